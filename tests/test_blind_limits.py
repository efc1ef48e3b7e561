"""Limits hold the curve they were made from, planted effects are what they are called, and constants come back.

The diagnosis is a coin with a known psychometric curve, or a list of numbers; no machine is diagnosed.
"""

import dataclasses
import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from didim_jax.errors import InputError
from didim_jax.gap import decide
from experiments.blind import calibrate, limits, real
from experiments.blind.judge import blank_row
from experiments.blind.limits import Asked, bound, measured, read_rows, realised
from experiments.blind.main_parameter import MAIN
from experiments.blind.plan import ALIAS, TWINS
from experiments.blind.staircase import LEVELS, chance, next_size, threshold
from experiments.study import write_json

# ---- staircase ----


def sizes_of(middle: float, slope: float) -> dict[float, float]:
    """Where a curve reaches the levels, by looking."""
    grid = np.geomspace(1e-3, 1e2, 20001)
    return {level: float(np.interp(level, chance(grid, np.log(middle), slope), grid)) for level in LEVELS}


def staircase(middle: float, slope: float, seed: int, n: int = 24) -> list[tuple[float, bool]]:
    rng, trials = np.random.default_rng(seed), []
    for k in range(n):
        size = next_size(trials, LEVELS[k % 2])
        trials.append((size, bool(rng.random() < chance(size, np.log(middle), slope))))
    return trials


@pytest.mark.parametrize(("middle", "slope"), [(0.25, 3.0), (0.8, 4.0), (0.1, 2.0)])
def test_the_intervals_hold_the_curve_about_as_often_as_they_say(middle, slope):
    """24 trials; 95 % intervals of 12 staircases each. 8 or fewer of 12 would be seen once in 450 times."""
    true = sizes_of(middle, slope)
    found = [{level: threshold(staircase(middle, slope, seed), level) for level in LEVELS} for seed in range(12)]
    for level, size in true.items():
        held = [t[level].low <= size <= (t[level].high or np.inf) for t in found]
        assert sum(held) >= 9
        values = [t[level].value for t in found if t[level].value is not None]
        assert np.median(values) == pytest.approx(size, rel=0.4)


def test_many_trials_find_the_curve():
    true = sizes_of(0.3, 4.0)
    trials = staircase(0.3, 4.0, seed=1, n=120)
    for level in LEVELS:
        assert threshold(trials, level).value == pytest.approx(true[level], rel=0.2)


def test_what_is_never_named_has_no_limit():
    found = threshold([(5.0, False)] * 12, 0.9)
    assert found.value is None and found.high is None


def test_what_is_missed_at_every_size_has_no_size_at_which_it_is_named_in_nine_of_ten():
    trials = [(0.05 * 1.12**k, k > 12 and k % 4 < 3) for k in range(40)]  # from 0.2 on, three times of four
    assert 0.17 < threshold(trials, 0.5).value < 0.5
    found = threshold(trials, 0.9)
    assert found.value is None and found.high is None


def test_a_limit_below_all_that_was_asked_is_no_more_than_the_least_of_it():
    found = threshold([(0.1 * k, True) for k in range(1, 13)], 0.5)
    assert (found.value, found.below) == (0.1, True) and found.low <= 0.1
    assert not threshold([(0.1 * k, k > 5) for k in range(1, 13)], 0.5).below


# ---- limits, trial by trial ----


class Coin:
    """Trials with a known curve; counts them, and may be stopped."""

    def __init__(self, stop_after: int = 10**9) -> None:
        self.left, self.asked, self.lock = stop_after, [], threading.Lock()

    def __call__(self, asked: Asked) -> dict[str, Any]:
        with self.lock:
            if self.left == 0:
                raise KeyboardInterrupt
            self.left -= 1
            self.asked.append(asked)
        if asked.size > 2:
            return {"refused": True}
        noise = {"low": 0.3, "usual": 1.0, "high": 3.0}[asked.noise]
        named = np.random.default_rng(asked.seed).random() < chance(asked.size, np.log(0.2 * noise), 4.0)
        found = [asked.effect] if named else []
        return {"named": bool(named), "found": found, "law": "plain", "value": 3 * asked.size, "std": 0.014 * noise}


