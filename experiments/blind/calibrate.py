"""The constants that turn evidence into probabilities and abstention, fitted on an open study; nothing is changed.

Only what was said already is weighed anew: `evidence` of every diagnosis.json goes through `didim_jax.gap.decide` with
other constants, no diagnosis is run again. The constants are the upper-case numbers of that module, all but those that
steer the search itself. What is maximised is the log probability given to what was true, under a prior about values
that never saw a case, `NEUTRAL`: about the present ones, set by hand on open cases, it would remember these. TWIN has
no say in that: it is set so that the truth is in the group that is named, and a group is named no more often than
needed.

It is judged on other effects than it was fitted on, twins counted as one: log score, Brier score, calibration error,
how often an effect of the catalogue is left unexplained, and how often one of no catalogue is not.

An open study is one whose cases were never sealed: cases, answers, and the diagnoses of `didim diagnose --cases`. One
that was sealed gave figures by being opened for the first time, and constants fitted on it would make them worthless:
it is refused, unless `--open` gives those figures up. `calibrated.json` then stays in its folder and says so.

References: A. Niculescu-Mizil, R. Caruana, *Predicting good probabilities with supervised learning*, ICML 2005.
"""

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize

from didim_jax.errors import InputError
from didim_jax.gap import decide
from didim_jax.gap.readings import CONTROLLER
from didim_jax.gap.verdict import FOREIGN, Findings, Quality, conclude

from ..study import write_json
from .judge import Row, blank_row, judge
from .layout import ANSWERS, DIAGNOSES, LEDGER, OPENED, SEALS, case_names, read_json
from .plan import with_twins
from .summary import calibration, mean

CALIBRATED = "calibrated.json"

_HELD = ("RELEVANT", "BESIDE", "PENALTY", "DRIFT")  # steers the search: another value needs other diagnoses
SEARCHED = (
    f"Not cross-validated are the constants of the search (hunt, search, score, noise; {', '.join(_HELD)}), what may "
    "be left of the control law or of a foreign record, and the form of the rules."
)
_TWIN = "TWIN"
_FOLDS = 5
_EVALUATIONS = 600
_FEWEST = 20
_LEAST = 1e-4  # probability given to the truth: a single surprise must not decide
_NEEDLESS = 0.25  # of a wrong answer, what a group costs whose first name alone was right


type Constants = Mapping[str, float]


@dataclasses.dataclass(frozen=True)
class Prior:
    """Where a fit starts, and the standard deviation of every constant's logarithm about that."""

    center: Constants
    width: float


NEUTRAL = Prior(
    {
        # Something else is as likely as not where a tenth is left, or a tenth of that is not noise.
        "LEFT": 0.01,
        "STRUCTURED": 0.1,
        "ODD": 0.1,
        # A tenth of a share more or less turns the odds by e, twice a quantity by eight: hardly a threshold.
        "SURE_NONE": 10.0,
        "SURE_STRUCTURED": 10.0,
        "SURE_ODD": 10.0,
        "SURE_LEFT": 3.0,
        "SURE_DRIFT": 3.0,
        # Likelihoods are taken at their word, laws for right to a percent.
        "TEMPERATURE": 1.0,
        "INEXACT": 0.01,
        # Odds of twenty to one tell two effects apart: e^3.
        "TWIN": 3.0,
    },
    width=1.5,  # four and a half times more or less is nothing odd: a slope of shares is known no better
)
"""Round numbers from what the constants mean."""


@dataclasses.dataclass(frozen=True)
class Seen:
    """One diagnosis and its answer, and what its verdict was drawn from."""

    blank: Row
    document: Mapping[str, Any]
    findings: Findings

    @classmethod
    def of(cls, blank: Row, document: Mapping[str, Any]) -> "Seen":
        """From diagnosis.json: what no step of the search lists as found was read off."""
        e = document["evidence"]
        named = tuple(document["effects"])
        found = tuple(name for stage in e["stages"] for name in stage["effects"])
        read = tuple(name for name in named if name not in found)
        # What is wrong in the controller takes part in the gap, as what was found does.
        adopted = (*(name for name in read if name in CONTROLLER), *found)
        numbers = Quality(**{field.name: e[field.name] for field in dataclasses.fields(Quality)})
        foreign = document["gap"]["fit"]["after"] > FOREIGN
        steps = tuple(_evidence(step) for step in e["steps"])
        return cls(blank, document, Findings(read, adopted, numbers, steps, tuple(e["order"]), foreign))

    @property
    def kinds(self) -> tuple[str, ...]:
        """What it holds: its effects, those left out of the catalogue too, twins as one; without any, itself."""
        return tuple(min(with_twins(name.removeprefix("x_"))) for name in self.blank.truth) or (self.blank.case,)


