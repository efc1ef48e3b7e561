"""The page of a blind study: report.html and figures/*.png, from what lies in its folder.

blind.json is needed. limits.json, ablations.json and real.json have a section each, which says so where the file is not
there. What the banner says comes from ledger.jsonl, results.json and opened.json.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from didim_jax.gap.decide import BESIDE, RELEVANT
from didim_jax.report import prepare_folder

from ..page import Picture, Section, Tabular, Text, picture, write_page
from . import case_tables, words
from . import page_tables as tables
from .ablation_scores import ablated, complete_and_sealed
from .figures_answers import answers_figure, groups_figure
from .figures_effects import effects_figure
from .figures_gap import gap_figure
from .figures_limits import limits_figure
from .figures_names import confusion_figure, reliability_figure
from .figures_rivals import ablations_figure, rivals_figure
from .judge import foretold
from .layout import LEDGER, OPENED, RESULTS, SCORE, digest, read_json
from .ledger import verify

type Part = Text | Tabular | Picture

LIMITS, ABLATIONS, REAL = "limits.json", "ablations.json", "real.json"
REPORT = "report.html"


def report(study: Path) -> Path:
    """Write the page. Raises InputError: no score, or one that is not what the ledger entered."""
    found = gather(study)
    folder = prepare_folder(study / "figures")

    def draw(name: str, caption: str, make: Callable[..., Figure], *of: Any) -> Picture:
        return picture(make(*of), folder / f"{name}.png", caption)

    score = found["score"]
    sections = [
        _answers(score, draw),
        _headline(score),
        _where(score, draw),
        _names(score, draw),
        _gap(score, draw),
        _rivals(score, draw),
        _limits(found["limits"], draw),
        _ablations(found["ablations"], score, draw),
        _real(found["real"]),
        _wrong(score, found["answers"]),
        _order(found["ledger"]),
    ]
    title = f"Does the diagnosis name the effect that is really there? {score['cases']} sealed cases, opened once"
    if not found["ledger"]:
        title = title.replace("sealed cases, opened once", "cases")
    write_page(study / REPORT, title, words.banner(found), words.answer(score), sections, _footer(found))
    return study / REPORT


def gather(study: Path) -> dict[str, Any]:
    """All that the page is made of; None for a file that is not there."""
    score = read_json(study / SCORE, "the score; run score first")
    answers = _optional(study / OPENED, "the opened answers") or {}
    results = _optional(study / RESULTS, "the results") or {}
    return {
        "score": score,
        "answers": answers,
        "foreign": sum("law" not in one["answer"] for one in answers.values()) if answers else None,
        "commits": results.get("commits", []),
        "ledger": verify(study) if (study / LEDGER).exists() else [],
        "limits": _optional(study / LIMITS, "detection limits"),
        "ablations": _optional(study / ABLATIONS, "ablations"),
        "real": _optional(study / REAL, "real records"),
    }


def _optional(path: Path, what: str) -> Any:
    return read_json(path, what) if path.exists() else None


def _answers(score: Mapping[str, Any], draw: Callable[..., Picture]) -> Section:
    caption = (
        "What each kind of case holds → the right answer. Bar: how its cases were answered; line: 95 % Wilson interval "
        "of the share that is right; diamond: the baseline that is best on these cases. In part: some of several "
        "effects, nothing else."
    )
    return Section("How every kind of case was answered", [draw("answers", caption, answers_figure, score)])


def _headline(score: Mapping[str, Any]) -> Section:
    text = (
        "Exact: the effects that are there, and no other. Accepted: or a twin in place of one, where the diagnosis "
        "says that these data cannot tell the two apart. Intervals are Wilson's for counts, Newcombe's for what is "
        "ahead on the same cases, and between two of the values for quantiles. A case that failed counts as wrong, "
        "its gap as visible and not closed. A figure may be claimed where its whole interval is on the right side of "
        "the target; a target may be reached, and the cases still be too few to claim it, which the last column says."
    )
    return Section("The figures to quote", [Text(text), tables.headline(score)])


def _where(score: Mapping[str, Any], draw: Callable[..., Picture]) -> Section:
    conditions = "One effect a case. Noise, load encoder and drive: effects of typical size only."
    effects = (
        "Left: cases with one effect of typical size; accepted, and beside it how many of how many; white: exact. "
        "Right: |estimate / truth - 1| of the parameter that truth and "
        "estimate have with one unit, in cases of any size that were accepted; bar and number: median; dashed: "
        "the minimum to be reached; dotted: the aim. The truth follows laws of its own. Compared is the parameter "
        "that says how large the effect is, of a sine and a cosine their amplitude, where both have one of that unit. "
        "It may still mean something else: T of a velocity_filter made discrete by another rule, k of another curve of "
        "gain_nonlinearity."
    )
    heading = "Where it is good and where it is not"
    if not {"small", "single", "large", "poor"} & set(score["strata"]):
        return Section(heading, [Text("No case holds one effect.")])
    parts = [
        draw("conditions", conditions, groups_figure, score),
        draw("effects", effects, effects_figure, score),
    ]
    return Section(heading, parts)


def _names(score: Mapping[str, Any], draw: Callable[..., Picture]) -> Section:
    confusion = (
        "Counts of all cases with at most one effect, of every size, noise and drive; shade: share of the row; frame: "
        "the right answer. Names in x_ are in no catalogue, and drive_gain is absorbed by the base parameters."
    )
    reliability = (
        "Cases with at most one effect, in ten bins of the probability of the first name; line: 95 % Wilson interval. "
        "Below: how many cases each bin holds."
    )
    heading = "Which name was given, and how sure it was"
    if not score["confusion"]:
        return Section(heading, [Text("No case holds at most one effect.")])
    parts = [
        draw("confusion", confusion, confusion_figure, score),
        draw("reliability", reliability, reliability_figure, score),
    ]
    return Section(heading, parts)


def _gap(score: Mapping[str, Any], draw: Callable[..., Picture]) -> Section:
    caption = (
        "On the check record, another trajectory of the same machine, judged once. Gap: norm of the force that the "
        "simulation misses below 60 Hz, over that of the motor force. Closed: (before² - after²) / (before² - "
        "noise²), where the gap is at least 1.5 times noise. The gap before is that of the diagnosis's own nominal "
        "drive. What has no fixed place in time or on the encoder (onset of a payload, of pulses and of a drift, "
        "phase of an encoder) is found anew on the check record, sizes are not. Number of cases in brackets; arrows: "
        "the minimum to be reached."
    )
    return Section("How far the gap shrinks", [draw("gap", caption, gap_figure, score), tables.gaps(score)])


def _rivals(score: Mapping[str, Any], draw: Callable[..., Picture]) -> Section:
    heading = "Baselines on the same cases: who wins where"
    if not score["baselines"]["methods"]:
        return Section(heading, [Text(words.NOT_RUN.format("baselines.json"))])
    parts: list[Part] = [Text(sentence) for sentence in words.who_wins(score)]
    if not score["baselines"]["blind"]:
        parts.append(Text("The baselines were not committed before the seals were opened: they were not blind."))
    parts += [Text(sentence) for sentence in words.UNLIKE]
    caption = "Right by the same rules, on the same cases. A baseline that fails on a case is wrong there."
    return Section(heading, [*parts, draw("baselines", caption, rivals_figure, score), tables.rivals(score)])


def _limits(found: Mapping[str, Any] | None, draw: Callable[..., Picture]) -> Section:
    heading = "How small an effect may be"
    if not found or not found.get("effects"):
        return Section(heading, [Text(words.NOT_RUN.format(LIMITS))])
    text = (
        f"Staircases on open cases of the same simulator (not sealed), SYNTHETIC like them: {found['noise']} noise, "
        f"{found['excitation']} excitation{_machine(found)}. The Cramér-Rao bound is the least standard deviation that "
        "any unbiased estimate of the size could have; here it is estimated, by the diagnosis, from the exact "
        "Jacobian of its own law, where truth follows another, and the noise that the refit leaves; there is none of "
        "what is read off the control law, where no noise is between. Named: alone, an admitted twin in its place "
        "where the two are said to be one group. What sets most limits is not the bound: an effect is worth a name "
        f"only where it closes {100 * RELEVANT:g} % of what is left ({100 * BESIDE:g} % beside others)."
    )
    more = (
        "The laws of an effect are pooled: where one is seen less well than another, the limit lies between the two; "
        "where they differ in their typical size, or in its unit, sizes are in typical sizes. Not reached: missed at "
        "large sizes, too. Below: named at the least size that was asked. With a dozen trials an interval holds the "
        "limit in 80 % of the time or more; a spot check can refute a limit that is far too low, hardly one that is "
        "too high."
    )
    caption = (
        "Size at which an effect is named in half and in nine of ten cases; thin lines: 95 % intervals, with an arrow "
        "where they have no end. Trials above a row were named, below it not. Each panel has its own unit and axis."
    )
    parts: list[Part] = [Text(text), draw("limits", caption, limits_figure, found), tables.limits(found)]
    checked = tables.spot_checks(found)
    said = [Text(text) for text in (more, *words.typical_sizes(found), words.commits(found.get("commits", [])))]
    return Section(heading, [*parts, *said, checked or Text("Spot checks elsewhere: not run.")])


def _machine(found: Mapping[str, Any]) -> str:
    if "model" not in found:
        return ""
    return f", {found['model']} machines {'with' if found.get('load_encoder') else 'without'} load encoder"


def _ablations(found: Mapping[str, Any] | None, score: Mapping[str, Any], draw: Callable[..., Picture]) -> Section:
    heading = "What each ingredient is worth"
    if not found:
        return Section(heading, [Text(words.NOT_RUN.format(ABLATIONS))])
    judged = ablated(found, score)
    if not any(one.right["n"] for one in judged):
        return Section(heading, [Text(f"Not run on these cases: {ABLATIONS} holds others.")])
    n, right, sealed = complete_and_sealed(found, score)
    text = (
        "The diagnosis with one ingredient removed, on the same cases, after their seals were opened, without their "
        "check records; all thresholds are those of the complete one. What changes no answer here was not needed on "
        f"these cases. Complete it is right in {right} of {n}; {sealed} of these when they were sealed: what was "
        "mended since, some of it on these cases, is the difference."
    )
    sizes = {one.right["n"] for one in judged}
    if len(sizes) > 1:
        text += " The variants did not run on equally many cases; points behind count those that both ran on."
    if skipped := sorted({case for cases in found.values() for case in cases} - _cases(score)):
        text += f" {len(skipped)} cases are not of this study and are left out, the first {skipped[0]}."
    caption = "Right by the rules of the study, with 95 % Wilson intervals; grey line: the complete diagnosis."
    made_at = {entry.get("commit") for cases in found.values() for entry in cases.values()}
    text += f" {words.commits(sorted(made_at, key=str))}"
    return Section(
        heading, [Text(text), draw("ablations", caption, ablations_figure, judged), tables.ablations(judged)]
    )


def _cases(score: Mapping[str, Any]) -> set[str]:
    return {row["case"] for row in score["rows"]}


def _real(found: Mapping[str, Any] | None) -> Section:
    heading = "Real records"
    if not found or not found.get("cases"):
        return Section(heading, [Text(words.NOT_RUN.format(REAL))])
    right = sum(bool(one["right"]) for one in found["cases"])
    gaps = [(one.get("gap") or {}).get("check") or {} for one in found["cases"]]
    n_foretold = sum(foretold(gap.get("predicted_after"), gap["after"]) for gap in gaps if gap.get("after"))
    text = (
        "MEASURED records of the EMPS benchmark, as they are or with an exact change; diagnosed without the answer: "
        f"{right} of {len(found['cases'])} right. Checks, no blind test: two records of one machine, on which the "
        "diagnosis was developed, and the same cases each time. The same record in other units must be answered alike "
        "by whatever is consistent; the volts of a pulse are compared with a fit of the control law, which the "
        "diagnosis makes as well, so that its onsets are what is tested; planted sizes are plain ones, many times the "
        "detection limits. Beside a planted effect the machine's own may be named, which nobody knows. The true delay "
        "is the planted one on top of what is found in the record with the pulses, the true M after a wrong gain that "
        "of the unchanged record, scaled. Right: what was done is named or said, within its tolerance; of the effects "
        f"named beside it nothing is known. Gap foretold within 25 % in {n_foretold} of them. So few cases "
        f"give no rate. {words.commits(found.get('commits', []))}"
    )
    return Section(heading, [Text(text), case_tables.real(found)])


def _wrong(score: Mapping[str, Any], answers: Mapping[str, Any]) -> Section:
    listed = case_tables.wrong(score, answers)
    heading = f"Every wrong answer: {len(listed.rows)} of {score['cases']} cases"
    if not listed.rows:
        return Section(heading, [Text("There is none.")])
    text = "Gap before → after on the check record, in brackets what noise alone leaves, all in % of the motor force."
    if not answers:
        text += f" Laws and sizes of the truth are not shown: there is no {OPENED} beside the score."
    return Section(heading, [Text(text), listed])


def _order(steps: list[Any]) -> Section:
    heading = "The ledger"
    if not steps:
        return Section(heading, [Text(f"There is no {LEDGER} beside the score: nothing shows the order of things.")])
    text = (
        "Every line holds the hash of what a step made and of the line before; this page was written after both were "
        "verified. Whoever knows the hash of the last line can do the same with `python -m experiments.blind verify`."
    )
    rows = [
        (step.step, f"{step.time[:10]} {step.time[11:19]} UTC", f"{step.content[:16]}…", f"{digest(step.line)[:16]}…")
        for step in steps
    ]
    return Section(heading, [Text(text), Tabular(("step", "time", "SHA-256 of what it made", "of the line"), rows)])


def _footer(found: Mapping[str, Any]) -> str:
    head = f" Last line of the ledger: {digest(found['ledger'][-1].line)}." if found["ledger"] else ""
    return f"All numbers are in {SCORE}, the figures also in figures/. {words.commits(found['commits'])}{head}"
