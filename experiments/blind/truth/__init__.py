"""An independent truth: cases of a drive with an effect that is withheld, so that a diagnosis can be tested blind.

Its laws, friction and integration are its own: set-valued Coulomb friction with real sticking, stepped through a
compiled loop. It imports nothing of the package that is tested.

Layout, imports point down: slots (numbers of the kernel) < friction, coupling, drive, sensor, environment (compiled
laws) < kernel (the loop) < machine, references, noise < sizes, law, laws_* (what is drawn) < catalogue, record < here.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io

from .catalogue import FLEXIBLE_ONLY, LAWS, OUTSIDE_LAWS, draw_effects, refuse
from .law import Draw
from .machine import DT, draw_machine
from .noise import LEVELS, Noise
from .record import CLIPPED_VOLTS, VOLTS, draw_plan, floor, simulate, variables, within
from .references import EXCITATIONS
from .slots import changed

__all__ = ["EFFECTS", "FLEXIBLE_ONLY", "OUTSIDE", "Made", "Wish", "make", "write"]

EFFECTS: tuple[str, ...] = tuple(LAWS)
"""Names of the contract that can be made."""

OUTSIDE: tuple[str, ...] = tuple(OUTSIDE_LAWS)
"""Effects of no catalogue, names in x_."""

RECORDS = ("fit", "check")
NOMINAL_VOLTS = 6.5  # V, peak of the nominal runs
VIGOURS = tuple(0.95**k for k in range(30))


@dataclass(frozen=True)
class Wish:
    """What a case is to be. `size` counts in typical sizes; `spread` 0 for staircases."""

    effects: tuple[str, ...] = ()
    size: float = 1.0
    spread: float = 0.25
    model: str = "flexible"
    load_encoder: bool = False
    noise: str = "usual"
    excitation: str = "usual"
    numerics: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        for name, among in (
            ("model", ("flexible", "rigid")),
            ("noise", tuple(LEVELS)),
            ("excitation", EXCITATIONS),
        ):
            if getattr(self, name) not in among:
                raise ValueError(f"{name} = {getattr(self, name)!r}: one of {', '.join(among)}.")
        if not self.size >= 0 or not 0 <= self.spread < 1:
            raise ValueError(f"size = {self.size}, spread = {self.spread}: size >= 0 and 0 <= spread < 1.")
        refuse(self.effects, self.model)


@dataclass(frozen=True)
class Made:
    """A case: variables of both records, the text of machine.toml, and the answer, which is not for the diagnosis."""

    fit: dict[str, np.ndarray]
    check: dict[str, np.ndarray]
    machine: str
    answer: dict[str, Any]


def make(wish: Wish) -> Made:
    """The case of a wish; the same wish gives the same case. Raises ValueError if no stable motion shows it."""
    machine = draw_machine(_rng(wish, 1), wish.model)
    noise = Noise(_rng(wish, 2), wish.noise, DT)
    nominal = changed(machine.slots(), **(_numerics(_rng(wish, 3)) if wish.numerics else {}))
    vir_type = np.float32 if _rng(wish, 4).random() < 0.5 else np.float64
    volts = CLIPPED_VOLTS if "saturation" in wish.effects else VOLTS

    peak = slope = 0.0
    for vigour in VIGOURS:
        plans = {name: draw_plan(_rng(wish, 5, k), machine, wish.excitation, vigour) for k, name in enumerate(RECORDS)}
        plain = {name: simulate(nominal, plans[name], [], None, _rng(wish, 6)) for name in RECORDS}
        if not all(run.sound(NOMINAL_VOLTS) for run in plain.values()):
            continue
        if not peak:  # limits that are shares of these keep when a motion has to be softened further
            peak = min(float(np.abs(run.u).max()) for run in plain.values())
            slope = min(float(np.abs(np.diff(run.u)).max()) / DT for run in plain.values())
        draw = Draw(_rng(wish, 7), machine, wish.size, peak, slope)
        effects, factors = draw_effects(wish.seed, draw, wish.effects, wish.size, wish.spread)
        p = changed(nominal, **{name: value for drawn in effects for name, value in drawn.slots.items()})
        noisy, quiet = (
            {name: simulate(p, plans[name], effects, some, _rng(wish, 8, k)) for k, name in enumerate(RECORDS)}
            for some in (noise, None)
        )
        if all(run.sound(volts) for run in (*noisy.values(), *quiet.values())):
            break
    else:
        wished = "+".join(wish.effects) or "none"
        raise ValueError(f"{wished} at size {wish.size:g}, seed {wish.seed}: no motion stays within the drive's range.")

    answer = {
        "effects": list(wish.effects),
        "size": wish.size,
        "sizes": factors,
        "law": {name: drawn.law for name, drawn in zip(wish.effects, effects, strict=True)},
        "block": {name: drawn.block for name, drawn in zip(wish.effects, effects, strict=True)},
        "parameters": {
            name: {key: {"value": float(value), "unit": unit} for key, (value, unit) in drawn.parameters.items()}
            for name, drawn in zip(wish.effects, effects, strict=True)
        },
        "intervals_s": {
            name: {record: within(drawn.intervals, plans[record]) for record in RECORDS}
            for name, drawn in zip(wish.effects, effects, strict=True)
            if drawn.intervals
        },
        "floor": {name: floor(noisy[name], quiet[name], plans[name].start) for name in RECORDS},
        "load_encoder": wish.load_encoder,
        "start_s": {name: round(plans[name].start * DT, 6) for name in RECORDS},
        "true": machine.base,
        "noise": wish.noise,
        "noise_rms": noise.describe(),
        "excitation": wish.excitation,
        "numerics": wish.numerics,
        "model": wish.model,
        "seed": wish.seed,
    }
    fit, check = (variables(noisy[name], plans[name], machine, wish.load_encoder, vir_type) for name in RECORDS)
    return Made(fit, check, machine.toml("case", wish.load_encoder), answer)


def write(made: Made, folder: Path, name: str) -> None:
    """fit.mat, check.mat and machine.toml in `folder`; the machine is called `name`."""
    folder.mkdir(parents=True, exist_ok=True)
    for record in RECORDS:
        path = folder / f"{record}.mat"
        io.savemat(path, getattr(made, record), oned_as="column")
        with path.open("r+b") as file:  # the date in it would tell when, and keep a case made again from being the same
            file.write(b"MATLAB 5.0 MAT-file".ljust(116))
    text = made.machine.replace('name = "case"', f'name = "{name}"', 1)
    (folder / "machine.toml").write_text(text, encoding="utf-8")


def _rng(wish: Wish, *stream: int) -> np.random.Generator:
    """One stream for each purpose: an effect more, or another noise level, leaves the machine as it is."""
    return np.random.default_rng([wish.seed, *stream])


def _numerics(rng: np.random.Generator) -> dict[str, float]:
    """Another smoothing of Coulomb friction, another step, and timing that is off by less than a fiftieth sample."""
    return {
        "smooth_law": float(rng.integers(1, 3)),
        "smooth_v": float(np.exp(rng.uniform(np.log(0.1e-3), np.log(1.5e-3)))),
        "substeps": float(rng.choice([8, 12, 16, 25])),
        "hold_late": float(rng.uniform(0, 20e-6)),
        "encoder_late": float(rng.uniform(-20e-6, 20e-6)),
    }
