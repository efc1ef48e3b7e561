"""Identification: from records to parameters, by every method of the paper and by exact differentiation."""

from .didim import didim, didim_columns
from .flexible_mode import flexible_mode, split_rigid
from .gauss_newton import fit_start, gauss_newton, levenberg_marquardt
from .identifiability import Identifiability, ModeScan, bounds, scan_modes
from .idim_ls import Filtering, idim_ls
from .least_squares import Stopping, exact_columns, iterate, linear_system
from .method import Choices, Method
from .nelder_mead import nelder_mead
from .output_error import output_error, pseudo_regular_start
from .parametrisation import ModeParameters, PlantParameters
from .procedure import identify
from .result import IdentificationResult
from .study import Run, Study, force_error
from .three_step import three_step
from .trial import FORCE, POSITION, Signal, Trial, trial

__all__ = [
    "FORCE",
    "POSITION",
    "Choices",
    "Filtering",
    "Identifiability",
    "IdentificationResult",
    "Method",
    "ModeParameters",
    "ModeScan",
    "PlantParameters",
    "Run",
    "Signal",
    "Stopping",
    "Study",
    "Trial",
    "bounds",
    "didim",
    "didim_columns",
    "exact_columns",
    "fit_start",
    "flexible_mode",
    "force_error",
    "gauss_newton",
    "identify",
    "idim_ls",
    "iterate",
    "levenberg_marquardt",
    "linear_system",
    "nelder_mead",
    "output_error",
    "pseudo_regular_start",
    "scan_modes",
    "split_rigid",
    "three_step",
    "trial",
]
