"""From records to a diagnosis: where the gap lies, which effect causes it, how far it shrinks on another trajectory."""

import dataclasses
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from ..effects import AbstractEffect, Bench, Block
from ..hygiene import admit
from ..machine import Machine
from ..recording import Recording
from . import decide
from .diagnosis import Diagnosis, Gap, Run
from .fit import Fit
from .floor import repeat_floor
from .hunt import Found, atlas_of, hunt
from .judge import judge, left, relative, rms_of
from .numbers import base_shifts, candidates, closed, parameters, predict, rms_floor
from .prepared import Prepared, prepare
from .readings import CONTROLLER, GRID, PULSES, Readings, read_off
from .search import Searcher
from .verdict import Quality, Verdict, evidence, judge_findings, next_experiment, quality
from .whereabouts import whereabouts

INVISIBLE = ("drive_gain",)
"""Absorbed by the base parameters exactly: never looked for."""

FAR = 2.0
"""Times the mass that is roughly known, beyond which it is another machine's."""

ABSORBED = (
    "A wrong drive gain cannot be seen in motor force and position: masses, friction and stiffness absorb it exactly."
)


def diagnose(
    recordings: Sequence[Recording],
    machine: Machine,
    catalogue: Sequence[type[AbstractEffect]],
    *,
    outline: Recording | None = None,
    open_check: Callable[[float], Recording] | None = None,
    exclude: Collection[str] = (),
    threads: int = 1,
    say: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Diagnose one machine from records of it.

    `outline` is the check record with nothing measured in it; `open_check` is called once, with the predicted gap,
    after everything else is decided, and returns the record that is then judged. `threads`: refits that run side by
    side. Raises InputError: a record that cannot be used.
    """
    findings = [(r, f) for r in recordings for f in admit(r, machine)]
    remarks = [f"{r.label}: {f.message}" for r, f in findings if f.check != "agreement"]
    read = read_off(recordings, machine, exclude)
    quiet = [read.quiet(r, k) for k, r in enumerate(recordings)]
    searcher = Searcher([prepare(r, machine, catalogue) for r in quiet], threads)
    left_out = {*CONTROLLER, *INVISIBLE, GRID, *exclude, *((PULSES,) if any(read.pulses) else ())}
    searched = [e for e in searcher.model.effects if e.label() not in left_out]

    say("nominal plant")
    nominal = searcher.nominal()
    found = hunt(searcher, nominal, searched, read.controller, say)
    q = quality(searcher, found, read.law_left)
    verdict = judge_findings(searcher, found, q, read)

    record = searcher.records[0]
    bench = dataclasses.replace(record.bench, grid=read.grid)
    before, after = _simulated(recordings[0], quiet[0], machine, catalogue, record.bench, bench, found)
    read_floor = None if any(read.pulses) else repeat_floor(record.recording).value
    floor = rms_floor(record, read_floor, q.structured, relative(record, found.last.outputs[0]))
    rms = record.channels[0].rms
    gaps = {"fit": Gap(relative(record, before), relative(record, after), floor / rms)}
    runs = [_run(record, recordings[0], before, after)]
    share, interval = closed(record, before, after, floor)
    once = False
    stages = [{"effects": [name], "fit": relative(record, fit.outputs[0])} for name, fit in found.stages]

    if open_check is not None and outline is not None:
        predicted = predict(outline, quiet[0], machine, catalogue, record, found)
        say("check record")
        checked = open_check(predicted)
        remarks += [f"{checked.label}: {f.message}" for f in admit(checked, machine)]
        plain = second = prepare(checked, machine, catalogue, record.bench)
        if GRID in verdict.effects:
            second = prepare(checked, machine, catalogue, bench)
        was = judge(plain, nominal.xs[0], (), rms_of(record, nominal)).outputs
        moved: dict[str, float] = {}
        now, last = was, None
        for (_, last), stage in zip(found.stages, stages, strict=True):
            now, moved = _judged(searcher, second, last, found)
            stage["check"] = relative(second, now)
        if verdict.effects and last is not found.last:  # an effect was taken out again, or all were read off
            now, moved = _judged(searcher, second, found.last, found)
        check_rms = second.channels[0].rms
        gaps["check"] = Gap(relative(second, was), relative(second, now), floor / check_rms, predicted)
        runs.append(_run(second, checked, was, now))
        # Pulses that came once are judged where they were.
        once = any(read.pulses) or f"{PULSES}.A" in moved
        if not once:
            share, interval = closed(second, was, now, floor)
        remarks += [f"{name} is {value:.4g} on the check record, its own." for name, value in moved.items()]

    if share is not None and read_floor is None and (once or open_check is None):
        remarks.append(
            "The share closed is of the record that was fitted, against noise guessed from what is left there."
        )
    estimates = parameters(searcher, found, read, verdict.effects, once)
    return Diagnosis(
        verdict=verdict.verdict,
        effects=verdict.effects,
        ambiguous_with=verdict.groups,
        ranking=tuple(verdict.ranking.items()),
        parameters=estimates,
        block=_block(searcher, verdict, read, estimates),
        base=base_shifts(searcher, found),
        gap=gaps,
        share=share,
        interval=interval,
        last_in={e: found.last_in[e] for e in verdict.effects if e in found.last_in},
        where=whereabouts(searcher, nominal, found.last, found.adopted, read),
        experiment=next_experiment(searcher, found, verdict, catalogue),
        remarks=(
            *remarks,
            *read.remarks,
            *_hum(q),
            *_untested(found),
            *((ABSORBED,) if verdict.verdict == "none" else ()),
        ),
        candidates=candidates(searcher, found, verdict.ranking, floor),
        atlas=atlas_of(record, left(record, before), floor),
        atlas_after=atlas_of(record, left(record, after), floor) if verdict.effects else None,
        runs=tuple(runs),
        evidence={
            **dataclasses.asdict(q),
            "looked_for": [e.label() for e in catalogue if e.label() not in {*INVISIBLE, *exclude}],
            "stages": stages,
            "order": found.order,
            "floor_from_repeats": read_floor is not None,
            "steps": [dataclasses.asdict(evidence(step)) for step in found.steps],
        },
        machine=machine.name,
        synthetic=any(r.synthetic for r in recordings),
        doubts=(
            *(f"{r.label}: {f.message}" for r, f in findings if f.check == "agreement"),
            *_mass(searcher, found, machine),
        ),
    )


def _simulated(
    recording: Recording,
    quiet: Recording,
    machine: Machine,
    catalogue: Sequence[type[AbstractEffect]],
    plain: Bench,
    bench: Bench,
    found: Found,
) -> tuple[np.ndarray, np.ndarray]:
    """The first record without any effect, and with all of them: those read off it too."""
    before, after = found.nominal.outputs[0], found.last.outputs[0]
    if quiet is not recording:
        before = prepare(recording, machine, catalogue, plain).model.run(found.nominal.xs[0])
    if bench.grid:
        after = prepare(quiet, machine, catalogue, bench).model.run(found.last.xs[0])
    return before, after


def _hum(q: Quality) -> tuple[str, ...]:
    if q.line < decide.ODD:
        return ()
    return (
        f"What is left hums at {q.line_hz:.4g} Hz ({100 * q.line:.0f} % of it): mains, a fan or a machine nearby? "
        "Nothing in the catalogue is as steady.",
    )


def _untested(found: Found) -> tuple[str, ...]:
    return tuple(
        f"{name} shows in one half of the record only, so that no part of it could be left out of its fit and tested."
        for name in found.once
    )


def _mass(searcher: Searcher, found: Found, machine: Machine) -> tuple[str, ...]:
    """Whether the mass is another machine's."""
    values = searcher.model.decode(found.last.xs[0])
    mass = sum(values[name] for name in ("M", "M1", "M2") if name in values)
    if machine.mass_apriori / FAR < mass < FAR * machine.mass_apriori:
        return ()
    return (
        f"A mass of {mass:.3g} kg is found, {machine.mass_apriori:.3g} kg are expected: "
        "is it this machine's file, its drive gain in N/V on the load axis?",
    )


def _judged(searcher: Searcher, second: Prepared, fit: Fit, found: Found) -> tuple[np.ndarray, dict[str, float]]:
    """The check record with the effects of a fit, and what had to be moved for it."""
    owners = {searcher.model.entries[i].owner for i in fit.chosen}
    effects = [e for e in searcher.model.effects if e.label() in owners and e.label() in found.adopted]
    judged = judge(second, fit.xs[0], effects, rms_of(searcher.records[0], fit))
    return judged.outputs, judged.moved


def _run(record: Prepared, recording: Recording, before: np.ndarray, after: np.ndarray) -> Run:
    return Run(recording.name, record.model.dt * np.arange(record.model.n), recording.tau, before[0], after[0])


def _block(searcher: Searcher, verdict: Verdict, read: Readings, found: dict[str, dict[str, Any]]) -> str | None:
    """Block of the first effect; pulses behind the control law enter at the drive, friction may rub on the load."""
    if not verdict.effects:
        return None
    first = verdict.effects[0]
    if first == PULSES and any(read.pulses):
        return "actuator"
    share = found[first].get("load_share")
    if share and share["value"] - 2 * share["std"] > 0.5:
        return Block.LOAD_SIDE.value
    return next(e.block.value for e in searcher.model.effects if e.label() == first)
