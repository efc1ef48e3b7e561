"""Every case diagnosed as a user would, and the results committed; it reads the public files of the study alone.

Stopped, it goes on where it was. What was committed may be added to, never changed.
"""

from pathlib import Path
from typing import Any

from didim_jax.report import prepare_folder

from ..study import commit as commit_of_project
from ..study import write_json
from .layout import CASES, DIAGNOSES, RESULTS, file_digest, hold, read_json
from .ledger import commit, require, verify
from .seal import verify_public

FILES = ("prediction.json", "diagnosis.json", "simulation.npz", "error.txt")
"""Of each case, whichever there are. A case with an error has no diagnosis: a wrong answer, but an answer."""

_COMMITS = "commits.json"


def diagnose(study: Path) -> str:
    """Diagnose what is not diagnosed yet, write results.json and commit it; the hash of the ledger's last line.

    Raises InputError: not sealed, opened already, a record that is not the one sealed, a result changed by hand.
    """
    steps = verify(study, redo="diagnose")
    require(study, "diagnose")
    names = verify_public(study)
    out = prepare_folder(study / DIAGNOSES)
    before: list[str | None] = []
    if (study / RESULTS).exists() or any(step.step == "diagnose" for step in steps):
        before = verify_results(study, complete=False)["commits"]
    todo = [name for name in names if not (out / name / "diagnosis.json").exists()]
    commits = _commits(out / _COMMITS, before, bool(todo))
    if todo:
        _diagnose(study / CASES, set(todo), out)
    write_json(study / RESULTS, {"commits": commits, "cases": {name: _hashes(out / name) for name in names}})
    return commit(study, "diagnose")


def verify_results(study: Path, complete: bool = True) -> dict[str, Any]:
    """results.json, if every file of a diagnosis is what it holds, and none came to it.

    Unless `complete`, a case whose diagnosis failed may be tried again. Raises InputError: which file is not as it was.
    """
    results: dict[str, Any] = read_json(study / RESULTS, "the results; run diagnose first")
    for name, files in results["cases"].items():
        if not complete and "diagnosis.json" not in files:
            continue
        for file in FILES:
            hold(study / DIAGNOSES / name / file, files.get(file), "since the results were committed")
    return results


def _diagnose(cases: Path, todo: set[str], out: Path) -> None:
    from didim_jax.gap.cases import cases_in
    from didim_jax.report.many import diagnose_under_bar

    diagnose_under_bar([case for case in cases_in(cases) if case.name in todo], out)


def _commits(path: Path, before: list[str | None], working: bool) -> list[str | None]:
    """Every commit of the project that diagnosed a part of this study, those `before` too, this one last."""
    known: list[str | None] = read_json(path, "commits that diagnosed") if path.exists() else []
    known = [*before, *(one for one in known if one not in before)]
    now = commit_of_project()
    if working and now not in known:
        known.append(now)
        write_json(path, known)
    return known


def _hashes(folder: Path) -> dict[str, str]:
    found = {name: file_digest(folder / name) for name in FILES}
    return {name: value for name, value in found.items() if value is not None}
