"""What a residual may be a smooth function of, as columns of a linear regression: the variables of the gap atlas."""

import numpy as np

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
"""Variables by key, as a person reads them. The time since the last stop or start holds what friction remembers."""


def dictionary(
    t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, reference: np.ndarray, dt: float, lead: float
) -> dict[str, np.ndarray]:
    """Columns (n, m) of every variable in `LABELS`, each with a mean square of 1 under its prior.

    A smooth function is a sum of cosines over the variable's range, amplitudes falling as 1/k: rough ones cost more.
    Only `v_even` can be a constant, only `v_odd` a constant times the direction: friction that is the same everywhere
    and always is neither a function of position nor of time. Speed is stretched near zero, where friction bends. The
    sign of motion is tanh(v / 1 % of the highest speed). Linear dynamics take their input from the reference alone (and
    the sign of friction): through the measured motion, noise would explain itself around the loop.
    """
    fastest, strongest = largest(v), largest(a)
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
    steady = smooth(v, 0.04, dt)
    index = np.arange(len(v))
    moving = np.abs(steady) > 0.02 * fastest
    at = np.maximum.accumulate(np.where(moving, index, -1))
    last = np.where(at >= 0, np.sign(steady[at]), 0.0)
    changed = (np.diff(moving) != 0) | (last[1:] * last[:-1] < 0)
    event = np.maximum.accumulate(np.concatenate([[-1], np.where(changed, index[1:], -1)]))
    since = np.where(event >= 0, (index - event) * dt, np.inf)  # nothing is known of before the record
    rest = ~moving[:, None]
    fading = np.exp(-since[:, None] / np.array([0.03, 0.1, 0.3]))
    return np.concatenate([rest, rest * fading, ~rest * fading], axis=1), last


def _cosines(u: np.ndarray, most: int, corner: float) -> np.ndarray:
    """cos(k pi u), k = 0 to `most`, falling as 1/k above the corner: continued evenly, u in [0, 1] has no jump."""
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


def largest(x: np.ndarray) -> float:
    """Largest absolute value, never 0: something to divide by."""
    return max(float(np.abs(x).max()), 1e-12)


def _scaled(x: np.ndarray) -> np.ndarray:
    """x with the mean square of its rows at 1; 0 stays 0."""
    size = np.sqrt(np.mean(np.sum(x**2, axis=1)))
    return x / size if size > 0 else x


def smooth(x: np.ndarray, seconds: float, dt: float) -> np.ndarray:
    """Weighted mean (Hann) over so many seconds, the ends held."""
    half = max(1, round(0.5 * seconds / dt))
    window = np.hanning(2 * half + 3)[1:-1]
    return np.convolve(np.pad(x, half, mode="edge"), window / window.sum(), mode="valid")
