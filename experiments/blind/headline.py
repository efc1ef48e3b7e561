"""The figures that are quoted of a study: each with its interval, its targets, and what may be claimed of it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from .intervals import Rate, claim, lead, rate
from .judge import VISIBLE, Row
from .summary import calibration, quantile


@dataclasses.dataclass(frozen=True)
class Target:
    """What was to be reached, and whether less is better."""

    minimum: float
    aim: float
    at_most: bool = False


def headline(rows: Sequence[Row], rivals: Mapping[str, Sequence[Row]]) -> list[dict[str, Any]]:
    """One entry a figure: what, value, k and n or only n, low, high, minimum, aim, met, claim."""
    return [*_rates(rows), *_quantities(rows), *_ahead(rows, rivals)]


def _rates(rows: Sequence[Row]) -> list[dict[str, Any]]:
    def of(*strata: str) -> list[Row]:
        return [r for r in rows if r.stratum in strata]

    single, silent = of("single"), of("none", "numerics")
    outside, inside = [r for r in rows if r.kind == "outside"], [r for r in rows if r.inside]
    named = [r for r in rows if r.named]
    alarm = [r.verdict != "none" for r in silent]
    return [
        _rate("single, typical size: accepted", [r.accepted for r in single], Target(0.95, 0.98)),
        _rate("single, typical size: exact", [r.exact for r in single], Target(0.91, 0.95)),
        _rate(f"of these, a gap above {VISIBLE:g} floors: accepted", [r.accepted for r in single if r.visible]),
        _rate("both of two, nothing else", [r.accepted for r in of("two")], Target(0.80, 0.93)),
        _rate("false alarm: none and numerics only", alarm, Target(0.04, 0.01, at_most=True)),
        _rate("of these, an effect named", [r.named for r in silent]),
        _rate("of these, unexplained", [r.verdict == "unexplained" for r in silent]),
        _rate("exact alias answered as absorbed", [r.accepted for r in of("alias")], Target(1.0, 1.0)),
        _rate("outside the catalogue: unexplained", [r.accepted for r in outside], Target(0.75, 0.90)),
        _rate(f"of these, a gap above {VISIBLE:g} floors: unexplained", [r.accepted for r in outside if r.visible]),
        _rate("outside the catalogue: a wrong name", [r.named for r in outside]),
        _rate("inside: falsely unexplained", _unexplained(inside), Target(0.05, 0.05, at_most=True)),
        _rate("single, typical size: falsely unexplained", _unexplained(single), Target(0.05, 0.05, at_most=True)),
        _rate("wrong name among those named", [not r.accepted for r in named], Target(0.05, 0.02, at_most=True)),
        _rate("block right, single", [r.block for r in single], Target(0.94, 0.98)),
        _rate("gap on the check record predicted within 25 %", [r.predicted for r in rows]),
    ]


def _unexplained(rows: Sequence[Row]) -> list[bool]:
    return [r.verdict == "unexplained" for r in rows]


def _quantities(rows: Sequence[Row]) -> list[dict[str, Any]]:
    closed = [r.closed for r in rows if r.closed is not None]
    errors = [error for r in rows if r.accepted for error in r.parameter_errors]
    calibrated = calibration([r for r in rows if r.kind != "several"])
    percent = (quantile(closed, 50), quantile(closed, 10), quantile(errors, 50))
    median, tenth, error = (found or {"value": None, "interval": None} for found in percent)
    n = calibrated["n"]
    return [
        _quantity("gap closed on the check record, median", **median, n=len(closed), target=Target(0.96, 0.99)),
        _quantity("gap closed on the check record, 10th percentile", **tenth, n=len(closed), target=Target(0.75, 0.90)),
        _quantity("own parameter, median error", **error, n=len(errors), target=Target(0.08, 0.03, at_most=True)),
        _quantity("Brier score", calibrated["brier"], None, n, Target(0.15, 0.06, at_most=True)),
        _quantity(
            "expected calibration error",
            calibrated["expected_calibration_error"],
            None,
            n,
            Target(0.06, 0.02, at_most=True),
        ),
    ]


def _ahead(rows: Sequence[Row], rivals: Mapping[str, Sequence[Row]]) -> list[dict[str, Any]]:
    """Points ahead of the best rival, single effects of typical size, on the same cases.

    In accepted, where only what can say that two effects are one group gains by it; and in exact, where none can.
    """
    ours = [r for r in rows if r.stratum == "single"]
    theirs = {name: [r for r in some if r.stratum == "single"] for name, some in rivals.items()}
    if not ours or not theirs:
        return []
    found = []
    for which in ("accepted", "exact"):
        hits = {name: [bool(getattr(r, which)) for r in some] for name, some in theirs.items()}
        best = max(hits, key=lambda name: sum(hits[name]))
        ahead = lead([bool(getattr(r, which)) for r in ours], hits[best])
        what = f"{which}, ahead of the best baseline ({best})"
        found.append(_quantity(what, ahead["ahead"], ahead["interval"], len(ours), Target(0.05, 0.15)))
    return found


def _rate(what: str, hits: Sequence[bool], target: Target | None = None) -> dict[str, Any]:
    found = rate(hits)
    out = {"what": what, **found.as_json(), **_met(found.value, target), "claim": None, "claimed": None}
    if target is not None:
        said = _best_claim(found, target)
        out |= {"claim": said.text, "claimed": said.holds}
    return out


def _best_claim(found: Rate, target: Target) -> Any:
    """Of the aim, if the count can bear that; else of the minimum."""
    aim = claim(found.k, found.n, target.aim, target.at_most)
    return aim if aim.holds else claim(found.k, found.n, target.minimum, target.at_most)


def _quantity(what: str, value: float | None, interval: Any, n: int, target: Target) -> dict[str, Any]:
    low, high = interval or (None, None)
    shown = {"what": what, "n": n, "value": value, "low": low, "high": high, **_met(value, target)}
    best, worst = (low, high) if target.at_most else (high, low)
    if best is None or worst is None:
        return {**shown, "claim": None, "claimed": None}
    right = [t for t in (target.aim, target.minimum) if (worst <= t if target.at_most else worst >= t)]
    sign = "≤" if target.at_most else "≥"
    if (best > target.minimum) if target.at_most else (best < target.minimum):
        return {**shown, "claim": f"{sign} {target.minimum:g}: does not hold", "claimed": False}
    if not right:
        return {**shown, "claim": f"{sign} {target.minimum:g}: not claimable with {n} values", "claimed": None}
    return {**shown, "claim": f"{sign} {right[0]:g}: holds", "claimed": True}


def _met(value: float | None, target: Target | None) -> dict[str, Any]:
    """Which of the targets the observed value reaches: aim, minimum or neither."""
    if target is None:
        return {"minimum": None, "aim": None, "at_most": None, "met": None}
    met = None
    if value is not None:
        reached = [(value <= t) if target.at_most else (value >= t) for t in (target.minimum, target.aim)]
        met = "aim" if reached[1] else "minimum" if reached[0] else "neither"
    return {"minimum": target.minimum, "aim": target.aim, "at_most": target.at_most, "met": met}
