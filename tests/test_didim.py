"""DIDIM converges as the paper says: on the real record, from every rough mass, in a few iterations, to one answer."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from didim_jax import CoulombViscous, Machine, RigidDrive
from didim_jax.formats import load_recording
from didim_jax.identify import Choices, PlantParameters, Stopping, didim, didim_columns, linear_system
from didim_jax.identify.case import Case
from didim_jax.identify.procedure import settle
from didim_jax.params import names

FREE = ("M", "Fv", "Fc", "offset")


@pytest.fixture(scope="module")
def emps_case(emps_dir):
    record, machine = load_recording(emps_dir / "DATA_EMPS.mat"), Machine.load(emps_dir / "machine.toml")
    return Case((record,), machine, settle(Choices("rigid")))


def drive(mass):
    return RigidDrive(float(mass), CoulombViscous(0.0, 0.0))


def test_every_rough_mass_leads_to_the_same_drive(emps_case):
    results = [didim(drive(m), FREE, emps_case.trials(drive(m), 5.0)) for m in np.geomspace(25.0, 1000.0, 50)]
    assert all(r.converged for r in results)
    assert max(r.n_iterations for r in results) <= 4
    theta = np.array([r.theta for r in results])
    np.testing.assert_allclose(theta, np.broadcast_to(theta[0], theta.shape), rtol=1e-3)


def test_the_start_is_estimated_unless_it_is_said_to_be_at_rest(emps_case):
    moving = didim(drive(78), FREE, emps_case.trials(drive(78), 60.0))
    resting_case = dataclasses.replace(emps_case, choices=dataclasses.replace(emps_case.choices, at_rest=True))
    resting = didim(drive(78), FREE, resting_case.trials(drive(78), 60.0))
    # The record starts at 6 mm/s: from rest, the first tenth of a second holds a good part of the residual.
    assert moving.relative_error < 0.95 * resting.relative_error
    assert len(moving.shifts[0]) == 4 and len(resting.shifts[0]) == 0
    early = int(0.1 / resting.rho_dt)
    assert np.sum(resting.rho[:early] ** 2) > 0.1 * np.sum(resting.rho**2)
    assert np.sum(moving.rho[:early] ** 2) < 0.03 * np.sum(moving.rho**2)


def test_a_loop_that_diverges_is_no_success(emps_case):
    result = didim(drive(2.0), FREE, emps_case.trials(drive(2.0), 5.0))  # under 8 kg the sampled loop is unstable
    assert not result.converged
    assert "diverged" in result.reason
    assert np.isnan(result.theta).all()


def test_every_iterate_is_kept(emps_case):
    result = didim(drive(200), FREE, emps_case.trials(drive(200), 5.0))
    assert result.trace.shape == (result.n_iterations + 1, 4)
    assert len(result.costs) == result.n_simulations == result.n_iterations + 1
    np.testing.assert_allclose(result.trace[0], [200, 0, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(result.trace[-1], result.theta)


def test_equation_21_with_an_absolute_value_ends_it_too(emps_case):
    result = didim(drive(78), FREE, emps_case.trials(drive(78), 5.0), Stopping(tolerance=0.0, cost_tolerance=1e-2))
    assert result.converged and "eq. 21" in result.reason
    assert abs(result.costs[-1] / result.costs[-2] - 1) < 1e-2
    assert result.costs[1] < 0.9 * result.costs[0]  # as printed it would have stopped at this first decrease


def test_the_columns_are_the_inverse_model_on_the_simulated_motion(twin_machine, twin_plant, twin_run):
    """J theta = Ys - 0 because W theta = tau: the identity that makes eq. 20 the Gauss-Newton step of eq. 16."""
    case = Case((twin_run,), twin_machine, settle(Choices("flexible")))
    parametrisation = PlantParameters.of(twin_plant, names(twin_plant), bounded=False)
    trials = case.trials(twin_plant, 60.0)
    x = parametrisation.encode(parametrisation.start())
    z = jnp.concatenate([x, jnp.zeros(trials[0].n_start)])
    residual, J = (np.asarray(a) for a in linear_system(z, (parametrisation, trials), didim_columns))
    n = len(trials[0].observed)
    simulated = residual[:n] + np.asarray(trials[0].observed)
    np.testing.assert_allclose(J[:n, : len(x)] @ np.asarray(x), simulated, atol=1e-9 * np.max(np.abs(simulated)))
    load = J[n : 2 * n, : len(x)]  # the load side's balance is zero, though none of its columns is
    assert np.max(np.abs(load @ np.asarray(x))) < 1e-9 * np.max(np.abs(load * np.asarray(x)))


def test_two_records_share_theta_and_keep_their_own_starts(emps_case, emps_dir):
    pulses = load_recording(emps_dir / "DATA_EMPS_PULSES.mat")
    both = dataclasses.replace(emps_case, recordings=(*emps_case.recordings, pulses))
    result = didim(drive(78), FREE, both.trials(drive(78), 5.0))
    alone = [
        didim(drive(78), FREE, dataclasses.replace(both, recordings=(r,)).trials(drive(78), 5.0))
        for r in both.recordings
    ]
    assert result.converged and len(result.shifts) == 2
    low, high = sorted(r["M"] for r in alone)
    assert low - 0.2 < result["M"] < high + 0.2
