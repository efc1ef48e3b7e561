"""The paper's procedure: rigid DIDIM, mass ratio and mode by Nelder-Mead, then all parameters by DIDIM.

References: paper, section V and fig. 4.
"""

import dataclasses

from ..plant import CoulombViscous, FlexibleDrive, RigidDrive
from .case import Case
from .didim import didim
from .flexible_mode import START, flexible_mode, split_rigid
from .least_squares import Stopping
from .result import IdentificationResult

RIGID_HZ = 5.0
"""Band of step 1, below the first mode (section V.B)."""

FLEXIBLE_HZ = 60.0
"""Band of steps 2 and 3 (section VI.D-E)."""

STEP_3 = Stopping(tolerance=1e-3, cost_tolerance=0.05)
"""Step 3 ends by eq. 21: its columns are not the derivative's, and past its best iterate the criterion creeps up."""


class StepFailed(Exception):
    """A step did not converge; `result` is that step's, with the steps before it."""

    def __init__(self, result: IdentificationResult):
        super().__init__(result.reason)
        self.result = result


def rigid_step(case: Case) -> IdentificationResult:
    """Step 1: rigid DIDIM from the machine's rough mass and no friction. Raises StepFailed. References: eq. 22."""
    start = RigidDrive(case.machine.mass_apriori, CoulombViscous(0.0, 0.0), 0.0)
    result = didim(start, case.free(start), case.trials(start, RIGID_HZ), on_iterate=case.tell("step 1"))
    return _converged(result, "step 1")


def mode_step(case: Case, step1: IdentificationResult, start: tuple[float, float] = START) -> IdentificationResult:
    """Step 2: (lam, f_n) by Nelder-Mead with step 1's totals. Raises StepFailed. References: eq. 25-28."""
    assert isinstance(step1.plant, RigidDrive)
    trials = case.trials(split_rigid(step1.plant, *start), FLEXIBLE_HZ)
    result = flexible_mode(step1.plant, trials, start, on_iterate=case.tell("step 2"))
    return _converged(result, "step 2", step1)


def global_start(step1: IdentificationResult, step2: IdentificationResult) -> FlexibleDrive:
    """Start of step 3: masses and stiffness of the first two steps, no friction. References: eq. 29-30."""
    assert isinstance(step1.plant, RigidDrive)
    drive = split_rigid(step1.plant, *step2.theta)
    none = CoulombViscous(0.0, 0.0)
    return FlexibleDrive(drive.M1, none, drive.M2, none, drive.K12, 0.0)


def three_step(case: Case, friction_sides: int = 1) -> IdentificationResult:
    """All three steps, from motor force alone; `steps` of the result holds the first two.

    `friction_sides` = 1 is the paper's step 3: all friction on the motor side, five columns (and the offset). With 2
    the load side has columns of its own; starting from zero they stay there: the load's rows are balanced already.

    Raises StepFailed when step 1 or 2 does not converge.
    """
    step1 = rigid_step(case)
    step2 = mode_step(case, step1)
    start = global_start(step1, step2)
    free = [name for name in case.free(start) if friction_sides == 2 or name not in ("Fv2", "Fc2")]
    step3 = didim(start, free, case.trials(start, FLEXIBLE_HZ), STEP_3, on_iterate=case.tell("step 3"))
    return dataclasses.replace(step3, method="three-step DIDIM", steps=(step1, step2))


def _converged(result: IdentificationResult, step: str, *before: IdentificationResult) -> IdentificationResult:
    if not result.converged:
        raise StepFailed(dataclasses.replace(result, reason=f"{step}: {result.reason}", steps=before))
    return result
