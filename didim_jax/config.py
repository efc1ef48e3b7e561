"""TOML files to frozen pydantic dataclasses: an unknown key, a wrong type or a value out of range is one clear line.

A config class is a pydantic dataclass with `config=CONFIG`; the description of a field begins with its unit,
and that description is what a user reads when the value is wrong::

    @dataclass(frozen=True, config=CONFIG)
    class Drive:
        gain: float = Field(gt=0, description="N/V")        # required, whatever it looks like
        limit: float = Field(10.0, gt=0, description="V")
"""

import dataclasses
import difflib
import json
import os
import tomllib
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pydantic
from pydantic_core import ErrorDetails

from didim_jax.errors import InputError

CONFIG = pydantic.ConfigDict(extra="forbid", allow_inf_nan=False)

_UNKNOWN = ("unexpected_keyword_argument", "extra_forbidden")
_MISSING = ("missing", "missing_argument", "missing_keyword_only_argument")
_TABLE = ("dataclass_type", "dataclass_exact_type", "model_type")


def load_toml[T](path: str | os.PathLike[str], cls: type[T]) -> T:
    """Build `cls`, a frozen pydantic dataclass, from the TOML file at `path`.

    Raises InputError, one line with the file and the dotted key: missing file, TOML syntax, unknown key (with the
    nearest known one), missing key, wrong type, value out of range.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            mapping = tomllib.load(file)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file.") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, a TOML file is expected.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8, so not TOML.") from None
    except (ValueError, RecursionError) as error:  # besides TOMLDecodeError: thousands of digits, or of brackets
        raise InputError(f"{path}: not valid TOML: {error}.") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from None
    return build(cls, mapping, str(path))


def build[T](cls: type[T], mapping: Mapping[str, Any], where: str) -> T:
    """Build `cls` from a mapping; `where` opens the line of the error.

    Raises InputError as `load_toml` does.
    """
    # Through JSON because pydantic is strict there and still takes tables and lists: a gain written "160" is a
    # mistake to name, not a number to guess.
    text = json.dumps(dict(mapping), default=_plain)
    try:
        return pydantic.TypeAdapter(cls).validate_json(text, strict=True, extra="forbid")
    except pydantic.ValidationError as error:
        errors = error.errors(include_url=False, include_context=False)
    # A misspelt key also leaves the right one missing: the unknown key is the cause, so it comes first.
    first = min(errors, key=lambda e: e["type"] not in _UNKNOWN)
    sentence = _sentence(cls, first)
    others = [key for e in errors if (key := f"'{_dotted(e['loc'])}'") not in sentence and e["loc"]]
    more = f" (also wrong or missing: {', '.join(others)})" if others else ""
    raise InputError(f"{where}: {sentence}{'' if sentence.endswith('?') else '.'}{more}")


def _sentence(cls: type, error: ErrorDetails) -> str:
    loc, kind = error["loc"], error["type"]
    key = _dotted(loc)
    if kind in _UNKNOWN:
        return f"unknown key '{key}'{_hint(cls, loc)}"
    about = _description(cls, loc)
    unit = f" [{about}]" if about else ""
    if kind in _MISSING:
        return f"missing key '{key}'{unit}"
    if kind in _TABLE:
        return f"'{key}' must be a table of keys, not {_short(error['input'])}"
    wish = error["msg"].removeprefix("Value error, ").replace("Input should", "must", 1)
    if not wish.startswith("must"):
        wish = f"is wrong: {wish}"
    return f"'{key}' {wish}{unit}, not {_short(error['input'])}" if key else wish.removeprefix("is wrong: ")


def _hint(cls: type, loc: tuple[int | str, ...]) -> str:
    """The nearest known key beside an unknown one, or the same name in another table."""
    leaf = str(loc[-1])
    parent = _class_at(cls, loc[:-1])
    siblings = [f.name for f in dataclasses.fields(parent)] if parent else []
    if near := difflib.get_close_matches(leaf, siblings, n=1):
        return f", did you mean '{_dotted((*loc[:-1], near[0]))}'?"
    if elsewhere := [key for key in _all_keys(cls) if key.rsplit(".", 1)[-1] == leaf]:
        return f", did you mean '{elsewhere[0]}'?"
    return f", known here: {', '.join(siblings)}" if siblings else ""


def _description(cls: type, loc: tuple[int | str, ...]) -> str:
    """Unit and meaning of the field at `loc`: its description, or "unit" in its dataclass metadata."""
    while loc and isinstance(loc[-1], int):
        loc = loc[:-1]
    parent = _class_at(cls, loc[:-1]) if loc else None
    if parent is None:
        return ""
    info = getattr(parent, "__pydantic_fields__", {}).get(loc[-1])
    for field in dataclasses.fields(parent):
        if field.name == loc[-1] and "unit" in field.metadata:
            return str(field.metadata["unit"])
    return (info.description or "") if info is not None else ""


def _class_at(cls: type, loc: tuple[int | str, ...]) -> Any:
    """The dataclass of the table at `loc`, or None; list positions and names of union members do not descend."""
    here: Any = cls
    for part in loc:
        hints = typing.get_type_hints(here)
        if part in hints:
            here = _dataclass_in(hints[part])
            if here is None:
                return None
    return here


def _dataclass_in(hint: Any) -> Any:
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return hint
    return next((found for arg in typing.get_args(hint) if (found := _dataclass_in(arg))), None)


def _all_keys(cls: type, prefix: str = "") -> Iterator[str]:
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):
        yield prefix + field.name
        inner = _dataclass_in(hints[field.name])
        if inner is not None and inner is not cls:
            yield from _all_keys(inner, f"{prefix}{field.name}.")


def _dotted(loc: tuple[int | str, ...]) -> str:
    """('cases', 2, 'kp') -> 'cases[2].kp'."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    return text.removeprefix(".")


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else str(value)  # numpy scalars; dates and paths as text


def _short(value: Any) -> str:
    text = repr(value).replace("\n", " ")
    return text if len(text) <= 60 else text[:57] + "..."