def seeded(folder: Path) -> Path:
    (folder / "limits").mkdir(parents=True)
    write_json(folder / "limits" / "seed.json", {"seed": 5})
    return folder


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return seeded(tmp_path)


def test_a_limit_is_in_the_effects_own_unit_and_holds_the_truth(study):
    found = limits.limits(study, ["offset"], 24, 4, one=Coin())
    one = found["effects"]["offset"]
    true = {key: 3 * size for key, size in zip(("p50", "p90"), sizes_of(0.2, 4.0).values(), strict=True)}
    assert (one["parameter"], one["unit"], one["typical"], one["crlb"], one["n"]) == (
        "F0",
        "N",
        3.0,
        pytest.approx(0.014),
        24,
    )
    for key, size in true.items():
        low, high = one[f"{key}_interval"]
        assert low <= size <= high and low <= one[key] <= high
        assert one["in_typical_sizes"][key] == pytest.approx(one[key] / 3)
    assert len(one["trials"]) == 24 and json.loads((study / "limits.json").read_text())["effects"]["offset"] == one
    assert [check["noise"] for check in found["spot_checks"]] == ["low", "high"]
    assert found["spot_checks"][1]["bound_ratio"] == pytest.approx(3.0)
    assert {at["foreseen"]: at["n"] for at in found["spot_checks"][0]["seen"]} == {0.5: 4, 0.9: 4}
    limits.print_limits(found)


def test_laws_that_differ_in_their_typical_size_share_no_unit(study):
    """One law is typically five times the other, a third has no such parameter; their spreads follow their sizes."""

    def one(asked: Asked) -> dict[str, Any]:
        law, typical = (("cubic", 0.2), ("tanh", 0.04), ("other", None))[asked.seed % 3]
        value = None if typical is None else typical * asked.size
        row = {"named": asked.size > 0.3, "found": ["cubic_stiffness"], "law": law, "value": value}
        return {**row, "std": 0.01 * (typical or 1e6)}

    found = limits.limits(study, ["cubic_stiffness"], 24, one=one)["effects"]["cubic_stiffness"]
    assert (found["parameter"], found["unit"], found["typical"]) == ("size", "typical sizes", 1.0)
    assert found["typical_of_law"] == pytest.approx({"cubic": 0.2, "tanh": 0.04})
    assert found["crlb"] == pytest.approx(0.01) and 0.2 < found["p50"] < 0.45


def test_a_law_without_the_parameter_leaves_the_others_without_its_unit(study):
    """Half of the trials are of a law that counts samples: the limit is no time then."""

    def one(asked: Asked) -> dict[str, Any]:
        lag = asked.seed % 2 == 0
        row = {"named": asked.size > 0.3, "found": ["offset"], "law": "lag" if lag else "window"}
        return {**row, "value": 1e-3 * asked.size if lag else None, "std": 1e-6}

    found = limits.limits(study, ["velocity_filter"], 12, one=one)["effects"]["velocity_filter"]
    assert (found["unit"], found["typical"], found["crlb"]) == ("typical sizes", 1.0, None)
    assert found["own_name"] == 0  # a twin's name it was, each time


def test_trials_count_at_the_size_that_the_truth_can_have():
    assert realised("encoder_quantisation", 0.0158) == 0  # one count is the encoder as it is documented
    assert realised("encoder_quantisation", 0.028) == pytest.approx(2 * 5e-8 / 3e-6)
    assert realised("saturation", 5.0) == pytest.approx(10 / 3) and realised("offset", 5.0) == 5.0


def test_no_size_may_be_asked_that_the_truth_cannot_have(study):
    never = Coin()
    limits.limits(study, ["saturation"], 12, one=lambda asked: {**never(asked), "named": False})
    assert max(asked.size for asked in never.asked) <= 10 / 3


