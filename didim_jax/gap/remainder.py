"""What a fit leaves, told from noise: does it go with the motion, come in bursts, hum at one frequency, drift too far?

The residual is made white by its own noise first. What noise alone gives is then the same at every noise level: no
share closed on blocks left out, windows of like energy, no line above the others, a drift of a fraction of the rest.
"""

import dataclasses

import numpy as np
import threadpoolctl

from .prepared import Prepared, motion
from .relevance import Regression, blocks
from .variables import dictionary

WINDOW_S = 0.2
QUIET, LOUD = 0.4, 2.5
"""Quantile of the windows' energies that is quiet, and times its energy from which a window is a burst."""

_QUIET_SHARE = 0.9
"""That quantile of the energy of a window of noise, against its mean: chi-squared with some twenty degrees."""

_REST = 1e-3
"""Of the stroke, below which the reference rests in a window."""

_SETTLED, _STEADY = 0.09, 0.6
"""Share of structure, and drift, below which a residual looks like noise."""


@dataclasses.dataclass(frozen=True)
class Remainder:
    """Shares of the whitened energy: `followed` by smooth functions of the motion, on blocks left out; in `bursts`; in
    the strongest `line` of the spectrum, at `line_hz`.

    `drift` is the rms of the slow part against the level of the rest at low frequency; a machine has 0.1 to 0.4.
    """

    followed: float
    bursts: float
    line: float
    line_hz: float
    drift: float

    @property
    def structured(self) -> float:
        """Share that is not noise."""
        return max(self.followed, self.bursts, self.line)

    @property
    def settled(self) -> bool:
        """Whether it looks like noise."""
        return self.structured < _SETTLED and self.drift < _STEADY


def remainder(record: Prepared, residual: np.ndarray) -> Remainder:
    """Of a residual of the record's force, N, (n_decimated,)."""
    force, dt = record.channels[0], record.dt
    if float(np.sqrt(np.mean(residual**2))) < force.least:
        return Remainder(0.0, 0.0, 0.0, 0.0, 0.0)
    noise = record.noise(force, residual)
    white = noise.whitening(len(residual), dt)(residual)
    q, v, a, qg = motion(record)
    columns = dictionary(record.t, q, v, a, qg, dt, record.bench.lead)
    with threadpoolctl.threadpool_limits(1, user_api="blas"):  # threads only wait for each other at this size
        fit = Regression(list(columns.values()), white, blocks(len(white), dt))
        followed = fit.share(fit.prior(range(len(columns))))
    return Remainder(followed, bursts(white, qg, dt), *line(white, dt), noise.drift)


def bursts(white: np.ndarray, reference: np.ndarray, dt: float) -> float:
    """Share of the energy of white noise that a few windows hold beyond what is quiet while the axis moves.

    (n,) every dt s. At rest friction holds against noise, too: such windows say nothing of what is quiet.
    """
    length = max(1, round(WINDOW_S / dt))
    count = len(white) // length
    rows = np.arange(count * length).reshape(count, length)
    moving = np.ptp(reference[rows], axis=1) > _REST * np.ptp(reference)
    if np.count_nonzero(moving) < 5:
        return 0.0
    energies = np.sum(white[rows[moving]] ** 2, axis=1)
    quiet = float(np.quantile(energies, QUIET)) / _QUIET_SHARE
    loud = energies > LOUD * quiet
    return float(np.sum(energies[loud] - quiet) / max(np.sum(energies), 1e-300))


def line(white: np.ndarray, dt: float) -> tuple[float, float]:
    """Share of the energy of white noise, (n,) every dt s, that one steady sinusoid holds, and its frequency, Hz.

    Some 0.02 in noise. Mains, a fan or a neighbour's machine go with no motion and come in no bursts.
    """
    n = len(white)
    power = np.abs(np.fft.rfft(white, 4 * n)) ** 2
    f = np.fft.rfftfreq(4 * n, dt)
    power[f < 2 / (n * dt)] = 0.0  # less than two turns are a drift
    strongest = int(np.argmax(power))
    return float(2 * power[strongest] / max(n * float(white @ white), 1e-300)), float(f[strongest])
