"""The gap atlas: where simulation and machine part, told without a model of why.

Two questions. *With what* does the residual go: how much of its energy does a smooth function of one recorded variable
close, on stretches of time that it was not fitted to? And *where* does it lie: in which frequencies, phases of motion,
passes and moments? Nothing here knows an effect's equation, so nothing can be found only because it was looked for.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.fft
import scipy.signal
import threadpoolctl

from ..signals import runs
from .relevance import Regression, blocks
from .variables import LABELS, dictionary, largest, smooth

BANDS_HZ = (0.0, 1.0, 3.0, 10.0, 20.0, 35.0, 60.0)
PHASES = ("rest", "low speed", "accelerating", "cruise", "decelerating")
_WHILE = {
    "rest": "at rest",
    "low speed": "at low speed",
    "accelerating": "while accelerating",
    "cruise": "while cruising",
    "decelerating": "while braking",
}
_IT_IS = {"constant": "It is a constant force", "dynamics": "It is a linear response to the reference"}

_SEGMENT_S = 1.0
_WINDOW_S = 0.1
_QUIET = 0.3
_SIDE_HZ = 8.0


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable: share of the residual energy a smooth function of it closes alone, and beyond all others together."""

    name: str
    share: float
    last_in: float

    @property
    def label(self) -> str:
        """Its name as a person reads it."""
        return LABELS[self.name]


