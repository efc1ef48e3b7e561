"""The blind protocol: nothing tells the answer before the seals are opened, whatever is changed is said, and the judge
follows the contract.
"""

import ast
import dataclasses
import json
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from didim_jax.errors import InputError
from experiments import blind
from experiments.blind import __main__ as command
from experiments.blind import diagnose as diagnosing
from experiments.blind import judge, ledger, plan
from experiments.blind.diagnose import diagnose
from experiments.blind.intervals import cases_needed, claim, lead_interval, quantile_interval, wilson
from experiments.blind.judge import agreement, blank_row, target
from experiments.blind.layout import canonical, case_names, read_json
from experiments.blind.ledger import verify
from experiments.blind.make import config_of, make
from experiments.blind.opening import open_seals, verify_all
from experiments.blind.plan import Config, compatible, draw
from experiments.blind.score import score
from experiments.blind.seal import seal, sealed, verify_answers
from experiments.blind.summary import brier, calibration
from experiments.blind.table import print_score
from experiments.study import read

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "configs" / "blind.toml"

EFFECTS = (*judge.BLOCKS, plan.ALIAS)
OUTSIDE = tuple(f"x_{k}" for k in range(8))
SAMPLES = 400


# ---- a simulator and a diagnosis that cost nothing ----


@dataclasses.dataclass(frozen=True)
class Wish:
    effects: tuple[str, ...] = ()
    size: float = 1.0
    spread: float = 0.25
    model: str = "flexible"
    load_encoder: bool = False
    noise: str = "usual"
    excitation: str = "usual"
    numerics: bool = False
    seed: int = 0


@dataclasses.dataclass(frozen=True)
class Made:
    fit: dict[str, np.ndarray]
    check: dict[str, np.ndarray]
    machine: str
    answer: dict[str, Any]


class Truth:
    """The interface of the truth simulator; it counts what it makes and refuses what it is told to."""

    EFFECTS, OUTSIDE, Wish = EFFECTS, OUTSIDE, Wish

    def __init__(self) -> None:
        self.wishes: list[Wish] = []
        self.refused: set[str] = set()
        self.unmoved: set[int] = set()

    def make(self, wish: Wish) -> Made:
        if self.refused & set(wish.effects) or wish.seed in self.unmoved:
            raise ValueError("the drive range is exceeded")
        self.wishes.append(wish)
        rng = np.random.default_rng(wish.seed)
        t = np.arange(SAMPLES) * 1e-3
        record = {"t": t, "vir": np.sin(20 * t) + 0.01 * rng.normal(size=SAMPLES), "gtau": np.array(35.15)}
        if wish.load_encoder:
            record["ql"] = t
        answer = {
            "effects": list(wish.effects),
            "floor": {"fit": 0.01, "check": 0.01},
            "parameters": {name: {"size": wish.size} for name in wish.effects},
        }
        return Made(record, record, f'model = "{wish.model}"\n', answer)

    def write(self, made: Made, folder: Path, name: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        scipy.io.savemat(folder / "fit.mat", made.fit)
        scipy.io.savemat(folder / "check.mat", made.check)
        (folder / "machine.toml").write_text(f'name = "{name}"\n{made.machine}')


@pytest.fixture
def truth(monkeypatch: pytest.MonkeyPatch) -> Truth:
    stub = Truth()
    monkeypatch.setattr(blind, "truth", stub, raising=False)  # whether or not the real one was imported
    return stub


def document(
    verdict: str = "none",
    effects: tuple[str, ...] = (),
    ambiguous: tuple[tuple[str, ...], ...] = (),
    block: str | None = None,
    **more: Any,
) -> dict[str, Any]:
    """A diagnosis that is sure of what it says."""
    first = {"none": "none", "unexplained": "other"}.get(verdict) or effects[0]
    ranking = [{"effect": name, "probability": float(name == first)} for name in {first, "none", "other"}]
    return {
        "verdict": verdict,
        "effects": list(effects),
        "ambiguous_with": [list(group) for group in ambiguous],
        "ranking": ranking,
        "parameters": {},
        "block": block,
        "gap": {"check": {"predicted_after": None}},
        **more,
    }


def write_diagnosis(folder: Path, check: Path, said: dict[str, Any], before: float = 0.5, after: float = 0.01) -> None:
    """With forces that leave these gaps: the recorded force, scaled."""
    record = scipy.io.loadmat(check)
    tau = np.ravel(record["vir"]) * float(record["gtau"].item())
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "simulation.npz", check_tau_before=tau * (1 - before), check_tau_after=tau * (1 - after))
    (folder / "prediction.json").write_text(json.dumps({"check": said["gap"]["check"]}))
    (folder / "diagnosis.json").write_text(json.dumps(said))


