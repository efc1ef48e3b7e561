"""The numbers of a diagnosis: shares closed, floors, predictions, parameters with their spread."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..effects import AbstractEffect
from ..hygiene import injected_scale
from ..machine import Machine
from ..recording import Recording
from .diagnosis import Candidate, Estimate, Shift
from .hunt import Found
from .judge import left, relative
from .model import Model
from .prepared import Prepared, prepare
from .readings import Readings
from .rounded import SHAPE
from .search import Searcher
from .spread import standard_deviations

_TRANSIENT = 0.6  # s


def rms_floor(record: Prepared, repeated: float | None, structured: float, after: float) -> float:
    """What noise alone would leave of the fit record, N rms: as `repeated` tells, else the unstructured rest."""
    rms = record.channels[0].rms
    unstructured = after * float(np.sqrt(max(1 - structured, 0.0)))
    return rms * (unstructured if repeated is None else min(after, repeated))


def predict(
    outline: Recording,
    fitted: Recording,
    machine: Machine,
    catalogue: Sequence[type[AbstractEffect]],
    record: Prepared,
    found: Found,
) -> float:
    """The gap left on a trajectory of which only the reference is known: the same newtons, another norm.

    A known signal enters as it does in the record that was fitted.
    """
    if outline.injected is not None and fitted.injected is not None:
        volts = injected_scale(fitted, machine) * outline.injected
        outline = dataclasses.replace(outline, injected=volts, vir=volts)
    ahead = prepare(outline, machine, catalogue, record.bench)
    x = np.array(found.last.xs[0])
    x[ahead.model.of("start")] = 0.0
    # Without its qm the record's initial state is not known: what the guess stirs up has died down by then.
    simulated = ahead.decimation(ahead.model.run(x)[0])[ahead.t > _TRANSIENT]
    rms = float(np.sqrt(np.mean(left(record, found.last.outputs[0]) ** 2)))
    expected = float(np.sqrt(np.mean(simulated**2)))
    return rms / (expected if np.isfinite(expected) and expected > 0 else record.channels[0].rms)


def closed(
    record: Prepared, before: np.ndarray, after: np.ndarray, floor: float
) -> tuple[float | None, tuple[float, float] | None]:
    """Share of the explainable gap closed, floor in N rms, and its 95 % interval over blocks of half a second.

    None where there is hardly a gap to close.
    """
    b, a = left(record, before) ** 2, left(record, after) ** 2
    block = max(1, round(0.5 / record.dt))
    groups = np.array_split(np.arange(len(b)), max(1, len(b) // block))
    sums = np.array([[b[g].sum(), a[g].sum(), floor**2 * len(g)] for g in groups])

    def share(s: np.ndarray) -> float:
        total_before, total_after, total_noise = s.sum(axis=0)
        return (total_before - total_after) / max(total_before - total_noise, 1e-300)

    if b.sum() <= 1.2 * floor**2 * len(b):
        return None, None
    rng = np.random.default_rng(0)
    draws = [share(sums[rng.integers(len(sums), size=len(sums))]) for _ in range(400)]
    low, high = (float(np.clip(v, -1.0, 1.0)) for v in np.percentile(draws, [2.5, 97.5]))
    return float(np.clip(share(sums), -1.0, 1.0)), (low, high)


def parameters(
    searcher: Searcher, found: Found, read: Readings, effects: Sequence[str], once: bool
) -> dict[str, dict[str, Any]]:
    """Parameters of every effect named, with their spread; `once`: its pulses did not come again."""
    model, std = searcher.model, standard_deviations(searcher, found.last)
    out: dict[str, dict[str, Any]] = {}
    for name in effects:
        out[name] = {
            model.entries[i].name: _estimate(
                model, found.last.xs[0], i, read.std.get(model.names[i], std.get(i, 0.0))
            ).document()
            for i in model.of(name)
            if np.isfinite(std.get(i, 0.0))  # otherwise the records do not show it
        }
        if name == "encoder_quantisation":
            out[name] = {"resolution": Estimate(read.grid, 0.0, "m").document()}
        if name == "disturbance_pulses" and any(read.pulses):
            volts = [p.volts for found in read.pulses for p in found]
            out[name] = {
                # their signs may alternate
                "A": Estimate(
                    float(np.sign(volts[0]) * np.median(np.abs(volts))), float(np.std(np.abs(volts))), "V"
                ).document(),
                "repeats": False,
            }
        elif name == "disturbance_pulses" and once:
            out[name]["repeats"] = False
    return out


def _estimate(model: Model, x: np.ndarray, place: int, std: float) -> Estimate:
    """Of an entry of x; at a bound it is the bound."""
    entry, bound = model.entries[place], model.bound(x, place)
    value = {"least": entry.lower, "most": entry.upper}.get(bound, entry.decode(x[place]))
    return Estimate(value, std, entry.unit, bound)


def base_shifts(searcher: Searcher, found: Found) -> dict[str, Shift]:
    """The plant's parameters without and with the effects: one that moved was a symptom."""
    model, std = searcher.model, standard_deviations(searcher, found.last)
    before, after = model.decode(found.nominal.xs[0]), model.decode(found.last.xs[0])
    return {
        model.names[i]: Shift(before[model.names[i]], after[model.names[i]], std.get(i, 0.0), model.entries[i].unit)
        for i in model.of("")
        if model.names[i] not in ("offset", *SHAPE[1:])  # an effect here; how the sign rises
    }


def candidates(searcher: Searcher, found: Found, ranking: dict[str, float], floor: float) -> tuple[Candidate, ...]:
    """Every effect that was refitted in the first step; floor in N rms."""
    if not found.steps:
        return ()
    record, model = searcher.records[0], searcher.model
    noise = floor / record.channels[0].rms
    before = relative(record, found.steps[0].before.outputs[0])
    out = []
    for r in found.steps[0].refits:
        gap = relative(record, r.fit.outputs[0])
        std = standard_deviations(searcher, r.fit)
        estimates = {
            model.entries[i].name: _estimate(model, r.fit.xs[0], i, std.get(i, 0.0))
            for i in model.of(r.effect)
            if np.isfinite(std.get(i, 0.0))  # otherwise the records do not show it
        }
        share = float(np.clip((before**2 - gap**2) / max(before**2 - noise**2, 1e-300), -1.0, 1.0))
        out.append(Candidate(r.effect, gap, share, ranking.get(r.effect, 0.0), estimates))
    return tuple(out)
