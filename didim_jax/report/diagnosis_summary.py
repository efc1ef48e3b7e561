"""The answer in one picture: where the gap lies, which effects may cause it, how far it shrinks."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..gap.diagnosis import Diagnosis
from .canvas import INK, MEASURED, RESIDUAL, SIMULATED, canvas, label, title
from .diagnosis_names import chance, named
from .diagnosis_shape import draw_shape
from .tables import percent

_WIDTH, _HEIGHT = 10.4, 2.9
_SHOWN = 6
_QUIET = "#aeb6bd"
_TWIN = "#e69f00"


def summary_figure(d: Diagnosis) -> Figure:
    """Three panels, one under each answer."""
    figure, axes = canvas(_WIDTH, _HEIGHT, 1, 3, margins=(0.6, 0.15, 0.5, 0.35))
    where, which, far = axes[0]
    third = _WIDTH / 3
    for k, (ax, left) in enumerate(((where, 0.6), (which, 1.75), (far, 0.65))):
        ax.set_position(
            ((k * third + left) / _WIDTH, 0.5 / _HEIGHT, (third - left - 0.25) / _WIDTH, (_HEIGHT - 0.85) / _HEIGHT)
        )
    draw_shape(where, d)
    _ranking(which, d)
    _gaps(far, d)
    return figure


def _ranking(ax: Axes, d: Diagnosis) -> None:
    """Probabilities of the first step, a bracket around twins."""
    shown = shown_ranking(d, _SHOWN)
    group = twins(d)
    for k, (effect, p) in enumerate(shown):
        colour = _QUIET if effect in ("none", "other") else _TWIN if effect in group else SIMULATED
        ax.barh(k, 100 * p, height=0.62, color=colour)
        inside = p > 0.8
        ax.text(
            100 * p + (-1.5 if inside else 1.5),
            k,
            chance(p),
            ha="right" if inside else "left",
            va="center",
            fontsize=8.5,
            color="white" if inside else INK,
        )
    paired = [k for k, (effect, _) in enumerate(shown) if effect in group]
    if len(paired) > 1:
        low, high = paired[0] - 0.35, paired[-1] + 0.35
        ax.plot([97, 100, 100, 97], [low, low, high, high], color=_TWIN, linewidth=1.6, clip_on=False)
        # Outside the bracket: inside, the number beside a bar may be anywhere.
        ax.text(102, 0.5 * (low + high), "not told apart", rotation=90, va="center", fontsize=8, color=INK)
    ax.set_yticks(np.arange(len(shown)), [_short(named(effect)) for effect, _ in shown])
    ax.set_ylim(max(len(shown), 4) - 0.4, -0.6)
    ax.set_xlim(0, 100)
    ax.grid(axis="y", visible=False)
    label(ax, x="probability, %")
    title(ax, "which came first" if len(d.effects) > 1 else "effects of the catalogue")


def shown_ranking(d: Diagnosis, most: int) -> list[tuple[str, float]]:
    """The likeliest effects, twins moved together; `none` and `other` always among them."""
    ranking = dict(sorted(d.ranking, key=lambda item: -item[1]))
    group = [e for e in twins(d) if e in ranking]
    effects = [e for e in ranking if e not in ("none", "other", *group)]
    chosen = (group + effects)[: most - 2] + [e for e in ("none", "other") if e in ranking]
    size = {e: max(ranking[g] for g in group) if e in group else ranking[e] for e in chosen}
    return [(e, ranking[e]) for e in sorted(chosen, key=lambda e: (-size[e], e not in group, -ranking[e]))]


def twins(d: Diagnosis) -> tuple[str, ...]:
    """The group that the first ranking cannot tell apart; () where there is none."""
    ranked = dict(d.ranking)
    return next((g for g in d.ambiguous_with if sum(e in ranked for e in g) > 1), ())


def _short(text: str) -> str:
    """In two lines where one is too long."""
    if len(text) <= 21:
        return text
    cut = text.rfind(" ", 0, 21)
    return f"{text[:cut]}\n{text[cut + 1 :]}"


def _gaps(ax: Axes, d: Diagnosis) -> None:
    """Down the stairs: the gap before, after, and what noise leaves; on the check record, what was predicted."""
    highest = 100 * max(max(g.before, g.after, g.predicted_after or 0.0) for g in d.gap.values())
    steps = ("before", "after", "floor") if d.effects else ("before", "floor")
    names = {"before": "before" if d.effects else "simulated", "after": "after", "floor": "noise"}
    ticks: list[tuple[float, str]] = []
    start = 0.0
    for name, gap in d.gap.items():
        for k, step in enumerate(steps):
            height = 100 * getattr(gap, step)
            colour = {"before": RESIDUAL, "after": SIMULATED, "floor": MEASURED}[step]
            ax.bar(start + k, height, width=0.86, color=colour)
            said = percent(getattr(gap, step)).removesuffix(" %")
            top = max(height, 100 * (gap.predicted_after or 0.0)) if k == len(steps) - 2 else height
            ax.text(start + k, top + 0.015 * highest, said, ha="center", va="bottom", fontsize=8.5, color=INK)
            ticks.append((start + k, names[step]))
        if gap.predicted_after is not None and np.isfinite(gap.predicted_after):
            at, level = start + len(steps) - 2, 100 * gap.predicted_after
            ax.plot([at - 0.43, at + 0.43], [level, level], color="black", linewidth=1.6, linestyle=(0, (2, 1)))
        middle = start + 0.5 * (len(steps) - 1)
        ax.text(middle, 1.13 * highest, f"{name} record", ha="center", fontsize=8.5, color=INK, fontweight="bold")
        start += len(steps) + 0.6
    ax.set_xticks([at for at, _ in ticks], [text for _, text in ticks])
    ax.set_ylim(0, 1.22 * highest or 1.0)
    ax.grid(axis="x", visible=False)
    label(ax, y="gap, % of the motor force")
    predicted = any(g.predicted_after is not None for g in d.gap.values())
    title(ax, "gap" + (" (dashed: predicted)" if predicted else ""))
