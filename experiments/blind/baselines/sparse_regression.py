"""Sparse regression of the inverse model's residual on a dictionary of signatures, forward stepwise by groups.

Orthogonal matching pursuit with one group of columns an effect: at each step the effect that leaves least joins, all of
them and the nominal columns fitted together, as long as it closes a share of what was left. The recorded volts are
first regressed on the terms of the control law: what is found there is named first.
"""

import numpy as np

from didim_jax.machine import Machine
from didim_jax.recording import Recording

from .answer import FALSE_PRECISION, Answer, weigh
from .control_law import left_by_law
from .dictionary import Candidate, everything, left_by
from .inverse import Inverse, inverse, span

NONE = 0.1
"""Share of the residual's energy that the first effect must close, besides what BIC asks."""
MORE = 0.2
"""Share of what is left that every further one must close. Both are the middle of those that get most of 73 open cases
right (55), of 0.05 to 0.3 and of 0.1 to 1; 52 with one effect at most."""
MOST = 3


def answer(recording: Recording, machine: Machine, *, fitted: Inverse | None = None) -> Answer:
    """Up to three effects. `fitted` saves fitting the nominal inverse model again."""
    law = left_by_law(recording, machine)
    x = fitted or inverse(recording, machine)
    candidates, basis, residual = everything(x), x.basis, x.residual
    n = len(residual) / FALSE_PRECISION
    found: list[str] = []
    first: Answer | None = None
    while len(found) < MOST:
        best = _best([c for c in candidates if c.effect not in found], residual, basis)
        penalty = {name: 0.5 * c.parameters * float(np.log(n)) for name, (_, c) in best.items()}
        step = weigh({name: share for name, (share, _) in best.items()}, n, MORE if found else NONE, penalty)
        first = first or step
        if not step.effects:
            break
        name = step.effects[0]
        found.append(name)
        basis = span(np.hstack([basis, best[name][1].columns]))
        residual = x.residual - basis @ (basis.T @ x.residual)
    assert first is not None
    if law:
        first = weigh(law, n, NONE)
    effects = dict.fromkeys([*(first.effects if law else ()), *found])
    return Answer(tuple(effects), first.ranking)


def _best(candidates: list[Candidate], residual: np.ndarray, basis: np.ndarray) -> dict[str, tuple[float, Candidate]]:
    """Effect to the least share that one of its candidates leaves, and that one."""
    best: dict[str, tuple[float, Candidate]] = {}
    for c, share in zip(candidates, left_by(candidates, residual, basis), strict=True):
        if c.effect not in best or share < best[c.effect][0]:
            best[c.effect] = (share, c)
    return best
