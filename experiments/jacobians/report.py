"""The page: what the numbers answer, then tables and figures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..page import Section, Tabular, Text, picture, write_page
from .config import Config
from .figures import draw
from .paths import FLEXIBLE
from .twin import SEVEN

type Numbers = Mapping[str, Any]

UNITS = {"M1": "kg", "Fv1": "N s/m", "Fc1": "N", "M2": "kg", "Fv2": "N s/m", "Fc2": "N", "K12": "N/m"}

PAPER_RESIDUAL = 0.0833
"""norm(Y - W X) / norm(Y) of DIDIM in the paper's Table 3."""

CAPTIONS = {
    "columns": "Columns of M1 and K12 below 60 Hz at the true drive. DIDIM's misses how the loop answers.",
    "loop": "The exact column over DIDIM's, frequency by frequency, on the linear loop's closed form T = L/(1+L).",
    "bands": "Cosine between DIDIM's column and the exact one at the true drive. "
    "'load side': M2, Fv2, Fc2 and K12 changed by a common factor.",
    "modes": "Relative error of the columns by cutoff, a line per flexible mode, and the largest eigenvalue below 1 of "
    "I - W^+ J: what one DIDIM iteration leaves of an error in the directions in which it moves at all.",
    "iterates": "Cosines along the iterates of step 1 (5 Hz; 60 Hz, where the rigid model does not belong) and of "
    "step 3. Circles: along DIDIM's iterates; squares: along those of exact Gauss-Newton.",
    "paths": "Step 3 on one noisy record. DIDIM's five and seven columns lie on each other, as do both exact methods.",
    "draws": "Noise draws: bias of every method, spread and coverage of exact Gauss-Newton. "
    "Bars: 95 % of what chance leaves of a standard deviation.",
    "friction": "Friction of the two sides from motor force alone, by excitation (equally long, same noise).",
}


def write(out: Path, config: Config, arrays: Mapping[str, np.ndarray], numbers: Numbers) -> None:
    """report.html and figures/."""
    figures = {
        name: picture(figure, out / "figures" / f"{name}.png", CAPTIONS[name]) for name, figure in draw(arrays).items()
    }
    sections = [
        Section(
            "Where eq. 17-18 holds", [*_where(numbers, config), figures["loop"], figures["bands"], figures["modes"]]
        ),
        Section("The columns themselves, and along the iterates", [figures["columns"], figures["iterates"]]),
        Section("The stacked system", _stacked(numbers)),
        Section("From step 2's start to the end", [figures["paths"], *_ends(numbers)]),
        Section("Bias, spread and coverage", [*_draws(numbers, config), figures["draws"]]),
        Section("Cost", _cost(numbers, config)),
        Section("Friction of both sides from motor force alone", [*_friction(numbers), figures["friction"]]),
    ]
    source = (
        "SYNTHETIC DATA: simulated twin of the paper's drive (Table 3 parameters), at rest at first, "
        f"white noise of {config.noise:g} N rms on the motor force; nothing here was measured."
    )
    footer = (
        "Columns by didim_jax.identify.didim_columns and exact_columns, theta = scale x for both. Numbers in "
        "metrics.json, arrays behind every figure in arrays.npz, config and versions in run.json."
    )
    title = "When is DIDIM's approximation good enough, and what does exact differentiation buy?"
    write_page(out / "report.html", title, source, answer(numbers, config), sections, footer)