def test_stopped_anywhere_it_ends_with_the_same_trials(tmp_path):
    folders = [seeded(tmp_path / name) for name in ("whole", "stopped")]
    limits.limits(folders[0], ["offset", "backlash"], 10, 2, one=Coin(), threads=2)
    with pytest.raises(KeyboardInterrupt):
        limits.limits(folders[1], ["offset", "backlash"], 10, 2, one=Coin(stop_after=7), threads=2)
    path = folders[1] / "limits" / "offset.jsonl"
    path.write_text(path.read_text() + '{"size": 0.3, "na')  # a line that was being written
    again = Coin()
    limits.limits(folders[1], ["offset", "backlash"], 10, 2, one=again, threads=2)
    whole, stopped = ((f / "limits.json").read_text() for f in folders)
    assert whole == stopped
    assert 0 < len(again.asked) < 28


def test_each_trial_has_a_seed_of_its_own_and_a_refused_size_is_not_asked_again(study):
    def one(asked: Asked) -> dict[str, Any]:
        seeds.append(asked.seed)
        return {"refused": True} if asked.size > 0.9 else {"named": False, "law": "plain", "value": asked.size}

    seeds: list[int] = []
    limits.limits(study, ["backlash"], 16, one=one)
    rows = read_rows(study / "limits" / "backlash.jsonl")
    assert len(set(seeds)) == len(rows) == 16
    refused = [row["size"] for row in rows if row.get("refused")]
    assert refused and refused == sorted(refused, reverse=True) and len(refused) < 6


def test_an_effect_without_a_limit_is_refused(study):
    with pytest.raises(InputError, match="absorbed"):
        limits.limits(study, [ALIAS], one=Coin())
    with pytest.raises(InputError, match="not among the effects"):
        limits.limits(study, ["no_such"], one=Coin())


def test_every_effect_of_the_simulator_has_a_parameter_of_the_catalogue():
    from didim_jax.effects.catalogue import CATALOGUE
    from didim_jax.params import parameters
    from experiments.blind import truth

    assert set(MAIN) == set(truth.EFFECTS) - {ALIAS}
    known = {effect.label(): {p.name for p in parameters(effect())} for effect in CATALOGUE}
    for name, main in MAIN.items():
        assert set(main.of) <= known[name]


def test_sizes_that_are_not_proportional_are_given_as_what_is():
    def of(effect: str, size: float, **parameters: tuple[float, str]) -> Any:
        named = {key: {"value": value, "unit": unit} for key, (value, unit) in parameters.items()}
        return measured(effect, {"parameters": {effect: named}, "sizes": {effect: size}})

    assert of("offset", 0.5, F0=(-1.5, "N")) == (1.5, "N", 1.0)
    assert of("base_flexibility", 1.0, mb=(600.0, "kg")) == (1 / 600, "1/kg", 1.0)
    value, unit, scale = of("saturation", 0.5, u=(4.7, "V"))
    assert (value, unit) == (pytest.approx(0.06), "1") and scale == pytest.approx(0.94 / 4.7)
    assert of("velocity_filter", 1.0, L=(4.0, "1"))[0] is None


def test_the_bound_is_taken_from_a_refit_whether_or_not_the_effect_was_named():
    estimates = {"a": {"value": 1.0, "std": 3.0}, "b": {"value": 0.0, "std": 1.0}}
    refitted = {"parameters": {}, "candidates": [{"effect": "lead_friction", "parameters": estimates}]}
    assert bound("lead_friction", refitted) == pytest.approx(np.sqrt(5))
    assert bound("lead_friction", {"parameters": {"lead_friction": estimates}}) == pytest.approx(np.sqrt(5))
    assert bound("offset", refitted) is None


# ---- digital plants ----

DT, GAIN, KP, KV, LEAD = 1e-3, 35.0, 120.0, 240.0, 0.0025
MASS, FV, OFFSET = 95.0, 200.0, 3.0


