"""Results of a sweep as labelled arrays in a zarr store, written chunk by chunk: a killed run goes on where it was."""

import hashlib
import json
import os
import shutil
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from .lanes import Ended, Lanes

_VARIABLES = {"start", "theta", "cost", "n_iterations", "ended"}


def sweep(
    store: str | os.PathLike[str],
    starts: np.ndarray,
    parameters: tuple[str, ...],
    run: Callable[[np.ndarray, slice], Lanes],
    *,
    key: Mapping[str, object],
    chunk: int = 64,
    title: str = "sweep",
) -> xr.Dataset:
    """Run every start, theta (n, n_theta), in chunks: `run(starts[rows], rows)`; returns what the store then holds.

    `key` says what the results depend on (any JSON). A store with the same key is continued: chunks that are there
    are not run again. One with another key is begun anew.

    Variables over (lane, parameter): start, theta; over lane: cost, n_iterations, ended (`Ended`).
    """
    store, n = Path(store), len(starts)
    digest = hashlib.sha256(json.dumps([dict(key), starts.tolist()], sort_keys=True, default=str).encode()).hexdigest()
    if not _continues(store, digest):
        _begin(store, starts, parameters, digest, min(chunk, n))
    done = _open(store)["ended"].values != Ended.NOT_RUN
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as progress:
        task = progress.add_task(title, total=n, completed=int(done.sum()))
        for first in range(0, n, chunk):
            rows = slice(first, min(first + chunk, n))
            if done[rows].all():
                continue
            lanes = run(starts[rows], rows)
            part = xr.Dataset(
                {
                    "theta": (("lane", "parameter"), np.asarray(lanes.theta)),
                    "cost": ("lane", np.asarray(lanes.cost)),
                    "n_iterations": ("lane", np.asarray(lanes.n_iterations)),
                    # last, since it is what tells a later run that this chunk is whole
                    "ended": ("lane", np.asarray(lanes.ended)),
                }
            )
            part.to_zarr(store, region={"lane": rows}, consolidated=False)
            progress.advance(task, rows.stop - rows.start)
    return _open(store).load()


def _open(store: Path) -> xr.Dataset:
    return xr.open_zarr(store, consolidated=False)


def _continues(store: Path, digest: str) -> bool:
    if not store.exists():
        return False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # zarr warns of what it does not know; then the store is begun anew
            held = _open(store)
        return held.attrs.get("digest") == digest and set(held) >= _VARIABLES
    except (OSError, ValueError, KeyError):  # not a store, or a broken one
        return False


def _begin(store: Path, starts: np.ndarray, parameters: tuple[str, ...], digest: str, chunk: int) -> None:
    """Make the empty store beside its place and move it there whole: a killed beginning leaves nothing half made."""
    fresh = store.with_name(f".{store.name}-begun")
    for old in (fresh, store):
        if old.is_dir():
            shutil.rmtree(old)
    n, k = starts.shape
    empty = xr.Dataset(
        {
            "start": (("lane", "parameter"), starts),
            "theta": (("lane", "parameter"), np.full((n, k), np.nan)),
            "cost": ("lane", np.full(n, np.nan)),
            "n_iterations": ("lane", np.zeros(n, dtype=np.int64)),
            "ended": ("lane", np.full(n, Ended.NOT_RUN.value, dtype=np.int64)),
        },
        coords={"parameter": list(parameters)},
        attrs={"digest": digest, "ended": {e.name.lower(): e.value for e in Ended}},
    )
    encoding = {name: {"chunks": (chunk, *variable.shape[1:])} for name, variable in empty.data_vars.items()}
    fresh.parent.mkdir(parents=True, exist_ok=True)
    empty.to_zarr(fresh, mode="w", encoding=encoding, consolidated=False)
    fresh.rename(store)
