"""Many identifications at once: one compiled program, one lane for each start or noise draw.

A lane takes the same steps on the same residual as a single identification; lanes differ in where they start and, where
asked, in the signal they compare with. Each ends with its own flag. They run batch by batch (vmap), and side by side on
every device that JAX has.
"""

import enum
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array
from jaxtyping import PyTree

from ..identify import least_squares as ls
from ..identify import simplex
from ..identify.least_squares import Columns, Problem, Stopping


class Ended(enum.IntEnum):
    """How a lane ended; NOT_RUN marks what a store still lacks."""

    NOT_RUN = 0
    CONVERGED = 1
    DIVERGED = 2
    EXHAUSTED = 3


class Lanes(eqx.Module):
    """The end of every lane: theta (n, n_theta), cost = norm(rho) / norm(Y), iterations, and `Ended`, (n,) each."""

    theta: Array
    cost: Array
    n_iterations: Array
    ended: Array


class _Running(eqx.Module):
    z: Array
    state: PyTree  # arrays of the solver's state; the rest of it is the same at every step
    final: Array
    cost: Array
    n_iterations: Array
    ended: Array


def least_squares_lanes(
    problem: Problem,
    starts: np.ndarray,
    columns: Columns,
    solver: optx.AbstractLeastSquaresSolver,
    stopping: Stopping,
    observed: np.ndarray | None = None,
    batch: int = 8,
) -> Lanes:
    """Least squares from every start, theta (n, n_theta): DIDIM or exact Gauss-Newton by `columns`, damped by `solver`.

    `observed`, (n, n_decimated), gives each lane a compared signal of its own (noise draws); one record then.
    """
    return _over(_least_squares_lane, (problem, columns, solver, stopping), starts, observed, batch)


def nelder_mead_lanes(
    problem: Problem, starts: np.ndarray, stopping: Stopping, observed: np.ndarray | None = None, batch: int = 8
) -> Lanes:
    """Nelder-Mead from every start, theta (n, n_theta). `observed` as for `least_squares_lanes`."""
    return _over(_nelder_mead_lane, (problem, stopping), starts, observed, batch)


def _over(
    lane: Callable[..., Lanes], shared: tuple, starts: np.ndarray, observed: np.ndarray | None, batch: int
) -> Lanes:
    """Run a lane for every start: a share of them on each device, batch by batch there."""
    parts = []
    for device, rows in zip(jax.devices(), np.array_split(np.arange(len(starts)), len(jax.devices())), strict=True):
        if len(rows):
            own = None if observed is None else observed[rows]
            there = jax.device_put((eqx.filter(shared, eqx.is_array), starts[rows], own), device)
            # Calls return before they are done, so that the devices work at the same time.
            parts.append(_run(lane, eqx.combine(there[0], shared), there[1], there[2], batch))
    return jax.tree.map(lambda *p: np.concatenate([np.asarray(a) for a in p]), *parts)


@eqx.filter_jit
def _run(lane: Callable[..., Lanes], shared: tuple, starts: Array, observed: Array | None, batch: int) -> Lanes:
    return jax.lax.map(lambda one: lane(*shared, *one), (starts, observed), batch_size=batch)


def _with_observed(problem: Problem, observed: Array | None) -> Problem:
    if observed is None:
        return problem
    parametrisation, (trial,) = problem
    return parametrisation, (eqx.tree_at(lambda t: t.observed, trial, observed),)


def _norm(problem: Problem) -> Array:
    return jnp.sqrt(sum(jnp.sum(trial.observed**2) for trial in problem[1]))


def _least_squares_lane(
    problem: Problem,
    columns: Columns,
    solver: optx.AbstractLeastSquaresSolver,
    stopping: Stopping,
    theta0: Array,
    observed: Array | None,
) -> Lanes:
    problem = _with_observed(problem, observed)
    parametrisation, trials = problem
    n_x = theta0.shape[0]
    z0 = jnp.concatenate([parametrisation.encode(theta0), jnp.zeros(sum(t.n_start for t in trials))])
    arrays, rest = eqx.partition(ls.first_state(solver, z0, problem, columns), eqx.is_array)

    def step(now: _Running) -> _Running:
        z, state, r, J = ls.step(solver, now.z, problem, columns, eqx.combine(now.state, rest))
        cost = jnp.linalg.norm(r) / _norm(problem)
        lost = ~(jnp.isfinite(r).all() & jnp.isfinite(J).all() & (cost < ls.DIVERGED))
        accepted = state.num_steps_since_acceptance == 0
        small = ls.relative_change(parametrisation, z, state.y_eval, n_x) < stopping.tolerance
        still = jnp.abs(cost - now.cost) <= stopping.cost_tolerance * now.cost  # eq. 21, absolute
        done = accepted & ((small & (ls.steepness(r, J) < ls.FLAT)) | still)
        n = now.n_iterations + 1
        ended = jnp.where(
            lost,
            Ended.DIVERGED,
            jnp.where(done, Ended.CONVERGED, jnp.where(n >= stopping.max_iterations, Ended.EXHAUSTED, Ended.NOT_RUN)),
        )
        return _Running(z, eqx.filter(state, eqx.is_array), jnp.where(done & small, state.y_eval, z), cost, n, ended)

    begin = _Running(z0, arrays, z0, jnp.asarray(jnp.inf), jnp.asarray(0), jnp.asarray(Ended.NOT_RUN.value))
    end = jax.lax.while_loop(lambda now: now.ended == Ended.NOT_RUN.value, step, begin)
    return Lanes(parametrisation.decode(end.final[:n_x]), end.cost, end.n_iterations, end.ended)


def _nelder_mead_lane(problem: Problem, stopping: Stopping, theta0: Array, observed: Array | None) -> Lanes:
    problem = _with_observed(problem, observed)
    parametrisation = problem[0]
    state0, _ = simplex.step(problem, simplex.first_state(simplex.first_simplex(parametrisation, theta0), problem))
    arrays, rest = eqx.partition(state0, eqx.is_array)

    def step(now: tuple[PyTree, Array, Array]) -> tuple[PyTree, Array, Array]:
        state, _ = simplex.step(problem, eqx.combine(now[0], rest))
        apart, uneven = simplex.unevenness(parametrisation, state)
        n = now[1] + 1
        lost = ~jnp.isfinite(jnp.min(state.f_simplex))
        done = (apart < stopping.tolerance) & (uneven < stopping.cost_tolerance)
        ended = jnp.where(
            lost,
            Ended.DIVERGED,
            jnp.where(done, Ended.CONVERGED, jnp.where(n >= stopping.max_iterations, Ended.EXHAUSTED, Ended.NOT_RUN)),
        )
        return eqx.filter(state, eqx.is_array), n, ended

    hopeless = jnp.where(jnp.isfinite(jnp.min(state0.f_simplex)), Ended.NOT_RUN.value, Ended.DIVERGED.value)
    begin = (arrays, jnp.asarray(0), hopeless)
    last, n, ended = jax.lax.while_loop(lambda now: now[2] == Ended.NOT_RUN.value, step, begin)
    state = eqx.combine(last, rest)
    best = jnp.argmin(state.f_simplex)
    cost = jnp.sqrt(state.f_simplex[best]) / _norm(problem)
    return Lanes(parametrisation.decode(state.simplex[best]), cost, n, ended)
