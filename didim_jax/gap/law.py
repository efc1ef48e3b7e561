"""Does the controller compute what its documentation says? The control-law residual answers without a plant::

    r_C[k] = vir[k] - scale * injected[k] - law[k - lag],   law[k] = kv (kp (qg[k] - qm[k]) - dq[k])      (V)

A sound controller leaves rounding, or the now and then of a count that recorder and controller read differently. What
is more has few explanations, each of them linear or nearly so: gains, a filter on the velocity, volts added behind it.
"""

import dataclasses
import itertools
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import scipy.optimize
import scipy.signal

from ..hygiene import injected_scale, law_terms
from ..machine import Machine
from ..recording import Recording
from ..signals import LowPass, runs
from .noise import white_in_band

RELEVANT = 2e-3
"""Share of the commanded force's rms below which r_C, both in the band, is not worth an effect."""

FAR_ABOVE = 5.0
"""Times the noise that r_C must reach."""

_MAX_LAG = 3
_LONGEST_FILTER = 0.02  # s
_TAPS = 8


class Pulse(NamedTuple):
    """Volts added to the law's output from `on` (first sample with them) to `off` (first without), s of the record.

    `shape` is their course, one number a sample, as a share of `volts`; None for a rectangle.
    """

    on: float
    off: float
    volts: float
    shape: np.ndarray | None = None


@dataclasses.dataclass(frozen=True)
class Explanation:
    """Some effects fitted together to r_C: parameters and their std devs by `effect.parameter`, and what is left.

    `rms` is left over (V); `share` of the energy of r_C is explained. The std devs allow for a correlated remainder.
    """

    effects: tuple[str, ...]
    parameters: dict[str, float]
    std: dict[str, float]
    rms: float
    share: float


@dataclasses.dataclass(frozen=True, eq=False)
class LawResidual:
    """r_C of a record, its size, and what may explain it.

    - `residual` V, one per sample; 0 where the law reaches back before the record; `rms` over the others
    - `lag` samples by which vir follows the law: r_C is taken with that lag
    - `rms_band`, `relative` r_C inside the band: V, and against the commanded force
    - `counting` V inside the band that half a count of doubt in qm would leave
    - `noise` V inside the band: what the best explanation leaves, at most `counting` or the white noise of r_C
    - `explanations` none, each effect, both gains together; each with the pulses as well where there are any
    - `free_filter` any filter of eight taps and unit gain on the velocity: tells a filter of another law
    - `pulses` that stand out of r_C, rectangular or of any course
    """

    residual: np.ndarray
    rms: float
    lag: int
    rms_band: float
    relative: float
    counting: float
    noise: float
    explanations: tuple[Explanation, ...]
    free_filter: Explanation
    pulses: tuple[Pulse, ...]

    @property
    def significant(self) -> bool:
        """Whether r_C matters: relevant in force, and far above its noise."""
        return self.relative > RELEVANT and self.rms_band > FAR_ABOVE * self.noise

    def of(self, *effects: str) -> Explanation:
        """The explanation by these effects together, in any order; by none of them without arguments."""
        for found in self.explanations:
            if set(found.effects) == set(effects):
                return found
        raise KeyError(f"r_C was not fitted by {effects}.")

    def best(self, exclude: Collection[str] = ()) -> Explanation:
        """The fewest effects, none of them excluded, that leave nothing relevant or hardly more than any others."""
        allowed = [e for e in self.explanations if not set(e.effects) & set(exclude)]
        irrelevant = RELEVANT * self.rms_band / max(self.relative, 1e-300)
        least = max(1.1 * min(e.rms for e in allowed), irrelevant)
        enough = [e for e in allowed if e.rms <= least] if self.significant else [self.of()]
        return min(enough, key=lambda e: (len(e.effects), e.rms))


