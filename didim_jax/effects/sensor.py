"""Effects in the motor encoder."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param, setting
from ._base import AbstractEffect, Bench, Block, Probe, Signals
from ._law import turn


class EncoderGrid(AbstractEffect):
    """qm = resolution * round(q / resolution): an encoder that counts; null resolution = 0 (m).

    For making data. The rounding has no derivative, so it never takes part in a fit.
    """

    block: ClassVar[Block] = Block.SENSOR
    name: ClassVar[str] = "encoder_quantisation"
    equation: ClassVar[str] = "qm = r round(q / r)"
    size: ClassVar[str] = "50 nm-5 um"
    source: ClassVar[str] = "read off the record, not fitted"
    resolution: Scalar = setting("m", default=0.0)

    @classmethod
    def at(cls, bench: Bench) -> "EncoderGrid":
        return cls(bench.grid)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        q = signals.incoming
        counts = self.resolution > 0
        step = jnp.where(counts, self.resolution, 1.0)
        return jnp.where(counts, step * jnp.round(q / step) - q, 0.0), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return ()


class EncoderPeriodicError(AbstractEffect):
    """qm = q + a sin phi + b cos phi, phi = 2 pi q / lead; null a = b = 0. The phase is lost at power-off."""

    block: ClassVar[Block] = Block.SENSOR
    name: ClassVar[str] = "encoder_periodic_error"
    equation: ClassVar[str] = "qm = q + a sin phi + b cos phi"
    size: ClassVar[str] = "0.3-4 um"
    twins: ClassVar[tuple[str, ...]] = ("cogging", "transmission_error")
    source: ClassVar[str] = "eccentric disc, interpolation error"
    a: Scalar = param("m", scale=1e-6, default=0.0)
    b: Scalar = param("m", scale=1e-6, default=0.0)
    lead: Scalar = setting("m", default=0.0025)

    @classmethod
    def at(cls, bench: Bench) -> "EncoderPeriodicError":
        return cls(lead=bench.lead)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        phi = turn(signals.q1, self.lead)
        return self.a * jnp.sin(phi) + self.b * jnp.cos(phi), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"a": 1e-6, "b": 1e-6}),)
