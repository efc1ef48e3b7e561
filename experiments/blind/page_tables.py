"""The tables of the page: every number with its unit, its interval and what may be claimed of it."""

from collections.abc import Mapping, Sequence
from typing import Any

from ..page import Tabular
from .ablation_scores import Ablated
from .words import between, kind, ordered, percent, practical

_REACHED = {"aim": "aim", "minimum": "minimum", "neither": "MISSED", None: "no case"}
_NARROW = 26  # characters: shorter cells stay on one line


def headline(score: Mapping[str, Any]) -> Tabular:
    """What is quoted, against its targets."""
    rows = []
    for one in score["headline"]:
        scale, unit, digits = _unit(one)

        def show(value: float | None, scale: float = scale, unit: str = unit, digits: int = digits) -> str:
            return "-" if value is None else f"{scale * value:.{digits}f}{unit}"

        def limit(value: float | None, scale: float = scale, unit: str = unit, at_most: Any = one["at_most"]) -> str:
            return "-" if value is None else f"{'≤' if at_most else '≥'} {scale * value:g}{unit}"

        claim = (one["claim"] or "-").split(" with ")[0]
        for bound in (one["minimum"], one["aim"]):
            if bound is not None and "k" not in one:
                claim = claim.replace(f" {bound:g}:", f" {scale * bound:g}{unit}:")
        of = f"{one['k']} of {one['n']}" if "k" in one else f"{one['n']} values"
        reached = "-" if one["minimum"] is None else _REACHED[one["met"]]
        limits = (limit(one["minimum"]), limit(one["aim"]))
        rows.append((one["what"], show(one["value"]), of, between(one, scale, digits), *limits, reached, claim))
    header = ("figure", "seen", "of", "95 % interval", "minimum", "aim", "reached", "claim")
    return held(header, rows)


def _unit(one: Mapping[str, Any]) -> tuple[float, str, int]:
    """Scale, unit and digits of a figure."""
    if "k" in one or one["what"].startswith("own parameter"):
        return 100, " %", 1
    if "ahead of the best baseline" in one["what"]:
        return 100, " points", 1
    return 1, "", 3


def gaps(score: Mapping[str, Any]) -> Tabular:
    """By kind of case, on the check record."""

    def number(found: Mapping[str, Any] | None, scale: float = 1.0, unit: str = "") -> str:
        return "-" if found is None else f"{scale * found['value']:.{1 if unit else 2}f}{unit}"

    rows = []
    for name in ordered([*score["strata"]]):
        found = score["strata"][name]
        closed, over, hit = found["closed"], found["after_over_floor"], found["predicted"]
        shares = (number(closed["median"], 100, " %"), number(closed["p10"], 100, " %"))
        left = (number(over["median"]), number(over["p90"]))
        rows.append((kind(name), str(closed["n"]), *shares, *left, f"{hit['k']} of {hit['n']}"))
    header = (
        "what the case holds",
        "cases with a gap to close",
        "closed, median",
        "closed, 10th percentile",
        "left / noise, median",
        "left / noise, 90th percentile",
        "gap predicted within 25 %",
    )
    return held(header, rows)


def rivals(score: Mapping[str, Any]) -> Tabular:
    """Right answers by kind of case: diagnosis, every baseline, and the lead over the best of them."""
    methods = score["baselines"]["methods"]
    rows = []
    for name in ordered([*score["strata"]]):
        ours = score["strata"][name]["accepted"]
        theirs = {method: found["strata"][name] for method, found in methods.items()}
        ahead = min((one["ahead"] for one in theirs.values()), default=0.0)
        best = [method for method, one in theirs.items() if one["ahead"] == ahead]
        interval = theirs[best[0]]["interval"]
        spread = f" ({100 * interval[0]:+.0f} to {100 * interval[1]:+.0f})" if interval else ""
        winner = "diagnosis" if ahead > 0 else "level" if ahead == 0 else " and ".join(best)
        shares = (percent(one["accepted"]["value"]) for one in theirs.values())
        lead = f"{100 * ahead:+.1f}{spread}"
        rows.append((kind(name), str(ours["n"]), percent(ours["value"]), *shares, lead, winner))
    if methods:
        briers = (_digits(found["calibration"]["brier"]) for found in methods.values())
        rows.append(("Brier score (0 best, 2 worst)", "", _digits(score["calibration"]["brier"]), *briers, "", ""))
    header = ("right", "cases", "diagnosis", *methods, "ahead of the best, points (95 %)", "who wins")
    return held(header, rows)