def examine_law(
    recording: Recording, machine: Machine, band_hz: float = 60.0, exclude: Collection[str] = ()
) -> LawResidual:
    """r_C of a record, fitted by every effect of the controller but those excluded and searched for pulses.

    No plant is needed.
    """
    n, c = len(recording), machine.controller
    position, velocity = np.zeros(n), np.zeros(n)
    position[2:], velocity[2:] = law_terms(recording, machine)
    vir = np.array(recording.vir)
    if recording.injected is not None:
        vir -= injected_scale(recording, machine) * recording.injected
    lag = _lag(vir[2:], position[2:], velocity[2:])
    position, velocity = np.roll(position, lag), np.roll(velocity, lag)
    first, last = 2 + max(lag, 0), n + min(lag, 0)
    P, V, r = position[first:last], velocity[first:last], (vir - position - velocity)[first:last]

    low = LowPass.butterworth(band_hz, c.sample_time)
    residual = np.zeros(n)
    residual[first:last] = r
    rms_band = _rms(low(residual, odd=False))
    commanded = max(_rms(low(recording.vir, odd=False)), 1e-300)

    candidates = [effects for effects in _CANDIDATES if not set(effects) & set(exclude)]
    explanations = [_explain(effects, r, P, V, c.sample_time) for effects in candidates]
    spans: list[tuple[int, int]] = []
    shapes: list[np.ndarray] = []
    rectangular = True
    if _PULSES not in exclude and rms_band * _unexplained(explanations) > RELEVANT * commanded:
        free, smallest = [P, P + V, *_delayed(V)], 0.005 * _rms(recording.vir)
        spans = _pulses(r, free, smallest)
        rectangular = bool(spans)
        spans = spans or _rounded(r, free, smallest)
        shapes = _shapes(spans, len(r))
        if not rectangular:
            shapes = [shape * r / _peak(r[a:b]) for shape, (a, b) in zip(shapes, spans, strict=True)]
    if spans:
        explanations += [_explain((*e, _PULSES), r, P, V, c.sample_time, shapes) for e in candidates]

    counting = _counting(encoder_grid(recording, machine) or machine.encoder.resolution, machine, low)
    found = LawResidual(
        residual=residual,
        rms=_rms(r),
        lag=lag,
        rms_band=rms_band,
        relative=rms_band / commanded,
        counting=counting,
        noise=min(max(counting, white_in_band(r, c.sample_time, low)), rms_band * _unexplained(explanations)),
        explanations=tuple(explanations),
        free_filter=_free_filter(r, V),
        pulses=(),
    )
    if not spans or not found.significant:
        return found
    best = found.best()
    volts = (best if _PULSES in best.effects else found.of(_PULSES)).parameters
    times = np.append(recording.t, recording.t[-1] + c.sample_time) - recording.t[0]
    # What is on at the first sample whose law is known was on before; likewise at the last.
    rows = [(first + a if a else 0, first + b if b < len(r) else n) for a, b in spans]
    pulses = [
        Pulse(
            float(times[a]),
            float(times[b]),
            volts[f"{_PULSES}.A{i}"],
            None if rectangular else np.interp(np.arange(a, b) - first, np.arange(len(r)), shape),
        )
        for i, ((a, b), shape) in enumerate(zip(rows, shapes, strict=True))
    ]
    return dataclasses.replace(found, pulses=tuple(pulses))


def _unexplained(explanations: Sequence[Explanation]) -> float:
    """The part of the rms of r_C that the best explanation leaves; about the same inside the band."""
    return float(np.sqrt(max(0.0, 1 - max(e.share for e in explanations))))


# -- explanations --------------------------------------------------------------------------------------------------

_PULSES = "disturbance_pulses"
_CANDIDATES: tuple[tuple[str, ...], ...] = (
    (),
    ("position_gain",),
    ("velocity_gain",),
    ("velocity_filter",),
    ("position_gain", "velocity_gain"),
)


def _explain(
    effects: tuple[str, ...],
    r: np.ndarray,
    P: np.ndarray,
    V: np.ndarray,
    dt: float,
    shapes: Sequence[np.ndarray] = (),
) -> Explanation:
    """Least squares of r_C on what the effects add to the law; `shapes` are those of unit pulses."""
    columns = {f"{_PULSES}.A{i}": shape for i, shape in enumerate(shapes)}
    if "velocity_filter" in effects:
        return _filter(effects, r, V, dt, columns)
    if "position_gain" in effects:
        columns["position_gain.e"] = P
    if "velocity_gain" in effects:  # the velocity loop's gain multiplies the whole law
        columns["velocity_gain.e"] = P + V
    values, left = _solve(list(columns.values()), r)
    covariance = _covariance(list(columns.values()), left)
    parameters = dict(zip(columns, values.tolist(), strict=True))
    if {"position_gain", "velocity_gain"} <= set(effects):
        # kv (1 + ev) (kp (1 + ep) (qg - qm) - dq): the column of position was fitted by (1 + ev) ep
        i, j = (list(columns).index(f"{name}.e") for name in ("position_gain", "velocity_gain"))
        factor = 1 + parameters["velocity_gain.e"]
        parameters["position_gain.e"] /= factor
        change = np.eye(len(columns))
        change[i, i], change[i, j] = 1 / factor, -parameters["position_gain.e"] / factor
        covariance = change @ covariance @ change.T
    return _explained(effects, parameters, covariance, r, left)


