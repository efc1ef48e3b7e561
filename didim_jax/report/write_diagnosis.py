"""The folder of one diagnosis: every file is made in full before the first one is put in its place."""

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from ..errors import InputError
from ..files import atomic_write
from ..gap.diagnosis import Diagnosis
from .canvas import png
from .diagnosis_document import diagnosis_document
from .diagnosis_page import BADGES, draw_diagnosis, named_runs, render_diagnosis
from .diagnosis_words import UNCHECKED, answers, headline

_FILES = ("simulation.npz", "report.html", "diagnosis.json")


def write_diagnosis(d: Diagnosis, folder: Path) -> None:
    """Write simulation.npz, report.html and diagnosis.json, the last one last: where it is new, so is the rest.

    After an error in making any of them the folder is as it was. Raises InputError, one line: it cannot be written to.
    """
    pictures = {name: png(figure) for name, figure in draw_diagnosis(d).items()}
    made = (_arrays(d), render_diagnosis(d, pictures).encode(), _document(d))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}).") from error
    for name in _FILES:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name}: is a folder, it stands where a file is to be written.")
    with contextlib.ExitStack() as stack:
        # All are written beside their places first; they are then moved there in the opposite order of this one.
        paths = [stack.enter_context(atomic_write(folder / name)) for name in reversed(_FILES)]
        for path, content in zip(paths, reversed(made), strict=True):
            path.write_bytes(content)


def _arrays(d: Diagnosis) -> bytes:
    """simulation.npz: of each record time (s), recorded and simulated commanded force (N), before and after."""
    arrays: dict[str, Any] = {}
    for name, run in named_runs(d).items():
        signals = {"t": run.t, "tau": run.tau, "tau_before": run.before, "tau_after": run.after}
        arrays |= {f"{name}_{key}": signal for key, signal in signals.items()}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _document(d: Diagnosis) -> bytes:
    text = json.dumps(diagnosis_document(d), indent=1, allow_nan=False, ensure_ascii=False)
    return f"{text}\n".encode()


def print_diagnosis(d: Diagnosis, folder: Path, console: Console | None = None) -> None:
    """The verdict and the three answers on the terminal, then what was remarked and where the report is."""
    console = console or Console()
    if d.synthetic:
        console.print(Text("SYNTHETIC data: simulated, not measured on a machine.", style="bold yellow"))
    for said in (*d.doubts, *(() if "check" in d.gap else (UNCHECKED,))):
        console.print(Text(said, style="bold yellow"))
    style = {"none": "bold green", "effect": "bold blue"}.get(d.verdict, "bold yellow")
    # Text, not str: a name out of a file is no markup.
    console.print(Text.assemble((f"{BADGES[d.verdict].upper()}  ", style), (headline(d), "bold")))
    for answer in answers(d):
        console.print(Text.assemble("\n", (f"{answer.question} {answer.head}.", "bold"), f"\n{answer.text}"))
    if d.remarks:
        console.print(Text("\nRemarks:"))
        for remark in d.remarks:
            console.print(Text(f"- {remark}"))
    console.print(Text(f"\nReport: {folder / 'report.html'}"), soft_wrap=True)
