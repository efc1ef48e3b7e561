"""What the model leaves, by frequency."""

import numpy as np
import scipy.signal
from matplotlib.figure import Figure

from ..identify.study import Run, Study
from .canvas import FAINT, RESIDUAL, SIMULATED, canvas, label, record_title, title

HIGHEST_HZ = 120.0
_SEGMENT_SECONDS = 4.0
_FLOOR = 1e-30  # a logarithmic axis has no zero to fill down to
_SIGNALS = {"N": "measured force", "m": "measured position"}


def spectrum_figure(study: Study) -> Figure:
    """Power spectral density of the method's residual rho, of the closed-loop residual, and behind them of the signal.

    rho ends at half the rate that the method decimates to; the closed-loop residual, every sample of it, goes on.
    """
    result = study.result
    unit = result.rho_unit
    figure, axes = canvas(9.6, 3.1, 1, 1, margins=(0.75, 0.12, 0.5, 0.35))
    ax = axes[0, 0]
    curves = []
    if study.runs:
        signal, left = _compared(study.runs[0], unit)
        behind, closed_loop = (psd(x, study.runs[0].recording.dt) for x in (signal, left))
        ax.fill_between(*behind, _FLOOR, color=FAINT, linewidth=0, alpha=0.7, label=_SIGNALS.get(unit, "signal"))
        ax.plot(*closed_loop, color=SIMULATED, linewidth=1.0, label="closed-loop residual, every sample")
        curves += [behind[1], closed_loop[1]]
    rho = psd(result.rho, result.rho_dt)
    ax.plot(*rho, color=RESIDUAL, linewidth=1.5, label=f"residual ρ of the fit, to {0.5 / result.rho_dt:.3g} Hz")
    powers = np.concatenate([*curves, rho[1]])
    ax.set_yscale("log")
    ax.set_xlim(0, HIGHEST_HZ)
    if np.any(powers > 0):
        ax.set_ylim(np.percentile(powers[powers > 0], 2) / 3, 2 * powers.max())
    label(ax, x="frequency, Hz", y=f"power density, {unit}²/Hz")
    title(ax, "Spectrum of the residual" + (f", {record_title(study.runs[0].recording)}" if study.runs else ""))
    ax.legend(loc="upper right", frameon=False, fontsize=8.5)
    return figure


def psd(x: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Welch's estimate up to 120 Hz, (Hz, unit²/Hz); empty where x is not finite."""
    if len(x) < 2 or not np.isfinite(x).all():
        return np.zeros(0), np.zeros(0)
    f, power = scipy.signal.welch(x, 1 / dt, nperseg=min(len(x), round(_SEGMENT_SECONDS / dt)))
    kept = (f > 0) & (f <= HIGHEST_HZ)
    return f[kept], power[kept]


def _compared(run: Run, unit: str) -> tuple[np.ndarray, np.ndarray]:
    """The recorded signal that the method compares, and what the simulation leaves of it."""
    if unit == "N":
        return run.recording.tau, run.recording.tau - run.tau
    return run.recording.qm, run.recording.qm - run.qm
