"""What the figures share: a canvas without global state, colours, and traces thinned to what a screen can show."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from ..recording import Recording

# Okabe and Ito's palette: told apart by colour-blind readers, and in grey by their lightness.
MEASURED = "#9aa3ab"
SIMULATED = "#0072b2"
RESIDUAL = "#d55e00"
THIRD = "#009e73"
FAINT = "#c9ced3"
INK = "#20262c"
DPI = 120


def canvas(
    width: float, height: float, rows: int, columns: int, *, margins: Sequence[float], **grid: Any
) -> tuple[Figure, np.ndarray]:
    """A figure (inches) and its axes, (rows, columns). `margins` are left, right, bottom, top in inches.

    Margins are given, not computed: a layout engine draws everything twice.
    """
    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    left, right, bottom, top = margins
    box = {"left": left / width, "right": 1 - right / width, "bottom": bottom / height, "top": 1 - top / height}
    sharing = {key: grid.pop(key) for key in ("sharex", "sharey") if key in grid}
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={**box, **grid}, **sharing)
    for ax in axes.flat:
        tidy(ax)
    return figure, axes


def tidy(ax: Axes) -> None:
    """Open frame, light grid, small figures."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color("#8a939b")
    ax.tick_params(labelsize=8.5, color="#8a939b", labelcolor=INK, length=3)
    ax.grid(color="#e6e9ec", linewidth=0.7)
    ax.set_axisbelow(True)


def label(ax: Axes, x: str = "", y: str = "") -> None:
    """Axis labels, quantity and unit; an empty one leaves what is there."""
    if x:
        ax.set_xlabel(x, fontsize=9, color=INK)
    if y:
        ax.set_ylabel(y, fontsize=9, color=INK)


def logarithmic(axis: Axis, low: float, high: float) -> None:
    """Plain numbers on a logarithmic axis: decades, and 2 and 5 between them where there are few."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 300 * low else (1,), numticks=16))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def title(ax: Axes, text: str, **style: Any) -> None:
    """A left-aligned title; names come from files, so a dollar sign in one is a dollar sign."""
    style = {"fontsize": 9.5, "color": INK, **style}
    ax.set_title(text, loc="left", parse_math=False, **style)


def png(figure: Figure) -> bytes:
    """The figure as a PNG."""
    buffer = io.BytesIO()
    # Level 1 is half the time of the default, for a file a fifth larger.
    figure.savefig(buffer, format="png", pil_kwargs={"compress_level": 1})
    return buffer.getvalue()


def envelope(t: np.ndarray, x: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest sample of each of `bins` stretches, in order of time: all that pixels can show."""
    size = len(x) // bins
    if size < 4:
        return t, x
    whole = len(x) // size * size
    rows = x[:whole].reshape(-1, size)
    offsets = np.arange(len(rows)) * size
    kept = np.sort(np.concatenate([offsets + rows.argmin(axis=1), offsets + rows.argmax(axis=1), [len(x) - 1]]))
    return t[kept], x[kept]


def record_title(recording: Recording) -> str:
    """Name of a record, and that it is synthetic where it is."""
    return f"{recording.name or recording.label}{' — SYNTHETIC' if recording.synthetic else ''}"
