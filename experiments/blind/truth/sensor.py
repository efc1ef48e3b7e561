"""The motor encoder: what is read for a position, and what a controller makes of the readings."""

import math

from numba import njit

HISTORY = 32  # readings kept for the speed estimate


@njit(cache=True)
def periodic_error(p, q):
    """a sin(phi + p + m sin phi) + a2 sin(2 phi + p2), m; phi = 2 pi q/lead."""
    if p.enc_a == 0.0:
        return 0.0
    phi = 2.0 * math.pi * q / p.lead
    bend = p.enc_mod * math.sin(phi) if p.enc_mod != 0.0 else 0.0
    return p.enc_a * math.sin(phi + p.enc_p + bend) + p.enc_a2 * math.sin(2.0 * phi + p.enc_p2)


@njit(cache=True)
def counted(q, step, law):
    """q on a grid: downwards (0) or to the nearest line (1)."""
    return math.floor(q / step + (0.5 if law == 1.0 else 0.0)) * step


@njit(cache=True)
def speed(p, past, k, filtered):
    """Speed estimate in m/s from the readings past[k % HISTORY]; `filtered` is the state of a filter after it.

    Nominal: (y[k] - y[k-2]) / (2 dt). Another filter: a first-order Butterworth of time constant T behind it, or a
    difference over a window of L > 2 samples, L not whole.
    """
    y = past[k % HISTORY]
    if p.vf_L > 2.0:
        n = int(p.vf_L)
        f = p.vf_L - n
        old = (1.0 - f) * past[(k - n) % HISTORY] + f * past[(k - n - 1) % HISTORY]
        return (y - old) / (p.vf_L * p.dt)
    dq = (y - past[(k - 2) % HISTORY]) / (2.0 * p.dt)
    if p.vf_T > 0.0:
        a = 2.0 * p.vf_T / p.dt
        out = (dq + filtered[0] + (a - 1.0) * filtered[1]) / (1.0 + a)
        filtered[0], filtered[1] = dq, out
        return out
    return dq
