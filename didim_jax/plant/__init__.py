"""Plants: what moves under a motor force. They state physics and know neither the controller nor the solver."""

from ._base import AbstractPlant, Axis, without_coulomb
from .flexible import FlexibleDrive, mass_ratio, mode, split
from .friction import V_EPS, AbstractFriction, AsymmetricCoulombViscous, CoulombViscous, smooth_sign
from .rigid import RigidDrive

__all__ = [
    "V_EPS",
    "AbstractFriction",
    "AbstractPlant",
    "AsymmetricCoulombViscous",
    "Axis",
    "CoulombViscous",
    "FlexibleDrive",
    "RigidDrive",
    "mass_ratio",
    "mode",
    "smooth_sign",
    "split",
    "without_coulomb",
]
