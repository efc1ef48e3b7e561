"""Maps as pictures, drawn from the stores alone."""

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from didim_jax.report.canvas import INK, canvas, label, logarithmic, title

from .job import WORDS, Outcome
from .mode_start import BOXES
from .no_start import Drawn

# Okabe and Ito: told apart by colour-blind readers, and by lightness in grey.
COLOURS = {
    Outcome.TRUTH: "#0072b2",
    Outcome.ELSEWHERE: "#f0c200",
    Outcome.DIVERGED: "#d55e00",
    Outcome.EXHAUSTED: "#bfc5ca",
}
MARKERS = {Outcome.TRUTH: "o", Outcome.ELSEWHERE: "s", Outcome.DIVERGED: "x", Outcome.EXHAUSTED: "^"}
_HATCH: dict[str, Any] = {"hatch": "////", "facecolor": "none", "edgecolor": "#20262c", "linewidth": 0.0}
_LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")


def _legend(figure: Figure, unstable: str) -> None:
    handles: list[Patch | Line2D] = [Patch(color=COLOURS[o], label=WORDS[o]) for o in Outcome]
    if unstable:
        handles.append(Patch(**_HATCH, label=unstable))
    figure.legend(handles=handles, loc="lower center", ncols=5, fontsize=8.5, frameon=False)


def rigid_figure(maps: Mapping[str, Mapping[str, xr.Dataset]]) -> Figure:
    """Iterations over the a-priori mass, a row a law, a column a method."""
    laws, methods = list(maps), list(next(iter(maps.values())))
    figure, axes = canvas(
        11, 2.5 * len(laws) + 0.9, len(laws), len(methods), margins=(0.6, 0.2, 0.95, 0.35), hspace=0.55, wspace=0.12
    )
    for i, law in enumerate(laws):
        for j, method in enumerate(methods):
            _rigid_panel(axes[i, j], maps[law][method])
            title(axes[i, j], f"{method}, {law} law")
            label(axes[i, j], "mass at the start ap M, kg", "iterations" if j == 0 else "")
    _legend(figure, "loop unstable at this start (continuous law: step too long for it)")
    return figure


def _rigid_panel(ax: Axes, lanes: xr.Dataset) -> None:
    mass, n, outcome = (lanes[k].values for k in ("given_mass", "n_iterations", "outcome"))
    bad = mass[lanes["unstable"].values]
    if bad.size:
        ax.axvspan(mass.min(), bad.max(), **_HATCH, alpha=0.35)
    for kind in Outcome:
        here = outcome == kind
        ax.plot(mass[here], n[here], MARKERS[kind], color=COLOURS[kind], markersize=3.5, linestyle="none")
    ax.set_xscale("log")
    logarithmic(ax.xaxis, mass.min(), mass.max())
    ax.set_ylim(-0.5, max(8, n.max() + 1))


def mode_figure(maps: Mapping[str, xr.Dataset], law: str) -> Figure:
    """How starts over the plane end, and after how many iterations; a column a method."""
    figure, axes = canvas(
        12.5, 8.2, 2, len(maps), margins=(0.6, 0.75, 1.1, 0.35), hspace=0.2, wspace=0.12, sharex=True, sharey=True
    )
    for column, (method, lanes) in zip(axes.T, maps.items(), strict=True):
        lam, f_n = (np.unique(lanes["start"].sel(parameter=p).values) for p in ("lam", "f_n"))
        shape = (len(lam), len(f_n))
        outcome = lanes["outcome"].values.reshape(shape)
        n = np.where(outcome == Outcome.TRUTH, lanes["n_iterations"].values.reshape(shape), np.nan)
        colours = ListedColormap([COLOURS[o] for o in Outcome])
        norm = BoundaryNorm([0.5, 1.5, 2.5, 3.5, 4.5], 4)
        edges = _edges(lam), np.exp(_edges(np.log(f_n)))
        column[0].pcolormesh(*edges, outcome.T, cmap=colours, norm=norm)
        shown = column[1].pcolormesh(*edges, n.T, cmap="cividis_r", vmin=0, vmax=40)
        unstable = lanes["unstable"].values.reshape(shape)
        for ax in column:
            _hatch(ax, *edges, unstable)
            for (a, b), (c, d) in BOXES.values():
                ax.add_patch(Rectangle((a, c), b - a, d - c, fill=False, edgecolor="white", linewidth=3.2))
            for style, ((a, b), (c, d)) in zip(("-", "--"), BOXES.values(), strict=True):
                ax.add_patch(Rectangle((a, c), b - a, d - c, fill=False, edgecolor=INK, linewidth=1.4, linestyle=style))
            ax.set_yscale("log")
            logarithmic(ax.yaxis, f_n.min(), f_n.max())
        title(column[0], f"{method}, {law} law")
        title(column[1], "iterations to the truth")
        label(column[1], "mass ratio at the start λ")
    for ax in axes[:, 0]:
        label(ax, y="mode at the start f_n, Hz")
    bar = figure.colorbar(shown, ax=axes[1, :], cax=figure.add_axes((0.945, 0.134, 0.012, 0.375)))
    bar.ax.tick_params(labelsize=8.5)
    figure.text(0.5, 0.035, "solid box: paper, section VI.D; dashed box: eq. 28", ha="center", fontsize=8.5, color=INK)
    _legend(figure, "loop unstable at this start" if law == "sampled" else "step too long for this start")
    return figure


