"""One identification to be done: records, machine, choices, and who is told of its progress."""

import dataclasses
from collections.abc import Callable

import numpy as np

from ..machine import Machine
from ..params import names
from ..plant import AbstractFriction, AbstractPlant, AsymmetricCoulombViscous, CoulombViscous
from ..recording import Recording
from ..rig import sampled_loop
from ..signals import Decimation
from .method import Choices
from .trial import Trial, trial

Progress = Callable[[str, int, np.ndarray, float], None]
"""Called with the step's name, the iteration, theta and the criterion norm(rho) / norm(Y)."""


@dataclasses.dataclass(frozen=True)
class Case:
    """What every method needs to begin."""

    recordings: tuple[Recording, ...]
    machine: Machine
    choices: Choices
    progress: Progress | None = None

    def trials(self, plant: AbstractPlant, cutoff_hz: float) -> tuple[Trial, ...]:
        """Every record under the machine's sampled loop around the plant, compared below the cutoff (Hz)."""
        decimation = Decimation.at(cutoff_hz, self.machine.controller.sample_time)
        loop = sampled_loop(self.machine, plant)
        return tuple(
            trial(r, self.machine, loop, decimation, at_rest=self.choices.at_rest, signal=self.choices.signal)
            for r in self.recordings
        )

    def free(self, plant: AbstractPlant) -> tuple[str, ...]:
        """The parameters to identify: all of the plant's, the offset if it was chosen."""
        return tuple(name for name in names(plant) if name != "offset" or self.choices.offset)

    def friction(self, Fv: float = 0.0, Fc: float = 0.0) -> AbstractFriction:
        """Friction of the chosen kind, both directions equal."""
        return AsymmetricCoulombViscous(Fv, Fc, Fv, Fc) if self.choices.asymmetric else CoulombViscous(Fv, Fc)

    def tell(self, step: str) -> Callable[[int, np.ndarray, float], None] | None:
        """Progress of one step."""
        progress = self.progress
        if progress is None:
            return None
        return lambda iteration, theta, cost: progress(step, iteration, theta, cost)


def with_choices(case: Case, **changes: object) -> Case:
    """The same case with other choices."""
    return dataclasses.replace(case, choices=dataclasses.replace(case.choices, **changes))  # type: ignore[arg-type]
