"""A report says what was found, refuses to show what was not, stands alone, and is written whole or not at all."""

import dataclasses
import html
import io
import json
import os
import re

import numpy as np
import pytest
from rich.console import Console

import didim_jax.report.write as write
from didim_jax.errors import InputError
from didim_jax.hygiene import Finding
from didim_jax.identify.identifiability import Identifiability
from didim_jax.identify.result import IdentificationResult
from didim_jax.identify.study import Run, Study
from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.report import (
    identification_document,
    parameter_rows,
    prepare_folder,
    print_study,
    render_page,
    write_study,
)
from didim_jax.report.canvas import envelope
from didim_jax.report.figures import draw
from didim_jax.report.force import worst_stretch
from didim_jax.report.tables import decimals, percent, rounded
from didim_jax.statistics import Spread

RIGID = RigidDrive(95.0, CoulombViscous(203.0, 20.0), -3.0)
FLEXIBLE = FlexibleDrive(67.0, CoulombViscous(203.0, 20.0), 28.0, CoulombViscous(0.0, 0.0), 9e5, 0.0)


def _result(
    plant=RIGID,
    names=("M", "Fv", "Fc"),
    units=("kg", "N s/m", "N"),
    theta=(95.1512, 203.21, 20.393),
    std=(0.11, 1.2, 0.10),
    error=0.0408,
    **changes,
):
    theta, std = np.array(theta, dtype=float), np.array(std, dtype=float)
    n = 4
    whole = dict(
        method="DIDIM",
        plant=plant,
        names=names,
        units=units,
        theta=theta,
        spread=Spread(std, 2.36 * std, np.diag(std**2), 26.0),
        relative_error=error,
        converged=True,
        reason="every parameter changes by less than 0.1 %",
        n_iterations=n - 1,
        n_simulations=n,
        trace=np.linspace(0.5, 1.0, n)[:, None] * theta,
        costs=error * np.array([9.0, 3.0, 1.1, 1.0]),
        rho=np.random.default_rng(1).normal(size=400),
        rho_dt=8e-3,
    )
    return IdentificationResult(**(whole | changes))


def _run(recording, name, error, synthetic=False):
    record = dataclasses.replace(recording, name=name, source=f"data/{name}.mat", synthetic=synthetic)
    start = {"q1": 0.0, "v1": 0.006}
    return Run(record, 0.96 * record.tau, record.qm + 1e-6, start, force_error=error, position_error=1.4e-4)


@pytest.fixture
def study(clean_run, emps_like):
    """A rigid drive from one measured record, with a check."""
    result = _result()
    said = Identifiability(
        result.names, result.units, np.array([0.08, 0.4, 0.3]), ("Fv against Fc: 2.1 %",), "All is given.", ()
    )
    findings = (("data/slow.mat", Finding("law", "vir is 1.02 times the position term.")),)
    return Study(
        emps_like,
        result,
        (_run(clean_run, "slow", 0.0422),),
        _run(clean_run, "fast", 0.0489),
        findings,
        said,
        {"model": "rigid", "cutoff_hz": 60.0, "offset": False},
        {"identification": 1.25},
    )


@pytest.fixture
def three_steps(study):
    """A flexible drive in three steps, whose stiffness and load mass the record does not give."""
    step1 = _result(rho=np.zeros(40), rho_dt=0.1)
    step2 = _result(FLEXIBLE, ("lam", "f_n"), ("1", "Hz"), (0.7, 31.5), (0.01, 0.3), method="Nelder-Mead")
    names, units = ("M1", "M2", "K12"), ("kg", "kg", "N/m")
    step3 = _result(
        FLEXIBLE,
        names,
        units,
        (67.1, 28.4444, np.nan),
        (0.9, 0.31, np.nan),
        error=0.035,
        method="three-step DIDIM",
        steps=(step1, step2),
    )
    said = Identifiability(
        names, units, np.array([0.5, 41.0, np.inf]), ("K12: not seen",), "No mode shows.", ("M2", "K12")
    )
    return dataclasses.replace(study, result=step3, identifiability=said, check=None)


@pytest.fixture
def diverged(study):
    """Nothing was estimated, so that nothing was simulated either."""
    nothing = np.full(3, np.nan)
    result = _result(
        theta=nothing,
        std=nothing,
        error=np.nan,
        converged=False,
        reason="the simulation diverged",
        trace=np.array([[78.0, 0.0, 0.0]]),
        costs=np.array([]),
        rho=np.full(400, np.nan),
    )
    return dataclasses.replace(study, result=result, runs=(), check=None)


@pytest.fixture
def synthetic(study, clean_run):
    """The rigid study of a simulated record."""
    return dataclasses.replace(study, runs=(_run(clean_run, "slow", 0.0422, synthetic=True),), findings=())


