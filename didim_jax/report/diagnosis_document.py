"""A diagnosis as the JSON document that the contract describes."""

import dataclasses
import math
from typing import Any

from ..gap.diagnosis import Diagnosis


def diagnosis_document(d: Diagnosis) -> dict[str, Any]:
    """The document, schema 1; numbers that do not exist are null."""
    document = {
        "schema": 1,
        "verdict": d.verdict,
        "effects": list(d.effects),
        "ambiguous_with": [list(group) for group in d.ambiguous_with],
        "ranking": [{"effect": name, "probability": p} for name, p in d.ranking],
        "parameters": d.parameters,
        "block": d.block,
        "base": {name: dataclasses.asdict(shift) for name, shift in d.base.items()},
        "gap": {
            name: {k: v for k, v in dataclasses.asdict(gap).items() if v is not None} for name, gap in d.gap.items()
        },
        "closed": None if d.share is None else {"share": d.share, "interval": list(d.interval or ())},
        "last_in": d.last_in,
        "where": dataclasses.asdict(d.where),
        "separating_experiment": None if d.experiment is None else dataclasses.asdict(d.experiment),
        "candidates": [
            {
                "effect": c.effect,
                "gap": c.gap,
                "share": c.share,
                "parameters": {k: dataclasses.asdict(v) for k, v in c.parameters.items()},
            }
            for c in d.candidates
        ],
        "atlas": None if d.atlas is None else d.atlas.as_json(),
        "machine": d.machine,
        "synthetic": d.synthetic,
        "remarks": list(d.remarks),
    }
    return _plain(document)


def _plain(value: Any) -> Any:
    """Python numbers instead of NumPy's, null instead of what is not finite."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
