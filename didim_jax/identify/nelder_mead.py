"""Nelder-Mead on the same criterion, for the methods that use no derivative of theta.

The initial state of each record is not one more dimension of the simplex: it enters the criterion almost linearly, so
every evaluation solves for it by one linear least squares (variable projection), and the simplex moves theta alone.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array
from jaxtyping import PyTree

from .least_squares import Problem, Stopping, describe, exact_columns, jacobian, linear_system
from .parametrisation import AbstractParametrisation
from .result import IdentificationResult
from .trial import Trial

_SPREAD = 0.05
"""Edge of the first simplex, relative to each parameter of the start, as in MATLAB's fminsearch (the paper's)."""

_SOLVER: optx.NelderMead = optx.NelderMead(rtol=0.0, atol=0.0)  # when to stop is decided below, from the whole simplex


def criterion(x: Array, problem: Problem) -> Array:
    """norm(Y - Ys)^2, least over the initial states (eq. 25, 32); infinite where the simulation is not finite."""
    parametrisation, trials = problem
    plant = parametrisation.plant(parametrisation.decode(x))
    total = sum(_least_over_start(trial, *_with_start_columns(plant, trial)) for trial in trials)
    return jnp.where(jnp.isfinite(total), total, jnp.inf)


def _with_start_columns(plant: PyTree, trial: Trial) -> tuple[Array, Array]:
    return jacobian(lambda s: trial.predict(plant, s) - trial.observed, jnp.zeros(trial.n_start))


def _augmented(trial: Trial, r: Array, S: Array) -> tuple[Array, Array]:
    """The system for s with the record's own knowledge of its start as last rows."""
    k = trial.n_start
    return jnp.concatenate([S, trial.signal.residual * jnp.eye(k)]), jnp.concatenate([r, jnp.zeros(k)])


def _least_over_start(trial: Trial, r: Array, S: Array) -> Array:
    if trial.n_start == 0:
        return r @ r
    A, b = _augmented(trial, r, S)
    explained = jnp.linalg.qr(A)[0].T @ b
    return b @ b - explained @ explained


@eqx.filter_jit
def _init(simplex: Array, problem: Problem) -> PyTree:
    struct = jax.ShapeDtypeStruct((), simplex.dtype)
    state = _SOLVER.init(_as_optimistix, simplex[0], problem, {}, struct, None, frozenset())
    return eqx.tree_at(lambda s: s.simplex, state, simplex)  # ours: its own has edges in x, not in theta


@eqx.filter_jit
def _step(problem: Problem, state: PyTree) -> tuple[PyTree, Array]:
    """One iteration: the solver's state, and how many simulations of every record it took."""
    shrinks = state.stats.n_shrink
    first = state.first_pass
    _, state, _ = _SOLVER.step(_as_optimistix, state.simplex[0], problem, {}, state, frozenset())
    # The solver reads its best and worst vertex off the simplex it had before this step, which makes it reflect the
    # wrong vertex whenever the new one is again the worst: read them off the simplex that it has now.
    order = jnp.argsort(state.f_simplex)
    best, worst = order[0], order[-1]
    state = eqx.tree_at(
        lambda s: (s.best[1], s.best[2], s.worst[1], s.worst[2]),
        state,
        (
            state.simplex[best],
            best.astype(state.best[2].dtype),
            state.simplex[worst],
            worst.astype(state.worst[2].dtype),
        ),
    )
    n_vertices = state.simplex.shape[0]
    return state, jnp.where(first, 0, 2) + n_vertices * (state.stats.n_shrink - shrinks)


def _as_optimistix(x: Array, problem: Problem) -> tuple[Array, None]:
    return criterion(x, problem), None


@eqx.filter_jit
def _best_starts(x: Array, problem: Problem) -> list[Array]:
    parametrisation, trials = problem
    plant = parametrisation.plant(parametrisation.decode(x))
    shifts = []
    for trial in trials:
        A, b = _augmented(trial, *_with_start_columns(plant, trial))
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
    edges = np.where(theta0 != 0, _SPREAD * theta0, 0.00025)
    vertices = np.vstack([theta0, theta0 + np.diag(edges)])
    simplex = jnp.stack([parametrisation.encode(jnp.asarray(v)) for v in vertices])
    norm_Y = float(np.linalg.norm(np.concatenate([np.asarray(t.observed) for t in trials])))
    state = _init(simplex, problem)
    trace, costs, simulations, converged, reason = [], [], 0, False, ""
    for k in range(stopping.max_iterations + 1):  # the first call only evaluates the starting simplex
        state, used = _step(problem, state)
        simulations += int(used) * len(trials)
        values = np.asarray(state.f_simplex)
        thetas = np.array([np.asarray(parametrisation.decode(x)) for x in state.simplex])
        best = int(np.argmin(values))
        trace.append(thetas[best])
        costs.append(float(np.sqrt(values[best])) / norm_Y)
        if on_iterate:
            on_iterate(k, trace[-1], costs[-1])
        if not np.isfinite(values[best]):
            reason = "no vertex of the simplex has a finite simulation"
            break
        apart = np.max(np.abs(thetas - thetas[best]) / np.maximum(np.abs(thetas[best]), 1e-12))
        uneven = np.sqrt(np.max(values)) - np.sqrt(values[best])
        if k and apart < stopping.tolerance and uneven < stopping.cost_tolerance * np.sqrt(values[best]):
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
