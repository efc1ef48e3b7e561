"""What else may be wrong: the initial state, the noise, the gains of the control law. Exact Gauss-Newton and DIDIM.

Every lane has a record of its own, made with the mistake; the fit knows nothing of it.
"""

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from didim_jax.control import SampledPD
from didim_jax.identify import Stopping
from didim_jax.identify.three_step import FLEXIBLE_HZ, STEP_3
from didim_jax.plant import RigidDrive
from didim_jax.signals import Decimation
from didim_jax.simulate import SampledLoop, Start, simulate

from . import global_start
from .config import Config
from .job import DIDIM, EXACT, Job, Method, run
from .twin import RECORD, Twin

_STOPPING = Stopping(tolerance=1e-4)


@dataclasses.dataclass(frozen=True)
class Condition:
    """One mistake: its name, its sizes, and how a record with it is made: (size, generator) -> force (n,) in N."""

    name: str
    label: str
    levels: tuple[float, ...]
    force: Callable[[float, np.random.Generator], np.ndarray]


def conditions(config: Config, twin: Twin) -> Iterator[Condition]:
    """The mistakes of this study; each record has the twin's own noise unless the noise is what varies."""

    def noisy(size: float, draw: np.random.Generator, tau: np.ndarray) -> np.ndarray:
        return tau + draw.normal(0.0, size, len(tau)) if size else tau

    def state(size: float, draw: np.random.Generator) -> np.ndarray:
        return noisy(config.noise_N, draw, force(twin, start_off=size * draw.normal(size=_n_start(twin))))

    def noise(size: float, draw: np.random.Generator) -> np.ndarray:
        return noisy(size, draw, force(twin))

    def position_gain(size: float, draw: np.random.Generator) -> np.ndarray:
        return noisy(config.noise_N, draw, force(twin, kp=1 + size))

    def velocity_gain(size: float, draw: np.random.Generator) -> np.ndarray:
        return noisy(config.noise_N, draw, force(twin, kv=1 + size))

    yield Condition("state", "initial state off, typical sizes (1e-5 m, 1e-3 m/s)", config.state_sizes, state)
    yield Condition("noise", "noise, N rms at 1 kHz", config.noise_levels_N, noise)
    yield Condition("kp", "true kp off, relative", config.gain_errors, position_gain)
    yield Condition("kv", "true kv off, relative", config.gain_errors, velocity_gain)


def force(twin: Twin, *, start_off: np.ndarray | None = None, kp: float = 1.0, kv: float = 1.0) -> np.ndarray:
    """Motor force (N) of the true drive without noise; gains as multiples, the start off by typical sizes."""
    loop = twin.loop(twin.truth, RECORD)
    assert isinstance(loop, SampledLoop) and isinstance(loop.controller, SampledPD)
    law = SampledPD(loop.controller.kp * kp, loop.controller.kv * kv)
    at_rest = twin.trial(twin.truth, FLEXIBLE_HZ, method=RECORD)
    start = at_rest.start
    if start_off is not None:
        k = len(twin.truth.state_scales)
        sizes = np.concatenate([twin.truth.state_scales, loop.memory_scales])
        moved = start_off * sizes
        start = Start(start.plant + moved[:k], start.memory + moved[k:])
    return np.asarray(simulate(dataclasses.replace(loop, controller=law), at_rest.excitation, start).tau)


def _n_start(twin: Twin) -> int:
    return len(twin.truth.state_scales) + len(twin.loop(twin.truth).memory_scales)


def maps(config: Config, twin: Twin, rigid: RigidDrive, out: Path) -> dict[str, dict[str, xr.Dataset]]:
    """By mistake, then by method."""
    done: dict[str, dict[str, xr.Dataset]] = {}
    decimation = Decimation.at(FLEXIBLE_HZ, twin.machine.controller.sample_time)
    for condition in conditions(config, twin):
        levels = np.repeat(condition.levels, config.condition_draws)
        draws = [np.random.default_rng([config.seed, k]) for k in range(len(levels))]
        observed = np.stack(
            [decimation(condition.force(level, draw)) for level, draw in zip(levels, draws, strict=True)]
        )
        done[condition.name] = {DIDIM.name: _run(twin, rigid, condition, DIDIM, levels, observed, out)}
        done[condition.name][EXACT.name] = _run(twin, rigid, condition, EXACT, levels, observed, out)
        if condition.name == "state":
            fitted = _run(twin, rigid, condition, EXACT, levels, observed, out, at_rest=False)
            done[condition.name][f"{EXACT.name}, start fitted"] = fitted
    return done


def _run(
    twin: Twin,
    rigid: RigidDrive,
    condition: Condition,
    method: Method,
    levels: np.ndarray,
    observed: np.ndarray,
    out: Path,
    at_rest: bool = True,
) -> xr.Dataset:
    starts = global_start.start(method, twin, rigid, np.full((len(levels), 3), 0.05))
    job = Job(
        name=f"{condition.name}_{method.slug}{'' if at_rest else '_start_fitted'}",
        method=method,
        problem=global_start.problem(method, twin, at_rest=at_rest),
        starts=starts,
        target={name: twin.true[name] for name in global_start.MASSES},
        tolerance=global_start.TOLERANCE if method.bounded else global_start.DIDIM_TOLERANCE,
        stopping=_STOPPING if method.bounded else STEP_3,
        key={**twin.key, "levels": levels.tolist(), "seconds": len(twin.recording)},
        unstable=np.zeros(len(starts), bool),
        observed=observed,
        batch=4 if method.bounded else 2,
    )
    lanes = run(job, out)
    theta = lanes["theta"].sel(parameter=list(global_start.MASSES)).values
    true = np.array([twin.true[name] for name in global_start.MASSES])
    return lanes.assign(level=("lane", levels), error=("lane", np.abs(theta / true - 1).max(axis=1)))


def ranges(lanes: xr.Dataset) -> list[dict[str, float]]:
    """Median and largest error of M1, M2 and K12, percent, and how many lanes converged, a row for every size."""
    rows = []
    for level in np.unique(lanes["level"].values):
        here = lanes["level"].values == level
        error = 100 * lanes["error"].values[here]
        rows.append(
            {
                "level": float(level),
                "lanes": int(here.sum()),
                "converged": int(np.sum(lanes["outcome"].values[here] <= 2)),
                "median_percent": float(np.median(error)),
                "most_percent": float(np.max(error)),
            }
        )
    return rows
