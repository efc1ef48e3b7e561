"""Friction of one mass: the cone of the set-valued Coulomb law, what widens it, and one step of sliding or sticking.

The cone [-lo, hi] holds the friction force at rest; in motion the force is -hi (v > 0) or +lo (v < 0). Effects widen or
tilt the cone. Forces in N, speeds in m/s, positions in m.
"""

import math

from numba import njit

BRISTLES = 4  # elements of the Maxwell-slip model


@njit(cache=True)
def part(share, side):
    """Share of one side: the motor's for side 0, the rest for side 1."""
    return share if side == 0 else 1.0 - share


@njit(cache=True)
def warming(p, t):
    """Course of the warm-up, 0 at the start, towards 1."""
    if p.drift_law == 0.0:
        return 1.0 - math.exp(-t / p.drift_T)
    if p.drift_law == 1.0:
        return min(t / p.drift_T, 1.0)
    x = min(t / p.drift_T, 1.0)
    return 1.0 - (1.0 - x) ** 3


@njit(cache=True)
def stribeck(p, s):
    """Excess over Coulomb at speed s >= 0, 1 at rest."""
    x = s / p.vs
    if p.dFs_law == 0.0:
        return 1.0 / (1.0 + x * x)
    if p.dFs_law == 1.0:
        return math.exp(-x)
    return 1.0 / math.cosh(min(x, 50.0))


@njit(cache=True)
def cone(p, side, Fc, q, v, Fs, tau, t, age, memory):
    """(hi, lo) in N."""
    s = abs(v)
    m = Fc
    if p.drift_c != 0.0:
        m *= 1.0 + p.drift_c * warming(p, t)
    if p.dFs != 0.0:
        m += part(p.dFs_share, side) * p.dFs * stribeck(p, s)
    if p.quad_c != 0.0:
        # the power is v^2 at 0.1 m/s whatever its exponent
        drag = 0.01 * (s / 0.1) ** p.quad_p if p.quad_law == 0.0 else s * s * s / (s + 0.02)
        m += part(p.quad_share, side) * p.quad_c * drag
    if p.pf_A != 0.0:
        x = (q - p.pf_q) / p.pf_L
        if p.pf_law == 0.0:
            shape = math.sin(math.pi * x)
        elif p.pf_law == 1.0:
            shape = x * x
        else:
            shape = x
        m += part(p.pf_share, side) * p.pf_A * shape
    if p.lf_A != 0.0:
        x = abs(q - p.lf_q) / p.lf_w
        if x < 1.0:
            shape = 0.5 * (1.0 + math.cos(math.pi * x)) if p.lf_law == 0.0 else 1.0 - x
            m += part(p.lf_share, side) * p.lf_A * shape
    if p.lead_A != 0.0:
        phi = 2.0 * math.pi * q / p.lead
        wave = p.lead_A * math.sin(phi + p.lead_p) + p.lead_A2 * math.sin(2.0 * phi + p.lead_p2)
        m += part(p.lead_share, side) * wave
    if p.mu != 0.0:
        load = abs(tau) if p.rigid != 0.0 else abs(Fs)
        if p.mu_law == 1.0:
            load = math.sqrt(load * load + p.mu_F * p.mu_F) - p.mu_F
        m += part(p.mu_share, side) * p.mu * load
    if p.x_ball != 0.0 and side == 0:
        m += p.x_ball * math.sin(2.0 * math.pi * q / (0.4 * p.lead) + p.x_ball_p)
    m += p.x_age_A * age
    a = 0.0
    if p.dFc != 0.0:
        onset = min(s / p.dFc_v, 1.0) if p.dFc_law == 0.0 else s / (s + p.dFc_v)
        a += part(p.dFc_share, side) * p.dFc * onset
    if p.dFv != 0.0:
        slow = 0.0 if p.dFv_law == 0.0 else p.dFv_v * (1.0 - math.exp(-s / p.dFv_v))
        a += part(p.dFv_share, side) * p.dFv * (s - slow)
    a += p.x_memory * memory
    return max(m + a, 0.0), max(m - a, 0.0)


@njit(cache=True)
def rounded_sign(p, v):
    """A smooth sign of another shape than tanh, of width smooth_v."""
    if p.smooth_law == 1.0:
        return math.atan(v / p.smooth_v) * 2.0 / math.pi
    return v / math.sqrt(v * v + p.smooth_v * p.smooth_v)


@njit(cache=True)
def presliding(p, z, v, h):
    """Friction force over its cone, in [-1, 1], of bristles z (m) that are stretched over the length zs; steps z.

    0: Dahl with exponent pre_n, z' = v (1 - |z/zs|^n sgn(v z)). 1: Maxwell-slip, BRISTLES elements of equal strength
    that yield one after another. 2: elasto-plastic, elastic below 0.6 zs, then Dahl over what is left.
    """
    if p.pre_law == 1.0:
        total = 0.0
        for i in range(BRISTLES):
            reach = p.zs * (i + 0.5) * 2.0 / BRISTLES
            z[i] = min(max(z[i] + h * v, -reach), reach)
            total += z[i] / reach
        return total / BRISTLES
    x = z[0] / p.zs
    if x * v < 0.0:
        yielding = -(abs(x) ** p.pre_n) if p.pre_law == 0.0 else 0.0
    elif p.pre_law == 0.0:
        yielding = abs(x) ** p.pre_n
    else:
        yielding = min(max((abs(x) - 0.6) / 0.4, 0.0), 1.0)
        yielding = yielding * yielding * (3.0 - 2.0 * yielding)
    z[0] = min(max(z[0] + h * v * (1.0 - yielding), -p.zs), p.zs)
    return z[0] / p.zs


@njit(cache=True)
def slide(p, M, Fv, v, force, hi, lo, z, h):
    """Speed after a step h under `force` and friction: the impulse that stops the mass, if the cone holds it.

    M dv = h (force - Fv v) + impulse, viscous part by the trapezoidal rule, -h hi <= impulse <= h lo.
    """
    if p.zs > 0.0:
        size = hi if v > 0.0 else lo
        force -= p.pre_r * size * presliding(p, z, v, h) + p.pre_C * v * math.exp(-((v / 0.003) ** 2))
        hi *= 1.0 - p.pre_r
        lo *= 1.0 - p.pre_r
    if p.smooth_law != 0.0:
        force -= (hi if v > 0.0 else lo) * rounded_sign(p, v)
        hi = lo = 0.0
    heavy = M + 0.5 * h * Fv
    free = (M * v + h * (force - 0.5 * Fv * v)) / heavy
    if free > h * hi / heavy:
        return free - h * hi / heavy
    if free < -h * lo / heavy:
        return free + h * lo / heavy
    return 0.0
