"""What the loop asks of a plant, and nothing more."""

import abc

import equinox as eqx
import jax.numpy as jnp
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

    The state is a vector of pairs, a position and its velocity: (q1, v1) of the motor side, then what the plant adds.
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
    def masses(self, payload: Scalar = 0.0) -> tuple[Array, Array]:
        """Mass (kg) that a force on the motor side and one on the load side accelerate; the payload is on the load."""

    @abc.abstractmethod
    def with_speeds(self, y: Array, v1: Array, v2: Array) -> Array:
        """The state with these velocities (m/s) of the two sides; a rigid drive has that of the motor side."""

    @abc.abstractmethod
    def inverse(self, motor: Axis, load: Axis) -> tuple[Array, ...]:
        """Inverse dynamic model: motor force (N), then every row that must be zero; linear in the parameters."""

    @abc.abstractmethod
    def accelerations(self, y: Array, dy: Array) -> tuple[Array, Array]:
        """(a1, a2) from the state and its derivative."""

    @abc.abstractmethod
    def start(self, q: Scalar, v: Scalar) -> Array:
        """State with both sides at position q (m) and velocity v (m/s)."""


class _Rolling(AbstractFriction):
    """Another friction's viscous part alone."""

    v_eps: Array
    friction: AbstractFriction

    def split(self, v: Array) -> tuple[Array, Array]:
        return self.friction.split(v)[0], jnp.zeros_like(v)

    def level(self, v: Array) -> Array:
        return jnp.zeros_like(v)


def without_coulomb[P: AbstractPlant](plant: P) -> P:
    """The plant with viscous friction alone."""

    def where(p: P) -> list[AbstractFriction]:
        return [friction for friction in p.frictions() if friction is not None]

    return eqx.tree_at(where, plant, [_Rolling(friction.v_eps, friction) for friction in where(plant)])
