"""The few sentences that a result comes down to, the same on the page and in the terminal."""

import math

from ..identify.result import IdentificationResult
from ..identify.study import Run, Study
from .tables import NO_NUMBER, NOT_GIVEN, parameter_rows, percent


def named_runs(study: Study) -> dict[str, Run]:
    """Every record under a short name: fit, fit_2, ..., check."""
    runs = {"fit" if k == 0 else f"fit_{k + 1}": run for k, run in enumerate(study.runs)}
    return runs | ({"check": study.check} if study.check else {})


def role(name: str) -> str:
    """'fit_2' -> 'fit 2'."""
    return name.replace("_", " ")


def record_names(study: Study) -> dict[str, str]:
    """From the label that findings carry, often a whole path, to the name of the record."""
    records = [run.recording for run in named_runs(study).values()]
    return {record.label: record.name for record in records if record.name}


def answer(study: Study) -> str:
    """What was found, in one sentence: the estimates with one standard deviation, and how well the model fits."""
    result, lost = study.result, study.identifiability.lost
    missing = [row.name for row in parameter_rows(result, lost) if row.value == NOT_GIVEN]
    not_given = f"{', '.join(missing)}: {NOT_GIVEN}"
    if said := estimates(result, lost):
        head = "" if result.converged else "Not converged, last iterate: "
        said = head + said + (f" ({not_given})" if missing else "")
    elif not missing:
        return f"No estimate: {result.reason.rstrip('.')}."
    elif result.steps:
        step = result.steps[-1]
        said = f"{not_given}. What it gives is the {step.plant.model} drive, {estimates(step)}"
    else:
        said = not_given
    errors = fit(study)
    return f"{said}; {errors[0].lower()}{errors[1:]}" if errors else f"{said}."


def estimates(result: IdentificationResult, lost: tuple[str, ...] = ()) -> str:
    """'M = 95.15 ± 0.26 kg, Fv = 203 ± 5 N s/m'; empty where there is no estimate."""
    return ", ".join(row.estimate for row in parameter_rows(result, lost) if row.given)


def fit(study: Study) -> str:
    """How well the model's own closed-loop simulation explains each record; empty where there is nothing to compare."""
    errors = [f"{percent(run.force_error)} ({role(name)})" for name, run in named_runs(study).items()]
    errors = [error for error in errors if NO_NUMBER not in error]
    listed = " and ".join(filter(None, [", ".join(errors[:-1]), *errors[-1:]]))
    lost = ", ".join(role(name) for name, run in named_runs(study).items() if not math.isfinite(run.force_error))
    unexplained = f"{listed} of the motor force unexplained"
    said = [f"The {study.result.plant.model} model leaves {unexplained}."] if listed else []
    said += [f"The simulation with the identified drive diverges ({lost})."] if lost else []
    return " ".join(said)


def stage_name(result: IdentificationResult) -> str:
    """'three-step DIDIM, flexible drive'."""
    return f"{result.method}, {result.plant.model} drive" if estimates(result) else "no estimate"


def outcome(result: IdentificationResult) -> str:
    """Converged or not, after how much work, and why it stopped; where nothing was even begun, only why."""
    reason = f"{result.reason.rstrip('.')}."
    if not (result.n_iterations or estimates(result)):
        return reason
    state = "Converged" if result.converged else "Not converged"
    work = f"{_count(result.n_iterations, 'iteration')}, {_count(result.n_simulations, 'simulation')}"
    return f"{state} ({work}): {reason}"


POOR = 0.3
"""A fit that leaves more of its signal than this explains it badly, converged or not."""


def cautions(result: IdentificationResult) -> list[str]:
    """What a reader must know before believing the numbers: what is not explained, or was explained better before."""
    said = []
    if result.relative_error > POOR:
        said.append(
            f"The model leaves {percent(result.relative_error)} of the signal it was fitted to: it is not this "
            "machine's, or the iteration ended in the wrong place, and the standard deviations say nothing of that."
        )
    for number, step in enumerate(result.steps, start=1):
        if _same_signal(step, result) and step.relative_error < result.relative_error:
            said.append(
                f"Step {number} ({step.method}) left {percent(step.relative_error)} of the same signal, the last "
                f"step {percent(result.relative_error)}: the estimates may be further off than their standard "
                "deviations say."
            )
            break
    return said


def _same_signal(a: IdentificationResult, b: IdentificationResult) -> bool:
    return (a.rho_dt, a.rho_unit, len(a.rho)) == (b.rho_dt, b.rho_unit, len(b.rho))


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"
