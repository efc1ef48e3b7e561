"""What `score` prints: the headline, the strata, and the baselines beside the diagnosis."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

_WIDE = 240


def print_score(document: Mapping[str, Any], console: Console | None = None) -> None:
    """blind.json for a person; in a file or a pipe the lines are as long as they need be."""
    console = console or Console()
    if not console.is_terminal:
        console.width = _WIDE
    _print(console, "headline", ("what", "seen", "of", "95 %", "minimum", "aim", "claim"), _headline(document))
    _print(console, "strata", ("stratum", "n", "accepted", "exact", "95 %", "verdicts"), _strata(document))
    methods = document["baselines"]["methods"]
    if methods:
        names = list(document["strata"])
        compared = {"diagnosis": document["strata"], **{method: found["strata"] for method, found in methods.items()}}
        rows = [
            (who, *(_percent(strata[name]["accepted"]["value"]) for name in names)) for who, strata in compared.items()
        ]
        _print(console, "accepted, beside the baselines", ("method", *names), rows)
        if not document["baselines"]["blind"]:
            console.print("The baselines were not committed before the seals were opened.")
    if failed := [row for row in document["rows"] if row["note"]]:
        console.print(Text(f"{len(failed)} without a usable diagnosis, the first {failed[0]['case']}: "), end="")
        console.print(Text(failed[0]["note"]))


def _headline(document: Mapping[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for one in document["headline"]:
        rated = "k" in one
        show = _percent if rated else _number
        bounds = f"{show(one['low'])} - {show(one['high'])}" if one["low"] is not None and one["n"] else "-"
        of = f"{one['k']}/{one['n']}" if rated else str(one["n"])
        sign = {True: "≤ ", False: "≥ ", None: ""}[one["at_most"]]
        limits = ("-" if one[key] is None else sign + show(one[key]) for key in ("minimum", "aim"))
        rows.append((one["what"], show(one["value"]), of, bounds, *limits, one["claim"] or "-"))
    return rows


def _strata(document: Mapping[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, found in document["strata"].items():
        accepted = found["accepted"]
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in sorted(found["verdicts"].items()))
        bounds = f"{_percent(accepted['low'])} - {_percent(accepted['high'])}"
        shares = (_percent(accepted["value"]), _percent(found["exact"]["value"]))
        rows.append((name, str(found["n"]), *shares, bounds, verdicts))
    return rows


def _print(console: Console, title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    table = Table(*header, title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
