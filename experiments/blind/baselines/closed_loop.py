"""The nominal drive fitted in closed loop by the package: what the rivals that simulate begin from."""

import dataclasses
from collections.abc import Sequence

from didim_jax.effects import AbstractEffect
from didim_jax.effects.catalogue import CATALOGUE
from didim_jax.gap.diagnose import INVISIBLE
from didim_jax.gap.fit import Fit
from didim_jax.gap.prepared import prepare
from didim_jax.gap.search import Searcher
from didim_jax.hygiene import admit
from didim_jax.machine import Machine
from didim_jax.recording import Recording


@dataclasses.dataclass(frozen=True)
class ClosedLoop:
    """A record's compiled loop and the fit without any effect."""

    searcher: Searcher
    fit: Fit

    @property
    def effects(self) -> list[AbstractEffect]:
        """Effects that may be named: all but those that nothing can show."""
        return [e for e in self.searcher.model.effects if e.label() not in INVISIBLE]

    @property
    def samples(self) -> int:
        """Residuals of all channels in the band."""
        return sum(len(r) for r in self.fit.residuals[0])


def closed_loop(
    recording: Recording,
    machine: Machine,
    catalogue: Sequence[type[AbstractEffect]] = CATALOGUE,
) -> ClosedLoop:
    """Fit the nominal drive. Raises InputError: a record that cannot be used."""
    admit(recording, machine)
    searcher = Searcher([prepare(recording, machine, catalogue)])
    return ClosedLoop(searcher, searcher.nominal())
