"""Every case with known answers diagnosed, once with the whole catalogue and once without its own effect and its twins.

python -m experiments.gap_cases [--config configs/gap_cases.toml] [--set key=value ...] [--quick] --out DIR

A case that is already diagnosed in DIR is not done again: begin with an empty DIR after a change of the code. The
answers are read here, to know what to leave out, and by the judge that comes with the cases; the package never sees
them.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax import InputError
from didim_jax.config import CONFIG

from .blind.calibrate import SEARCHED, Seen, compared, figures
from .blind.judge import blank_row, judge
from .blind.plan import with_twins
from .data import gap_folder
from .study import main, write_json


@dataclass(frozen=True, config=CONFIG)
class Config:
    """Which cases, and whether each effect is left out in turn."""

    whole: bool = Field(description="diagnose with the whole catalogue")
    leave_out: bool = Field(description="diagnose without the case's own effect and its twins")
    cases: int = Field(ge=0, description="how many cases, 0 for all")
    folds: int = Field(ge=2, description="of the cross-validation of the decision's constants")


def run(config: Config, out: Path) -> None:
    """Diagnose, judge, and cross-validate the constants of the decision."""
    folder = gap_folder()
    if folder is None:
        raise InputError(
            "the cases are not here: a folder gap with dev, dev_answers.json and score.py; see DIDIM_DATA."
        )
    answers = json.loads((folder / "dev_answers.json").read_text(encoding="utf-8"))
    summary: dict[str, Any] = {}
    for name, wanted in (("whole", config.whole), ("left_out", config.leave_out)):
        if not wanted:
            continue
        excluded = _left_out(answers) if name == "left_out" else {case: () for case in answers}
        chosen = dict(list(excluded.items())[: config.cases or None])
        _diagnose(folder / "dev", chosen, out / name)
        summary[name] = _judged(folder, {case: answers[case] for case in chosen}, out / name, name == "left_out")
    if config.whole:
        summary["probabilities"] = _cross_validated(out, answers, config.folds)
    write_json(out / "summary.json", summary)
    print(json.dumps(summary, indent=1))


def _left_out(answers: dict[str, Any]) -> dict[str, tuple[str, ...]]:
    """Case to the effects left out for it: its own and the twins of the contract."""
    out = {}
    for case, answer in answers.items():
        if len(answer["effects"]) == 1 and answer["effects"] != ["drive_gain"]:
            out[case] = tuple(sorted(with_twins(answer["effects"][0])))
    return out


def _diagnose(cases: Path, excluded: dict[str, tuple[str, ...]], out: Path) -> None:
    from didim_jax.gap.cases import cases_in
    from didim_jax.report.many import diagnose_under_bar

    wanted = [case for case in cases_in(cases) if case.name in excluded]
    todo = [case for case in wanted if not (out / case.name / "diagnosis.json").exists()]
    out.mkdir(parents=True, exist_ok=True)
    # A case without a diagnosis is a wrong answer to the judge.
    diagnose_under_bar(todo, out, exclude=excluded, label=out.name)


def _judged(folder: Path, answers: dict[str, Any], results: Path, excluded: bool) -> dict[str, Any]:
    """What the judge says; a case of its own process, as anyone would run it."""
    chosen = results / "answers.json"
    write_json(chosen, answers)
    command = [sys.executable, str(folder / "score.py"), str(results), str(chosen), str(folder / "dev")]
    subprocess.run(
        [*command, *(["--excluded"] if excluded else []), "--json", str(results / "score.json")],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    score: dict[str, Any] = json.loads((results / "score.json").read_text(encoding="utf-8"))
    rows = score["rows"]
    named = sum(row["found"].split(":")[0] in ("effect", "ambiguous") for row in rows)
    return {**score["summary"], "cases": len(rows), "named": named / len(rows)}


def _cross_validated(out: Path, answers: dict[str, Any], folds: int) -> dict[str, Any]:
    """Probabilities and abstention with constants that were fitted on other effects than those they are judged on."""
    cases = []
    for name in ("whole", "left_out"):
        for path in sorted((out / name).glob("*/diagnosis.json")):
            effects = answers[path.parent.name]["effects"]
            if name == "left_out":  # it is in no catalogue then
                effects = [f"x_{effect}" for effect in effects]
            blank = blank_row(path.parent.name, {"stratum": name, "answer": {"effects": effects}})
            cases.append(Seen.of(blank, json.loads(path.read_text(encoding="utf-8"))))
    return {
        "note": SEARCHED,
        "as_written": figures([judge(seen.blank, seen.document) for seen in cases]),
        **compared(cases, folds),
    }


if __name__ == "__main__":
    main("gap_cases", Config, run)
