"""Rows of judgements to numbers: strata, groups, calibration and confusion, each count with its interval."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .intervals import quantile_interval, rate
from .judge import Row
from .plan import STRATA

_BINS = 10


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Strata, groups, confusion and calibration."""
    single = [r for r in rows if r.stratum == "single"]
    groups: dict[str, Callable[[Row], Any]] = {
        "noise": lambda r: r.noise,
        "load_encoder": lambda r: r.load_encoder,
        "model": lambda r: r.model,
        "effect": lambda r: "+".join(r.truth),
    }
    return {
        "strata": {name: stratum(some) for name, some in by(rows, lambda r: r.stratum, STRATA).items()},
        "groups": {name: {k: correct(v) for k, v in by(single, key).items()} for name, key in groups.items()},
        "confusion": confusion(rows),
        "calibration": calibration([r for r in rows if r.kind != "several"]),
    }


def by(rows: Sequence[Row], key: Callable[[Row], Any], order: Sequence[Any] = ()) -> dict[str, list[Row]]:
    """Rows by a key, in this order and then by name; those without the key are left out."""
    found = {key(r) for r in rows} - {None}
    listed = [k for k in order if k in found] + sorted(found - set(order), key=str)
    return {str(k): [r for r in rows if key(r) == k] for k in listed}


def correct(rows: Sequence[Row]) -> dict[str, Any]:
    """How many are accepted, how many exact."""
    return {name: rate([getattr(r, name) for r in rows]).as_json() for name in ("accepted", "exact")}


def stratum(rows: Sequence[Row]) -> dict[str, Any]:
    """All that is counted of one stratum."""
    closed = [r.closed for r in rows if r.closed is not None]
    over = [r.over_floor for r in rows if r.over_floor is not None]
    return {
        "n": len(rows),
        **correct(rows),
        "first": rate([r.first for r in rows]).as_json(),
        "first_three": rate([r.first_three for r in rows]).as_json(),
        "block": rate([r.block for r in rows if r.inside]).as_json(),
        "verdicts": Counter(r.verdict for r in rows),
        "closed": {"n": len(closed), "median": quantile(closed, 50), "p10": quantile(closed, 10)},
        "after_over_floor": {"n": len(over), "median": quantile(over, 50), "p90": quantile(over, 90)},
        "predicted": rate([r.predicted for r in rows]).as_json(),
        "brier": mean([brier(r) for r in rows]),
    }


def quantile(values: Sequence[float], percent: float) -> dict[str, Any] | None:
    """A quantile with its interval; None of no values."""
    if not values:
        return None
    return {"value": float(np.percentile(values, percent)), "interval": quantile_interval(values, percent)}


def mean(values: Sequence[float]) -> float | None:
    """Their mean; None of no values."""
    return float(np.mean(values)) if values else None


def brier(r: Row) -> float:
    """sum (p - right)^2 over all names, 0 to 2; a diagnosis without a ranking has 2."""
    if not r.ranking:
        return 2.0
    missed = not set(r.ranking) & set(r.target)
    return sum((p - (name in r.target)) ** 2 for name, p in r.ranking.items()) + missed


def calibration(rows: Sequence[Row]) -> dict[str, Any]:
    """Brier score, expected calibration error of the first name, and its reliability in ten bins."""
    confidence = np.array([max(r.ranking.values()) if r.ranking else 1.0 for r in rows])
    right = np.array([r.first for r in rows])
    bins = np.clip((confidence * _BINS).astype(int), 0, _BINS - 1)
    reliability = [
        {
            "from": k / _BINS,
            "to": (k + 1) / _BINS,
            "confidence": float(confidence[bins == k].mean()),
            "right": rate(right[bins == k].tolist()).as_json(),
        }
        for k in sorted(set(bins.tolist()))
    ]
    off = [abs(one["confidence"] - one["right"]["value"]) * one["right"]["n"] for one in reliability]
    return {
        "n": len(rows),
        "brier": mean([brier(r) for r in rows]),
        "expected_calibration_error": sum(off) / len(rows) if rows else None,
        "reliability": reliability,
    }


def confusion(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Truth, of cases with at most one effect, to what was named first: an effect, none, other, or failed."""
    out: dict[str, Counter[str]] = {}
    for r in rows:
        if r.kind != "several":
            said = {"none": "none", "unexplained": "other", "failed": "failed"}.get(r.verdict) or r.found[0]
            out.setdefault("+".join(r.truth) or "none", Counter())[said] += 1
    return {name: dict(out[name]) for name in sorted(out)}
