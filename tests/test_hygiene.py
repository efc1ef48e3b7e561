"""An unusable record is refused with its reason; a sound one is admitted, and what is odd about it is said."""

import dataclasses
import re
import warnings

import numpy as np
import pytest

from didim_jax.errors import InputError
from didim_jax.formats import load_recording
from didim_jax.hygiene import admit, examine, injected_scale
from didim_jax.machine import Machine
from didim_jax.recording import Recording


def _with(run, **channels):
    return dataclasses.replace(run, **channels)


def _cut(run, rows):
    return dataclasses.replace(run, **{name: values[rows] for name, values in run.channels.items()})


def _refusal(run, machine):
    with pytest.raises(InputError) as caught:
        admit(run, machine)
    message = str(caught.value)
    assert message.startswith(f"{run.label}: ")
    assert "\n" not in message
    return message


def _reported(run, machine, check):
    """The messages of one check on an admitted record."""
    return [finding.message for finding in admit(run, machine) if finding.check == check]


def test_nothing_is_said_of_a_clean_record(clean_run, emps_like):
    assert admit(clean_run, emps_like) == ()


# -- time --------------------------------------------------------------------------------------------------------


def test_thirty_samples(clean_run, emps_like):
    assert "30 samples are too few, at least 1000 are needed" in _refusal(_cut(clean_run, slice(30)), emps_like)


def test_many_samples_of_a_short_moment(clean_run, emps_like):
    fast = dataclasses.replace(emps_like, controller=dataclasses.replace(emps_like.controller, sample_time=1e-4))
    assert "0.2 s are too short, at least 1 s" in _refusal(_with(clean_run, t=0.1 * clean_run.t), fast)


def test_the_shortest_admissible_record(clean_run, emps_like):
    admit(_cut(clean_run, slice(1000)), emps_like)


def test_reversed_time(clean_run, emps_like):
    assert "t does not increase at row 2" in _refusal(_with(clean_run, t=clean_run.t[::-1]), emps_like)


def test_a_repeated_time_stamp(clean_run, emps_like):
    t = clean_run.t.copy()
    t[700] = t[699]
    assert "t does not increase at row 701" in _refusal(_with(clean_run, t=t), emps_like)


@pytest.mark.parametrize("second_rate", [2.0, 1.01])
def test_two_sampling_rates(clean_run, emps_like, second_rate):
    step = np.where(np.arange(len(clean_run) - 1) < 1200, 1e-3, second_rate * 1e-3)
    line = _refusal(_with(clean_run, t=np.concatenate([[0.0], np.cumsum(step)])), emps_like)
    assert "not uniformly sampled" in line
    assert "row 1202" in line


def test_a_lost_stretch(clean_run, emps_like):
    rows = np.r_[0:900, 950:2000]
    assert "not uniformly sampled: the step is 0.051 s at row 901" in _refusal(_cut(clean_run, rows), emps_like)


@pytest.mark.parametrize(("jitter", "n_reports"), [(1e-4, 0), (2e-2, 1)])
def test_jitter_is_silent_when_tiny_and_reported_when_small(clean_run, emps_like, jitter, n_reports):
    noise = np.random.default_rng(0).uniform(-0.5, 0.5, len(clean_run)) * jitter * 1e-3
    assert len(_reported(_with(clean_run, t=clean_run.t + noise), emps_like, "time")) == n_reports


@pytest.mark.parametrize(("factor", "reading"), [(1e3, "t looks like milliseconds"), (2.0, "the step of t is 0.002 s")])
def test_another_sample_time_than_the_machine(clean_run, emps_like, factor, reading):
    line = _refusal(_with(clean_run, t=factor * clean_run.t), emps_like)
    assert reading in line
    assert "the machine samples every 0.001 s" in line


# -- channels ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["qg", "qm", "vir"])
def test_a_channel_that_never_moves(clean_run, emps_like, name):
    dead = _with(clean_run, **{name: np.full(len(clean_run), 0.125)})
    assert f"{name} never moves, it is 0.125 in all 2000 rows" in _refusal(dead, emps_like)


def test_a_dead_load_encoder_is_only_reported(clean_run, emps_like):
    assert _reported(_with(clean_run, ql=np.zeros(len(clean_run))), emps_like, "dead channel")


