"""The package's own score, nuisances projected out, without the refits that follow it in a diagnosis.

At most one effect: the one whose signature explains most of the residual, none where that share is small.
"""

from didim_jax.gap.score import score
from didim_jax.machine import Machine
from didim_jax.recording import Recording

from .answer import FALSE_PRECISION, Answer, weigh
from .closed_loop import ClosedLoop, closed_loop

NONE = 0.08
"""Share of the whitened residual's energy below which nothing is named. Of 0, 0.03, 0.05, 0.08 ... 0.6 the middle of
those that get most of 73 open cases right (62)."""


def answer(recording: Recording, machine: Machine, *, nominal: ClosedLoop | None = None) -> Answer:
    """The effect of the best score. `nominal` saves fitting the drive again."""
    loop = nominal or closed_loop(recording, machine)
    left: dict[str, float] = {}
    for s in score(loop.searcher.problem(), loop.fit, loop.effects):
        left[s.effect] = min(1 - s.share, left.get(s.effect, 1.0))
    return weigh(left, loop.samples / FALSE_PRECISION, NONE)
