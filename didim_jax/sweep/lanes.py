"""Many identifications at once: one compiled program, one lane for each start or noise draw.

A lane takes the same steps on the same residual as a single identification; lanes differ in where they start and, where
asked, in the signal they compare with. Each ends with its own flag. They run batch by batch (vmap), and side by side on
every device that JAX has.
"""

import enum
import queue
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

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
    """Run a lane for every start, batch by batch; each device takes the next batch as soon as it is free.

    All batches have one size (the last is filled up), so that one compiled program serves sweeps of every length.
    """
    devices = jax.devices()
    n = len(starts)
    batch = max(1, min(batch, -(-n // len(devices))))
    waiting: queue.SimpleQueue[np.ndarray] = queue.SimpleQueue()
    for first in range(0, n, batch):
        waiting.put(np.arange(first, min(first + batch, n)))

    def work(device: jax.Device) -> list[tuple[np.ndarray, Lanes]]:
        there = eqx.combine(jax.device_put(eqx.filter(shared, eqx.is_array), device), shared)
        done: list[tuple[np.ndarray, Lanes]] = []
        while True:
            try:
                rows = waiting.get_nowait()
            except queue.Empty:
                return done
            filled = np.pad(rows, (0, batch - len(rows)), mode="edge")
            own = None if observed is None else observed[filled]
            end = _run(lane, there, *jax.device_put((starts[filled], own), device))
            done.append((rows, jax.tree.map(lambda a, k=rows.size: np.asarray(a)[:k], end)))

    with ThreadPoolExecutor(len(devices)) as pool:
        parts = [part for share in pool.map(work, devices) for part in share]
    parts.sort(key=lambda part: part[0][0])
    return jax.tree.map(lambda *p: np.concatenate(p), *(part for _, part in parts))


@eqx.filter_jit
def _run(lane: Callable[..., Lanes], shared: tuple, starts: Array, observed: Array | None) -> Lanes:
    return jax.vmap(lambda *one: lane(*shared, *one))(starts, observed)


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
        taken = now.n_iterations
        lost = ~(jnp.isfinite(r).all() & jnp.isfinite(J).all() & (cost < ls.DIVERGED))
        accepted = state.num_steps_since_acceptance == 0
        # Eq. 21, absolute; there is nothing to compare the first cost with.
        still = accepted & (taken > 0) & (jnp.abs(cost - now.cost) <= stopping.cost_tolerance * now.cost)
        last = still | (taken == stopping.max_iterations)
        change = ls.unsettled(parametrisation, z, state.y_eval, n_x, r, J, stopping.tolerance)
        small = accepted & (change < 1) & (ls.steepness(r, J) < ls.FLAT) & ~last
        stuck = ~accepted & (jnp.max(jnp.abs(state.y_eval - z)) < 1e-12)  # no step decreases the criterion any further
        ended = jnp.where(
            lost,
            Ended.DIVERGED,
            jnp.where(still | small, Ended.CONVERGED, jnp.where(last | stuck, Ended.EXHAUSTED, Ended.NOT_RUN)),
        )
        n = jnp.where(lost | last, taken, taken + 1)
        return _Running(z, eqx.filter(state, eqx.is_array), jnp.where(small, state.y_eval, z), cost, n, ended)

    begin = _Running(z0, arrays, z0, jnp.asarray(jnp.inf), jnp.asarray(0), jnp.asarray(Ended.NOT_RUN.value))
    end = jax.lax.while_loop(lambda now: now.ended == Ended.NOT_RUN.value, step, begin)
    return Lanes(parametrisation.decode(end.final[:n_x]), end.cost, end.n_iterations, end.ended)


def _nelder_mead_lane(problem: Problem, stopping: Stopping, theta0: Array, observed: Array | None) -> Lanes:
    problem = _with_observed(problem, observed)
    parametrisation = problem[0]
    state0 = simplex.first_state(simplex.first_simplex(parametrisation, theta0), problem)
    arrays, rest = eqx.partition(state0, eqx.is_array)

    def step(now: tuple[PyTree, Array, Array]) -> tuple[PyTree, Array, Array]:
        state, _ = simplex.step(problem, eqx.combine(now[0], rest))
        apart, uneven = simplex.unevenness(parametrisation, state)
        n = now[1] + 1
        lost = ~jnp.isfinite(jnp.min(state.f_simplex))
        done = (n > 0) & (apart < stopping.tolerance) & (uneven < stopping.cost_tolerance)
        ended = jnp.where(
            lost,
            Ended.DIVERGED,
            jnp.where(done, Ended.CONVERGED, jnp.where(n >= stopping.max_iterations, Ended.EXHAUSTED, Ended.NOT_RUN)),
        )
        return eqx.filter(state, eqx.is_array), n, ended

    begin = (arrays, jnp.asarray(-1), jnp.asarray(Ended.NOT_RUN.value))  # the first step only evaluates the simplex
    last, n, ended = jax.lax.while_loop(lambda now: now[2] == Ended.NOT_RUN.value, step, begin)
    state = eqx.combine(last, rest)
    best = jnp.argmin(state.f_simplex)
    cost = jnp.sqrt(state.f_simplex[best]) / _norm(problem)
    return Lanes(parametrisation.decode(state.simplex[best]), cost, n, ended)
