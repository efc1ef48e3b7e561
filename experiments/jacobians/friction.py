"""Motor-side and load-side friction from motor force alone, by excitation. The paper: it cannot be separated."""

import dataclasses

import numpy as np

from didim_jax.identify.gauss_newton import STOPPING
from didim_jax.reference import Chirp, Dwell, Motion, Sequence, Together, Trapezoid, load_reference
from didim_jax.signals import Decimation
from didim_jax.synthesize import synthesize

from ..data import TWIN
from .angles import columns
from .config import Config
from .draws import Sample, bound, lanes, noisy_signals, sample
from .twin import SEVEN, Twin

_FAST = Trapezoid(distance=0.1, speed=0.2, acceleration=1.5, dwell=0.1)
_SLOW = Trapezoid(distance=0.15, speed=0.05, acceleration=1.0)
_LOW = Chirp(amplitude=0.029, f_start=1.0, f_end=33.0, duration=5.5, exponent=2.0, taper=0.4)
_ON_MOVE = Chirp(amplitude=1.05e-4, f_start=12.0, f_end=36.0, duration=6.1, exponent=0.0)
_HIGH = Chirp(amplitude=1.3e-4, f_start=60.0, f_end=33.0, duration=1.5, exponent=0.0)

EXCITATIONS: dict[str, Motion] = {
    "trapezoids": Sequence((Dwell(0.3), _FAST, _FAST, _SLOW, _FAST, _FAST, _FAST)),
    "chirps about rest": Sequence((Dwell(0.3), _LOW, _HIGH, _LOW, _HIGH)),
    "chirps on slow moves": Sequence((Dwell(0.3), Together((_SLOW, _ON_MOVE)), Together((_SLOW, _ON_MOVE)))),
    "trapezoids and chirps": load_reference(TWIN / "reference.toml").motion,
    "trapezoids and multisines": load_reference(TWIN / "reference_check.toml").motion,
}
"""Motions of the twin's own parts; each is held at its end until all are equally long."""


@dataclasses.dataclass(frozen=True)
class Separation:
    """What one excitation gives: Cramer-Rao covariance of all seven parameters, and the draws."""

    covariance: np.ndarray
    sample: Sample

    @property
    def std(self) -> np.ndarray:
        """Bound of each parameter."""
        return np.sqrt(np.diag(self.covariance))

    def correlation(self, a: str, b: str) -> float:
        """Of the errors of two parameters."""
        i, j = SEVEN.index(a), SEVEN.index(b)
        return float(self.covariance[i, j] / (self.std[i] * self.std[j]))

    def sum_std(self, a: str, b: str) -> float:
        """Bound of the sum of two parameters."""
        k = [SEVEN.index(a), SEVEN.index(b)]
        return float(np.sqrt(np.sum(self.covariance[np.ix_(k, k)])))


def separations(twin: Twin, config: Config) -> dict[str, Separation]:
    """Every excitation, with the same noise, as long as the twin's reference."""
    return {name: _separation(twin, config, motion) for name, motion in EXCITATIONS.items()}


def _separation(twin: Twin, config: Config, motion: Motion) -> Separation:
    moved = motion.sample(twin.dt)
    qg = twin.qg[0] + np.pad(moved, (0, len(twin.qg) - len(moved)), mode="edge")
    clean = synthesize(twin.machine, twin.plant, qg, name="excitation")
    there = dataclasses.replace(twin, qg=qg, clean=clean)
    decimation = Decimation.at(config.cutoff_hz, twin.dt)
    observed = noisy_signals(clean.tau, decimation, config.noise, config.friction_draws, config.seed)
    found = lanes(there.trial(twin.plant, decimation), twin.plant, SEVEN, STOPPING, observed, exact=True)
    return Separation(bound(columns(there, twin.plant, SEVEN).J, config.noise), sample(found, SEVEN))