def _page(study):
    """The page, with empty pictures: what is in them is not text."""
    return render_page(study, dict.fromkeys(draw(study), b""))


def _text(page):
    """What a reader of the page sees, as one line."""
    page = re.sub(r"<style>.*?</style>|<[^>]*>", "", page, flags=re.DOTALL)
    return " ".join(html.unescape(page).split())


def _terminal(study, **more):
    stream = io.StringIO()
    print_study(study, console=Console(file=stream, width=100), **more)
    return stream.getvalue()


# -- what is said ------------------------------------------------------------------------------------------------


def test_the_page_opens_with_the_answer(study):
    text = _text(_page(study))
    assert (
        "M = 95.15 ± 0.26 kg, Fv = 203.2 ± 2.8 N s/m, Fc = 20.39 ± 0.24 N; "
        "the rigid model leaves 4.22 % (fit) and 4.89 % (check) of the motor force unexplained."
    ) in text
    assert "Converged (3 iterations, 4 simulations): every parameter changes by less than 0.1 %." in text
    assert "vir is 1.02 times the position term." in text


def test_no_convergence_is_said_before_the_numbers(study):
    study = dataclasses.replace(study, result=dataclasses.replace(study.result, converged=False, reason="out of time"))
    for text in (_text(_page(study)), _terminal(study)):
        assert "Not converged (3 iterations, 4 simulations): out of time." in text
    assert "Not converged, last iterate: M = " in _text(_page(study))


def test_a_lost_parameter_is_never_a_number(three_steps):
    """M2 has a finite estimate, 28.4444 kg: the record does not give it all the same."""
    for text in (_text(_page(three_steps)), _terminal(three_steps)):
        assert "28.4" not in text
        assert re.search(r"M2\W*not given by this record", text)
        assert re.search(r"K12\W*not given by this record", text)
    assert "(M2, K12: not given by this record)" in _text(_page(three_steps))


def test_a_lost_parameter_that_was_not_even_tried_has_a_row(study):
    row = parameter_rows(study.result, ("K12",))[-1]
    assert (row.name, row.value, row.given) == ("K12", "not given by this record", False)


def test_where_nothing_is_given_the_step_before_is_the_answer(three_steps):
    """The procedure ends so on a record that shows no flexible mode: NaN throughout, the rigid drive as a step."""
    names, nothing = three_steps.result.names, np.full(3, np.nan)
    none = _result(
        RIGID,
        names,
        ("",) * 3,
        nothing,
        nothing,
        method="none",
        converged=False,
        reason="No mode shows.",
        n_iterations=0,
        trace=nothing[None, :],
        costs=np.array([np.nan]),
        steps=(_result(),),
    )
    said = dataclasses.replace(three_steps.identifiability, lost=names)
    text = _text(_page(dataclasses.replace(three_steps, result=none, identifiability=said)))
    assert "M1, M2, K12: not given by this record. What it gives is the rigid drive, M = 95.15 ± 0.26 kg" in text
    assert "Converged (0" not in text


def test_a_diverged_run_has_no_estimate(diverged):
    text = _text(_page(diverged))
    assert "No estimate: the simulation diverged." in text
    assert "of the motor force unexplained" not in text
    assert "no estimate" in _terminal(diverged)


def test_a_step_that_fitted_better_than_the_result_is_pointed_out(three_steps):
    worse = dataclasses.replace(three_steps, result=dataclasses.replace(three_steps.result, relative_error=0.13))
    for say in (lambda s: _text(_page(s)), _terminal):
        assert "Step 2 (Nelder-Mead) left 4.08 % of the same signal" in " ".join(say(worse).split())
        assert "of the same signal" not in say(three_steps)  # step 1 left more, and of another signal


def test_synthetic_is_said_only_of_synthetic_records(study, synthetic):
    page, plain = _page(synthetic), _page(study)
    assert 'class="banner"' in page and "SYNTHETIC DATA" in page
    assert 'class="banner"' not in plain and "SYNTHETIC" not in plain
    assert "SYNTHETIC" in _terminal(synthetic) and "SYNTHETIC" not in _terminal(study)
    titles = {name: figure.axes[0].get_title(loc="left") for name, figure in draw(synthetic).items()}
    assert "SYNTHETIC" in titles["force_fit"] and "SYNTHETIC" not in titles["force_check"]


def test_every_step_of_a_procedure_is_on_the_page(three_steps):
    text = _text(_page(three_steps))
    assert "Step 1: DIDIM, rigid drive" in text
    assert "Step 2: Nelder-Mead, flexible drive" in text
    assert "Step 3: three-step DIDIM, flexible drive" in text