@dataclasses.dataclass
class Loop:
    """A mass under the sampled law, its motion exact between samples, in plain numpy."""

    gain: float = GAIN
    kv: float = KV
    mass: float = MASS
    Fv: float = FV
    offset: float = OFFSET
    delay: int = 0

    def run(self, qg: np.ndarray, seen: Any, state: tuple[float, float], before: np.ndarray) -> Any:
        """qm, vir and the state at every sample, from sample 2 on; `before`: qm of two samples and earlier vir."""
        n = len(qg)
        qm, vir, states = np.zeros(n), np.zeros(n), np.zeros((n, 2))
        q, v = state
        decay = np.exp(-self.Fv / self.mass * DT)
        earlier = list(before[2:])
        last = list(before[:2])
        for k in range(n):
            states[k] = q, v
            qm[k] = seen(np.array(q))
            vir[k] = self.kv * (KP * (qg[k] - qm[k]) - (qm[k] - last[-2]) / (2 * DT))
            last.append(qm[k])
            earlier.append(vir[k])
            end = (self.gain * earlier[-1 - self.delay] - self.offset) / self.Fv
            q, v = q + end * DT + (v - end) * (1 - decay) * self.mass / self.Fv, end + (v - end) * decay
        return qm, vir, states


def clean(q: np.ndarray) -> np.ndarray:
    return q


@pytest.fixture(scope="module")
def recorded() -> tuple[real.Record, np.ndarray]:
    """A record that starts in motion, and the true state at every sample."""
    t = DT * np.arange(1500)
    qg = 0.02 * (1 - np.cos(9 * t)) + 0.0004 * np.sin(70 * t)
    qm, vir, states = Loop().run(qg, clean, (0.0, 0.0), np.zeros(2))
    run = real.Record(qg, qm, vir, GAIN, KP, KV, 10.0, DT)
    return run.cut(300), states[300:]


def test_the_law_holds_in_the_record(recorded):
    run, _ = recorded
    np.testing.assert_allclose(run.law()[2:], run.vir[2:], atol=1e-9)


def test_a_relabelled_drive_signal_is_a_lighter_machine(recorded):
    """The same qm to rounding, from M, Fv and the offset divided by 1 + e under the documented gain."""
    run, states = recorded
    e = 0.08
    other = real.relabelled(run, e)
    assert (other.gain, other.kp, other.limit) == (GAIN, KP, pytest.approx(10.0 / (1 + e)))
    lighter = Loop(kv=other.kv, mass=MASS / (1 + e), Fv=FV / (1 + e), offset=OFFSET / (1 + e))
    before = np.concatenate([run.qm[:2], run.vir[:2]])
    qm, vir, _ = lighter.run(other.qg[2:], clean, tuple(states[2]), before)
    np.testing.assert_allclose(qm, other.qm[2:], atol=1e-12)
    np.testing.assert_allclose(vir, other.vir[2:], atol=1e-8)
    np.testing.assert_allclose(other.gain * other.vir / lighter.mass, run.gain * run.vir / MASS, rtol=1e-12)


@pytest.mark.parametrize("d", [1, 2])
def test_a_record_with_its_drive_signal_moved_is_that_of_a_late_drive(recorded, d):
    """A loop with d samples between command and force, under the rebuilt reference, makes this very record."""
    run, states = recorded
    other = real.delayed(run, d)
    at = 2 + d  # of the record: the drive needs the d commands before
    qm, vir, _ = Loop(delay=d).run(
        other.qg[d:], clean, tuple(states[at]), np.concatenate([run.qm[at - 2 : at], other.vir[:d]])
    )
    np.testing.assert_allclose(qm, other.qm[d:], atol=1e-11)
    np.testing.assert_allclose(vir, other.vir[d:], atol=1e-6)
    np.testing.assert_allclose(other.vir, run.vir[2 + d :], atol=0)


