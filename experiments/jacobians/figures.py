"""The study's pictures, each drawn from arrays.npz alone."""

import itertools
from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from didim_jax.report.canvas import FAINT, INK, MEASURED, RESIDUAL, SIMULATED, THIRD, canvas, label, logarithmic, title

type Arrays = Mapping[str, np.ndarray]

_COLOURS = (SIMULATED, RESIDUAL, THIRD, "#cc79a7", "#e69f00", "#56b4e9", MEASURED, INK)
_BOUND = "Cramér-Rao bound"


def draw(arrays: Arrays) -> dict[str, Figure]:
    """All figures by the name of their file."""
    return {
        "columns": columns_figure(arrays),
        "loop": loop_figure(arrays),
        "bands": bands_figure(arrays),
        "modes": modes_figure(arrays),
        "iterates": iterates_figure(arrays),
        "paths": paths_figure(arrays),
        "draws": draws_figure(arrays),
        "friction": friction_figure(arrays),
    }


def columns_figure(arrays: Arrays) -> Figure:
    """M1's and K12's columns below 60 Hz: the fast trapezoid, and the chirp as it passes the mode."""
    names = [str(n) for n in arrays["columns.flexible.names"]]
    t, W, J = arrays["columns.t"], arrays["columns.flexible.W"], arrays["columns.flexible.J"]
    windows = {"fast trapezoid": (0.25, 1.1), "chirp about rest, 18 to 28 Hz": (4.8, 6.4)}
    figure, axes = canvas(9.6, 4.6, 2, 2, margins=(0.8, 0.15, 0.5, 0.4), hspace=0.42, wspace=0.26)
    for row, (name, unit, scale) in zip(axes, (("M1", "N/kg", 1.0), ("K12", "N per 1e5 N/m", 1e5)), strict=True):
        for ax, (said, (low, high)) in zip(row, windows.items(), strict=True):
            k = names.index(name)
            inside = (t >= low) & (t <= high)
            ax.plot(t[inside], scale * J[inside, k], color=SIMULATED, lw=1.3, label="exact")
            ax.plot(t[inside], scale * W[inside, k], color=RESIDUAL, lw=0.9, label="DIDIM")
            title(ax, f"{name}, {said}")
            label(ax, x="time (s)" if row is axes[-1] else "", y=f"column ({unit})" if ax is row[0] else "")
    axes[0, 1].legend(fontsize=8, frameon=False, loc="upper right", ncols=2)
    return figure


def loop_figure(arrays: Arrays) -> Figure:
    """T = J / W of the mass's column: amplitude and phase, beside the linear loop's closed form."""
    f = arrays["columns.f"]
    figure, axes = canvas(9.6, 2.9, 1, 2, margins=(0.65, 0.15, 0.5, 0.35), wspace=0.24)
    for model, colour, name in (("rigid", SIMULATED, "rigid, M"), ("flexible", RESIDUAL, "flexible, M1")):
        T, loop = arrays[f"columns.{model}.T"], arrays[f"columns.{model}.loop"]
        parts: tuple[Callable[[np.ndarray], np.ndarray], ...] = (np.abs, _degrees)
        for ax, part in zip(axes[0], parts, strict=True):
            ax.plot(f, part(loop), color=colour, lw=1.2, label=f"{name}: linear loop, L/(1+L)")
            ax.plot(f, part(T), "o", color=colour, ms=3.2, label=f"{name}: exact column / DIDIM's")
    for ax, one in zip(axes[0], (1.0, 0.0), strict=True):
        ax.axhline(one, color=INK, lw=0.8, ls="--")
    axes[0, 0].annotate(
        "DIDIM: T = 1", (61, 1.0), (0, 3), textcoords="offset points", ha="right", fontsize=8, color=INK
    )
    axes[0, 1].legend(fontsize=7.5, frameon=False, loc="upper right")
    axes[0, 1].set_ylim(top=90)
    label(axes[0, 0], x="frequency (Hz)", y="abs(T)")
    label(axes[0, 1], x="frequency (Hz)", y="phase of T (degrees)")
    title(axes[0, 0], "How the loop answers a parameter's force")
    return figure


