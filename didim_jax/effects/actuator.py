"""Effects between the command and the force: amplifier, motor, and the forces of the motor's own magnets."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array

from .._types import Scalar
from ..params import param, setting
from ._base import AbstractEffect, Bench, Block, Probe, Signals
from ._law import power, remembered, turn

_LONGEST_DELAY = 6
"""Samples that a delay may have."""

_TIMING = MappingProxyType({"T": 5e-5})
"""When within a sample the drive takes its command over is the machine's own."""

_LATE = tuple(Probe({"T": T}, linear=False) for T in (3e-4, 1e-3, 2.5e-3))
"""Where lag and delay are looked for: twins, from the same starts."""


class AmplifierLag(AbstractEffect):
    """T F' + F = F_command under a held command, as its mean over each sample; null T = 0.

    mean = u + (F - u) r (1 - a), F[k+1] = u + (F - u) a, r = T / dt, a = exp(-1 / r). A little less than 0 is a command
    that is taken over early, against the encoder.
    """

    block: ClassVar[Block] = Block.ACTUATOR
    name: ClassVar[str] = "amplifier_lag"
    equation: ClassVar[str] = "T tau' + tau = g vir"
    size: ClassVar[str] = "0.2-3 ms"
    twins: ClassVar[tuple[str, ...]] = ("time_delay",)
    source: ClassVar[str] = "current loop of the amplifier"
    least: ClassVar[Mapping[str, float]] = _TIMING
    sampled: ClassVar[bool] = True
    T: Scalar = param("s", scale=1e-3, lower=-5e-5, upper=2e-2, default=0.0)

    def init(self, signals: Signals) -> Any:
        return 0.0 * signals.q1 + signals.force

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        a = remembered(self.T, signals.dt)
        behind = x - signals.incoming
        return behind * (self.T / signals.dt) * (1 - a), signals.incoming + behind * a

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return _LATE


class TimeDelay(AbstractEffect):
    """tau(t) = g vir(t - T) under a held command, as its mean over each sample; null T = 0, at most six samples."""

    block: ClassVar[Block] = Block.ACTUATOR
    name: ClassVar[str] = "time_delay"
    equation: ClassVar[str] = "tau = g vir(t - T)"
    size: ClassVar[str] = "0.2-3 ms"
    twins: ClassVar[tuple[str, ...]] = ("amplifier_lag",)
    source: ClassVar[str] = "bus and computation time"
    least: ClassVar[Mapping[str, float]] = _TIMING
    sampled: ClassVar[bool] = True
    T: Scalar = param("s", scale=1e-3, lower=0.0, upper=6e-3, default=0.0)

    def init(self, signals: Signals) -> Any:
        return jnp.zeros(_LONGEST_DELAY) + signals.force

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        past = jnp.concatenate([signals.incoming[None], x])
        r, i = jnp.minimum(self.T / signals.dt, _LONGEST_DELAY), np.arange(len(past))
        rising = jnp.where((i > 0) & (r >= i - 1) & (r < i), r - (i - 1), 0.0)
        weights = rising + jnp.where((r >= i) & (r < i + 1), i + 1 - r, 0.0)
        return jnp.sum(weights * (past - signals.incoming)), past[:-1]

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return _LATE


class Saturation(AbstractEffect):
    """|tau| = g (b + s (1 - exp(-(|vir| - b) / s))) above b = limit (1 - soft), s = limit soft.

    Below b nothing is lost; far above it g limit is all there is. soft = 0 is a hard limit. Null: the documented limit.
    """

    block: ClassVar[Block] = Block.ACTUATOR
    name: ClassVar[str] = "saturation"
    equation: ClassVar[str] = "tau = g clip(vir, -limit, limit), corner rounded over soft limit"
    size: ClassVar[str] = "below the documented limit"
    source: ClassVar[str] = "current limit of the amplifier"
    sampled: ClassVar[bool] = True
    limit: Scalar = param("V", scale=1.0, lower=0.05, default=jnp.inf)
    soft: Scalar = param("1", scale=0.1, lower=0.0, upper=0.4, default=0.0)

    @classmethod
    def at(cls, bench: Bench) -> "Saturation":
        return cls(limit=bench.limit)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        most = signals.gain * jnp.minimum(self.limit, 1e9)
        u = signals.incoming
        beyond = jnp.abs(u) - most * (1 - self.soft)
        over = jnp.where(beyond > 0, beyond, 0.0)  # nothing at all up to the corner
        s = most * jnp.maximum(self.soft, 1e-6)
        return -jnp.sign(u) * jnp.where(self.soft > 1e-6, over - s * (1 - jnp.exp(-over / s)), over), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        sorted_volts = np.quantile(np.abs(bench.volts), [0.9, 0.96, 0.985, 0.995, 0.999])
        limits = [min(float(v), 0.98 * bench.limit) for v in sorted_volts]
        return (
            *(Probe({"limit": v}, linear=False) for v in limits),
            *(Probe({"limit": v, "soft": 0.2}, linear=False) for v in (limits[2], limits[4])),
        )


