"""`didim diagnose` refuses what it cannot use in one line, leaves a whole folder or none, and knows a user's effects.

One bad case among many does not stop the others.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import numpy as np
import pytest
import scipy.io
from gap_machine import path, record

from didim_jax import cli
from didim_jax.effects import catalogue
from didim_jax.errors import InputError
from didim_jax.formats import load_recording, save_recording
from didim_jax.gap.cases import cases_in
from didim_jax.machine import Machine
from didim_jax.recording import Recording
from didim_jax.report import many

WHOLE = catalogue.CATALOGUE
FEW = "position_gain velocity_gain velocity_filter amplifier_dead_zone cogging offset cable_spring local_friction"
FILES = {"diagnosis.json", "simulation.npz", "report.html", "prediction.json"}

OWN = '''"""What my machine has at the end of its stroke."""

import jax.numpy as jnp

import didim_jax as dj


class Bumper(dj.AbstractEffect):
    """A rubber stop: -k (q - q0) beyond q0; null k = 0."""

    block = dj.Block.ENVIRONMENT
    name = "bumper"
    equation = "-k max(q - q0, 0)"
    k: float = dj.param("N/m", scale=300.0, default=0.0)
    q0: float = dj.param("m", scale=0.01, default=0.06)

    def __call__(self, t, x, signals):
        return -self.k * jnp.maximum(signals.q2 - self.q0, 0.0), x
'''


def stop(q: float, v: float) -> float:
    """10 N at the end of the stroke, stiffer the further in."""
    return 2500.0 * max(q - 0.05, 0.0) ** 1.5


class Desk:
    """A folder with two records of a machine, its file, and the command, run in this process."""

    def __init__(self, folder: Path, machine: Machine, records: dict[str, Recording], capsys, monkeypatch):
        self.folder, self._capsys, self._monkeypatch = folder, capsys, monkeypatch
        machine.save(folder / "machine.toml")
        for name, made in records.items():
            save_recording(made, folder / name)

    def write(self, name: str, text: str) -> str:
        (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (self.folder / name).write_text(text)
        return name

    def edited(self, old: str, new: str, name: str = "bad.toml") -> str:
        text = (self.folder / "machine.toml").read_text()
        assert text.count(old) == 1
        return self.write(name, text.replace(old, new))

    def case(self, name: str, machine: str = "machine.toml", check: bool = True) -> None:
        folder = self.folder / "cases" / name
        folder.mkdir(parents=True)
        for there, here in {"fit.mat": "fit.mat", "check.mat": "check.mat", "machine.toml": machine}.items():
            if check or there != "check.mat":
                (folder / there).write_bytes((self.folder / here).read_bytes())

    def files(self) -> dict[str, bytes | None]:
        """Every file and folder of the desk, hidden ones too."""
        found = sorted(self.folder.rglob("*"))
        return {str(p): p.read_bytes() if p.is_file() else None for p in found}

    def diagnose(self, *arguments: str) -> tuple[int, str, str]:
        return self.run("diagnose", *arguments)

    def run(self, *arguments: str) -> tuple[int, str, str]:
        """Status, standard output and standard error of `didim ...`."""
        self._monkeypatch.setattr(sys, "argv", ["didim", *arguments])
        self._capsys.readouterr()
        status: object = 0
        try:
            cli.main()
        except SystemExit as end:
            status = end.code
        said = self._capsys.readouterr()
        assert isinstance(status, int), status
        return status, said.out, said.err


@pytest.fixture(scope="module")
def records(emps_like) -> dict[str, Recording]:
    return {
        name: record(emps_like, path(number), rubs=stop, seed=number)
        for number, name in enumerate(("fit.mat", "check.mat"))
    }


@pytest.fixture
def desk(tmp_path, emps_like, records, capsys, monkeypatch) -> Iterator[Desk]:
    jax.devices()  # those there are: the command would ask for one a core, and every test after it would have them
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    monkeypatch.chdir(tmp_path)
    few = tuple(effect for effect in catalogue.CATALOGUE if effect.label() in FEW.split())
    monkeypatch.setattr(catalogue, "CATALOGUE", few)  # compiles in a third of the time
    yield Desk(tmp_path, emps_like, records, capsys, monkeypatch)


@pytest.fixture
def idle(monkeypatch):
    """Nothing may be simulated."""

    def begun(*_, **__):
        raise AssertionError("a diagnosis was begun")

    monkeypatch.setattr("didim_jax.gap.diagnose.prepare", begun)


# -- refused -----------------------------------------------------------------------------------------------------


def spoilt(desk: Desk, **changes: np.ndarray | None) -> str:
    good = load_recording(desk.folder / "fit.mat")
    variables = {**good.channels, "gtau": good.gain, **good.documented} | changes
    np.savez(desk.folder / "bad.npz", **{name: value for name, value in variables.items() if value is not None})
    return "bad.npz"


def empty(desk: Desk) -> str:
    (desk.folder / "nothing").mkdir()
    return "nothing"


FIT = ("fit.mat", "--machine", "machine.toml", "--out", "out")

BAD: dict[str, tuple[Callable[[Desk], tuple[str, ...]], tuple[str, ...]]] = {
    "nothing at all": (lambda d: (), ("--out",)),
    "no folder": (lambda d: FIT[:-2], ("--out",)),
    "no record and no cases": (lambda d: ("--out", "out"), ("record", "--machine", "--cases")),
    "no record": (lambda d: ("--machine", "machine.toml", "--out", "out"), ("record", "--cases")),
    "no machine": (lambda d: ("fit.mat", "--out", "out"), ("--machine",)),
    "unknown option": (lambda d: (*FIT, "--excluded", "offset"), ("--excluded",)),
    "misspelt effect": (
        lambda d: (*FIT, "--exclude", "ofset"),
        ("--exclude ofset", "no such effect", "did you mean offset?"),
    ),
    "unknown effect": (
        lambda d: (*FIT, "--exclude", "bogus"),
        ("--exclude bogus", "no such effect", "known are", "cogging, local_friction, offset"),
    ),
    "no process": (lambda d: ("--cases", "cases", "--out", "out", "--workers", "0"), ("--workers", "1 or more")),
    "processes for one": (lambda d: (*FIT, "--workers", "2"), ("--workers", "--cases")),
    "cases and a record": (lambda d: ("fit.mat", "--cases", "cases", "--out", "out"), ("--cases", "no others")),
    "no folder of cases": (lambda d: ("--cases", "nowhere", "--out", "out"), ("nowhere", "no such folder")),
    "folder without a case": (lambda d: ("--cases", empty(d), "--out", "out"), ("nothing", "no case", "fit.mat")),
    "missing record": (lambda d: ("nowhere.mat", *FIT[1:]), ("nowhere.mat", "no such file")),
    "missing second record": (lambda d: ("fit.mat", "nowhere.mat", *FIT[1:]), ("nowhere.mat", "no such file")),
    "missing machine": (
        lambda d: ("fit.mat", "--machine", "nowhere.toml", "--out", "out"),
        ("nowhere.toml", "no such file"),
    ),
    "missing check": (lambda d: (*FIT, "--check", "nowhere.mat"), ("nowhere.mat", "no such file")),
    "check without a reference": (
        lambda d: (*FIT, "--check", spoilt(d, qg=None)),
        ("bad.npz", "qg is missing"),
    ),
    "check at another rate": (
        lambda d: (*FIT, "--check", spoilt(d, t=2 * load_recording("check.mat").t)),
        ("bad.npz", "step of t", "0.002 s"),
    ),
    "check that is too short": (
        lambda d: (*FIT, "--check", spoilt(d, **{k: v[:500] for k, v in load_recording("check.mat").channels.items()})),
        ("bad.npz", "500 samples", "at least 1000"),
    ),
    "check that is the record itself": (lambda d: (*FIT, "--check", "fit.mat"), ("fit.mat", "another trajectory")),
    "record twice": (lambda d: ("fit.mat", *FIT), ("fit.mat", "same run")),
    "unknown key": (
        lambda d: ("fit.mat", "--machine", d.edited("gain =", "gane ="), "--out", "out"),
        ("bad.toml", "gane"),
    ),
    "negative gain": (
        lambda d: ("fit.mat", "--machine", d.edited("35.15", "-35.15"), "--out", "out"),
        ("bad.toml", "'drive.gain'", "-35.15"),
    ),
    "another kp": (
        lambda d: ("fit.mat", "--machine", d.edited("160.18", "170.0"), "--out", "out"),
        ("fit.mat", "160.18", "170", "kp"),
    ),
    "another kv": (
        lambda d: ("fit.mat", "--machine", d.edited("243.45", "200.0"), "--out", "out"),
        ("fit.mat", "243.45", "200", "kv"),
    ),
    "another drive gain": (
        lambda d: ("fit.mat", "--machine", d.edited("35.15", "36.0"), "--out", "out"),
        ("fit.mat", "35.15 N/V in the record", "36 N/V"),
    ),
    "record in millimetres": (
        lambda d: (spoilt(d, qm=1e3 * load_recording("fit.mat").qm), *FIT[1:]),
        ("bad.npz", "qm", "millimetres"),
    ),
    "missing file of effects": (lambda d: (*FIT, "--effects", "nowhere.py"), ("nowhere.py", "no such file")),
    "file of effects without one": (lambda d: (*FIT, "--effects", d.write("my.py", "x = 1\n")), ("my.py", "no effect")),
    "effect that is not null": (
        lambda d: (*FIT, "--effects", d.write("my.py", OWN.replace("=300.0, default=0.0", "=300.0, default=9.0"))),
        ("my.py", "Bumper", "at its defaults"),
    ),
    "file in the place of the folder": (lambda d: (*FIT[:-1], d.write("file", "")), ("file", "is a file")),
}


@pytest.mark.parametrize(("make", "words"), BAD.values(), ids=BAD)
def test_what_cannot_be_diagnosed_is_refused_before_anything_is_simulated(desk, idle, make, words):
    arguments = make(desk)
    before = desk.files()
    status, out, err = desk.diagnose(*arguments)
    assert (status, out) == (2, ""), err
    assert err.startswith("didim: ") and len(err.splitlines()) == 1 and "Traceback" not in err
    assert [word for word in words if word not in err] == [], err
    assert desk.files() == before


def test_help_names_what_comes_out_and_every_option(desk):
    status, out, err = desk.diagnose("--help")
    assert (status, err) == (0, "")
    options = ("--machine", "--check", "--cases", "--exclude", "--effects", "diagnosis.json", "report.html")
    assert [word for word in options if word not in out] == []


# -- written -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_an_effect_from_a_file_of_one_s_own_is_found_by_its_name(desk):
    """The record has a rubber stop; no effect of the catalogue is one, and the user's has another law than it."""
    own = desk.write("my_effects.py", OWN)
    status, out, err = desk.diagnose(*FIT, "--check", "check.mat", "--effects", own)
    assert status == 0 and "Traceback" not in err
    assert "SYNTHETIC" in out and "bumper" in out and "report.html" in out.replace("\n", "")
    assert {p.name for p in Path("out").iterdir()} == FILES
    told = json.loads(Path("out/diagnosis.json").read_text(encoding="utf-8"))
    assert (told["verdict"], told["effects"], told["block"]) == ("effect", ["bumper"], "environment")
    assert set(told["parameters"]["bumper"]) == {"k", "q0"}
    assert told["gap"]["check"]["after"] < 0.5 * told["gap"]["check"]["before"]
    assert told["synthetic"] is True
    predicted = json.loads(Path("out/prediction.json").read_text(encoding="utf-8"))
    assert predicted["check"]["predicted_after"] == told["gap"]["check"]["predicted_after"]
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "bumper" in page and "SYNTHETIC" in page.upper()
    assert told["evidence"]["looked_for"][-1] == "bumper" and "Looked for, 9 effects" in page
    with np.load("out/simulation.npz") as signals:
        names = {f"{r}_{signal}" for r in ("fit", "check") for signal in ("t", "tau", "tau_before", "tau_after")}
        assert set(signals) == names
        fit = load_recording("fit.mat")
        np.testing.assert_allclose(signals["fit_tau"], fit.vir * fit.gain, rtol=1e-12)

    # Left out by its name, it is not there: what remains is no effect of this catalogue, and that is said.
    assert desk.diagnose(*FIT[:-1], "without", "--effects", own, "--exclude", "bumper")[0] == 0
    without = json.loads(Path("without/diagnosis.json").read_text(encoding="utf-8"))
    assert "bumper" not in json.dumps(without["ranking"]) and "bumper" not in without["effects"]
    assert set(without["gap"]) == {"fit"}