@pytest.fixture
def diagnosed(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """`diagnose_cases` that finds nothing anywhere; how often each case was diagnosed."""
    seen: Counter[str] = Counter()

    def diagnose_cases(
        cases: Any, out: Path, *, exclude: Any, effects: Path | None, workers: int, done: Callable
    ) -> list[str]:
        assert exclude == () and effects is None and workers > 0
        for case in cases:
            seen[case.name] += 1
            write_diagnosis(out / case.name, case.check, document())
            done(case, "none: -")
        return []

    monkeypatch.setattr("didim_jax.report.many.diagnose_cases", diagnose_cases)
    return seen


QUICK = Config(
    seed=1,
    workers=1,
    small_size=0.35,
    large_size=3.0,
    load_encoder=0.5,
    low_noise=0.2,
    high_noise=0.2,
    rigid=0.15,
    **dict.fromkeys(plan.STRATA, 0) | {"single": 2, "none": 1, "outside": 1, "alias": 1},
)


@pytest.fixture
def study(tmp_path: Path, truth: Truth) -> Path:
    """Five cases, made and sealed."""
    make(tmp_path, tmp_path / "answers", QUICK)
    seal(tmp_path, tmp_path / "answers")
    return tmp_path


@pytest.fixture
def opened(study: Path, diagnosed: Counter[str]) -> Path:
    """Diagnosed and opened as well."""
    diagnose(study)
    open_seals(study, study / "answers")
    return study


def edit(path: Path, change: Callable[[Any], None]) -> None:
    value = json.loads(path.read_text())
    change(value)
    path.write_text(json.dumps(value))


def refused(match: str) -> Any:
    return pytest.raises(InputError, match=match)


# ---- the plan ----


def whole_plan(seed: int = 5) -> list[plan.Planned]:
    table = read(CONFIG, [], quick=False)
    return draw(Config(**table), seed, EFFECTS, OUTSIDE)


def test_the_plan_holds_what_the_config_says():
    cases, table = whole_plan(), read(CONFIG, [], quick=False)
    assert Counter(case.stratum for case in cases) == {name: table[name] for name in plan.STRATA}
    assert [case.case for case in cases] == [f"case-{k + 1:04d}" for k in range(len(cases))]
    single = Counter(case.wish["effects"] for case in cases if case.stratum == "single")
    assert set(single) == {(name,) for name in EFFECTS if name != plan.ALIAS}
    assert max(single.values()) - min(single.values()) <= 1
    outside = Counter(case.wish["effects"] for case in cases if case.stratum == "outside")
    assert set(outside.values()) == {table["outside"] // len(OUTSIDE)}
    for name in ("single", "none", "outside"):
        wishes = [case.wish for case in cases if case.stratum == name]
        n = len(wishes)
        assert abs(sum(wish["load_encoder"] for wish in wishes) - 0.5 * n) <= 1
        assert abs(sum(wish["noise"] == "usual" for wish in wishes) - 0.6 * n) <= 1
        assert abs(sum(wish["model"] == "rigid" for wish in wishes) - 0.15 * n) <= 1
    assert {case.wish["size"] for case in cases} == {0.35, 1.0, 3.0}
    assert {case.stratum for case in cases if case.wish["numerics"]} == {"numerics"}
    assert {case.stratum for case in cases if case.wish["excitation"] == "poor"} == {"poor"}
    assert len({case.wish["seed"] for case in cases}) == len(cases)


def test_effects_that_need_a_coupling_are_never_asked_of_a_rigid_machine():
    for case in whole_plan():
        assert case.wish["model"] == "flexible" or not plan.FLEXIBLE_ONLY & set(case.wish["effects"])


def test_combinations_hold_no_twins():
    pairs = [case.wish["effects"] for case in whole_plan() if case.stratum in ("two", "three")]
    assert all(compatible(some) and plan.ALIAS not in some and len(set(some)) == len(some) for some in pairs)
    assert not compatible(("offset", "stribeck", "asymmetric_coulomb"))
    assert not compatible(("position_gain", "velocity_filter"))


def test_the_names_tell_nothing_of_the_stratum():
    """The place of a stratum's cases in the list is that of a random draw: no run of one stratum, no order of them."""
    first, second = whole_plan(5), whole_plan(6)
    assert whole_plan(5) == first and [c.stratum for c in first] != [c.stratum for c in second]
    n = len(first)
    for name in ("single", "none", "numerics"):
        places = [k for k, case in enumerate(first) if case.stratum == name]
        spread = n / np.sqrt(12 * len(places))
        assert abs(np.mean(places) - n / 2) < 4 * spread  # four standard deviations of a uniform draw's mean


def test_quick_is_a_handful():
    assert 5 <= len(draw(Config(**read(CONFIG, [], quick=True)), 1, EFFECTS, OUTSIDE)) <= 10


# ---- make ----


def assert_alike(study: Path) -> None:
    """Every folder holds the same files, keys and channels (but for ql and its mention, by a draw of its own)."""
    machines, channels = set(), set()
    for name in case_names(study):
        folder = study / "cases" / name
        assert sorted(path.name for path in folder.iterdir()) == ["check.mat", "fit.mat", "machine.toml"]
        assert name in (folder / "machine.toml").read_text()
        machines.add(re.sub(r"(?m)#.*$| +|[-\d.]+(e-?\d+)?|\"[^\"]*\"", "", (folder / "machine.toml").read_text()))
        for record in ("fit.mat", "check.mat"):
            channels.add(frozenset(k for k, *_ in scipy.io.whosmat(folder / record)) - {"ql"})
    assert len(machines) == len(channels) == 1


def test_public_files_are_alike_whatever_the_answer(study: Path):
    assert_alike(study)


@pytest.mark.slow
def test_public_files_of_the_real_simulator_are_alike(tmp_path: Path):
    """A case of every stratum; the plan knows every effect that the simulator refuses a rigid machine."""
    from experiments.blind import truth

    assert set(truth.FLEXIBLE_ONLY).issubset(plan.FLEXIBLE_ONLY)
    assert set(truth.EFFECTS) <= {*judge.BLOCKS, plan.ALIAS} and all(name.startswith("x_") for name in truth.OUTSIDE)
    make(tmp_path, tmp_path / "answers", dataclasses.replace(QUICK, **dict.fromkeys(plan.STRATA, 1)))
    assert_alike(tmp_path)
    seal(tmp_path, tmp_path / "answers")


def test_the_revealed_plan_makes_the_same_wishes(study: Path, truth: Truth, diagnosed: Counter[str], tmp_path: Path):
    diagnose(study)
    open_seals(study, study / "answers")
    before = list(truth.wishes)
    again = tmp_path / "again"
    command.main(["make", str(again), "--plan", str(study / "plan.json"), "--set", "workers=1"])
    assert truth.wishes[len(before) :] == before
    with refused("opened.json: is no plan of a study"):
        config_of(study / "opened.json", 1)


@pytest.mark.slow
def test_a_case_made_again_is_the_same_to_the_last_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from experiments.blind import truth

    made = truth.make(truth.Wish(("offset",), seed=3))
    truth.write(made, tmp_path / "one", "case")
    monkeypatch.setattr("time.asctime", lambda *when: "another day")
    truth.write(truth.make(truth.Wish(("offset",), seed=3)), tmp_path / "two", "case")
    for file in ("fit.mat", "check.mat", "machine.toml"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    assert scipy.io.loadmat(tmp_path / "one" / "fit.mat")["t"].size > 1000


def test_make_goes_on_and_keeps_what_is_there(tmp_path: Path, truth: Truth):
    truth.refused = {name for name in EFFECTS if name != plan.ALIAS}
    with refused(r"2 of 5 cases could not be made: case-\d+ \(single, .*drive range"):
        make(tmp_path, tmp_path / "answers", QUICK)
    kept = {path.name: path.read_text() for path in (tmp_path / "answers").glob("case-*.json")}
    with refused("not what was planned, 2 differ"):
        seal(tmp_path, tmp_path / "answers")
    truth.refused, before = set(), len(truth.wishes)
    make(tmp_path, tmp_path / "answers", QUICK)
    assert (len(kept), before, len(truth.wishes)) == (3, 3, 5)
    assert all((tmp_path / "answers" / name).read_text() == text for name, text in kept.items())
    with refused("another config"):
        make(tmp_path, tmp_path / "answers", dataclasses.replace(QUICK, none=2))
    with refused("another config"):
        make(tmp_path, tmp_path / "answers", dataclasses.replace(QUICK, seed=2))


def test_a_machine_that_cannot_be_moved_is_drawn_again(tmp_path: Path, truth: Truth):
    planned = {case.wish["seed"] for case in draw(QUICK, 1, EFFECTS, OUTSIDE)}
    truth.unmoved = {min(planned)}
    make(tmp_path, tmp_path / "answers", QUICK)
    assert len(truth.wishes) == 5 and len({wish.seed for wish in truth.wishes} & planned) == 4


def test_a_fresh_seed_is_drawn_and_lies_with_the_answers_alone(tmp_path: Path, truth: Truth):
    fresh = dataclasses.replace(QUICK, seed=None)
    seeds = set()
    for name in ("a", "b"):
        make(tmp_path / name, tmp_path / name / "answers", fresh)
        seed = read_json(tmp_path / name / "answers" / "plan.json", "plan")["seed"]
        seeds.add(seed)
        public = [path for path in (tmp_path / name / "cases").rglob("*") if path.is_file()]
        assert public and all(str(seed).encode() not in path.read_bytes() for path in public)
    assert len(seeds) == 2
    make(tmp_path / "a", tmp_path / "a" / "answers", fresh)  # the seed that was drawn is used again
    assert len(truth.wishes) == 10


def test_no_case_is_added_to_a_sealed_study(study: Path):
    with refused("sealed already"):
        make(study, study / "answers", QUICK)


# ---- seals ----


def test_the_seal_is_the_documented_hash(study: Path):
    """Anyone can compute it: SHA-256 of the salt's bytes and the rest in canonical JSON."""
    import hashlib

    name = case_names(study)[0]
    answer = read_json(study / "answers" / f"{name}.json", "answer")
    rest = json.dumps({k: answer[k] for k in sorted(answer) if k != "salt"}, sort_keys=True, separators=(",", ":"))
    expected = hashlib.sha256(bytes.fromhex(answer["salt"]) + rest.encode()).hexdigest()
    assert read_json(study / "seals.json", "seals")["cases"][name]["answer"] == expected == sealed(answer)
    assert canonical({"b": 1.5, "a": ["é"]}) == b'{"a":["\\u00e9"],"b":1.5}'


def test_no_public_file_holds_an_answer_or_a_salt(study: Path):
    public = b"".join(path.read_bytes() for path in study.rglob("*") if path.is_file() and "answers" not in path.parts)
    for name in case_names(study):
        answer = read_json(study / "answers" / f"{name}.json", "answer")
        assert answer["salt"].encode() not in public
        assert not any(effect.encode() in public for effect in answer["answer"]["effects"])


def test_an_outside_team_needs_cases_and_short_answers(tmp_path: Path, truth: Truth, diagnosed: Counter[str]):
    study, answers = tmp_path / "study", tmp_path / "elsewhere"
    answers.mkdir()
    truth.write(truth.make(Wish()), study / "cases" / "press-7", "press-7")
    given = {"case": "press-7", "stratum": "ours", "answer": {"effects": [], "floor": {"check": 0.01}}}
    (answers / "press-7.json").write_text(json.dumps(given))
    seal(study, answers)
    assert re.fullmatch("[0-9a-f]{64}", read_json(answers / "press-7.json", "answer")["salt"])
    diagnose(study)
    open_seals(study, answers)
    assert score(study)["strata"]["ours"]["accepted"]["k"] == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda a: a.update(case="another"), "case must be"),
        (lambda a: a.pop("stratum"), "stratum must be a text"),
        (lambda a: a.update(salt="aa"), "salt must be 64"),
        (lambda a: a["answer"].update(effects="offset"), "answer.effects must be"),
        (lambda a: a["answer"].pop("floor"), "answer.floor.check must be"),
        (lambda a: a.pop("answer"), "an answer is an object"),
    ],
)
def test_an_unusable_answer_is_not_sealed(tmp_path: Path, truth: Truth, change: Callable, said: str):
    make(tmp_path, tmp_path / "answers", QUICK)
    edit(tmp_path / "answers" / "case-0002.json", change)
    with refused(f"case-0002.json: {said}"):
        seal(tmp_path, tmp_path / "answers")
    assert not (tmp_path / "ledger.jsonl").exists()


