"""The verdict on what the hunt found, with probabilities and groups of twins."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..effects import AbstractEffect
from . import decide
from .diagnosis import Experiment
from .experiment import separating_experiment
from .fit import Fit
from .hunt import Found, energy, gain, structure
from .judge import relative
from .readings import Readings
from .search import Searcher, Step

FOREIGN = 0.5
"""Share of the force that is left where the record is not this machine's at all."""


@dataclasses.dataclass(frozen=True)
class Quality:
    """What the hunt came to, in shares of energy.

    `gain` is what the first effect closed of the residual. `structured_before` and `structured` depend on the motion
    by a model-free atlas, without and with the effects; `left` is how much of that structure they left. `law_left` is
    the share of r_C that nothing explains.
    """

    gain: float
    structured_before: float
    structured: float
    left: float
    law_left: float


def quality(searcher: Searcher, found: Found, law_left: float) -> Quality:
    """Measure it on the first record."""
    first = found.steps[0] if found.steps else None
    best = None if first is None else next((r for r in first.refits if r.effect in found.order[:1]), None)
    if best is None and first is not None and first.refits:
        best = first.refits[0]
    closed = 0.0 if first is None or best is None else gain(first.before, best.fit)
    before, after = structure(searcher, found.nominal), structure(searcher, found.last)
    whole = max(before * energy(found.nominal), 1e-300)
    return Quality(closed, before, after, min(after * energy(found.last) / whole, 1.0), law_left)


@dataclasses.dataclass(frozen=True)
class Verdict:
    """The verdict, the effects it names, their groups of twins, and the first step's ranking."""

    verdict: str
    effects: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    ranking: dict[str, float]


def judge_findings(searcher: Searcher, found: Found, q: Quality, read: Readings) -> Verdict:
    """From the evidence to a verdict."""
    effects = tuple(dict.fromkeys((*read.effects, *found.adopted)))
    # What is only read off the record takes no part in the gap: there is nothing of which a share could be left.
    if found.adopted:
        other = decide.other(q.left, q.structured, q.law_left)
    else:
        other = decide.unknown(q.structured, q.law_left)
    if relative(searcher.records[0], found.last.outputs[0]) > FOREIGN:
        other = 1.0
    if read.effects:
        ranking = decide.settled(read.effects[0], other)
    else:
        none = decide.none(q.gain)
        # Where nothing was found, structure that is left speaks against none; where something was, for what was found.
        none, shared = (none * (1 - other), other) if not effects else (none, other * (1 - none))
        ranking = decide.probabilities(evidence(searcher, found.steps[0], found.order[:1]), none, shared)
    if other > 0.5:
        return Verdict("unexplained", effects, (), ranking)
    if not effects:
        return Verdict("none", (), (), ranking)
    groups = []
    for name in found.adopted:
        step = found.step_of(name)
        if step is not None and (group := decide.twins(evidence(searcher, step, (name,)), name, effects)):
            groups.append(group)
    return Verdict("ambiguous" if groups else "effect", effects, tuple(groups), ranking)


def evidence(searcher: Searcher, step: Step, adopted: Sequence[str] = ()) -> decide.Evidence:
    """Energies of the refits of one step, whitened as the best of them leaves it.

    What fitted better than the effect `adopted` in this step did not gain on other blocks, and is left out.
    """
    model = searcher.model
    names = [r.effect for r in step.refits]
    refits = step.refits[names.index(adopted[0]) if adopted and adopted[0] in names else 0 :]
    if not refits:
        return decide.Evidence((), np.zeros(0), np.zeros(0), 1.0, 1)
    filters = [
        [p.whitening(c, r) for c, r in zip(p.channels, row, strict=True)]
        for p, row in zip(searcher.records, refits[0].fit.residuals, strict=True)
    ]

    def whitened(fit: Fit) -> float:
        return float(
            sum(
                np.sum(w(r) ** 2)
                for row, ws in zip(fit.residuals, filters, strict=True)
                for r, w in zip(row, ws, strict=True)
            )
        )

    return decide.Evidence(
        tuple(r.effect for r in refits),
        np.array([whitened(r.fit) for r in refits]),
        np.array([len(model.of(r.effect)) for r in refits], dtype=float),
        whitened(step.before),
        sum(len(r) for row in step.before.residuals for r in row),
    )


def next_experiment(
    searcher: Searcher, found: Found, verdict: Verdict, catalogue: Sequence[type[AbstractEffect]]
) -> Experiment | None:
    """What would part the first group of twins; None where nothing is ambiguous."""
    step = found.step_of(verdict.groups[0][0]) if verdict.groups else None
    if step is None:
        return None
    fits = [r.fit for r in step.refits if r.effect in verdict.groups[0]]
    return separating_experiment(searcher.records[0], catalogue, searcher.base, fits)
