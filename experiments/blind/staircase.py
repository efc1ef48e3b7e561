"""A psychometric function and the adaptive staircase that measures it: at which size is an effect named how often?

The chance of a name grows with the size as a logistic in its logarithm, p = (1 - LAPSE) / (1 + exp(-s (log size - m))):
two parameters, a weak prior on both. The next size asked is where the trials so far place the level that is looked for.

References: A. Watson, D. Pelli, *QUEST: a Bayesian adaptive psychometric method*, Perception & Psychophysics 33, 1983;
F. Wichmann, N. Hill, *The psychometric function I*, Perception & Psychophysics 63, 2001 (why a lapse rate).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.special import expit, logit

LEVELS = (0.5, 0.9)
"""Chances whose sizes are looked for, by turns."""

LAPSE = 0.02
"""Chance that even a plain effect is not named; one such trial must not flatten the whole curve."""

SMALLEST, LARGEST = 0.01, 5.0
"""Sizes that may be asked, in typical sizes."""

_MIDDLE, _MIDDLE_STD = np.log(0.4), 1.5
_SLOPE, _SLOPE_STD = np.log(3.0), 1.0
_FALL = 0.5 * 3.841458820694124  # of the log-likelihood at the ends of a 95 % interval, one parameter

_PLACES = np.linspace(np.log(2e-3), np.log(50.0), 291)
_SLOPES = np.geomspace(0.3, 30.0, 31)

type Trial = tuple[float, bool]
"""Size, in typical sizes, and whether the effect was named."""


@dataclasses.dataclass(frozen=True)
class Threshold:
    """Size at which a level is reached, with its 95 % interval; None: above all sizes that may be asked."""

    value: float | None
    low: float | None
    high: float | None


def chance(size: float | np.ndarray, middle: float | np.ndarray, slope: float | np.ndarray) -> np.ndarray:
    """Chance that an effect is named; `middle` is a logarithm of a size."""
    return np.asarray((1 - LAPSE) * expit(slope * (np.log(size) - middle)))


def next_size(trials: Sequence[Trial], level: float, largest: float = LARGEST) -> float:
    """The size to ask: the posterior mean, in the logarithm, of where this level is reached."""
    posterior = _log_posterior(trials, level)
    weights = np.exp(posterior - posterior.max()).sum(axis=1)
    return float(np.clip(np.exp(weights @ _PLACES / weights.sum()), SMALLEST, largest))


def threshold(trials: Sequence[Trial], level: float, largest: float = LARGEST) -> Threshold:
    """Maximum likelihood under the weak prior, and where the profile over the slope falls by chi2(95 %) / 2."""
    profile = _log_posterior(trials, level).max(axis=1)
    inside = _PLACES[profile >= profile.max() - _FALL]
    found = (float(np.exp(x)) for x in (_PLACES[int(np.argmax(profile))], inside[0], inside[-1]))
    return Threshold(*(x if x <= largest else None for x in found))


def _log_posterior(trials: Sequence[Trial], level: float) -> np.ndarray:
    """Over the place of the level (rows, log size) and the slope (columns)."""
    place, slope = _PLACES[:, None], _SLOPES[None, :]
    middle = place - logit(level / (1 - LAPSE)) / slope
    out = -0.5 * ((middle - _MIDDLE) / _MIDDLE_STD) ** 2 - 0.5 * ((np.log(slope) - _SLOPE) / _SLOPE_STD) ** 2
    for size, named in trials:
        p = chance(size, middle, slope)
        out += np.log(np.maximum(p if named else 1 - p, 1e-300))
    return np.asarray(out)
