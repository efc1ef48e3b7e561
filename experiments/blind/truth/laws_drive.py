"""Effects of controller, actuator and sensor: how each is drawn."""

from .law import Draw, Drawn, Law
from .machine import LIMIT, RESOLUTION


def position_gain(draw: Draw) -> Drawn:
    e = draw.sign() * draw.size("position_gain")
    return Drawn("kp (1 + e)", "controller", {"e_kp": e}, {"e": (e, "1")})


def velocity_gain(draw: Draw) -> Drawn:
    e = draw.sign() * draw.size("velocity_gain")
    return Drawn("kv (1 + e), of the whole law", "controller", {"e_kv": e}, {"e": (e, "1")})


def velocity_filter(draw: Draw) -> Drawn:
    if draw.choice("lag", "window") == "lag":
        T = draw.size("velocity_filter/lag")
        text = "dq behind a first-order Butterworth, 1/(1 + T s), bilinear"
        return Drawn(text, "controller", {"vf_T": T}, {"T": (T, "s")})
    L = min(2.0 + draw.size("velocity_filter/window"), 30.0)
    text = "dq = (y(t) - y(t - L dt))/(L dt), moving average over L samples, y linear between readings"
    return Drawn(text, "controller", {"vf_L": L}, {"L": (L, "1")})


def amplifier_lag(draw: Draw) -> Drawn:
    T = draw.size("amplifier_lag")
    law = draw.choice("two lags", "uneven")
    text = {
        "two lags": "two lags of T/2 one behind the other",
        "uneven": "one lag, 0.85 T when the force grows and 1.15 T when it falls",
    }[law]
    return Drawn(text, "actuator", {"lag_T": T, "lag_law": float(law == "uneven")}, {"T": (T, "s")})


def time_delay(draw: Draw) -> Drawn:
    T = min(draw.size("time_delay"), 8e-3)
    law = draw.choice("constant", "beating")
    beat = draw.uniform(0.15, 0.3) if law == "beating" and T > 0 else 0.0
    slots = {"delay_T": T, "delay_beat": beat, "delay_period": draw.uniform(0.3, 1.5)}
    text = "tau(t - T), T not whole in samples"
    if beat:
        text += ", beating by a saw tooth of relative height b (two clocks)"
        return Drawn(text, "actuator", slots, {"T": (T, "s"), "b": (beat, "1")})
    return Drawn(text, "actuator", slots, {"T": (T, "s")})


def saturation(draw: Draw) -> Drawn:
    """The limit lies below the peak of the nominal runs by a share that grows with the size."""
    law = draw.choice("hard", "knee")
    low, n = draw.size("saturation"), draw.uniform(6, 14)
    u = draw.peak_volts * (1 - min(low, 0.4)) if low > 0 else 0.0
    text = {"hard": "clipped at u", "knee": "V / (1 + |V/u|^n)^(1/n)"}[law]
    slots = {"sat_u": u, "sat_n": n, "sat_law": float(law == "knee")}
    parameters = {"u": (u or LIMIT, "V")} | ({"n": (n, "1")} if law == "knee" else {})
    return Drawn(text, "actuator", slots, parameters)


def amplifier_dead_zone(draw: Draw) -> Drawn:
    law = draw.choice("tanh", "hyperbola")
    d = draw.size("amplifier_dead_zone")
    text = {
        "tanh": "V - d tanh(V/(0.6 d))",
        "hyperbola": "dead zone d, corners rounded by a hyperbola of width d/4",
    }[law]
    return Drawn(text, "actuator", {"dz_u": d, "dz_law": float(law == "hyperbola")}, {"d": (d, "V")})


def gain_nonlinearity(draw: Draw) -> Drawn:
    law = draw.choice("tanh", "bend")
    k = draw.size(f"gain_nonlinearity/{law}")
    text = {"tanh": "tanh(k V)/k", "bend": "V (1 - k u0 (V/u0)^2/(1 + |V|/u0)), u0 = 3 V"}[law]
    return Drawn(text, "actuator", {"gn_k": k, "gn_law": float(law == "bend")}, {"k": (k, "1/V")})


def drive_gain(draw: Draw) -> Drawn:
    e = draw.sign() * draw.size("drive_gain")
    return Drawn("tau = (1 + e) g V", "actuator", {"e_g": e}, {"e": (e, "1")})


def cogging(draw: Draw) -> Drawn:
    A = draw.size("cogging")
    three = draw.choice("two", "three") == "three"
    A2 = A * draw.uniform(0.1, 0.4)
    A3 = A * draw.uniform(0.1, 0.3) if three else 0.0
    slots = {"cog_1": A, "cog_2": A2, "cog_3": A3}
    slots |= {f"cog_p{n}": draw.phase() for n in (1, 2, 3)}
    text = f"-sum of A_n sin(n phi + p_n), n = 1 to {3 if three else 2}, phi = 2 pi q1/lead"
    parameters = {"A": (A, "N"), "A2": (A2, "N"), "p": (slots["cog_p1"], "rad")}
    return Drawn(text, "actuator", slots, parameters | ({"A3": (A3, "N")} if three else {}))


def encoder_periodic_error(draw: Draw) -> Drawn:
    a = draw.size("encoder_periodic_error")
    law = draw.choice("two lines", "bent")
    a2 = a * draw.uniform(0.05, 0.15) if law == "two lines" else 0.0
    bend = draw.uniform(0.1, 0.25) if law == "bent" else 0.0
    text = {
        "two lines": "qm = q + a sin(phi + p) + a2 sin(2 phi + p2); phases new in every record",
        "bent": "qm = q + a sin(phi + p + m sin phi); phase new in every record",
    }[law]
    slots = {"enc_a": a, "enc_a2": a2, "enc_mod": bend}
    extra = {"a2": (a2, "m")} if a2 else {"m": (bend, "1")}
    return Drawn(text, "sensor", slots, {"a": (a, "m"), **extra}, record_phases=("enc_p", "enc_p2"))


def encoder_quantisation(draw: Draw) -> Drawn:
    law = draw.choice("downwards", "to the nearest")
    size = draw.size("encoder_quantisation")
    step = round(size / RESOLUTION) * RESOLUTION if size > 0 else 0.0
    slots = {"grid": step, "grid_law": float(law == "to the nearest")}
    return Drawn(f"qm rounded {law} on a grid", "sensor", slots, {"grid": (step or RESOLUTION, "m")})


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        position_gain,
        velocity_gain,
        velocity_filter,
        amplifier_lag,
        time_delay,
        saturation,
        amplifier_dead_zone,
        gain_nonlinearity,
        drive_gain,
        cogging,
        encoder_periodic_error,
        encoder_quantisation,
    )
}
