"""How much of the gap is closed on the trajectory that was not fitted, and what is left of it against noise."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from didim_jax.report.canvas import INK, canvas, label, logarithmic, title

from .dots import MISSED, RIGHT, SOFT, WRONG

_HALO = [withStroke(linewidth=3, foreground="white")]

_GROUPS = {
    "one effect": (("single", "small", "large", "poor"), RIGHT, "-"),
    "two or three": (("two", "three"), WRONG, "--"),
    "nothing to find": (("none", "numerics", "alias"), SOFT, "-."),
    "of no catalogue": (("outside",), MISSED, ":"),
}


def gap_figure(score: Mapping[str, Any]) -> Figure:
    """Distribution functions: gap closed, where there is one to close; and what is left over the noise floor."""
    figure, axes = canvas(9.8, 3.5, 1, 2, margins=(0.75, 0.2, 0.5, 0.4), wspace=0.2)
    closed, left = axes[0]
    low, highest = 0.0, 2.0
    for name, (strata, colour, style) in _GROUPS.items():
        rows = [row for row in score["rows"] if row["stratum"] in strata]
        shares = [100 * row["closed"] for row in rows if row["closed"] is not None]
        over = [row["over_floor"] for row in rows if row["over_floor"] is not None]
        drawn = {"color": colour, "linestyle": style, "linewidth": 1.7}
        if shares:
            low = min(low, *shares)
            _steps(closed, shares, label=f"{name} ({len(shares)})", **drawn)
        if over:
            highest = max(highest, *over)
            _steps(left, over, label=f"{name} ({len(over)})", **drawn)
    for share, percent, word in ((96, 50, "median"), (75, 10, "10th percentile")):
        closed.plot(share, percent, ">", color=INK, markersize=6, zorder=5)
        place: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "va": "bottom", "fontsize": 8}
        closed.annotate(f"minimum, {word}", (share, percent), (-4, 4), path_effects=_HALO, **place)
    closed.set_xlim(max(low, -20), 101.5)
    left.set_xscale("log")
    logarithmic(left.xaxis, 0.9, highest)
    left.set_xlim(0.9, 1.05 * highest)
    left.axvline(1, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
    for ax in (closed, left):
        ax.set_ylim(0, 101.5)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="upper left" if ax is closed else "lower right", fontsize=8.5, frameon=False)
    title(closed, "gap closed, by energy")
    title(left, "gap that is left, over what noise alone leaves")
    label(closed, "gap closed on the check record, %", "cases up to here, %")
    label(left, "gap after / noise floor (1: nothing left but noise)", "cases up to here, %")
    return figure


def _steps(ax: Axes, values: list[float], **style: Any) -> None:
    """Percentage of the values up to each."""
    x = np.sort(np.asarray(values, float))
    ax.step(np.r_[x[0], x, x[-1]], 100 * np.r_[0, np.arange(1, len(x) + 1), len(x)] / len(x), where="post", **style)