@pytest.mark.parametrize("sensor", [real.periodic(2e-6, 0.7, LEAD), real.grid(2e-6)])
def test_a_record_through_another_sensor_is_that_of_a_loop_with_it(recorded, sensor):
    """The controller reads the sensor; the force, and so the true motion, are those of the record."""
    run, states = recorded
    other = real.read_through(run, sensor)
    assert np.abs(other.qm - run.qm[2:]).max() > 0.9e-6
    np.testing.assert_array_equal(other.vir, run.vir[2:])
    if sensor(np.array(1e-6)) != sensor(np.array(1e-6 + 1e-9)):  # rounding may fall on the other side: law alone
        qm, vir, _ = Loop().run(other.qg, sensor, tuple(states[2]), sensor(run.qm[:2]))
        np.testing.assert_allclose(qm, other.qm, atol=1e-11)
        np.testing.assert_allclose(vir, other.vir, atol=1e-6)
    np.testing.assert_allclose(other.law()[2:], other.vir[2:], atol=1e-9)


def test_what_only_the_recorder_saw_breaks_the_law_as_said(recorded):
    run, _ = recorded
    other = real.read_through(run, real.periodic(2e-6, 0.7, LEAD), in_loop=False)
    error = other.qm - run.qm
    expected = KV * (KP * error[2:] + (error[2:] - error[:-2]) / (2 * DT))
    np.testing.assert_allclose((other.vir - other.law())[2:], expected, atol=1e-9)
    np.testing.assert_array_equal(other.vir, run.vir)


def test_a_late_log_breaks_the_law_by_that_lag(recorded):
    run, _ = recorded
    late = real.logged_late(run, 1)
    np.testing.assert_allclose(late.vir[3:], late.law()[2:-1], atol=1e-9)
    assert np.abs((late.vir - late.law())[2:]).max() > 1e-3


def test_pulses_stay_with_the_drive_signal(recorded):
    run, _ = recorded
    pulses = 5.0 * (np.arange(len(run.qm)) % 400 < 200)
    pulsed = dataclasses.replace(run, vir=run.vir + 1.014 * pulses, pulses=pulses, volts=1.014)
    moved = real.delayed(pulsed, 2)
    np.testing.assert_allclose((moved.law() + 1.014 * moved.pulses)[2:], moved.vir[2:], atol=1e-9)


def written(folder: Path, run: real.Record, pulses: np.ndarray | None = None) -> None:
    more = {} if pulses is None else {"pulses_N": pulses.astype(np.uint8)}
    scipy.io.savemat(folder, {**run.variables(), **more}, oned_as="column")


def test_cases_are_in_the_contracts_form_and_answers_can_be_sealed(tmp_path, recorded, monkeypatch):
    from didim_jax.formats import load_recording
    from didim_jax.machine import Machine
    from experiments.blind.seal import seal

    run = dataclasses.replace(recorded[0], gain=35.15065188248547)
    pulses = 5.0 * (np.arange(len(run.qm)) % 400 >= 300)
    written(tmp_path / "DATA_EMPS.mat", run)
    written(tmp_path / "DATA_EMPS_PULSES.mat", dataclasses.replace(run, vir=run.vir + 1.014 * pulses), pulses)
    out = tmp_path / "real"
    real.make(out, tmp_path)
    seal(out, out / "answers")
    names = sorted(path.name for path in (out / "cases").iterdir())
    assert len(names) == 8
    for name in names:
        machine = Machine.load(out / "cases" / name / "machine.toml")
        for file in ("fit", "check"):
            record = load_recording(out / "cases" / name / f"{file}.mat")
            assert record.gain == machine.drive.gain and record.documented["kv"] == machine.controller.kv
        answer = json.loads((out / "answers" / f"{name}.json").read_text())["answer"]
        if answer["rule"] == "pulses":
            assert load_recording(out / "cases" / name / "fit.mat").injected is None
            assert answer["parameters"]["disturbance_pulses"]["A"]["value"] == pytest.approx(5 * 1.014, rel=1e-3)
            assert answer["onsets_s"] == pytest.approx([0.3, 0.7, 1.1])


