"""What the study is told."""

from typing import Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax.config import CONFIG


@dataclass(frozen=True, config=CONFIG)
class Config:
    """One run of the study; every number is explained in configs/jacobians.toml."""

    seed: int = Field(ge=0)
    noise: float = Field(gt=0, description="N rms per sample")
    rigid_hz: float = Field(gt=0, description="Hz")
    cutoff_hz: float = Field(gt=0, description="Hz")
    bands_hz: tuple[float, ...] = Field(min_length=2, description="Hz, edges")
    modes_hz: tuple[float, ...] = Field(min_length=1, description="Hz")
    cutoffs_hz: tuple[float, ...] = Field(min_length=1, description="Hz")
    accepted: float = Field(gt=0, description="relative error of a column")
    draws: int = Field(ge=10)
    approximate_draws: int = Field(ge=2)
    methods: tuple[Literal["didim five", "didim seven", "didim seven half", "didim seven truth", "exact five"], ...] = (
        Field(description="drawn besides exact Gauss-Newton")
    )
    checked_draws: int = Field(ge=1)
    friction_draws: int = Field(ge=2)
    timings: int = Field(ge=1)
