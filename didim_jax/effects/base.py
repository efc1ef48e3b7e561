"""Effects of the frame that carries the axis."""

from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array

from .._types import Scalar
from ..params import param
from ._base import AbstractEffect, Bench, Block, Forces, Probe, Signals


class BaseFlexibility(AbstractEffect):
    """A frame with motor and encoder on a spring: xb'' = -mu tau - w^2 xb - 2 zeta w xb', w = 2 pi f; null mu = 0.

    mu = 1 / frame mass. Positions are measured from the frame. The guides stand on the floor to a share `guides`: their
    friction is that of v + guides xb', and the frame does not feel it.
    """

    block: ClassVar[Block] = Block.BASE
    name: ClassVar[str] = "base_flexibility"
    equation: ClassVar[str] = "mb xb'' = -kb xb - cb xb' - tau; friction of v + guides xb'"
    size: ClassVar[str] = "150-900 kg, 15-45 Hz"
    twins: ClassVar[tuple[str, ...]] = ("coupling_damping", "second_flexible_mode")
    source: ClassVar[str] = "machine on its feet, motor on its bracket"
    mu: Scalar = param("1/kg", scale=1e-3, lower=0.0, upper=0.05, default=0.0)
    f: Scalar = param("Hz", scale=5.0, lower=4.0, upper=90.0, default=25.0)
    zeta: Scalar = param("1", scale=0.02, lower=1e-3, upper=0.5, default=0.02)
    guides: Scalar = param("1", scale=0.5, lower=0.0, upper=1.0, default=1.0)

    def init(self, signals: Signals) -> Any:
        w = 2 * jnp.pi * self.f
        return jnp.stack([-self.mu * signals.force / w**2, 0.0 * signals.q1])  # bent by the force that is there

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        w = 2 * jnp.pi * self.f
        a = -self.mu * signals.force - w * w * x[0] - 2 * self.zeta * w * x[1]
        return Forces(frame=a, slide=self.guides * x[1]), jnp.stack([x[1], a])

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        frequencies = np.geomspace(10.0, 60.0, 20)
        return tuple(Probe({"mu": 1 / 600}, {"f": float(f), "zeta": 0.02, "guides": 0.5}) for f in frequencies)
