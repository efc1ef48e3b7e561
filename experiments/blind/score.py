"""The judgement of a study whose seals are open: every rate with its interval, by stratum and by what may matter.

`blind.json` holds `headline` (what is quoted, against its targets), `strata`, `groups` (single effects by noise, load
encoder, model and effect), `confusion`, `calibration`, `baselines` and, of each case, `rows`.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from didim_jax.errors import InputError

from ..study import commit as commit_of_project
from ..study import plain, write_json
from .diagnose import verify_results
from .headline import headline
from .intervals import lead
from .judge import Row, blank_row, judge, row
from .layout import BASELINES, OPENED, SCORE, read_json
from .ledger import Step, commit, require, verify
from .plan import STRATA
from .seal import verify_answers, verify_public
from .summary import by, calibration, correct, summary


def score(study: Path) -> dict[str, Any]:
    """Verify everything, judge every case and write blind.json. Raises InputError: not opened, or tampered with."""
    steps = verify(study, redo="score")
    require(study, "score")
    verify_public(study)
    verify_results(study)
    answers = read_json(study / OPENED, "the answers; run open first")
    verify_answers(study, answers)
    document = {"commit": commit_of_project(), **judged(study, answers, steps)}
    write_json(study / SCORE, document)
    commit(study, "score")
    written: dict[str, Any] = read_json(study / SCORE, "the score")
    return written


def judged(study: Path, answers: Mapping[str, Any], steps: Sequence[Step]) -> dict[str, Any]:
    """What blind.json holds of an opened study, but the commit that judged."""
    rows = [row(study, case, answers[case]) for case in sorted(answers)]
    rivals = baselines(study / BASELINES, answers)
    document = {
        "schema": 1,
        "cases": len(rows),
        "headline": headline(rows, rivals),
        **summary(rows),
        "baselines": {
            "blind": not rivals or "baselines" in {step.step for step in steps},
            "methods": {name: baseline_summary(rows, theirs) for name, theirs in rivals.items()},
        },
        "rows": rows,
    }
    return dict(plain(document))


def differs(one: Any, other: Any, where: str = "") -> str | None:
    """The first place where two JSON values are not the same but for rounding; None: nowhere."""
    inside: list[tuple[str, Any, Any]] = []
    if isinstance(one, dict) and isinstance(other, dict):
        if set(one) != set(other):
            return where or "its keys"
        inside = [(f"{where}.{key}".strip("."), one[key], other[key]) for key in one]
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            return where
        inside = [(f"{where}[{k}]", a, b) for k, (a, b) in enumerate(zip(one, other, strict=True))]
    elif isinstance(one, float) and isinstance(other, float):
        return None if math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-12) else where
    elif one != other:
        return where
    return next((found for place, a, b in inside if (found := differs(a, b, place)) is not None), None)


def baselines(path: Path, answers: Mapping[str, Any]) -> dict[str, list[Row]]:
    """Of each rival a row a case, if there are rivals: {method: {case: {"effects", "ranking", "verdict"?}}}.

    One that gives no verdict says `effect` where it names something and `none` where it does not. A case with an
    "error" is answered wrongly. Raises InputError: a case without an answer, or one that cannot be judged.
    """
    if not path.exists():
        return {}
    out: dict[str, list[Row]] = {}
    for method, theirs in read_json(path, "answers of the baselines").items():
        out[method] = []
        for case in sorted(answers):
            blank = blank_row(case, answers[case])
            if case not in theirs:
                raise InputError(f"{path}: {method} has not answered {case}; run the baselines to their end.")
            try:
                out[method].append(_of_rival(blank, theirs[case]))
            except Exception as error:  # another team's file: whatever is wrong with it
                raise InputError(f"{path}: {method}, {case}: {type(error).__name__}: {error}.") from None
    return out


def _of_rival(blank: Row, said: Mapping[str, Any]) -> Row:
    if "error" in said:
        return dataclasses.replace(blank, note=str(said["error"]))
    return judge(blank, {"verdict": "effect" if said["effects"] else "none"} | dict(said))


def baseline_summary(rows: Sequence[Row], theirs: Sequence[Row]) -> dict[str, Any]:
    """A rival by stratum, and how far the diagnosis is ahead of it on the same cases: accepted, and exact."""
    strata = {}
    for name, some in by(theirs, lambda r: r.stratum, STRATA).items():
        ours = [r for r in rows if r.stratum == name]
        strata[name] = {
            **correct(some),
            **lead([r.accepted for r in ours], [r.accepted for r in some]),
            "exact_lead": lead([r.exact for r in ours], [r.exact for r in some]),
        }
    return {"strata": strata, "calibration": calibration([r for r in theirs if r.kind != "several"])}