def limits(found: Mapping[str, Any]) -> Tabular:
    """Detection limits of every effect, in its own unit."""
    rows = []
    for name, one in found["effects"].items():
        scale, unit = practical(one["unit"], one["typical"] or 1.0)

        def size(key: str, one: Mapping[str, Any] = one, scale: float = scale) -> str:
            low, high = one.get(f"{key}_interval") or (None, None)
            upper = "more" if high is None else _short(scale * high)
            if (one.get("below") or {}).get(key):
                return f"below {_short(scale * one[key], 3)} (to {upper})"
            within = "" if low is None else f" ({_short(scale * low)} to {upper})"
            absent = "-" if key == "crlb" else "not reached"
            return (absent if one[key] is None else _short(scale * one[key], 3)) + within

        over = f"{one['p50'] / one['crlb']:.0f}" if one["p50"] and one["crlb"] else "-"
        hits = sum(bool(hit) for _, hit in one["trials"])
        named = f"{hits} of {one['n']}"
        if one.get("own_name", hits) < hits:
            named += f", {hits - one['own_name']} of these by a twin's name"
        rows.append((f"{name}, {one['parameter']}", unit, *map(size, ("typical", "crlb", "p50", "p90")), over, named))
    header = (
        "effect, parameter",
        "unit",
        "typical size",
        "Cramér-Rao bound (1 std)",
        "named in 50 % (95 %)",
        "named in 90 % (95 %)",
        "50 % limit / bound",
        "trials: named",
    )
    return held(header, rows)


def spot_checks(found: Mapping[str, Any]) -> Tabular | None:
    """Limits scaled to other noise levels, and what was named at them; None where none was made."""
    rows = []
    for check in found.get("spot_checks") or []:
        one = found["effects"][check["effect"]]
        scale, unit = practical(one["unit"], one["typical"] or 1.0)
        foreseen = ("-" if check[key] is None else f"{_short(scale * check[key], 3)} {unit}" for key in ("p50", "p90"))
        seen = "; ".join(f"{100 * at['foreseen']:.0f} %: {at['k']} of {at['n']}" for at in check["seen"])
        ratios = ("-" if check[key] is None else f"{check[key]:.2f}" for key in ("scale", "bound_ratio"))
        rows.append((check["effect"], f"{check['noise']} noise", *ratios, *foreseen, seen))
    header = (
        "effect",
        "at",
        "noise / usual",
        "bound / usual",
        "50 % foreseen at",
        "90 % foreseen at",
        "named there",
    )
    return held(header, rows, "Spot checks: the limits, scaled by the noise") if rows else None


def ablations(found: Sequence[Ablated]) -> Tabular:
    """Right, false alarms, and how far behind the complete diagnosis, on the same cases."""
    rows = []
    for one in found:
        spread = f" ({100 * one.interval[0]:+.1f} to {100 * one.interval[1]:+.1f})" if one.interval else ""
        behind = "-" if one.behind is None else f"{100 * one.behind:+.1f}{spread}"
        right = f"{one.right['k']} of {one.right['n']} ({between(one.right, digits=0)} %)"
        alarms = f"{one.alarms['k']} of {one.alarms['n']}"
        kinds = (f"{some['k']} of {some['n']}" for some in (one.single, one.outside))
        rows.append((one.words, right, *kinds, alarms, behind, str(one.errors)))
    header = (
        "variant",
        "right (95 %)",
        "one effect",
        "of no catalogue",
        "false alarms",
        "behind the complete one, points (95 %)",
        "errors",
    )
    return held(header, rows)


def _short(value: float, digits: int = 2) -> str:
    """So many digits, without a power of ten where it can be read without."""
    return f"{float(f'{value:.{digits}g}'):g}"


def _digits(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def held(header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> Tabular:
    """Short cells stay on one line."""
    held = [[cell.replace(" ", "\u00a0") if len(cell) < _NARROW else cell for cell in row] for row in rows]
    return Tabular(header, held, caption)
