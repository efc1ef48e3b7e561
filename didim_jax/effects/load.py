"""Effects on the load side: masses that the nominal plant does not have."""

from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array

from .._types import Scalar
from ..params import param
from ._base import AbstractEffect, Bench, Block, Forces, Probe, Signals
from ._law import passed


class SecondFlexibleMode(AbstractEffect):
    """Part of the load, m3, hangs on a spring: F = m3 (w^2 (q3 - q2) + 2 zeta w (v3 - v2)), w = 2 pi f3; null m3 = 0.

    m3 q3'' = -F, and M2 - m3 is what moves with q2: M2 stays the whole load.
    """

    block: ClassVar[Block] = Block.LOAD_SIDE
    name: ClassVar[str] = "second_flexible_mode"
    equation: ClassVar[str] = "m3 q3'' = -K23 (q3 - q2) - C23 (v3 - v2)"
    size: ClassVar[str] = "2-14 kg, 25-65 Hz"
    twins: ClassVar[tuple[str, ...]] = ("base_flexibility",)
    source: ClassVar[str] = "tool, table or arm on the carriage"
    m3: Scalar = param("kg", scale=5.0, lower=0.0, upper=60.0, default=0.0)
    f3: Scalar = param("Hz", scale=5.0, lower=8.0, upper=110.0, default=40.0)
    zeta: Scalar = param("1", scale=0.02, lower=1e-3, upper=0.5, default=0.01)

    def init(self, signals: Signals) -> Any:
        return jnp.stack([0.0 * signals.q1 + signals.q2, 0.0 * signals.q1 + signals.v2])

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        w = 2 * jnp.pi * self.f3
        pull = w * w * (x[0] - signals.q2) + 2 * self.zeta * w * (x[1] - signals.v2)
        return Forces(load=self.m3 * pull, payload=-self.m3), jnp.stack([x[1], -pull])

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        frequencies = np.geomspace(15.0, 80.0, 22)
        return tuple(Probe({"m3": 4.0}, {"f3": float(f3), "zeta": 0.015}) for f3 in frequencies)


class PayloadChange(AbstractEffect):
    """M2 becomes M2 + dm at t0; null dm = 0."""

    block: ClassVar[Block] = Block.LOAD_SIDE
    name: ClassVar[str] = "payload_change"
    equation: ClassVar[str] = "M2 + dm H(t - t0)"
    size: ClassVar[str] = "2-14 kg"
    twins: ClassVar[tuple[str, ...]] = ("friction_drift",)
    source: ClassVar[str] = "a part taken or put down"
    own_to_record: ClassVar[tuple[str, ...]] = ("t0",)
    dm: Scalar = param("kg", scale=4.0, lower=-25.0, upper=60.0, default=0.0)
    t0: Scalar = param("s", scale=1.0, default=5.0)

    @classmethod
    def at(cls, bench: Bench) -> "PayloadChange":
        return cls(t0=0.5 * bench.duration)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        return Forces(payload=self.dm * passed(signals.held_since, signals.dt, self.t0)), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        shares = np.linspace(0.05, 0.95, 19)
        return tuple(Probe({"dm": 4.0}, {"t0": float(share) * bench.duration}) for share in shares)
