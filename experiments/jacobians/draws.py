"""Bias, spread and coverage of each method over noise draws, against the Cramer-Rao bound.

References: paper, eq. 13-14; C. R. Rao, 1945; H. Cramer, 1946.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scipy.stats
from jax import Array

from didim_jax.identify import PlantParameters, Stopping, Trial, didim_columns, exact_columns, gauss_newton
from didim_jax.identify.gauss_newton import STOPPING
from didim_jax.identify.three_step import STEP_3
from didim_jax.plant import FlexibleDrive
from didim_jax.signals import Decimation
from didim_jax.statistics import cramer_rao, spread
from didim_jax.sweep import Ended, Lanes, least_squares_lanes

from .angles import Pair
from .config import Config
from .paths import ON
from .twin import FIVE, SEVEN, Starts, Twin

_AT_ONCE = 100  # noise draws that are filtered together: 12 MB


def noisy_signals(tau: np.ndarray, decimation: Decimation, noise: float, n: int, seed: int) -> np.ndarray:
    """The compared signal of `n` draws of white noise (N rms per sample) on a recorded force, (n, n_decimated)."""
    generator = np.random.default_rng(seed)
    sizes = [min(_AT_ONCE, n - k) for k in range(0, n, _AT_ONCE)]
    parts = [decimation(tau[:, None] + generator.normal(0.0, noise, (len(tau), size))).T for size in sizes]
    return np.ascontiguousarray(np.concatenate(parts))


def lanes(
    trial: Trial,
    start: FlexibleDrive,
    names: tuple[str, ...],
    stopping: Stopping,
    observed: np.ndarray,
    *,
    exact: bool,
) -> Lanes:
    """One identification per draw, all from the same start; the parametrisation is that of the package's methods."""
    parametrisation = PlantParameters.of(start, names, bounded=exact)
    starts = np.tile(np.asarray(parametrisation.start()), (len(observed), 1))
    solver: optx.GaussNewton = optx.GaussNewton(rtol=0.0, atol=0.0)
    kind = exact_columns if exact else didim_columns
    return least_squares_lanes((parametrisation, (trial,)), starts, kind, solver, stopping, observed, batch=1)


@dataclasses.dataclass(frozen=True)
class Sample:
    """Estimates of one method over the draws, in the order of SEVEN: what it does not estimate is its start's zero.

    `theta` has the draws that converged, (n_converged, 7), `costs` their norm(rho) / norm(Y).
    """

    theta: np.ndarray
    names: tuple[str, ...]
    converged: int
    draws: int
    iterations: float
    costs: np.ndarray

    def bias(self, truth: np.ndarray) -> np.ndarray:
        """Mean error, SI units."""
        return self.theta.mean(axis=0) - truth

    @property
    def std(self) -> np.ndarray:
        """Standard deviation over the draws, SI units."""
        return self.theta.std(axis=0, ddof=1)


def sample(found: Lanes, names: tuple[str, ...]) -> Sample:
    """The converged lanes."""
    ok = np.asarray(found.ended) == Ended.CONVERGED
    theta = np.zeros((int(ok.sum()), len(SEVEN)))
    theta[:, [SEVEN.index(n) for n in names]] = np.asarray(found.theta)[ok]
    return Sample(
        theta,
        names,
        int(ok.sum()),
        len(ok),
        float(np.mean(np.asarray(found.n_iterations)[ok])),
        np.asarray(found.cost)[ok],
    )


