"""Exact Gauss-Newton recovers the twin's seven parameters from motor force alone, friction of both sides included."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from didim_jax import CoulombViscous, FlexibleDrive, InputError
from didim_jax.identify import (
    Choices,
    Method,
    PlantParameters,
    Stopping,
    exact_columns,
    gauss_newton,
    iterate,
    levenberg_marquardt,
    linear_system,
)
from didim_jax.identify.case import Case
from didim_jax.identify.parametrisation import AbstractParametrisation
from didim_jax.identify.procedure import settle
from didim_jax.params import names, unpack, values

# Mass and stiffness as step 2 leaves them (Table 2 of the paper), friction on the motor side.
START = FlexibleDrive(66.3, CoulombViscous(216.0, 18.2), 40.7, CoulombViscous(0.0, 0.0), 9.13e5)


@pytest.fixture(scope="module")
def case(twin_machine, twin_run):
    return Case((twin_run,), twin_machine, settle(Choices("flexible", Method.GAUSS_NEWTON)))


def test_all_seven_parameters_of_the_twin(case, twin_plant):
    result = gauss_newton(START, case.free(START), case.trials(START, 60.0))
    truth = values(twin_plant)
    assert result.converged and result.n_iterations <= 6
    for name in ("M1", "M2", "K12"):
        assert result[name] == pytest.approx(truth[name], rel=5e-3), name
    std = dict(zip(result.names, result.std_autocorrelated, strict=True))
    for name in ("Fv1", "Fc1", "Fv2", "Fc2"):
        assert abs(result[name] - truth[name]) < 3 * std[name], name
        assert std[name] < 0.03 * truth[name], name  # and the record does separate them
    for kind in ("Fv", "Fc"):
        assert result[f"{kind}1"] + result[f"{kind}2"] == pytest.approx(truth[f"{kind}1"] + truth[f"{kind}2"], rel=0.01)
    assert result.gradient_cosine < 1e-4  # a true minimum, not a small step


def test_levenberg_marquardt_ends_at_the_same_drive(case):
    far = unpack(START, jnp.asarray([0.5, 1, 1, 1.4, 1, 1, 0.6, 1]) * jnp.asarray(list(values(START).values())))
    damped = levenberg_marquardt(far, case.free(far), case.trials(far, 60.0))
    near = gauss_newton(START, case.free(START), case.trials(START, 60.0))
    assert damped.converged
    np.testing.assert_allclose(damped.theta[[0, 3, 6]], near.theta[[0, 3, 6]], rtol=1e-3)
    assert np.all(np.diff(damped.costs) <= 0)  # a step that raises the criterion is taken back


@pytest.mark.parametrize("cutoff_hz", [5.0, 60.0])
def test_the_jacobian_is_the_derivative(case, twin_plant, cutoff_hz):
    parametrisation = PlantParameters.of(twin_plant, names(twin_plant), bounded=True)
    trials = case.trials(twin_plant, cutoff_hz)
    problem = (parametrisation, trials)
    z = jnp.concatenate([parametrisation.encode(parametrisation.start()), jnp.zeros(trials[0].n_start)])
    J = np.asarray(linear_system(z, problem, exact_columns)[1])
    h = 1e-4  # x is near 1 in size; smaller steps lose the difference of two 20,000-step runs to rounding
    for column, unit in zip(J.T, np.eye(len(z)), strict=True):
        ahead, behind = (np.asarray(linear_system(z + s * h * unit, problem, exact_columns)[0]) for s in (1, -1))
        assert np.linalg.norm((ahead - behind) / (2 * h) - column) < 1e-5 * np.linalg.norm(column)


class Idle(AbstractParametrisation):
    """M1, and a second parameter that the plant never sees."""

    inner: PlantParameters

    @property
    def names(self):
        return ("M1", "idle")

    @property
    def units(self):
        return ("kg", "1")

    def encode(self, theta):
        return jnp.concatenate([self.inner.encode(theta[:1]), theta[1:]])

    def decode(self, x):
        return jnp.concatenate([self.inner.decode(x[:1]), x[1:]])

    def plant(self, theta):
        return self.inner.plant(theta[:1])


def test_a_parameter_that_changes_nothing_stops_the_run(case):
    idle = Idle(PlantParameters.of(START, ("M1",), bounded=True))
    solver = optx.GaussNewton(rtol=0.0, atol=0.0)
    with pytest.raises(InputError, match="idle changes nothing"):
        iterate("test", idle, case.trials(START, 60.0), np.array([66.3, 1.0]), exact_columns, solver, Stopping())


def test_a_start_without_a_finite_simulation_is_no_success(case):
    hopeless = FlexibleDrive(0.05, CoulombViscous(0.0, 0.0), 0.05, CoulombViscous(0.0, 0.0), 1e7)
    result = gauss_newton(hopeless, case.free(hopeless), case.trials(hopeless, 60.0))
    assert not result.converged and "diverged" in result.reason and np.isnan(result.theta).all()
