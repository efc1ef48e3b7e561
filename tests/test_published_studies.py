"""What was published of a blind study holds together: its ledger, its seals, its score; and README quotes that score."""

from pathlib import Path

import pytest

from experiments.blind.ledger import verify
from experiments.blind.layout import OPENED, PLAN, SCORE, digest, read_json
from experiments.blind.page import report
from experiments.blind.seal import verify_answers

STUDIES = Path(__file__).resolve().parents[1] / "experiments" / "blind" / "studies"
FOLDERS = sorted(path for path in STUDIES.iterdir() if path.is_dir())


@pytest.fixture(params=FOLDERS, ids=lambda path: path.name)
def study(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy: a page is written into it."""
    for path in request.param.rglob("*"):
        if path.is_file():
            target = tmp_path / path.relative_to(request.param)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    return tmp_path


def test_nothing_of_it_was_changed(study: Path) -> None:
    steps = verify(study)
    assert steps[0].step == "seal"
    if (study / OPENED).exists():
        verify_answers(study, read_json(study / OPENED, "answers"))
