"""The drive as two masses and a spring, and the two ways to name its stiffness."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param, part
from ._base import AbstractPlant, Axis
from .friction import AbstractFriction


class FlexibleDrive(AbstractPlant):
    """Two masses on a spring, delta = q2 - q1 (the paper's q2 is our delta, its q12 our q2).

        tau = M1 a1 + F1(v1) + offset - K12 delta
        0   = M2 a2 + F2(v2) + K12 delta

    The state is (q1, v1, delta, d delta/dt): the deflection is micrometres on a stroke of decimetres, and
    q2 - q1 would lose its digits.

    References: paper, eq. 2-5.
    """

    M1: Scalar = param("kg", positive=True, scale=50.0)
    motor_friction: AbstractFriction = part("1")
    M2: Scalar = param("kg", positive=True, scale=50.0)
    load_friction: AbstractFriction = part("2")
    K12: Scalar = param("N/m", positive=True, scale=1e6)
    offset: Scalar = param("N", scale=1.0, default=0.0)

    model: ClassVar[str] = "flexible"
    state_names: ClassVar[tuple[str, ...]] = ("q1", "v1", "delta", "ddelta")
    state_scales: ClassVar[tuple[float, ...]] = (1e-5, 1e-3, 1e-5, 1e-3)

    def sides(self, y: Array) -> tuple[Array, Array, Array, Array]:
        return y[0], y[1], y[0] + y[2], y[1] + y[3]

    def coupling_force(self, y: Array) -> Array:
        return self.K12 * y[2]

    def vector_field(
        self,
        y: Array,
        tau: Array,
        on_motor: Scalar = 0.0,
        on_coupling: Scalar = 0.0,
        on_load: Scalar = 0.0,
        frame: Scalar = 0.0,
        payload: Scalar = 0.0,
    ) -> Array:
        """Equation 5."""
        _, v1, _, v2 = self.sides(y)
        F12 = self.coupling_force(y) + on_coupling
        a1 = (tau + on_motor - self.motor_friction(v1) - self.offset + F12) / self.M1
        a2 = (on_load - self.load_friction(v2) - F12) / (self.M2 + payload)
        return jnp.stack([v1, a1 - frame, y[3], a2 - a1])

    def frictions(self) -> tuple[AbstractFriction, AbstractFriction]:
        return self.motor_friction, self.load_friction

    def elastic(self, y: Array) -> tuple[Array, Array]:
        return y[2], jnp.asarray(self.K12)

    def masses(self, payload: Scalar = 0.0) -> tuple[Array, Array]:
        return jnp.asarray(self.M1), jnp.asarray(self.M2 + payload)

    def with_speeds(self, y: Array, v1: Array, v2: Array) -> Array:
        return jnp.stack([y[0], v1, y[2], v2 - v1])

    def inverse(self, motor: Axis, load: Axis) -> tuple[Array, ...]:
        """Equation 2: the motor's row, and the load's, which must be zero."""
        F12 = self.K12 * (load.q - motor.q)
        return (
            self.M1 * motor.a + self.motor_friction(motor.v) + self.offset - F12,
            self.M2 * load.a + self.load_friction(load.v) + F12,
        )

    def accelerations(self, y: Array, dy: Array) -> tuple[Array, Array]:
        return dy[1], dy[1] + dy[3]

    def start(self, q: Scalar, v: Scalar) -> Array:
        return jnp.asarray([q, v, 0.0, 0.0], dtype=float)


def mode(M2: Scalar, K12: Scalar) -> Array:
    """f_n = sqrt(K12 / M2) / (2 pi), Hz: natural frequency with the motor locked. References: paper, eq. 23."""
    return jnp.sqrt(K12 / M2) / (2 * jnp.pi)


def mass_ratio(M1: Scalar, M2: Scalar) -> Array:
    """lam = M1 / (M1 + M2). References: paper, eq. 24."""
    return jnp.asarray(M1 / (M1 + M2))


def split(M: Scalar, lam: Scalar, f_n: Scalar) -> tuple[Array, Array, Array]:
    """(M1, M2, K12) of a total mass M (kg), mass ratio lam and mode f_n (Hz).

    M1 = lam M, M2 = (1 - lam) M, K12 = 4 pi^2 (1 - lam) f_n^2 M.

    References: paper, eq. 26. Equation 29, which starts step 3, is printed without the square on f_n; the 9.13e5 N/m
    of Table 3 is the squared form, so that is what both steps use.
    """
    M1 = jnp.asarray(lam * M)
    M2 = jnp.asarray((1 - lam) * M)
    return M1, M2, M2 * (2 * jnp.pi * f_n) ** 2
