"""Every method of the paper, and the exact one, on one twin; compile and run timed apart."""

import dataclasses
import time
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from didim_jax.identify import (
    POSITION,
    Filtering,
    IdentificationResult,
    Stopping,
    didim,
    flexible_mode,
    gauss_newton,
    idim_ls,
    output_error,
    pseudo_regular_start,
    split_rigid,
)
from didim_jax.identify.case import Case
from didim_jax.identify.three_step import global_start
from didim_jax.params import select, unpack, values
from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive

from .config import PaperConfig
from .twin import Twin, named, trials_of

STEP_1, STEP_2 = "step 1", "step 2"
DIDIM, DIDIM_7, DIDIM_7_HALF = "DIDIM", "DIDIM, seven columns", "DIDIM, seven columns, halved friction"
LS, LS_LATE = "IDIM-LS", "IDIM-LS, force not centred"
EXACT = "exact Gauss-Newton"
OE_POSITION, OE_FORCE = "OE position", "OE force"

FLEXIBLE = (LS, LS_LATE, DIDIM, DIDIM_7, EXACT, OE_POSITION, OE_FORCE)
"""Methods that give all of the flexible drive, in the order of the tables."""

FIVE = ("M1", "Fv1", "Fc1", "M2", "K12")
"""Columns of the paper's step 3: all friction is the motor side's."""

SEVEN = ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12")


@dataclasses.dataclass(frozen=True)
class Fit:
    """One identification: its result, the time of the first call without a step (s) and that of the fit (s)."""

    result: IdentificationResult
    compile_s: float
    run_s: float

    @property
    def parameters(self) -> dict[str, float]:
        """Flexible drive: every parameter and what follows from it; nan where the simulation diverged."""
        found = named(values(self.result.plant))
        return found if np.isfinite(self.result.theta).all() else dict.fromkeys(found, float("nan"))

    def rel_std(self, name: str) -> float | None:
        """%std of eq. 15; None for a parameter that was not estimated, or is zero but for rounding."""
        if name not in self.result.names:
            return None
        percent = float(self.result.rel_std[self.result.names.index(name)])
        return percent if percent < 1e6 else None

    def std(self, name: str) -> float:
        """Standard deviation for whatever spectrum of the residual, SI."""
        return float(self.result.std_autocorrelated[self.result.names.index(name)])


def timed(fit: Callable[[Stopping], IdentificationResult], stopping: Stopping) -> Fit:
    """Run once without a step, which compiles what is not compiled yet, then in full."""
    begin = time.perf_counter()
    fit(dataclasses.replace(stopping, max_iterations=0))
    ready = time.perf_counter()
    result = fit(stopping)
    return Fit(result, ready - begin, time.perf_counter() - ready)


def run_methods(twin: Twin, config: PaperConfig) -> dict[str, Fit]:
    """Steps 1 to 3, IDIM-LS, exact Gauss-Newton and both output errors, by name."""
    case = twin.case(config)
    step1 = rigid(case, config, config.start_mass_kg)
    step2 = shape(case, config, step1.result, (config.start_lam, config.start_f_n_hz))
    found = {STEP_1: step1, STEP_2: step2, **_third_steps(case, config, step1.result, step2.result)}
    found |= _inverse_model(twin, config)
    found[EXACT] = _exact(case, config, split(step1.result, step2.result))
    for name, signalled in ((OE_POSITION, twin.case(config, POSITION)), (OE_FORCE, case)):
        found[name] = _output_error(signalled, config, step1.result)
    return found


def rigid(case: Case, config: PaperConfig, mass_kg: float) -> Fit:
    """Step 1: rigid DIDIM from a rough mass and no friction. References: paper, V.B, eq. 22."""
    start = RigidDrive(mass_kg, CoulombViscous(0.0, 0.0), 0.0)
    trials = trials_of(case, start, config.rigid_cutoff_hz)
    return timed(lambda s: didim(start, ("M", "Fv", "Fc"), trials, s), Stopping(config.didim_tolerance))


