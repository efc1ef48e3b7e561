"""Friction effects: how each is drawn. Every function returns the effect at `draw.factor` times its typical size."""

from .law import Draw, Drawn, Law


def asymmetric_coulomb(draw: Draw) -> Drawn:
    share, block = draw.side()
    dFc, v = draw.sign() * draw.size("asymmetric_coulomb"), draw.uniform(0.001, 0.004)
    law = draw.choice("ramp", "saturating")
    text = {
        "ramp": "-dFc min(|v|/v0, 1): lives beyond a few mm/s",
        "saturating": "-dFc |v|/(|v| + v0)",
    }[law]
    slots = {"dFc": dFc, "dFc_v": v, "dFc_law": float(law == "saturating"), "dFc_share": share}
    return Drawn(text, block, slots, {"dFc": (dFc, "N"), "v0": (v, "m/s")})


def asymmetric_viscous(draw: Draw) -> Drawn:
    share, block = draw.side()
    dFv, v = draw.sign() * draw.size("asymmetric_viscous"), draw.uniform(0.005, 0.02)
    law = draw.choice("plain", "late")
    text = {"plain": "-dFv |v|", "late": "-dFv (|v| - v0 (1 - exp(-|v|/v0)))"}[law]
    slots = {"dFv": dFv, "dFv_law": float(law == "late"), "dFv_v": v, "dFv_share": share}
    return Drawn(text, block, slots, {"dFv": (dFv, "N s/m")} | ({"v0": (v, "m/s")} if law == "late" else {}))


def stribeck(draw: Draw) -> Drawn:
    share, block = draw.side()
    laws = ("dFs / (1 + (v/vs)^2)", "dFs exp(-|v|/vs)", "dFs / cosh(v/vs)")
    k = int(draw.rng.integers(len(laws)))
    dFs, vs = draw.size("stribeck"), draw.uniform(0.006, 0.022)
    slots = {"dFs": dFs, "vs": vs, "dFs_law": float(k), "dFs_share": share}
    return Drawn(f"excess over Coulomb {laws[k]}", block, slots, {"dFs": (dFs, "N"), "vs": (vs, "m/s")})


def quadratic_viscous(draw: Draw) -> Drawn:
    share, block = draw.side()
    c, p = draw.size("quadratic_viscous"), draw.uniform(1.8, 2.2)
    law = draw.choice("power", "late")
    text = {"power": "-c (0.1 m/s)^2 (|v|/(0.1 m/s))^p s", "late": "-c |v|^3/(|v| + 0.02 m/s) s"}[law]
    slots = {"quad_c": c, "quad_p": p, "quad_law": float(law == "late"), "quad_share": share}
    return Drawn(text, block, slots, {"c": (c, "N s2/m2")} | ({"p": (p, "1")} if law == "power" else {}))


def position_friction(draw: Draw) -> Drawn:
    share, block = draw.side()
    law = draw.choice("sine", "bowl", "tilt")
    A = draw.sign() * draw.size(f"position_friction/{law}")
    q0, L = {
        "sine": (draw.uniform(0.0, 0.1), draw.uniform(0.06, 0.11)),
        "bowl": (draw.uniform(0.03, 0.07), 0.06),
        "tilt": (draw.uniform(0.04, 0.07), 0.06),
    }[law]
    if law == "bowl":
        A = abs(A)
    text = {
        "sine": "Coulomb friction + A sin(pi (q - q0)/L)",
        "bowl": "Coulomb friction + A ((q - q0)/L)^2",
        "tilt": "Coulomb friction + A (q - q0)/L",
    }[law]
    code = float(("sine", "bowl", "tilt").index(law))
    slots = {"pf_A": A, "pf_law": code, "pf_q": q0, "pf_L": L, "pf_share": share}
    return Drawn(text, block, slots, {"A": (A, "N"), "q0": (q0, "m"), "L": (L, "m")})


def local_friction(draw: Draw) -> Drawn:
    share, block = draw.side()
    law = draw.choice("raised cosine", "triangle")
    A, q0, w = draw.size("local_friction"), draw.uniform(0.03, 0.055), draw.uniform(0.012, 0.03)
    slots = {"lf_A": A, "lf_law": float(law == "triangle"), "lf_q": q0, "lf_w": w, "lf_share": share}
    text = f"Coulomb friction + a {law} of height A about q0, half-width w"
    return Drawn(text, block, slots, {"A": (A, "N"), "q0": (q0, "m"), "w": (w, "m")})


