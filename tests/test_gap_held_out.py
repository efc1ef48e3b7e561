"""What is held out stays held out: the check record is predicted first and judged once, and no answer is ever read."""

import ast
import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from gap_machine import path, record

from didim_jax.effects.catalogue import CATALOGUE
from didim_jax.formats import save_recording
from didim_jax.gap import cases
from didim_jax.gap.cases import Case, diagnose_case
from didim_jax.gap.judge import judge
from didim_jax.gap.prepared import Prepared, prepare

PACKAGE = Path(__file__).resolve().parents[1] / "didim_jax"

FEW = "position_gain velocity_gain velocity_filter stribeck offset asymmetric_coulomb payload_change "
FEW += "encoder_periodic_error disturbance_pulses"
CATALOGUE_OF_FEW = tuple(effect for effect in CATALOGUE if effect.label() in FEW.split())


# -- no answer is read -------------------------------------------------------------------------------------------

ANSWERS = r"(?i)dev_?answers|answers?\.(json|toml|ya?ml|csv)|\btruth\.|gap/dev|DIDIM_DATA|/shared/|\.\./"


def strings(source: str) -> list[str]:
    """Every text in a program that is not a docstring; f-strings in pieces."""
    tree = ast.parse(source)
    documentation = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and node.body
        if isinstance(node.body[0], ast.Expr)
    }
    constants = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in documentation)
    return [node.value for node in constants if isinstance(node.value, str)]


