"""The rivals of the diagnosis name what they can know, name nothing on a nominal drive, and see no check record.

An ablation removes one ingredient for as long as it lasts, and DIDIM's columns are those of the inverse model.
"""

import dataclasses
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from gap_machine import path, record

from didim_jax.effects.actuator import Cogging
from didim_jax.effects.coupling import CouplingDamping
from didim_jax.effects.environment import Offset
from didim_jax.formats import save_recording
from didim_jax.gap import diagnose, hunt, search
from didim_jax.gap.prepared import Prepared, prepare
from didim_jax.gap.search import Searcher
from didim_jax.machine import Machine
from didim_jax.recording import Recording
from experiments.blind.ablations import ABLATIONS, along_fixed_motion, only
from experiments.blind.baselines import correlation, friction_ladder, lasso, run, score_only, sparse_regression
from experiments.blind.baselines.answer import Answer, weigh
from experiments.blind.baselines.closed_loop import closed_loop
from experiments.blind.baselines.inverse import inverse

REGRESSIONS = (friction_ladder, sparse_regression, lasso)
TWIN = Path(__file__).resolve().parents[1] / "configs" / "twin" / "machine.toml"


def pulled_by_magnets(q: float, v: float) -> float:
    """4 N once per turn of the screw."""
    return 4 * math.sin(2 * math.pi * q / 0.0025 + 0.3)


@pytest.fixture(scope="module")
def nominal(emps_like: Machine) -> Recording:
    return record(emps_like, path())


@pytest.fixture(scope="module")
def tilted(emps_like: Machine) -> Recording:
    return record(emps_like, path(), rubs=lambda q, v: 4.0)


@pytest.fixture(scope="module")
def cogging(emps_like: Machine) -> Recording:
    return record(emps_like, path(), rubs=pulled_by_magnets)


def sound(answer: Answer) -> Answer:
    """The answer, its ranking checked."""
    assert sum(answer.ranking.values()) == pytest.approx(1)
    assert min(answer.ranking.values()) >= 0
    assert "none" in answer.ranking
    assert next(iter(answer.ranking)) == (answer.effects[0] if answer.effects else "none")
    return answer


# -- on the inverse model ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("rival", REGRESSIONS, ids=lambda rival: rival.__name__.split(".")[-1])
def test_nothing_is_named_on_a_nominal_drive(rival, nominal: Recording, emps_like: Machine):
    assert sound(rival.answer(nominal, emps_like)).effects == ()


@pytest.mark.parametrize("rival", REGRESSIONS, ids=lambda rival: rival.__name__.split(".")[-1])
def test_an_offset_is_named(rival, tilted: Recording, emps_like: Machine):
    assert sound(rival.answer(tilted, emps_like)).effects == ("offset",)


@pytest.mark.parametrize("rival", (sparse_regression, lasso), ids=lambda rival: rival.__name__.split(".")[-1])
def test_cogging_is_named_by_those_that_know_it(rival, cogging: Recording, emps_like: Machine):
    assert sound(rival.answer(cogging, emps_like)).effects == ("cogging",)


def test_a_ladder_of_friction_cannot_name_cogging(cogging: Recording, emps_like: Machine):
    assert "cogging" not in sound(friction_ladder.answer(cogging, emps_like)).ranking


def test_two_effects_are_found_one_after_the_other(emps_like: Machine):
    both = record(emps_like, path(), rubs=lambda q, v: 4.0 + pulled_by_magnets(q, v))
    assert sorted(sound(sparse_regression.answer(both, emps_like)).effects) == ["cogging", "offset"]


@pytest.mark.parametrize("rival", (sparse_regression, lasso), ids=lambda rival: rival.__name__.split(".")[-1])
def test_a_gain_is_read_off_the_control_law(rival, emps_like: Machine):
    law = emps_like.controller
    other = dataclasses.replace(emps_like, controller=dataclasses.replace(law, kp=1.05 * law.kp))
    assert sound(rival.answer(record(other, path()), emps_like)).effects == ("position_gain",)


