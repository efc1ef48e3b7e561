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

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax import InputError
from didim_jax.config import CONFIG

from .blind.plan import TWINS
from .data import gap_folder
from .study import main, write_json


@dataclass(frozen=True, config=CONFIG)
class Config:
    """Which cases, and whether each effect is left out in turn."""

    whole: bool = Field(description="diagnose with the whole catalogue")
    leave_out: bool = Field(description="diagnose without the case's own effect and its twins")
    cases: int = Field(ge=0, description="how many cases, 0 for all")
    folds: int = Field(ge=2, description="of the cross-validation of the abstention threshold")


def run(config: Config, out: Path) -> None:
    """Diagnose, judge, and cross-validate the one threshold that was set on these cases."""
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
    if config.whole and config.leave_out:
        summary["threshold"] = _cross_validated(out, answers, config.folds)
    write_json(out / "summary.json", summary)
    print(json.dumps(summary, indent=1))


def _left_out(answers: dict[str, Any]) -> dict[str, tuple[str, ...]]:
    """Case to the effects left out for it: its own and the twins of the contract."""
    out = {}
    for case, answer in answers.items():
        if len(answer["effects"]) == 1 and answer["effects"] != ["drive_gain"]:
            own = answer["effects"][0]
            out[case] = tuple(sorted({own}.union(*(pair for pair in TWINS if own in pair))))
    return out


def _diagnose(cases: Path, excluded: dict[str, tuple[str, ...]], out: Path) -> None:
    from didim_jax.effects.catalogue import CATALOGUE
    from didim_jax.gap.cases import cases_in
    from didim_jax.report.many import diagnose_under_bar

    wanted = [case for case in cases_in(cases) if case.name in excluded]
    todo = [case for case in wanted if not (out / case.name / "diagnosis.json").exists()]
    out.mkdir(parents=True, exist_ok=True)
    # A case without a diagnosis is a wrong answer to the judge.
    diagnose_under_bar(todo, CATALOGUE, out, exclude=excluded, label=out.name)


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
    """The share of structure left at which to abstain, set on other effects than those it is judged on."""
    rows = []
    for name, unknown in (("whole", False), ("left_out", True)):
        for path in sorted((out / name).glob("*/diagnosis.json")):
            document = json.loads(path.read_text(encoding="utf-8"))
            if document["effects"]:
                effect = "+".join(answers[path.parent.name]["effects"])
                rows.append((effect, np.log(max(document["evidence"]["left"], 1e-9)), unknown))
    kinds = sorted({row[0] for row in rows})
    right, thresholds = [], []
    for fold in range(folds):
        held = {kind for k, kind in enumerate(kinds) if k % folds == fold}
        trained = [(x, unknown) for kind, x, unknown in rows if kind not in held]
        grid = np.log(np.geomspace(0.005, 0.5, 60))
        hits = [np.mean([(x > c) == unknown for x, unknown in trained]) for c in grid]
        best = float(np.mean(grid[np.array(hits) == max(hits)]))  # the middle of what is equally good
        thresholds.append(float(np.exp(best)))
        right += [(x > best) == unknown for kind, x, unknown in rows if kind in held]
    return {"thresholds": thresholds, "right_on_other_effects": float(np.mean(right)), "cases": len(right)}


if __name__ == "__main__":
    main("gap_cases", Config, run)
