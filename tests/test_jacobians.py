"""DIDIM's columns are the exact ones without the loop's answer, and the study says so in numbers."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments.jacobians.angles import Pair, columns, compare, contraction, loop_response, response
from experiments.jacobians.config import Config
from experiments.jacobians.draws import coverage_limits
from experiments.jacobians.results import THREE, crossing, rigid_twin
from experiments.jacobians.twin import PHASES, SEVEN, Twin, build_twin, phases
from experiments.study import read

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def twin() -> Twin:
    return build_twin(Config(**read(ROOT / "configs" / "jacobians.toml", [], quick=True)))


@pytest.fixture(scope="module")
def rigid(twin: Twin) -> Pair:
    return columns(twin, rigid_twin(twin), THREE)


def test_comparison_of_columns_that_are_equal_twice_as_long_orthogonal_or_zero() -> None:
    J = np.array([[1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
    W = np.array([[1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    found = compare(W, J)
    np.testing.assert_allclose(found["cosine"], [1.0, 1.0, 0.0, np.nan])
    np.testing.assert_allclose(found["ratio"], [1.0, 2.0, 1.0, np.nan])
    np.testing.assert_allclose(found["error"], [0.0, 1.0, np.sqrt(2.0), np.nan])


def test_exact_columns_leave_nothing_after_one_iteration() -> None:
    J = np.random.default_rng(0).normal(size=(50, 3)) * [1.0, 1e3, 1e-6]
    np.testing.assert_allclose(contraction(J, J), 0.0, atol=1e-12)
    np.testing.assert_allclose(contraction(2 * J, J), 0.5)


def test_crossing_of_a_level() -> None:
    x = np.array([1.0, 2.0, 4.0])
    assert crossing(x, np.array([0.1, 0.1, 0.4]), 0.2) == pytest.approx(8**0.5)
    assert crossing(x, np.array([0.1, 0.1, 0.1]), 0.2) == 4.0
    assert np.isnan(crossing(x, np.array([0.3, 0.1, 0.1]), 0.2))
    assert np.isnan(crossing(x, np.full(3, np.nan), 0.2))


def test_coverage_limits_close_in_on_95_percent() -> None:
    few, many = coverage_limits(40), coverage_limits(2000)
    assert few[0] < many[0] < 0.95 < many[1] < few[1]
    assert many[0] > 0.93 and many[1] < 0.97


def test_every_sample_of_the_reference_has_at_most_one_phase(twin: Twin) -> None:
    labels = phases(twin.dt)
    assert len(labels) == len(twin.qg)
    assert set(labels.tolist()) == {-1, *range(len(PHASES))}
    speed = np.gradient(twin.qg, twin.dt)
    np.testing.assert_allclose(np.abs(speed[labels == PHASES.index("cruise")]), 0.2, rtol=5e-3)


def test_exact_columns_are_didims_through_the_closed_loop(twin: Twin, rigid: Pair) -> None:
    """J = T W. Coulomb friction adds damping that the linear T lacks, most of it near the loop's resonance: 7 %."""
    f, T = response(rigid.W[:, 0], rigid.J[:, 0], twin.dt, 2.0, 32.0)
    np.testing.assert_allclose(T, loop_response(twin.machine, rigid_twin(twin), f), atol=0.2, rtol=0)
    assert abs(T[0] - 1) < 0.01 < 0.5 < abs(T[8] - 1)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("jacobians")
    command = [sys.executable, "-m", "experiments.jacobians", "--quick", "--out", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return folder


@pytest.fixture(scope="module")
def metrics(out: Path) -> dict:
    return json.loads((out / "metrics.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_run_folder_holds_everything_and_the_page_needs_nothing_else(out: Path) -> None:
    for name in ("run.json", "metrics.json", "arrays.npz", "report.html", "figures/draws.png"):
        assert (out / name).stat().st_size > 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "SYNTHETIC" in page
    words = re.sub(r'base64,[^"]*', "", page)
    assert "http" not in words and "<script" not in words and "src" not in words.replace('src="data:image/png;', "")
    assert "nan" not in re.findall(r"\w+", words)


@pytest.mark.slow
def test_eq_18_holds_for_step_1_and_not_for_step_3(metrics: dict) -> None:
    """The measured cosines are 0.999, 0.55 and 0.55; at 60 Hz even the rigid mass has 0.31."""
    columns = metrics["columns"]
    assert min(columns["rigid 5 Hz"]["cosine"].values()) > 0.995
    assert max(columns["rigid 5 Hz"]["contraction"]) < 0.05
    assert columns["rigid 60 Hz"]["cosine"]["M"] < 0.5
    for name in ("M1", "K12"):
        assert 0.3 < columns["flexible 60 Hz"]["cosine"][name] < 0.8


@pytest.mark.slow
def test_didim_cannot_move_the_ratios_of_the_load_side(metrics: dict) -> None:
    """Three eigenvalues of 1: f_n, Fv2/M2 and Fc2/M2 stay, so that seven columns without friction are the five."""
    np.testing.assert_allclose(metrics["columns"]["flexible 60 Hz"]["contraction"][-3:], 1.0, atol=1e-6)
    for key in ("didim five", "didim seven", "didim seven half"):
        f_n = metrics["paths"][key]["f_n, Hz"]
        np.testing.assert_allclose(f_n, f_n[0], rtol=1e-8)
    five, seven = (metrics["paths"][key]["theta"] for key in ("didim five", "didim seven"))
    for name in five:
        assert seven[name] == pytest.approx(five[name], rel=1e-6)


@pytest.mark.slow
def test_exact_estimates_keep_to_the_bound_and_didims_do_not(metrics: dict) -> None:
    """40 draws: a mean is good to 0.16 std, a std to 11 %; four times that is asked, and binomial coverage."""
    draws = metrics["draws"]
    exact, five = draws["gauss-newton"], draws["didim five"]
    assert exact["converged"] == exact["draws"]
    low, high = draws["coverage limits"]
    for name in SEVEN:
        assert abs(exact["bias in its std"][name]) < 0.65
        assert 0.6 < exact["std over the bound"][name] < 1.45
        assert low <= draws["coverage"]["autocorrelated"][name] <= high
    for name in ("M1", "M2", "K12"):
        assert five["bias in bounds"][name] < -50
    assert draws["check"]["apart"] < 0.01 and draws["check"]["std_apart"] < 0.02


@pytest.mark.slow
def test_motor_force_separates_the_friction_of_the_two_sides(metrics: dict) -> None:
    for here in metrics["friction"].values():
        assert -1 < here["correlation Fc1 Fc2"] < 0
        for name in ("Fv1", "Fv2", "Fc1", "Fc2"):
            assert here["bound"][name] < 0.1 * metrics["truth"][name]
