"""The numbers that the kernel reads: one structured array of length 1, every effect at its null.

A field of a structured array keeps its name inside the compiled loop, and the type of the array is part of the compiled
function's signature. The last field carries a digest of the sources of the compiled functions, so that a change in any
of them is compiled anew and never served from the cache.
"""

import hashlib
from pathlib import Path

import numpy as np

COMPILED = ("kernel.py", "friction.py", "coupling.py", "drive.py", "sensor.py", "environment.py")

# SI units, load axis. `*_law` chooses a form, `*_share` is the motor side's share (1: motor only).
NULL: dict[str, float] = {
    # loop and numerics
    "dt": 1e-3,
    "substeps": 20.0,
    "rigid": 0.0,
    "smooth_law": 0.0,  # 0 set-valued, 1 arctan, 2 hyperbola
    "smooth_v": 0.0,
    "hold_late": 0.0,
    "encoder_late": 0.0,
    # base parameters
    "M1": 1.0,
    "Fv1": 0.0,
    "Fc1": 0.0,
    "M2": 1.0,
    "Fv2": 0.0,
    "Fc2": 0.0,
    "K12": 0.0,
    "C12": 0.0,
    "g": 35.15,
    "limit": 10.0,
    "lead": 0.0025,
    "resolution": 5e-8,
    "encoder_law": 0.0,  # 0 floor, 1 round
    # controller
    "kp": 0.0,
    "kv": 0.0,
    "e_kp": 0.0,
    "e_kv": 0.0,
    "vf_law": 0.0,
    "vf_T": 0.0,
    "vf_L": 2.0,
    # drive
    "e_g": 0.0,
    "lag_law": 0.0,
    "lag_T": 0.0,
    "delay_T": 0.0,
    "delay_beat": 0.0,
    "delay_period": 1.0,
    "sat_law": 0.0,
    "sat_u": 0.0,
    "sat_n": 8.0,
    "dz_law": 0.0,
    "dz_u": 0.0,
    "gn_law": 0.0,
    "gn_k": 0.0,
    # friction
    "dFc": 0.0,
    "dFc_law": 0.0,
    "dFc_v": 0.003,
    "dFc_share": 1.0,
    "dFv": 0.0,
    "dFv_law": 0.0,
    "dFv_v": 0.01,
    "dFv_share": 1.0,
    "dFs": 0.0,
    "vs": 0.01,
    "dFs_law": 0.0,
    "dFs_share": 1.0,
    "quad_c": 0.0,
    "quad_p": 2.0,
    "quad_law": 0.0,
    "quad_share": 1.0,
    "pf_A": 0.0,
    "pf_law": 0.0,
    "pf_q": 0.0,
    "pf_L": 0.1,
    "pf_share": 1.0,
    "lf_A": 0.0,
    "lf_law": 0.0,
    "lf_q": 0.0,
    "lf_w": 0.01,
    "lf_share": 1.0,
    "lead_A": 0.0,
    "lead_A2": 0.0,
    "lead_p": 0.0,
    "lead_p2": 0.0,
    "lead_share": 1.0,
    "mu": 0.0,
    "mu_law": 0.0,
    "mu_F": 0.0,
    "mu_share": 1.0,
    "drift_c": 0.0,
    "drift_v": 0.0,
    "drift_T": 1.0,
    "drift_law": 0.0,
    "zs": 0.0,
    "pre_r": 0.0,
    "pre_law": 0.0,
    "pre_C": 0.0,
    "pre_n": 1.0,
    # coupling
    "C": 0.0,
    "C_law": 0.0,
    "eta": 0.0,
    "k3": 0.0,
    "k3_law": 0.0,
    "b": 0.0,
    "b_C": 0.0,
    "b_law": 0.0,
    "te_a": 0.0,
    "te_a2": 0.0,
    "te_p": 0.0,
    "te_p2": 0.0,
    # further masses
    "m3": 0.0,
    "m3_w": 0.0,
    "m3_zeta": 0.0,
    "base_inv": 0.0,
    "base_w": 0.0,
    "base_zeta": 0.0,
    "base_friction": 0.0,
    "dm": 0.0,
    "dm_t0": 0.0,
    "dm_ramp": 0.0,
    # sensor
    "enc_a": 0.0,
    "enc_a2": 0.0,
    "enc_mod": 0.0,
    "enc_p": 0.0,
    "enc_p2": 0.0,
    "grid": 0.0,
    "grid_law": 0.0,
    # forces from outside
    "cog_1": 0.0,
    "cog_2": 0.0,
    "cog_3": 0.0,
    "cog_p1": 0.0,
    "cog_p2": 0.0,
    "cog_p3": 0.0,
    "F0_motor": 0.0,
    "F0_load": 0.0,
    "kc": 0.0,
    "kc_q0": 0.0,
    "kc_law": 0.0,
    "kc_L": 0.2,
    "pulse_F": 0.0,
    "pulse_V": 0.0,
    "pulse_law": 0.0,
    "pulse_t0": 0.0,
    "pulse_W": 1.0,
    "pulse_P": 2.0,
    "pulse_n": 0.0,
    "pulse_flip": 0.0,
    # outside the catalogue
    "x_age_A": 0.0,
    "x_age_T": 1.0,
    "x_age_L": 1.0,
    "x_kq": 0.0,
    "x_kq_law": 0.0,
    "x_kq_L": 0.1,
    "x_jump": 0.0,
    "x_jump_rate": 0.0,
    "x_mains_F": 0.0,
    "x_mains_f": 50.0,
    "x_mains_p": 0.0,
    "x_notch": 0.0,
    "x_notch_w": 0.0,
    "x_notch_zeta": 0.0,
    "x_play": 0.0,
    "x_rate": 0.0,
    "x_heat": 0.0,
    "x_heat_W": 1.0,
    "x_heat_T": 1.0,
    "x_memory": 0.0,
    "x_memory_L": 1.0,
    "x_ball": 0.0,
    "x_ball_p": 0.0,
    "x_drop": 0.0,
    "x_drop_n": 1.0,
    "x_relax_K": 0.0,
    "x_relax_T": 1.0,
    "x_sag": 0.0,
    "x_sag_T": 1.0,
    "x_dac": 0.0,
}


def _digest() -> str:
    folder = Path(__file__).parent
    return hashlib.sha256(b"".join((folder / name).read_bytes() for name in COMPILED)).hexdigest()[:12]


DTYPE = np.dtype([*((name, "f8") for name in NULL), (f"sources_{_digest()}", "f8")])


def slots(**values: float) -> np.ndarray:
    """The nominal machine with some numbers set. An unknown name is an error."""
    p = np.zeros(1, DTYPE)
    for name, null in NULL.items():
        p[name] = null
    return changed(p, **values)


def changed(p: np.ndarray, **values: float) -> np.ndarray:
    """A copy of `p` with some numbers set."""
    unknown = sorted(set(values) - set(NULL))
    if unknown:
        raise ValueError(f"The kernel reads no number named {', '.join(unknown)}.")
    p = p.copy()
    for name, value in values.items():
        p[name] = value
    return p
