"""Effects of coupling, load side, base and environment: how each is drawn."""

import numpy as np

from .law import Draw, Drawn, Law


def coupling_damping(draw: Draw) -> Drawn:
    law = draw.choice("viscous", "power", "structural")
    size = draw.size(f"coupling_damping/{law}")
    if law == "structural":
        text = "eta K12 |delta| delta'/(|delta'| + 0.5 mm/s) above the nominal damping"
        return Drawn(text, "coupling", {"eta": size}, {"eta": (size, "1")})
    text = {"viscous": "C delta'", "power": "C delta' (|delta'|/(5 mm/s))^0.25"}[law] + " above the nominal damping"
    return Drawn(text, "coupling", {"C": size, "C_law": float(law == "power")}, {"C": (size, "N s/m")})


def cubic_stiffness(draw: Draw) -> Drawn:
    law = draw.choice("cubic", "tanh")
    k3 = draw.size(f"cubic_stiffness/{law}")
    if law == "tanh" and draw.rng.random() < 0.4:
        k3 = -min(k3, 0.8)  # softening, which a bare cubic cannot bear
    text = {
        "cubic": "K12 delta (1 + k3 (delta/50 um)^2)",
        "tanh": "K12 delta (1 + k3 tanh((delta/50 um)^2))",
    }[law]
    return Drawn(text, "coupling", {"k3": k3, "k3_law": float(law == "tanh")}, {"k3": (k3, "1")})


def backlash(draw: Draw) -> Drawn:
    law = draw.choice("sticking", "pushing")
    b = draw.size("backlash")
    C = draw.uniform(0.3, 1.0) * draw.machine.base["C12"]
    text = "dead zone of delta, half-width b, damping C in the gap" + (
        "; in contact the coupling only pushes" if law == "pushing" else ""
    )
    slots = {"b": b, "b_C": C, "b_law": float(law == "pushing")}
    return Drawn(text, "coupling", slots, {"b": (b, "m"), "C": (C, "N s/m")})


def transmission_error(draw: Draw) -> Drawn:
    a = draw.size("transmission_error")
    two = draw.choice("one", "two") == "two"
    slots = {
        "te_a": a,
        "te_a2": a * draw.uniform(0.1, 0.25) if two else 0.0,
        "te_p": draw.phase(),
        "te_p2": draw.phase(),
    }
    text = "delta = q2 - q1 - a sin(phi + p)" + (" - a2 sin(2 phi + p2)" if two else "") + ", phi = 2 pi q1/lead"
    parameters = {"a": (a, "m"), "p": (slots["te_p"], "rad")}
    return Drawn(text, "coupling", slots, parameters | ({"a2": (slots["te_a2"], "m")} if two else {}))


def second_flexible_mode(draw: Draw) -> Drawn:
    f, zeta = draw.uniform(28, 55), draw.uniform(0.01, 0.04)
    m3 = draw.size("second_flexible_mode") * (f / 40) ** 2  # a slower mode shows more
    slots = {"m3": m3, "m3_w": 2 * np.pi * f, "m3_zeta": zeta}
    text = "a mass m3 on the load, spring m3 (2 pi f)^2, damping ratio zeta of its own"
    return Drawn(text, "load side", slots, {"m3": (m3, "kg"), "f": (f, "Hz"), "zeta": (zeta, "1")})


def payload_change(draw: Draw) -> Drawn:
    dm = draw.size("payload_change") * (1.0 if draw.rng.random() < 0.75 else -1.0)
    load = draw.machine.mass if draw.machine.rigid else draw.machine.base["M2"]
    dm = max(dm, -0.6 * load)
    t0 = draw.uniform(2.5, 7.0)
    law = draw.choice("at once", "poured")
    ramp = draw.uniform(0.1, 0.5) if law == "poured" else 0.0
    slots = {"dm": dm, "dm_t0": t0, "dm_ramp": ramp}
    text = "dm on the load from t0 of the run"
    if law == "poured":
        text += ", poured on from rest over T: -dm/T v while it flows"
    parameters = {"dm": (dm, "kg"), "t0": (t0, "s")} | ({"T": (ramp, "s")} if ramp else {})
    return Drawn(text, "load side", slots, parameters, intervals=((t0, float("inf")),))


def base_flexibility(draw: Draw) -> Drawn:
    f, zeta = draw.uniform(19, 40), draw.uniform(0.02, 0.06)
    inverse = draw.size("base_flexibility") * (f / 30) ** 2  # a slower frame is a heavier one
    law = draw.choice("with friction", "without friction")
    slots = {
        "base_inv": inverse,
        "base_w": 2 * np.pi * f,
        "base_zeta": zeta,
        "base_friction": float(law == "with friction"),
    }
    text = "frame of mass mb on spring and damper, encoders and drive on it, reaction to the drive " + (
        "and to friction" if law == "with friction" else "only"
    )
    mass = {"mb": (1 / inverse, "kg")} if inverse > 0 else {}
    return Drawn(text, "base", slots, {**mass, "f": (f, "Hz"), "zeta": (zeta, "1")})


def offset(draw: Draw) -> Drawn:
    F0 = draw.sign() * draw.size("offset")
    law = draw.choice("motor", "load")
    slots = {f"F0_{law}": -F0}
    return Drawn(f"constant force -F0 on the {law}", "environment", slots, {"F0": (F0, "N")})


def cable_spring(draw: Draw) -> Drawn:
    law = draw.choice("stiffening", "slackening")
    kc, q0, L = draw.size("cable_spring"), draw.uniform(0.02, 0.09), draw.uniform(0.1, 0.25)
    text = {"stiffening": "-kc x (1 + (x/L)^2), x = q2 - q0", "slackening": "-kc L tanh(x/L), x = q2 - q0"}[law]
    slots = {"kc": kc, "kc_q0": q0, "kc_L": L, "kc_law": float(law == "slackening")}
    return Drawn(text, "environment", slots, {"kc": (kc, "N/m"), "q0": (q0, "m"), "L": (L, "m")})


def disturbance_pulses(draw: Draw) -> Drawn:
    enters = draw.choice("force", "volts")
    shape = draw.choice("half-sine", "trapezoid")
    A = draw.sign() * draw.size(f"disturbance_pulses/{enters}")
    n = int(draw.rng.integers(2, 6))
    t0, P = draw.uniform(1.1, 2.0), draw.uniform(1.1, 1.9)
    W = draw.uniform(0.15, 0.4)
    flip = draw.rng.random() < 0.4
    slots = {
        "pulse_F" if enters == "force" else "pulse_V": A,
        "pulse_law": float(shape == "trapezoid"),
        "pulse_t0": t0,
        "pulse_W": W,
        "pulse_P": P,
        "pulse_n": float(n) if A else 0.0,
        "pulse_flip": float(flip),
    }
    where = "force on the load" if enters == "force" else "volts added to the control law's output, recorded in vir"
    text = f"{n} {shape} pulses{', signs in turn' if flip else ''}, {where}"
    parameters = {
        "A": (A, "N" if enters == "force" else "V"),
        "t0": (t0, "s"),
        "W": (W, "s"),
        "P": (P, "s"),
        "n": (float(n), "1"),
    }
    block = "environment" if enters == "force" else "actuator"
    intervals = tuple((t0 + k * P, t0 + k * P + W) for k in range(n))
    return Drawn(text, block, slots, parameters, intervals=intervals)


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        coupling_damping,
        cubic_stiffness,
        backlash,
        transmission_error,
        second_flexible_mode,
        payload_change,
        base_flexibility,
        offset,
        cable_spring,
        disturbance_pulses,
    )
}
