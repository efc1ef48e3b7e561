"""The parameter that says how large an effect is: in a truth, in a diagnosis, and how far one is from the other."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True)
class Main:
    """What the size of an effect is measured in.

    `name` and `unit` in the answer, and the parameters of the diagnosis that are it: a sine and a cosine of one line
    are its amplitude. None, where the diagnosis has no parameter of that meaning.
    """

    name: str
    unit: str
    of: tuple[str, ...]


MAIN: Mapping[str, Main] = {
    "position_gain": Main("e", "1", ("e",)),
    "velocity_gain": Main("e", "1", ("e",)),
    "velocity_filter": Main("T", "s", ("T",)),
    "amplifier_lag": Main("T", "s", ("T",)),
    "time_delay": Main("T", "s", ("T",)),
    "saturation": Main("u", "V", ("limit",)),
    "amplifier_dead_zone": Main("d", "V", ("d",)),
    "gain_nonlinearity": Main("k", "1/V", ("k",)),
    "cogging": Main("A", "N", ("a1", "b1")),
    "encoder_periodic_error": Main("a", "m", ("a", "b")),
    "encoder_quantisation": Main("grid", "m", ()),
    "asymmetric_coulomb": Main("dFc", "N", ("dFc",)),
    "asymmetric_viscous": Main("dFv", "N s/m", ("dFv",)),
    "stribeck": Main("dFs", "N", ("dFs",)),
    "quadratic_viscous": Main("c", "N s2/m2", ("c",)),
    "position_friction": Main("A", "N", ()),
    "local_friction": Main("A", "N", ("A",)),
    "lead_friction": Main("A", "N", ("a", "b")),
    "presliding": Main("r", "1", ("share",)),
    "load_dependent_friction": Main("mu", "1", ("mu",)),
    "friction_drift": Main("d_c", "1", ("d_coulomb",)),
    "coupling_damping": Main("C", "N s/m", ("C",)),
    "cubic_stiffness": Main("k3", "1", ("k3",)),
    "backlash": Main("b", "m", ("b",)),
    "transmission_error": Main("a", "m", ("a", "b")),
    "second_flexible_mode": Main("m3", "kg", ("m3",)),
    "payload_change": Main("dm", "kg", ("dm",)),
    "base_flexibility": Main("mb", "kg", ("mu",)),
    "offset": Main("F0", "N", ("F0",)),
    "cable_spring": Main("kc", "N/m", ("kc",)),
    "disturbance_pulses": Main("A", "N", ("A",)),
}

_RENAMED = {"saturation": ("share of the peak cut off", "1"), "base_flexibility": ("1/mb", "1/kg")}


def proportional(effect: str) -> tuple[str, str]:
    """Name and unit of what grows with the effect: its main parameter, or what stands for one that falls."""
    return _RENAMED.get(effect, (MAIN[effect].name, MAIN[effect].unit))


def amplitude(parts: Sequence[Mapping[str, Any]]) -> float:
    """The value that an estimate's parts are: one its own, a sine and a cosine their amplitude."""
    return float(parts[0]["value"] if len(parts) == 1 else np.hypot(*(part["value"] for part in parts)))


def true_size(effect: str, answer: Mapping[str, Any]) -> float | None:
    """The effect's main parameter in an answer; None where this law has none of that unit."""
    main = MAIN[effect]
    found = answer["parameters"][effect].get(main.name)
    return None if found is None or found["unit"] != main.unit else float(found["value"])
