"""The noise of a residual: white or coloured, and a slow drift that white noise's criterion would take for an effect.

A slow force (bearings, drafts, a warming amplifier) is an Ornstein-Uhlenbeck process here, one-sided spectrum
S(f) = 4 s^2 T / (1 + (2 pi f T)^2). Weights are applied line by line of a cosine transform, which keeps time.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import scipy.fft
import scipy.optimize
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
        return cls(1 / np.sqrt(sigma**2 + slow**2 * _drift(_lines(n, dt), dt)))

    def __call__(self, r: np.ndarray) -> np.ndarray:
        """Along the last axis."""
        return scipy.fft.idct(self.weights * scipy.fft.dct(r, norm="ortho", axis=-1), norm="ortho", axis=-1)


CORNER, SLOW, SPREAD = 40.0, 0.15, 0.7
"""Typical corner (Hz), drift against noise, and by how much (log) machines differ in both."""

_HIGHEST = 55.0  # Hz: above, the filter of the band has the say


@dataclasses.dataclass(frozen=True)
class Noise:
    """What a residual's own spectrum says of its noise, by maximum likelihood: variance of the cosine line at f

    sigma^2 / (1 + (f / corner)^2) + slow^2 drift(f) + least^2, and the log-likelihood of the lines below 55 Hz, that of
    the prior included and constants left out.

    `sigma` (level of a line at low frequency), `slow` (rms of the drift) and `least` in the residual's unit, `corner`
    Hz. The closed loop colours noise, so even white one has a corner. What is typical comes in as a prior: a force that
    an effect should explain is not to pass for drift.
    """

    sigma: float
    corner: float
    slow: float
    least: float
    log_likelihood: float

    @classmethod
    def of(cls, residual: np.ndarray, dt: float, least: float = 0.0) -> "Noise":
        """Of a residual in the band, (n,), every dt s; nothing is said to be quieter than `least` rms."""
        lines, n = scipy.fft.dct(residual, norm="ortho") ** 2, len(residual)
        f = _lines(n, dt)
        inside = np.flatnonzero(f < min(_HIGHEST, 0.4 / dt))
        if lines[0] < 1e-20 * np.sum(lines):  # a channel compared without its mean
            inside = inside[1:]
        # Lines one by one where drift is steep, then in bunches.
        edges = np.concatenate([np.arange(20), np.geomspace(20, len(inside), 40).astype(int)])
        edges = np.unique(edges[edges < len(inside)])
        counts = np.diff(np.append(edges, len(inside)))
        power = np.add.reduceat(lines[inside], edges) / counts
        f = np.add.reduceat(f[inside], edges) / counts
        drift, least = _drift(f, dt), max(least, 1e-150)

        def cost(z: np.ndarray) -> tuple[float, np.ndarray]:
            """Negative log-likelihood of log sigma, log corner and log(slow / sigma), and its slope."""
            white = np.exp(2 * z[0]) / (1 + (f / np.exp(z[1])) ** 2)
            slow = np.exp(2 * (z[0] + z[2])) * drift
            S = white + slow + least**2
            away = np.array([0.0, (z[1] - np.log(CORNER)) / SPREAD, (z[2] - np.log(SLOW)) / SPREAD])
            slope = 0.5 * counts * (1 - power / S) / S
            turned = 2 * white * (f / np.exp(z[1])) ** 2 / (1 + (f / np.exp(z[1])) ** 2)
            gradient = np.array([slope @ (2 * (white + slow)), slope @ turned, slope @ (2 * slow)]) + away / SPREAD
            return 0.5 * float(counts @ (power / S + np.log(S)) + away @ away), gradient

        rms = max(float(np.sqrt(np.mean(residual**2))), least)
        found = min(
            (_minimum(cost, np.array([np.log(rms), np.log(CORNER), np.log(slow)])) for slow in (0.05, 0.5)),
            key=lambda end: float(end.fun),
        )
        sigma, corner, ratio = np.exp(found.x)
        return cls(float(sigma), float(corner), float(sigma * ratio), least, -float(found.fun))

    @property
    def drift(self) -> float:
        """Rms of the slow part against the level of the rest at low frequency."""
        return self.slow / self.sigma

    def whitening(self, n: int, dt: float) -> Whitening:
        """What makes n samples of this noise white, of unit variance."""
        f = _lines(n, dt)
        coloured = self.sigma**2 / (1 + (f / self.corner) ** 2)
        return Whitening(1 / np.sqrt(coloured + self.slow**2 * _drift(f, dt) + self.least**2))


def _minimum(
    cost: Callable[[np.ndarray], tuple[float, np.ndarray]], start: np.ndarray
) -> scipy.optimize.OptimizeResult:
    bounds = [(start[0] - 12, start[0] + 3), (np.log(0.5), np.log(500.0)), (np.log(1e-3), np.log(100.0))]
    return scipy.optimize.minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds)


def _lines(n: int, dt: float) -> np.ndarray:
    """Frequencies of the cosine lines, Hz."""
    return np.arange(n) / (2 * n * dt)


def _drift(f: np.ndarray, dt: float) -> np.ndarray:
    """Variance of the cosine lines of a drift of unit rms."""
    return 4 * CORRELATION_TIME / (1 + (2 * np.pi * f * CORRELATION_TIME) ** 2) / (2 * dt)


def white_in_band(x: np.ndarray, dt: float, low: LowPass) -> float:
    """Rms of the white noise of x inside the band: its level above six tenths of half the rate, carried down."""
    f, density = scipy.signal.welch(x, 1 / dt, nperseg=min(1024, len(x)), detrend="linear", average="median")
    _, H = scipy.signal.sosfreqz(low.sos, worN=4096)
    return float(np.sqrt(np.mean(density[f > 0.3 / dt]) * np.mean(np.abs(H) ** 4) * 0.5 / dt))
