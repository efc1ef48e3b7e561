"""A diagnosis is told verdict first, its document keeps the contract, and its folder is written whole or not at all."""

import dataclasses
import html
import io
import itertools
import json
import os
import re
import time

import numpy as np
import pytest
from rich.console import Console

import didim_jax.report.write_diagnosis as write
from didim_jax.errors import InputError
from didim_jax.gap.atlas import atlas
from didim_jax.gap.diagnosis import Candidate, Diagnosis, Estimate, Experiment, Gap, Run, Shift, Where
from didim_jax.report.atlas import atlas_figure
from didim_jax.report.canvas import png
from didim_jax.report.diagnosis_document import diagnosis_document
from didim_jax.report.diagnosis_force import run_figure, worst_stretches
from didim_jax.report.diagnosis_names import chance, listed, named
from didim_jax.report.diagnosis_page import draw_diagnosis, named_runs, render_diagnosis
from didim_jax.report.diagnosis_summary import shown_ranking, summary_figure
from didim_jax.report.diagnosis_words import answers, headline
from didim_jax.report.write_diagnosis import print_diagnosis, write_diagnosis
from didim_jax.signals import LowPass

DT = 1e-3
BLOCKS = {"controller", "actuator", "motor side", "coupling", "load side", "sensor", "base", "environment"}
FILES = {"simulation.npz", "report.html", "diagnosis.json"}
VERDICTS = ("none", "effect", "ambiguous", "unexplained")


# -- a plausible diagnosis, by hand ------------------------------------------------------------------------------


def _motion(n, seconds):
    """Strokes of 0.2 m that grow faster, position m, velocity m/s, acceleration m/s2."""
    t = DT * np.arange(n)
    q = 0.1 - 0.1 * np.cos(2 * np.pi * t * (0.15 + 0.25 * t / seconds))
    v = np.gradient(q, DT)
    return t, q, v, np.gradient(v, DT)


def _run(name, seed, n=9000, missing=9.0):
    """A rigid drive: recorded with Stribeck friction, without it before, with nearly all of it after."""
    t, _, v, a = _motion(n, n * DT)
    noise = np.random.default_rng(seed).normal(size=n)
    noise = 2.0 * noise / noise.std()
    nominal = 95.0 * a + 203.0 * v + 20.0 * np.tanh(v / 1e-3)
    extra = missing * np.exp(-(np.abs(v / 0.02) ** 1.5)) * np.tanh(v / 1e-3)
    return Run(name, t, nominal + extra + noise, nominal, nominal + 0.97 * extra)


def _map(run, simulated):
    """The atlas of what a simulation leaves of the run."""
    step = 8
    t, q, v, a = (x[::step] for x in _motion(len(run.t), len(run.t) * DT))
    left = LowPass.butterworth(60.0, DT)(run.tau - simulated, odd=False)[::step]
    return atlas(t, left, q, v, a, q, DT * step, 0.0025)


def _estimates(**numbers):
    return {name: Estimate(*number) for name, number in numbers.items()}


@pytest.fixture(scope="module")
def effect():
    """Stribeck friction, named, with a check record."""
    fit, check = _run("slow", 0), _run("fast", 1)
    sizes = _estimates(dFs=(8.73, 0.27, "N"), vs=(0.0201, 0.0006, "m/s"))
    gap = Gap(0.0386, 0.0130, 0.0124)
    return Diagnosis(
        verdict="effect",
        effects=("stribeck",),
        ambiguous_with=(),
        ranking=(("stribeck", 0.93), ("other", 0.05), ("quadratic_viscous", 0.015), ("none", 0.005)),
        parameters={"stribeck": {name: size.document() for name, size in sizes.items()}},
        block="motor side",
        base={
            "M": Shift(95.3, 95.1, 0.11, "kg"),
            "Fv": Shift(183.0, 203.4, 1.2, "N s/m"),
            "Fc": Shift(23.1, 20.1, 0.1, "N"),
        },
        gap={"fit": gap, "check": Gap(0.0390, 0.0128, 0.0120, 0.0125)},
        share=0.985,
        interval=(0.97, 0.99),
        last_in={"stribeck": 1.0},
        where=Where(None, [-0.166, 0.173], None, [0.0, 15.4], "force"),
        experiment=None,
        remarks=("slow: qg - qm is 0.10 mm at the first sample.",),
        candidates=(
            Candidate("stribeck", 0.0130, 0.98, 0.93, sizes),
            Candidate("quadratic_viscous", 0.0227, 0.71, 0.015, _estimates(c=(2000.0, 1900.0, "N s2/m2"))),
        ),
        atlas=_map(fit, fit.before),
        atlas_after=_map(fit, fit.after),
        runs=(fit, check),
        evidence={"gain": np.float64(0.86), "steps": [{"energy": np.array([1.0, 2.0])}]},
        machine="bench",
        synthetic=False,
    )