# ---- the order of steps ----


def test_the_steps_in_order(opened: Path):
    score(opened)
    score(opened)  # says the same again: no new line
    assert [step.step for step in verify(opened)] == ["seal", "diagnose", "open", "score"]
    assert verify_all(opened) == "5 cases, seal -> diagnose -> open -> score: nothing was changed."


def test_a_step_out_of_order_is_refused(tmp_path: Path, truth: Truth, diagnosed: Counter[str]):
    make(tmp_path, tmp_path / "answers", QUICK)
    for step in (diagnose, lambda study: open_seals(study, study / "answers"), score):
        with refused("out of order: nothing is sealed yet"):
            step(tmp_path)
    seal(tmp_path, tmp_path / "answers")
    with refused("open is out of order: no diagnosis was committed"):
        open_seals(tmp_path, tmp_path / "answers")
    with refused("score is out of order: the seals are not open yet"):
        score(tmp_path)
    with refused("seal is out of order: the study is sealed already"):
        seal(tmp_path, tmp_path / "answers")
    diagnose(tmp_path)
    open_seals(tmp_path, tmp_path / "answers")
    with refused("diagnose is out of order: the seals are open, and what is made after that is not blind"):
        diagnose(tmp_path)
    with refused("the seals are open already"):
        open_seals(tmp_path, tmp_path / "answers")


