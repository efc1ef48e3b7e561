"""The gap atlas: where simulation and machine part, told without a model of why.

Two questions. *With what* does the residual go: how much of its energy does a smooth function of one recorded variable
close, on stretches of time that it was not fitted to? And *where* does it lie: in which frequencies, phases of motion,
passes and moments? Nothing here knows an effect's equation, so nothing can be found only because it was looked for.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.fft
import scipy.linalg
import scipy.signal
import threadpoolctl

LABELS = {
    "constant": "constant",
    "v_even": "speed (even)",
    "v_odd": "velocity (odd)",
    "q": "position",
    "direction_q": "direction × position",
    "screw": "screw angle",
    "direction_screw": "direction × screw angle",
    "time": "time",
    "direction_time": "direction × time",
    "reversal": "time since reversal",
    "dynamics": "linear dynamics",
    "acceleration": "acceleration (not linear)",
    "time_acceleration": "time × acceleration",
}
"""Variables by key, as a person reads them."""

BANDS_HZ = (0.0, 1.0, 3.0, 10.0, 20.0, 35.0, 60.0)
PHASES = ("rest", "low speed", "accelerating", "cruise", "decelerating")
_WHILE = dict(
    zip(PHASES, ("at rest", "at low speed", "while accelerating", "while cruising", "while braking"), strict=True)
)

_BLOCK_S = 0.4
"""Longer than any filter or lag that ties neighbours, short enough that slow functions of time bridge a gap."""
_FOLDS = 5
_TEMPER = 3.0
"""Noise inside the band, and what no column fits, is correlated over a few samples: that many count as one."""
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
    - `explainable` share that all variables together close, cross-validated; 0 for noise
    - `structured` 1 - (floor_rms / rms)^2: also what is bound to moments, resonances or thresholds that no smooth
      function follows; noise alone gives up to about 0.1
    - `variables` by share; `v_even` may hold a constant, every other one has its mean or its sign's mean removed
    - `bands`, `phases`, `passes` (strokes between reversals), `segments` (1 s), each summing to 1; `intervals` where the
      power exceeds four times its median
    - `table` (bands, phases) share of energy; its rows sum to the bands exactly, its columns to the phases nearly
    - `side` "motor" or "load", None if not told
    - `t` s, `residual` N, `reference` m: what was looked at, for the picture
    """

    rms: float
    floor_rms: float
    explainable: float
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
    def structured(self) -> float:
        """Share of the energy above the floor."""
        return 1 - (self.floor_rms / self.rms) ** 2 if self.rms > 0 else 0.0

    def __getitem__(self, name: str) -> Variable:
        """A variable by its key in `LABELS`."""
        return next(v for v in self.variables if v.name == name)

    def words(self) -> str:
        """Where the gap lies, in two or three sentences."""
        head = f"The simulation misses the commanded force by {self.rms:.2g} N rms"
        if max(self.explainable, self.structured) < 0.15:
            return f"{head}, which looks like noise. Nothing recorded with it closes a tenth of its energy."
        head += f"; about {self.floor_rms:.2g} N of that looks like noise."
        return " ".join(filter(None, [head, self._with_what(), self._where()]))

    def _with_what(self) -> str:
        first, *rest = self.variables
        if first.share < 0.1:
            return "No single variable closes a tenth of its energy."
        if first.name == "v_even" and self["constant"].share > 0.97 * first.share:
            first = self["constant"]  # a function of speed may be constant, and this one is
        said = f"It goes with {first.label}, which alone closes {_percent(first.share)} of its energy"
        nested = {"constant", "v_even", first.name}
        rivals = [v for v in rest if v.share > 0.85 * first.share and v.name not in nested]
        if first.last_in > 0.3 * first.share:
            return f"{said}; {_percent(first.last_in)} nothing else closes."
        if rivals:
            either = f"{rivals[0].label} ({_percent(rivals[0].share)})"
            return f"{said}; {either} does nearly as well, and this record hardly tells them apart."
        return f"{said}, most of which other variables together close as well."

    def _where(self) -> str:
        low, high = _middle([b.energy for b in self.bands])
        hz = f"{self.bands[low].name.split('–')[0]}–{self.bands[high].name.split('–')[1]}"
        phase = max(self.phases, key=lambda p: p.energy)
        said = f"It lies at {hz}, most of it {_WHILE[phase.name]} ({_percent(phase.energy)} of it"
        said += f" in {_percent(phase.size)} of the time)"
        held, lasting = (sum(getattr(i, key) for i in self.intervals) for key in ("energy", "size"))
        if held > 0.3 and held > 3 * lasting:
            largest = sorted(self.intervals, key=lambda i: -i.energy)[:3]
            names = ", ".join(i.name for i in self.intervals if i in largest)
            count = len(self.intervals)
            many = "" if count == 1 else f"{count} intervals, " if count <= 3 else f"{count} intervals, the largest "
            said += f"; {many}{names}, hold{'s' if count == 1 else ''} {_percent(held)} in {_percent(lasting)}"
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
            "explainable": self.explainable,
            "structured": self.structured,
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
    columns = _dictionary(t, q, v, a, reference, dt, lead)
    with threadpoolctl.threadpool_limits(1, user_api="blas"):  # threads only wait for each other at this size
        variables, explainable, left = _shares(columns, r, dt)
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
        explainable=explainable,
        variables=variables,
        bands=bands,
        phases=tuple(
            Part(name, float(energy[phase == k].sum()), float(np.mean(phase == k))) for k, name in enumerate(PHASES)
        ),
        passes=_stretches(t, energy, passes, dt),
        segments=_stretches(t, energy, _edges(len(r), _SEGMENT_S / dt), dt),
        intervals=_intervals(t, energy, dt),
        table=table,
        side=None if load is None else _side(r, np.asarray(load, dtype=float), dt, explainable),
        t=np.asarray(t),
        residual=r,
        reference=np.asarray(reference),
    )