def answer(numbers: Numbers, config: Config) -> list[str]:
    """Five sentences, every number from the results."""
    rigid5, rigid60, flexible = (
        numbers["columns"][f"{model} {hz:g} Hz"]
        for model, hz in (("rigid", config.rigid_hz), ("rigid", config.cutoff_hz), ("flexible", config.cutoff_hz))
    )
    five, exact = numbers["draws"]["didim five"], numbers["draws"]["gauss-newton"]
    masses = ("M1", "M2", "K12")
    off = {
        key: {n: 100 * (numbers["paths"][key]["theta"][n] / numbers["truth"][n] - 1) for n in masses}
        for key in ("exact five", "didim five")
    }
    seconds = numbers["cost"]["iteration"]
    ratio = seconds["exact, seven columns"] / seconds["DIDIM, seven columns"]
    bias = max(abs(v) for v in exact["bias in its std"].values())
    spread = exact["std over the bound"].values()
    return [
        "DIDIM's column is what a parameter does before the position loop answers, the exact one that times the loop "
        f"(J = T W): eq. 17-18 holds well below the loop's bandwidth, for the mass to {config.accepted:.0%} up to "
        f"{numbers['modes']['rigid good to, Hz']['M']:.1f} Hz.",
        f"So it is good enough for rigid step 1 at {config.rigid_hz:g} Hz (cosines {_range(rigid5['cosine'])}; an "
        f"iteration leaves {100 * max(rigid5['contraction']):.1f} % of an error), and not at {config.cutoff_hz:g} Hz "
        f"(cosine of M {rigid60['cosine']['M']:.2f}).",
        f"For flexible step 3 at {config.cutoff_hz:g} Hz it is not: the columns of M1 and K12 have cosines "
        f"{flexible['cosine']['M1']:.2f} and {flexible['cosine']['K12']:.2f} with the exact ones, the load side can "
        "only be scaled as a whole (f_n stays where step 2 left it), and the paper's five columns are biased by "
        f"{', '.join(f'{n} {_signed(five["bias"][n], n)}' for n in masses)}.",
        "Where the model fits, and step 2's f_n with it, wrong columns cost time and spread; where it does not, they "
        "multiply the model's error: with all friction on the motor side the exact derivative is off by "
        f"{_percents(off['exact five'])}, DIDIM by {_percents(off['didim five'])}.",
        f"Exact differentiation buys all seven parameters, both sides' friction among them: in {exact['draws']} draws "
        f"a bias of at most {bias:.2f} std, a spread of {min(spread):.2f} to {max(spread):.2f} of the Cramér-Rao bound "
        f"and {_covered(numbers)}, for {ratio:.1f} times the time of a DIDIM iteration.",
    ]


def _covered(numbers: Numbers) -> str:
    if "coverage" not in numbers["draws"]:
        return "intervals not judged, since a draw did not converge"
    shares = numbers["draws"]["coverage"]["autocorrelated"].values()
    return f"95 % intervals that hold the truth in {100 * min(shares):.1f} to {100 * max(shares):.1f} %"


# -- sections ----------------------------------------------------------------------------------------------------


def _where(numbers: Numbers, config: Config) -> list[Text | Tabular]:
    rows = []
    for key, here in numbers["columns"].items():
        for name, cosine in here["cosine"].items():
            if np.isfinite(cosine):
                error = here["error"][name]
                verdict = "holds" if error < config.accepted else "does not"
                rows.append([f"{key}, {name}", f"{cosine:.3f}", f"{here['ratio'][name]:.3g}", f"{error:.3g}", verdict])
    good = numbers["modes"]["good to, Hz"]
    header = ["mode f_n (Hz)", *(f"{f:g}" for f in numbers["modes"]["f_n"])]
    shown = ("M1", "Fv1", "Fc1", "K12", "load side")
    reach = [[name, *(_hz(x) for x in good[name])] for name in shown]
    text = (
        "A parameter that changes acts as a disturbing force, its column W; the loop answers, and what appears in the "
        "motor force is J = T W with T = L/(1 + L), 1 at rest and below the loop's bandwidth, above it large, late and "
        "then small; a flexible mode adds its own notch and peak. Eq. 17-18 is T = 1. It holds for friction while "
        "cruising, and fails for whatever lives above a few hertz: the mass in a chirp, Coulomb friction at reversals. "
        "K12 has no such band: DIDIM's column is the deflection, the exact one is what a stiffness does to the motion."
    )
    return [
        Text(text),
        Tabular(
            ["column at the true drive", "cosine", "norm ratio", "relative error", f"eq. 18 to {config.accepted:.0%}"],
            rows,
        ),
        Tabular(
            header, reach, f"Highest cutoff (Hz) at which a column is within {config.accepted:.0%}; - where none is."
        ),
    ]