def test_the_terminal_has_the_table_and_a_few_lines(study, tmp_path):
    text = _terminal(study, folder=tmp_path)
    assert re.search(r"Fv .* 203\.2 .* 1\.2 .* 2\.8 .* 1\.4 .* N s/m", text)
    assert "leaves 4.22 % (fit) and 4.89 % (check) of the motor force" in text
    assert "1 finding in the records; the first, in slow: vir is" in text
    assert "report.html" in text


# -- numbers for a reader ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (95.1512, 0.26, ("95.15", "0.26")),
        (203.21, 5.2, ("203", "5")),
        (913217.0, 1234.0, ("913200", "1200")),
        (-0.004, 0.23, ("0.00", "0.23")),  # no minus zero
        (20.393, 0.0999, ("20.39", "0.10")),
        (67.99999999999, 1e-13, ("68.00000", "1.0e-13")),  # noise-free data
        (-0.0, 1e-13, ("0.000", "1.0e-13")),
        (1.5e-7, 2e-9, ("1.500e-07", "2.0e-09")),
    ],
)
def test_a_value_has_the_digits_that_its_standard_deviation_carries(value, std, shown):
    place = decimals(std)
    assert (rounded(value, place), rounded(std, place)) == shown


@pytest.mark.parametrize("std", [np.nan, np.inf, 0.0])
def test_without_a_standard_deviation_five_digits_are_shown(std):
    row = parameter_rows(_result(std=(std, 1.0, 1.0)))[0]
    assert (row.value, row.estimate) == ("95.151", "M = 95.151 kg")


def test_the_larger_standard_deviation_goes_with_the_answer():
    spread = Spread(np.array([0.26, 1.0, 1.0]), np.array([0.04, 1.0, 1.0]), np.eye(3), 1.0)
    row = parameter_rows(_result(spread=spread))[0]
    assert (row.std, row.std_autocorrelated, row.estimate) == ("0.26", "0.04", "M = 95.15 ± 0.26 kg")


def test_percent():
    assert [percent(x) for x in (0.042194, 1.4e-4, 0.0, 3.0, np.nan)] == ["4.22 %", "0.0140 %", "0 %", "300 %", "–"]


def test_an_envelope_keeps_the_extremes_and_their_order():
    rng = np.random.default_rng(0)
    t, x = np.arange(24841.0), rng.normal(size=24841)
    thin_t, thin_x = envelope(t, x, 900)
    assert len(thin_t) < 2000
    assert (thin_x.min(), thin_x.max()) == (x.min(), x.max())
    assert np.all(np.diff(thin_t) > 0)
    np.testing.assert_array_equal(thin_x, x[thin_t.astype(int)])  # samples as they are, nothing averaged


def test_the_zoom_shows_where_the_residual_is_worst():
    t = np.arange(20000) * 1e-3
    stretch = worst_stretch(t, np.exp(-(((t - 12.3) / 0.2) ** 2)))
    assert t[stretch][0] < 11.9 and t[stretch][-1] > 12.7
    assert t[stretch][-1] - t[stretch][0] == pytest.approx(1.5)


# -- the page stands alone ---------------------------------------------------------------------------------------


def test_nothing_on_the_page_is_fetched(study, three_steps):
    for page in (_page(study), _page(three_steps)):
        assert "http://" not in page and "https://" not in page
        assert "<script" not in page and "@import" not in page and "url(" not in page
        assert all(source.startswith("data:image/png;base64,") for source in re.findall(r'src="([^"]*)', page))
        assert page.count("<img") == page.count("data:image/png;base64,")


def test_names_out_of_files_are_text_not_markup(study, clean_run):
    """Neither HTML, nor mathematics in a figure, nor rich's markup in the terminal."""
    hostile = dataclasses.replace(study, runs=(_run(clean_run, "<b>[red]$x", 0.1),), findings=())
    assert "<b>" not in _page(hostile)
    assert "&lt;b&gt;[red]$x" in _page(hostile)
    hostile = dataclasses.replace(hostile, findings=(("data/<b>[red]$x.mat", Finding("law", "odd")),))
    assert "<b>[red]$x: odd" in _terminal(hostile)


# -- identification.json -----------------------------------------------------------------------------------------

STEP_KEYS = {
    "method",
    "model",
    "parameters",
    "relative_error",
    "condition_number",
    "iterations",
    "simulations",
    "converged",
    "reason",
    "steps",
}
KEYS = STEP_KEYS | {"schema", "check", "closed_loop", "identifiability", "hygiene", "synthetic", "settings", "seconds"}
RUN_KEYS = {"record", "force_error", "position_error", "start"}


