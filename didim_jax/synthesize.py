"""Synthetic records: the machine of a file, a plant of known parameters, and an encoder that counts."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from .effects import AbstractEffect, EncoderGrid
from .errors import InputError
from .machine import Machine
from .plant import AbstractPlant
from .recording import Recording
from .rig import sampled_loop
from .simulate import Excitation, simulate


def synthesize(
    machine: Machine,
    plant: AbstractPlant,
    qg: np.ndarray,
    *,
    force_noise: float = 0.0,
    noise_inside_loop: bool = False,
    effects: Sequence[AbstractEffect] = (),
    seed: int = 0,
    name: str = "synthetic",
    substeps: int = 1,
) -> Recording:
    """Run the sampled loop from rest at qg[0] and record it, both positions (m) on the encoder's grid.

    White noise of `force_noise` N rms per sample is added to the recorded command, divided by the drive gain. With
    `noise_inside_loop` it is added to the control law's output instead: the machine feels it, vir contains it, and
    the record does not say so.

    Raises InputError: noise or seed below zero, the run diverges, or the command exceeds the drive's limit.
    """
    if not 0 <= force_noise < np.inf:
        raise InputError(f"noise = {force_noise:g} N rms must be a finite number, zero or more.")
    if seed < 0:
        raise InputError(f"seed = {seed} must be a whole number, zero or more.")
    dt = machine.controller.sample_time
    gain = machine.drive.gain
    noise = np.random.default_rng(seed).normal(0.0, force_noise / gain, len(qg)) if force_noise else np.zeros(len(qg))
    inside = noise if noise_inside_loop else np.zeros(len(qg))

    grid = EncoderGrid(machine.encoder.resolution)
    loop = sampled_loop(machine, plant, (*effects, grid), substeps)
    run = simulate(loop, Excitation(jnp.asarray(dt), jnp.asarray(qg), jnp.asarray(inside)), loop.start(qg[0], 0.0, dt))
    vir = np.asarray(run.vir)
    if not run.ok:
        raise InputError(_diverged(name, vir, dt))
    _keep_drive_range(name, vir, dt, machine.drive.limit)

    return Recording(
        t=dt * np.arange(len(qg)),
        qg=qg,
        qm=np.asarray(run.qm),
        ql=_counted(np.asarray(run.load.q), machine.encoder.resolution),
        vir=vir if noise_inside_loop else vir + noise,
        gain=gain,
        name=name,
        synthetic=True,
        documented={"kp": machine.controller.kp, "kv": machine.controller.kv},
    )


def _counted(q: np.ndarray, resolution: float) -> np.ndarray:
    return resolution * np.round(q / resolution)


def _diverged(name: str, vir: np.ndarray, dt: float) -> str:
    lost = np.flatnonzero(~np.isfinite(vir))
    since = f" at t = {lost[0] * dt:.4g} s" if lost.size else ""
    return f"{name}: the simulation diverges{since}; correct the plant's parameters, or take more substeps."


def _keep_drive_range(name: str, vir: np.ndarray, dt: float, limit: float) -> None:
    over = np.flatnonzero(np.abs(vir) > limit)
    if over.size:  # the first time counts: once the drive has clipped, the loop runs after its reference
        raise InputError(
            f"{name}: the command exceeds the drive's limit of {limit:g} V from t = {over[0] * dt:.4g} s on, up to "
            f"{np.abs(vir).max():.3g} V; lower the reference's acceleration or amplitude just before, or the noise."
        )
