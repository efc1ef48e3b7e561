"""How the estimate came about: every parameter, and the criterion, by iteration."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..identify.result import IdentificationResult
from .canvas import INK, RESIDUAL, SIMULATED, canvas, label, logarithmic, title
from .words import stage_name

_COLUMNS = 5
_PANEL = 1.28  # inches


def iterates_figure(result: IdentificationResult) -> Figure:
    """Small panels, one per parameter in its unit and one for norm(rho) / norm(Y); a row per step of a procedure."""
    stages = [stage for stage in (*result.steps, result) if np.isfinite(stage.trace).all()]
    rows = [_panels(stage) for stage in stages]
    width = max(len(row) for row in rows)
    columns = width if len(stages) > 1 or width <= _COLUMNS + 1 else -(-width // 2)
    if len(stages) == 1:
        rows = [rows[0][k : k + columns] for k in range(0, width, columns)]
    gap = 0.85 if len(stages) > 1 else 0.6
    height = 0.95 + _PANEL * len(rows) + gap * (len(rows) - 1) - (0 if len(stages) > 1 else 0.2)
    figure, axes = canvas(
        9.6,
        height,
        len(rows),
        columns,
        hspace=gap / _PANEL,
        wspace=0.42 if columns <= _COLUMNS + 1 else 0.66,
        margins=(0.55, 0.12, 0.45, 0.5 if len(stages) > 1 else 0.3),
    )
    for k, (line, row) in enumerate(zip(axes, rows, strict=True)):
        for ax, panel in zip(line, row, strict=False):
            panel(ax)
            if row is rows[-1]:
                label(ax, x="iteration")
        for ax in line[len(row) :]:
            ax.remove()
        if len(stages) > 1:
            line[0].annotate(
                f"step {k + 1}: {stage_name(stages[k])}",
                (0, 1),
                (0, 21),
                xycoords="axes fraction",
                textcoords="offset points",
                fontsize=9.5,
                fontweight="bold",
                color=INK,
            )
    return figure


def has_iterates(result: IdentificationResult) -> bool:
    """Whether there is more to draw than one solution."""
    return any(len(stage.trace) > 1 for stage in (*result.steps, result))


def _panels(stage: IdentificationResult) -> list[Callable[[Axes], None]]:
    """One function per panel, each drawing on the axes it is given."""
    traces = zip(stage.names, stage.units, np.atleast_2d(stage.trace).T, strict=True)
    panels = [lambda ax, n=n, u=u, y=y: _parameter(ax, n, u, y) for n, u, y in traces]
    return [*panels, lambda ax: _criterion(ax, stage.costs)]


def _parameter(ax: Axes, name: str, unit: str, values: np.ndarray) -> None:
    _line(ax, values, SIMULATED)
    ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.ticklabel_format(axis="y", style="sci", scilimits=(-2, 4), useOffset=False)
    ax.yaxis.get_offset_text().set_fontsize(8)
    title(ax, name if unit == "1" else f"{name}, {unit}", fontsize=9)


def _criterion(ax: Axes, costs: np.ndarray) -> None:
    _line(ax, 100 * costs, RESIDUAL)
    positive = 100 * costs[np.isfinite(costs) & (costs > 0)]
    if positive.size:
        ax.set_yscale("log")
        low, high = positive.min() / 1.15, positive.max() * 1.15
        ax.set_ylim(low, high)
        logarithmic(ax.yaxis, low, high)
    title(ax, "|ρ| / |Y|, %", fontsize=9)


def _line(ax: Axes, values: np.ndarray, colour: str) -> None:
    few = len(values) <= 20
    ax.plot(values, color=colour, linewidth=1.4, marker="o" if few else "", markersize=3.5)
    ax.xaxis.set_major_locator(MaxNLocator(4, integer=True))
