"""The drive as one rigid mass."""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param, part
from ._base import AbstractPlant, Axis
from .friction import AbstractFriction


class RigidDrive(AbstractPlant):
    """tau = M a + F(v) + offset.

    `offset` (N) is a constant force against the motor: a tilted axis, or an error of the drive's zero.

    References: paper, eq. 6-9; the offset is the benchmark authors'.
    """

    M: Scalar = param("kg", positive=True, scale=100.0)
    friction: AbstractFriction = part()
    offset: Scalar = param("N", scale=1.0, default=0.0)

    model: ClassVar[str] = "rigid"
    state_names: ClassVar[tuple[str, ...]] = ("q1", "v1")
    state_scales: ClassVar[tuple[float, ...]] = (1e-5, 1e-3)

    def sides(self, y: Array) -> tuple[Array, Array, Array, Array]:
        return y[0], y[1], y[0], y[1]

    def coupling_force(self, y: Array) -> Array:
        return jnp.zeros_like(y[0])  # a rigid drive has no coupling whose force could be told apart

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
        """Equation 9. A force inside the coupling does no work on a rigid drive."""
        v = y[1]
        force = tau + on_motor + on_load - self.friction(v) - self.offset
        return jnp.stack([v, force / (self.M + payload) - frame])

    def frictions(self) -> tuple[AbstractFriction, None]:
        return self.friction, None

    def elastic(self, y: Array) -> tuple[Array, Array]:
        return jnp.zeros_like(y[0]), jnp.zeros_like(y[0])

    def masses(self, payload: Scalar = 0.0) -> tuple[Array, Array]:
        return jnp.asarray(self.M + payload), jnp.asarray(self.M + payload)

    def with_speeds(self, y: Array, v1: Array, v2: Array) -> Array:
        return jnp.stack([y[0], v1])

    def inverse(self, motor: Axis, load: Axis) -> tuple[Array, ...]:
        """Equation 6."""
        return (self.M * motor.a + self.friction(motor.v) + self.offset,)

    def accelerations(self, y: Array, dy: Array) -> tuple[Array, Array]:
        return dy[1], dy[1]

    def start(self, q: Scalar, v: Scalar) -> Array:
        return jnp.asarray([q, v], dtype=float)
