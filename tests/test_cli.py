"""A mistake ends in one line on standard error and status 2, with nothing written; a good record leaves all its files.

The line names what is wrong and where (file, row, column, unit) and what to do; nothing is simulated before it is said.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import didim_jax.identify.procedure as procedure
from didim_jax import CATALOGUE, cli
from didim_jax.effects.symbols import meanings, units
from didim_jax.formats import load_recording, save_recording

PLANT = """model = "rigid"
[parameters]
M = 95.0        # kg
Fv = 200.0      # N s/m
Fc = 20.0       # N
"""

REFERENCE = """start = 0.0
[limits]
stroke = [0.0, 0.25]
speed = 0.25
acceleration = 20.0
[[segment]]
kind = "trapezoid"
distance = 0.1
speed = 0.2
acceleration = 1.5
dwell = 0.1
[[segment]]
kind = "trapezoid"
distance = 0.02
speed = 0.04
acceleration = 0.8
"""


class Desk:
    """A folder with one good record, its machine, a plant and a reference; and the command, run in this process."""

    def __init__(self, folder: Path, machine, record, capsys, monkeypatch):
        self.folder, self.good, self._capsys, self._monkeypatch = folder, record, capsys, monkeypatch
        machine.save(folder / "machine.toml")
        save_recording(record, folder / "good.npz")
        self.write("plant.toml", PLANT)
        self.write("reference.toml", REFERENCE)

    def write(self, name: str, content: str | bytes) -> str:
        (self.folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
        return name

    def record(self, **changes) -> str:
        """The good record with some of its variables replaced, or left out where None."""
        variables = {**self.good.channels, "gtau": self.good.gain} | changes
        np.savez(self.folder / "bad.npz", **{name: value for name, value in variables.items() if value is not None})
        return "bad.npz"

    def table(self, header: str, rows: str | None = None) -> str:
        """A csv file; without rows of its own, with those of the good record."""
        r = self.good
        if rows is None:
            rows = "".join(
                f"{a!r},{b!r},{c!r},{d!r}\n" for a, b, c, d in np.column_stack([r.t, r.qg, r.qm, r.vir]).tolist()
            )
        return self.write("bad.csv", header + rows)

    def edited(self, name: str, old: str, new: str) -> str:
        """A file of the desk with one text replaced."""
        text = (self.folder / name).read_text()
        assert text.count(old) == 1
        return self.write(f"bad_{name}", text.replace(old, new))

    def files(self) -> dict[str, bytes | None]:
        """Every file and folder of the desk, hidden ones too."""
        found = sorted(self.folder.rglob("*"))
        return {str(path): path.read_bytes() if path.is_file() else None for path in found}

    def run(self, *arguments: str | Path) -> tuple[int, str, str]:
        """Status, standard output and standard error of `didim ...`."""
        self._monkeypatch.setattr(sys, "argv", ["didim", *map(str, arguments)])
        self._capsys.readouterr()
        status: object = 0
        try:
            cli.main()
        except SystemExit as end:
            status = end.code
        said = self._capsys.readouterr()
        assert isinstance(status, int), status
        return status, said.out, said.err

    def identify(self, *arguments: str | Path, machine: str = "machine.toml", out: str | Path = "out"):
        return self.run("identify", *arguments, "--machine", machine, "--out", out)

    def simulate(self, *arguments: str, plant="plant.toml", reference="reference.toml", out="made.npz"):
        named = ("--machine", "machine.toml", "--plant", plant, "--reference", reference, "--out", out)
        return self.run("simulate", *named, *arguments)


@pytest.fixture
def desk(tmp_path, emps_like, clean_run, capsys, monkeypatch) -> Iterator[Desk]:
    monkeypatch.chdir(tmp_path)
    yield Desk(tmp_path, emps_like, clean_run, capsys, monkeypatch)
    assert not plt.get_fignums()


@pytest.fixture
def idle(monkeypatch):
    """Nothing may be simulated or fitted."""

    def begun(*_):
        raise AssertionError("an identification was begun")

    monkeypatch.setattr(procedure, "identifiability", begun)
    monkeypatch.setattr(procedure, "_run", begun)


def assert_refused(desk: Desk, before: dict[str, bytes | None], result: tuple[int, str, str], words: tuple[str, ...]):
    status, out, err = result
    assert (status, out) == (2, "")
    assert err.startswith("didim: ") and len(err.splitlines()) == 1
    assert "Traceback" not in err
    assert [word for word in words if word not in err] == [], err
    assert desk.files() == before


# -- records -----------------------------------------------------------------------------------------------------


def spoilt(values: np.ndarray, row: int, value: float) -> np.ndarray:
    changed = np.array(values)
    changed[row - 1] = value
    return changed


def two_rates(t: np.ndarray) -> np.ndarray:
    return np.concatenate([t[:1000], t[1000] + 2e-3 * np.arange(len(t) - 1000)])


def first(desk: Desk, n: int) -> dict[str, np.ndarray]:
    return {name: values[:n] for name, values in desk.good.channels.items()}


def a_folder(desk: Desk) -> str:
    (desk.folder / "runs.mat").mkdir()
    return "runs.mat"


BAD_RECORDS: dict[str, tuple[Callable[[Desk], str], tuple[str, ...]]] = {
    "missing file": (lambda d: "nowhere.mat", ("nowhere.mat", "no such file")),
    "folder": (a_folder, ("runs.mat", "is a folder")),
    "unknown suffix": (lambda d: d.write("bad.txt", "1 2 3"), ("bad.txt", "'.txt'", ".mat or .csv or .npz")),
    "text named mat": (lambda d: d.write("bad.mat", "1 2 3\n" * 99), ("bad.mat", "not a MATLAB v5 file")),
    "empty mat": (lambda d: d.write("bad.mat", ""), ("bad.mat", "not a MATLAB v5 file")),
    "MATLAB 7.3": (lambda d: d.write("bad.mat", "MATLAB 7.3 MAT-file" + 200 * " "), ("bad.mat", "-v7")),
    "text named npz": (lambda d: d.write("bad.npz", "1 2 3"), ("bad.npz", "not a numpy .npz", "numpy.savez")),
    "empty csv": (lambda d: d.write("bad.csv", ""), ("bad.csv", "empty", "column names")),
    "csv of names alone": (lambda d: d.table("t,qg,qm,vir\n", ""), ("bad.csv", "0 samples")),
    "binary csv": (lambda d: d.write("bad.csv", bytes(range(256))), ("bad.csv", "not a csv text file")),
    "csv without names": (lambda d: d.table(""), ("bad.csv", "no line of column names", "t,qg,qm,vir")),
    "semicolons": (lambda d: d.table("t;qg;qm;vir\n", "0;0;0;0\n"), ("bad.csv", "separated by commas")),
    "unknown unit": (lambda d: d.table("t,qg,qm,vir\ns,inch,m,V\n"), ("bad.csv", "'inch'", "'qg'", "m, mm, um")),
    "newtons for volts": (lambda d: d.table("t,qg,qm,vir\ns,m,m,N\n"), ("bad.csv", "'N'", "'vir'", "V, mV")),
    "cell not a number": (
        lambda d: d.table("t,qg,qm,vir\n", "0,0,0,0\n0.001,x,0,0\n"),
        ("bad.csv", "line 3", "'qg'", "'x' is not a number"),
    ),
    "nan in a cell": (
        lambda d: d.table("t,qg,qm,vir\n", "0,0,0,0\n0.001,0,nan,0\n"),
        ("bad.csv", "line 3", "'qm'", "nan is not a finite number"),
    ),
    "short row": (lambda d: d.table("t,qg,qm,vir\n", "0,0,0\n"), ("bad.csv", "line 2", "3 cells", "4")),
    "missing column": (lambda d: d.table("t,qg,qm,volt\n"), ("bad.csv", "vir is missing", "volt")),
    "missing channel": (lambda d: d.record(vir=None), ("bad.npz", "vir is missing", "the file holds")),
    "nan": (lambda d: d.record(qm=spoilt(d.good.qm, 18, np.nan)), ("bad.npz", "qm is nan at row 18")),
    "inf": (lambda d: d.record(vir=spoilt(d.good.vir, 18, np.inf)), ("bad.npz", "vir is inf at row 18")),
    "text for numbers": (lambda d: d.record(qm=np.array(["a", "b"])), ("bad.npz", "qm does not hold real numbers")),
    "two columns": (lambda d: d.record(qm=np.zeros((9, 2))), ("bad.npz", "qm has the shape (9, 2)")),
    "channels of two lengths": (lambda d: d.record(qm=d.good.qm[:-5]), ("bad.npz", "qg 2000, qm 1995")),
    "pickled objects": (lambda d: d.record(qm=np.array([{}, {}])), ("bad.npz", "plain numbers")),
    "time reversed": (
        lambda d: d.record(t=d.good.t[::-1]),
        ("bad.npz", "t does not increase at row 2", "order of time"),
    ),
    "two sampling rates": (
        lambda d: d.record(t=two_rates(d.good.t)),
        ("bad.npz", "0.002 s at row 1002", "0.001 s elsewhere", "resample"),
    ),
    "another rate": (
        lambda d: d.record(t=2 * d.good.t),
        ("bad.npz", "0.002 s", "every 0.001 s", "correct t or the machine's sample_time"),
    ),
    "milliseconds": (lambda d: d.record(t=1e3 * d.good.t), ("bad.npz", "milliseconds")),
    "30 samples": (lambda d: d.record(**first(d, 30)), ("bad.npz", "30 samples are too few", "1000")),
    "1 sample": (lambda d: d.record(**first(d, 1)), ("bad.npz", "1 samples", "at least two")),
    "position that never moves": (lambda d: d.record(qm=0 * d.good.qm), ("bad.npz", "qm never moves", "2000 rows")),
    "reference that never moves": (lambda d: d.record(qg=0 * d.good.qg), ("bad.npz", "qg never moves")),
    "millivolts": (lambda d: d.record(vir=1e3 * d.good.vir), ("bad.npz", "millivolts", "expected are V and m")),
    "kilovolts": (lambda d: d.record(vir=1e-3 * d.good.vir), ("bad.npz", "kilovolts", "expected are V and m")),
    "newtons": (lambda d: d.record(vir=d.good.tau), ("bad.npz", "35.15 times", "newtons", "expected are V and m")),
    "divided by the gain": (lambda d: d.record(vir=d.good.vir / d.good.gain), ("bad.npz", "divided by the drive gain")),
    "kilonewtons": (lambda d: d.record(vir=1e-3 * d.good.tau), ("bad.npz", "kilonewtons")),
    "millimetres": (
        lambda d: d.record(qg=1e3 * d.good.qg, qm=1e3 * d.good.qm),
        ("bad.npz", "qg moves over", "millimetres", "give it in metres"),
    ),
    "one position in millimetres": (lambda d: d.record(qm=1e3 * d.good.qm), ("bad.npz", "qm", "millimetres")),
    "another gain": (
        lambda d: d.record(gtau=36.0),
        ("bad.npz", "36 N/V in the record", "35.15 N/V in the machine", "correct the wrong one"),
    ),
    "gain below zero": (lambda d: d.record(gtau=-35.15), ("bad.npz", "gtau = -35.15 N/V", "positive")),
}


@pytest.mark.parametrize("role", ["record", "check"])
@pytest.mark.parametrize(("make", "words"), BAD_RECORDS.values(), ids=BAD_RECORDS)
def test_an_unusable_record_is_refused_before_anything_is_simulated(desk, idle, make, words, role):
    bad = make(desk)
    before = desk.files()
    asked = [bad] if role == "record" else ["good.npz", "--check", bad]
    assert_refused(desk, before, desk.identify(*asked), words)


def test_no_pickle_is_ever_run(desk, idle):
    class Bomb:
        def __reduce__(self):
            return (Path.touch, (Path("ran"),))

    bad = desk.record(qm=np.array([Bomb()], dtype=object))
    assert_refused(desk, desk.files(), desk.identify(bad), (bad, "plain numbers"))
    assert not Path("ran").exists()


@pytest.mark.parametrize("again", [["good.npz"], ["./good.npz"], ["copy.npz"], ["--check", "good.npz"]])
def test_the_same_run_twice_is_refused(desk, idle, again):
    (desk.folder / "copy.npz").write_bytes((desk.folder / "good.npz").read_bytes())
    assert_refused(desk, desk.files(), desk.identify("good.npz", *again), ("same run as good.npz", "give it once"))


# -- machine -----------------------------------------------------------------------------------------------------

BAD_MACHINES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "unknown key": ("kp = ", "kpp = ", ("'controller.kpp'", "did you mean 'controller.kp'?")),
    "unknown table": ("[drive]", "[drve]", ("'drve'", "did you mean 'drive'?")),
    "missing key": ("mass_apriori = 78.0", "", ("missing key 'mass_apriori'", "kg")),
    "negative mass": ("= 78.0", "= -78.0", ("'mass_apriori'", "greater than 0", "kg", "-78.0")),
    "no sample time": (
        "sample_time = 0.001",
        "sample_time = 0.0",
        ("'controller.sample_time'", "greater than 0", "[s]"),
    ),
    "text for a number": ("gain = 35.15", 'gain = "35"', ("'drive.gain'", "valid number", "N/V", "'35'")),
    "number for a text": ('"bench"', "3", ("'name'", "valid string", "3")),
    "nan": ("kp = 160.18", "kp = nan", ("'controller.kp'", "finite", "1/s", "nan")),
    "unknown model": ('"rigid"', '"rigd"', ("'model'", "'rigid' or 'flexible'", "'rigd'")),
    "syntax": ("kp = ", "kp ", ("not valid TOML", "line")),
    "no end of brackets": ("kp = 160.18", "kp = " + 3000 * "[", ("not valid TOML",)),
}


@pytest.mark.parametrize(("old", "new", "words"), BAD_MACHINES.values(), ids=BAD_MACHINES)
def test_a_wrong_machine_file_is_refused(desk, idle, old, new, words):
    text = (desk.folder / "machine.toml").read_text()
    assert old in text
    bad = desk.write("bad.toml", text.replace(old, new, 1))
    assert_refused(desk, desk.files(), desk.identify("good.npz", machine=bad), (bad, *words))


@pytest.mark.parametrize(
    ("name", "words"), [("nowhere.toml", "no such file"), (".", "is a folder"), ("good.npz", "not a text file")]
)
def test_what_is_no_machine_file_is_refused(desk, idle, name, words):
    assert_refused(desk, desk.files(), desk.identify("good.npz", machine=name), (name, words))


def test_a_machine_too_slow_for_the_band_is_refused(desk, idle):
    slow = desk.edited("machine.toml", "sample_time = 0.001", "sample_time = 0.01")
    record = desk.record(t=10 * desk.good.t)
    assert_refused(desk, desk.files(), desk.identify(record, machine=slow), ("every 0.01 s", "60 Hz", "0.00833 s"))


def test_a_gain_a_thousand_times_too_high_is_named(desk):
    record = desk.record(gtau=None)
    machine = desk.edited("machine.toml", "gain = 35.15", "gain = 35150.0")
    words = ("unstable", "mass_apriori (kg)", "gains of controller and drive")
    assert_refused(desk, desk.files(), desk.identify(record, machine=machine), words)


# -- output folder -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("good.npz", ("good.npz", "is a file, a folder is expected")),
        ("good.npz/below/it", ("good.npz", "is a file, a folder is expected")),
        ("/proc/didim", ("/proc/didim", "cannot be written")),
        ("x" * 300, ("cannot be written", "too long")),
        ("new/" + "x" * 300, ("cannot be written", "too long")),
    ],
)
def test_a_folder_that_cannot_be_written_is_refused(desk, idle, out, words):
    if out.startswith("/proc") and not sys.platform.startswith("linux"):
        pytest.skip("/proc is Linux's")
    assert_refused(desk, desk.files(), desk.identify("good.npz", out=out), words)


def test_an_earlier_result_survives_a_refused_run(desk, idle):
    (desk.folder / "out" / "figures").mkdir(parents=True)
    desk.write("out/identification.json", "{}")
    desk.write("out/figures/force_fit.png", "a picture")
    bad = desk.record(t=desk.good.t[::-1])
    assert_refused(desk, desk.files(), desk.identify(bad), (bad,))


# -- options -----------------------------------------------------------------------------------------------------

NAMED = ("--machine", "machine.toml", "--out", "out")

BAD_OPTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "nothing": ((), ("identify, simulate",)),
    "unknown command": (("idntify",), ("idntify", "identify, simulate")),
    "no option": (("identify",), ("--machine", "--out")),
    "no folder": (("identify", "good.npz", "--machine", "machine.toml"), ("Missing", "--out")),
    "no record": (("identify", *NAMED), ("no record given", ".mat, .csv or .npz")),
    "unknown option": (("identify", "good.npz", *NAMED, "--bogus"), ("--bogus",)),
    "misspelt option": (("identify", "good.npz", *NAMED, "--metod", "didim"), ("--metod", "meant", "--method")),
    "unknown method": (("identify", "good.npz", *NAMED, "--method", "dydim"), ("'dydim'", "--method", "'didim'")),
    "option without value": (("identify", "good.npz", *NAMED, "--cutoff-hz"), ("--cutoff-hz", "Missing value")),
    "text for a number": (("identify", "good.npz", *NAMED, "--cutoff-hz", "abc"), ("--cutoff-hz", "'abc'")),
    "both offsets": (("identify", "good.npz", *NAMED, "--offset", "--no-offset"), ("--offset and --no-offset",)),
    "position for didim": (
        ("identify", "good.npz", *NAMED, "--method", "didim", "--signal", "position"),
        ("--signal position", "--method output-error"),
    ),
    "three steps for a rigid drive": (
        ("identify", "good.npz", *NAMED, "--method", "three-step"),
        ("three-step", "--model flexible", "--method didim"),
    ),
    "three steps with asymmetric friction": (
        ("identify", "good.npz", *NAMED, "--model", "flexible", "--friction", "asymmetric"),
        ("three-step", "symmetric friction", "--method gauss-newton"),
    ),
    "inverse model without the load's position": (
        ("identify", "no_load.npz", *NAMED, "--model", "flexible", "--method", "idim-ls"),
        ("no_load.npz", "ql (m)", "three-step"),
    ),
    **{
        f"cutoff of {hz}": (("identify", "good.npz", *NAMED, "--cutoff-hz", hz), ("between 0.5 Hz", "and 500 Hz"))
        for hz in ("0", "-5", "0.1", "500", "600", "nan", "inf")
    },
}


@pytest.mark.parametrize(("arguments", "words"), BAD_OPTIONS.values(), ids=BAD_OPTIONS)
def test_a_wrong_command_line_is_refused_in_one_line(desk, idle, arguments, words):
    os.rename(desk.record(ql=None), "no_load.npz")
    assert_refused(desk, desk.files(), desk.run(*arguments), words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--help",), ("identify", "simulate")),
        (("identify", "--help"), ("--machine", "--check", "--cutoff-hz", "machine.toml")),
        (("simulate", "--help"), ("--plant", "--reference", "--noise")),
        (("effects", "--help"), ("--file",)),
    ],
)
def test_help_goes_to_standard_output(desk, arguments, words):
    status, out, err = desk.run(*arguments)
    assert (status, err) == (0, "")
    assert [word for word in words if word not in out] == []


# -- simulate ----------------------------------------------------------------------------------------------------

BAD_SIMULATIONS: dict[str, tuple[tuple[str, str, str] | None, dict[str, str], tuple[str, ...], tuple[str, ...]]] = {
    "unknown parameter": (("plant", "M = ", "Mass = "), {}, (), ("bad_plant.toml", "'parameters.Mass'", "M, Fv, Fc")),
    "missing parameter": (("plant", "Fv = 200.0", ""), {}, (), ("bad_plant.toml", "'parameters.Fv'", "N s/m")),
    "negative mass": (("plant", "95.0", "-95.0"), {}, (), ("bad_plant.toml", "'parameters.M'", "[kg]", "-95")),
    "unstable plant": (("plant", "95.0", "1e-6"), {}, (), ("diverges at t =", "plant's parameters")),
    "beyond the drive": (("plant", "95.0", "9500.0"), {}, (), ("drive's limit of 10 V", "lower the reference")),
    "stroke": (("reference", "distance = 0.1", "distance = 0.5"), {}, (), ("stroke, upper end (0.25 m)", "t =")),
    "unknown motion": (("reference", '"trapezoid"\ndistance = 0.1', '"trapez"\ndistance = 0.1'), {}, (), ("'trapez'",)),
    "list of motions": (
        ("reference", '"trapezoid"\ndistance = 0.1', '["a"]\ndistance = 0.1'),
        {},
        (),
        ("unknown kind",),
    ),
    "endless reference": (("reference", "dwell = 0.1", "dwell = 1e12"), {}, (), ("reference", "samples", "shorter")),
    "no plant": (None, {"plant": "nowhere.toml"}, (), ("nowhere.toml", "no such file")),
    "no reference": (None, {"reference": "nowhere.toml"}, (), ("nowhere.toml", "no such file")),
    "missing folder": (None, {"out": "nowhere/made.npz"}, (), ("made.npz", "nowhere does not exist")),
    "unknown suffix": (None, {"out": "made.txt"}, (), ("made.txt", "'.txt'", ".mat or .csv or .npz")),
    "name too long": (None, {"out": "x" * 300 + ".npz"}, (), ("cannot be written", "too long")),
    "negative noise": (None, {}, ("--noise", "-3"), ("noise = -3 N rms", "zero or more")),
    "noise that is no number": (None, {}, ("--noise", "nan"), ("noise = nan N rms", "zero or more")),
    "negative seed": (None, {}, ("--seed", "-1", "--noise", "3"), ("seed = -1", "zero or more")),
    "seed that is no number": (None, {}, ("--seed", "1.5"), ("--seed", "'1.5'")),
}


@pytest.mark.parametrize(("edit", "names", "options", "words"), BAD_SIMULATIONS.values(), ids=BAD_SIMULATIONS)
def test_what_cannot_be_simulated_is_refused(desk, edit, names, options, words):
    if edit:
        which, old, new = edit
        names = {which: desk.edited(f"{which}.toml", old, new)}
    assert_refused(desk, desk.files(), desk.simulate(*options, **names), words)


# -- effects -----------------------------------------------------------------------------------------------------

OWN_EFFECT = """import didim_jax as dj


