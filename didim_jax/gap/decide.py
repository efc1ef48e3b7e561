"""From the evidence to a verdict: probabilities of each effect, of none, of something else, and groups of twins.

The numbers below are set by hand on open cases; `experiments/gap_cases.py` cross-validates the one that decides on
abstention. Sealed cases judge all of them.
"""

import dataclasses
from collections.abc import Collection

import numpy as np

RELEVANT = 0.12
"""Share of the residual energy that an effect must close to be worth a name."""

LEFT = 0.09
"""Share of the gap's structure, left by all effects found, at which something else is as likely as not."""

STRUCTURED = 0.15
"""Share of the last residual that must follow the motion for that."""

ODD = 0.32
"""The same where nothing was found: slow and coloured noise alone reach some 0.3 where there is no gap at all."""

TEMPERATURE = 12.0
"""Residuals are autocorrelated and laws are not exact: log-likelihoods are worth this many times less."""

TWIN = 4.0
"""Difference of tempered log-likelihood within which two effects are one group."""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What one step of the search found, per effect: whitened residual energy left, and the number of parameters.

    `before` is the energy without any effect, `rows` the number of residuals.
    """

    effects: tuple[str, ...]
    energy: np.ndarray
    parameters: np.ndarray
    before: float
    rows: int


def log_likelihood(evidence: Evidence) -> np.ndarray:
    """-n/2 log energy - parameters/2 log n, tempered, (n_effects,)."""
    n = evidence.rows / TEMPERATURE
    return -0.5 * n * np.log(evidence.energy) - 0.5 * evidence.parameters * np.log(n)


def probabilities(evidence: Evidence, none: float, other: float) -> dict[str, float]:
    """Probability of each effect, `none` and `other`, largest first; they sum to 1."""
    out = {"none": none, "other": other}
    if len(evidence.effects):
        ll = log_likelihood(evidence)
        weights = np.exp(ll - ll.max())
        weights = (1 - none - other) * weights / weights.sum()
        out |= dict(zip(evidence.effects, (float(w) for w in weights), strict=True))
    total = sum(out.values())
    return {k: v / total for k, v in sorted(out.items(), key=lambda item: -item[1])}


def twins(evidence: Evidence, effect: str, adopted: Collection[str] = ()) -> tuple[str, ...]:
    """The group of at most three that these data cannot tell apart from the effect, itself first; () when alone."""
    ll = log_likelihood(evidence)
    mine = ll[evidence.effects.index(effect)]
    near = [
        (mine - value, name)
        for name, value in zip(evidence.effects, ll, strict=True)
        if name not in (effect, *adopted) and mine - value < TWIN
    ]
    return (effect, *[name for _, name in sorted(near)[:2]]) if near else ()


def logistic(z: float) -> float:
    """1 / (1 + exp(-z))."""
    return float(1 / (1 + np.exp(-np.clip(z, -40, 40))))


def none(gain: float) -> float:
    """Probability that there is no gap worth a name, from the share of residual energy that the best effect closes."""
    return logistic(60.0 * (RELEVANT - gain))


def other(left: float, structured: float, law_left: float) -> float:
    """Probability of something outside the catalogue though effects were found.

    `left` is the share of the gap's structure that they leave, `structured` the share of what they leave that still
    follows the motion: both must be large. `law_left` is the share of r_C that nothing explains.
    """
    force = logistic(4.0 * np.log(max(left, 1e-9) / LEFT)) * logistic(50.0 * (structured - STRUCTURED))
    return max(force, logistic(20.0 * (law_left - 0.2)))


def unknown(structured: float, law_left: float) -> float:
    """Probability of something outside the catalogue where no effect was found: the residual follows the motion."""
    return max(logistic(25.0 * (structured - ODD)), logistic(20.0 * (law_left - 0.2)))


def settled(effect: str, other: float) -> dict[str, float]:
    """The ranking when an effect was read off the record itself."""
    rest = max(1 - other, 0.0)
    shares = {effect: 0.999 * rest, "other": other, "none": 0.001 * rest}
    return dict(sorted(shares.items(), key=lambda item: -item[1]))
