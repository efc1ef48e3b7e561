"""What one identification leaves behind, before anything is written or drawn."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from ..hygiene import Finding
from ..machine import Machine
from ..plant import AbstractPlant
from ..recording import Recording
from ..rig import sampled_loop
from ..signals import Decimation, LowPass
from ..simulate import simulate
from .case import Case
from .gauss_newton import fit_start
from .identifiability import Identifiability
from .least_squares import DIVERGED
from .result import IdentificationResult
from .trial import trial


@dataclasses.dataclass(frozen=True)
class Run:
    """One record beside the closed-loop simulation with the identified drive, every sample.

    `tau` (N) and `qm` (m) are simulated; `start` is the initial state that was used, by name (SI units).
    `force_error` = norm(F(tau_record - tau)) / norm(F(tau_record)), F a Butterworth of order 4 at 60 Hz, forward and
    backward; `position_error` the same ratio for qm, unfiltered. All of them are nan where the simulation diverges.
    """

    recording: Recording
    tau: np.ndarray
    qm: np.ndarray
    start: dict[str, float]
    force_error: float
    position_error: float


@dataclasses.dataclass(frozen=True)
class Study:
    """One identification: what went in, what was found odd in it, what came out, and how it simulates each record.

    `check` is a record that took no part in the fit: only its initial state, and the volts per unit of a known injected
    signal, were taken from it.
    `settings` are the choices that were made, name to value; `seconds` the time each part took.
    """

    machine: Machine
    result: IdentificationResult
    runs: tuple[Run, ...]
    check: Run | None
    findings: tuple[tuple[str, Finding], ...]
    identifiability: Identifiability
    settings: dict[str, object]
    seconds: dict[str, float]

    @property
    def synthetic(self) -> bool:
        """Whether any record was simulated rather than measured."""
        records = [run.recording for run in self.runs] + ([self.check.recording] if self.check else [])
        return any(record.synthetic for record in records)


ERROR_HZ = 60.0
"""Band of the closed-loop force error, Hz: the paper's."""


def force_error(tau: np.ndarray, simulated: np.ndarray, dt: float) -> float:
    """norm(F(tau - simulated)) / norm(F(tau)), F a zero-phase Butterworth of order 4 at 60 Hz; every sample counts."""
    low_pass = LowPass.butterworth(ERROR_HZ, dt)
    return float(np.linalg.norm(low_pass(tau - simulated)) / np.linalg.norm(low_pass(tau)))


def run(case: Case, recording: Recording, plant: AbstractPlant) -> Run:
    """Simulate one record with a drive that stays as it is; only the record's own initial state is fitted to it.

    The scale of a known injected signal is the record's too: `hygiene.injected_scale` finds it from the control law.
    """
    machine, at_rest = case.machine, case.choices.at_rest
    dt = machine.controller.sample_time
    one = trial(recording, machine, sampled_loop(machine, plant), Decimation.at(ERROR_HZ, dt), at_rest=at_rest)
    shift = jnp.zeros(0) if at_rest else jnp.asarray(fit_start(plant, (one,)).shifts[0])
    start = one.shifted(plant, shift)
    simulation = simulate(one.loop, one.excitation, start)
    tau, qm = np.asarray(simulation.tau), np.asarray(simulation.qm)
    if not (simulation.ok and np.abs(tau).max() < DIVERGED * np.abs(recording.tau).max()):
        tau, qm = np.full_like(tau, np.nan), np.full_like(qm, np.nan)
    named = zip((*plant.state_names, *one.loop.memory_names), (*start.plant, *start.memory), strict=True)
    return Run(
        recording=recording,
        tau=tau,
        qm=qm,
        start={name: float(value) for name, value in named},
        force_error=force_error(recording.tau, tau, dt),
        position_error=float(np.linalg.norm(recording.qm - qm) / np.linalg.norm(recording.qm)),
    )
