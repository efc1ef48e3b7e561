"""The machine of this study: the twin at rest, under the rig's sampled law or the paper's continuous one."""

import dataclasses
import hashlib
from collections.abc import Sequence
from typing import Literal

import diffrax as dfx
import numpy as np

from didim_jax.identify import Trial, trial
from didim_jax.machine import Machine
from didim_jax.params import values
from didim_jax.plant import AbstractPlant, FlexibleDrive
from didim_jax.plant_file import load_plant
from didim_jax.recording import Recording
from didim_jax.reference import load_reference
from didim_jax.rig import continuous_loop, excitation, sampled_loop
from didim_jax.signals import Decimation
from didim_jax.simulate import AbstractLoop, ContinuousLoop, SampledLoop, simulate
from didim_jax.solver import Unrolled
from didim_jax.synthesize import synthesize

from ..data import TWIN
from .stability import integrated_radius, sampled_radius

Law = Literal["sampled", "continuous"]
"""Sampled, held and delayed as on the rig, or acting at every instant as in the paper."""

FAST = dfx.Bosh3()
"""Integrates the lanes. How far it is from the record's own Tsit5 is part of the results."""

RECORD = dfx.Tsit5()
"""Integrates records, one step a sample."""

CONTINUOUS_SUBSTEPS = 2
"""The continuous law closes a velocity loop of 8557/M rad/s, which a step of 1 ms cannot follow for M below 4 kg."""


@dataclasses.dataclass(frozen=True)
class Twin:
    """A machine, its true drive, and a record of it under one law."""

    machine: Machine
    truth: FlexibleDrive
    law: Law
    recording: Recording

    @property
    def true(self) -> dict[str, float]:
        """Name to true value, SI units."""
        return values(self.truth)

    @property
    def key(self) -> dict[str, object]:
        """What results on this record depend on, for a store to know its own."""
        digest = hashlib.sha256(np.ascontiguousarray(self.recording.vir).tobytes()).hexdigest()
        return {"law": self.law, "record": digest, "method": type(FAST).__name__, "substeps": CONTINUOUS_SUBSTEPS}

    def loop(self, plant: AbstractPlant, method: dfx.AbstractERK = FAST) -> AbstractLoop:
        """The loop that lanes simulate."""
        loop: SampledLoop | ContinuousLoop
        if self.law == "sampled":
            loop = sampled_loop(self.machine, plant)
        else:
            loop = continuous_loop(self.machine, plant, substeps=CONTINUOUS_SUBSTEPS)
        return dataclasses.replace(loop, solver=Unrolled(method))

    def trial(
        self, plant: AbstractPlant, cutoff_hz: float, *, at_rest: bool = True, method: dfx.AbstractERK = FAST
    ) -> Trial:
        """The record, to be compared below the cutoff (Hz) with drives of the plant's kind."""
        decimation = Decimation.at(cutoff_hz, self.machine.controller.sample_time)
        return trial(self.recording, self.machine, self.loop(plant, method), decimation, at_rest=at_rest)

    def radius(self, plant: AbstractPlant) -> float:
        """Spectral radius of the loop around a drive, as lanes see it; no finite simulation above 1."""
        if self.law == "sampled":
            return sampled_radius(plant, self.machine)
        return integrated_radius(plant, self.machine, FAST, CONTINUOUS_SUBSTEPS)

    def unstable(self, plants: Sequence[AbstractPlant]) -> np.ndarray:
        """Which drives have a radius above 1, (n,) bool."""
        return np.array([self.radius(plant) > 1 for plant in plants])

    def first(self, seconds: float) -> "Twin":
        """The same with the first seconds of the record only."""
        r, n = self.recording, round(seconds / self.machine.controller.sample_time) + 1
        cut = {name: getattr(r, name)[:n] for name in ("t", "qg", "qm", "ql", "vir") if getattr(r, name) is not None}
        return dataclasses.replace(self, recording=dataclasses.replace(r, **cut))


def make(law: Law, noise: float, seed: int) -> Twin:
    """The twin of the paper's drive (Table 3) under trapezoids and chirps; white force noise, N rms at 1 kHz."""
    machine, truth = Machine.load(TWIN / "machine.toml"), load_plant(TWIN / "plant.toml")
    assert isinstance(truth, FlexibleDrive)
    qg = load_reference(TWIN / "reference.toml").sample(machine.controller.sample_time)
    recording = synthesize(machine, truth, qg, force_noise=noise, seed=seed, name="twin")
    twin = Twin(machine, truth, law, recording)
    return twin if law == "sampled" else dataclasses.replace(twin, recording=_continuous(twin, noise, seed))


def _continuous(twin: Twin, noise: float, seed: int) -> Recording:
    """The same motion under the continuous law; positions as they are, not counted."""
    loop = continuous_loop(twin.machine, twin.truth, substeps=4)
    r = twin.recording
    start = loop.start(float(r.qg[0]), 0.0, twin.machine.controller.sample_time)
    run = simulate(loop, excitation(r, twin.machine), start)
    added = np.random.default_rng(seed).normal(0.0, noise / r.gain, len(r))
    return dataclasses.replace(r, qm=np.asarray(run.qm), ql=np.asarray(run.load.q), vir=np.asarray(run.vir) + added)
