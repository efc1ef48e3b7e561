"""The main figure: how every kind of case was answered; and the same rates by noise, encoder, model and size."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from didim_jax.report.canvas import INK, canvas, label

from .dots import ABSTAINED, EXACT, MISSED, PART, RIGHT, SOFT, TWIN, WRONG, aside, lowest, names, rates
from .words import WANTED, between, kind, ordered

_ANSWERS: Mapping[str, tuple[str, str, str]] = {
    "exact": ("right", RIGHT, ""),
    "twin": ("right, a twin admitted", TWIN, ""),
    "part": ("in part", PART, ""),
    "missed": ("says none", MISSED, "...."),
    "abstained": ("says unexplained", ABSTAINED, ""),
    "wrong": ("a wrong name", WRONG, "////"),
    "failed": ("no diagnosis", INK, ""),
}

_GAPS = {"two", "none", "outside"}  # what begins another kind of right answer stands a little apart


def how(row: Mapping[str, Any]) -> str:
    """How a case was answered."""
    if row["accepted"]:
        return "exact" if row["exact"] else "twin"
    if row["verdict"] in ("none", "unexplained"):
        return {"none": "missed", "unexplained": "abstained"}[row["verdict"]]
    if row["verdict"] == "failed":
        return "failed"
    return "part" if set(row["found"]) < set(row["target"]) else "wrong"


def answers_figure(score: Mapping[str, Any]) -> Figure:
    """A bar a kind of case, in shares of its cases; a diamond is the best baseline on the same cases."""
    strata = ordered([*score["strata"]])
    figure, axes = canvas(9.8, 0.245 * len(strata) + 1.3, 1, 1, margins=(3.05, 2.25, 0.45, 0.52))
    ax = axes[0, 0]
    y: list[float] = []
    place = 0.0
    for name in strata:
        place += 0.35 if y and name in _GAPS else 0.0
        y.append(place)
        place += 1.0
    used = set()
    for at, name in zip(y, strata, strict=True):
        rows = [row for row in score["rows"] if row["stratum"] == name]
        left = 0.0
        for answer, (_, colour, hatch) in _ANSWERS.items():
            share = 100 * sum(how(row) == answer for row in rows) / len(rows)
            if share:
                used.add(answer)
                ax.barh(at, share, 0.74, left, color=colour, hatch=hatch, edgecolor="white", linewidth=0.8)
            left += share
        accepted = score["strata"][name]["accepted"]
        ax.plot([100 * accepted["low"], 100 * accepted["high"]], [at, at], color=INK, linewidth=1.4, zorder=4)
        _best(ax, at, name, score)
        aside(ax, at, f"{100 * accepted['value']:.0f} %", fontweight="bold", x=1.115, ha="right")
        ax.text(
            1.13,
            at,
            f"{accepted['k']} of {accepted['n']} ({between(accepted, digits=0)})",
            transform=ax.get_yaxis_transform(),
            va="center",
            fontsize=8.5,
            color=SOFT,
        )
    names(ax, y, [f"{kind(name)} → {WANTED.get(name, 'name it')}" for name in strata], 9)
    ax.set_xlim(-1.5, 101.5)  # a diamond at an end covers neither name nor bar
    ax.set_ylim(y[-1] + 0.6, -0.6)
    label(ax, "share of the cases, %")
    ax.text(1.035, 1.01, "right (95 % interval)", transform=ax.transAxes, fontsize=8.5, color=SOFT)
    handles: list[Patch | Line2D] = [
        Patch(facecolor=c, hatch=h, edgecolor="white", label=w) for a, (w, c, h) in _ANSWERS.items() if a in used
    ]
    if score["baselines"]["methods"]:
        diamond: dict[str, Any] = {"marker": "D", "markerfacecolor": "white", "markeredgecolor": INK, "markersize": 6}
        handles.append(Line2D([], [], linestyle="none", label="best baseline", **diamond))
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=8,
        fontsize=8.5,
        frameon=False,
        columnspacing=1.3,
        handlelength=1.5,
    )
    return figure


def _best(ax: Any, at: float, stratum: str, score: Mapping[str, Any]) -> None:
    theirs = [m["strata"][stratum]["accepted"]["value"] for m in score["baselines"]["methods"].values()]
    if theirs:
        style = {"markerfacecolor": "white", "markeredgecolor": INK, "markersize": 6, "clip_on": False, "zorder": 5}
        ax.plot(100 * max(theirs), at, "D", **style)


def groups_figure(score: Mapping[str, Any]) -> Figure:
    """Accepted and exact: noise, load encoder and model among single effects of typical size; size over strata."""
    rows: list[tuple[str, Mapping[str, Any]] | None] = []
    orders: dict[str, Sequence[str]] = {"noise": ("low", "usual", "high"), "load_encoder": ("True", "False")}
    spoken = {"True": "yes", "False": "no"}
    for group, word in (("noise", "noise"), ("load_encoder", "load encoder"), ("model", "drive")):
        found = score["groups"].get(group, {})
        listed = [k for k in orders.get(group, ()) if k in found]
        listed += [k for k in found if k not in listed]
        rows += [(f"{word}: {spoken.get(key, key)}", found[key]) for key in listed] + [None] * bool(listed)
    sizes = {"small": "small", "single": "typical", "large": "large", "poor": "typical, hardly excited"}
    rows += [(f"size: {word}", score["strata"][name]) for name, word in sizes.items() if name in score["strata"]]
    figure, axes = canvas(9.8, 0.26 * len(rows) + 0.95, 1, 1, margins=(2.3, 1.7, 0.5, 0.35))
    ax = axes[0, 0]
    kept = [(k, *row) for k, row in enumerate(rows) if row]
    rates(ax, [k - 0.13 for k, *_ in kept], [f["accepted"] for *_, f in kept], "accepted (an admitted twin may stand)")
    exact = [f["exact"] for *_, f in kept]
    rates(ax, [k + 0.17 for k, *_ in kept], exact, "exact", color=SOFT, markersize=4.5, **EXACT)
    for k, _, found in kept:
        aside(ax, k, f"{found['accepted']['k']} of {found['accepted']['n']}")
    names(ax, [k for k, *_ in kept], [text for _, text, _ in kept], 9)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlim(lowest([f[name] for *_, f in kept for name in ("accepted", "exact")]), 100.8)
    label(ax, "named right, % of the cases, with 95 % intervals")
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2, fontsize=8.5, frameon=False, borderaxespad=0.1)
    return figure
