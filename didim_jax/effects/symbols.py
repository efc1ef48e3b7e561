"""What the symbols in an effect's law mean, its parameters first of all, in a few words each."""

from ..params import parameters
from ._base import AbstractEffect

COMMON = (
    "In the laws q and v are position and velocity of the motor side, s the sign of v, delta the bend of the coupling, "
    "phi the angle of the screw, vir the command (V), tau the motor force (N), g the drive's gain (N/V), H a unit "
    "step, ' is d/dt."
)
"""Of the symbols that many laws share; an effect that means something else by one says so itself."""

_SHARED = {"load_share": "share that rubs on the load side, the rest on the motor side"}

_TURN = {"a": "sine over a turn of the screw", "b": "cosine over a turn of the screw"}

_MEANINGS = {
    "position_gain": {"e": "by how much kp is larger than documented, relative"},
    "velocity_filter": {"T": "time constant of the filter", "dqf": "velocity that the controller works with"},
    "velocity_gain": {"e": "by how much kv is larger than documented, relative"},
    "saturation": {
        "limit": "largest command that gets through",
        "soft": "share of the limit over which the corner is rounded",
    },
    "amplifier_dead_zone": {"d": "command that is lost, on each side of zero"},
    "gain_nonlinearity": {
        "k": "share of the gain that is lost, per volt, at u0",
        "p": "power of the command with which the loss grows",
    },
    "drive_gain": {"e": "by how much the drive's gain is larger than documented, relative"},
    "amplifier_lag": {"T": "time constant with which the force follows the command"},
    "time_delay": {"T": "delay of the force after the command"},
    "cogging": {
        "a1": "sine, once a turn of the screw",
        "b1": "cosine, once a turn",
        "a2": "sine, twice a turn",
        "b2": "cosine, twice a turn",
    },
    "asymmetric_coulomb": {
        "dFc": "by how much Coulomb friction is larger in the positive direction, and smaller in the negative",
        "v0": "speed over which it comes up from rest",
        "tail": "share that comes up more slowly",
    },
    "asymmetric_viscous": {
        "dFv": "by how much viscous friction is larger in the positive direction, and smaller in the negative",
        "v0": "speed from which it counts",
    },
    "stribeck": {
        "dFs": "excess of friction over Coulomb friction near rest",
        "vs": "speed at which 37 % of it is left",
        "a": "how steeply it falls around that speed",
    },
    "quadratic_viscous": {
        "c": "friction over the square of the speed, at 0.1 m/s",
        "p": "power of the speed with which it grows",
    },
    "position_friction": {
        "c1": "slope over the stroke",
        "c2": "parabola over the stroke",
        "c3": "cubic over the stroke",
        "c4": "quartic over the stroke",
        "x": "place in the stroke, -1 to 1",
        "P_n": "Legendre polynomials",
    },
    "lead_friction": _TURN,
    "local_friction": {
        "A": "excess of friction at the spot",
        "q0": "place of the spot",
        "w": "distance from it at which 37 % is left",
    },
    "load_dependent_friction": {
        "mu": "friction over the force transmitted",
        "preload": "Fp: force up to which there is hardly any",
    },
    "friction_drift": {
        "d_coulomb": "change of Coulomb friction by the end of the record, relative",
        "d_viscous": "change of viscous friction by the end of the record, relative",
        "T": "time constant of the change",
        "g": "0 at the beginning of the record, 1 at its end",
    },
    "presliding": {
        "share": "share of the motor side's friction that a bristle carries; 1 is all",
        "load": "such a share of the load side's, over that of the motor side's",
        "z_s": "deflection at which the bristle gives way",
        "T": "damping of the bristle over its stiffness",
        "F": "force of the bristle, N",
        "g": "friction that holds at rest, Fc and what other effects add to it, N",
    },
    "coupling_damping": {"C": "viscous damping", "eta": "loss factor: damping force over spring force"},
    "cubic_stiffness": {
        "k3": "by how much the coupling is stiffer at a bend of 50 um, relative",
        "reach": "bend from which it hardly stiffens further",
    },
    "backlash": {"b": "half of the play"},
    "transmission_error": _TURN,
    "second_flexible_mode": {
        "m3": "part of the load that hangs on a spring",
        "f3": "its natural frequency",
        "zeta": "its damping ratio",
        "K23, C23": "spring and damper between it and the load",
    },
    "payload_change": {"dm": "mass taken up by the load", "t0": "when"},
    "encoder_periodic_error": _TURN,
    "encoder_quantisation": {"resolution": "r: step of the encoder"},
    "base_flexibility": {
        "mu": "one over the mass of the frame",
        "f": "natural frequency of the frame",
        "zeta": "its damping ratio",
        "guides": "share to which the guides stand on the floor instead of the frame",
        "mb, kb, cb, xb": "mass, stiffness, damping and motion of the frame",
    },
    "offset": {"F0": "constant force against the positive direction"},
    "cable_spring": {"kc": "stiffness", "q0": "position at which it does not pull"},
    "disturbance_pulses": {
        "A": "height",
        "t0": "when the first begins",
        "width": "how long one lasts",
        "period": "from one to the next",
        "n": "shape: 0 a rectangle, 1 half a sine, 2 a raised cosine",
        "odd": "height of every second one over that of the others",
        "count": "how many there are",
    },
}


def units(effect: type[AbstractEffect]) -> dict[str, str]:
    """Unit of each parameter, by its name."""
    return {parameter.name: parameter.unit for parameter in parameters(effect())}


def meanings(effect: type[AbstractEffect]) -> dict[str, str]:
    """Symbol to meaning, of every parameter and of what else the law holds; "" for what only a user's file knows."""
    known = _MEANINGS.get(effect.label(), {})
    return known | {name: _SHARED.get(name, "") for name in units(effect) if name not in known}
