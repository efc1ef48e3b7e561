"""diffrax's explicit Runge-Kutta methods with their stages written out, for thousands of short steps of a small system.

diffrax runs the stages of a step in a loop of its own, which is right for large systems. Between two samples of a
controller there is one step of a handful of states: written out, it compiles into straight arithmetic, two to three
times as fast, and its derivative likewise.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax as dfx
import equinox as eqx
import jax


class Unrolled(dfx.AbstractSolver):
    """One step of `method` with the same tableau and the same arithmetic; states are any tree of arrays."""

    method: dfx.AbstractERK = eqx.field(static=True, default=dfx.Tsit5())

    term_structure: ClassVar = dfx.AbstractTerm
    interpolation_cls: ClassVar[Callable[..., dfx.LocalLinearInterpolation]] = dfx.LocalLinearInterpolation

    def order(self, terms: Any) -> int | None:
        return self.method.order(terms)

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any) -> None:
        return None

    def func(self, terms: Any, t0: Any, y0: Any, args: Any) -> Any:
        return terms.vf(t0, y0, args)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: None, made_jump: Any
    ) -> tuple[Any, None, dict[str, Any], None, dfx.RESULTS]:
        tableau = self.method.tableau
        assert isinstance(tableau, dfx.ButcherTableau)
        h = t1 - t0
        weights = [float(b) for b in tableau.b_sol]
        rows = [[], *([float(a) for a in row] for row in tableau.a_lower)]
        times = [0.0, *(float(c) for c in tableau.c)]
        last = max(i for i, b in enumerate(weights) if b)  # a stage that only estimates the error is left out
        k: list[Any] = []

        def moved(by: list[float]) -> Any:
            """y0 + h sum(by k), leaf by leaf."""
            used = [(b, ki) for b, ki in zip(by, k, strict=False) if b]
            if not used:
                return y0
            parts, slopes = [b for b, _ in used], [ki for _, ki in used]
            return jax.tree.map(lambda y, *ki: y + h * sum(b * x for b, x in zip(parts, ki, strict=True)), y0, *slopes)

        for row, c in zip(rows[: last + 1], times, strict=False):
            k.append(terms.vf(t0 + c * h, moved(row), args))
        y1 = moved(weights)
        return y1, None, {"y0": y0, "y1": y1}, None, dfx.RESULTS.successful  # type: ignore[return-value]