@dataclasses.dataclass(frozen=True)
class Part:
    """Share of the residual energy that lies in a part of the record, and the share of it (time, bandwidth) it is."""

    name: str
    energy: float
    size: float
    span: tuple[float, float] | None = None
    """From and to: s, or Hz for a band; None for a phase, which comes in pieces."""

    @property
    def times(self) -> float:
        """Energy against size: 5 means five times more than its share."""
        return self.energy / self.size if self.size > 0 else 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Atlas:
    """Where a residual r (N) lies. Shares are of its energy, sum(r^2).

    - `rms`, `floor_rms` N: of r, and of what looks like noise in it (see `_quiet_rms`)
    - `closed` share that all variables together close, cross-validated; 0 for noise
    - `explainable` 1 - (floor_rms / rms)^2: also what is bound to moments, resonances or thresholds, which no smooth
      function follows; noise alone gives up to about 0.1, slow drift of it more
    - `variables` by share alone; what several could close counts in each, and last in for none
    - `bands`, `phases`, `passes` (strokes between reversals), `segments` (1 s), each summing to 1; `intervals` where
      the power exceeds four times its median
    - `table` (bands, phases) share of energy; its rows sum to the bands exactly, its columns to the phases nearly
    - `side` "motor" or "load", None if not told
    - `t` s, `residual` N, `reference` m: what was looked at, for the picture
    """

    rms: float
    floor_rms: float
    closed: float
    variables: tuple[Variable, ...]
    bands: tuple[Part, ...]
    phases: tuple[Part, ...]
    passes: tuple[Part, ...]
    segments: tuple[Part, ...]
    intervals: tuple[Part, ...]
    table: np.ndarray
    side: str | None
    t: np.ndarray
    residual: np.ndarray
    reference: np.ndarray

    @property
    def explainable(self) -> float:
        """Share of the energy above the floor."""
        return 1 - (self.floor_rms / self.rms) ** 2 if self.rms > 0 else 0.0

    def __getitem__(self, name: str) -> Variable:
        """A variable by its key in `LABELS`."""
        return next(v for v in self.variables if v.name == name)

    def words(self) -> str:
        """Where the gap lies, in two or three sentences."""
        head = f"The simulation misses the commanded force by {self.rms:.2g} N rms"
        if self.explainable < 0.15:
            return f"{head}, which looks like noise. Nothing recorded with it closes a tenth of its energy."
        head += f"; about {self.floor_rms:.2g} N of that looks like noise."
        return " ".join(filter(None, [head, self._with_what(), self._where()]))

    def _with_what(self) -> str:
        first, *rest = self.variables
        if first.share < 0.1:
            return "No single variable closes a tenth of its energy."
        if first.name == "v_even" and self["constant"].share > 0.97 * first.share:
            first = self["constant"]  # a function of speed may be constant, and this one is
        said = _IT_IS.get(first.name, f"It goes with {first.label}")
        said += f", which alone closes {_percent(first.share)} of its energy"
        if first.last_in > 0.9 * first.share:
            return f"{said}, and nothing else does."
        if first.last_in > 0.3 * first.share:
            return f"{said}, {_percent(first.last_in)} that nothing else closes."
        nested = {"constant", "v_even", first.name}
        rivals = [v for v in rest if v.share > 0.85 * first.share and v.name not in nested]
        if rivals:
            either = f"{rivals[0].label} ({_percent(rivals[0].share)})"
            return f"{said}; {either} does nearly as well, and this record hardly tells them apart."
        return f"{said}."

    def _where(self) -> str:
        low, high = _middle([b.energy for b in self.bands])
        said = f"It lies at {self.bands[low].name.split('–')[0]}–{self.bands[high].name.split('–')[1]}"
        phase = max(self.phases, key=lambda p: p.energy * np.log(max(p.times, 1e-9)))
        if phase.times > 1.5 and phase.energy > 0.25:
            said += f", above all {_WHILE[phase.name]}"
            said += f" ({_percent(phase.energy)} of it in {_percent(phase.size)} of the time)"
        held, lasting = (sum(getattr(i, key) for i in self.intervals) for key in ("energy", "size"))
        if held > 0.3 and held > 3 * lasting:
            loudest = sorted(self.intervals, key=lambda i: -i.energy)[:3]
            names = ", ".join(i.name for i in self.intervals if i in loudest)
            count = len(self.intervals)
            many = "" if count == 1 else f"{count} intervals, " if count <= 3 else f"{count} intervals, the largest "
            said += f"; {many}{names}, hold{'s' if count == 1 else ''} {_percent(held)}"
        side = {"motor": "; the load does not show it", "load": "; the load's deflection shows it too"}
        return said + side.get(self.side or "", "") + "."

    def as_json(self) -> dict[str, Any]:
        """The same in plain dicts and numbers, without the signals."""

        def parts(row: Sequence[Part]) -> list[dict[str, Any]]:
            return [
                {"name": p.name, "energy": p.energy, "size": p.size, "times": p.times}
                | ({"span": list(p.span)} if p.span else {})
                for p in row
            ]

        return {
            "rms_N": self.rms,
            "floor_rms_N": self.floor_rms,
            "closed": self.closed,
            "explainable": self.explainable,
            "variables": [{"name": v.name, "share": v.share, "last_in": v.last_in} for v in self.variables],
            "bands": parts(self.bands),
            "phases": parts(self.phases),
            "passes": parts(self.passes),
            "segments": parts(self.segments),
            "intervals": parts(self.intervals),
            "band_by_phase": self.table.tolist(),
            "side": self.side,
            "words": self.words(),
        }


def atlas(
    t: np.ndarray,
    residual: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    reference: np.ndarray,
    dt: float,
    lead: float,
    load: np.ndarray | None = None,
) -> Atlas:
    """Atlas of a residual (N): commanded force of the record less the simulation's, in the band, decimated.

    All arrays (n,), every `dt` s: motor position q m, velocity v m/s, acceleration a m/s2, reference m; `lead` m/turn.
    `load` is the residual of the load's deflection, q2 - q1 recorded less simulated, m.
    """
    r = np.asarray(residual, dtype=float)
    if not np.isfinite(r).all():
        raise ValueError("the residual of an atlas must be finite; a simulation that diverged has none.")
    columns = dictionary(t, q, v, a, reference, dt, lead)
    with threadpoolctl.threadpool_limits(1, user_api="blas"):  # threads only wait for each other at this size
        variables, closed, left = _shares(columns, r, dt)
    rms = float(np.sqrt(np.mean(r**2)))
    floor_rms = min(_quiet_rms(left, dt), float(np.sqrt(np.mean(left**2))), rms)
    energy = r**2 / max(float(r @ r), 1e-300)
    bands, split = _bands(r, dt)
    phase, passes = _phases(reference, dt)
    table = np.array([[np.sum(row[phase == k] ** 2) for k in range(len(PHASES))] for row in split])
    table /= max(float(r @ r), 1e-300)
    return Atlas(
        rms=rms,
        floor_rms=floor_rms,
        closed=closed,
        variables=variables,
        bands=bands,
        phases=tuple(
            Part(name, float(energy[phase == k].sum()), float(np.mean(phase == k))) for k, name in enumerate(PHASES)
        ),
        passes=_stretches(t, energy, passes, dt),
        segments=_stretches(t, energy, _edges(len(r), _SEGMENT_S / dt), dt),
        intervals=_intervals(t, energy, dt),
        table=table,
        side=None if load is None or floor_rms > 0.9 * rms else _side(r, np.asarray(load, dtype=float), dt),
        t=np.asarray(t),
        residual=r,
        reference=np.asarray(reference),
    )


