"""One least-squares driver for every simulation-based method: the same residual, whatever its derivative.

DIDIM and exact Gauss-Newton minimise the same residual and differ only in the columns they take for its derivative.
`columns` is that choice: a function that gives residual and columns together. It becomes the derivative rule of the
residual (`jax.custom_jvp`), so that one optimistix solver serves both.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array
from jax.flatten_util import ravel_pytree
from jax.scipy.linalg import block_diag
from jaxtyping import PyTree

from ..errors import InputError
from ..statistics import Spread, spread
from .parametrisation import AbstractParametrisation
from .result import IdentificationResult
from .trial import Trial

type Columns = Callable[[AbstractParametrisation, Trial, Array, Array], tuple[Array, Array, Array]]
"""(parametrisation, trial, x, s) -> residual (n,), its columns for x (n, n_x) and for s (n, n_s)."""

type Problem = tuple[AbstractParametrisation, tuple[Trial, ...]]
"""What is estimated, and every record that it is estimated from."""


DIVERGED = 1e3
"""A residual so many times the signal is a simulation that has left the machine behind, finite or not."""


def exact_columns(
    parametrisation: AbstractParametrisation, trial: Trial, x: Array, s: Array
) -> tuple[Array, Array, Array]:
    """The derivative itself, by forward-mode differentiation through the closed loop."""

    def residual(z: tuple[Array, Array]) -> Array:
        return trial.predict(parametrisation.plant(parametrisation.decode(z[0])), z[1]) - trial.observed

    r, (by_x, by_s) = jacobian(residual, (x, s))
    return r, by_x, by_s


def jacobian(f: Callable[[PyTree], Array], z: PyTree) -> tuple[Array, PyTree]:
    """f(z) and all its columns by one batched forward pass."""
    flat, unravel = ravel_pytree(z)
    if flat.size == 0:
        empty = f(z)
        return empty, jax.tree.map(lambda a: jnp.zeros((*empty.shape, *a.shape)), z)
    value, columns = jax.vmap(lambda direction: jax.jvp(f, (z,), (unravel(direction),)), out_axes=(None, -1))(
        jnp.eye(flat.size)
    )
    return value, jax.vmap(unravel)(columns)


@eqx.filter_custom_jvp
def _residual(z: Array, problem: Problem, columns: Columns) -> Array:
    return _assemble(z, problem, columns)[0]


@_residual.def_jvp
def _residual_jvp(primals: PyTree, tangents: PyTree) -> tuple[Array, Array]:
    z, problem, columns = primals
    r, J = _assemble(z, problem, columns)
    return r, J @ tangents[0]


def _assemble(z: Array, problem: Problem, columns: Columns) -> tuple[Array, Array]:
    """Residual and columns of all records: x is shared, each record's initial state is its own.

    Below the records' rows stands one row per entry of s: what the record itself says of its initial state.
    """
    parametrisation, trials = problem
    x, shifts = unravel(z, problem)
    parts = [columns(parametrisation, trial, x, s) for trial, s in zip(trials, shifts, strict=True)]
    weights = [trial.signal.residual * jnp.eye(trial.n_start) for trial in trials]
    known = [w @ s for w, s in zip(weights, shifts, strict=True)]
    residual = jnp.concatenate([r for r, _, _ in parts] + known)
    by_x = jnp.concatenate([J for _, J, _ in parts] + [jnp.zeros((len(s), len(x))) for s in shifts])
    by_s = jnp.concatenate([block_diag(*[S for _, _, S in parts]), block_diag(*weights)])
    return residual, jnp.concatenate([by_x, by_s], axis=1)


linear_system = eqx.filter_jit(_assemble)
"""(z, problem, columns) -> residual and Jacobian, compiled: the system a least squares at z would solve."""


def unravel(z: Array, problem: Problem) -> tuple[Array, list[Array]]:
    """(x, one s per record) of the vector that the solver moves."""
    sizes = [trial.n_start for trial in problem[1]]
    n_x = z.shape[0] - sum(sizes)
    return z[:n_x], jnp.split(z[n_x:], list(np.cumsum(sizes)[:-1]))


def first_state(solver: optx.AbstractLeastSquaresSolver, z: Array, problem: Problem, columns: Columns) -> PyTree:
    """The solver's state before its first step."""
    struct = eqx.filter_eval_shape(_residual, z, problem, columns)
    return solver.init(_as_optimistix(columns), z, problem, {}, struct, None, frozenset())


def step(
    solver: optx.AbstractLeastSquaresSolver, z: Array, problem: Problem, columns: Columns, state: PyTree
) -> tuple[Array, PyTree, Array, Array]:
    """One evaluation and one step: the accepted point, the state with the next point to try, r and J at the former."""
    z, state, _ = solver.step(_as_optimistix(columns), z, problem, {}, state, frozenset())
    n = z.shape[0]
    J = jax.vmap(state.f_info.jac.mv, in_axes=1, out_axes=1)(jnp.eye(n))
    return z, state, state.f_info.residual, J