def _evidence(step: Mapping[str, Any]) -> decide.Evidence:
    likely, counts = (np.array(step[key], dtype=float) for key in ("log_likelihood", "parameters"))
    return decide.Evidence(tuple(step["effects"]), likely, counts, step["before"])


def present() -> dict[str, float]:
    """The constants as they are."""
    return {k: v for k, v in vars(decide).items() if k.isupper() and isinstance(v, float) and k not in _HELD}


def about_present() -> Prior:
    """About the constants as they are, to within a factor of e."""
    return Prior(present(), width=1.0)


@contextlib.contextmanager
def with_constants(constants: Constants) -> Iterator[None]:
    """`decide` with these constants; put back at the end."""
    old = {name: vars(decide)[name] for name in constants}
    try:
        for name in old:
            setattr(decide, name, constants[name])
        yield
    finally:
        for name, value in old.items():
            setattr(decide, name, value)


def rows(cases: Sequence[Seen], constants: Constants) -> list[Row]:
    """Every case concluded with these constants, and judged."""
    with with_constants(constants):
        return [judge(seen.blank, dataclasses.asdict(conclude(seen.findings))) for seen in cases]


def log_score(judged: Sequence[Row]) -> float:
    """Mean log probability that was given to what is true."""
    given = (sum(r.ranking.get(name, 0.0) for name in r.target) for r in judged)
    return float(np.mean([np.log(max(p, _LEAST)) for p in given]))


def fitted(cases: Sequence[Seen], prior: Prior) -> dict[str, float]:
    """The constants that maximise the log score under the prior, then TWIN."""
    start = prior.center
    names = [name for name in start if name != _TWIN]
    center = np.array([start[name] for name in names])
    weigh = [seen for seen in cases if len(seen.blank.target) == 1]
    if not weigh:
        return dict(start)

    def constants(z: np.ndarray) -> dict[str, float]:
        return dict(start) | dict(zip(names, (center * np.exp(prior.width * z)).tolist(), strict=True))

    def cost(z: np.ndarray) -> float:
        return -log_score(rows(weigh, constants(z))) + 0.5 * float(z @ z) / len(weigh)

    simplex = np.vstack([np.zeros(len(names)), 0.4 * np.eye(len(names))])
    options = {"initial_simplex": simplex, "maxfev": _EVALUATIONS, "xatol": 1e-2, "fatol": 1e-5}
    best = constants(scipy.optimize.minimize(cost, simplex[0], method="Nelder-Mead", options=options).x)
    if _TWIN not in start:
        return best
    tried = sorted({start[_TWIN], 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 13.0})

    def worth(twin: float) -> float:
        z = np.log(twin / start[_TWIN]) / prior.width
        return _grouped(rows(cases, best | {_TWIN: twin})) - 0.5 * z**2 / len(cases)

    return best | {_TWIN: max(tried, key=worth)}


def _grouped(judged: Sequence[Row]) -> float:
    """Accepted, less what needless groups cost."""
    needless = [r.verdict == "ambiguous" and r.exact for r in judged]
    return float(np.mean([r.accepted for r in judged]) - _NEEDLESS * np.mean(needless))


def cross_validated(cases: Sequence[Seen], prior: Prior, folds: int = _FOLDS) -> list[Row]:
    """Every case judged with constants that were fitted without any of its effects and without their twins.

    A fold judges the cases whose first effect is in it, and is fitted without every case that holds any effect of
    those. Folds of all that is connected through cases of several effects would not leak either, but where these are
    many they connect half of a study.
    """
    firsts = sorted({seen.kinds[0] for seen in cases})
    out = []
    for fold in range(min(folds, len(firsts))):
        judging = [seen for seen in cases if seen.kinds[0] in firsts[fold::folds]]
        held = {kind for seen in judging for kind in seen.kinds}
        out += rows(judging, fitted([seen for seen in cases if held.isdisjoint(seen.kinds)], prior))
    return out


