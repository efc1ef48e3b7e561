"""Friction of one side of the drive, linear in its parameters, with a smooth sign of stated speed."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param, setting

V_EPS = 1e-3
"""Speed (m/s) at which the smooth sign has reached tanh(1) = 0.76; sign(v) is its limit for v_eps to 0."""


def smooth_sign(v: Array, v_eps: Scalar) -> Array:
    """s(v) = tanh(v / v_eps): sign(v) away from rest, differentiable through it."""
    return jnp.tanh(v / v_eps)


class AbstractFriction(eqx.Module):
    """A friction force (N) that opposes the velocity (m/s): positive force for positive velocity."""

    v_eps: eqx.AbstractVar[Array]

    def __call__(self, v: Array) -> Array:
        """Friction force in N at velocity v in m/s."""
        viscous, coulomb = self.split(v)
        return viscous + coulomb

    @abc.abstractmethod
    def split(self, v: Array) -> tuple[Array, Array]:
        """(viscous part, Coulomb part) of that force, N."""

    @abc.abstractmethod
    def level(self, v: Array) -> Array:
        """Coulomb part without its sign, N: what holds at rest too."""


class CoulombViscous(AbstractFriction):
    """F = Fv v + Fc s(v).

    References: paper, eq. 2 and 6.
    """

    Fv: Scalar = param("N s/m", scale=100.0)
    Fc: Scalar = param("N", scale=10.0)
    v_eps: Scalar = setting("m/s", default=V_EPS)  # type: ignore[assignment]

    def split(self, v: Array) -> tuple[Array, Array]:
        return self.Fv * v, self.Fc * smooth_sign(v, self.v_eps)

    def level(self, v: Array) -> Array:
        return self.Fc + jnp.zeros_like(v)


class AsymmetricCoulombViscous(AbstractFriction):
    """F = s+ (Fv_pos v + Fc_pos s) + s- (Fv_neg v + Fc_neg s), with s+ = (1 + s)/2 and s- = (1 - s)/2.

    With both sides equal this is `CoulombViscous` exactly.

    References: Janot, Gautier, Brunot, *Data Set and Reference Models of EMPS*, 2019.
    """

    Fv_pos: Scalar = param("N s/m", scale=100.0)
    Fc_pos: Scalar = param("N", scale=10.0)
    Fv_neg: Scalar = param("N s/m", scale=100.0)
    Fc_neg: Scalar = param("N", scale=10.0)
    v_eps: Scalar = setting("m/s", default=V_EPS)  # type: ignore[assignment]

    def split(self, v: Array) -> tuple[Array, Array]:
        s = smooth_sign(v, self.v_eps)
        forward, backward = 0.5 * (1 + s), 0.5 * (1 - s)
        viscous = forward * (self.Fv_pos * v) + backward * (self.Fv_neg * v)
        coulomb = forward * (self.Fc_pos * s) + backward * (self.Fc_neg * s)
        return viscous, coulomb

    def level(self, v: Array) -> Array:
        s = smooth_sign(v, self.v_eps)
        return 0.5 * (1 + s) * self.Fc_pos + 0.5 * (1 - s) * self.Fc_neg
