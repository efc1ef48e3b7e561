"""Step 2: mass ratio and mode from starts all over the plane (paper, section V.C; eq. 28 and section VI.D)."""

import dataclasses
from pathlib import Path

import numpy as np
import xarray as xr

from didim_jax.identify import Stopping
from didim_jax.identify.flexible_mode import STOPPING, mode_parameters
from didim_jax.identify.three_step import FLEXIBLE_HZ
from didim_jax.params import values
from didim_jax.plant import RigidDrive, mass_ratio, mode
from didim_jax.sweep import least_squares_lanes

from .config import Config
from .job import DAMPED, EXACT, NELDER_MEAD, Job, Method, count, run
from .twin import Law, Twin

TOLERANCE = 0.02
"""Of lam and f_n: a lane within it has found the criterion's minimum (which lies beside the truth, friction being
all on the motor side)."""

METHODS = (NELDER_MEAD, EXACT, DAMPED)

BOXES = {"the paper's box": ((0.25, 0.95), (15.0, 50.0)), "eq. 28's box": ((0.1, 0.9), (10.0, 80.0))}
"""lam and f_n (Hz), from and to: found to converge in section VI.D, recommended in eq. 28."""

_LEAST_SQUARES = Stopping(tolerance=1e-3, max_iterations=40)


def target(twin: Twin, rigid: RigidDrive) -> dict[str, float]:
    """Where the criterion is least: damped exact steps from the true (lam, f_n)."""
    start = np.array([true_mode(twin)])
    assert DAMPED.columns is not None and DAMPED.solver is not None
    problem = (mode_parameters(rigid), (twin.trial(twin.truth, FLEXIBLE_HZ),))
    end = least_squares_lanes(problem, start, DAMPED.columns, DAMPED.solver, _LEAST_SQUARES)
    return {"lam": float(end.theta[0, 0]), "f_n": float(end.theta[0, 1])}


def true_mode(twin: Twin) -> tuple[float, float]:
    """(lam, f_n in Hz) of the true drive."""
    true = twin.true
    return float(mass_ratio(true["M1"], true["M2"])), float(mode(true["M2"], true["K12"]))


def grid(config: Config, law: Law) -> np.ndarray:
    """Starts (lam, f_n), (n, 2): even in lam, geometric in f_n."""
    coarser = (config.share(10000, law) / 10000) ** 0.5
    n_lam, n_f_n = (max(2, round(coarser * n)) for n in config.mode_grid)
    lam = np.linspace(*config.mode_lam, n_lam)
    f_n = np.geomspace(*config.mode_f_n_Hz, n_f_n)
    return np.stack(np.meshgrid(lam, f_n, indexing="ij"), axis=-1).reshape(-1, 2)


def maps(config: Config, twin: Twin, rigid: RigidDrive, out: Path) -> dict[str, xr.Dataset]:
    """One map a method, from the same starts."""
    starts = grid(config, twin.law)
    wanted = target(twin, rigid)
    return {m.name: one(config, twin, rigid, m, starts, wanted, out) for m in METHODS}


def one(
    config: Config,
    twin: Twin,
    rigid: RigidDrive,
    method: Method,
    starts: np.ndarray,
    wanted: dict[str, float],
    out: Path,
    suffix: str = "",
) -> xr.Dataset:
    """One method from the given starts."""
    family = mode_parameters(rigid)
    simplex = dataclasses.replace(STOPPING, max_iterations=config.mode_iterations)
    job = Job(
        name=f"step2_{method.slug}_{twin.law}{suffix}",
        method=method,
        problem=(family, (twin.trial(twin.truth, FLEXIBLE_HZ),)),
        starts=starts,
        target=wanted,
        tolerance=TOLERANCE,
        stopping=simplex if method is NELDER_MEAD else _LEAST_SQUARES,
        key={**twin.key, "rigid": values(rigid)},
        unstable=twin.unstable([family.plant(start) for start in starts]),
        batch=8 if method is NELDER_MEAD else 4,
    )
    return run(job, out)


def ranges(lanes: xr.Dataset) -> dict[str, object]:
    """What `ranges.json` says of one map."""
    unstable = lanes["unstable"].values
    said: dict[str, object] = {"all starts": count(lanes), "stable loop at the start": count(lanes, ~unstable)}
    for name, box in BOXES.items():
        said[name] = count(lanes, inside(lanes, box))
        said[f"{name}, stable loop at the start"] = count(lanes, inside(lanes, box) & ~unstable)
    return said


def inside(lanes: xr.Dataset, box: tuple[tuple[float, float], tuple[float, float]]) -> np.ndarray:
    """Which starts lie in the box, (n,) bool."""
    lam, f_n = lanes["start"].sel(parameter="lam").values, lanes["start"].sel(parameter="f_n").values
    (a, b), (c, d) = box
    return (lam >= a) & (lam <= b) & (f_n >= c) & (f_n <= d)