def test_without_the_records_one_line_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("DIDIM_DATA", str(tmp_path / "nowhere"))
    assert real.real(tmp_path) is None
    assert capsys.readouterr().out.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_from_the_records_to_the_judgement_every_case_sealed_before_it_is_diagnosed(tmp_path, recorded, monkeypatch):
    from experiments.blind import diagnose as diagnosing

    run = dataclasses.replace(recorded[0], gain=35.15065188248547)
    pulses = 5.0 * (np.arange(len(run.qm)) % 400 >= 300)
    (tmp_path / "emps").mkdir()
    written(tmp_path / "emps" / "DATA_EMPS.mat", run)
    written(tmp_path / "emps" / "DATA_EMPS_PULSES.mat", dataclasses.replace(run, vir=run.vir + pulses), pulses)
    monkeypatch.setenv("DIDIM_DATA", str(tmp_path))

    def say_nothing(cases: Path, todo: set[str], out: Path) -> None:
        assert (out.parent / "seals.json").exists()
        for name in todo - {"real-5"}:  # that one fails
            (out / name).mkdir()
            write_json(out / name / "diagnosis.json", found("none", base={"M": {"after": 95.0, "std": 0.1}}))

    monkeypatch.setattr(diagnosing, "_diagnose", say_nothing)
    document = real.real(tmp_path)
    assert document is not None and [row["verdict"] for row in document["cases"]].count("failed") == 1
    assert not any(row["right"] for row in document["cases"])
    assert json.loads((tmp_path / "real.json").read_text()) == document
    steps = [json.loads(line)["step"] for line in (tmp_path / "real" / "ledger.jsonl").read_text().splitlines()]
    assert steps == ["seal", "diagnose", "open"]
    monkeypatch.setattr(diagnosing, "_diagnose", lambda *arguments: pytest.fail("opened already"))
    assert real.real(tmp_path) == document
    real.print_real(document)


def found(verdict: str, *effects: str, **more: Any) -> dict[str, Any]:
    blank = {"ambiguous_with": [], "parameters": {}, "block": "actuator", "gap": {}, "base": {}, "remarks": []}
    return {**blank, "verdict": verdict, "effects": list(effects), **more}


def asked(rule: str, *effects: str, **more: Any) -> dict[str, Any]:
    return {"what": "", "rule": rule, "effects": list(effects), "also": [], "remark": "", "tolerance": 0.1, **more}


def test_a_planted_effect_counts_beside_the_machines_own():
    T = {"parameters": {"time_delay": {"T": {"value": 1e-3, "unit": "s"}}}}
    answer = asked("planted", "asymmetric_viscous", "time_delay", **T)

    def row(value: float, *effects: str, **more: Any) -> dict[str, Any]:
        size = {"time_delay": {"T": {"value": value, "std": 1e-6, "unit": "s"}}}
        return real.judged("r", answer, found("effect", *effects, parameters=size, **more), None)

    assert row(1.05e-3, "stribeck", "time_delay")["right"]
    assert not row(1.2e-3, "stribeck", "time_delay")["right"]  # its size is wrong
    late = found("effect", "time_delay", parameters={"time_delay": {"T": {"value": 1.3e-3, "std": None}}})
    pulsed = found("effect", "amplifier_lag", parameters={"amplifier_lag": {"T": {"value": 0.3e-3}}})
    assert real.judged("r", answer, late, None, real.own_lag(pulsed))["right"]  # on top of the machine's own
    assert not row(1.05e-3, "asymmetric_viscous")["right"]
    assert not real.judged("r", answer, found("effect", "time_delay"), None)["right"]  # and no size of it
    unsure = found("unexplained", "time_delay", parameters={"time_delay": {"T": {"value": 1e-3, "std": None}}})
    assert not real.judged("r", answer, unsure, None)["right"]
    twins = found("ambiguous", "amplifier_lag", ambiguous_with=[["amplifier_lag", "time_delay"]])
    lag = real.judged("r", answer, twins, None)
    assert lag["right"] and lag["parameter"]["T"]["value"] is None
    assert not real.judged("r", answer, found("effect", "amplifier_lag"), None)["right"]
    assert not real.judged("r", answer, None, None)["right"]