def shape(case: Case, config: PaperConfig, step1: IdentificationResult, start: tuple[float, float]) -> Fit:
    """Step 2: (lam, f_n) by Nelder-Mead. References: paper, V.C, eq. 25-28."""
    drive = _rigid_drive(step1)
    trials = trials_of(case, split_rigid(drive, *start), config.flexible_cutoff_hz)
    stopping = Stopping(config.simplex_tolerance, config.simplex_cost_tolerance, config.mode_iterations)
    return timed(lambda s: flexible_mode(drive, trials, start, s), stopping)


def third_step(case: Case, config: PaperConfig, start: FlexibleDrive, names: tuple[str, ...]) -> Fit:
    """Step 3: DIDIM over the named columns, ended by eq. 21 with an absolute value. References: paper, V.D."""
    trials = trials_of(case, start, config.flexible_cutoff_hz)
    stopping = Stopping(config.didim_tolerance, config.eq_21_tolerance)
    return timed(lambda s: didim(start, names, trials, s), stopping)


def _third_steps(
    case: Case, config: PaperConfig, step1: IdentificationResult, step2: IdentificationResult
) -> dict[str, Fit]:
    start = global_start(step1, step2)
    halved = split(step1, step2, friction_share=0.5)
    return {
        DIDIM: third_step(case, config, start, FIVE),
        DIDIM_7: third_step(case, config, start, SEVEN),
        DIDIM_7_HALF: third_step(case, config, halved, SEVEN),
    }


def split(step1: IdentificationResult, step2: IdentificationResult, friction_share: float = 1.0) -> FlexibleDrive:
    """Where exact Gauss-Newton starts: totals of step 1 and shape of step 2, friction on the motor side (eq. 26-27)."""
    return split_rigid(_rigid_drive(step1), step2["lam"], step2["f_n"], friction_share)


def _exact(case: Case, config: PaperConfig, start: FlexibleDrive) -> Fit:
    trials = trials_of(case, start, config.flexible_cutoff_hz)
    return timed(lambda s: gauss_newton(start, SEVEN, trials, s), Stopping(config.exact_tolerance))


def _output_error(case: Case, config: PaperConfig, step1: IdentificationResult) -> Fit:
    """Nelder-Mead over all seven. References: paper, eq. 32-33."""
    start = pseudo_regular_start(_rigid_drive(step1), config.start_f_nat_hz)
    trials = trials_of(case, start, config.flexible_cutoff_hz)
    stopping = Stopping(config.simplex_tolerance, config.simplex_cost_tolerance, config.output_error_iterations)
    return timed(lambda s: output_error(start, SEVEN, trials, s), stopping)


def _inverse_model(twin: Twin, config: PaperConfig) -> dict[str, Fit]:
    """IDIM-LS from both encoders, with and without the half sample of the held force."""
    return {name: _idim_ls(twin, config, centred) for name, centred in ((LS, True), (LS_LATE, False))}


def _idim_ls(twin: Twin, config: PaperConfig, centred: bool) -> Fit:
    filtering = Filtering(
        position_hz=config.position_cutoff_hz,
        factor=config.idim_decimation,
        decimation_hz=config.flexible_cutoff_hz,
        centred_force=centred,
    )
    none = CoulombViscous(0.0, 0.0)
    start = FlexibleDrive(1.0, none, 1.0, none, 1.0)  # least squares has no start; a drive is asked for its columns
    idim_ls(start, SEVEN, [twin.fit], filtering)
    begin = time.perf_counter()
    result = idim_ls(start, SEVEN, [twin.fit], filtering)
    took = time.perf_counter() - begin
    # The result's drive carries the hard sign of its least squares: a simulation needs the smooth one.
    drive = unpack(start, jnp.asarray(result.theta), select(start, result.names))
    return Fit(dataclasses.replace(result, plant=drive), 0.0, took)


def _rigid_drive(step1: IdentificationResult) -> RigidDrive:
    assert isinstance(step1.plant, RigidDrive)
    return step1.plant
