"""The drive between the command and the force: what it does to a sample (volts), and its dynamics between samples."""

import math

from numba import njit


@njit(cache=True)
def saturated(p, u):
    """The drive's known limit, and a lower real one: hard, or with a knee u / (1 + |u/u_max|^n)^(1/n)."""
    u = min(max(u, -p.limit), p.limit)
    if p.sat_u > 0.0:
        if p.sat_law == 0.0:
            return min(max(u, -p.sat_u), p.sat_u)
        return u / (1.0 + (abs(u) / p.sat_u) ** p.sat_n) ** (1.0 / p.sat_n)
    return u


@njit(cache=True)
def without_small_volts(p, u):
    """Dead zone with rounded corners: u - d tanh(u/(0.6 d)), or a hyperbola of asymptotes |u| = d."""
    d = p.dz_u
    if d <= 0.0:
        return u
    if p.dz_law == 0.0:
        return u - d * math.tanh(u / (0.6 * d))
    r2 = 4.0 * (0.25 * d) ** 2
    x = abs(u) - d
    y = 0.5 * (x + math.sqrt(x * x + r2)) - 0.5 * (-d + math.sqrt(d * d + r2))
    return math.copysign(y, u)


@njit(cache=True)
def bent(p, u):
    """Gain that falls with the volts: u_s tanh(u/u_s) with 1/u_s = k, or u (1 - k u0 (|u|/u0)^2 / (1 + |u|/u0))."""
    if p.gn_k == 0.0:
        return u
    if p.gn_law == 0.0:
        return math.tanh(p.gn_k * u) / p.gn_k
    x = abs(u) / 3.0
    return u * (1.0 - 3.0 * p.gn_k * x * x / (1.0 + x))


@njit(cache=True)
def lagged(p, x, tau, h):
    """Mean force over a step h behind two lags (T/2 each; or one that falls slower than it rises). Steps x."""
    if p.lag_T <= 0.0:
        return tau
    if p.lag_law == 0.0:
        a = 1.0 - math.exp(-2.0 * h / p.lag_T)
        old = x[1]
        first = x[0] + a * (tau - x[0])
        x[1] += a * (0.5 * (x[0] + first) - x[1])
        x[0] = first
        return 0.5 * (old + x[1])
    T = p.lag_T * (0.85 if abs(tau) > abs(x[0]) else 1.15)
    old = x[0]
    x[0] += (1.0 - math.exp(-h / T)) * (tau - x[0])
    return 0.5 * (old + x[0])


@njit(cache=True)
def delay(p, t):
    """Delay in s of the held command: constant, or beating as two clocks that drift past each other."""
    if p.delay_beat == 0.0:
        return p.delay_T + p.hold_late
    saw = 2.0 * ((t / p.delay_period) % 1.0) - 1.0
    return p.delay_T * (1.0 + p.delay_beat * saw) + p.hold_late


@njit(cache=True)
def notched(p, u, x):
    """Notch of a drive, bilinear: (s^2 + 2 z (1-n) w s + w^2) / (s^2 + 2 z w s + w^2), depth n. Steps x."""
    if p.x_notch == 0.0:
        return u
    c = p.x_notch_w / math.tan(0.5 * p.x_notch_w * p.dt)
    w2, c2 = p.x_notch_w**2, c * c
    top = 2.0 * p.x_notch_zeta * (1.0 - p.x_notch) * p.x_notch_w * c
    low = 2.0 * p.x_notch_zeta * p.x_notch_w * c
    a0, a1, a2 = c2 + low + w2, 2.0 * (w2 - c2), c2 - low + w2
    b0, b1, b2 = c2 + top + w2, a1, c2 - top + w2
    y = (b0 * u + x[0]) / a0
    x[0] = b1 * u - a1 * y + x[1]
    x[1] = b2 * u - a2 * y
    return y
