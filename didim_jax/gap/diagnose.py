"""From records to a diagnosis: where the gap lies, which effect causes it, how far it shrinks on another trajectory."""

import dataclasses
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from ..effects import AbstractEffect
from ..hygiene import admit
from ..machine import Machine
from ..recording import Recording
from ..signals import LowPass, central_difference
from . import decide
from .atlas import Atlas, atlas
from .diagnosis import Candidate, Diagnosis, Estimate, Experiment, Gap, Run, Shift
from .experiment import separating_experiment
from .fit import Fit
from .floor import repeat_floor
from .judge import judge, left, relative, rms_of
from .law import LawResidual, Pulse, encoder_grid, examine_law
from .prepared import Prepared, prepare
from .search import Refit, Searcher, Step
from .spread import standard_deviations
from .whereabouts import whereabouts

MOST_EFFECTS = 4
_TRANSIENT = 0.6  # s
SHARE = 0.025
"""Of the gap closed, what an effect must hold alone to be kept beside others."""
SETTLED, WORTH = 0.05, 0.04
"""Structure left after an effect below which a further one is only tried if its score promises this share."""
CONTROLLER = ("position_gain", "velocity_gain", "velocity_filter")
INVISIBLE = ("drive_gain",)
"""Absorbed by the base parameters exactly: never looked for."""
SEEN = ("encoder_quantisation",)
"""Read off the record, not fitted."""


@dataclasses.dataclass(frozen=True)
class Found:
    """Where the search ended."""

    nominal: Fit
    last: Fit
    adopted: tuple[str, ...]
    steps: tuple[Step, ...]
    last_in: dict[str, float]
    fixed: tuple[str, ...]


