"""The three questions answered in words: where the gap lies, which effect causes it, how far it shrinks."""

import dataclasses

from ..gap.diagnosis import Diagnosis, Gap
from .diagnosis_names import capital, chance, listed, named, place
from .tables import decimals, percent, rounded, significant

_SEEN_CHANGE = 0.03
"""A gap that changes by less than this, relative, is said to stay."""


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
                f"motor force {on}; noise alone would leave {percent(gap.floor)}."
            )
        case "unexplained":
            said = (
                f"There is a gap that no effect of the catalogue accounts for: {percent(gap.before)} of the motor "
                f"force {on}, where noise alone would leave {percent(gap.floor)}."
            )
            return f"{said} With {_all(d)} it {_moves(gap)}." if d.effects else said
        case "ambiguous":
            group, *_ = d.ambiguous_with or (d.effects,)
            others = [named(e) for e in d.effects if e not in group]
            too = f", and {listed(others)}" if others else ""
            first = (
                f"The simulation lacks {listed([named(e) for e in group], 'or')}, "
                f"which these data cannot tell apart{too}."
            )
            return f"{first} With {_all(d)}, the gap {on} {_moves(gap)}; noise alone leaves {percent(gap.floor)}."
    them = "it" if len(d.effects) == 1 else "them"
    return (
        f"The simulation lacks {_all(d)}. With {them}, the gap {on} {_moves(gap)} of the motor force; "
        f"noise alone leaves {percent(gap.floor)}."
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
        left = (d.atlas_after if d.effects else d.atlas) or d.atlas
        with_it = f"With {_all(d)} in: " if d.effects else ""
        if left is None:
            return "Not known", "The residual was not mapped."
        first = left.variables[0]
        head = f"It goes with {first.label}" if first.share >= 0.1 else "Bound to no single variable"
        return head, with_it + left.words()
    head = place(d.block) if d.block else "Not bound to a place"
    if d.where.time_s:
        head += f", {_intervals(d.where.time_s)}"
    elif d.where.frequency_hz:
        head += f", {_span(d.where.frequency_hz, 'Hz')}"
    return head, _looked_at(d)


def _looked_at(d: Diagnosis) -> str:
    return d.atlas.words() if d.atlas is not None else ""


def ranges(d: Diagnosis) -> str:
    """The ranges that hold nine tenths of what the effects change in the simulated force; empty without one."""
    where = d.where
    spans = ((where.speed_m_s, 1e3, "mm/s"), (where.position_m, 1e3, "mm"), (where.frequency_hz, 1.0, "Hz"))
    said = [_span([scale * x for x in span], unit) for span, scale, unit in spans if span]
    return f"Nine tenths of what {_all(d)} changes in the force lies at {listed(said)}." if said and d.effects else ""


def _span(ends: list[float], unit: str) -> str:
    """'-20 to 20 mm/s'."""
    return f"{significant(ends[0], 2)} to {significant(ends[1], 2)} {unit}"


def _intervals(spans: list[list[float]]) -> str:
    shown = listed([f"{on:.2f}–{off:.2f} s" for on, off in spans[:2]]) if len(spans) < 3 else ""
    return shown or f"{len(spans)} intervals from {spans[0][0]:.2f} to {spans[-1][1]:.2f} s"


# -- which -------------------------------------------------------------------------------------------------------


def _which(d: Diagnosis) -> tuple[str, str]:
    p = dict(d.ranking)
    rivals = [f"{named(e)} ({chance(x)})" for e, x in d.ranking if e not in ("none", *d.effects)]
    match d.verdict:
        case "none":
            text = "No effect closes more of the gap than noise and the base parameters leave it."
            text += f" Closest: {rivals[0]}." if rivals else ""
            text += " A wrong drive gain would not show: masses, friction and stiffness absorb it."
            return f"None ({chance(p.get('none', 0.0))})", text
        case "unexplained":
            text = "No effect of the catalogue, alone or with others, leaves a residual that looks like noise."
            if d.effects:
                text += f" On the way {_all(d)} was found{_shares(d)}; the rest follows no known law."
            else:
                best = [f"{named(e)} ({chance(x)})" for e, x in d.ranking if e not in ("none", "other")]
                text += f" Closest: {best[0]}." if best else ""
            return f"None that is known ({chance(p.get('other', 0.0))})", text
        case "ambiguous":
            group, *more = d.ambiguous_with or (d.effects,)
            head = f"{capital(_with_chance(group[0], p))} or {listed([_with_chance(e, p) for e in group[1:]], 'or')}"
            text = "Either leaves the same force on these records to within its noise."
            text += "".join(f" Nor can {listed([named(e) for e in g])} be told apart." for g in more)
            if len(d.effects) > 1:
                text += f" Also found: {listed([named(e) for e in d.effects if e not in group])}{_shares(d)}."
            if d.experiment:
                text += f" To part them: {d.experiment.what}; they then differ by {d.experiment.angle_deg:.0f}°."
            return head, text
    head = capital(_with_chance(d.effects[0], p))
    head += f", and {listed([named(e) for e in d.effects[1:]])}" if d.effects[1:] else ""
    text = f"{sizes(d)} " if sizes(d) else ""
    text += f"{capital(_shares(d).strip())}. " if len(d.effects) > 1 and _shares(d) else ""
    return head, text + (f"Next likeliest: {listed(rivals[:2])}." if rivals else "")


def sizes(d: Diagnosis) -> str:
    """The first effect's parameters: 'dFs = 6.1 ± 0.1 N, vs = 15.2 ± 0.8e-3 m/s.'"""
    said = [estimate(k, v) for k, v in d.parameters.get(d.effects[0], {}).items() if isinstance(v, dict)]
    return f"{', '.join(said)}." if said else ""


def estimate(name: str, number: dict[str, object]) -> str:
    """'F0 = 3.10 ± 0.12 N', with the digits that the standard deviation carries."""
    value, std = (float(number.get(k) or 0.0) for k in ("value", "std"))  # type: ignore[arg-type]
    unit = number.get("unit") or "1"
    places = decimals(std)
    spread = "" if places is None else f" ± {rounded(std, places)}"
    return f"{name} = {rounded(value, places)}{spread}{'' if unit == '1' else f' {unit}'}"


def _with_chance(effect: str, p: dict[str, float]) -> str:
    return f"{named(effect)} ({chance(p[effect])})" if effect in p else named(effect)


def _all(d: Diagnosis) -> str:
    return listed([named(e) for e in d.effects])


def _shares(d: Diagnosis) -> str:
    """What each effect holds of the gap: ' (taken out again, it gives back 60 % of the gap closed)'."""
    held = [f"{named(e)} {100 * d.last_in[e]:.0f} %" for e in d.effects if e in d.last_in]
    return f" (taken out again, of the gap closed comes back: {listed(held)})" if held else ""


# -- how far -----------------------------------------------------------------------------------------------------


def _how_far(d: Diagnosis) -> tuple[str, str]:
    name = judged_on(d)
    records = "; ".join(_record(record, gap, bool(d.effects)) for record, gap in d.gap.items())
    text = f"{capital(records)}."
    if "check" not in d.gap:
        text += " There was no check record: the gap is judged on the record that chose the effect, which flatters it."
    elif name == "fit":
        text += " What was found is not repeated on the check record, so the gap closed is judged on the fit record."
    if not d.effects:
        return ("Nothing to close" if d.verdict == "none" else "Not at all"), text
    if d.share is None:
        return "The gap is as small as the noise", text
    between = f" [{100 * d.interval[0]:.0f}, {100 * d.interval[1]:.0f}]" if d.interval else ""
    if d.share <= 0:
        return f"Not at all on the {name} record", text
    return f"{100 * d.share:.0f} %{between} of what can be closed", text


def _record(name: str, gap: Gap, changed: bool) -> str:
    said = f"{name} record: {percent(gap.before)}"
    said += f" before, {percent(gap.after)} after" if changed else ""
    if gap.predicted_after is not None:
        said += f" ({percent(gap.predicted_after)} said beforehand)"
    return f"{said}, {percent(gap.floor)} is noise"


def _moves(gap: Gap) -> str:
    """'falls from 4.0 % to 1.2 %'."""
    if abs(gap.after - gap.before) < _SEEN_CHANGE * gap.before:
        return f"stays at {percent(gap.before)}"
    return f"{'falls' if gap.after < gap.before else 'rises'} from {percent(gap.before)} to {percent(gap.after)}"
