"""A record survives the trip through every format unchanged; a file that cannot be used is one line that says why."""

import dataclasses

import numpy as np
import pytest
import scipy.io

from didim_jax.errors import InputError
from didim_jax.formats import load_recording, save_recording

SUFFIXES = (".mat", ".csv", ".npz")


def _refused(path, **options):
    """The line of the refusal: one line, and it opens with the file."""
    with pytest.raises(InputError) as caught:
        load_recording(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def _csv(tmp_path, text):
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    return path


# -- what comes back ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("synthetic", [True, False])
def test_round_trip_is_exact(clean_run, tmp_path, suffix, synthetic):
    full = dataclasses.replace(
        clean_run,
        injected=5.0 * (np.arange(len(clean_run)) % 2),
        synthetic=synthetic,
        documented={"kp": 160.18, "kv": 243.45},
    )
    path = tmp_path / f"run{suffix}"
    save_recording(full, path)
    back = load_recording(path)
    assert set(back.channels) == set(full.channels) == {"t", "qg", "qm", "ql", "vir", "injected"}
    for name, values in full.channels.items():
        np.testing.assert_array_equal(back.channels[name], values, err_msg=name)  # bit for bit, in csv too
    assert (back.gain, back.synthetic, back.documented) == (full.gain, synthetic, full.documented)
    assert (back.name, back.source) == ("run", str(path))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_optional_channels_stay_absent(clean_run, tmp_path, suffix):
    save_recording(dataclasses.replace(clean_run, ql=None), tmp_path / f"run{suffix}")
    back = load_recording(tmp_path / f"run{suffix}")
    assert back.ql is None
    assert back.injected is None
    assert back.documented == {}


def test_mat_is_written_as_the_benchmark_is(clean_run, tmp_path):
    save_recording(clean_run, tmp_path / "run.mat")
    found = scipy.io.loadmat(tmp_path / "run.mat")
    assert found["qm"].shape == (len(clean_run), 1)
    assert found["gtau"].shape == (1, 1)
    assert found["synthetic"].item() == 1


def test_units_row_is_converted(tmp_path):
    path = _csv(tmp_path, "# gtau = 35.15\nt,qg,qm,ql,vir\nms,mm,um,m,mV\n0,1,2,3,4\n1,2,3,4,5\n")
    r = load_recording(path)
    np.testing.assert_array_equal(r.t, [0, 1e-3])
    np.testing.assert_array_equal(r.qg, [1e-3, 2e-3])
    np.testing.assert_array_equal(r.qm, [2e-6, 3e-6])
    np.testing.assert_array_equal(r.ql, [3, 4])
    np.testing.assert_array_equal(r.vir, [4e-3, 5e-3])


def test_no_units_row_means_si_and_other_columns_are_left_alone(tmp_path):
    path = _csv(tmp_path, "\ufeff# gtau=35.15 N/V\n\nt, qg, qm, vir, note\n0,1,2,3,start\n\n1,2,3,4,\n")
    r = load_recording(path)
    np.testing.assert_array_equal(r.vir, [3, 4])
    assert r.gain == 35.15


def test_columns_map_our_names_to_those_of_the_file(tmp_path):
    path = _csv(tmp_path, "time,target,motor position,u,drive gain\n[s],[m],[mm],[V],\n0,1,2,3,35\n1,2,3,4,35\n")
    names = {"t": "time", "qg": "target", "qm": "motor position", "vir": "u", "gtau": "drive gain"}
    r = load_recording(path, columns=names)
    np.testing.assert_array_equal(r.qm, [2e-3, 3e-3])
    assert r.gain == 35.0
    assert "'Motor Position') is missing" in _refused(path, columns={**names, "qm": "Motor Position"})
    assert "columns names no channel speed" in _refused(path, columns={"speed": "v"})


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_gain_of_the_file_comes_before_the_one_given(clean_run, tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    save_recording(clean_run, path)
    assert load_recording(path, gain=1.0).gain == clean_run.gain


def test_gain_beside_a_file_without_one(tmp_path):
    path = _csv(tmp_path, "t,qg,qm,vir\n0,1,2,3\n1,2,3,4\n")
    assert load_recording(path, gain=35.0).gain == 35.0
    assert "gtau (N/V) is not in the file" in _refused(path)


def test_benchmark_files(emps_dir):
    fit, check = (load_recording(emps_dir / f"{name}.mat") for name in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    assert len(fit) == len(check) == 24841
    assert fit.gain == 35.15065188248547
    assert fit.documented == {"kp": 160.18, "kv": 243.45}
    assert fit.injected is None
    assert set(np.unique(check.injected)) == {0.0, 5.0}
    assert not fit.synthetic


# -- what is refused ---------------------------------------------------------------------------------------------


def test_files_that_are_not_there(tmp_path):
    assert "no such file" in _refused(tmp_path / "absent.mat")
    (tmp_path / "folder.mat").mkdir()
    assert "is a folder" in _refused(tmp_path / "folder.mat")
    (tmp_path / "run.txt").write_text("t,qg\n")
    assert "unknown file type '.txt'; a record is a .mat or .csv or .npz file" in _refused(tmp_path / "run.txt")


@pytest.mark.parametrize("content", [b"t,qg,qm,vir\n0,1,2,3\n" * 20, b"", b"\x00" * 300, bytes(range(256)) * 8])
def test_other_files_renamed(tmp_path, content):
    for suffix, line in ((".mat", "not a MATLAB v5 file"), (".npz", "not a numpy .npz file")):
        path = tmp_path / f"run{suffix}"
        path.write_bytes(content)
        assert line in _refused(path)


def test_truncated_mat(clean_run, tmp_path):
    path = tmp_path / "run.mat"
    save_recording(clean_run, path)
    path.write_bytes(path.read_bytes()[:20_000])
    assert "not a MATLAB v5 file" in _refused(path)


def test_matlab_73(tmp_path):
    path = tmp_path / "run.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + b"\x00" * 400)
    assert "MATLAB v7.3 file; save it again in MATLAB with save(..., '-v7')" in _refused(path)


def _variables(run):
    return {"t": run.t, "qg": run.qg, "qm": run.qm, "vir": run.vir, "gtau": run.gain}


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"qg": None}, "channel qg is missing; the file holds gtau, qm, t, vir"),
        ({"qm": np.zeros((1000, 2))}, "channel qm has the shape (1000, 2)"),
        ({"vir": "volts"}, "channel vir does not hold real numbers"),
        ({"vir": np.zeros(1000) + 1j}, "channel vir does not hold real numbers (complex128)"),
        ({"gtau": np.array([35.0, 36.0])}, "gtau must be one constant"),
        ({"gtau": np.nan}, "gtau is nan"),
        ({"gtau": -35.0}, "gtau = -35.0 N/V must be a positive number"),
        ({"vir": np.zeros(7)}, "channels differ in length"),
    ],
)
def test_variables_that_cannot_be_used(clean_run, tmp_path, change, line):
    variables = {name: v for name, v in (_variables(clean_run) | change).items() if v is not None}
    scipy.io.savemat(tmp_path / "run.mat", variables, oned_as="column")
    np.savez(tmp_path / "run.npz", **variables)
    assert line in _refused(tmp_path / "run.mat")
    assert line in _refused(tmp_path / "run.npz")


