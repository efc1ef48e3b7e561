"""All the pictures of one identification, by the name of their file."""

from matplotlib.figure import Figure

from ..identify.study import Study
from .estimates import estimates_figure
from .force import force_figure
from .iterates import has_iterates, iterates_figure
from .spectrum import spectrum_figure
from .words import estimates, named_runs, role


def draw(study: Study) -> dict[str, Figure]:
    """force_fit, force_fit_2, ..., force_check, spectrum; estimates and iterates where there are any."""
    figures = {f"force_{name}": force_figure(run, role(name)) for name, run in named_runs(study).items()}
    if estimates(study.result, study.identifiability.lost):
        figures["estimates"] = estimates_figure(study)
    figures["spectrum"] = spectrum_figure(study)
    if has_iterates(study.result):
        figures["iterates"] = iterates_figure(study.result)
    return figures
