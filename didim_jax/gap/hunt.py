"""The hunt for effects: one at a time, refitted together, as long as the next one is worth it; then back again."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..effects import AbstractEffect
from . import decide
from .atlas import Atlas, atlas
from .fit import PRIORS, Fit, Problem
from .judge import CLOCK, at_best_instant
from .prepared import Prepared, motion
from .relevance import halves
from .remainder import Remainder, remainder
from .search import LONG, Refit, Searcher, Step

MOST_EFFECTS = 4
SHARE = 0.02
"""Of the gap closed, what an effect must hold alone to be kept beside others."""
WORTH = 0.08
"""Share that a further effect's score must promise to be tried where what is left looks like noise."""
CERTAIN = 5.0
"""Rise of the log-likelihood, less the penalty, that noise does not give, whichever of all effects is looked for."""
CLOSE = 6.0
"""Differences of it that decide nothing: the one that closes more of the gap comes first."""
SIMPLER = 0.02
"""Share of the energy left that a parameter must be worth in that."""
HIDDEN = 0.1
"""Of what a parameter changes, the share that a half of the blocks must show for it to be refitted there."""
ONCE = 4.0
"""Times `CERTAIN` that is asked of what so shows in one half alone: the other cannot test it."""
TRIED = 3
"""Refits of a step that may show that they gain on blocks they were not fitted to."""


@dataclasses.dataclass(frozen=True)
class Found:
    """Where the hunt ended.

    `read` effects came with the record, `adopted` lists them and those found, in order. `stages` holds the fit after
    each effect found, `order` which one each step found; `last_in` the share of the closed gap that comes back without
    an effect. Effects that act `once` could not be tested where they were not fitted.
    """

    nominal: Fit
    last: Fit
    read: tuple[str, ...]
    adopted: tuple[str, ...]
    steps: tuple[Step, ...]
    stages: tuple[tuple[str, Fit], ...]
    last_in: dict[str, float]
    order: tuple[str, ...]
    once: tuple[str, ...] = ()

    def step_of(self, effect: str) -> Step | None:
        """The step in which an effect was found; None for one that was read off the record."""
        if effect not in self.order:
            return None
        return self.steps[self.order.index(effect)]


def hunt(
    searcher: Searcher,
    nominal: Fit,
    effects: Sequence[AbstractEffect],
    controller: Mapping[str, float],
    say: Callable[[str], None],
) -> Found:
    """Find what `nominal` lacks. `controller` parameters are known already and stay as they are."""
    read = tuple(dict.fromkeys(name.split(".")[0] for name in controller))
    last, adopted = nominal, read
    if controller:
        xs = [searcher.model.encode(x, controller) for x in nominal.xs]
        last = searcher.problem().solve(xs, nominal.chosen, evaluations=12)
        searcher.weigh(last)
        last = searcher.problem().solve(last.xs, last.chosen, evaluations=6)
    steps: list[Step] = []
    stages: list[tuple[str, Fit]] = []
    once: list[str] = []
    while len(adopted) < MOST_EFFECTS:
        worth = WORTH if adopted and all(r.settled for r in rest(searcher, last)) else 0.0
        others = [e for e in effects if e.label() not in adopted]
        step = searcher.step(last, others, adopted, worth)
        steps.append(step)
        if not step.refits:
            break
        best, refuted = _best(searcher, step, adopted)
        steps[-1] = dataclasses.replace(step, refuted=refuted)
        if best is None:
            break
        say(f"{best.effect}: {100 * gain(step, best):.0f} % of what was left")
        adopted = (*adopted, best.effect)
        if _acts_once(searcher, best):
            once.append(best.effect)
        last = _settle(searcher, last, best, adopted)
        stages.append((best.effect, last))
    adopted, last, last_in = _eliminate(searcher, nominal, last, adopted, read)
    kept = tuple(stage for stage in stages if stage[0] in adopted)
    acting_once = tuple(name for name in once if name in adopted)
    order = tuple(name for name, _ in stages)
    return Found(nominal, last, read, adopted, tuple(steps), kept, last_in, order, acting_once)


