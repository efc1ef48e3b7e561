"""Every case diagnosed as a user would, and the results committed; it reads the public files of the study alone.

Stopped, it goes on where it was. What was committed may be added to, never changed.
"""

from pathlib import Path

from didim_jax.errors import InputError
from didim_jax.report import prepare_folder

from ..study import commit as commit_of_project
from ..study import write_json
from .layout import CASES, DIAGNOSES, RESULTS, file_digest, read_json
from .ledger import commit, require, verify
from .seal import verify_public

FILES = ("prediction.json", "diagnosis.json", "simulation.npz", "error.txt")
"""Of each case, whichever there are. A case with an error has no diagnosis: a wrong answer, but an answer."""

_COMMITS = "commits.json"


def diagnose(study: Path) -> str:
    """Diagnose what is not diagnosed yet, write results.json and commit it; the hash of the ledger's last line.

    Raises InputError: not sealed, opened already, a record that is not the one sealed, a result changed by hand.
    """
    verify(study, redo="diagnose")
    require(study, "diagnose")
    names = verify_public(study)
    out = prepare_folder(study / DIAGNOSES)
    if (study / RESULTS).exists():
        verify_results(study, complete=False)
    todo = [name for name in names if not (out / name / "diagnosis.json").exists()]
    commits = _commits(out / _COMMITS, bool(todo))
    if todo:
        _diagnose(study / CASES, set(todo), out)
    write_json(study / RESULTS, {"commits": commits, "cases": {name: _hashes(out / name) for name in names}})
    return commit(study, "diagnose")


def verify_results(study: Path, complete: bool = True) -> None:
    """Raises InputError: which file is not what results.json holds. A missing one is to be made if not `complete`."""
    for name, files in read_json(study / RESULTS, "the results; run diagnose first")["cases"].items():
        for file, value in files.items():
            path = study / DIAGNOSES / name / file
            now = file_digest(path)
            retried = not complete and (now is None or "diagnosis.json" not in files)
            if now != value and not retried:
                what = "is missing" if now is None else "was changed"
                raise InputError(f"{path}: {what} since the results were committed.")


def _diagnose(cases: Path, todo: set[str], out: Path) -> None:
    from didim_jax.gap.cases import cases_in
    from didim_jax.report.many import diagnose_under_bar

    diagnose_under_bar([case for case in cases_in(cases) if case.name in todo], out)


def _commits(path: Path, working: bool) -> list[str | None]:
    """Every commit of the project that diagnosed a part of this study, this one last."""
    known: list[str | None] = read_json(path, "commits that diagnosed") if path.exists() else []
    now = commit_of_project()
    if working and now not in known:
        known.append(now)
        write_json(path, known)
    return known


def _hashes(folder: Path) -> dict[str, str]:
    found = {name: file_digest(folder / name) for name in FILES}
    return {name: value for name, value in found.items() if value is not None}
