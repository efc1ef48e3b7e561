"""didim_jax: differentiable simulation of flexible-joint drives, for identification and for the gap to reality.

Importing sets no global flag. Programs switch on float64 themselves (`jax.config.update("jax_enable_x64", True)`):
the methods here are not meant for less.
"""

from .chain import Chain
from .control import ContinuousPD, Drive, SampledPD
from .effects import AbstractEffect, Block, Signals
from .errors import InputError
from .formats import load_recording, save_recording
from .hygiene import Finding, admit, examine
from .machine import Machine
from .params import names, pack, parameters, unpack, values
from .plant import (
    AsymmetricCoulombViscous,
    CoulombViscous,
    FlexibleDrive,
    RigidDrive,
    mass_ratio,
    mode,
    split,
)
from .recording import Recording
from .simulate import ContinuousLoop, Excitation, SampledLoop, Simulation, Start, simulate

__all__ = [
    "AbstractEffect",
    "AsymmetricCoulombViscous",
    "Block",
    "Chain",
    "ContinuousLoop",
    "ContinuousPD",
    "CoulombViscous",
    "Drive",
    "Excitation",
    "Finding",
    "FlexibleDrive",
    "InputError",
    "Machine",
    "Recording",
    "RigidDrive",
    "SampledLoop",
    "SampledPD",
    "Signals",
    "Simulation",
    "Start",
    "admit",
    "examine",
    "load_recording",
    "mass_ratio",
    "mode",
    "names",
    "pack",
    "parameters",
    "save_recording",
    "simulate",
    "split",
    "unpack",
    "values",
]
