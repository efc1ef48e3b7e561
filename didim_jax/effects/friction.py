"""Friction beyond Coulomb and viscous, each one force that opposes the motion."""

import abc
from typing import Any, ClassVar

import jax.numpy as jnp
from jax import Array

from .._types import Scalar
from ..params import param, setting
from ._base import AbstractEffect, Bench, Block, Forces, Probe, Signals
from ._law import power, turn


class AbstractSidedEffect(AbstractEffect):
    """Friction of which `load_share` rubs on the load side, the rest on the motor side.

    Which one shows near the mode, in the deflection, and where friction holds. The deflection itself is micrometres, so
    q and v are the motor's for both.
    """

    block: ClassVar[Block] = Block.MOTOR_SIDE
    load_share: Scalar = param("1", scale=0.5, lower=0.0, upper=1.0, default=0.5)

    def sides(self, f: Array, signals: Signals) -> tuple[Array, Array]:
        """f on the motor side and on the load side; a rigid drive has one side."""
        share = jnp.where(signals.stiffness == 0, 0.0, self.load_share)
        return (1 - share) * f, share * f


class AbstractGripEffect(AbstractSidedEffect):
    """A friction g(q, v) s that opposes the motion like Coulomb friction, and at rest holds."""

    @abc.abstractmethod
    def grip(self, q: Array, v: Array, signals: Signals) -> Array:
        """g (N) at q (m) and v (m/s) of the motor side."""

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        motor, load = self.sides(self.grip(signals.q1, signals.v1, signals), signals)
        return Forces(grip_motor=motor, grip_load=load), x


class AsymmetricCoulomb(AbstractSidedEffect):
    """f = dFc tanh(|v| / v0) (1 - tail v0 / (v0 + |v|)): Coulomb friction larger in one direction; null dFc = 0.

    None at rest, from where it comes up over v0: as tanh does, or with a tail more slowly.
    """

    name: ClassVar[str] = "asymmetric_coulomb"
    equation: ClassVar[str] = "-dFc tanh(|v| / v0) (1 - tail v0 / (v0 + |v|))"
    size: ClassVar[str] = "1-5 N"
    twins: ClassVar[tuple[str, ...]] = ("offset",)
    source: ClassVar[str] = "Janot, Gautier, Brunot, EMPS benchmark, 2019"
    dFc: Scalar = param("N", scale=2.0, default=0.0)
    v0: Scalar = param("m/s", scale=3e-4, lower=1e-5, upper=5e-3, default=3e-4)
    tail: Scalar = param("1", scale=0.5, lower=0.0, upper=1.0, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        speed = jnp.abs(signals.v1)
        rises = jnp.tanh(speed / self.v0) * (1 - self.tail * self.v0 / (self.v0 + speed))
        motor, load = self.sides(-self.dFc * rises, signals)
        return Forces(motor=motor, load=load), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"dFc": 2.0}),)


class AsymmetricViscous(AbstractSidedEffect):
    """f = dFv (|v| - v0 (1 - e^(-|v| / v0))): viscous friction larger in one direction, from v0 on; null dFv = 0."""

    name: ClassVar[str] = "asymmetric_viscous"
    equation: ClassVar[str] = "-dFv (|v| - v0 (1 - exp(-|v| / v0)))"
    size: ClassVar[str] = "15-60 N s/m"
    twins: ClassVar[tuple[str, ...]] = ("offset",)
    source: ClassVar[str] = "Janot, Gautier, Brunot, EMPS benchmark, 2019"
    dFv: Scalar = param("N s/m", scale=30.0, default=0.0)
    v0: Scalar = param("m/s", scale=3e-3, lower=1e-5, upper=0.03, default=1e-4)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        speed = jnp.abs(signals.v1)
        motor, load = self.sides(-self.dFv * (speed + self.v0 * jnp.expm1(-speed / self.v0)), signals)
        return Forces(motor=motor, load=load), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"dFv": 30.0}),)


