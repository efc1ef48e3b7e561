"""The verdict on what the hunt found, with probabilities and groups of twins."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..effects import AbstractEffect
from . import decide
from .diagnosis import Experiment
from .experiment import separating_experiment
from .hunt import Found, gain, rest
from .judge import relative
from .readings import Readings
from .search import Searcher, Step

FOREIGN = 0.5
"""Share of the force that is left where a record is not this machine's at all."""


@dataclasses.dataclass(frozen=True)
class Quality:
    """What the hunt came to.

    `gain` is the share of the residual's energy that the first effect closed, or would have, if nothing refuted it.
    `followed`, `bursts`, `line`, `line_hz` and `drift` say what the last residual still holds (see `Remainder`),
    `structured` its share that is not noise, `left` that as a share of all there was to explain. `law_left` is the
    share of r_C that nothing explains.
    """

    gain: float
    followed: float
    bursts: float
    line: float
    line_hz: float
    drift: float
    structured: float
    left: float
    law_left: float


def quality(searcher: Searcher, found: Found, law_left: float) -> Quality:
    """Measure it on all records; what is left, on the one that speaks most for something else."""
    closed = 0.0
    if found.steps:
        first = found.steps[0]
        credible = [r for r in first.refits if r.effect not in first.refuted]
        best = next((r for r in credible if r.effect in found.order[:1]), credible[0] if credible else None)
        closed = 0.0 if best is None else gain(first, best)
    each = []
    for k, remains in enumerate(rest(searcher, found.last)):
        before, after = (float(np.sum(fit.residuals[k][0] ** 2)) for fit in (found.nominal, found.last))
        left, explained = remains.structured * after, max(before - after, 0.0)
        share = left / max(left + explained, 1e-300)
        each.append(
            Quality(
                gain=closed,
                **dataclasses.asdict(remains),
                structured=remains.structured,
                left=float(share),
                law_left=law_left,
            )
        )
    return max(each, key=lambda q: _other(q, bool(found.adopted)))


def _other(q: Quality, found: bool) -> float:
    """Probability of something outside the catalogue."""
    # What is only read off the record takes no part in the gap: there is nothing of which a share could be left.
    if found:
        return decide.other(q.left, q.structured, q.drift, q.law_left)
    return decide.unknown(q.structured, q.drift, q.law_left)


@dataclasses.dataclass(frozen=True)
class Verdict:
    """The verdict, the effects it names, their groups of twins, and the first step's ranking."""

    verdict: str
    effects: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    ranking: dict[str, float]


@dataclasses.dataclass(frozen=True)
class Findings:
    """What a verdict is drawn from: all of it is in diagnosis.json.

    Effects `read` off the record and those `adopted`; the evidence of every step, and the effect that each found in
    `order`. `foreign`: most of the force is left, so that a record is not this machine's.
    """

    read: tuple[str, ...]
    adopted: tuple[str, ...]
    quality: Quality
    steps: tuple[decide.Evidence, ...]
    order: tuple[str, ...]
    foreign: bool


def judge_findings(searcher: Searcher, found: Found, q: Quality, read: Readings) -> Verdict:
    """From what the hunt found to a verdict."""
    gaps = [relative(p, out) for p, out in zip(searcher.records, found.last.outputs, strict=True)]
    foreign = max(gaps) > FOREIGN
    steps = tuple(evidence(step) for step in found.steps)
    return conclude(Findings(tuple(read.effects), found.adopted, q, steps, found.order, foreign))


def conclude(found: Findings) -> Verdict:
    """From the evidence to a verdict."""
    q = found.quality
    effects = tuple(dict.fromkeys((*found.read, *found.adopted)))
    other = 1.0 if found.foreign else _other(q, bool(found.adopted))
    if found.read:
        ranking = decide.settled(found.read[0], other)
    else:
        none = decide.none(q.gain)
        # Where nothing was found, structure that is left speaks against none; where something was, for what was found.
        none, shared = (none * (1 - other), other) if not effects else (none, other * (1 - none))
        # What was found first and is not missed beside what was found later is in question no more.
        gone = [name for name in found.order if name not in effects]
        first = found.steps[0].without(gone) if found.steps else decide.NOTHING
        ranking = decide.probabilities(first, none, shared)
    if other > 0.5:
        return Verdict("unexplained", effects, (), ranking)
    if not effects:
        return Verdict("none", (), (), ranking)
    steps = dict(zip(found.order, found.steps, strict=False))  # the last step may have found nothing
    groups = tuple(
        group
        for name in found.adopted
        if name in steps and name in steps[name].effects and (group := decide.twins(steps[name], name, effects))
    )
    return Verdict("ambiguous" if groups else "effect", effects, groups, ranking)


def evidence(step: Step) -> decide.Evidence:
    """Likelihoods of the refits of one step, without those refuted in it."""
    kept = [r for r in step.refits if r.effect not in step.refuted]
    if not kept:
        return decide.NOTHING
    return decide.Evidence(
        tuple(r.effect for r in kept),
        np.array([r.log_likelihood for r in kept]),
        np.array([r.parameters for r in kept], dtype=float),
        step.log_likelihood,
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
