"""Effects: terms that a nominal plant leaves out, each attached to one block of the loop."""

from ._base import SAMPLED, AbstractEffect, Bench, Block, Forces, Probe, Signals, acts_once_per_sample
from .sensor import EncoderGrid

__all__ = [
    "SAMPLED",
    "AbstractEffect",
    "Bench",
    "Block",
    "EncoderGrid",
    "Forces",
    "Probe",
    "Signals",
    "acts_once_per_sample",
]