def test_nothing_in_the_package_names_a_file_of_answers():
    read = {path: strings(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")}
    assert len(read) > 50
    found = [(path.name, text) for path, texts in read.items() for text in texts if re.search(ANSWERS, text)]
    assert found == []


@pytest.mark.parametrize("text", ["../shared/gap/dev", "dev_answers.json", "answers.json", "/data/shared/x"])
def test_that_search_finds_what_it_looks_for(text):
    assert [t for t in strings(f'"""Say."""\nopen("{text}")') if re.search(ANSWERS, t)]
    assert not [t for t in strings(f'"""Say {text}."""') if re.search(ANSWERS, t)]


def test_the_diagnosis_opens_no_file_but_those_of_the_case():
    """Only `cases` reads anything, and only what its caller names."""
    opening = re.compile(r"\bopen\(|read_text|read_bytes|loadmat|np\.load|load_recording\(|\.load\(|glob\(|iterdir")
    found = {path.name for path in (PACKAGE / "gap").glob("*.py") if opening.search(path.read_text(encoding="utf-8"))}
    assert found == {"cases.py"}


# -- the check record --------------------------------------------------------------------------------------------


@pytest.fixture
def case(tmp_path, emps_like) -> Case:
    """A machine that sticks more near rest than its simulation does, in files."""

    def sticking(q: float, v: float) -> float:
        return 10 * np.tanh(v / 4e-4) / (1 + (v / 0.012) ** 2)

    save_recording(record(emps_like, path(0), rubs=sticking, seed=1), tmp_path / "fit.mat")
    save_recording(record(emps_like, path(1), rubs=sticking, seed=2), tmp_path / "check.mat")
    emps_like.save(tmp_path / "machine.toml")
    return Case("case", (tmp_path / "fit.mat",), tmp_path / "check.mat", tmp_path / "machine.toml")


@pytest.mark.slow
def test_the_prediction_is_on_disk_before_anything_measured_in_the_check_record_is_read(case, tmp_path, monkeypatch):
    out, seen = tmp_path / "out", []
    loadmat, load_recording = scipy.io.loadmat, cases.load_recording

    def watched_loadmat(file, *arguments, **options):
        if Path(file) == case.check:
            predicted = (out / "prediction.json").exists()
            seen.append((options.get("variable_names"), predicted))
        return loadmat(file, *arguments, **options)

    def watched_load(path, **options):
        assert path != case.check or (out / "prediction.json").exists()
        return load_recording(path, **options)

    monkeypatch.setattr(scipy.io, "loadmat", watched_loadmat)
    monkeypatch.setattr(cases, "load_recording", watched_load)
    d = diagnose_case(case, CATALOGUE_OF_FEW, out)

    assert d.effects == ("stribeck",)
    assert [names for names, predicted in seen if not predicted]  # the reference was read before
    for names, predicted in seen:
        assert predicted or (names is not None and set(names) <= {"t", "qg", "pulses_N"})
    assert [names for names, predicted in seen if predicted] == [None]  # and all of it once, afterwards
    told = json.loads((out / "prediction.json").read_text(encoding="utf-8"))
    assert told == {"check": {"predicted_after": d.gap["check"].predicted_after}}


@pytest.mark.slow
def test_what_was_measured_in_the_check_record_changes_nothing_but_its_own_gap(case, tmp_path):
    """The same reference run on another machine: names, sizes, probabilities, prediction, all as before."""
    assert case.check is not None
    d = diagnose_case(case, CATALOGUE_OF_FEW, tmp_path / "one")
    honest = scipy.io.loadmat(case.check)
    channels = {name: honest[name] for name in ("t", "qg", "gtau", "kp", "kv", "qm", "vir")}
    shift = 1e-4 * np.sin(np.arange(len(channels["qg"])) / 40)[:, None]
    scipy.io.savemat(case.check, channels | {"qm": channels["qm"] + shift, "vir": 0.8 * channels["vir"]})
    other = diagnose_case(case, CATALOGUE_OF_FEW, tmp_path / "other")
    for name in ("verdict", "effects", "ambiguous_with", "ranking", "parameters", "base", "block", "last_in", "where"):
        assert getattr(other, name) == getattr(d, name), name
    assert other.gap["fit"] == d.gap["fit"]
    assert other.gap["check"].predicted_after == d.gap["check"].predicted_after
    assert other.gap["check"].after > 2 * d.gap["check"].after


# -- what may move on the check record ---------------------------------------------------------------------------

RMS = {"force": 0.5}  # N, what the fit left
DRIVE = {"M": 95.0, "Fv": 200.0, "Fc": 20.0, "v_eps": 1e-3}


@pytest.fixture(scope="module")
def checked(emps_like) -> Prepared:
    return prepare(record(emps_like, path(1), seed=2), emps_like, CATALOGUE_OF_FEW)


def as_if(checked: Prepared, values: dict[str, float]) -> Prepared:
    """The check record with the force that its model gives at these values."""
    out = checked.model.run(checked.model.encode(np.zeros(len(checked.model.entries)), values))
    channels = tuple(dataclasses.replace(c, observed=checked.filtered(out, c)) for c in checked.channels)
    return dataclasses.replace(checked, channels=channels)


def changed(checked: Prepared, before: np.ndarray, after: np.ndarray) -> set[str]:
    return {
        name
        for name, a, b in zip(checked.model.names, before, after, strict=True)
        if a != b and not name.startswith("start.")
    }


def adopted(checked: Prepared, *names: str):
    return [e for e in checked.model.effects if e.label() in names]


@pytest.mark.slow
def test_sizes_stay_and_only_the_start_moves(checked):
    """Also where other sizes would fit far better: the machine of the check record has twice the offset."""
    sizes = DRIVE | {"offset.F0": 3.0, "asymmetric_coulomb.dFc": 1.0}
    second = as_if(checked, sizes | {"offset.F0": 6.0, "start.v1": 1e-3})
    x = second.model.encode(np.zeros(len(second.model.entries)), sizes)
    judged = judge(second, x, adopted(second, "offset", "asymmetric_coulomb"), RMS)
    assert changed(second, x, judged.x) == set() and judged.moved == {}
    np.testing.assert_array_equal(judged.outputs, second.model.run(judged.x))


@pytest.mark.slow
def test_a_clock_may_be_another_one_and_its_effect_keeps_its_size(checked):
    sizes = DRIVE | {"payload_change.dm": 8.0, "payload_change.t0": 1.0}
    second = as_if(checked, sizes | {"payload_change.dm": 10.0, "payload_change.t0": 1.35})
    x = second.model.encode(np.zeros(len(second.model.entries)), sizes)
    judged = judge(second, x, adopted(second, "payload_change"), RMS)
    assert changed(second, x, judged.x) == {"payload_change.t0"}
    assert judged.moved == {"payload_change.t0": pytest.approx(1.35, abs=0.05)}


@pytest.mark.slow
@pytest.mark.parametrize("come_again", [True, False])
def test_pulses_may_not_come_again_but_cannot_be_others(checked, come_again):
    pulses = {"A": 30.0, "t0": 1.0, "width": 0.05, "period": 1000.0, "n": 0.0}
    sizes = DRIVE | {f"disturbance_pulses.{k}": v for k, v in pulses.items()}
    second = as_if(checked, sizes | {"disturbance_pulses.A": 40.0 * come_again, "disturbance_pulses.t0": 1.2})
    x = second.model.encode(np.zeros(len(second.model.entries)), sizes)
    judged = judge(second, x, adopted(second, "disturbance_pulses"), RMS)
    values = second.model.decode(judged.x)
    assert changed(second, x, judged.x) <= {"disturbance_pulses.t0", "disturbance_pulses.A"}
    assert values["disturbance_pulses.A"] == pytest.approx(30.0 * come_again)
    if come_again:
        assert judged.moved == {"disturbance_pulses.t0": pytest.approx(1.2, abs=0.02)}
    else:
        assert judged.moved["disturbance_pulses.A"] == 0.0


@pytest.mark.slow
def test_an_encoder_s_phase_may_be_lost_and_its_error_keeps_its_size(checked):
    size = "encoder_periodic_error.a", "encoder_periodic_error.b"
    sizes = DRIVE | dict(zip(size, (2e-6, 0.0), strict=True))
    second = as_if(checked, DRIVE | dict(zip(size, (0.0, 3e-6), strict=True)))
    x = second.model.encode(np.zeros(len(second.model.entries)), sizes)
    judged = judge(second, x, adopted(second, "encoder_periodic_error"), RMS)
    a, b = (second.model.decode(judged.x)[name] for name in size)
    assert changed(second, x, judged.x) == set(size)
    assert np.hypot(a, b) == pytest.approx(2e-6, rel=1e-9)
    assert b > 1.9e-6 and set(judged.moved) == {"encoder_periodic_error.phase"}
