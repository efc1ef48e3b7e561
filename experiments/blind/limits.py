"""Detection limits: the size at which each effect is named in 50 % and in 90 % of cases, beside the Cramér-Rao bound.

Flexible machine, motor encoder alone, usual excitation. Every trial is another machine, another noise and another
motion, with the effect at the size that the staircase asks for. Named is what the judge of the sealed cases accepts:
verdict `effect` or `ambiguous` with nothing else in it, a listed twin allowed where the two are said to be one group;
`own_name` counts those named by the effect's own name. Laws of an effect are pooled.
The verdict is reached before the check record is opened and does not depend on it: that record is left out here.

At another noise level the limit is scaled by the noise, as the bound scales; a few trials there say whether it holds.

`limits/EFFECT.jsonl` has a line a trial; stopped, it goes on with the next. `limits.json` holds of each effect its
parameter, unit, the value at typical size, the bound (`crlb`), `p50` and `p90` with 95 % intervals in that unit, the
same in typical sizes, and the trials. A limit is null where it lies above all sizes that can be asked, or nowhere; it
is `below` where it lies under all that were asked. The bound is the median over the trials of the diagnosis's own
standard deviation, from the exact Jacobian of its own law, which is not the law of the truth, and the spectrum of what
the refit leaves: an estimate of that bound. There is none of what is read off the record, where no noise is between,
nor where the law of the truth counts its size otherwise. Where the laws of an effect differ in their typical size or
its unit, limits are in typical sizes alone, and `typical_of_law` says what those are.
"""

import dataclasses
import json
import secrets
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from didim_jax.errors import InputError
from didim_jax.files import atomic_write
from didim_jax.gap.readings import CONTROLLER
from didim_jax.report import prepare_folder

from ..study import commit as commit_of_project
from ..study import write_json
from .intervals import rate
from .judge import blank_row, judge
from .layout import read_json
from .main_parameter import MAIN, proportional, true_size
from .plan import ALIAS
from .staircase import LARGEST, LEVELS, Trial, next_size, threshold

LIMITS = "limits.json"

TRIALS = 24

SPOT = ("offset", "stribeck", "amplifier_dead_zone", "lead_friction")
"""Effects whose limits are checked at other noise levels, one of each kind."""

SPOT_TRIALS = 4
"""Trials of a spot check at each of the two scaled limits."""

_TRIES = 5
_BELOW = 0.7  # of a size that no motion bears: the largest to ask from then on

UNBOUNDED = (*CONTROLLER, "gain_nonlinearity")
"""Read off the control law, which leaves rounding; or of another law, in which k is something else."""

MOST: Mapping[str, float] = {"saturation": 10 / 3, "presliding": 4.0, "friction_drift": 3.0, "cubic_stiffness": 4.0}
"""Typical sizes beyond which there is no more of it: no friction is left to bend, no peak to cut off."""

_ALIKE = 1.25  # times: laws whose typical values differ by no more have limits in one unit


@dataclasses.dataclass(frozen=True)
class Asked:
    """One trial to make."""

    effect: str
    size: float
    noise: str
    seed: int


type Attempt = Callable[[Asked], dict[str, Any]]
"""A trial, made and diagnosed: at least `named`; or `refused`, where no motion bears the size."""


def attempt(asked: Asked) -> dict[str, Any]:
    """Make the case, diagnose its fit record, judge it. A diagnosis that fails is one that names nothing."""
    from didim_jax.effects.catalogue import CATALOGUE
    from didim_jax.gap.cases import Case, diagnose_case
    from didim_jax.report.diagnosis_document import diagnosis_document

    from . import truth

    began = time.monotonic()
    for seed in (asked.seed, *np.random.default_rng(asked.seed).integers(2**63, size=_TRIES - 1).tolist()):
        wish = truth.Wish((asked.effect,), asked.size, 0.0, noise=asked.noise, seed=seed)
        try:
            made = truth.make(wish)
            break
        except ValueError as error:  # of some machines no motion is within the drive's range: another one, then
            said = str(error)
    else:
        return {"refused": True, "note": said}
    answer = made.answer
    value, unit, scale = measured(asked.effect, answer)
    row = {"named": False, "law": answer["law"][asked.effect], "value": value, "unit": unit, "std": None}
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            truth.write(made, folder, "trial")
            case = Case("trial", (folder / "fit.mat",), None, folder / "machine.toml")
            found = diagnosis_document(diagnose_case(case, CATALOGUE, folder))
        judged = judge(blank_row("trial", {"stratum": "limit", "answer": answer}), found)
        std = bound(asked.effect, found)
        row |= {
            "named": judged.accepted,
            "verdict": judged.verdict,
            "found": list(judged.found),
            "std": None if std is None else std * scale,
        }
    except Exception as error:  # whatever goes wrong with one diagnosis
        row["note"] = " ".join(f"{type(error).__name__}: {error}".split())[-160:]
    return row | {"case_seed": seed, "seconds": round(time.monotonic() - began, 2)}


