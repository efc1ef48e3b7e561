"""The project's own diagnosis with one ingredient removed: what each of them is worth on the same cases.

python -m experiments.blind.ablations CASES --out DIR [--only ABLATION ...] [--cases NAME ...]

Ingredients are removed in one of two ways. Where the diagnosis takes the thing as an argument (the records without
their load encoder), it is left out of the argument. Where it does not, a context manager puts another function in the
place of a named one of `didim_jax.gap` for as long as the cases run, and puts the old one back:

| ablation | in place of | what is there instead |
|---|---|---|
| `no_projection` | `search.score` | the same score, nuisances not projected out of signature and residual |
| `no_numerics` | `Searcher.base`, `._starts`, `._sharpened` | friction's sign held, `HELD_SIGN` wide, a tanh |
| `no_start` | `Searcher.base` | initial state held at what the first samples say |
| `no_whitening` | `Prepared.whitening`, `Searcher.weigh_by_noise`, `.log_likelihood` | white noise of the same rms |
| `force_only` | `diagnose.read_off`, `diagnose.CONTROLLER` | nothing read; the controller's effects are searched |
| `didim_jacobian` | `diagnose.prepare` | its model's columns are DIDIM's, of the force along a motion held fixed |
| `fit_only` | `hunt._gains_elsewhere`, `._certain` | no gain asked on blocks left out; the other rules remain |

Without the other channels nothing can name a coarser encoder grid. Without whitening, what decides on `unexplained` is
still told under each residual's own noise. All thresholds are those of the complete diagnosis.

The replacement holds for the whole process: one ablation at a time, cases side by side within it. Of a case only
fit.mat and machine.toml are read. DIR/ablations.json holds verdict, effects, groups of twins, ranking, seconds and
commit by ablation and case; killed, it goes on where it was.
"""

import argparse
import contextlib
import dataclasses
import json
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import scipy.signal

from didim_jax.cli import program
from didim_jax.devices import cores
from didim_jax.effects import SAMPLED
from didim_jax.effects.catalogue import CATALOGUE
from didim_jax.errors import InputError
from didim_jax.formats import load_recording
from didim_jax.gap import diagnose as diagnosing
from didim_jax.gap import hunt, search
from didim_jax.gap.cases import Case, cases_in
from didim_jax.gap.fit import Fit, Problem
from didim_jax.gap.noise import Whitening
from didim_jax.gap.prepared import Channel, Prepared, prepare
from didim_jax.gap.readings import Readings
from didim_jax.gap.rounded import SHAPE
from didim_jax.gap.score import Each, Score, in_turn, score
from didim_jax.gap.search import Searcher
from didim_jax.machine import Machine
from didim_jax.recording import Recording
from didim_jax.rig import excitation
from experiments.processes import calls
from experiments.study import commit, write_json

from .baselines.inverse import held, second_difference


@dataclasses.dataclass(frozen=True)
class Ingredients:
    """What the diagnosis has; a complete one has everything."""

    projection: bool = True
    numerics: bool = True
    start: bool = True
    whitening: bool = True
    other_channels: bool = True
    exact_jacobian: bool = True
    second_criterion: bool = True


ABLATIONS: Mapping[str, Ingredients] = {
    "complete": Ingredients(),
    "no_projection": Ingredients(projection=False),
    "no_numerics": Ingredients(numerics=False),
    "no_start": Ingredients(start=False),
    "no_whitening": Ingredients(whitening=False),
    "force_only": Ingredients(other_channels=False),
    "didim_jacobian": Ingredients(exact_jacobian=False),
    "fit_only": Ingredients(second_criterion=False),
}


@contextlib.contextmanager
def only(ingredients: Ingredients) -> Iterator[None]:
    """Diagnose with these ingredients; everything is put back at the end, also after an exception."""
    changes: list[tuple[Any, str, Any]] = []
    if not ingredients.projection:
        changes.append((search, "score", unprojected))
    if not ingredients.numerics:
        changes += [(Searcher, "base", property(fitting_but(SHAPE))), (Searcher, "_sharpened", as_it_is)]
        changes.append((Searcher, "_starts", with_held_sign))
    if not ingredients.start:
        changes.append((Searcher, "base", property(fitting_but(("start",)))))
    if not ingredients.whitening:
        changes += [(Prepared, "whitening", white), (Searcher, "log_likelihood", white_likelihood)]
        changes.append((Searcher, "weigh_by_noise", Searcher.weigh))
    if not ingredients.other_channels:
        changes += [(diagnosing, "read_off", nothing_read), (diagnosing, "CONTROLLER", ())]
    if not ingredients.exact_jacobian:
        changes.append((diagnosing, "prepare", prepare_didim))
    if not ingredients.second_criterion:
        changes += [(hunt, "_gains_elsewhere", gains_anywhere), (hunt, "_certain", gains_anywhere)]
    with contextlib.ExitStack() as stack:
        for owner, name, value in changes:
            stack.callback(setattr, owner, name, vars(owner)[name])
            setattr(owner, name, value)
        yield


