"""The page of a blind study says what is synthetic, what was not run, where a baseline wins, and every wrong case; it
stands alone, and its axes have labels.
"""

import dataclasses
import re
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from didim_jax.errors import InputError
from experiments.blind import ledger, words
from experiments.blind.__main__ import main
from experiments.blind.ablation_scores import WORDS, ablated
from experiments.blind.ablations import ABLATIONS
from experiments.blind.figures_answers import answers_figure, groups_figure, how
from experiments.blind.figures_effects import effects_figure
from experiments.blind.figures_gap import gap_figure
from experiments.blind.figures_limits import limits_figure
from experiments.blind.figures_names import confusion_figure, reliability_figure
from experiments.blind.figures_rivals import ablations_figure, rivals_figure
from experiments.blind.headline import headline
from experiments.blind.judge import Row, agreement, target
from experiments.blind.layout import read_json
from experiments.blind.page import gather, report
from experiments.blind.plan import STRATA
from experiments.blind.score import baseline_summary
from experiments.blind.summary import summary
from experiments.study import write_json

TRUTHS: dict[str, list[tuple[str, ...]]] = {
    "single": [("stribeck",), ("offset",), ("cogging",), ("backlash",)],
    "small": [("stribeck",)],
    "none": [(), ()],
    "alias": [("drive_gain",)],
    "two": [("stribeck", "offset")],
    "outside": [("x_<mains>",)],
}


def answered(row: Row, verdict: str, *found: str, sure: float = 0.9) -> Row:
    exact, accepted = agreement(row.target, verdict, found, [])
    first = {"none": "none", "unexplained": "other"}.get(verdict) or found[0]
    ranking = {first: sure, "friction_drift": 1 - sure}
    right = first in row.target
    more: dict[str, Any] = {"exact": exact, "accepted": accepted, "first": right, "first_three": right, "block": right}
    return dataclasses.replace(row, verdict=verdict, found=found, ranking=ranking, **more)


def right(row: Row) -> Row:
    silent = {"none": "none", "outside": "unexplained"}.get(row.kind)
    return answered(row, silent) if silent else answered(row, "effect", *row.target)


def rows() -> list[Row]:
    """All right but case-02, an offset called lead_friction."""
    out = []
    for stratum, truths in TRUTHS.items():
        for effects in truths:
            case = f"case-{len(out) + 1:02d}"
            row = right(Row(case, stratum, effects, target(effects), "usual", len(out) % 2 == 0, "flexible"))
            gap = {"before": 0.05, "after": 0.021, "floor": 0.02, "over_floor": 1.05, "predicted": True}
            inside = {"closed": 0.98, "parameter_errors": (0.02,)} if row.inside else {}
            out.append(dataclasses.replace(row, **gap, **inside))
    out[1] = answered(dataclasses.replace(out[1], closed=0.1, parameter_errors=()), "effect", "lead_friction")
    return out


def document(rivals: dict[str, list[Row]]) -> dict[str, Any]:
    ours = rows()
    methods = {name: baseline_summary(ours, theirs) for name, theirs in rivals.items()}
    found = {"schema": 1, "cases": len(ours), "headline": headline(ours, rivals), **summary(ours), "rows": ours}
    return {**found, "baselines": {"blind": True, "methods": methods}}


LIMITS = {
    "effects": {
        "offset": dict(
            parameter="F0", unit="N", typical=3.0, crlb=0.014, p50=0.4, p90=0.7, p50_interval=[0.3, 0.5],
            p90_interval=[0.6, 0.9], n=3, trials=[[0.3, False], [0.51, True], [0.69, True]],
        ),
        "backlash": dict(
            parameter="b", unit="m", typical=8e-6, crlb=1e-7, p50=2e-6, p90=None, p50_interval=[1e-6, None],
            p90_interval=None, n=1, trials=[[2e-6, True]], below={"p50": True, "p90": False}, own_name=0,
        ),
        "presliding": dict(
            parameter="share", unit="1", typical=None, crlb=None, p50=None, p90=None, p50_interval=None,
            p90_interval=None, n=0, trials=[],
        ),
    },
    "noise": "usual",
    "excitation": "usual",
    "spot_checks": [
        {
            "effect": "offset", "noise": "high", "scale": 2.0, "bound_ratio": None, "p50": 0.8, "p90": 1.4,
            "seen": [{"foreseen": 0.5, "k": 0, "n": 4}, {"foreseen": 0.9, "k": 4, "n": 4}],
        }
    ],
}  # fmt: skip

