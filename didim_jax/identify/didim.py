"""DIDIM: the inverse model, evaluated on the simulated motion, taken for the Jacobian of the simulated force.

References: paper, sections IV (rigid), V.B (step 1) and V.D (step 3).
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array

from ..idm import observation_matrix
from ..plant import AbstractPlant
from .least_squares import Stopping, iterate, jacobian
from .parametrisation import AbstractParametrisation, PlantParameters
from .result import IdentificationResult
from .trial import Trial

STOPPING = Stopping(tolerance=1e-3)


def didim_columns(
    parametrisation: AbstractParametrisation, trial: Trial, x: Array, s: Array
) -> tuple[Array, Array, Array]:
    """Residual, and IDM(q_ddm, v_ddm, a_ddm) as its columns: the simulated motion is taken not to depend on theta.

    A flexible drive adds the rows of its load side, whose force is zero and whose residual therefore is too; without
    them neither M2 nor its friction would have a column. Columns for the initial state are exact: eq. 18 has none.

    References: paper, eq. 17-20.
    """
    assert isinstance(parametrisation, PlantParameters) and not parametrisation.bounded
    theta = parametrisation.decode(x)
    plant = parametrisation.plant(theta)
    simulation = trial.simulate(plant, s)
    W = observation_matrix(plant, simulation.motor, simulation.load, parametrisation.chosen)
    decimated = jax.vmap(jax.vmap(trial.decimation, in_axes=1, out_axes=1))(W)  # (rows, n, n_theta)
    by_x = jnp.concatenate(list(decimated)) * jax.jacfwd(parametrisation.decode)(x).diagonal()[None, :]
    predicted, by_s = jacobian(lambda shift: trial.predict(plant, shift), s)
    silent = by_x.shape[0] - predicted.shape[0]  # rows of the load side
    residual = jnp.concatenate([predicted - trial.observed, jnp.zeros(silent)])
    return residual, by_x, jnp.concatenate([by_s, jnp.zeros((silent, s.shape[0]))])


def didim(
    plant: AbstractPlant,
    names: Sequence[str],
    trials: tuple[Trial, ...],
    stopping: Stopping = STOPPING,
    on_iterate: Callable[[int, np.ndarray, float], None] | None = None,
) -> IdentificationResult:
    """Iterate simulation and least squares from the plant's own values over the named parameters.

    With `names` shorter than the plant's, the others stay: leaving out Fv2 and Fc2 (both zero) gives the paper's five
    columns, in which friction is one.

    References: paper, eq. 20-21; start values eq. 22 (rigid), eq. 29-30 (flexible).
    """
    parametrisation = PlantParameters.of(plant, names, bounded=False)
    solver: optx.GaussNewton = optx.GaussNewton(rtol=0.0, atol=0.0)
    return iterate(
        "DIDIM",
        parametrisation,
        trials,
        np.asarray(parametrisation.start()),
        didim_columns,
        solver,
        stopping,
        on_iterate,
    )
