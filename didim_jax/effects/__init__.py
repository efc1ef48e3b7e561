"""Effects: terms that a nominal plant leaves out, each attached to one block of the loop."""

from ._base import SAMPLED, AbstractEffect, Block, Signals
from .sensor import EncoderGrid

__all__ = ["SAMPLED", "AbstractEffect", "Block", "EncoderGrid", "Signals"]
