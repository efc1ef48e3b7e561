"""What was published of a blind study holds together: ledger, seals, score and page; and README quotes that score."""

import re
import shutil
from pathlib import Path

import pytest

from experiments.blind.ablation_scores import ablated
from experiments.blind.layout import OPENED, SCORE, digest, read_json
from experiments.blind.ledger import verify
from experiments.blind.page import ABLATIONS, LIMITS, report
from experiments.blind.page_tables import headline
from experiments.blind.seal import verify_answers

STUDIES = Path(__file__).resolve().parents[1] / "experiments" / "blind" / "studies"
FOLDERS = sorted(path for path in STUDIES.iterdir() if path.is_dir())


@pytest.fixture(params=FOLDERS, ids=lambda path: path.name)
def study(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy: a page is written into it."""
    return Path(shutil.copytree(request.param, tmp_path / "study"))


def test_nothing_of_it_was_changed(study: Path) -> None:
    steps = verify(study)
    assert steps[0].step == "seal"
    if (study / OPENED).exists():
        verify_answers(study, read_json(study / OPENED, "answers"))


def test_the_page_can_be_written_from_what_was_published(study: Path) -> None:
    if not (study / SCORE).exists():
        pytest.skip("sealed and not scored yet")
    html = report(study).read_text(encoding="utf-8")
    assert "before any diagnosis" in html and "SYNTHETIC" in html
    assert digest(verify(study)[-1].line) in html


QUOTED = ("figure", "seen", "of", "95 % interval", "minimum", "reached")


def test_readme_quotes_the_newest_score() -> None:
    """Its table is that of the page, of every figure that has a target."""
    newest = next(path for path in reversed(FOLDERS) if (path / SCORE).exists())
    score = read_json(newest / SCORE, "the score")
    table = headline(score)
    rows = [{name: row[table.header.index(name)] for name in QUOTED} for row in table.rows]
    asked = [row for row in rows if row["minimum"] != "-"]
    text = (STUDIES.parents[2] / "README.md").read_text(encoding="utf-8")
    assert f"A study of {score['cases']} sealed cases" in text and newest.name in text
    for row in asked:
        assert f"| {' | '.join(row.values())} |".replace("\u00a0", " ") in text
    assert (len(asked), [row["reached"] for row in asked].count("MISSED")) == (17, 7)
    assert "Seven of seventeen targets are missed" in text
    visible = next(one for one in score["headline"] if one["what"] == "of these, a gap above 1.2 floors: accepted")
    assert f"{visible['k']} of the other {visible['n']}" in " ".join(text.split())


def test_readme_quotes_the_limits() -> None:
    """Every row of its table, the effects without a 90 % limit, and the spot checks."""
    found = read_json(FOLDERS[-1] / LIMITS, "limits")
    text = " ".join((STUDIES.parents[2] / "README.md").read_text(encoding="utf-8").split())
    rows = re.findall(r"\| (\w+) \| ([\d.]+) ([^|]+) \| ([\d.]+) ([^|]+) \|", text)
    rows = [row for row in rows if row[0] in found["effects"]]
    assert len(rows) == 10
    for name, *quoted in rows:
        one = found["effects"][name]
        for value, unit, key in zip(quoted[::2], quoted[1::2], ("p50", "p90"), strict=True):
            scale = 1.0 if unit == one["unit"] else {"m": 1e-3, "µ": 1e-6}[unit.removesuffix(one["unit"])]
            assert float(value) == float(f"{one[key] / scale:.2g}")
    lost = [name for name, one in found["effects"].items() if one["p90"] is None]
    assert f"reached at no size for {', '.join(lost[:-1])} and {lost[-1]}" in text
    for level, words in ((0.5, "named where 50 % were foreseen"), (0.9, "where 90 %")):
        seen = [at for check in found["spot_checks"] for at in check["seen"] if at["foreseen"] == level]
        assert f"{sum(at['k'] for at in seen)} of {sum(at['n'] for at in seen)} {words}" in text


def test_readme_quotes_the_ablations() -> None:
    """Its table, and which losses are beyond chance."""
    study = FOLDERS[-1]
    found = ablated(read_json(study / ABLATIONS, "ablations"), read_json(study / SCORE, "the score"))
    text = (STUDIES.parents[2] / "README.md").read_text(encoding="utf-8")
    for one in found:
        first, behind = ("nothing", "-") if one.behind is None else (one.words, f"{100 * one.behind:.0f}")
        counts = (f"{rate['k']} of {rate['n']}" for rate in (one.right, one.single, one.alarms))
        assert f"| {' | '.join((first, *counts, behind))} |" in text
    assert {one.name for one in found if one.p_value < 0.01} == {"didim_jacobian", "no_start"}
    edge = next(one for one in found if one.name == "force_only")
    assert (edge.lost, edge.won, edge.p_value) == (5, 0, pytest.approx(0.0625))
    assert (
        "Beyond chance are DIDIM's Jacobian and the initial state" in text and "five lost, none won, p = 0.06" in text
    )
