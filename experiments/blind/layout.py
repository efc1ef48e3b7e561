"""What lies where in the folder of a blind study, and the hashes that everything is held by."""

import hashlib
import json
from pathlib import Path
from typing import Any

from didim_jax.errors import InputError

CASES = "cases"
ANSWERS = "answers"
DIAGNOSES = "diagnoses"

SEALS = "seals.json"
PLAN = "plan.json"
LEDGER = "ledger.jsonl"
RESULTS = "results.json"
BASELINES = "baselines.json"
OPENED = "opened.json"
SCORE = "blind.json"

PUBLIC = ("fit.mat", "check.mat", "machine.toml")
"""The files of a case, as `didim diagnose --cases` reads them."""


def case_names(study: Path) -> list[str]:
    """The folders below `cases`, by name. Raises InputError: none."""
    folder = study / CASES
    names = sorted(path.name for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []
    if not names:
        raise InputError(f"{folder}: holds no case: a folder each, with {', '.join(PUBLIC)}.")
    return names


def digest(content: bytes) -> str:
    """SHA-256, hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def file_digest(path: Path) -> str | None:
    """SHA-256 of a file; None where there is none."""
    return digest(path.read_bytes()) if path.is_file() else None


def hold(path: Path, expected: str | None, since: str, subject: str = "") -> None:
    """Raises InputError, one line with `since` when, where a file has not the SHA-256 it had (None: it had none)."""
    now = file_digest(path)
    if now != expected:
        what = "is missing" if now is None else "was added" if expected is None else "was changed"
        raise InputError(f"{path}: {subject}{what} {since}.")


def canonical(value: Any) -> bytes:
    """The one way to write a JSON value that is hashed: keys sorted, no spaces, ASCII, no NaN."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode("ascii")


def read_json(path: Path, what: str) -> Any:
    """The value of a JSON file. Raises InputError, one line that says `what` is missing or broken."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file: {what}.") from None
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({' '.join(str(error).split())}): {what}.") from None
