"""Effects that no catalogue holds: the right diagnosis is "none of these"."""

import numpy as np

from .law import Draw, Drawn, Law


def x_dwell_friction(draw: Draw) -> Drawn:
    A, T, L = draw.size("x_dwell_friction"), draw.uniform(0.05, 0.3), draw.uniform(0.004, 0.012)
    if not draw.machine.rigid:
        A *= 0.5  # on each mass
    text = "Coulomb friction of each mass + A g; at rest g' = (1 - g)/T, in motion g decays over the travel L"
    slots = {"x_age_A": A, "x_age_T": T, "x_age_L": L}
    return Drawn(text, "motor side", slots, {"A": (A, "N"), "T": (T, "s"), "L": (L, "m")})


def x_position_stiffness(draw: Draw) -> Drawn:
    law = draw.choice("linear", "cosine")
    a, L = draw.sign() * draw.size("x_position_stiffness"), draw.uniform(0.08, 0.12)
    a = float(np.clip(a, -0.6, 2.0))
    text = {"linear": "K12 (1 + a q/L)", "cosine": "K12 (1 + a cos(2 pi q/L))"}[law]
    slots = {"x_kq": a, "x_kq_L": L, "x_kq_law": float(law == "cosine")}
    return Drawn(text, "coupling", slots, {"a": (a, "1"), "L": (L, "m")})


def x_missed_counts(draw: Draw) -> Drawn:
    a, rate = draw.size("x_missed_counts"), draw.uniform(0.5, 1.2)
    text = "the encoder loses or gains counts for good now and then: steps of about a, at random times"
    return Drawn(text, "sensor", {"x_jump": a, "x_jump_rate": rate}, {"a": (a, "m"), "rate": (rate, "1/s")})


def x_mains(draw: Draw) -> Drawn:
    A, f = draw.size("x_mains"), draw.uniform(49.95, 50.05)
    text = "force A sin(2 pi f t + p) on the motor, phase new in every record"
    slots = {"x_mains_F": A, "x_mains_f": f}
    return Drawn(text, "actuator", slots, {"A": (A, "N"), "f": (f, "Hz")}, record_phases=("x_mains_p",))


def x_notch(draw: Draw) -> Drawn:
    depth = min(draw.size("x_notch"), 1.0)
    f, zeta = draw.uniform(45, 110), draw.uniform(0.3, 0.7)
    text = "(s^2 + 2 zeta (1 - n) w s + w^2)/(s^2 + 2 zeta w s + w^2) in the drive, w = 2 pi f"
    slots = {"x_notch": depth, "x_notch_w": 2 * np.pi * f, "x_notch_zeta": zeta}
    return Drawn(text, "actuator", slots, {"n": (depth, "1"), "f": (f, "Hz"), "zeta": (zeta, "1")})


def x_encoder_play(draw: Draw) -> Drawn:
    w = draw.size("x_encoder_play")
    text = "the reading follows the motor with a play of +-w (encoder mount)"
    return Drawn(text, "sensor", {"x_play": w}, {"w": (w, "m")})


def x_rate_limiter(draw: Draw) -> Drawn:
    """The limit lies below the steepest command of the nominal runs by a share that grows with the size."""
    size = draw.size("x_rate_limiter")
    rate = draw.peak_slope * (1 - min(size, 0.15)) if size > 0 else 0.0
    slots = {"x_rate": rate}
    return Drawn("the drive follows commands at R at most", "actuator", slots, {"R": (rate, "V/s")} if rate else {})


def x_heat_viscous(draw: Draw) -> Drawn:
    a, T = draw.size("x_heat_viscous"), draw.uniform(0.5, 1.5)
    W = 1.5  # J
    text = "Fv/(1 + a w), w' = (friction power on the motor)/W - w/T: warmed by work, cooled at rest"
    slots = {"x_heat": a, "x_heat_T": T, "x_heat_W": W}
    return Drawn(text, "motor side", slots, {"a": (a, "1"), "T": (T, "s"), "W": (W, "J")})


def x_drag_memory(draw: Draw) -> Drawn:
    A, L = draw.size("x_drag_memory"), draw.uniform(0.006, 0.02)
    if not draw.machine.rigid:
        A *= 0.5
    text = "Coulomb friction of each mass + A w sgn v, w follows the direction over the travel L"
    return Drawn(text, "motor side", {"x_memory": A, "x_memory_L": L}, {"A": (A, "N"), "L": (L, "m")})


def x_ball_passing(draw: Draw) -> Drawn:
    A = draw.size("x_ball_passing")
    text = "Coulomb friction of the motor + A sin(2 pi q/(0.4 lead) + p)"
    return Drawn(text, "motor side", {"x_ball": A, "x_ball_p": draw.phase()}, {"A": (A, "N")})


def x_dropped_commands(draw: Draw) -> Drawn:
    share, n = min(draw.size("x_dropped_commands"), 0.3), float(draw.rng.integers(3, 9))
    text = "the drive misses commands and holds the old one, n in a row, a share of all samples"
    return Drawn(text, "actuator", {"x_drop": share, "x_drop_n": n}, {"share": (share, "1"), "n": (n, "1")})


def x_relaxation(draw: Draw) -> Drawn:
    k, T = draw.size("x_relaxation"), draw.uniform(0.006, 0.03)
    K = k * draw.machine.base["K12"]
    text = "a Maxwell element beside the coupling: F' = K delta' - F/T"
    return Drawn(text, "coupling", {"x_relax_K": K, "x_relax_T": T}, {"K": (K, "N/m"), "T": (T, "s")})


def x_supply_sag(draw: Draw) -> Drawn:
    a, T = draw.size("x_supply_sag"), draw.uniform(0.1, 0.6)
    text = "gain (1 - a s), s the mean of |V| over T: the supply sags under load"
    return Drawn(text, "actuator", {"x_sag": a, "x_sag_T": T}, {"a": (a, "1/V"), "T": (T, "s")})


def x_dac_steps(draw: Draw) -> Drawn:
    step = draw.size("x_dac_steps")
    return Drawn("the drive resolves the command in coarse steps", "actuator", {"x_dac": step}, {"step": (step, "V")})


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        x_dwell_friction,
        x_position_stiffness,
        x_missed_counts,
        x_mains,
        x_notch,
        x_encoder_play,
        x_rate_limiter,
        x_heat_viscous,
        x_drag_memory,
        x_ball_passing,
        x_dropped_commands,
        x_relaxation,
        x_supply_sag,
        x_dac_steps,
    )
}
