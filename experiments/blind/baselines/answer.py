"""What a rival answers, in the form of a diagnosis: the effects it names and how sure it is of each."""

import dataclasses
from collections.abc import Mapping

import numpy as np

FALSE_PRECISION = 12.0
"""Residuals in the band are autocorrelated: so many samples count as one."""


@dataclasses.dataclass(frozen=True)
class Answer:
    """Effects named, largest first, none when empty; `ranking` of the first step, with `none`, sums to 1."""

    effects: tuple[str, ...]
    ranking: dict[str, float]


def weigh(left: Mapping[str, float], n: float, none: float = 0.0, penalty: Mapping[str, float] | None = None) -> Answer:
    """The likeliest effect, or none, by the share of the residual's energy that each would leave.

    The weight of an effect is left^(-n / 2) exp(-penalty), `n` independent samples; nothing found leaves 1 - `none`.
    """
    scores = {"none": -0.5 * n * np.log(1 - none)}
    for name, share in left.items():
        scores[name] = -0.5 * n * np.log(max(share, 1e-12)) - (penalty or {}).get(name, 0.0)
    top = max(scores.values())
    weights = {name: float(np.exp(score - top)) for name, score in scores.items()}
    total = sum(weights.values())
    ranking = {name: weights[name] / total for name in sorted(scores, key=lambda name: -scores[name])}
    first = next(iter(ranking))
    return Answer(() if first == "none" else (first,), ranking)
