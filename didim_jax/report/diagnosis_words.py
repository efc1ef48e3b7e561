"""The three questions answered in words: where the gap lies, which effect causes it, how far it shrinks."""

import dataclasses

from ..gap.atlas import Atlas, Variable
from ..gap.diagnosis import Diagnosis, Gap
from .diagnosis_names import capital, chance, listed, named, place
from .tables import decimals, percent, rounded, significant

_SEEN_CHANGE = 0.03
"""A gap that changes by less than this, relative, is said to stay."""

UNCHECKED = "No check record: all numbers are from the record that was fitted, which flatters what was found."
"""Said first where it is so, on the page and in the terminal."""

_MORE_THAN_NOISE = 1.5
"""Times the noise from which what is left is said to be more; estimates of noise differ by a third."""

_WORTH_NAMING = 0.1
"""Share of the gap's energy that a variable must close to be named."""


@dataclasses.dataclass(frozen=True)
class Answer:
    """One question, its answer in a few words, and the sentences under it."""

    question: str
    head: str
    text: str


def headline(d: Diagnosis) -> str:
    """The whole diagnosis in two sentences."""
    name = judged_on(d)
    gap = d.gap[name]
    on = f"on the {name} record"
    match d.verdict:
        case "none":
            return (
                f"Nothing is missing that these data could show. The simulation leaves {percent(gap.before)} of the "
                f"motor force {on}; noise alone would leave an estimated {percent(gap.floor)}."
            )
        case "unexplained" if d.effects:
            return (
                f"With {_all(d)}, the gap {on} {_moves(gap)} of the motor force, but what is left follows no effect of "
                f"the catalogue; noise alone leaves an estimated {percent(gap.floor)}."
            )
        case "unexplained":
            return (
                f"No effect of the catalogue accounts for the gap: {percent(gap.before)} of the motor force {on}, "
                f"where noise alone would leave an estimated {percent(gap.floor)}."
            )
        case "ambiguous":
            group, _ = _groups(d)
            others = [named(e) for e in d.effects if e not in group]
            too = f", and {listed(others)}" if others else ""
            if len(group) > 1:
                added = f"With {listed(['the likelier one', *others])}"
                said = f"{listed([named(e) for e in group], 'or')} (these data cannot tell which){too}"
            else:
                said, added = _all(d), "Once added"
        case _:
            said, added = _all(d), "Once added"
    return (
        f"Missing in the simulation: {said}. {added}, the gap {on} {_moves(gap)} of the motor force; "
        f"noise alone leaves an estimated {percent(gap.floor)}."
    )


def answers(d: Diagnosis) -> tuple[Answer, Answer, Answer]:
    """Where, which, how far."""
    return (
        Answer("Where is the gap?", *_where(d)),
        Answer("Which effect causes it?", *_which(d)),
        Answer("How far does it shrink?", *_how_far(d)),
    )


def judged_on(d: Diagnosis) -> str:
    """The record that says how far the gap shrinks: the check record, unless what was found is not repeated there."""
    repeats = all(d.parameters.get(effect, {}).get("repeats", True) is not False for effect in d.effects)
    return "check" if "check" in d.gap and repeats else "fit"


# -- where -------------------------------------------------------------------------------------------------------


def _where(d: Diagnosis) -> tuple[str, str]:
    if d.verdict == "none":
        return "Nowhere in particular", _looked_at(d)
    if d.verdict == "unexplained":
        left = d.atlas_after or d.atlas
        with_it = f"With {_all(d)} in place: " if d.effects else ""
        if left is None:
            return "Not known", "The residual was not mapped."
        words = left.words()
        return _leading(left), with_it + (f"{words[0].lower()}{words[1:]}" if with_it else words)
    head = place(d.block) if d.block else "Not bound to a place"
    first = d.effects[0] if d.effects else ""
    if d.where.time_s and (first == "disturbance_pulses" or "t0" in d.parameters.get(first, {})):
        head += f", {_intervals(d.where.time_s)}"
    return head, _looked_at(d)


