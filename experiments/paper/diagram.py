"""Figure 4 of the paper, the identification procedure, drawn anew with what each step took and gave."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from didim_jax.report.canvas import INK, SIMULATED, canvas

from .config import PaperConfig
from .methods import DIDIM, STEP_1, STEP_2, Fit

_PALE, _GREY = "#eaf3f9", "#f4f5f6"


def procedure(fits: dict[str, Fit], config: PaperConfig) -> Figure:
    """Record -> step 1 -> step 2 -> step 3, with start values, bands and results. References: paper, fig. 4."""
    figure, axes = canvas(9.6, 4.0, 1, 1, margins=(0.1, 0.1, 0.1, 0.1))
    ax = axes[0, 0]
    ax.axis("off")
    ax.set_xlim(0, 96)
    ax.set_ylim(0, 40)
    one, two, three = (fits[step].result for step in (STEP_1, STEP_2, DIDIM))
    _box(
        ax,
        1,
        30,
        94,
        8.5,
        _GREY,
        "one record: reference qg and motor force tau",
        ["the loop is simulated with the controller, the hold and the drive limit of the machine; no position is used"],
    )
    _step(
        ax,
        1,
        "step 1: rigid DIDIM",
        f"below {config.rigid_cutoff_hz:g} Hz",
        [f"start {config.start_mass_kg:g} kg, no friction (22)"],
        [f"M {one['M']:.1f} kg", f"Fv {one['Fv']:.0f} N s/m, Fc {one['Fc']:.1f} N", f"{one.n_iterations} iterations"],
    )
    _step(
        ax,
        34,
        "step 2: Nelder-Mead",
        f"below {config.flexible_cutoff_hz:g} Hz",
        [f"start lam {config.start_lam:g}, f_n {config.start_f_n_hz:g} Hz (28)", "all friction at the motor (27)"],
        [f"lam {two['lam']:.3f}", f"f_n {two['f_n']:.2f} Hz", f"{two.n_iterations} iterations"],
    )
    _step(
        ax,
        67,
        "step 3: flexible DIDIM",
        f"below {config.flexible_cutoff_hz:g} Hz",
        ["masses, stiffness (29), no friction (30)"],
        [
            f"M1 {three['M1']:.1f} kg, M2 {three['M2']:.1f} kg",
            f"K12 {three['K12']:.3g} N/m",
            f"Fv {three['Fv1']:.0f} N s/m, Fc {three['Fc1']:.1f} N",
            f"{three.n_iterations} iterations",
        ],
    )
    for x in (15, 48, 81):
        _arrow(ax, (x, 30), (x, 25.6))
    for left, text in ((29.4, "M Fv Fc"), (62.4, "lam f_n")):
        _arrow(ax, (left - 0.2, 12.5), (left + 4.4, 12.5))
        ax.text(left + 2.1, 13.4, text, ha="center", va="bottom", fontsize=7.5, color=INK)
    return figure


def _step(ax: Axes, x: float, name: str, band: str, start: list[str], found: list[str]) -> None:
    _box(ax, x, 2.5, 28, 22.5, _PALE, name, [band, "", *start, "", *found])


def _box(ax: Axes, x: float, y: float, width: float, height: float, fill: str, heading: str, lines: list[str]) -> None:
    style = "round,pad=0,rounding_size=0.8"
    ax.add_patch(FancyBboxPatch((x, y), width, height, boxstyle=style, facecolor=fill, edgecolor=SIMULATED))
    centre, top = x + width / 2, y + height
    ax.text(centre, top - 1.6, heading, ha="center", va="top", fontsize=10, fontweight="bold", color=INK)
    ax.text(centre, top - 4.6, "\n".join(lines), ha="center", va="top", fontsize=8.2, color=INK, linespacing=1.3)


def _arrow(ax: Axes, begin: tuple[float, float], end: tuple[float, float]) -> None:
    ax.add_patch(FancyArrowPatch(begin, end, arrowstyle="-|>", mutation_scale=13, color=SIMULATED, linewidth=1.4))
