"""The folder of one diagnosis: every file is made in full before the first one is put in its place."""

import json
from pathlib import Path

import numpy as np

from ..files import atomic_write
from ..gap.diagnosis import Diagnosis
from .diagnosis_document import diagnosis_document


def write_diagnosis(d: Diagnosis, folder: Path) -> None:
    """Write simulation.npz, report.html and diagnosis.json, the last one last: where it is new, so is the rest."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {}
    for name, run in zip(_names(d), d.runs, strict=True):
        arrays |= {
            f"{name}_t": run.t,
            f"{name}_tau": run.tau,
            f"{name}_tau_before": run.before,
            f"{name}_tau_after": run.after,
        }
    with atomic_write(folder / "simulation.npz") as path:
        np.savez_compressed(path, **arrays)
    text = json.dumps(diagnosis_document(d), indent=1, allow_nan=False, ensure_ascii=False)
    with atomic_write(folder / "diagnosis.json") as path:
        path.write_text(text + "\n", encoding="utf-8")


def _names(d: Diagnosis) -> list[str]:
    """fit (fit_2, ...) and check, in the order of the runs."""
    fits = len(d.runs) - ("check" in d.gap)
    return [*("fit" if k == 0 else f"fit_{k + 1}" for k in range(fits)), "check"][: len(d.runs)]


def print_diagnosis(d: Diagnosis, folder: Path) -> None:
    """The three answers on the terminal."""
    from .diagnosis_words import answers

    for line in answers(d):
        print(line)
    print(f"{folder / 'report.html'}")