_first_state, _step = eqx.filter_jit(first_state), eqx.filter_jit(step)


def _as_optimistix(columns: Columns) -> Callable[[Array, Problem], tuple[Array, None]]:
    return lambda z, problem: (_residual(z, problem, columns), None)


@dataclasses.dataclass(frozen=True)
class Stopping:
    """When to stop: every parameter changes by less than `tolerance` of itself, or the cost less than `cost_tolerance`.

    The second is eq. 21 read with an absolute value; as printed it stops at the first decrease.
    """

    tolerance: float = 1e-3
    cost_tolerance: float = 0.0
    max_iterations: int = 30


def iterate(
    method: str,
    parametrisation: AbstractParametrisation,
    trials: tuple[Trial, ...],
    theta0: np.ndarray,
    columns: Columns,
    solver: optx.AbstractLeastSquaresSolver,
    stopping: Stopping,
    on_iterate: Callable[[int, np.ndarray, float], None] | None = None,
) -> IdentificationResult:
    """Minimise norm(Y - Ys)^2 over theta and the initial state of every record.

    One iteration is one simulation of every record and one least squares; the simulation that judges the last
    estimate is not an iteration. A residual that is not finite, or a parameter that changes nothing, stops the run.

    References: paper, eq. 16 and 20-21.
    """
    problem = (parametrisation, trials)
    n_x = len(theta0)
    z = jnp.concatenate([parametrisation.encode(jnp.asarray(theta0)), jnp.zeros(sum(t.n_start for t in trials))])
    norm_Y = float(np.linalg.norm(np.concatenate([np.asarray(t.observed) for t in trials])))
    state = _first_state(solver, z, problem, columns)
    trace: list[np.ndarray] = [np.asarray(theta0, dtype=float)]
    costs: list[float] = []
    converged, reason, iterations, simulations = False, "", 0, 0
    while True:
        z, state, residual, jacobian = _step(solver, z, problem, columns, state)
        r, J = np.asarray(residual), np.asarray(jacobian)
        simulations += len(trials)
        with np.errstate(over="ignore"):  # a run on its way out may hold numbers whose squares overflow
            close = np.linalg.norm(r) < DIVERGED * norm_Y
        if not (np.isfinite(r).all() and np.isfinite(J).all() and close):
            return _lost(method, problem, z, iterations, simulations, trace, costs)
        if simulations == len(trials):
            _refuse_dead_columns(J, parametrisation.names)
        theta = np.asarray(parametrisation.decode(z[:n_x]))
        accepted = int(state.num_steps_since_acceptance) == 0
        if accepted:
            costs.append(float(np.linalg.norm(r)) / norm_Y)
            if iterations:
                trace.append(theta)
            if on_iterate:
                on_iterate(iterations, theta, costs[-1])
        if converged:
            break
        if len(costs) > 1 and accepted and abs(costs[-1] - costs[-2]) <= stopping.cost_tolerance * costs[-2]:
            converged, reason = (
                True,
                f"the criterion changes by less than {stopping.cost_tolerance:g} of itself (eq. 21)",
            )
            break
        if iterations == stopping.max_iterations:
            reason = f"not converged after {iterations} iterations"
            break
        iterations += 1
        change = unsettled(parametrisation, z, state.y_eval, n_x, residual, jacobian, stopping.tolerance)
        if accepted and change < 1 and steepness(residual, jacobian) < FLAT:
            converged = True
            reason = f"every parameter changes by less than {100 * stopping.tolerance:g} %, or a hundredth of its std"
        elif not accepted and jnp.max(jnp.abs(state.y_eval - z)) < 1e-12:
            reason = "no step decreases the criterion any further"
            break
    return describe(method, problem, z, r, J, converged, reason, iterations, simulations, trace, costs)


def unsettled(
    parametrisation: AbstractParametrisation, z: Array, proposed: Array, n_x: int, r: Array, J: Array, tolerance: float
) -> Array:
    """Largest change of a parameter, in units of what may be neglected: settled below 1.

    What may be neglected is `tolerance` of the parameter itself, or a hundredth of its standard deviation where that is
    more: a parameter that is zero but for noise never settles relative to itself. Where there is no parameter it is
    `tolerance` of an initial state's typical size.
    """
    if n_x == 0:
        return jnp.max(jnp.abs(proposed - z), initial=0.0) / tolerance
    before, after = parametrisation.decode(z[:n_x]), parametrisation.decode(proposed[:n_x])
    moved = jnp.abs(after - before)
    R = jnp.linalg.qr(J, mode="r")
    inverse = jax.scipy.linalg.solve_triangular(R, jnp.eye(len(z)))
    std = jnp.sqrt(jnp.sum(inverse**2, axis=1) * (r @ r) / (len(r) - len(z)))[:n_x]  # of x
    by_size = moved / (tolerance * jnp.maximum(jnp.abs(after), 1e-300))
    by_std = jnp.abs(proposed - z)[:n_x] / (0.01 * jnp.maximum(std, 1e-300))
    return jnp.max(jnp.minimum(by_size, by_std))


