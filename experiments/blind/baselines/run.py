"""Every rival on every case of a folder: python -m experiments.blind.baselines.run CASES --out DIR

Of a case fit.mat and machine.toml are read, never the check record. DIR/baselines.json holds, by rival and case, the
effects named, the ranking and the seconds it took, what rivals share counted for each. Killed, it goes on where it was.
"""

import argparse
import json
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from didim_jax.cli import program
from didim_jax.devices import cores
from didim_jax.formats import load_recording
from didim_jax.gap.cases import Case, cases_in
from didim_jax.machine import Machine
from didim_jax.recording import Recording
from experiments.processes import calls
from experiments.study import write_json

from . import correlation, friction_ladder, lasso, score_only, sparse_regression
from .answer import Answer
from .closed_loop import closed_loop
from .inverse import inverse

type Rival = Callable[..., Answer]

REGRESSIONS: Mapping[str, Rival] = {
    "friction_ladder": friction_ladder.answer,
    "sparse_regression": sparse_regression.answer,
    "lasso": lasso.answer,
}
"""On the inverse model; they share its nominal fit."""

SIMULATIONS: Mapping[str, Rival] = {"correlation": correlation.answer, "score_only": score_only.answer}
"""On the closed loop; they share the nominal drive's fit."""

BASELINES = (*REGRESSIONS, *SIMULATIONS)


def answer_all(
    cases: Path,
    out: Path,
    *,
    only: Collection[str] = BASELINES,
    threads: int = 1,
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, Any]]:
    """Answer every case that has no answer yet and write `out`/baselines.json; `threads` cases side by side.

    A rival that fails names nothing, and its error is kept in place of an answer; it is tried again by the next call.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "baselines.json"
    done: dict[str, dict[str, Any]] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    lock = threading.Lock()

    def one(case: Case) -> None:
        wanted = [
            name for name in BASELINES if name in only and "error" in done.get(name, {}).get(case.name, {"error": 0})
        ]
        if not wanted:
            return
        answers = call(_answers, case, wanted)
        with lock:
            for name, entry in answers.items():
                done.setdefault(name, {})[case.name] = entry
            write_json(path, done)
        say(f"{case.name}: " + ", ".join(f"{k} {'+'.join(v['effects']) or 'none'}" for k, v in answers.items()))

    with calls(threads) as call, ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, cases_in(cases)))
    return done


def _answers(case: Case, wanted: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Rival to its entry for one case."""
    out: dict[str, dict[str, Any]] = {}

    def shared(rivals: Mapping[str, Rival], keyword: str, fit: Callable[[Recording, Machine], Any]) -> None:
        chosen = [name for name in wanted if name in rivals]
        begin = time.perf_counter()
        try:
            machine = Machine.load(case.machine)
            recording = load_recording(case.fits[0], gain=machine.drive.gain)
            fitted = fit(recording, machine) if chosen else None
        except Exception as error:  # an unusable case is a wrong answer of every rival, and the others go on
            out.update({name: _failed(error, time.perf_counter() - begin) for name in chosen})
            return
        common = time.perf_counter() - begin
        for name in chosen:
            begin = time.perf_counter()
            try:
                found = rivals[name](recording, machine, **{keyword: fitted})
                entry = {"effects": list(found.effects), "ranking": found.ranking}
                out[name] = {**entry, "seconds": common + time.perf_counter() - begin}
            except Exception as error:
                out[name] = _failed(error, common + time.perf_counter() - begin)

    shared(REGRESSIONS, "fitted", inverse)
    shared(SIMULATIONS, "nominal", closed_loop)
    return out


def _failed(error: Exception, seconds: float) -> dict[str, Any]:
    return {"effects": [], "ranking": {}, "seconds": seconds, "error": f"{type(error).__name__}: {error}"}


def main(argv: list[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m experiments.blind.baselines.run", description=__doc__)
    parser.add_argument("cases", type=Path, help="folder with a folder each, with fit.mat and machine.toml")
    parser.add_argument("--out", type=Path, required=True, help="where baselines.json is, or will be")
    parser.add_argument("--only", nargs="+", choices=BASELINES, default=BASELINES, help="these rivals")
    arguments = parser.parse_args(argv)
    with program():
        answer_all(arguments.cases, arguments.out, only=arguments.only, threads=cores(), say=print)


if __name__ == "__main__":
    main()
