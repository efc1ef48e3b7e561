"""The paper's numbers, as printed; SI units, so K12 in N/m. They are compared with, never used by a computation.

M. Gautier, A. Jubien, A. Janot, P-Ph. Robet, *Dynamic identification of flexible joint manipulators with an efficient
closed loop output error method based on motor torque output data*, Tables 1-6 and section VI.

An entry is addressed by (table, parameter, case), a case by the record and the column: "without payload, IDIM-LS".
Eq. 34 is given only where the paper gives it: DIDIM books all friction on the motor side, so the sides have no error.
"""

import dataclasses
from collections.abc import Iterator, Mapping

BARE, LOADED = "without payload", "with payload"

UNITS = {
    **dict.fromkeys(("M_tot", "M1", "M2", "M1 + M2", "Delta M2"), "kg"),
    **dict.fromkeys(("Fv_tot", "Fv1", "Fv2", "Fv1 + Fv2"), "N s/m"),
    **dict.fromkeys(("Fc_tot", "Fc1", "Fc2", "Fc1 + Fc2"), "N"),
    **dict.fromkeys(("lam", "iterations", "simulations", "ratio"), "1"),
    "K12": "N/m",
    "f_n": "Hz",
    "relative error": "%",
    "time": "s",
}
"""Unit of a parameter, whatever the table; columns of %std and eq. 34 are in percent."""

type Key = tuple[str, str, str]
"""(table, parameter, case)."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One printed number; None where the paper prints a dash."""

    table: str
    parameter: str
    case: str
    value: float | None

    @property
    def key(self) -> Key:
        """What the entry is compared by."""
        return self.table, self.parameter, self.case


def unit(parameter: str, case: str) -> str:
    """Unit of a row."""
    return "%" if case.endswith(("%std", "eq. 34")) else UNITS[parameter]


_PLANT = ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12")
_SUMS = ("M1 + M2", "Fv1 + Fv2", "Fc1 + Fc2")

_TABLE_1 = {  # start, result, %std; the last row is the relative error
    BARE: {"M_tot": (78, 107, 0.3), "Fv_tot": (0, 216, 1.4), "Fc_tot": (0, 18.2, 1.4), "relative error": 5.06},
    LOADED: {"M_tot": (78, 117, 0.3), "Fv_tot": (0, 220, 1.4), "Fc_tot": (0, 17.6, 1.7), "relative error": 5.47},
}

_TABLE_2 = {  # start, result
    BARE: {"lam": (0.5, 0.62), "f_n": (40, 23.85), "relative error": 8.80, "iterations": 16},
    LOADED: {"lam": (0.5, 0.57), "f_n": (40, 20.89), "relative error": 10.8, "iterations": 17},
}

_TABLES_3_4 = {  # IDIM-LS and its %std; DIDIM's start, result and %std
    ("3", BARE): {
        "M1": (68.0, 0.3, 66.3, 65.3, 0.3),
        "Fv1": (104, 1.3, 0, 215, 0.7),
        "Fc1": (10.0, 0.8, 0, 17.6, 0.8),
        "M2": (38.0, 0.7, 40.7, 37.4, 0.5),
        "Fv2": (96.5, 1.4, 0, None, None),
        "Fc2": (9.5, 1.3, 0, None, None),
        "K12": (8.8e5, 0.7, 9.13e5, 8.4e5, 0.5),
    },
    ("4", LOADED): {
        "M1": (69, 0.3, 66.7, 67, 0.4),
        "Fv1": (110, 1.6, 0, 217, 0.8),
        "Fc1": (10.5, 1.3, 0, 17.7, 1.1),
        "M2": (46.5, 0.7, 50.3, 46.2, 0.6),
        "Fv2": (98.2, 1.2, 0, None, None),
        "Fc2": (8.68, 1.5, 0, None, None),
        "K12": (8.6e5, 0.6, 8.67e5, 8.1e5, 0.6),
    },
}

_SUMS_3_4 = {  # IDIM-LS, DIDIM
    ("3", BARE): {
        "M1 + M2": (106, 103),
        "Fv1 + Fv2": (211, 215),
        "Fc1 + Fc2": (19.5, 17.6),
        "relative error": (6.81, 8.33),
    },
    ("4", LOADED): {
        "M1 + M2": (115, 113),
        "Fv1 + Fv2": (208, 217),
        "Fc1 + Fc2": (19.1, 17.7),
        "Delta M2": (8.5, 8.8),
        "relative error": (7.34, 8.52),
    },
}

