"""Where an effect shows: the ranges of time, speed, position and frequency that hold what it explains."""

import numpy as np

from .diagnosis import Where
from .fit import Fit
from .judge import left
from .readings import CONTROLLER, Readings
from .search import Searcher

_HELD = (0.05, 0.95)
"""Quantiles of the explained energy between which it is said to lie."""


def whereabouts(searcher: Searcher, before: Fit, after: Fit, adopted: tuple[str, ...], read: Readings) -> Where:
    """Ranges of what the adopted effects changed in the simulated force of the first record."""
    record = searcher.records[0]
    changed = left(record, before.outputs[0]) - left(record, after.outputs[0])
    pulses = [[p.on, p.off] for p in read.pulses[0]]
    if not adopted or not np.any(changed):
        return Where(pulses or None, None, None, None, "law" if pulses else "force")
    factor, dt = record.decimation.factor, record.model.dt
    q = record.recording.qm[::factor]
    v = np.gradient(q, dt * factor)
    energy = changed**2
    spectrum = np.abs(np.fft.rfft(changed * np.hanning(len(changed)))) ** 2
    frequency = np.fft.rfftfreq(len(changed), dt * factor)
    channel = "law" if pulses or adopted[0] in CONTROLLER else "force"
    return Where(
        time_s=pulses or _intervals(searcher, after, adopted),
        speed_m_s=_range(v, energy),
        position_m=_narrow(q, energy),
        frequency_hz=_range(frequency, spectrum),
        channel=channel,
    )


def _range(x: np.ndarray, weight: np.ndarray) -> list[float]:
    order = np.argsort(x)
    share = np.cumsum(weight[order]) / weight.sum()
    low, high = (x[order][min(int(np.searchsorted(share, s)), len(x) - 1)] for s in _HELD)
    return [float(low), float(high)]


def _narrow(x: np.ndarray, weight: np.ndarray) -> list[float] | None:
    """The range of x if it is clearly narrower than where the machine went."""
    low, high = _range(x, weight)
    usual = _range(x, np.ones_like(weight))
    return [low, high] if high - low < 0.6 * (usual[1] - usual[0]) else None


def _intervals(searcher: Searcher, fit: Fit, adopted: tuple[str, ...]) -> list[list[float]] | None:
    """Every interval of an effect that is bound in time, s of the record."""
    model, record = searcher.model, searcher.records[0]
    values, end = model.decode(fit.xs[0]), record.model.dt * record.model.n
    if "disturbance_pulses" in adopted:
        t0, width, period = (values[f"disturbance_pulses.{k}"] for k in ("t0", "width", "period"))
        starts = np.arange(t0, end, period) if period < end else np.array([t0])
        starts = starts[: int(np.ceil(min(values["disturbance_pulses.count"], len(starts))))]
        return [[float(max(s, 0.0)), float(min(s + width, end))] for s in starts if s < end and s + width > 0]
    if "payload_change" in adopted:
        return [[float(np.clip(values["payload_change.t0"], 0.0, end)), float(end)]]
    return None
