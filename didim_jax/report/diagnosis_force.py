"""Force and residual of one record, before and after: the whole of it, and close by where it fits worst."""

import numpy as np
import scipy.signal
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..gap.diagnosis import Gap, Run
from ..identify.study import ERROR_HZ
from ..signals import LowPass
from .canvas import INK, MEASURED, RESIDUAL, SIMULATED, canvas, envelope, label, title
from .tables import percent, significant

ZOOM_SECONDS = 0.8
_USUAL, _PEAK = 0.998, 2.0
"""That quantile of a residual has room in the overview; what is higher as well, up to so many times as much."""

_BINS = 700  # about the pixels across the wide column
_WINDOW = "#f3e9c6"


def run_figure(run: Run, name: str, gap: Gap | None, changed: bool) -> Figure:
    """Residual (N, below 60 Hz) over the whole record; force and residual in its three worst stretches.

    `changed` is False where no effect was adopted: there is then one simulation, not two.
    """
    figure, axes = canvas(
        10.4, 5.1, 3, 3, margins=(0.65, 0.15, 0.48, 0.55), height_ratios=(1.05, 1, 0.8), hspace=0.56, wspace=0.2
    )
    grid = axes[0, 0].get_subplotspec().get_gridspec()
    for ax in axes[0, 1:]:
        ax.remove()
    whole: Axes = axes[0, 0]
    whole.set_subplotspec(grid[0, :])
    dt = float(run.t[-1] - run.t[0]) / (len(run.t) - 1)
    before, after = (_in_band(run.tau - x, dt) for x in (run.before, run.after))
    curves = (
        [(before, RESIDUAL, "before"), (after, SIMULATED, "after")] if changed else [(after, SIMULATED, "simulated")]
    )
    for residual, colour, said in curves:
        whole.plot(*envelope(run.t, residual, _BINS), color=colour, linewidth=0.9, label=said)
    windows = worst_stretches(run.t, before, after)
    for number, window in enumerate(windows, start=1):
        on, off = run.t[window][0], run.t[window][-1]
        whole.axvspan(on, off, color=_WINDOW, linewidth=0, zorder=0)
        whole.text(
            0.5 * (on + off),
            1.0,
            str(number),
            transform=whole.get_xaxis_transform(),
            ha="center",
            va="top",
            fontsize=8.5,
        )
    _frame(whole, run.t, "residual, N")
    _fit_height(whole, run.t, [r for r, *_ in curves])
    gaps = "" if gap is None else f": gap {percent(gap.before)}" + (f" before, {percent(gap.after)} after" * changed)
    title(whole, f"{name}{gaps}, residual below {ERROR_HZ:g} Hz", fontweight="bold", pad=19)
    whole.plot([], [], color=MEASURED, linewidth=2.6, label="recorded")  # for the zooms
    whole.legend(loc="lower right", bbox_to_anchor=(1, 0.98), ncols=3, frameon=False, fontsize=8.5, borderaxespad=0)
    _zooms(axes, run, windows, curves)
    return figure


def _in_band(x: np.ndarray, dt: float) -> np.ndarray:
    """As the diagnosis compares them: ends continued evenly, so that the first sample's noise is filtered, too."""
    return LowPass.butterworth(ERROR_HZ, dt)(x, odd=False) if ERROR_HZ * dt < 0.5 else x


def _zooms(axes: np.ndarray, run: Run, windows: list[slice], curves: list[tuple[np.ndarray, str, str]]) -> None:
    """Under each other the force and the residual of each stretch; the residuals on one scale."""
    simulations = {"before": run.before, "after": run.after, "simulated": run.after}
    limits = _limits([r[w] for w in windows for r, *_ in curves])
    for k, (top, bottom) in enumerate(axes[1:].T):
        if k >= len(windows):
            top.remove()
            bottom.remove()
            continue
        part = windows[k]
        top.plot(run.t[part], run.tau[part], color=MEASURED, linewidth=2.6)
        for residual, colour, said in curves:
            shown = simulations[said]
            top.plot(run.t[part], shown[part], color=colour, linewidth=1.1)
            bottom.plot(run.t[part], residual[part], color=colour, linewidth=1.3)
        top.locator_params(axis="x", nbins=4)
        _frame(top, run.t[part], "motor force, N" if k == 0 else "")
        _frame(bottom, run.t[part], "residual, N" if k == 0 else "", "time, s")
        bottom.set_ylim(*limits)
        top.tick_params(labelbottom=False)
        box = bottom.get_position()  # the upper one has no numbers under it, so there is room
        bottom.set_position((box.x0, box.y0, box.width, box.height + 0.45 * (top.get_position().y0 - box.y1)))
        if k:
            bottom.tick_params(labelleft=False)
        title(top, f"{k + 1}: {run.t[part][0]:.2f}–{run.t[part][-1]:.2f} s")


def _frame(ax: Axes, t: np.ndarray, y: str, x: str = "") -> None:
    ax.axhline(0, color="black", linewidth=0.6, zorder=1)
    ax.set_xlim(t[0], t[-1])
    ax.locator_params(axis="y", nbins=4)
    label(ax, x=x, y=y)


def _limits(rows: list[np.ndarray]) -> tuple[float, float]:
    """Symmetric, room for all that is finite."""
    size = max((float(np.abs(r[np.isfinite(r)]).max(initial=0.0)) for r in rows), default=0.0)
    return (-1.1 * size, 1.1 * size) if size > 0 else (-1.0, 1.0)


def _fit_height(ax: Axes, t: np.ndarray, rows: list[np.ndarray]) -> None:
    """Room for all but a short peak, such as a start's: that one is cut off, or nothing else could be seen."""
    size = np.nan_to_num(np.max(np.abs(rows), axis=0), posinf=0.0)
    usual, highest = float(np.quantile(size, _USUAL)), int(np.argmax(size))
    if not size[highest] > _PEAK * usual > 0:
        ax.set_ylim(*_limits(rows))
        return
    ax.set_ylim(-1.1 * usual, 1.1 * usual)
    said = f"cut off: {significant(float(size[highest]), 2)} N at {t[highest]:.2f} s"
    patch = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.0}
    ax.text(0.997, 0.03, said, transform=ax.transAxes, ha="right", va="bottom", fontsize=7.5, color=INK, bbox=patch)


def worst_stretches(t: np.ndarray, before: np.ndarray, after: np.ndarray, seconds: float = ZOOM_SECONDS) -> list[slice]:
    """At most three stretches that do not overlap, by time: two worst before, one worst after (in power)."""
    n = max(2, round(seconds * (len(t) - 1) / float(t[-1] - t[0])) + 1)
    if n >= len(t):
        return [slice(0, len(t))]
    weights = np.hanning(n + 2)[1:-1]
    firsts: list[int] = []
    for residual in (before, before, after):
        # Weighted, so that what is shown lies in the middle.
        power = scipy.signal.oaconvolve(np.nan_to_num(residual, posinf=0.0, neginf=0.0) ** 2, weights, mode="valid")
        for first in firsts:
            power[max(first - n + 1, 0) : first + n] = -1.0
        if power.max() < 0:
            break
        firsts.append(int(np.argmax(power)))
    return [slice(first, first + n) for first in sorted(firsts)]