def _leading(one: Atlas) -> str:
    """The variable that the residual goes with, as a few words."""
    first = leading(one)
    if first is None:
        return "Bound to no single variable"
    said = {"constant": "A constant force", "dynamics": "A linear response to the reference"}
    return said.get(first.name, f"It goes with {first.label}")


def leading(one: Atlas) -> Variable | None:
    """The variable that closes most alone; None where none closes a tenth."""
    first = one.variables[0]
    if first.share < _WORTH_NAMING:
        return None
    constant = one["constant"]  # a function of speed may be constant
    return constant if first.name == "v_even" and constant.share > 0.97 * first.share else first


def _looked_at(d: Diagnosis) -> str:
    return d.atlas.words() if d.atlas is not None else ""


def ranges(d: Diagnosis) -> str:
    """Every interval that an effect is bound to, and the ranges that hold nine tenths of what the effects change."""
    where = d.where
    spans = ((where.speed_m_s, 1e3, "mm/s"), (where.position_m, 1e3, "mm"), (where.frequency_hz, 1.0, "Hz"))
    said = [_span([scale * x for x in span], unit) for span, scale, unit in spans if span]
    if not d.effects:
        return ""
    bound = listed([f"{on:.2f}–{off:.2f} s" for on, off in where.time_s or []])
    held = f"Nine tenths of the change in force that comes with {_all(d)} lie at {listed(said)}." if said else ""
    return f"Bound to {bound}. {held}".rstrip() if bound else held


def _span(ends: list[float], unit: str) -> str:
    """'-20 to 20 mm/s'."""
    return f"{significant(ends[0], 2)} to {significant(ends[1], 2)} {unit}"


def _intervals(spans: list[list[float]]) -> str:
    shown = listed([f"{on:.2f}–{off:.2f} s" for on, off in spans[:2]]) if len(spans) < 3 else ""
    return shown or f"{len(spans)} intervals from {spans[0][0]:.2f} to {spans[-1][1]:.2f} s"


# -- which -------------------------------------------------------------------------------------------------------


def _groups(d: Diagnosis) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The first effect's group, alone if it has no twin, and the groups of further effects."""
    first = next((g for g in d.ambiguous_with if d.effects[0] in g), (d.effects[0],))
    return first, [g for g in d.ambiguous_with if g != first]


def _which(d: Diagnosis) -> tuple[str, str]:
    p = dict(d.ranking)

    def ranked(*but: str) -> list[str]:
        return [f"{named(e)} ({chance(x)})" for e, x in d.ranking if e not in but]

    rivals, known = ranked("none", *d.effects), ranked("none", "other")
    match d.verdict:
        case "none":
            text = "No effect closes more of the gap than noise and the base parameters leave it."
            text += f" Closest: {known[0]}." if known else ""
            text += " A wrong drive gain would not show: masses, friction and stiffness absorb it."
            return f"None ({chance(p.get('none', 0.0))})", text
        case "unexplained":
            text = "No effect of the catalogue, alone or with others, leaves a residual that looks like noise."
            if d.effects:
                text += f" On the way {_all(d)} {'was' if len(d.effects) == 1 else 'were'} found. {_shares(d)}"
            else:
                text += f" Closest: {known[0]}." if known else ""
            likeliest = d.ranking[0][0] == "other"
            return "None that is known" + (f" ({chance(p['other'])})" if likeliest else ""), text
        case "ambiguous":
            group, more = _groups(d)
            head = capital(_with_chance(group[0], p))
            text = sizes(d)
            if len(group) > 1:
                head += f" or {listed([_with_chance(e, p) for e in group[1:]], 'or')}"
                text = "Each leaves the same force on these records to within the noise."
            text += "".join(f" These data cannot tell {listed([named(e) for e in g], 'from')}." for g in more)
            if len(d.effects) > 1:
                text += f" Also found: {listed([named(e) for e in d.effects if e not in group])}. {_shares(d)}".rstrip()
            if d.experiment:
                text += f" To part them: {d.experiment.what}; they then differ by {d.experiment.angle_deg:.0f}°."
            return head, text
    head = capital(_with_chance(d.effects[0], p))
    head += f", and {listed([named(e) for e in d.effects[1:]])}" if d.effects[1:] else ""
    text = f"{sizes(d)} " if sizes(d) else ""
    text += f"{_shares(d)} " if len(d.effects) > 1 and _shares(d) else ""
    return head, text + (f"Next likeliest: {listed(rivals[:2])}." if rivals else "")


