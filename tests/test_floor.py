"""A floor from repeats is the noise of one pass; the load encoder's noise is read above the motion."""

import dataclasses

import numpy as np
import pytest

from didim_jax.formats import load_recording
from didim_jax.gap.floor import load_noise, repeat_floor
from didim_jax.recording import Recording
from didim_jax.signals import LowPass

DT = 1e-3
GAIN = 35.15


def _reference(n, period=2.5):
    t = DT * np.arange(n)
    return 0.05 * (1 - np.cos(2 * np.pi * t / period)) + 2e-3 * np.sin(6 * np.pi * t / period)


def _record(seconds, noise=0.0, drift=0.0, seed=0, qg=None, **channels):
    """A force that follows the reference, with white noise (N rms) and a drift (N per pass of 2.5 s)."""
    n = round(seconds / DT)
    t = DT * np.arange(n)
    qg = _reference(n) if qg is None else qg
    rng = np.random.default_rng(seed)
    tau = 40 * np.sin(2 * np.pi * t / 2.5) + 25 * np.sign(np.cos(2 * np.pi * t / 2.5 + 0.3))
    tau = tau + noise * rng.standard_normal(n) + drift * t / 2.5
    return Recording(t, qg, qg + 1e-6 * tau, tau / GAIN, GAIN, name="record", synthetic=True, **channels)


def _band_rms(x):
    return np.sqrt(np.mean(LowPass.butterworth(60.0, DT)(x, odd=False) ** 2))


@pytest.mark.parametrize("seconds", [4.3, 8.0, 10.0])
def test_the_floor_is_the_noise_of_one_pass(seconds):
    clean, noisy = _record(seconds), _record(seconds, noise=3.0)
    true = _band_rms(noisy.tau - clean.tau) / _band_rms(noisy.tau)
    floor = repeat_floor(noisy)
    assert floor.period == pytest.approx(2.5, abs=1e-9)
    # 60 Hz over some seconds are several hundred independent values: 5 %, three times that
    assert floor.value == pytest.approx(true, rel=0.15)
    assert floor.half_difference == pytest.approx(floor.value / np.sqrt(2))
    assert floor.reason == ""


def test_without_noise_there_is_no_floor_above_rounding():
    assert repeat_floor(_record(10.0)).value < 1e-9


def test_a_drift_shows_from_first_to_last_more_than_between_neighbours():
    floor = repeat_floor(_record(10.0, noise=0.5, drift=2.0))
    assert floor.drift == pytest.approx(3 * 2.0 / np.sqrt(2) / _band_rms(_record(10.0).tau), rel=0.1)
    assert floor.drift > 2 * floor.value


def test_one_event_is_not_noise():
    quiet = _record(10.0, noise=1.0)
    vir = quiet.vir.copy()
    vir[9000:9300] += 1.0
    assert repeat_floor(dataclasses.replace(quiet, vir=vir)).value == pytest.approx(repeat_floor(quiet).value, rel=0.2)


def test_a_reference_that_does_not_repeat():
    n = 10000
    chirp = 0.03 * np.sin(2 * np.pi * (0.2 + 0.05 * DT * np.arange(n)) * DT * np.arange(n))
    floor = repeat_floor(_record(10.0, qg=chirp))
    assert floor.value is None
    assert "does not repeat" in floor.reason


@pytest.mark.parametrize("shape", ["constant", "one step", "dwell"])
def test_rest_is_no_repetition(shape):
    n = 6000
    qg = np.zeros(n)
    if shape == "one step":
        qg[3000:] = 0.05
    if shape == "dwell":
        qg[:1000] = np.linspace(0, 0.1, 1000)
        qg[1000:] = 0.1
    assert repeat_floor(_record(6.0, qg=qg)).value is None


def test_barely_more_than_one_pass_is_too_little():
    assert repeat_floor(_record(2.8, noise=1.0)).value is None


def test_injected_signals_must_repeat_as_well():
    on = (np.arange(10000) % 1000 < 500).astype(float)
    floor = repeat_floor(_record(10.0, injected=on))
    assert floor.value is None
    assert floor.period == pytest.approx(2.5, abs=1e-9)
    assert "injected" in floor.reason
    assert repeat_floor(_record(10.0, injected=np.tile(on[:2500], 4))).value is not None


# -- load encoder ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [1e-8, 3e-7])
def test_load_noise_is_that_inside_the_band(sigma):
    clean = _record(10.0)
    noise = sigma * np.random.default_rng(2).standard_normal(len(clean))
    deflection = LowPass.butterworth(80.0, DT)(2e-6 * clean.vir)  # what the coupling does ends far below
    noisy = dataclasses.replace(clean, ql=clean.qm + deflection + noise)
    assert load_noise(noisy) == pytest.approx(_band_rms(noise), rel=0.1)  # 600 independent values: 3 %


def test_without_a_load_encoder_there_is_none():
    assert load_noise(_record(4.0)) is None


# -- development cases, real records -----------------------------------------------------------------------------


def test_the_real_floor(emps_dir):
    """Neighbouring passes differ by 0.53-0.61 % of the force, the first from the last by more: the axis warms up."""
    floor = repeat_floor(load_recording(emps_dir / "DATA_EMPS.mat"))
    assert floor.period == pytest.approx(6.24, abs=1e-6)
    assert 0.005 < floor.value < 0.0065
    assert floor.drift > floor.value


def test_pulses_that_do_not_repeat_leave_no_floor(emps_dir):
    floor = repeat_floor(load_recording(emps_dir / "DATA_EMPS_PULSES.mat"))
    assert floor.value is None
    assert "injected" in floor.reason


def test_the_development_cases(gap_cases):
    """No reference repeats; two encoders that count 50 nm have sqrt(2) / sqrt(12) of it as noise, here in 60 Hz."""
    noises = []
    for folder in gap_cases[:12]:
        run = load_recording(folder / "fit.mat")
        assert repeat_floor(run).value is None
        noises.append(load_noise(run))
    found = [x for x in noises if x is not None]
    assert found
    counting = 5e-8 / np.sqrt(6) * _band_rms(np.random.default_rng(0).standard_normal(100000))
    np.testing.assert_allclose(found, counting, rtol=0.1)
