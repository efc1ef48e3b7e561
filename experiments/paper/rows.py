"""Rows of tables.json: what the paper prints, what we find on the twin, and what the twin's parameters are."""

import dataclasses
import math
from collections.abc import Iterable, Iterator

from .beyond import Draws, Fits
from .methods import (
    DIDIM,
    DIDIM_7,
    DIDIM_7_HALF,
    EXACT,
    FIVE,
    FLEXIBLE,
    LS,
    LS_LATE,
    OE_FORCE,
    OE_POSITION,
    SEVEN,
    STEP_1,
    STEP_2,
    Fit,
)
from .published import BARE, LOADED, Key, entries, unit
from .twin import PLUS, Twin

SUMS = ("M1 + M2", "Fv1 + Fv2", "Fc1 + Fc2")

type Pair = tuple[float | None, float | None]
"""(ours, truth)."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One number: the paper's, ours, and the twin's true value; None where there is none."""

    table: str
    parameter: str
    case: str
    paper: float | None
    ours: float | None
    truth: float | None
    unit: str

    @property
    def difference(self) -> float | None:
        """Ours from the paper's, percent of the paper's."""
        return _relative(self.ours, self.paper)

    @property
    def error(self) -> float | None:
        """Ours from the truth, percent of the truth."""
        return _relative(self.ours, self.truth)


def _relative(a: float | None, b: float | None) -> float | None:
    return 100 * (a / b - 1) if a is not None and b else None


def eq_34(found: float, didim: float) -> float:
    """%e of a Nelder-Mead estimate against DIDIM's. References: paper, eq. 34."""
    return 100 * (found - didim) / didim


def table_rows(sets: dict[str, Twin], fits: Fits, draws: dict[str, Draws], forces: dict[str, float]) -> list[Row]:
    """Every row of Tables 1-6 and of the text in the paper's order, then ours alone (table "extra").

    `forces` are the force errors (%) of the cross-validation by method. KeyError when a number of the paper has no
    counterpart.
    """
    ours = dict(_measured(sets, fits))
    paper = {entry.key: entry.value for entry in entries()}
    rows = [_row(key, value, ours.pop(key)) for key, value in paper.items()]
    rows += [_row(key, None, pair) for key, pair in ours.items()]
    rows += [_row(("extra", "relative error", f"check, {m}"), None, (e, None)) for m, e in forces.items()]
    for method, drawn in draws.items():
        case = f"{PLUS}, {method}, {len(drawn.delta_M2)} of {drawn.asked} draws"
        rows.append(_row(("extra", "Delta M2", f"{case}, mean"), None, (drawn.mean, sets[PLUS].payload_kg)))
        rows.append(_row(("extra", "Delta M2", f"{case}, std"), None, (drawn.std, None)))
    return rows


def _row(key: Key, paper: float | None, pair: Pair) -> Row:
    ours, truth = (None if x is None or not math.isfinite(x) else float(x) for x in pair)
    return Row(*key, paper=paper, ours=ours, truth=truth, unit=unit(key[1], key[2]))


def _measured(sets: dict[str, Twin], fits: Fits) -> Iterator[tuple[Key, Pair]]:
    for name, twin in sets.items():
        tables = {BARE: "3", LOADED: "4"}
        extra = name == PLUS
        yield from _steps("extra" if extra else "1", "extra" if extra else "2", twin, fits[name])
        yield from _flexible(tables.get(name, "extra"), twin, fits)
        yield from _output_error("extra" if extra else None, twin, fits)
    yield from _text(fits[BARE])


def _steps(first: str, second: str, twin: Twin, fits: dict[str, Fit]) -> Iterator[tuple[Key, Pair]]:
    """Tables 1 and 2."""
    step1, step2 = fits[STEP_1].result, fits[STEP_2].result
    for k, name in enumerate(("M_tot", "Fv_tot", "Fc_tot")):
        yield (first, name, f"{twin.name}, start"), (step1.trace[0][k], None)
        yield (first, name, f"{twin.name}, result"), (step1.theta[k], twin.truth[name])
        yield (first, name, f"{twin.name}, %std"), (step1.rel_std[k], None)
    yield (first, "relative error", f"{twin.name}, result{_of(first, STEP_1)}"), (100 * step1.relative_error, None)
    yield (first, "iterations", f"{twin.name}, result{_of(first, STEP_1)}"), (step1.n_iterations, None)
    for k, name in enumerate(("lam", "f_n")):
        yield (second, name, f"{twin.name}, start"), (step2.trace[0][k], None)
        yield (second, name, f"{twin.name}, result"), (step2.theta[k], twin.truth[name])
    yield (second, "relative error", f"{twin.name}, result{_of(second, STEP_2)}"), (100 * step2.relative_error, None)
    yield (second, "iterations", f"{twin.name}, result{_of(second, STEP_2)}"), (step2.n_iterations, None)