def sizes(d: Diagnosis) -> str:
    """The first effect's parameters: 'dFs = 6.1 ± 0.1 N, vs = 15.2 ± 0.8e-3 m/s.'"""
    numbers = {k: v for k, v in d.parameters.get(d.effects[0], {}).items() if isinstance(v, dict)}
    said = [estimate(k, v) for k, v in numbers.items() if k != "load_share"]
    return f"{', '.join(said)}." if said else ""


def estimate(name: str, number: dict[str, object]) -> str:
    """'F0 = 3.10 ± 0.12 N', with the digits that the standard deviation carries; 'a = 0.6 (the least it may be)'."""
    value, std = (float(number.get(k) or 0.0) for k in ("value", "std"))  # type: ignore[arg-type]
    unit = number.get("unit") or "1"
    places = decimals(std)
    spread = "" if places is None else f" ± {rounded(std, places)}"
    limit = f" (the {number['bound']} it may be)" if number.get("bound") else ""
    return f"{name} = {rounded(value, places)}{spread}{'' if unit == '1' else f' {unit}'}{limit}"


def _with_chance(effect: str, p: dict[str, float]) -> str:
    return f"{named(effect)} ({chance(p[effect])})" if effect in p else named(effect)


def _all(d: Diagnosis) -> str:
    return listed([named(e) for e in d.effects])


def _shares(d: Diagnosis) -> str:
    """'Taken out again, backlash gives back 94 % of what was closed, friction drift 15 %.'"""
    held = [(named(e), f"{100 * d.last_in[e]:.0f} %") for e in d.effects if e in d.last_in]
    if not held:
        return ""
    (first, share), *rest = held
    said = [f"{first} gives back {share} of what was closed", *(f"{name} {more}" for name, more in rest)]
    return f"Taken out again, {listed(said)}."


# -- how far -----------------------------------------------------------------------------------------------------


def _how_far(d: Diagnosis) -> tuple[str, str]:
    name = judged_on(d)
    text = " ".join(_record(record, d.gap[record], bool(d.effects)) for record in reversed(d.gap))
    if "check" in d.gap and name == "fit":
        text += " What was found is not repeated on the check record, so the gap closed is judged on the fit record."
    if not d.effects:
        return ("Nothing to close" if d.verdict == "none" else "Not at all"), text
    above = d.gap[name].after / d.gap[name].floor if d.gap[name].floor > 0 else 1.0
    if above > _MORE_THAN_NOISE:
        text += f" What is left is {above:.1f} times the noise: not all of it is explained."
    if d.share is None:
        return "The gap is as small as the noise", text
    closed = "of what can be closed" + (", on the fit record" if "check" in d.gap and name == "fit" else "")
    if min(d.share, *(d.interval or ())) > 0.995:
        return f"More than 99 % {closed}", text
    between = f" [{100 * d.interval[0]:.0f}, {100 * d.interval[1]:.0f}]" if d.interval else ""
    if d.share <= 0:
        return f"Not at all on the {name} record", text
    return f"{100 * d.share:.0f} %{between} {closed}", text


def _record(name: str, gap: Gap, changed: bool) -> str:
    said = f"{capital(name)} record: {percent(gap.before)}"
    said += f" before, {percent(gap.after)} after" if changed else ""
    said += f", an estimated {percent(gap.floor)} is noise"
    return f"{said}; {percent(gap.predicted_after)} was predicted." if gap.predicted_after is not None else f"{said}."


def _moves(gap: Gap) -> str:
    """'falls from 4.0 % to 1.2 %'."""
    if abs(gap.after - gap.before) < _SEEN_CHANGE * gap.before:
        return f"stays at {percent(gap.before)}"
    return f"{'falls' if gap.after < gap.before else 'rises'} from {percent(gap.before)} to {percent(gap.after)}"
