"""Rows of tables.json laid out as the paper's tables are, ours beside its own."""

from collections.abc import Sequence

from ..page import Tabular
from .methods import DIDIM, EXACT, FLEXIBLE, LS, LS_LATE, SEVEN
from .published import BARE, LOADED, OE, Key, unit
from .rows import SUMS, Row
from .twin import PLUS

DASH = "–"

type Lookup = dict[Key, Row]


def lookup(rows: Sequence[Row]) -> Lookup:
    """Rows by their key."""
    return {(row.table, row.parameter, row.case): row for row in rows}


def number(x: float | None) -> str:
    """Four digits; whole numbers in groups of three from ten thousand on; rounding is zero."""
    if x is None:
        return DASH
    if abs(x) < 1e-9:
        return "0"
    if abs(x) >= 1e4:
        return f"{x:,.0f}".replace(",", "\N{NO-BREAK SPACE}")
    return f"{x:.4g}" if abs(x) >= 1e-3 else f"{x:.1e}"


def relative(x: float | None) -> str:
    """A relative difference, percent."""
    return DASH if x is None else f"{x:+.1f}\N{NO-BREAK SPACE}%"


def _name(parameter: str) -> str:
    u = unit(parameter, "")
    return parameter if u == "1" else f"{parameter}, {u}"


def first_table(rows: Lookup, record: str) -> Tabular:
    """Table 1."""
    header = ("", "start", "paper", "ours", "ours vs paper", "truth", "ours vs truth", "%std paper", "%std ours")
    body = []
    for name in ("M_tot", "Fv_tot", "Fc_tot"):
        start, std = (rows["1", name, f"{record}, {column}"] for column in ("start", "%std"))
        body.append([_name(name), number(start.ours), *_compared(rows["1", name, f"{record}, result"]), *_pair(std)])
    error = rows["1", "relative error", f"{record}, result"]
    body.append([_name("relative error"), "", *_compared(error), "", ""])
    return Tabular(header, body, f"Table 1, {record}")


def second_table(rows: Lookup, record: str) -> Tabular:
    """Table 2."""
    header = ("", "start", "paper", "ours", "ours vs paper", "truth", "ours vs truth")
    body = []
    for name in ("lam", "f_n"):
        start = number(rows["2", name, f"{record}, start"].ours)
        body.append([_name(name), start, *_compared(rows["2", name, f"{record}, result"])])
    for name in ("relative error", "iterations"):
        body.append([_name(name), "", *_compared(rows["2", name, f"{record}, result"])])
    return Tabular(header, body, f"Table 2, {record}")


def inverse_table(rows: Lookup, table: str, record: str) -> Tabular:
    """Tables 3 and 4, IDIM-LS: the held force centred, and taken as it is recorded."""
    header = ["", "paper", "ours", "ours vs paper", "truth", "ours vs truth", "%std paper", "%std ours"]
    header += ["force not centred", "it vs truth"]
    body = []
    for name in (*SEVEN, *SUMS, *(["Delta M2"] if record != BARE else []), "relative error"):
        case = f"{record}, {LS}"
        std = rows.get((table, name, f"{case} %std"))
        late = rows[table, name, f"{record}, {LS_LATE}"]
        spread = _pair(std) if std else ("", "")
        body.append(
            [_name(name), *_compared(rows[table, name, case]), *spread, number(late.ours), relative(late.error)]
        )
    return Tabular(header, body, f"Table {table}, IDIM-LS, {record}")


def didim_table(rows: Lookup, table: str, record: str) -> Tabular:
    """Tables 3 and 4, DIDIM."""
    header = ["", "start paper", "start ours", "paper", "ours", "ours vs paper", "truth", "ours vs truth"]
    header += ["%std paper", "%std ours"]
    body = []
    extra = ["Delta M2"] if record != BARE else []
    for name in (*SEVEN, *SUMS, *extra, "relative error"):
        case = f"{record}, {DIDIM}"
        start, std = rows.get((table, name, f"{case} start")), rows.get((table, name, f"{case} %std"))
        begin = _pair(start) if start else ("", "")
        spread = _pair(std) if std else ("", "")
        body.append([_name(name), *begin, *_compared(rows[table, name, case]), *spread])
    return Tabular(header, body, f"Table {table}, DIDIM (five columns), {record}")


def all_methods(rows: Lookup, table: str, record: str, methods: Sequence[str]) -> Tabular:
    """Every method on one record: estimates, and in brackets how far off the truth."""
    body = []
    for name in (*SEVEN, *SUMS, "relative error", "iterations", "simulations"):
        cells = []
        truth = rows[table, name, f"{record}, {EXACT}"].truth if name in (*SEVEN, *SUMS) else None
        for method in methods:
            row = rows.get((_table_of(table, method), name, f"{record}, {method}"))
            off = f" ({relative(row.error)})" if row and row.error is not None else ""
            cells.append("" if row is None else number(row.ours) + off)
        body.append([_name(name), number(truth) if truth is not None else "", *cells])
    return Tabular(("", "truth", *methods), body, f"all methods, {record}")


def _table_of(table: str, method: str) -> str:
    """Output error has tables of its own, of the records that the paper has."""
    own = {column: number for number, column in OE.items()}
    return own.get(method, table) if table != "extra" else table


def output_error_table(rows: Lookup, table: str, record: str) -> Tabular:
    """Tables 5 and 6."""
    case = f"{record}, {OE[table]}"
    header = ("", "paper", "ours", "ours vs paper", "truth", "ours vs truth", "eq. 34 paper", "eq. 34 ours")
    body = []
    extra = ["Delta M2"] if record != BARE else []
    for name in (*SEVEN, *SUMS, *extra, "relative error", "iterations", "simulations"):
        error = rows.get((table, name, f"{case}, eq. 34"))
        both = (relative(error.paper), relative(error.ours)) if error else ("", "")
        body.append([_name(name), *_compared(rows[table, name, case]), *both])
    return Tabular(header, body, f"Table {table}, {OE[table]}, {record}")


def payload_table(rows: Lookup) -> Tabular:
    """Delta M2 of every method, for both payloads."""
    header = (
        "",
        f"{PLUS}: ours, kg",
        "ours vs truth",
        f"{LOADED}: paper, kg",
        "ours, kg",
        "truth, kg",
        "ours vs truth",
    )
    body = []
    for method in FLEXIBLE:
        plus = rows["extra", "Delta M2", f"{PLUS}, {method}"]
        loaded = rows[_table_of("4", method), "Delta M2", f"{LOADED}, {method}"]
        own = [number(loaded.paper), number(loaded.ours), number(loaded.truth), relative(loaded.error)]
        body.append([method, number(plus.ours), relative(plus.error), *own])
    return Tabular(header, body, "Delta M2 by method")


def text_table(rows: Lookup) -> Tabular:
    """Iterations, simulations and times that the text names."""
    body = [
        [f"{row.case}: {_name(row.parameter)}", number(row.paper), number(row.ours)]
        for row in rows.values()
        if row.table == "text"
    ]
    return Tabular(("", "paper", "ours"), body, "iterations and times in the paper's text")


def _compared(row: Row) -> tuple[str, ...]:
    return (number(row.paper), number(row.ours), relative(row.difference), number(row.truth), relative(row.error))


def _pair(row: Row) -> tuple[str, str]:
    return number(row.paper), number(row.ours)