def _degrees(z: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.unwrap(np.angle(z)))


def bands_figure(arrays: Arrays) -> Figure:
    """Cosines by band and by phase of motion, rigid and flexible."""
    edges = arrays["columns.bands_hz"]
    bands = [f"{a:g} to {b:g} Hz" for a, b in itertools.pairwise(edges)]
    figure, axes = canvas(9.6, 4.6, 2, 2, margins=(1.2, 0.15, 0.35, 0.4), hspace=0.36, wspace=0.42, width_ratios=(3, 5))
    for row, (key, rows, said) in zip(
        axes,
        (("band", bands, "by band"), ("phase", [str(p) for p in arrays["columns.phases"]], "by phase, below 60 Hz")),
        strict=True,
    ):
        for ax, model in zip(row, ("rigid", "flexible"), strict=True):
            names = [str(n) for n in arrays[f"columns.{model}.names"]]
            cosine = arrays[f"columns.{model}.{key}.cosine"]
            kept = np.isfinite(cosine).any(axis=0)
            _cells(ax, cosine[:, kept], rows, [n for n, k in zip(names, kept, strict=True) if k])
            title(ax, f"{model} drive, {said}")
    return figure


def _cells(ax: Axes, values: np.ndarray, rows: list[str], names: list[str]) -> None:
    ax.grid(False)
    ax.imshow(values, vmin=-1, vmax=1, cmap="RdBu", aspect="auto")
    ax.set_xticks(range(len(names)), names)
    ax.set_yticks(range(len(rows)), rows)
    for (i, j), value in np.ndenumerate(values):
        ax.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=8, color="white" if abs(value) > 0.6 else INK)


