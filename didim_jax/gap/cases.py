"""A case in files: the records to diagnose, the check record, and what may be known of that one before it is judged."""

import dataclasses
import json
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np
import scipy.io

from ..devices import forget_programs
from ..effects import AbstractEffect
from ..errors import InputError
from ..files import atomic_write
from ..formats import load_recording
from ..hygiene import admit_clock, refuse_repeated
from ..machine import Machine
from ..recording import Recording
from .diagnose import diagnose
from .diagnosis import Diagnosis


def outline(path: Path, machine: Machine) -> Recording:
    """The check record with nothing measured in it: t, qg and pulses_N as in the file, qm = qg, vir = 0.

    Of a MATLAB file nothing else is read. Raises InputError as `load_recording` does.
    """
    if path.suffix.lower() == ".mat" and path.is_file():
        try:
            variables = scipy.io.loadmat(path, variable_names=["t", "qg", "pulses_N"])
            there = {name for name, *_ in scipy.io.whosmat(path)}
            known = {k: np.ravel(v).astype(float) for k, v in variables.items() if not k.startswith("_")}
        except Exception as error:  # the reader raises whatever a damaged file makes it stumble over
            raise InputError(f"{path}: not a MATLAB v5 file ({' '.join(str(error).split())}).") from None
        for name in ("t", "qg", "qm", "vir"):
            if name not in there:
                raise InputError(f"{path}: channel {name} is missing; the file holds {', '.join(sorted(there))}.")
    else:
        whole = load_recording(path, gain=machine.drive.gain)
        known = {"t": whole.t, "qg": whole.qg} | ({} if whole.injected is None else {"pulses_N": whole.injected})
    return Recording(
        t=known["t"],
        qg=known["qg"],
        qm=known["qg"],
        vir=np.zeros(len(known["qg"])),
        gain=machine.drive.gain,
        injected=known.get("pulses_N"),
        name=path.stem,
        source=str(path),
    )


def _ahead(path: Path, fits: Sequence[Path], machine: Machine) -> Recording:
    """The check record's outline, refused now, not after minutes of fitting, where that shows that it cannot serve."""
    known = outline(path, machine)
    admit_clock(known, machine)
    if path.resolve() in {fit.resolve() for fit in fits}:
        raise InputError(f"{path}: is fitted already; check on another trajectory.")
    return known


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
    """Read a case, diagnose it and write the prediction to `out`/prediction.json before the check record is opened.

    Raises InputError: any of the files cannot be used.
    """
    forget_programs()
    machine = Machine.load(case.machine)
    recordings = [load_recording(path, gain=machine.drive.gain) for path in case.fits]
    refuse_repeated(recordings)
    ahead = None if case.check is None else _ahead(case.check, case.fits, machine)
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
