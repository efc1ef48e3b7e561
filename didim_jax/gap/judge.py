"""Judge a fitted model on another record: only what belongs to that record is estimated, never an effect's size."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ..effects import AbstractEffect
from .fit import Fit, Problem
from .noise import Whitening
from .prepared import Prepared
from .score import Each, in_turn

CLOCK = 0.95
"""Seconds by which the clocks of two runs may differ: a record begins up to 0.9 s after its machine's own run."""


@dataclasses.dataclass(frozen=True)
class Judged:
    """A record simulated with parameters that were fitted elsewhere: x, outputs (2, n), what was moved besides."""

    x: np.ndarray
    outputs: np.ndarray
    moved: dict[str, float]


def judge(record: Prepared, x: np.ndarray, effects: Sequence[AbstractEffect], sigma: Mapping[str, float]) -> Judged:
    """Simulate a record with the machine of x; its initial state, and clocks of its effects, are its own.

    `sigma` is the rms that the fit left on each channel, by name; a channel that the fit did not have weighs little.
    """
    model = record.model
    whitening = [[Whitening.flat(len(c.observed), sigma.get(c.name, 0.1 * c.rms)) for c in record.channels]]
    problem = Problem([record], whitening)
    x = np.array(x, dtype=float)
    start = model.of("start")
    x[start] = 0.0
    x = problem.solve(x, start, evaluations=20, tolerance=1e-6).xs[0]
    moved = {}
    for effect in effects:
        for parameter in effect.own_to_record:
            name = f"{effect.label()}.{parameter}"
            if name in model.index:
                x = _clock(problem, x, name, start)
                moved[name] = model.decode(x)[name]
        if effect.label() == "disturbance_pulses":
            x = _absent(problem, x, start, moved)
    x = _phase(problem, x, effects, start, moved)
    return Judged(x, model.run(x), moved)


def _clock(problem: Problem, x: np.ndarray, name: str, start: Sequence[int]) -> np.ndarray:
    """x with one instant moved to where this record has it."""
    moved = at_best_instant(problem, x, name, np.linspace(-CLOCK, CLOCK, 64))
    fit = problem.solve(moved, [*start, problem.records[0].model.index[name]], evaluations=12)
    return fit.xs[0]


def at_best_instant(problem: Problem, x: np.ndarray, name: str, shifts: np.ndarray, each: Each = in_turn) -> np.ndarray:
    """x with one instant moved by the shift (s) that leaves least of a record; `each` runs the trials."""
    model = problem.records[0].model
    at = model.decode(x)[name]
    trials = [model.encode(x, {name: at + shift}) for shift in shifts]
    return trials[int(np.argmin(_costs(problem, trials, each)))]


def _absent(problem: Problem, x: np.ndarray, start: Sequence[int], moved: dict[str, float]) -> np.ndarray:
    """x without the pulses where this record does not have them; A is then noted as moved to 0."""
    model = problem.records[0].model
    without = problem.solve(model.encode(x, {"disturbance_pulses.A": 0.0}), start, evaluations=12)
    if without.cost >= problem.solve(x, start, evaluations=2).cost:
        return x
    moved["disturbance_pulses.A"] = 0.0
    return without.xs[0]


def _phase(
    problem: Problem, x: np.ndarray, effects: Sequence[AbstractEffect], start: Sequence[int], moved: dict[str, float]
) -> np.ndarray:
    """x with the phase of the encoder's periodic error as in this record, where that is lost at power-off."""
    model = problem.records[0].model
    for effect in effects:
        if effect.label() != "encoder_periodic_error":
            continue
        a, b = (model.decode(x)[f"{effect.label()}.{k}"] for k in "ab")
        size, phase = float(np.hypot(a, b)), float(np.arctan2(b, a))
        turns = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        trials = [
            model.encode(x, {f"{effect.label()}.a": size * np.cos(p), f"{effect.label()}.b": size * np.sin(p)})
            for p in phase + turns
        ]
        costs = _costs(problem, trials)
        best = int(np.argmin(costs))
        if costs[best] < 0.8 * costs[0]:
            x = problem.solve(trials[best], start, evaluations=6).xs[0]
            moved[f"{effect.label()}.phase"] = float(turns[best])
    return x


def _costs(problem: Problem, trials: Sequence[np.ndarray], each: Each = in_turn) -> list[float]:
    costs = []
    for out in each(problem.records[0].model.run, trials):
        cost = float(np.sum(problem.whitened(problem.residuals([out])) ** 2))
        costs.append(cost if np.isfinite(cost) else np.inf)
    return costs


def relative(record: Prepared, outputs: np.ndarray) -> float:
    """norm(F(tau - tau_sim)) / norm(F(tau)): the gap."""
    force = record.channels[0]
    left = force.observed - record.filtered(outputs, force)
    return float(np.linalg.norm(left) / np.linalg.norm(force.observed))


def left(record: Prepared, outputs: np.ndarray) -> np.ndarray:
    """Record minus simulation of the commanded force in the band, N, (n_decimated,)."""
    force = record.channels[0]
    return force.observed - record.filtered(outputs, force)


def rms_of(record: Prepared, fit: Fit) -> dict[str, float]:
    """Rms that a fit leaves on each channel of its first record, by name."""
    return {
        c.name: max(float(np.sqrt(np.mean(r**2))), 1e-12)
        for c, r in zip(record.channels, fit.residuals[0], strict=True)
    }