def _stacked(numbers: Numbers) -> list[Text | Tabular]:
    rows = []
    for key in (k for k in numbers["columns"] if k.startswith("flexible")):
        here = numbers["columns"][key]
        rows.append([key, *(f"{here['stacked cosine'][n]:.2f}" for n in SEVEN)])
        rows.append(["eigenvalues of I - W^+ J (any order)", *(f"{x:.2f}" for x in here["contraction"])])
    text = (
        "DIDIM stacks the load side's balance below: M2, Fv2, Fc2 have columns only there, where the exact derivative "
        "is zero, because the simulated load balances whatever theta is. Their cosine is 0. The least squares is "
        "still not blind: it keeps that balance, which allows one change, all of M2, Fv2, Fc2, K12 by a common factor. "
        "So three eigenvalues are 1: f_n, Fv2/M2 and Fc2/M2 stay where they start, for ever. Started without load "
        "friction (eq. 30) the seven columns are the five. That motor force 'cannot separate' the two sides' friction "
        "is a property of these columns, not of the data."
    )
    return [Text(text), Tabular(["cosine with the load's rows", *SEVEN], rows)]


def _ends(numbers: Numbers) -> list[Text | Tabular]:
    rows = []
    for key, name in FLEXIBLE.items():
        here = numbers["paths"][key]
        values = [_value(here["theta"].get(n)) for n in SEVEN]
        rows.append([name, *values, f"{here['f_n, Hz'][0]:.3f}", f"{here['f_n, Hz'][-1]:.3f}"])
    rigid = [
        [key.removeprefix("rigid "), *(f"{here['theta'][n]:.4g} ± {here['std'][n]:.2g}" for n in ("M", "Fv", "Fc"))]
        for key, here in numbers["paths"].items()
        if key.startswith("rigid")
    ]
    header = ["step 3, run to its own end", *(f"{n} ({UNITS[n]})" for n in SEVEN), "f_n at first", "f_n (Hz)"]
    return [
        Tabular(header, rows),
        Tabular(
            ["step 1, rigid drive", "M (kg)", "Fv (N s/m)", "Fc (N)"], rigid, "Totals of the twin: 106, 200.5, 19.5."
        ),
    ]


def _draws(numbers: Numbers, config: Config) -> list[Text | Tabular]:
    draws = numbers["draws"]
    rows, spread = [], []
    for key in ("gauss-newton", *config.methods):
        here = draws[key]
        name = f"{FLEXIBLE[key]} ({here['converged']} of {here['draws']})"
        values = [
            f"{_signed(here['bias'][n], n)} ({_times(here['bias in bounds'][n])})"
            if n in here["names"]
            else "left at 0"
            for n in SEVEN
        ]
        rows.append([name, *values])
        spread.append([name, *(f"{here['std over the bound'][n]:.2f}" if n in here["names"] else "-" for n in SEVEN)])
    kinds = {"white": "own, eq. 13-14", "autocorrelated": "own, any spectrum of rho", "bound": "the bound"}
    low, high = draws["coverage limits"]
    covered = [
        [f"95 % interval by {kinds[k]}", *(f"{100 * v[n]:.1f} %" for n in SEVEN)]
        for k, v in draws.get("coverage", {}).items()
    ]
    stated = [
        [f"stated std, {kinds[k]}, over the bound", *(f"{v[n]:.3f}" for n in SEVEN)]
        for k, v in draws.get("stated std over the bound", {}).items()
    ]
    check = draws.get("check")
    text = (
        "Noise is drawn on one noise-free record (the encoder's steps are in it). The bound takes every sample of the "
        "record. Exact Gauss-Newton starts from the truth; "
        + (
            f"{check['draws']} draws repeated from step 2's start end within {check['apart']:.1e} bounds of the same "
            f"estimate, with stated std within {100 * check['std_apart']:.2f} %. "
            if check
            else ""
        )
        + "Each draw's own std comes from its own residual and the columns at the truth. Eq. 13-14 takes the decimated "
        "noise for white; the 60 Hz filter leaves neighbours a correlation of 0.14, so it promises a little too much. "
        f"Limits (binomial, 99.9 %) of an honest interval: {100 * low:.1f} to {100 * high:.1f} %. DIDIM ends by "
        "eq. 21; where its draws end at different iterations, its spread is that choice."
    )
    head = [f"{n} ({UNITS[n]})" for n in SEVEN]
    return [
        Text(text),
        Tabular(["bias (in std of the bound)", *head], rows),
        Tabular(["std over draws / bound", *SEVEN], spread),
        Tabular(["exact Gauss-Newton", *SEVEN], [*covered, *stated]),
        Tabular(["", *head], [["Cramér-Rao bound", *(f"{draws['bound'][n]:.3g}" for n in SEVEN)]]),
    ]


