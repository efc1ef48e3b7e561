"""What the controller adds to its documented law is found in the control-law residual alone, without a plant."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from didim_jax.formats import load_recording
from didim_jax.gap import law
from didim_jax.gap.law import Pulse, encoder_grid, examine_law
from didim_jax.machine import Machine
from didim_jax.recording import Recording

ROUNDING = 1e-7  # V: vir is stored with seven digits in the development cases


def _run(machine, position=0.0, velocity=0.0, T=0.0, volts=None, grid=0.0, extra=0.0, seconds=6.0):
    """A rigid mass from standstill, encoder counted; the law's gains, filter and output as asked for."""
    c, n = machine.controller, int(seconds * 1000)
    t = np.arange(n) * c.sample_time
    qg = 0.05 * (1 - np.cos(2 * np.pi * t / 3)) + 0.0003 * (1 - np.cos(14 * np.pi * t))
    volts = np.zeros(n) if volts is None else volts
    grid = grid or machine.encoder.resolution
    a = np.exp(-c.sample_time / T) if T else 0.0
    qm, vir = np.zeros(n), np.zeros(n)
    q = v = filtered = 0.0
    for k in range(n):
        qm[k] = grid * np.round(q / grid)
        dq = (qm[k] - qm[max(k - 2, 0)]) / (2 * c.sample_time)
        filtered = a * filtered + (1 - a) * dq
        law = c.kv * (1 + velocity) * (c.kp * (1 + position) * (qg[k] - qm[k]) - filtered)
        vir[k] = law + volts[k] + extra * v * abs(v)
        v += c.sample_time * (machine.drive.gain * vir[k] - 200.0 * v - 20.0 * np.tanh(v / 1e-3)) / 95.0
        q += c.sample_time * v
    vir = vir.astype(np.float32).astype(float)
    return Recording(t, qg, qm, vir, machine.drive.gain, name="run", synthetic=True)


def _train(*pulses, n=6000):
    volts = np.zeros(n)
    for a, b, height in pulses:
        volts[a:b] += height
    return volts


def _assert_pulses(found, expected):
    assert len(found) == len(expected)
    for pulse, (a, b, height) in zip(found, expected, strict=True):
        assert pulse.on == pytest.approx(a * 1e-3, abs=1e-9)
        assert pulse.off == pytest.approx(b * 1e-3, abs=1e-9)
        assert pulse.volts == pytest.approx(height, rel=0.02)


# -- one effect --------------------------------------------------------------------------------------------------


def test_a_sound_controller_leaves_rounding(emps_like):
    found = examine_law(_run(emps_like), emps_like)
    assert found.rms < ROUNDING
    assert (found.significant, found.lag, found.pulses, found.best().effects) == (False, 0, (), ())


@pytest.mark.parametrize(
    ("effect", "parameter", "value"),
    [
        ("position_gain", "position", 0.02),
        ("position_gain", "position", -0.005),
        ("velocity_gain", "velocity", 0.02),
        ("velocity_filter", "T", 3e-4),
        ("velocity_filter", "T", 3e-3),
    ],
)
def test_an_effect_of_the_controller_explains_the_residual_to_rounding(emps_like, effect, parameter, value):
    found = examine_law(_run(emps_like, **{parameter: value}), emps_like)
    assert found.significant
    assert found.best().effects == (effect,)
    assert found.best().rms < ROUNDING
    assert found.lag == 0
    assert found.pulses == ()
    (name,) = found.best().parameters
    # the residual is exact to seven digits of vir, and is some per cent of it
    assert found.best().parameters[name] == pytest.approx(value, rel=1e-5)
    assert found.best().share > 1 - 1e-9


def test_both_gains_together(emps_like):
    found = examine_law(_run(emps_like, position=0.03, velocity=-0.04), emps_like)
    best = found.best()
    assert best.effects == ("position_gain", "velocity_gain")
    assert best.parameters["position_gain.e"] == pytest.approx(0.03, rel=1e-5)
    assert best.parameters["velocity_gain.e"] == pytest.approx(-0.04, rel=1e-5)


def test_an_excluded_effect_is_not_taken(emps_like):
    found = examine_law(_run(emps_like, velocity=0.02), emps_like)
    assert "velocity_gain" not in found.best(exclude=["velocity_gain"]).effects


def test_what_is_left_out_of_the_catalogue_explains_nothing(emps_like):
    """Its residual stays, and is no noise."""
    run = _run(emps_like, velocity=0.02)
    whole, without = examine_law(run, emps_like), examine_law(run, emps_like, exclude=["velocity_gain"])
    assert all("velocity_gain" not in e.effects for e in without.explanations)
    assert without.significant and without.rms == whole.rms
    assert whole.best().share > 1 - 1e-9 > without.best().share


