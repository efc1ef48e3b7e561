"""The nominal friction of a diagnosis: Coulomb and viscous, with a sign that may rise more slowly than tanh."""

from typing import Any

import equinox as eqx
from jax import Array

from .._types import Scalar
from ..effects._law import late
from ..params import param, setting
from ..plant import AbstractFriction, AbstractPlant
from ..plant.friction import smooth_sign


class RoundedCoulombViscous(AbstractFriction):
    """F = Fv v + Fc (1 - tail v_eps / (v_eps + |v|)) s(v).

    How a drive's friction passes through rest is no effect: another shape of it than tanh must not be called one. A
    tail of 0 is `CoulombViscous`; 0.5 is near 2/pi atan(v / v_eps). It matters where v_eps is wide, and nowhere else.
    """

    Fv: Scalar = param("N s/m", scale=100.0)
    Fc: Scalar = param("N", scale=10.0)
    v_eps: Scalar = setting("m/s", default=3e-4)  # type: ignore[assignment]
    tail: Scalar = setting("1", default=0.0)

    def split(self, v: Array) -> tuple[Array, Array]:
        return self.Fv * v, self.level(v) * smooth_sign(v, self.v_eps)

    def level(self, v: Array) -> Array:
        return self.Fc * late(v, self.v_eps, self.tail)


def with_sign(plant: AbstractPlant, v_eps: Array, tail: Array) -> AbstractPlant:
    """The plant with this smoothing speed (m/s) and tail in every friction it has."""

    def where(p: AbstractPlant) -> list[Any]:
        frictions = [friction for friction in p.frictions() if isinstance(friction, RoundedCoulombViscous)]
        return [value for friction in frictions for value in (friction.v_eps, friction.tail)]

    return eqx.tree_at(where, plant, [v_eps, tail] * (len(where(plant)) // 2))
