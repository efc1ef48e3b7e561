"""How far a rate or a quantile from so many cases may be trusted, and what may be claimed of it."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import binom, binomtest

_Z = 1.959963984540054  # 95 %, two-sided


@dataclasses.dataclass(frozen=True)
class Rate:
    """k of n, with the 95 % interval of Wilson."""

    k: int
    n: int

    @property
    def value(self) -> float | None:
        """The share observed; None of no cases."""
        return self.k / self.n if self.n else None

    @property
    def interval(self) -> tuple[float, float]:
        """See `wilson`."""
        return wilson(self.k, self.n)

    def as_json(self) -> dict[str, float | int | None]:
        """All of it, for blind.json."""
        low, high = self.interval
        return {"k": self.k, "n": self.n, "value": self.value, "low": low, "high": high}


def rate(hits: Sequence[bool]) -> Rate:
    """How many of them are true."""
    return Rate(sum(map(bool, hits)), len(hits))


def wilson(k: int, n: int) -> tuple[float, float]:
    """95 % interval of a rate of which k of n were seen (Wilson, JASA 22, 1927); everything, of no cases."""
    if n == 0:
        return 0.0, 1.0
    p, z2 = k / n, _Z**2
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = _Z / (1 + z2 / n) * float(np.sqrt(p * (1 - p) / n + z2 / (4 * n**2)))
    return max(middle - half, 0.0) if k else 0.0, min(middle + half, 1.0) if k < n else 1.0


@dataclasses.dataclass(frozen=True)
class Claim:
    """Whether the interval lies on the right side of a target (True), on the wrong one (False) or on both (None)."""

    holds: bool | None
    text: str


def claim(k: int, n: int, target: float, at_most: bool = False) -> Claim:
    """What k of n can bear of 'at least `target`', or of 'at most' it."""
    sign = "≤" if at_most else "≥"
    wish = f"{sign} {100 * target:g} %"
    if n:
        low, high = wilson(k, n)
        if (high <= target) if at_most else (low >= target):
            return Claim(True, f"{wish}: holds")
        if (low > target) if at_most else (high < target):
            return Claim(False, f"{wish}: does not hold")
    needed = cases_needed(target, at_most)
    more = "no number bears it" if needed is None else f"the fewest that bear it: {needed}, all right"
    return Claim(None, f"{wish}: not claimable with {n} cases ({more})")


def cases_needed(target: float, at_most: bool = False) -> int | None:
    """The fewest cases, all of them right, that bear the claim; None: no number does."""
    wrong = target if at_most else 1 - target
    return int(np.ceil(_Z**2 * (1 - wrong) / wrong - 1e-9)) if wrong > 0 else None


def quantile_interval(values: Sequence[float], percent: float) -> tuple[float, float] | None:
    """95 % interval of a quantile between two of the values, by how many lie below it; None: too few to bound it.

    Free of any assumption on their distribution; a 10th percentile needs 36 values, a median 6.
    """
    n = len(values)
    low, high = (int(binom.ppf(tail, n, percent / 100)) for tail in (0.025, 0.975)) if n else (0, 0)
    if not 1 <= low <= high < n:
        return None
    ordered = np.sort(np.asarray(values, float))
    return float(ordered[low - 1]), float(ordered[high])


def lead(ours: Sequence[bool], theirs: Sequence[bool]) -> dict[str, Any]:
    """By how much one rate is above another on the same cases, with its interval; None of no cases."""
    ahead = (sum(ours) - sum(theirs)) / len(ours) if ours else None
    return {"ahead": ahead, "interval": lead_interval(ours, theirs)}


def exact_paired_test(ours: Sequence[bool], theirs: Sequence[bool]) -> tuple[int, int, float]:
    """Cases that only ours has right, those that only theirs has, and p of no difference (exact McNemar test)."""
    only_ours, only_theirs = (
        sum(a and not b for a, b in zip(x, y, strict=True)) for x, y in ((ours, theirs), (theirs, ours))
    )
    differ = only_ours + only_theirs
    return only_ours, only_theirs, float(binomtest(only_ours, differ).pvalue) if differ else 1.0


def lead_interval(ours: Sequence[bool], theirs: Sequence[bool]) -> tuple[float, float] | None:
    """95 % interval of the difference of two rates on the same cases; None of no cases.

    Newcombe, *Improved confidence intervals for the difference between binomial proportions based on paired data*,
    Statistics in Medicine 17, 1998, method 10.
    """
    n = len(ours)
    if not n:
        return None
    both = sum(a and b for a, b in zip(ours, theirs, strict=True))
    k, m = sum(ours), sum(theirs)
    p, q = k / n, m / n
    (low_p, high_p), (low_q, high_q) = wilson(k, n), wilson(m, n)
    spread = k * (n - k) * m * (n - m)
    together = float(both * n - k * m)
    together = max(together - n / 2, 0.0) if together > 0 else together
    phi = together / float(np.sqrt(spread)) if spread else 0.0

    def off(a: float, b: float) -> float:
        return float(np.sqrt(max(a * a - 2 * phi * a * b + b * b, 0.0)))

    return p - q - off(p - low_p, high_q - q), p - q + off(high_p - p, q - low_q)
