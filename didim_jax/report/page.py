"""report.html: one self-contained page, no script, nothing fetched, saying what was found and how far to trust it."""

import base64
import importlib.metadata
import importlib.resources
import math
import platform
import re
from collections.abc import Mapping
from typing import Any

import jinja2
from markupsafe import Markup, escape

from ..identify.result import IdentificationResult
from ..identify.study import Run, Study
from .tables import NO_NUMBER, parameter_rows, percent, significant
from .words import answer, cautions, estimates, named_runs, outcome, record_names, role, stage_name

_PACKAGES = ("didim_jax", "jax", "numpy", "scipy", "optimistix", "diffrax")


def render_page(study: Study, figures: Mapping[str, bytes]) -> str:
    """The page, with each figure (PNG, by the names of `figures.draw`) inside it."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["minus"] = _minus
    template = importlib.resources.files(__package__).joinpath("identify.html.j2").read_text(encoding="utf-8")
    lost = study.identifiability.lost
    return environment.from_string(template).render(
        study=study,
        answer=_unbroken(answer(study), study),
        stages=[_stage(step, k, lost) for k, step in enumerate((*study.result.steps, study.result), start=1)],
        cautions=cautions(study.result),
        final=_stage(study.result, 0, lost),
        instead=_stage(study.result.steps[-1], 0) if study.result.steps and not estimates(study.result, lost) else None,
        records=[_record(name, run) for name, run in named_runs(study).items()],
        findings=[(record_names(study).get(label, label), finding) for label, finding in study.findings],
        settings={name: _setting(value) for name, value in study.settings.items()},
        seconds={name: f"{value:.2f} s" for name, value in study.seconds.items()},
        versions=versions(),
        figures={name: base64.b64encode(png).decode("ascii") for name, png in figures.items()},
    )


def versions() -> dict[str, str]:
    """What computed this: Python and the packages, by name."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:  # run from the checkout
            found[name] = "not installed"
    return found


def _minus(text: str) -> str:
    """A true minus before a number: -3.17, 5e-08, qm[-1]; hyphens stay."""
    return re.sub(r"(?<!\w)-(?=\d)|(?<=\de)-(?=\d)", "−", text)


def _unbroken(text: str, study: Study) -> Markup:
    """The sentence as HTML, in which no line breaks between a number and its unit."""
    html = str(escape(_minus(text)))
    for result in (*study.result.steps, study.result):
        for row in parameter_rows(result, study.identifiability.lost):
            said = str(escape(_minus(row.estimate)))
            if row.given and f"<span>{said}" not in html:
                html = html.replace(said, f"<span>{said}</span>")
    return Markup(html)


def _stage(result: IdentificationResult, number: int, lost: tuple[str, ...] = ()) -> dict[str, Any]:
    """One step of a procedure, or the whole of it, as text."""
    return {
        "number": number,
        "name": stage_name(result),
        "converged": result.converged,
        "outcome": outcome(result),
        "rows": parameter_rows(result, lost),
        "relative_error": percent(result.relative_error),
        "condition_number": significant(result.condition_number, 3),
        "cosine": f"{result.gradient_cosine:.1g}" if math.isfinite(result.gradient_cosine) else NO_NUMBER,
    }


def _record(name: str, run: Run) -> dict[str, Any]:
    """One record and its closed-loop simulation, as text."""
    record = run.recording
    return {
        "key": f"force_{name}",
        "role": role(name),
        "name": record.name or record.label,
        "synthetic": record.synthetic,
        "samples": len(record),
        "duration": f"{record.t[-1] - record.t[0]:.1f} s",
        "force_error": percent(run.force_error),
        "position_error": percent(run.position_error),
        "start": ", ".join(f"{state} = {value:.4g}" for state, value in run.start.items()) or NO_NUMBER,
    }


def _setting(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(_setting(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
