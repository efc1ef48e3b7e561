"""The gap atlas as one picture: what the gap goes with, where in frequency and motion it lies, and when."""

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from ..gap.atlas import Atlas, Variable
from ..gap.variables import LABELS
from .canvas import FAINT, INK, RESIDUAL, SIMULATED, canvas, label, title

_FEWEST, _MOST = 4, 8
"""Variables in the picture, those that close 1 % or more; all are in diagnosis.json."""

_HEAT = LinearSegmentedColormap.from_list("heat", ["#ffffff", "#fbe3cf", "#f0a56b", RESIDUAL, "#7d2c00"])
_MARKED = "#f3e9c6"
_WINDOW_S = 0.1

_WORTH_EXPLAINING = 0.02
"""Share of the energy before that must be left above the noise; with less there is nothing to explain."""


def atlas_figure(before: Atlas, after: Atlas | None = None) -> Figure:
    """Shares by variable, energy by band and phase of motion, residual over time; with `after`, the two side by side.

    Both are drawn in shares of the energy *before*, so that what an effect has closed is seen to be gone.
    """
    names = _chosen(before, after)
    if after is None:
        figure, axes = canvas(
            9.6,
            5.7,
            2,
            2,
            margins=(1.75, 0.15, 0.5, 0.4),
            width_ratios=(1, 1.25),
            height_ratios=(1.7, 1),
            hspace=0.5,
            wspace=0.32,
        )
        grid = axes[1, 0].get_subplotspec().get_gridspec()
        for ax in axes[1]:
            ax.remove()
        strip = figure.add_subplot(grid[1, :])
        strip.spines[["top", "right"]].set_visible(False)
        strip.tick_params(labelsize=8.5, color="#8a939b", labelcolor=INK, length=3)
        columns = [(before, axes[0, 0], axes[0, 1], strip)]
        heads = [f"{before.rms:.3g} N rms, of which an estimated {before.floor_rms:.3g} N are noise"]
    else:
        figure, axes = canvas(
            9.6,
            7.4,
            3,
            2,
            margins=(1.75, 0.15, 0.5, 0.4),
            height_ratios=(1.15, 1.15, 1),
            hspace=0.52,
            wspace=0.08,
        )
        columns = [(before, *axes[:, 0]), (after, *axes[:, 1])]
        heads = [
            f"before: {before.rms:.2g} N rms",
            f"after: {after.rms:.2g} N rms, noise (estimated) {after.floor_rms:.2g} N",
        ]
    longest = max((a[name].share * _scale(a, before) for a, *_ in columns for name in names), default=0.0)
    loudest = max(float(a.table.max()) * _scale(a, before) for a, *_ in columns)
    highest = max(float(_strength(a).max()) for a, *_ in columns)
    for (one, bars, heat, strip), head, left in zip(columns, heads, (True, False), strict=False):
        scale = _scale(one, before)
        _bars(bars, one, names, scale, max(1.12 * 100 * longest, 10.0))
        _heat(heat, one, scale, max(loudest, 1e-300))
        _strip(strip, one, 1.08 * max(highest, 1e-300))
        title(bars, head, fontweight="bold")
        if not left:
            for ax in (bars, heat, strip):
                ax.tick_params(labelleft=False)
                label(ax, y=" ")
    title(columns[0][2], "where: % of the energy, by frequency and phase")
    stands_out = any(interval.span for one, *_ in columns for interval in one.intervals)
    title(columns[0][3], "when: shaded where the power is over four times its median" if stands_out else "when")
    columns[0][1].legend(loc="lower right", frameon=False, fontsize=8, handlelength=1.4)
    strip = columns[-1][3]
    strip.legend(
        loc="lower right",
        bbox_to_anchor=(1, 1.0),
        frameon=False,
        fontsize=8,
        ncols=2,
        handlelength=1.8,
        borderaxespad=0.1,
    )
    return figure


def _chosen(before: Atlas, after: Atlas | None) -> list[str]:
    """The variables that close most, before or after, largest first."""
    size = {name: before[name].share for name in LABELS}
    if after is not None:
        size = {name: max(share, after[name].share * _scale(after, before)) for name, share in size.items()}
    ranked = sorted(size, key=lambda name: -size[name])
    return ranked[: int(np.clip(sum(share >= 0.01 for share in size.values()), _FEWEST, _MOST))]


def _scale(one: Atlas, before: Atlas) -> float:
    """Energy of a residual against that before."""
    return (one.rms / before.rms) ** 2 if before.rms > 0 else 0.0


