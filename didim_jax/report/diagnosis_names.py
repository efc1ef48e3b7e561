"""Effects and places of the loop as a person calls them; files and the command line keep the short names."""

from collections.abc import Sequence

_EFFECTS = {
    "none": "no effect",
    "other": "something else",
    "position_gain": "another position gain",
    "velocity_gain": "another velocity gain",
    "velocity_filter": "another velocity filter",
    "drive_gain": "another drive gain",
    "saturation": "saturation below the documented limit",
    "gain_nonlinearity": "nonlinear drive gain",
    "asymmetric_coulomb": "asymmetric Coulomb friction",
    "asymmetric_viscous": "asymmetric viscous friction",
    "stribeck": "Stribeck friction",
    "quadratic_viscous": "quadratic viscous friction",
    "position_friction": "position-dependent friction",
    "lead_friction": "friction over the screw's turn",
    "presliding": "presliding friction",
    "load_dependent_friction": "load-dependent friction",
    "base_flexibility": "flexible base",
    "encoder_periodic_error": "periodic encoder error",
    "offset": "constant force",
    "cable_spring": "cable spring",
}
"""Only where the short name, its underscores as spaces, does not read well."""

_PLACES = {
    "controller": "In the controller",
    "actuator": "In the actuator",
    "motor side": "On the motor side",
    "coupling": "In the coupling",
    "load side": "On the load side",
    "sensor": "In the encoder",
    "base": "In the base",
    "environment": "From outside, on the load",
}


def named(effect: str) -> str:
    """'stribeck' -> 'Stribeck friction', 'time_delay' -> 'time delay'."""
    return _EFFECTS.get(effect, effect.replace("_", " "))


def place(block: str) -> str:
    """'motor side' -> 'On the motor side'."""
    return _PLACES.get(block, f"In the {block}")


def listed(items: Sequence[str], last: str = "and") -> str:
    """'a', 'a and b', 'a, b and c'."""
    return f" {last} ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))


def chance(p: float) -> str:
    """A probability in whole percent; never 0 % or 100 %, which it is not."""
    return "<1 %" if p < 0.01 else ">99 %" if p > 0.99 else f"{100 * p:.0f} %"


def capital(text: str) -> str:
    """The text with a capital first letter, the rest as it is."""
    return text[:1].upper() + text[1:]
