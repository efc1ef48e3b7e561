"""The seals of a study: a salted hash of every answer and a hash of every public file, published before diagnosing.

An outside team brings a folder with

    cases/NAME/fit.mat, check.mat, machine.toml     what `didim diagnose --cases` reads; nothing in it tells the answer
    answers/NAME.json                               kept to themselves, wherever they like (`--answers DIR`)

and runs `seal` on it. An answer is a JSON object:

    "case"      the NAME of its folder
    "salt"      64 random hexadecimal digits; left out, `seal` draws them and writes them into the file
    "stratum"   single, small, large, none, numerics, alias, two, three, outside or poor; others count on their own
    "noise", "load_encoder", "model"   low | usual | high, true | false, flexible | rigid; optional
    "answer"    "effects": names of `didim effects`, or of their own beginning with x_ for one that is in no catalogue
                "floor": {"check": the gap that noise alone leaves on check.mat}
                "before": {"check": the gap with the nominal parameters}; optional
                "parameters": {effect: {name: {"value": number}}}, or the number alone, SI; optional

`seals.json` then holds of each case SHA-256(salt, as 32 bytes, then the object without its salt in canonical JSON:
keys sorted, no spaces, ASCII) and the SHA-256 of each public file; and of answers/plan.json, if `make` left one:
cases of the plan that are not sealed would show, and its seed makes all of them anew. It is published; the folder
without the answers goes to whoever diagnoses, and `open --answers DIR` is run when the results are committed.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from didim_jax.errors import InputError

from ..study import write_json
from .layout import CASES, DIAGNOSES, PLAN, PUBLIC, SEALS, canonical, case_names, digest, file_digest, hold, read_json
from .ledger import commit, require, verify
from .make import new_salt


def seal(study: Path, answers: Path) -> str:
    """Write seals.json and begin the ledger with it. Raises InputError: an answer is missing or unusable."""
    verify(study, redo="seal")
    require(study, "seal")
    names = case_names(study)
    if (study / DIAGNOSES).exists():
        raise InputError(f"{study / DIAGNOSES}: there are diagnoses before there is a seal; move them away.")
    _complete(study, answers, names)
    cases = {}
    for name in names:
        document = salted(answers / f"{name}.json", name)
        files = {file: file_digest(study / CASES / name / file) for file in PUBLIC}
        if missing := [file for file, value in files.items() if value is None]:
            raise InputError(f"{study / CASES / name}: {missing[0]} is missing.")
        cases[name] = {"answer": sealed(document), "files": files}
    write_json(study / SEALS, {"schema": 1, "plan": file_digest(answers / PLAN), "cases": cases})
    return commit(study, "seal")


def sealed(document: Mapping[str, Any]) -> str:
    """The seal of an answer."""
    content = {key: value for key, value in document.items() if key != "salt"}
    return digest(bytes.fromhex(document["salt"]) + canonical(content))


def salted(path: Path, case: str) -> dict[str, Any]:
    """The answer of a case, with a salt that is written into its file where it had none."""
    document = _usable(path, case)
    if "salt" not in document:
        document["salt"] = new_salt()
        write_json(path, document)
    return document


def verify_public(study: Path) -> list[str]:
    """Names of the cases, if their files are those that were sealed. Raises InputError: which one is not."""
    expected = read_json(study / SEALS, "the seals; run seal first")["cases"]
    for name in sorted(set(case_names(study)) | set(expected)):
        if name not in expected:
            raise InputError(f"{study / CASES / name}: was added after the cases were sealed.")
        for file, value in expected[name]["files"].items():
            hold(study / CASES / name / file, value, "since it was sealed")
    return sorted(expected)


def verify_answers(study: Path, documents: Mapping[str, Mapping[str, Any]]) -> None:
    """Raises InputError: which answer is not the one that was sealed."""
    for name, case in read_json(study / SEALS, "the seals; run seal first")["cases"].items():
        if name not in documents:
            raise InputError(f"{name}: its answer is missing.")
        if sealed(documents[name]) != case["answer"]:
            raise InputError(f"{name}: its answer, stratum or salt was changed since it was sealed.")


def verify_plan(study: Path, path: Path) -> bool:
    """Whether there is a sealed plan, and `path` is it. Raises InputError: one that was changed or is missing."""
    expected = read_json(study / SEALS, "the seals; run seal first").get("plan")
    if expected is not None:
        hold(path, expected, "since it was sealed", "the plan ")
    return expected is not None


def read_answers(study: Path, answers: Path) -> dict[str, dict[str, Any]]:
    """Case to answer, of every sealed case. Raises InputError: missing or unusable."""
    return {
        name: _usable(answers / f"{name}.json", name, salt=True)
        for name in read_json(study / SEALS, "the seals; run seal first")["cases"]
    }


def _complete(study: Path, answers: Path, names: list[str]) -> None:
    if (answers / PLAN).exists():
        planned = {case["case"] for case in read_json(answers / PLAN, "the plan of this study")["cases"]}
        if planned != set(names):
            differing = sorted(planned ^ set(names))
            raise InputError(
                f"{study}: not what was planned, {len(differing)} differ ({differing[0]}); run make first."
            )


def _usable(path: Path, case: str, salt: bool = False) -> dict[str, Any]:
    """An answer that can be sealed and judged."""
    document = read_json(path, f"the answer of {case}")
    if not isinstance(document, dict) or not isinstance(document.get("answer"), dict):
        raise InputError(f"{path}: an answer is an object with case, stratum and answer.")
    answer = document["answer"]
    effects, floor = answer.get("effects"), answer.get("floor")
    wrong = {
        f"case must be {case!r}": document.get("case") != case,
        "stratum must be a text": not isinstance(document.get("stratum"), str),
        "salt must be 64 hexadecimal digits": (salt or "salt" in document)
        and not re.fullmatch("[0-9a-f]{64}", str(document.get("salt"))),
        "answer.effects must be a list of names": not isinstance(effects, list)
        or not all(isinstance(name, str) for name in effects),
        "answer.floor.check must be a number, 0 or more": not isinstance(floor, dict)
        or not isinstance(floor.get("check"), int | float)
        or not floor["check"] >= 0,
    }
    if said := [text for text, is_wrong in wrong.items() if is_wrong]:
        raise InputError(f"{path}: {said[0]}.")
    return document
