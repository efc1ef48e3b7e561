"""Forces from outside and of the motor's magnets, N; positions in m, times in s of the machine's own run."""

import math

from numba import njit


@njit(cache=True)
def cogging(p, q):
    """Sum of a_n sin(n phi + p_n), n = 1 to 3, phi = 2 pi q/lead; opposes the motor, whatever the direction."""
    if p.cog_1 == 0.0:
        return 0.0
    phi = 2.0 * math.pi * q / p.lead
    return (
        p.cog_1 * math.sin(phi + p.cog_p1)
        + p.cog_2 * math.sin(2.0 * phi + p.cog_p2)
        + p.cog_3 * math.sin(3.0 * phi + p.cog_p3)
    )


@njit(cache=True)
def cable(p, q):
    """Pull of a cable: kc x (1 + (x/L)^2), or kc L tanh(x/L), x = q - q0."""
    if p.kc == 0.0:
        return 0.0
    x = q - p.kc_q0
    if p.kc_law == 0.0:
        return p.kc * x * (1.0 + (x / p.kc_L) ** 2)
    return p.kc * p.kc_L * math.tanh(x / p.kc_L)


@njit(cache=True)
def pulse(p, t):
    """Train of pulse_n pulses of height 1: half-sines, or trapezoids with flanks of a fifth of the width."""
    if p.pulse_n == 0.0 or t < p.pulse_t0:
        return 0.0
    i = math.floor((t - p.pulse_t0) / p.pulse_P)
    x = (t - p.pulse_t0 - i * p.pulse_P) / p.pulse_W
    if i >= p.pulse_n or x >= 1.0:
        return 0.0
    high = math.sin(math.pi * x) if p.pulse_law == 0.0 else min(1.0, 5.0 * x, 5.0 * (1.0 - x))
    return -high if p.pulse_flip != 0.0 and i % 2 == 1 else high


@njit(cache=True)
def mains(p, t):
    """Interference from the mains."""
    if p.x_mains_F == 0.0:
        return 0.0
    return p.x_mains_F * math.sin(2.0 * math.pi * p.x_mains_f * t + p.x_mains_p)


@njit(cache=True)
def payload(p, t):
    """Mass on the load (kg), and its flow (kg/s) while it is poured on over dm_ramp."""
    if p.dm == 0.0 or t < p.dm_t0:
        return 0.0, 0.0
    if t < p.dm_t0 + p.dm_ramp:
        return p.dm * (t - p.dm_t0) / p.dm_ramp, p.dm / p.dm_ramp
    return p.dm, 0.0
