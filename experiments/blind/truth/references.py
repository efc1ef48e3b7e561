"""Reference positions: strokes of several speeds with chirps and multisines over them, dwells, small slow moves."""

import numpy as np

from .machine import DT

EXCITATIONS = ("usual", "poor")
SPEED = 0.2  # m/s, never reached
REACH = 0.16  # m, end of the axis
FORCE = 165.0  # N that inertia and friction of a reference may ask for


def draw_reference(
    rng: np.random.Generator, mass: float, seconds: float, excitation: str, vigour: float = 1.0
) -> np.ndarray:
    """qg in m at 1 kHz, from rest in motion at once. `mass` in kg bounds the accelerations, `vigour` scales them."""
    if excitation not in EXCITATIONS:
        raise ValueError(f"excitation = {excitation!r}: one of {', '.join(EXCITATIONS)}.")
    n = round(seconds / DT)
    if excitation == "poor":
        return _slow_trapezoid(rng, n)
    while True:
        qg = _mixed(rng, vigour * FORCE / mass, n)
        if qg.min() > -0.002 and qg.max() < REACH and np.abs(np.diff(qg)).max() < 0.97 * SPEED * DT:
            return qg


def _slow_trapezoid(rng: np.random.Generator, n: int) -> np.ndarray:
    """Once there and back."""
    low, high = rng.uniform(0.0, 0.02), rng.uniform(0.07, 0.13)
    dwell = int(rng.uniform(0.5, 1.2) / DT)
    v = (high - low) / (DT * (0.5 * (n - dwell) - 700))
    there = _stroke(low, high, v, 0.5)
    path = np.concatenate([there, np.full(dwell, high), _stroke(high, low, v, 0.5)])
    return np.concatenate([path, np.full(max(n - path.size, 0), low)])[:n]


def _mixed(rng: np.random.Generator, most: float, n: int) -> np.ndarray:
    """Strokes in a random order of kinds, each kind once in ten seconds or so; accelerations up to `most`, m/s2."""
    pieces: list[np.ndarray] = []
    overlays: list[np.ndarray] = []
    at, end = rng.uniform(0.0, 0.015), 0.0
    kinds: list[str] = []
    done = 0
    while done < n:
        if not kinds:
            kinds = list(rng.permutation(["fast", "fast", "chirp", "sines", "slow"]))
        kind = kinds.pop()
        if at < 0.04:
            end = rng.uniform(0.066, 0.15) if kind != "slow" else rng.uniform(0.06, 0.09)
        else:
            end = rng.uniform(0.0, 0.02)
        way = abs(end - at)
        if kind == "fast":
            piece = _stroke(at, end, rng.uniform(0.1, 0.18), rng.uniform(0.5, 0.9) * most)
        elif kind == "slow":
            seconds = rng.uniform(1.6, 2.6)
            middle = at + np.sign(end - at) * rng.uniform(0.3, 0.6) * way
            back = middle - np.sign(end - at) * rng.uniform(0.001, 0.006)
            v = way / seconds
            piece = np.concatenate(
                [_stroke(at, middle, v, 0.4), _stroke(middle, back, rng.uniform(0.01, 0.03), 0.4),
                 _stroke(back, end, 1.3 * v, 0.5)]
            )  # fmt: skip
        else:
            piece = _stroke(at, end, way / rng.uniform(1.5, 2.4), 0.35 * most)
        overlay = np.zeros(piece.size)
        if kind == "chirp":
            overlay = _chirp(rng, piece.size, 0.42 * most)
        elif kind == "sines":
            overlay = _sines(rng, piece.size, 0.45 * most)
        pause = int(rng.uniform(0.05, 0.4) / DT)
        pieces += [piece, np.full(pause, end)]
        overlays += [overlay, np.zeros(pause)]
        done += piece.size + pause
        at = end
    return (np.concatenate(pieces) + np.concatenate(overlays))[:n]


def _stroke(start: float, end: float, v: float, a: float) -> np.ndarray:
    """From rest to rest, speed trapezoid of acceleration `a` rounded over 30 ms."""
    way = abs(end - start)
    v = min(v, np.sqrt(way * a))
    ramp, cruise = v / a, way / v - v / a
    t = np.arange(0.0, 2 * ramp + cruise + 0.03, DT)
    speed = np.interp(t, [0.0, ramp, ramp + cruise, 2 * ramp + cruise], [0.0, v, v, 0.0])
    window = np.hanning(32)[1:-1]
    speed = np.convolve(speed, window / window.sum())[: t.size]
    path = np.cumsum(speed)
    return start + (end - start) * path / path[-1]


def _taper(n: int) -> np.ndarray:
    """1 with flanks of 0.15 s."""
    flank = min(150, n // 3)
    ramp = 0.5 * (1 - np.cos(np.pi * np.arange(flank) / flank))
    return np.concatenate([ramp, np.ones(n - 2 * flank), ramp[::-1]])


def _chirp(rng: np.random.Generator, n: int, a: float) -> np.ndarray:
    """Exponential sweep within 1-40 Hz; amplitude limited at low frequency by speed, at high by acceleration."""
    f0, f1 = rng.uniform(1, 3), rng.uniform(30, 40)
    if rng.random() < 0.4:
        f0, f1 = f1, f0
    f = f0 * (f1 / f0) ** (np.arange(n) / n)
    w = 2 * np.pi * f
    phase = np.cumsum(w) * DT
    loop = 2 * np.pi * 18.0  # the loop follows less above it: more reference for the same force
    amplitude = np.minimum(a / w**2 * np.minimum(1 + (w / loop) ** 2, 3.0), 0.035 / w)
    return amplitude * np.sin(phase) * _taper(n)


def _sines(rng: np.random.Generator, n: int, a: float) -> np.ndarray:
    """Some 7 lines between 1.5 and 38 Hz of equal acceleration, random phases."""
    f = np.geomspace(1.5, 38, 7) * rng.uniform(0.92, 1.08, 7)
    t = np.arange(n) * DT
    w = 2 * np.pi * f
    lines = np.minimum(a / 2.2 / w**2, 0.012 / w)[:, None] * np.sin(w[:, None] * t + rng.uniform(0, 2 * np.pi, (7, 1)))
    return lines.sum(0) * _taper(n)
