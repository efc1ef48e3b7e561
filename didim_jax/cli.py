"""The command line: `didim identify`, `didim diagnose`, `didim simulate` and `didim effects`.

A user's mistake ends in one line on standard error and exit status 2. Heavy modules are imported by the command that
needs them.
"""

import difflib
import functools
import io
import os
import re
import shutil
import signal
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from tyro.conf import FlagCreatePairsOff, Positional

from .devices import cores, prepare_jax
from .errors import InputError


def main() -> None:
    """Entry point of the `didim` command."""
    app = tyro.extras.SubcommandApp()
    app.command(name="identify")(_parsed(identify))
    app.command(name="simulate")(_parsed(simulate))
    app.command(name="diagnose")(_parsed(diagnose))
    app.command(name="effects")(_parsed(effects))
    with program():
        with _usage():
            command = app.cli(prog="didim", description="Identify flexible-joint drives by differentiable simulation.")
        command()


@contextmanager
def program() -> Iterator[None]:
    """What every program of the project does around its work: float64, and one line for a user's mistake.

    An interrupted one ends without a word and with the shell's status for it, 130; so does one whose output nobody
    reads any more, with 141.
    """
    asked: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, stop)
    try:
        prepare_jax()
        try:
            yield
        finally:
            sys.stdout.flush()  # here, where a reader that has left is noticed, and not while Python ends
    except InputError as error:
        print(f"didim: {error}", file=sys.stderr)
        sys.exit(2)
    except BaseException as error:
        if asked or isinstance(error, KeyboardInterrupt):  # a compiler that is interrupted raises something of its own
            sys.exit(130)
        met = error.__context__ if isinstance(error, SystemExit) else error  # rich exits where it meets one
        if isinstance(met, BrokenPipeError):
            _discard_output()
            sys.exit(141)
        raise
    finally:
        signal.signal(signal.SIGINT, before)