def modes_figure(arrays: Arrays) -> Figure:
    """Relative error of the columns over cutoff, a line per mode; the slowest contraction."""
    names = [str(n) for n in arrays["modes.names"]]
    f_n, cutoff = arrays["modes.f_n"], arrays["modes.cutoff"]
    shown = [k for k in range(len(f_n)) if k in {0, len(f_n) // 4, len(f_n) // 2, 3 * len(f_n) // 4, len(f_n) - 1}]
    figure, axes = canvas(9.6, 2.9, 1, 4, margins=(0.6, 0.15, 0.5, 0.55), wspace=0.32)
    for ax, name in zip(axes[0], ("M1", "Fc1", "load side"), strict=False):
        for c, k in enumerate(shown):
            ax.plot(cutoff, arrays["modes.error"][k, :, names.index(name)], "o-", ms=2.5, lw=1.1, color=_COLOURS[c])
        rigid = {"M1": 0, "Fc1": 2}.get(name)
        if rigid is not None:
            ax.plot(cutoff, arrays["modes.rigid.error"][:, rigid], color=INK, lw=1.2, ls="--")
        ax.axhline(0.1, color=MEASURED, lw=0.8)
        ax.set_yscale("log")
        logarithmic(ax.yaxis, *ax.get_ylim())
        title(ax, f"{name} (dashed: rigid)" if rigid is not None else f"{name}, as a whole")
    ax = axes[0, 3]
    for c, k in enumerate(shown):
        ax.plot(cutoff, arrays["modes.slowest"][k], "o-", ms=2.5, lw=1.1, color=_COLOURS[c], label=f"{f_n[k]:g} Hz")
    ax.set_ylim(0, 1.05)
    title(ax, "what one iteration leaves")
    for one in axes[0]:
        one.set_xscale("log")
        logarithmic(one.xaxis, 1, 400)
        label(one, x="cutoff (Hz)")
    label(axes[0, 0], y="norm(W - J) / norm(J)")
    figure.legend(
        *ax.get_legend_handles_labels(), fontsize=8, frameon=False, ncols=6, loc="upper center", title="mode f_n",
        title_fontsize=8,
    )  # fmt: skip
    for one in axes[0]:
        box = one.get_position()
        one.set_position((box.x0, box.y0, box.width, box.height * 0.9))
    return figure


def iterates_figure(arrays: Arrays) -> Figure:
    """Cosine of every column along the iterates."""
    panels = {
        "rigid, 5 Hz": (("rigid didim 5 Hz", "o-"), ("rigid gauss-newton 5 Hz", "s--")),
        "rigid, 60 Hz": (("rigid didim 60 Hz", "o-"), ("rigid gauss-newton 60 Hz", "s--")),
        "flexible, 60 Hz": (("didim five", "o-"), ("gauss-newton", "s--")),
    }
    figure, axes = canvas(9.6, 2.8, 1, 3, margins=(0.6, 0.15, 0.5, 0.35), wspace=0.2, sharey=True)
    for ax, (said, paths) in zip(axes[0], panels.items(), strict=True):
        names = ("M", "Fv", "Fc") if "rigid" in said else [str(n) for n in arrays["names"]]
        for key, style in paths:
            cosine = arrays[f"paths.{key}.cosine"]
            for k, name in enumerate(names):
                if np.isfinite(cosine[:, k]).any():
                    ax.plot(cosine[:, k], style, ms=3, lw=1.1, color=_COLOURS[k], label=name if style == "o-" else None)
        ax.legend(fontsize=8, frameon=False, ncols=2, loc="lower right")
        title(ax, said)
        label(ax, x="iteration")
        ax.set_ylim(-0.05, 1.05)
    label(axes[0, 0], y="cosine with the exact column")
    return figure


PATHS = {
    "didim five": ("DIDIM, five columns", RESIDUAL, "o-"),
    "didim seven": ("DIDIM, seven columns", "#e69f00", "x:"),
    "didim seven half": ("DIDIM, seven, friction halved", "#cc79a7", "o-"),
    "didim seven truth": ("DIDIM, seven, from the truth", "#56b4e9", "o-"),
    "exact five": ("exact, five parameters", MEASURED, "s-"),
    "gauss-newton": ("exact Gauss-Newton", SIMULATED, "s-"),
    "levenberg-marquardt": ("exact Levenberg-Marquardt", THIRD, "x:"),
}
"""Step 3 by key: name, colour and line in the figure."""


def paths_figure(arrays: Arrays) -> Figure:
    """Criterion and distance to the truth by iteration."""
    figure, axes = canvas(9.6, 3.6, 1, 2, margins=(0.65, 0.15, 0.5, 0.85), wspace=0.22)
    for key, (said, colour, style) in PATHS.items():
        stop = int(arrays[f"paths.{key}.stop"])
        for ax, quantity in zip(axes[0], ("costs", "distance"), strict=True):
            y = arrays[f"paths.{key}.{quantity}"]
            ax.plot(y, style, ms=3.5, lw=1.2, color=colour, label=said)
            if "didim" in key:
                ax.plot(stop, y[stop], "o", ms=9, mfc="none", mec=colour)
    for ax in axes[0]:
        ax.set_yscale("log")
        logarithmic(ax.yaxis, *ax.get_ylim())
        label(ax, x="iteration of step 3")
    label(axes[0, 0], y="criterion norm(rho) / norm(Y)")
    label(axes[0, 1], y="error of M1, M2, K12 (rms, %)")
    title(axes[0, 0], "rings: where eq. 21 stops DIDIM")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), fontsize=8, frameon=False, ncols=4, loc="upper center")
    return figure