# -- variables: what the residual may be a smooth function of ----------------------------------------------------


def _dictionary(
    t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, reference: np.ndarray, dt: float, lead: float
) -> dict[str, np.ndarray]:
    """Columns (n, m) of every variable in `LABELS`, each with a mean square of 1 under its prior.

    A smooth function is a sum of cosines over the variable's range, amplitudes falling as 1/k: rough ones cost more.
    Speed is stretched near zero, where friction bends. Linear dynamics take their input from the reference alone (and
    the sign of friction): through the measured motion, noise would explain itself around the loop.
    """
    fastest, strongest = _largest(v), _largest(a)
    sign = np.tanh(v / (0.01 * fastest))
    direction = sign[:, None]
    w = _unit(np.log1p(np.abs(v) / (0.03 * fastest)))
    speed = _cosines(w, 8, 4)
    place = _cosines(_unit(q), 24, 6)[:, 1:]
    clock = _cosines(_unit(t), int(np.clip(1.2 * np.ptp(t), 6, 24)), 4)[:, 1:]
    # The screw's angle turns into a frequency that grows with speed, and the loop answers each frequency its own way.
    angle = 2 * np.pi * q / lead
    waves = np.column_stack([f(n * angle) for n in (1, 2) for f in (np.sin, np.cos)])
    screw = np.concatenate([waves * c[:, None] for c in _cosines(w, 3, 4).T], axis=1)
    memory, last = _since_reversal(v, fastest, dt)
    step = max(1, round(8e-3 / dt))
    driven = np.zeros_like(q)
    driven[1:-1] = np.diff(reference, 2) / dt**2
    response = _lags(driven, -4, 40, step)
    dynamics = [response, _lags(sign, -2, 12, step), *(x[:, None] for x in (np.gradient(reference, dt), v, a))]
    b = a / strongest
    bent = np.column_stack([b**3, b**5, np.abs(b) * sign, b**2, b**2 * sign])
    columns = {
        "constant": np.ones((len(q), 1)),
        "v_even": speed[:, 1:],
        "v_odd": direction * speed,
        "q": place - place.mean(axis=0),
        "direction_q": direction * place,
        "screw": screw,
        "direction_screw": direction * screw,
        "time": clock,
        "direction_time": direction * clock,
        "reversal": np.concatenate([memory, last[:, None] * memory], axis=1),
        "dynamics": np.concatenate([_scaled(x) for x in dynamics], axis=1),
        "acceleration": bent,
        "time_acceleration": b[:, None] * clock,
    }
    return {name: _scaled(x) for name, x in columns.items()}


