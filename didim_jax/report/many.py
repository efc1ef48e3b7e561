"""Many cases, compiled once: each in a folder of its own, some of them side by side."""

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..devices import cores
from ..effects import AbstractEffect
from ..errors import InputError
from ..files import atomic_write
from ..gap.cases import Case, diagnose_case
from .write_diagnosis import write_diagnosis


def diagnose_cases(
    cases: Sequence[Case],
    catalogue: Sequence[type[AbstractEffect]],
    out: Path,
    *,
    exclude: Collection[str] | Mapping[str, Collection[str]],
    threads: int,
    done: Callable[[Case, str], None],
) -> list[str]:
    """Diagnose and write every case; a bad one leaves its line in `out`/<case>/error.txt, and its name is returned.

    `exclude` are the effects left out of the catalogue, of every case or by the case's name.
    """

    def one(case: Case) -> str | None:
        folder = out / case.name
        without = exclude[case.name] if isinstance(exclude, Mapping) else exclude
        try:
            diagnosis = diagnose_case(case, catalogue, folder, exclude=without)
            write_diagnosis(diagnosis, folder)
        except Exception as error:  # whatever goes wrong with one case, the others go on
            said = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            said = " ".join(said.split())
            folder.mkdir(parents=True, exist_ok=True)
            for stale in ("diagnosis.json", "prediction.json", "simulation.npz", "report.html"):
                (folder / stale).unlink(missing_ok=True)
            with atomic_write(folder / "error.txt") as path:
                path.write_text(f"{said}\n", encoding="utf-8")
            done(case, f"unusable: {said}")
            return case.name
        (folder / "error.txt").unlink(missing_ok=True)
        done(case, f"{diagnosis.verdict}: {', '.join(diagnosis.effects) or '-'}")
        return None

    with ThreadPoolExecutor(threads) as pool:
        return [name for name in pool.map(one, cases) if name is not None]


def diagnose_under_bar(
    cases: Sequence[Case],
    catalogue: Sequence[type[AbstractEffect]],
    out: Path,
    *,
    exclude: Collection[str] | Mapping[str, Collection[str]] = (),
    label: str = "cases",
) -> list[str]:
    """`diagnose_cases` on every core, under a bar with the time left, a line a case; names of those not usable."""
    console = Console(stderr=True)
    bars = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*bars, console=console) as progress:
        task = progress.add_task(label, total=len(cases))

        def done(case: Case, line: str) -> None:
            progress.advance(task)
            console.print(f"{case.name}: {line}", markup=False, highlight=False)

        return diagnose_cases(cases, catalogue, out, exclude=exclude, threads=cores(), done=done)