def _discard_output() -> None:
    """What is still to be written goes nowhere, or Python would complain of the pipe once more when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _parsed(command: Callable[..., None]) -> Callable[..., Callable[[], None]]:
    """The command with its arguments bound, to be run once all of them are understood."""

    @functools.wraps(command)
    def bind(*args: Any, **options: Any) -> Callable[[], None]:
        return functools.partial(command, *args, **options)

    return bind


@contextmanager
def _usage() -> Iterator[None]:
    """tyro says what is wrong with a command line in a box of many lines: here it becomes one."""
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            yield
    except SystemExit as end:
        if end.code == 2:
            raise InputError(_complaint(said.getvalue())) from None
        raise


def _complaint(box: str) -> str:
    """The sentences of the box: without title, frame and colours, and without the help texts, indented by eight."""
    rows = re.sub(r"\x1b\[[\d;]*m", "", box).splitlines()[1:]
    text = textwrap.dedent("\n".join(row.strip("╭╮╰╯│").rstrip() for row in rows))
    parts = [part.strip().split("\n\n")[0] for part in re.split(r"(?m)^ *[─-]+$", text) if "helptext" not in part]
    said = [" ".join(re.sub(r"(?m)^ {8}.*", "", part).split()).rstrip(".") for part in parts]
    return "; ".join(filter(None, said)) + "; see --help."


def identify(
    records: Positional[tuple[Path, ...]],
    /,
    machine: Path,
    out: Path,
    method: Literal["three-step", "idim-ls", "didim", "gauss-newton", "output-error"] | None = None,
    model: Literal["rigid", "flexible"] | None = None,
    friction: Literal["symmetric", "asymmetric"] = "symmetric",
    offset: FlagCreatePairsOff[bool] = False,
    no_offset: FlagCreatePairsOff[bool] = False,
    at_rest: FlagCreatePairsOff[bool] = False,
    check: Path | None = None,
    signal: Literal["force", "position"] = "force",
    cutoff_hz: float | None = None,
) -> None:
    """Identify a machine from one or more records of it, and show how well it then simulates them.

    Args:
        records: Records of one machine (.mat, .csv or .npz), fitted together.
        machine: What is documented of the machine (machine.toml).
        out: Folder for identification.json, simulation.npz, figures and report.html.
        method: Rigid: didim unless said otherwise; flexible: three-step.
        model: The machine file's model unless said otherwise.
        friction: One pair of friction parameters, or one for each direction.
        offset: Estimate a constant force. The default for symmetric friction.
        no_offset: Do not. The default for asymmetric friction, where it differs from Coulomb friction only at rest.
        at_rest: The records start at rest; otherwise the initial state of each is estimated.
        check: A record that takes no part in the fit and is simulated once, at the end.
        signal: What output-error compares.
        cutoff_hz: Band of the comparison, Hz: 5 for rigid didim, 60 otherwise.
    """

    from .formats import load_recording
    from .identify import FORCE, POSITION, Choices, Method
    from .identify import identify as run
    from .machine import Machine
    from .report import check_folder, print_study, write_study

    if offset and no_offset:
        raise InputError("--offset and --no-offset exclude each other: give one of them.")
    if signal == "position" and method != "output-error":
        raise InputError("--signal position is for --method output-error: the other methods compare the motor force.")
    if not records:
        raise InputError("no record given: name at least one .mat, .csv or .npz file.")
    known = Machine.load(machine)
    recordings = [load_recording(record, gain=known.drive.gain) for record in records]
    checked = load_recording(check, gain=known.drive.gain) if check else None
    check_folder(out)
    choices = Choices(
        model=model or known.model,
        method=Method(method) if method else None,
        asymmetric=friction == "asymmetric",
        offset=True if offset else False if no_offset else None,
        at_rest=at_rest,
        cutoff_hz=cutoff_hz,
        signal=POSITION if signal == "position" else FORCE,
    )
    with _progress() as (progress, say):
        study = run(recordings, known, choices, checked, progress, say)
    write_study(study, out)
    print_study(study, out)


def diagnose(
    records: Positional[tuple[Path, ...]] = (),
    /,
    *,
    out: Path,
    machine: Path | None = None,
    check: Path | None = None,
    cases: Path | None = None,
    exclude: tuple[str, ...] = (),
    effects: Path | None = None,
    workers: int | None = None,
) -> None:
    """Diagnose the gap between a machine and its simulation: where it lies, which effect causes it, how far it shrinks.

    Args:
        records: Records of one machine (.mat, .csv or .npz), fitted together.
        out: Folder for diagnosis.json, simulation.npz and report.html; with --cases, one folder a case in it.
        machine: What is documented of the machine (machine.toml).
        check: Another trajectory of it: judged once, at the end.
        cases: Folder of cases, each with fit.mat, check.mat and machine.toml.
        exclude: Effects to leave out of the catalogue.
        effects: Python file with effects of your own, added to the catalogue.
        workers: Processes side by side, with --cases; one a core unless said otherwise, some 3 GB each.
    """
    from .effects.catalogue import CATALOGUE, load
    from .gap.cases import Case, cases_in, diagnose_case

    catalogue = CATALOGUE + (() if effects is None else load(effects))
    known = {effect.label() for effect in catalogue}
    if unknown := sorted(set(exclude) - known):
        near = difflib.get_close_matches(unknown[0], known)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(sorted(known))}."
        raise InputError(f"--exclude {unknown[0]}: no such effect; {hint}")
    if workers is not None and (workers < 1 or cases is None):
        raise InputError("--workers takes a number of processes, 1 or more, and goes with --cases.")
    if cases is not None:
        if records or machine or check:
            raise InputError("--cases takes its records and machines from its folders: give no others.")
        _diagnose_many(cases_in(cases), out, exclude, effects, workers)
        return
    if not records or machine is None:
        raise InputError("give at least one record and its --machine, or a folder of --cases.")
    from .report import check_folder
    from .report.write_diagnosis import print_diagnosis, write_diagnosis

    check_folder(out)
    case = Case(records[0].stem, tuple(records), check, machine)
    with _progress() as (_, say):
        ahead = iter(() if check else ("no --check record: nothing will be judged on another trajectory",))

        def tell(text: str) -> None:
            for first in ahead:  # not before the files are found usable: a refusal is one line
                say(first)
            say(text)

        found = diagnose_case(case, catalogue, out, exclude=exclude, threads=cores(), say=tell)
    write_diagnosis(found, out)
    print_diagnosis(found, out)


def _diagnose_many(
    cases: Sequence[Any], out: Path, exclude: Sequence[str], effects: Path | None, workers: int | None
) -> None:
    """All cases; exit status 1 where one could not be used."""
    from .report.many import diagnose_under_bar

    bad = diagnose_under_bar(cases, out, exclude=exclude, effects=effects, workers=workers)
    if bad:
        print(f"didim: {len(bad)} of {len(cases)} cases could not be used: {', '.join(bad)}.", file=sys.stderr)
        sys.exit(1)


def simulate(
    machine: Path,
    plant: Path,
    reference: Path,
    out: Path,
    noise: Annotated[float, tyro.conf.arg(metavar="N")] = 0.0,
    noise_inside: FlagCreatePairsOff[bool] = False,
    seed: int = 0,
) -> None:
    """Simulate a machine and write the run as a record, marked as synthetic.

    Args:
        machine: Controller, drive and encoder (machine.toml).
        plant: Parameters of the drive (plant.toml).
        reference: The motion to follow (reference.toml).
        out: Record to write: .mat, .csv or .npz.
        noise: White force noise, N rms per sample.
        noise_inside: Let the noise act inside the loop, at the drive, instead of on the recorded force alone.
        seed: Seed of the noise.
    """
    from .formats import save_recording
    from .machine import Machine
    from .plant_file import load_plant
    from .reference import load_reference
    from .synthesize import synthesize

    known = Machine.load(machine)
    qg = load_reference(reference).sample(known.controller.sample_time)
    recording = synthesize(
        known, load_plant(plant), qg, force_noise=noise, noise_inside_loop=noise_inside, seed=seed, name=out.stem
    )
    save_recording(recording, out)
    print(
        f"{out}: {len(recording)} samples, {recording.t[-1]:.4g} s, "
        f"peak command {np.abs(recording.vir).max():.2f} V of {known.drive.limit:g} V (synthetic)"
    )


def effects(file: Path | None = None) -> None:
    """List the effects that a simulation may hold beyond the nominal drive.

    Args:
        file: Python file with effects of your own, listed after those of the catalogue.
    """
    from .effects.catalogue import CATALOGUE, load
    from .effects.symbols import COMMON

    width = min(shutil.get_terminal_size((_COLUMNS, 24)).columns, _COLUMNS)
    for effect in (*CATALOGUE, *(load(file) if file else ())):
        print(_described(effect, width), end="\n\n")
    print(textwrap.fill(COMMON, width))


_COLUMNS = 100


def _described(effect: Any, width: int) -> str:
    """Name, block and law of an effect; indented below, what its symbols mean, and what else its class says of it.

    Only names begin at the margin, so that a search for `^name` finds one.
    """
    from .effects.symbols import meanings, units

    unit = units(effect)
    law = effect.equation or " ".join((effect.__doc__ or "").split("\n\n")[0].split())
    rows = [(effect.label(), f"{effect.block.value}: {law}")]
    for symbol, meaning in meanings(effect).items():
        rows.append((f"    {symbol}" + (f" [{unit[symbol]}]" if symbol in unit else ""), meaning))
    rows += [("    size", effect.size), ("    twins", ", ".join(effect.twins)), ("    source", effect.source)]
    fold = textwrap.TextWrapper(width, subsequent_indent=" " * 25, break_on_hyphens=False)
    lines = []
    for head, said in rows:
        fold.initial_indent = f"{head:<24} "
        lines += fold.wrap(said or "-")
    return "\n".join(lines)


@contextmanager
def _progress() -> Iterator[tuple[Callable[[str, int, np.ndarray, float], None], Callable[[str], None]]]:
    """A line on standard error that follows the iterations, and a way to say something above it."""
    from rich.console import Console

    console = Console(stderr=True)
    with console.status("simulating ...") as status:

        def show(step: str, iteration: int, theta: np.ndarray, cost: float) -> None:
            status.update(f"{step}: iteration {iteration}, residual {100 * cost:.2f} % of the signal")

        yield show, lambda text: console.print(text, markup=False, highlight=False)


if __name__ == "__main__":
    main()
