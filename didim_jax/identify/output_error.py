"""Output error by Nelder-Mead over all parameters: the method that the paper measures DIDIM against.

References: paper, section VI (comparison with other OE methods), eq. 32-33.
"""

from collections.abc import Callable, Sequence

import numpy as np

from ..plant import AbstractPlant, FlexibleDrive, RigidDrive
from .flexible_mode import split_rigid
from .least_squares import Stopping
from .nelder_mead import nelder_mead
from .parametrisation import PlantParameters
from .result import IdentificationResult
from .trial import Trial

STOPPING = Stopping(tolerance=1e-2, cost_tolerance=1e-3, max_iterations=1000)


def output_error(
    plant: AbstractPlant,
    names: Sequence[str],
    trials: tuple[Trial, ...],
    stopping: Stopping = STOPPING,
    on_iterate: Callable[[int, np.ndarray, float], None] | None = None,
) -> IdentificationResult:
    """Minimise the error of whatever signal the trials compare (`FORCE` or `POSITION`) from the plant's own values.

    References: paper, eq. 32.
    """
    parametrisation = PlantParameters.of(plant, names, bounded=True)
    method = f"OE ({trials[0].signal.name})"
    return nelder_mead(method, parametrisation, trials, np.asarray(parametrisation.start()), stopping, on_iterate)


def pseudo_regular_start(rigid: RigidDrive, f_nat: float = 30.0) -> FlexibleDrive:
    """Half of mass and friction on each side, K12 = pi^2 f_nat^2 M: a drive whose free mode is f_nat (Hz).

    References: paper, eq. 33.
    """
    return split_rigid(rigid, 0.5, f_nat / 2**0.5, friction_share=0.5)