# ---- diagnose ----


def test_diagnose_works_where_the_answers_are_not(study: Path, tmp_path_factory: Any, diagnosed: Counter[str]):
    elsewhere = tmp_path_factory.mktemp("kept") / "answers"
    (study / "answers").rename(elsewhere)
    diagnose(study)
    assert not (study / "answers").exists() and set(diagnosed.values()) == {1} and len(diagnosed) == 5
    results = read_json(study / "results.json", "results")
    assert set(results["cases"]["case-0001"]) == {"diagnosis.json", "prediction.json", "simulation.npz"}
    assert len(results["commits"]) == 1
    open_seals(study, elsewhere)
    assert score(study)["cases"] == 5


def test_diagnose_goes_on_where_it_was(study: Path, diagnosed: Counter[str]):
    write_diagnosis(study / "diagnoses" / "case-0003", study / "cases" / "case-0003" / "check.mat", document())
    head = diagnose(study)
    assert set(diagnosed) == {f"case-{k:04d}" for k in (1, 2, 4, 5)}
    assert diagnose(study) == head  # nothing to do, nothing to enter


def test_what_failed_may_be_tried_again_and_nothing_else(study: Path, diagnosed: Counter[str]):
    """A diagnosis that was committed cannot be replaced, by taking it away or all the results."""
    failed = study / "diagnoses" / "case-0002"
    diagnose(study)
    results = study / "results.json"
    kept = failed / "diagnosis.json"
    kept.rename(study / "kept.json")
    with refused("case-0002/diagnosis.json: is missing since the results were committed"):
        diagnose(study)
    results.rename(study / "kept-results.json")
    with refused("results.json: no such file"):
        diagnose(study)
    assert diagnosed["case-0002"] == 1

    (study / "kept-results.json").rename(results)
    (study / "ledger.jsonl").write_text((study / "ledger.jsonl").read_text().splitlines()[0] + "\n")
    edit(results, lambda r: r["cases"].update({"case-0002": {"error.txt": "0" * 64}}))
    diagnose(study)
    assert (diagnosed["case-0002"], diagnosed["case-0001"]) == (2, 1)


def test_a_diagnosis_that_came_after_the_commitment_is_said(study: Path, diagnosed: Counter[str]):
    diagnose(study)
    (study / "diagnoses" / "case-0003" / "error.txt").write_text("was never here")
    for step in (diagnose, lambda study: open_seals(study, study / "answers"), verify_all):
        with refused("case-0003/error.txt: was added since the results were committed"):
            step(study)


