"""Exact Gauss-Newton and Levenberg-Marquardt: the derivative of the closed-loop simulation itself, in optimistix."""

from collections.abc import Callable, Sequence

import numpy as np
import optimistix as optx

from ..plant import AbstractPlant
from .least_squares import Stopping, exact_columns, iterate
from .parametrisation import PlantParameters
from .result import IdentificationResult
from .trial import Trial

STOPPING = Stopping(tolerance=1e-4)

START_STOPPING = Stopping(tolerance=1e-2)
"""For initial states alone: in their typical sizes, 1e-5 m and 1e-3 m/s."""

OnIterate = Callable[[int, np.ndarray, float], None]


def gauss_newton(
    plant: AbstractPlant,
    names: Sequence[str],
    trials: tuple[Trial, ...],
    stopping: Stopping = STOPPING,
    on_iterate: OnIterate | None = None,
) -> IdentificationResult:
    """Full steps from the plant's own values over the named parameters; masses and stiffness as logarithms."""
    return _exact(
        "exact Gauss-Newton", plant, names, trials, optx.GaussNewton(rtol=0.0, atol=0.0), stopping, on_iterate
    )


def levenberg_marquardt(
    plant: AbstractPlant,
    names: Sequence[str],
    trials: tuple[Trial, ...],
    stopping: Stopping = STOPPING,
    on_iterate: OnIterate | None = None,
) -> IdentificationResult:
    """Damped steps, for starts that are far away: a step that raises the criterion, or diverges, is taken back."""
    return _exact(
        "exact Levenberg-Marquardt",
        plant,
        names,
        trials,
        optx.LevenbergMarquardt(rtol=0.0, atol=0.0),
        stopping,
        on_iterate,
    )


def _exact(
    method: str,
    plant: AbstractPlant,
    names: Sequence[str],
    trials: tuple[Trial, ...],
    solver: optx.AbstractLeastSquaresSolver,
    stopping: Stopping,
    on_iterate: OnIterate | None,
) -> IdentificationResult:
    parametrisation = PlantParameters.of(plant, names, bounded=True)
    return iterate(
        method,
        parametrisation,
        trials,
        np.asarray(parametrisation.start()),
        exact_columns,
        solver,
        stopping,
        on_iterate,
    )


def fit_start(
    plant: AbstractPlant, trials: tuple[Trial, ...], stopping: Stopping = START_STOPPING
) -> IdentificationResult:
    """The initial state of each record under a plant that stays as it is: all that may be fitted on a check record."""
    return gauss_newton(plant, (), trials, stopping)
