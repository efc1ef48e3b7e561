"""report.html of one diagnosis: self-contained, the answer on the first screen, what it rests on below."""

import base64
import functools
import importlib.resources
import math
from collections.abc import Mapping
from typing import Any

import jinja2
from matplotlib.figure import Figure

from ..effects import AbstractEffect
from ..effects.catalogue import CATALOGUE
from ..effects.symbols import COMMON, meanings, units
from ..gap.diagnosis import Diagnosis, Run
from .atlas import atlas_figure
from .diagnosis_force import run_figure
from .diagnosis_names import capital, chance, named
from .diagnosis_summary import shown_ranking, summary_figure, twins
from .diagnosis_words import UNCHECKED, answers, estimate, headline, ranges
from .page import _minus, versions
from .tables import NO_NUMBER, decimals, percent, rounded
from .words import role

_MOVED = 0.05
"""A base parameter that moves by more than this, relative, is a symptom worth a look."""

BADGES = {
    "none": "no gap",
    "effect": "effect named",
    "ambiguous": "named up to twins",
    "unexplained": "unexplained",
}


def draw_diagnosis(d: Diagnosis) -> dict[str, Figure]:
    """summary, atlas, and force_fit, force_fit_2, ..., force_check."""
    figures = {"summary": summary_figure(d)}
    before, after = d.atlas, d.atlas_after
    if before is not None:
        figures["atlas"] = atlas_figure(before, after)
    for name, run in named_runs(d).items():
        own = f" {run.name}" if run.name != name else ""
        title = f"{role(name)} record{own}{' — SYNTHETIC' if d.synthetic else ''}"
        figures[f"force_{name}"] = run_figure(run, title, d.gap.get(name), bool(d.effects))
    return figures


def render_diagnosis(d: Diagnosis, figures: Mapping[str, bytes]) -> str:
    """The page, with each figure (PNG, by the names of `draw_diagnosis`) inside it."""
    return _template().render(
        d=d,
        badge=BADGES[d.verdict],
        unchecked="" if "check" in d.gap else UNCHECKED,
        headline=headline(d),
        answers=answers(d),
        records={name: run.name for name, run in named_runs(d).items()},
        figures={name: base64.b64encode(png).decode("ascii") for name, png in figures.items()},
        adopted=[_adopted(d, effect) for effect in d.effects],
        ranking=_ranking(d),
        gaps=[_gap(d, name) for name in d.gap],
        base=[_base(name, shift) for name, shift in d.base.items()],
        ranges=ranges(d),
        symbols=COMMON,
        experiment=d.experiment,
        versions=versions(),
    )


@functools.cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"typeset": _typeset, "role": role}
    source = importlib.resources.files(__package__).joinpath("diagnosis.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source)


def _typeset(text: str) -> str:
    """True minus signs, and no line that breaks before a percent sign or around ±."""
    return _minus(text).replace(" %", "\N{NO-BREAK SPACE}%").replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}")


def named_runs(d: Diagnosis) -> dict[str, Run]:
    """Every run under its short name: fit, fit_2, ..., check."""
    fits = len(d.runs) - ("check" in d.gap)
    names = ["fit" if k == 0 else f"fit_{k + 1}" for k in range(fits)]
    return dict(zip([*names, "check"] if fits < len(d.runs) else names, d.runs, strict=True))


def _adopted(d: Diagnosis, effect: str) -> dict[str, Any]:
    """One adopted effect as text: its law, its size, what it holds of the gap closed, its twins."""
    numbers: Mapping[str, Any] = d.parameters.get(effect, {})
    law = _law(effect)
    group = next((g for g in d.ambiguous_with if effect in g), ())
    said, unit = (meanings(law), units(law)) if law else ({}, {})
    return {
        "effect": effect,
        "name": capital(named(effect)),
        "law": law.equation if law else "",
        "symbols": [f"{symbol}: {said[symbol]}" for symbol in said if symbol not in {*unit, *numbers}],
        "parameters": [
            (estimate(k, v) if isinstance(v, dict) else f"{k}: {_plain(v)}", said.get(k, ""))
            for k, v in numbers.items()
        ],
        "last_in": f"{100 * d.last_in[effect]:.0f} %" if effect in d.last_in else NO_NUMBER,
        "twins": [named(e) for e in group if e != effect],
    }


def _law(effect: str) -> type[AbstractEffect] | None:
    """The effect's class; None for one of a user's own file."""
    return next((e for e in CATALOGUE if e.label() == effect), None)


def _plain(value: object) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _ranking(d: Diagnosis) -> list[dict[str, Any]]:
    """Every row of the first step's ranking as text; the first of the twins says how many rows its bracket spans."""
    candidates = {c.effect: c for c in d.candidates}
    group = twins(d)
    rows: list[dict[str, Any]] = []
    for effect, p in shown_ranking(d, len(d.ranking) + 2):
        c = candidates.get(effect)
        said = meanings(law) if (law := _law(effect)) else {}
        rows.append(
            {
                "effect": effect,
                "name": capital(named(effect)),
                "adopted": effect in d.effects,
                "chance": chance(p),
                "width": f"{100 * p:.1f}",
                "gap": percent(d.gap["fit"].before if effect == "none" else c.gap if c else math.nan),
                "share": f"{100 * c.share:.0f} %" if c and math.isfinite(c.share) else NO_NUMBER,
                "parameters": [(estimate(k, vars(v)), said.get(k, "")) for k, v in c.parameters.items()] if c else [],
                "twin": effect in group,
                "spans": sum(e in group for e, _ in d.ranking)
                if effect in group and not any(row["twin"] for row in rows)
                else 0,
            }
        )
    return rows


def _gap(d: Diagnosis, name: str) -> dict[str, str]:
    gap = d.gap[name]
    predicted = gap.predicted_after
    off = "" if predicted is None or not gap.after > 0 else f"{100 * (predicted / gap.after - 1):+.0f} %"
    return {
        "record": name,
        "before": percent(gap.before),
        "after": percent(gap.after),
        "floor": percent(gap.floor),
        "above": f"{gap.after / gap.floor:.2f}" if gap.floor > 0 else NO_NUMBER,
        "predicted": NO_NUMBER if predicted is None else percent(predicted),
        "off": off or NO_NUMBER,
    }


def _base(name: str, shift: Any) -> dict[str, Any]:
    """One base parameter as text, and by how much it moved when the effects came in."""
    places = decimals(shift.std)
    moved = shift.after / shift.before - 1 if shift.before else math.nan
    return {
        "name": name,
        "before": rounded(shift.before, places),
        "after": rounded(shift.after, places),
        "std": NO_NUMBER if places is None else rounded(shift.std, places),
        "moved": f"{100 * moved:+.1f} %" if math.isfinite(moved) else NO_NUMBER,
        "symptom": math.isfinite(moved) and abs(moved) > _MOVED,
        "unit": "" if shift.unit == "1" else shift.unit,
    }