# -- shares ------------------------------------------------------------------------------------------------------


def _shares(columns: dict[str, np.ndarray], r: np.ndarray, dt: float) -> tuple[tuple[Variable, ...], float, np.ndarray]:
    """Every variable's share alone and last in, the share of all together, and what all together leave, (n,) N."""
    fit = Regression(list(columns.values()), r, blocks(len(r), dt))
    names = list(columns)
    if fit.energy == 0:
        return tuple(Variable(name, 0.0, 0.0) for name in names), 0.0, r
    together = fit.prior(range(len(names)))
    closed = fit.share(together)
    found = []
    for k, name in enumerate(names):
        alone = [names.index("constant"), k] if name == "v_even" else [k]
        last_in = 0.0
        if closed > 0 and together.sizes[k] > 0:
            # The others may take over what this one held, so their sizes are found anew.
            others = [j for j in range(len(names)) if j != k]
            last_in = max(closed - fit.share(fit.prior(others, together.sizes[others], rounds=6)), 0.0)
        found.append(Variable(name, fit.share(fit.prior(alone)), last_in))
    left = fit.residual(together) if closed > 0 else r
    return tuple(sorted(found, key=lambda v: -v.share)), closed, left


def _quiet_rms(left: np.ndarray, dt: float) -> float:
    """Rms of the noise (N) in what the variables leave: at each frequency the power that its quiet windows have.

    Windows of 0.5 s; the 30 % quantile of their periodograms, which for noise is -log(0.7) times the mean, so that what
    is bound to moments (pulses, reversals, resonances met by a chirp) stays out.

    References: Allen et al., *FINDCHIRP*, Phys. Rev. D 85, 122006 (2012), appendix B, for the median.
    """
    length = min(round(0.5 / dt), len(left) // 4)
    if length < 8:
        return float(np.sqrt(np.mean(left**2)))
    f, _, power = scipy.signal.spectrogram(
        left, 1 / dt, window="hann", nperseg=length, noverlap=length // 2, detrend=False, scaling="density"
    )
    density = np.quantile(power, _QUIET, axis=1) / -np.log(1 - _QUIET)
    return float(np.sqrt(np.sum(density) * (f[1] - f[0])))


# -- parts: frequencies, phases, passes, moments -----------------------------------------------------------------


def _bands(r: np.ndarray, dt: float) -> tuple[tuple[Part, ...], np.ndarray]:
    """Energy by frequency band, and r split into the bands, (bands, n), by a cosine transform: no jump at the ends."""
    n, nyquist = len(r), 0.5 / dt
    spectrum = scipy.fft.dct(r, norm="ortho")
    f = np.arange(n) * nyquist / n
    ends = [e for e in BANDS_HZ[:-1] if e < nyquist] + [nyquist]  # the last one holds what is above 60 Hz, too
    parts, split = [], []
    for low, high in itertools.pairwise(ends):
        inside = np.where((f >= low) & (f < high), spectrum, 0.0)
        split.append(scipy.fft.idct(inside, norm="ortho"))
        shown = min(high, BANDS_HZ[-1])
        energy = float(inside @ inside) / max(float(r @ r), 1e-300)
        parts.append(Part(f"{low:g}–{shown:g} Hz", energy, (high - low) / nyquist, (low, shown)))
    return tuple(parts), np.array(split)


def _phases(reference: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Phase of motion of every sample (place in `PHASES`), and where passes begin and end, from the reference.

    The reference is smoothed over 0.2 s, so that a chirp on top of a cruise is still cruise.
    """
    velocity = np.gradient(reference, dt)
    v = smooth(velocity, 0.2, dt)
    a = np.gradient(v, dt)
    fastest, hardest = largest(v), largest(a)
    phase = np.full(len(v), PHASES.index("cruise"))
    phase[a * np.sign(v) > 0.15 * hardest] = PHASES.index("accelerating")
    phase[a * np.sign(v) < -0.15 * hardest] = PHASES.index("decelerating")
    phase[np.abs(v) < 0.1 * fastest] = PHASES.index("low speed")
    phase[smooth(np.abs(velocity), 0.04, dt) < 2e-3 * fastest] = PHASES.index("rest")
    moving = np.flatnonzero(np.abs(v) > 0.1 * fastest)
    turn = np.flatnonzero(np.diff(np.sign(v[moving])) != 0)
    between = (moving[turn] + moving[turn + 1] + 1) // 2 if moving.size else np.zeros(0, dtype=int)
    return phase, np.concatenate([[0], between, [len(v)]]).astype(int)


def _edges(n: int, length: float) -> np.ndarray:
    """Ends of equal stretches of about this many samples."""
    return np.round(np.linspace(0, n, max(1, round(n / length)) + 1)).astype(int)


def _stretches(t: np.ndarray, energy: np.ndarray, edges: np.ndarray, dt: float) -> tuple[Part, ...]:
    """One part for each stretch between two edges."""
    return tuple(_stretch(t, energy, i, j, dt) for i, j in itertools.pairwise(edges))


def _stretch(t: np.ndarray, energy: np.ndarray, i: int, j: int, dt: float) -> Part:
    on, off = float(t[i]), float(t[j - 1]) + dt
    return Part(f"{on:.2f}–{off:.2f} s", float(energy[i:j].sum()), (j - i) / len(t), (on, off))


def _intervals(t: np.ndarray, energy: np.ndarray, dt: float) -> tuple[Part, ...]:
    """At most eight intervals whose power, over 0.1 s, exceeds four times its median, and which hold 2 % or more."""
    power = smooth(energy, 2 * _WINDOW_S, dt)
    loud = power > 4 * max(float(np.median(power)), 1e-6 / len(t))
    found = [_stretch(t, energy, i, j, dt) for i, j in runs(loud, bridged=_WINDOW_S / dt)]
    kept = sorted((p for p in found if p.energy > 0.02), key=lambda p: -p.energy)[:8]
    return tuple(sorted(kept, key=lambda p: p.span or (0.0, 0.0)))


def _side(r: np.ndarray, load: np.ndarray, dt: float) -> str | None:
    """Which side of the coupling a slow force acts on: on the load it bends the coupling by F / K12, on the motor not.

    Below 8 Hz the inertia of the load hides neither. None if the residual is faster, or something in between.
    """
    low = scipy.fft.dct(r, norm="ortho")[: max(2, round(2 * _SIDE_HZ * dt * len(r)))]
    bend = scipy.fft.dct(load, norm="ortho")[: len(low)]
    energy, bent = float(low @ low), float(bend @ bend)
    if energy < 0.2 * float(r @ r) or bent == 0:
        return None
    cosine = float(low @ bend) / np.sqrt(energy * bent)
    return "load" if cosine < -0.8 else "motor" if abs(cosine) < 0.6 else None


def _middle(energies: Sequence[float]) -> tuple[int, int]:
    """First and last of the fewest neighbouring parts that hold two thirds of the energy."""
    n = len(energies)
    spans = [(i, j) for i in range(n) for j in range(i, n)]
    enough = [(i, j) for i, j in spans if sum(energies[i : j + 1]) > 2 / 3 * sum(energies)] or [(0, n - 1)]
    return min(enough, key=lambda s: (s[1] - s[0], -sum(energies[s[0] : s[1] + 1])))


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
