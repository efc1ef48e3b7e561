"""What a record can give is said before the fit: bounds on the twin, and no flexible mode in the real record."""

import numpy as np
import pytest

from didim_jax import Machine
from didim_jax.formats import load_recording
from didim_jax.identify import Choices, Method, bounds, gauss_newton, identify, scan_modes, split_rigid
from didim_jax.identify.case import Case
from didim_jax.identify.procedure import identifiability, settle
from didim_jax.params import names


def test_the_real_record_cannot_give_the_flexible_drive_and_no_numbers_are_pretended(emps_dir):
    record, machine = load_recording(emps_dir / "DATA_EMPS.mat"), Machine.load(emps_dir / "machine.toml")
    said = []
    study = identify([record], machine, Choices("flexible"), say=said.append)
    assert said and "cannot give M2 and K12 apart" in said[0]
    assert {"M2", "K12"} <= set(study.identifiability.lost)
    assert np.isnan(study.result.theta).all() and not study.result.converged
    assert study.result.steps[0]["M"] == pytest.approx(95.2, rel=0.01)  # what it does give: the rigid drive


def test_the_twin_shows_its_mode(twin_machine, twin_run):
    case = Case((twin_run,), twin_machine, settle(Choices("flexible", Method.GAUSS_NEWTON)))
    said, rigid = identifiability(case)
    assert rigid is not None and not said.lost
    scan = scan_modes(rigid.plant, rigid.relative_error, case.trials(split_rigid(rigid.plant, 0.5, 40.0), 60.0))
    assert scan.visible and scan.explained > 0.5
    lam, f_n = scan.best
    assert abs(lam - 68 / 106) < 0.2 and abs(f_n - 24.2) < 6  # a coarse grid: the neighbour of the truth


def test_the_bound_is_the_spread_of_an_efficient_fit(twin_machine, twin_run, twin_plant):
    case = Case((twin_run,), twin_machine, settle(Choices("flexible", Method.GAUSS_NEWTON)))
    trials = case.trials(twin_plant, 60.0)
    free = names(twin_plant)
    said = bounds(twin_plant, free, trials)
    fit = gauss_newton(twin_plant, free, trials)
    # Both are sigma^2 (J^T J)^-1: the bound for 5 % of the force, the fit for the residual that the noise left.
    expected = said.bound_percent * fit.relative_error / 0.05
    np.testing.assert_allclose(fit.rel_std[:7], expected[:7], rtol=0.05)


def test_what_trades_against_what_is_said_in_words(twin_machine, twin_run, twin_plant):
    case = Case((twin_run,), twin_machine, settle(Choices("flexible", Method.GAUSS_NEWTON)))
    said = bounds(twin_plant, ("Fv1", "Fv2", "K12"), case.trials(twin_plant, 60.0))
    assert "Fv1 against Fv2" in said.directions[0] or "Fv2 against Fv1" in said.directions[0]


def test_a_weak_parameter_is_named(twin_machine, twin_run, twin_plant):
    case = Case((twin_run,), twin_machine, settle(Choices("flexible", Method.GAUSS_NEWTON)))
    slow = case.trials(twin_plant, 2.0)  # below 2 Hz a 24 Hz mode hardly shows
    verdict = bounds(twin_plant, ("M1", "M2", "K12"), slow).verdict
    assert "K12" in verdict and "only weakly" in verdict