def draws_figure(arrays: Arrays) -> Figure:
    """Bias in units of the bound for every method; spread over the bound and coverage for exact Gauss-Newton."""
    names, truth, unit = [str(n) for n in arrays["names"]], arrays["truth"], arrays["draws.bound"]
    keys = [k for k in PATHS if f"draws.{k}.theta" in arrays]
    figure, axes = canvas(9.6, 3.7, 1, 3, margins=(0.75, 0.15, 0.3, 0.85), wspace=0.3, width_ratios=(1.6, 1, 1))
    ax, x = axes[0, 0], np.arange(len(names))
    for i, key in enumerate(keys):
        bias = (arrays[f"draws.{key}.theta"].mean(axis=0) - truth) / unit
        said, colour, _ = PATHS[key]
        ax.plot(x + 0.12 * (i - len(keys) / 2), bias, "o", ms=4.5, color=colour, label=said)
    ax.set_yscale("symlog", linthresh=0.1)
    ax.set_yticks([-1000, -100, -10, -1, -0.1, 0.1, 1, 10, 100, 1000], minor=False)
    ax.axhspan(-0.1, 0.1, color=FAINT, alpha=0.5)
    ax.set_xticks(x, names)
    figure.legend(*ax.get_legend_handles_labels(), fontsize=8, frameon=False, ncols=3, loc="upper center")
    label(ax, y=f"bias (std of the {_BOUND})")
    title(ax, "bias; grey: within a tenth")

    exact = arrays["draws.gauss-newton.theta"]
    n = len(exact)
    ratio = exact.std(axis=0, ddof=1) / unit
    ax = axes[0, 1]
    ax.errorbar(x, ratio, 1.96 * ratio / np.sqrt(2 * (n - 1)), fmt="o", ms=4, color=SIMULATED, lw=1.2)
    ax.axhspan(0.9, 1.1, color=FAINT, alpha=0.5)
    ax.axhline(1, color=INK, lw=0.8)
    ax.set_xticks(x, names, fontsize=7.5)
    label(ax, y="std / bound")
    title(ax, f"exact Gauss-Newton, {n} draws")

    ax = axes[0, 2]
    for i, (kind, said, colour) in enumerate(
        (("white", "eq. 13-14", MEASURED), ("autocorrelated", "any spectrum", THIRD), ("bound", "bound", SIMULATED))
    ):
        if f"draws.coverage.{kind}" in arrays:
            ax.plot(x + 0.2 * (i - 1), 100 * arrays[f"draws.coverage.{kind}"], "o", ms=4, color=colour, label=said)
    low, high = arrays["draws.coverage.limits"]
    ax.axhspan(100 * low, 100 * high, color=FAINT, alpha=0.5)
    ax.axhline(95, color=INK, lw=0.8)
    ax.set_xticks(x, names, fontsize=7.5)
    ax.set_ylim(bottom=100 * low - 2.5)
    ax.legend(fontsize=7.5, frameon=False, loc="lower right", ncols=2)
    label(ax, y="truth inside the 95 % interval (%)")
    title(ax, "coverage; grey: binomial limits")
    return figure


def friction_figure(arrays: Arrays) -> Figure:
    """Bound (bar) and spread over draws (dot) of both sides' friction, and the correlation, by excitation."""
    names, truth = [str(n) for n in arrays["names"]], arrays["truth"]
    excitations = [str(e) for e in arrays["friction.excitations"]]
    figure, axes = canvas(9.6, 2.7, 1, 3, margins=(1.75, 0.15, 0.5, 0.35), wspace=0.12, sharey=True)
    y = np.arange(len(excitations))
    for ax, pair in zip(axes[0], (("Fv1", "Fv2"), ("Fc1", "Fc2")), strict=False):
        for i, name in enumerate(pair):
            k = names.index(name)
            where = y + 0.3 * (i - 0.5)
            colour = (SIMULATED, RESIDUAL)[i]
            ax.barh(where, 100 * arrays["friction.bound"][:, k] / truth[k], 0.28, color=colour, alpha=0.55, label=name)
            ax.plot(100 * arrays["friction.std"][:, k] / truth[k], where, "o", ms=4, color=colour)
        ax.legend(fontsize=8, frameon=False)
        label(ax, x="std (% of the value)")
    title(axes[0, 0], "viscous: bound (bar), draws (dot)")
    title(axes[0, 1], "Coulomb")
    for i, said in enumerate(("Fv1, Fv2", "Fc1, Fc2")):
        axes[0, 2].plot(arrays["friction.correlation"][:, i], y, "os"[i], ms=5, color=(INK, THIRD)[i], label=said)
    axes[0, 2].set_xlim(-1.02, 0.02)
    axes[0, 2].legend(fontsize=8, frameon=False)
    label(axes[0, 2], x="correlation of the errors")
    title(axes[0, 2], "motor against load")
    axes[0, 0].set_yticks(y, excitations)
    axes[0, 0].invert_yaxis()
    return figure