REAL = {
    "cases": [
        {
            "case": "real-1",
            "what": "as recorded",
            "truth": ["asymmetric_coulomb"],
            "found": ["offset"],
            "verdict": "effect",
            "right": False,
            "parameter": {
                "effect": "cogging", "name": "a", "unit": "N", "true": 3.0, "found": 3.1, "std": 0.1, "within": True,
            },
            "gap": {"check": {"before": 0.061, "after": 0.041, "floor": 0.03}},
        },
        {**dict.fromkeys(("parameter", "gap")), "case": "real-2", "what": "delayed", "truth": ["time_delay"],
         "found": [], "verdict": "failed", "right": False},
    ]
}  # fmt: skip


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A score and nothing else."""
    study = tmp_path_factory.mktemp("bare")
    write_json(study / "blind.json", document({}))
    report(study)
    return study


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A score with baselines, everything beside it, and a ledger."""
    study = tmp_path_factory.mktemp("whole")
    guess = [answered(right(row), "effect", "stribeck") for row in rows()]
    guess[1] = right(guess[1])
    lucky = [right(row) for row in rows()]
    write_json(study / "blind.json", document({"guess": guess, "lucky": lucky}))
    write_json(study / "limits.json", LIMITS)
    write_json(study / "real.json", REAL)
    said = {
        "verdict": "effect",
        "effects": ["stribeck"],
        "ambiguous_with": [],
        "ranking": {},
        "seconds": 12.0,
        "commit": "c0ffee",
    }
    none = {**said, "verdict": "none", "effects": []}
    elsewhere = {"error": "ValueError: broken", "effects": [], "ranking": {}, "seconds": 1.0}
    variants = {"complete": {"case-01": said, "case-06": none, "case-99": said}}
    variants["no_whitening"] = {"case-01": none, "case-06": said, "case-03": elsewhere}
    write_json(study / "ablations.json", variants)
    made = {"law": {"offset": "a step of the sign"}, "parameters": {"offset": {"F0": {"value": 2.5, "unit": "N"}}}}
    write_json(study / "opened.json", {row.case: {"answer": made} for row in rows()})
    write_json(study / "results.json", {"commits": ["0123456789abcdef+"], "cases": {}})
    for name in ("seals.json", "baselines.json"):
        write_json(study / name, {})
    for step in ("seal", "diagnose", "baselines", "open", "score"):
        ledger.commit(study, step)
    report(study)
    return study


def page(study: Path) -> str:
    return (study / "report.html").read_text(encoding="utf-8")


def test_missing_parts_are_said_to_be_missing(bare: Path) -> None:
    html = page(bare)
    for name in ("baselines.json", "limits.json", "ablations.json", "real.json"):
        assert f"Not run: there is no {name} beside the score." in html
    assert "Baselines: not run." in html
    drawn = {path.stem for path in (bare / "figures").iterdir()}
    assert drawn == {"answers", "conditions", "effects", "confusion", "reliability", "gap"}
    assert html.count("<img ") == len(drawn)


def test_the_banner_says_what_is_synthetic_and_what_the_ledger_shows(bare: Path, whole: Path) -> None:
    without, with_all = (re.search(r'class="banner">(.*?)</div>', page(s)) for s in (bare, whole))
    assert without and with_all
    assert "What made the 10 cases is not known" in without[1] and "No ledger lies beside" in without[1]
    assert "opened once" not in page(bare)
    for said in ("All 10 cases are SYNTHETIC", "before any diagnosis", "opened once", "measured", "0123456789 with"):
        assert said in with_all[1]


def test_the_answer_comes_first_with_intervals(whole: Path) -> None:
    first = page(whole).split("<h2>")[0]
    assert "75.0 % of 4 cases (95 % interval 30.1 to 95.4)" in first
    assert "0.0 % of 2 cases" in first and "98.0 % (median" in first


def test_a_winning_baseline_is_named(whole: Path) -> None:
    html = page(whole)
    assert "lucky, is 25.0 points AHEAD; lucky wins on “one effect, typical size”." in html
    assert "lucky wins on “one effect, typical size”: 4 of 4 right, the diagnosis 3 of 4 (so few" in html
    assert "guess wins" not in html


def test_no_baseline_wins_is_said_as_well() -> None:
    score = document({"guess": [answered(right(row), "effect", "stribeck") for row in rows()]})
    assert words.wins(score) == []
    assert words.who_wins(score)[0].startswith("No baseline is ahead")
    assert any("none wins on any kind of case" in sentence for sentence in words.answer(score))


def test_every_wrong_case_is_listed_with_its_law(whole: Path) -> None:
    listed = page(whole).split("Every wrong answer: 1 of 10 cases")[1].split("</table>")[0]
    for said in ("case-02", "a step of the sign", "F0 2.5 N", "lead_friction"):
        assert said in listed.replace("\u00a0", " ")
    assert "5.0 → 2.1 % (noise 2.0)" in listed.replace("\u00a0", " ")


def test_the_page_stands_alone(bare: Path, whole: Path) -> None:
    for study in (bare, whole):
        html = re.sub(r'src="data:[^"]*"', "", page(study))
        assert not re.search(r"(https?:)?//[a-z]|<script|<link|src=|href=|@import|url\(", html)
    assert "x_<mains>" not in page(whole)  # names come from files