@pytest.mark.parametrize(
    ("factors", "reading"),
    [
        ({"qm": 1e3}, "qm moves over .*: it looks like millimetres"),
        ({"qg": 1e3}, "qg moves over .*: it looks like millimetres"),
        ({"ql": 1e3}, "ql moves over .*: it looks like millimetres"),
        ({"qg": 1e3, "qm": 1e3}, "it looks like millimetres"),
        ({"qm": 1e6}, "it looks like micrometres"),
        ({"qg": 1e-3}, "a factor of 100.: they look like metres against millimetres"),
        ({"vir": 1e3}, "vir looks like millivolts"),
        ({"vir": 35.15}, "vir looks like newtons"),
        ({"vir": 35.15e-3}, "vir looks like kilonewtons"),
        ({"vir": 35.15e3}, "vir looks like millinewtons"),
        ({"vir": 1 / 35.15}, "vir looks divided by the drive gain"),
        ({"vir": 1e-3}, "millimetres .or vir like kilovolts"),
        ({"vir": -1.0}, "the sign of vir"),
    ],
)
def test_wrong_units_are_refused_with_their_likely_reading(clean_run, emps_like, factors, reading):
    wrong = _with(clean_run, **{name: factor * getattr(clean_run, name) for name, factor in factors.items()})
    with pytest.raises(InputError, match=reading):
        admit(wrong, emps_like)


def test_a_small_stroke_in_millimetres_shows_in_the_control_law(clean_run, emps_like):
    small = _with(clean_run, **{name: 0.02 * getattr(clean_run, name) for name in ("qg", "qm", "vir")}, ql=None)
    admit(small, emps_like)
    assert np.ptp(1e3 * small.qm) < 5  # not a stroke to wonder about by itself
    assert "qg and qm look like millimetres" in _refusal(_with(small, qg=1e3 * small.qg, qm=1e3 * small.qm), emps_like)


@pytest.mark.parametrize("gain", [0.9, 1.0, 1.3])
def test_a_drive_gain_near_one_is_not_taken_for_newtons(clean_run, emps_like, gain):
    machine = dataclasses.replace(emps_like, drive=dataclasses.replace(emps_like.drive, gain=gain))
    assert admit(_with(clean_run, gain=gain), machine) == ()


def test_the_grid_of_the_encoder(clean_run, emps_like):
    def said(qm):
        return _reported(_with(clean_run, qm=qm), emps_like, "encoder")

    assert said(clean_run.qm) == []
    assert said(clean_run.qm + 1.7e-8) == []  # where the zero of the encoder lies is nobody's fault
    assert "steps of 1e-06 m, 20 counts" in said(1e-6 * np.round(clean_run.qm / 1e-6))[0]
    assert "a lattice of 3e-08 m" in said(3e-8 * np.round(clean_run.qm / 3e-8))[0]
    assert "nor on any other" in said(clean_run.qm + np.random.default_rng(0).normal(0, 2e-8, len(clean_run)))[0]


def test_samples_beyond_the_drive_limit_are_counted(clean_run, emps_like):
    limit = float(np.sort(np.abs(clean_run.vir))[-12])  # eleven samples above it
    machine = dataclasses.replace(emps_like, drive=dataclasses.replace(emps_like.drive, limit=limit))
    (line,) = _reported(clean_run, machine, "limit")
    first = int(np.flatnonzero(np.abs(clean_run.vir) > limit)[0]) + 1
    assert "in 11 samples" in line
    assert f"rows {first}" in line
    clipped = _with(clean_run, vir=np.clip(clean_run.vir, -limit, limit))
    assert "recorded after the clip" in _reported(clipped, machine, "limit")[0]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"gain": 35.5}, "gtau is 35.5 N/V in the record and 35.15 N/V in the machine"),
        ({"documented": {"kp": 150.0}}, "kp is 150 1/s in the record and 160.18 1/s in the machine"),
        ({"documented": {"kv": 243.0}}, "kv is 243 V s/m in the record and 243.45 V s/m in the machine"),
    ],
)
def test_record_and_machine_must_agree(clean_run, emps_like, change, line):
    assert line in _refusal(_with(clean_run, **change), emps_like)


def test_a_load_that_moves_against_the_motor_is_no_rigid_drive(clean_run, emps_like):
    """Zeros apart, a scale off by 30 ppm and drives of 97 Hz and more are rigid enough."""
    # 3.5e6 N/m, or 30 Hz for 95 kg; part of it looks like a scale, so that the spring looks stiffer.
    both = _with(clean_run, ql=clean_run.qm + 3e-3 + 1e-5 * clean_run.vir)
    (line,) = _reported(both, emps_like, "agreement")
    assert re.search(r"a spring of some [3-6]\d Hz", line) and 'model = "flexible"' in line
    assert not _reported(both, dataclasses.replace(emps_like, model="flexible"), "agreement")
    scaled = (1 + 3e-5) * clean_run.qm + 3e-3 + 1e-6 * clean_run.vir
    assert not _reported(_with(clean_run, ql=scaled), emps_like, "agreement")


def test_agreement_is_to_a_thousandth(clean_run, emps_like):
    admit(_with(clean_run, gain=35.15 * 1.0009, documented={"kp": 160.18 * 0.9991}), emps_like)


