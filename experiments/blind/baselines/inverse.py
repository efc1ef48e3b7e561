"""The nominal drive by inverse dynamics: motor force by least squares on the recorded motion, no simulation.

With G the load side's resonance, (1 + c p) / (1 + c p + p^2 / w^2), the flexible drive is as linear as the rigid one::

    tau = M1 a + Fv1 v + Fc1 s + G (M2 a + Fv2 v + Fc2 s) + load's free swing

w is the best of a grid. The force is averaged over the samples before and after each position, as a held one acts.
Force and columns are compared after the same filters: a low-pass, and a notch at w, where the inverse model multiplies
every error by the height of the resonance.
"""

import dataclasses

import numpy as np
import scipy.signal

from didim_jax.machine import Machine
from didim_jax.recording import Recording
from didim_jax.signals import Decimation, central_difference

CUTOFF_HZ = 60.0
V_EPS = 5e-4
"""Speed of the smooth sign, m/s: a rival does not fit it."""
DAMPING = 0.01
"""Of the load side's resonance, from the friction of its guides and the coupling's own, against critical."""


@dataclasses.dataclass(frozen=True, eq=False)
class Inverse:
    """A record's inverse model: every sample of motion and force, (n,), and the nominal fit, filtered and decimated.

    `residual` (n_decimated,) is what the nominal columns leave, `basis` (n_decimated, k) spans those columns; both
    are `filtered`.
    """

    recording: Recording
    machine: Machine
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    s: np.ndarray
    f_n: float
    M1: float
    M2: float
    Fv: float
    Fc: float
    decimation: Decimation
    basis: np.ndarray
    residual: np.ndarray

    @property
    def dt(self) -> float:
        """Sample time, s."""
        return self.machine.controller.sample_time

    @property
    def flexible(self) -> bool:
        """Whether the drive has a coupling."""
        return self.machine.model == "flexible"

    @property
    def t(self) -> np.ndarray:
        """Time since the first sample, s."""
        return self.dt * np.arange(len(self.q))

    def filtered(self, x: np.ndarray) -> np.ndarray:
        """Signals (n, ...) as they are compared, (n_decimated, ...)."""
        return self.decimation(notched(x, self.f_n, self.dt) if self.flexible else x)

    def to_load(self, x: np.ndarray, damping: float = DAMPING) -> np.ndarray:
        """G x: what a force or motion on the load side is on the motor side; x itself where the drive is rigid."""
        return through_load(x, self.f_n, self.dt, damping) if self.flexible else x

    def moved(self, x: np.ndarray) -> np.ndarray:
        """Force (N) of an acceleration (m/s2) of the whole drive besides the one recorded."""
        return self.M1 * x + self.M2 * self.to_load(x)

    @property
    def transmitted(self) -> np.ndarray:
        """Force in the coupling, N. Half of the friction is taken to be behind it: the record hardly says."""
        return self.to_load(self.M2 * self.a + 0.5 * self.Fv * self.v + 0.5 * self.Fc * self.s)


def through_load(x: np.ndarray, f_n: float, dt: float, damping: float) -> np.ndarray:
    """The load side's resonance at f_n (Hz), settled at the first sample."""
    w = 2 * np.pi * f_n
    b, a = scipy.signal.bilinear([2 * damping / w, 1.0], [1 / w**2, 2 * damping / w, 1.0], 1 / dt)
    return np.asarray(scipy.signal.lfilter(b, a, x, zi=scipy.signal.lfilter_zi(b, a) * x[0])[0])


def notched(x: np.ndarray, f_n: float, dt: float) -> np.ndarray:
    """1 / G at f_n (Hz) over a resonance of the same frequency that is well damped, along the first axis."""
    w = 2 * np.pi * f_n
    b, a = scipy.signal.bilinear([1 / w**2, 2 * DAMPING / w, 1.0], [1 / w**2, 1.4 / w, 1.0], 1 / dt)
    settled = scipy.signal.lfilter_zi(b, a)
    zi = settled[:, None] * x[:1] if x.ndim == 2 else settled * x[0]
    return np.asarray(scipy.signal.lfilter(b, a, x, axis=0, zi=zi)[0])


def second_difference(x: np.ndarray, dt: float) -> np.ndarray:
    """x'' at every sample; with a force held between samples it is exact for its mean before and after."""
    inside = (x[2:] - 2 * x[1:-1] + x[:-2]) / dt**2
    return np.concatenate([inside[:1], inside, inside[-1:]])


def held(u: np.ndarray) -> np.ndarray:
    """Mean of what was held before and after each sample."""
    return 0.5 * (u + np.concatenate([u[:1], u[:-1]]))


def span(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of columns (n, k), those that are all but multiples of others left out."""
    norms = np.linalg.norm(columns, axis=0)
    U, sizes, _ = np.linalg.svd(columns / np.where(norms > 0, norms, 1.0), full_matrices=False)
    return U[:, sizes > 1e-6 * max(sizes.max(initial=0.0), 1e-300)]


def inverse(recording: Recording, machine: Machine) -> Inverse:
    """Fit the nominal drive to a record."""
    dt = machine.controller.sample_time
    q = recording.qm
    v, a = central_difference(q, dt), second_difference(q, dt)
    s = np.tanh(v / V_EPS)
    decimation = Decimation.at(CUTOFF_HZ, dt)
    t, sides, tau = dt * np.arange(len(q)), [a, v, s], held(recording.tau)

    def system(f_n: float) -> np.ndarray:
        """Columns and, last, the force, (n_decimated, k + 1)."""
        decay, w = np.exp(-DAMPING * 2 * np.pi * f_n * t), 2 * np.pi * f_n
        load = [through_load(x, f_n, dt, DAMPING) for x in sides]
        swing = [decay * np.cos(w * t), decay * np.sin(w * t)]
        return decimation(notched(np.column_stack([*sides, *load, *swing, tau]), f_n, dt))

    def left(f_n: float) -> float:
        A = system(f_n)
        U = span(A[:, :-1])
        return float(np.sum((A[:, -1] - U @ (U.T @ A[:, -1])) ** 2))

    f_n, A = np.inf, decimation(np.column_stack([*sides, tau]))
    if machine.model == "flexible":
        f_n = min(np.geomspace(9.0, 70.0, 28), key=left)
        f_n = min(f_n * np.linspace(0.94, 1.06, 13), key=left)
        A = system(f_n)
    W, Y = A[:, :-1], A[:, -1]
    norms = np.linalg.norm(W, axis=0)
    theta = np.linalg.lstsq(W / norms, Y, rcond=1e-6)[0] / norms
    M1, Fv, Fc = theta[:3]
    M2 = 0.0
    if machine.model == "flexible":
        M2, Fv, Fc = theta[3], Fv + theta[4], Fc + theta[5]
    U = span(W)
    return Inverse(
        recording,
        machine,
        q,
        v,
        a,
        s,
        float(f_n),
        float(M1),
        float(M2),
        float(Fv),
        float(Fc),
        decimation,
        U,
        Y - U @ (U.T @ Y),
    )
