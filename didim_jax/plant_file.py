"""Parameter values of a drive in a file::

    model = "flexible"        # or "rigid"
    [parameters]              # by their names in theta
    M1 = 68.0                 # kg
    Fv1 = 104.0               # N s/m
    ...

A side whose friction is named `Fv1_pos`, `Fc1_pos`, `Fv1_neg`, `Fc1_neg` has the asymmetric law.
"""

import difflib
import os
from collections.abc import Mapping, Sequence
from typing import Literal

import jax.numpy as jnp
from pydantic import Field
from pydantic.dataclasses import dataclass

from .config import CONFIG, load_toml
from .errors import InputError
from .params import Parameter, parameters, unpack
from .plant import (
    V_EPS,
    AbstractFriction,
    AbstractPlant,
    AsymmetricCoulombViscous,
    CoulombViscous,
    FlexibleDrive,
    RigidDrive,
)


@dataclass(frozen=True, config=CONFIG)
class _PlantFile:
    model: Literal["rigid", "flexible"] = Field(description='"rigid" or "flexible"')
    parameters: dict[str, float] = Field(description="SI units")
    v_eps: float = Field(default=V_EPS, gt=0, description="m/s, speed of the smooth sign")


def load_plant(path: str | os.PathLike[str]) -> AbstractPlant:
    """Read a plant. The offset may be left out (0 N), as may `v_eps`.

    Raises InputError, one line with file, name and unit: a parameter unknown, missing, negative, or a mass or stiffness
    of zero.
    """
    file = load_toml(path, _PlantFile)
    given = file.parameters

    def friction(side: str) -> AbstractFriction:
        asymmetric = any(name.startswith((f"Fv{side}_", f"Fc{side}_")) for name in given)
        return AsymmetricCoulombViscous(0, 0, 0, 0, file.v_eps) if asymmetric else CoulombViscous(0, 0, file.v_eps)

    plant: AbstractPlant
    if file.model == "rigid":
        plant = RigidDrive(1.0, friction(""))
    else:
        plant = FlexibleDrive(1.0, friction("1"), 1.0, friction("2"), 1.0)

    known = parameters(plant)
    _refuse_unknown(given, [p.name for p in known], f"{path}: ", file.model)
    chosen = tuple(p for p in known if p.name in given or p.name != "offset")
    return unpack(plant, jnp.asarray([_value(p, given, f"{path}: ") for p in chosen]), chosen)


def _refuse_unknown(given: Mapping[str, float], names: Sequence[str], where: str, model: str) -> None:
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(names)}."
            raise InputError(f"{where}unknown key 'parameters.{name}' of a {model} drive, {hint}")


def _value(p: Parameter, given: Mapping[str, float], where: str) -> float:
    if p.name not in given:
        raise InputError(f"{where}missing key 'parameters.{p.name}' [{p.unit}].")
    value = given[p.name]
    if (value < 0 and p.name != "offset") or (value == 0 and p.positive):
        wish = "must be greater than 0" if p.positive else "must not be negative"
        raise InputError(f"{where}'parameters.{p.name}' {wish} [{p.unit}], not {value:g}.")
    return value
