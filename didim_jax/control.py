"""Position controllers, and the drive that turns their volts into force."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from ._types import Scalar
from .params import setting


class Drive(eqx.Module):
    """force = gain * clip(vir, -limit, limit), N.

    References: paper, eq. 31.
    """

    gain: Scalar = setting("N/V")
    limit: Scalar = setting("V", default=jnp.inf)

    def __call__(self, vir: Array) -> Array:
        return self.gain * jnp.clip(vir, -self.limit, self.limit)


class AbstractSampledController(eqx.Module):
    """A control law that runs once per sample and remembers a vector of past values between samples."""

    memory_names: eqx.AbstractClassVar[tuple[str, ...]]
    memory_scales: eqx.AbstractClassVar[tuple[float, ...]]

    @abc.abstractmethod
    def recall(self, q: Scalar, v: Scalar, dt: Scalar) -> Array:
        """Memory at a first sample where the motor is at q (m) and has been moving at v (m/s)."""

    @abc.abstractmethod
    def __call__(self, memory: Array, qg: Array, qm: Array, dt: Scalar) -> tuple[Array, Array]:
        """(vir in V, next memory) from the reference and the measured position (m)."""

    @abc.abstractmethod
    def terms(self, memory: Array, qg: Array, qm: Array, dt: Scalar) -> tuple[Array, Array]:
        """The terms of vir (V) that come of position and of velocity; zeros for a law that has no such parts."""


class SampledPD(AbstractSampledController):
    """vir[k] = kv (kp (qg[k] - qm[k]) - dq[k]), dq[k] = (qm[k] - qm[k-2]) / (2 dt): PD with a two-sample velocity.

    The mean of two samples, differenced once, is the difference over two: the law of the benchmark's rig.

    References: Janot, Gautier, Brunot, *Data Set and Reference Models of EMPS*, 2019.
    """

    kp: Scalar = setting("1/s")
    kv: Scalar = setting("V s/m")

    memory_names = ("qm[-1]", "qm[-2]")
    memory_scales = (1e-5, 1e-5)

    def recall(self, q: Scalar, v: Scalar, dt: Scalar) -> Array:
        return jnp.asarray([q - v * dt, q - 2 * v * dt], dtype=float)

    def __call__(self, memory: Array, qg: Array, qm: Array, dt: Scalar) -> tuple[Array, Array]:
        dq = (qm - memory[1]) / (2 * dt)
        return self.kv * (self.kp * (qg - qm) - dq), jnp.stack([qm, memory[0]])

    def terms(self, memory: Array, qg: Array, qm: Array, dt: Scalar) -> tuple[Array, Array]:
        return self.kv * self.kp * (qg - qm), -self.kv * (qm - memory[1]) / (2 * dt)


class ContinuousPD(eqx.Module):
    """vir = kv (kp (qg - q) - v): the same law at every instant, as in the paper."""

    kp: Scalar = setting("1/s")
    kv: Scalar = setting("V s/m")

    def __call__(self, qg: Array, q: Array, v: Array) -> Array:
        return self.kv * (self.kp * (qg - q) - v)

    def terms(self, qg: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """The terms of vir (V) that come of position and of velocity."""
        return self.kv * self.kp * (qg - q), -self.kv * v