def _best(searcher: Searcher, step: Step, adopted: tuple[str, ...]) -> tuple[Refit | None, tuple[str, ...]]:
    """The refit to adopt, and those that are out though they may be likelier."""
    least = decide.BESIDE if adopted else decide.RELEVANT
    usual = {r.effect for r in step.refits if _usual(searcher, r)}
    worth = [r for r in step.refits if gain(step, r) >= least and r.effect not in usual]
    names = {r.effect for r in worth}
    certain = [r for r in worth if _certain(searcher, step, r)]
    failed = [*sorted(usual), *(r.effect for r in worth if r not in certain)]
    for refit in _ordered(certain)[:TRIED]:
        if _gains_elsewhere(searcher, step.before, refit, adopted, 0.5 * least):
            slight = [r.effect for r in step.refits if r.effect not in names and _likely(r) > _likely(refit)]
            return refit, tuple(dict.fromkeys((*failed, *slight)))
        failed.append(refit.effect)
    return None, tuple(dict.fromkeys((*failed, *(r.effect for r in certain))))  # nobody is named untested


def rest(searcher: Searcher, fit: Fit) -> list[Remainder]:
    """What of every record's force residual is not noise."""
    return [remainder(p, row[0]) for p, row in zip(searcher.records, fit.residuals, strict=True)]


def atlas_of(record: Prepared, residual: np.ndarray, floor: float) -> Atlas:
    """The atlas of a residual of the record's force; `floor` is the diagnosis' own, N rms."""
    q, v, a, qg = motion(record)
    drawn = atlas(record.t, residual, q, v, a, qg, record.dt, record.bench.lead)
    return dataclasses.replace(drawn, floor_rms=floor)


def gain(step: Step, refit: Refit) -> float:
    """Share of the force residual's energy that a refit closes; hardly any where noise alone could have given it.

    Energy says what matters; the likelihood, in which a slow drift weighs little, what is certain.
    """
    share = 1 - energy(refit.fit) / energy(step.before)
    # What closes most of the gap needs less: noise that looks like an effect seldom is all the noise there is.
    certain = _likely(refit) - step.log_likelihood > CERTAIN * (1 - max(share, 0.0))
    return share if certain else min(share, 0.3 * decide.RELEVANT)


def _likely(refit: Refit) -> float:
    """Log-likelihood with the effect, less what its parameters cost."""
    return refit.log_likelihood - decide.PENALTY * refit.parameters


def energy(fit: Fit) -> float:
    """Energy of the force residual in the band, over all records."""
    return float(sum(row[0] @ row[0] for row in fit.residuals))


def _ordered(refits: Sequence[Refit]) -> list[Refit]:
    """Likeliest first, but of those as likely as the best the one that leaves the least energy."""
    best = max((_likely(r) for r in refits), default=0.0)
    near = [r for r in refits if _likely(r) > best - CLOSE]
    far = [r for r in refits if _likely(r) <= best - CLOSE]

    def left(r: Refit) -> float:
        return energy(r.fit) * (1 + SIMPLER * r.parameters)

    return [*sorted(near, key=left), *sorted(far, key=_likely, reverse=True)]


def _usual(searcher: Searcher, refit: Refit) -> bool:
    """Whether the effect is no larger than every machine has it."""
    effect = next(e for e in searcher.model.effects if e.label() == refit.effect)
    values = searcher.model.decode(refit.fit.xs[0])
    return bool(effect.least) and all(abs(values[f"{refit.effect}.{k}"]) < v for k, v in effect.least.items())


def _gains_elsewhere(searcher: Searcher, before: Fit, best: Refit, adopted: tuple[str, ...], least: float) -> bool:
    """Whether the effect gains this share on blocks of time that are left out of a refit, both halves together.

    The refits begin where the one to all blocks ended: what a half cannot move stays there.
    """
    split = _halves(searcher)
    hidden, start = _hidden(searcher, best.fit), searcher.model.of("start")
    both = (before, before.chosen, adopted), (best.fit, searcher.chosen(before, best.effect), (*adopted, best.effect))

    def elsewhere(trial: tuple[int, tuple[Fit, Sequence[int], tuple[str, ...]]]) -> float:
        half, (fit, chosen, free) = trial
        mask = [halved == half for halved in split]
        held = {*start, *hidden[half]}  # stays as all blocks together have it
        found = searcher.problem(mask=mask).solve(
            fit.xs, [i for i in chosen if i not in held], frozenset(free), evaluations=4
        )
        return sum(float(np.sum(row[0][~m] ** 2)) for row, m in zip(found.residuals, mask, strict=True))

    left = searcher.side_by_side(elsewhere, [(half, one) for half in (0, 1) for one in both])
    return left[1] + left[3] < (1 - least) * (left[0] + left[2])


def _halves(searcher: Searcher) -> list[np.ndarray]:
    return [halves(len(p.channels[0].observed), p.dt) for p in searcher.records]


