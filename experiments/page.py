"""The page of a study: what is synthetic, the answer in words, then text, tables and figures; self-contained."""

import base64
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jinja2
from matplotlib.figure import Figure

from didim_jax.files import atomic_write
from didim_jax.report.canvas import png


@dataclasses.dataclass(frozen=True)
class Text:
    """One paragraph."""

    text: str
    kind: str = "text"


@dataclasses.dataclass(frozen=True)
class Tabular:
    """A table whose cells are ready to read; the first column is text, all of them where it is `prose`."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    kind: str = "table"
    prose: bool = False


@dataclasses.dataclass(frozen=True)
class Picture:
    """A figure of the run folder, inside the page."""

    data: str
    caption: str
    kind: str = "figure"


@dataclasses.dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    heading: str
    parts: Sequence[Text | Tabular | Picture]


def picture(figure: Figure, path: Path, caption: str) -> Picture:
    """Write the figure into the run folder and hold it for the page."""
    data = png(figure)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)
    return Picture(base64.b64encode(data).decode("ascii"), caption)


def write_page(
    path: Path, title: str, source: str, answer: Sequence[str], sections: Sequence[Section], footer: str
) -> None:
    """Write report.html. `source` says in the first line what is synthetic and what is measured or the paper's."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = Path(__file__).with_name("study.html.j2").read_text(encoding="utf-8")
    page = environment.from_string(template).render(
        title=title, source=source, answer=answer, sections=sections, footer=footer
    )
    with atomic_write(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