class Wind(dj.AbstractEffect):
    block = dj.Block.ENVIRONMENT
    name = "wind"
    equation = "A [N] t"
    A: float = dj.param("N", default=0.0)

    def __call__(self, t, x, signals):
        return self.A * t, x
"""


def blocks(out: str) -> dict[str, str]:
    """What `didim effects` says of each effect, by its name, as one line; last, under "", of all laws."""
    *effects, common = re.split(r"\n\n", out.strip())
    return {block.split()[0]: " ".join(block.split()) for block in effects} | {"": " ".join(common.split())}


def test_effects_are_listed_in_full_with_what_their_symbols_mean(desk):
    status, out, err = desk.run("effects")
    assert (status, err) == (0, "")
    said = blocks(out)
    assert list(said) == [*(effect.label() for effect in CATALOGUE), ""]
    for effect in CATALOGUE:
        told = (effect.block.value, effect.equation, effect.size, ", ".join(effect.twins) or "twins -", effect.source)
        assert [cell for cell in told if cell not in said[effect.label()]] == []
        assert [name for name, unit in units(effect).items() if f"{name} [{unit}]" not in said[effect.label()]] == []
    names = [line.split()[0] for line in out.splitlines() if re.match(r"[a-z_]+  ", line)]
    assert names == [effect.label() for effect in CATALOGUE]  # alone at the margin, for a search to find them


@pytest.mark.parametrize("effect", CATALOGUE, ids=[effect.label() for effect in CATALOGUE])
def test_every_parameter_has_a_meaning(effect):
    assert set(units(effect)) <= set(meanings(effect))
    assert all(meanings(effect).values())


@pytest.mark.parametrize(("columns", "width"), [(None, 100), ("60", 60), ("300", 100)])
def test_effects_are_folded_and_not_cut(desk, monkeypatch, columns, width):
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    else:
        monkeypatch.delenv("COLUMNS", raising=False)
    status, out, err = desk.run("effects")
    assert (status, err) == (0, "") and "…" not in out
    assert max(map(len, out.splitlines())) <= width
    said = blocks(out)
    assert all(effect.equation in said[effect.label()] for effect in CATALOGUE)


def test_effects_of_a_file_come_last(desk):
    own = desk.write("my_effects.py", OWN_EFFECT)
    before = desk.files()
    status, out, err = desk.run("effects", "--file", own)
    assert (status, err) == (0, "")
    assert blocks(out)["wind"] == "wind environment: A [N] t A [N] - size - twins - source -"
    assert list(blocks(out))[-2:] == ["wind", ""]
    assert desk.files() == before
    said = OWN_EFFECT.replace('    equation = "A [N] t"\n', "")
    desk.write("my_effects.py", said.replace("Effect):\n", 'Effect):\n    """A gale,\n    from aside."""\n\n'))
    found = blocks(desk.run("effects", "--file", own)[1])["wind"]
    assert found.startswith("wind environment: A gale, from aside. A [N]")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (None, None, ("nowhere.py", "no such file")),
        ("class Wind(", "class Wind((", ("my_effects.py, line", "SyntaxError")),
        ("dj.AbstractEffect", "object", ("my_effects.py", "no effect in it")),
        ('"wind"', '"stribeck"', ("my_effects.py", "'stribeck' is taken by the catalogue")),
        ("default=0.0", "default=2.0", ("my_effects.py", "Wind", "at its defaults", "null")),
    ],
)
def test_a_file_of_effects_with_a_mistake_is_refused(desk, old, new, words):
    text = OWN_EFFECT
    own = desk.write("my_effects.py", text.replace(old, new)) if old else "nowhere.py"
    assert_refused(desk, desk.files(), desk.run("effects", "--file", own), words)


# -- the good path -----------------------------------------------------------------------------------------------

KEYS = {"method", "model", "parameters", "relative_error", "condition_number", "iterations", "converged", "reason"}
KEYS |= {"check", "closed_loop", "identifiability", "hygiene", "steps", "simulations", "synthetic", "settings"}
KEYS |= {"schema", "seconds"}


def documented(folder: str | Path) -> dict:
    return json.loads((Path(folder) / "identification.json").read_text(encoding="utf-8"))


def test_simulate_then_identify_gives_the_mass_back(desk):
    status, out, err = desk.simulate("--noise", "1", out="made.mat")
    assert (status, err) == (0, "") and "made.mat" in out and "synthetic" in out
    assert load_recording("made.mat").synthetic
    assert desk.simulate("--noise", "1", "--seed", "1", out="other.csv")[0] == 0
    status, out, err = desk.identify("made.mat", "--check", "other.csv", out=Path("a folder") / "für ρ")
    assert status == 0 and "Traceback" not in err and "report.html" in out.replace("\n", "")
    folder = Path("a folder") / "für ρ"
    document = documented(folder)
    assert set(document) == KEYS
    assert (document["method"], document["model"], document["converged"]) == ("DIDIM", "rigid", True)
    assert list(document["parameters"]) == ["M", "Fv", "Fc", "offset"]
    for entry in document["parameters"].values():
        assert set(entry) == {"value", "std", "relative_std_percent", "unit", "std_autocorrelated"}
    assert document["parameters"]["M"]["unit"] == "kg"
    assert document["parameters"]["M"]["value"] == pytest.approx(95.0, rel=0.01)
    assert document["check"]["record"] == "other" and 0 < document["check"]["force_error"] < 0.1
    assert document["synthetic"]
    with np.load(folder / "simulation.npz") as signals:
        assert len(signals["fit_tau_sim"]) == len(load_recording("made.mat"))
        assert len(signals["check_tau_sim"]) == len(load_recording("other.csv"))
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.startswith("<!") and "SYNTHETIC" in page.upper()
    assert {path.name for path in folder.iterdir()} == {
        "figures",
        "identification.json",
        "report.html",
        "simulation.npz",
    }
    assert {"force_fit.png", "force_check.png"} <= {path.name for path in (folder / "figures").iterdir()}


def test_a_second_run_replaces_the_first(desk):
    """Records of two lengths are fitted together; nothing of the earlier run with a check is left beside them."""
    short = desk.record(**first(desk, 1500))
    os.chmod(short, 0o444)
    assert desk.identify("good.npz", "--check", short, "--method", "idim-ls", "--at-rest")[0] == 0
    assert documented("out")["check"]["record"] == "bad"
    assert Path("out/figures/force_check.png").exists()
    assert desk.identify("good.npz", short, "--method", "idim-ls", "--at-rest")[0] == 0
    assert documented("out")["check"] is None
    assert list(documented("out")["closed_loop"]) == ["fit", "fit_2"]
    names = {path.name for path in Path("out/figures").iterdir()}
    assert {"force_fit.png", "force_fit_2.png"} <= names and "force_check.png" not in names
    assert not [path for path in Path("out").rglob(".*")]


def test_a_fit_that_diverges_is_reported_and_is_no_mistake(desk):
    """vir is noise, which no drive explains: the answer is that there is none, and status 0."""
    noise = desk.record(vir=np.random.default_rng(0).normal(size=len(desk.good)))
    status, out, err = desk.identify(noise)
    assert status == 0 and "Traceback" not in err
    document = documented("out")
    assert document["converged"] is False
    assert "Not converged" in out
    assert "ot converged" in Path("out/report.html").read_text(encoding="utf-8")


def test_an_identified_drive_that_cannot_be_simulated_is_said(desk):
    """Least squares on the inverse model answers all the same; its drive has an unstable closed loop."""
    noise = desk.record(vir=np.random.default_rng(0).normal(size=len(desk.good)))
    status, out, err = desk.identify(noise, "--method", "idim-ls")
    assert status == 0 and "Traceback" not in err
    assert "identified drive diverges (fit)" in " ".join(out.split())
    assert documented("out")["closed_loop"]["fit"]["force_error"] is None


@pytest.mark.parametrize("when", ["identification", "writing"])
def test_an_interrupted_run_leaves_nothing(desk, monkeypatch, when):
    def interrupt(*_):
        raise KeyboardInterrupt

    if when == "identification":
        monkeypatch.setattr(procedure, "identifiability", interrupt)
    else:
        monkeypatch.setattr("didim_jax.report.write.render_page", interrupt)
    before = desk.files()
    status, out, err = desk.identify("good.npz", "--method", "idim-ls", out="new/out")
    assert (status, out) == (130, "") and "Traceback" not in err
    assert desk.files() == before


# -- the program itself ------------------------------------------------------------------------------------------


def command(desk: Desk, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "didim_jax", *arguments, "--machine", "machine.toml", "--out", "out"]


@pytest.fixture
def outside(tmp_path_factory) -> dict[str, str]:
    """The environment, with caches of its own."""
    cache = str(tmp_path_factory.mktemp("cache"))
    environment = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    return environment | {"XDG_CACHE_HOME": cache, "MPLCONFIGDIR": cache}


@pytest.mark.slow
def test_the_program_refuses_in_one_line(desk, outside):
    before = desk.files()
    run = subprocess.run(
        command(desk, "identify", "nowhere.mat"), env=outside, capture_output=True, text=True, check=False
    )
    assert_refused(desk, before, (run.returncode, run.stdout, run.stderr), ("nowhere.mat", "no such file"))


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="SIGINT as a terminal sends it")
def test_an_interrupted_program_ends_without_a_word(desk, outside):
    before = desk.files()
    process = subprocess.Popen(
        command(desk, "identify", "good.npz"), env=outside, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    cache = Path(outside["XDG_CACHE_HOME"]) / "didim_jax"
    while not list(cache.glob("*")) and time.monotonic() < deadline:
        time.sleep(0.05)  # the first compiled program in the cache: the fit is on its way
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "") and "Traceback" not in err
    assert desk.files() == before


PRINTING = {
    "effects": ("-m", "didim_jax", "effects"),
    "help": ("-m", "didim_jax", "--help"),
    "rich": ("-c", "from didim_jax.cli import program\nimport rich\nwith program():\n    rich.print('x')"),
}


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="a pipe as a shell makes it")
@pytest.mark.parametrize("arguments", PRINTING.values(), ids=PRINTING)
def test_a_program_whose_reader_has_left_ends_without_a_word(outside, arguments):
    read, written = os.pipe()
    os.close(read)
    with open(written, "wb") as pipe:
        run = subprocess.run(
            [sys.executable, *arguments], env=outside, stdout=pipe, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (run.returncode, run.stderr) == (141, "")