def test_a_filter_of_another_law_is_told_by_its_taps(emps_like):
    run = _run(emps_like)
    c = emps_like.controller
    dq = np.zeros(len(run))
    dq[2:] = (run.qm[2:] - run.qm[:-2]) / (2 * c.sample_time)
    mean = np.convolve(dq, np.full(4, 0.25))[: len(run)]  # in place of dq: the mean of the last four
    found = examine_law(dataclasses.replace(run, vir=run.vir - c.kv * (mean - dq)), emps_like)
    assert found.of("velocity_filter").share < 0.999
    assert found.free_filter.share > 1 - 1e-9
    taps = [found.free_filter.parameters[f"velocity_filter.b{j}"] for j in range(1, 9)]
    np.testing.assert_allclose(taps, [0.25, 0.25, 0.25, 0, 0, 0, 0, 0], atol=1e-5)


def test_what_a_filter_saw_before_the_record_is_no_pulse():
    """A record that begins in motion: the law's first samples are not as foreseen, and all others are."""
    t = np.arange(2000) * 1e-3
    left = 1e-4 * np.random.default_rng(0).normal(size=len(t))
    left[:2] += 0.03
    assert law._pulses(left, [np.sin(9 * t)], smallest=0.01) == []
    left[:20] = 0.03  # what lasts was on before
    assert law._pulses(left, [np.sin(9 * t)], smallest=0.01) == [(0, 20)]


def test_the_standard_deviation_covers_the_error_under_white_noise(emps_like):
    run, rng = _run(emps_like, position=0.01), np.random.default_rng(5)
    z = []
    for _ in range(20):
        noisy = dataclasses.replace(run, vir=run.vir + 0.02 * rng.standard_normal(len(run)))
        e = examine_law(noisy, emps_like).of("position_gain")
        z.append((e.parameters["position_gain.e"] - 0.01) / e.std["position_gain.e"])
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.5  # twenty draws: 1 +- 0.16, three times that


@pytest.mark.parametrize("lag", [-1, 1, 2])
def test_a_shifted_channel_is_a_lag_and_nothing_else(emps_like, lag):
    run = _run(emps_like)
    shifted = dataclasses.replace(run, vir=np.roll(run.vir, lag))
    found = examine_law(shifted, emps_like)
    assert found.lag == lag
    assert found.rms < ROUNDING or lag < 0  # the roll puts one foreign sample at the end


def test_an_unknown_term_is_significant_and_no_pulse(emps_like):
    found = examine_law(_run(emps_like, extra=40.0), emps_like)  # up to half a volt, smooth
    assert found.significant
    assert found.pulses == ()


# -- pulses ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "pulses",
    [
        [(500, 800, 1.0), (2500, 2800, 1.0), (4500, 4800, 1.0)],
        [(1234, 1250, -0.3)],
        [(0, 300, 2.0), (3000, 3400, -2.0), (5700, 6000, 2.0)],
        [(1000, 1500, 1.0), (1500, 2000, -0.5)],
        [(k, k + 500, 5.0) for k in range(344, 5500, 1000)],
    ],
    ids=["train", "short and weak", "at both ends", "adjoining", "half of the time"],
)
def test_pulses_are_found_to_the_sample(emps_like, pulses):
    found = examine_law(_run(emps_like, volts=_train(*pulses)), emps_like)
    assert found.significant
    assert found.best().effects == ("disturbance_pulses",)
    _assert_pulses(found.pulses, pulses)


@pytest.mark.parametrize(
    ("effect", "settings"),
    [
        ("position_gain", {"position": 0.03}),
        ("velocity_gain", {"velocity": -0.03}),
        ("velocity_filter", {"T": 1e-3}),
    ],
)
def test_pulses_behind_another_effect(emps_like, effect, settings):
    pulses = [(500, 800, 1.5), (2500, 2800, 1.5), (4500, 4800, 1.5)]
    found = examine_law(_run(emps_like, volts=_train(*pulses), **settings), emps_like)
    assert set(found.best().effects) == {effect, "disturbance_pulses"}
    assert found.best().rms < ROUNDING
    _assert_pulses(found.pulses, pulses)


def test_pulses_in_white_noise(emps_like):
    pulses = [(700, 1000, 0.5), (3200, 3500, 0.5)]
    run = _run(emps_like, volts=_train(*pulses))
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(run))
    _assert_pulses(examine_law(dataclasses.replace(run, vir=run.vir + noise), emps_like).pulses, pulses)


