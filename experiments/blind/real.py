"""The measured EMPS records as cases whose answers are withheld, as they are and with an effect planted in them.

Two cases are the records themselves: the screw's friction is asymmetric (the authors say so and fitted it), and the
pulses that were added to the drive signal, with `pulses_N` removed. In the others a *digital plant* is put into the
record. What is exact about each of them:

A record of a closed loop states two things. The plant: this motion follows from this force. The law: this drive signal
follows from this reference and this measured position. The reference is free: nothing but the law contains it. A record
whose signals are changed therefore remains one of a real machine with that change in it, as long as the plant's
statement is still true, and the reference is replaced by the one from which the law, documented as before, makes the
new drive signal (`rebuilt`):

    qg[k] = qm[k] + (vir[k] / kv + dq[k]) / kp,   dq[k] = (qm[k] - qm[k-2]) / 2 dt

Friction, noise and screw are then those of the real machine, and no model takes part. The reference comes out as rough
as the encoder's counts make dq: this is a limit of these cases, not of the planted effect.

- gain: vir, kv and the drive's limit divided by 1 + e, gtau documented as before. The law holds as it did, and the true
  force is (1 + e) gtau vir: exactly `drive_gain`. M, Fv, Fc and all effects in newtons divided by 1 + e fit the record
  as well as before: the answer is the same as without it, with all of them smaller.
- delay: vir[k + d] recorded at k, reference rebuilt. The plant answers d samples after the drive signal and the law
  holds with no lag: exactly `time_delay`, T = d samples, in the drive, on top of what lag the machine has already. That
  one is taken from the case of the pulses, whose sharp edges show it and in which none is planted.
- late log: vir[k - d] recorded at k and nothing else changed. The motion now begins *before* the force that makes it,
  so that no drive explains it, and the law holds with a lag of d, so that no controller at these instants explains it:
  the signal was logged late. That is to be said, and no effect of the loop to be named for it.
- requantised: qm rounded to a coarser grid, reference rebuilt: exactly `encoder_quantisation`, the controller reads it.
- periodic error: a sin(2 pi qm / lead + p) added to qm, reference rebuilt: exactly `encoder_periodic_error`, again in
  the loop. Not rebuilt, the controller has read the encoder without it: the force tells nothing, and the law is broken
  by kv (kp error + its derivative). That the law is broken is to be said; the error may be named from it, no other.

The machine has its own asymmetry and whatever else nobody knows, so that a planted effect is one of several: it must be
among those found, and its size must be right. Nothing is asked of the others. `real/` is a study of its own, sealed,
diagnosed and opened in this order; records and cases are never committed. It is no blind test of the diagnosis, which
was developed on these two records of one machine, and its cases are the same each time: it shows what holds on them.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from didim_jax.machine import Machine
from didim_jax.report import prepare_folder

from ..data import EMPS_MACHINE, EMPS_RECORDS, emps_folder
from ..study import write_json
from .diagnose import diagnose
from .layout import ANSWERS, CASES, DIAGNOSES, OPENED, RESULTS, SEALS, read_json
from .ledger import read as steps_of
from .main_parameter import amplitude
from .opening import open_seals, verify_all
from .plan import ALIAS, TWINS
from .seal import seal

REAL = "real.json"

RULES: Mapping[str, str] = {
    "first": "named first",
    "pulses": "block actuator, every onset to 5 ms and none more",
    "planted": "named, or an admitted twin, in a verdict that names something",
    "absorbed": "the answer as without it: a test of units",
    "logged": "said in a remark, and no effect named for it",
}
"""What each kind of case asks for, besides a size within the tolerance."""

_FOLDER = "real"
_OWN = "asymmetric_viscous"

_GAIN = 0.08
_DELAY = 1  # samples
_GRID = 2e-6  # m, 40 counts
_PERIODIC, _PHASE = 2e-6, 0.7  # m, rad

_DFV = (166.7061 - 240.4236) / 2  # N s/m, the authors' Fv+ and Fv-
_ONSET = 5e-3  # s


@dataclasses.dataclass(frozen=True, eq=False)
class Record:
    """A measured run and what is documented of its loop; `pulses` as in the file, `volts` what a unit of them adds."""

    qg: np.ndarray
    qm: np.ndarray
    vir: np.ndarray
    gain: float
    kp: float
    kv: float
    limit: float
    dt: float
    pulses: np.ndarray | None = None
    volts: float = 0.0

    @classmethod
    def load(cls, path: Path, machine: Machine) -> "Record":
        """From a file of the data set."""
        found = scipy.io.loadmat(path)
        qg, qm, vir = (np.ravel(found[name]).astype(float) for name in ("qg", "qm", "vir"))
        gain, kp, kv = (float(found[name].item()) for name in ("gtau", "kp", "kv"))
        record = cls(qg, qm, vir, gain, kp, kv, machine.drive.limit, machine.controller.sample_time)
        if "pulses_N" not in found:
            return record
        pulses = np.ravel(found["pulses_N"]).astype(float)
        left, shape = (record.vir - record.law())[2:], pulses[2:]
        return dataclasses.replace(record, pulses=pulses, volts=float(shape @ left / (shape @ shape)))

    def speed(self) -> np.ndarray:
        """dq of the control law, m/s; not a number at the first two samples."""
        dq = np.full(len(self.qm), np.nan)
        dq[2:] = (self.qm[2:] - self.qm[:-2]) / (2 * self.dt)
        return dq

    def law(self) -> np.ndarray:
        """What the control law makes of reference and position, V; not a number at the first two samples."""
        return np.asarray(self.kv * (self.kp * (self.qg - self.qm) - self.speed()))

    def cut(self, start: int, stop: int | None = None) -> "Record":
        """Samples from `start` on."""
        at = slice(start, stop)
        pulses = None if self.pulses is None else self.pulses[at]
        return dataclasses.replace(self, qg=self.qg[at], qm=self.qm[at], vir=self.vir[at], pulses=pulses)

    def quiet(self) -> "Record":
        """Without its pulses being told."""
        return dataclasses.replace(self, pulses=None, volts=0.0)

    def variables(self) -> dict[str, Any]:
        """Of a .mat file in the form of the contract."""
        out = {
            "t": self.dt * np.arange(len(self.qm)),
            **{name: getattr(self, name) for name in ("qg", "qm", "vir", "kp", "kv")},
            "gtau": self.gain,
        }
        return out if self.pulses is None else out | {"pulses_N": self.pulses}


# -- digital plants ------------------------------------------------------------------------------------------------


def rebuilt(record: Record) -> Record:
    """With the reference from which the law makes vir; the first two samples, whose law reaches back, are left out."""
    told = record.vir if record.pulses is None else record.vir - record.volts * record.pulses
    qg = record.qm + (told / record.kv + record.speed()) / record.kp
    return dataclasses.replace(record, qg=qg).cut(2)


def relabelled(record: Record, e: float) -> Record:
    """The drive signal in another unit than the documented gain is meant for: drive_gain e."""
    scale = 1 / (1 + e)
    return dataclasses.replace(
        record,
        vir=scale * record.vir,
        kv=scale * record.kv,
        limit=scale * record.limit,
        volts=scale * record.volts,
    )


def delayed(record: Record, samples: int) -> Record:
    """The drive answers so many samples later: time_delay."""
    early = dataclasses.replace(
        record,
        vir=np.roll(record.vir, -samples),
        pulses=None if record.pulses is None else np.roll(record.pulses, -samples),
    )
    return rebuilt(early.cut(0, len(record.qm) - samples))


def logged_late(record: Record, samples: int) -> Record:
    """vir recorded so many samples late, nothing else."""
    late = dataclasses.replace(
        record,
        vir=np.roll(record.vir, samples),
        pulses=None if record.pulses is None else np.roll(record.pulses, samples),
    )
    return late.cut(samples)


def read_through(record: Record, sensor: Callable[[np.ndarray], np.ndarray], in_loop: bool = True) -> Record:
    """qm through another sensor, which the controller reads as well, or (not `in_loop`) only the recorder."""
    seen = dataclasses.replace(record, qm=sensor(record.qm))
    return rebuilt(seen) if in_loop else seen


def grid(step: float) -> Callable[[np.ndarray], np.ndarray]:
    """A sensor that rounds to the nearest step, m."""
    return lambda q: step * np.round(q / step)


def periodic(amplitude: float, phase: float, lead: float) -> Callable[[np.ndarray], np.ndarray]:
    """A sensor with an error that repeats with every turn of the screw, m and rad."""
    return lambda q: q + amplitude * np.sin(2 * np.pi * q / lead + phase)


# -- cases ---------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Planted:
    """A case: what is done to both records, what is true, and how the answer is judged.

    `rule`: one of `RULES`; of what was logged wrongly, `remark` is to be said and `also` may be named. `tolerance` of
    the size, relative.
    """

    what: str
    rule: str
    effects: tuple[str, ...]
    change: Callable[[Record], Record]
    parameter: tuple[str, str, float] | None = None
    tolerance: float | None = None
    also: tuple[str, ...] = ()
    remark: str = ""
    swapped: bool = False


def planted(lead: float, dt: float, volts: float) -> tuple[Planted, ...]:
    """Every case; `volts` of an injected pulse."""
    error = periodic(_PERIODIC, _PHASE, lead)
    late, logged = "x_late_log", "x_logged_periodic_error"
    return (
        Planted("the record as it is", "first", (_OWN,), lambda r: r, ("dFv", "N s/m", _DFV), 0.10),
        Planted(
            "injected pulses, not told",
            "pulses",
            ("disturbance_pulses",),
            lambda r: r.quiet(),
            ("A", "V", volts),
            0.02,
            swapped=True,
        ),
        Planted(
            f"drive signal relabelled by {1 + _GAIN:g}",
            "absorbed",
            (_OWN, ALIAS),
            lambda r: relabelled(r, _GAIN),
            ("M", "kg", 1 / (1 + _GAIN)),
            0.01,
        ),
        Planted(
            f"drive {_DELAY} sample late",
            "planted",
            (_OWN, "time_delay"),
            lambda r: delayed(r, _DELAY),
            ("T", "s", _DELAY * dt),
            0.2,
        ),
        Planted(
            f"drive signal logged {_DELAY} sample late",
            "logged",
            (_OWN, late),
            lambda r: logged_late(r, _DELAY),
            remark=f"vir lags the documented control law by {_DELAY} sample",
        ),
        Planted(
            "encoder requantised",
            "planted",
            (_OWN, "encoder_quantisation"),
            lambda r: read_through(r, grid(_GRID)),
            ("resolution", "m", _GRID),
            0.01,
        ),
        Planted(
            "periodic error of the encoder, in the loop",
            "planted",
            (_OWN, "encoder_periodic_error"),
            lambda r: read_through(r, error),
            ("a", "m", _PERIODIC),
            0.1,
        ),
        Planted(
            "periodic error of the recorder alone",
            "logged",
            (_OWN, logged),
            lambda r: read_through(r, error, in_loop=False),
            also=("encoder_periodic_error",),
            remark="vir differs from the documented control law",
        ),
    )


def real(study: Path) -> dict[str, Any] | None:
    """Make, seal, diagnose, open and judge the cases; write real.json. None, and a line, without the records."""
    folder = emps_folder()
    if folder is None:
        print("The measured records are not here: put them in a folder emps and name the one above it in DIDIM_DATA.")
        return None
    out = prepare_folder(study / _FOLDER)
    if not (out / SEALS).exists():
        make(out, folder)
    done = {step.step for step in steps_of(out)}
    if "seal" not in done:
        seal(out, out / ANSWERS)
    if "open" not in done:
        diagnose(out)
        open_seals(out, out / ANSWERS)
    verify_all(out)
    answers = read_json(out / OPENED, "the answers")
    found = {name: _document(out, name) for name in sorted(answers)}
    by_rule = {document["answer"]["rule"]: name for name, document in answers.items()}
    plain, lag = found[by_rule["first"]], own_lag(found[by_rule["pulses"]])
    rows = [judged(name, answers[name]["answer"], found[name], plain, lag) for name in sorted(answers)]
    document = {
        "schema": 1,
        "data": "measured (EMPS benchmark), effects planted as said",
        "commits": read_json(out / RESULTS, "the results")["commits"],
        "cases": rows,
    }
    write_json(study / REAL, document)
    return document


def make(out: Path, folder: Path) -> None:
    """Every case and its answer, before anything is sealed."""
    machine = Machine.load(EMPS_MACHINE)
    first, second = (Record.load(folder / name, machine) for name in EMPS_RECORDS)
    assert second.pulses is not None
    cases = planted(machine.screw_lead, first.dt, second.volts * float(np.abs(second.pulses).max()))
    prepare_folder(out / ANSWERS)
    for k, case in enumerate(cases, 1):
        name = f"real-{k}"
        fit, check = (second, first) if case.swapped else (first, second)
        _write(out / CASES / name, name, machine, case.change(fit), case.change(check))
        write_json(out / ANSWERS / f"{name}.json", _answer(name, case, second))


def _write(folder: Path, name: str, machine: Machine, fit: Record, check: Record) -> None:
    prepare_folder(folder)
    for file, record in (("fit.mat", fit), ("check.mat", check)):
        scipy.io.savemat(folder / file, record.variables(), oned_as="column")
    dataclasses.replace(
        machine,
        name=name,
        controller=dataclasses.replace(machine.controller, kp=fit.kp, kv=fit.kv),
        drive=dataclasses.replace(machine.drive, gain=fit.gain, limit=fit.limit),
    ).save(folder / "machine.toml")


def _answer(name: str, case: Planted, pulsed: Record) -> dict[str, Any]:
    """In the form of `seal`. What noise leaves of a measured record is not known: floor 0 claims nothing."""
    answer: dict[str, Any] = {
        "effects": list(case.effects),
        "floor": {"check": 0.0},
        "what": case.what,
        "rule": case.rule,
        "also": list(case.also),
        "remark": case.remark,
        "tolerance": case.tolerance,
    }
    if case.parameter is not None:
        key, unit, value = case.parameter
        answer["parameters"] = {case.effects[-1]: {key: {"value": value, "unit": unit}}}
    if case.rule == "pulses":
        assert pulsed.pulses is not None
        edges = np.flatnonzero(np.diff(pulsed.pulses) > 0) + 1
        answer["onsets_s"] = (pulsed.dt * edges).tolist()
    return {"case": name, "stratum": "real", "load_encoder": False, "model": "rigid", "answer": answer}


# -- judgement -----------------------------------------------------------------------------------------------------


def own_lag(found: Mapping[str, Any] | None) -> float:
    """Delay or lag (s) that the machine has of its own, by a diagnosis in which none was planted; 0 where none was."""
    named = {} if found is None else found["parameters"]
    return float(sum(named[name]["T"]["value"] for name in ("time_delay", "amplifier_lag") if name in named))


def judged(
    name: str,
    answer: Mapping[str, Any],
    found: Mapping[str, Any] | None,
    plain: Mapping[str, Any] | None,
    lag: float = 0.0,
) -> dict[str, Any]:
    """A row of real.json; `plain` is the diagnosis of the record as it is, `lag` the machine's own, in s."""
    row = {"case": name, "what": answer["what"], "rule": answer["rule"], "truth": answer["effects"]}
    if found is None:
        return {**row, "found": [], "verdict": "failed", "right": False, "parameter": {}, "gap": None}
    size = _size(answer, found, plain, lag)
    twin = answer["effects"] and answer["effects"][-1] not in found["effects"]  # has no size to tell of this one
    within = all(one["within"] or (twin and one["within"] is None) for one in size.values())
    return {
        **row,
        "found": found["effects"],
        "ambiguous_with": found["ambiguous_with"],
        "verdict": found["verdict"],
        "right": _right(answer, found, plain) and within,
        "parameter": size,
        "gap": found["gap"],
        "remarks": found["remarks"],
    }


