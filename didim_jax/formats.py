"""Records in files: MATLAB v5 `.mat`, `.csv`, `.npz`. All three hold the variable names of the EMPS benchmark.

| variable | unit | |
| --- | --- | --- |
| `t` `qg` `qm` `vir` | s m m V | required |
| `ql` | m | load position, optional |
| `pulses_N` | as found | known signal added to the control law's output, optional |
| `gtau` `kp` `kv` | N/V, 1/s, V s/m | constants, optional |
| `synthetic` | - | 1 when the record was simulated |

A csv file has one line of names, then optionally one line of units (`s,mm,mm,V`), then numbers; constants stand in
comment lines (`# gtau = 35.15`) or in constant columns.
"""

import csv
import os
import re
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import scipy.io

from didim_jax.errors import InputError
from didim_jax.files import atomic_write
from didim_jax.recording import Recording

type Variables = dict[str, np.ndarray]

# A unit is a divisor: 246.4 mm / 1000 is the metre value correctly rounded, 246.4 * 1e-3 is not.
_TIME = {"s": 1.0, "ms": 1e3}
_POSITION = {"m": 1.0, "mm": 1e3, "um": 1e6, "µm": 1e6, "μm": 1e6}  # micro sign and Greek mu look the same
_VOLTAGE = {"V": 1.0, "mV": 1e3}
_UNITS = {"t": _TIME, "qg": _POSITION, "qm": _POSITION, "ql": _POSITION, "vir": _VOLTAGE}
_SI = {"t": "s", "qg": "m", "qm": "m", "ql": "m", "vir": "V", "pulses_N": ""}
_REQUIRED = ("t", "qg", "qm", "vir")
_OPTIONAL = ("ql", "pulses_N")
_CONSTANTS = ("gtau", "kp", "kv", "synthetic")
_NAMES = (*_REQUIRED, *_OPTIONAL, *_CONSTANTS)


def load_recording(
    path: str | os.PathLike[str], *, gain: float | None = None, columns: Mapping[str, str] | None = None
) -> Recording:
    """Read one record from a `.mat`, `.csv` or `.npz` file.

    `columns` maps names above to the names in the file where they differ, {"qm": "motor position"}.
    `gain` (N/V) is used only where the file has no `gtau`.

    Raises InputError, one line: no such file, unreadable, unknown suffix, channel missing, cell not a number
    (line and column), unknown unit, NaN, channels of different length, no gain.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, a record file is expected.")
    if not path.exists():
        raise InputError(f"{path}: no such file.")
    renamed = {name: name for name in _NAMES} | dict(columns or {})
    if unknown := set(renamed) - set(_NAMES):
        raise InputError(
            f"{path}: columns names no channel {', '.join(sorted(unknown))}; known are {', '.join(_NAMES)}."
        )
    reader = _pick(_READERS, path)
    try:
        variables = reader(path, renamed)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    return _assemble(variables, renamed, path, gain)


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a record to a `.mat`, `.csv` or `.npz` file, whole or not at all; `load_recording` reads it back exactly.

    Raises InputError: unknown suffix, folder missing or not writable.
    """
    path = Path(path)
    writer = _pick(_WRITERS, path)
    channels = {"pulses_N" if name == "injected" else name: v for name, v in recording.channels.items()}
    constants = {"gtau": recording.gain, **recording.documented}
    if recording.synthetic:
        constants["synthetic"] = 1.0
    with atomic_write(path) as temporary:
        writer(temporary, channels, constants)


def _pick[T](table: Mapping[str, T], path: Path) -> T:
    try:
        return table[path.suffix.lower()]
    except KeyError:
        known = " or ".join(table)
        raise InputError(f"{path}: unknown file type {path.suffix!r}; a record is a {known} file.") from None


def _assemble(variables: Variables, renamed: Mapping[str, str], path: Path, gain: float | None) -> Recording:
    present = {name: variables[there] for name, there in renamed.items() if there in variables}
    for name in _REQUIRED:
        if name not in present:
            asked = f"channel {name}" + (f" (as {renamed[name]!r})" if renamed[name] != name else "")
            raise InputError(f"{path}: {asked} is missing; the file holds {', '.join(sorted(variables)) or 'nothing'}.")
    channels = {name: _vector(present[name], name, path) for name in (*_REQUIRED, *_OPTIONAL) if name in present}
    constants = {name: _constant(present[name], name, path) for name in _CONSTANTS if name in present}
    gain = constants.pop("gtau", gain)
    if gain is None:
        raise InputError(
            f"{path}: the drive gain gtau (N/V) is not in the file; "
            "add it there (in csv: a line '# gtau = 35.15') or give the gain beside the file."
        )
    synthetic = bool(constants.pop("synthetic", 0.0))
    return Recording(
        **{("injected" if name == "pulses_N" else name): v for name, v in channels.items()},
        gain=gain,
        name=path.stem,
        source=str(path),
        synthetic=synthetic,
        documented=constants,
    )


def _vector(values: np.ndarray, name: str, path: Path) -> np.ndarray:
    if values.dtype.kind not in "fiub":
        raise InputError(f"{path}: channel {name} does not hold real numbers ({values.dtype}).")
    if values.ndim > 2 or (values.ndim == 2 and 1 not in values.shape):
        raise InputError(f"{path}: channel {name} has the shape {values.shape}, one column is expected.")
    return values.reshape(-1).astype(np.float64)


def _constant(values: np.ndarray, name: str, path: Path) -> float:
    values = _vector(values, name, path)
    if not np.isfinite(values).all():
        raise InputError(f"{path}: {name} is {values[~np.isfinite(values)][0]}, a finite number is expected.")
    if values.size == 0 or np.ptp(values) > 0:
        raise InputError(f"{path}: {name} must be one constant, the file holds {values.size} values of it.")
    return float(values[0])


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


