"""Figures of the study: the paper's figures 5 and 6 on the twin, and every method beside paper and truth."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from didim_jax.identify import Run
from didim_jax.report.canvas import INK, RESIDUAL, SIMULATED, THIRD, canvas, envelope, label, title
from didim_jax.report.force import in_band, worst_stretch

from .beyond import Draws, Fits
from .methods import DIDIM, EXACT, FLEXIBLE, LS, OE_FORCE, OE_POSITION, STEP_2
from .published import BARE, LOADED, entries
from .rows import delta_M2, delta_M2_std
from .twin import PLUS, Twin

_COLOURS = {BARE: SIMULATED, LOADED: RESIDUAL, PLUS: THIRD}
_RED, _BLUE, _BLACK = "#c8102e", "#0050a0", "#111111"
"""The paper's colours of figure 6: measurement, simulation, error."""


def mode_by_iteration(sets: dict[str, Twin], fits: Fits) -> Figure:
    """lam and f_n of step 2 by iteration, with the truth and the paper's end values. References: paper, fig. 5."""
    figure, axes = canvas(9.6, 3.3, 1, 2, margins=(0.62, 0.2, 0.52, 0.62), wspace=0.2)
    paper = {entry.key: entry.value for entry in entries()}
    for k, (ax, name, unit) in enumerate(zip(axes[0], ("lam", "f_n"), ("", ", Hz"), strict=True)):
        for record, twin in sets.items():
            trace = fits[record][STEP_2].result.trace[:, k]
            ax.plot(trace, color=_COLOURS[record], linewidth=1.5, marker=".", markersize=5, label=record)
            ax.axhline(twin.truth[name], color=_COLOURS[record], linewidth=0.9, linestyle=":")
            printed = paper.get(("2", name, f"{record}, result"))
            if printed is not None:
                k_end = paper["2", "iterations", f"{record}, result"]
                ax.plot(k_end, printed, "s", color=_COLOURS[record], markerfacecolor="white", markersize=6)
        label(ax, x="iteration of Nelder-Mead", y=f"{name}{unit}")
    axes[0, 1].legend(frameon=False, fontsize=8.5)
    title(axes[0, 0], "step 2 (fig. 5): dots ours, squares the paper's ends, dotted the twin's truth", pad=14)
    return figure


def cross_validation(runs: dict[str, Run]) -> Figure:
    """DIDIM and exact Gauss-Newton on the second trajectory: force and error, N. References: paper, fig. 6."""
    figure, axes = canvas(
        9.6,
        5.6,
        2,
        2,
        margins=(0.7, 0.2, 0.5, 0.5),
        width_ratios=(1.7, 1),
        hspace=0.32,
        wspace=0.14,
        sharey="row",
    )
    for (wide, close), method in zip(axes, (DIDIM, EXACT), strict=True):
        run = runs[method]
        record = run.recording
        window = worst_stretch(record.t, in_band(runs[DIDIM].recording.tau - runs[DIDIM].tau, record.dt), 0.6)
        for ax, part in ((wide, slice(None)), (close, window)):
            _force(ax, run, part)
        title(wide, f"{method}: force error {100 * run.force_error:.1f} % below 60 Hz", fontweight="bold")
        title(close, f"the {record.t[window][-1] - record.t[window][0]:.1f} s that DIDIM fits worst")
        label(wide, y="motor force, N")
    for ax in axes[1]:
        label(ax, x="time, s")
    axes[0, 0].legend(frameon=False, fontsize=8.5, ncols=3, loc="lower right")
    return figure


def _force(ax: Axes, run: Run, part: slice) -> None:
    """Force and error below 60 Hz, the band of the fit."""
    record = run.recording
    signals = (
        ("measured (synthetic)", record.tau, _RED, 1.0),
        ("simulated", run.tau, _BLUE, 0.8),
        ("error", record.tau - run.tau, _BLACK, 0.9),
    )
    for name, raw, colour, width in signals:
        signal = in_band(raw, record.dt)
        ax.plot(*envelope(record.t[part], signal[part], 900), color=colour, linewidth=width, label=name)
    ax.set_xlim(record.t[part][0], record.t[part][-1])


def errors_by_method(sets: dict[str, Twin], fits: Fits) -> Figure:
    """Error of masses, stiffness and friction sums against the twin's truth, percent, by method and record."""
    names = ("M1", "M2", "K12", "Fv1 + Fv2", "Fc1 + Fc2")
    figure, axes = canvas(9.6, 3.5, 1, len(names), margins=(2.0, 0.2, 0.52, 0.62), sharey=True, wspace=0.12)
    for ax, name in zip(axes[0], names, strict=True):
        for k, (record, twin) in enumerate(sets.items()):
            off = [100 * (fits[record][method].parameters[name] / twin.truth[name] - 1) for method in FLEXIBLE]
            ax.plot(off, np.arange(len(off)) + 0.2 * (k - 1), "o", color=_COLOURS[record], markersize=5, label=record)
        ax.axvline(0, color=INK, linewidth=0.9)
        ax.set_ylim(len(FLEXIBLE) - 0.5, -0.5)
        title(ax, name)
        label(ax, x="off the truth, %")
    axes[0, 0].set_yticks(range(len(FLEXIBLE)), FLEXIBLE)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=8.5, ncols=3, loc="upper right")
    return figure


def payload(sets: dict[str, Twin], fits: Fits, draws: dict[str, Draws]) -> Figure:
    """Delta M2 (kg) by method, with two standard deviations of the pair of fits, beside truth and paper."""
    figure, axes = canvas(9.6, 3.4, 1, 2, margins=(2.0, 0.2, 0.52, 0.5), sharey=True, wspace=0.1)
    paper = {entry.key: entry.value for entry in entries()}
    tables = {LS: "4", DIDIM: "4", OE_POSITION: "5", OE_FORCE: "6"}
    for ax, record in zip(axes[0], (PLUS, LOADED), strict=True):
        for row, method in enumerate(FLEXIBLE):
            own = {"xerr": 2 * delta_M2_std(fits, record, method), "capsize": 3, "elinewidth": 1}
            ax.errorbar(delta_M2(fits, record, method), row, fmt="o", color=_COLOURS[record], markersize=6, **own)
            printed = paper.get((tables.get(method, ""), "Delta M2", f"{record}, {method}"))
            if printed is not None:
                ax.plot(printed, row, "s", color=INK, markerfacecolor="white", markersize=7)
            if record == PLUS and method in draws:
                found = draws[method].delta_M2
                ax.plot(found, np.full(len(found), row + 0.28), "|", color=INK, markersize=6, alpha=0.5)
        ax.axvline(sets[record].payload_kg, color=INK, linewidth=0.9, linestyle=":")
        label(ax, x="Delta M2, kg")
    title(axes[0, 0], "exactly 10 kg on M2; strokes are fresh noise")
    title(axes[0, 1], "Table 4 less Table 3; squares are the paper's")
    axes[0, 0].set_yticks(range(len(FLEXIBLE)), FLEXIBLE)
    axes[0, 0].set_ylim(len(FLEXIBLE) - 0.5, -0.5)
    return figure
