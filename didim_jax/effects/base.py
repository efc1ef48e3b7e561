"""Effects of the frame that carries the axis."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param
from ._base import AbstractEffect, Bench, Block, Probe, Signals


class BaseFlexibility(AbstractEffect):
    """A frame on a spring: xb'' = -mu R - w^2 xb - 2 zeta w xb', R the axis's force on it, w = 2 pi f; null mu = 0.

    mu = 1 / frame mass. R = motor force less friction; the positions are measured from the frame.
    """

    block: ClassVar[Block] = Block.BASE
    name: ClassVar[str] = "base_flexibility"
    equation: ClassVar[str] = "mb xb'' = -kb xb - cb xb' - (tau - friction)"
    size: ClassVar[str] = "150-900 kg, 15-45 Hz"
    twins: ClassVar[tuple[str, ...]] = ("coupling_damping", "second_flexible_mode")
    source: ClassVar[str] = "machine on its feet"
    mu: Scalar = param("1/kg", scale=1e-3, lower=0.0, upper=0.05, default=0.0)
    f: Scalar = param("Hz", scale=5.0, lower=4.0, upper=90.0, default=25.0)
    zeta: Scalar = param("1", scale=0.02, lower=1e-3, upper=0.5, default=0.02)

    def init(self, signals: Signals) -> Any:
        return jnp.zeros(2) * signals.q1

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        w = 2 * jnp.pi * self.f
        friction = signals.coulomb1 + signals.viscous1 + signals.coulomb2 + signals.viscous2
        a = -self.mu * (signals.force - friction) - w * w * x[0] - 2 * self.zeta * w * x[1]
        return a, jnp.stack([x[1], a])

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return tuple(Probe({"mu": 1 / 600}, {"f": f, "zeta": 0.02}) for f in (12.0, 16.0, 20.0, 25.0, 31.0, 39.0))
