"""IDIM-LS: least squares on the inverse model, from measured positions.

References: paper, section III.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..idm import known_force, observation_matrix
from ..params import select, unpack
from ..plant import AbstractFriction, AbstractPlant, Axis
from ..recording import Recording
from ..signals import Decimation, LowPass, central_difference
from ..statistics import base_columns, solve
from .result import IdentificationResult


@dataclasses.dataclass(frozen=True)
class Filtering:
    """How positions become velocities and accelerations, and how W and Y are decimated.

    The defaults are the benchmark authors': a Butterworth of order 4 at 100 Hz forward and backward, central
    differences, 49 samples dropped at both ends, decimation by 10 with MATLAB's filter.
    """

    position_hz: float = 100.0
    trim: int = 49
    factor: int = 10
    decimation_hz: float | None = None
    """Cutoff of a Butterworth of order 4 in place of MATLAB's filter (the paper's 60 Hz)."""
    centred_force: bool = False
    """Take for the force at a sample the mean of the commands held before and after it.

    A drive that holds its command from one sample to the next acts half a sample late: at 30 Hz and 1 kHz that is 5
    degrees, which least squares books as friction. The authors' scripts do not, and below 10 Hz it does not matter.
    """

    def decimation(self, dt: float) -> Decimation:
        low_pass = (
            LowPass.chebyshev(self.factor)
            if self.decimation_hz is None
            else LowPass.butterworth(self.decimation_hz, dt)
        )
        return Decimation(low_pass, self.factor, self.trim)


AUTHORS = Filtering()
"""The benchmark authors' filters, for a rigid drive."""

WITH_LOAD_ENCODER = Filtering(factor=8, decimation_hz=60.0, centred_force=True)
"""The paper's filters for a flexible drive, 100 Hz and 60 Hz (section VI.B), and the hold of the drive counted."""


def motion(q: np.ndarray, dt: float, position_hz: float) -> Axis:
    """Motion of one side from its encoder: low-pass without phase, then central differences twice."""
    q = LowPass.butterworth(position_hz, dt)(q)
    v = central_difference(q, dt)
    return Axis(jnp.asarray(q), jnp.asarray(v), jnp.asarray(central_difference(v, dt)))


def idim_ls(
    plant: AbstractPlant, names: Sequence[str], recordings: Sequence[Recording], filtering: Filtering = AUTHORS
) -> IdentificationResult:
    """Solve Y = W chi + rho for the named parameters; the others keep the plant's values.

    The sign of the velocity is the hard one. A flexible drive needs the load encoder. Columns that the record cannot
    tell apart are regrouped into base parameters, and `reason` says how.

    Raises InputError when a flexible drive is asked for and a record has no `ql`.

    References: paper, eq. 10-15.
    """
    if plant.model == "flexible":
        need_load_position(recordings)
    sharp = _hard_sign(plant)
    chosen = select(plant, names)
    dt = recordings[0].dt
    decimate = filtering.decimation(dt)
    W_parts, Y_parts = [], []
    for recording in recordings:
        motor = motion(recording.qm, recording.dt, filtering.position_hz)
        load = motor
        if plant.model == "flexible" and recording.ql is not None:
            load = motion(recording.ql, recording.dt, filtering.position_hz)
        W = np.asarray(observation_matrix(sharp, motor, load, chosen))
        known = np.asarray(known_force(sharp, motor, load, chosen))
        for row in range(len(W)):
            measured = _force(recording, filtering) if row == 0 else np.zeros(len(recording))
            W_parts.append(decimate(W[row]))
            Y_parts.append(decimate(measured - known[row]))
    W, Y = np.concatenate(W_parts), np.concatenate(Y_parts)
    base, beta = base_columns(W)
    others = [p.name for i, p in enumerate(chosen) if i not in base]
    solution = solve(W[:, base], Y, [len(part) for part in Y_parts])
    kept = tuple(chosen[i] for i in base)
    return IdentificationResult(
        method="IDIM-LS",
        plant=unpack(plant, jnp.asarray(solution.theta), kept),
        names=tuple(p.name for p in kept),
        units=tuple(p.unit for p in kept),
        theta=solution.theta,
        spread=solution.spread,
        relative_error=solution.relative_error,
        converged=True,
        reason="one linear least squares" + _regrouped(kept, others, beta),
        n_iterations=1,
        n_simulations=0,
        trace=solution.theta[None, :],
        costs=np.array([solution.relative_error]),
        rho=solution.rho,
        rho_dt=dt * filtering.factor,
    )


def need_load_position(recordings: Sequence[Recording]) -> None:
    """Raises InputError for a record without `ql`."""
    for recording in recordings:
        if recording.ql is None:
            raise InputError(
                f"{recording.label}: IDIM-LS of the flexible model needs the load position ql (m), which this "
                "record does not have; use the three-step method, which needs the motor force alone."
            )


def _force(recording: Recording, filtering: Filtering) -> np.ndarray:
    tau = recording.tau
    return 0.5 * (tau + np.concatenate([tau[:1], tau[:-1]])) if filtering.centred_force else tau


def _hard_sign(plant: AbstractPlant) -> AbstractPlant:
    """The same plant with sign(v): no derivative is taken here, and the measured speed needs no smoothing."""

    def harden(part: object) -> object:
        if isinstance(part, AbstractFriction):
            return eqx.tree_at(lambda f: f.v_eps, part, jnp.asarray(1e-15, dtype=float))
        return part

    return jax.tree.map(harden, plant, is_leaf=lambda part: isinstance(part, AbstractFriction))


def _regrouped(kept: Sequence, others: Sequence[str], beta: np.ndarray) -> str:
    """Which base parameter took in which dependent one, in words."""
    groups = []
    for row, parameter in zip(beta, kept, strict=True):
        terms = [f"{b:+.3g} {name}" for b, name in zip(row, others, strict=True) if abs(b) > 1e-6]
        if terms:
            groups.append(f"{parameter.name} stands for {parameter.name} {' '.join(terms)}")
    return f"; dependent columns regrouped: {', '.join(groups)}" if groups else ""
