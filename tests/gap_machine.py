"""A drive for the tests of the diagnosis, in plain numpy: neither its laws nor its integration are the package's."""

import math
from collections.abc import Callable

import numpy as np

from didim_jax.machine import Machine
from didim_jax.recording import Recording

N = 3000
"""Samples of every record: one length, so that each program compiles once."""

CUT = 400
"""Samples of the machine's own run before a record begins: it begins in motion."""

_SUBSTEPS = 8


def path(number: int = 0) -> np.ndarray:
    """Reference positions, m, of N + CUT samples: a stroke of 0.1 m, slower and faster, with a ripple on the way."""
    t = 1e-3 * np.arange(N + CUT)
    slow, fast, ripple = ((0.55, 1.1, 7.0), (0.45, 0.95, 6.0), (0.62, 1.25, 8.0))[number]
    stroke = 0.03 * (1 - np.cos(2 * np.pi * slow * t)) + 0.02 * (1 - np.cos(2 * np.pi * fast * t))
    return stroke + 3e-4 * (1 - np.cos(2 * np.pi * ripple * t))


def record(
    machine: Machine,
    qg: np.ndarray,
    *,
    rubs: Callable[[float, float], float] = lambda q, v: 0.0,
    drives: Callable[[float], float] = lambda volts: volts,
    noise: float = 1.0,
    seed: int = 0,
    with_load: bool = False,
) -> Recording:
    """Run the documented law on a drive of 95 kg (60 + 35 kg on 7e5 N/m where flexible) and keep all but the beginning.

    `rubs` is a friction force (N, against positive motion) beyond 200 N s/m and 20 N, by position (m) and velocity
    (m/s) of the motor side; `drives` makes of the commanded volts those that the motor gets. The noise (N rms, one
    value a sample) is a force on the motor side that no channel shows.
    """
    c, grid = machine.controller, machine.encoder.resolution
    gain, limit, dt = machine.drive.gain, machine.drive.limit, machine.controller.sample_time
    flexible = machine.model == "flexible"
    m1, m2, stiffness, damping = (60.0, 35.0, 7e5, 20.0) if flexible else (95.0, 1.0, 0.0, 0.0)
    pushed = np.random.default_rng(seed).normal(0.0, noise, len(qg))
    q1 = q2 = float(qg[0])
    v1 = v2 = 0.0
    h = dt / _SUBSTEPS
    qm, ql, vir = (np.zeros(len(qg)) for _ in range(3))

    def rates(force: float, q1: float, v1: float, q2: float, v2: float) -> tuple[float, float]:
        friction = 200.0 * v1 + 20.0 * v1 / math.sqrt(v1 * v1 + 1.6e-7) + rubs(q1, v1)
        spring = stiffness * (q2 - q1) + damping * (v2 - v1)
        return (force - friction + spring) / m1, -spring / m2

    for k in range(len(qg)):
        qm[k], ql[k] = grid * round(q1 / grid), grid * round(q2 / grid)
        dq = (qm[k] - qm[max(k - 2, 0)]) / (2 * dt)
        vir[k] = c.kv * (c.kp * (qg[k] - qm[k]) - dq)
        force = gain * min(max(drives(vir[k]), -limit), limit) + pushed[k]
        for _ in range(_SUBSTEPS):  # the midpoint rule
            a1, a2 = rates(force, q1, v1, q2, v2)
            w1, w2 = v1 + 0.5 * h * a1, v2 + 0.5 * h * a2
            a1, a2 = rates(force, q1 + 0.5 * h * v1, w1, q2 + 0.5 * h * v2, w2)
            q1, q2, v1, v2 = q1 + h * w1, q2 + h * w2, v1 + h * a1, v2 + h * a2
    kept = slice(CUT, None)
    return Recording(
        t=dt * np.arange(len(qg) - CUT),
        qg=qg[kept],
        qm=qm[kept],
        vir=vir[kept],
        gain=gain,
        ql=ql[kept] if with_load else None,
        name=f"machine, seed {seed}",
        synthetic=True,
        documented={"kp": c.kp, "kv": c.kv},
    )