def unprojected(problem: Problem, fit: Fit, effects: Sequence[Any], each: Each = in_turn) -> list[Score]:
    """The package's score with no nuisance to project out."""
    return score(problem, dataclasses.replace(fit, jacobian=fit.jacobian[:, :0]), effects, each)


HELD_SIGN = 1e-6
"""Speed (m/s) over which friction's sign rises where it is held: the least there is, a drive that sticks at rest."""

_base, _starts = vars(Searcher)["base"].fget, vars(Searcher)["_starts"]


def fitting_but(held: Collection[str]) -> Callable[[Searcher], list[int]]:
    """Places of what every fit moves, less the entries of these names or owners."""

    def places(searcher: Searcher) -> list[int]:
        model = searcher.model
        return [i for i in _base(searcher) if not {model.names[i], model.entries[i].owner} & {*held}]

    return places


def with_held_sign(searcher: Searcher) -> list[np.ndarray]:
    """Where the nominal fit begins, with the width that stays."""
    return [searcher.model.encode(x, {"v_eps": HELD_SIGN}) for x in _starts(searcher)]


def as_it_is(searcher: Searcher, fit: Fit) -> Fit:
    """No other smoothing speed tried."""
    return fit


def white(prepared: Prepared, channel: Channel, residual: np.ndarray) -> Whitening:
    """White noise of the residual's rms: no slow drift."""
    return Whitening.flat(len(residual), max(float(np.sqrt(np.mean(residual**2))), 1e-4 * channel.rms))


def white_likelihood(searcher: Searcher, fit: Fit) -> float:
    """Log-likelihood of what a fit leaves, were it white."""
    return sum(
        -0.5 * len(r) * float(np.log(max(np.mean(r**2), (1e-4 * c.rms) ** 2)))
        for p, row in zip(searcher.records, fit.residuals, strict=True)
        for c, r in zip(p.channels, row, strict=True)
    )


def nothing_read(recordings: Sequence[Recording], machine: Machine, exclude: Collection[str]) -> Readings:
    """Control law and encoder not looked at."""
    return Readings({}, {}, 0.0, tuple(() for _ in recordings), 0.0, ())


def gains_anywhere(*arguments: Any) -> bool:
    """The gain on interleaved blocks not asked for, nor what is asked for in its place of what acts once."""
    return True


