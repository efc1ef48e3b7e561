"""What noise alone would leave of a residual, told without a model: from passes that repeat, and from high frequencies.

A floor from repeats holds whatever does not come again: force noise through the loop, the encoder, slow drift. It needs
a reference that repeats, so most records have none; the reason is then said.
"""

import dataclasses

import numpy as np
import scipy.fft
import scipy.signal

from ..recording import Recording
from ..signals import LowPass
from .noise import white_in_band

_REPEATS = 1e-4
"""Largest rms by which passes may differ, per stroke. One sample too early or late is several times as much."""

_SHORTEST_PERIOD = 0.2  # s
_SHORTEST_OVERLAP = 1.0  # s


@dataclasses.dataclass(frozen=True)
class Floor:
    """Noise of the commanded force from pass to pass, against its rms, both inside the band.

    - `value` rms(difference of two passes) / sqrt(2): the noise of one pass, what a perfect model leaves; None without
      repeats
    - `half_difference` half the difference: what is left about the mean of two passes, smaller by sqrt(2)
    - `drift` the same as `value` from the first pass to the last, where there are more than two; above it if the
      machine changes from pass to pass
    - `period` s, `passes` how many fit into the record, not whole
    - `reason` why there is none; "" otherwise
    """

    value: float | None = None
    half_difference: float | None = None
    drift: float | None = None
    period: float | None = None
    passes: float = 1.0
    reason: str = ""


def repeat_floor(recording: Recording, band_hz: float = 60.0) -> Floor:
    """Floor of the closed-loop residual from passes of a reference that repeats.

    Neighbouring passes are compared, the median of their differences counts: a slow trend, or one event, is not noise.
    """
    dt, n = recording.dt, len(recording)
    lag = _period(recording.qg, dt)
    if lag is None:
        return Floor(reason="the reference does not repeat within the record")
    passes = n / lag
    injected = recording.injected
    if injected is not None and np.any(injected[lag:] != injected[:-lag]):
        reason = f"the reference repeats every {lag * dt:.4g} s, the injected signal does not"
        return Floor(period=lag * dt, passes=passes, reason=reason)
    low, tau = LowPass.butterworth(band_hz, dt), recording.tau
    rms = _rms(low(tau, odd=False))
    if rms == 0:
        return Floor(period=lag * dt, passes=passes, reason="the commanded force is zero")
    apart = low(tau[lag:] - tau[:-lag], odd=False)
    starts = [k for k in range(0, len(apart), lag) if k == 0 or len(apart) - k >= 0.5 * lag]
    difference = float(np.median([_rms(apart[k : k + lag]) for k in starts])) / rms
    drift, last = None, (n // lag - 1) * lag
    if last > lag:
        drift = float(_rms(low(tau[last : last + lag] - tau[:lag], odd=False)) / rms / np.sqrt(2))
    return Floor(float(difference / np.sqrt(2)), difference / 2, drift, lag * dt, passes)


def load_noise(recording: Recording, band_hz: float = 60.0) -> float | None:
    """Noise of the two encoders in ql - qm inside the band, m rms; None without a load encoder.

    From the spectrum above six tenths of half the sampling rate, where the axis no longer moves, carried down as white.
    Force noise bends the coupling inside the band, and that comes on top: 1 N on 1e6 N/m is 1 um.
    """
    if recording.ql is None:
        return None
    dt = recording.dt
    return white_in_band(recording.ql - recording.qm, dt, LowPass.butterworth(band_hz, dt))


def _period(q: np.ndarray, dt: float) -> int | None:
    """Samples after which q comes again; None where it does not, or hardly moves where it could be seen to."""
    n = len(q)
    stroke = float(np.ptp(q))
    first, last = round(_SHORTEST_PERIOD / dt), n - round(_SHORTEST_OVERLAP / dt)
    if stroke == 0 or last <= first:
        return None
    x = (q - q.mean()) / stroke
    size = scipy.fft.next_fast_len(2 * n, real=True)
    spectrum = np.fft.rfft(x, size)
    product = np.fft.irfft(spectrum * spectrum.conj(), size)[:n]
    energy = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(n)
    apart = energy[n - lags] + (energy[n] - energy[lags]) - 2 * product  # sum over k of (x[k + lag] - x[k])^2
    apart = np.sqrt(np.maximum(apart, 0.0) / (n - lags))
    for lag in np.flatnonzero(apart < 3 * _REPEATS):
        exact = _rms(x[lag:] - x[: n - lag])  # the sums above cancel to some 1e-7
        if not first <= lag <= last or exact > _REPEATS:
            continue
        # what comes again must be most of the motion, not a dwell; and one sample off must be worse
        if n - lag < 0.2 * lag or np.ptp(x[: n - lag]) < 0.5:
            continue
        if min(apart[lag - 1], apart[lag + 1]) > exact:
            return int(lag)
    return None


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))