@pytest.fixture(scope="module")
def diagnoses(effect):
    """One of each verdict."""
    nominal = tuple(dataclasses.replace(run, after=run.before) for run in effect.runs)
    alone = {"effects": (), "parameters": {}, "block": None, "last_in": {}, "share": None, "interval": None}
    nowhere = Where(None, None, None, None, "force")
    force = {"F0": {"value": -3.1, "std": 0.1, "unit": "N"}}
    return {
        "effect": effect,
        "none": dataclasses.replace(
            effect,
            verdict="none",
            ranking=(("none", 0.98), ("offset", 0.015), ("other", 0.005)),
            gap={"fit": Gap(0.0124, 0.0124, 0.0121), "check": Gap(0.0121, 0.0121, 0.0120, 0.0123)},
            runs=nominal,
            atlas=effect.atlas_after,
            where=nowhere,
            **alone,
        ),
        "ambiguous": dataclasses.replace(
            effect,
            verdict="ambiguous",
            effects=("offset", "cogging"),
            ambiguous_with=(("offset", "asymmetric_coulomb"),),
            ranking=(("offset", 0.55), ("other", 0.06), ("asymmetric_coulomb", 0.38), ("none", 0.01)),
            parameters={"offset": force, "cogging": {"a1": {"value": 1.0, "std": 0.0, "unit": "N"}}},
            block="environment",
            last_in={"offset": 0.8, "cogging": 0.25},
            experiment=Experiment("dwell at rest with dither below breakaway, 4 s", 41.0),
            candidates=(
                Candidate("offset", 0.0131, 0.97, 0.55, _estimates(F0=(-3.1, 0.1, "N"))),
                Candidate("asymmetric_coulomb", 0.0133, 0.96, 0.38, _estimates(dFc=(3.0, 0.1, "N"))),
            ),
        ),
        "unexplained": dataclasses.replace(
            effect,
            verdict="unexplained",
            ranking=(("other", 0.83), ("cogging", 0.16), ("none", 0.01)),
            gap={"fit": Gap(0.0386, 0.0386, 0.0124), "check": Gap(0.0390, 0.0390, 0.0120, 0.0391)},
            runs=nominal,
            atlas_after=effect.atlas,
            where=nowhere,
            **alone,
        ),
    }


@pytest.fixture(params=VERDICTS)
def diagnosis(diagnoses, request):
    """Each verdict in turn."""
    return diagnoses[request.param]


def _unchecked(d):
    """The same without a check record."""
    return dataclasses.replace(d, gap={"fit": d.gap["fit"]}, runs=d.runs[:1])


def _page(d):
    """The page, with empty pictures: what is in them is not text."""
    names = ["summary", *(["atlas"] if d.atlas else []), *(f"force_{name}" for name in named_runs(d))]
    return render_diagnosis(d, dict.fromkeys(names, b""))


