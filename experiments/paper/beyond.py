"""What the tables do not show: equations as printed, other starts, the spread of the payload, another trajectory."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from didim_jax.identify import PlantParameters, Run, Stopping, didim_columns, exact_columns
from didim_jax.identify.least_squares import Columns
from didim_jax.identify.study import run
from didim_jax.identify.three_step import global_start
from didim_jax.params import pack
from didim_jax.plant import AbstractPlant, FlexibleDrive
from didim_jax.sweep.lanes import Ended, Lanes, least_squares_lanes

from .config import PaperConfig
from .methods import DIDIM, EXACT, FIVE, FLEXIBLE, SEVEN, STEP_1, STEP_2, Fit, rigid, shape, split, third_step
from .published import BARE
from .twin import PLUS, Twin, trials_of

type Fits = dict[str, dict[str, Fit]]
"""Twin, method -> fit."""


@dataclasses.dataclass(frozen=True)
class AsPrinted:
    """Eq. 21 without its absolute value and eq. 29 without its square, each followed to the letter.

    `stops_at` is the iteration at which (cost[k] - cost[k-1]) / cost[k-1] first is below the tolerance, `M2` (kg) and
    `cost` what step 3 has there; `K12` (N/m) is the start by eq. 29 as printed, and `fit` where step 3 ends from it.
    """

    stops_at: int
    M2: float
    cost: float
    K12: float
    fit: Fit


def as_printed(twin: Twin, config: PaperConfig, fits: dict[str, Fit]) -> AsPrinted:
    """Follow the paper's eq. 21 and eq. 29 as they are printed."""
    result = fits[DIDIM].result
    change = np.diff(result.costs) / result.costs[:-1]
    stops_at = int(np.argmax(change <= config.eq_21_tolerance)) + 1
    start = global_start(fits[STEP_1].result, fits[STEP_2].result)
    f_n = fits[STEP_2].result["f_n"]
    literal = eqx.tree_at(lambda drive: drive.K12, start, jnp.asarray(start.K12) / f_n)
    fit = third_step(twin.case(config), config, literal, FIVE)
    M2 = float(result.trace[stops_at][result.names.index("M2")])
    return AsPrinted(stops_at, M2, float(result.costs[stops_at]), float(literal.K12), fit)


@dataclasses.dataclass(frozen=True)
class Restart:
    """A step from another start, and whether it ends where the published start does (within 1 %)."""

    step: str
    start: str
    found: str
    iterations: int
    same: bool


def other_starts(twin: Twin, config: PaperConfig, fits: dict[str, Fit]) -> list[Restart]:
    """Steps 1 and 2 from the ends of the ranges for which the paper reports convergence (VI.C, VI.D)."""
    case, found = twin.case(config), []
    for mass in config.step_1_masses_kg:
        again = rigid(case, config, mass)
        found.append(_restart(STEP_1, f"M_tot {mass:g} kg", again, fits[STEP_1]))
    for start in config.step_2_starts:
        again = shape(case, config, fits[STEP_1].result, start)
        found.append(_restart(STEP_2, f"lam {start[0]:g}, f_n {start[1]:g} Hz", again, fits[STEP_2]))
    return found


def _restart(step: str, start: str, again: Fit, first: Fit) -> Restart:
    one, other = again.result, first.result
    same = one.converged and bool(np.allclose(one.theta, other.theta, rtol=0.01))
    end = ", ".join(f"{n} {v:.4g} {u}" for n, v, u in zip(one.names, one.theta, one.units, strict=True))
    return Restart(step, start, end.replace(" 1,", ","), one.n_iterations, same)


@dataclasses.dataclass(frozen=True)
class Draws:
    """Delta M2 (kg) of one method over many draws of the noise, and how many of them converged on both drives."""

    delta_M2: np.ndarray
    asked: int

    @property
    def mean(self) -> float:
        """kg."""
        return float(np.mean(self.delta_M2))

    @property
    def std(self) -> float:
        """kg, of one draw."""
        return float(np.std(self.delta_M2, ddof=1))


def payload_draws(sets: dict[str, Twin], config: PaperConfig, fits: Fits) -> dict[str, Draws]:
    """Exact Gauss-Newton and DIDIM on fresh noise, with 10 kg and without; steps 1 and 2 stay those of the records."""
    exact = (SEVEN, exact_columns, Stopping(config.exact_tolerance))
    approximate = (FIVE, didim_columns, Stopping(config.didim_tolerance, config.eq_21_tolerance))
    found = {}
    for method, (names, columns, stopping) in ((EXACT, exact), (DIDIM, approximate)):
        M2 = []
        for k, name in enumerate((BARE, PLUS)):
            steps = fits[name][STEP_1].result, fits[name][STEP_2].result
            start = split(*steps) if method == EXACT else global_start(*steps)
            lanes = _lanes(sets[name], config, start, names, columns, stopping, seed=config.seed + 1000 + k)
            M2.append(np.where(lanes.ended == Ended.CONVERGED, np.asarray(lanes.theta)[:, names.index("M2")], np.nan))
        delta = M2[1] - M2[0]
        found[method] = Draws(delta[np.isfinite(delta)], config.draws)
    return found


def _lanes(
    twin: Twin,
    config: PaperConfig,
    start: FlexibleDrive,
    names: tuple[str, ...],
    columns: Columns,
    stopping: Stopping,
    seed: int,
) -> Lanes:
    trial = trials_of(twin.case(config), start, config.flexible_cutoff_hz)[0]
    noise = np.random.default_rng(seed).normal(0.0, config.force_noise_N, (config.draws, len(twin.clean)))
    observed = np.stack([np.asarray(trial.decimation(jnp.asarray(twin.clean.tau + row))) for row in noise])
    parametrisation = PlantParameters.of(start, names, bounded=columns is exact_columns)
    theta0 = np.tile(np.asarray(pack(start, parametrisation.chosen)), (config.draws, 1))
    solver: optx.GaussNewton = optx.GaussNewton(rtol=0.0, atol=0.0)
    return least_squares_lanes((parametrisation, (trial,)), theta0, columns, solver, stopping, observed)


THE_TWIN = "the twin itself"
"""The floor of the cross-validation: the true parameters, and the noise."""


def cross_validation(twin: Twin, config: PaperConfig, fits: dict[str, Fit]) -> dict[str, Run]:
    """The second trajectory simulated with each method's drive; nothing is fitted to it. References: paper, fig. 6."""
    case = twin.case(config)
    drives: dict[str, AbstractPlant] = {method: fits[method].result.plant for method in FLEXIBLE}
    return {name: run(case, twin.check, drive) for name, drive in (drives | {THE_TWIN: twin.plant}).items()}
