"""One record as a fit sees it: simulate it with some plant and initial state, filter, decimate, compare."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from .._types import Traj
from ..machine import Machine
from ..plant import AbstractPlant
from ..recording import Recording
from ..rig import excitation, first_state
from ..signals import Decimation, TracedDecimation
from ..simulate import AbstractLoop, Excitation, Simulation, Start, simulate


@dataclasses.dataclass(frozen=True)
class Signal:
    """A signal that is compared: where the record and where the simulation hold it, its unit, its usual residual.

    The residual weighs the record's own knowledge of its initial state: a shift s by one typical size costs as much as
    one sample that is off by `residual`. Without that a low-pass leaves the first milliseconds to chance.
    """

    name: str
    unit: str
    residual: float
    recorded: Callable[[Recording], np.ndarray]
    simulated: Callable[[Simulation], Traj]


FORCE = Signal("motor force", "N", 1.0, lambda recording: recording.tau, lambda simulation: simulation.tau)
"""The commanded motor force: all that DIDIM compares."""

POSITION = Signal("motor position", "m", 1e-6, lambda recording: recording.qm, lambda simulation: simulation.qm)
"""The measured motor position, for the output error on position."""


class Trial(eqx.Module):
    """A record, the loop that simulates it, and the signal that is compared.

    `start` is the initial state read off the record. Unless the record is known to start `at_rest`, the fit moves it:
    a vector s of shifts, in units of the typical sizes of position, velocity and controller memory.
    """

    loop: AbstractLoop
    excitation: Excitation
    start: Start
    decimation: TracedDecimation
    observed: Array
    signal: Signal = eqx.field(static=True)
    at_rest: bool = eqx.field(static=True)

    @property
    def n_start(self) -> int:
        """Length of s."""
        return 0 if self.at_rest else self.start.plant.shape[0] + self.start.memory.shape[0]

    def simulate(self, plant: AbstractPlant, s: Array) -> Simulation:
        """The record's run with another plant and shifted initial state."""
        loop = eqx.tree_at(lambda a: a.chain.plant, self.loop, plant)
        return simulate(loop, self.excitation, self.shifted(plant, s))

    def shifted(self, plant: AbstractPlant, s: Array) -> Start:
        """The initial state moved by s."""
        if self.at_rest:
            return self.start
        k = len(plant.state_scales)
        return Start(
            self.start.plant + s[:k] * np.array(plant.state_scales),
            self.start.memory + s[k:] * np.array(self.loop.memory_scales),
        )

    def predict(self, plant: AbstractPlant, s: Array) -> Array:
        """The compared signal, filtered and decimated, (n_decimated,)."""
        return self.decimation(self.signal.simulated(self.simulate(plant, s)))


def trial(
    recording: Recording,
    machine: Machine,
    loop: AbstractLoop,
    decimation: Decimation,
    *,
    at_rest: bool,
    signal: Signal = FORCE,
) -> Trial:
    """Prepare one record for a fit. The measured signal and the simulated one pass through the same decimation.

    A record that never reaches the drive's limit is simulated without it: the clip could then act only at trial
    parameters far from the machine, where it makes the loop swing without bound and ends the iteration.
    """
    if np.max(np.abs(recording.vir)) < machine.drive.limit:
        loop = eqx.tree_at(lambda a: a.chain.drive.limit, loop, jnp.asarray(jnp.inf, dtype=float))
    start = first_state(recording, machine, loop)
    if at_rest:
        start = loop.start(float(recording.qm[0]), 0.0, machine.controller.sample_time)
    return Trial(
        loop=loop,
        excitation=excitation(recording, machine),
        start=start,
        decimation=decimation.traced(),
        observed=jnp.asarray(decimation(signal.recorded(recording))),
        signal=signal,
        at_rest=at_rest,
    )
