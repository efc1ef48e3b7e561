"""One identification as plain data for identification.json: strict JSON, so what is not a number becomes null."""

import math
import os
from collections.abc import Mapping
from typing import Any

from ..identify.result import IdentificationResult
from ..identify.study import Run, Study
from .words import named_runs, record_names

SCHEMA = 1
"""Raised when a key changes its name or its meaning; a new key leaves it."""


def identification_document(study: Study) -> dict[str, Any]:
    """Everything but the signals. Nothing is rounded; errors are ratios, and what is in percent says so in its key.

    `closed_loop` has the records by short name (fit, fit_2, ..., check), as simulation.npz does; all units are SI.
    """
    ident = study.identifiability
    runs, labels = named_runs(study), record_names(study)
    document = {
        "schema": SCHEMA,
        **_result(study.result),
        "check": _run(study.check) if study.check else None,
        "closed_loop": {name: _run(run) for name, run in runs.items()},
        "identifiability": {
            "bound_percent": dict(zip(ident.names, ident.bound_percent, strict=True)),
            "directions": ident.directions,
            "verdict": ident.verdict,
            "lost": ident.lost,
        },
        "hygiene": [
            {"record": labels.get(record, record), "check": finding.check, "message": finding.message}
            for record, finding in study.findings
        ],
        "synthetic": study.synthetic,
        "settings": study.settings,
        "seconds": study.seconds,
    }
    return plain(document)


def _result(result: IdentificationResult) -> dict[str, Any]:
    columns = zip(
        result.names, result.theta, result.std, result.rel_std, result.units, result.std_autocorrelated, strict=True
    )
    return {
        "method": result.method,
        "model": result.plant.model,
        "parameters": {
            name: {
                "value": value,
                "std": std,
                "relative_std_percent": relative,
                "unit": unit,
                "std_autocorrelated": autocorrelated,
            }
            for name, value, std, relative, unit, autocorrelated in columns
        },
        "relative_error": result.relative_error,
        "condition_number": result.condition_number,
        "iterations": result.n_iterations,
        "simulations": result.n_simulations,
        "converged": result.converged,
        "reason": result.reason,
        "steps": [_result(step) for step in result.steps],
    }


def _run(run: Run) -> dict[str, Any]:
    return {
        "record": run.recording.name,
        "force_error": run.force_error,
        "position_error": run.position_error,
        "start": run.start,
    }


def plain(value: Any) -> Any:
    """The same in dicts, lists, text and finite numbers; anything else as its text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())  # arrays and scalars of numpy and JAX
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)