def lead_friction(draw: Draw) -> Drawn:
    share, block = draw.side()
    A = draw.size("lead_friction")
    law = draw.choice("one line", "two lines")
    A2 = draw.uniform(0.2, 0.35) * A if law == "two lines" else 0.0
    slots = {"lead_A": A, "lead_A2": A2, "lead_p": draw.phase(), "lead_p2": draw.phase(), "lead_share": share}
    text = "Coulomb friction + A sin(phi + p)" + (" + A2 sin(2 phi + p2)" if A2 else "")
    parameters = {"A": (A, "N"), "p": (slots["lead_p"], "rad")}
    return Drawn(text, block, slots, parameters | ({"A2": (A2, "N")} if A2 else {}))


def presliding(draw: Draw) -> Drawn:
    laws = ("Dahl, z' = v (1 - |z/zs|^n sgn(v z))", "Maxwell-slip of four elements, reach zs on average",
            "elasto-plastic, elastic below 0.6 zs")  # fmt: skip
    k = int(draw.rng.integers(3))
    r = min(draw.size("presliding"), 1.0)
    zs = draw.uniform(60e-6, 250e-6) if r > 0 else 0.0
    C, n = draw.uniform(20, 80) * r, draw.uniform(1.0, 1.6)
    slots = {"zs": zs, "pre_r": r, "pre_law": float(k), "pre_C": C, "pre_n": n}
    text = f"{laws[k]}, for a share r of each mass's Coulomb force, the rest dry; micro-damping C exp(-(v/3 mm/s)^2)"
    block = "motor side" if draw.machine.rigid or draw.machine.base["Fc1"] > draw.machine.base["Fc2"] else "load side"
    parameters = {"zs": (zs, "m"), "r": (r, "1"), "C": (C, "N s/m")}
    return Drawn(text, block, slots, parameters | ({"n": (n, "1")} if k == 0 else {}))


def load_dependent_friction(draw: Draw) -> Drawn:
    share, block = draw.side()
    law = draw.choice("plain", "preloaded")
    mu, F = draw.size("load_dependent_friction"), draw.uniform(10, 30)
    force = "tau" if draw.machine.rigid else "Fs"
    text = {
        "plain": f"Coulomb friction + mu |{force}|",
        "preloaded": f"Coulomb friction + mu (sqrt({force}^2 + F^2) - F)",
    }[law]
    slots = {"mu": mu, "mu_law": float(law == "preloaded"), "mu_F": F, "mu_share": share}
    return Drawn(text, block, slots, {"mu": (mu, "1")} | ({"F": (F, "N")} if law == "preloaded" else {}))


def friction_drift(draw: Draw) -> Drawn:
    d = -draw.size("friction_drift") if draw.rng.random() < 0.8 else draw.size("friction_drift")
    law = draw.choice("exponential", "piecewise", "cubic")
    T = draw.uniform(2.0, 5.0) if law == "exponential" else draw.uniform(4.0, 9.0)
    d_c, d_v = d * draw.uniform(0.7, 1.2), d * draw.uniform(0.7, 1.2)
    text = {
        "exponential": "Fc (1 + d_c g), Fv (1 + d_v g), g = 1 - exp(-t/T)",
        "piecewise": "Fc (1 + d_c g), Fv (1 + d_v g), g = min(t/T, 1)",
        "cubic": "Fc (1 + d_c g), Fv (1 + d_v g), g = 1 - (1 - min(t/T, 1))^3",
    }[law]
    slots = {
        "drift_c": max(d_c, -0.9),
        "drift_v": max(d_v, -0.9),
        "drift_T": T,
        "drift_law": float(("exponential", "piecewise", "cubic").index(law)),
    }
    parameters = {"d_c": (slots["drift_c"], "1"), "d_v": (slots["drift_v"], "1"), "T": (T, "s")}
    return Drawn(text, "motor side", slots, parameters)


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        asymmetric_coulomb,
        asymmetric_viscous,
        stribeck,
        quadratic_viscous,
        position_friction,
        local_friction,
        lead_friction,
        presliding,
        load_dependent_friction,
        friction_drift,
    )
}
