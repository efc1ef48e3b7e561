"""What the page of a blind study says in words: whose records, how they were kept blind, the answer, who wins where."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Any

from .main_parameter import proportional

KINDS = {
    "single": "one effect, typical size",
    "small": "one effect, small",
    "large": "one effect, large",
    "poor": "one effect, hardly excited",
    "two": "two effects",
    "three": "three effects",
    "none": "nothing",
    "numerics": "nothing but numerics",
    "alias": "wrong drive gain, absorbed",
    "outside": "effect of no catalogue",
}
"""Stratum to what its cases hold, in the order of the page."""

WANTED = {"two": "name both", "three": "name all", "none": "none", "numerics": "none", "alias": "none"} | {
    "outside": "unexplained"
}
"""Stratum to the right answer; elsewhere it is to name the effect."""

_SINGLE = "single, typical size: accepted"
_TWO, _ALARM = "both of two, nothing else", "false alarm: none and numerics only"
_OUTSIDE, _ABSTAINED = "outside the catalogue: unexplained", "inside: falsely unexplained"
_MEDIAN, _TENTH = "gap closed on the check record, median", "gap closed on the check record, 10th percentile"
_PARAMETER, _AHEAD = "own parameter, median error", "accepted, ahead of the best baseline"

UNLIKE = (
    "The baselines cannot answer that no effect of theirs explains a gap, so that effects of no catalogue are beyond "
    "them; they cannot call two effects one group, as the diagnosis may; and most name at most one effect. In `exact` "
    "no group helps anybody.",
    "The diagnosis was mended on opened cases of earlier studies of this simulator, and its noise model, rise of "
    "friction's sign, timing, clocks and constants were set on open ones; the thresholds of the baselines were chosen "
    "on other open cases and left as they were. score_only is the package's own score without refits.",
)
"""In what the baselines are not alike to the diagnosis."""

NOT_RUN = "Not run: there is no {} beside the score."


def ordered(strata: Sequence[str]) -> list[str]:
    """Strata in the order of the page, those of an outside team last."""
    known = [name for name in KINDS if name in strata]
    return known + [name for name in strata if name not in KINDS]


def kind(stratum: str) -> str:
    """What its cases hold."""
    return KINDS.get(stratum, stratum)


def percent(value: float | None) -> str:
    """A share as a percentage."""
    return "-" if value is None else f"{100 * value:.1f} %"


def between(found: Mapping[str, Any], scale: float = 100, digits: int = 1) -> str:
    """The 95 % interval, in percent."""
    if found["low"] is None or not found["n"]:
        return "-"
    return f"{scale * found['low']:.{digits}f} to {scale * found['high']:.{digits}f}"


def practical(unit: str, usual: float) -> tuple[float, str]:
    """Factor and unit in which a size of this order reads well."""
    if unit == "m" and usual < 1e-3:
        return 1e6, "µm"
    if unit == "s" and usual < 0.1:
        return 1e3, "ms"
    return 1.0, "" if unit == "1" else re.sub("(?<=[a-z])([23])", lambda found: "²³"[int(found[0]) - 2], unit)


def typical_sizes(limits: Mapping[str, Any]) -> list[str]:
    """What a typical size is, of every effect whose laws differ in it."""
    said = []
    for name, one in limits["effects"].items():
        laws = one.get("typical_of_law") or {}
        if one["parameter"] == "size" and laws:
            parameter, si = proportional(name)
            scale, unit = practical(si, max(laws.values()))
            values = "; ".join(f"{scale * value:.3g} {unit}".strip() + f" ({law})" for law, value in laws.items())
            said.append(f"A typical size of {name}, {parameter}: {values}.")
    return said


def banner(study: Mapping[str, Any]) -> str:
    """Whose records, and what the ledger shows of the order of things."""
    n = study["score"]["cases"]
    foreign = study["foreign"]
    if foreign is None:
        made = f"What made the {n} cases is not known here: no answers lie beside the score."
    elif foreign:
        made = f"{foreign} of the {n} cases were brought by another team; what made them is not known here."
    else:
        made = (
            f"All {n} cases are SYNTHETIC, made by a simulator that shares no code with the package. A typical size is "
            "meant to open a gap of two to five times what noise leaves; base parameters, refitted, take part of it."
        )
    steps = {step.step: step.time for step in study["ledger"]}
    if {"seal", "diagnose", "open"} <= set(steps):
        kept = (
            f"Sealed {_day(steps['seal'])} before any diagnosis, diagnosed until {_day(steps['diagnose'])}, "
            f"opened once, {_day(steps['open'])} UTC."
        )
    else:
        kept = "No ledger lies beside this score: nothing shows that the answers were sealed before the diagnosis."
    real = " The table of real records, marked so, is measured." if study["real"] else ""
    return f"{made}{real} {kept} {commits(study['commits'])}"


def commits(known: Sequence[str | None]) -> str:
    """The commit that diagnosed; a plus is spelt out."""
    if not known:
        return "Commit that diagnosed: not known."
    said = [
        "unknown" if one is None else f"{one[:10]}{' with changes not committed' if one.endswith('+') else ''}"
        for one in known
    ]
    return f"Diagnosed at commit{'s' if len(said) > 1 else ''} {', '.join(said)}."


def _day(time: str) -> str:
    return f"{time[:10]} {time[11:16]}"


def answer(score: Mapping[str, Any]) -> list[str]:
    """The sentences on the first screen, the answer first in each."""
    found = {one["what"]: one for one in score["headline"] if one["n"]}

    def told(what: str, text: str) -> str:
        return (
            text.format(**found[what], p=percent(found[what]["value"]), i=between(found[what])) if what in found else ""
        )

    def beside(what: str, text: str) -> str:
        return text.format(percent(found[what]["value"])) if what in found else ""

    sentences = (
        told(_SINGLE, "Named right: one effect of typical size in {p} of {n} cases (95 % interval {i})")
        + told(_TWO, "; both of two, and nothing else, in {p} of {n}"),
        told(_ALARM, "False alarm: in {p} of {n} cases with nothing to find ({i})"),
        told(_OUTSIDE, "Abstains: on {p} of {n} effects of no catalogue ({i})")
        + beside(_ABSTAINED, "; wrongly, on {} of the cases whose effects it knows"),
        beside(_MEDIAN, "Gap closed on a trajectory not fitted, energy above noise: {} (median")
        + told(_TENTH, "; 10th percentile {p}, interval {i})")
        + beside(_PARAMETER, "; the effect's own parameter is off by {} (median)"),
    )
    return [*(f"{sentence}." for sentence in sentences if sentence), _rivals(score), _targets(score)]


def _rivals(score: Mapping[str, Any]) -> str:
    if not score["baselines"]["methods"]:
        return "Baselines: not run."
    lead = next((one for one in score["headline"] if one["what"].startswith(_AHEAD)), None)
    said = "Baselines:"
    if lead is not None:
        best = lead["what"].rsplit("(", 1)[-1].rstrip(")")
        points = 100 * lead["value"]
        interval = f" ({between(lead)})" if lead["low"] is not None and points > 0 else ""
        way = "level" if not points else f"{abs(points):.1f} points {'behind' if points > 0 else 'AHEAD'}{interval}"
        said += f" on one effect of typical size the best, {best}, is {way};"
    won: dict[str, list[str]] = {}
    for one in wins(score):
        won.setdefault(one.method, []).append(f"“{kind(one.stratum)}”")
    where = "; ".join(f"{method} wins on {', '.join(some)}" for method, some in won.items())
    return f"{said} {where or 'none wins on any kind of case'}."


def _targets(score: Mapping[str, Any]) -> str:
    aimed = [one for one in score["headline"] if one["minimum"] is not None and one["met"] is not None]
    count = {met: [one["what"] for one in aimed if one["met"] == met] for met in ("aim", "minimum", "neither")}
    missed = f" ({'; '.join(count['neither'])})" if count["neither"] else ""
    sure = sum(bool(one["claimed"]) for one in aimed)
    return (
        f"Targets: of {len(aimed)}, {len(count['aim'])} reach the aim, {len(count['minimum'])} only the minimum, "
        f"{len(count['neither'])} neither{missed}; {sure} may be claimed with this number of cases."
    )


@dataclasses.dataclass(frozen=True)
class Win:
    """A baseline ahead of the diagnosis on a stratum; `sure` where the whole interval says so."""

    stratum: str
    method: str
    theirs: Mapping[str, Any]
    ours: Mapping[str, Any]
    sure: bool


def wins(score: Mapping[str, Any]) -> list[Win]:
    """Every stratum on which a baseline is accepted more often than the diagnosis, the widest lead first."""
    found = []
    for stratum in ordered([*score["strata"]]):
        some = []
        for method, theirs in score["baselines"]["methods"].items():
            one = theirs["strata"].get(stratum)
            if one is not None and one["ahead"] is not None and one["ahead"] < 0:
                sure = bool(one["interval"]) and one["interval"][1] < 0
                win = Win(stratum, method, one["accepted"], score["strata"][stratum]["accepted"], sure)
                some.append((one["ahead"], win))
        found += [win for _, win in sorted(some, key=lambda pair: pair[0])]
    return found


def who_wins(score: Mapping[str, Any]) -> list[str]:
    """In words: where a baseline is ahead, and where one is level."""
    methods = score["baselines"]["methods"]
    won = wins(score)
    said = [
        f"{one.method} wins on “{kind(one.stratum)}”: {one.theirs['k']} of {one.theirs['n']} right, the diagnosis "
        f"{one.ours['k']} of {one.ours['n']}{'' if one.sure else ' (so few cases could be chance)'}."
        for one in won
    ]
    said = said or ["No baseline is ahead of the diagnosis on any kind of case."]
    lost = {one.stratum for one in won}
    level = [
        f"“{kind(stratum)}” ({', '.join(some)})"
        for stratum in ordered([*score["strata"]])
        if stratum not in lost
        and (some := [m for m, theirs in methods.items() if theirs["strata"].get(stratum, {}).get("ahead") == 0])
    ]
    if level:
        said.append(f"Level with the diagnosis: {'; '.join(level)}.")
    if any(one.stratum in ("none", "numerics", "alias", "outside") for one in won):
        said.append(
            "Where the right answer is to name nothing, a method that seldom names anything wins: hold it against "
            "the other rows."
        )
    return said