def test_an_absorbed_gain_changes_no_answer_but_scales_the_mass():
    M = {"drive_gain": {"M": {"value": 1 / 1.08, "unit": "kg"}}}
    answer = asked("absorbed", "drive_gain", parameters=M, tolerance=0.01)
    plain, lighter = (
        found("effect", "asymmetric_viscous", base={"M": {"after": M, "std": 0.1}}) for M in (95.0, 95.0 / 1.08)
    )
    assert real.judged("r", answer, lighter, plain)["right"]
    assert not real.judged("r", answer, plain, plain)["right"]
    assert not real.judged("r", answer, {**lighter, "effects": ["offset"]}, plain)["right"]


def test_what_was_logged_wrongly_is_said_and_nothing_is_named_for_it():
    answer = asked("logged", "x_late_log", remark="lags the law")
    plain, remarks = found("effect", "stribeck"), ["fit.mat: vir lags the law by 1 sample."]

    def right(*said: str, **more: Any) -> bool:
        return bool(real.judged("r", answer, found(*said, **more), plain)["right"])

    assert right("unexplained", remarks=remarks) and right("effect", "stribeck", remarks=remarks)
    assert not right("unexplained", "time_delay", remarks=remarks)
    assert not right("effect", "stribeck", "time_delay", remarks=remarks)
    assert not right("unexplained")


# ---- calibration ----


def evidence(likely: list[float], names: list[str], gain: float, left: float = 0.01) -> dict[str, Any]:
    step = {"effects": names, "log_likelihood": likely, "parameters": [1.0] * len(names), "before": -1000.0}
    remains = {"followed": 0.1, "bursts": 0.0, "line": 0.0, "line_hz": 50.0, "structured": 0.1, "drift": 0.1}
    quality = remains | {"gain": gain, "left": left, "law_left": 0.0}
    found = names[:1] if gain > 0.15 else []
    return {**quality, "stages": [{"effects": found}] if found else [], "order": found, "steps": [step]}


def case(name: str, truth: list[str], e: dict[str, Any]) -> calibrate.Seen:
    effects = [n for stage in e["stages"] for n in stage["effects"]]
    document = {"effects": effects, "evidence": e, "gap": {"fit": {"after": 0.02}}}
    return calibrate.Seen.of(blank_row(name, {"stratum": "single", "answer": {"effects": truth}}), document)


def tempered(temperature: float, n: int, seed: int = 0) -> list[calibrate.Seen]:
    """Two rivals a case; the better one is true as often as log-likelihoods worth 1 / temperature say."""
    rng, out = np.random.default_rng(seed), []
    for k in range(n):
        gap = rng.uniform(0, 4)  # of the tempered log-likelihoods
        likely = [-1000.0, -1000.0 - gap * temperature]
        right = bool(rng.random() < decide.logistic(gap))
        names = [f"effect_{k % 10}", "rival"]
        out.append(case(f"c{k}", [names[0] if right else names[1]], evidence(likely, names, 0.6)))
    return out


@pytest.mark.parametrize("temperature", [1.0, 5.0])
def test_a_known_temperature_comes_back(temperature):
    cases, before = tempered(temperature, 120), calibrate.present()
    start = {name: before[name] for name in ("TEMPERATURE", "SURE_NONE", "SURE_LEFT", "SURE_ODD")}
    found = calibrate.fitted(cases, calibrate.Prior(start, width=1.0))
    assert found["TEMPERATURE"] == pytest.approx(temperature, rel=0.5)
    assert calibrate.present() == before  # nothing was changed
    now, then = (calibrate.log_score(calibrate.rows(cases, c)) for c in (start, found))
    assert then > now


def test_the_conclusion_is_drawn_from_what_the_file_says_with_the_constants_as_they_are():
    """Ranking and abstention of a diagnosis as it was read."""
    seen = case("c", ["a"], evidence([-1000.0, -1001.0], ["a", "b"], 0.6, left=0.09))
    (judged,) = calibrate.rows([seen], calibrate.present())
    other = decide.other(0.09, 0.1, 0.1, 0.0)
    assert judged.verdict == ("unexplained" if other > 0.5 else "ambiguous")
    none = decide.none(0.6)
    want = decide.probabilities(seen.findings.steps[0], none, other * (1 - none))
    assert judged.ranking == pytest.approx(want)