def _since_reversal(v: np.ndarray, fastest: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Fading memory of the last stop or start, (n, 7), and the direction of the last motion, which rest keeps.

    At rest friction still pushes as it did when the motion ended: a constant there, and exponentials both there and in
    motion, of 30, 100 and 300 ms.
    """
    smooth = _smooth(v, 0.04, dt)
    index = np.arange(len(v))
    moving = np.abs(smooth) > 0.02 * fastest
    at = np.maximum.accumulate(np.where(moving, index, -1))
    last = np.where(at >= 0, np.sign(smooth[at]), 0.0)
    changed = (np.diff(moving) != 0) | (last[1:] * last[:-1] < 0)
    event = np.maximum.accumulate(np.concatenate([[-1], np.where(changed, index[1:], -1)]))
    since = np.where(event >= 0, (index - event) * dt, np.inf)  # nothing is known of before the record
    rest = ~moving[:, None]
    fading = np.exp(-since[:, None] / np.array([0.03, 0.1, 0.3]))
    return np.concatenate([rest, rest * fading, ~rest * fading], axis=1), last


def _cosines(u: np.ndarray, most: int, corner: float) -> np.ndarray:
    """cos(k pi u), k = 0 to `most`, falling as 1/k above the corner: an even continuation of u in [0, 1] has no jump."""
    k = np.arange(most + 1)
    return np.cos(np.pi * np.outer(u, k)) / np.sqrt(1 + (k / corner) ** 2)


def _lags(x: np.ndarray, first: int, last: int, step: int) -> np.ndarray:
    """x delayed by first to last steps, fading over 20 steps; 0 before and after the record."""
    padded = np.pad(x, (last * step, -first * step))
    columns = [
        padded[(last - k) * step : (last - k) * step + len(x)] * np.exp(-abs(k) / 20) for k in range(first, last + 1)
    ]
    return np.column_stack(columns)


def _unit(x: np.ndarray) -> np.ndarray:
    """x moved and scaled to [0, 1]; 0 where it is constant."""
    return (x - x.min()) / max(float(np.ptp(x)), 1e-300)


def _largest(x: np.ndarray) -> float:
    return max(float(np.abs(x).max()), 1e-12)


def _scaled(x: np.ndarray) -> np.ndarray:
    """x with the mean square of its rows at 1; 0 stays 0."""
    size = np.sqrt(np.mean(np.sum(x**2, axis=1)))
    return x / size if size > 0 else x


def _smooth(x: np.ndarray, seconds: float, dt: float) -> np.ndarray:
    """Weighted mean (Hann) over so many seconds, the ends held."""
    half = max(1, round(0.5 * seconds / dt))
    window = np.hanning(2 * half + 3)[1:-1]
    return np.convolve(np.pad(x, half, mode="edge"), window / window.sum(), mode="valid")


# -- shares: Bayesian linear regression, judged on blocks left out ------------------------------------------------


def _shares(columns: dict[str, np.ndarray], r: np.ndarray, dt: float) -> tuple[tuple[Variable, ...], float, np.ndarray]:
    """Every variable's share alone and last in, the share of all together, and what all together leave, (n,) N."""
    fit = _Regression(list(columns.values()), r, _folds(len(r), dt))
    names = list(columns)
    if fit.energy == 0:
        return tuple(Variable(name, 0.0, 0.0) for name in names), 0.0, r
    together = fit.prior(range(len(names)))
    explainable = fit.share(together)
    found = []
    for k, name in enumerate(names):
        alone = [names.index("constant"), k] if name == "v_even" else [k]
        last_in = 0.0
        if explainable > 0 and together.sizes[k] > 0:
            # The others may take over what this one held, so their sizes are found anew.
            others = [j for j in range(len(names)) if j != k]
            last_in = max(explainable - fit.share(fit.prior(others, together.sizes[others], rounds=6)), 0.0)
        found.append(Variable(name, fit.share(fit.prior(alone)), last_in))
    left = fit.residual(together) if explainable > 0 else r
    return tuple(sorted(found, key=lambda v: -v.share)), explainable, left


def _folds(n: int, dt: float) -> np.ndarray:
    """Fold of every sample: blocks of 0.4 s (less if the record is short), shuffled within each run of five.

    In order they would fall on the same place of a stroke that repeats every two seconds, and never be fitted there.
    """
    length = max(1, min(round(_BLOCK_S / dt), n // (2 * _FOLDS)))
    blocks = -(-n // length)
    rng = np.random.default_rng(0)
    order = np.concatenate([rng.permutation(_FOLDS) for _ in range(-(-blocks // _FOLDS))])
    return np.repeat(order[:blocks], length)[:n]


@dataclasses.dataclass(frozen=True)
class _Prior:
    """Groups of columns, the variance of the weights of each (N^2), and that of the noise (N^2)."""

    groups: tuple[int, ...]
    sizes: np.ndarray
    noise: float


class _Regression:
    """r = sum_g X_g w_g + noise, w_g ~ N(0, s_g I): a size s_g for each group of columns, found from the evidence.

    A group that the residual does not need gets the size 0 and costs nothing, however many columns it has. The sizes
    come from the whole record, a dozen numbers; the weights never see the block they are judged on.

    References: MacKay, *Bayesian interpolation*, Neural Computation 4 (1992), section 4, with a size for each group.
    """

    def __init__(self, groups: Sequence[np.ndarray], r: np.ndarray, folds: np.ndarray) -> None:
        self.X, self.r, self.folds = np.concatenate(groups, axis=1), r, folds
        ends = np.cumsum([x.shape[1] for x in groups])
        self.places = [np.arange(e - x.shape[1], e) for e, x in zip(ends, groups, strict=True)]
        parts = [folds == k for k in range(_FOLDS)]
        self.grams = np.array([self.X[p].T @ self.X[p] for p in parts])
        self.products = np.array([self.X[p].T @ r[p] for p in parts])
        self.energies = np.array([r[p] @ r[p] for p in parts])
        self.energy = float(r @ r)

    def prior(self, groups: Sequence[int], start: np.ndarray | None = None, rounds: int = 12) -> _Prior:
        """The sizes for which r is likeliest, with all groups in at first; enough rounds that shares settle."""
        n, mean = len(self.r), self.energy / len(self.r)
        gram_all, product_all = self.grams.sum(axis=0), self.products.sum(axis=0)
        sizes = np.full(len(groups), 0.1 * mean) if start is None else np.maximum(start, 1e-3 * mean)
        noise = 0.5 * mean
        for _ in range(rounds):
            active = np.flatnonzero(sizes > 0)
            if active.size == 0:
                break
            at, h = self._active(_Prior(tuple(groups), sizes, noise))
            gram, product = gram_all[np.ix_(at, at)] * h[:, None] * h, product_all[at] * h
            precision = _TEMPER * noise
            root = _inverse_root(gram / precision)
            w = root.T @ (root @ product) / precision
            counts = np.array([len(self.places[groups[k]]) for k in active])
            firsts = np.cumsum(counts) - counts
            determined = counts - np.add.reduceat(np.sum(root**2, axis=0), firsts)  # weights that the data decide
            new = sizes[active] * np.add.reduceat(w**2, firsts) / np.maximum(determined, 1e-12)
            new[(determined < 1e-6) | (new < 1e-5 * mean)] = 0.0
            unexplained = self.energy - 2 * w @ product + w @ gram @ w
            last, noise = noise, max(unexplained / max(n - determined.sum(), 1.0), 1e-12 * mean)
            settled = (new > 0).all() and (np.abs(np.log(new / sizes[active])) < 0.1).all()
            sizes[active] = new
            if settled and abs(np.log(noise / last)) < 0.02:
                break
        return _Prior(tuple(groups), sizes, noise)

    def share(self, prior: _Prior) -> float:
        """Share of the energy that is closed on the blocks left out; 0 where it grows."""
        if not np.any(prior.sizes > 0):
            return 0.0
        at, _ = self._active(prior)
        left = self.energy
        for k, w in enumerate(self._weights(prior)):
            left += w @ self.grams[k][np.ix_(at, at)] @ w - 2 * w @ self.products[k][at]
        return max(float(1 - left / self.energy), 0.0)

    def residual(self, prior: _Prior) -> np.ndarray:
        """What is left at every sample, predicted from the folds that it is not in."""
        at, _ = self._active(prior)
        left = self.r.copy()
        for k, w in enumerate(self._weights(prior)):
            part = self.folds == k
            left[part] -= self.X[np.ix_(part, at)] @ w
        return left

    def _active(self, prior: _Prior) -> tuple[np.ndarray, np.ndarray]:
        """Columns of the groups whose size is not 0, and the root of each one's size."""
        chosen = [(self.places[g], s) for g, s in zip(prior.groups, prior.sizes, strict=True) if s > 0]
        return np.concatenate([p for p, _ in chosen]), np.sqrt(np.concatenate([np.full(len(p), s) for p, s in chosen]))

    def _weights(self, prior: _Prior) -> list[np.ndarray]:
        """Weights of the active columns, fitted without each fold in turn."""
        at, h = self._active(prior)
        grams, products = self.grams[:, at[:, None], at] * h[:, None] * h, self.products[:, at] * h
        precision = _TEMPER * prior.noise
        out = []
        for gram, product in zip(grams.sum(axis=0) - grams, products.sum(axis=0) - products, strict=True):
            A = gram / precision + np.eye(len(at))
            factor = scipy.linalg.cho_factor(A, lower=True, overwrite_a=True, check_finite=False)
            out.append(h * scipy.linalg.cho_solve(factor, product / precision, check_finite=False))
        return out


def _inverse_root(gram: np.ndarray) -> np.ndarray:
    """L^-1 with L L' = I + gram; the squares in its columns sum to the diagonal of the inverse."""
    L = scipy.linalg.cholesky(gram + np.eye(len(gram)), lower=True, overwrite_a=True, check_finite=False)
    return scipy.linalg.lapack.dtrtri(L, lower=1)[0]


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
    for low, high in zip(ends, ends[1:], strict=False):
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
    v = _smooth(velocity, 0.2, dt)
    a = np.gradient(v, dt)
    fastest, hardest = _largest(v), _largest(a)
    phase = np.full(len(v), PHASES.index("cruise"))
    phase[a * np.sign(v) > 0.15 * hardest] = PHASES.index("accelerating")
    phase[a * np.sign(v) < -0.15 * hardest] = PHASES.index("decelerating")
    phase[np.abs(v) < 0.1 * fastest] = PHASES.index("low speed")
    phase[_smooth(np.abs(velocity), 0.04, dt) < 2e-3 * fastest] = PHASES.index("rest")
    moving = np.flatnonzero(np.abs(v) > 0.1 * fastest)
    turn = np.flatnonzero(np.diff(np.sign(v[moving])) != 0)
    between = (moving[turn] + moving[turn + 1] + 1) // 2 if moving.size else np.zeros(0, dtype=int)
    return phase, np.concatenate([[0], between, [len(v)]]).astype(int)


def _edges(n: int, length: float) -> np.ndarray:
    """Ends of equal stretches of about this many samples."""
    return np.round(np.linspace(0, n, max(1, round(n / length)) + 1)).astype(int)


def _stretches(t: np.ndarray, energy: np.ndarray, edges: np.ndarray, dt: float) -> tuple[Part, ...]:
    """One part for each stretch between two edges."""
    return tuple(_stretch(t, energy, i, j, dt) for i, j in zip(edges, edges[1:], strict=False))


def _stretch(t: np.ndarray, energy: np.ndarray, i: int, j: int, dt: float) -> Part:
    on, off = float(t[i]), float(t[j - 1]) + dt
    return Part(f"{on:.2f}–{off:.2f} s", float(energy[i:j].sum()), (j - i) / len(t), (on, off))


def _intervals(t: np.ndarray, energy: np.ndarray, dt: float) -> tuple[Part, ...]:
    """At most eight intervals whose power, over 0.1 s, exceeds four times its median, and which hold 2 % or more."""
    power = _smooth(energy, 2 * _WINDOW_S, dt)
    loud = np.concatenate([[False], power > 4 * max(float(np.median(power)), 1e-6 / len(t)), [False]]).astype(int)
    on, off = np.flatnonzero(np.diff(loud) > 0), np.flatnonzero(np.diff(loud) < 0)
    apart = (on[1:] - off[:-1]) * dt > _WINDOW_S
    on, off = on[np.concatenate([[True], apart])[: len(on)]], off[np.concatenate([apart, [True]])[: len(off)]]
    found = [_stretch(t, energy, i, j, dt) for i, j in zip(on, off, strict=True)]
    largest = sorted((p for p in found if p.energy > 0.02), key=lambda p: -p.energy)[:8]
    return tuple(sorted(largest, key=lambda p: p.span or (0.0, 0.0)))


def _side(r: np.ndarray, load: np.ndarray, dt: float, explainable: float) -> str | None:
    """Which side of the coupling a slow force acts on: on the load it bends the coupling by F / K12, on the motor not.

    Below 8 Hz the inertia of the load hides neither. None if the residual is noise, fast, or something in between.
    """
    low = scipy.fft.dct(r, norm="ortho")[: max(2, round(2 * _SIDE_HZ * dt * len(r)))]
    bend = scipy.fft.dct(load, norm="ortho")[: len(low)]
    energy, bent = float(low @ low), float(bend @ bend)
    if explainable < 0.2 or energy < 0.2 * float(r @ r) or bent == 0:
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
