"""The ledger of a study: one line a step, each with the hash of what the step made and of the line before it.

A line of `ledger.jsonl` is {"step", "time", "content", "previous"}: the time in UTC, and the SHA-256 of the step's file
and of the line before. A changed line, a line taken out and a step out of order show. What does not is
a ledger that was written anew from the beginning, or whose last lines are gone together with the files of those steps:
against that the hash of the last line, which every command prints, is to be published at once.
"""

import dataclasses
import datetime
import json
from collections.abc import Sequence
from pathlib import Path

from didim_jax.errors import InputError
from didim_jax.files import atomic_write

from .layout import BASELINES, LEDGER, OPENED, RESULTS, SCORE, SEALS, canonical, digest, file_digest, hold

FILES = {"seal": SEALS, "diagnose": RESULTS, "baselines": BASELINES, "open": OPENED, "score": SCORE}
"""What each step makes."""

_START = "0" * 64


@dataclasses.dataclass(frozen=True)
class Step:
    """One line."""

    step: str
    time: str
    content: str
    previous: str

    @property
    def line(self) -> bytes:
        """As it stands in the file, without its end."""
        return canonical(dataclasses.asdict(self))


def commit(study: Path, step: str) -> str:
    """Enter a step whose file is written; returns the hash of the new line. Nothing, if the last line says the same."""
    steps = read(study)
    content = file_digest(study / FILES[step])
    if content is None:
        raise InputError(f"{study / FILES[step]}: no such file, so {step} cannot be entered.")
    if not (steps and (steps[-1].step, steps[-1].content) == (step, content)):
        require(study, step)
        time = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        steps.append(Step(step, time, content, head(steps)))
        with atomic_write(study / LEDGER) as path:
            path.write_bytes(b"".join(one.line + b"\n" for one in steps))
    return head(steps)


def head(steps: Sequence[Step]) -> str:
    """Hash of the last line: to be published, it holds all of them."""
    return digest(steps[-1].line) if steps else _START


def read(study: Path) -> list[Step]:
    """The lines as they are. Raises InputError: one that is no line of a ledger."""
    path = study / LEDGER
    steps = []
    for number, line in enumerate(path.read_bytes().splitlines() if path.is_file() else [], 1):
        try:
            step = Step(**json.loads(line))
            usable = step.line == line and step.step in FILES
        except (ValueError, TypeError):
            usable = False
        if not usable:
            raise InputError(f"{path}, line {number}: is no line of a ledger; it was changed.")
        steps.append(step)
    return steps


def verify(study: Path, redo: str | None = None) -> list[Step]:
    """The steps, if they are in order, none is missing, and each one's file is as it was entered.

    The file of the step `redo`, about to be written, may be missing, or be there without a line: an interrupted command
    leaves that. Raises InputError, one line: what was tampered with.
    """
    if not study.is_dir():
        raise InputError(f"{study}: no such folder.")
    steps = read(study)
    path = study / LEDGER
    for number, step in enumerate(steps, 1):
        before = steps[: number - 1]
        if step.previous != head(before):
            raise InputError(f"{path}, line {number} ({step.step}): the line before it was changed or taken out.")
        if said := _too_early_or_late([one.step for one in before], step.step):
            raise InputError(f"{path}, line {number} ({step.step}): out of order: {said}.")
    last = {step.step: (number, step) for number, step in enumerate(steps, 1)}
    for name, file in FILES.items():
        now = file_digest(study / file)
        if name in last:
            number, step = last[name]
            if now is not None or name != redo:
                hold(study / file, step.content, f"after line {number} ({name}) of the ledger entered it")
        elif now is not None and name not in (redo, "baselines"):
            raise InputError(
                f"{study / file}: no line of the ledger enters it: {name} was interrupted, or its line taken out."
            )
    return steps


def require(study: Path, step: str) -> None:
    """Raises InputError where `step` may not come now."""
    if said := _too_early_or_late([one.step for one in read(study)], step):
        raise InputError(f"{study}: {step} is out of order: {said}.")


def _too_early_or_late(done: Sequence[str], step: str) -> str | None:
    """Why a step may not follow those done; None where it may."""
    if step == "seal":
        return "the study is sealed already" if done else None
    if "seal" not in done:
        return "nothing is sealed yet"
    if step in ("diagnose", "baselines"):
        return "the seals are open, and what is made after that is not blind" if "open" in done else None
    if step == "open":
        if "diagnose" not in done:
            return "no diagnosis was committed yet"
        return "the seals are open already" if "open" in done else None
    return None if "open" in done else "the seals are not open yet"