@pytest.mark.slow
def test_one_bad_case_does_not_stop_the_others(desk, monkeypatch):
    desk.case("case-001")
    desk.case("case-002", machine=desk.edited("160.18", "170.0"))
    desk.case("case-003", check=False)
    desk.write("cases/notes/readme.txt", "not a case")
    desk.write("out/case-003/error.txt", "of an earlier run\n")
    # Processes of their own know the whole catalogue: most of it is left out, or it would compile for minutes.
    monkeypatch.setattr(catalogue, "CATALOGUE", WHOLE)
    others = sorted({effect.label() for effect in WHOLE} - set(FEW.split()))
    status, _, err = desk.diagnose("--cases", "cases", "--out", "out", "--workers", "1", "--exclude", *others)
    assert status == 1 and "Traceback" not in err
    assert "1 of 3 cases could not be used: case-002" in err.splitlines()[-1]
    assert {p.name for p in Path("out").iterdir()} == {"case-001", "case-002", "case-003"}
    assert [p.name for p in Path("out/case-002").iterdir()] == ["error.txt"]
    (line,) = Path("out/case-002/error.txt").read_text(encoding="utf-8").splitlines()
    assert "kp" in line and "170" in line
    assert {p.name for p in Path("out/case-001").iterdir()} == FILES
    assert {p.name for p in Path("out/case-003").iterdir()} == FILES - {"prediction.json"}
    for name in ("case-001", "case-003"):
        told = json.loads(Path(f"out/{name}/diagnosis.json").read_text(encoding="utf-8"))
        assert told["schema"] == 1 and ("check" in told["gap"]) == (name == "case-001")