def _filter(
    effects: tuple[str, ...], r: np.ndarray, V: np.ndarray, dt: float, columns: dict[str, np.ndarray]
) -> Explanation:
    """F[k] = a F[k-1] + (1 - a) V[k], a = exp(-dt / T), in place of V: T by a search, all else by least squares.

    What the filter held before the record starts is unknown and fades with a^k.
    """
    Q = np.linalg.qr(np.column_stack(list(columns.values())))[0] if columns else np.zeros((len(r), 0))

    def model(T: float) -> tuple[np.ndarray, np.ndarray]:
        a = float(np.exp(-dt / T))
        return scipy.signal.lfilter([1 - a], [1, -a], V) - V, a ** np.arange(1.0, len(V) + 1)

    def left(T: float) -> float:
        change, memory = (x - Q @ (Q.T @ x) for x in model(T))
        rest = r_alone - change
        return _rms(rest - memory * (memory @ rest) / (memory @ memory))

    r_alone = r - Q @ (Q.T @ r)
    trials = np.geomspace(0.05 * dt, _LONGEST_FILTER, 40)
    k = int(np.argmin([left(T) for T in trials]))
    bounds = (float(trials[max(k - 1, 0)]), float(trials[min(k + 1, len(trials) - 1)]))
    # the square: near an exact fit the rms has a corner, which a parabola through three points takes for nothing
    found = scipy.optimize.minimize_scalar(
        lambda T: left(T) ** 2, bounds=bounds, method="bounded", options={"xatol": 1e-9 * dt}
    )
    T = float(found.x)
    change, memory = model(T)
    at = max(T, 0.2 * dt)  # a = exp(-dt / T) has no slope at T = 0
    slope = (model(1.0001 * at)[0] - model(0.9999 * at)[0]) / (2e-4 * at)
    everything = [slope, memory, *columns.values()]
    values, remainder = _solve(everything, r - change)  # a last Gauss-Newton step
    if abs(values[0]) > 0.01 * T:  # no minimum in the range: the search ended at one of its ends
        values, remainder = _solve(everything[1:], r - change)
        values = np.append(0.0, values)
    keep = [0, *range(2, len(everything))]
    covariance = _covariance(everything, remainder)[np.ix_(keep, keep)]
    parameters = {"velocity_filter.T": T + float(values[0]), **dict(zip(columns, values[2:].tolist(), strict=True))}
    return _explained(effects, parameters, covariance, r, remainder)


def _free_filter(r: np.ndarray, V: np.ndarray) -> Explanation:
    columns, r = [x[_TAPS:] for x in _delayed(V)], r[_TAPS:]
    values, left = _solve(columns, r)
    parameters = {f"velocity_filter.b{j}": float(v) for j, v in enumerate(values, start=1)}
    return _explained(("velocity_filter",), parameters, _covariance(columns, left), r, left)