class Stribeck(AbstractGripEffect):
    """f = dFs exp(-(|v| / vs)^a) s: excess of friction over Coulomb near rest, dFs < 0 allowed; null dFs = 0."""

    name: ClassVar[str] = "stribeck"
    equation: ClassVar[str] = "-dFs exp(-(|v| / vs)^a) s"
    size: ClassVar[str] = "2-11 N, 4-30 mm/s"
    twins: ClassVar[tuple[str, ...]] = ("presliding", "quadratic_viscous")
    source: ClassVar[str] = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994"
    dFs: Scalar = param("N", scale=5.0, default=0.0)
    vs: Scalar = param("m/s", scale=0.01, lower=1.5e-3, upper=0.04, default=0.015)
    a: Scalar = param("1", scale=1.0, lower=0.6, upper=2.5, default=1.5)

    def grip(self, q: Array, v: Array, signals: Signals) -> Array:
        return self.dFs * jnp.exp(-power(v, self.vs, self.a))

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return tuple(Probe({"dFs": 4.0}, {"vs": vs, "a": a}) for vs, a in ((0.006, 1.0), (0.015, 1.5), (0.03, 2.0)))


class QuadraticViscous(AbstractGripEffect):
    """f = c v_r^2 (|v| / v_r)^p s, v_r = 0.1 m/s: c v |v| for p = 2; null c = 0."""

    name: ClassVar[str] = "quadratic_viscous"
    equation: ClassVar[str] = "-c v_r^2 (|v| / v_r)^p s, v_r = 0.1 m/s"
    size: ClassVar[str] = "200-1200 N s2/m2"
    twins: ClassVar[tuple[str, ...]] = ("stribeck",)
    source: ClassVar[str] = "churning of lubricant, fans"
    c: Scalar = param("N s2/m2", scale=300.0, default=0.0)
    p: Scalar = param("1", scale=0.5, lower=1.4, upper=3.5, default=2.0)

    def grip(self, q: Array, v: Array, signals: Signals) -> Array:
        return self.c * 0.01 * power(v, 0.1, self.p)

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"c": 300.0}),)


class PositionFriction(AbstractGripEffect):
    """f = (sum of c_n P_n(x), n = 1...4) s, Legendre polynomials of x = (q - middle) / half stroke; null c = 0."""

    name: ClassVar[str] = "position_friction"
    equation: ClassVar[str] = "-(sum c_n P_n(x)) s"
    size: ClassVar[str] = "1-5 N"
    twins: ClassVar[tuple[str, ...]] = ("local_friction",)
    source: ClassVar[str] = "misaligned guides, preload that varies along the screw"
    c1: Scalar = param("N", scale=2.0, default=0.0)
    c2: Scalar = param("N", scale=2.0, default=0.0)
    c3: Scalar = param("N", scale=2.0, default=0.0)
    c4: Scalar = param("N", scale=2.0, default=0.0)
    middle: Scalar = setting("m", default=0.05)
    half_stroke: Scalar = setting("m", default=0.05)

    @classmethod
    def at(cls, bench: Bench) -> "PositionFriction":
        return cls(middle=bench.middle, half_stroke=bench.half_stroke)

    def grip(self, q: Array, v: Array, signals: Signals) -> Array:
        x = (q - self.middle) / self.half_stroke
        even = self.c2 * 0.5 * (3 * x**2 - 1) + self.c4 * 0.125 * (35 * x**4 - 30 * x**2 + 3)
        return self.c1 * x + self.c3 * 0.5 * (5 * x**3 - 3 * x) + even

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"c1": 2.0, "c2": 2.0, "c3": 2.0, "c4": 2.0}),)


