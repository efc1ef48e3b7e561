"""didim_jax: differentiable simulation of flexible-joint drives, for identification and for the gap to reality.

Importing sets no global flag. Programs switch on float64 themselves (`jax.config.update("jax_enable_x64", True)`):
the methods here are not meant for less.
"""

from .chain import Chain
from .control import ContinuousPD, Drive, SampledPD
from .effects import AbstractEffect, Bench, Block, Forces, Probe, Signals
from .effects.catalogue import CATALOGUE
from .errors import InputError
from .formats import load_recording, save_recording
from .hygiene import Finding, admit, examine
from .machine import Machine
from .params import names, pack, param, parameters, setting, unpack, values
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
    "CATALOGUE",
    "AbstractEffect",
    "AsymmetricCoulombViscous",
    "Bench",
    "Block",
    "Chain",
    "ContinuousLoop",
    "ContinuousPD",
    "CoulombViscous",
    "Drive",
    "Excitation",
    "Finding",
    "FlexibleDrive",
    "Forces",
    "InputError",
    "Machine",
    "Probe",
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
    "param",
    "parameters",
    "save_recording",
    "setting",
    "simulate",
    "split",
    "unpack",
    "values",
]