# -- MATLAB ------------------------------------------------------------------------------------------------------


def _read_mat(path: Path, renamed: Mapping[str, str]) -> Variables:
    with path.open("rb") as file:
        head = file.read(128)
    if head.startswith(b"MATLAB 7.3"):
        raise InputError(f"{path}: MATLAB v7.3 file; save it again in MATLAB with save(..., '-v7').")
    try:
        found = scipy.io.loadmat(path, appendmat=False)
    except Exception as error:  # a damaged or foreign binary fails in a dozen ways inside the reader
        raise InputError(f"{path}: not a MATLAB v5 file ({_one_line(error)}).") from error
    return {name: np.asarray(value) for name, value in found.items() if not name.startswith("__")}


def _write_mat(path: Path, channels: Variables, constants: Mapping[str, float]) -> None:
    scipy.io.savemat(path, {**channels, **constants}, appendmat=False, oned_as="column")


# -- npz ---------------------------------------------------------------------------------------------------------


def _read_npz(path: Path, renamed: Mapping[str, str]) -> Variables:
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: not a numpy .npz file; write it with numpy.savez.")
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: np.asarray(archive[name]) for name in archive.files}
    except Exception as error:  # as above
        raise InputError(f"{path}: not a numpy .npz file of plain numbers ({_one_line(error)}).") from error


def _write_npz(path: Path, channels: Variables, constants: Mapping[str, float]) -> None:
    np.savez(path, allow_pickle=False, **channels, **{name: np.float64(v) for name, v in constants.items()})


# -- csv ---------------------------------------------------------------------------------------------------------


def _read_csv(path: Path, renamed: Mapping[str, str]) -> Variables:
    constants, rows = _csv_lines(path, renamed)
    if not rows:
        raise InputError(f"{path}: empty; a line of column names is expected.")
    _, header = rows.pop(0)
    if all(_is_number(cell) for cell in header):
        raise InputError(f"{path}: no line of column names above the numbers; write for example 't,qg,qm,vir'.")
    if len(header) == 1 and re.search(r"[;\t]", header[0]):
        raise InputError(f"{path}: cells must be separated by commas, the first line is {header[0][:60]!r}.")
    if twice := {name for name in header if name and header.count(name) > 1}:
        raise InputError(f"{path}: column {sorted(twice)[0]!r} appears twice.")
    for number, row in rows:
        if len(row) != len(header):
            raise InputError(f"{path}: line {number} has {len(row)} cells, the header has {len(header)}.")
    units = [""] * len(header)
    if rows and not any(_is_number(cell) for cell in rows[0][1]):
        units = rows.pop(0)[1]
    wanted = {there: name for name, there in renamed.items()}
    variables: Variables = {name: np.array([]) for name in header if name}  # all are listed where one is missing
    for index, there in enumerate(header):
        if (name := wanted.get(there)) is not None:
            divisor = _divisor(units[index], name, there, path)
            cells = [(number, row[index]) for number, row in rows]
            variables[there] = np.array([_number(cell, number, there, path) for number, cell in cells]) / divisor
    return variables | constants


def _csv_lines(path: Path, renamed: Mapping[str, str]) -> tuple[Variables, list[tuple[int, list[str]]]]:
    """The constants of the comment lines, and the other lines as (line number in the file, cells)."""
    constants: Variables = {}
    rows: list[tuple[int, list[str]]] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            for row in reader:
                cells = [cell.strip() for cell in row]
                if cells and cells[0].startswith("#"):
                    comment = re.fullmatch(r"#\s*(\w+)\s*=\s*(\S+).*", ",".join(cells))
                    if comment and comment[1] in _CONSTANTS:
                        value = _number(comment[2], reader.line_num, comment[1], path)
                        constants[renamed[comment[1]]] = np.array([value])
                elif len(cells) > 1 or any(cells):
                    rows.append((reader.line_num, cells))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a csv text file in UTF-8 ({error}).") from error
    return constants, rows


def _divisor(unit: str, name: str, there: str, path: Path) -> float:
    unit = unit.strip("[]() ")
    known = _UNITS.get(name)
    if known is None or not unit:  # constants and the injected signal are taken as written; no unit means SI
        return 1.0
    if unit not in known:
        listed = ", ".join(u for u in known if u.isascii())
        raise InputError(f"{path}: unknown unit {unit!r} of column {there!r}; known are {listed}.")
    return known[unit]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(cell: str, line: int, column: str, path: Path) -> float:
    if not _is_number(cell):
        raise InputError(f"{path}: line {line}, column {column!r}: {cell[:40]!r} is not a number.")
    value = float(cell)
    if not np.isfinite(value):
        raise InputError(
            f"{path}: line {line}, column {column!r}: {cell} is not a finite number; cut or repair the record."
        )
    return value


def _write_csv(path: Path, channels: Variables, constants: Mapping[str, float]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {name} = {value!r}\n" for name, value in constants.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(channels)
        writer.writerow(_SI[name] for name in channels)
        writer.writerows(zip(*(values.tolist() for values in channels.values()), strict=True))  # repr: exact


_READERS: dict[str, Callable[[Path, Mapping[str, str]], Variables]] = {
    ".mat": _read_mat,
    ".csv": _read_csv,
    ".npz": _read_npz,
}
_WRITERS: dict[str, Callable[[Path, Variables, Mapping[str, float]], None]] = {
    ".mat": _write_mat,
    ".csv": _write_csv,
    ".npz": _write_npz,
}
