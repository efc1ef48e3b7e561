"""The folder of one identification: every file is made in full before the first one is put in its place."""

import contextlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..identify.study import Study
from .canvas import png
from .document import identification_document
from .figures import draw
from .page import render_page
from .words import named_runs

_FILES = ("simulation.npz", "report.html", "identification.json")
_FIGURES = "figures"


def prepare_folder(folder: str | os.PathLike[str]) -> Path:
    """Make the folder and try to write in it.

    Raises InputError, one line: not a folder, no permission, a read-only or full disk, a folder in the place of a file.
    """
    folder = Path(folder)
    with _one_line(folder):
        for path in (folder, *folder.parents):
            if path.exists() and not path.is_dir():
                raise InputError(f"{path}: is a file, a folder is expected.")
        folder.mkdir(parents=True, exist_ok=True)
        with _temporary(folder) as probe:
            (probe / "probe").write_text("written", encoding="ascii")
    for name in _FILES:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name}: is a folder, it stands where a file is to be written.")
    if (figures := folder / _FIGURES).exists() and not figures.is_dir():
        raise InputError(f"{figures}: is a file, it stands where a folder is to be written.")
    return folder


def check_folder(folder: str | os.PathLike[str]) -> None:
    """Refuse what `prepare_folder` would, before an identification is worth losing, and leave no folder behind."""
    with _taken_back(Path(folder)):
        prepare_folder(folder)


def write_study(study: Study, folder: str | os.PathLike[str]) -> list[Path]:
    """Write figures/*.png, simulation.npz, report.html and identification.json; their paths, in that order.

    identification.json comes last: where it is new, so is everything else. After an error in making any of them the
    folder is as it was.

    Raises InputError as `prepare_folder` does.
    """
    folder = Path(folder)
    with _taken_back(folder), _one_line(folder), _temporary(prepare_folder(folder)) as workshop:
        made = _make(study, workshop)
        return _move(made, workshop, folder)


def _make(study: Study, workshop: Path) -> list[Path]:
    (workshop / _FIGURES).mkdir()
    pictures = {name: png(figure) for name, figure in draw(study).items()}
    paths = [workshop / _FIGURES / f"{name}.png" for name in pictures]
    for path, picture in zip(paths, pictures.values(), strict=True):
        path.write_bytes(picture)
    simulation, report, document = (workshop / name for name in _FILES)
    signals = {
        f"{name}_{signal}": values
        for name, run in named_runs(study).items()
        for signal, values in (
            ("t", run.recording.t),
            ("tau", run.recording.tau),
            ("tau_sim", run.tau),
            ("qm", run.recording.qm),
            ("qm_sim", run.qm),
        )
    }
    np.savez(simulation, allow_pickle=False, **signals)
    report.write_text(render_page(study, pictures), encoding="utf-8")
    text = json.dumps(identification_document(study), indent=2, ensure_ascii=False, allow_nan=False)
    document.write_text(text + "\n", encoding="utf-8")
    return [*paths, simulation, report, document]


def _move(made: list[Path], workshop: Path, folder: Path) -> list[Path]:
    """Put each file in its place; a figure of an earlier run that this one does not have would belong to nothing."""
    (folder / _FIGURES).mkdir(exist_ok=True)
    placed = [folder / path.relative_to(workshop) for path in made]
    for source, target in zip(made, placed, strict=True):
        os.replace(source, target)
    for old in (folder / _FIGURES).glob("*.png"):
        if old not in placed and (old.stem in ("iterates", "estimates") or old.stem.startswith("force_")):
            old.unlink()
    return placed


@contextlib.contextmanager
def _taken_back(folder: Path) -> Iterator[None]:
    """Remove the folders made inside, where in the end nothing is in them."""
    missing = [path for path in (folder, *folder.parents) if not os.path.exists(path)]
    try:
        yield
    finally:
        for path in missing:
            with contextlib.suppress(OSError):  # not made, or not empty
                path.rmdir()


@contextlib.contextmanager
def _temporary(folder: Path) -> Iterator[Path]:
    """A hidden folder beside the files to come; inside `folder`, because its parent may be another file system."""
    path = folder / f".writing-{secrets.token_hex(4)}"
    try:
        path.mkdir()
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


@contextlib.contextmanager
def _one_line(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}).") from error
