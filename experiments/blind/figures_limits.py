"""How small an effect may be and still be named: a panel a unit, every axis in the effect's own unit."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from didim_jax.report.canvas import DPI, INK, label, logarithmic, tidy

from .dots import ABSTAINED, RIGHT, SOFT, WRONG, names
from .words import practical

_ROW, _HEAD, _TOP, _WIDTH, _LEFT = 0.36, 0.62, 0.4, 10.4, 2.3  # inches


def by_unit(limits: Mapping[str, Any]) -> dict[str, list[str]]:
    """Effects that share a unit, the largest group first, each from what is seen best against its typical size."""
    effects = limits["effects"]
    groups: dict[str, list[str]] = {}
    for name, one in effects.items():
        groups.setdefault(one["unit"], []).append(name)

    def ease(name: str) -> float:
        one = effects[name]
        return (one["p50"] or np.inf) / (one["typical"] or 1.0)

    return {unit: sorted(groups[unit], key=ease) for unit in sorted(groups, key=lambda unit: -len(groups[unit]))}


def limits_figure(limits: Mapping[str, Any]) -> Figure:
    """Sizes named in half and in nine of ten cases beside the Cramér-Rao bound, over all trials."""
    columns: tuple[list[tuple[str, list[str]]], ...] = ([], [])
    heights = [0.0, 0.0]
    for unit, some in by_unit(limits).items():
        shorter = int(heights[1] < heights[0])
        columns[shorter].append((unit, some))
        heights[shorter] += _ROW * len(some) + _HEAD
    height = max(*heights, 1.0) + _TOP
    figure = Figure(figsize=(_WIDTH, height), dpi=DPI)
    FigureCanvasAgg(figure)
    for column, panels in enumerate(columns):
        top = height - _TOP
        for unit, some in panels:
            tall = _ROW * len(some)
            left = (column * 0.5 * _WIDTH + _LEFT) / _WIDTH
            ax = figure.add_axes((left, (top - tall) / height, (0.5 * _WIDTH - _LEFT - 0.15) / _WIDTH, tall / height))
            tidy(ax)
            _panel(ax, unit, some, limits["effects"])
            top -= tall + _HEAD
    figure.legend(handles=_legend(), loc="upper left", ncols=7, fontsize=8.5, frameon=False, columnspacing=1.2)
    return figure


def _panel(ax: Axes, unit: str, some: list[str], effects: Mapping[str, Any]) -> None:
    seen: list[float] = []
    scale, shown = practical(unit, max(effects[name]["typical"] or 0.0 for name in some))
    for y, name in enumerate(some):
        one, below = _scaled(effects[name], scale), effects[name].get("below") or {}
        for size, named in one["trials"]:
            colour, marker, place = (RIGHT, "|", y - 0.27) if named else (WRONG, "x", y + 0.27)
            ax.plot(size, place, marker, color=colour, markersize=4, alpha=0.7, markeredgewidth=0.9)
            seen.append(size)
        p50, p90 = one["p50"], one["p90"]
        if p50 and p90:
            ax.plot([p50, p90], [y, y], color=RIGHT, linewidth=3.2, alpha=0.35, solid_capstyle="butt")
        for level, face in (("p50", "white"), ("p90", RIGHT)):
            value, (low, high) = one[level], one[f"{level}_interval"]
            if low:
                end = high or 1.35 * max([low, value or low, *(size for size, _ in one["trials"])])
                ax.plot([low, end], [y, y], color=RIGHT, linewidth=1.0)
                if high is None:
                    ax.plot(end, y, ">", color=RIGHT, markersize=4)
                seen += [low, end]
            if value:
                marker = "<" if below.get(level) else "o"
                ax.plot(value, y, marker, color=RIGHT, markerfacecolor=face, markersize=6, zorder=4)
                seen.append(value)
        if one["typical"]:
            ax.plot(one["typical"], y, "^", color=ABSTAINED, markeredgecolor=SOFT, markersize=6, zorder=3)
            seen.append(one["typical"])
        if one["crlb"]:
            ax.plot(one["crlb"], y, "s", color=INK, markersize=4.5, zorder=4)
            seen.append(one["crlb"])
    ax.set_xscale("log")
    positive = [x for x in seen if x and x > 0] or [0.1, 1.0]
    low, high = min(positive) / 1.4, max(positive) * 1.4
    logarithmic(ax.xaxis, low, high)
    if high > 120 * low:
        logarithmic(ax.xaxis, low, 1000 * low)
    ax.set_xlim(low, high)
    ax.set_ylim(len(some) - 0.5, -0.5)
    names(ax, range(len(some)), [f"{name}  {effects[name]['parameter']}" for name in some])
    label(ax, f"size, {shown}" if shown else "size, 1 (no unit)")


def _scaled(one: Mapping[str, Any], scale: float) -> dict[str, Any]:
    """Every size of an effect in another unit."""

    def times(value: float | None) -> float | None:
        return None if value is None else scale * value

    out: dict[str, Any] = {key: times(one[key]) for key in ("typical", "crlb", "p50", "p90")}
    for key in ("p50_interval", "p90_interval"):
        out[key] = [times(value) for value in one.get(key) or (None, None)]
    return {**out, "trials": [(scale * size, named) for size, named in one["trials"]]}


def _legend() -> list[Line2D]:
    none: dict[str, Any] = {"linestyle": "none"}
    return [
        Line2D([], [], marker="s", color=INK, markersize=4.5, label="Cramér-Rao bound (1 std)", **none),
        Line2D([], [], marker="o", color=RIGHT, markerfacecolor="white", markersize=6, label="named in 50 %", **none),
        Line2D([], [], marker="o", color=RIGHT, markersize=6, label="named in 90 %", **none),
        Line2D([], [], marker="<", color=RIGHT, markerfacecolor="white", markersize=6, label="or less", **none),
        Line2D([], [], marker="^", color=ABSTAINED, markeredgecolor=SOFT, markersize=6, label="typical size", **none),
        Line2D([], [], marker="|", color=RIGHT, markersize=6, label="trial: named", **none),
        Line2D([], [], marker="x", color=WRONG, markersize=4, label="trial: not named", **none),
    ]