def _hidden(searcher: Searcher, fit: Fit) -> tuple[set[int], set[int]]:
    """Places of what each of the halves hardly shows: the instant of a push that lies in the other."""
    places = searcher.shared(fit)
    half = np.concatenate([h for h, p in zip(_halves(searcher), searcher.records, strict=True) for _ in p.channels])
    J = fit.jacobian[: len(half), : len(places)]
    shown = [np.sum(J[half == k] ** 2, axis=0) for k in (0, 1)]
    one, two = (
        {i for i, s, t in zip(places, mine, shown[0] + shown[1], strict=True) if s < HIDDEN * t} for mine in shown
    )
    return one, two


def _acts_once(searcher: Searcher, refit: Refit) -> bool:
    """Whether one half of the blocks hardly shows some parameter of the effect."""
    one, two = _hidden(searcher, refit.fit)
    return bool((one | two) & set(searcher.model.of(refit.effect)))


def _certain(searcher: Searcher, step: Step, refit: Refit) -> bool:
    """Whether what acts once is so likely that no test elsewhere is needed; true of everything else."""
    return _likely(refit) - step.log_likelihood > ONCE * CERTAIN or not _acts_once(searcher, refit)


def _settle(searcher: Searcher, before: Fit, best: Refit, adopted: tuple[str, ...]) -> Fit:
    """The refit once more, its instants tried elsewhere and its channels weighed by what it leaves."""
    model, fit, free = searcher.model, best.fit, frozenset(adopted)
    chosen = searcher.chosen(before, best.effect)
    if set(fit.chosen) != set(chosen):  # a cheap refit, of some of the places
        fit = searcher.problem().solve(fit.xs, chosen, free, LONG)
    effect = next(e for e in model.effects if e.label() == best.effect)
    for parameter in effect.own_to_record:
        name = f"{best.effect}.{parameter}"
        if name in model.index:
            moved = searcher.problem().solve(_at_best_instant(searcher, fit, name), chosen, free, 18)
            fit = moved if moved.cost < fit.cost else fit
    for _ in range(2):
        whitening = searcher.whitening
        searcher.weigh_by_noise(fit)
        settled = searcher.problem().solve(fit.xs, chosen, free, 8)
        if energy(settled) > energy(before):  # weighed otherwise, more may be left than there was
            searcher.whitening = whitening
            break
        fit = settled
    return fit


def _at_best_instant(searcher: Searcher, fit: Fit, name: str) -> list[np.ndarray]:
    """x of every record with one instant shifted to where it leaves least."""
    # An instant that was found for one record is a guess of another's, by as much as clocks differ.
    shifts = np.linspace(-0.4, 0.4, 32) if len(searcher.records) == 1 else np.linspace(-CLOCK, CLOCK, 76)
    return [
        at_best_instant(Problem([p], [whitening]), x, name, shifts, searcher.side_by_side)
        for p, x, whitening in zip(searcher.records, fit.xs, searcher.whitening, strict=True)
    ]


def _eliminate(
    searcher: Searcher, nominal: Fit, last: Fit, adopted: tuple[str, ...], read: tuple[str, ...]
) -> tuple[tuple[str, ...], Fit, dict[str, float]]:
    """Take each effect out again: one that is not missed goes; the others say what they hold of the gap."""
    while True:
        whole = max(energy(nominal) - energy(last), 1e-300)
        if len(adopted) == 1:
            without = {adopted[0]: nominal}
        else:
            fits = searcher.side_by_side(functools.partial(_without, searcher, last, adopted), adopted)
            without = dict(zip(adopted, fits, strict=True))
        last_in = {n: float(np.clip((energy(fit) - energy(last)) / whole, 0.0, 1.0)) for n, fit in without.items()}
        superfluous = [
            n
            for n in adopted
            if n not in read
            and len(adopted) > 1
            and (last_in[n] < SHARE or 1 - energy(last) / energy(without[n]) < decide.BESIDE)
        ]
        if not superfluous:
            return adopted, last, last_in
        gone = superfluous[-1]  # a later one was looked for in what an earlier one had left
        adopted, last = tuple(n for n in adopted if n != gone), without[gone]


def _without(searcher: Searcher, last: Fit, adopted: tuple[str, ...], name: str) -> Fit:
    """The fit without one of its effects."""
    model = searcher.model
    places = model.of(name)
    null = {model.names[i]: model.entries[i].null for i in places}
    xs = [model.encode(x, null) for x in last.xs]
    kept = [i for i in last.chosen if i not in places or model.names[i] in PRIORS]
    return searcher.problem().solve(xs, kept, frozenset(adopted) - {name}, 12)
