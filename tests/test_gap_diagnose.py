"""The effect that a machine has and its simulation lacks is named, and adding it closes the gap on another trajectory.

The machines are simulated in plain numpy with laws of their own (another smooth sign, another Stribeck curve, a lag of
second order), a force noise that nothing records, and records that begin in motion.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any

import numpy as np
import pytest
import threadpoolctl
from gap_machine import CUT, path, record
from scipy.signal import butter, sosfiltfilt

from didim_jax.effects import AbstractEffect
from didim_jax.effects.actuator import Cogging
from didim_jax.effects.catalogue import CATALOGUE
from didim_jax.effects.environment import DisturbancePulses, Offset
from didim_jax.effects.friction import Stribeck
from didim_jax.gap.diagnose import diagnose
from didim_jax.gap.diagnosis import Diagnosis
from didim_jax.report.diagnosis_document import diagnosis_document

pytestmark = pytest.mark.slow

FEW = (
    "amplifier_lag amplifier_dead_zone cogging stribeck asymmetric_coulomb lead_friction coupling_damping backlash "
    "transmission_error encoder_periodic_error base_flexibility offset"
)
"""Enough rivals for the drive with a coupling, and a third of the time to compile."""


@pytest.fixture(scope="module", autouse=True)
def _one_thread() -> Iterator[None]:
    with threadpoolctl.threadpool_limits(1, user_api="blas"):  # as the program does
        yield


def sign(v: float) -> float:
    return v / math.hypot(v, 4e-4)


def sticking(q: float, v: float) -> float:
    """10 N more near rest; a Lorentzian where the catalogue has an exponential."""
    return 10 * sign(v) / (1 + (v / 0.012) ** 2)


def pulled_by_magnets(q: float, v: float) -> float:
    """4 N once per turn, with a third harmonic that the catalogue does not have."""
    return 4 * math.sin(2 * math.pi * q / 0.0025 + 0.3) ** 3


def losing_200_mV(volts: float) -> float:
    return math.copysign(max(abs(volts) - 0.2, 0.0), volts)


def lagging(seconds: float) -> Callable[[float], float]:
    """Two equal lags in a row, together this long; the catalogue has one."""
    keep, state = math.exp(-2e-3 / seconds), [0.0, 0.0]

    def drives(volts: float) -> float:
        state[0] = volts + (state[0] - volts) * keep
        state[1] = state[0] + (state[1] - state[0]) * keep
        return state[1]

    return drives


def diagnosed(
    machine,
    *,
    paths: tuple[int, ...] = (0,),
    check: bool = True,
    catalogue: Sequence[type[AbstractEffect]] = CATALOGUE,
    exclude: Collection[str] = (),
    threads: int = 1,
    **hidden: Any,
) -> Diagnosis:
    """Diagnosis of a machine with something hidden, from records of it on these paths, checked on another one."""
    fits = [record(machine, path(k), seed=10 + k, **hidden) for k in paths]
    assert abs(fits[0].qm[1] - fits[0].qm[0]) > 1e-5  # m in a millisecond: the record begins in motion
    if not check:
        return diagnose(fits, machine, catalogue, exclude=exclude, threads=threads)
    last = record(machine, path(1), seed=11, **hidden)
    outline = dataclasses.replace(last, qm=last.qg, vir=0 * last.vir, ql=None)
    return diagnose(
        fits, machine, catalogue, outline=outline, open_check=lambda _: last, exclude=exclude, threads=threads
    )


def assert_closed(d: Diagnosis, noise: float = 1.3) -> None:
    """Nearly all of the gap is gone on the record it was found on and on the other one, as predicted."""
    for gap in d.gap.values():
        assert gap.after < 0.5 * gap.before
        assert gap.after < noise * gap.floor
    if "check" in d.gap:
        assert d.gap["check"].predicted_after == pytest.approx(d.gap["check"].after, rel=0.3)
    assert d.share is not None and d.share > 0.95
    assert d.interval is not None and d.interval[0] <= d.share <= d.interval[1]


@pytest.fixture(scope="module")
def sticky(emps_like) -> Diagnosis:
    return diagnosed(emps_like, rubs=sticking)


def test_a_machine_as_modelled_lacks_nothing(emps_like):
    d = diagnosed(emps_like)
    assert (d.verdict, d.effects, d.parameters, d.ambiguous_with) == ("none", (), {}, ())
    assert d.ranking[0][0] == "none" and d.ranking[0][1] > 0.9
    assert d.block is None and d.experiment is None
    assert d.share is None or abs(d.share) < 0.1
    for gap in d.gap.values():
        assert gap.before == gap.after < 1.2 * gap.floor
    assert d.base["M"].after == pytest.approx(95.0, rel=2e-3)


def test_friction_that_grows_near_rest(sticky):
    assert (sticky.verdict, sticky.effects, sticky.block) == ("effect", ("stribeck",), "motor side")
    assert sticky.ranking[0][0] == "stribeck"
    assert_closed(sticky)
    assert sticky.parameters["stribeck"]["dFs"]["value"] == pytest.approx(10.0, rel=0.2)
    assert sticky.base["M"].after == pytest.approx(95.0, rel=2e-3)
    # Without the effect viscous and Coulomb friction take over part of it.
    assert abs(sticky.base["Fv"].before - 200) > 3 * abs(sticky.base["Fv"].after - 200)


def test_the_document_keeps_to_its_schema(sticky):
    document = diagnosis_document(sticky)
    assert document["schema"] == 1
    assert set(document) >= {
        *("verdict", "effects", "ambiguous_with", "ranking", "parameters", "block", "base", "gap", "closed"),
        *("last_in", "where", "separating_experiment", "remarks"),
    }
    p = {row["effect"]: row["probability"] for row in document["ranking"]}
    assert {"none", "other"} < set(p) and len(p) == len(document["ranking"])
    assert all(0 <= x <= 1 for x in p.values()) and sum(p.values()) == pytest.approx(1)
    known = {effect.label() for effect in CATALOGUE}
    assert set(p) - {"none", "other"} <= known and set(document["effects"]) <= known
    assert set(document["gap"]) == {"fit", "check"}
    assert set(document["gap"]["fit"]) == {"before", "after", "floor"}
    assert set(document["gap"]["check"]) == {"before", "after", "floor", "predicted_after"}
    assert set(document["parameters"]["stribeck"]) >= {"dFs", "vs", "a"}
    for number in document["parameters"]["stribeck"].values():
        assert set(number) == {"value", "std", "unit"} and number["std"] > 0
    assert {"M", "Fv", "Fc"} <= set(document["base"])
    assert set(document["base"]["M"]) == {"before", "after", "std", "unit"}
    assert set(document["closed"]) == {"share", "interval"}
    assert set(document["where"]) == {"time_s", "speed_m_s", "position_m", "frequency_hz", "channel"}
    assert [run.name for run in sticky.runs] == ["machine, seed 10", "machine, seed 11"]
    assert all(len(run.t) == len(run.tau) == len(run.before) == len(run.after) for run in sticky.runs)


def test_noise_is_one_number(sticky):
    """In the gap, and in newtons in the map of what is left before and after."""
    gap = sticky.gap["fit"]
    for one, left in ((sticky.atlas, gap.before), (sticky.atlas_after, gap.after)):
        assert one.floor_rms / one.rms == pytest.approx(gap.floor / left, rel=1e-9)


def test_the_gap_is_that_of_the_contract(sticky):
    """norm(F(tau - tau_sim)) / norm(F(tau)) over every sample, F of order 4 at 60 Hz, forward and backward."""
    sos = butter(4, 60.0, fs=1000.0, output="sos")
    for run, gap in zip(sticky.runs, sticky.gap.values(), strict=True):
        whole = np.linalg.norm(sosfiltfilt(sos, run.tau))
        for simulated, told in ((run.before, gap.before), (run.after, gap.after)):
            # decimated, and filtered with other ends: alike, not equal
            assert np.linalg.norm(sosfiltfilt(sos, run.tau - simulated)) / whole == pytest.approx(told, rel=0.05)


def test_an_amplifier_that_loses_the_first_volts(emps_like):
    d = diagnosed(emps_like, drives=losing_200_mV)
    assert (d.verdict, d.effects, d.block) == ("effect", ("amplifier_dead_zone",), "actuator")
    assert_closed(d)
    assert d.parameters["amplifier_dead_zone"]["d"]["value"] == pytest.approx(0.2, rel=0.05)


def test_twins_are_named_together_with_what_would_part_them(emps_like):
    d = diagnosed(emps_like, drives=lagging(1.8e-3))
    assert d.verdict == "ambiguous" and set(d.ambiguous_with[0]) == {"amplifier_lag", "time_delay"}
    assert d.effects == d.ambiguous_with[0][:1]
    assert d.experiment is not None and d.experiment.what and 0 < d.experiment.angle_deg <= 90
    assert_closed(d)


def test_a_constant_force_on_a_short_record(emps_like):
    """4 N close nine tenths of the gap; in 3 s they are one number against a slow drift of 0.3 N."""
    d = diagnosed(emps_like, rubs=lambda q, v: 4.0)
    assert d.verdict == "ambiguous" and set(d.ambiguous_with[0]) >= {"offset", "asymmetric_coulomb"}
    assert_closed(d)


def test_two_effects_at_once(emps_like):
    d = diagnosed(emps_like, drives=losing_200_mV, rubs=pulled_by_magnets)
    assert set(d.effects) == {"amplifier_dead_zone", "cogging"}
    assert set(d.last_in) == set(d.effects) and all(0 < share <= 1 for share in d.last_in.values())
    assert_closed(d, noise=1.6)  # the third harmonic of the magnets stays
    assert d.parameters["amplifier_dead_zone"]["d"]["value"] == pytest.approx(0.2, rel=0.05)


WITHHELD = ("stribeck", "cogging", "encoder_periodic_error", "transmission_error", "lead_friction")


@pytest.fixture(scope="module", params=[sticking, pulled_by_magnets], ids=["sticking", "magnets"])
def unknown(request, emps_like) -> Diagnosis:
    """The effect, and what could stand for it, withheld from the catalogue."""
    return diagnosed(emps_like, exclude=WITHHELD, rubs=request.param)


def test_none_of_these_is_an_answer(unknown):
    assert unknown.verdict == "unexplained"
    assert not {*unknown.effects, *dict(unknown.ranking)} & set(WITHHELD)
    assert unknown.gap["check"].after > 0.3 * unknown.gap["check"].before


@pytest.mark.parametrize("unknown", [pulled_by_magnets], ids=["magnets"], indirect=True)
def test_what_is_unexplained_is_not_ranked_as_nothing(unknown):
    assert dict(unknown.ranking)["none"] < 0.5


def test_noise_of_the_recorder_is_no_gap(emps_like):
    """20 mV on the recorded vir that the drive never had: as `didim simulate --noise` writes it."""
    clean = record(emps_like, path(0), seed=10)
    noise = np.random.default_rng(3).normal(0.0, 0.02, len(clean))
    d = diagnose([dataclasses.replace(clean, vir=clean.vir + noise)], emps_like, CATALOGUE)
    assert (d.verdict, d.effects) == ("none", ())


def test_two_records_of_one_machine_are_fitted_together(emps_like, sticky):
    d = diagnosed(emps_like, paths=(0, 2), rubs=sticking)
    assert (d.verdict, d.effects) == ("effect", ("stribeck",))
    assert_closed(d)
    # Twice the data: a standard deviation of 0.7 of what it was, or so.
    both, one = (x.parameters["stribeck"]["vs"]["std"] for x in (d, sticky))
    assert 0.3 * one < both < one
    assert [run.name for run in d.runs][-1] == "machine, seed 11"


def test_each_record_has_a_clock_of_its_own(emps_like):
    """One push of 21 N for 0.2 s, at another instant in every record; half of each record cannot show it."""

    def pushed(at: float) -> Callable[[float], float]:
        sample = itertools.count()
        return lambda volts: volts + 0.6 * (at <= 1e-3 * (next(sample) - CUT) < at + 0.2)

    fits = [record(emps_like, path(k), seed=10 + k, drives=pushed(at)) for k, at in ((0, 1.0), (2, 1.55))]
    d = diagnose(fits, emps_like, [DisturbancePulses, Offset, Cogging, Stribeck])
    assert (d.verdict, d.effects, d.block) == ("effect", ("disturbance_pulses",), "environment")
    assert d.gap["fit"].after < 1.2 * d.gap["fit"].floor
    assert d.parameters["disturbance_pulses"]["t0"]["value"] == pytest.approx(1.0, abs=0.02)
    assert abs(d.parameters["disturbance_pulses"]["A"]["value"]) == pytest.approx(0.6 * emps_like.drive.gain, rel=0.1)
    assert any("one half of the record only" in remark for remark in d.remarks)


def test_without_a_check_record_the_fit_is_what_is_judged(emps_like, sticky):
    """And refits side by side are the refits one after another."""
    d = diagnosed(emps_like, check=False, threads=2, rubs=sticking)
    assert set(d.gap) == {"fit"} and len(d.runs) == 1
    assert (d.verdict, d.effects, d.parameters) == (sticky.verdict, sticky.effects, sticky.parameters)


@pytest.mark.parametrize("with_load", [False, True], ids=["motor encoder", "both encoders"])
def test_a_drive_with_a_coupling(emps_like, with_load):
    machine = dataclasses.replace(emps_like, model="flexible")
    few = tuple(effect for effect in CATALOGUE if effect.label() in FEW.split())
    d = diagnosed(machine, catalogue=few, rubs=pulled_by_magnets, with_load=with_load)
    assert (d.verdict, d.effects, d.block) == ("effect", ("cogging",), "actuator")
    assert_closed(d, noise=1.6)
    assert d.base["M1"].after == pytest.approx(60.0, rel=0.02)
    assert d.base["M2"].after == pytest.approx(35.0, rel=0.02)
    assert d.base["K12"].after == pytest.approx(7e5, rel=0.03)
