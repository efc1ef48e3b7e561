"""What was published of a blind study holds together: ledger, seals, score and page; and README quotes that score."""

import shutil
from pathlib import Path

import pytest

from experiments.blind.layout import OPENED, SCORE, digest, read_json
from experiments.blind.ledger import verify
from experiments.blind.page import report
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


def test_readme_quotes_the_newest_score() -> None:
    """Every count that stands there is one of blind.json."""
    newest = next(path for path in reversed(FOLDERS) if (path / SCORE).exists())
    score = read_json(newest / SCORE, "the score")
    figures = {one["what"]: one for one in score["headline"]}
    text = " ".join((STUDIES.parents[2] / "README.md").read_text(encoding="utf-8").split())
    assert f"A study of {score['cases']} sealed cases" in text
    for what, phrase in (
        ("single, typical size: accepted", "named in {k} of {n} ("),
        ("of these, a gap above 1.2 floors: accepted", "in {k} of the {n} whose gap is above"),
        ("both of two, nothing else", "both of two in {k} of {n}"),
        ("false alarm: none and numerics only", "an alarm in {k} of {n} with nothing to find"),
        ("wrong name among those named", "a name that is wrong, or one that is missing, in {k} of {n} that were named"),
        ("outside the catalogue: unexplained", "`unexplained` for {k} of {n} effects of no catalogue"),
        ("inside: falsely unexplained", "{k} of {n} of the catalogue"),
    ):
        assert phrase.format(**figures[what]) in text, what
    assert [one["met"] for one in score["headline"] if one["met"]].count("neither") == 7
    assert "Seven of seventeen targets are missed" in text
    assert f"off by {100 * figures['own parameter, median error']['value']:.1f} % in the median" in text
    scores = (figures[name]["value"] for name in ("Brier score", "expected calibration error"))
    assert "Brier score {:.2f}, calibration error {:.2f}".format(*scores) in text