# -- control law -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lag", [-3, -1, 1, 2])
def test_a_shifted_control_signal_is_found(clean_run, emps_like, lag):
    lines = _reported(_with(clean_run, vir=np.roll(clean_run.vir, lag)), emps_like, "law")
    assert f"vir {'lags' if lag > 0 else 'leads'} the documented control law by {abs(lag)} sample" in lines[0]


def test_other_gains_than_documented_are_told_apart(clean_run, emps_like):
    other = dataclasses.replace(emps_like, controller=dataclasses.replace(emps_like.controller, kp=160.18 / 1.03))
    (line,) = _reported(clean_run, other, "law")  # and no lag
    assert "1.03 times the position term and 1 times the velocity term" in line


def test_noise_on_the_control_signal_is_reported_in_volts_and_newtons(clean_run, emps_like):
    sigma = 0.1 * np.std(clean_run.vir)
    noisy = _with(clean_run, vir=clean_run.vir + np.random.default_rng(0).normal(0, sigma, len(clean_run)))
    (line,) = [line for line in _reported(noisy, emps_like, "law") if "residual" in line]
    volts = float(line.split("residual of ")[1].split(" V")[0])
    newtons = float(line.split(" V (")[1].split(" N")[0])
    assert volts == pytest.approx(sigma, rel=0.1)  # the rms of 2000 draws: 2 % wide
    assert newtons == pytest.approx(35.15 * volts, rel=0.01)


def test_a_control_signal_from_elsewhere_is_reported_not_read_as_a_unit(clean_run, emps_like):
    foreign = _with(clean_run, vir=np.random.default_rng(0).normal(0, 1, len(clean_run)))
    assert _reported(foreign, emps_like, "law")


# -- injected signal ---------------------------------------------------------------------------------------------


def _pulses(n):
    return 5.0 * (np.arange(n) // 100 % 2)


@pytest.mark.parametrize("scale", [1.014, -0.5, 1 / 35.15])
def test_the_scale_of_the_injected_signal_is_found(clean_run, emps_like, scale):
    pulses = _pulses(len(clean_run))
    run = _with(clean_run, injected=pulses, vir=clean_run.vir + scale * pulses)
    assert injected_scale(run, emps_like) == pytest.approx(scale, abs=1e-9)  # algebra only: the law holds exactly
    assert f"pulses_N enters at {scale:.4g} V per unit" in _reported(run, emps_like, "injected")[0]
    assert _reported(run, emps_like, "law") == []


def test_gains_that_are_off_do_not_shift_the_scale(clean_run, emps_like):
    pulses = _pulses(len(clean_run))
    other = dataclasses.replace(emps_like, controller=dataclasses.replace(emps_like.controller, kp=150.0))
    run = _with(clean_run, injected=pulses, vir=clean_run.vir + 1.014 * pulses)
    assert injected_scale(run, other) == pytest.approx(1.014, abs=1e-9)


def test_no_injected_signal_has_scale_zero(clean_run, emps_like):
    assert injected_scale(clean_run, emps_like) == 0.0
    assert injected_scale(_with(clean_run, injected=np.zeros(len(clean_run))), emps_like) == 0.0
    unused = _with(clean_run, injected=_pulses(len(clean_run)))
    assert injected_scale(unused, emps_like) == pytest.approx(0.0, abs=1e-9)
    assert "does not show in vir" in _reported(unused, emps_like, "injected")[0]


# -- whatever comes ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 49, 51, 1500])
@pytest.mark.parametrize("size", [0.0, 1e-300, 1.0, 1e300])
def test_examine_never_raises(emps_like, n, size):
    draw = np.random.default_rng(n).normal(0, size or 1.0, (6, n)) * (size > 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        findings = examine(Recording(*draw[:4], gain=35.15, ql=draw[4], injected=draw[5]), emps_like)
    assert any(finding.refuse for finding in findings)


# -- real records ------------------------------------------------------------------------------------------------


def test_the_benchmark_records_are_admitted_and_read_as_documented(emps_dir):
    machine = Machine.load(emps_dir / "machine.toml")
    fit, check = (load_recording(emps_dir / f"{name}.mat") for name in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    assert admit(fit, machine) == ()
    assert {finding.check for finding in admit(check, machine)} == {"injected", "encoder"}
    assert injected_scale(check, machine) == pytest.approx(1.014, abs=5e-4)  # the value stated with the data


def test_every_development_case_is_admitted(gap_cases):
    for case in gap_cases:
        machine = Machine.load(case / "machine.toml")
        for name in ("fit.mat", "check.mat"):
            assert {finding.check for finding in admit(load_recording(case / name), machine)} <= {"law", "limit"}
