"""JAX on this machine: how every program sets it up, its devices, and what a process may hold."""

import multiprocessing
import os
import threading
from pathlib import Path

_MAPS, _MOST_MAPS = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")


def prepare_jax() -> None:
    """float64, a cache of compiled programs so that only the first run on a machine compiles, LAPACK on one thread.

    Its systems have a few columns here: threads of its own wait for each other and for JAX's, and make it slower.
    """
    import jax
    import platformdirs
    import scipy.linalg  # noqa: F401  # loaded, so that there is something to limit
    import threadpoolctl

    threadpoolctl.threadpool_limits(1, user_api="blas")

    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", platformdirs.user_cache_dir("didim_jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)
    # A thread then waits for its own computation, in its own time: two threads, two cores, one compiled program.
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def prepare_process() -> None:
    """The same in a process that works for another one, and ends with it."""
    prepare_jax()

    def follow() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def use_every_core() -> None:
    """One JAX device a core, so that work runs side by side. Must come before JAX is first used."""
    flag = f"--xla_force_host_platform_device_count={cores()}"
    if "xla_force_host_platform_device_count" not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()


def cores() -> int:
    """Processors that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(allowed(0)) if allowed else os.cpu_count() or 1


def forget_programs(full: float = 0.6) -> bool:
    """Drop all compiled programs once they fill this share of the regions of memory that Linux lets a process map.

    Each takes hundreds of the 65530; after some eighty cases the next one would fail for want of memory. What is used
    again comes from the cache on disk. Returns whether it had to; never where there is no such limit.
    """
    try:
        most = int(_MOST_MAPS.read_text())
        used = _MAPS.read_bytes().count(b"\n")
    except (OSError, ValueError):
        return False
    if used < full * most:
        return False
    import jax  # late: the devices are counted before JAX is first used

    jax.clear_caches()
    return True