def _right(answer: Mapping[str, Any], found: Mapping[str, Any], plain: Mapping[str, Any] | None) -> bool:
    effects, wanted = found["effects"], answer["effects"][-1]
    own = [] if plain is None else plain["effects"]
    if answer["rule"] == "logged":
        new = set(effects) - {*own, *answer["also"]}
        return not new and any(answer["remark"] in said for said in found["remarks"])
    if answer["rule"] == "absorbed":
        return plain is not None and all(found[key] == plain[key] for key in ("verdict", "effects"))
    if answer["rule"] == "first":
        return effects[:1] == [wanted]
    if answer["rule"] == "pulses":
        return wanted in effects and found["block"] == "actuator" and _onsets(answer["onsets_s"], found)
    return found["verdict"] != "unexplained" and (wanted in effects or _as_twin(wanted, found))


def _as_twin(wanted: str, found: Mapping[str, Any]) -> bool:
    """Whether a listed twin was named and the two were said to be one group."""
    groups = [set(group) for group in found["ambiguous_with"]]
    return any(
        {other, wanted} in TWINS and any({other, wanted} <= group for group in groups) for other in found["effects"]
    )


def _onsets(true: Sequence[float], found: Mapping[str, Any]) -> bool:
    """Whether every pulse, and none more, begins where it did. One that was on at the first sample has no onset."""
    on = [interval[0] for interval in found["where"]["time_s"] or [] if interval[0] > 0]
    return len(on) == len(true) and all(abs(a - b) <= _ONSET for a, b in zip(sorted(on), true, strict=True))


