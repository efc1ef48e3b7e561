"""The seals opened: once, when the results are committed, and only if every answer is the one that was sealed."""

from pathlib import Path

from didim_jax.errors import InputError
from didim_jax.files import atomic_write

from ..study import write_json
from .diagnose import verify_results
from .layout import BASELINES, OPENED, PLAN, SCORE, digest, read_json
from .ledger import commit, require, verify
from .score import baselines, differs, judged
from .seal import read_answers, verify_answers, verify_plan, verify_public


def open_seals(study: Path, answers: Path) -> str:
    """Write opened.json, every answer with its salt, for all to hold against the seals; the hash of the last line.

    Answers of the baselines, if there are any, are committed first. The plan, where one was sealed, is shown as well:
    STUDY/plan.json. Raises InputError: nothing is diagnosed yet, a baseline has not answered every case, or which
    answer, record or result was changed.
    """
    verify(study, redo="open")
    require(study, "open")
    verify_public(study)
    verify_results(study)
    documents = read_answers(study, answers)
    verify_answers(study, documents)
    planned = verify_plan(study, answers / PLAN)
    if (study / BASELINES).exists():
        baselines(study / BASELINES, documents)  # all there and usable: once open, none may be mended
        commit(study, "baselines")
    if planned:
        with atomic_write(study / PLAN) as path:
            path.write_bytes((answers / PLAN).read_bytes())
    write_json(study / OPENED, documents)
    return commit(study, "open")


def verify_all(study: Path, published: str | None = None) -> str:
    """Hold everything that there is against the ledger, the score too, which is judged anew; a line on how far it is.

    Raises InputError: what was changed; or no line of the ledger has the hash that was `published`.
    """
    steps = verify(study)
    if published is not None and published not in {digest(step.line) for step in steps}:
        raise InputError(f"{study}: no line of its ledger has the hash {published}: it was written anew.")
    done = {step.step for step in steps}
    cases = verify_public(study) if "seal" in done else []
    if "diagnose" in done:
        verify_results(study)
    if "open" in done:
        answers = read_json(study / OPENED, "the answers; run open first")
        verify_answers(study, answers)
        verify_plan(study, study / PLAN)
    if "score" in done:  # which needs open, by the ledger's order
        written = read_json(study / SCORE, "the score")
        if (where := differs(written, judged(study, answers, steps) | {"commit": written.get("commit")})) is not None:
            raise InputError(f"{study / SCORE}: judged anew, {where or 'all of it'} is another.")
    return f"{len(cases)} cases, {' -> '.join(step.step for step in steps) or 'nothing sealed'}: nothing was changed."