@pytest.mark.parametrize("by_name", [False, True], ids=["of every case", "by name"])
def test_effects_are_left_out_of_every_case_or_of_one(desk, monkeypatch, by_name):
    desk.case("case-001")
    desk.case("case-002")
    seen, said = {}, {}

    def nothing(case, effects, out, *, exclude):
        seen[case.name] = tuple(exclude)
        raise InputError(f"{case.name}: nothing in it")

    monkeypatch.setattr(many, "diagnose_case", nothing)
    left_out = {"case-001": ("offset",), "case-002": ()} if by_name else ("offset",)
    cases = cases_in(Path("cases"))
    bad = many.diagnose_cases(
        cases, Path("out"), exclude=left_out, workers=1, done=lambda case, line: said.update({case.name: line})
    )
    assert bad == ["case-001", "case-002"]
    assert seen == {"case-001": ("offset",), "case-002": () if by_name else ("offset",)}
    assert said["case-002"] == "unusable: case-002: nothing in it"


def test_a_case_that_kills_its_process_is_bad_and_the_others_go_on(desk):
    """Here by a user's effects, which end the process that reads them for the first case; else for want of memory."""
    desk.case("case-001")
    desk.case("case-002", machine=desk.edited("160.18", "170.0"))
    left_out = {"case-001": ("deadly",), "case-002": ("harmless",)}
    desk.write(
        "deadly.py",
        "import inspect, os\n"
        "frames = [f.frame.f_locals.get('exclude') for f in inspect.stack()]\n"
        "if ('deadly',) in frames:\n    os._exit(9)\n"
        "import didim_jax as dj\n"
        "class Nothing(dj.AbstractEffect):\n"
        "    block = dj.Block.ENVIRONMENT\n    name = 'nothing'\n    k: float = dj.param('N', scale=1.0, default=0.0)\n"
        "    def __call__(self, t, x, signals):\n        return self.k * signals.q1, x\n",
    )
    said = {}
    bad = many.diagnose_cases(
        cases_in(Path("cases")),
        Path("out"),
        exclude=left_out,
        effects=Path("deadly.py"),
        workers=2,
        done=lambda case, line: said.update({case.name: line}),
    )
    assert bad == ["case-001", "case-002"]
    assert "killed" in said["case-001"] and "killed" in Path("out/case-001/error.txt").read_text(encoding="utf-8")
    assert "170" in said["case-002"]  # its own fault, told by a process of its own


