"""The same answer in the terminal."""

import os
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..identify.study import Study
from .tables import parameter_rows
from .words import answer, cautions, estimates, fit, outcome, record_names, stage_name

_COLUMNS = ("parameter", "value", "std\nwhite", "std\nautocorr.", "rel.\nstd %", "unit")


def print_study(study: Study, folder: str | os.PathLike[str] | None = None, console: Console | None = None) -> None:
    """The parameter table, then a few lines: how it ended, how well it fits, what was found, where the report is."""
    console = console or Console()
    result, lost = study.result, study.identifiability.lost
    table = Table(title=Text(f"{study.machine.name}: {stage_name(result)}"), title_justify="left")
    for k, column in enumerate(_COLUMNS):
        table.add_column(column, justify="left" if k in (0, 5) else "right", no_wrap=True)
    for row in parameter_rows(result, lost):
        cells = (row.name, row.value, row.std, row.std_autocorrelated, row.relative_std_percent, row.unit)
        # Text, not str: a name out of a file is no markup.
        table.add_row(*(Text(cell, style="" if row.given else "yellow") for cell in cells))
    console.print(table)
    if study.synthetic:
        console.print(Text("SYNTHETIC data: simulated, not measured on a machine.", style="bold yellow"))
    console.print(Text(outcome(result), style="" if result.converged else "bold yellow"))
    if not estimates(result, lost):
        console.print(Text(answer(study)))
    elif errors := fit(study):
        console.print(Text(errors))
    for caution in cautions(result):
        console.print(Text(f"Caution: {caution}", style="bold yellow"))
    if study.identifiability.verdict != result.reason:
        console.print(Text(study.identifiability.verdict, style="yellow" if lost else ""))
    if study.findings:
        found = len(study.findings)
        record, first = study.findings[0]
        record = record_names(study).get(record, record)
        text = f"{found} finding{'' if found == 1 else 's'} in the records; the first, in {record}: {first.message}"
        console.print(Text(text))
    if folder is not None:
        console.print(Text(f"Report: {Path(folder) / 'report.html'}"), soft_wrap=True)
