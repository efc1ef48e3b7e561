"""What the figures of a blind study share: colours, and rates as dots with their Wilson intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from didim_jax.report.canvas import INK

RIGHT = "#0072b2"  # Okabe and Ito, as everywhere in the project
TWIN = "#8fbfdd"
PART = "#f0e442"
WRONG = "#d55e00"
ABSTAINED = "#c9ced3"
MISSED = "#e69f00"
SOFT = "#5f6b76"
RIVALS = (("#d55e00", "s"), ("#009e73", "^"), ("#cc79a7", "D"), ("#e69f00", "v"), ("#56b4e9", "P"), ("#20262c", "X"))
"""Colour and marker of each baseline, in order."""

EXACT = {"marker": "D", "markerfacecolor": "white", "markeredgecolor": SOFT}
"""Of rates of exact answers, beside those of accepted ones."""


def rates(ax: Axes, y: Sequence[float], found: Sequence[Mapping[str, Any]], label: str = "", **style: Any) -> None:
    """Shares in percent, each with its interval; of no cases, nothing."""
    style = {"color": RIGHT, "marker": "o", "markersize": 5.5, "zorder": 3, "clip_on": False, **style}
    for k, (place, one) in enumerate(zip(y, found, strict=True)):
        if one["n"]:
            ax.plot([100 * one["low"], 100 * one["high"]], [place] * 2, color=style["color"], linewidth=1.3, zorder=2)
            ax.plot(100 * one["value"], place, linestyle="none", label=label if k == 0 else None, **style)


def names(ax: Axes, y: Sequence[float], texts: Sequence[str], size: float = 8.5) -> None:
    """Names down the side; they come from files, so a dollar sign in one is a dollar sign."""
    ax.set_yticks(list(y), list(texts), fontsize=size, color=INK, parse_math=False)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", visible=False)


def aside(ax: Axes, y: float, text: str, x: float = 1.015, **style: Any) -> None:
    """Words to the right of an axis, at the height of a row."""
    style = {"fontsize": 8.5, "color": INK, "va": "center", **style}
    ax.text(x, y, text, transform=ax.get_yaxis_transform(), parse_math=False, **style)


def lowest(found: Sequence[Mapping[str, Any]]) -> float:
    """Where an axis of percentages may begin so that every interval is inside."""
    low = min((100 * one["low"] for one in found if one["n"]), default=0.0)
    return float(10 * np.floor(max(low - 2, 0) / 10))
