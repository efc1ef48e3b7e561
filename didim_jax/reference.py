"""Reference positions that excite a drive: trapezoids for mass and friction, chirps and multisines for its mode.

A motion is a value that knows how to sample itself: `sample(dt)` gives the positions at 0, dt, 2 dt, ... up to its end,
in m, relative to its start, at rest at both ends. Motions follow one another (`Sequence`) or are added (`Together`).
A reference is a motion with a place to start and limits to keep, as a TOML file gives it::

    start = 0.05                                    # m
    limits = { stroke = [0.0, 0.25], speed = 0.3, acceleration = 20.0 }      # m, m/s, m/s2

    [[segment]]
    kind = "trapezoid"                              # there and back
    distance = 0.1                                  # m
    speed = 0.12                                    # m/s
    acceleration = 0.8                              # m/s2

    [[segment]]
    kind = "together"                               # its parts are added; "sequence" puts them one after the other
    part = [{ kind = "chirp", ... }, { kind = "trapezoid", ... }]

References: paper, section VI.A (trapezoidal velocity coupled with a chirp).
"""

import dataclasses
import difflib
import math
import os
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from .config import CONFIG, build, load_toml
from .errors import InputError


class Motion(Protocol):
    """A motion from rest to rest."""

    def sample(self, dt: float) -> np.ndarray:
        """Positions relative to the start (m) at every dt (s), both ends included; the first is 0."""


@dataclass(frozen=True, config=CONFIG)
class Dwell:
    """Nothing moves for a while."""

    duration: float = Field(gt=0, description="s")

    def sample(self, dt: float) -> np.ndarray:
        return np.zeros_like(_times(self.duration, dt))


