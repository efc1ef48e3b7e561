"""The judgement of a study whose seals are open: every rate with its interval, by stratum and by what may matter.

`blind.json` holds `headline` (what is quoted, against its targets), `strata`, `groups` (single effects by noise, load
encoder, model and effect), `confusion`, `calibration`, `baselines` and, of each case, `rows`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from didim_jax.errors import InputError

from ..study import write_json
from .diagnose import verify_results
from .headline import headline
from .intervals import bootstrap
from .judge import Row, blank_row, judge, row
from .layout import BASELINES, OPENED, SCORE, read_json
from .ledger import commit, require, verify
from .plan import STRATA
from .seal import verify_answers, verify_public
from .summary import by, calibration, correct, mean, summary


def score(study: Path) -> dict[str, Any]:
    """Verify everything, judge every case and write blind.json. Raises InputError: not opened, or tampered with."""
    steps = verify(study, redo="score")
    require(study, "score")
    verify_public(study)
    verify_results(study)
    answers = read_json(study / OPENED, "the answers; run open first")
    verify_answers(study, answers)
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
    write_json(study / SCORE, document)
    commit(study, "score")
    written: dict[str, Any] = read_json(study / SCORE, "the score")
    return written


def baselines(path: Path, answers: Mapping[str, Any]) -> dict[str, list[Row]]:
    """Of each rival a row a case, if there are rivals: {method: {case: {"effects", "ranking", "verdict"?}}}.

    One that gives no verdict says `effect` where it names something and `none` where it does not. A case without an
    answer, or with an "error", is answered wrongly. Raises InputError: an answer that cannot be judged.
    """
    if not path.exists():
        return {}
    out: dict[str, list[Row]] = {}
    for method, theirs in read_json(path, "answers of the baselines").items():
        out[method] = []
        for case in sorted(answers):
            blank = blank_row(case, answers[case])
            said = theirs.get(case, {"error": "missing"})
            if "error" not in said:
                verdict = {"verdict": "effect" if said["effects"] else "none"}
                try:
                    blank = judge(blank, verdict | said)
                except (KeyError, ValueError) as error:
                    raise InputError(f"{path}: {method}, {case}: {error}.") from None
            out[method].append(blank)
    return out


def baseline_summary(rows: Sequence[Row], theirs: Sequence[Row]) -> dict[str, Any]:
    """A rival by stratum, and how far the diagnosis is ahead of it on the same cases, in accepted."""
    strata = {}
    for name, some in by(theirs, lambda r: r.stratum, STRATA).items():
        ours = [r for r in rows if r.stratum == name]
        ahead = [float(a.accepted) - float(b.accepted) for a, b in zip(ours, some, strict=True)]
        strata[name] = {**correct(some), "ahead": mean(ahead), "interval": bootstrap(ahead, np.mean)}
    return {"strata": strata, "calibration": calibration([r for r in theirs if r.kind != "several"])}
