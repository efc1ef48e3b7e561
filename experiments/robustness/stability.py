"""Is the closed loop around a drive stable at all? A start whose own loop is not has no finite simulation.

Linearised while both sides move, where Coulomb friction is a constant force and drops out.
"""

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jax import Array

from didim_jax.machine import Machine
from didim_jax.plant import AbstractPlant

_MOVING = 0.1
"""Speed (m/s) of the linearisation, a hundred times that of the smooth sign."""


def linearised(plant: AbstractPlant) -> tuple[np.ndarray, np.ndarray]:
    """A (n, n) and B (n, 1) of dy/dt = A y + B tau (eq. 5, 9), tau in N."""
    A, B = _derivatives(plant)
    return np.asarray(A), np.asarray(B)[:, None]


@eqx.filter_jit
def _derivatives(plant: AbstractPlant) -> tuple[Array, Array]:
    y, tau = plant.start(0.0, _MOVING), jnp.asarray(0.0)
    return jax.jacfwd(plant.vector_field, argnums=0)(y, tau), jax.jacfwd(plant.vector_field, argnums=1)(y, tau)


def sampled_radius(plant: AbstractPlant, machine: Machine) -> float:
    """Spectral radius of the sampled loop, per sample: stable below 1.

    Exact discretisation under a held force; the law's memory holds qm[k-1] and qm[k-2]:
    tau[k] = -g kv (kp q[k] + (q[k] - q[k-2]) / (2 dt)).
    """
    A, B = linearised(plant)
    law, n = machine.controller, len(A)
    dt = law.sample_time
    held = scipy.linalg.expm(dt * np.block([[A, B], [np.zeros((1, n + 1))]]))
    gain = machine.drive.gain * law.kv
    feedback = np.zeros((1, n + 2))
    feedback[0, 0] = -gain * (law.kp + 1 / (2 * dt))
    feedback[0, -1] = gain / (2 * dt)
    loop = np.zeros((n + 2, n + 2))
    loop[:n, :n] = held[:n, :n]
    loop[:n] += held[:n, n:] @ feedback
    loop[n, 0] = loop[n + 1, n] = 1.0  # q becomes qm[k-1], that becomes qm[k-2]
    return _radius(loop)


def integrated_radius(plant: AbstractPlant, machine: Machine, method: dfx.AbstractERK, substeps: int) -> float:
    """Spectral radius of one explicit Runge-Kutta step around the continuous law, step = sample time / substeps.

    The continuous loop is stable whatever the masses; its integration is not, where the step is too long for them.
    """
    A, B = linearised(plant)
    law = machine.controller
    feedback = np.zeros((1, len(A)))
    feedback[0, :2] = -machine.drive.gain * law.kv * np.array([law.kp, 1.0])
    A = A + B @ feedback
    h, identity, tableau = law.sample_time / substeps, np.eye(len(A)), method.tableau
    assert isinstance(tableau, dfx.ButcherTableau)
    rows: list[np.ndarray] = [np.zeros(0), *(np.asarray(row) for row in tableau.a_lower)]
    k: list[np.ndarray] = []
    for row in rows:
        k.append(A @ (identity + h * sum((a * ki for a, ki in zip(row, k, strict=True)), np.zeros_like(A))))
    return _radius(
        identity + h * sum((b * ki for b, ki in zip(np.asarray(tableau.b_sol), k, strict=True)), np.zeros_like(A))
    )


def _radius(matrix: np.ndarray) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))
