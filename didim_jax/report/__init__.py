"""From one identification to what a person reads: a page, figures, a table in the terminal, and plain files."""

from .document import identification_document
from .page import render_page
from .tables import Row, parameter_rows
from .terminal import print_study
from .write import check_folder, prepare_folder, write_study

__all__ = [
    "Row",
    "check_folder",
    "identification_document",
    "parameter_rows",
    "prepare_folder",
    "print_study",
    "render_page",
    "write_study",
]
