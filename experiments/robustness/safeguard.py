"""A safeguard for DIDIM's steps that does not ask the criterion to fall.

DIDIM's columns are not the derivative, so its fixed point is not the criterion's minimum: a search that insists on
decrease (Levenberg-Marquardt, Armijo) stalls beside it. What goes wrong far away is coarser: one step leaves the drives
that the loop can carry, and the simulation explodes. So a step is refused, and halved, only where the criterion
is no longer finite or grows by more than a stated factor.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import PyTree


class _Grown(eqx.Module):
    """The search's own state: the length of the step that is being tried."""

    length: Any


class HalveOnBlowUp(optx.AbstractSearch):
    """Full steps; half as long while norm(rho) is not finite or more than `factor` times the last accepted one."""

    factor: float = 2.0

    def init(self, y: PyTree, f_info_struct: PyTree) -> _Grown:
        return _Grown(jnp.asarray(1.0))

    def step(
        self, first_step: Any, y: PyTree, y_eval: PyTree, f_info: Any, f_eval_info: Any, state: _Grown
    ) -> tuple[Any, Any, Any, _Grown]:
        before, after = f_info.as_min(), f_eval_info.as_min()  # both are norm(rho)^2 / 2
        accept = first_step | (jnp.isfinite(after) & (after <= self.factor**2 * before))
        length = jnp.where(accept, 1.0, 0.5 * state.length)
        return length, accept, optx.RESULTS.successful, _Grown(length)


class DampedFromTheStart(optx.ClassicalTrustRegion):
    """Levenberg-Marquardt's search beginning at a damping that is felt: lambda = 1 / `first`, in N^2.

    optimistix begins at lambda = 1; the residual is in N, so J^T J is of the order of 1e6 and the first steps are full
    Gauss-Newton steps, which from far away end in a pit next to the right one.
    """

    first: float = 1e-5

    def init(self, y: PyTree, f_info_struct: Any) -> Any:
        state = super().init(y, f_info_struct)
        return eqx.tree_at(lambda s: s.step_size, state, jnp.asarray(self.first))


def damped_from_the_start(growth: float = 3.5) -> optx.LevenbergMarquardt:
    """optimistix's Levenberg-Marquardt with that search; where three quarters of a step come true, lambda falls by
    `growth`.
    """
    plain: optx.LevenbergMarquardt = optx.LevenbergMarquardt(rtol=0.0, atol=0.0)
    return eqx.tree_at(lambda solver: solver.search, plain, DampedFromTheStart(high_cutoff=0.75, high_constant=growth))


def _silent(**said: Any) -> None:
    """optimistix tells every step what it did; here nobody listens."""


class SafeguardedGaussNewton(optx.AbstractGaussNewton):
    """Gauss-Newton whose steps are halved where they blow up."""

    rtol: float = 0.0
    atol: float = 0.0
    norm: Any = eqx.field(static=True, default=optx.max_norm)
    descent: Any = optx.NewtonDescent()
    search: Any = HalveOnBlowUp()
    verbose: Any = eqx.field(static=True, default=_silent)
