"""How well each parameter is known, beside how well the record could tell it at best."""

import numpy as np
from matplotlib.figure import Figure

from ..identify.study import Study
from .canvas import RESIDUAL, SIMULATED, THIRD, canvas, label, logarithmic, title
from .tables import parameter_rows


def estimates_figure(study: Study) -> Figure:
    """Relative standard deviation of each parameter, both kinds, and its Cramér-Rao bound: percent, logarithmic."""
    rows = parameter_rows(study.result, study.identifiability.lost)
    figure, axes = canvas(9.6, 1.1 + 0.3 * len(rows), 1, 1, margins=(0.75, 0.3, 0.48, 0.58))
    ax = axes[0, 0]
    bound, white, autocorrelated = _percentages(study, [row.name if row.given else "" for row in rows])
    y = np.arange(len(rows))
    ends = np.stack([bound, white, autocorrelated])
    known = np.isfinite(ends).any(axis=0)
    extremes = (np.nanmin(ends[:, known], axis=0), np.nanmax(ends[:, known], axis=0))
    ax.hlines(y[known], *extremes, color="#aeb6bd", linewidth=2)
    ax.plot(bound, y, "|", color=THIRD, markersize=13, markeredgewidth=2.2, label="Cramér-Rao bound before the fit")
    ax.plot(white, y, "o", color=SIMULATED, markersize=6.5, label="if the residual is white")
    ax.plot(autocorrelated, y, "D", color=RESIDUAL, markersize=5.5, label="whatever its spectrum")
    ax.set_xscale("log")
    if known.any():
        low, high = np.nanmin(ends) / 1.6, np.nanmax(ends) * 1.6
        ax.set_xlim(low, high)
        logarithmic(ax.xaxis, low, high)
    ax.set_yticks(y, [row.name for row in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    for k, row in enumerate(rows):
        if not row.given:
            ax.text(0.01, k, row.value, transform=ax.get_yaxis_transform(), va="center", fontsize=9, style="italic")
    label(ax, x="relative standard deviation, %")
    title(ax, "Uncertainty of the estimates", pad=20)
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=3,
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.1,
        handletextpad=0.3,
    )
    return figure


def _percentages(study: Study, names: list[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(bound, white, autocorrelated) of each name, NaN where there is none: a logarithmic axis has no place for it."""
    result, ident = study.result, study.identifiability
    with np.errstate(divide="ignore", invalid="ignore"):
        autocorrelated = 100 * result.std_autocorrelated / np.abs(result.theta)
    columns = (
        dict(zip(ident.names, ident.bound_percent, strict=True)),
        dict(zip(result.names, result.rel_std, strict=True)),
        dict(zip(result.names, autocorrelated, strict=True)),
    )
    values = np.array([[column.get(name, np.nan) for name in names] for column in columns], dtype=float)
    values[~(np.isfinite(values) & (values > 0))] = np.nan
    return values[0], values[1], values[2]
