"""From the start of step 2 to the end, by every method: criterion, distance from the truth, simulations, seconds."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from didim_jax.identify import IdentificationResult, Stopping, didim, gauss_newton, levenberg_marquardt
from didim_jax.identify.three_step import STEP_3, mode_step, rigid_step
from didim_jax.plant import CoulombViscous, RigidDrive
from didim_jax.signals import Decimation

from .config import Config
from .twin import FIVE, SEVEN, Starts, Twin, drive

ON = Stopping(tolerance=1e-3, max_iterations=60)
"""DIDIM beyond eq. 21, to where it stays."""

FLEXIBLE = {
    "didim five": "DIDIM, five columns",
    "didim seven": "DIDIM, seven columns, no friction at first",
    "didim seven half": "DIDIM, seven columns, friction halved",
    "didim seven truth": "DIDIM, seven columns, from the truth",
    "exact five": "exact Gauss-Newton, five parameters",
    "gauss-newton": "exact Gauss-Newton, seven",
    "levenberg-marquardt": "exact Levenberg-Marquardt, seven",
}
"""Methods of step 3 by key, and how they are called on the page."""

RIGID = ("didim 5 Hz", "gauss-newton 5 Hz", "didim 60 Hz", "gauss-newton 60 Hz")


@dataclasses.dataclass(frozen=True)
class Path:
    """One identification, run twice: the first call compiles (or reads a stored program), the second is warm."""

    result: IdentificationResult
    first_seconds: float
    warm_seconds: float


def timed(identify: Callable[[], IdentificationResult]) -> Path:
    """Run it twice."""
    begin = time.perf_counter()
    identify()
    between = time.perf_counter()
    result = identify()
    return Path(result, between - begin, time.perf_counter() - between)


def flexible_paths(twin: Twin, starts: Starts, config: Config) -> dict[str, Path]:
    """Step 3 on the noisy record by each method of FLEXIBLE; DIDIM runs on past eq. 21, whose stop is in its costs.

    Exact methods start with step 1's friction, all of it on the motor side, DIDIM with none, as the paper has it.
    """
    trials = (twin.trial(twin.plant, Decimation.at(config.cutoff_hz, twin.dt), twin.noisy),)
    truth = drive(twin.truth)
    return {
        "didim five": timed(lambda: didim(starts.zero, FIVE, trials, ON)),
        "didim seven": timed(lambda: didim(starts.zero, SEVEN, trials, ON)),
        "didim seven half": timed(lambda: didim(starts.half, SEVEN, trials, ON)),
        "didim seven truth": timed(lambda: didim(truth, SEVEN, trials, ON)),
        "exact five": timed(lambda: gauss_newton(starts.motor, FIVE, trials)),
        "gauss-newton": timed(lambda: gauss_newton(starts.motor, SEVEN, trials)),
        "levenberg-marquardt": timed(lambda: levenberg_marquardt(starts.motor, SEVEN, trials)),
    }


def rigid_paths(twin: Twin, config: Config) -> dict[str, Path]:
    """Step 1 by DIDIM and by exact Gauss-Newton, below 5 Hz and, where it does not belong, below 60 Hz."""
    start = RigidDrive(twin.machine.mass_apriori, CoulombViscous(0.0, 0.0))
    names = ("M", "Fv", "Fc")
    paths = {}
    for name, hz in (("5 Hz", config.rigid_hz), ("60 Hz", config.cutoff_hz)):
        trials = (twin.trial(start, Decimation.at(hz, twin.dt), twin.noisy),)
        paths[f"didim {name}"] = timed(lambda trials=trials: didim(start, names, trials))  # type: ignore[misc]
        paths[f"gauss-newton {name}"] = timed(lambda trials=trials: gauss_newton(start, names, trials))  # type: ignore[misc]
    return paths


def step_paths(twin: Twin) -> dict[str, Path]:
    """Steps 1 and 2, which every flexible identification here begins with."""
    case = twin.case()
    step1 = timed(lambda: rigid_step(case))
    return {"step 1": step1, "step 2": timed(lambda: mode_step(case, step1.result))}


def eq_21(costs: np.ndarray) -> int:
    """The iterate at which the paper's stopping rule ends a path: the criterion changes by less than 5 % of itself."""
    changes = np.abs(np.diff(costs)) <= STEP_3.cost_tolerance * costs[:-1]
    return int(np.argmax(changes)) + 1 if changes.any() else len(costs) - 1


def distance(result: IdentificationResult, trace: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Root mean square of the relative errors of M1, M2 and K12 along a path, percent."""
    wanted = ("M1", "M2", "K12")
    here = trace[:, [result.names.index(n) for n in wanted]]
    there = truth[[SEVEN.index(n) for n in wanted]]
    return 100 * np.sqrt(np.mean((here / there - 1) ** 2, axis=1))
