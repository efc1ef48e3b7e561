"""The catalogue: every effect that takes part in a diagnosis. To add one, write its class and name it here.

A user's own file needs no entry: `load` imports it and takes its effects.
"""

import importlib.util
import inspect
from pathlib import Path

from ..errors import InputError
from ._base import AbstractEffect
from .actuator import (
    AmplifierDeadZone,
    AmplifierLag,
    Cogging,
    DriveGain,
    GainNonlinearity,
    Saturation,
    TimeDelay,
)
from .base import BaseFlexibility
from .controller import PositionGain, VelocityFilter, VelocityGain
from .coupling import Backlash, CouplingDamping, CubicStiffness, TransmissionError
from .environment import CableSpring, DisturbancePulses, Offset
from .friction import (
    AsymmetricCoulomb,
    AsymmetricViscous,
    FrictionDrift,
    LeadFriction,
    LoadDependentFriction,
    LocalFriction,
    PositionFriction,
    Presliding,
    QuadraticViscous,
    Stribeck,
)
from .load import PayloadChange, SecondFlexibleMode
from .sensor import EncoderGrid, EncoderPeriodicError

CATALOGUE: tuple[type[AbstractEffect], ...] = (
    PositionGain,
    VelocityGain,
    VelocityFilter,
    Saturation,
    AmplifierDeadZone,
    GainNonlinearity,
    DriveGain,
    AmplifierLag,
    TimeDelay,
    Cogging,
    AsymmetricCoulomb,
    AsymmetricViscous,
    Stribeck,
    QuadraticViscous,
    PositionFriction,
    LeadFriction,
    LocalFriction,
    Presliding,
    LoadDependentFriction,
    FrictionDrift,
    CouplingDamping,
    CubicStiffness,
    Backlash,
    TransmissionError,
    SecondFlexibleMode,
    PayloadChange,
    EncoderPeriodicError,
    EncoderGrid,
    BaseFlexibility,
    Offset,
    CableSpring,
    DisturbancePulses,
)
"""In the order in which they act within a block."""


def load(path: Path) -> tuple[type[AbstractEffect], ...]:
    """The effects that a user's Python file defines. Raises InputError: no such file, not importable, none in it."""
    if not path.is_file():
        raise InputError(f"{path}: no such file.")
    spec = importlib.util.spec_from_file_location(f"didim_effects_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path}: not a Python file.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's file does wrong is theirs to read, in one line
        raise InputError(f"{path}: {type(error).__name__}: {' '.join(str(error).split())}") from None
    found = tuple(
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, AbstractEffect)
        and value.__module__ == module.__name__
        and not inspect.isabstract(value)
    )
    if not found:
        raise InputError(f"{path}: defines no effect; subclass didim_jax.AbstractEffect.")
    return found