def figures(judged: Sequence[Row]) -> dict[str, Any]:
    """What is compared: scores, and how often each kind of case is abstained from."""
    single = [r for r in judged if r.kind != "several"]
    found = calibration(single)
    return {
        "cases": len(judged),
        "log_score": log_score(single),
        "brier": found["brier"],
        "expected_calibration_error": found["expected_calibration_error"],
        "accepted": mean([float(r.accepted) for r in judged]),
        "exact": mean([float(r.exact) for r in judged]),
        "ambiguous": mean([float(r.verdict == "ambiguous") for r in judged]),
        "falsely_unexplained": mean([float(r.verdict == "unexplained") for r in judged if r.inside]),
        "outside_unexplained": mean([float(r.verdict == "unexplained") for r in judged if r.kind == "outside"]),
        "false_alarm": mean([float(r.verdict != "none") for r in judged if r.kind == "none"]),
    }


def compared(cases: Sequence[Seen], folds: int = _FOLDS) -> dict[str, Any]:
    """Figures with the constants as they are, and cross-validated: from neutral ones, and from those as they are."""
    return {
        "now": figures(rows(cases, present())),
        "cross_validated": figures(cross_validated(cases, NEUTRAL, folds)),
        "cross_validated_from_now": figures(cross_validated(cases, about_present(), folds)),
    }


def calibrate(study: Path, given_up: bool = False) -> dict[str, Any]:
    """Fit, cross-validate, and write calibrated.json. Raises InputError: not open, or too few diagnoses."""
    cases = read_cases(study, given_up)
    if len(cases) < _FEWEST:
        raise InputError(f"{study}: {len(cases)} usable diagnoses; at least {_FEWEST} are needed to fit anything.")
    document = {
        "note": f"Constants were fitted on these answers: no figure of this study is a blind one any more. {SEARCHED}",
        "now": present(),
        "suggested": fitted(cases, NEUTRAL),
        "figures": compared(cases),
        "as_written": figures([judge(seen.blank, seen.document) for seen in cases]),
    }
    write_json(study / CALIBRATED, document)
    return document


def read_cases(study: Path, given_up: bool) -> list[Seen]:
    """Answers and diagnoses of an open study; what has no diagnosis is left out. Raises InputError: it is not open."""
    if (study / SEALS).exists() or (study / LEDGER).exists():
        if not (study / OPENED).exists():
            raise InputError(f"{study}: its answers are sealed; a study that is still to be opened is never fitted on.")
        if not given_up:
            raise InputError(
                f"{study}: its figures come from a first opening, and fitting on it would make them worthless; "
                "use a study that was never sealed, or give the figures up with --open."
            )
        answers = read_json(study / OPENED, "the answers")
    else:
        names = case_names(study)
        answers = {name: read_json(study / ANSWERS / f"{name}.json", f"the answer of {name}") for name in names}
    cases = []
    for name in sorted(answers):
        path = study / DIAGNOSES / name / "diagnosis.json"
        if path.exists():
            cases.append(Seen.of(blank_row(name, answers[name]), read_json(path, "a diagnosis")))
    return cases


def print_calibration(document: Mapping[str, Any]) -> None:
    """Constants and figures, now and then."""
    print(f"{'constant':28} {'now':>9} {'suggested':>9}")
    for name, value in document["now"].items():
        print(f"{name:28} {value:9.4g} {document['suggested'][name]:9.4g}")
    columns = list(document["figures"].values())
    print(f"\n{'figure':28} {'now':>9} {'other effects':>13} {'from now':>9}")
    for name in columns[0]:
        shown = ("-" if column[name] is None else f"{column[name]:.4g}" for column in columns)
        print("{:28} {:>9} {:>13} {:>9}".format(name, *shown))
    print(f"\n{SEARCHED}\nNothing was changed: the constants are in didim_jax/gap/decide.py.")
