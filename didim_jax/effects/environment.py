"""Effects from outside the machine: N on the load side."""

import itertools
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from .._types import Scalar
from ..params import param
from ..signals import runs
from ._base import AbstractEffect, Bench, Block, Probe, Signals
from ._law import passed


class Offset(AbstractEffect):
    """-F0: a tilted axis, a counterweight, the drive's zero; null F0 = 0."""

    block: ClassVar[Block] = Block.ENVIRONMENT
    name: ClassVar[str] = "offset"
    equation: ClassVar[str] = "-F0"
    size: ClassVar[str] = "1-7 N"
    twins: ClassVar[tuple[str, ...]] = ("asymmetric_coulomb",)
    source: ClassVar[str] = "Janot, Gautier, Brunot, EMPS benchmark, 2019"
    F0: Scalar = param("N", scale=2.0, default=0.0)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        return -self.F0 + 0.0 * signals.q1, x


class CableSpring(AbstractEffect):
    """-kc (q2 - q0): a cable or hose that pulls back; null kc = 0."""

    block: ClassVar[Block] = Block.ENVIRONMENT
    name: ClassVar[str] = "cable_spring"
    equation: ClassVar[str] = "-kc (q2 - q0)"
    size: ClassVar[str] = "10-120 N/m"
    twins: ClassVar[tuple[str, ...]] = ("offset",)
    source: ClassVar[str] = "cable chain"
    kc: Scalar = param("N/m", scale=30.0, default=0.0)
    q0: Scalar = param("m", scale=0.03, lower=-0.3, upper=0.5, default=0.05)

    @classmethod
    def at(cls, bench: Bench) -> "CableSpring":
        return cls(q0=bench.middle)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        return -self.kc * (signals.q2 - self.q0), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        span = bench.q_high - bench.q_low
        return tuple(Probe({"kc": 30.0}, {"q0": bench.q_low + x * span}) for x in (0.2, 0.5, 0.8))


class DisturbancePulses(AbstractEffect):
    """A sin(pi u)^n, u = (t - t0) / width within a pulse: forces that come and go every `period`; null A = 0.

    n = 0 is a rectangle, 1 half a sine, 2 a raised cosine. Every second pulse is `odd` times as large: -1 where their
    signs alternate. There are `count` of them, the last one less where that is not whole.
    """

    block: ClassVar[Block] = Block.ENVIRONMENT
    name: ClassVar[str] = "disturbance_pulses"
    equation: ClassVar[str] = "A sin(pi u)^n, u = (t - t0 - k period) / width in [0, 1], k < count; odd k: odd A"
    size: ClassVar[str] = "5-200 N"
    source: ClassVar[str] = "process forces, collisions, injected test signals"
    own_to_record: ClassVar[tuple[str, ...]] = ("t0",)
    A: Scalar = param("N", scale=10.0, default=0.0)
    t0: Scalar = param("s", scale=0.05, default=1.0)
    width: Scalar = param("s", scale=0.02, lower=2e-3, upper=5.0, default=0.2)
    period: Scalar = param("s", scale=0.05, lower=0.05, upper=1e3, default=1e3)
    n: Scalar = param("1", scale=1.0, lower=0.0, upper=3.0, default=0.0)
    odd: Scalar = param("1", scale=1.0, lower=-2.0, upper=2.0, default=1.0)
    count: Scalar = param("1", scale=1.0, lower=1.0, upper=1e3, default=1e3)

    def __call__(self, t: Array, x: Any, signals: Signals) -> tuple[Array, Any]:
        since, dt = signals.held_since, signals.dt
        # the pulse that this sample may lie in; the one before cannot reach here, as a pulse is shorter than the period
        k = jnp.maximum(jnp.floor((since + dt - self.t0) / self.period), 0.0)
        begin = self.t0 + k * self.period
        u = jnp.clip((since + 0.5 * dt - begin) / self.width, 1e-3, 1 - 1e-3)
        profile = jnp.exp(self.n * jnp.log(jnp.sin(jnp.pi * u)))
        A = self.A * jnp.where(k % 2 == 0, 1.0, self.odd) * jnp.clip(self.count - k, 0.0, 1.0)
        return A * profile * (passed(since, dt, begin) - passed(since, dt, begin + self.width)), x

    def probes(self, bench: Bench) -> tuple[Probe, ...]:
        return tuple(
            Probe(
                {"A": train.size * peak},
                {
                    "t0": train.t0 - wider * train.width,
                    "width": (1 + 2 * wider) * train.width,
                    "period": train.period,
                    "n": n,
                    "odd": train.odd,
                    "count": train.number,
                },
            )
            for train in pulses_in(bench.disturbance, bench.dt)
            for n, peak, wider in ((0.0, 1.0, 0.0), (1.0, 1.3, 0.15))
        )


class Train(NamedTuple):
    """Pulses that repeat: size N, first onset s, width s, period s, share of every second one, and how many."""

    size: float
    t0: float
    width: float
    period: float = 1e3
    odd: float = 1.0
    number: float = 1e3

    def course(self, t: np.ndarray) -> np.ndarray:
        """Rectangles of unit height, and of the height `odd`, at t (s), (n,)."""
        k = np.floor((t - self.t0) / self.period)
        on = (t >= self.t0) & (k < self.number) & (t - self.t0 - k * self.period < self.width)
        return np.where(on, np.where(k % 2 == 0, 1.0, self.odd), 0.0)


def pulses_in(force: np.ndarray, dt: float) -> list[Train]:
    """Trains of pulses that stand out of a disturbance (N, every dt s).

    Every interval where the force is far from its median is a pulse. Pulses of one sign are tried as a train and the
    largest alone, then those of both signs in turn.
    """
    if len(force) < 10 or not np.any(force):
        return []
    level = np.median(force)
    spread = 1.4826 * np.median(np.abs(force - level))
    least = max(4 * spread, 0.25 * np.max(np.abs(force - level)))
    found = []
    for signs in ((1.0,), (-1.0,), (1.0, -1.0)):
        spans = sorted(
            (a, b, sign) for sign in signs for a, b in runs(sign * (force - level) > least) if (b - a) * dt > 5e-3
        )
        if not spans:
            continue
        weight = [float(np.sum(sign * (force[a:b] - level))) for a, b, sign in spans]
        strong = [s for s, w in zip(spans, weight, strict=True) if w > 0.3 * max(weight)]
        onset = np.array([a for a, *_ in strong]) * dt
        width = float(np.median([b - a for a, b, _ in strong])) * dt
        size = strong[0][2] * float(np.mean([sign * np.mean(force[a:b] - level) for a, b, sign in strong]))
        gaps = np.diff(onset)
        period = max(float(np.median(gaps[gaps > width])) if np.any(gaps > width) else 1e3, 1.05 * width)
        count = float(round((onset[-1] - onset[0]) / period) + 1)
        if onset[0] + count * period + width > dt * len(force):
            count = 1e3  # the record ends before the next one would
        train = Train(size, float(onset[0]), width, period, -1.0 if len(signs) == 2 else 1.0, count)
        if len(signs) == 2:
            turns = [one[2] != two[2] for one, two in itertools.pairwise(strong)]
            if turns and np.mean(turns) > 0.5:
                found.append(train)
            continue
        a, b, sign = spans[int(np.argmax(weight))]
        found.append(Train(sign * float(np.mean(sign * (force[a:b] - level))), float(a * dt), float(b - a) * dt))
        if len(strong) > 1:
            found.append(train)
    return found