def measured(effect: str, answer: Mapping[str, Any]) -> tuple[float | None, str, float]:
    """The effect's own size in an answer, its unit, and what a standard deviation of the diagnosis is times in it.

    None where this law has no such parameter. A limit of the drive counts as the share of the nominal peak that it cuts
    off; the frame of a base, whose effect is the larger the lighter it is, by the inverse of its mass.
    """
    true, (_, unit) = true_size(effect, answer), proportional(effect)
    if true is None:
        return None, unit, 1.0
    value = abs(true)
    if effect == "base_flexibility":
        return 1 / value, unit, 1.0
    if effect == "saturation":
        from .truth.sizes import TYPICAL

        share = TYPICAL["saturation"] * realised(effect, answer["sizes"][effect])
        return share, unit, (1 - share) / value
    return value, unit, 1.0


def bound(effect: str, found: Mapping[str, Any]) -> float | None:
    """Standard deviation of the effect's own size in a diagnosis that refitted it, named or not; else None."""
    refitted = {c["effect"]: c["parameters"] for c in found.get("candidates", [])}
    estimates = found["parameters"].get(effect) or refitted.get(effect) or {}
    stds = [estimates[name]["std"] for name in MAIN[effect].of if name in estimates]
    if len(stds) < max(len(MAIN[effect].of), 1) or not all(std and np.isfinite(std) for std in stds):
        return None
    if any(estimates[name].get("bound") for name in MAIN[effect].of):  # it goes no further: no spread of an estimate
        return None
    return float(np.sqrt(np.mean(np.square(stds))))


