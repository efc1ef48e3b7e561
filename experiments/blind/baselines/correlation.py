"""Largest raw correlation of the closed-loop residual with a signature: nothing projected out, whitened or refitted.

The signature of an effect is what it changes in the simulation at its usual size, as in the package's score. Where
one has several columns, the correlation is the multiple one. At most one effect.
"""

import dataclasses

from didim_jax.gap.fit import Problem
from didim_jax.gap.noise import Whitening
from didim_jax.gap.score import score
from didim_jax.machine import Machine
from didim_jax.recording import Recording

from .answer import FALSE_PRECISION, Answer, weigh
from .closed_loop import ClosedLoop, closed_loop

NONE = 0.05
"""Square of the correlation below which nothing is named. Of 0, 0.03, 0.05, 0.08 ... 0.6 the one that gets most of 73
open cases right (54)."""


def answer(recording: Recording, machine: Machine, *, nominal: ClosedLoop | None = None) -> Answer:
    """The effect of the largest correlation. `nominal` saves fitting the drive again."""
    loop = nominal or closed_loop(recording, machine)
    flat = [[Whitening.flat(len(c.observed), c.rms) for c in p.channels] for p in loop.searcher.records]
    bare = dataclasses.replace(loop.fit, jacobian=loop.fit.jacobian[:, :0])  # no nuisance to project out
    left: dict[str, float] = {}
    for s in score(Problem(loop.searcher.records, flat), bare, loop.effects):
        left[s.effect] = min(1 - s.share, left.get(s.effect, 1.0))
    return weigh(left, loop.samples / FALSE_PRECISION, NONE)
