"""A record made ready for diagnosis: the compiled loop around it, and what is compared, filtered and decimated."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..effects import AbstractEffect, Bench
from ..machine import Machine
from ..plant import AbstractPlant, FlexibleDrive, RigidDrive
from ..recording import Recording
from ..rig import excitation, first_state, sampled_loop
from ..signals import Decimation, LowPass, central_difference
from .model import SOLVER, SUBSTEPS, Model
from .noise import SLOW_SHARE, Noise, Whitening
from .rounded import RoundedCoulombViscous

CUTOFF_HZ = 60.0
"""Band in which simulation and machine are compared, as the contract has it."""


@dataclasses.dataclass(frozen=True)
class Channel:
    """One compared signal: its name, unit, row among the model's outputs, and the record's, filtered, (n_decimated,).

    A `centred` one is compared without its mean: two encoders have no common zero.
    """

    name: str
    unit: str
    row: int
    observed: np.ndarray
    centred: bool = False

    @property
    def rms(self) -> float:
        """Of the record's signal in the band."""
        return float(np.sqrt(np.mean(self.observed**2)))

    @property
    def least(self) -> float:
        """Rms below which a residual is of the numbers, not of the machine."""
        return 1e-4 * self.rms


@dataclasses.dataclass(frozen=True)
class Prepared:
    """A record, its model, its channels, and the rigid inverse model's parameters to start from."""

    recording: Recording
    machine: Machine
    model: Model
    decimation: Decimation
    channels: tuple[Channel, ...]
    rigid: dict[str, float]
    bench: Bench

    def filtered(self, outputs: np.ndarray, channel: Channel) -> np.ndarray:
        """A channel of the model's outputs, (..., 2, n), in the band, (..., n_decimated)."""
        signal = self.decimation(np.moveaxis(outputs[..., channel.row, :], -1, 0)).T
        return signal - signal.mean(axis=-1, keepdims=True) if channel.centred else signal

    def whitening(self, channel: Channel, residual: np.ndarray) -> Whitening:
        """What makes this residual of a channel white."""
        sigma = max(float(np.sqrt(np.mean(residual**2))), channel.least)
        return Whitening.of(len(residual), self.dt, sigma, SLOW_SHARE * channel.rms)

    def noise(self, channel: Channel, residual: np.ndarray) -> Noise:
        """What this residual of a channel shows of its own noise."""
        return Noise.of(residual, self.dt, channel.least)

    @property
    def dt(self) -> float:
        """Between decimated samples, s."""
        return self.model.dt * self.decimation.factor

    @property
    def t(self) -> np.ndarray:
        """Times of the decimated samples, s."""
        return self.model.dt * np.arange(self.model.n)[:: self.decimation.factor]


def nominal(model: str) -> AbstractPlant:
    """A plant of the documented kind; its numbers are placeholders that a fit replaces."""
    friction = RoundedCoulombViscous(100.0, 10.0)
    return RigidDrive(100.0, friction) if model == "rigid" else FlexibleDrive(60.0, friction, 40.0, friction, 9e5)


def prepare(
    recording: Recording,
    machine: Machine,
    catalogue: Sequence[type[AbstractEffect]],
    bench: Bench | None = None,
) -> Prepared:
    """Make a record ready. `bench` of another record of the machine keeps the effects' settings (ranges) the same."""
    dt = machine.controller.sample_time
    if bench is None:
        bench = Bench(
            lead=machine.screw_lead,
            limit=machine.drive.limit,
            gain=machine.drive.gain,
            dt=dt,
            q_low=float(recording.qg.min()),
            q_high=float(recording.qg.max()),
            duration=dt * len(recording),
            volts=recording.vir,
        )
    effects = tuple(effect.at(bench) for effect in catalogue)
    loop = sampled_loop(machine, nominal(machine.model), effects, SUBSTEPS, SOLVER)
    model = Model(loop, excitation(recording, machine), first_state(recording, machine, loop))
    # Odd reflection, as the gap is defined: it holds the fit to the first sample, where an even one averages it away.
    decimation = Decimation(LowPass.butterworth(CUTOFF_HZ, dt), max(1, int(0.5 / (CUTOFF_HZ * dt) + 1e-9)))
    channels = [Channel("force", "N", 0, decimation(recording.tau))]
    # A rigid drive has both encoders on one mass.
    if recording.ql is not None and machine.model == "flexible" and np.ptp(recording.ql - recording.qm) > 0:
        twist = decimation(recording.ql - recording.qm)
        channels.append(Channel("load", "m", 1, twist - twist.mean(), centred=True))
    return Prepared(recording, machine, model, decimation, tuple(channels), _rigid(recording, machine), bench)


def _rigid(recording: Recording, machine: Machine) -> dict[str, float]:
    """M, Fv, Fc of the rigid inverse model by least squares at 20 Hz: where the nominal fit starts."""
    dt = machine.controller.sample_time
    low = LowPass.butterworth(20.0, dt)
    v = central_difference(recording.qm, dt)
    a = central_difference(v, dt)
    W = low(np.column_stack([a, v, np.tanh(v / 2e-3), np.ones_like(v)]))
    Y = low(recording.tau)
    theta = np.linalg.lstsq(W, Y, rcond=None)[0]
    return {"M": float(theta[0]), "Fv": float(theta[1]), "Fc": float(theta[2])}


def motion(record: Prepared) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Motor position, velocity and acceleration in the band, and the reference position, at the decimated samples."""
    dt, factor, q = record.model.dt, record.decimation.factor, record.recording.qm
    low = LowPass.butterworth(CUTOFF_HZ, dt)
    v = low(central_difference(q, dt), odd=False)
    a = low(central_difference(central_difference(q, dt), dt), odd=False)
    return q[::factor], v[::factor], a[::factor], record.recording.qg[::factor]
