"""Effects in the controller: it does not compute what its documentation says. Volts, once per sample."""

from typing import Any, ClassVar

from jax import Array

from .._types import Scalar
from ..params import param
from ._base import AbstractEffect, Bench, Block, Probe, Signals
from ._law import remembered


class PositionGain(AbstractEffect):
    """vir = kv (kp (1 + e) (qg - qm) - dq); null e = 0."""

    block: ClassVar[Block] = Block.CONTROLLER
    name: ClassVar[str] = "position_gain"
    equation: ClassVar[str] = "kp (1 + e)"
    size: ClassVar[str] = "0.5-8 %"
    source: ClassVar[str] = "control-law residual"
    e: Scalar = param("1", scale=0.01, lower=-0.5, upper=0.5, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        return self.e * signals.law_position, x


class VelocityGain(AbstractEffect):
    """vir = kv (1 + e) (kp (qg - qm) - dq); null e = 0."""

    block: ClassVar[Block] = Block.CONTROLLER
    name: ClassVar[str] = "velocity_gain"
    equation: ClassVar[str] = "kv (1 + e)"
    size: ClassVar[str] = "0.5-8 %"
    twins: ClassVar[tuple[str, ...]] = ("velocity_filter",)
    source: ClassVar[str] = "control-law residual"
    e: Scalar = param("1", scale=0.01, lower=-0.5, upper=0.5, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        return self.e * signals.incoming, x


class VelocityFilter(AbstractEffect):
    """dqf[k] = a dqf[k-1] + (1 - a) dq[k], a = exp(-dt / T): a first-order filter on the velocity; null T = 0."""

    block: ClassVar[Block] = Block.CONTROLLER
    name: ClassVar[str] = "velocity_filter"
    equation: ClassVar[str] = "T dqf' + dqf = dq"
    size: ClassVar[str] = "0.2-3 ms"
    twins: ClassVar[tuple[str, ...]] = ("velocity_gain",)
    source: ClassVar[str] = "control-law residual"
    T: Scalar = param("s", scale=5e-4, lower=0.0, upper=2e-2, default=0.0)

    def init(self, signals: Signals) -> Any:
        return 0.0 * signals.q1 + signals.law_velocity  # settled, as in a motion that has been going on

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        a = remembered(self.T, signals.dt)
        filtered = signals.law_velocity + a * (x - signals.law_velocity)
        return filtered - signals.law_velocity, filtered

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"T": bench.dt}),)
