"""The study runs, resumes and says what it found; its stability function agrees with plain simulation."""

import json

import numpy as np
import pytest
import xarray as xr

from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive, split
from experiments.robustness.config import Config
from experiments.robustness.stability import integrated_radius, sampled_radius
from experiments.robustness.twin import CONTINUOUS_SUBSTEPS, FAST
from experiments.study import main


def rigid(M):
    return RigidDrive(M, CoulombViscous(0.0, 0.0), 0.0)


def flexible(lam, f_n):
    M1, M2, K12 = split(106.0, lam, f_n)
    return FlexibleDrive(M1, CoulombViscous(200.0, 0.0), M2, CoulombViscous(0.0, 0.0), K12)


def grows(plant, machine, seconds=3.0, steps=40):
    """Brute force: the sampled law around the drive in small explicit steps, from a small offset."""
    law, gain = machine.controller, machine.drive.gain
    v = dict(zip(("M1", "M2", "K12", "Fv"), _numbers(plant), strict=True))
    q1 = q2 = 1e-3
    v1 = v2 = 0.0
    old, older, peaks = q1, q1, []
    h = law.sample_time / steps
    for _ in range(int(seconds / law.sample_time)):
        tau = gain * law.kv * (-law.kp * q1 - (q1 - older) / (2 * law.sample_time))
        older, old = old, q1
        for _ in range(steps):  # semi-implicit: no growth of its own
            F12 = v["K12"] * (q2 - q1)
            v1 += h * (tau - v["Fv"] * v1 + F12) / v["M1"]
            v2 -= h * F12 / v["M2"]
            q1, q2 = q1 + h * v1, q2 + h * v2
        peaks.append(abs(q1))
        if abs(q1) > 1e6:
            return True
    return max(peaks[-200:]) > 1e-3


def _numbers(plant):
    if plant.model == "rigid":  # as two halves on a stiff spring would be slow: the load weighs nothing
        return float(plant.M), 1.0, 0.0, 0.0
    return float(plant.M1), float(plant.M2), float(plant.K12), float(plant.motor_friction.Fv)


@pytest.mark.parametrize("mass, unstable", [(6.0, True), (7.5, True), (10.0, False), (100.0, False)])
def test_a_light_mass_makes_the_sampled_loop_unstable(twin_machine, mass, unstable):
    assert (sampled_radius(rigid(mass), twin_machine) > 1) == unstable == grows(rigid(mass), twin_machine)


@pytest.mark.parametrize("lam, f_n, unstable", [(0.05, 5, True), (0.05, 40, True), (0.25, 90, True), (0.64, 24, False)])
def test_a_light_motor_side_does_too(twin_machine, lam, f_n, unstable):
    drive = flexible(lam, f_n)
    assert (sampled_radius(drive, twin_machine) > 1) == unstable == grows(drive, twin_machine)


def test_the_continuous_loop_needs_steps_short_enough(twin_machine):
    """Its velocity loop is 8557/M rad/s; Bosh3 is stable up to 2.5 of a step on the real axis."""
    rate = twin_machine.drive.gain * twin_machine.controller.kv
    limit = 2.51 * CONTINUOUS_SUBSTEPS / twin_machine.controller.sample_time
    heavier, lighter = rigid(1.3 * rate / limit), rigid(0.7 * rate / limit)
    assert integrated_radius(heavier, twin_machine, FAST, CONTINUOUS_SUBSTEPS) < 1
    assert integrated_radius(lighter, twin_machine, FAST, CONTINUOUS_SUBSTEPS) > 1


def _run(config, out):
    from experiments.robustness.maps import study

    study(config, out)


@pytest.mark.slow
def test_the_study_runs_and_resumes(tmp_path):
    out = tmp_path / "run"
    arguments = ["--quick", "--out", str(out), "--set", "twins=1", "--set", "noise_levels_N=[3.0]"]
    main("robustness", Config, _run, arguments)
    ranges = json.loads((out / "ranges.json").read_text())
    safe = ranges["sampled"]["step 1"]["DIDIM with safeguard"]["all starts"]
    assert safe["truth"] == safe["lanes"]
    for lanes in (xr.open_zarr(path, consolidated=False) for path in (out / "maps").glob("step*.zarr")):
        assert set(np.unique(lanes["outcome"])) <= {1, 2, 3, 4} and "unstable" in lanes
    page = (out / "report.html").read_text()
    assert page.index("SYNTHETIC") < page.index("Step 1")
    assert len(list((out / "figures").glob("*.png"))) == 5
    written = {path: path.stat().st_mtime_ns for path in (out / "maps").glob("step*/theta/c/*/*")}
    main("robustness", Config, _run, arguments)
    assert written and written == {path: path.stat().st_mtime_ns for path in written}  # not a lane is run again
