"""Score every effect without refitting: how much of the residual its signature explains, nuisances projected out.

The signature is a secant, the simulation at a probe less the nominal one: it exists where a derivative at the null does
not (thresholds, gaps, a limit), and it is of the effect's usual size.
"""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from ..effects import AbstractEffect, Probe
from ..signals import LowPass
from .fit import Fit, Problem
from .model import ALWAYS


@dataclasses.dataclass(frozen=True)
class Score:
    """One probe of an effect: share of the whitened residual energy it explains, its signature, where a refit starts.

    `signature` (rows, columns) is whitened, nuisances projected out; `kept` is the share of its norm that survived.
    """

    effect: str
    probe: Probe
    share: float
    coefficients: np.ndarray
    signature: np.ndarray
    kept: float
    start: Mapping[str, float]


type Each = Callable[[Callable[[np.ndarray], np.ndarray], Iterable[np.ndarray]], list[np.ndarray]]
"""Maps a simulation over many x."""


def in_turn(run: Callable[[np.ndarray], np.ndarray], xs: Iterable[np.ndarray]) -> list[np.ndarray]:
    """One after the other."""
    return [run(x) for x in xs]


def score(
    problem: Problem,
    fit: Fit,
    effects: Sequence[AbstractEffect],
    each: Each = in_turn,
) -> list[Score]:
    """Every probe of every effect, best first. Effects are those of the first record's model, in its order."""
    first = problem.records[0]
    # A force that pushes along with the motor leaves the command short of the simulation's.
    pushed = fit.outputs[0][0] - first.recording.tau
    bench = dataclasses.replace(first.bench, disturbance=LowPass.butterworth(30.0, first.model.dt)(pushed))
    trials = [(effect, probe) for effect in effects for probe in effect.probes(bench)]
    model = problem.records[0].model
    columns = [
        (effect, probe, {f"{effect.label()}.{k}": v for k, v in {**probe.shape, name: size}.items()})
        for effect, probe in trials
        for name, size in probe.sizes.items()
    ]
    # Beside others an effect does nearly the same as alone, and alone it runs in a small program of its own.
    beside = [i for i in range(len(model.entries)) if model.entries[i].owner not in {"", "start", *ALWAYS}]
    rows = []
    for p, x in zip(problem.records, fit.xs, strict=True):
        alone = np.array(x)
        alone[beside] = 0.0
        out = np.array(each(p.model.run, [alone, *(model.encode(alone, values) for *_, values in columns)]))
        rows.append([p.filtered(out[1:] - out[0], c) for c in p.channels])
    signatures = problem.whitened(rows)
    signatures[~np.isfinite(signatures)] = 0.0
    residual = problem.whitened(fit.residuals)
    total = float(residual @ residual)
    padding = np.zeros(fit.jacobian.shape[0] - len(residual))  # rows of the priors
    basis = np.linalg.qr(_scaled(fit.jacobian))[0]

    def project(v: np.ndarray) -> np.ndarray:
        v = np.concatenate([v, np.zeros((*v.shape[:-1], len(padding)))], axis=-1)
        return v - (v @ basis) @ basis.T

    left = project(residual)
    scores, at = [], 0
    for effect, probe in trials:
        k = len(probe.sizes)
        raw = signatures[at : at + k]
        at += k
        own = project(raw).T
        kept = float(np.linalg.norm(own) / max(np.linalg.norm(raw), 1e-300))
        if not np.isfinite(kept) or np.linalg.norm(own) == 0:
            continue
        coefficients = np.linalg.lstsq(own, left, rcond=1e-6)[0]
        coefficients = _allowed(coefficients, effect, probe, model) if probe.linear else np.clip(coefficients, 0.0, 1.0)
        explained = left @ left - np.sum((left - own @ coefficients) ** 2)
        sizes = {
            f"{effect.label()}.{name}": null + (c if probe.linear else 1.0) * (size - null)
            for (name, size), c, null in zip(
                probe.sizes.items(), coefficients, _nulls(effect, probe, model), strict=True
            )
        }
        shape = {f"{effect.label()}.{name}": value for name, value in probe.shape.items()}
        scores.append(
            Score(effect.label(), probe, float(explained / total), coefficients, own, kept, {**shape, **sizes})
        )
    return sorted(scores, key=lambda s: -s.share)


def _nulls(effect, probe, model) -> list[float]:
    return [model.entries[model.index[f"{effect.label()}.{name}"]].null for name in probe.sizes]


def _allowed(c: np.ndarray, effect, probe, model) -> np.ndarray:
    """Coefficients within what the parameters may be; a size is not believed beyond thirty times the probe's."""
    out = []
    for value, (name, size), null in zip(c, probe.sizes.items(), _nulls(effect, probe, model), strict=True):
        entry = model.entries[model.index[f"{effect.label()}.{name}"]]
        ends = sorted(((entry.lower - null) / (size - null), (entry.upper - null) / (size - null)))
        out.append(float(np.clip(value, max(ends[0], -30.0), min(ends[1], 30.0))))
    return np.array(out)


def _scaled(J: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(J, axis=0)
    return J / np.where(norms > 0, norms, 1.0)
