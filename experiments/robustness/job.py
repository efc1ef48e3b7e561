"""One map: many starts of one method, run chunk by chunk, and every end judged by itself."""

import dataclasses
import enum
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import optimistix as optx
import xarray as xr

from didim_jax.identify import Stopping, didim_columns, exact_columns
from didim_jax.identify.least_squares import Columns, Problem
from didim_jax.sweep import Ended, Lanes, least_squares_lanes, nelder_mead_lanes, sweep

from .safeguard import SafeguardedGaussNewton, damped_from_the_start


class Outcome(enum.IntEnum):
    """How a lane ended, beside the truth."""

    TRUTH = 1
    ELSEWHERE = 2
    DIVERGED = 3
    EXHAUSTED = 4


WORDS = {
    Outcome.TRUTH: "converged to the truth",
    Outcome.ELSEWHERE: "converged elsewhere",
    Outcome.DIVERGED: "diverged",
    Outcome.EXHAUSTED: "iterations exhausted",
}


@dataclasses.dataclass(frozen=True)
class Method:
    """Name, columns and step of a least squares; Nelder-Mead has neither."""

    name: str
    columns: Columns | None = None
    solver: optx.AbstractLeastSquaresSolver | None = None

    @property
    def slug(self) -> str:
        """The name as part of a file's name."""
        return self.name.lower().replace(" ", "_").replace("-", "_").replace(",", "")

    @property
    def bounded(self) -> bool:
        """Whether masses and stiffness are moved as logarithms. DIDIM's least squares is in theta itself."""
        return self.columns is not didim_columns


_GAUSS_NEWTON: optx.GaussNewton = optx.GaussNewton(rtol=0.0, atol=0.0)

DIDIM = Method("DIDIM", didim_columns, _GAUSS_NEWTON)
SAFE_DIDIM = Method("DIDIM with safeguard", didim_columns, SafeguardedGaussNewton())
EXACT = Method("exact Gauss-Newton", exact_columns, _GAUSS_NEWTON)
DAMPED = Method("exact Levenberg-Marquardt", exact_columns, damped_from_the_start())
NELDER_MEAD = Method("Nelder-Mead")


@dataclasses.dataclass(frozen=True)
class Job:
    """Many starts, theta (n, n_theta), of one method on one problem.

    A lane has found the truth when every parameter of `target` is within `tolerance` of it, relative. `unstable` says
    which starts have no finite simulation. `observed` gives every lane a signal of its own.
    """

    name: str
    method: Method
    problem: Problem
    starts: np.ndarray
    target: Mapping[str, float]
    tolerance: float
    stopping: Stopping
    key: Mapping[str, object]
    unstable: np.ndarray
    observed: np.ndarray | None = None
    batch: int = 4
    chunk: int = 64

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta."""
        return self.problem[0].names


def run(job: Job, out: Path) -> xr.Dataset:
    """Lanes of the job in `out/maps/NAME.zarr`: start, theta, cost, n_iterations, ended, outcome, unstable."""
    store = out / "maps" / f"{job.name}.zarr"
    key = {
        "job": job.name,
        "method": job.method.name,
        "stopping": dataclasses.asdict(job.stopping),
        "batch": job.batch,
        **job.key,
    }
    begin = time.perf_counter()
    lanes = sweep(
        store, job.starts, job.parameters, lambda s, r: _lanes(job, s, r), key=key, chunk=job.chunk, title=job.name
    )
    judged = lanes.assign(
        outcome=("lane", judge(lanes, job.target, job.tolerance)), unstable=("lane", np.asarray(job.unstable))
    )
    spent = lanes.attrs.get("seconds", 0.0) + time.perf_counter() - begin  # of this run and those before it
    judged.attrs.update(seconds=spent, outcomes={o.name.lower(): o.value for o in Outcome})
    extra = judged[["outcome", "unstable"]].drop_vars("parameter", errors="ignore")
    extra.attrs = dict(judged.attrs)
    extra.to_zarr(store, mode="a", consolidated=False)
    return judged


def _lanes(job: Job, starts: np.ndarray, rows: slice) -> Lanes:
    observed = None if job.observed is None else job.observed[rows]
    if job.method.columns is None or job.method.solver is None:
        return nelder_mead_lanes(job.problem, starts, job.stopping, observed, batch=job.batch)
    return least_squares_lanes(
        job.problem, starts, job.method.columns, job.method.solver, job.stopping, observed, batch=job.batch
    )


def judge(lanes: xr.Dataset, target: Mapping[str, float], tolerance: float) -> np.ndarray:
    """`Outcome` of every lane, (n,)."""
    theta = lanes["theta"].sel(parameter=list(target)).values
    wanted = np.array(list(target.values()))
    there = np.all(np.abs(theta / wanted - 1) < tolerance, axis=1)
    ended = lanes["ended"].values
    return np.select(
        [ended == Ended.DIVERGED, ended == Ended.EXHAUSTED, there],
        [Outcome.DIVERGED, Outcome.EXHAUSTED, Outcome.TRUTH],
        Outcome.ELSEWHERE,
    ).astype(np.int64)


@dataclasses.dataclass(frozen=True)
class Count:
    """Lanes of one region, by how they ended; iterations are those of lanes that found the truth."""

    lanes: int
    truth: int
    elsewhere: int
    diverged: int
    exhausted: int
    iterations_median: float
    iterations_most: int

    @property
    def percent(self) -> float:
        """Share that found the truth."""
        return 100 * self.truth / self.lanes if self.lanes else float("nan")


def count(lanes: xr.Dataset, where: np.ndarray | None = None) -> Count:
    """Count the lanes (of a region, (n,) bool)."""
    chosen = np.ones(lanes.sizes["lane"], bool) if where is None else where
    outcome = lanes["outcome"].values[chosen]
    of = {kind: int(np.sum(outcome == kind)) for kind in Outcome}
    n = lanes["n_iterations"].values[chosen][outcome == Outcome.TRUTH]
    return Count(
        lanes=len(outcome),
        truth=of[Outcome.TRUTH],
        elsewhere=of[Outcome.ELSEWHERE],
        diverged=of[Outcome.DIVERGED],
        exhausted=of[Outcome.EXHAUSTED],
        iterations_median=float(np.median(n)) if n.size else float("nan"),
        iterations_most=int(n.max()) if n.size else 0,
    )


def range_of(lanes: xr.Dataset, values: np.ndarray, near: float) -> tuple[float, float] | None:
    """The widest unbroken range of `values`, around `near`, in which every lane found the truth; None if none has."""
    good = lanes["outcome"].values == Outcome.TRUTH
    order = np.argsort(values)
    values, good = values[order], good[order]
    middle = int(np.argmin(np.abs(np.log(np.maximum(values, 1e-300) / near))))
    if not good[middle]:
        return None
    low, high = middle, middle
    while low > 0 and good[low - 1]:
        low -= 1
    while high < len(good) - 1 and good[high + 1]:
        high += 1
    return float(values[low]), float(values[high])
