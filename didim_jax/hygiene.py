"""Is this record fit to be used? Only the unusable is refused; what is merely odd is reported.

A check is a small function of the record and the machine that yields findings; to add one, write it and name it in
`CHECKS`. Rows are counted from 1. Only the documented law and the record are compared: no plant is needed here.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from didim_jax.errors import InputError
from didim_jax.machine import Machine
from didim_jax.recording import Recording
from didim_jax.signals import LowPass, central_difference


@dataclasses.dataclass(frozen=True)
class Finding:
    """One thing seen in a record: which check saw it, in one line, and whether the record is unusable for it."""

    check: str
    message: str
    refuse: bool = False


def examine(recording: Recording, machine: Machine) -> tuple[Finding, ...]:
    """Run every check; never raises. Refusing findings and odd ones alike, in the order of `CHECKS`."""
    return _found(CHECKS, recording, machine)


def admit(recording: Recording, machine: Machine) -> tuple[Finding, ...]:
    """The findings to report with the results.

    Raises InputError with the line of the first refusing finding.
    """
    return _admitted(recording, examine(recording, machine))


def admit_clock(recording: Recording, machine: Machine) -> tuple[Finding, ...]:
    """As `admit`, of the times of a record and their number alone: what was measured is not asked."""
    return _admitted(recording, _found(CLOCK, recording, machine))


def _found(checks: Iterable["Check"], recording: Recording, machine: Machine) -> tuple[Finding, ...]:
    with np.errstate(all="ignore"):  # a record of absurd size is for the checks to name, not to stumble over
        return tuple(finding for check in checks for finding in check(recording, machine))


def _admitted(recording: Recording, findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    for finding in findings:
        if finding.refuse:
            raise InputError(f"{recording.label}: {finding.message}")
    return findings


def refuse_repeated(records: Sequence[Recording]) -> None:
    """The same run twice would halve a variance for nothing, and as a check it would check nothing: InputError."""
    for a, b in itertools.combinations(records, 2):
        if np.array_equal(a.qm, b.qm) and np.array_equal(a.vir, b.vir):
            raise InputError(f"{b.label}: holds the same run as {a.label}; give it once, and check on another.")


def injected_scale(recording: Recording, machine: Machine) -> float:
    """What one unit of the injected signal adds to vir, V; 0.0 when there is none.

    Least squares of vir on the position term, the velocity term and the injected signal, each with its own factor: a
    controller whose gains are not the documented ones must not shift the scale.
    """
    fit = _fit_law(recording, machine)
    return 0.0 if fit is None else fit.scale


# -- time --------------------------------------------------------------------------------------------------------

_MIN_SAMPLES = 1000
_MIN_SECONDS = 1.0
_TIME_UNITS = {1e3: "milliseconds", 1e6: "microseconds"}


def _enough_samples(r: Recording, m: Machine) -> Iterator[Finding]:
    if len(r) < _MIN_SAMPLES:
        yield Finding("length", f"{len(r)} samples are too few, at least {_MIN_SAMPLES} are needed.", refuse=True)


def _time_increases(r: Recording, m: Machine) -> Iterator[Finding]:
    back = np.flatnonzero(np.diff(r.t) <= 0)
    if back.size:
        k = back[0] + 1
        yield Finding(
            "time",
            f"t does not increase at row {k + 1}: {r.t[k]:.9g} s after {r.t[k - 1]:.9g} s "
            f"({back.size} such rows); put the rows in order of time.",
            refuse=True,
        )


def _time_uniform(r: Recording, m: Machine) -> Iterator[Finding]:
    step = np.diff(r.t)
    dt = float(np.median(step))
    if dt <= 0:
        return  # said by _time_increases
    uneven = np.abs(step / dt - 1)
    drift = np.abs(r.t - r.t[0] - r.dt * np.arange(len(r))).max() / dt
    if uneven.max() > 0.1 or drift > 0.5:  # the second: two rates that differ by little, over many samples
        k = int(np.argmax(uneven > 0.5 * uneven.max()))
        yield Finding(
            "time",
            f"t is not uniformly sampled: the step is {step[k]:.6g} s at row {k + 2} and {dt:.6g} s "
            "elsewhere; resample the record or cut it there.",
            refuse=True,
        )
    elif uneven.max() > 1e-3:
        yield Finding("time", f"the step of t varies by {100 * uneven.max():.2g} %; taken as uniform, {r.dt:.6g} s.")


def _sample_time(r: Recording, m: Machine) -> Iterator[Finding]:
    expected = m.controller.sample_time
    ratio = r.dt / expected
    if ratio > 0 and abs(ratio - 1) > 0.01:
        reading = f"; t looks like {_near(ratio, _TIME_UNITS)}" if _near(ratio, _TIME_UNITS) else ""
        yield Finding(
            "time",
            f"the step of t is {r.dt:.6g} s, the machine samples every {expected:.6g} s{reading}; "
            "correct t or the machine's sample_time.",
            refuse=True,
        )


def _long_enough(r: Recording, m: Machine) -> Iterator[Finding]:
    seconds = len(r) * r.dt
    if 0 <= seconds < _MIN_SECONDS:
        yield Finding("length", f"{seconds:.3g} s are too short, at least {_MIN_SECONDS:g} s are needed.", refuse=True)


# -- channels ----------------------------------------------------------------------------------------------------

_LONGEST_STROKE = 5.0  # m: a precision screw is shorter, and a short stroke in millimetres is longer


def _dead_channel(r: Recording, m: Machine) -> Iterator[Finding]:
    for name, values in r.channels.items():
        if name not in ("t", "injected") and np.ptp(values) == 0:
            yield Finding(
                "dead channel", f"{name} never moves, it is {values[0]:.6g} in all {len(r)} rows.", refuse=name != "ql"
            )


def _stroke_units(r: Recording, m: Machine) -> Iterator[Finding]:
    """Positions in millimetres or micrometres where metres are expected: by their size, then against each other."""
    strokes = {name: float(np.ptp(values)) for name, values in r.channels.items() if name in ("qg", "qm", "ql")}
    for name, stroke in strokes.items():
        if stroke > _LONGEST_STROKE:
            unit, factor = ("millimetres", 1e3) if stroke / 1e3 <= _LONGEST_STROKE else ("micrometres", 1e6)
            yield Finding(
                "units",
                f"{name} moves over {stroke:.4g} m: it looks like {unit} ({stroke / factor:.4g} m); give it in metres.",
                refuse=True,
            )
    for name in ("qm", "ql"):
        if not strokes["qg"] or not strokes.get(name) or strokes[name] > _LONGEST_STROKE < strokes["qg"]:
            continue
        ratio = strokes[name] / strokes["qg"]
        if any(abs(ratio * 1000.0**power - 1) < 0.05 for power in (-2, -1, 1, 2)):
            yield Finding(
                "units",
                f"{name} moves over {strokes[name]:.4g} m and qg over {strokes['qg']:.4g} m, "
                f"a factor of {ratio:.4g}: they look like metres against millimetres; "
                "give both in metres.",
                refuse=True,
            )
        elif not 0.5 < ratio < 2:
            yield Finding(
                "units",
                f"{name} moves {ratio:.3g} times as far as qg ({strokes[name]:.4g} m against {strokes['qg']:.4g} m).",
            )


_ONE_BODY = 20.0  # counts, rms: two encoders on one body differ by roundings and errors of their scales
_RIGID_HZ = 80.0  # a mode well above the band of 60 Hz does not show in it


def _two_encoders(r: Recording, m: Machine) -> Iterator[Finding]:
    """Does the load swing against the motor, where the machine is said to be rigid?

    Zero, scale, warming and skew of two encoders are no swing. On a spring the load lags by a / (2 pi f)^2.
    """
    if r.ql is None or m.model != "rigid" or np.ptp(r.ql) == 0 or len(r) < _MIN_SAMPLES:
        return
    dt = m.controller.sample_time
    v = central_difference(r.qm, dt)
    a = LowPass.butterworth(min(60.0, 0.2 / dt), dt)(central_difference(v, dt))
    apart = _regress([np.ones(len(r)), r.qm, r.t - r.t[0], v], r.ql - r.qm)[1]
    frequency = float(np.sqrt(np.std(a) / apart)) / (2 * np.pi) if apart > 0 else np.inf
    if apart > _ONE_BODY * m.encoder.resolution and frequency < _RIGID_HZ:
        yield Finding(
            "agreement",
            f"ql swings against qm by {1e6 * apart:.3g} um rms, as on a spring of some {frequency:.2g} Hz, and the "
            'machine is said to be rigid: set model = "flexible" in its file, or give the file of this machine.',
        )


def _encoder_grid(r: Recording, m: Machine) -> Iterator[Finding]:
    count = m.encoder.resolution
    values = np.unique(r.qm)
    if len(values) < 2:
        return  # said by _dead_channel
    if _on_lattice(values, count):
        multiple = int(np.gcd.reduce(np.round((values - values[0]) / count).astype(np.int64)))
        if multiple > 1:
            yield Finding(
                "encoder",
                f"qm moves in steps of {multiple * count:.4g} m, {multiple} counts of the documented {count:.4g} m.",
            )
        return
    spacing = float(np.diff(values).min())
    if spacing > 1e-9 * np.ptp(values):  # below that, the lattice would be the one of the floating-point numbers
        spacing = float(np.ptp(values) / np.round(np.ptp(values) / spacing))
        if _on_lattice(values, spacing, tolerance=0.02):
            yield Finding("encoder", f"qm lies on a lattice of {spacing:.4g} m, the documented count is {count:.4g} m.")
            return
    yield Finding(
        "encoder",
        f"qm is not on the encoder's grid of {count:.4g} m, nor on any other: it was filtered, resampled or simulated.",
    )


def _on_lattice(values: np.ndarray, spacing: float, tolerance: float = 1e-2) -> bool:
    """Whether all values are whole steps from the first, to `tolerance` of a step (rounding leaves 1e-9)."""
    steps = (values - values[0]) / spacing
    return bool(np.all(np.abs(steps - np.round(steps)) < tolerance))


def _beyond_limit(r: Recording, m: Machine) -> Iterator[Finding]:
    limit = m.drive.limit
    over = np.flatnonzero(np.abs(r.vir) > limit)
    at = np.flatnonzero(np.abs(r.vir) == limit)
    if over.size:
        yield Finding(
            "limit",
            f"vir goes beyond the drive limit of {limit:g} V, up to {np.abs(r.vir).max():.4g} V, in "
            f"{over.size} samples (rows {_rows(over)}): the drive clips it there.",
        )
    elif at.size > 1:
        yield Finding(
            "limit",
            f"vir is exactly the drive limit of {limit:g} V in {at.size} samples (rows "
            f"{_rows(at)}): it looks recorded after the clip, it is expected before.",
        )


def _documented(r: Recording, m: Machine) -> Iterator[Finding]:
    found = {"gtau": r.gain, **r.documented}
    expected = {"gtau": (m.drive.gain, "N/V"), "kp": (m.controller.kp, "1/s"), "kv": (m.controller.kv, "V s/m")}
    for name, (value, unit) in expected.items():
        if name in found and not abs(found[name] - value) <= 1e-3 * abs(value):
            yield Finding(
                "agreement",
                f"{name} is {found[name]:.7g} {unit} in the record and {value:.7g} {unit} in "
                "the machine; correct the wrong one.",
                refuse=True,
            )


# -- control law -------------------------------------------------------------------------------------------------

_MAX_LAG = 3
_SHORTEST_FIT = 50  # samples: below that a regression says nothing, and the length is refused anyway


@dataclasses.dataclass(frozen=True)
class _LawFit:
    """vir[k] = position * kv kp (qg - qm)[j] - velocity * kv dq[j] + scale * injected[j] + residual[k], j = k - lag.

    The two terms of the law have a factor each: they are large and nearly cancel, so that a common factor turns a kp
    3 % off into a residual of 30 %, and looks like a lag. `lag` is the one of least residual.
    """

    lag: int
    position: float
    velocity: float
    scale: float  # V per unit of the injected signal; 0 without one
    residual: float  # rms, V
    relative: float  # residual / rms of vir


def law_terms(r: Recording, m: Machine) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity terms of the documented law, V, from the third sample on."""
    c = m.controller
    dq = (r.qm[2:] - r.qm[:-2]) / (2 * c.sample_time)
    return c.kv * c.kp * (r.qg[2:] - r.qm[2:]), -c.kv * dq


