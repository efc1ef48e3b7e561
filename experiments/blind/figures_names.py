"""Which name was given for which truth, and how far the probability of a name may be believed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from didim_jax.report.canvas import INK, canvas, label, title

from .dots import RIGHT, SOFT, WRONG
from .judge import BLOCKS
from .plan import ALIAS

_ANSWERS = ("none", "other", "failed")
_SHADE = LinearSegmentedColormap.from_list("shade", ["#ffffff", "#cfe3f1", "#8fbfdd", RIGHT])


def confusion_figure(score: Mapping[str, Any]) -> Figure:
    """Truth down, first name given across, counts; the shade is the share of the row, the frame the right answer."""
    table = score["confusion"]
    said = {name for row in table.values() for name in row}
    truths = _in_order(table)
    across = [
        name
        for name in _in_order(said | set(table))
        if name not in _ANSWERS and not name.startswith("x_") and (name != ALIAS or name in said)
    ]
    across += [name for name in _ANSWERS if name in said or name != "failed"]
    counts = np.array([[table[t].get(name, 0) for name in across] for t in truths])
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    height = 0.225 * len(truths) + 2.05
    figure, axes = canvas(10.6, height, 1, 1, margins=(2.2, 0.6, 0.4, 1.65))
    ax = axes[0, 0]
    ax.pcolormesh(shares, cmap=_SHADE, vmin=0, vmax=1, edgecolors="#eceff1", linewidth=0.6)
    for (i, j), count in np.ndenumerate(counts):
        if count:
            colour = "white" if shares[i, j] > 0.7 else INK
            ax.text(j + 0.5, i + 0.5, str(count), ha="center", va="center", fontsize=7.5, color=colour)
    for i, truth in enumerate(truths):
        wanted = "other" if truth.startswith("x_") else "none" if truth == ALIAS else truth
        if wanted in across:
            ax.add_patch(Rectangle((across.index(wanted), i), 1, 1, fill=False, edgecolor=INK, linewidth=1.1))
        total = {"transform": ax.get_yaxis_transform(), "fontsize": 7.5, "color": SOFT, "va": "center"}
        ax.text(1.01, i + 0.5, f"{counts[i].sum()}", **total)
    ax.text(1.01, 1.01, "cases", transform=ax.transAxes, fontsize=7.5, color=SOFT)
    ax.set_yticks(np.arange(len(truths)) + 0.5, truths, fontsize=8, parse_math=False)
    spoken = {"other": "unexplained", "failed": "no diagnosis"}
    texts = [spoken.get(name, name) for name in across]
    ax.set_xticks(np.arange(len(across)) + 0.5, texts, rotation=90, fontsize=8, parse_math=False)
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    ax.set_ylim(len(truths), 0)
    ax.grid(visible=False)
    ax.spines[["left", "bottom"]].set_visible(False)
    label(ax, "named first", "truth")
    ax.xaxis.set_label_position("bottom")
    return figure


def _in_order(found: Any) -> list[str]:
    """Along the loop, controller first; then the alias, none, and what no catalogue holds."""
    known = [*BLOCKS, ALIAS, "none"]
    return [name for name in known if name in found] + sorted(set(found) - set(known))


def reliability_figure(score: Mapping[str, Any]) -> Figure:
    """Share of right first names over the probability that they were given, and how many cases each point has."""
    calibrated = score["calibration"]
    figure, axes = canvas(
        6.4, 4.9, 2, 1, margins=(0.75, 0.2, 0.5, 0.35), height_ratios=(3.2, 1), hspace=0.12, sharex=True
    )
    ax, below = axes[:, 0]
    ax.plot([0, 100], [0, 100], color=SOFT, linewidth=0.9, linestyle=(0, (4, 3)), label="as often as said")
    for k, one in enumerate(calibrated["reliability"]):
        right = one["right"]
        x = 100 * one["confidence"]
        ax.plot([x, x], [100 * right["low"], 100 * right["high"]], color=RIGHT, linewidth=1.4)
        once = "seen, 95 % interval" if k == 0 else None
        ax.plot(x, 100 * right["value"], "o", color=RIGHT, markersize=6, label=once)
        middle = 50 * (one["from"] + one["to"])
        below.bar(middle, right["n"], 9.2, color="#8fbfdd", label="right" if k == 0 else None)
        wrong = right["n"] - right["k"]
        style = {"color": WRONG, "hatch": "////", "edgecolor": "white", "linewidth": 0}
        below.bar(middle, wrong, 9.2, right["k"], label="wrong" if k == 0 else None, **style)
        below.text(middle, right["n"], f"{right['n']}", ha="center", va="bottom", fontsize=8, color=INK)
    most = max((one["right"]["n"] for one in calibrated["reliability"]), default=1)
    ax.set_xlim(0, 101)
    ax.set_ylim(-2, 102)
    below.set_ylim(0, 1.3 * most)
    brier, error = calibrated["brier"], calibrated["expected_calibration_error"]
    if brier is not None:
        title(ax, f"Brier score {brier:.3f}, expected calibration error {100 * error:.1f} points")
    label(ax, y="first name right, % of the cases")
    label(below, "probability given to the first name, %", "cases")
    ax.legend(loc="upper left", fontsize=8.5, frameon=False)
    below.legend(loc="upper left", fontsize=8, frameon=False, ncols=2)
    return figure
