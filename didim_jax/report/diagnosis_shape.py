"""The gap against the one variable that it goes with: the shape of what is missing, before any law is fitted."""

import dataclasses

import numpy as np
from matplotlib.axes import Axes

from ..gap.atlas import Atlas
from ..gap.diagnosis import Diagnosis
from .canvas import INK, RESIDUAL, SIMULATED, label, title
from .diagnosis_words import leading

_BINS = 48
_FEWEST = 6
"""Samples that a bin must hold to be drawn."""

_VELOCITY = ("constant", "v_even", "v_odd", "direction_q", "reversal")
_MOVING = 0.02
"""Of the largest speed: what is slower has no direction."""


@dataclasses.dataclass(frozen=True)
class _View:
    """What is drawn across (its name and values) and whether the force is counted along the motion."""

    name: str
    x: np.ndarray
    along: bool = False


def draw_shape(ax: Axes, d: Diagnosis) -> None:
    """Mean and middle half of the residual force (N) in bins of the variable, before and with the effects.

    Where the gap is bound to moments or frequencies, or there is no atlas, its course over time is drawn instead.
    """
    before, after = d.atlas, d.atlas_after
    if before is None:
        ax.text(0.5, 0.5, "the residual was not mapped", transform=ax.transAxes, ha="center", color=INK, fontsize=9)
        return
    view = None if d.where.time_s or d.verdict == "none" else _view(before)
    for one, colour, name in (
        (before, RESIDUAL, "simulated" if after is None else "before"),
        (after, SIMULATED, "after"),
    ):
        if one is None:
            continue
        if view is None:
            _course(ax, one, colour, name)
        else:
            _binned(ax, one, view, colour, name)
    for on, off in d.where.time_s or []:
        ax.axvspan(on, off, color="#f3e9c6", linewidth=0, zorder=0)
    if view is None:
        label(ax, x="time, s", y="residual, N rms over 0.1 s")
        noise = (after or before).floor_rms
        ax.axhline(noise, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="noise (estimated)", zorder=4)
        ax.set_ylim(bottom=0)
    else:
        ax.axhline(0, color="black", linewidth=0.6, zorder=1)
        kind = "force along the motion" if view.along else "force"
        title(ax, f"gap against {view.name.split(',')[0]}")
        label(ax, x=view.name, y=f"missing {kind}, N")
    if after is not None or view is None:
        ax.legend(
            loc="lower right",
            bbox_to_anchor=(1.03, 0.985),
            ncols=3,
            frameon=False,
            fontsize=8.5,
            handlelength=1.2,
            columnspacing=0.9,
            handletextpad=0.4,
            borderaxespad=0.1,
        )


def _view(one: Atlas) -> _View | None:
    """By the variable that closes most alone; None where it is one that has no simple axis."""
    first = leading(one)
    if first is None:
        return None
    dt = float(np.median(np.diff(one.t)))
    velocity = np.gradient(one.reference, dt)
    if first.name in ("q", "direction_q"):
        return _View("position, mm", 1e3 * one.reference, along=first.name == "direction_q")
    if first.name in ("time", "direction_time"):
        return _View("time, s", one.t, along=first.name == "direction_time")
    if first.name in _VELOCITY:
        return _View("velocity, mm/s", 1e3 * velocity)
    if first.name == "acceleration":
        return _View("acceleration, m/s²", np.gradient(velocity, dt))
    return None


def _binned(ax: Axes, one: Atlas, view: _View, colour: str, name: str) -> None:
    """Mean of each bin as a line, quartiles as a band."""
    r, x = one.residual, view.x
    if view.along:
        v = np.gradient(one.reference)
        moving = np.abs(v) > _MOVING * np.abs(v).max()
        r, x = (r * np.sign(v))[moving], x[moving]
    edges = np.linspace(x.min(), x.max(), _BINS + 1)
    place = np.clip(np.digitize(x, edges) - 1, 0, _BINS - 1)
    rows = [r[place == k] for k in range(_BINS)]
    full = [k for k, row in enumerate(rows) if len(row) >= _FEWEST]
    middle = 0.5 * (edges[:-1] + edges[1:])[full]
    low, high = np.array([np.percentile(rows[k], [25, 75]) for k in full]).reshape(-1, 2).T
    ax.fill_between(middle, low, high, color=colour, alpha=0.2, linewidth=0, zorder=2)
    ax.plot(middle, [rows[k].mean() for k in full], color=colour, linewidth=1.8, zorder=3, label=name)


def _course(ax: Axes, one: Atlas, colour: str, name: str) -> None:
    """Root mean square over 0.1 s."""
    n = max(1, round(0.1 / float(np.median(np.diff(one.t)))))
    whole = len(one.t) // n * n
    strength = np.sqrt(np.mean(one.residual[:whole].reshape(-1, n) ** 2, axis=1))
    ax.plot(one.t[:whole].reshape(-1, n).mean(axis=1), strength, color=colour, linewidth=1.3, label=name)
    ax.set_xlim(one.t[0], one.t[-1])
