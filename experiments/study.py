"""What every study shares: a validated config, overrides, and a run folder that says where it came from.

python -m experiments.NAME [--config configs/NAME.toml] [--set key=value ...] [--quick] --out DIR
"""

import argparse
import dataclasses
import importlib.metadata
import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from didim_jax.config import build
from didim_jax.devices import use_every_core
from didim_jax.errors import InputError
from didim_jax.files import atomic_write
from didim_jax.report import prepare_folder

from .data import ROOT

_PACKAGES = ("didim_jax", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy", "scipy")


def main[C](name: str, config: type[C], run: Callable[[C, Path], None], argv: list[str] | None = None) -> None:
    """Read the config, make the run folder, run. One line and exit status 2 for a user's mistake.

    `configs/NAME.toml` holds the config, and under `[quick]` what `--quick` changes in it.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m experiments.{name}", description=sys.modules[run.__module__].__doc__
    )
    parser.add_argument("--config", type=Path, default=ROOT / "configs" / f"{name}.toml", help="TOML file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override; VALUE as in TOML")
    parser.add_argument("--quick", action="store_true", help="a small version, in seconds")
    parser.add_argument("--out", type=Path, required=True, help="run folder")
    arguments = parser.parse_args(argv)
    use_every_core()
    from didim_jax.cli import program  # after the devices are settled: it starts JAX

    with program():
        table = read(arguments.config, arguments.set, arguments.quick)
        chosen = build(config, table, str(arguments.config))
        out = prepare_folder(arguments.out)
        _describe(out, name, table, arguments.quick)
        run(chosen, out)


def read(path: Path, overrides: list[str], quick: bool) -> dict[str, Any]:
    """The config's table: the file, then its `[quick]` table if asked, then the overrides, dotted keys allowed."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such config file; give one with --config.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise InputError(f"{path}: {error}") from None
    small = table.pop("quick", {})
    if quick:
        table.update(small)
    for override in overrides:
        key, separator, text = override.partition("=")
        if not separator:
            raise InputError(f"--set {override}: write it as KEY=VALUE, the value as in TOML.")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            raise InputError(f"--set {override}: {text!r} is no TOML value (text needs quotes).") from None
        *parents, leaf = key.strip().split(".")
        place = table
        for parent in parents:
            place = place.setdefault(parent, {})
        place[leaf] = value
    return table


def _describe(out: Path, name: str, table: dict[str, Any], quick: bool) -> None:
    versions = {package: importlib.metadata.version(package) for package in _PACKAGES}
    provenance = {
        "study": name,
        "quick": quick,
        "config": table,
        "commit": commit(),
        "python": platform.python_version(),
        "packages": versions,
        "cores": os.cpu_count(),
    }
    write_json(out / "run.json", provenance)


def commit() -> str | None:
    """Commit of the checkout, with a plus where it was changed since; None outside one."""
    try:
        here = {"cwd": ROOT, "capture_output": True, "text": True, "check": True}
        head = subprocess.run(["git", "rev-parse", "HEAD"], **here).stdout.strip()  # type: ignore[call-overload]
        changed = subprocess.run(["git", "status", "--porcelain"], **here).stdout.strip()  # type: ignore[call-overload]
    except (OSError, subprocess.CalledProcessError):
        return None
    return head + ("+" if changed else "")


def write_json(path: Path, value: Any) -> None:
    """Write JSON under a temporary name, then rename. Not-a-number becomes null; dataclasses and NumPy go too."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(plain(value), indent=2, allow_nan=False), encoding="utf-8")


def plain(value: Any) -> Any:
    """As `write_json` writes it and a reader finds it."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain(dataclasses.asdict(value))
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if (isinstance(value, float) and value != value) or value in (float("inf"), float("-inf")):
        return None
    return value
