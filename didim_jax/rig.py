"""From what is documented (a machine, a record) to what is simulated (a loop, its excitation, its start)."""

import dataclasses
from collections.abc import Sequence

import diffrax as dfx
import jax.numpy as jnp
import numpy as np

from .chain import Chain
from .control import ContinuousPD, Drive, SampledPD
from .effects import AbstractEffect
from .hygiene import injected_scale
from .machine import Machine
from .plant import AbstractPlant
from .recording import Recording
from .simulate import AbstractLoop, ContinuousLoop, Excitation, SampledLoop, Start
from .sliding import Sliding

_START_SAMPLES = 15
"""Samples whose parabola gives the first speed: long enough for an encoder's steps, short enough for a mode."""


def sampled_loop(
    machine: Machine,
    plant: AbstractPlant,
    effects: Sequence[AbstractEffect] = (),
    substeps: int = 1,
    solver: dfx.AbstractSolver | Sliding | None = None,
) -> SampledLoop:
    """The machine's sampled controller and drive around a plant, `substeps` integration steps per sample."""
    law, chain = machine.controller, _chain(machine, plant, effects)
    loop = SampledLoop(controller=SampledPD(law.kp, law.kv), chain=chain, substeps=substeps)
    return loop if solver is None else dataclasses.replace(loop, solver=solver)


def continuous_loop(
    machine: Machine, plant: AbstractPlant, effects: Sequence[AbstractEffect] = (), substeps: int = 1
) -> ContinuousLoop:
    """The same gains as a law that acts at every instant, as in the paper."""
    law = machine.controller
    return ContinuousLoop(
        controller=ContinuousPD(law.kp, law.kv), chain=_chain(machine, plant, effects), substeps=substeps
    )


def _chain(machine: Machine, plant: AbstractPlant, effects: Sequence[AbstractEffect]) -> Chain:
    return Chain(Drive(machine.drive.gain, machine.drive.limit), plant, tuple(effects))


def excitation(recording: Recording, machine: Machine) -> Excitation:
    """The record's reference, and its injected signal in V, at the controller's sample time."""
    injected = np.zeros(len(recording))
    if recording.injected is not None:
        injected = injected_scale(recording, machine) * recording.injected
    return Excitation(jnp.asarray(machine.controller.sample_time), jnp.asarray(recording.qg), jnp.asarray(injected))


def first_state(recording: Recording, machine: Machine, loop: AbstractLoop) -> Start:
    """Start of a record, from its own samples: position qm[0] (m) and first speed."""
    return loop.start(recording.qm[0], first_speed(recording, machine), machine.controller.sample_time)


def first_speed(recording: Recording, machine: Machine) -> float:
    """Speed (m/s) at the first sample: the slope there of a parabola through the first 15 positions."""
    head = recording.qm[:_START_SAMPLES]
    return float(np.polyfit(machine.controller.sample_time * np.arange(len(head)), head, 2)[1])
