"""A psychometric function and the adaptive staircase that measures it: at which size is an effect named how often?

The chance of a name grows with the size as a logistic in its logarithm, p = (1 - lapse) / (1 + exp(-s (log size - m))),
a weak prior on all three; an effect that is missed at large sizes, too, has no size that is named in 90 %. The next
size asked is where the trials so far place the level that is looked for.

References: A. Watson, D. Pelli, *QUEST: a Bayesian adaptive psychometric method*, Perception & Psychophysics 33, 1983;
F. Wichmann, N. Hill, *The psychometric function I*, Perception & Psychophysics 63, 2001 (why a lapse rate).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.special import expit, logit

LEVELS = (0.5, 0.9)
"""Chances whose sizes are looked for, by turns."""

LAPSES = (0.02, 0.05, 0.1, 0.2, 0.3)
"""Chance that even a plain effect is not named; one such trial must not flatten the whole curve."""

SMALLEST, LARGEST = 0.01, 5.0
"""Sizes that may be asked, in typical sizes."""

_MIDDLE, _MIDDLE_STD = np.log(0.4), 1.5
_SLOPE, _SLOPE_STD = np.log(3.0), 1.0
_USUAL_LAPSE = 0.04  # mean of an exponential prior
_FALL = 0.5 * 3.841458820694124  # of the log-likelihood at the ends of a 95 % interval, one parameter

_PLACES = np.linspace(np.log(2e-3), np.log(50.0), 291)
_SLOPES = np.geomspace(0.3, 30.0, 31)

type Trial = tuple[float, bool]
"""Size, in typical sizes, and whether the effect was named."""


@dataclasses.dataclass(frozen=True)
class Threshold:
    """Size at which a level is reached, with its 95 % interval; None: above all sizes that may be asked, or nowhere.

    `below`: it lies under all sizes that were asked, so that `value` and `low` are no more than the least of them.
    """

    value: float | None
    low: float | None
    high: float | None
    below: bool = False


def chance(
    size: float | np.ndarray, middle: float | np.ndarray, slope: float | np.ndarray, lapse: float = LAPSES[0]
) -> np.ndarray:
    """Chance that an effect is named; `middle` is a logarithm of a size."""
    return np.asarray((1 - lapse) * expit(slope * (np.log(size) - middle)))


def next_size(trials: Sequence[Trial], level: float, largest: float = LARGEST) -> float:
    """The size to ask: the posterior mean, in the logarithm, of where this level is reached."""
    posterior = _log_posterior(trials, level, LAPSES[0])
    weights = np.exp(posterior - posterior.max()).sum(axis=1)
    return float(np.clip(np.exp(weights @ _PLACES / weights.sum()), SMALLEST, largest))


def threshold(trials: Sequence[Trial], level: float, largest: float = LARGEST) -> Threshold:
    """Maximum likelihood under the weak prior, and where the profile over the rest falls by chi2(95 %) / 2.

    With a dozen trials the interval holds the size in 80 % of the time or more (simulated): the prior has a say in it.
    """
    profile = np.max([_log_posterior(trials, level, p).max(axis=1) for p in LAPSES if level < 1 - p], axis=0)
    # What is missed too often whatever the size reaches the level nowhere: any place will do for another level.
    nowhere = max((_log_posterior(trials, 0.5, p).max() for p in LAPSES if level >= 1 - p), default=-np.inf)
    best = max(nowhere, profile.max())
    inside = np.exp(_PLACES[profile >= best - _FALL])
    low, high = (inside[0], inside[-1]) if inside.size else (np.inf, np.inf)
    value = np.exp(_PLACES[int(np.argmax(profile))]) if profile.max() > nowhere else np.inf
    high = np.inf if nowhere >= best - _FALL else high
    least = min((size for size, _ in trials), default=SMALLEST)
    shown = max(value, least)
    return Threshold(
        _within(shown, largest), _within(min(low, shown), largest), _within(high, largest), bool(value < least)
    )


def _within(size: float, largest: float) -> float | None:
    return float(size) if size <= largest else None


def _log_posterior(trials: Sequence[Trial], level: float, lapse: float) -> np.ndarray:
    """Over the place of the level (rows, log size) and the slope (columns)."""
    place, slope = _PLACES[:, None], _SLOPES[None, :]
    middle = place - logit(level / (1 - lapse)) / slope
    out = -0.5 * ((middle - _MIDDLE) / _MIDDLE_STD) ** 2 - 0.5 * ((np.log(slope) - _SLOPE) / _SLOPE_STD) ** 2
    out -= (lapse - LAPSES[0]) / _USUAL_LAPSE
    for size, named in trials:
        p = chance(size, middle, slope, lapse)
        out += np.log(np.maximum(p if named else 1 - p, 1e-300))
    return np.asarray(out)