def test_the_flexible_drive_is_as_linear_as_the_rigid_one(emps_like: Machine):
    machine = dataclasses.replace(emps_like, model="flexible")
    x = inverse(record(machine, path()), machine)
    # 60 and 35 kg on 7e5 N/m; the path goes to 8 Hz, the load's resonance is at 22.5
    np.testing.assert_allclose([x.M1, x.M2, x.f_n], [60, 35, math.sqrt(7e5 / 35) / (2 * math.pi)], rtol=0.05)
    assert friction_ladder.answer(x.recording, machine, fitted=x).effects == ()
    tilted = record(machine, path(), rubs=lambda q, v: 4.0)
    assert friction_ladder.answer(tilted, machine).effects == ("offset",)


def test_the_least_left_weighs_most_and_none_takes_what_is_too_little():
    assert weigh({"a": 0.5, "b": 0.6}, n=100, none=0.2).effects == ("a",)
    assert weigh({"a": 0.9, "b": 0.95}, n=100, none=0.2).effects == ()
    assert weigh({"a": 0.5, "b": 0.6}, n=100, none=0.2, penalty={"a": 20.0}).effects == ("b",)
    assert sound(weigh({"a": 0.0}, n=1e6)).ranking["a"] == 1


# -- on the closed loop ------------------------------------------------------------------------------------------


def test_correlation_and_score_name_cogging_among_two(cogging: Recording, emps_like: Machine):
    loop = closed_loop(cogging, emps_like, (Cogging, Offset))
    for rival in (correlation, score_only):
        found = sound(rival.answer(cogging, emps_like, nominal=loop))
        assert found.effects == ("cogging",)
        assert set(found.ranking) == {"cogging", "offset", "none"}


# -- on a folder of cases ----------------------------------------------------------------------------------------


@pytest.fixture
def cases(tmp_path: Path, twin_machine: Machine) -> Path:
    """Two cases, of which the second's record is damaged; what stands for a check record cannot be read."""
    for name in ("case-1", "case-2"):
        folder = tmp_path / "cases" / name
        folder.mkdir(parents=True)
        shutil.copy(TWIN, folder / "machine.toml")
        (folder / "check.mat").write_text("nobody may open this")
    save_recording(record(twin_machine, path(), rubs=lambda q, v: 4.0), tmp_path / "cases" / "case-1" / "fit.mat")
    (tmp_path / "cases" / "case-2" / "fit.mat").write_text("not a record")
    return tmp_path / "cases"


