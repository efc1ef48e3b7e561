"""Effects in the coupling. N added to its force on the motor side, K12 delta, and taken from the load side."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param, setting
from ._base import AbstractEffect, Bench, Block, Probe, Signals
from ._law import turn

_SLIDES = 1e-3  # m/s


class CouplingDamping(AbstractEffect):
    """F12 = K12 delta + C delta' + eta K12 |delta| delta' / sqrt(delta'^2 + v_s^2): viscous damping, or a loss factor.

    C comes above the few tens of N s/m that every coupling has. The second part loses the same share of energy at every
    frequency, as rubber does (T. J. Reid, J. Royal Aeronautical Society 60, 1956); v_s = 1 mm/s. Null C = eta = 0.
    """

    block: ClassVar[Block] = Block.COUPLING
    name: ClassVar[str] = "coupling_damping"
    equation: ClassVar[str] = "C delta' + eta K12 |delta| sign(delta')"
    size: ClassVar[str] = "100-1200 N s/m"
    twins: ClassVar[tuple[str, ...]] = ("base_flexibility",)
    source: ClassVar[str] = "elastomer coupling"
    C: Scalar = param("N s/m", scale=200.0, lower=-10.0, upper=6000.0, default=0.0)
    eta: Scalar = param("1", scale=0.05, lower=0.0, upper=0.5, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        rate = signals.v2 - signals.v1
        lost = self.eta * signals.stiffness * jnp.abs(signals.deflection)
        return self.C * rate + lost * rate / jnp.sqrt(rate**2 + _SLIDES**2), x


class CubicStiffness(AbstractEffect):
    """F12 = K12 delta (1 + k3 u^2 / (1 + (delta / reach)^2)), u = delta / 50 um; k3 < 0 allowed; null k3 = 0.

    A long reach is a cubic spring; beyond a short one the stiffness is another, and constant.
    """

    block: ClassVar[Block] = Block.COUPLING
    name: ClassVar[str] = "cubic_stiffness"
    equation: ClassVar[str] = "K12 delta (1 + k3 (delta / 50 um)^2 / (1 + (delta / reach)^2))"
    size: ClassVar[str] = "0.01-0.4"
    twins: ClassVar[tuple[str, ...]] = ("backlash",)
    source: ClassVar[str] = "hardening coupling"
    k3: Scalar = param("1", scale=0.03, lower=-1.0, upper=3.0, default=0.0)
    reach: Scalar = param("m", scale=1e-4, lower=2e-5, upper=5e-3, default=1e-3)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        d = signals.deflection
        return self.k3 * signals.stiffness * d * (d / 5e-5) ** 2 / (1 + (d / self.reach) ** 2), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return Probe({"k3": 0.03}, {"reach": 1e-3}), Probe({"k3": 0.1}, {"reach": 6e-5})


class Backlash(AbstractEffect):
    """F12 = K12 (delta - clip(delta, -b, b)): a dead zone of width 2 b; null b = 0."""

    block: ClassVar[Block] = Block.COUPLING
    name: ClassVar[str] = "backlash"
    equation: ClassVar[str] = "K12 (delta - clip(delta, -b, b))"
    size: ClassVar[str] = "b 1-20 um"
    twins: ClassVar[tuple[str, ...]] = ("cubic_stiffness",)
    source: ClassVar[str] = "worn nut, keyed shaft"
    b: Scalar = param("m", scale=5e-6, lower=0.0, upper=2e-4, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        d = signals.deflection
        return -signals.stiffness * jnp.where(jnp.abs(d) > self.b, jnp.sign(d) * self.b, d), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return tuple(Probe({"b": b}, linear=False) for b in (1.5e-6, 5e-6, 1e-5, 1.8e-5, 3e-5))


class TransmissionError(AbstractEffect):
    """F12 = K12 (delta - a sin phi - b cos phi), phi = 2 pi q1 / lead; null a = b = 0."""

    block: ClassVar[Block] = Block.COUPLING
    name: ClassVar[str] = "transmission_error"
    equation: ClassVar[str] = "K12 (delta - a sin phi - b cos phi)"
    size: ClassVar[str] = "1-6 um"
    twins: ClassVar[tuple[str, ...]] = ("cogging", "encoder_periodic_error")
    source: ClassVar[str] = "wobble of the screw, eccentric gear"
    a: Scalar = param("m", scale=2e-6, default=0.0)
    b: Scalar = param("m", scale=2e-6, default=0.0)
    lead: Scalar = setting("m", default=0.0025)

    @classmethod
    def at(cls, bench: Bench) -> "TransmissionError":
        return cls(lead=bench.lead)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        phi = turn(signals.q1, self.lead)
        return -signals.stiffness * (self.a * jnp.sin(phi) + self.b * jnp.cos(phi)), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"a": 2e-6, "b": 2e-6}),)
