"""A diagnosis as the JSON document that the contract describes."""

import dataclasses
from typing import Any

from ..gap.diagnosis import Diagnosis
from .document import plain

SCHEMA = 1
"""Raised when a key changes its name or its meaning; a new key leaves it."""


def diagnosis_document(d: Diagnosis) -> dict[str, Any]:
    """The document, schema 1, everything but the signals. Nothing is rounded; numbers that do not exist are null."""
    document = {
        "schema": SCHEMA,
        "verdict": d.verdict,
        "effects": d.effects,
        "ambiguous_with": d.ambiguous_with,
        "ranking": [{"effect": name, "probability": p} for name, p in d.ranking],
        "parameters": d.parameters,
        "block": d.block,
        "base": {name: dataclasses.asdict(shift) for name, shift in d.base.items()},
        "gap": {
            name: {k: v for k, v in dataclasses.asdict(gap).items() if v is not None} for name, gap in d.gap.items()
        },
        "closed": None if d.share is None else {"share": d.share, "interval": d.interval},
        "last_in": d.last_in,
        "where": dataclasses.asdict(d.where),
        "separating_experiment": None if d.experiment is None else dataclasses.asdict(d.experiment),
        "candidates": [
            {
                "effect": c.effect,
                "probability": c.probability,
                "gap": c.gap,
                "share": c.share,
                "parameters": {k: v.document() for k, v in c.parameters.items()},
            }
            for c in d.candidates
        ],
        "atlas": None if d.atlas is None else d.atlas.as_json(),
        "atlas_after": None if d.atlas_after is None else d.atlas_after.as_json(),
        "evidence": d.evidence,
        "machine": d.machine,
        "synthetic": d.synthetic,
        "remarks": [*d.doubts, *d.remarks],
    }
    return plain(document)
