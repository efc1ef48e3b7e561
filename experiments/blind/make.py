"""Cases and their secret answers, made by the truth simulator; stopped, it goes on where it was.

The plan and every answer lie in `answers`, which is not to be published before the seals are opened.
"""

import dataclasses
import functools
import secrets
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from didim_jax.config import build
from didim_jax.errors import InputError
from didim_jax.processes import processes
from didim_jax.report import prepare_folder

from ..study import write_json
from .layout import CASES, PLAN, PUBLIC, SEALS, read_json
from .plan import Config, Planned, draw

_TRIES = 5


def make(study: Path, answers: Path, config: Config) -> None:
    """Make every case of the plan that is not there yet. Raises InputError: sealed already, or begun with another plan.

    A case that the simulator refuses does not stop the others; all of them are named at the end.
    """
    if (study / SEALS).exists():
        raise InputError(f"{study}: is sealed already, no case can be added; make another study.")
    prepare_folder(study / CASES)
    prepare_folder(answers)
    plan = _plan(answers / PLAN, config)
    todo = [planned for planned in plan if not _is_made(study, answers, planned.case)]
    one = functools.partial(make_one, study, answers)
    bar = track(_side_by_side(one, todo, config.workers), "cases", len(todo), console=Console(stderr=True))
    refused = [said for said in bar if said]
    if refused:
        raise InputError(f"{len(refused)} of {len(todo)} cases could not be made: {'; '.join(refused)}.")
    print(f"{study}: {len(plan)} cases, {len(todo)} of them new; the answers in {answers} are secret.")


def config_of(plan: Path, workers: int) -> Config:
    """The config and seed of a plan that was shown: the same cases again. Raises InputError: it is no plan."""
    shown = read_json(plan, "the plan of an opened study")
    if not isinstance(shown, dict) or not isinstance(shown.get("config"), dict) or "seed" not in shown:
        raise InputError(f"{plan}: is no plan of a study: it has no config and seed.")
    return build(Config, {**shown["config"], "seed": shown["seed"], "workers": workers}, str(plan))


def make_one(study: Path, answers: Path, planned: Planned) -> str:
    """Simulate a case and write its files, the answer last: where it is, the rest is. Returns why not, or nothing."""
    from . import truth  # in the process that simulates: compiling it takes a while

    for seed in _seeds(planned.wish["seed"]):
        try:
            made = truth.make(truth.Wish(**planned.wish | {"effects": tuple(planned.wish["effects"]), "seed": seed}))
            break
        except ValueError as error:  # of some machines no motion is within the drive's range: another one, then
            said = str(error)
    else:
        effects = "+".join(planned.wish["effects"])
        return f"{planned.case} ({planned.stratum}, {effects or 'none'}, {planned.wish['model']}): {said}"
    prepare_folder(study / CASES / planned.case)
    truth.write(made, study / CASES / planned.case, planned.case)
    document = {
        "case": planned.case,
        "salt": new_salt(),
        "stratum": planned.stratum,
        **{key: planned.wish[key] for key in ("noise", "load_encoder", "model")},
        "answer": made.answer,
    }
    write_json(answers / f"{planned.case}.json", document)
    return ""


def _seeds(planned: int) -> list[int]:
    """The seed of the plan, and those to try where it gives no machine that can be moved."""
    return [planned, *(int(seed) for seed in np.random.default_rng(planned).integers(2**63, size=_TRIES - 1))]


def new_salt() -> str:
    """32 random bytes, hexadecimal: without them an answer could be guessed and held against its seal."""
    return secrets.token_hex(32)


def _plan(path: Path, config: Config) -> list[Planned]:
    """The plan of a study that was begun, else a new one, written down before the first case is made."""
    from . import truth

    wanted = {key: value for key, value in dataclasses.asdict(config).items() if key not in ("seed", "workers")}
    if path.exists():
        begun = read_json(path, "the plan of this study")
        if begun["config"] != wanted or config.seed not in (None, begun["seed"]):
            raise InputError(f"{path}: this study was begun with another config; finish it with that one.")
        return [Planned(**planned) for planned in begun["cases"]]
    seed = secrets.randbits(128) if config.seed is None else config.seed
    plan = draw(config, seed, truth.EFFECTS, truth.OUTSIDE)
    write_json(path, {"seed": seed, "config": wanted, "cases": plan})
    return plan


def _is_made(study: Path, answers: Path, case: str) -> bool:
    files = [study / CASES / case / name for name in PUBLIC]
    return all(path.is_file() for path in (*files, answers / f"{case}.json"))


def _side_by_side(one: Callable[[Planned], str], todo: Iterable[Planned], workers: int) -> Iterator[str]:
    """Results in order; in processes of their own, because a simulation in compiled Python holds its interpreter."""
    if workers == 1:
        yield from map(one, todo)
        return
    with processes(workers) as pool:
        yield from pool.map(one, todo)