def _bars(ax: Axes, one: Atlas, names: list[str], scale: float, limit: float) -> None:
    """Share that each variable closes alone; hatched, what nothing else closes."""
    y = np.arange(len(names))
    rows: list[Variable] = [one[name] for name in names]
    shares = 100 * scale * np.array([v.share for v in rows])
    last_in = np.minimum(100 * scale * np.array([v.last_in for v in rows]), shares)
    ax.barh(y, shares, height=0.66, color="#8fbfdd", label="closed by a smooth function of it")
    ax.barh(
        y, last_in, height=0.66, color=SIMULATED, hatch="////", edgecolor="white", linewidth=0, label="by nothing else"
    )
    if shares.max() < 1:
        _empty(ax, one, scale, "no single variable closes 1 %")
    for k, share in enumerate(shares):
        if share >= 1:
            ax.text(share + 0.01 * limit, k, f"{share:.0f}", va="center", fontsize=8, color=INK)
    ax.set_yticks(y, [v.label for v in rows])
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlim(0, limit)
    ax.grid(axis="y", visible=False)
    label(ax, x="% of the energy")


def _heat(ax: Axes, one: Atlas, scale: float, loudest: float) -> None:
    """Share of energy by band (up) and phase (across); under each phase its share of time."""
    kept = [k for k, phase in enumerate(one.phases) if phase.size > 0.005]
    table = scale * one.table[:, kept]
    ax.pcolormesh(table, cmap=_HEAT, vmin=0, vmax=loudest, edgecolors="#eceff1", linewidth=0.8)
    if table.max(initial=0.0) < 0.005:
        _empty(ax, one, scale, "less than 0.5 % everywhere")
    for (i, j), share in np.ndenumerate(table):
        if share >= 0.005:
            colour = "white" if share > 0.55 * loudest else INK
            ax.text(j + 0.5, i + 0.5, f"{100 * share:.0f}", ha="center", va="center", fontsize=8.5, color=colour)
    phases = [one.phases[k] for k in kept]
    ax.set_xticks(
        np.arange(len(kept)) + 0.5, [f"{p.name.replace('erating', '.')}\n{100 * p.size:.0f} % of time" for p in phases]
    )
    ax.set_yticks(np.arange(len(one.bands)) + 0.5, [b.name for b in one.bands])
    ax.tick_params(length=0, labelsize=8)
    ax.grid(visible=False)
    ax.spines[["left", "bottom"]].set_visible(False)


def _empty(ax: Axes, one: Atlas, scale: float, otherwise: str) -> None:
    """A panel without a number in it says why; what is `otherwise` said leaves something above the noise."""
    said = "nothing left to explain" if scale * one.explainable < _WORTH_EXPLAINING else otherwise
    ax.text(0.5, 0.5, said, transform=ax.transAxes, ha="center", va="center", fontsize=9, color=INK)


def _strip(ax: Axes, one: Atlas, limit: float) -> None:
    """Residual, rms over 0.1 s, its floor, the intervals that stand out, and in grey how the reference moves."""
    t = one.t
    for interval in one.intervals:
        if interval.span:
            ax.axvspan(*interval.span, color=_MARKED, linewidth=0, zorder=0)
    stroke = float(np.ptp(one.reference))
    if stroke > 0:
        moved = (one.reference - one.reference.min()) / stroke
        ax.plot(t, limit * (0.05 + 0.9 * moved), color=FAINT, linewidth=1.2, zorder=1, label="reference")
    ax.fill_between(t, _strength(one), color=RESIDUAL, alpha=0.85, linewidth=0, zorder=2)
    ax.axhline(one.floor_rms, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), zorder=3, label="noise (estimated)")
    for end, following in itertools.pairwise(one.passes):
        if end.span and following.span:
            ax.axvline(end.span[1], color="#8a939b", linewidth=0.6, linestyle=":", zorder=1)
    ax.set_xlim(t[0], t[-1])
    ax.set_ylim(0, limit)
    label(ax, x="time, s", y="residual, N rms")


def _strength(one: Atlas) -> np.ndarray:
    """Root mean square of the residual over 0.1 s around each sample, N."""
    dt = float(np.median(np.diff(one.t)))
    half = max(1, round(0.5 * _WINDOW_S / dt))
    weights = np.ones(2 * half + 1)
    inside = np.convolve(np.ones(len(one.t)), weights, mode="same")
    return np.sqrt(np.convolve(one.residual**2, weights, mode="same") / inside)
