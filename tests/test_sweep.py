"""Lanes end where single runs end, whatever their neighbours do; a killed sweep goes on where it was."""

import os
import subprocess
import sys

import numpy as np
import optimistix as optx
import pytest
import xarray as xr

from didim_jax import CoulombViscous, RigidDrive
from didim_jax.identify import (
    PlantParameters,
    Stopping,
    didim,
    didim_columns,
    exact_columns,
    gauss_newton,
    nelder_mead,
    trial,
)
from didim_jax.rig import sampled_loop
from didim_jax.signals import Decimation
from didim_jax.sweep import Ended, Lanes, least_squares_lanes, nelder_mead_lanes, store, sweep

NAMES = ("M", "Fv", "Fc")
GAUSS_NEWTON: optx.GaussNewton = optx.GaussNewton(rtol=0.0, atol=0.0)


def drive(M, Fv=0.0, Fc=0.0):
    return RigidDrive(M, CoulombViscous(Fv, Fc), 0.0)


@pytest.fixture(scope="module")
def trials(emps_like, clean_run):
    """Two seconds of a rigid mass at rest; 95 kg, 200 N s/m, 20 N."""
    loop = sampled_loop(emps_like, drive(95.0))
    return (trial(clean_run, emps_like, loop, Decimation.at(20.0, 1e-3), at_rest=True),)


def lanes_of(trials, starts, bounded, columns, stopping, **more):
    parametrisation = PlantParameters.of(drive(95.0), NAMES, bounded=bounded)
    return least_squares_lanes((parametrisation, trials), np.array(starts), columns, GAUSS_NEWTON, stopping, **more)


@pytest.mark.parametrize(
    "method, columns, stopping",
    [
        (didim, didim_columns, Stopping(1e-3)),
        (didim, didim_columns, Stopping(1e-6, cost_tolerance=0.05)),  # ends by eq. 21
        (didim, didim_columns, Stopping(1e-12, max_iterations=3)),  # runs out
        (gauss_newton, exact_columns, Stopping(1e-4)),
    ],
)
def test_least_squares_lanes_end_as_single_runs_do(trials, method, columns, stopping):
    starts = [[30.0, 0.0, 0.0], [78.0, 100.0, 10.0], [300.0, 50.0, 40.0]]
    lanes = lanes_of(trials, starts, method is gauss_newton, columns, stopping, batch=2)
    for k, theta in enumerate(starts):
        one = method(drive(*theta), NAMES, trials, stopping)
        assert (lanes.ended[k] == Ended.CONVERGED) == one.converged
        assert lanes.n_iterations[k] == one.n_iterations
        # the same arithmetic, batched: rounding only
        np.testing.assert_allclose(lanes.theta[k], one.theta, rtol=1e-9)
        assert lanes.cost[k] == pytest.approx(one.relative_error, rel=0.02)  # before the last, small step


def test_nelder_mead_lanes_end_as_single_runs_do(trials):
    starts, stopping = [[80.0, 150.0, 15.0], [110.0, 250.0, 25.0]], Stopping(1e-2, 1e-3, max_iterations=60)
    parametrisation = PlantParameters.of(drive(95.0), NAMES, bounded=True)
    lanes = nelder_mead_lanes((parametrisation, trials), np.array(starts), stopping, batch=2)
    for k, theta in enumerate(starts):
        one = nelder_mead("OE", parametrisation, trials, np.array(theta), stopping)
        assert lanes.n_iterations[k] == one.n_iterations
        assert (lanes.ended[k] == Ended.CONVERGED) == one.converged
        np.testing.assert_allclose(lanes.theta[k], one.theta, rtol=1e-9)
        assert lanes.cost[k] == pytest.approx(one.relative_error, rel=1e-9)


def test_a_diverging_lane_leaves_its_neighbours_alone(trials):
    """Under 8 kg the sampled loop is unstable: the first simulation is not finite."""
    good, bad = [78.0, 0.0, 0.0], [3.0, 0.0, 0.0]
    mixed = lanes_of(trials, [good, bad, good], False, didim_columns, Stopping(1e-3), batch=3)
    alone = lanes_of(trials, [good], False, didim_columns, Stopping(1e-3), batch=1)
    assert mixed.ended.tolist() == [Ended.CONVERGED, Ended.DIVERGED, Ended.CONVERGED]
    np.testing.assert_allclose(mixed.theta[[0, 2]], np.repeat(alone.theta, 2, axis=0), rtol=1e-9)
    simplex = nelder_mead_lanes(
        (PlantParameters.of(drive(95.0), NAMES, bounded=True), trials), np.array([bad]), Stopping(1e-2, 1e-3)
    )
    assert simplex.ended.tolist() == [Ended.DIVERGED] and simplex.n_iterations.tolist() == [0]


