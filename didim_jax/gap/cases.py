"""A case in files: the records to diagnose, the check record, and what may be known of that one before it is judged."""

import dataclasses
import json
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np

from ..devices import forget_programs
from ..effects import AbstractEffect
from ..errors import InputError
from ..files import atomic_write
from ..formats import load_recording
from ..hygiene import admit, refuse_repeated
from ..machine import Machine
from ..recording import Recording
from .diagnose import diagnose
from .diagnosis import Diagnosis


def outline(check: Recording) -> Recording:
    """A record with nothing measured in it: t, qg and pulses_N as they are, qm = qg, vir = 0."""
    return dataclasses.replace(check, qm=check.qg, ql=None, vir=np.zeros(len(check)))


def clear(folder: Path) -> None:
    """Remove what a diagnosis leaves in its folder; a folder of such a name is a user's, and stays."""
    for name in ("diagnosis.json", "prediction.json", "simulation.npz", "report.html"):
        if (folder / name).is_file():
            (folder / name).unlink()


@dataclasses.dataclass(frozen=True)
class Case:
    """A folder with fit.mat, machine.toml and, usually, check.mat."""

    name: str
    fits: tuple[Path, ...]
    check: Path | None
    machine: Path


def cases_in(folder: Path) -> tuple[Case, ...]:
    """Every folder below that holds a fit record, by name. Raises InputError: no such folder, none in it."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder.")
    found = tuple(
        Case(
            path.name,
            (path / "fit.mat",),
            path / "check.mat" if (path / "check.mat").exists() else None,
            path / "machine.toml",
        )
        for path in sorted(folder.iterdir())
        if path.is_dir() and ((path / "fit.mat").exists() or (path / "machine.toml").exists())
    )
    if not found:
        raise InputError(f"{folder}: holds no case: a folder each, with fit.mat, check.mat and machine.toml.")
    return found


def diagnose_case(
    case: Case,
    catalogue: Sequence[type[AbstractEffect]],
    out: Path,
    *,
    exclude: Collection[str] = (),
    threads: int = 1,
    say: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Read a case, diagnose it and write the prediction to `out`/prediction.json before the check record is judged.

    Until then nothing measured in the check record is known but that it can be used. Raises InputError: any of the
    files cannot be used, or two hold the same run.
    """
    forget_programs()
    machine = Machine.load(case.machine)
    recordings = [load_recording(path, gain=machine.drive.gain) for path in case.fits]
    refuse_repeated(recordings)
    ahead = None if case.check is None else outline(_usable(case.check, machine, recordings))
    clear(out)  # no folder holds results of two runs

    def open_check(predicted: float) -> Recording:
        assert case.check is not None
        out.mkdir(parents=True, exist_ok=True)
        with atomic_write(out / "prediction.json") as path:
            path.write_text(json.dumps({"check": {"predicted_after": predicted}}) + "\n", encoding="utf-8")
        return load_recording(case.check, gain=machine.drive.gain)

    return diagnose(
        recordings,
        machine,
        catalogue,
        outline=ahead,
        open_check=None if case.check is None else open_check,
        exclude=exclude,
        threads=threads,
        say=say,
    )


def _usable(path: Path, machine: Machine, others: Sequence[Recording]) -> Recording:
    """The record in a file, refused now and not after minutes of fitting the others."""
    record = load_recording(path, gain=machine.drive.gain)
    admit(record, machine)
    refuse_repeated([*others, record])
    return record