def test_nan_inside(clean_run, tmp_path):
    qm = clean_run.qm.copy()
    qm[41] = np.nan
    scipy.io.savemat(tmp_path / "run.mat", _variables(clean_run) | {"qm": qm})
    assert "channel qm is nan at row 42" in _refused(tmp_path / "run.mat")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("t,qg,qm,vir\n0,1,2,3\n1,2,oops,4\n", "line 3, column 'qm': 'oops' is not a number"),
        ("t,qg,qm,vir\n0,1,2,3\n\n# note\n1,2,,4\n", "line 5, column 'qm': '' is not a number"),
        ("t,qg,qm,vir\n0,1,2,3\n,,,\n", "line 3, column 't': '' is not a number"),
        ("t,qg,qm,vir\n0,1,2,3\n1,2,nan,4\n", "line 3, column 'qm': nan is not a finite number"),
        ("t,qg,qm,vir\n0,1,2,3\n1,2,3\n", "line 3 has 3 cells, the header has 4"),
        ("t,qg,qm,vir\n0,1,2,3\n1,2,3,4,5\n", "line 3 has 5 cells, the header has 4"),
        ("t,qg,qm,vir\ns,inch,m,V\n0,1,2,3\n1,2,3,4\n", "unknown unit 'inch' of column 'qg'; known are m, mm, um"),
        ("t,qg,qm,vir\nmin,m,m,V\n0,1,2,3\n1,2,3,4\n", "unknown unit 'min' of column 't'; known are s, ms"),
        ("t,qg,qm,vir\ns,m,m,N\n0,1,2,3\n1,2,3,4\n", "unknown unit 'N' of column 'vir'; known are V, mV"),
        ("t,qg,vir\n0,1,2\n1,2,3\n", "channel qm is missing; the file holds qg, t, vir"),
        ("t,qg,qm,qm,vir\n0,1,2,2,3\n1,2,3,3,4\n", "column 'qm' appears twice"),
        ("0,1,2,3\n1,2,3,4\n", "no line of column names"),
        ("t;qg;qm;vir\n0;1;2;3\n", "cells must be separated by commas"),
        ("# nothing\n", "empty"),
        ("t,qg,qm,vir\n", "0 samples"),
    ],
)
def test_csv_that_cannot_be_used(tmp_path, text, line):
    assert line in _refused(_csv(tmp_path, text), gain=35.15)


def test_gain_column_that_is_not_constant(tmp_path):
    assert "gtau must be one constant" in _refused(_csv(tmp_path, "t,qg,qm,vir,gtau\n0,1,2,3,35\n1,2,3,4,36\n"))


def test_binary_csv(tmp_path):
    (tmp_path / "run.csv").write_bytes(b"\xff\xfe\x00t\x00,")
    assert "not a csv text file" in _refused(tmp_path / "run.csv")


# -- writing whole or not at all ---------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failed_write_leaves_the_old_file_and_nothing_else(clean_run, tmp_path, suffix, monkeypatch):
    path = tmp_path / f"run{suffix}"
    save_recording(clean_run, path)
    before = path.read_bytes()
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(InputError, match=r"cannot be written \(No space left on device\)"):
        save_recording(dataclasses.replace(clean_run, vir=2 * clean_run.vir), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_places_that_cannot_be_written(clean_run, tmp_path):
    with pytest.raises(InputError, match=r"the folder .* does not exist"):
        save_recording(clean_run, tmp_path / "absent" / "run.mat")
    with pytest.raises(InputError, match=r"unknown file type '\.xls'"):
        save_recording(clean_run, tmp_path / "run.xls")
    (tmp_path / "taken.csv").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        save_recording(clean_run, tmp_path / "taken.csv")
