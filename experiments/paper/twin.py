"""The synthetic twin: three drives with the published loop around them, and the records that are identified."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from didim_jax import Machine
from didim_jax.identify import FORCE, Choices, Method, Signal, Trial
from didim_jax.identify.case import Case
from didim_jax.identify.procedure import settle
from didim_jax.params import values
from didim_jax.plant import AbstractPlant, FlexibleDrive, mass_ratio, mode
from didim_jax.plant_file import load_plant
from didim_jax.recording import Recording
from didim_jax.reference import load_reference
from didim_jax.synthesize import synthesize

from ..data import TWIN
from .config import PaperConfig
from .published import BARE, LOADED

PLUS = "+10 kg"
"""The third drive, which the paper does not have: Table 3's with exactly 10 kg on M2."""

_FILES = {BARE: "plant.toml", LOADED: "plant_payload.toml", PLUS: "plant_plus_10kg.toml"}


@dataclasses.dataclass(frozen=True)
class Twin:
    """One drive of known parameters, its record for the fit and one on another trajectory.

    `clean` is the fit's record before noise: the command that the drive obeys. `payload_kg` is what its M2 has more
    than that of the drive without payload.
    """

    name: str
    machine: Machine
    plant: FlexibleDrive
    fit: Recording
    clean: Recording
    check: Recording
    payload_kg: float

    @property
    def truth(self) -> dict[str, float]:
        """All parameters by the paper's names."""
        return named(values(self.plant))

    def case(self, config: PaperConfig, signal: Signal = FORCE) -> Case:
        """The fit's record with the choices of the study; no offset, since the paper has none."""
        choices = Choices(
            "flexible", Method.THREE_STEP, offset=False, at_rest=config.at_rest, cutoff_hz=config.flexible_cutoff_hz
        )
        return Case((self.fit,), self.machine, dataclasses.replace(settle(choices), signal=signal))


def trials_of(case: Case, plant: AbstractPlant, cutoff_hz: float) -> tuple[Trial, ...]:
    """The case's record prepared for a fit, of the same type whether or not the noise took it past the drive's limit.

    Such a record is simulated with the limit, the others without; a weakly typed number there would compile twice.
    """
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=leaf.dtype), case.trials(plant, cutoff_hz))


def named(plant: dict[str, float]) -> dict[str, float]:
    """A flexible drive's parameters, and what follows from them: sums, mass ratio, mode (eq. 6, 23, 24)."""
    sums = {f"{k}1 + {k}2": plant[f"{k}1"] + plant[f"{k}2"] for k in ("M", "Fv", "Fc")}
    totals = {f"{k}_tot": sums[f"{k}1 + {k}2"] for k in ("M", "Fv", "Fc")}
    shape = {"lam": float(mass_ratio(plant["M1"], plant["M2"])), "f_n": float(mode(plant["M2"], plant["K12"]))}
    return {**plant, **sums, **totals, **shape}


def twins(config: PaperConfig) -> dict[str, Twin]:
    """The three drives under trapezoid and chirp, and under the check's trajectory, each with noise of its own."""
    machine = Machine.load(TWIN / "machine.toml")
    dt = machine.controller.sample_time
    reference, other = (load_reference(TWIN / f).sample(dt) for f in ("reference.toml", "reference_check.toml"))
    return {
        name: _twin(name, machine, reference, other, config.force_noise_N, config.seed + 2 * i)
        for i, name in enumerate(_FILES)
    }


def _twin(name: str, machine: Machine, reference: np.ndarray, other: np.ndarray, noise: float, seed: int) -> Twin:
    plant = load_plant(TWIN / _FILES[name])
    assert isinstance(plant, FlexibleDrive)

    def record(qg: np.ndarray, what: str, rms: float, own_seed: int) -> Recording:
        return synthesize(machine, plant, qg, force_noise=rms, seed=own_seed, name=f"twin {name}, {what}")

    fit = record(reference, "trapezoid and chirp", noise, seed)
    clean = record(reference, "without noise", 0.0, seed)
    payload = values(plant)["M2"] - values(load_plant(TWIN / _FILES[BARE]))["M2"]
    return Twin(name, machine, plant, fit, clean, record(other, "check", noise, seed + 1), payload)
