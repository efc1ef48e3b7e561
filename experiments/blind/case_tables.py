"""Tables with a row a case: the real records, and every wrong answer of the study."""

from collections.abc import Mapping
from typing import Any

from ..page import Tabular
from .real import RULES
from .words import kind, ordered


def real(found: Mapping[str, Any]) -> Tabular:
    """Measured records, or measured records with an exact change whose answer is known."""
    rows = []
    for one in found["cases"]:
        right = "right" if one["right"] else "WRONG"
        names = (" + ".join(one[key]) or "none" for key in ("truth", "found"))
        sizes = _beside_truth(one.get("parameter") or {})
        asked = RULES.get(one.get("rule", ""), "-")
        rows.append(
            (one["case"], one["what"], asked, *names, f"{one['verdict']}: {right}", sizes, _gap(one.get("gap") or {}))
        )
    header = ("case", "record (MEASURED) and what was done", "asked", "truth", "found", "verdict", "size", "gap")
    return Tabular(header, rows, prose=True)


def _beside_truth(size: Mapping[str, Any]) -> str:
    """The planted parameter as found, and as it is."""
    if "name" not in size:
        return "; ".join(_quantities(size)) or "-"
    spread = f" ± {size['std']:.2g}" if size.get("std") is not None else ""
    found = "not estimated" if size["found"] is None else f"{_cell(size['found'])}{spread}"
    return f"{size['name']} {found} {size['unit']} (true {_cell(size['true'])})"


def wrong(score: Mapping[str, Any], answers: Mapping[str, Any]) -> Tabular:
    """Every case that is not accepted, by kind of case."""
    rank = {name: k for k, name in enumerate(ordered([*score["strata"]]))}
    rows = []
    for row in sorted(score["rows"], key=lambda row: (rank[row["stratum"]], row["truth"], row["case"])):
        if not row["accepted"]:
            names = " + ".join(row["found"])
            verdict = "" if row["verdict"] == "effect" else f"{row['verdict']}: "
            said = f"{verdict}{names}" if names else row["note"] or row["verdict"]
            sure = f"{100 * max(row['ranking'].values()):.0f} %" if row["ranking"] else "-"
            encoder = {True: "yes", False: "no"}.get(row["load_encoder"], "-")
            record = (row["model"] or "-", row["noise"] or "-", encoder)
            truth = _truth(row, answers.get(row["case"], {}).get("answer", {}))
            rows.append((row["case"], kind(row["stratum"]), *record, truth, said, sure, _gap(row)))
    about = ("drive", "noise", "load encoder")
    header = ("case", "holds", *about, "truth, its law and size", "said", "probability of the first", "gap")
    return Tabular(header, rows, prose=True)


def _truth(row: Mapping[str, Any], answer: Mapping[str, Any]) -> str:
    """Names, each with the law and the numbers it was made with, where the answer has them."""
    laws, sizes = answer.get("law") or {}, answer.get("parameters") or {}
    said = []
    for name in row["truth"]:
        numbers = ", ".join(_quantities(sizes.get(name) or {}))
        more = "; ".join(filter(None, (laws.get(name, ""), numbers)))
        said.append(f"{name} ({more})" if more else name)
    return " + ".join(said) or "nothing"


def _gap(found: Mapping[str, Any]) -> str:
    """before → after, and what noise leaves, in percent of the motor force."""
    found = found.get("check") or found.get("fit") or found
    before, after, floor = (found.get(key) for key in ("before", "after", "floor"))
    if before is None or after is None:
        return "-"
    noise = "" if floor is None else f" (noise\u00a0{100 * floor:.1f})"
    return f"{100 * before:.1f} → {100 * after:.1f} %".replace(" ", "\u00a0") + noise


def _quantities(found: Any, name: str = "") -> list[str]:
    """Values with their unit and spread, out of whatever nest of names they stand in."""
    if isinstance(found, Mapping) and "value" in found:
        spread = "" if found.get("std") is None else f" ± {found['std']:.2g}"
        true = found.get("true", found.get("truth"))
        known = "" if true is None else f" (true {_cell(true)})"
        unit = f" {found['unit']}" if found.get("unit") not in (None, "", "1") else ""
        return [f"{name} {_cell(found['value'])}{spread}{unit}{known}".strip()]
    if isinstance(found, Mapping):
        return [text for key, value in found.items() for text in _quantities(value, f"{name} {key}".strip())]
    return [f"{name} {_cell(found)}".strip()]


def _cell(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    if isinstance(value, int | float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return ", ".join(_quantities(value))
    return ", ".join(map(_cell, value)) if isinstance(value, list | tuple) else str(value)