@pytest.mark.slow
def test_what_didim_simulate_writes_can_be_diagnosed(desk):
    """A rigid drive has both encoders on one mass: ql is qm, and says nothing."""
    desk.write("plant.toml", 'model = "rigid"\n[parameters]\nM = 95.0\nFv = 200.0\nFc = 20.0\n')
    desk.write(
        "reference.toml",
        "start = 0.0\n[limits]\nstroke = [-0.1, 0.2]\nspeed = 0.3\nacceleration = 9.0\n"
        '[[segment]]\nkind = "trapezoid"\ndistance = 0.1\nspeed = 0.15\nacceleration = 1.5\n',
    )
    made = ("--plant", "plant.toml", "--reference", "reference.toml", "--out", "made.mat", "--noise", "1")
    assert desk.run("simulate", "--machine", "machine.toml", *made)[0] == 0
    assert desk.diagnose("made.mat", *FIT[1:])[0] == 0
    assert json.loads(Path("out/diagnosis.json").read_text(encoding="utf-8"))["verdict"] == "none"


@pytest.mark.slow
def test_a_force_that_no_drive_explains_is_no_fault_of_the_program(desk):
    """vir is noise: either there is a verdict, which names nothing, or one line says what is wrong."""
    n = len(load_recording("fit.mat"))
    noise = spoilt(desk, vir=np.random.default_rng(0).normal(size=n), kp=None, kv=None)
    status, _, err = desk.diagnose(noise, *FIT[1:])
    assert status in (0, 2) and "Traceback" not in err
    if status == 0:
        told = json.loads(Path("out/diagnosis.json").read_text(encoding="utf-8"))
        assert told["verdict"] in ("none", "unexplained")


