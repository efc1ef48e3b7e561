"""What the loop asks of a plant, and nothing more."""

import abc

import equinox as eqx
from jax import Array

from .._types import Scalar
from .friction import AbstractFriction


class Axis(eqx.Module):
    """Position (m), velocity (m/s) and, where known, acceleration (m/s2) of one side of the drive."""

    q: Array
    v: Array
    a: Array


class AbstractPlant(eqx.Module):
    """A drive in SI units on the load axis: motor side 1, load side 2, forces positive along q.

    The state is a vector: (q1, v1) of the motor side, then whatever the plant adds.
    """

    model: eqx.AbstractClassVar[str]
    state_names: eqx.AbstractClassVar[tuple[str, ...]]
    state_scales: eqx.AbstractClassVar[tuple[float, ...]]

    @abc.abstractmethod
    def sides(self, y: Array) -> tuple[Array, Array, Array, Array]:
        """(q1, v1, q2, v2) of the state."""

    @abc.abstractmethod
    def coupling_force(self, y: Array) -> Array:
        """Force (N) that the coupling exerts on the motor side, and with the other sign on the load side."""

    @abc.abstractmethod
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
        """dy/dt under the motor force tau and what effects add.

        Forces on each block (N), the frame's acceleration (m/s2), a mass on the load side (kg).
        """

    @abc.abstractmethod
    def frictions(self) -> tuple[AbstractFriction | None, AbstractFriction | None]:
        """Friction of the motor side and of the load side; None where that side has none of its own."""

    @abc.abstractmethod
    def elastic(self, y: Array) -> tuple[Array, Array]:
        """Deflection of the coupling (m) and its stiffness (N/m); zeros for a plant without one."""

    @abc.abstractmethod
    def inverse(self, motor: Axis, load: Axis) -> tuple[Array, ...]:
        """Inverse dynamic model: motor force (N), then every row that must be zero; linear in the parameters."""

    @abc.abstractmethod
    def accelerations(self, y: Array, dy: Array) -> tuple[Array, Array]:
        """(a1, a2) from the state and its derivative."""

    @abc.abstractmethod
    def start(self, q: Scalar, v: Scalar) -> Array:
        """State with both sides at position q (m) and velocity v (m/s)."""