def _of(table: str, step: str) -> str:
    """Which step, where one table holds both."""
    return f", {step}" if table == "extra" else ""


def _flexible(table: str, twin: Twin, fits: Fits) -> Iterator[tuple[Key, Pair]]:
    """Tables 3 and 4, and the columns that they do not have: the other variants and exact Gauss-Newton."""
    for method in (LS, LS_LATE, DIDIM, DIDIM_7, DIDIM_7_HALF, EXACT):
        fit, case = fits[twin.name][method], f"{twin.name}, {method}"
        yield from _values(table, case, method, fit, twin)
        for name in SEVEN:
            if method == DIDIM:
                start = fit.result.trace[0][FIVE.index(name)] if name in FIVE else 0.0
                yield (table, name, f"{case} start"), (start, None)
            yield (table, name, f"{case} %std"), (fit.rel_std(name), None)
        yield (table, "relative error", case), (100 * fit.result.relative_error, None)
        yield (table, "iterations", case), (fit.result.n_iterations, None)
        yield from _payload(table, case, method, twin, fits)


def _output_error(table: str | None, twin: Twin, fits: Fits) -> Iterator[tuple[Key, Pair]]:
    """Tables 5 and 6."""
    didim = fits[twin.name][DIDIM].parameters
    for own, method in (("5", OE_POSITION), ("6", OE_FORCE)):
        fit, case, where = fits[twin.name][method], f"{twin.name}, {method}", table or own
        yield from _values(where, case, method, fit, twin)
        yield from _payload(where, case, method, twin, fits)
        for name in ("M1", "M2", "K12", *SUMS):
            yield (where, name, f"{case}, eq. 34"), (eq_34(fit.parameters[name], didim[name]), None)
        if twin.name != BARE:
            delta = eq_34(delta_M2(fits, twin.name, method), delta_M2(fits, twin.name, DIDIM))
            yield (where, "Delta M2", f"{case}, eq. 34"), (delta, None)
        yield (where, "relative error", case), (100 * fit.result.relative_error, None)
        yield (where, "iterations", case), (fit.result.n_iterations, None)
        yield (where, "simulations", case), (fit.result.n_simulations, None)


def _values(table: str, case: str, method: str, fit: Fit, twin: Twin) -> Iterator[tuple[Key, Pair]]:
    truth: dict[str, float | None] = dict(twin.truth)
    if method in (DIDIM, DIDIM_7):  # friction is one: what the motor side shows is to be compared with the sum
        truth |= {"Fv1": truth["Fv_tot"], "Fc1": truth["Fc_tot"], "Fv2": None, "Fc2": None}
    for name in (*SEVEN, *SUMS):
        yield (table, name, case), (fit.parameters[name], truth[name])


def _payload(table: str, case: str, method: str, twin: Twin, fits: Fits) -> Iterator[tuple[Key, Pair]]:
    if twin.name != BARE:
        yield (table, "Delta M2", case), (delta_M2(fits, twin.name, method), twin.payload_kg)


def delta_M2(fits: Fits, name: str, method: str) -> float:
    """M2 with the payload less M2 without, kg."""
    return fits[name][method].parameters["M2"] - fits[BARE][method].parameters["M2"]


def delta_M2_std(fits: Fits, name: str, method: str) -> float:
    """Its standard deviation from those of the two fits, kg."""
    return math.hypot(fits[name][method].std("M2"), fits[BARE][method].std("M2"))


def three_step_seconds(fits: dict[str, Fit]) -> float:
    """Run time of steps 1 to 3, s, compiling apart."""
    return sum(fits[step].run_s for step in (STEP_1, STEP_2, DIDIM))


def _text(fits: dict[str, Fit]) -> Iterable[tuple[Key, Pair]]:
    """What the text says of iterations and times; of Nelder-Mead it is the faster of the two, as "a minimum" says."""
    simplex = min((fits[OE_POSITION], fits[OE_FORCE]), key=lambda fit: fit.result.n_iterations)
    for name, method in (("step 1", STEP_1), ("step 3", DIDIM)):
        yield ("text", "iterations", name), (fits[method].result.n_iterations, None)
        yield ("text", "time", name), (fits[method].run_s, None)
    yield ("text", "time", "three-step DIDIM"), (three_step_seconds(fits), None)
    yield ("text", "iterations", "Nelder-Mead"), (simplex.result.n_iterations, None)
    yield ("text", "simulations", "Nelder-Mead"), (simplex.result.n_simulations, None)
    yield ("text", "time", "Nelder-Mead"), (simplex.run_s, None)
    yield ("text", "ratio", "Nelder-Mead over DIDIM, time"), (simplex.run_s / three_step_seconds(fits), None)
    for method in (STEP_1, STEP_2, *FLEXIBLE):
        yield ("extra", "time", f"{method}, run"), (fits[method].run_s, None)
        yield ("extra", "time", f"{method}, compile"), (fits[method].compile_s, None)