def test_every_case_is_answered_and_none_twice(cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    opened = []
    load = run.load_recording
    monkeypatch.setattr(run, "load_recording", lambda p, **named: opened.append(p.name) or load(p, **named))
    run.answer_all(cases, tmp_path / "out", only=run.REGRESSIONS)
    assert set(opened) == {"fit.mat"}
    written = json.loads((tmp_path / "out" / "baselines.json").read_text())
    assert set(written) == set(run.REGRESSIONS)
    for answers in written.values():
        # the first one: what sparse regression may add to it on three seconds of motion is not what is tested here
        assert answers["case-1"]["effects"][0] == "offset"
        assert sum(answers["case-1"]["ranking"].values()) == pytest.approx(1)
        assert answers["case-1"]["seconds"] > 0
        assert "not a MATLAB" in answers["case-2"]["error"]

    opened.clear()  # what failed is tried again, what is answered is not
    (cases / "case-1" / "fit.mat").unlink()
    shutil.rmtree(cases / "case-2")
    assert run.answer_all(cases, tmp_path / "out", only=run.REGRESSIONS) == written
    assert opened == []


# -- ablations ---------------------------------------------------------------------------------------------------


def test_an_ablation_puts_everything_back():
    places = [
        (search, "score"),
        (Searcher, "base"),
        (Searcher, "_sharpened"),
        (Searcher, "weigh_by_noise"),
        (Prepared, "whitening"),
        (diagnose, "read_off"),
        (diagnose, "CONTROLLER"),
        (diagnose, "prepare"),
        (hunt, "_gains_elsewhere"),
    ]
    before = [vars(owner)[name] for owner, name in places]
    for name, ingredients in ABLATIONS.items():
        with pytest.raises(KeyError), only(ingredients):
            changed = [vars(owner)[key] is not old for (owner, key), old in zip(places, before, strict=True)]
            assert any(changed) == (name != "complete")
            raise KeyError
        assert all(vars(owner)[key] is old for (owner, key), old in zip(places, before, strict=True))


def test_didim_columns_are_those_of_the_inverse_model(nominal: Recording, emps_like: Machine):
    p = prepare(nominal, emps_like, (Cogging, Offset))  # the loop of the test above: nothing compiles twice
    model = p.model
    x = model.encode(np.zeros(len(model.entries)), {"M": 95.0, "Fv": 200.0, "Fc": 20.0, "v_eps": 4e-4})
    chosen = [model.index[name] for name in ("Fv", "Fc", "offset.F0")]
    value, exact = model.columns(x, chosen)
    v = np.gradient(nominal.qm, model.dt)
    expected = [v, np.tanh(v / 4e-4), np.ones_like(v)]
    for column, own in zip(along_fixed_motion(p, x, chosen, value, exact), expected, strict=True):
        a, b = p.filtered(column, p.channels[0]), p.decimation(own)
        # 1 N of noise in the recorded motion, along which `expected` is, and the motion changing within a sample
        assert a @ b > 0.999 * np.linalg.norm(a) * np.linalg.norm(b)


def test_didim_columns_of_a_flexible_drive_are_those_of_its_transfer_functions(emps_like: Machine):
    """Along a fixed motor motion q1: p^2 q1 and p q1 for the motor side, G^2 p^2 q1 for M2, (1 - G)^2 q1 for K12."""
    machine = dataclasses.replace(emps_like, model="flexible")
    run = record(machine, path())
    p = prepare(run, machine, (CouplingDamping,))
    K, M2, Fv2, C = 7e5, 35.0, 10.0, 2000.0  # damped: what the record begins with is soon forgotten
    size = {"M1": 60.0, "Fv1": 200.0, "Fc1": 20.0, "M2": M2, "Fv2": Fv2, "Fc2": 0.0, "K12": K, "v_eps": 4e-4}
    x = p.model.encode(np.zeros(len(p.model.entries)), {**size, "coupling_damping.C": C})
    names = ("M1", "Fv1", "M2", "K12")
    chosen = [p.model.index[name] for name in names]
    value, exact = p.model.columns(x, chosen)
    found = along_fixed_motion(p, x, chosen, value, exact)
    law, q = machine.controller, np.full(len(run) + 2, run.qg[0])
    for k, tau in enumerate(value[0]):  # the simulated motion, of which the control law made this force
        ahead = law.kp * run.qg[k] - tau / (machine.drive.gain * law.kv)
        q[k + 2] = (ahead + q[k] / (2 * run.dt)) / (law.kp + 1 / (2 * run.dt))
    q = q[2:]
    v = np.gradient(q, run.dt)
    a, whole = np.gradient(v, run.dt), [M2, C + Fv2, K]
    behind, slip = ([C, K], whole), ([M2, Fv2, 0.0], whole)

    def twice(transfer: tuple[list[float], list[float]], signal: np.ndarray) -> np.ndarray:
        for _ in range(2):
            signal = scipy.signal.lsim(transfer, signal, run.t - run.t[0])[1]
        return signal

    expected = {"M1": a, "Fv1": v, "M2": twice(behind, a), "K12": twice(slip, q - q[0])}
    late = slice(len(p.decimation(v)) // 3, None)
    for name, place, column, plain in zip(names, chosen, found, exact, strict=True):
        unit = 1e-6 * np.eye(len(x))[place]
        per_step = (p.model.decode(x + unit)[name] - p.model.decode(x - unit)[name]) / 2e-6
        own = per_step * p.decimation(expected[name])[late]

        def apart(y: np.ndarray, own: np.ndarray = own) -> float:
            """Share of the inverse model's column that is missing in this one."""
            return float(np.linalg.norm(p.filtered(y, p.channels[0])[late] - own) / np.linalg.norm(own))

        assert apart(column) < min(0.1, 0.5 * apart(plain)), (name, apart(column), apart(plain))