def _size(
    answer: Mapping[str, Any], found: Mapping[str, Any], plain: Mapping[str, Any] | None, lag: float
) -> dict[str, dict[str, Any]]:
    """The effect's own parameter beside the truth, of a sine and a cosine their amplitude. Empty: none to tell."""
    if "parameters" not in answer:
        return {}
    effect = answer["effects"][-1]
    ((key, told),) = answer["parameters"][effect].items()
    true, tolerance = told["value"], answer["tolerance"]
    if effect == "time_delay":
        true += lag
    estimates = found["parameters"].get(effect, {})
    if answer["rule"] == "absorbed":
        true = float("nan") if plain is None else true * plain["base"][key]["after"]
        shift = found["base"][key]
        parts = [{"value": shift["after"], "std": shift["std"]}]
    else:
        parts = [estimates[part] for part in (("a", "b") if key == "a" else (key,)) if part in estimates]
    told = {"value": None, "std": None, "unit": told["unit"], "true": true, "tolerance": tolerance, "within": None}
    if parts:
        value = amplitude(parts)
        std = float(np.sqrt(np.mean([(part["std"] or 0.0) ** 2 for part in parts])))
        told |= {"value": value, "std": std, "within": bool(abs(value / true - 1) <= tolerance)}
    return {key: told}


def _document(out: Path, name: str) -> dict[str, Any] | None:
    """The diagnosis of a case, its records named without their folder: what is published is the same everywhere."""
    path = out / DIAGNOSES / name / "diagnosis.json"
    if not path.exists():
        return None
    found = read_json(path, "the diagnosis")
    here = f"{out / CASES / name}/"
    return {**found, "remarks": [said.removeprefix(here) for said in found["remarks"]]}


def print_real(document: Mapping[str, Any]) -> None:
    """A line a case."""
    for row in document["cases"]:
        said = "right" if row["right"] else "WRONG"
        for name, size in row["parameter"].items():
            value = "-" if size["value"] is None else f"{size['value']:.4g}"
            said += f"; {name} {value} {size['unit']} (true {size['true']:.4g})"
        print(f"{row['case']} {row['what']}: {row['verdict']}: {', '.join(row['found']) or '-'}; {said}")
