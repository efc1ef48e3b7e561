"""The seals opened: once, when the results are committed, and only if every answer is the one that was sealed."""

from pathlib import Path

from ..study import write_json
from .diagnose import verify_results
from .layout import BASELINES, OPENED, read_json
from .ledger import commit, require, verify
from .seal import read_answers, verify_answers, verify_public


def open_seals(study: Path, answers: Path) -> str:
    """Write opened.json, every answer with its salt, for all to hold against the seals; the hash of the last line.

    Answers of the baselines, if there are any, are committed first. Raises InputError: nothing is diagnosed yet, or
    which answer, record or result was changed.
    """
    verify(study, redo="open")
    require(study, "open")
    verify_public(study)
    verify_results(study)
    documents = read_answers(study, answers)
    verify_answers(study, documents)
    if (study / BASELINES).exists():
        commit(study, "baselines")
    write_json(study / OPENED, documents)
    return commit(study, "open")


def verify_all(study: Path) -> str:
    """Hold everything that there is against the ledger; one line that says how far the study is."""
    steps = verify(study)
    done = {step.step for step in steps}
    cases = verify_public(study) if "seal" in done else []
    if "diagnose" in done:
        verify_results(study)
    if "open" in done:
        verify_answers(study, read_json(study / OPENED, "the answers; run open first"))
    return f"{len(cases)} cases, {' -> '.join(step.step for step in steps) or 'nothing sealed'}: nothing was changed."
