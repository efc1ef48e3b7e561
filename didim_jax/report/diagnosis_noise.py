"""One noise on the whole page: that of the gap, in N for the maps, which estimate one of their own."""

import dataclasses

from ..gap.atlas import Atlas
from ..gap.diagnosis import Diagnosis


def maps(d: Diagnosis) -> tuple[Atlas | None, Atlas | None]:
    """The map before and, where an effect was adopted, the one after, both with the noise of the fit record's gap."""
    gap = d.gap["fit"]
    before = _with_noise(d.atlas, gap.floor, gap.before)
    return before, _with_noise(d.atlas_after, gap.floor, gap.after) if d.effects else None


def _with_noise(one: Atlas | None, floor: float, gap: float) -> Atlas | None:
    """The map's residual is the gap in N, so the noise is to its rms as the floor is to the gap."""
    return dataclasses.replace(one, floor_rms=one.rms * floor / gap) if one is not None and gap > 0 else one
