"""One diagnosis judged against its answer, by the rules of the contract and not by the diagnosis's own word."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.signal

from .layout import CASES, DIAGNOSES, read_json
from .main_parameter import MAIN, Main, amplitude
from .plan import ALIAS, TWINS

_FRICTION = (
    "asymmetric_coulomb asymmetric_viscous stribeck quadratic_viscous position_friction lead_friction local_friction "
    "presliding load_dependent_friction friction_drift"
)
_BLOCKS = {
    ("controller",): "position_gain velocity_gain velocity_filter",
    ("actuator",): "amplifier_lag time_delay saturation amplifier_dead_zone gain_nonlinearity cogging",
    ("motor side", "load side"): _FRICTION,
    ("coupling",): "coupling_damping cubic_stiffness backlash transmission_error",
    ("load side",): "second_flexible_mode payload_change",
    ("sensor",): "encoder_periodic_error encoder_quantisation",
    ("base",): "base_flexibility",
    ("environment",): "offset cable_spring disturbance_pulses",
}
BLOCKS = {name: set(blocks) for blocks, names in _BLOCKS.items() for name in names.split()}
"""Effect to the blocks of the loop that it may be reported in: of friction either side, few records tell them apart."""

NONE: tuple[str, ...] = ("none",)
OTHER: tuple[str, ...] = ("other",)

_NAMING = ("effect", "ambiguous")
_VERDICTS = ("none", *_NAMING, "unexplained")

_CUTOFF_HZ = 60.0
VISIBLE = 1.2
"""Times the floor from which a gap is seen without knowing what to look for."""

_WORTH_CLOSING = 1.5  # times the floor: below that the share of the gap closed is noise
_PREDICTED = 0.25


@dataclasses.dataclass(frozen=True)
class Row:
    """What is judged of one case; None where it does not apply."""

    case: str
    stratum: str
    truth: tuple[str, ...]
    target: tuple[str, ...]
    noise: str | None
    load_encoder: bool | None
    model: str | None
    verdict: str = "failed"
    found: tuple[str, ...] = ()
    exact: bool = False
    accepted: bool = False
    first: bool = False
    first_three: bool = False
    block: bool = False
    ranking: Mapping[str, float] = dataclasses.field(default_factory=dict)
    before: float | None = None
    after: float | None = None
    floor: float | None = None
    closed: float | None = None
    over_floor: float | None = None
    predicted: bool = False
    parameter_errors: tuple[float, ...] = ()
    note: str = ""

    @property
    def kind(self) -> str:
        """none (also what is absorbed), outside, single or several."""
        if self.target in (NONE, OTHER):
            return "none" if self.target == NONE else "outside"
        return "single" if len(self.target) == 1 else "several"

    @property
    def inside(self) -> bool:
        """Whether the catalogue holds what is to be found."""
        return self.kind in ("single", "several")

    @property
    def visible(self) -> bool:
        """Whether the gap stands out of the noise on the check record; of a case that failed, it is taken to."""
        return self.before is None or self.floor is None or self.before > VISIBLE * self.floor

    @property
    def named(self) -> bool:
        """Whether the diagnosis names an effect."""
        return self.verdict in _NAMING


def foretold(predicted: float | None, after: float) -> bool:
    """Whether what would be left on the check record was said beforehand to a quarter."""
    return predicted is not None and abs(predicted / after - 1) <= _PREDICTED


def row(study: Path, case: str, sealed: Mapping[str, Any]) -> Row:
    """Judge one case; a missing or broken diagnosis is a wrong one, and says why."""
    answer = sealed["answer"]
    blank = blank_row(case, sealed)
    try:
        document = read_json(study / DIAGNOSES / case / "diagnosis.json", "the diagnosis")
        foreseen = read_json(study / DIAGNOSES / case / "prediction.json", "what was predicted")
        with np.load(study / DIAGNOSES / case / "simulation.npz", allow_pickle=False) as simulation:
            before, after = (
                gap(study / CASES / case / "check.mat", simulation, stage) for stage in ("before", "after")
            )
        judged = judge(blank, document)
        predicted = foreseen["check"]["predicted_after"]
        floor = answer["floor"]["check"]
        before = answer.get("before", {}).get("check", before)
        worth = blank.inside and before > _WORTH_CLOSING * floor
        return dataclasses.replace(
            judged,
            block=block_right(blank.target[0], answer, document.get("block")),
            before=before,
            after=after,
            closed=min((before**2 - after**2) / (before**2 - floor**2), 1.0) if worth else None,
            over_floor=after / floor if floor > 0 else None,
            predicted=foretold(predicted, after),
            parameter_errors=parameter_errors(document, answer),
        )
    except Exception as error:  # whatever a diagnosis lacks
        said = " ".join(f"{type(error).__name__}: {error}".split())
        return dataclasses.replace(blank, closed=0.0 if blank.inside else None, note=said[-120:])


def blank_row(case: str, sealed: Mapping[str, Any]) -> Row:
    """What is asked, with nothing answered."""
    effects = tuple(sealed["answer"]["effects"])
    return Row(
        case,
        sealed["stratum"],
        effects,
        target(effects),
        noise=sealed.get("noise"),
        load_encoder=sealed.get("load_encoder"),
        model=sealed.get("model"),
        floor=sealed["answer"].get("floor", {}).get("check"),
    )


def block_right(effect: str, answer: Mapping[str, Any], block: str | None) -> bool:
    """Whether the effect may be reported there: pulses by where they enter, which the answer may say."""
    allowed = BLOCKS.get(effect, {block})
    told = answer.get("block", {}).get(effect)
    return block in (allowed if told is None or len(allowed) > 1 else {told})


def target(effects: Sequence[str]) -> tuple[str, ...]:
    """What the right answer names: `other` where an effect is in no catalogue, `none` where all is absorbed."""
    if any(name.startswith("x_") for name in effects):
        return OTHER
    return tuple(name for name in effects if name != ALIAS) or NONE


def judge(blank: Row, document: Mapping[str, Any]) -> Row:
    """Verdict, names and ranking held against the target: of a diagnosis, or of a baseline that has no more."""
    found = tuple(document["effects"])
    ranking = probabilities(document["ranking"])
    order = sorted(ranking, key=lambda name: -ranking[name])
    verdict = document["verdict"]
    if verdict not in _VERDICTS or (verdict in _NAMING and not found):
        raise ValueError(f"verdict {verdict!r} with {len(found)} effects: is none of the contract's")
    exact, accepted = agreement(blank.target, verdict, found, document.get("ambiguous_with") or [])
    return dataclasses.replace(
        blank,
        verdict=verdict,
        found=found,
        exact=exact,
        accepted=accepted,
        first=order[0] in blank.target,
        first_three=bool(set(order[:3]) & set(blank.target)),
        ranking=ranking,
    )


def agreement(
    wanted: Sequence[str], verdict: str, found: Sequence[str], ambiguous: Sequence[Sequence[str]]
) -> tuple[bool, bool]:
    """Exact: all that is wanted is named, nothing else. Accepted: an admitted twin may stand for one of them."""
    if silent := {NONE: "none", OTHER: "unexplained"}.get(tuple(wanted)):
        return (verdict == silent,) * 2
    if verdict not in _NAMING:
        return False, False
    groups = [set(group) for group in ambiguous if len(group) <= 3] if verdict == "ambiguous" else []
    left = list(found)
    for name in wanted:
        admitted = (other for other in left if {other, name} in TWINS and any({other, name} <= some for some in groups))
        hit = name if name in left else next(admitted, None)
        if hit is None:
            return False, False
        left.remove(hit)
    return sorted(found) == sorted(wanted), not left


def probabilities(ranking: Sequence[Mapping[str, Any]] | Mapping[str, float]) -> dict[str, float]:
    """Name to probability. Raises ValueError: they are none."""
    pairs = ranking.items() if isinstance(ranking, Mapping) else ((r["effect"], r["probability"]) for r in ranking)
    p = {name: float(value) for name, value in pairs}
    if not p or min(p.values()) < 0 or max(p.values()) > 1 or abs(sum(p.values()) - 1) > 1e-3:
        raise ValueError("ranking: probabilities must lie in [0, 1] and sum to 1")
    return p


def gap(check: Path, simulation: Mapping[str, np.ndarray], stage: str) -> float:
    """norm(F(tau - tau_sim)) / norm(F(tau)) on the check record, tau from the record, F a 60 Hz low-pass."""
    record = scipy.io.loadmat(check)
    period = float(np.median(np.diff(np.ravel(record["t"]))))
    tau = np.ravel(record["vir"]).astype(float) * float(np.squeeze(record["gtau"]))
    simulated = np.ravel(simulation[f"check_tau_{stage}"])
    if simulated.shape != tau.shape or not np.isfinite(simulated).all():
        raise ValueError(f"check_tau_{stage}: wrong length or not finite")
    low_pass = scipy.signal.butter(4, 2 * _CUTOFF_HZ * period, output="sos")
    left, whole = (scipy.signal.sosfiltfilt(low_pass, x) for x in (tau - simulated, tau))
    return float(np.linalg.norm(left) / np.linalg.norm(whole))


def parameter_errors(document: Mapping[str, Any], answer: Mapping[str, Any]) -> tuple[float, ...]:
    """|value / true - 1| of the main parameter of every effect that is in answer and diagnosis with one meaning.

    Of a sine and a cosine the amplitude counts. An answer that does not have the parameter under that name is compared
    by names.
    """
    errors = []
    for effect, true in answer.get("parameters", {}).items():
        if not isinstance(true, Mapping):
            continue
        found = document.get("parameters", {}).get(effect, {})
        main = MAIN.get(effect)
        if main is not None and main.name in true:
            pairs = [(main.name, estimate(main, found))]
        else:
            pairs = [(name, found[name]["value"]) for name in sorted(set(true) & set(found))]
        for name, value in pairs:
            told = true[name]
            right = told.get("value") if isinstance(told, Mapping) else told
            if isinstance(value, int | float) and isinstance(right, int | float) and right:
                errors.append(abs(value / right - 1))
    return tuple(errors)


def estimate(main: Main, found: Mapping[str, Any]) -> float | None:
    """The main parameter in a diagnosis; None where it has none in that unit."""
    parts = [found[name] for name in main.of if name in found]
    if not parts or len(parts) < len(main.of) or any(part.get("unit") != main.unit for part in parts):
        return None
    return amplitude(parts)
