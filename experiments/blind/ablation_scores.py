"""Answers of the ablations, judged by the rules of the study, on the cases whose truth blind.json holds."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from .intervals import exact_paired_test, lead, rate
from .judge import agreement

WORDS = {
    "complete": "complete diagnosis",
    "no_projection": "nuisances not projected out in the preselection",
    "no_numerics": "width and shape of friction's sign held, not fitted",
    "no_start": "initial state as the first samples say, not fitted",
    "no_whitening": "white noise instead of whitening",
    "force_only": "motor force only: no control law, no encoder grid, no load encoder",
    "didim_jacobian": "DIDIM's Jacobian in the same solver, not the exact one",
    "fit_only": "no test on blocks left out; the other rules remain",
}
"""Ablation to what is different in it."""


@dataclasses.dataclass(frozen=True)
class Ablated:
    """One variant: how many are right in all, of one effect and of none of the catalogue's; false alarms where there is
    nothing; points behind the complete diagnosis, cases lost and won against it, and how likely that is by chance.
    """

    name: str
    right: Mapping[str, Any]
    single: Mapping[str, Any]
    outside: Mapping[str, Any]
    alarms: Mapping[str, Any]
    behind: float | None
    interval: tuple[float, float] | None
    lost: int
    won: int
    p_value: float
    errors: int

    @property
    def words(self) -> str:
        """What is different in it."""
        return WORDS.get(self.name, self.name)


def ablated(answers: Mapping[str, Mapping[str, Any]], score: Mapping[str, Any]) -> list[Ablated]:
    """Every variant that ran, the complete one first; an error is a wrong answer."""
    rows = {row["case"]: row for row in score["rows"]}
    accepted = {
        name: {case: _accepted(rows[case], said) for case, said in sorted(cases.items()) if case in rows}
        for name, cases in answers.items()
    }
    complete = accepted.get("complete", {})
    out = []
    for name in [n for n in WORDS if n in answers] + [n for n in answers if n not in WORDS]:
        both = [case for case in accepted[name] if case in complete and name != "complete"]
        pair = [complete[case] for case in both], [accepted[name][case] for case in both]
        behind = lead(*pair)
        judged = {case: answers[name][case] for case in accepted[name]}
        quiet = [said for case, said in judged.items() if rows[case]["stratum"] in ("none", "numerics")]
        out.append(
            Ablated(
                name,
                rate([*accepted[name].values()]).as_json(),
                rate([ok for case, ok in accepted[name].items() if _single(rows[case])]).as_json(),
                rate([ok for case, ok in accepted[name].items() if rows[case]["stratum"] == "outside"]).as_json(),
                rate([said.get("verdict", "failed") != "none" for said in quiet]).as_json(),
                behind["ahead"],
                behind["interval"],
                *exact_paired_test(*pair),
                sum("error" in said for said in judged.values()),
            )
        )
    return out


def _single(row: Mapping[str, Any]) -> bool:
    """Whether it holds one effect that can be seen and that the catalogue has."""
    return len(row["truth"]) == 1 and row["stratum"] not in ("outside", "alias")


def complete_and_sealed(answers: Mapping[str, Mapping[str, Any]], score: Mapping[str, Any]) -> tuple[int, int, int]:
    """How many cases the complete diagnosis ran on, how many it had right, and how many the sealed one had of them."""
    rows = {row["case"]: row for row in score["rows"]}
    both = [(said, rows[case]) for case, said in answers.get("complete", {}).items() if case in rows]
    return len(both), sum(_accepted(row, said) for said, row in both), sum(row["accepted"] for _, row in both)


def _accepted(row: Mapping[str, Any], said: Mapping[str, Any]) -> bool:
    """Whether an answer is accepted by the rules of the study; an error is not."""
    if "error" in said:
        return False
    return agreement(row["target"], said["verdict"], said["effects"], said.get("ambiguous_with") or [])[1]
