"""The catalogue: every effect that takes part in a diagnosis. To add one, write its class and name it here.

A user's own file needs no entry: `load` reads it and takes its effects.
"""

import inspect
import sys
import traceback
from pathlib import Path
from types import ModuleType

from ..errors import InputError
from ._base import AbstractEffect
from ._check import fault
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
    VelocityFilter,
    VelocityGain,
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
    LoadDependentFriction,
    FrictionDrift,
    Presliding,
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
    """The effects that a user's Python file defines, in its order.

    Raises InputError, one line: no such file, not importable, no effect in it, one that is not nothing at its defaults
    or otherwise unfit, a name that is taken.
    """
    module = _imported(path)
    found = tuple(
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, AbstractEffect)
        and value.__module__ == module.__name__
        and not inspect.isabstract(value)
    )
    if not found:
        raise InputError(f"{path}: no effect in it; define a subclass of didim_jax.AbstractEffect with __call__.")
    taken = {effect.label(): "the catalogue" for effect in CATALOGUE}
    for effect in found:
        name = effect.label()
        if name in taken:
            raise InputError(f"{path}: {effect.__name__}: the name '{name}' is taken by {taken[name]}; choose another.")
        taken[name] = effect.__name__
        if wrong := fault(effect):
            raise InputError(f"{path}: {effect.__name__} {wrong}.")
    return found


def _imported(path: Path) -> ModuleType:
    """A user's file as a module; nothing is written beside it."""
    try:
        source = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file.") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None
    module = ModuleType(f"didim_effects_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # where dataclasses look for the meaning of annotations
    try:
        exec(compile(source, str(path), "exec"), vars(module))
    except (Exception, SystemExit) as error:  # whatever a user's file does wrong is theirs to read, in one line
        del sys.modules[module.__name__]
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == str(path)]
        line = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else None
        where = f"{path}, line {line}" if line else str(path)
        said = error.msg if isinstance(error, SyntaxError) else str(error)
        raise InputError(f"{where}: {type(error).__name__}: {' '.join(said.split())}") from None
    return module
