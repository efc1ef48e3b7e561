"""Which experiment would tell twins apart: every excitation of a menu is simulated with each of them."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from ..effects import AbstractEffect
from ..recording import Recording
from ..reference import Chirp, Together, Trapezoid
from ..reference import Sequence as Motions
from .diagnosis import Experiment
from .fit import Fit
from .prepared import Prepared, prepare


@dataclasses.dataclass(frozen=True)
class Menu:
    """One experiment: what to do, and the reference position (m, one per sample) on a stroke from low to high."""

    what: str
    qg: np.ndarray


def separating_experiment(
    record: Prepared, catalogue: Sequence[type[AbstractEffect]], base: Sequence[int], group: Sequence[Fit]
) -> Experiment | None:
    """The experiment of the menu with the largest signal x sin(angle) between the fits of a group of twins.

    The signature of a fit is its simulated force less that of the same plant with the effect at its null, the base
    parameters' own columns projected out. Of a group of three the two that are hardest to part count.
    """
    best: tuple[float, Experiment] | None = None
    for item in _menu(record):
        signatures = _signatures(record, catalogue, base, group, item)
        if signatures is None:
            continue
        pairs = [_apart(a, b) for a, b in itertools.combinations(signatures, 2)]
        if not pairs:
            return None
        signal, angle = min(pairs)
        if best is None or signal > best[0]:
            best = (signal, Experiment(item.what, float(np.degrees(angle))))
    return None if best is None else best[1]


def _apart(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """(signal x sin(angle) in N rms, angle between two signatures in rad)."""
    na, nb = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    cosine = min(abs(float(a @ b)) / max(na * nb, 1e-300), 1.0)
    angle = float(np.arccos(cosine))
    return min(na, nb) / np.sqrt(len(a)) * np.sin(angle), angle


def _signatures(
    record: Prepared,
    catalogue: Sequence[type[AbstractEffect]],
    base: Sequence[int],
    group: Sequence[Fit],
    item: Menu,
) -> list[np.ndarray] | None:
    machine, dt = record.machine, record.machine.controller.sample_time
    t = dt * np.arange(len(item.qg))
    planned = Recording(t=t, qg=item.qg, qm=item.qg, vir=np.zeros(len(t)), gain=machine.drive.gain, name=item.what)
    ahead = prepare(planned, machine, catalogue, record.bench)
    model, start = ahead.model, ahead.model.of("start")
    out = []
    for fit in group:
        x = np.array(fit.xs[0])
        x[start] = 0.0
        plain = x.copy()
        for i in fit.chosen:
            if model.entries[i].owner not in ("", "start") and i not in base:
                plain[i] = 0.0
        with_effect, columns = model.columns(x, [i for i in base if i not in start])
        without = model.run(plain)
        peak = np.max(np.abs(with_effect[0])) / machine.drive.gain
        if not np.isfinite(with_effect).all() or peak > machine.drive.limit:
            return None
        low: Callable[[np.ndarray], np.ndarray] = lambda y: ahead.decimation(y.T).T  # noqa: E731
        signature = low(with_effect[0] - without[0])
        J = low(columns[:, 0, :]).T
        J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        Q = np.linalg.qr(J)[0]
        out.append(signature - Q @ (Q.T @ signature))
    return out


def _menu(record: Prepared) -> list[Menu]:
    """Excitations within the stroke of the record, as long as it."""
    bench, dt = record.bench, record.machine.controller.sample_time
    low, span = bench.q_low, max(bench.q_high - bench.q_low, 1e-3)
    n = record.model.n

    def fitted(what: str, motion: object, start: float) -> Menu:
        qg = start + motion.sample(dt)  # type: ignore[attr-defined]
        return Menu(what, np.concatenate([qg, np.full(max(n - len(qg), 0), qg[-1])])[:n])

    return [
        fitted("slow trapezoids over the stroke, 20 mm/s", Trapezoid(0.9 * span, 0.02, 0.5, 1, 0.1), low),
        fitted(
            "trapezoids over the stroke at two speeds, 30 and 150 mm/s",
            Motions((Trapezoid(0.9 * span, 0.03, 0.5, 1, 0.1), Trapezoid(0.9 * span, 0.15, 1.5, 2, 0.1))),
            low,
        ),
        fitted(
            "chirp, 2 to 60 Hz, small amplitude, on a slow trapezoid",
            Together((Trapezoid(0.8 * span, 0.03, 0.5), Chirp(2e-5, 2.0, 60.0, 6.0))),
            low,
        ),
        fitted(
            "chirp, 1 to 40 Hz, large amplitude, on a slow trapezoid",
            Together((Trapezoid(0.8 * span, 0.03, 0.5), Chirp(1e-4, 1.0, 40.0, 6.0))),
            low,
        ),
        fitted(
            "short strokes of 2 mm at 5 mm/s, forty reversals",
            Trapezoid(0.002, 0.005, 0.5, 20),
            low + 0.5 * span,
        ),
    ]