class LocalFriction(AbstractGripEffect):
    """f = A exp(-((q - q0) / w)^2) s: a tight or a dirty spot; null A = 0."""

    name: ClassVar[str] = "local_friction"
    equation: ClassVar[str] = "-A exp(-((q - q0) / w)^2) s"
    size: ClassVar[str] = "1-9 N, 5-30 mm"
    twins: ClassVar[tuple[str, ...]] = ("position_friction",)
    source: ClassVar[str] = "dent, chip or dry spot on a guide"
    A: Scalar = param("N", scale=4.0, default=0.0)
    q0: Scalar = param("m", scale=0.02, default=0.05)
    w: Scalar = param("m", scale=0.01, lower=1e-3, upper=0.035, default=0.01)

    @classmethod
    def at(cls, bench: Bench) -> "LocalFriction":
        return cls(q0=bench.middle)

    def grip(self, q: Array, v: Array, signals: Signals) -> Array:
        return self.A * jnp.exp(-(((q - self.q0) / self.w) ** 2))

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        places = [bench.q_low + (bench.q_high - bench.q_low) * x for x in (0.08, 0.22, 0.36, 0.5, 0.64, 0.78, 0.92)]
        return tuple(Probe({"A": 4.0}, {"q0": q0, "w": w}) for w in (0.007, 0.018) for q0 in places)


class LeadFriction(AbstractGripEffect):
    """f = (a sin phi + b cos phi) s, phi = 2 pi q / lead; null a = b = 0."""

    name: ClassVar[str] = "lead_friction"
    equation: ClassVar[str] = "-(a sin phi + b cos phi) s"
    size: ClassVar[str] = "0.7-4 N"
    twins: ClassVar[tuple[str, ...]] = ("cogging",)
    source: ClassVar[str] = "run-out of the screw"
    a: Scalar = param("N", scale=2.0, default=0.0)
    b: Scalar = param("N", scale=2.0, default=0.0)
    lead: Scalar = setting("m", default=0.0025)

    @classmethod
    def at(cls, bench: Bench) -> "LeadFriction":
        return cls(lead=bench.lead)

    def grip(self, q: Array, v: Array, signals: Signals) -> Array:
        phi = turn(q, self.lead)
        return self.a * jnp.sin(phi) + self.b * jnp.cos(phi)

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"a": 2.0, "b": 2.0}),)


class LoadDependentFriction(AbstractGripEffect):
    """f = mu (sqrt(F^2 + Fp^2) - Fp) s, F = K12 delta: friction that grows with the force transmitted; null mu = 0.

    Fp is the preload, up to which it hardly does. A rigid drive has no such force of its own: the motor's stands in.
    """

    name: ClassVar[str] = "load_dependent_friction"
    equation: ClassVar[str] = "-mu (sqrt((K12 delta)^2 + Fp^2) - Fp) s"
    size: ClassVar[str] = "0.02-0.15"
    source: ClassVar[str] = "friction of the screw's flanks"
    mu: Scalar = param("1", scale=0.05, lower=-0.6, upper=0.6, default=0.0)
    preload: Scalar = param("N", scale=20.0, lower=0.1, upper=200.0, default=1.0)

    def grip(self, q: Array, v: Array, signals: Signals) -> Array:
        transmitted = jnp.where(signals.stiffness == 0, signals.force, signals.coupling)
        return self.mu * (jnp.hypot(transmitted, self.preload) - self.preload)

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return (Probe({"mu": 0.05}),)


class FrictionDrift(AbstractEffect):
    """Coulomb and viscous friction of both sides times 1 + d g(t), g = (1 - e^(-t/T)) / (1 - e^(-D/T)); null d = 0.

    D is the record's duration; a long T makes g linear.
    """

    block: ClassVar[Block] = Block.MOTOR_SIDE
    name: ClassVar[str] = "friction_drift"
    equation: ClassVar[str] = "friction x (1 + d g(t))"
    size: ClassVar[str] = "15-50 %"
    source: ClassVar[str] = "warming lubricant"
    twins: ClassVar[tuple[str, ...]] = ("payload_change",)
    own_to_record: ClassVar[tuple[str, ...]] = ("t0",)
    d_coulomb: Scalar = param("1", scale=0.3, lower=-0.95, upper=3.0, default=0.0)
    d_viscous: Scalar = param("1", scale=0.3, lower=-0.95, upper=3.0, default=0.0)
    T: Scalar = param("s", scale=10.0, lower=0.5, upper=60.0, default=15.0)
    t0: Scalar = setting("s", default=0.0)
    duration: Scalar = setting("s", default=10.0)

    @classmethod
    def at(cls, bench: Bench) -> "FrictionDrift":
        return cls(duration=bench.duration)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        middle = signals.held_since + 0.5 * signals.dt  # one value per sample
        g = jnp.expm1(-(middle - self.t0) / self.T) / jnp.expm1(-self.duration / self.T)
        coulomb, viscous = g * self.d_coulomb, g * self.d_viscous
        return Forces(
            motor=-viscous * signals.viscous1,
            load=-viscous * signals.viscous2,
            grip_motor=coulomb * (signals.level1 + signals.grip1),
            grip_load=coulomb * (signals.level2 + signals.grip2),
        ), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return tuple(Probe({"d_coulomb": 0.2, "d_viscous": 0.2}, {"T": T}) for T in (2.0, 20.0))