class AmplifierDeadZone(AbstractEffect):
    """The first `d` volts of the command are lost: tau = g (vir - clip(vir, -d, d)); null d = 0."""

    block: ClassVar[Block] = Block.ACTUATOR
    name: ClassVar[str] = "amplifier_dead_zone"
    equation: ClassVar[str] = "tau = g (vir - clip(vir, -d, d))"
    size: ClassVar[str] = "10-250 mV"
    twins: ClassVar[tuple[str, ...]] = ("backlash",)
    source: ClassVar[str] = "crossover of the output stage"
    sampled: ClassVar[bool] = True
    d: Scalar = param("V", scale=0.05, lower=0.0, upper=2.0, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        lost = signals.gain * self.d
        u = signals.incoming
        return -jnp.where(jnp.abs(u) > lost, jnp.sign(u) * lost, u), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return Probe({"d": 0.03}, linear=False), Probe({"d": 0.12}, linear=False)


_BEND = 3.0  # V


class GainNonlinearity(AbstractEffect):
    """tau = g vir (1 - k u0 (|vir| / u0)^p), u0 = 3 V; null k = 0.

    p = 1 loses k per volt, p = 2 is the beginning of a hyperbolic tangent.
    """

    block: ClassVar[Block] = Block.ACTUATOR
    name: ClassVar[str] = "gain_nonlinearity"
    equation: ClassVar[str] = "tau = g vir (1 - k u0 (|vir| / u0)^p), u0 = 3 V"
    size: ClassVar[str] = "0-3 %/V"
    source: ClassVar[str] = "saturating magnetic circuit"
    sampled: ClassVar[bool] = True
    k: Scalar = param("1/V", scale=0.01, lower=-0.09, upper=0.09, default=0.0)
    p: Scalar = param("1", scale=0.5, lower=0.7, upper=2.2, default=1.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        u = signals.incoming
        return -self.k * _BEND * power(u / signals.gain, _BEND, self.p) * u, x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return tuple(Probe({"k": 0.01}, {"p": p}) for p in (1.0, 2.0))


class DriveGain(AbstractEffect):
    """tau = g (1 + e) vir; null e = 0. Masses, friction and stiffness absorb it exactly."""

    block: ClassVar[Block] = Block.ACTUATOR
    name: ClassVar[str] = "drive_gain"
    equation: ClassVar[str] = "tau = (1 + e) g vir"
    size: ClassVar[str] = "any: it cannot be seen"
    source: ClassVar[str] = "torque constant, drive calibration"
    sampled: ClassVar[bool] = True
    e: Scalar = param("1", scale=0.03, lower=-0.5, upper=0.5, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        return self.e * signals.incoming, x


class Cogging(AbstractEffect):
    """F = -sum over n = 1, 2 of (a_n sin n phi + b_n cos n phi), phi = 2 pi q1 / lead; null a = b = 0."""

    block: ClassVar[Block] = Block.ACTUATOR
    name: ClassVar[str] = "cogging"
    equation: ClassVar[str] = "-sum(a_n sin n phi + b_n cos n phi)"
    size: ClassVar[str] = "0.7-4 N"
    twins: ClassVar[tuple[str, ...]] = ("encoder_periodic_error", "transmission_error")
    source: ClassVar[str] = "slots of the motor, pitch of the screw"
    a1: Scalar = param("N", scale=2.0, default=0.0)
    b1: Scalar = param("N", scale=2.0, default=0.0)
    a2: Scalar = param("N", scale=1.0, default=0.0)
    b2: Scalar = param("N", scale=1.0, default=0.0)
    lead: Scalar = setting("m", default=0.0025)

    @classmethod
    def at(cls, bench: Bench) -> "Cogging":
        return cls(lead=bench.lead)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        phi = turn(signals.q1, self.lead)
        sin, cos = jnp.sin(phi), jnp.cos(phi)
        twice = self.a2 * 2 * sin * cos + self.b2 * (cos * cos - sin * sin)
        return -(self.a1 * sin + self.b1 * cos + twice), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"a1": 2.0, "b1": 2.0, "a2": 1.0, "b2": 1.0}),)
