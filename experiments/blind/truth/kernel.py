"""The loop over controller samples: read, compute, hold, and move the masses through the sample in fixed steps.

A step is drift, kick, drift: positions half a step, speeds a whole step with the friction impulse in closed form,
positions half a step. It is of second order where friction is smooth, and a mass at rest in its cone stays at exactly
zero speed.
"""

import math

import numpy as np
from numba import njit

from .coupling import coupling_force, pitch_error
from .drive import bent, delay, lagged, notched, saturated, without_small_volts
from .environment import cable, cogging, mains, payload, pulse
from .friction import BRISTLES, cone, slide, warming
from .sensor import HISTORY, counted, periodic_error, speed

STILL = 2e-5  # m/s: slower counts as dwelling
COMMANDS = 16  # forces kept for the delay


@njit(cache=True)
def _ageing(p, age, v, h):
    """Growth of a contact at rest, decay over the travel that renews it."""
    if p.x_age_A == 0.0:
        return 0.0
    if abs(v) < STILL:
        return age + (1.0 - age) * h / p.x_age_T
    return age / (1.0 + abs(v) * h / p.x_age_L)


@njit(cache=True)
def run(params, qg, motor_noise, load_noise, jitter, jumps, dropped, ideal):
    """One run from rest at qg[0]. Noise in N, jitter and jumps of the encoder in m, `dropped` marks lost commands.

    -> (qm, ql, u, q1, v1, q2, v2): readings in m, the recorded command in V, true states at the samples. `ideal` leaves
    out the encoder's own count (a coarser grid, which is an effect, stays).
    """
    p = params[0]
    n = qg.size
    rigid = p.rigid != 0.0
    steps = int(p.substeps)
    h = p.dt / steps
    out_qm, out_ql, out_u = np.empty(n), np.empty(n), np.empty(n)
    out_q1, out_v1, out_q2, out_v2 = np.empty(n), np.empty(n), np.empty(n), np.empty(n)

    q1 = q2 = q3 = qg[0]
    v1 = v2 = v3 = 0.0
    qb = vb = 0.0  # frame
    f1 = f2 = 0.0  # friction of the step before, on the masses
    relaxing = 0.0
    age1 = age2 = memory = heat = sag = 0.0
    z1, z2 = np.zeros(BRISTLES), np.zeros(BRISTLES)
    lag, notch, filtered = np.zeros(2), np.zeros(2), np.zeros(2)
    past, commands = np.zeros(HISTORY), np.zeros(COMMANDS)
    played = q1
    command = 0.0
    if p.te_a != 0.0:  # the screw is assembled without stretch at the start
        q2 = q3 = q1 + pitch_error(p, q1)[0]

    for k in range(n):
        # read
        played = min(max(played, q1 - p.x_play), q1 + p.x_play)
        y = played + periodic_error(p, q1) + jumps[k]
        if p.encoder_late != 0.0:
            y -= p.encoder_late * v1
        if not ideal:
            y = counted(y + jitter[k], p.resolution, p.encoder_law)
        if p.grid > 0.0:
            y = counted(y, p.grid, p.grid_law)
        if k == 0:
            past[:] = y
        past[k % HISTORY] = y
        # compute: the contract's law
        kp, kv = p.kp * (1.0 + p.e_kp), p.kv * (1.0 + p.e_kv)
        u = kv * (kp * (qg[k] - y) - speed(p, past, k, filtered))
        u += p.pulse_V * pulse(p, k * p.dt)
        out_qm[k], out_u[k] = y, u
        out_ql[k] = q2 if ideal else counted(q2, p.resolution, p.encoder_law)
        out_q1[k], out_v1[k], out_q2[k], out_v2[k] = q1, v1, q2, v2
        # hold
        if not dropped[k]:
            wanted = u
            if p.x_dac > 0.0:
                wanted = math.floor(wanted / p.x_dac + 0.5) * p.x_dac
            if p.x_rate > 0.0:
                reach = p.x_rate * p.dt
                wanted = min(max(wanted, command - reach), command + reach)
            command = wanted
        c = saturated(p, notched(p, command, notch))
        c = bent(p, without_small_volts(p, c))
        tau_k = p.g * (1.0 + p.e_g) * c
        if p.x_sag != 0.0:
            sag += (abs(c) - sag) * p.dt / p.x_sag_T
            tau_k *= 1.0 - p.x_sag * sag
        commands[k % COMMANDS] = tau_k
        late = delay(p, k * p.dt) / p.dt
        whole = int(late)
        newer = commands[(k - whole) % COMMANDS]
        older = commands[(k - whole - 1) % COMMANDS]
        # move
        for j in range(steps):
            t = k * p.dt + (j + 0.5) * h
            tau = newer
            if late > 0.0:
                w = min(max((late - whole) * steps - j, 0.0), 1.0)
                tau = w * older + (1.0 - w) * newer
            tau = lagged(p, lag, tau, h)
            q1 += 0.5 * h * v1
            q2 += 0.5 * h * v2
            q3 += 0.5 * h * v3
            qb += 0.5 * h * vb

            on_motor = tau + motor_noise[k] + p.F0_motor - cogging(p, q1) + mains(p, t)
            on_load = load_noise[k] + p.F0_load - cable(p, q2) + p.pulse_F * pulse(p, t)
            mass, flow = payload(p, t)
            on_load -= flow * v2
            if p.m3 > 0.0:
                a3 = p.m3_w * (p.m3_w * (q2 - q3) + 2.0 * p.m3_zeta * (v2 - v3))
                on_load -= p.m3 * a3
                v3 += h * a3
            m1, m2 = p.M1, p.M2 + mass
            Fs = 0.0
            if rigid:
                m1 += mass
                on_motor += on_load
                on_load = 0.0
            else:
                error, slope = pitch_error(p, q1)
                stretch, rate = q2 - q1 - error, v2 - v1 * (1.0 + slope)
                if p.x_relax_K != 0.0:
                    relaxing = (relaxing + h * p.x_relax_K * rate) / (1.0 + h / p.x_relax_T)
                Fs = coupling_force(p, stretch, rate, q2, relaxing)
                on_motor += Fs
                on_load -= Fs
            if p.base_inv > 0.0:
                push = -tau - p.base_friction * (f1 + f2)
                ab = p.base_inv * push - p.base_w * (p.base_w * qb + 2.0 * p.base_zeta * vb)
                vb += h * ab
                on_motor -= m1 * ab
                on_load -= m2 * ab

            Fv1, Fv2 = p.Fv1, p.Fv2
            if p.drift_v != 0.0:
                warm = 1.0 + p.drift_v * warming(p, t)
                Fv1 *= warm
                Fv2 *= warm
            if p.x_heat != 0.0:
                heat += h * (Fv1 * v1 * v1 + abs(f1 * v1)) / p.x_heat_W
                heat /= 1.0 + h / p.x_heat_T
                Fv1 /= 1.0 + p.x_heat * heat
                Fv2 /= 1.0 + p.x_heat * heat
            age1 = _ageing(p, age1, v1, h)
            if p.x_memory != 0.0:
                way = h * v1 / p.x_memory_L
                memory = (memory + way) / (1.0 + abs(way))
            hi, lo = cone(p, 0, p.Fc1, q1, v1, Fs, tau, t, age1, memory)
            new = slide(p, m1, Fv1, v1, on_motor, hi, lo, z1, h)
            f1 = m1 * (new - v1) / h - on_motor
            v1 = new
            if rigid:
                v2 = v1
                q1 += 0.5 * h * v1
                q2 = q1
            else:
                age2 = _ageing(p, age2, v2, h)
                hi, lo = cone(p, 1, p.Fc2, q2, v2, Fs, tau, t, age2, memory)
                new = slide(p, m2, Fv2, v2, on_load, hi, lo, z2, h)
                f2 = m2 * (new - v2) / h - on_load
                v2 = new
                q1 += 0.5 * h * v1
                q2 += 0.5 * h * v2
            q3 += 0.5 * h * v3
            qb += 0.5 * h * vb
    return out_qm, out_ql, out_u, out_q1, out_v1, out_q2, out_v2
