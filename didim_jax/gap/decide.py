"""From the evidence to a verdict: probabilities of each effect, of none, of something else, and groups of twins.

The numbers below are set on open cases. `experiments/gap_cases.py` fits those that no search depends on from neutral
ones, without the effects that they are then judged on; the others it leaves as they are. Sealed cases judge all.
"""

import dataclasses
from collections.abc import Collection

import numpy as np

RELEVANT, BESIDE = 0.085, 0.12
"""Share of the residual energy that an effect must close to be worth a name, alone and beside others."""

LEFT = 0.03
"""Share of the explainable gap, left by all effects found, times the share of that residual that is not noise, at which
something else is as likely as not: much of a little, or a little of much."""

STRUCTURED = 0.1
"""Share of the last residual that must not be noise for that."""

ODD = 0.14
"""The same where nothing was found."""

DRIFT = 0.9
"""Slow part of the last residual against the rest, at which it is as likely as not that no drift of a machine is it."""

SURE_NONE, SURE_LEFT, SURE_STRUCTURED, SURE_ODD, SURE_DRIFT = 60.0, 5.8, 50.0, 40.0, 6.0
"""How quickly a probability turns at `RELEVANT`, `LEFT`, `STRUCTURED`, `ODD` and `DRIFT`."""

TEMPERATURE = 2.0
"""Noise is not as it is modelled: log-likelihoods are worth this many times less."""

INEXACT = 0.01
"""Nor are laws: by this share of what the best effect raises the log-likelihood by, it is worth less again."""

PENALTY = 3.0
"""Log-likelihood that a parameter costs: half the logarithm of some four hundred independent samples."""

TWIN = 4.0
"""Difference of tempered log-likelihood within which two effects are one group."""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What one step of the search found: log-likelihood with each effect, its number of parameters, and `before` it."""

    effects: tuple[str, ...]
    log_likelihood: np.ndarray
    parameters: np.ndarray
    before: float

    @property
    def weight(self) -> np.ndarray:
        """Tempered, and less what the parameters cost, (n_effects,)."""
        rise = max(float(np.max(self.log_likelihood, initial=self.before)) - self.before, 0.0)
        return (self.log_likelihood - PENALTY * self.parameters) / (TEMPERATURE + INEXACT * rise)

    def without(self, names: Collection[str]) -> "Evidence":
        """Less these effects."""
        kept = [i for i, name in enumerate(self.effects) if name not in names]
        effects = tuple(self.effects[i] for i in kept)
        return Evidence(effects, self.log_likelihood[kept], self.parameters[kept], self.before)


NOTHING = Evidence((), np.zeros(0), np.zeros(0), 0.0)
"""Of a step without a refit."""


def probabilities(evidence: Evidence, none: float, other: float) -> dict[str, float]:
    """Probability of each effect, `none` and `other`, largest first; they sum to 1.

    Where no effect is in question, none has what `other` leaves.
    """
    out = {"none": none if len(evidence.effects) else 1 - other, "other": other}
    if len(evidence.effects):
        weights = np.exp(evidence.weight - evidence.weight.max())
        weights = max(1 - none - other, 0.0) * weights / weights.sum()  # rounding must not make it less
        out |= dict(zip(evidence.effects, (float(w) for w in weights), strict=True))
    total = sum(out.values())
    return {k: v / total for k, v in sorted(out.items(), key=lambda item: -item[1])}


def twins(evidence: Evidence, effect: str, adopted: Collection[str] = ()) -> tuple[str, ...]:
    """The group of at most three that these data cannot tell apart from the effect, itself first; () when alone."""
    mine = evidence.weight[evidence.effects.index(effect)]
    near = [
        (mine - value, name)
        for name, value in zip(evidence.effects, evidence.weight, strict=True)
        if name not in (effect, *adopted) and mine - value < TWIN
    ]
    return (effect, *[name for _, name in sorted(near)[:2]]) if near else ()


def logistic(z: float) -> float:
    """1 / (1 + exp(-z))."""
    return float(1 / (1 + np.exp(-np.clip(z, -40, 40))))


def none(gain: float) -> float:
    """Probability that there is no gap worth a name, from the share of residual energy that the best effect closes."""
    return logistic(SURE_NONE * (RELEVANT - gain))


def other(left: float, structured: float, drift: float, law_left: float) -> float:
    """Probability of something outside the catalogue though effects were found.

    `left` is the share of the explainable gap that they leave, `structured` the share of what they leave that is not
    noise: their product must be large; or `drift`, the slow part of it against the rest, or `law_left`, the share of
    r_C that nothing explains.
    """
    much = logistic(SURE_LEFT * np.log(max(left * structured, 1e-9) / LEFT))
    certain = logistic(SURE_STRUCTURED * (structured - STRUCTURED))
    return max(much * certain, _drifts(drift), _law(law_left))


def unknown(structured: float, drift: float, law_left: float) -> float:
    """Probability of something outside the catalogue where no effect was found."""
    return max(logistic(SURE_ODD * (structured - ODD)), _drifts(drift), _law(law_left))


def _drifts(drift: float) -> float:
    return logistic(SURE_DRIFT * np.log(max(drift, 1e-9) / DRIFT))


def _law(law_left: float) -> float:
    return logistic(20.0 * (law_left - 0.2))


def settled(effect: str, other: float) -> dict[str, float]:
    """The ranking when an effect was read off the record itself."""
    rest = max(1 - other, 0.0)
    shares = {effect: 0.999 * rest, "other": other, "none": 0.001 * rest}
    return dict(sorted(shares.items(), key=lambda item: -item[1]))