def _text(page):
    """What a reader of the page sees, as one line."""
    page = re.sub(r"<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(page).split())


def _terminal(d, tmp_path):
    stream = io.StringIO()
    print_diagnosis(d, tmp_path, console=Console(file=stream, width=1000))
    return stream.getvalue()


# -- what is said ------------------------------------------------------------------------------------------------


def test_the_page_opens_with_the_verdict(diagnoses):
    said = {
        "effect": "Missing in the simulation: Stribeck friction. Once added, the gap on the check record falls from "
        "3.90 % to 1.28 % of the motor force; noise alone leaves an estimated 1.20 %.",
        "none": "Nothing is missing that these data could show. The simulation leaves 1.21 % of the motor force on the "
        "check record; noise alone would leave an estimated 1.20 %.",
        "ambiguous": "Missing in the simulation: constant force or asymmetric Coulomb friction (these data cannot tell "
        "which), and cogging. With the likelier one and cogging, the gap on the check record falls from 3.90 % to "
        "1.28 % of the motor force; noise alone leaves an estimated 1.20 %.",
        "unexplained": "No effect of the catalogue accounts for the gap: 3.90 % of the motor force on the check "
        "record, where noise alone would leave an estimated 1.20 %.",
    }
    for verdict, d in diagnoses.items():
        assert headline(d) == said[verdict]
        text = _text(_page(d))
        assert text.index(headline(d)) < text.index("Where is the gap?") < text.index("Where the gap lies")


def test_three_questions_have_an_answer_each(diagnosis, tmp_path):
    text, terminal = _text(_page(diagnosis)), _terminal(diagnosis, tmp_path)
    for answer in answers(diagnosis):
        assert answer.head and answer.text.endswith(".")
        assert answer.question in text and answer.question in terminal
        assert answer.text in terminal
    assert "report.html" in terminal


def test_the_answers_of_a_named_effect(diagnoses):
    where, which, far = answers(diagnoses["effect"])
    assert where.head == "On the motor side"
    assert (which.head, far.head) == ("Stribeck friction (93 %)", "98 % [97, 99] of what can be closed")
    assert which.text == (
        "dFs = 8.73 ± 0.27 N, vs = 0.0201 ± 0.0006 m/s. Next likeliest: something else (5 %) and quadratic viscous "
        "friction (2 %)."
    )
    assert "Check record: 3.90 % before, 1.28 % after, an estimated 1.20 % is noise; 1.25 % was predicted." in far.text


def test_twins_come_with_what_would_part_them(diagnoses):
    d = diagnoses["ambiguous"]
    _, which, _ = answers(d)
    assert which.head == "Constant force (55 %) or asymmetric Coulomb friction (38 %)"
    assert "dwell at rest with dither below breakaway, 4 s" in which.text and "41°" in which.text
    assert [e for e, _ in shown_ranking(d, 6)] == ["offset", "asymmetric_coulomb", "other", "none"]  # side by side
    page = _page(d)
    assert re.search(r'<td class="bracket" rowspan="2">not told apart', page)
    assert "To tell the twins apart" in page
    assert 'class="bracket"' not in _page(diagnoses["effect"])


def test_unexplained_says_what_was_found_on_the_way(diagnoses):
    d = dataclasses.replace(diagnoses["effect"], verdict="unexplained", ranking=(("other", 0.8), ("stribeck", 0.2)))
    assert headline(d).startswith(
        "With Stribeck friction, the gap on the check record falls from 3.90 % to 1.28 % of the motor force, but"
    )
    where, which, _ = answers(d)
    assert where.text.startswith("With Stribeck friction in place: the simulation misses")
    assert which.head == "None that is known (80 %)"
    assert "On the way Stribeck friction was found." in which.text


def test_no_gap_says_what_could_not_be_seen(diagnoses):
    _, which, far = answers(diagnoses["none"])
    assert which.head == "None (98 %)" and "A wrong drive gain would not show" in which.text
    assert far.head == "Nothing to close" and " after" not in far.text


def test_without_a_check_record_the_reader_is_warned_first_and_once(diagnosis, tmp_path):
    d = _unchecked(diagnosis)
    assert "on the fit record" in headline(d) and "check record" not in headline(d)
    for text in (_text(_page(d)), _terminal(d, tmp_path)):
        assert text.count("No check record") == 1
        assert text.index("No check record") < text.index(headline(d))
        assert "The check record chose nothing" not in text
    assert "No check record" not in _text(_page(diagnosis)) + _terminal(diagnosis, tmp_path)


def test_what_is_not_repeated_is_judged_on_the_fit_record(diagnoses):
    d = diagnoses["effect"]
    once = {"disturbance_pulses": {"A": {"value": 9.0, "std": 0.5, "unit": "N"}, "repeats": False}}
    where = dataclasses.replace(d.where, time_s=[[2.1, 2.4], [5.0, 5.2]])
    d = dataclasses.replace(d, effects=("disturbance_pulses",), parameters=once, block="environment", where=where)
    assert "the gap on the fit record falls from 3.86 % to 1.30 %" in headline(d)
    text = _text(_page(d))
    assert "A = 9.0 ± 0.5 N height repeats: no" in text
    assert "is not repeated on the check record" in text
    assert "2.10–2.40 s and 5.00–5.20 s" in text


def test_a_gap_that_grows_is_said_to(diagnoses):
    d = diagnoses["effect"]
    worse = {"fit": d.gap["fit"], "check": Gap(0.039, 0.052, 0.012, 0.0125)}
    d = dataclasses.replace(d, gap=worse, share=-0.8, interval=(-0.9, -0.7))
    assert "the gap on the check record rises from 3.90 % to 5.20 %" in headline(d)
    assert answers(d)[2].head == "Not at all on the check record"


def test_synthetic_is_said_in_the_first_lines_and_only_of_synthetic_data(effect, tmp_path):
    plain, synthetic = effect, dataclasses.replace(effect, synthetic=True)
    assert "SYNTHETIC DATA" in _text(_page(synthetic))[:200]
    assert _terminal(synthetic, tmp_path).startswith("SYNTHETIC")
    assert "SYNTHETIC" not in _page(plain) and "SYNTHETIC" not in _terminal(plain, tmp_path)


def test_every_parameter_has_its_meaning_beside_it(effect):
    text = _text(_page(effect))
    assert "vs = 0.0201 ± 0.0006 m/s speed at which 37 % of it is left" in text
    assert "s the sign of v" in text
    assert 'title="friction over the square of the speed, at 0.1 m/s">c = ' in _page(effect)  # a candidate's
    sizes = {"z_s": {"value": 2e-4, "std": 1e-5, "unit": "m"}}
    text = _text(_page(dataclasses.replace(effect, effects=("presliding",), parameters={"presliding": sizes})))
    assert "F: force of the bristle, N" in text and "z_s: " not in text


def test_a_symptom_among_the_base_parameters_is_marked(effect):
    page = _page(effect)
    assert re.search(r'class="symptom">\+11\.1\s%', page)  # Fv
    assert re.search(r'class="">−0\.2\s%', page)  # M


def test_small_words():
    assert [chance(p) for p in (0.0, 0.0099, 0.55, 0.999)] == ["<1 %", "<1 %", "55 %", ">99 %"]
    assert [listed(x) for x in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b", "a, b and c"]
    assert (named("time_delay"), named("my_own_effect")) == ("time delay", "my own effect")


def test_zooms_show_where_it_was_worst_and_where_it_still_is():
    t = DT * np.arange(9000)
    bump = {c: np.exp(-(((t - c) / 0.1) ** 2)) for c in (1.0, 3.0, 6.5)}
    found = worst_stretches(t, bump[1.0] + 2 * bump[6.5], bump[3.0])
    assert [min(bump, key=lambda c: abs(c - t[s].mean())) for s in found] == [1.0, 3.0, 6.5]
    assert all(a.stop <= b.start for a, b in itertools.pairwise(found))
    assert worst_stretches(t[:300], t[:300], t[:300]) == [slice(0, 300)]  # shorter than a zoom


def test_a_short_peak_does_not_flatten_the_overview(effect):
    """A start's transient of 20 ms, forty times the residual."""
    run = effect.runs[1]
    peak = 400.0 * np.exp(-((run.t / 0.01) ** 2))
    for tau, high in ((run.tau, False), (run.tau + peak, True)):
        whole = run_figure(dataclasses.replace(run, tau=tau), "check", None, True).axes[0]
        said = [text.get_text() for text in whole.texts if "cut off" in text.get_text()]
        assert whole.get_ylim()[1] < 40.0
        assert bool(said) == high
        assert not high or re.fullmatch(r"cut off: \d+ N at 0\.0\d s", said[0])


def test_an_empty_panel_of_the_map_says_why(effect):
    """Nothing goes with noise; what comes in a few moments goes with no variable, but is there."""
    before, after = effect.atlas, dataclasses.replace(effect.atlas_after, floor_rms=0.99 * effect.atlas_after.rms)
    said = {text.get_text() for ax in atlas_figure(before, after).axes for text in ax.texts}
    assert "nothing left to explain" in said
    one = dataclasses.replace(after, floor_rms=0.1 * after.rms)
    said = {text.get_text() for ax in atlas_figure(one).axes for text in ax.texts}
    assert "no single variable closes 1 %" in said and "nothing left to explain" not in said


# -- the page stands alone ---------------------------------------------------------------------------------------


def test_nothing_on_the_page_is_fetched(diagnosis):
    page = render_diagnosis(diagnosis, {name: png(figure) for name, figure in draw_diagnosis(diagnosis).items()})
    assert "http://" not in page and "https://" not in page
    assert "<script" not in page and "@import" not in page and "url(" not in page and "<link" not in page
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in re.findall(r'src="([^"]*)', page))
    assert page.count("<img") == 4  # the answer, the atlas, the fit record, the check record


def test_names_out_of_files_are_text_not_markup(effect, tmp_path):
    run = dataclasses.replace(effect.runs[0], name="<b>[red]$x")
    d = dataclasses.replace(effect, runs=(run, effect.runs[1]), remarks=("<i>[bold]odd",))
    page = _page(d)
    assert "<b>[red]" not in page and "&lt;b&gt;[red]$x" in page and "&lt;i&gt;[bold]odd" in page
    assert "<i>[bold]odd" in _terminal(d, tmp_path)


def test_an_effect_of_the_users_own_needs_no_entry_anywhere(effect):
    d = dataclasses.replace(effect, effects=("sticky_tape",), block="payload", parameters={"sticky_tape": {}})
    assert "Missing in the simulation: sticky tape." in headline(d)
    assert "In the payload" in _text(_page(d))


def test_without_an_atlas_the_page_is_made_all_the_same(diagnosis):
    d = dataclasses.replace(diagnosis, atlas=None, atlas_after=None)
    assert "The residual was not mapped." in _text(_page(d))
    assert "atlas" not in draw_diagnosis(d)
    assert all(answer.text for answer in answers(d)[1:])


def test_a_doubt_about_the_machine_s_file_comes_before_the_answer(effect):
    said = "slow: ql swings against qm by 18 um rms, and the machine is said to be rigid."
    d = dataclasses.replace(effect, doubts=(said,))
    text = _text(_page(d))
    assert text.index(said) < text.index(headline(d))
    assert diagnosis_document(d)["remarks"] == [said, *effect.remarks]


def test_what_is_left_well_above_the_noise_is_said(effect):
    gap = effect.gap["check"]
    shrinks = answers(dataclasses.replace(effect, share=0.999, interval=(0.997, 1.0)))[2]
    assert shrinks.head.startswith("More than 99 %") and "times the noise" not in shrinks.text
    more = dataclasses.replace(gap, after=3 * gap.floor)
    assert "3.0 times the noise" in answers(dataclasses.replace(effect, gap=effect.gap | {"check": more}))[2].text


def test_noise_is_one_number_and_an_estimate(effect):
    noise = f"about {effect.atlas.floor_rms:.2g} N of that looks like noise"
    assert noise in answers(effect)[0].text
    text = _text(_page(effect))
    assert "noise (estimated)" in text and "may come out below it" in text


def test_several_records_each_have_their_picture(effect):
    d = dataclasses.replace(effect, runs=(effect.runs[0], *effect.runs))
    assert list(draw_diagnosis(d)) == ["summary", "atlas", "force_fit", "force_fit_2", "force_check"]
    assert _page(d).count("<img") == 5


def test_the_gap_that_was_predicted_is_marked(effect):
    marks = [line for line in summary_figure(effect).axes[2].lines if line.get_linestyle() == "--"]
    assert [float(line.get_ydata()[0]) for line in marks] == [1.25]


# -- diagnosis.json ----------------------------------------------------------------------------------------------

KEYS = {
    "schema",
    "verdict",
    "effects",
    "ambiguous_with",
    "ranking",
    "parameters",
    "block",
    "base",
    "gap",
    "closed",
    "last_in",
    "where",
    "separating_experiment",
    "remarks",
}
"""As the contract has them; further keys are allowed."""


def _strict(text):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_the_document_keeps_the_contract(diagnosis, unpainted, tmp_path):
    write_diagnosis(diagnosis, tmp_path)
    document = _strict((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert set(document) >= KEYS and document["schema"] == 1
    assert document["verdict"] in VERDICTS
    probabilities = {row["effect"]: row["probability"] for row in document["ranking"]}
    assert {"none", "other"} <= set(probabilities)
    assert all(0 <= p <= 1 for p in probabilities.values())
    assert sum(probabilities.values()) == pytest.approx(1.0, abs=1e-9)
    assert document["block"] in BLOCKS | {None}
    assert set(document["where"]) == {"time_s", "speed_m_s", "position_m", "frequency_hz", "channel"}
    assert set(document["gap"]["fit"]) == {"before", "after", "floor"}
    assert set(document["gap"]["check"]) == {"before", "after", "floor", "predicted_after"}
    assert all(set(shift) == {"before", "after", "std", "unit"} for shift in document["base"].values())
    for numbers in document["parameters"].values():
        assert all(set(number) == {"value", "std", "unit"} for number in numbers.values())
    if document["effects"]:
        assert document["closed"] == {"share": 0.985, "interval": [0.97, 0.99]}
    else:
        assert document["closed"] is None and document["last_in"] == {}
    if document["verdict"] == "ambiguous":
        assert document["ambiguous_with"] == [["offset", "asymmetric_coulomb"]]
        assert set(document["separating_experiment"]) == {"what", "angle_deg"}
    else:
        assert document["ambiguous_with"] == [] and document["separating_experiment"] is None


def test_what_is_not_a_number_is_null(effect):
    document = diagnosis_document(dataclasses.replace(effect, gap={"fit": Gap(0.1, np.float64(0.2), float("nan"))}))
    assert document["gap"] == {"fit": {"before": 0.1, "after": 0.2, "floor": None}}
    assert document["evidence"] == {"gain": 0.86, "steps": [{"energy": [1.0, 2.0]}]}
    json.dumps(document, allow_nan=False)


# -- files -------------------------------------------------------------------------------------------------------


def test_the_folder_holds_the_three_files(effect, tmp_path):
    folder = tmp_path / "new" / "case-001"
    write_diagnosis(effect, folder)
    assert {path.name for path in folder.iterdir()} == FILES
    with np.load(folder / "simulation.npz", allow_pickle=False) as arrays:
        signals = ("t", "tau", "tau_before", "tau_after")
        assert set(arrays) == {f"{record}_{signal}" for record in ("fit", "check") for signal in signals}
        np.testing.assert_array_equal(arrays["check_tau_after"], effect.runs[1].after)
        np.testing.assert_array_equal(arrays["fit_tau"], effect.runs[0].tau)


def test_without_a_check_record_there_is_none_in_the_files(effect, unpainted, tmp_path):
    d = _unchecked(dataclasses.replace(effect))
    write_diagnosis(dataclasses.replace(d, runs=(*d.runs, *d.runs)), tmp_path)
    with np.load(tmp_path / "simulation.npz", allow_pickle=False) as arrays:
        assert {name.rsplit("_tau")[0] for name in arrays if name.endswith("_tau")} == {"fit", "fit_2"}
    assert set(_strict((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))["gap"]) == {"fit"}


@pytest.fixture
def unpainted(monkeypatch):
    """Pages without pictures."""
    monkeypatch.setattr(write, "draw_diagnosis", lambda d: {})
    monkeypatch.setattr(write, "render_diagnosis", lambda d, pictures: _page(d))


@pytest.mark.parametrize("broken", ["_arrays", "_document", "render_diagnosis"])
def test_a_failure_midway_leaves_the_folder_as_it_was(diagnoses, unpainted, tmp_path, monkeypatch, broken):
    write_diagnosis(diagnoses["effect"], tmp_path / "old")
    before = {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()}

    def fail(*_):
        raise RuntimeError("in the middle")

    monkeypatch.setattr(write, broken, fail)
    for folder in ("old", "new"):
        with pytest.raises(RuntimeError, match="in the middle"):
            write_diagnosis(diagnoses["none"], tmp_path / folder)
    assert {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()} == before
    assert not (tmp_path / "new").exists()


def test_a_disk_that_fills_leaves_the_folder_as_it_was(diagnoses, unpainted, tmp_path, monkeypatch):
    write_diagnosis(diagnoses["effect"], tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    whole = type(tmp_path).write_bytes

    def full(path, content):
        if path.suffix == ".html":
            raise OSError(28, "No space left on device")
        return whole(path, content)

    monkeypatch.setattr(type(tmp_path), "write_bytes", full)
    with pytest.raises(InputError, match="No space left on device"):
        write_diagnosis(diagnoses["none"], tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_document_comes_last(effect, unpainted, tmp_path, monkeypatch):
    order = []
    monkeypatch.setattr(os, "replace", lambda source, target: order.append(target.name))
    write_diagnosis(effect, tmp_path)
    assert order == ["simulation.npz", "report.html", "diagnosis.json"]


@pytest.mark.parametrize("name", sorted(FILES))
def test_a_folder_in_the_place_of_a_file_is_refused(effect, unpainted, tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=f"{name}: is a folder"):
        write_diagnosis(effect, tmp_path)


def test_a_file_in_the_place_of_the_folder_is_refused(effect, unpainted, tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match="taken: cannot be written"):
        write_diagnosis(effect, tmp_path / "taken")


def test_pages_for_many_cases_cost_little(effect, tmp_path):
    """Seventy of them are written in two minutes of one core; CPU time, so that a busy machine does not count."""
    write_diagnosis(effect, tmp_path)
    start = time.process_time()
    write_diagnosis(effect, tmp_path)
    assert time.process_time() - start < 1.5 * 2  # twice the aim: slower machines than ours
