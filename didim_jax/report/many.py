"""Many cases, each in a folder of its own, side by side in processes of their own."""

import contextlib
import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..devices import cores
from ..effects import AbstractEffect
from ..effects.catalogue import CATALOGUE, load
from ..errors import InputError
from ..files import atomic_write
from ..gap.cases import Case, clear, diagnose_case
from ..processes import processes
from .write_diagnosis import write_diagnosis


def diagnose_cases(
    cases: Sequence[Case],
    out: Path,
    *,
    exclude: Collection[str] | Mapping[str, Collection[str]] = (),
    effects: Path | None = None,
    workers: int,
    done: Callable[[Case, str], None],
) -> list[str]:
    """Diagnose and write every case; a bad one leaves its line in `out`/<case>/error.txt, and its name is returned.

    `exclude` are the effects left out of the catalogue, of every case or by the case's name; `effects` is a file of a
    user's own. `done` is told of every case as it ends. One worker is this process itself.
    """

    def without(case: Case) -> tuple[str, ...]:
        return tuple(exclude[case.name] if isinstance(exclude, Mapping) else exclude)

    bad = []

    def note(case: Case, good: bool, line: str) -> None:
        if not good:
            bad.append(case.name)
        done(case, line)

    if min(workers, len(cases)) < 2:
        for case in cases:
            note(case, *_diagnose(case, out / case.name, without(case), effects))
        return bad
    waiting = list(cases)

    def attempt(some: Sequence[Case], workers: int) -> None:
        """Diagnose some cases; those of a process that is killed, and what it leaves undone, go on waiting."""
        with contextlib.suppress(BrokenProcessPool), processes(workers) as pool:
            running = {pool.submit(_diagnose, c, out / c.name, without(c), effects): c for c in some}
            for future in as_completed(running):
                good, line = future.result()
                waiting.remove(running[future])
                note(running[future], good, line)

    attempt(cases, min(workers, len(cases)))
    for case in tuple(waiting):  # one at a time, to tell the case that kills its process from those beside it
        attempt([case], 1)
        if case in waiting:
            note(case, *_failed(out / case.name, "its process was killed, most likely for want of memory"))
    return sorted(bad)


def _diagnose(case: Case, folder: Path, exclude: Collection[str], effects: Path | None) -> tuple[bool, str]:
    """One case, written: whether it could be used, and a line about it."""
    try:
        diagnosis = diagnose_case(case, _catalogue(effects), folder, exclude=exclude)
        write_diagnosis(diagnosis, folder)
    except Exception as error:  # whatever goes wrong with one case, the others go on
        said = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        return _failed(folder, " ".join(said.split()))
    (folder / "error.txt").unlink(missing_ok=True)
    return True, f"{diagnosis.verdict}: {', '.join(diagnosis.effects) or '-'}"


def _failed(folder: Path, said: str) -> tuple[bool, str]:
    """Leave the reason in place of results."""
    folder.mkdir(parents=True, exist_ok=True)
    clear(folder)
    with atomic_write(folder / "error.txt") as path:
        path.write_text(f"{said}\n", encoding="utf-8")
    return False, f"unusable: {said}"


@functools.cache
def _catalogue(effects: Path | None) -> tuple[type[AbstractEffect], ...]:
    """The catalogue, and a user's own effects after it; read once in a process."""
    return CATALOGUE + (() if effects is None else load(effects))


def diagnose_under_bar(
    cases: Sequence[Case],
    out: Path,
    *,
    exclude: Collection[str] | Mapping[str, Collection[str]] = (),
    effects: Path | None = None,
    label: str = "cases",
    workers: int | None = None,
) -> list[str]:
    """`diagnose_cases` under a bar with the time left, a line a case; names of those not usable.

    On every core unless `workers` says how many processes.
    """
    console = Console(stderr=True)
    bars = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*bars, console=console) as progress:
        task = progress.add_task(label, total=len(cases))

        def done(case: Case, line: str) -> None:
            progress.advance(task)
            console.print(f"{case.name}: {line}", markup=False, highlight=False)

        return diagnose_cases(cases, out, exclude=exclude, effects=effects, workers=workers or cores(), done=done)
