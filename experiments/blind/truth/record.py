"""Records of a machine: runs on different references, cut where a record begins, and the floor that noise leaves."""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from .kernel import run
from .law import Drawn
from .machine import DT, Machine
from .noise import Noise
from .references import REACH, SPEED, draw_reference
from .slots import changed

SECONDS = 10.0
START = 0.9  # s, the latest start of a record in its run
VOLTS = 8.0  # V, peak of a record whose drive does not saturate
CLIPPED_VOLTS = 40.0  # V, peak of the command (recorded before the clip) where it does


@dataclass(frozen=True)
class Plan:
    """What a run follows: reference in m from the run's first sample; sample at which the record starts."""

    qg: np.ndarray
    start: int


@dataclass(frozen=True)
class Run:
    """A run as recorded (from its very start), and what is true."""

    qm: np.ndarray
    ql: np.ndarray
    u: np.ndarray
    q1: np.ndarray
    v1: np.ndarray
    q2: np.ndarray
    v2: np.ndarray

    def sound(self, volts: float) -> bool:
        """Finite, within stroke, speed and drive range."""
        if not all(np.isfinite(x).all() for x in (self.u, self.q1, self.q2)):
            return False
        inside = min(self.q1.min(), self.q2.min()) > -0.01 and max(self.q1.max(), self.q2.max()) < REACH + 0.01
        return inside and np.abs(self.v1).max() <= 1.02 * SPEED and np.abs(self.u).max() <= volts


def draw_plan(rng: np.random.Generator, machine: Machine, excitation: str, vigour: float) -> Plan:
    """A reference, and a start: at rest, or some 0.1-0.9 s later in motion, as likely as not."""
    moving = rng.random() < 0.5
    qg = draw_reference(rng, machine.mass, SECONDS + START, excitation, vigour)
    start = 0
    if moving:
        speed = np.abs(np.gradient(qg, DT))
        later = [k for k in range(100, round(START / DT)) if speed[k] > 0.003]
        start = int(rng.choice(later))
    return Plan(qg[: start + round(SECONDS / DT)], start)


def simulate(p: np.ndarray, plan: Plan, effects: list[Drawn], noise: Noise | None, rng: np.random.Generator) -> Run:
    """One run; with `noise` None quiet and with an ideal encoder. The same `rng` gives the same phases and events."""
    n = plan.qg.size
    phases = {name: float(rng.uniform(0, 2 * np.pi)) for drawn in effects for name in drawn.record_phases}
    p = changed(p, **phases)
    jumps, dropped = _jumps(p, rng, n), _dropped(p, rng, n)
    still = np.zeros(n)
    motor, load, jitter = noise.draw(rng, n) if noise else (still, still, still)
    return Run(*run(p, plan.qg, motor, load, jitter, jumps, dropped, noise is None))


def floor(noisy: Run, quiet: Run, start: int) -> float:
    """norm(F(tau - tau_quiet)) / norm(F(tau)) over the record; the gain cancels."""
    tau, calm = noisy.u[start:], quiet.u[start:]
    return float(np.linalg.norm(low_pass(tau - calm)) / np.linalg.norm(low_pass(tau)))


def low_pass(x: np.ndarray) -> np.ndarray:
    """Butterworth of order 4 at 60 Hz, forward and backward."""
    return np.asarray(signal.sosfiltfilt(signal.butter(4, 60 * 2 * DT, output="sos"), x))


def variables(
    noisy: Run, plan: Plan, machine: Machine, load_encoder: bool, vir_type: type[np.floating]
) -> dict[str, np.ndarray]:
    """The variables of a .mat file; vectors of 10,000 samples, and gains of one."""
    cut = slice(plan.start, None)
    out = {
        "t": np.arange(round(SECONDS / DT)) * DT,
        "qg": plan.qg[cut],
        "qm": noisy.qm[cut],
        "vir": noisy.u[cut].astype(vir_type),
        "gtau": np.array([machine.gain]),
        "kp": np.array([machine.kp]),
        "kv": np.array([machine.kv]),
    }
    if load_encoder:
        out["ql"] = noisy.ql[cut]
    return out


def within(intervals: tuple[tuple[float, float], ...], plan: Plan) -> list[list[float]]:
    """Intervals in s of the run, as [on, off] in s of the record; those outside it are left out."""
    moved = ([max(on - plan.start * DT, 0.0), min(off - plan.start * DT, SECONDS)] for on, off in intervals)
    return [[on, off] for on, off in moved if on < off]


def _jumps(p: np.ndarray, rng: np.random.Generator, n: int) -> np.ndarray:
    """Counts lost so far, in m."""
    size, rate = float(p["x_jump"][0]), float(p["x_jump_rate"][0])
    if size == 0:
        return np.zeros(n)
    steps = np.zeros(n)
    for _ in range(max(2, rng.poisson(rate * n * DT))):
        steps[rng.integers(300, n)] += rng.choice([-1, 1]) * rng.uniform(0.7, 1.4) * size
    return np.cumsum(steps)


def _dropped(p: np.ndarray, rng: np.random.Generator, n: int) -> np.ndarray:
    """Samples at which the drive gets no new command."""
    share, length = float(p["x_drop"][0]), int(p["x_drop_n"][0])
    out = np.zeros(n, bool)
    if share > 0:
        for k in np.flatnonzero(rng.random(n) < share / length):
            out[max(k, 1) : k + length] = True
    return out
