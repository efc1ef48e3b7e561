"""One Nelder-Mead step on the criterion that all methods share, for one run or for many lanes.

The initial state of each record is not one more dimension of the simplex: it enters the criterion almost linearly, so
every evaluation solves for it by one linear least squares (variable projection), and the simplex moves theta alone.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array
from jaxtyping import PyTree

from .least_squares import Problem, jacobian
from .parametrisation import AbstractParametrisation
from .trial import Trial

_SPREAD = 0.05
"""Edge of the first simplex, relative to each parameter of the start, as in MATLAB's fminsearch (the paper's)."""

_SOLVER: optx.NelderMead = optx.NelderMead(rtol=0.0, atol=0.0)  # when to stop is decided below, from the whole simplex


def criterion(x: Array, problem: Problem) -> Array:
    """norm(Y - Ys)^2, least over the initial states (eq. 25, 32); infinite where the simulation is not finite."""
    parametrisation, trials = problem
    plant = parametrisation.plant(parametrisation.decode(x))
    total = sum(_least_over_start(trial, *with_start_columns(plant, trial)) for trial in trials)
    return jnp.where(jnp.isfinite(total), total, jnp.inf)


def with_start_columns(plant: PyTree, trial: Trial) -> tuple[Array, Array]:
    return jacobian(lambda s: trial.predict(plant, s) - trial.observed, jnp.zeros(trial.n_start))


def augmented(trial: Trial, r: Array, S: Array) -> tuple[Array, Array]:
    """The system for s with the record's own knowledge of its start as last rows."""
    k = trial.n_start
    return jnp.concatenate([S, trial.signal.residual * jnp.eye(k)]), jnp.concatenate([r, jnp.zeros(k)])


def _least_over_start(trial: Trial, r: Array, S: Array) -> Array:
    if trial.n_start == 0:
        return r @ r
    A, b = augmented(trial, r, S)
    explained = jnp.linalg.qr(A)[0].T @ b
    return b @ b - explained @ explained


def first_simplex(parametrisation: AbstractParametrisation, theta0: Array) -> Array:
    """Vertices in x, (n + 1, n): the start, and an edge along each parameter, backwards where a bound is in the way."""
    edges = jnp.diag(jnp.where(theta0 != 0, _SPREAD * theta0, 0.00025))
    ahead, behind = (jax.vmap(parametrisation.encode)(theta0[None, :] + sign * edges) for sign in (1, -1))
    vertices = jnp.where(jnp.isfinite(ahead).all(axis=1, keepdims=True), ahead, behind)
    return jnp.concatenate([parametrisation.encode(theta0)[None, :], vertices])


def first_state(simplex: Array, problem: Problem) -> PyTree:
    """The solver's state before the simplex is evaluated."""
    struct = jax.ShapeDtypeStruct((), simplex.dtype)
    state = _SOLVER.init(_as_optimistix, simplex[0], problem, {}, struct, None, frozenset())
    return eqx.tree_at(lambda s: s.simplex, state, simplex)  # ours: its own has edges in x, not in theta


def step(problem: Problem, state: PyTree) -> tuple[PyTree, Array]:
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


def unevenness(parametrisation: AbstractParametrisation, state: PyTree) -> tuple[Array, Array]:
    """How far apart the simplex is: in theta, relative to the best vertex, and in the criterion, likewise."""
    thetas = jax.vmap(parametrisation.decode)(state.simplex)
    best = jnp.argmin(state.f_simplex)
    apart = jnp.max(jnp.abs(thetas - thetas[best][None, :]) / jnp.maximum(jnp.abs(thetas[best]), 1e-12)[None, :])
    least = jnp.sqrt(state.f_simplex[best])
    return apart, (jnp.sqrt(jnp.max(state.f_simplex)) - least) / jnp.maximum(least, 1e-300)


def _as_optimistix(x: Array, problem: Problem) -> tuple[Array, None]:
    return criterion(x, problem), None
