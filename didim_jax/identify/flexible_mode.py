"""Step 2: mass ratio and mode of the flexible drive, total mass and friction given.

References: paper, section V.C, eq. 23-28.
"""

from collections.abc import Callable

import numpy as np

from ..params import pack, unpack
from ..plant import CoulombViscous, FlexibleDrive, RigidDrive, split
from .least_squares import Stopping
from .nelder_mead import nelder_mead
from .parametrisation import ModeParameters
from .result import IdentificationResult
from .trial import Trial

START = (0.5, 40.0)
"""lam and f_n (Hz) that the paper starts from (Table 2)."""

STOPPING = Stopping(tolerance=1e-2, cost_tolerance=1e-3, max_iterations=100)


def flexible_mode(
    rigid: RigidDrive,
    trials: tuple[Trial, ...],
    start: tuple[float, float] = START,
    stopping: Stopping = STOPPING,
    on_iterate: Callable[[int, np.ndarray, float], None] | None = None,
) -> IdentificationResult:
    """Nelder-Mead over (lam, f_n), with the rigid drive's mass, friction (all on the motor side) and offset.

    ValueError when the rigid drive's friction is not symmetric: eq. 27 has one viscous and one Coulomb parameter.
    """
    return nelder_mead("Nelder-Mead", mode_parameters(rigid), trials, np.array(start), stopping, on_iterate)


def mode_parameters(rigid: RigidDrive) -> ModeParameters:
    """The (lam, f_n) family of flexible drives that share a rigid drive's totals."""
    if not isinstance(rigid.friction, CoulombViscous):
        raise ValueError(
            "step 2 takes symmetric friction (eq. 27): identify the rigid model with symmetric friction first."
        )
    return ModeParameters(rigid.M, rigid.friction, rigid.offset)


def split_rigid(rigid: RigidDrive, lam: float, f_n: float, friction_share: float = 1.0) -> FlexibleDrive:
    """A flexible drive with a rigid one's totals: `lam` of the mass and `friction_share` of the friction at the motor.

    Friction keeps its kind, symmetric or asymmetric. References: paper, eq. 26.
    """
    M1, M2, K12 = split(rigid.M, lam, f_n)
    friction = pack(rigid.friction)
    motor = unpack(rigid.friction, friction_share * friction)
    load = unpack(rigid.friction, (1 - friction_share) * friction)
    return FlexibleDrive(M1, motor, M2, load, K12, rigid.offset)
