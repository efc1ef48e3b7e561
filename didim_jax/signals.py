"""Zero-phase filters, central differences, and the one decimation that W and Y share.

Filters are designed by scipy.signal. They are applied by it on the host, and by the same recursion in JAX where a
derivative must pass through; the two agree to rounding, edges included.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.signal
from jax import Array

from ._types import Traj
from .errors import InputError


@dataclasses.dataclass(frozen=True)
class LowPass:
    """A digital low-pass filter as second-order sections, (n_sections, 6), to be run forward and backward."""

    sos: np.ndarray

    @classmethod
    def butterworth(cls, cutoff_hz: float, dt: float, order: int = 4) -> "LowPass":
        """Butterworth of the given order (4 in the paper and by its authors), one pass; -6 dB at the cutoff in two."""
        nyquist_hz = 0.5 / dt
        if not 0 < cutoff_hz < nyquist_hz:
            raise InputError(
                f"cutoff must lie between 0 and {nyquist_hz:g} Hz (half the sampling rate), not {cutoff_hz:g} Hz."
            )
        return cls(scipy.signal.butter(order, cutoff_hz / nyquist_hz, output="sos"))

    @classmethod
    def chebyshev(cls, factor: int) -> "LowPass":
        """The usual decimation filter (MATLAB's decimate): Chebyshev I, order 8, 0.05 dB, at 0.8 of the new Nyquist."""
        return cls(scipy.signal.cheby1(8, 0.05, 0.8 / factor, output="sos"))

    def __call__(self, x: np.ndarray, odd: bool = True) -> np.ndarray:
        """Forward and backward along the first axis, on the host; the ends continued by odd or by even reflection."""
        padtype = "odd" if odd else "even"
        return scipy.signal.sosfiltfilt(self.sos, x, axis=0, padtype=padtype, padlen=self.padding)

    @property
    def padding(self) -> int:
        """Samples of odd extension at each end, as scipy.signal.filtfilt chooses them."""
        return 3 * (2 * self.sos.shape[0] + 1)


@dataclasses.dataclass(frozen=True)
class Decimation:
    """Parallel decimation: the same zero-phase low-pass on Y and on every column of W, then one sample in `factor`.

    References: paper, section III (after eq. 15).
    """

    low_pass: LowPass
    factor: int
    trim: int = 0
    """Samples dropped at both ends before filtering, where central differences and filters have edges."""
    odd: bool = True
    """Continue the ends by odd reflection, as SciPy and MATLAB do.

    That reflects everything about the one first sample, whose noise is then not filtered at all; even reflection
    averages it with the rest.
    """

    @classmethod
    def at(cls, cutoff_hz: float, dt: float) -> "Decimation":
        """Butterworth of order 4 at the cutoff, then the highest factor whose Nyquist frequency is not below it.

        White noise then leaves samples that are nearly independent, so eq. 13-14 hold. Even reflection at the ends.
        """
        return cls(LowPass.butterworth(cutoff_hz, dt), max(1, int(0.5 / (cutoff_hz * dt) + 1e-9)), odd=False)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Trim, filter and decimate along the first axis, on the host."""
        x = x[self.trim : len(x) - self.trim]
        return self.low_pass(x, self.odd)[:: self.factor]

    def traced(self) -> "TracedDecimation":
        """The same operation for use inside a jitted function; `trim` must be zero."""
        if self.trim:
            raise ValueError("simulations are not trimmed: every sample counts.")
        sos = self.low_pass.sos
        return TracedDecimation(
            jnp.asarray(sos), jnp.asarray(scipy.signal.sosfilt_zi(sos)), self.low_pass.padding, self.factor, self.odd
        )


class TracedDecimation(eqx.Module):
    """`Decimation` on one traced signal, (n,) to (ceil(n / factor),)."""

    sos: Array
    zi: Array
    padding: int = eqx.field(static=True)
    factor: int = eqx.field(static=True)
    odd: bool = eqx.field(static=True)

    @eqx.filter_jit
    def __call__(self, x: Traj) -> Array:
        p = self.padding
        head, tail = x[p:0:-1], x[-2 : -p - 2 : -1]
        if self.odd:
            head, tail = 2 * x[0] - head, 2 * x[-1] - tail
        y = jnp.concatenate([head, x, tail])
        y = self._pass(y, reverse=False)
        y = self._pass(y, reverse=True)
        return y[p:-p][:: self.factor]

    def _pass(self, x: Traj, *, reverse: bool) -> Traj:
        """One pass of the cascade (transposed direct form II), started as if x had always had its first value."""
        first = x[-1] if reverse else x[0]

        def step(z: Array, u: Array) -> tuple[Array, Array]:
            rows = []
            for section in range(self.sos.shape[0]):
                b0, b1, b2, _, a1, a2 = self.sos[section]
                y = b0 * u + z[section, 0]
                rows.append(jnp.stack([b1 * u - a1 * y + z[section, 1], b2 * u - a2 * y]))
                u = y
            return jnp.stack(rows), u

        return jax.lax.scan(step, self.zi * first, x, reverse=reverse)[1]


def central_difference(x: np.ndarray, dt: float) -> np.ndarray:
    """dx/dt at sample k from samples k - 1 and k + 1, one-sided at the ends; no phase shift."""
    return np.gradient(x, dt, axis=0)


def runs(high: np.ndarray, bridged: float = 0) -> list[tuple[int, int]]:
    """First and past-the-last sample of every run of True in (n,) of bool; gaps of up to `bridged` samples are none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], high, [False]]).astype(int)))
    found: list[tuple[int, int]] = []
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found and a - found[-1][1] <= bridged:
            found[-1] = (found[-1][0], b)
        else:
            found.append((a, b))
    return found
