"""From the vector that an optimiser moves to the plant it stands for."""

import abc
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from .._types import Scalar, Theta
from ..params import Parameter, pack, select, unpack
from ..plant import AbstractPlant, CoulombViscous, FlexibleDrive, split


class AbstractParametrisation(eqx.Module):
    """A vector x whose entries are near 1 in size, and the physical parameters theta and plant that it stands for."""

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of theta."""

    @property
    @abc.abstractmethod
    def units(self) -> tuple[str, ...]:
        """SI units of theta."""

    @abc.abstractmethod
    def encode(self, theta: Theta) -> Array:
        """x of theta."""

    @abc.abstractmethod
    def decode(self, x: Array) -> Theta:
        """theta of x."""

    @abc.abstractmethod
    def plant(self, theta: Theta) -> AbstractPlant:
        """The plant with these parameters."""


class PlantParameters(AbstractParametrisation):
    """Some parameters of a plant; the others keep the template's values.

    theta = scale x, or scale exp(x) for those that must stay positive, if `bounded`. DIDIM solves for theta itself
    and must not be bounded: its least squares is linear in theta.
    """

    template: AbstractPlant
    chosen: tuple[Parameter, ...] = eqx.field(static=True)
    bounded: bool = eqx.field(static=True)

    @classmethod
    def of(cls, plant: AbstractPlant, names: Sequence[str], *, bounded: bool) -> "PlantParameters":
        """The named parameters of the plant, in the plant's order. ValueError on a name that it does not have."""
        return cls(plant, select(plant, names), bounded)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.chosen)

    @property
    def units(self) -> tuple[str, ...]:
        return tuple(p.unit for p in self.chosen)

    @property
    def _scale(self) -> np.ndarray:
        return np.array([p.scale for p in self.chosen])

    @property
    def _logarithmic(self) -> np.ndarray:
        return np.array([self.bounded and p.positive for p in self.chosen], dtype=bool)

    def start(self) -> Theta:
        """The template's own values."""
        return pack(self.template, self.chosen)

    def encode(self, theta: Theta) -> Array:
        x = theta / self._scale
        return jnp.where(self._logarithmic, jnp.log(jnp.where(self._logarithmic, x, 1.0)), x)

    def decode(self, x: Array) -> Theta:
        return jnp.asarray(self._scale) * jnp.where(self._logarithmic, jnp.exp(jnp.where(self._logarithmic, x, 0.0)), x)

    def plant(self, theta: Theta) -> AbstractPlant:
        return unpack(self.template, theta, self.chosen)


class ModeParameters(AbstractParametrisation):
    """Mass ratio lam and mode f_n (Hz) of a flexible drive whose total mass and friction are known.

    lam = sigmoid(x0) stays inside (0, 1), f_n = exp(x1) Hz. All the friction is the motor side's.

    References: paper, eq. 26 and 27.
    """

    M: Scalar
    friction: CoulombViscous
    offset: Scalar

    @property
    def names(self) -> tuple[str, ...]:
        return ("lam", "f_n")

    @property
    def units(self) -> tuple[str, ...]:
        return ("1", "Hz")

    def encode(self, theta: Theta) -> Array:
        lam, f_n = theta
        return jnp.stack([jnp.log(lam / (1 - lam)), jnp.log(f_n)])

    def decode(self, x: Array) -> Theta:
        return jnp.stack([jax.nn.sigmoid(x[0]), jnp.exp(x[1])])

    def plant(self, theta: Theta) -> FlexibleDrive:
        M1, M2, K12 = split(self.M, theta[0], theta[1])
        load = CoulombViscous(0.0, 0.0, self.friction.v_eps)
        return FlexibleDrive(M1, self.friction, M2, load, K12, self.offset)