def figures(study: Path) -> dict[str, Figure]:
    found = gather(study)
    score = found["score"]
    plain = (answers_figure, groups_figure, effects_figure, confusion_figure, reliability_figure, gap_figure)
    out = {make.__name__: make(score) for make in (*plain, rivals_figure)}
    judged = ablated(found["ablations"], score)
    return out | {"limits_figure": limits_figure(found["limits"]), "ablations_figure": ablations_figure(judged)}


def test_every_axis_says_what_it_shows_and_in_which_unit(whole: Path) -> None:
    for name, figure in figures(whole).items():
        for ax in figure.axes:
            below_it = any(ax.get_shared_x_axes().joined(ax, other) for other in figure.axes if other is not ax)
            labels = [ax.get_xlabel()] if not (below_it and not ax.get_xlabel()) else []
            named = any(re.search("[a-z]", text.get_text()) for text in ax.get_yticklabels())
            blank = all(not text.get_text() for text in ax.get_yticklabels())
            labels += [] if named or blank else [ax.get_ylabel()]
            assert all(labels), name
            if name != "confusion_figure":
                assert all(re.search(r", (%|N|µm|1 )|noise floor|^cases", text) for text in labels), (name, labels)


def test_trials_are_marked_at_their_sizes() -> None:
    newton, micrometre = (
        next(ax for ax in limits_figure(LIMITS).axes if unit in ax.get_xlabel()) for unit in (", N", "µm")
    )
    marked = [line.get_xdata()[0] for line in newton.lines if line.get_marker() in ("|", "x")]
    assert marked == pytest.approx([0.3, 0.51, 0.69])
    assert [line.get_xdata()[0] for line in micrometre.lines if line.get_marker() == "|"] == pytest.approx([2.0])


def test_cases_with_several_effects_alone_have_a_page_too(tmp_path: Path) -> None:
    several = [row for row in rows() if row.stratum == "two"]
    found = {"schema": 1, "cases": 1, "headline": headline(several, {}), **summary(several), "rows": several}
    write_json(tmp_path / "blind.json", {**found, "baselines": {"blind": True, "methods": {}}})
    report(tmp_path)
    assert not (tmp_path / "figures" / "confusion.png").exists()


def test_limits_and_real_records_have_units_and_truth(whole: Path) -> None:
    html = page(whole).replace("\u00a0", " ")
    for said in (
        "<td>0.4 (0.3 to 0.5)</td>",
        "<td>µm</td>",
        "<td>below 2 (to more)</td>",
        "1 of 1, 1 of these by a twin&#39;s name",
        "not reached",
        "50 %: 0 of 4",
    ):
        assert said in html
    assert "a 3.1 ± 0.1 N (true 3)" in html and "MEASURED" in html


def test_ablations_are_judged_on_the_cases_of_the_study(whole: Path) -> None:
    found = gather(whole)
    complete, other = ablated(found["ablations"], found["score"])
    assert (complete.right["k"], complete.right["n"], complete.alarms["k"]) == (2, 2, 0)
    assert (other.right["k"], other.right["n"], other.alarms["k"], other.errors, other.behind) == (0, 3, 1, 1, 1.0)
    assert "1 cases are not of this study" in page(whole) and "commits unknown, c0ffee." in page(whole)
    assert set(WORDS) == set(ABLATIONS)


def test_how_a_case_was_answered() -> None:
    two = next(row for row in rows() if row.stratum == "two")
    for row, said in (
        (two, "exact"),
        (answered(two, "effect", "offset"), "part"),
        (answered(two, "effect", "offset", "cogging"), "wrong"),
        (answered(two, "none"), "missed"),
        (answered(two, "unexplained"), "abstained"),
        (dataclasses.replace(two, verdict="failed", accepted=False, exact=False), "failed"),
    ):
        assert how(dataclasses.asdict(row)) == said


def test_every_stratum_has_words() -> None:
    assert set(words.KINDS) == set(STRATA)
    assert words.ordered(["mine", "none", "single"]) == ["single", "none", "mine"]
    assert words.practical("N s2/m2", 1000) == (1.0, "N s²/m²")


def test_cases_of_another_team_are_not_called_synthetic() -> None:
    study = {"score": {"cases": 3}, "foreign": 3, "ledger": [], "real": None, "commits": []}
    assert "brought by another team" in words.banner(study) and "SYNTHETIC" not in words.banner(study)


def test_a_changed_score_is_refused(whole: Path, tmp_path: Path) -> None:
    for path in whole.glob("*.json*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    score = read_json(tmp_path / "blind.json", "")
    write_json(tmp_path / "blind.json", {**score, "cases": 1000})
    with pytest.raises(InputError, match=r"blind\.json: was changed"):
        report(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        main(["report", str(tmp_path / "nowhere")])
    assert stopped.value.code == 2
