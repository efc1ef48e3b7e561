"""Force of the coupling between motor side and load side, N; stretch in m, its rate in m/s."""

import math

from numba import njit

STRETCH = 50e-6  # m: where k3 is quoted


@njit(cache=True)
def pitch_error(p, q):
    """Kinematic error of the screw, m, and its slope: e = a sin(phi + p) + a2 sin(2 phi + p2), phi = 2 pi q/lead."""
    if p.te_a == 0.0:
        return 0.0, 0.0
    turn = 2.0 * math.pi / p.lead
    one, two = turn * q + p.te_p, 2.0 * turn * q + p.te_p2
    slope = turn * (p.te_a * math.cos(one) + 2.0 * p.te_a2 * math.cos(two))
    return p.te_a * math.sin(one) + p.te_a2 * math.sin(two), slope


@njit(cache=True)
def stiffness(p, q):
    """K12 in N/m at position q."""
    if p.x_kq == 0.0:
        return p.K12
    x = q / p.x_kq_L
    return p.K12 * (1.0 + p.x_kq * (x if p.x_kq_law == 0.0 else math.cos(2.0 * math.pi * x)))


@njit(cache=True)
def coupling_force(p, stretch, rate, q, relaxing):
    """Force on the motor side; its opposite acts on the load. The nominal law is K12 stretch + C12 rate."""
    d = stretch
    if p.b > 0.0:
        if abs(d) <= p.b:
            return p.b_C * rate
        d -= math.copysign(p.b, d)
    K = stiffness(p, q)
    F = K * d
    if p.k3 != 0.0:
        x = (d / STRETCH) ** 2
        F += K * d * p.k3 * (x if p.k3_law == 0.0 else math.tanh(x))
    damping = p.C12 * rate
    if p.C != 0.0:
        damping += p.C * (rate if p.C_law == 0.0 else rate * (abs(rate) / 0.005) ** 0.25)
    if p.eta != 0.0:
        damping += p.eta * K * abs(d) * rate / (abs(rate) + 0.0005)
    F += damping + relaxing
    if p.b > 0.0 and p.b_law == 1.0 and F * d < 0.0:
        return 0.0  # contact does not pull
    return F
