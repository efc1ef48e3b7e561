"""Sweeps: many identifications at once, over starts, noise draws and machines."""

from .lanes import Ended, Lanes, least_squares_lanes, nelder_mead_lanes
from .store import sweep

__all__ = ["Ended", "Lanes", "least_squares_lanes", "nelder_mead_lanes", "sweep"]
