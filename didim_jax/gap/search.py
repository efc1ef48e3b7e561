"""Which effect: score all of them, refit the best with exact Jacobians, keep what gains; again, until nothing does."""

import dataclasses
import functools
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from ..effects import AbstractEffect, Block
from ..errors import InputError
from .decide import DRIFT
from .fit import PRIORS, Fit, Problem
from .model import FRICTION
from .noise import Whitening
from .prepared import Prepared
from .score import Score, score

SHORT, LONG = 5, 18
"""Evaluations of a first, cheap refit of every candidate, and of one of the best with all that may move."""

RIVAL = 3.0
"""Times the least cost after the cheap refits that a rival may leave and still be refitted in full."""

NEARLY = 1.3
"""Times the cost of the best full refit within which a cheap one is made full as well."""

SAME = 1.03
"""Times its cost within which another refit of the effect is on the way to the same minimum."""


@dataclasses.dataclass(frozen=True)
class Refit:
    """An effect with its refit: joined to those adopted before it.

    `log_likelihood` of what it leaves, and how many of the effect's `parameters` change anything on these records.
    """

    effect: str
    fit: Fit
    score: Score
    log_likelihood: float
    parameters: int


@dataclasses.dataclass(frozen=True)
class Step:
    """One step of the search: every effect's best score, and the refits made, least cost first.

    `log_likelihood` is that of `before`. `refuted` are those that fitted well and closed too little, or gained nothing
    where they were not fitted.
    """

    before: Fit
    log_likelihood: float
    scores: tuple[Score, ...]
    refits: tuple[Refit, ...]
    refuted: tuple[str, ...] = ()


class _Trial(NamedTuple):
    """A refit on the way, from one start."""

    score: Score
    fit: Fit

    @property
    def effect(self) -> str:
        return self.score.effect


SHARPNESS = (3e-6, 3e-5)
"""Smoothing speeds (m/s) of friction's sign that the nominal fit tries besides its own."""