def test_every_lane_may_have_a_signal_of_its_own(trials):
    """A signal 10 % larger is a machine with 10 % more of everything, to the order of the motion's own change."""
    Y = np.asarray(trials[0].observed)
    starts = [[78.0, 0.0, 0.0]] * 3
    observed = np.stack([Y, 1.1 * Y, Y])
    lanes = lanes_of(trials, starts, False, didim_columns, Stopping(1e-4), observed=observed, batch=2)
    plain = lanes_of(trials, starts[:1], False, didim_columns, Stopping(1e-4))
    np.testing.assert_allclose(lanes.theta[[0, 2]], np.repeat(plain.theta, 2, axis=0), rtol=1e-9)
    assert lanes.theta[1, 0] == pytest.approx(1.1 * plain.theta[0, 0], rel=0.03)


@pytest.mark.slow
def test_any_number_of_devices_gives_the_same(tmp_path):
    """Another number of devices takes another process."""
    script_text = (
        "import sys, jax, numpy as np\n"
        "jax.config.update('jax_enable_x64', True)\n"
        "import jax.numpy as jnp\n"
        "from didim_jax.sweep import lanes\n"
        "def lane(shared, x, own): return lanes.Lanes(x * shared, x[0], jnp.sum(x), own[0])\n"
        "x = np.arange(22.0).reshape(11, 2)\n"
        "out = lanes._over(lane, (jnp.asarray(2.0),), x, x + 1, 3)\n"
        "assert jax.device_count() == int(sys.argv[1])\n"
        "np.testing.assert_array_equal(out.theta, 2 * x)\n"
        "np.testing.assert_array_equal(out.cost, x[:, 0])\n"
        "np.testing.assert_array_equal(out.ended, x[:, 0] + 1)\n"
    )
    script = tmp_path / "devices.py"
    script.write_text(script_text)
    for n in (1, 2, 3, 16):  # more devices than batches too
        flags = {"XLA_FLAGS": f"--xla_force_host_platform_device_count={n}"}
        subprocess.run([sys.executable, str(script), str(n)], check=True, env={**os.environ, **flags})


# -- the store ----------------------------------------------------------------------------------------------------

STARTS = np.arange(20.0).reshape(10, 2)


class Killed(Exception):
    """What stands for a kill between two chunks."""


class Counting:
    """A `run` that counts its calls and gives out before the call numbered `last`."""

    def __init__(self, last=99):
        self.rows, self.last = [], last

    def __call__(self, starts, rows):
        if len(self.rows) == self.last:
            raise Killed
        self.rows.append((rows.start, rows.stop))
        n = len(starts)
        return Lanes(2 * starts, starts[:, 0], np.full(n, 3), np.full(n, Ended.CONVERGED.value))


def go(folder, run, **key):
    return sweep(folder / "s.zarr", STARTS, ("a", "b"), run, key=key or {"v": 1}, chunk=4)


def test_a_sweep_is_a_labelled_array(tmp_path):
    run = Counting()
    found = go(tmp_path, run)
    assert run.rows == [(0, 4), (4, 8), (8, 10)]
    np.testing.assert_array_equal(found["theta"].sel(parameter="b"), 2 * STARTS[:, 1])
    np.testing.assert_array_equal(found["start"], STARTS)
    assert (found["ended"] == Ended.CONVERGED).all() and (found["n_iterations"] == 3).all()


def test_a_killed_sweep_goes_on_where_it_was(tmp_path):
    with pytest.raises(Killed):
        go(tmp_path, Counting(last=2))
    rest = Counting()
    found = go(tmp_path, rest)
    assert rest.rows == [(8, 10)]
    np.testing.assert_array_equal(found["theta"], 2 * STARTS)
    again = Counting()
    go(tmp_path, again)
    assert again.rows == []


def test_another_key_begins_anew(tmp_path):
    go(tmp_path, Counting())
    other = Counting()
    go(tmp_path, other, v=2)
    assert len(other.rows) == 3


@pytest.mark.parametrize("break_it", ["empty folder", "no arrays", "rubbish", "lost array", "killed beginning"])
def test_a_store_that_is_not_whole_is_replaced(tmp_path, break_it, monkeypatch):
    path = tmp_path / "s.zarr"
    if break_it == "empty folder":
        path.mkdir()
    elif break_it == "no arrays":
        go(tmp_path, Counting())
        digest = xr.open_zarr(path, consolidated=False).attrs["digest"]
        xr.Dataset(attrs={"digest": digest}).to_zarr(path, mode="w", consolidated=False)
    elif break_it == "rubbish":
        go(tmp_path, Counting())
        (path / "zarr.json").write_text("{")
    elif break_it == "lost array":
        go(tmp_path, Counting())
        (path / "cost" / "zarr.json").unlink()
    else:
        with monkeypatch.context() as patch:
            patch.setattr(store.Path, "rename", lambda *a: (_ for _ in ()).throw(Killed))
            with pytest.raises(Killed):
                go(tmp_path, Counting())
        assert not path.exists()
    run = Counting()
    found = go(tmp_path, run)
    assert len(run.rows) == 3
    np.testing.assert_array_equal(found["cost"], STARTS[:, 0])
