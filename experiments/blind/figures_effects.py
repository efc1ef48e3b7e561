"""Effect by effect: how often it is named, and how far its own parameter is off."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from didim_jax.report.canvas import INK, canvas, label, logarithmic, title

from .dots import EXACT, RIGHT, SOFT, aside, names, rates
from .judge import BLOCKS

_LEAST = 1e-2  # percent: smaller errors are drawn here
_SPREAD = 0.22


def errors_by_effect(score: Mapping[str, Any]) -> dict[str, list[float]]:
    """Relative errors of own parameters, in percent, of single effects that are named right, of any size."""
    out: dict[str, list[float]] = {}
    for row in score["rows"]:
        if row["accepted"] and len(row["truth"]) == 1 and row["parameter_errors"]:
            out.setdefault(row["truth"][0], []).extend(100 * error for error in row["parameter_errors"])
    return out


def effects_figure(score: Mapping[str, Any]) -> Figure:
    """Left: accepted and exact, of typical size. Right: error of the effect's own parameters, the median a bar."""
    found, errors = score["groups"].get("effect", {}), errors_by_effect(score)
    listed = [name for name in BLOCKS if name in found or name in errors]
    listed += sorted((set(found) | set(errors)) - set(listed))
    figure, axes = canvas(9.8, 0.235 * max(len(listed), 3) + 1.0, 1, 2, margins=(2.1, 0.75, 0.5, 0.4), wspace=0.32)
    named, off = axes[0]
    at = {name: k for k, name in enumerate(listed)}
    asked = [name for name in listed if name in found]
    rates(named, [at[name] for name in asked], [found[name]["accepted"] for name in asked])
    exact = [found[name]["exact"] for name in asked]
    rates(named, [at[name] for name in asked], exact, color="none", markersize=3.5, zorder=4, **EXACT)
    for name in asked:
        one = found[name]["accepted"]
        aside(named, at[name], f"{one['k']} of {one['n']}")
    names(named, range(len(listed)), listed)
    named.set_xlim(0, 101)
    values = [max(error, _LEAST) for some in errors.values() for error in some]
    for name, some in errors.items():
        shown = np.maximum(some, _LEAST)
        lanes = at[name] + _SPREAD * (np.arange(len(shown)) % 3 - 1)
        off.plot(shown, lanes, "o", color=RIGHT, markersize=3.6, alpha=0.7)
        middle = float(np.median(shown))
        off.plot([middle] * 2, [at[name] - 0.38, at[name] + 0.38], color=INK, linewidth=1.8)
        aside(off, at[name], f"{np.median(some):.1f} %")
    off.set_xscale("log")
    logarithmic(off.xaxis, *((min(values) / 1.5, max(values) * 1.5) if values else (0.1, 10.0)))
    if values:
        off.set_xlim(min(values) / 1.5, max(values) * 1.5)
    for limit, style in ((8, (0, (4, 3))), (3, (0, (1, 2)))):
        off.axvline(limit, color=SOFT, linewidth=1.0, linestyle=style)
    names(off, range(len(listed)), [""] * len(listed))
    for ax in (named, off):
        ax.set_ylim(len(listed) - 0.4, -0.6)
        ax.hlines(np.arange(len(listed)), *ax.get_xlim(), color="#eef0f2", linewidth=0.7, zorder=0)
    title(named, "accepted (white: exact), typical size")
    title(off, "own parameter, where accepted, any size")
    label(named, "accepted, % of the cases, with 95 % intervals")
    label(off, "error of its own parameters, %")
    return figure