def test_diagnoses_before_the_seal_are_refused(tmp_path: Path, truth: Truth):
    make(tmp_path, tmp_path / "answers", QUICK)
    (tmp_path / "diagnoses").mkdir()
    with refused("diagnoses: there are diagnoses before there is a seal"):
        seal(tmp_path, tmp_path / "answers")


def test_the_plan_is_sealed_and_shown(study: Path, diagnosed: Counter[str]):
    """So that cases of it that are missing would show, and all can be made again."""
    diagnose(study)
    planned = (study / "answers" / "plan.json").read_text()
    edit(study / "answers" / "plan.json", lambda p: p.update(seed=2))
    with refused("answers/plan.json: the plan was changed since it was sealed"):
        open_seals(study, study / "answers")
    (study / "answers" / "plan.json").write_text(planned)
    open_seals(study, study / "answers")
    assert (study / "plan.json").read_text() == planned
    (study / "plan.json").unlink()
    with refused("plan.json: the plan is missing since it was sealed"):
        verify_all(study)


def test_a_score_that_was_not_judged_is_said(opened: Path):
    """Entered in the ledger as a score is, and still not what answers and diagnoses give."""
    score(opened)
    edit(opened / "blind.json", lambda b: b["strata"]["none"]["accepted"].update(k=0))
    ledger.commit(opened, "score")
    with refused("blind.json: judged anew, strata.none.accepted.k is another"):
        verify_all(opened)


def test_a_ledger_written_anew_does_not_hold_the_published_hash(opened: Path):
    published = ledger.head(ledger.read(opened)[:2])
    verify_all(opened, published)
    with refused("no line of its ledger has the hash 1234"):
        verify_all(opened, "1234")


def test_baselines_that_have_not_answered_everything_stay_closed(study: Path, diagnosed: Counter[str]):
    diagnose(study)
    path = study / "baselines.json"
    answers = {case: {"effects": [], "ranking": {"none": 1.0}} for case in case_names(study)}
    path.write_text(json.dumps({"silent": answers | {"case-0004": {"effects": [], "ranking": None}}}))
    with refused("baselines.json: silent, case-0004: TypeError"):
        open_seals(study, study / "answers")
    path.write_text(json.dumps({"silent": {case: answers[case] for case in list(answers)[:-1]}}))
    with refused("baselines.json: silent has not answered case-0005; run the baselines to their end"):
        open_seals(study, study / "answers")
    assert not (study / "opened.json").exists()
    assert [step.step for step in verify(study)] == ["seal", "diagnose"]


def test_an_interrupted_commit_is_taken_up(study: Path, diagnosed: Counter[str]):
    diagnose(study)
    lines = (study / "ledger.jsonl").read_text().splitlines()
    (study / "ledger.jsonl").write_text(lines[0] + "\n")  # as if stopped between results.json and its line
    diagnose(study)
    assert [step.step for step in verify(study)] == ["seal", "diagnose"]


def test_diagnose_never_speaks_of_answers():
    text = Path(diagnosing.__file__).read_text(encoding="utf-8")
    assert "answers" not in text.lower() and "OPENED" not in text


def test_the_package_imports_no_experiment():
    for path in (ROOT / "didim_jax").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.split(".")[0] == "experiments" for name in names), path


# ---- tampering ----


def test_a_changed_answer_is_said(study: Path, diagnosed: Counter[str]):
    diagnose(study)
    for change in (
        lambda a: a["answer"].update(effects=["offset"]),
        lambda a: a.update(stratum="poor"),
        lambda a: a.update(salt="0" * 64),
    ):
        path = study / "answers" / "case-0004.json"
        kept = path.read_text()
        edit(path, change)
        with refused("case-0004: its answer, stratum or salt was changed since it was sealed"):
            open_seals(study, study / "answers")
        path.write_text(kept)
    assert not (study / "opened.json").exists()
    open_seals(study, study / "answers")


def test_answers_may_not_be_exchanged_or_missing(study: Path):
    documents = {name: read_json(study / "answers" / f"{name}.json", "answer") for name in case_names(study)}
    with refused("case-0001: its answer, stratum or salt was changed"):
        verify_answers(study, documents | {"case-0001": documents["case-0002"]})
    del documents["case-0003"]
    with refused("case-0003: its answer is missing"):
        verify_answers(study, documents)


def test_a_changed_record_is_said(study: Path, diagnosed: Counter[str]):
    record = study / "cases" / "case-0002" / "check.mat"
    kept = record.read_bytes()
    record.write_bytes(kept[:-1] + b"!")
    with refused("case-0002/check.mat: was changed since it was sealed"):
        diagnose(study)
    record.unlink()
    with refused("case-0002/check.mat: is missing since it was sealed"):
        diagnose(study)
    record.write_bytes(kept)
    (study / "cases" / "case-0099").mkdir()
    with refused("case-0099: was added after the cases were sealed"):
        diagnose(study)
    assert not diagnosed


