"""The noise of a residual: white, and a slow drift that a criterion on white noise would take for an effect.

A slow force (bearings, drafts, a warming amplifier) is an Ornstein-Uhlenbeck process here, one-sided spectrum
S(f) = 4 s^2 T / (1 + (2 pi f T)^2). Weights are applied line by line of a cosine transform, which keeps time.
"""

import dataclasses

import numpy as np
import scipy.fft
import scipy.signal

from ..signals import LowPass

CORRELATION_TIME = 3.0
"""T, s."""

SLOW_SHARE = 0.007
"""s against the rms of the channel."""


@dataclasses.dataclass(frozen=True)
class Whitening:
    """e = C' w C r, C the orthonormal cosine transform: innovations of about unit variance; `weights` (n,)."""

    weights: np.ndarray

    @classmethod
    def flat(cls, n: int, sigma: float) -> "Whitening":
        """White noise of rms sigma."""
        return cls(np.full(n, 1 / sigma))

    @classmethod
    def of(cls, n: int, dt: float, sigma: float, slow: float) -> "Whitening":
        """White noise of rms sigma and a slow drift of rms `slow`, at a sample time dt (s)."""
        f = np.arange(n) / (2 * n * dt)
        drift = 4 * slow**2 * CORRELATION_TIME / (1 + (2 * np.pi * f * CORRELATION_TIME) ** 2)
        return cls(1 / np.sqrt(sigma**2 + drift / (2 * dt)))

    def __call__(self, r: np.ndarray) -> np.ndarray:
        """Along the last axis."""
        return scipy.fft.idct(self.weights * scipy.fft.dct(r, norm="ortho", axis=-1), norm="ortho", axis=-1)


def white_in_band(x: np.ndarray, dt: float, low: LowPass) -> float:
    """Rms of the white noise of x inside the band: its level above six tenths of half the rate, carried down."""
    f, density = scipy.signal.welch(x, 1 / dt, nperseg=min(1024, len(x)), detrend="linear", average="median")
    _, H = scipy.signal.sosfreqz(low.sos, worN=4096)
    return float(np.sqrt(np.mean(density[f > 0.3 / dt]) * np.mean(np.abs(H) ** 4) * 0.5 / dt))