class Presliding(AbstractEffect):
    """A share of the friction that grips, g s(v), becomes a bristle's: F + T F', F' = (g v - |v| F) Fc / (g z_s).

    F (N) follows g s on a travel of g / sigma0, wherever the motion turns and wherever g = Fc + ... changes on the way;
    z_s = Fc / sigma0 is the deflection at break-away, T = sigma1 / sigma0. `share` is that of the motor side's
    friction, `load` times as much that of the load side's; the sides differ by micrometres. Null share = 0, 1 is all.
    """

    block: ClassVar[Block] = Block.MOTOR_SIDE
    name: ClassVar[str] = "presliding"
    equation: ClassVar[str] = "share (F + T F') for share g s, F' = (g v - |v| F) Fc / (g z_s)"
    size: ClassVar[str] = "z_s 60-600 um"
    twins: ClassVar[tuple[str, ...]] = ("stribeck",)
    source: ClassVar[str] = "Dahl, 1968; Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40, 1995"
    share: Scalar = param("1", scale=1.0, lower=0.0, upper=1.0, default=0.0)
    load: Scalar = param("1", scale=0.5, lower=0.0, upper=1.0, default=0.5)
    z_s: Scalar = param("m", scale=2e-4, lower=1e-5, upper=3e-3, default=3e-4)
    T: Scalar = param("s", scale=2e-3, lower=-4e-3, upper=0.012, default=0.0)

    def init(self, signals: Signals) -> Any:
        return jnp.maximum(jnp.stack([signals.level1, signals.level2]), 0.0) * signals.s1

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Forces, Any]:
        plain = jnp.stack([signals.level1, signals.level2])
        more = jnp.stack([signals.grip1, signals.grip2])
        level = jnp.maximum(plain + more, 0.0)  # what grips never pushes
        softer = jnp.clip(1 + more / jnp.where(jnp.abs(plain) > _LEAST_LEVEL, plain, _LEAST_LEVEL), 0.0, _SOFTEST)
        # a bristle that bends through within half a sample is followed no faster, or fast motion would be stiff
        bend = jnp.maximum(self.z_s * softer, 0.5 * jnp.abs(signals.v1) * signals.dt)
        bend = jnp.maximum(bend, _LEAST_BEND)  # where g passes through 0 at rest
        rate = (signals.v1 * level - jnp.abs(signals.v1) * x) / bend
        load = jnp.where(signals.stiffness == 0, 0.0, self.load * self.share)  # a rigid drive has one side
        share = jnp.stack([self.share, load])
        force, grip = -share * (x + self.T * rate), -share * level
        return Forces(motor=force[0], load=force[1], grip_motor=grip[0], grip_load=grip[1]), rate

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return tuple(Probe({"share": 1.0}, {"z_s": z, "T": 1e-3}, linear=False) for z in (8e-5, 1.8e-4, 3.5e-4, 7e-4))


_LEAST_LEVEL, _SOFTEST, _LEAST_BEND = 0.01, 10.0, 1e-6
"""N, 1 and m: nominal friction of which others are told, and how far they may change the travel of a bristle."""
