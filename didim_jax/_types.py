"""Names for the array shapes that appear in signatures."""

from jax import Array

type Scalar = Array | float
"""A traced scalar, or a Python number that becomes one."""

type Traj = Array
"""One value per sample, shape (n,)."""

type Theta = Array
"""A vector of parameters, shape (n_theta,)."""
