"""What `configs/robustness.toml` may say."""

from typing import Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax.config import CONFIG


@dataclass(frozen=True, config=CONFIG)
class Config:
    """Sizes of every map, and the record that they are made with."""

    laws: tuple[Literal["sampled", "continuous"], ...] = Field(min_length=1, description="control laws")
    continuous_share: float = Field(gt=0, le=1, description="of starts and draws for the continuous law")
    noise_N: float = Field(ge=0, description="N rms at 1 kHz")
    seed: int = Field(ge=0)
    map_seconds: float = Field(gt=0, description="s of the record that the maps use")
    check_starts: int = Field(ge=0, description="starts of the mode map repeated on the full record")
    rigid_starts: int = Field(ge=2, description="masses")
    rigid_mass_kg: tuple[float, float] = Field(description="kg, from and to")
    mode_lam: tuple[float, float] = Field(description="mass ratio, from and to")
    mode_f_n_Hz: tuple[float, float] = Field(description="Hz, from and to")
    mode_grid: tuple[int, int] = Field(description="points in lam and f_n")
    mode_iterations: int = Field(ge=1, description="most iterations of Nelder-Mead")
    global_draws: int = Field(ge=1, description="draws of the exact methods")
    global_didim_draws: int = Field(ge=1, description="draws of DIDIM")
    global_off: float = Field(gt=0, lt=1, description="largest relative error of M1, M2, K12")
    condition_draws: int = Field(ge=1, description="records of each mistake")
    state_sizes: tuple[float, ...] = Field(description="typical sizes of the initial state")
    noise_levels_N: tuple[float, ...] = Field(description="N rms at 1 kHz")
    gain_errors: tuple[float, ...] = Field(description="relative error of kp, of kv")
    twins: int = Field(ge=1, description="random machines identified without a start")
    twin_tolerance: float = Field(gt=0, description="largest relative error of M1, M2, K12")
    cost_starts: int = Field(ge=1)
    cost_samples: int = Field(ge=100)
    cost_iterations: int = Field(ge=1)
    cost_batch: int = Field(ge=1, description="lanes that one device runs at once")

    def share(self, n: int, law: str) -> int:
        """How many of n starts a law gets: the continuous one takes twice as long and says little that is new."""
        return n if law == "sampled" else max(1, round(n * self.continuous_share))