def _regress(columns: list[np.ndarray], target: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares on columns scaled to one: factors and rms residual; not a number where the columns are not."""
    A = np.column_stack(columns)
    size = np.abs(A).max(axis=0)
    size[size == 0] = 1.0
    if not (np.isfinite(A).all() and np.isfinite(target).all()):
        return np.full(A.shape[1], np.nan), np.nan
    factors = np.linalg.lstsq(A / size, target)[0] / size
    return factors, float(np.sqrt(np.mean((target - A @ factors) ** 2)))


def _fit_law(r: Recording, m: Machine) -> _LawFit | None:
    """None where the record is too short or too odd to say anything."""
    if len(r) < _SHORTEST_FIT:
        return None
    columns = [*law_terms(r, m), np.zeros(len(r) - 2) if r.injected is None else r.injected[2:]]
    vir = r.vir[2:]
    last = len(vir) - _MAX_LAG
    fits = {}
    for lag in range(-_MAX_LAG, _MAX_LAG + 1):  # the same samples of vir for every lag
        fits[lag] = _regress([x[_MAX_LAG - lag : last - lag] for x in columns], vir[_MAX_LAG:last])
    lag = min(fits, key=lambda n: fits[n][1])
    if fits[lag][1] > 0.9 * fits[0][1]:
        lag = 0  # no better than in step: not worth a word
    (position, velocity, scale), residual = fits[lag]
    rms = float(np.sqrt(np.mean(vir**2)))
    if not (np.isfinite(residual) and np.isfinite(rms) and rms > 0):
        return None
    return _LawFit(lag, float(position), float(velocity), float(scale), residual, residual / rms)


def _vir_units(r: Recording, m: Machine) -> Iterator[Finding]:
    """vir in another unit than V, or positions in another than m: the factor on the law gives it away."""
    fit = _fit_law(r, m)
    if fit is None or fit.relative > 0.5:
        return  # vir does not follow the law at all: its factor means nothing
    g = m.drive.gain
    readings = {
        1e3: "vir looks like millivolts (or qg and qm like kilometres)",
        1e-3: "qg and qm look like millimetres (or vir like kilovolts)",
        1e-6: "qg and qm look like micrometres",
        -1.0: "the sign of vir is opposite to that of the law",
        g: "vir looks like newtons",
        g * 1e3: "vir looks like millinewtons",
        g / 1e3: "vir looks like kilonewtons, or like newtons with qg and qm in millimetres",
        1 / g: "vir looks divided by the drive gain",
    }
    readings = {factor: text for factor, text in readings.items() if not 0.5 < factor < 2}  # a gain near 1 N/V
    # 10 %: gains of the controller may be off by some per cent on top, and no reading is that near to a right record.
    reading = _near(fit.position, readings, 0.1)
    if reading and reading == _near(fit.velocity, readings, 0.1):
        yield Finding(
            "units",
            f"vir is {fit.position:.4g} times the documented control law: {reading}; expected are V and m.",
            refuse=True,
        )


def _control_law(r: Recording, m: Machine) -> Iterator[Finding]:
    fit = _fit_law(r, m)
    if fit is None:
        return
    if fit.lag:
        yield Finding(
            "law",
            f"vir {'lags' if fit.lag > 0 else 'leads'} the documented control law by {abs(fit.lag)} "
            f"sample{'s' if abs(fit.lag) > 1 else ''} ({abs(fit.lag) * r.dt:.4g} s), 0 expected: a "
            "shifted channel, or a controller that is not the documented one.",
        )
    scaled = max(abs(fit.position - 1), abs(fit.velocity - 1)) > 5e-3
    if scaled or fit.relative > 0.02:
        said = (
            f"vir is {fit.position:.4g} times the position term and {fit.velocity:.4g} times the velocity term of"
            if scaled
            else "vir follows"
        )
        yield Finding(
            "law",
            f"{said} the documented control law, with a residual of {fit.residual:.3g} V "
            f"({fit.residual * m.drive.gain:.3g} N) rms, {100 * fit.relative:.2g} % of vir.",
        )


def _injected_signal(r: Recording, m: Machine) -> Iterator[Finding]:
    if r.injected is None:
        return
    scale = injected_scale(r, m)
    size = abs(scale) * float(np.ptp(np.append(r.injected, 0.0)))  # from none to most
    if size < 1e-3 * float(np.ptp(r.vir)):
        yield Finding("injected", f"pulses_N does not show in vir ({scale:.4g} V per unit).")
    else:
        newtons = size * m.drive.gain
        yield Finding(
            "injected",
            f"pulses_N enters at {scale:.4g} V per unit (documented as N, which would be "
            f"{1 / m.drive.gain:.4g} V per unit): {size:.4g} V or {newtons:.4g} N in all.",
        )


# -- wording -----------------------------------------------------------------------------------------------------


def _near(value: float, readings: dict[float, str], tolerance: float = 0.05) -> str:
    """The reading whose factor is nearest to `value`, where that is within `tolerance` of it; else ""."""
    off = {abs(value / factor - 1): text for factor, text in readings.items()}
    return off[min(off)] if min(off) < tolerance else ""


def _rows(indices: np.ndarray) -> str:
    """[2, 3, 4, 9] -> "3-5, 10": the first few runs, rows counted from 1."""
    runs = np.split(indices + 1, np.flatnonzero(np.diff(indices) > 1) + 1)
    text = [f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in itertools.islice(runs, 5)]
    return ", ".join(text) + (f" and {len(runs) - 5} more stretches" if len(runs) > 5 else "")


type Check = Callable[[Recording, Machine], Iterable[Finding]]

CLOCK: tuple[Check, ...] = (_enough_samples, _time_increases, _time_uniform, _sample_time, _long_enough)

CHECKS: tuple[Check, ...] = (
    *CLOCK,
    _dead_channel,
    _stroke_units,
    _documented,
    _two_encoders,
    _vir_units,
    _control_law,
    _injected_signal,
    _encoder_grid,
    _beyond_limit,
)