def test_a_changed_result_is_said(study: Path, diagnosed: Counter[str]):
    diagnose(study)
    path = study / "diagnoses" / "case-0005" / "diagnosis.json"
    kept = path.read_text()
    edit(path, lambda d: d.update(verdict="unexplained"))
    for step in (diagnose, lambda study: open_seals(study, study / "answers"), verify_all):
        with refused("case-0005/diagnosis.json: was changed since the results were committed"):
            step(study)
    path.write_text(kept)
    edit(study / "results.json", lambda r: r["cases"].pop("case-0005"))
    with refused(r"results.json: was changed after line 2 \(diagnose\) of the ledger"):
        open_seals(study, study / "answers")


def test_results_changed_after_opening_are_said(opened: Path):
    (opened / "diagnoses" / "case-0001" / "simulation.npz").unlink()
    with refused("case-0001/simulation.npz: is missing since the results were committed"):
        score(opened)


def test_changed_seals_opened_answers_and_scores_are_said(opened: Path):
    score(opened)
    for name, step in (("seals.json", 1), ("opened.json", 3), ("blind.json", 4)):
        kept = (opened / name).read_text()
        (opened / name).write_text(kept + " ")
        with refused(rf"{name}: was changed after line {step} "):
            score(opened)
        (opened / name).write_text(kept)
    (opened / "blind.json").unlink()  # made again
    score(opened)


def test_a_line_taken_out_or_changed_is_said(opened: Path):
    path = opened / "ledger.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(lines[0] + lines[2])
    with refused(r"line 2 \(open\): the line before it was changed or taken out"):
        verify_all(opened)
    path.write_text("".join(lines).replace('"time":"2', '"time":"1', 1))
    with refused(r"line 2 \(diagnose\): the line before it was changed"):
        verify_all(opened)
    path.write_text("".join(lines[:2]))
    with refused(r"opened.json: no line of the ledger enters it: open was interrupted, or its line taken out"):
        diagnose(opened)
    path.write_text("nothing\n")
    with refused("line 1: is no line of a ledger"):
        verify_all(opened)
    path.unlink()
    with refused("seals.json: no line of the ledger enters it"):
        verify_all(opened)


def test_a_ledger_forged_out_of_order_is_said(study: Path, diagnosed: Counter[str]):
    """Hashes that fit do not make an order that is allowed."""
    diagnose(study)
    steps = ledger.read(study)
    forged = [steps[0]]
    for name in ("open", "diagnose"):
        forged.append(ledger.Step(name, steps[1].time, steps[1].content, ledger.head(forged)))
    (study / "ledger.jsonl").write_bytes(b"".join(step.line + b"\n" for step in forged))
    with refused(r"line 2 \(open\): out of order: no diagnosis was committed yet"):
        verify_all(study)


# ---- intervals ----


def test_wilson_against_known_values():
    """Newcombe, Statistics in Medicine 17, 1998, table I, method 3."""
    known = {
        (81, 263): (0.2553, 0.3662),
        (15, 148): (0.0624, 0.1605),
        (0, 20): (0.0, 0.1611),
        (1, 29): (0.0061, 0.1718),
    }
    for (k, n), expected in known.items():
        np.testing.assert_allclose(wilson(k, n), expected, atol=5e-5)
    assert wilson(0, 0) == (0.0, 1.0) and wilson(7, 7)[1] == 1.0


def test_a_rate_is_claimed_only_where_the_count_can_bear_it():
    assert claim(0, 110, 0.04, at_most=True).holds is True
    assert claim(0, 20, 0.04, at_most=True).holds is None
    assert claim(0, 20, 0.04, at_most=True).text == (
        "≤ 4 %: not claimable with 20 cases (the fewest that bear it: 93, all right)"
    )
    assert claim(10, 20, 0.95).holds is False
    assert claim(8, 8, 1.0).text == "≥ 100 %: not claimable with 8 cases (no number bears it)"
    assert claim(0, 0, 0.5).holds is None
    needed = cases_needed(0.01, at_most=True)
    assert claim(0, needed, 0.01, at_most=True).holds and claim(0, needed - 1, 0.01, at_most=True).holds is None


def test_quantile_intervals_hold_the_quantile_as_often_as_they_say():
    """Of 400 samples at least 95 % hold it, somewhat more as an end is a value; below 368 once in 500 times."""
    rng = np.random.default_rng(0)
    for n, percent, true in ((60, 10, np.log(1 / 0.9)), (25, 50, np.log(2))):
        found = [quantile_interval(rng.exponential(size=n).tolist(), percent) for _ in range(400)]
        held = sum(low <= true <= high for low, high in found)
        assert 368 <= held <= 399
    assert quantile_interval(range(35), 10) is None and quantile_interval(range(37), 10) is not None
    assert quantile_interval([1.0] * 5, 50) is None and quantile_interval([], 50) is None


def test_the_lead_on_the_same_cases():
    """Newcombe (1998), table II, method 10: 36 both right, 12 and 2 one alone, 0 neither."""
    ours = [True] * 48 + [False] * 2
    theirs = [True] * 36 + [False] * 12 + [True] * 2
    assert lead_interval(ours, theirs) == pytest.approx((0.0569, 0.3404), abs=1e-4)
    low, high = lead_interval([True, False] * 20, [True, False] * 20)
    assert -0.1 < low < 0 < high < 0.1 and high == pytest.approx(-low)
    low, high = lead_interval([True] * 3, [False] * 3)
    assert low == pytest.approx(0.206, abs=1e-3) and high == 1.0  # where a bootstrap would say 1 to 1
    assert lead_interval([], []) is None


