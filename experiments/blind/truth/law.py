"""What a drawn effect is: numbers for the kernel, and words and parameters for the answer."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .machine import Machine
from .sizes import TYPICAL


@dataclass(frozen=True)
class Drawn:
    """One effect of one machine.

    `record_phases` are slots that get a new random phase in every record; `intervals` say when a time-local effect
    acts, (on, off) in s of the machine's own run.
    """

    law: str
    block: str
    slots: dict[str, float]
    parameters: dict[str, tuple[float, str]]  # name: value, unit
    record_phases: tuple[str, ...] = ()
    intervals: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Draw:
    """What a law may draw from: the machine, its nominal run, and the factor on the typical size."""

    rng: np.random.Generator
    machine: Machine
    factor: float
    peak_volts: float  # of the nominal runs, the smaller of both records
    peak_slope: float  # V/s, likewise

    def choice(self, *laws: str) -> str:
        """One of several laws."""
        return laws[int(self.rng.integers(len(laws)))]

    def size(self, key: str) -> float:
        """Typical size of an effect, or of one of its laws, times the factor."""
        return TYPICAL[key] * self.factor

    def sign(self) -> float:
        return 1.0 if self.rng.random() < 0.5 else -1.0

    def uniform(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def phase(self) -> float:
        return float(self.rng.uniform(0, 2 * np.pi))

    def side(self) -> tuple[float, str]:
        """Motor's share of a friction effect, and its block."""
        if self.machine.rigid:
            return 1.0, "motor side"
        share = float(self.rng.choice([0.0, 0.25, 0.75, 1.0]))
        return share, "motor side" if share > 0.5 else "load side"


Law = Callable[[Draw], Drawn]
