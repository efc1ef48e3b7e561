"""The benchmark package gives both EMPS records with all their channels, and each of its failures is one line."""

import dataclasses
import importlib.util
import sys
import types

import numpy as np
import pytest

from didim_jax.benchmark import load_emps_benchmark
from didim_jax.errors import InputError
from didim_jax.formats import save_recording

NAMES = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")


@pytest.fixture
def downloaded(clean_run, tmp_path):
    """A folder as the package leaves it after a download, with a small simulated record in place of each file."""
    folder = tmp_path / ".nonlinear_benchmarks" / "EMPS"
    folder.mkdir(parents=True)
    (folder / "EMPS.zip").write_bytes(b"")  # its presence is what the package takes for a finished download
    pulses = dataclasses.replace(clean_run, injected=np.ones(len(clean_run)))
    for name, run in zip(NAMES, (clean_run, pulses), strict=True):
        save_recording(run, folder / name)
    return folder


def _package(monkeypatch, EMPS):
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", types.SimpleNamespace(EMPS=EMPS))


def _refused():
    with pytest.raises(InputError) as caught:
        load_emps_benchmark()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def _check(records, run):
    fit, check = records
    np.testing.assert_array_equal(fit.qg, run.qg)  # the channel that the package's own arrays lack
    np.testing.assert_array_equal(fit.vir, run.vir)
    assert (fit.name, check.name) == ("DATA_EMPS", "DATA_EMPS_PULSES")
    assert fit.injected is None
    assert check.injected is not None


def test_records_of_a_folder_already_downloaded(downloaded, clean_run, monkeypatch, capsys):
    def EMPS(data_file_locations):
        assert data_file_locations
        print("dataset not found downloading")
        return [str(downloaded / name) for name in NAMES]

    _package(monkeypatch, EMPS)
    _check(load_emps_benchmark(), clean_run)
    assert capsys.readouterr().out == ""


@pytest.mark.skipif(importlib.util.find_spec("nonlinear_benchmarks") is None, reason="needs nonlinear_benchmarks")
def test_the_real_package_finds_that_folder(downloaded, clean_run, monkeypatch):
    import nonlinear_benchmarks.utilities

    monkeypatch.setattr(nonlinear_benchmarks.utilities, "get_tmp_benchmark_directory", lambda: str(downloaded.parent))
    _check(load_emps_benchmark(), clean_run)


def test_package_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", None)  # what Python itself sets for "not there"
    assert "needs the package nonlinear_benchmarks" in _refused()


def test_download_fails(monkeypatch):
    def EMPS(data_file_locations):
        raise ConnectionError("Max retries exceeded\nName or service not known")

    _package(monkeypatch, EMPS)
    line = _refused()
    assert "could not be downloaded (Max retries exceeded Name or service not known)" in line
    assert "give DATA_EMPS.mat as a file" in line


def test_interrupted_download(downloaded, monkeypatch):
    (downloaded / NAMES[1]).unlink()
    _package(monkeypatch, lambda data_file_locations: [str(downloaded / name) for name in NAMES])
    line = _refused()
    assert NAMES[1] in line
    assert f"remove the folder {downloaded} and try again" in line
