"""The methods by name, and the choices that they share."""

import dataclasses
import enum

from .trial import FORCE, Signal


class Method(enum.Enum):
    """Identification methods, as the command line calls them."""

    THREE_STEP = "three-step"
    IDIM_LS = "idim-ls"
    DIDIM = "didim"
    GAUSS_NEWTON = "gauss-newton"
    OUTPUT_ERROR = "output-error"


@dataclasses.dataclass(frozen=True)
class Choices:
    """What an identification is asked for.

    `method` None is the model's own: DIDIM for a rigid drive, three-step for a flexible one.
    `offset` None: on for symmetric friction, off for asymmetric (a constant force and unequal Coulomb friction differ
    only at rest, so that a record gives one of them).
    `cutoff_hz` None: 5 Hz for rigid DIDIM (paper, V.B), 60 Hz otherwise (VI).
    """

    model: str
    method: Method | None = None
    asymmetric: bool = False
    offset: bool | None = None
    at_rest: bool = False
    cutoff_hz: float | None = None
    signal: Signal = FORCE
