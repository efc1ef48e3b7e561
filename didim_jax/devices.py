"""JAX devices of this machine."""

import os
from pathlib import Path

_MAPS, _MOST_MAPS = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")


def use_every_core() -> None:
    """One JAX device a core, so that work runs side by side. Must come before JAX is first used."""
    flag = f"--xla_force_host_platform_device_count={cores()}"
    if "xla_force_host_platform_device_count" not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()


def cores() -> int:
    """Processors of this machine."""
    return os.cpu_count() or 1


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