# ---- the judge ----


@pytest.mark.parametrize(
    ("truth", "verdict", "found", "ambiguous", "expected"),
    [
        (["stribeck"], "effect", ["stribeck"], [], (True, True)),
        (["stribeck"], "effect", ["presliding"], [], (False, False)),
        (["stribeck"], "none", [], [], (False, False)),
        (["stribeck"], "unexplained", ["stribeck"], [], (False, False)),
        (["offset"], "ambiguous", ["asymmetric_coulomb"], [["asymmetric_coulomb", "offset"]], (False, True)),
        (["offset"], "ambiguous", ["offset"], [["asymmetric_coulomb", "offset"]], (True, True)),
        (["offset"], "effect", ["asymmetric_coulomb"], [["asymmetric_coulomb", "offset"]], (False, False)),
        (["offset"], "ambiguous", ["asymmetric_coulomb"], [], (False, False)),
        (["offset"], "ambiguous", ["asymmetric_coulomb"], [["offset", "asymmetric_coulomb", "a", "b"]], (False, False)),
        (["stribeck"], "ambiguous", ["presliding"], [["stribeck", "presliding"]], (False, False)),  # no listed twins
        (["backlash", "offset"], "effect", ["offset", "backlash"], [], (True, True)),
        (["backlash", "offset"], "effect", ["backlash"], [], (False, False)),
        (["backlash"], "effect", ["backlash", "offset"], [], (False, False)),
        (
            ["backlash", "offset"],
            "ambiguous",
            ["backlash", "asymmetric_coulomb"],
            [["asymmetric_coulomb", "offset"]],
            (False, True),
        ),
        ([], "none", [], [], (True, True)),
        ([], "unexplained", [], [], (False, False)),
        (["drive_gain"], "none", [], [], (True, True)),
        (["drive_gain"], "effect", ["drive_gain"], [], (False, False)),
        (["drive_gain", "offset"], "effect", ["offset"], [], (True, True)),
        (["x_notch"], "unexplained", ["offset"], [], (True, True)),
        (["x_notch"], "effect", ["offset"], [], (False, False)),
        (["x_notch", "offset"], "unexplained", [], [], (True, True)),
    ],
)
def test_what_is_exact_and_what_is_accepted(truth, verdict, found, ambiguous, expected):
    assert agreement(target(truth), verdict, found, ambiguous) == expected


def test_the_gap_is_measured_and_not_believed(opened: Path):
    """Forces scaled by 1 - g leave a gap of g; of a gap of 0.5 over a floor of 0.01, 0.1 left is 96 % of the energy."""
    sealed_answer = {
        "stratum": "single",
        "answer": {
            "effects": ["cogging"],
            "floor": {"check": 0.01},
            "parameters": {"cogging": {"A": {"value": 2.0, "unit": "N"}}, "offset": {"F0": 1.0}},
        },
    }
    said = document(
        "effect",
        ("cogging",),
        block="actuator",
        parameters={"cogging": {"a1": {"value": 1.32, "unit": "N"}, "b1": {"value": -1.76, "unit": "N"}}},
        gap={"check": {"before": 0.0, "after": 0.0, "predicted_after": 0.12}},
    )
    check = opened / "cases" / "case-0001" / "check.mat"
    write_diagnosis(opened / "diagnoses" / "case-0001", check, said, 0.5, 0.1)
    row = judge.row(opened, "case-0001", sealed_answer)
    np.testing.assert_allclose([row.before, row.after, row.over_floor], [0.5, 0.1, 10.0], rtol=1e-9)
    np.testing.assert_allclose(row.closed, (0.5**2 - 0.1**2) / (0.5**2 - 0.01**2), rtol=1e-9)
    np.testing.assert_allclose(row.parameter_errors, [0.1])  # the amplitude is 2.2 N
    assert row.exact and row.block and row.predicted and row.first and not row.note

    write_diagnosis(opened / "diagnoses" / "case-0001", check, said | {"effects": []})
    row = judge.row(opened, "case-0001", sealed_answer)
    assert row.verdict == "failed" and "'effect' with 0 effects" in row.note

    (opened / "diagnoses" / "case-0001" / "diagnosis.json").unlink()
    row = judge.row(opened, "case-0001", sealed_answer)
    assert (row.verdict, row.accepted, row.closed) == ("failed", False, 0.0) and "no such file" in row.note
    assert row.visible  # or it would leave the count of those that should have been seen
    assert brier(row) == 2.0


def test_pulses_are_judged_by_where_they_enter():
    into_volts = {"block": {"disturbance_pulses": "actuator"}}
    assert judge.block_right("disturbance_pulses", into_volts, "actuator")
    assert not judge.block_right("disturbance_pulses", into_volts, "environment")
    assert judge.block_right("disturbance_pulses", {}, "environment")
    for side in ("motor side", "load side"):
        assert judge.block_right("stribeck", {"block": {"stribeck": "load side"}}, side)
    assert not judge.block_right("stribeck", {}, "coupling")


def judged(effects: tuple[str, ...], ranking: dict[str, float], verdict: str = "effect") -> judge.Row:
    blank = blank_row("case", {"stratum": "single", "answer": {"effects": list(effects)}})
    first = max(ranking, key=lambda name: ranking[name])
    return judge.judge(blank, {"verdict": verdict, "effects": [first], "ranking": ranking})