class Searcher:
    """Records of one machine, how their residuals are weighed, and how many refits run side by side."""

    def __init__(self, records: Sequence[Prepared], threads: int = 1) -> None:
        self.records = tuple(records)
        self.threads = threads
        self._plain: np.ndarray = np.zeros(0)  # where the nominal fit began: a plant as the record suggests it
        self.model = self.records[0].model
        self.whitening: list[list[Whitening]] = [
            [Whitening.flat(len(c.observed), 0.02 * c.rms) for c in p.channels] for p in self.records
        ]

    def problem(self, mask: Sequence[np.ndarray] | None = None) -> Problem:
        """The least-squares problem as it is weighed now."""
        return Problem(self.records, self.whitening, self.own, mask)

    @functools.cached_property
    def own(self) -> frozenset[int]:
        """Places of what every record has a value of its own of, besides its start: clocks do not start together."""
        if len(self.records) == 1:
            return frozenset()
        names = (f"{e.label()}.{p}" for e in self.model.effects for p in e.own_to_record)
        return frozenset(self.model.index[name] for name in names if name in self.model.index)

    def weigh(self, fit: Fit) -> None:
        """Let every channel weigh by what this fit leaves of it."""
        self.whitening = [
            [p.whitening(c, r) for c, r in zip(p.channels, row, strict=True)]
            for p, row in zip(self.records, fit.residuals, strict=True)
        ]

    def weigh_by_noise(self, fit: Fit) -> None:
        """The same by the noise that what it leaves shows: only where it holds no large effect any more.

        A record whose force still drifts further than a machine does weighs as a whole: what is slow in it is to be
        explained, and as noise it would weigh nothing.
        """
        self.weigh(fit)
        for k, (p, row) in enumerate(zip(self.records, fit.residuals, strict=True)):
            noises = [p.noise(c, r) for c, r in zip(p.channels, row, strict=True)]
            if noises[0].drift <= DRIFT:
                self.whitening[k] = [noise.whitening(len(r), p.dt) for noise, r in zip(noises, row, strict=True)]

    def log_likelihood(self, fit: Fit) -> float:
        """Of what a fit leaves of all records and channels, each under the noise that its own spectrum shows."""
        return sum(
            p.noise(c, r).log_likelihood
            for p, row in zip(self.records, fit.residuals, strict=True)
            for c, r in zip(p.channels, row, strict=True)
        )

    def shared(self, fit: Fit) -> list[int]:
        """Places that all records of a fit share, in the order of the first columns of its Jacobian."""
        own = self.own | set(self.model.of("start"))
        return [i for i in fit.chosen if i not in own]

    def columns(self, fit: Fit) -> list[int]:
        """Place of each of the first columns of its Jacobian: what all records share, then what is the first one's."""
        shared = self.shared(fit)
        return [*shared, *(i for i in fit.chosen if i not in shared)]

    def _acting(self, effect: str, fit: Fit) -> int:
        """How many parameters of an effect change anything on these records."""
        columns = self.columns(fit)
        moved = np.any(fit.jacobian[: len(fit.innovations), : len(columns)] != 0, axis=0)
        return sum(bool(moved[columns.index(i)]) for i in self.model.of(effect) if i in columns)

    def side_by_side[A, B](self, work: Callable[[A], B], items: Iterable[A]) -> list[B]:
        """Work on the items in the threads; results in their order."""
        if self.threads == 1:
            return [work(item) for item in items]
        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(work, items))

    @property
    def base(self) -> list[int]:
        """Places of what every fit moves: plant, smoothing, initial state, and what every machine has a little of."""
        model = self.model
        plant = [i for i in model.of("") if model.names[i] != "offset"]  # that one is an effect here
        acting = {e.label() for e in model.effects if self.flexible or e.block is not Block.COUPLING}
        always = [i for name, i in model.index.items() if name in PRIORS and model.entries[i].owner in acting]
        return list(dict.fromkeys([*plant, *model.of("start"), *always]))

    @property
    def flexible(self) -> bool:
        """Whether the nominal plant has a coupling."""
        return "K12" in self.model.index

    def nominal(self) -> Fit:
        """The fit without any effect: the best of a grid over mass ratio and mode, then least squares."""
        starts = self._starts()
        p = self.records[0]
        outputs = self.side_by_side(p.model.run, starts)
        costs = [float(np.sum((p.channels[0].observed - p.filtered(out, p.channels[0])) ** 2)) for out in outputs]
        if not np.isfinite(costs).any():
            raise InputError(f"{p.recording.label}: no drive of this kind follows it; check model and units.")
        self._plain = starts[int(np.nanargmin(costs))]
        fit = self.problem().solve(self._plain, self.base, evaluations=20)
        fit = self._sharpened(fit)
        self.weigh(fit)
        fit = self.problem().solve(fit.xs, self.base, evaluations=12)
        if not fit.ok:
            raise InputError(f"{p.recording.label}: the fit of the nominal drive diverged; check model and units.")
        return fit

    def _sharpened(self, fit: Fit) -> Fit:
        """The fit from the best of several smoothing speeds: far from the right one it shows no slope."""
        problem, model = self.problem(), self.model

        def from_speed(v_eps: float) -> Fit:
            return problem.solve([model.encode(x, {"v_eps": v_eps}) for x in fit.xs], self.base, evaluations=3)

        found = [fit, *self.side_by_side(from_speed, SHARPNESS)]
        best = min((f for f in found if f.ok), key=lambda f: f.cost, default=fit)
        return best if best is fit else problem.solve(best.xs, self.base, evaluations=12)

    def _starts(self) -> list[np.ndarray]:
        model, rigid = self.model, self.records[0].rigid
        M, Fv, Fc = max(rigid["M"], 1.0), max(rigid["Fv"], 1.0), max(rigid["Fc"], 0.1)
        zero = np.zeros(len(model.entries))
        if not self.flexible:
            return [model.encode(zero, {"M": M, "Fv": Fv, "Fc": Fc, "v_eps": 1e-3})]
        return [
            model.encode(
                zero,
                {
                    "M1": lam * M,
                    "M2": (1 - lam) * M,
                    "K12": (1 - lam) * M * (2 * np.pi * f_n) ** 2,
                    "Fv1": Fv / 2,
                    "Fv2": Fv / 2,
                    "Fc1": Fc / 2,
                    "Fc2": Fc / 2,
                    "v_eps": 3e-4,
                    "coupling_damping.C": 25.0,
                },
            )
            for lam in (0.3, 0.45, 0.6, 0.75)
            for f_n in (11.0, 14.0, 17.0, 21.0, 26.0, 33.0, 43.0, 60.0)
        ]

    def step(
        self,
        before: Fit,
        effects: Sequence[AbstractEffect],
        adopted: tuple[str, ...],
        worth: float = 0.0,
    ) -> Step:
        """Score `effects`, refit the best of them on top of what `before` holds.

        Nothing is refitted where no score reaches the share `worth`. Beside others fewer are tried: less is left then,
        and every pair is a program of its own.
        """
        most, again_with = (4, 2) if adopted else (7, 3)
        problem = self.problem()
        scores = score(problem, before, effects, self.side_by_side)
        likely = self.log_likelihood(before)
        if not scores or scores[0].share < worth:
            return Step(before, likely, tuple(scores), ())
        twins = {e.label(): e.twins for e in effects}
        by_effect: dict[str, list[Score]] = {}
        for s in scores:
            by_effect.setdefault(s.effect, []).append(s)
        tried = [
            s
            for name in list(by_effect)[:most]
            for s in _distinct(by_effect[name], 1 if by_effect[name][0].probe.linear else 2)
        ]
        # A mode is found from several starts or not at all.
        seen = {id(s) for s in tried}
        tried += [
            s for name in list(by_effect)[:again_with] for s in _distinct(by_effect[name], 2) if id(s) not in seen
        ]
        starts = [(s, before.xs) for s in tried]
        if self._bent(before) and not adopted:
            starts += [(s, (self._plain,) * len(self.records)) for s in tried]

        def short(start: tuple[Score, Sequence[np.ndarray]]) -> _Trial:
            s, xs = start
            chosen = [i for i in self.chosen(before, s.effect) if not self._small(i, (s.effect, *adopted))]
            starts = [self.model.encode(x, s.start) for x in xs]
            return _Trial(s, problem.solve(starts, chosen, frozenset({s.effect, *adopted}), SHORT))

        def long(r: _Trial) -> _Trial:
            fit = problem.solve(r.fit.xs, self.chosen(before, r.effect), frozenset({r.effect, *adopted}), LONG)
            return _Trial(r.score, fit)

        first = sorted((r for r in self.side_by_side(short, starts) if r.fit.ok), key=lambda r: r.fit.cost)
        if not first:
            return Step(before, likely, tuple(scores), ())
        # Several probes of one effect may end in several minima: the best two effects get all of theirs.
        near = _apart([r for r in first if r.fit.cost < RIVAL * first[0].fit.cost])
        leaders = list(dict.fromkeys(r.effect for r in near))[:4]
        again = [r for r in near if r.effect in leaders[:2]][:4]
        again += [next(r for r in near if r.effect == name) for name in leaders[2:]]
        whole = [r for r in self.side_by_side(long, again) if r.fit.ok]
        # What is nearly as good, or known to look the same, is compared when it has arrived, too.
        least = min((r.fit.cost for r in whole), default=np.inf)
        alike = {e for r in whole if r.fit.cost == least for e in twins.get(r.effect, ())}
        late = {r.effect: r for r in reversed(near) if r.effect in alike or r.fit.cost < NEARLY * least}
        done = {r.effect for r in again}
        whole += [r for r in self.side_by_side(long, (late[e] for e in late if e not in done)) if r.fit.ok]
        best: dict[str, _Trial] = {}
        for r in [*sorted(whole, key=lambda r: r.fit.cost), *first]:
            best.setdefault(r.effect, r)
        top = tuple(ss[0] for ss in by_effect.values())
        refits = (
            Refit(r.effect, r.fit, r.score, self.log_likelihood(r.fit), self._acting(r.effect, r.fit))
            for r in sorted(best.values(), key=lambda r: r.fit.cost)
        )
        return Step(before, likely, top, tuple(refits))

    def chosen(self, before: Fit, effect: str) -> list[int]:
        """Places of what is refitted with an effect."""
        return list(dict.fromkeys([*before.chosen, *self.model.of(effect)]))

    def _small(self, place: int, free: Collection[str]) -> bool:
        """Whether it belongs to the start or to what every machine has a little of: it can wait for the full refit."""
        entry = self.model.entries[place]
        return entry.owner == "start" or (self.model.names[place] in PRIORS and entry.owner not in free)

    def _bent(self, fit: Fit) -> bool:
        """Whether an effect has pushed the plant's friction as low as it may go."""
        names, low, x = self.model.names, 0.9 * self.model.lower, fit.xs[0]
        return any(x[i] < low[i] for i in self.model.of("") if names[i].startswith(FRICTION))


def _distinct(scores: Sequence[Score], most: int) -> list[Score]:
    """The best probes of one effect, not two whose signatures are nearly the same."""
    kept: list[Score] = []
    for s in scores:
        if len(kept) >= most:
            break
        if all(_cosine(s, other) < 0.98 for other in kept):
            kept.append(s)
    return kept


def _apart(trials: Sequence[_Trial]) -> list[_Trial]:
    """Without those of an effect that are on their way to a minimum another one nears, too; least cost first."""
    kept: list[_Trial] = []
    for r in trials:
        if not any(r.effect == other.effect and r.fit.cost < SAME * other.fit.cost for other in kept):
            kept.append(r)
    return kept


def _cosine(a: Score, b: Score) -> float:
    u, v = a.signature[:, 0], b.signature[:, 0]
    return float(abs(u @ v) / max(np.linalg.norm(u) * np.linalg.norm(v), 1e-300))
