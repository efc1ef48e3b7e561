"""What a diagnosis says: everything that `diagnosis.json`, `simulation.npz` and the page are written from."""

import dataclasses
from typing import Any

import numpy as np

from .atlas import Atlas


@dataclasses.dataclass(frozen=True)
class Gap:
    """norm(F(tau - tau_sim)) / norm(F(tau)) of one record: nominal, with the effects, and what noise would leave.

    `predicted_after` is what was said of `after` before the record was read; None for the fit record.
    """

    before: float
    after: float
    floor: float
    predicted_after: float | None = None


@dataclasses.dataclass(frozen=True)
class Run:
    """One record and its two simulations, (n,): time s, recorded and simulated commanded force N."""

    name: str
    t: np.ndarray
    tau: np.ndarray
    before: np.ndarray
    after: np.ndarray


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number, its standard deviation and unit; `bound` says "least" or "most" where it may go no further."""

    value: float
    std: float
    unit: str
    bound: str = ""

    def document(self) -> dict[str, Any]:
        """As diagnosis.json has it: `bound` only where there is one."""
        found = dataclasses.asdict(self)
        return found if self.bound else {k: v for k, v in found.items() if k != "bound"}


@dataclasses.dataclass(frozen=True)
class Shift:
    """A base parameter in the nominal fit and with the effects in."""

    before: float
    after: float
    std: float
    unit: str


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect refitted in the first step: gap left on the fit record, share of the explainable gap closed."""

    effect: str
    gap: float
    share: float
    probability: float
    parameters: dict[str, Estimate]


@dataclasses.dataclass(frozen=True)
class Where:
    """Where the first effect shows; None where it is not bound to a range."""

    time_s: list[list[float]] | None
    speed_m_s: list[float] | None
    position_m: list[float] | None
    frequency_hz: list[float] | None
    channel: str


@dataclasses.dataclass(frozen=True)
class Experiment:
    """An excitation that would tell a group of twins apart: what to do, and the angle between them that it reaches."""

    what: str
    angle_deg: float


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The answer to: where is the gap, which effect causes it, how far does it shrink. See the contract's schema.

    `verdict` is none, effect, ambiguous or unexplained. `share`, `interval`: of the explainable gap closed on the check
    record (on the fit record without one). `runs`: fit records, then the check record. `evidence`: the numbers that the
    verdict was drawn from. `doubts` say why this may not be the machine of its file at all.
    """

    verdict: str
    effects: tuple[str, ...]
    ambiguous_with: tuple[tuple[str, ...], ...]
    ranking: tuple[tuple[str, float], ...]
    parameters: dict[str, dict[str, Any]]
    block: str | None
    base: dict[str, Shift]
    gap: dict[str, Gap]
    share: float | None
    interval: tuple[float, float] | None
    last_in: dict[str, float]
    where: Where
    experiment: Experiment | None
    remarks: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    atlas: Atlas | None
    atlas_after: Atlas | None
    runs: tuple[Run, ...]
    evidence: dict[str, Any]
    machine: str
    synthetic: bool
    doubts: tuple[str, ...] = ()
