"""Standard deviations of a fit's parameters, right where its residual is autocorrelated."""

import numpy as np

from ..statistics import spread
from .fit import Fit
from .search import Searcher


def standard_deviations(searcher: Searcher, fit: Fit) -> dict[int, float]:
    """By place in x, in the parameter's unit. Logarithmic entries: to first order. At a bound: were all else known."""
    residual, J = fit.innovations, fit.jacobian
    columns = searcher.columns(fit)
    rho = np.concatenate([residual, np.zeros(J.shape[0] - len(residual))])
    model = searcher.model
    bound = np.zeros(J.shape[1], dtype=bool)
    bound[: len(columns)] = [bool(model.bound(fit.xs[0], place)) for place in columns]
    shown = np.linalg.norm(J[: len(residual)], axis=0) > 0
    seen = shown & ~bound
    lengths = [len(r) for row in fit.residuals for r in row]
    if J.shape[0] > len(residual):
        lengths.append(J.shape[0] - len(residual))
    try:
        std = spread(J[:, seen], rho, lengths).std_autocorrelated
    except (ValueError, np.linalg.LinAlgError):
        std = np.full(np.count_nonzero(seen), np.inf)
    whole = np.full(J.shape[1], np.inf)  # of what the records do not show
    whole[seen] = std
    whole[bound & shown] = 1 / np.linalg.norm(J[: len(residual), bound & shown], axis=0)
    values = model.decode(fit.xs[0])
    out = {}
    for position, place in enumerate(columns):
        entry = model.entries[place]
        factor = abs(values[model.names[place]]) if entry.logarithmic else entry.scale
        out[place] = float(whole[position] * factor)
    return out