def test_brier_and_calibration_by_hand():
    rows = [
        judged(("offset",), {"offset": 0.9, "none": 0.1}),
        judged(("offset",), {"stribeck": 0.9, "offset": 0.1}),
        judged(("x_notch",), {"stribeck": 0.6, "none": 0.4}),
    ]
    np.testing.assert_allclose([brier(r) for r in rows], [0.02, 1.62, 0.36 + 0.16 + 1])
    found = calibration(rows)
    # two at 0.9 of which half are right, one at 0.6 that is not
    np.testing.assert_allclose(found["expected_calibration_error"], (2 * 0.4 + 0.6) / 3)
    assert [(one["from"], one["right"]["k"], one["right"]["n"]) for one in found["reliability"]] == [
        (0.6, 0, 1),
        (0.9, 1, 2),
    ]
    with pytest.raises(ValueError, match="sum to 1"):
        judged(("offset",), {"offset": 0.9})


# ---- the whole ----


def test_a_study_is_scored_stratum_by_stratum(study: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any):
    """One single right, one named wrongly, none an alarm, the alias absorbed, the unknown one unexplained."""
    answers = {name: read_json(study / "answers" / f"{name}.json", "answer") for name in case_names(study)}
    of = {name: [case for case, answer in answers.items() if answer["stratum"] == name] for name in plan.STRATA}
    right, wrong = of["single"]
    effect = answers[right]["answer"]["effects"][0]
    other = "stribeck" if answers[wrong]["answer"]["effects"] != ["stribeck"] else "backlash"
    own = {effect: {"size": {"value": 1.1}}}
    said = {
        right: document("effect", (effect,), block=min(judge.BLOCKS[effect]), parameters=own),
        wrong: document("effect", (other,)),
        of["none"][0]: document("unexplained"),
        of["alias"][0]: document("none"),
        of["outside"][0]: document("unexplained"),
    }

    def diagnose_cases(cases: Any, out: Path, **options: Any) -> list[str]:
        for case in cases:
            write_diagnosis(out / case.name, case.check, said[case.name])
        return []

    monkeypatch.setattr("didim_jax.report.many.diagnose_cases", diagnose_cases)
    diagnose(study)
    silent = {case: {"effects": [], "ranking": {"none": 1.0}, "seconds": 0.1} for case in answers}
    failing = {case: {"effects": [], "ranking": {}, "error": "ValueError"} for case in answers}
    (study / "baselines.json").write_text(json.dumps({"silent": silent, "failing": failing}))
    open_seals(study, study / "answers")
    found = score(study)
    assert [step.step for step in verify(study)] == ["seal", "diagnose", "baselines", "open", "score"]
    figures = {one["what"]: one for one in found["headline"]}

    def count(what: str) -> tuple[int, int]:
        return figures[what]["k"], figures[what]["n"]

    assert count("single, typical size: accepted") == count("single, typical size: exact") == (1, 2)
    assert count("false alarm: none and numerics only") == count("of these, unexplained") == (1, 1)
    assert count("exact alias answered as absorbed") == (1, 1)
    assert count("outside the catalogue: unexplained") == (1, 1)
    assert count("wrong name among those named") == (1, 2)
    assert count("both of two, nothing else") == (0, 0)
    np.testing.assert_allclose(figures["own parameter, median error"]["value"], 0.1)
    np.testing.assert_allclose(figures["accepted, ahead of the best baseline (silent)"]["value"], 0.5)
    assert figures["single, typical size: accepted"]["met"] == "neither"
    assert found["confusion"][effect] == {effect: 1} and found["confusion"]["none"] == {"other": 1}
    assert found["baselines"]["blind"] is True
    silence = found["baselines"]["methods"]["silent"]["strata"]
    assert (silence["none"]["accepted"]["k"], silence["single"]["accepted"]["k"]) == (1, 0)
    assert found["baselines"]["methods"]["failing"]["strata"]["none"]["accepted"]["k"] == 0
    assert found["groups"]["effect"][effect]["accepted"]["k"] == 1
    assert {row["case"] for row in found["rows"]} == set(answers)
    print_score(found)
    assert "beside the baselines" in capsys.readouterr().out
    edit(study / "baselines.json", lambda b: b.pop("failing"))
    with refused("baselines.json: was changed after line 3"):
        score(study)


def test_the_command_runs_every_step(tmp_path: Path, truth: Truth, diagnosed: Counter[str], capsys: Any):
    study = str(tmp_path / "study")
    command.main(["make", study, "--quick", "--set", "workers=1"])
    for step in ("seal", "diagnose", "open"):
        command.main([step, study])
        assert re.search(r"ledger: [0-9a-f]{64}", capsys.readouterr().out)
    command.main(["score", study])
    assert "false alarm" in capsys.readouterr().out
    command.main(["verify", study])
    assert "nothing was changed" in capsys.readouterr().out
    with pytest.raises(SystemExit) as end:
        command.main(["diagnose", study])
    assert end.value.code == 2 and capsys.readouterr().err.count("\n") == 1
    for step in command._STEPS:
        with pytest.raises(SystemExit):
            command.main([step, "--help"])
        assert "Reads" in capsys.readouterr().out
