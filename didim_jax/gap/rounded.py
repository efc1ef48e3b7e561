"""The nominal friction of a diagnosis: Coulomb and viscous, with a sign that may rise more slowly than tanh."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param, setting
from ..plant import AbstractFriction, AbstractPlant
from ..plant.friction import smooth_sign


class RoundedCoulombViscous(AbstractFriction):
    """F = Fv v + Fc s(v), s = (1 - tail - knee) tanh(x) + tail x / (1 + |x|) + knee x / sqrt(1 + x^2), x = v / v_eps.

    How a drive's friction passes through rest is no effect: another shape of it than tanh must not be called one. With
    tail and knee at 0 it is `CoulombViscous`; 0.46 and 0.59 make 2/pi atan(pi x / 2) to half a percent. It matters
    where v_eps is wide, and nowhere else.
    """

    Fv: Scalar = param("N s/m", scale=100.0)
    Fc: Scalar = param("N", scale=10.0)
    v_eps: Scalar = setting("m/s", default=3e-4)  # type: ignore[assignment]
    tail: Scalar = setting("1", default=0.0)
    knee: Scalar = setting("1", default=0.0)

    def split(self, v: Array) -> tuple[Array, Array]:
        return self.Fv * v, self.level(v) * smooth_sign(v, self.v_eps)

    def level(self, v: Array) -> Array:
        x = jnp.abs(v) / self.v_eps
        square = x * x
        coth = jnp.sqrt(square + 1 / (1 + square / 3 + square * square * (2 / 45)))  # x / tanh(x) to 0.3 %, and faster
        rises = self.tail / (1 + x) + self.knee / jnp.sqrt(1 + square)
        return self.Fc * (1 - self.tail - self.knee + rises * coth)


SHAPE = ("v_eps", "tail", "knee")
"""What belongs to the sign, and to every friction of a plant alike."""


def with_sign(plant: AbstractPlant, shape: Array) -> AbstractPlant:
    """The plant with these values of `SHAPE` in every friction it has, (3,)."""

    def where(p: AbstractPlant) -> list[Any]:
        frictions = [friction for friction in p.frictions() if isinstance(friction, RoundedCoulombViscous)]
        return [getattr(friction, name) for friction in frictions for name in SHAPE]

    return eqx.tree_at(where, plant, list(shape) * (len(where(plant)) // len(SHAPE)))