def test_a_study_is_open_or_given_up(tmp_path):
    for k, seen in enumerate(tempered(12.0, 24)):
        answer = {"case": f"c{k}", "stratum": "single", "answer": {"effects": list(seen.blank.truth)}}
        for name, value in ((f"answers/c{k}.json", answer), (f"diagnoses/c{k}/diagnosis.json", dict(seen.document))):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            write_json(tmp_path / name, value)
        (tmp_path / "cases" / f"c{k}").mkdir(parents=True)
    cases = calibrate.read_cases(tmp_path, False)
    assert len(cases) == 24
    write_json(tmp_path / "seals.json", {})
    for given_up in (False, True):
        with pytest.raises(InputError, match="sealed"):
            calibrate.read_cases(tmp_path, given_up)
    answers = {s.blank.case: {"stratum": "single", "answer": {"effects": list(s.blank.truth)}} for s in cases}
    write_json(tmp_path / "opened.json", answers)
    with pytest.raises(InputError, match="worthless"):
        calibrate.read_cases(tmp_path, False)
    assert len(calibrate.read_cases(tmp_path, True)) == 24


def test_every_case_is_judged_with_constants_of_other_effects(monkeypatch):
    """None of them, nor a twin of one, is in what the constants were fitted on: also not of a case with several."""
    several = [["offset", "stribeck"], ["stribeck", "cogging"], ["time_delay", "x_cogging", "backlash"]]
    twins = [["asymmetric_coulomb"], ["encoder_periodic_error"], ["x_transmission_error"], ["amplifier_lag"], [], []]
    remains = evidence([-1000.0], ["stribeck"], 0.6)
    cases = [case(f"c{k}", truth, remains) for k, truth in enumerate([*several, *twins, ["backlash"], ["offset"]])]
    trained = []
    monkeypatch.setattr(calibrate, "fitted", lambda some, _: trained.append(some) or calibrate.present())
    monkeypatch.setattr(calibrate, "rows", lambda some, c: [(s, trained[-1]) for s in some])
    judged = calibrate.cross_validated(cases, calibrate.NEUTRAL, 4)
    assert sorted(seen.blank.case for seen, _ in judged) == sorted(seen.blank.case for seen in cases)
    for seen, others in judged:
        mine = {name.removeprefix("x_") for name in seen.blank.truth}
        near = mine.union(*(pair for pair in TWINS if mine & pair))
        assert others and seen not in others
        assert not any(near & {name.removeprefix("x_") for name in other.blank.truth} for other in others)


def test_a_study_of_one_effect_leaves_nothing_to_fit_on():
    cases = [case(f"c{k}", ["stribeck"], evidence([-1000.0], ["stribeck"], 0.6)) for k in range(3)]
    assert calibrate.cross_validated(cases, calibrate.NEUTRAL) == calibrate.rows(cases, calibrate.NEUTRAL.center)


def test_a_fit_that_starts_neutral_does_not_remember_what_was_set_by_hand(monkeypatch):
    """It starts at a value of every constant that is fitted, and the present ones have no part in what it finds."""
    assert set(calibrate.NEUTRAL.center) == set(calibrate.present())
    cases = tempered(3.0, 20)
    found = calibrate.fitted(cases, calibrate.NEUTRAL)
    for name, value in calibrate.present().items():
        monkeypatch.setattr(decide, name, 3 * value)
    assert calibrate.fitted(cases, calibrate.NEUTRAL) == found


def test_figures_are_printed(capsys):
    cases = tempered(12.0, 20)
    now = calibrate.figures(calibrate.rows(cases, calibrate.present()))
    document = {"now": calibrate.present(), "suggested": calibrate.present()}
    calibrate.print_calibration(
        {**document, "figures": dict.fromkeys(("now", "cross_validated", "cross_validated_from_now"), now)}
    )
    shown = capsys.readouterr().out
    assert "TEMPERATURE" in shown and calibrate.SEARCHED in shown