def diagnose(
    recordings: Sequence[Recording],
    machine: Machine,
    catalogue: Sequence[type[AbstractEffect]],
    *,
    outline: Recording | None = None,
    open_check: Callable[[float], Recording] | None = None,
    exclude: Collection[str] = (),
    devices: Sequence[Any] = (None,),
    say: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Diagnose one machine from records of it.

    `outline` is the check record with nothing measured in it; `open_check` is called once, with the predicted gap,
    after everything else is decided, and returns the record that is then judged. `devices`: where refits may run side by side.
    Raises InputError: a record that cannot be used.
    """
    remarks = [f"{r.label}: {f.message}" for r in recordings for f in admit(r, machine)]
    laws = [examine_law(r, machine) for r in recordings]
    injected = tuple(law.pulses if "disturbance_pulses" not in exclude else () for law in laws)
    for r, pulses in zip(recordings, injected, strict=True):
        if pulses:
            volts = np.median([abs(p.volts) for p in pulses])
            remarks.append(
                f"{r.label}: vir holds {len(pulses)} pulses of {volts:.4g} V that the control law does not give."
            )
    quiet = [_with(r, pulses) for r, pulses in zip(recordings, injected, strict=True)]
    replicas = [[prepare(r, machine, catalogue, device) for r in quiet] for device in devices]
    searcher = Searcher(replicas)
    searched = [e for e in searcher.model.effects if e.label() not in (*CONTROLLER, *INVISIBLE, *SEEN, *exclude)]

    say("nominal plant")
    nominal = searcher.nominal()
    controller, law_left = _controller(laws[0], exclude, remarks)
    found = _search(searcher, nominal, searched, controller, say)
    quality = Quality.of(searcher, found, law_left)
    grid = encoder_grid(recordings[0], machine)
    verdict = _verdict(searcher, found, quality, exclude, controller, grid, remarks)

    record = searcher.records[0]
    run = Run(
        recordings[0].name,
        record.model.dt * np.arange(record.model.n),
        recordings[0].tau,
        nominal.outputs[0][0],
        found.last.outputs[0][0],
    )
    before, after = relative(record, nominal.outputs[0]), relative(record, found.last.outputs[0])
    floor = _floor(record, found, quality, after)
    gaps = {"fit": Gap(before, after, floor)}
    runs = [run]
    share, interval = _closed(record, nominal.outputs[0], found.last.outputs[0], floor)

    if open_check is not None and outline is not None:
        predicted = _predict(outline, machine, catalogue, record, found, floor, after)
        say("check record")
        checked = open_check(predicted)
        remarks += [f"{checked.label}: {f.message}" for f in admit(checked, machine)]
        second = prepare(checked, machine, catalogue, devices[0], record.bench)
        adopted = [e for e in searcher.model.effects if e.label() in found.adopted]
        plain = judge(second, nominal.xs[0], (), rms_of(nominal))
        full = judge(second, found.last.xs[0], adopted, rms_of(found.last)) if found.adopted else plain
        floor_check = (
            floor
            * _norm(record)
            / _norm(second)
            * (len(record.channels[0].observed) ** -0.5)
            / (len(second.channels[0].observed) ** -0.5)
        )
        gaps["check"] = Gap(relative(second, plain.outputs), relative(second, full.outputs), floor_check, predicted)
        runs.append(
            Run(
                checked.name,
                second.model.dt * np.arange(second.model.n),
                checked.tau,
                plain.outputs[0],
                full.outputs[0],
            )
        )
        share, interval = _closed(second, plain.outputs, full.outputs, floor_check)
        remarks += [f"{name} is {value:.4g} on the check record: its own." for name, value in full.moved.items()]

    first = next((e for e in searcher.model.effects if found.adopted and e.label() == found.adopted[0]), None)
    return Diagnosis(
        verdict=verdict.verdict,
        effects=verdict.effects,
        ambiguous_with=verdict.groups,
        ranking=tuple(verdict.ranking.items()),
        parameters=_parameters(searcher, found, verdict.effects),
        block=None if first is None else first.block.value,
        base=_base(searcher, found),
        gap=gaps,
        share=share,
        interval=interval,
        last_in={e: found.last_in[e] for e in verdict.effects if e in found.last_in},
        where=whereabouts(searcher, nominal, found.last, found.adopted),
        experiment=_experiment(searcher, found, verdict, catalogue),
        remarks=tuple(remarks),
        candidates=_candidates(searcher, found, verdict.ranking, floor),
        atlas=_atlas(record, left(record, nominal.outputs[0])),
        atlas_after=_atlas(record, left(record, found.last.outputs[0])),
        runs=tuple(runs),
        evidence={
            **dataclasses.asdict(quality),
            "steps": [dataclasses.asdict(_evidence(searcher, step)) for step in found.steps],
        },
        machine=machine.name,
        synthetic=any(r.synthetic for r in recordings),
    )


def _with(recording: Recording, pulses: Sequence[Pulse]) -> Recording:
    """The record with pulses that were found in its control law as a known signal, V."""
    if not pulses:
        return recording
    volts = np.zeros(len(recording)) if recording.injected is None else np.array(recording.injected)
    t = recording.t - recording.t[0]
    for pulse in pulses:
        volts[(t >= pulse.on - 0.5 * recording.dt) & (t < pulse.off - 0.5 * recording.dt)] += pulse.volts
    return dataclasses.replace(recording, injected=volts)


# -- search ------------------------------------------------------------------------------------------------------


def _controller(law: LawResidual, exclude: Collection[str], remarks: list[str]) -> tuple[dict[str, float], float]:
    """What the control-law residual says of the controller: parameters by name, and share of r_C left unexplained."""
    if not law.significant:
        return {}, 0.0
    best = law.best(exclude)
    remarks.append(
        f"vir differs from the documented control law by {law.relative:.3g} of the commanded force in the band; "
        + (f"{' and '.join(best.effects)} leaves {best.rms:.2g} V." if best.effects else "no known effect explains it.")
    )
    allowed = {k: v for k, v in best.parameters.items() if k.split(".")[0] in CONTROLLER}
    return allowed, 1 - best.share


def _search(
    searcher: Searcher,
    nominal: Fit,
    effects: Sequence[AbstractEffect],
    controller: dict[str, float],
    say: Callable[[str], None],
) -> Found:
    model = searcher.model
    fixed = tuple(dict.fromkeys(name.split(".")[0] for name in controller))
    last, adopted, steps = nominal, fixed, []
    if controller:
        xs = [model.encode(x, controller) for x in nominal.xs]
        last = searcher.problem().solve(xs, nominal.chosen, evaluations=12)
        searcher.weigh(last)
        last = searcher.problem().solve(last.xs, last.chosen, evaluations=6)
    free = adopted
    while len(adopted) < MOST_EFFECTS:
        settled = bool(adopted) and _structure(searcher, last) < SETTLED
        others = [e for e in effects if e.label() not in adopted]
        step = searcher.step(last, others, free, worth=WORTH if settled else 0.0)
        steps.append(step)
        if not step.refits:
            break
        best = step.refits[0]
        say(f"{best.effect}: {100 * (1 - best.fit.cost / last.cost):.0f} % of what was left")
        if 1 - best.fit.cost / last.cost < decide.RELEVANT:
            break
        adopted = free = (*adopted, best.effect)
        last = _settle(searcher, best, adopted)
    adopted, last, last_in = _eliminate(searcher, nominal, last, adopted, fixed)
    return Found(nominal, last, adopted, tuple(steps), last_in, fixed)


def _settle(searcher: Searcher, best: Refit, adopted: tuple[str, ...]) -> Fit:
    """The refit once more, its instants tried elsewhere and its channels weighed by what it leaves."""
    model, fit, free = searcher.model, best.fit, frozenset(adopted)
    effect = next(e for e in model.effects if e.label() == best.effect)
    for parameter in effect.own_to_record:
        name = f"{best.effect}.{parameter}"
        if name not in model.index:
            continue
        at = model.decode(fit.xs[0])[name]
        shifts = np.concatenate([np.linspace(-0.4, 0.4, 32)])
        problem = searcher.problem()
        trials = [[model.encode(x, {name: at + s}) for s in shifts] for x in fit.xs]
        costs = np.zeros(len(shifts))
        for p, xs, filters in zip(problem.records, trials, problem.whitening, strict=True):
            for k, out in enumerate(p.model.batch(np.array(xs))):
                rows = [w(c.observed - p.filtered(out, c)) for c, w in zip(p.channels, filters, strict=True)]
                costs[k] += sum(float(r @ r) for r in rows)
        best_shift = int(np.nanargmin(costs))
        moved = problem.solve([xs[best_shift] for xs in trials], fit.chosen, free, 18)
        if moved.cost < fit.cost:
            fit = moved
    searcher.weigh(fit)
    return searcher.problem().solve(fit.xs, fit.chosen, free, 12)


def _structure(searcher: Searcher, fit: Fit) -> float:
    """Share of the first record's residual that still depends on the motion, a slow drift weighed out first."""
    record, r = searcher.records[0], fit.residuals[0][0]
    return _atlas(record, record.whitening(record.channels[0], r)(r)).explainable


def _eliminate(
    searcher: Searcher, nominal: Fit, last: Fit, adopted: tuple[str, ...], fixed: tuple[str, ...]
) -> tuple[tuple[str, ...], Fit, dict[str, float]]:
    """Take each effect out again: one that is not missed goes; the others say what they hold of the gap."""
    last_in: dict[str, float] = {}
    while True:
        last_in = {}
        without: dict[str, Fit] = {}
        for name in adopted:
            fit = nominal if len(adopted) == 1 else _without(searcher, last, adopted, name)
            without[name] = fit
            whole = _energy(nominal) - _energy(last)
            last_in[name] = float(np.clip((_energy(fit) - _energy(last)) / max(whole, 1e-300), 0.0, 1.0))
        superfluous = [
            n
            for n in adopted
            if n not in fixed
            and len(adopted) > 1
            and (last_in[n] < SHARE or 1 - _energy(last) / _energy(without[n]) < decide.RELEVANT)
        ]
        if not superfluous:
            return adopted, last, last_in
        gone = min(superfluous, key=lambda n: last_in[n])
        adopted, last = tuple(n for n in adopted if n != gone), without[gone]


def _without(searcher: Searcher, last: Fit, adopted: tuple[str, ...], name: str) -> Fit:
    model = searcher.model
    places = model.of(name)
    null = {model.names[i]: model.entries[i].null for i in places}
    xs = [model.encode(x, null) for x in last.xs]
    kept = [i for i in last.chosen if i not in places or model.names[i] == "coupling_damping.C"]
    return searcher.problem().solve(xs, kept, frozenset(adopted) - {name}, 12)


def _energy(fit: Fit) -> float:
    """Energy of the force residual in the band, over all records."""
    return float(sum(row[0] @ row[0] for row in fit.residuals))


# -- decision ----------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Quality:
    """What the search came to, in shares of energy.

    `gain` is what the first effect closed of the residual. `structured_before` and `structured` depend on the motion
    by a model-free atlas, without and with the effects; `left` is how much of that structure they left. `law_left` is
    the share of r_C that nothing explains.
    """

    gain: float
    structured_before: float
    structured: float
    left: float
    law_left: float

    @classmethod
    def of(cls, searcher: Searcher, found: Found, law_left: float) -> "Quality":
        first = found.steps[0] if found.steps else None
        gain = 0.0 if first is None or not first.refits else 1 - first.refits[0].fit.cost / first.before.cost
        before, after = _structure(searcher, found.nominal), _structure(searcher, found.last)
        whole = before * _energy(found.nominal)
        return cls(gain, before, after, min(after * _energy(found.last) / max(whole, 1e-300), 1.0), law_left)


@dataclasses.dataclass(frozen=True)
class Verdict:
    """The verdict, the effects it names, their groups of twins, and the first step's ranking."""

    verdict: str
    effects: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    ranking: dict[str, float]


def _verdict(
    searcher: Searcher,
    found: Found,
    quality: Quality,
    exclude: Collection[str],
    controller: dict[str, float],
    grid: float | None,
    remarks: list[str],
) -> Verdict:
    missing = quality.left if found.adopted else quality.structured
    other = decide.other(missing, quality.law_left)
    none = 0.0 if controller else decide.none(quality.gain)
    evidence = [_evidence(searcher, step) for step in found.steps]
    if controller:
        first = found.fixed[0]
        ranking = decide.settled(first, other)
    else:
        ranking = decide.probabilities(evidence[0], none, other * (1 - none))
    if grid is not None:
        remarks.append(f"qm lies on a grid of {grid:.4g} m, coarser than documented.")
    if other > 0.5:
        return Verdict("unexplained", found.adopted, (), ranking)
    if not found.adopted:
        if grid is not None and "encoder_quantisation" not in exclude:
            return Verdict("effect", ("encoder_quantisation",), (), decide.settled("encoder_quantisation", other))
        return Verdict("none", (), (), ranking)
    groups = []
    for name in found.adopted:
        step = _step_of(found, name)
        if step is not None and (group := decide.twins(_evidence(searcher, step), name)):
            groups.append(group)
    return Verdict("ambiguous" if groups else "effect", found.adopted, tuple(groups), ranking)


def _step_of(found: Found, effect: str) -> Step | None:
    """The step in which an effect was adopted; None for one that was read off the control law."""
    return next((s for s in found.steps if s.refits and s.refits[0].effect == effect), None)


def _evidence(searcher: Searcher, step: Step) -> decide.Evidence:
    """Energies of the refits of one step, whitened as the best of them leaves it."""
    model = searcher.model
    if not step.refits:
        return decide.Evidence((), np.zeros(0), np.zeros(0), 1.0, 1)
    filters = [
        [p.whitening(c, r) for c, r in zip(p.channels, row, strict=True)]
        for p, row in zip(searcher.records, step.refits[0].fit.residuals, strict=True)
    ]

    def energy(fit: Fit) -> float:
        return float(
            sum(
                np.sum(w(r) ** 2)
                for row, ws in zip(fit.residuals, filters, strict=True)
                for r, w in zip(row, ws, strict=True)
            )
        )

    rows = sum(len(r) for row in step.before.residuals for r in row)
    return decide.Evidence(
        tuple(r.effect for r in step.refits),
        np.array([energy(r.fit) for r in step.refits]),
        np.array([len(model.of(r.effect)) for r in step.refits], dtype=float),
        energy(step.before),
        rows,
    )


def _experiment(
    searcher: Searcher, found: Found, verdict: Verdict, catalogue: Sequence[type[AbstractEffect]]
) -> Experiment | None:
    """What would part the first group of twins."""
    if verdict.verdict != "ambiguous":
        return None
    group = verdict.groups[0]
    step = _step_of(found, group[0])
    if step is None:
        return None
    fits = [r.fit for r in step.refits if r.effect in group]
    return separating_experiment(searcher.records[0], catalogue, searcher.base, fits)


# -- numbers -----------------------------------------------------------------------------------------------------


def _norm(record: Prepared) -> float:
    return float(np.linalg.norm(record.channels[0].observed))


def _floor(record: Prepared, found: Found, quality: Quality, after: float) -> float:
    """What noise alone would leave of the fit record: from repeats where there are any, else the unstructured rest."""
    repeated = repeat_floor(record.recording)
    unstructured = after * float(np.sqrt(max(1 - quality.structured, 0.0)))
    return min(after, repeated.value) if repeated.value is not None else unstructured


def _predict(
    outline: Recording,
    machine: Machine,
    catalogue: Sequence[type[AbstractEffect]],
    record: Prepared,
    found: Found,
    floor: float,
    after: float,
) -> float:
    """The gap that will be left on a trajectory of which only the reference is known: the same newtons, another norm."""
    ahead = prepare(outline, machine, catalogue, None, record.bench)
    x = np.array(found.last.xs[0])
    x[ahead.model.of("start")] = 0.0
    # Without its qm the record's initial state is not known: what the guess stirs up has died down by then.
    simulated = ahead.decimation(ahead.model.run(x)[0])[ahead.t > _TRANSIENT]
    rms = float(np.sqrt(np.mean(left(record, found.last.outputs[0]) ** 2)))
    return rms / float(np.sqrt(np.mean(simulated**2)))


def _closed(
    record: Prepared, before: np.ndarray, after: np.ndarray, floor: float
) -> tuple[float | None, tuple[float, float] | None]:
    """Share of the explainable gap closed, and its 95 % interval over blocks of half a second."""
    b, a = left(record, before) ** 2, left(record, after) ** 2
    noise = floor**2 * np.sum(record.channels[0].observed ** 2) / len(b)
    block = max(1, round(0.5 / (record.model.dt * record.decimation.factor)))
    groups = np.array_split(np.arange(len(b)), max(1, len(b) // block))
    sums = np.array([[b[g].sum(), a[g].sum(), noise * len(g)] for g in groups])

    def share(s: np.ndarray) -> float:
        total_before, total_after, total_noise = s.sum(axis=0)
        return (total_before - total_after) / max(total_before - total_noise, 1e-300)

    if b.sum() <= 1.2 * noise * len(b):
        return None, None
    rng = np.random.default_rng(0)
    draws = [share(sums[rng.integers(len(sums), size=len(sums))]) for _ in range(400)]
    low, high = (float(np.clip(v, -1.0, 1.0)) for v in np.percentile(draws, [2.5, 97.5]))
    return float(np.clip(share(sums), -1.0, 1.0)), (low, high)


def _parameters(searcher: Searcher, found: Found, effects: Sequence[str]) -> dict[str, dict[str, Any]]:
    model, std = searcher.model, standard_deviations(searcher, found.last)
    values = model.decode(found.last.xs[0])
    return {
        name: {
            model.entries[i].name: dataclasses.asdict(
                Estimate(values[model.names[i]], std.get(i, 0.0), model.entries[i].unit)
            )
            for i in model.of(name)
        }
        for name in effects
    }


def _base(searcher: Searcher, found: Found) -> dict[str, Shift]:
    model, std = searcher.model, standard_deviations(searcher, found.last)
    before, after = model.decode(found.nominal.xs[0]), model.decode(found.last.xs[0])
    return {
        model.names[i]: Shift(before[model.names[i]], after[model.names[i]], std.get(i, 0.0), model.entries[i].unit)
        for i in model.of("")
        if model.names[i] != "offset"
    }


def _candidates(searcher: Searcher, found: Found, ranking: dict[str, float], floor: float) -> tuple[Candidate, ...]:
    if not found.steps:
        return ()
    record, model = searcher.records[0], searcher.model
    before = relative(record, found.steps[0].before.outputs[0])
    out = []
    for r in found.steps[0].refits:
        gap = relative(record, r.fit.outputs[0])
        values = model.decode(r.fit.xs[0])
        std = standard_deviations(searcher, r.fit)
        parameters = {
            model.entries[i].name: Estimate(values[model.names[i]], std.get(i, 0.0), model.entries[i].unit)
            for i in model.of(r.effect)
        }
        share = float(np.clip((before**2 - gap**2) / max(before**2 - floor**2, 1e-300), -1.0, 1.0))
        out.append(Candidate(r.effect, gap, share, ranking.get(r.effect, 0.0), parameters))
    return tuple(out)


def _atlas(record: Prepared, residual: np.ndarray) -> Atlas:
    dt, factor = record.model.dt, record.decimation.factor
    q = record.recording.qm
    low = LowPass.butterworth(60.0, dt)
    v = low(central_difference(q, dt), odd=False)
    a = low(central_difference(central_difference(q, dt), dt), odd=False)
    return atlas(
        record.t,
        residual,
        q[::factor],
        v[::factor],
        a[::factor],
        record.recording.qg[::factor],
        dt * factor,
        record.bench.lead,
    )
