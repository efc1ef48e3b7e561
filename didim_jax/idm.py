"""The inverse dynamic model as a linear system: Y = W theta + rho.

W is not written down a second time: the plant's own `inverse` is linear in its parameters, so its derivative with
respect to them is the observation matrix.

References: paper, eq. 4, 7, 10-12.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from .params import Parameter, pack, unpack
from .plant import AbstractPlant, Axis


@eqx.filter_jit
def observation_matrix(plant: AbstractPlant, motor: Axis, load: Axis, chosen: Sequence[Parameter]) -> Array:
    """W by rows of the model, (n_rows, n_samples, n_theta), in SI units.

    Row 0 is the motor force (N); further rows are balances that must be zero (the load side of a flexible drive).
    Parameters that are not chosen keep the plant's values and belong to Y: see `known_force`.
    """

    def rows(theta: Array) -> Array:
        return jnp.stack(unpack(plant, theta, chosen).inverse(motor, load))

    return jax.jacfwd(rows)(jnp.zeros(len(chosen)))


@eqx.filter_jit
def known_force(plant: AbstractPlant, motor: Axis, load: Axis, chosen: Sequence[Parameter]) -> Array:
    """What the parameters that are not chosen contribute to each row, (n_rows, n_samples), N."""
    return jnp.stack(unpack(plant, jnp.zeros_like(pack(plant, chosen)), chosen).inverse(motor, load))