def _explained(
    effects: tuple[str, ...], parameters: dict[str, float], covariance: np.ndarray, r: np.ndarray, left: np.ndarray
) -> Explanation:
    std = dict(zip(parameters, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    share = 1 - float(left @ left) / max(float(r @ r), 1e-300)
    return Explanation(effects, parameters, std, _rms(left), share)


def _solve(columns: Sequence[np.ndarray], target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares: values, and what is left."""
    if not columns:
        return np.zeros(0), target
    A = np.column_stack(columns)
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    A /= size
    values = np.linalg.lstsq(A, target, rcond=1e-12)[0]
    return values / size, target - A @ values


def _covariance(columns: Sequence[np.ndarray], left: np.ndarray) -> np.ndarray:
    """Covariance of least-squares values that allows for correlation over 50 samples: what is left is rarely white.

    References: Newey, West, *A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent
    covariance matrix*, Econometrica 55, 1987.
    """
    if not columns:
        return np.zeros((0, 0))
    A = np.column_stack(columns)
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    Q, R = np.linalg.qr(A / size)
    # Sums over every window of the reach, squared: the weights of Bartlett, 1 - k / reach on lag k.
    reach = min(50, len(left))
    total = np.cumsum(np.pad(Q * left[:, None], ((reach, reach), (0, 0))), axis=0)
    windows = total[reach:] - total[:-reach]
    S = windows.T @ windows / reach
    inverse = np.linalg.pinv(R, rcond=1e-12)
    return inverse @ S @ inverse.T / np.outer(size, size)


def _delayed(V: np.ndarray) -> list[np.ndarray]:
    """What taps 1 to 8 of a filter of unit gain add to V; before the first sample V was as then."""
    padded = np.concatenate([np.full(_TAPS, V[0]), V])
    return [padded[_TAPS - j : len(padded) - j] - V for j in range(1, _TAPS + 1)]


# -- pulses --------------------------------------------------------------------------------------------------------

_WINDOW = 5  # samples on either side of an edge; a shorter pulse is not found
_MOST_PULSES = 30


def _pulses(r: np.ndarray, free: list[np.ndarray], smallest: float) -> list[tuple[int, int]]:
    """Rows [on, off) where r_C has another level, found by its edges while gains and filters stay free.

    The volts act on the loop and so on the law's own terms: edges and the factors of those terms are found in turn.
    Edges survive wrong factors, as they happen within one sample, and the loop takes longer.
    """
    spans: list[tuple[int, int]] = []
    for _ in range(6):
        values = _solve([*free, *_shapes(spans, len(r))], r)[0]
        rest = r - np.column_stack(free) @ values[: len(free)]
        # A record that begins in motion does not say what a filter had seen before: its first samples are no pulse.
        sized = [(a, b) for a, b in _plateaus(rest, smallest) if _WINDOW <= b - a < len(r) / 2]
        if sized == spans:
            break
        spans = sized
    if not spans:
        return []
    without = _rms(_solve(free, r)[1])
    with_them = _rms(_solve([*free, *_shapes(spans, len(r))], r)[1])
    # rectangles must be most of it: anything can be cut into enough steps
    return spans if with_them < 0.5 * without else []


def _rounded(r: np.ndarray, free: list[np.ndarray], smallest: float) -> list[tuple[int, int]]:
    """Rows [on, off) of pulses that come and go smoothly: stretches far above a law that is met everywhere else.

    Their course is r_C's own, so that it must not be what other gains and filters give, the `free` columns.
    """
    if _rms(_solve(free, r)[1]) < 0.5 * _rms(r):
        return []
    quiet = 1.4826 * float(np.median(np.abs(r - np.median(r))))
    high = np.abs(r) > max(6 * quiet, 0.05 * float(np.max(np.abs(r))))
    found = runs(high, bridged=2 * _WINDOW - 1)
    spans = [(a, b) for a, b in found if b - a >= 2 * _WINDOW and abs(_peak(r[a:b])) > smallest]
    held = sum(float(r[a:b] @ r[a:b]) for a, b in spans)
    lasting = sum(b - a for a, b in spans)
    # Few and far apart, and all there is.
    few = 0 < len(spans) <= _MOST_PULSES and lasting < 0.4 * len(r)
    return spans if few and held > 0.98 * float(r @ r) else []


def _peak(x: np.ndarray) -> float:
    """The value furthest from zero."""
    return float(x[np.argmax(np.abs(x))])


def _plateaus(x: np.ndarray, smallest: float) -> list[tuple[int, int]]:
    """Stretches between sharp edges whose median is at least `smallest` (V); equal neighbours are one."""
    cuts = [0, *_edges(x, smallest), len(x)]
    found: list[tuple[int, int, float]] = []
    for a, b in itertools.pairwise(cuts):
        level = float(np.median(x[a:b]))
        if abs(level) < smallest:
            continue
        if found and found[-1][1] == a and abs(level - found[-1][2]) < 0.2 * abs(level):
            found[-1] = (found[-1][0], b, found[-1][2])
        else:
            found.append((a, b, level))
    return [(a, b) for a, b, _ in found]


def _edges(x: np.ndarray, smallest: float) -> list[int]:
    """First samples of new levels: the mean after less the mean before stands out, and the jump is one sample's."""
    w = _WINDOW
    if len(x) < 4 * w:
        return []
    mean = np.convolve(x, np.full(w, 1 / w), mode="valid")  # mean[k] of x[k : k + w]
    step = np.zeros(len(x))
    step[w : len(x) - w + 1] = mean[w:] - mean[:-w]
    spread = 1.4826 * float(np.median(np.abs(step - np.median(step))))
    peaks, _ = scipy.signal.find_peaks(np.abs(step), height=max(6 * spread, smallest), distance=w)
    edges = []
    for k in peaks:
        window = x[k - w : k + w]
        cut = min(range(2, 2 * w - 1), key=lambda i: _spread(window[:i]) + _spread(window[i:]))
        k = int(k - w + cut)
        if abs(x[k] - x[k - 1]) > 0.5 * abs(window[cut:].mean() - window[:cut].mean()):
            edges.append(k)
    return sorted(set(edges))


def _spread(x: np.ndarray) -> float:
    return float(np.sum((x - x.mean()) ** 2))


def _shapes(spans: Sequence[tuple[int, int]], n: int) -> list[np.ndarray]:
    """One on each span, zero elsewhere."""
    rows = np.arange(n)
    return [((rows >= a) & (rows < b)).astype(float) for a, b in spans]


# -- lag, noise, grid ----------------------------------------------------------------------------------------------


def _lag(vir: np.ndarray, P: np.ndarray, V: np.ndarray) -> int:
    """Samples by which vir follows the law, of least residual with the factors of its terms free.

    Two more taps on the velocity are free as well, or a filter there would look like a lag of everything.
    """
    m = _MAX_LAG + 2
    if len(vir) < 20 * m:
        return 0
    last = len(vir) - m
    left = {}
    for lag in range(-_MAX_LAG, _MAX_LAG + 1):
        columns = [x[m - lag - j : last - lag - j] for x, j in ((P, 0), (V, 0), (V, 1), (V, 2))]
        left[lag] = _rms(_solve(columns, vir[m:last])[1])
    best = min(left, key=lambda lag: left[lag])
    return best if left[best] < 0.5 * left[0] else 0


def _counting(count: float, machine: Machine, low: LowPass) -> float:
    """V inside the band when every qm is off by up to half a count, independently: count / sqrt(12) through the law."""
    c = machine.controller
    w, H = scipy.signal.sosfreqz(low.sos, worN=4096)
    law = c.kv * np.abs(c.kp + 1j * np.sin(w) / c.sample_time)
    return float(count / np.sqrt(12) * np.sqrt(np.mean((law * np.abs(H) ** 2) ** 2)))


def encoder_grid(recording: Recording, machine: Machine) -> float | None:
    """Spacing (m) of the lattice that qm lies on, where it is coarser than documented by half or more; else None."""
    least = 1.5 * machine.encoder.resolution
    values = np.unique(recording.qm)
    gaps = np.diff(values)
    # Two readings of one count may differ by the rounding of the numbers in the file.
    values = values[np.append(True, gaps > 0.05 * machine.encoder.resolution)]
    if len(values) < 50:
        return None
    gaps = np.diff(values)
    smallest = float(gaps[gaps < 1.5 * gaps.min()].mean())
    for parts in range(1, 7):  # a fast record may never show two neighbouring counts
        if smallest / parts < 0.95 * least:
            return None
        spacing = _refined(values, smallest / parts)
        steps = (values - values[0]) / spacing
        off = steps - np.round(steps)
        off -= np.round(off - off[len(off) // 2])  # about one of them, wherever it lies between two counts
        if np.ptp(off) < 0.5 and spacing > 0.999 * least:
            return spacing
    return None


def _refined(values: np.ndarray, spacing: float) -> float:
    """The spacing, fitted to whole steps over longer and longer distances, so that no step is miscounted."""
    distances = np.concatenate([values[2**k :] - values[: -(2**k)] for k in range(len(values).bit_length() - 1)])
    reach = 2.0
    while True:
        near = distances[distances <= reach * spacing]
        steps = np.round(near / spacing)
        if steps.any():
            spacing = float(steps @ near / (steps @ steps))
        if len(near) == len(distances):
            return spacing
        reach *= 2


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if len(x) else 0.0
