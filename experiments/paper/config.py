"""What the study may be told: seeds, noise, bands, start values, when to stop. SI units, others in the key's name."""

from pydantic import Field
from pydantic.dataclasses import dataclass

from didim_jax.config import CONFIG


@dataclass(frozen=True, config=CONFIG)
class PaperConfig:
    """One comparison with the paper; configs/paper.toml says why each value is what it is."""

    seed: int = Field(ge=0, description="of the first record's noise; the others follow")
    force_noise_N: float = Field(ge=0, description="N rms per sample at 1 kHz, added to the recorded force")
    at_rest: bool = Field(description="take every record to start at rest, or estimate its initial state")
    start_mass_kg: float = Field(gt=0, description="kg, rough total mass, eq. 22")
    start_lam: float = Field(gt=0, lt=1, description="mass ratio that step 2 starts from")
    start_f_n_hz: float = Field(gt=0, description="Hz, mode that step 2 starts from")
    start_f_nat_hz: float = Field(gt=0, description="Hz, free mode that output error starts from, eq. 33")
    rigid_cutoff_hz: float = Field(gt=0, description="Hz, band of step 1")
    flexible_cutoff_hz: float = Field(gt=0, description="Hz, band of all other fits")
    position_cutoff_hz: float = Field(gt=0, description="Hz, low-pass on positions for IDIM-LS")
    idim_decimation: int = Field(ge=1, description="samples per row of IDIM-LS")
    didim_tolerance: float = Field(gt=0, description="relative change of every parameter that ends DIDIM")
    eq_21_tolerance: float = Field(gt=0, description="relative change of the criterion that ends step 3, eq. 21")
    exact_tolerance: float = Field(gt=0, description="relative change of every parameter that ends Gauss-Newton")
    simplex_tolerance: float = Field(gt=0, description="how far a simplex may be apart in theta at the end, relative")
    simplex_cost_tolerance: float = Field(gt=0, description="the same of the criterion")
    mode_iterations: int = Field(ge=1, description="most iterations of step 2")
    output_error_iterations: int = Field(ge=1, description="most iterations of Nelder-Mead over all parameters")
    step_1_masses_kg: tuple[float, ...] = Field(description="kg, other starts of step 1 (section VI.C)")
    step_2_starts: tuple[tuple[float, float], ...] = Field(description="other starts (lam, f_n in Hz) of step 2 (VI.D)")
    draws: int = Field(ge=2, description="noise draws for the spread of Delta M2")
    compile_afresh: bool = Field(description="compile every program in this run, so that its time can be stated")
