"""How far DIDIM's columns are from the exact ones: cosine, ratio of norms, relative error; by band, phase and mode.

A parameter that changes by d theta acts on the loop as the force -W d theta. Exactly, the loop answers it:
J = T W at every frequency, T the closed loop from a disturbing force to the motor force. DIDIM takes T for 1.

References: paper, eq. 17-18.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from didim_jax import Machine
from didim_jax.identify import PlantParameters, didim_columns, exact_columns, linear_system
from didim_jax.plant import AbstractPlant, CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.signals import Decimation, LowPass

from .twin import RAW, Twin


@dataclasses.dataclass(frozen=True)
class Pair:
    """Columns at one plant, every sample, unfiltered, SI units, (n, n_theta).

    `W` are DIDIM's on the motor-force row, `load` its row of the load side (None for a rigid drive), `J` the exact
    ones. On the load side's row the exact ones are zero: that row is balanced whatever theta is.
    """

    W: np.ndarray
    load: np.ndarray | None
    J: np.ndarray

    def filtered(self, low_pass: LowPass | Decimation) -> "Pair":
        """The same columns behind a filter."""
        return Pair(low_pass(self.W), None if self.load is None else low_pass(self.load), low_pass(self.J))

    def stacked(self) -> tuple[np.ndarray, np.ndarray]:
        """(W, J) with the load side's rows below, as DIDIM solves them."""
        if self.load is None:
            return self.W, self.J
        return np.concatenate([self.W, self.load]), np.concatenate([self.J, np.zeros_like(self.load)])


def columns(twin: Twin, plant: AbstractPlant, names: Sequence[str]) -> Pair:
    """Both kinds of columns at one plant, for the twin's reference."""
    parametrisation = PlantParameters.of(plant, names, bounded=False)  # theta = scale x: columns compare one to one
    problem = (parametrisation, (twin.trial(plant, RAW),))
    x = parametrisation.encode(parametrisation.start())
    scale = np.array([p.scale for p in parametrisation.chosen])
    W, J = (np.asarray(linear_system(x, problem, kind)[1]) / scale for kind in (didim_columns, exact_columns))
    n = len(J)
    return Pair(W[:n], W[n:] if len(W) > n else None, J)


def compare(W: np.ndarray, J: np.ndarray) -> dict[str, np.ndarray]:
    """Per column: cosine, ratio norm(W)/norm(J), relative error norm(W - J)/norm(J); nan where a column is zero."""
    w, j = np.linalg.norm(W, axis=0), np.linalg.norm(J, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.real(np.sum(np.conj(W) * J, axis=0)) / (w * j)
        return {
            "cosine": cosine,
            "ratio": np.where(w > 0, w / j, np.nan),
            "error": np.where(w > 0, np.linalg.norm(W - J, axis=0) / j, np.nan),
        }


def by_band(W: np.ndarray, J: np.ndarray, dt: float, edges: Sequence[float]) -> dict[str, np.ndarray]:
    """`compare` on the Fourier lines of each band (Hz), (n_bands, n_theta), and the share of norm(J)^2 it holds."""
    f = np.fft.rfftfreq(len(W), dt)
    Wf, Jf = np.fft.rfft(W, axis=0), np.fft.rfft(J, axis=0)
    rows = []
    all_bands = np.sum(np.abs(Jf[(f >= edges[0]) & (f < edges[-1])]) ** 2, axis=0)
    for low, high in itertools.pairwise(edges):
        inside = (f >= low) & (f < high)
        share = np.sum(np.abs(Jf[inside]) ** 2, axis=0) / all_bands
        rows.append({**compare(Wf[inside], Jf[inside]), "share": share})
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def by_phase(W: np.ndarray, J: np.ndarray, labels: np.ndarray, n: int) -> dict[str, np.ndarray]:
    """`compare` on the samples of each phase, (n, n_theta)."""
    rows = [compare(W[labels == k], J[labels == k]) for k in range(n)]
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def contraction(W: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Moduli of the eigenvalues of I - W^+ J, ascending: what one iteration leaves of a small error of theta.

    DIDIM near a drive that fits maps the error e to (I - W^+ J) e, W^+ the pseudo-inverse of the stacked W. An
    eigenvalue of 1 is a direction in which it never moves.
    """
    norms = np.linalg.norm(W, axis=0)
    solved = np.linalg.lstsq(W / norms, J / norms, rcond=None)[0]
    return np.sort(np.abs(np.linalg.eigvals(np.eye(W.shape[1]) - solved)))


def load_as_a_whole(pair: Pair, theta: np.ndarray, load: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Columns for a common relative change of the load side's parameters: all that DIDIM can do to them, (n, 1)."""
    index = list(load)
    return (pair.W[:, index] @ theta[index])[:, None], (pair.J[:, index] @ theta[index])[:, None]


def response(W: np.ndarray, J: np.ndarray, dt: float, width: float, highest: float) -> tuple[np.ndarray, np.ndarray]:
    """T as the columns have it: sum(conj(W) J) / sum(abs(W)^2) over bins of `width` Hz; frequencies and T, complex."""
    f = np.fft.rfftfreq(len(W), dt)
    Wf, Jf = np.fft.rfft(W), np.fft.rfft(J)
    centres = np.arange(width / 2, highest, width)
    inside = [(f >= c - width / 2) & (f < c + width / 2) for c in centres]
    return centres, np.array([np.vdot(Wf[k], Jf[k]) / np.vdot(Wf[k], Wf[k]) for k in inside])


def loop_response(machine: Machine, plant: AbstractPlant, f: np.ndarray) -> np.ndarray:
    """T = L / (1 + L) of the linear loop (no Coulomb friction), from a force on the motor side to the motor force.

    The hold delays by half a sample, the two-sample velocity by one more.
    """
    s, law = 2j * np.pi * f, machine.controller
    held = np.exp(-s * law.sample_time / 2)
    command = machine.drive.gain * law.kv * (law.kp + s * np.exp(-s * law.sample_time)) * held
    loop_gain = command / _dynamic_stiffness(plant, s)
    return loop_gain / (1 + loop_gain)


def _dynamic_stiffness(plant: AbstractPlant, s: np.ndarray) -> np.ndarray:
    """Force over position at the motor side, N/m."""
    if isinstance(plant, RigidDrive):
        return _side(plant.M, plant.friction, s)
    assert isinstance(plant, FlexibleDrive)
    load, K = _side(plant.M2, plant.load_friction, s), float(plant.K12)
    return _side(plant.M1, plant.motor_friction, s) + K * load / (K + load)


def _side(M: object, friction: object, s: np.ndarray) -> np.ndarray:
    assert isinstance(friction, CoulombViscous)
    return float(M) * s**2 + float(friction.Fv) * s  # type: ignore[arg-type]
