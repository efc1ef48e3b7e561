"""What each effect would add to the force of the inverse model: columns along the recorded motion, by effect.

An effect whose shape is not linear in a parameter (a Stribeck speed, a resonance) has a candidate per value of a grid.
Effects of the controller are not here: the inverse model holds whatever computed the force.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.signal

from didim_jax.effects.environment import pulses_in

from .inverse import Inverse, held, second_difference, span


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """Columns (n_decimated, k) that an effect adds, and the number of parameters that chose its shape."""

    effect: str
    columns: np.ndarray
    shape: int = 0

    @property
    def parameters(self) -> int:
        """How many numbers the effect adds to a fit."""
        return self.columns.shape[1] + self.shape


def friction(x: Inverse) -> list[Candidate]:
    """Effects of friction and environment: what a ladder of friction laws knows."""
    return _made(x, _friction(x))


def everything(x: Inverse) -> list[Candidate]:
    """Every effect that shows in the inverse model; those of a coupling where there is one."""
    blocks = [_friction(x), _presliding(x), _actuator(x), _load(x), _sensor(x), _pulses(x)]
    return [c for block in [*blocks, *([_coupling(x)] if x.flexible else [])] for c in _made(x, block)]


def left_by(candidates: Sequence[Candidate], residual: np.ndarray, basis: np.ndarray) -> list[float]:
    """Share of the residual's energy that each candidate leaves, fitted together with the columns in `basis`."""
    total = max(float(residual @ residual), 1e-300)
    out = []
    for c in candidates:
        own = c.columns - basis @ (basis.T @ c.columns)
        kept = np.linalg.norm(own, axis=0) > 1e-3 * np.linalg.norm(c.columns, axis=0)
        U = span(own[:, kept])
        out.append(1 - float(np.sum((U.T @ residual) ** 2)) / total)
    return out


type _Columns = Iterator[tuple[str, Sequence[np.ndarray], int]]
"""Effect, columns at every sample, parameters of the shape."""


def _made(x: Inverse, columns: _Columns) -> list[Candidate]:
    return [Candidate(effect, x.filtered(np.column_stack(list(some))), shape) for effect, some, shape in columns]


def _friction(x: Inverse) -> _Columns:
    q, v, s = x.q, x.v, x.s
    phi = 2 * np.pi * q / x.machine.screw_lead
    low, high = float(q.min()), float(q.max())
    along = (q - 0.5 * (low + high)) / max(0.5 * (high - low), 1e-6)
    yield "offset", [np.ones_like(q)], 0
    yield "cable_spring", [q, np.ones_like(q)], 0
    yield "asymmetric_coulomb", [s * s], 0
    yield "asymmetric_viscous", [np.abs(v)], 0
    yield "quadratic_viscous", [v * np.abs(v)], 0
    yield "position_friction", [np.polynomial.Legendre.basis(n)(along) * s for n in (1, 2, 3, 4)], 0
    yield "lead_friction", [np.sin(phi) * s, np.cos(phi) * s], 0
    for vs in (0.004, 0.008, 0.015, 0.03):
        yield "stribeck", [np.exp(-((np.abs(v) / vs) ** 1.5)) * s], 1
    for width in (0.007, 0.018):
        for q0 in low + (high - low) * np.linspace(0.08, 0.92, 7):
            yield "local_friction", [np.exp(-(((q - q0) / width) ** 2)) * s], 2


def _presliding(x: Inverse) -> _Columns:
    """Also what depends on the motion's past, or on the force transmitted: not in a ladder of friction laws."""
    z_s = np.array([8e-5, 1.8e-4, 3.5e-4, 7e-4])
    z = np.empty((len(x.v), len(z_s)))
    z[0] = x.s[0]
    keep, towards = np.exp(-np.abs(x.v[:, None]) * x.dt / z_s), np.sign(x.v)
    for k in range(1, len(z)):  # z' = (v - |v| z) / z_s, exact where v is held
        z[k] = towards[k] + (z[k - 1] - towards[k]) * keep[k]
    for column in z.T:
        yield "presliding", [column - x.s], 1
    yield "load_dependent_friction", [np.abs(x.transmitted if x.flexible else x.recording.tau) * x.s], 0
    for T in (2.0, 20.0):
        g = np.expm1(-x.t / T) / np.expm1(-x.t[-1] / T)
        yield "friction_drift", [g * x.s, g * x.v], 1