_TABLES_5_6: dict[tuple[str, str], dict[str, tuple[float, float | None]]] = {  # result, eq. 34 against DIDIM
    ("5", BARE): {
        **{"M1": (64.1, -1.8), "Fv1": (126, None), "Fc1": (13.2, None), "M2": (40.1, 7.2)},
        **{"Fv2": (84.6, None), "Fc2": (5.2, None), "K12": (8.7e5, 3.6), "M1 + M2": (104.2, 1.2)},
        **{"Fv1 + Fv2": (211, -1.9), "Fc1 + Fc2": (18.4, 4.5), "iterations": (179, None)},
    },
    ("5", LOADED): {
        **{"M1": (65.9, -1.6), "Fv1": (117, None), "Fc1": (10.2, None), "M2": (48.3, 4.5)},
        **{"Fv2": (113, None), "Fc2": (8.0, None), "K12": (8.1e5, 0.0), "M1 + M2": (114.2, 1.1)},
        **{"Fv1 + Fv2": (230, 6.0), "Fc1 + Fc2": (18.2, 2.8), "Delta M2": (8.2, -6.8), "iterations": (185, None)},
    },
    ("6", BARE): {
        **{"M1": (67.1, 2.8), "Fv1": (76.5, None), "Fc1": (12.1, None), "M2": (37.8, 1.1)},
        **{"Fv2": (135, None), "Fc2": (6.40, None), "K12": (7.681e5, -8.6), "M1 + M2": (105, 1.9)},
        **{"Fv1 + Fv2": (212, -1.4), "Fc1 + Fc2": (18.5, 5.0), "iterations": (172, None)},
        "relative error": (7.38, None),
    },
    ("6", LOADED): {
        **{"M1": (68.1, 1.6), "Fv1": (128, None), "Fc1": (8.4, None), "M2": (45.7, -1.1)},
        **{"Fv2": (80, None), "Fc2": (10, None), "K12": (8.2e5, 1.2), "M1 + M2": (113.8, 0.7)},
        **{"Fv1 + Fv2": (208, -4.1), "Fc1 + Fc2": (18.4, 4.0), "Delta M2": (7.9, -10.0), "iterations": (188, None)},
        "relative error": (8.21, None),
    },
}

_TEXT = (  # section VI.C, VI.E and the comparison with output error
    Entry("text", "iterations", "step 1", 2),
    Entry("text", "time", "step 1", 4),
    Entry("text", "iterations", "step 3", 3),
    Entry("text", "time", "step 3", 6),
    Entry("text", "time", "three-step DIDIM", 64),
    Entry("text", "iterations", "Nelder-Mead", 172),
    Entry("text", "simulations", "Nelder-Mead", 276),
    Entry("text", "time", "Nelder-Mead", 540),
    Entry("text", "ratio", "Nelder-Mead over DIDIM, time", 9),
)

OE = {"5": "OE position", "6": "OE force"}
"""Column of Table 5 and of Table 6."""


def entries() -> Iterator[Entry]:
    """Every number of Tables 1-6, table by table as printed, then those of the text."""
    for record, rows in _TABLE_1.items():
        yield from _columns("1", record, rows, ("start", "result", "%std"), "result")
    for record, rows in _TABLE_2.items():
        yield from _columns("2", record, rows, ("start", "result"), "result")
    for (table, record), plant in _TABLES_3_4.items():
        yield from _columns(table, record, plant, ("IDIM-LS", "IDIM-LS %std", "DIDIM start", "DIDIM", "DIDIM %std"))
        yield from _columns(table, record, _SUMS_3_4[table, record], ("IDIM-LS", "DIDIM"))
    for (table, record), simplex in _TABLES_5_6.items():
        for name, (value, eq_34) in simplex.items():
            yield Entry(table, name, f"{record}, {OE[table]}", value)
            if eq_34 is not None:
                yield Entry(table, name, f"{record}, {OE[table]}, eq. 34", eq_34)
    yield from _TEXT


def printed(table: str, parameter: str, case: str) -> float:
    """One printed number. KeyError where the paper has none."""
    value = {entry.key: entry.value for entry in entries()}[table, parameter, case]
    if value is None:
        raise KeyError((table, parameter, case))
    return value


def _columns(
    table: str, record: str, rows: Mapping[str, object], columns: tuple[str, ...], single: str = ""
) -> Iterator[Entry]:
    """Rows of several columns; a number that stands alone belongs to the column `single`."""
    for name, values in rows.items():
        if isinstance(values, tuple):
            for column, value in zip(columns, values, strict=True):
                yield Entry(table, name, f"{record}, {column}", value)
        elif isinstance(values, int | float):
            yield Entry(table, name, f"{record}, {single}", values)


@dataclasses.dataclass(frozen=True)
class Sum:
    """A sum that the paper prints beside its terms."""

    where: str
    printed: float
    from_terms: float


def printed_sums() -> tuple[Sum, ...]:
    """The paper's sums recomputed from its own rounded terms, where they differ by more than the rounding."""
    value = {entry.key: entry.value for entry in entries()}
    found = []
    for (table, name, case), total in value.items():
        if name in _SUMS and total is not None and "eq. 34" not in case and not case.endswith("DIDIM"):
            one, two = (value[table, term, case] for term in name.split(" + "))
            if one is not None and two is not None and abs(one + two - total) > 0.01 * total:
                found.append(Sum(f"Table {table}, {case}: {name}", total, one + two))
    return tuple(found)