def prepare_didim(*arguments: Any, **named: Any) -> Prepared:
    """The package's `prepare`, its model with DIDIM's columns."""
    p = prepare(*arguments, **named)
    exact = p.model.columns

    def columns(x: np.ndarray, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        value, tangents = exact(x, chosen)
        return value, along_fixed_motion(p, x, chosen, value, tangents)

    p.model.columns = columns  # type: ignore[method-assign]
    return p


def along_fixed_motion(
    p: Prepared, x: np.ndarray, chosen: Sequence[int], value: np.ndarray, tangents: np.ndarray
) -> np.ndarray:
    """DIDIM's columns, (len(chosen), 2, n), from the exact ones: less the force that moves the drive otherwise.

    With the motor's motion held fixed, a parameter changes the force by the inverse model's column. In closed loop the
    motion gives way by dq, which the control law ties to the force, d tau = -g kv (kp dq + (dq[k] - dq[k-2]) / 2 dt).
    To first order the column is therefore d tau - Z dq, Z the inverse dynamics about the simulated motion, the load
    side behind its resonance G, the sign's slope included; the load's motion against the motor's loses (G - 1) dq. The
    slope of the load side's Coulomb friction is in Z, not in G. No second simulation is needed, and effects with
    states are treated like others; what an effect itself adds to Z is left out. Initial state, controller and sensor
    keep the exact derivative: the idea is about the drive.

    References: paper, eq. 17-20.
    """
    law, gain, at, dt = p.machine.controller, p.machine.drive.gain, p.model.decode(x), p.model.dt
    sampled = {"start", *(e.label() for e in p.model.effects if e.block in SAMPLED)}
    told = excitation(p.recording, p.machine)
    qg = np.asarray(told.qg)
    volts = law.kv * law.kp * qg + np.asarray(told.injected) - value[0] / gain
    v = np.gradient(_seen(volts, law.kp, law.kv, dt, qg[0]), dt)
    slope = 1 / (at["v_eps"] * np.cosh(np.clip(v / at["v_eps"], -300, 300)) ** 2)
    moved = np.zeros_like(tangents)
    for row, tangent, place in zip(moved, tangents, chosen, strict=True):
        if p.model.entries[place].owner in sampled or not np.isfinite(tangent).all():
            continue
        dq = _seen(-tangent[0] / gain, law.kp, law.kv, dt)
        dv, da = np.gradient(dq, dt), second_difference(dq, dt)
        if "K12" not in at:
            force = at["M"] * da + (at["Fv"] + at["Fc"] * slope) * dv
        else:
            load = _load_side(at["M2"] * da + (at["Fv2"] + at["Fc2"] * slope) * dv, at, dt)
            force = at["M1"] * da + (at["Fv1"] + at["Fc1"] * slope) * dv + load
            row[1] = _load_side(dq, at, dt) - dq
        row[0] = held(force[::-1])[::-1]  # a held force acts half a sample after its own
    return tangents - moved


def _load_side(x: np.ndarray, at: Mapping[str, float], dt: float) -> np.ndarray:
    """(C p + K12) / (M2 p^2 + (C + Fv2) p + K12) x: what the load side makes of the motor's motion, from rest."""
    K, C = at["K12"], at.get("coupling_damping.C", 0.0)
    b, a = scipy.signal.bilinear([C, K], [at["M2"], C + at["Fv2"], K], 1 / dt)
    return np.asarray(scipy.signal.lfilter(b, a, x))


def _seen(volts: np.ndarray, kp: float, kv: float, dt: float, before: float = 0.0) -> np.ndarray:
    """q (m) with kv (kp q[k] + (q[k] - q[k-2]) / 2 dt) = volts[k]: the position from which the law made them."""
    b, a = [1.0], [kv * (kp + 0.5 / dt), 0.0, -0.5 * kv / dt]
    zi = scipy.signal.lfiltic(b, a, [before, before])
    return np.asarray(scipy.signal.lfilter(b, a, volts, zi=zi)[0])


def diagnose_all(
    cases: Path,
    out: Path,
    *,
    ablations: Collection[str] = tuple(ABLATIONS),
    chosen: Collection[str] = (),
    threads: int = 1,
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, Any]]:
    """Diagnose the `chosen` cases of a folder (all when empty) under every ablation; write `out`/ablations.json.

    What fails leaves its error there in place of a verdict, and is tried again by the next call. Raises InputError: a
    chosen case that is not there.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "ablations.json"
    done: dict[str, dict[str, Any]] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    lock = threading.Lock()
    there = cases_in(cases)
    if missing := sorted(set(chosen) - {case.name for case in there}):
        raise InputError(f"{cases}: no case {missing[0]} in it; nothing was diagnosed.")
    wanted, at = [case for case in there if not chosen or case.name in chosen], commit()
    with calls(threads) as call:
        for name in ablations:
            results = done.setdefault(name, {})

            def one(case: Case, name: str = name, results: dict[str, Any] = results) -> None:
                entry = {**call(_without, case, name), "commit": at}
                with lock:
                    results[case.name] = entry
                    write_json(path, done)
                say(f"{name} {case.name}: {entry.get('verdict', entry.get('error'))} {'+'.join(entry['effects'])}")

            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(one, [case for case in wanted if "error" in results.get(case.name, {"error": ""})]))
    return done


def _without(case: Case, name: str) -> dict[str, Any]:
    """One case under one ablation."""
    with only(ABLATIONS[name]):
        return _diagnosed(case, ABLATIONS[name])


def _diagnosed(case: Case, ingredients: Ingredients) -> dict[str, Any]:
    """One case, its check record left aside."""
    begin = time.perf_counter()
    try:
        machine = Machine.load(case.machine)
        recordings = [load_recording(path, gain=machine.drive.gain) for path in case.fits]
        if not ingredients.other_channels:
            recordings = [dataclasses.replace(r, ql=None) for r in recordings]
        found = diagnosing.diagnose(recordings, machine, CATALOGUE)
    except Exception as error:  # a case without a diagnosis is a wrong answer, and the others go on
        text = f"{type(error).__name__}: {error}"
        return {"effects": [], "ranking": {}, "seconds": time.perf_counter() - begin, "error": text}
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "ambiguous_with": [list(group) for group in found.ambiguous_with],
        "ranking": dict(found.ranking),
        "share": found.share,
        "seconds": time.perf_counter() - begin,
    }


def main(argv: list[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m experiments.blind.ablations", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("cases", type=Path, help="folder with a folder each, with fit.mat and machine.toml")
    parser.add_argument("--out", type=Path, required=True, help="where ablations.json is, or will be")
    parser.add_argument("--only", nargs="+", choices=tuple(ABLATIONS), default=tuple(ABLATIONS), help="these ablations")
    parser.add_argument("--cases", dest="chosen", nargs="+", default=(), metavar="NAME", help="these cases")
    arguments = parser.parse_args(argv)
    with program():
        diagnose_all(
            arguments.cases,
            arguments.out,
            ablations=arguments.only,
            chosen=arguments.chosen,
            threads=cores(),
            say=print,
        )


if __name__ == "__main__":
    main()
