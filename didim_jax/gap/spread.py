"""Standard deviations of a fit's parameters, right where its residual is autocorrelated."""

import numpy as np

from ..statistics import spread
from .fit import Fit
from .search import Searcher


def standard_deviations(searcher: Searcher, fit: Fit) -> dict[int, float]:
    """By place in x, in the parameter's unit. Logarithmic entries: to first order; 0 at a bound."""
    problem = searcher.problem()
    residual = problem.whitened(fit.residuals)
    J = fit.jacobian
    shared = searcher.shared(fit)
    if J.shape[0] < len(residual):
        return {}
    rho = np.concatenate([residual, np.zeros(J.shape[0] - len(residual))])
    model = searcher.model
    bound = np.zeros(J.shape[1], dtype=bool)
    bound[: len(shared)] = [bool(model.bound(fit.xs[0], place)) for place in shared]
    shown = np.linalg.norm(J[: len(residual)], axis=0) > 0
    seen = shown & ~bound
    lengths = [len(r) for row in fit.residuals for r in row]
    if J.shape[0] > len(residual):
        lengths.append(J.shape[0] - len(residual))
    try:
        std = spread(J[:, seen], rho, lengths).std_autocorrelated
    except (ValueError, np.linalg.LinAlgError):
        return {}
    whole = np.full(J.shape[1], np.inf)  # of what the records do not show
    whole[seen] = std
    whole[bound & shown] = 0.0
    values = model.decode(fit.xs[0])
    out = {}
    for position, place in enumerate(shared):
        entry = model.entries[place]
        factor = abs(values[model.names[place]]) if entry.logarithmic else entry.scale
        out[place] = float(whole[position] * factor)
    return out