def _edges(x: np.ndarray) -> np.ndarray:
    """Edges of cells around even points, (n + 1,)."""
    half = 0.5 * (x[1] - x[0])
    return np.append(x - half, x[-1] + half)


def _hatch(ax: Axes, xe: np.ndarray, ye: np.ndarray, where: np.ndarray) -> None:
    """Hatch cells one by one, by their edges: a contour would round their corners."""
    for i, j in zip(*np.nonzero(where), strict=True):
        ax.add_patch(Rectangle((xe[i], ye[j]), xe[i + 1] - xe[i], ye[j + 1] - ye[j], **_HATCH, alpha=0.6))


def global_figure(maps: Mapping[str, xr.Dataset], law: str) -> Figure:
    """How draws of step 3 end, over the errors of M2 and K12; and the share that finds the truth."""
    figure, axes = canvas(14, 3.9, 1, len(maps) + 1, margins=(0.6, 0.2, 0.95, 0.35), wspace=0.28)
    for ax, (method, lanes) in zip(axes[0], maps.items(), strict=False):
        off, outcome = 100 * lanes["off"].values, lanes["outcome"].values
        for kind in Outcome:
            here = outcome == kind
            ax.plot(off[here, 1], off[here, 2], MARKERS[kind], color=COLOURS[kind], markersize=2.6, linestyle="none")
        title(ax, method)
        label(ax, "M2 off, %", "K12 off, %" if ax is axes[0, 0] else "")
    share = axes[0, -1]
    edges = np.linspace(0, np.abs(off).max(), 7)
    for colour, (method, lanes) in zip(_LINES, maps.items(), strict=False):
        worst = 100 * np.abs(lanes["off"].values).max(axis=1)
        found = lanes["outcome"].values == Outcome.TRUTH
        places = [(worst >= a) & (worst < b) for a, b in itertools.pairwise(edges)]
        percent = [100 * found[p].mean() if p.any() else np.nan for p in places]
        share.plot(
            0.5 * (edges[1:] + edges[:-1]), percent, "o-", color=colour, markersize=4, linewidth=1.3, label=method
        )
    share.set_ylim(-3, 103)
    share.legend(fontsize=7.5, frameon=False, loc="center left")
    title(share, f"share that finds the truth, {law} law")
    label(share, "largest of the three errors, %", "%")
    _legend(figure, "")
    return figure


def condition_figure(maps: Mapping[str, Mapping[str, xr.Dataset]], labels: Mapping[str, str]) -> Figure:
    """Largest error of M1, M2, K12 against the size of each mistake: every lane, and the median."""
    figure, axes = canvas(13, 3.7, 1, len(maps), margins=(0.65, 0.2, 0.95, 0.35), wspace=0.25)
    for ax, (name, methods) in zip(axes[0], maps.items(), strict=True):
        for colour, (method, lanes) in zip(_LINES, methods.items(), strict=False):
            level, error = lanes["level"].values, 100 * lanes["error"].values
            levels = np.unique(level)
            ax.plot(level, error, ".", color=colour, markersize=3.5, alpha=0.6)
            ax.plot(
                levels, [np.median(error[level == v]) for v in levels], "-", color=colour, linewidth=1.4, label=method
            )
        ax.set_yscale("log")
        if name in ("state", "noise"):
            ax.set_xscale("symlog", linthresh=0.3 if name == "noise" else 1.0)
            ax.set_xticks(levels, [f"{v:g}" for v in levels])
            ax.minorticks_off()
        label(ax, labels[name], "largest error of M1, M2, K12, %" if ax is axes[0, 0] else "")
        title(ax, name)
    axes[0, 0].legend(fontsize=7.5, frameon=False)
    return figure


def no_start_figure(drawn: list[Drawn], tolerance: float) -> Figure:
    """Random machines in the plane of what is to be found, and the errors of what was."""
    figure, axes = canvas(11, 3.9, 1, 2, margins=(0.65, 0.6, 0.6, 0.35), wspace=0.25)
    lam, f_n = np.array([d.lam for d in drawn]), np.array([d.f_n_Hz for d in drawn])
    error = 100 * np.array([d.error for d in drawn])
    shown = axes[0, 0].scatter(lam, f_n, c=np.log10(error), cmap="cividis", s=22)
    wrong = error >= 100 * tolerance
    axes[0, 0].plot(lam[wrong], f_n[wrong], "x", color="#d55e00", markersize=10, markeredgewidth=2)
    axes[0, 0].set_yscale("log")
    logarithmic(axes[0, 0].yaxis, 10, 60)
    bar = figure.colorbar(shown, ax=axes[0, 0])
    bar.set_label("log10 of the largest error, %", fontsize=8.5)
    bar.ax.tick_params(labelsize=8)
    title(axes[0, 0], "machines drawn (a cross: not found)")
    label(axes[0, 0], "true mass ratio λ", "true mode f_n, Hz")
    ax = axes[0, 1]
    order = np.arange(1, len(error) + 1)
    ax.plot(np.sort(error), 100 * order / len(error), color="#0072b2", drawstyle="steps-post")
    ax.axvline(100 * tolerance, color="#d55e00", linewidth=1.2, linestyle="--")
    ax.set_xscale("log")
    title(ax, "share of machines below an error")
    label(ax, "largest error of M1, M2, K12, % (dashed: tolerance)", "%")
    return figure