@dataclass(frozen=True, config=CONFIG)
class Trapezoid:
    """There and back, `repeats` times: constant acceleration up to `speed`, constant speed, constant deceleration.

    A distance too short to reach the speed gives a triangle of velocity. `dwell` is the rest after each move.
    A negative distance goes back first.
    """

    distance: float = Field(description="m")
    speed: float = Field(gt=0, description="m/s")
    acceleration: float = Field(gt=0, description="m/s2")
    repeats: int = Field(default=1, ge=1, description="times there and back")
    dwell: float = Field(default=0.0, ge=0, description="s")

    def sample(self, dt: float) -> np.ndarray:
        length = abs(self.distance)
        speed = min(self.speed, math.sqrt(length * self.acceleration))
        move = length / speed + speed / self.acceleration if length else 0.0
        half = move + self.dwell
        t = _times(2 * self.repeats * half, dt)
        leg = np.minimum(t // half, 2 * self.repeats - 1) if half else np.zeros_like(t)
        inside = np.clip(t - leg * half, 0.0, move)
        # the second half of a move is its first half seen from the other end
        from_end = np.minimum(inside, move - inside)
        ramp = np.minimum(from_end, speed / self.acceleration)
        covered = 0.5 * self.acceleration * ramp**2 + speed * (from_end - ramp)
        there = np.where(inside > move / 2, length - covered, covered)
        return math.copysign(1.0, self.distance) * np.where(leg % 2 == 0, there, length - there)


@dataclass(frozen=True, config=CONFIG)
class Chirp:
    """q(t) = w(t) A(f) sin(2 pi integral f dt): a sine whose frequency goes linearly from f_start to f_end.

    A(f) = amplitude (f_start / f)^exponent.
    Amplitude of position is constant for exponent 0, of velocity for 1, of acceleration for 2. The window w rises
    smoothly (twice differentiable) during the first `taper` seconds and falls during the last.
    """

    amplitude: float = Field(gt=0, description="m, at f_start")
    f_start: float = Field(gt=0, description="Hz")
    f_end: float = Field(gt=0, description="Hz")
    duration: float = Field(gt=0, description="s")
    exponent: float = Field(default=1.0, description="of the amplitude's fall with frequency")
    taper: float = Field(default=0.2, ge=0, description="s")

    def __post_init__(self) -> None:
        if 2 * self.taper > self.duration:
            raise ValueError(f"taper = {self.taper:g} s, twice, is longer than duration = {self.duration:g} s")

    def sample(self, dt: float) -> np.ndarray:
        _resolved(max(self.f_start, self.f_end), dt)
        t = np.minimum(_times(self.duration, dt), self.duration)
        rate = (self.f_end - self.f_start) / self.duration
        f = self.f_start + rate * t
        phase = 2 * np.pi * (self.f_start + rate * t / 2) * t
        window = _window(t, self.duration, self.taper)
        return window * self.amplitude * (self.f_start / f) ** self.exponent * np.sin(phase)


@dataclass(frozen=True, config=CONFIG)
class Multisine:
    """A sum of harmonics of `base` Hz with Schroeder's phases, for `periods` whole periods between two tapers.

    The harmonics' amplitudes fall as frequency^-exponent, and `amplitude` is the peak of their sum. A `seed` draws
    the phases instead: other seeds, other signals of the same spectrum.

    References: M. Schroeder, *Synthesis of low-peak-factor signals*, 1970, eq. 11.
    """

    amplitude: float = Field(gt=0, description="m, peak")
    base: float = Field(gt=0, description="Hz")
    harmonics: tuple[int, ...] = Field(min_length=1, description="multiples of the base frequency")
    periods: int = Field(default=1, ge=1, description="whole periods")
    exponent: float = Field(default=1.0, description="of the amplitude's fall with frequency")
    taper: float = Field(default=0.2, ge=0, description="s, before and after the periods")
    seed: int | None = Field(default=None, ge=0, description="of the phases")

    def __post_init__(self) -> None:
        if min(self.harmonics) < 1 or len(set(self.harmonics)) != len(self.harmonics):
            raise ValueError(f"harmonics must be different whole numbers from 1 on, not {list(self.harmonics)}")

    def sample(self, dt: float) -> np.ndarray:
        k = np.sort(np.asarray(self.harmonics, dtype=float))
        _resolved(self.base * k[-1], dt)
        weight = k**-self.exponent
        if self.seed is None:
            # His phases for equal powers whatever the exponent: the harmonics take turns over the period, so that the
            # force has no peak either. Those for the powers of the position would put all high harmonics at once.
            phase = -np.pi * np.arange(len(k)) * np.arange(1, len(k) + 1) / len(k)
        else:
            phase = np.random.default_rng(self.seed).uniform(0, 2 * np.pi, len(k))

        def periodic(t: np.ndarray) -> np.ndarray:
            return np.cos(2 * np.pi * self.base * np.outer(t, k) + phase) @ weight

        period = 1 / self.base
        peak = np.max(np.abs(periodic(np.linspace(0, period, 16 * int(k[-1]), endpoint=False))))
        duration = self.periods * period + 2 * self.taper
        t = np.minimum(_times(duration, dt), duration)
        return self.amplitude / peak * _window(t, duration, self.taper) * periodic(t - self.taper)


@dataclasses.dataclass(frozen=True)
class Sequence:
    """Motions one after the other."""

    parts: tuple[Motion, ...]

    def sample(self, dt: float) -> np.ndarray:
        end, pieces = 0.0, [np.zeros(1)]
        for part in self.parts:
            piece = end + part.sample(dt)
            end = piece[-1]
            pieces.append(piece[1:])  # its first sample is the last one before
        return np.concatenate(pieces)


@dataclasses.dataclass(frozen=True)
class Together:
    """Motions added, all from the same instant; one that is over stays where it ended."""

    parts: tuple[Motion, ...]

    def sample(self, dt: float) -> np.ndarray:
        pieces = [part.sample(dt) for part in self.parts]
        longest = max(len(piece) for piece in pieces)
        return np.sum([np.pad(piece, (0, longest - len(piece)), mode="edge") for piece in pieces], axis=0)


# -- limits ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, config=CONFIG)
class Limits:
    """What the mechanics allow a reference: from where to where, how fast, how hard."""

    stroke: tuple[float, float] = Field(description="m, from and to")
    speed: float = Field(gt=0, description="m/s")
    acceleration: float = Field(gt=0, description="m/s2")

    def __post_init__(self) -> None:
        if not self.stroke[0] < self.stroke[1]:
            raise ValueError(f"stroke = {list(self.stroke)} m must go from the lower end to the upper one")


def check(qg: np.ndarray, dt: float, limits: Limits) -> None:
    """Hold a sampled reference (m) against limits; speed and acceleration are differences of its samples.

    Raises InputError naming the limit first exceeded, the time, the value and by how much. Whether the drive has the
    volts to follow is for a simulation to tell (`synthesize`).
    """
    low, high = limits.stroke
    v = np.diff(qg) / dt
    a = np.diff(qg, 2) / dt**2
    held = (
        ("stroke, lower end", "m", low, low - qg, 0),
        ("stroke, upper end", "m", high, qg - high, 0),
        ("speed", "m/s", limits.speed, np.abs(v) - limits.speed, 0),
        ("acceleration", "m/s2", limits.acceleration, np.abs(a) - limits.acceleration, 1),
    )
    for name, unit, limit, excess, delay in held:
        # differences of positions carry their rounding, divided by dt twice
        slack = 1e-9 * abs(limit) + 1e-15 / dt ** (0 if unit == "m" else 1 if unit == "m/s" else 2)
        if excess.size and excess.max() > slack:
            worst, first = int(np.argmax(excess)), int(np.argmax(excess > slack))
            raise InputError(
                f"reference: the {name} ({limit:g} {unit}) is exceeded from t = {(first + delay) * dt:.4g} s on, most "
                f"at t = {(worst + delay) * dt:.4g} s, by {excess[worst]:.3g} {unit}."
            )


# -- files -------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Reference:
    """A motion from a start position (m), within limits."""

    motion: Motion
    start: float
    limits: Limits

    def sample(self, dt: float) -> np.ndarray:
        """Reference positions qg (m) at every dt (s). Raises InputError where a limit is exceeded."""
        qg = self.start + self.motion.sample(dt)
        check(qg, dt, self.limits)
        return qg


_KINDS: dict[str, type] = {"dwell": Dwell, "trapezoid": Trapezoid, "chirp": Chirp, "multisine": Multisine}
_GROUPS: dict[str, type[Sequence] | type[Together]] = {"sequence": Sequence, "together": Together}


@dataclass(frozen=True, config=CONFIG)
class _Group:
    part: tuple[dict[str, Any], ...] = Field(min_length=1, description="motions")


@dataclass(frozen=True, config=CONFIG)
class _File:
    start: float = Field(description="m")
    limits: Limits = Field(description="stroke, speed, acceleration")
    segment: tuple[dict[str, Any], ...] = Field(min_length=1, description="motions, one after the other")


def load_reference(path: str | os.PathLike[str]) -> Reference:
    """Read a reference file. Raises InputError, one line with file, segment and key, when it cannot be used."""
    file = load_toml(path, _File)
    # Each table is built as the class its kind names, so that a misspelt key is held against the right class.
    parts = tuple(_motion(table, f"{path}: segment {i}") for i, table in enumerate(file.segment, start=1))
    return Reference(Sequence(parts), file.start, file.limits)


def _motion(table: Mapping[str, Any], where: str) -> Motion:
    keys = {name: value for name, value in table.items() if name != "kind"}
    kind = str(table["kind"]) if "kind" in table else None
    if kind in _GROUPS:
        group = build(_Group, keys, f"{where} ({kind})")
        return _GROUPS[kind](tuple(_motion(p, f"{where}, part {i}") for i, p in enumerate(group.part, start=1)))
    if kind in _KINDS:
        motion: Motion = build(_KINDS[kind], keys, f"{where} ({kind})")
        return motion
    known = (*_KINDS, *_GROUPS)
    if kind is None:
        raise InputError(f"{where}: missing key 'kind', one of {', '.join(known)}.")
    near = difflib.get_close_matches(kind, known, n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(known)}."
    raise InputError(f"{where}: unknown kind {kind!r}, {hint}")


# -- sampling ----------------------------------------------------------------------------------------------------


_MOST_SAMPLES = 10_000_000
"""Longer references are mistakes of unit, and no memory holds them."""


def _times(duration: float, dt: float) -> np.ndarray:
    """0, dt, ... until the duration is over."""
    if duration / dt > _MOST_SAMPLES:
        raise InputError(
            f"reference: {duration:g} s sampled every {dt:g} s are over {_MOST_SAMPLES:g} samples; make it shorter."
        )
    return dt * np.arange(math.ceil(duration / dt - 1e-9) + 1)


def _window(t: np.ndarray, duration: float, taper: float) -> np.ndarray:
    """From 0 to 1 and back to 0, twice differentiable."""
    if taper == 0:
        return np.ones_like(t)
    x = np.clip(np.minimum(t, duration - t) / taper, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def _resolved(f: float, dt: float) -> None:
    if f >= 0.5 / dt:
        raise InputError(f"reference: {f:g} Hz cannot be sampled every {dt:g} s, it must stay below {0.5 / dt:g} Hz.")
