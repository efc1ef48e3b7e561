"""Measured and simulated force, and under it what is left."""

import numpy as np
from matplotlib.figure import Figure

from ..identify.study import ERROR_HZ, Run
from ..signals import LowPass
from .canvas import FAINT, MEASURED, RESIDUAL, SIMULATED, canvas, envelope, label, record_title, title
from .tables import percent

ZOOM_SECONDS = 1.5
_BINS = 900  # about the pixels across the wide column


def force_figure(run: Run, role: str) -> Figure:
    """Force and residual (N) against time (s): the whole record, and beside it the stretch that fits worst.

    The residual is drawn as it is in light grey, and below 60 Hz in colour: what `force_error` measures.
    """
    record = run.recording
    t, measured, simulated = record.t, record.tau, run.tau
    raw = measured - simulated
    residual = in_band(raw, record.dt)
    figure, axes = canvas(
        9.6,
        5.3,
        2,
        2,
        margins=(0.68, 0.2, 0.5, 0.62),
        sharex="col",
        sharey="row",
        width_ratios=(1.75, 1),
        height_ratios=(1.55, 1),
        hspace=0.15,
        wspace=0.16,
    )
    window = worst_stretch(t, residual)
    for (top, bottom), part in zip(axes.T, (slice(None), window), strict=True):
        clock, zoomed = t[part], part is window
        # The measurement is drawn broad and pale, so that a simulation on top of it does not hide it.
        for ax, signal, name, colour, thin, thick in (
            (top, measured, "measured", MEASURED, 1.6, 2.6),
            (top, simulated, "simulated", SIMULATED, 0.8, 1.1),
            (bottom, raw, "as recorded", FAINT, 0.8, 0.8),
            (bottom, residual, f"below {ERROR_HZ:g} Hz", RESIDUAL, 0.9, 1.3),
        ):
            width = thick if zoomed else thin
            ax.plot(*envelope(clock, signal[part], _BINS), color=colour, linewidth=width, label=name)
        bottom.axhline(0, color="black", linewidth=0.6)
        bottom.set_xlim(clock[0], clock[-1])
        label(bottom, x="time, s")
    for ax in axes[:, 0]:
        ax.axvspan(t[window][0], t[window][-1], color="#f3e9c6", linewidth=0, zorder=0)
        ax.legend(
            loc="lower left",
            bbox_to_anchor=(0, 0.985),
            ncols=2,
            frameon=False,
            fontsize=8.5,
            borderaxespad=0.1,
            handlelength=1.6,
        )
    label(axes[0, 0], y="motor force, N")
    label(axes[1, 0], y="residual, N")
    axes[0, 0].set_ylim(*_force_limits(measured, simulated))
    axes[1, 0].set_ylim(*_residual_limits(raw, residual))
    title(axes[0, 0], f"{role}: {record_title(record)}, error {percent(run.force_error)}", fontweight="bold", pad=24)
    title(axes[0, 1], f"the {t[window][-1] - t[window][0]:.1f} s that fit worst")
    return figure


def in_band(x: np.ndarray, dt: float) -> np.ndarray:
    """Butterworth of order 4 forward and backward; the signal itself where the sampling is too slow for that."""
    return LowPass.butterworth(ERROR_HZ, dt)(x) if ERROR_HZ * dt < 0.5 else x


def worst_stretch(t: np.ndarray, residual: np.ndarray, seconds: float = ZOOM_SECONDS) -> slice:
    """The stretch of so many seconds with the largest residual, root mean square."""
    dt = (t[-1] - t[0]) / (len(t) - 1)
    n = min(len(t), max(2, round(seconds / dt) + 1))
    energy = np.concatenate([[0.0], np.cumsum(np.nan_to_num(residual, posinf=0.0, neginf=0.0) ** 2)])
    first = int(np.argmax(energy[n:] - energy[:-n]))
    return slice(first, first + n)


def _force_limits(measured: np.ndarray, simulated: np.ndarray) -> tuple[float, float]:
    """Room for both; a simulation that has run away must not flatten the measurement."""
    low, high = float(measured.min()), float(measured.max())
    span = (high - low) or 1.0
    finite = simulated[np.isfinite(simulated)]
    if finite.size:
        low, high = max(min(low, finite.min()), low - span), min(max(high, finite.max()), high + span)
    return low - 0.06 * span, high + 0.06 * span


def _residual_limits(raw: np.ndarray, residual: np.ndarray) -> tuple[float, float]:
    """Symmetric, with all of the filtered residual and nearly all of the raw one: single spikes are cut off."""
    raw, residual = (np.abs(x[np.isfinite(x)]) for x in (raw, residual))
    size = max(float(residual.max(initial=0.0)), float(np.percentile(raw, 99.5)) if raw.size else 0.0)
    return (-1.1 * size, 1.1 * size) if size > 0 else (-1.0, 1.0)
