"""JAX devices of this machine."""

import os


def use_every_core() -> None:
    """One JAX device a core, so that work runs side by side. Must come before JAX is first used."""
    flag = f"--xla_force_host_platform_device_count={cores()}"
    if "xla_force_host_platform_device_count" not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()


def cores() -> int:
    """Processors of this machine."""
    return os.cpu_count() or 1
