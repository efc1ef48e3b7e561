"""The three questions answered in words: where the gap lies, which effect causes it, how far it shrinks."""

from ..gap.diagnosis import Diagnosis


def answers(d: Diagnosis) -> tuple[str, str, str]:
    """One sentence or two for each question."""
    return _where(d), _which(d), _how_far(d)


def _where(d: Diagnosis) -> str:
    return "Where: " + (d.atlas.words() if d.atlas is not None else "not known.")


def _which(d: Diagnosis) -> str:
    chance = dict(d.ranking)
    match d.verdict:
        case "none":
            return f"Which: none. No gap beyond noise and what the base parameters absorb ({chance.get('none', 0):.0%})."
        case "unexplained":
            found = f" {' and '.join(d.effects)} was found on the way." if d.effects else ""
            return f"Which: nothing in the catalogue accounts for it ({chance.get('other', 0):.0%}).{found}"
        case "ambiguous":
            groups = "; ".join(" or ".join(group) for group in d.ambiguous_with)
            return f"Which: {' and '.join(d.effects)}; these data cannot tell apart {groups}."
    return f"Which: {' and '.join(d.effects)} ({chance.get(d.effects[0], 0):.0%} for the first)."


def _how_far(d: Diagnosis) -> str:
    fit = d.gap["fit"]
    text = f"How far: {100 * fit.before:.2f} % of the force before, {100 * fit.after:.2f} % after, {100 * fit.floor:.2f} % is noise"
    if check := d.gap.get("check"):
        text += (
            f"; on the check record {100 * check.before:.2f} % before, {100 * check.after:.2f} % after "
            f"({100 * (check.predicted_after or 0):.2f} % predicted)"
        )
    if d.share is not None and d.interval is not None:
        text += f": {d.share:.0%} of the explainable gap closed [{d.interval[0]:.0%}, {d.interval[1]:.0%}]"
    return text + "."