@pytest.mark.parametrize("missing", ["qm", "vir"])
def test_a_check_record_that_lacks_a_channel_is_refused_before_the_search(desk, idle, missing):
    """The names in a file may be known before its numbers are read."""
    channels = {k: v for k, v in scipy.io.loadmat("check.mat").items() if k != missing}
    scipy.io.savemat("bad.mat", {k: v for k, v in channels.items() if not k.startswith("__")})
    before = desk.files()
    status, out, err = desk.diagnose(*FIT, "--check", "bad.mat")
    assert (status, out) == (2, "") and missing in err
    assert desk.files() == before


@pytest.mark.parametrize("check", [(), ("--check", "check.mat")], ids=["without", "with"])
def test_that_nothing_will_be_judged_elsewhere_is_said_before_anything_else(desk, monkeypatch, check):
    def begun(*_, say, **__):
        say("begun")
        raise InputError("begun is enough")

    monkeypatch.setattr("didim_jax.gap.cases.diagnose_case", begun)
    _, _, err = desk.diagnose(*FIT, *check)
    warned = [] if check else ["no --check record: nothing will be judged on another trajectory"]
    assert err.splitlines()[:-1] == [*warned, "begun"]


@pytest.mark.slow
def test_a_second_run_without_a_check_leaves_no_prediction_of_the_first(desk):
    desk.write("out/prediction.json", "{}")
    assert desk.diagnose(*FIT)[0] == 0
    assert {p.name for p in Path("out").iterdir()} == FILES - {"prediction.json"}


@pytest.mark.slow
def test_an_interrupted_diagnosis_leaves_nothing(desk, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("didim_jax.gap.diagnose.prepare", interrupt)
    before = desk.files()
    status, out, err = desk.diagnose(*FIT)
    assert (status, out) == (130, "") and "Traceback" not in err
    assert desk.files() == before
