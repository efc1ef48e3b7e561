"""Nelder-Mead on the same criterion, for the methods that use no derivative of theta."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from . import simplex
from .least_squares import Problem, Stopping, describe, exact_columns, linear_system
from .parametrisation import AbstractParametrisation
from .result import IdentificationResult
from .trial import Trial

_first_state, _step = eqx.filter_jit(simplex.first_state), eqx.filter_jit(simplex.step)


@eqx.filter_jit
def _best_starts(x: Array, problem: Problem) -> list[Array]:
    parametrisation, trials = problem
    plant = parametrisation.plant(parametrisation.decode(x))
    shifts = []
    for trial in trials:
        A, b = simplex.augmented(trial, *simplex.with_start_columns(plant, trial))
        shifts.append(-jnp.linalg.lstsq(A, b)[0] if trial.n_start else jnp.zeros(0))
    return shifts


def nelder_mead(
    method: str,
    parametrisation: AbstractParametrisation,
    trials: tuple[Trial, ...],
    theta0: np.ndarray,
    stopping: Stopping,
    on_iterate: Callable[[int, np.ndarray, float], None] | None = None,
) -> IdentificationResult:
    """Minimise the criterion over theta, from a simplex whose edges are 5 % of each parameter.

    Stops when every parameter agrees within `tolerance` over the simplex, and the criterion within `cost_tolerance`.

    References: paper, section V.C, eq. 32; J. Lagarias et al., 1998 (fminsearch).
    """
    problem = (parametrisation, trials)
    theta0 = np.asarray(theta0, dtype=float)
    norm_Y = float(np.linalg.norm(np.concatenate([np.asarray(t.observed) for t in trials])))
    state = _first_state(simplex.first_simplex(parametrisation, jnp.asarray(theta0)), problem)
    trace, costs, simulations, converged, reason = [], [], 0, False, ""
    for k in range(stopping.max_iterations + 1):  # the first call only evaluates the starting simplex
        state, used = _step(problem, state)
        simulations += int(used) * len(trials)
        values = np.asarray(state.f_simplex)
        best = int(np.argmin(values))
        trace.append(np.asarray(parametrisation.decode(state.simplex[best])))
        costs.append(float(np.sqrt(values[best])) / norm_Y)
        if on_iterate:
            on_iterate(k, trace[-1], costs[-1])
        if not np.isfinite(values[best]):
            reason = "no vertex of the simplex has a finite simulation"
            break
        apart, uneven = simplex.unevenness(parametrisation, state)
        if k and apart < stopping.tolerance and uneven < stopping.cost_tolerance:
            converged = True
            reason = (
                f"the simplex agrees within {stopping.tolerance:g} in theta "
                f"and {stopping.cost_tolerance:g} in the criterion"
            )
            break
        if k == stopping.max_iterations:
            reason = f"not converged after {k} iterations"
    x = state.simplex[int(np.argmin(np.asarray(state.f_simplex)))]
    z = jnp.concatenate([x, *_best_starts(x, problem)])
    r, J = linear_system(z, problem, exact_columns)
    return describe(
        method, problem, z, np.asarray(r), np.asarray(J), converged, reason, len(trace) - 1, simulations, trace, costs
    )