def every_method(twin: Twin, starts: Starts, config: Config) -> tuple[dict[str, Sample], np.ndarray]:
    """Draws of exact Gauss-Newton and of the config's other methods, and the compared signals of the former.

    The first draws are the same for all. Exact Gauss-Newton starts from the truth (`checked` repeats some of its draws
    from step 2). DIDIM starts where step 2 leaves it and ends by eq. 21, as in the paper's step 3; "didim seven truth"
    starts from the truth and runs on.
    """
    decimation = Decimation.at(config.cutoff_hz, twin.dt)
    trial = twin.trial(twin.plant, decimation)
    observed = noisy_signals(twin.clean.tau, decimation, config.noise, config.draws, config.seed)
    few = observed[: config.approximate_draws]
    recipes = {
        "gauss-newton": (twin.plant, SEVEN, STOPPING, True),
        "didim five": (starts.zero, FIVE, STEP_3, False),
        "didim seven": (starts.zero, SEVEN, STEP_3, False),
        "didim seven half": (starts.half, SEVEN, STEP_3, False),
        "didim seven truth": (twin.plant, SEVEN, ON, False),
        "exact five": (starts.motor, FIVE, STOPPING, True),
    }
    found = {}
    for key in ("gauss-newton", *config.methods):
        start, names, stopping, exact = recipes[key]
        signals = observed if key == "gauss-newton" else few
        found[key] = sample(lanes(trial, start, names, stopping, signals, exact=exact), names)
    return found, observed


@dataclasses.dataclass(frozen=True)
class Intervals:
    """Standard deviations that each draw states of itself, (n, 7): eq. 13-14, and for a residual of any spectrum."""

    white: np.ndarray
    autocorrelated: np.ndarray


def own_std(twin: Twin, config: Config, pair: Pair, theta: np.ndarray, observed: np.ndarray) -> Intervals:
    """Each draw's own standard deviations: from its own residual, one simulation each, and the columns at the truth.

    The columns differ between a draw's estimate and the truth by as much as the parameters do, 1e-3 at most of M1, M2
    and K12 (`checked` compares with the full ones).
    """
    decimation = Decimation.at(config.cutoff_hz, twin.dt)
    J = decimation(pair.J)
    trial = twin.trial(twin.plant, decimation)
    predicted = np.asarray(_predicted(PlantParameters.of(twin.plant, SEVEN, bounded=False), trial, jnp.asarray(theta)))
    spreads = [spread(J, y - p) for y, p in zip(observed, predicted, strict=True)]
    return Intervals(np.array([s.std for s in spreads]), np.array([s.std_autocorrelated for s in spreads]))


@eqx.filter_jit
def _predicted(parametrisation: PlantParameters, trial: Trial, theta: Array) -> Array:
    def one(at: Array) -> Array:
        return trial.predict(parametrisation.plant(at), jnp.zeros(trial.n_start))

    return jax.lax.map(one, theta)


def bound(J: np.ndarray, noise: float) -> np.ndarray:
    """Cramer-Rao covariance from every sample of the record, unfiltered: white noise of `noise` N rms."""
    return cramer_rao(J, noise)


def coverage(theta: np.ndarray, std: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Share of the draws whose 95 % interval holds the truth, per parameter."""
    return np.mean(np.abs(theta - truth) <= scipy.stats.norm.ppf(0.975) * std, axis=0)


def coverage_limits(n: int) -> tuple[float, float]:
    """Between which shares an honest 95 % interval stays over n draws, in 99.9 % of studies (binomial)."""
    low, high = scipy.stats.binom.ppf([0.0005, 0.9995], n, 0.95) / n
    return float(low), float(high)


@dataclasses.dataclass(frozen=True)
class Check:
    """Draws repeated from step 2's start with the columns of their own end.

    `apart`: largest difference from the estimate that began at the truth, in bounds; `std_apart`: largest relative
    difference between the standard deviations of `own_std` and those with the columns at the estimate.
    """

    draws: int
    apart: float
    std_apart: float


def checked(
    twin: Twin, starts: Starts, config: Config, observed: np.ndarray, found: Sample, own: Intervals, unit: np.ndarray
) -> Check:
    """`unit`: the bound of each parameter."""
    trial = twin.trial(twin.plant, Decimation.at(config.cutoff_hz, twin.dt), twin.noisy)
    n = min(config.checked_draws, found.converged)
    apart, std_apart = 0.0, 0.0
    for k in range(n):
        one = eqx.tree_at(lambda t: t.observed, trial, jnp.asarray(observed[k]))
        result = gauss_newton(starts.motor, SEVEN, (one,))
        apart = max(apart, float(np.max(np.abs(result.theta - found.theta[k]) / unit)))
        std_apart = max(std_apart, float(np.max(np.abs(result.std / own.white[k] - 1))))
    return Check(n, apart, std_apart)