def _cost(numbers: Numbers, config: Config) -> list[Text | Tabular]:
    cost = numbers["cost"]
    names = {**FLEXIBLE, "step 1": "step 1, rigid DIDIM", "step 2": "step 2, Nelder-Mead"}
    rows = [
        [
            names.get(key, key),
            str(here["parameters"]),
            str(here["iterations"]),
            str(here["simulations"]),
            f"{here['warm, s']:.2f}",
            f"{1000 * here['warm, s'] / here['simulations']:.0f}",
            f"{max(here['first call, s'] - here['warm, s'], 0):.1f}",
        ]
        for key, here in {**cost["steps"], **cost["step 3"]}.items()
    ]
    header = [
        "identification",
        "parameters",
        "iterations",
        "simulations",
        "warm (s)",
        "ms per simulation",
        "compile (s)",
    ]
    each = [[key, f"{1000 * seconds:.1f}"] for key, seconds in cost["iteration"].items()]
    text = (
        "An exact column is a tangent carried along in the simulation; DIDIM's are read off it. Compile is the first "
        "call less the warm one; where a program of the same shape was compiled before, or is stored, it is near 0."
    )
    return [
        Text(text),
        Tabular(["residual and columns, median", "ms"], each, f"One evaluation, {config.timings} repetitions."),
        Tabular(header, rows),
    ]


def _friction(numbers: Numbers) -> list[Text | Tabular]:
    friction = numbers["friction"]
    shown = ("Fv1", "Fv2", "Fc1", "Fc2")
    rows = [
        [
            name,
            *(f"{here['bound'][n]:.3g} / {here['std'][n]:.3g}" for n in shown),
            f"{here['bound of Fv1 + Fv2']:.2g}",
            f"{here['bound of Fc1 + Fc2']:.2g}",
            f"{here['correlation Fv1 Fv2']:.3f}",
            f"{here['correlation Fc1 Fc2']:.3f}",
            f"{here['converged']} of {here['draws']}",
        ]
        for name, here in friction.items()
    ]
    header = [
        "excitation: bound / std over draws", *(f"{n} ({UNITS[n]})" for n in shown), "Fv1 + Fv2", "Fc1 + Fc2",
        "corr. Fv", "corr. Fc", "converged",
    ]  # fmt: skip
    wider = PAPER_RESIDUAL / numbers["draws"]["gauss-newton"]["criterion"]
    worst = {n: wider * friction["trapezoids"]["bound"][n] for n in ("Fv1", "Fc1")}
    text = (
        "The paper: 'we cannot separate motor friction from load friction'. With the exact derivative every excitation "
        "here separates them while the model is right: their errors are strongly opposed, and chirps beside the moves "
        "loosen that. The bound grows in proportion to the residual: with the paper's of "
        f"{100 * PAPER_RESIDUAL:.1f} % (Table 3) as noise it would be {wider:.0f} times wider, by trapezoids alone "
        f"{worst['Fv1']:.0f} N s/m for Fv1 and {worst['Fc1']:.1f} N for Fc1; and a real residual is model error."
    )
    return [Text(text), Tabular(header, rows)]


# -- words -------------------------------------------------------------------------------------------------------


def _signed(value: float, name: str) -> str:
    return f"{value:+.3g} {UNITS[name]}" if abs(value) < 1000 else f"{value:+,.0f} {UNITS[name]}"


def _value(value: float | None) -> str:
    return "-" if value is None else "0" if abs(value) < 1e-9 else f"{value:.5g}" if value < 1e5 else f"{value:,.0f}"


def _times(value: float) -> str:
    return f"{value:+.2f}" if abs(value) < 10 else f"{value:+.0f}"


def _hz(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"


def _range(values: Mapping[str, float]) -> str:
    low, high = min(values.values()), max(values.values())
    return f"{low:.3f} to {high:.3f}"


def _percents(values: Mapping[str, float]) -> str:
    return ", ".join(f"{v:+.1f} % ({n})" for n, v in values.items())
