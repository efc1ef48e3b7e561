"""From records and a machine to a study: admit, say what can be identified, identify, simulate, check."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from ..errors import InputError
from ..hygiene import Finding, admit, refuse_repeated
from ..machine import Machine
from ..params import select
from ..plant import FlexibleDrive, RigidDrive
from ..recording import Recording
from ..rig import first_speed
from ..statistics import Spread
from .case import Case, Progress, with_choices
from .didim import didim
from .flexible_mode import split_rigid
from .gauss_newton import gauss_newton, levenberg_marquardt
from .identifiability import Identifiability, bounds, hidden_mode, scan_modes
from .idim_ls import WITH_LOAD_ENCODER, idim_ls, need_load_position
from .method import Choices, Method
from .output_error import output_error, pseudo_regular_start
from .result import IdentificationResult
from .study import ERROR_HZ, Study, run
from .three_step import FLEXIBLE_HZ, RIGID_HZ, StepFailed, mode_step, rigid_step, three_step


def identify(
    recordings: Sequence[Recording],
    machine: Machine,
    choices: Choices,
    check: Recording | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Study:
    """Identify one machine from one or more records of it.

    `say` is told, before anything is fitted, what the records can give. The check record is simulated once, at the end,
    with the drive as identified on the others; only its initial state, and the scale
    of a known injected signal, are taken from it.

    Raises InputError, one line, on a record that cannot be used and on choices that contradict each other.
    """
    seconds: dict[str, float] = {}
    choices = settle(choices)
    every = [*recordings, *([check] if check else [])]
    findings = tuple((record.label, finding) for record in every for finding in admit(record, machine))
    if choices.at_rest:
        findings += tuple((record.label, found) for record in every for found in _moving(record, machine))
    refuse_repeated(every)
    _refuse_band(choices, machine, every)
    if choices.method is Method.IDIM_LS and choices.model == "flexible":
        need_load_position(recordings)
    case = Case(tuple(recordings), machine, choices, progress)
    with _timed(seconds, "identifiability"):
        said, rigid = identifiability(case)
    say(said.verdict)
    with _timed(seconds, "identification"):
        try:
            result = _not_given(said, rigid) if said.lost and rigid else _run(case)
        except StepFailed as failure:
            result = failure.result
    with _timed(seconds, "simulation"):
        drive = rigid.plant if said.lost and rigid else result.plant
        finite = bool(np.isfinite(result.theta).all()) or bool(said.lost)
        runs = tuple(run(case, record, drive) for record in recordings) if finite else ()
        checked = run(case, check, drive) if check and finite else None
    return Study(machine, result, runs, checked, findings, said, _settings(choices), seconds)


def _moving(recording: Recording, machine: Machine) -> tuple[Finding, ...]:
    """What to say of a record that is taken to start at rest and does not."""
    speed = first_speed(recording, machine)
    if abs(speed) < 2e-3:  # no encoder's steps would give more to a machine at rest
        return ()
    text = f"starts at {1e3 * speed:.3g} mm/s but is simulated from rest, as asked: leave out --at-rest."
    return (Finding("start", text),)


def settle(choices: Choices) -> Choices:
    """Every open choice filled in. InputError where two contradict each other."""
    flexible = choices.model == "flexible"
    method = choices.method or (Method.THREE_STEP if flexible else Method.DIDIM)
    if method is Method.THREE_STEP and not flexible:
        raise InputError(
            "method three-step is for the flexible model: use --model flexible, or --method didim for a rigid drive."
        )
    if flexible and choices.asymmetric and method in (Method.THREE_STEP, Method.DIDIM):
        raise InputError(
            f"method {method.value} has symmetric friction in its step 2 (paper, eq. 27): "
            "use --method gauss-newton for asymmetric friction of a flexible drive."
        )
    offset = not choices.asymmetric if choices.offset is None else choices.offset
    low = method is Method.DIDIM and not flexible
    return dataclasses.replace(
        choices,
        method=method,
        offset=offset,
        cutoff_hz=(RIGID_HZ if low else FLEXIBLE_HZ) if choices.cutoff_hz is None else choices.cutoff_hz,
    )


def _refuse_band(choices: Choices, machine: Machine, records: Sequence[Recording]) -> None:
    """A band that the records and their sampling cannot have: that of the fit, and that of the reported force error."""
    assert choices.cutoff_hz is not None
    lowest = 1 / min(len(record) * record.dt for record in records)
    highest = 0.5 / machine.controller.sample_time
    if not lowest < choices.cutoff_hz < highest:
        raise InputError(
            f"cutoff {choices.cutoff_hz:g} Hz must lie between {lowest:.3g} Hz (one period in the shortest record) "
            f"and {highest:g} Hz (half the sampling rate)."
        )
    if highest <= ERROR_HZ:
        raise InputError(
            f"the machine samples every {machine.controller.sample_time:g} s, too slowly to compare motor forces up to "
            f"{ERROR_HZ:g} Hz: its sample_time must be below {0.5 / ERROR_HZ:.3g} s."
        )


def identifiability(case: Case) -> tuple[Identifiability, IdentificationResult | None]:
    """What the records can give, before anything is fitted; and the rigid drive, where finding a mode needed one.

    For a flexible drive identified from motor force alone the question comes first whether a mode shows at all: bounds
    at a drive with a slow mode would promise everything of a record that rules such a drive out.
    """
    mass = case.machine.mass_apriori
    if case.choices.model == "rigid":
        supposed = RigidDrive(mass, case.friction(100.0, 10.0))  # typical sizes: nothing is known yet
        return bounds(supposed, case.free(supposed), case.trials(supposed, _band(case))), None
    if case.choices.method is Method.IDIM_LS:
        flexible = split_rigid(RigidDrive(mass, case.friction(100.0, 10.0)), 0.5, 40.0, 0.5)
        return bounds(flexible, case.free(flexible), case.trials(flexible, _band(case))), None
    symmetric = with_choices(case, asymmetric=False)
    low = rigid_step(symmetric)
    assert isinstance(low.plant, RigidDrive)
    rigid = gauss_newton(low.plant, symmetric.free(low.plant), symmetric.trials(low.plant, _band(case)))
    assert isinstance(rigid.plant, RigidDrive)
    scan = scan_modes(rigid.plant, rigid.relative_error, case.trials(split_rigid(rigid.plant, 0.5, 40.0), _band(case)))
    nominal = _with_friction(case, split_rigid(rigid.plant, *scan.best, friction_share=0.5))
    if not scan.visible:
        return hidden_mode(scan, select(nominal, case.free(nominal))), rigid
    return bounds(nominal, case.free(nominal), case.trials(nominal, _band(case))), rigid


def _band(case: Case) -> float:
    assert case.choices.cutoff_hz is not None
    return case.choices.cutoff_hz


def _with_friction(case: Case, drive: FlexibleDrive) -> FlexibleDrive:
    """The same drive with friction of the chosen kind."""
    motor, load = (case.friction(f.Fv, f.Fc) for f in (drive.motor_friction, drive.load_friction))  # type: ignore[attr-defined]
    return FlexibleDrive(drive.M1, motor, drive.M2, load, drive.K12, drive.offset)


def _rigid_idim_ls(case: Case) -> IdentificationResult:
    drive = RigidDrive(case.machine.mass_apriori, case.friction())
    return idim_ls(drive, case.free(drive), case.recordings)


def _rigid_didim(case: Case) -> IdentificationResult:
    drive = RigidDrive(case.machine.mass_apriori, case.friction())
    return didim(drive, case.free(drive), case.trials(drive, _band(case)), on_iterate=case.tell("DIDIM"))


def _rigid_gauss_newton(case: Case) -> IdentificationResult:
    return _exact(case, RigidDrive(case.machine.mass_apriori, case.friction()))


def _rigid_output_error(case: Case) -> IdentificationResult:
    step1 = rigid_step(with_choices(case, asymmetric=False, signal=Choices.signal))
    start = RigidDrive(step1["M"], case.friction(step1["Fv"], step1["Fc"]), step1.plant.offset)  # type: ignore[attr-defined]
    return output_error(start, case.free(start), case.trials(start, _band(case)), on_iterate=case.tell("Nelder-Mead"))


def _flexible_idim_ls(case: Case) -> IdentificationResult:
    start = split_rigid(RigidDrive(case.machine.mass_apriori, case.friction()), 0.5, 40.0)
    return idim_ls(start, case.free(start), case.recordings, WITH_LOAD_ENCODER)


def _flexible_didim(case: Case) -> IdentificationResult:
    return three_step(case, friction_sides=2)


def _flexible_gauss_newton(case: Case) -> IdentificationResult:
    symmetric = with_choices(case, asymmetric=False)
    step1 = rigid_step(symmetric)
    step2 = mode_step(symmetric, step1)
    assert isinstance(step1.plant, RigidDrive)
    result = _exact(case, _with_friction(case, split_rigid(step1.plant, *step2.theta)))
    return dataclasses.replace(result, steps=(step1, step2))


def _flexible_output_error(case: Case) -> IdentificationResult:
    step1 = rigid_step(with_choices(case, asymmetric=False, signal=Choices.signal))
    assert isinstance(step1.plant, RigidDrive)
    start = _with_friction(case, pseudo_regular_start(step1.plant))
    result = output_error(start, case.free(start), case.trials(start, _band(case)), on_iterate=case.tell("Nelder-Mead"))
    return dataclasses.replace(result, steps=(step1,))


def _exact(case: Case, start: RigidDrive | FlexibleDrive) -> IdentificationResult:
    """Full Gauss-Newton steps; damped ones from the same start where those do not converge."""
    trials, free = case.trials(start, _band(case)), case.free(start)
    result = gauss_newton(start, free, trials, on_iterate=case.tell("Gauss-Newton"))
    if result.converged:
        return result
    return levenberg_marquardt(start, free, trials, on_iterate=case.tell("Levenberg-Marquardt"))


_METHODS = {
    ("rigid", Method.IDIM_LS): _rigid_idim_ls,
    ("rigid", Method.DIDIM): _rigid_didim,
    ("rigid", Method.GAUSS_NEWTON): _rigid_gauss_newton,
    ("rigid", Method.OUTPUT_ERROR): _rigid_output_error,
    ("flexible", Method.THREE_STEP): three_step,
    ("flexible", Method.IDIM_LS): _flexible_idim_ls,
    ("flexible", Method.DIDIM): _flexible_didim,
    ("flexible", Method.GAUSS_NEWTON): _flexible_gauss_newton,
    ("flexible", Method.OUTPUT_ERROR): _flexible_output_error,
}


def _not_given(said: Identifiability, rigid: IdentificationResult) -> IdentificationResult:
    """The answer for a record that cannot give the flexible model: no numbers for it; the rigid drive as a step."""
    nothing = np.full(len(said.names), np.nan)
    return dataclasses.replace(
        rigid,
        method="none",
        names=said.names,
        units=said.units,
        theta=nothing,
        spread=Spread(nothing, nothing, np.full((len(nothing), len(nothing)), np.nan), float("nan")),
        converged=False,
        reason=said.verdict,
        n_iterations=0,
        trace=nothing[None, :],
        costs=np.array([np.nan]),
        steps=(rigid,),
    )


def _run(case: Case) -> IdentificationResult:
    assert case.choices.method is not None
    return _METHODS[case.choices.model, case.choices.method](case)


def _settings(choices: Choices) -> dict[str, object]:
    assert choices.method is not None
    return {
        "model": choices.model,
        "method": choices.method.value,
        "friction": "asymmetric" if choices.asymmetric else "symmetric",
        "offset": bool(choices.offset),
        "at rest": choices.at_rest,
        "cutoff_hz": choices.cutoff_hz,
        "compared signal": choices.signal.name,
    }


@contextmanager
def _timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    seconds[part] = time.perf_counter() - begin
