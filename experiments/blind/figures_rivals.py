"""The diagnosis beside its baselines, and beside itself with one ingredient removed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from didim_jax.report.canvas import FAINT, canvas, label

from .ablation_scores import Ablated
from .dots import RIGHT, RIVALS, aside, lowest, names, rates
from .words import kind, ordered


def rivals_figure(score: Mapping[str, Any]) -> Figure:
    """Accepted by kind of case, every method on the same cases."""
    strata, methods = ordered([*score["strata"]]), score["baselines"]["methods"]
    figure, axes = canvas(9.8, 0.52 * len(strata) + 1.15, 1, 1, margins=(2.3, 1.0, 0.5, 0.55))
    ax = axes[0, 0]
    offsets = np.linspace(-0.34, 0.34, len(methods) + 1)
    y = np.arange(len(strata))
    for k, at in enumerate(y):
        if k % 2:
            ax.axhspan(at - 0.5, at + 0.5, color="#f4f5f6", linewidth=0, zorder=0)
    for (method, found), shift, (colour, marker) in zip(
        methods.items(), offsets[1:], _styles(len(methods)), strict=True
    ):
        style = {"color": colour, "marker": marker, "markersize": 4.2, "markerfacecolor": "white"}
        rates(ax, y + shift, [found["strata"][name]["accepted"] for name in strata], method, **style)
    ours = [score["strata"][name]["accepted"] for name in strata]
    rates(ax, y + offsets[0], ours, "diagnosis", markersize=7)
    for at, one in zip(y, ours, strict=True):
        aside(ax, float(at), f"{one['n']} cases")
    names(ax, y.tolist(), [kind(name) for name in strata], 9)
    ax.set_xlim(-1, 101)
    ax.set_ylim(len(strata) - 0.45, -0.55)
    label(ax, "right, % of the cases, with 95 % intervals")
    handles, labels = ax.get_legend_handles_labels()
    order = [len(handles) - 1, *range(len(handles) - 1)]
    ax.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        loc="lower left",
        bbox_to_anchor=(-0.22, 1.0),
        ncols=6,
        fontsize=8.5,
        frameon=False,
        columnspacing=1.2,
    )
    return figure


def _styles(n: int) -> list[tuple[str, str]]:
    return [RIVALS[k % len(RIVALS)] for k in range(n)]


def ablations_figure(found: Sequence[Ablated]) -> Figure:
    """Right answers of each variant, the complete diagnosis as a line."""
    figure, axes = canvas(9.8, 0.33 * len(found) + 0.85, 1, 1, margins=(4.4, 0.9, 0.5, 0.15))
    ax = axes[0, 0]
    complete = next((one for one in found if one.name == "complete"), None)
    if complete is not None and complete.right["n"]:
        ax.axvline(100 * complete.right["value"], color=FAINT, linewidth=1.4, zorder=1)
    rates(ax, range(len(found)), [one.right for one in found], color=RIGHT, markersize=6.5)
    for k, one in enumerate(found):
        aside(ax, k, f"{one.right['k']} of {one.right['n']}")
    names(ax, range(len(found)), [one.words for one in found], 9)
    ax.set_ylim(len(found) - 0.4, -0.6)
    ax.set_xlim(lowest([one.right for one in found]), 101)
    label(ax, "right, % of the cases, with 95 % intervals")
    return figure