def limits(
    study: Path,
    effects: Sequence[str] = (),
    trials: int = TRIALS,
    spot_trials: int = SPOT_TRIALS,
    *,
    one: Attempt = attempt,
    threads: int = 1,
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Measure the limits of the effects (all when empty), effects side by side; write and return limits.json.

    Effects measured before stay in it. Raises InputError: an effect that is unknown or has no limit.
    """
    for name in effects:
        if name not in MAIN:
            why = "absorbed by the base parameters at any size" if name == ALIAS else "not among the effects"
            raise InputError(f"{name}: {why}; there are limits of {', '.join(MAIN)}.")
    if trials < 1 or spot_trials < 0:
        raise InputError(f"--trials {trials} --spot-trials {spot_trials}: at least 1, and at least 0.")
    folder = prepare_folder(study / "limits")
    seed = _seed(folder / "seed.json")
    chosen, commit = tuple(effects or MAIN), commit_of_project()

    def staircase(effect: str) -> None:
        path = folder / f"{effect}.jsonl"
        rows = read_rows(path)
        while len(rows) < trials:
            asked_of, largest = usable(effect, rows), _largest(effect, rows)
            size = next_size(asked_of, LEVELS[len(asked_of) % len(LEVELS)], largest)
            asked = Asked(effect, size, "usual", _draw(seed, effect, "usual", len(rows)))
            rows.append(_entered(path, asked, commit, one(asked)))
            say(f"{effect} {len(rows)}/{trials}: size {size:.3g} {_outcome(rows[-1])}")
        write_json(study / LIMITS, summary(study))

    def spot(where: tuple[str, str]) -> None:
        effect, noise = where
        path = _spot_path(study, effect, noise)
        rows = read_rows(path)
        for k, (level, size) in enumerate(_spot_plan(study, effect, noise, spot_trials)[len(rows) :], len(rows)):
            asked = Asked(effect, size, noise, _draw(seed, effect, noise, k))
            rows.append(_entered(path, asked, commit, {"level": level, **one(asked)}))
            say(f"{effect} at {noise} noise {k + 1}: size {size:.3g} {_outcome(rows[-1])}")

    side_by_side(staircase, chosen, threads)
    if spot_trials:
        prepare_folder(folder / "spot")
        side_by_side(spot, [(e, noise) for e in SPOT if e in chosen for noise in _ratios()], threads)
    document = summary(study)
    write_json(study / LIMITS, document)
    return document


def side_by_side[A](work: Callable[[A], None], items: Sequence[A], threads: int) -> None:
    """Work on the items, a thread each. The first error stops what is not begun, and is raised."""
    with ThreadPoolExecutor(threads) as pool:
        running = [pool.submit(work, item) for item in items]
        try:
            for future in running:
                future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def summary(study: Path) -> dict[str, Any]:
    """All that was measured so far, as limits.json holds it."""
    effects, commits = {}, set()
    for name in MAIN:
        rows = read_rows(study / "limits" / f"{name}.jsonl")
        commits |= {row.get("commit") for row in rows}
        if usable(name, rows):
            effects[name] = _limit(name, rows)
    checks = [
        _spot_check(effects[name], name, noise, read_rows(_spot_path(study, name, noise)))
        for name in SPOT
        if name in effects
        for noise in _ratios()
    ]
    return {
        "schema": 1,
        "commits": sorted(commits, key=str),
        "effects": effects,
        "noise": "usual",
        "excitation": "usual",
        "model": "flexible",
        "load_encoder": False,
        "spot_checks": [check for check in checks if check],
    }


def _limit(name: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    trials, largest = usable(name, rows), _largest(name, rows)
    at = {f"p{100 * level:.0f}": threshold(trials, level, largest) for level in LEVELS}
    values = typical_values(rows)
    laws = sorted({row["law"] for row in rows if "law" in row})
    alike = bool(values) and set(values) == set(laws) and max(values.values()) <= _ALIKE * min(values.values())
    typical = float(np.median([*values.values()])) if alike else 1.0
    parameter, unit = proportional(name) if alike else ("size", "typical sizes")
    least = None if name in UNBOUNDED else _bound(rows)

    def shown(factor: float) -> dict[str, Any]:
        return {
            **{key: _times(one.value, factor) for key, one in at.items()},
            **{f"{key}_interval": [_times(one.low, factor), _times(one.high, factor)] for key, one in at.items()},
            "trials": [[size * factor, named] for size, named in trials],
        }

    return {
        "parameter": parameter,
        "unit": unit,
        "typical": typical,
        "typical_of_law": values,
        "crlb": _times(least, typical),
        **shown(typical),
        "below": {key: one.below for key, one in at.items()},
        "n": len(trials),
        "own_name": sum(bool(row.get("named")) and name in row["found"] for row in rows),
        "laws": laws,
        "in_typical_sizes": {"crlb": least, **shown(1.0)},
    }


def typical_values(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Law to the main parameter at typical size, of the laws that have it; each trial has a factor of its own."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row.get("value"):
            found.setdefault(row["law"], []).append(row["value"] / row["size"])
    return {law: float(np.median(values)) for law, values in sorted(found.items())}


def _bound(rows: Sequence[Mapping[str, Any]]) -> float | None:
    """In typical sizes: of the trials that named the effect, if any; else of those that refitted it."""
    usable = [row for row in rows if row.get("std") and row.get("value")]
    usable = [row for row in usable if row["named"]] or usable
    return float(np.median([row["std"] * row["size"] / row["value"] for row in usable])) if usable else None


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


# -- other noise levels --------------------------------------------------------------------------------------------


def _ratios() -> dict[str, float]:
    """Noise level to its rms over that of the usual level."""
    from .truth.noise import LEVELS as NOISE

    return {name: rms / NOISE["usual"] for name, rms in NOISE.items() if name != "usual"}


def _spot_path(study: Path, effect: str, noise: str) -> Path:
    return study / "limits" / "spot" / f"{effect}-{noise}.jsonl"


def _scaled(effect: str, rows: Sequence[Mapping[str, Any]], noise: str) -> list[float | None]:
    """The limits at a noise level, in typical sizes, scaled as the bound is."""
    ratio, trials, largest = _ratios()[noise], usable(effect, rows), _largest(effect, rows)
    return [_times(threshold(trials, level, largest).value, ratio) for level in LEVELS]


def _spot_plan(study: Path, effect: str, noise: str, each: int) -> list[tuple[float, float]]:
    """Level and size, by turns at the scaled limits; those that cannot be asked are left out."""
    rows = read_rows(study / "limits" / f"{effect}.jsonl")
    pairs = zip(LEVELS, _scaled(effect, rows, noise), strict=True)
    return [(level, size) for level, size in pairs if size is not None and size <= LARGEST] * each


def _spot_check(
    usually: Mapping[str, Any], effect: str, noise: str, rows: Sequence[Mapping[str, Any]]
) -> dict[str, Any] | None:
    """What was foreseen at another noise level, and what was seen."""
    if not usable(effect, rows):
        return None
    ratio = _ratios()[noise]
    seen = {level: rate([row["named"] for row in rows if row["level"] == level and "named" in row]) for level in LEVELS}
    usual, here = usually["in_typical_sizes"]["crlb"], _bound(rows)
    return {
        "effect": effect,
        "noise": noise,
        "scale": ratio,
        "bound_ratio": here / usual if here and usual else None,
        "p50": _times(usually["p50"], ratio),
        "p90": _times(usually["p90"], ratio),
        "unit": usually["unit"],
        "seen": [{"foreseen": level, **one.as_json()} for level, one in seen.items()],
    }


# -- trials in files -----------------------------------------------------------------------------------------------


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The trials of a file; none where there is none. A last line that was cut short is not there."""
    rows = []
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    for number, line in enumerate(lines, 1):
        try:
            rows.append(json.loads(line))
        except ValueError:
            if number < len(lines):
                raise InputError(f"{path}, line {number}: is no trial; it was changed.") from None
    return rows


def usable(effect: str, rows: Sequence[Mapping[str, Any]]) -> list[Trial]:
    """What the staircase counts: trials that could be made, each at the size that it had."""
    sizes = [(realised(effect, row["size"]), row["named"]) for row in rows if "named" in row]
    return [(size, named) for size, named in sizes if size > 0]


def realised(effect: str, size: float) -> float:
    """The size that the truth can have, in typical sizes: no more than all there is, a grid of whole counts.

    0 where nothing is left of the effect: a grid of one count is the encoder as it is documented.
    """
    if effect == "encoder_quantisation":
        from .truth.machine import RESOLUTION
        from .truth.sizes import TYPICAL

        counts = round(size * TYPICAL[effect] / RESOLUTION)
        return counts * RESOLUTION / TYPICAL[effect] if counts > 1 else 0.0
    return min(size, MOST.get(effect, size))


def _largest(effect: str, rows: Sequence[Mapping[str, Any]]) -> float:
    return min([MOST.get(effect, LARGEST), *(_BELOW * row["size"] for row in rows if row.get("refused"))])


def _entered(path: Path, asked: Asked, commit: str | None, found: Mapping[str, Any]) -> dict[str, Any]:
    """Write the trial behind those that are there, all or nothing."""
    row = {"size": asked.size, "seed": asked.seed, "commit": commit, **found}
    before = read_rows(path)
    with atomic_write(path) as temporary:
        temporary.write_text("".join(f"{json.dumps(one)}\n" for one in (*before, row)), encoding="utf-8")
    return row


def _seed(path: Path) -> int:
    """Of this study's trials: drawn once."""
    if not path.exists():
        write_json(path, {"seed": secrets.randbits(63)})
    return int(read_json(path, "the seed of the limits")["seed"])


def _draw(seed: int, effect: str, noise: str, k: int) -> int:
    """The seed of a trial: the same when it is made again, another one for each."""
    return int(np.random.default_rng([seed, k, *effect.encode(), 0, *noise.encode()]).integers(2**63))


def _outcome(row: Mapping[str, Any]) -> str:
    if row.get("refused"):
        return "cannot be made"
    said = f"{row.get('verdict', 'failed')}: {', '.join(row.get('found', ())) or '-'}"
    return f"{'named' if row['named'] else 'not named'} ({said})"


def print_limits(document: Mapping[str, Any]) -> None:
    """A line an effect."""
    print(f"{'effect':24} {'unit':8} {'bound':>10} {'50 %':>10} {'90 %':>10}   95 % intervals")
    for name, one in document["effects"].items():
        crlb = "-" if one["crlb"] is None else f"{one['crlb']:.3g}"
        values = " ".join(f"{value:>10}" for value in (crlb, _number(one["p50"]), _number(one["p90"])))
        intervals = ", ".join(" - ".join(map(_number, one[f"{key}_interval"])) for key in ("p50", "p90"))
        print(f"{name:24} {one['unit']:8} {values}   {intervals}")
    for check in document["spot_checks"]:
        seen = ", ".join(f"{at['k']} of {at['n']} named for {100 * at['foreseen']:.0f} %" for at in check["seen"])
        print(f"{check['effect']} at {check['noise']} noise, limits scaled by {check['scale']:g}: {seen}")


def _number(value: float | None) -> str:
    return "beyond" if value is None else f"{value:.3g}"
