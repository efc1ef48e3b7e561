"""The synthetic twin: its machine, plant, records, and what its reference does when."""

import dataclasses

import numpy as np

from didim_jax import Machine
from didim_jax.identify import Choices, IdentificationResult, Method, Trial, split_rigid, trial
from didim_jax.identify.case import Case
from didim_jax.identify.three_step import global_start, mode_step, rigid_step
from didim_jax.plant import AbstractPlant, CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.plant_file import load_plant
from didim_jax.recording import Recording
from didim_jax.reference import Chirp, Sequence, Together, Trapezoid, load_reference
from didim_jax.rig import sampled_loop
from didim_jax.signals import Decimation, LowPass
from didim_jax.synthesize import synthesize

from ..data import TWIN
from .config import Config

SEVEN = ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12")
FIVE = ("M1", "Fv1", "Fc1", "M2", "K12")
"""The columns of the paper's step 3: friction is one, on the motor side."""

RAW = Decimation(LowPass(np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])), 1)
"""Every sample as it is: filters are applied afterwards, so that one simulation serves every cutoff."""

PHASES = ("acceleration", "cruise", "reversal", "chirp at rest", "chirp on a move")
"""What the reference does: the parts of its trapezoids, and its chirps without and with a slow move under them."""


@dataclasses.dataclass(frozen=True)
class Twin:
    """The machine, its true plant, and two records of the same run: free of noise, and with one draw of it."""

    machine: Machine
    plant: FlexibleDrive
    qg: np.ndarray
    clean: Recording
    noisy: Recording

    @property
    def dt(self) -> float:
        """Sample time, s."""
        return self.machine.controller.sample_time

    @property
    def truth(self) -> np.ndarray:
        """The seven parameters in the order of SEVEN, SI units."""
        p = self.plant
        f1, f2 = p.motor_friction, p.load_friction
        assert isinstance(f1, CoulombViscous) and isinstance(f2, CoulombViscous)
        return np.array([float(x) for x in (p.M1, f1.Fv, f1.Fc, p.M2, f2.Fv, f2.Fc, p.K12)])

    def case(self) -> Case:
        """The noisy record to be identified: known to start at rest, no offset."""
        choices = Choices("flexible", Method.GAUSS_NEWTON, at_rest=True, offset=False)
        return Case((self.noisy,), self.machine, choices)

    def trial(self, plant: AbstractPlant, decimation: Decimation, recording: Recording | None = None) -> Trial:
        """A record (the clean one) under the machine's loop around a plant."""
        loop = sampled_loop(self.machine, plant)
        return trial(recording or self.clean, self.machine, loop, decimation, at_rest=True)


def build_twin(config: Config) -> Twin:
    """Table 3's plant under the trapezoids and chirps of configs/twin/reference.toml."""
    machine, plant = Machine.load(TWIN / "machine.toml"), load_plant(TWIN / "plant.toml")
    assert isinstance(plant, FlexibleDrive)
    qg = load_reference(TWIN / "reference.toml").sample(machine.controller.sample_time)
    clean = synthesize(machine, plant, qg, name="twin")
    noisy = synthesize(machine, plant, qg, force_noise=config.noise, seed=config.seed, name="twin")
    return Twin(machine, plant, qg, clean, noisy)


def drive(theta: np.ndarray) -> FlexibleDrive:
    """The flexible drive with the values of SEVEN."""
    M1, Fv1, Fc1, M2, Fv2, Fc2, K12 = theta
    return FlexibleDrive(M1, CoulombViscous(Fv1, Fc1), M2, CoulombViscous(Fv2, Fc2), K12)


@dataclasses.dataclass(frozen=True)
class Starts:
    """The first two steps of the paper, and where the third may start from.

    `zero`: no friction (eq. 30); `motor`: step 1's friction on the motor side; `half`: half of it on each side.
    """

    step1: IdentificationResult
    step2: IdentificationResult
    zero: FlexibleDrive
    motor: FlexibleDrive
    half: FlexibleDrive


def first_steps(case: Case) -> Starts:
    """Steps 1 and 2 on the noisy record."""
    step1 = rigid_step(case)
    step2 = mode_step(case, step1)
    assert isinstance(step1.plant, RigidDrive)
    lam, f_n = step2.theta
    motor, half = (split_rigid(step1.plant, lam, f_n, share) for share in (1.0, 0.5))
    return Starts(step1, step2, global_start(step1, step2), motor, half)


def phases(dt: float) -> np.ndarray:
    """Index into PHASES for every sample of the twin's reference, -1 where none applies.

    In a trapezoid `reversal` is below a tenth of its speed, `cruise` above 99.9 % of it.
    """
    motion = load_reference(TWIN / "reference.toml").motion
    assert isinstance(motion, Sequence)
    labels = [np.full(1, -1)]
    for part in motion.parts:
        n = len(part.sample(dt)) - 1
        if isinstance(part, Trapezoid):
            v = np.abs(np.gradient(part.sample(dt), dt))[1:]
            labels.append(np.select([v < 0.1 * part.speed, v > 0.999 * part.speed], [2, 1], 0))
        else:
            kind = 3 if isinstance(part, Chirp) else 4 if isinstance(part, Together) else -1
            labels.append(np.full(n, kind))
    return np.concatenate(labels)