def _actuator(x: Inverse) -> _Columns:
    tau, volts, dt = x.recording.tau, x.recording.vir, x.dt
    phi = 2 * np.pi * x.q / x.machine.screw_lead
    yield "cogging", [f(n * phi) for n in (1, 2) for f in (np.sin, np.cos)], 0
    yield "gain_nonlinearity", [held(tau * np.abs(volts))], 0
    for T in (3e-4, 1e-3, 2.5e-3):
        yield "time_delay", [held(tau - np.interp(x.t - T, x.t, tau))], 1
        keep = np.exp(-dt / T)
        late = scipy.signal.lfilter([1 - keep], [1, -keep], tau, zi=keep * tau[:1])[0]
        yield "amplifier_lag", [held(tau - late)], 1
    for quantile in (0.9, 0.96, 0.985, 0.995, 0.999):
        most = np.quantile(np.abs(tau), quantile)
        yield "saturation", [held(tau - np.clip(tau, -most, most))], 1
    for volt in (0.03, 0.12):
        lost = volt * x.recording.gain
        yield "amplifier_dead_zone", [held(np.clip(tau, -lost, lost))], 1


def _coupling(x: Inverse) -> _Columns:
    """A coupling that gives by delta more leaves the load behind by G delta."""
    phi, F = 2 * np.pi * x.q / x.machine.screw_lead, x.transmitted

    def behind(delta: np.ndarray) -> np.ndarray:
        return x.to_load(second_difference(delta, x.dt))

    yield "coupling_damping", [x.to_load(F, damping=0.05) - x.to_load(F)], 0
    yield "cubic_stiffness", [behind((F / 50.0) ** 3)], 0
    for force in (1.0, 4.0):
        yield "backlash", [behind(np.tanh(F / force))], 1
    yield "transmission_error", [behind(np.sin(phi)), behind(np.cos(phi))], 0


def _load(x: Inverse) -> _Columns:
    a2 = x.to_load(x.a)
    for share in np.linspace(0.05, 0.95, 19):
        yield "payload_change", [x.to_load(np.where(x.t > share * x.t[-1], a2, 0.0))], 1
    for f in np.geomspace(15.0, 80.0, 22):
        yield "second_flexible_mode", [x.to_load(_resonant(a2, f, 0.015, x.dt))], 1
    for f in np.geomspace(10.0, 60.0, 20):
        yield "base_flexibility", [x.moved(_resonant(x.recording.tau, f, 0.02, x.dt))], 1


def _resonant(y: np.ndarray, f: float, zeta: float, dt: float) -> np.ndarray:
    """p^2 / (p^2 + 2 zeta w p + w^2) on y: what a mass on a spring (Hz) does not follow, or a frame's acceleration."""
    w = 2 * np.pi * f
    b, a = scipy.signal.bilinear([1.0, 0.0, 0.0], [1.0, 2 * zeta * w, w * w], 1 / dt)
    return np.asarray(scipy.signal.lfilter(b, a, y, zi=scipy.signal.lfilter_zi(b, a) * y[0])[0])


def _sensor(x: Inverse) -> _Columns:
    """qm = q + e: the force of the motion e that the drive did not make."""
    phi = 2 * np.pi * x.q / x.machine.screw_lead
    errors = [np.sin(phi), np.cos(phi)]
    yield (
        "encoder_periodic_error",
        [x.moved(second_difference(e, x.dt)) + x.Fv * np.gradient(e, x.dt) for e in errors],
        0,
    )


def _pulses(x: Inverse) -> _Columns:
    step = x.dt * x.decimation.factor
    for train in pulses_in(x.residual, step):
        yield "disturbance_pulses", [train.course(x.t)], 5
