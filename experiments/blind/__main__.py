"""A blind study, step by step: python -m experiments.blind STEP STUDY, STEP one of make, seal, diagnose, open, score,
report, verify; and beside the sealed cases limits, real, calibrate.

Every step goes on where it was stopped, refuses what was tampered with, and prints the hash of the ledger's last line.
Published at once, that hash holds all that was done before it.
"""

import argparse
import dataclasses
import functools
from pathlib import Path

from didim_jax.config import build
from didim_jax.devices import cores

from ..data import ROOT
from ..study import read
from .layout import ANSWERS

_STEPS = {
    "make": (
        "make cases and their secret answers",
        "Reads the config. Writes STUDY/cases/CASE/ (fit.mat, check.mat, machine.toml), and answers/CASE.json and "
        "answers/plan.json, which are secret.",
    ),
    "seal": (
        "publish a salted hash of every answer",
        "Reads STUDY/cases and the answers. Writes STUDY/seals.json and the first line of STUDY/ledger.jsonl. For "
        "cases of your own see the beginning of experiments/blind/seal.py.",
    ),
    "diagnose": (
        "diagnose every case and commit the results",
        "Reads STUDY/cases and seals.json, no answer: those may be elsewhere. Writes STUDY/diagnoses/CASE/, "
        "results.json with their hashes, and a line of the ledger.",
    ),
    "open": (
        "verify the seals and reveal the answers",
        "Reads the answers and all of STUDY. Writes STUDY/opened.json and a line of the ledger; STUDY/baselines.json, "
        "if it is there, is committed before. No diagnosis is accepted after that.",
    ),
    "score": (
        "judge the diagnoses",
        "Reads STUDY/opened.json, the cases, the diagnoses and baselines.json. Writes STUDY/blind.json and a line of "
        "the ledger, and prints the figures.",
    ),
    "report": (
        "write the page of the study",
        "Reads STUDY/blind.json and, where they are, limits.json, ablations.json, real.json, and what the other steps "
        "left. Writes STUDY/report.html and STUDY/figures/.",
    ),
    "verify": (
        "hold the study against its ledger",
        "Reads all of STUDY but the unopened answers, writes nothing, and says what was tampered with.",
    ),
    "limits": (
        "measure how small an effect may be and still be named",
        "Reads what it left in STUDY/limits/ and goes on from there: open cases of its own, made and diagnosed, a "
        "staircase an effect. Writes STUDY/limits/ and limits.json.",
    ),
    "real": (
        "diagnose the measured EMPS records, some with an effect planted in them",
        "Reads the EMPS records. Writes STUDY/real/, a sealed study of its own, and real.json. Without the records it "
        "only says so.",
    ),
    "calibrate": (
        "suggest constants of the probabilities and of abstention",
        "Reads the answers and diagnoses of an open STUDY. Writes STUDY/calibrated.json, and changes no constant.",
    ),
}


def main(argv: list[str] | None = None) -> None:
    """Run one step. One line and exit status 2 for a user's mistake, and for whatever was tampered with."""
    arguments = _parser().parse_args(argv)
    from didim_jax.cli import program

    with program():
        _run(arguments)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.blind", description=__doc__)
    steps = parser.add_subparsers(dest="step", required=True, metavar="STEP")
    for name, (short, what) in _STEPS.items():
        step = steps.add_parser(name, help=short, description=what)
        step.add_argument("study", type=Path, metavar="STUDY", help="folder of the study")
        if name in ("make", "seal", "open"):
            step.add_argument("--answers", type=Path, metavar="DIR", help=f"secret answers (STUDY/{ANSWERS})")
        if name == "make":
            default = ROOT / "configs" / "blind.toml"
            step.add_argument("--config", type=Path, default=default, help="TOML file (configs/blind.toml)")
            step.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override of the config")
            step.add_argument("--quick", action="store_true", help="a few cases")
            step.add_argument("--fresh", action="store_true", help="draw the seed, whatever the config says")
            step.add_argument("--plan", type=Path, metavar="FILE", help="plan.json of an opened study: its cases again")
        if name == "limits":
            step.add_argument("--effects", nargs="+", default=[], metavar="EFFECT", help="these alone (all)")
            step.add_argument("--trials", type=int, default=24, help="of each effect (24)")
            step.add_argument("--spot-trials", type=int, default=4, help="at each limit at another noise level (4)")
        if name == "verify":
            step.add_argument("--head", metavar="HASH", help="a published hash, that of a line of the ledger")
        if name == "calibrate":
            step.add_argument("--open", action="store_true", help="give up the blind figures of an opened study")
    return parser


def _run(arguments: argparse.Namespace) -> None:
    """The modules of a step are imported here: they start JAX."""
    study = arguments.study
    answers = getattr(arguments, "answers", None) or study / ANSWERS
    if arguments.step == "make":
        from .make import make
        from .plan import Config

        config = build(Config, read(arguments.config, arguments.set, arguments.quick), str(arguments.config))
        if arguments.plan:
            from .make import config_of

            config = config_of(arguments.plan, config.workers)
        make(study, answers, dataclasses.replace(config, seed=None) if arguments.fresh else config)
    elif arguments.step == "seal":
        from .seal import seal

        _print_head(seal(study, answers))
    elif arguments.step == "diagnose":
        from .diagnose import diagnose

        _print_head(diagnose(study))
    elif arguments.step == "open":
        from .opening import open_seals

        _print_head(open_seals(study, answers))
    elif arguments.step == "score":
        from .score import score
        from .table import print_score

        print_score(score(study))
    elif arguments.step == "report":
        from .page import report

        print(report(study))
    elif arguments.step == "limits":
        from ..processes import calls
        from .limits import attempt, limits, print_limits

        asked = (arguments.effects, arguments.trials, arguments.spot_trials)
        with calls(cores()) as call:
            found = limits(
                study,
                *asked,
                one=functools.partial(call, attempt),
                threads=cores(),
                say=lambda text: print(text, flush=True),
            )
        print_limits(found)
    elif arguments.step == "real":
        from .real import print_real, real

        if (document := real(study)) is not None:
            print_real(document)
    elif arguments.step == "calibrate":
        from .calibrate import calibrate, print_calibration

        print_calibration(calibrate(study, arguments.open))
    else:
        from . import ledger
        from .opening import verify_all

        print(verify_all(study, arguments.head))
        if steps := ledger.read(study):
            print(f"ledger: {ledger.head(steps)}")


def _print_head(head: str) -> None:
    print(f"ledger: {head} (publish it)")


if __name__ == "__main__":
    main()