# -- encoder grid ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("grid", [7.5e-8, 1.3e-7, 1e-6, 5e-6])
@pytest.mark.parametrize("storage", [np.float64, np.float32])
def test_a_coarser_grid_is_read_off(emps_like, grid, storage):
    run = _run(emps_like, grid=grid)
    run = dataclasses.replace(run, qm=run.qm.astype(storage) + 1.7e-3)
    assert encoder_grid(run, emps_like) == pytest.approx(grid, rel=1e-4)


def test_no_grid_without_one(emps_like):
    run = _run(emps_like)
    assert encoder_grid(run, emps_like) is None  # counted as documented
    noisy = run.qm + 1e-6 * np.random.default_rng(1).standard_normal(len(run))
    assert encoder_grid(dataclasses.replace(run, qm=noisy), emps_like) is None


# -- development cases, real records -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "effect"),
    [
        ("case-012", "position_gain"),
        ("case-027", "position_gain"),
        ("case-057", "velocity_gain"),
        ("case-058", "velocity_gain"),
        ("case-036", "velocity_filter"),
        ("case-051", "velocity_filter"),
        ("case-001", None),
        ("case-043", None),  # pulses of force: the law does not know of them
    ],
)
def test_the_development_cases(gap_cases, case, effect):
    folder = {path.name: path for path in gap_cases}[case]
    machine = Machine.load(folder / "machine.toml")
    sizes = []
    for name in ("fit.mat", "check.mat"):
        found = examine_law(load_recording(folder / name), machine)
        assert found.best().effects == ((effect,) if effect else ())
        assert found.significant == bool(effect)
        assert found.best().rms < ROUNDING
        assert found.pulses == ()
        sizes += found.best().parameters.values()
    if effect:
        assert sizes[0] == pytest.approx(sizes[1], rel=1e-5)  # one machine, two trajectories


@pytest.fixture(scope="module")
def emps_machine(emps_dir: Path) -> Machine:
    return Machine.load(emps_dir / "machine.toml")


def test_the_real_controller_is_as_documented(emps_dir, emps_machine):
    """What is left is one count in the velocity now and then, kv * 5e-8 m / 2 ms = 6.1 mV."""
    found = examine_law(load_recording(emps_dir / "DATA_EMPS.mat"), emps_machine)
    assert (found.significant, found.lag, found.pulses, found.best().effects) == (False, 0, (), ())
    assert 0.5 < found.rms_band / found.counting < 2
    counts = found.residual[2:] / (243.45 * 5e-8 / 2e-3)
    assert np.abs(counts - np.round(counts)).max() < 0.35  # kp and kv are given to four digits, of 31 V


def test_known_pulses_leave_nothing(emps_dir, emps_machine):
    found = examine_law(load_recording(emps_dir / "DATA_EMPS_PULSES.mat"), emps_machine)
    assert (found.significant, found.lag, found.pulses) == (False, 0, ())


@pytest.mark.slow
def test_hidden_pulses_are_found_in_the_real_record(emps_dir, emps_machine):
    record = load_recording(emps_dir / "DATA_EMPS_PULSES.mat")
    assert record.injected is not None
    edges = np.flatnonzero(np.diff(np.concatenate([[0], record.injected, [0]])))
    times = np.append(record.t, record.t[-1] + 1e-3)
    expected = [Pulse(times[a], times[b], 5.069) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    found = examine_law(dataclasses.replace(record, injected=None), emps_machine)
    assert found.best().effects == ("disturbance_pulses",)
    assert len(found.pulses) == len(expected) == 25
    for pulse, truth in zip(found.pulses, expected, strict=True):
        assert pulse.on == pytest.approx(truth.on, abs=1e-9)
        assert pulse.off == pytest.approx(truth.off, abs=1e-9)
        assert pulse.volts == pytest.approx(truth.volts, rel=2e-3)


@pytest.mark.parametrize(("effect", "value"), [("position_gain", 0.005), ("velocity_gain", -0.01)])
def test_a_gain_behind_the_real_counting(emps_dir, emps_machine, effect, value):
    record, c = load_recording(emps_dir / "DATA_EMPS.mat"), emps_machine.controller
    position = c.kv * c.kp * (record.qg - record.qm)
    added = value * (position if effect == "position_gain" else record.vir)
    found = examine_law(dataclasses.replace(record, vir=record.vir + added), emps_machine)
    assert found.best().effects == (effect,)
    # the documented kp and kv are themselves right to 2e-4
    assert found.best().parameters[f"{effect}.e"] == pytest.approx(value, abs=3e-4)
    assert found.pulses == ()