def _strict(text):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_the_document_has_its_keys_and_exact_numbers(study):
    document = identification_document(study)
    assert set(document) == KEYS
    assert document["parameters"]["M"] == {
        "value": 95.1512,
        "std": 0.11,
        "unit": "kg",
        "relative_std_percent": study.result.rel_std[0],
        "std_autocorrelated": study.result.std_autocorrelated[0],
    }
    assert document["check"] == document["closed_loop"]["check"]
    assert document["check"]["record"] == "fast" and document["check"]["force_error"] == 0.0489
    assert set(document["closed_loop"]) == {"fit", "check"} and set(document["closed_loop"]["fit"]) == RUN_KEYS
    assert document["hygiene"] == [
        {"record": "slow", "check": "law", "message": "vir is 1.02 times the position term."}
    ]
    assert (document["model"], document["synthetic"], document["schema"]) == ("rigid", False, 1)


def test_steps_have_the_shape_of_the_whole(three_steps):
    document = identification_document(three_steps)
    assert [step["method"] for step in document["steps"]] == ["DIDIM", "Nelder-Mead"]
    assert all(set(step) == STEP_KEYS for step in document["steps"])
    assert document["check"] is None


def test_what_is_not_a_number_is_null(three_steps, diverged):
    document = _strict(json.dumps(identification_document(three_steps), allow_nan=False))
    assert document["parameters"]["K12"] == {
        "value": None,
        "std": None,
        "relative_std_percent": None,
        "unit": "N/m",
        "std_autocorrelated": None,
    }
    assert document["identifiability"]["bound_percent"]["K12"] is None
    assert document["identifiability"]["lost"] == ["M2", "K12"]
    assert _strict(json.dumps(identification_document(diverged), allow_nan=False))["relative_error"] is None


# -- files -------------------------------------------------------------------------------------------------------


def test_the_folder_holds_everything(study, tmp_path):
    second = dataclasses.replace(study, runs=(*study.runs, *study.runs))
    written = write_study(second, tmp_path / "new" / "run")
    folder = tmp_path / "new" / "run"
    assert sorted(path for path in folder.rglob("*") if path.is_file()) == sorted(written)
    names = {str(path.relative_to(folder)) for path in written}
    figures = ("force_fit", "force_fit_2", "force_check", "estimates", "spectrum", "iterates")
    assert names == {f"figures/{name}.png" for name in figures} | {
        "identification.json",
        "report.html",
        "simulation.npz",
    }
    assert all((folder / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG") for name in figures)
    assert _strict((folder / "identification.json").read_text(encoding="utf-8")) == identification_document(second)
    with np.load(folder / "simulation.npz", allow_pickle=False) as arrays:
        signals = ("t", "tau", "tau_sim", "qm", "qm_sim")
        assert set(arrays) == {f"{name}_{signal}" for name in ("fit", "fit_2", "check") for signal in signals}
        np.testing.assert_array_equal(arrays["check_tau_sim"], study.check.tau)
        np.testing.assert_array_equal(arrays["fit_tau"], study.runs[0].recording.tau)


def test_a_second_run_leaves_no_figure_of_the_first(study, diverged, tmp_path):
    write_study(study, tmp_path)
    (tmp_path / "figures" / "mine.png").write_bytes(b"a figure of the user's")
    write_study(diverged, tmp_path)
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"spectrum.png", "mine.png"}


@pytest.mark.parametrize("existing", [True, False])
@pytest.mark.parametrize("error", [RuntimeError("in the middle"), OSError(28, "No space left on device")])
def test_a_failure_midway_leaves_nothing(study, tmp_path, monkeypatch, existing, error):
    folder = tmp_path / "run"
    if existing:
        write_study(study, folder)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def fail(*_):
        raise error

    monkeypatch.setattr(write, "identification_document", fail)
    with pytest.raises(InputError if isinstance(error, OSError) else RuntimeError):
        write_study(dataclasses.replace(study, check=None), folder)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert folder.exists() == existing


def test_a_folder_is_prepared_and_left_empty(tmp_path):
    folder = prepare_folder(tmp_path / "a" / "b")
    assert folder.is_dir() and not list(folder.iterdir())
    assert prepare_folder(str(folder)) == folder


@pytest.mark.parametrize("below", ["taken", "taken/run", "taken/deep/run"])
def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path, below):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match=r"taken: is a file, a folder is expected\.$"):
        prepare_folder(tmp_path / below)


@pytest.mark.parametrize("name", ["report.html", "identification.json", "simulation.npz"])
def test_a_folder_in_the_place_of_a_file_is_refused(tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=f"{name}: is a folder"):
        prepare_folder(tmp_path)


def test_a_file_in_the_place_of_the_figures_is_refused(tmp_path):
    (tmp_path / "figures").write_text("a file")
    with pytest.raises(InputError, match="figures: is a file"):
        prepare_folder(tmp_path)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"):
        prepare_folder(tmp_path)


def test_a_folder_that_cannot_be_made_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot be written") as caught:
        prepare_folder(tmp_path / ("x" * 300))  # longer than a name may be, for root too
    assert "\n" not in str(caught.value)