FLAT = 0.01
"""A residual is stationary below this cosine with every column: a damped step may be small anywhere."""


def steepness(r: Array, J: Array) -> Array:
    """Largest cosine between the residual and a column of J; zero for a residual that is rounding."""
    norms = jnp.linalg.norm(J, axis=0) * jnp.linalg.norm(r)
    cosines = jnp.abs(J.T @ r) / jnp.where(norms > 0, norms, 1.0)
    return jnp.where(jnp.linalg.norm(r) > 1e-9 * jnp.linalg.norm(J), jnp.max(cosines, initial=0.0), 0.0)


def _refuse_dead_columns(J: np.ndarray, names: tuple[str, ...]) -> None:
    """A parameter without effect on the compared signal cannot be estimated, and would be silently kept."""
    dead = [name for name, column in zip(names, J.T, strict=False) if not np.any(column)]
    if dead:
        raise InputError(
            f"{', '.join(dead)} changes nothing in this simulation and cannot be identified: leave it out."
        )


def _lost(
    method: str,
    problem: Problem,
    z: Array,
    iterations: int,
    simulations: int,
    trace: list[np.ndarray],
    costs: list[float],
) -> IdentificationResult:
    """A run whose simulation is no longer finite: nothing is estimated, and the last finite iterate is in the trace."""
    x, shifts = unravel(z, problem)
    nothing = np.full(len(x), np.nan)
    at = ", ".join(f"{n} = {v:.4g}" for n, v in zip(problem[0].names, problem[0].decode(x).tolist(), strict=True))
    return IdentificationResult(
        method=method,
        plant=problem[0].plant(problem[0].decode(x)),
        names=problem[0].names,
        units=problem[0].units,
        theta=nothing,
        spread=Spread(nothing, nothing, np.full((len(x), len(x)), np.nan), float("nan")),
        relative_error=float("nan"),
        converged=False,
        reason=f"the simulation diverged at iteration {iterations} ({at})",
        n_iterations=iterations,
        n_simulations=simulations,
        trace=np.array(trace),
        costs=np.array(costs),
        rho=np.full(sum(len(t.observed) for t in problem[1]), np.nan),
        rho_dt=_sample_time(problem),
        rho_unit=problem[1][0].signal.unit,
        shifts=tuple(np.asarray(s) for s in shifts),
    )


def _sample_time(problem: Problem) -> float:
    trial = problem[1][0]
    return float(trial.excitation.dt) * trial.decimation.factor


def describe(
    method: str,
    problem: Problem,
    z: Array,
    r: np.ndarray,
    J: np.ndarray,
    converged: bool,
    reason: str,
    iterations: int,
    simulations: int,
    trace: list[np.ndarray],
    costs: list[float],
) -> IdentificationResult:
    """Put the end of an iteration on the host, with the spread of theta: residual r and Jacobian J at z."""
    parametrisation, trials = problem
    x, shifts = unravel(z, problem)
    n_x = len(x)
    # Columns for theta itself, so that the spread is in SI units.
    slope = np.diag(np.asarray(jax.jacfwd(parametrisation.decode)(x))) if n_x else np.zeros(0)
    W = np.concatenate([J[:, :n_x] / slope, J[:, n_x:]], axis=1)
    n_rows = len(r) - len(z) + n_x  # rows of records; below them those of the initial states
    n_data = sum(len(t.observed) for t in trials)
    per_record = n_rows // n_data
    runs = [len(t.observed) for t in trials for _ in range(per_record)] + ([len(z) - n_x] if len(z) > n_x else [])
    full = spread(W, r, runs)
    norms = np.linalg.norm(W[:, :n_x], axis=0) * np.linalg.norm(r)
    return IdentificationResult(
        method=method,
        plant=parametrisation.plant(parametrisation.decode(x)),
        names=parametrisation.names,
        units=parametrisation.units,
        theta=np.asarray(parametrisation.decode(x)),
        spread=Spread(
            full.std[:n_x],
            full.std_autocorrelated[:n_x],
            full.covariance[:n_x, :n_x],
            float(np.linalg.cond(W[:, :n_x])) if n_x else float("nan"),
        ),
        relative_error=costs[-1],
        converged=converged,
        reason=reason,
        n_iterations=iterations,
        n_simulations=simulations,
        trace=np.array(trace),
        costs=np.array(costs),
        rho=-r[:n_data],
        rho_dt=_sample_time(problem),
        rho_unit=trials[0].signal.unit,
        gradient_cosine=float(np.max(np.abs(W[:, :n_x].T @ r) / norms, initial=0.0)),
        shifts=tuple(np.asarray(s) for s in shifts),
    )
