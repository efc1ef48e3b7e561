"""Pieces of equations that several effects share."""

import jax.numpy as jnp
from jax import Array

from .._types import Scalar


def power(v: Array, per: Scalar, exponent: Scalar) -> Array:
    """(|v| / per)^exponent, with a derivative at rest; the logarithm of v is the same in every effect that asks."""
    return jnp.exp(0.5 * exponent * (jnp.log(v * v + 1e-14) - 2 * jnp.log(per)))


def turn(q: Array, lead: Scalar) -> Array:
    """phi = 2 pi q / lead, rad: angle of the screw."""
    return 2 * jnp.pi * q / lead


def remembered(time: Scalar, dt: Scalar) -> Array:
    """exp(-dt / T), what a first-order lag keeps of itself over one sample; 0 at T = 0, with a finite derivative."""
    ratio = time / dt
    slow = ratio > 0.02  # below, exp(-1 / ratio) is nothing even in double precision
    return jnp.where(slow, jnp.exp(-1 / jnp.where(slow, ratio, 1.0)), 0.0)


def passed(since: Scalar, dt: Scalar, instant: Scalar) -> Array:
    """Share of the sample that begins at `since` which lies after `instant`: 0 before, 1 after, linear within.

    The step's impulse is exact, and so is its derivative by the instant: one sample alone has it, also where the
    instant falls between two samples, to rounding.
    """
    after = (since + dt - instant) / dt
    here = (after > -1e-9) & (after < 1 - 1e-9)
    return jnp.where(here, after, jnp.where(after > 0.5, 1.0, 0.0))
