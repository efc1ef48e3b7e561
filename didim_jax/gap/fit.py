"""Fit some entries of x to one or more records of a machine, exact Jacobian, bounds, and what is known beforehand."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.optimize

from .noise import Whitening
from .prepared import Prepared

STOPPED = 1e6
"""Residual of a simulation that diverged: a step that leads there is rejected."""

PRIORS: Mapping[str, tuple[float, float, float, float]] = {
    "amplifier_lag.T": (0.0, 2e-5, -5e-5, 1e-4),
    "coupling_damping.C": (25.0, 12.0, 0.0, 80.0),
    "tail": (0.0, 0.15, 0.0, 1.0),
    "knee": (0.0, 0.3, 0.0, 1.0),
}
"""Mean, standard deviation, least and most (SI) of what every machine has a little of, if it is not looked for.

Within a sample, too: an encoder is read, and a command taken over, some microseconds early or late.
"""

_OVERFLOW = 1e100

START_STD = 10.0
"""Of shifts of the initial state, in typical sizes."""


@dataclasses.dataclass(frozen=True)
class Fit:
    """Where a fit ended: x and unfiltered outputs of each record, residuals in the band by record and channel, cost.

    `innovations` are those residuals as they were weighed, a row of `jacobian` each; rows of the priors follow there.
    """

    chosen: tuple[int, ...]
    xs: tuple[np.ndarray, ...]
    outputs: tuple[np.ndarray, ...]
    residuals: tuple[tuple[np.ndarray, ...], ...]
    cost: float
    innovations: np.ndarray
    jacobian: np.ndarray
    evaluations: int

    @property
    def ok(self) -> bool:
        """Whether every number of the simulations is finite."""
        return all(np.isfinite(out).all() for out in self.outputs)


class Problem:
    """Records of one machine, whitened; x of the first holds the machine, each record has its own initial state.

    `chosen` are places in x; those of the start and those named in `own` have a value for each record.
    """

    def __init__(
        self,
        records: Sequence[Prepared],
        whitening: Sequence[Sequence[Whitening]],
        own: frozenset[int] = frozenset(),
        mask: Sequence[np.ndarray] | None = None,
    ) -> None:
        self.records = tuple(records)
        self.whitening = tuple(tuple(w) for w in whitening)
        model = records[0].model
        self.own = own | set(model.of("start"))
        self.mask = mask

    def residuals(self, outputs: Sequence[np.ndarray]) -> tuple[tuple[np.ndarray, ...], ...]:
        """Record minus simulation in the band, by record and channel."""
        return tuple(
            tuple(c.observed - p.filtered(out, c) for c in p.channels)
            for p, out in zip(self.records, outputs, strict=True)
        )

    def whitened(self, rows: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
        """One vector of the residuals (or columns, along the last axis) of all records and channels."""
        parts = []
        for i, (row, filters) in enumerate(zip(rows, self.whitening, strict=True)):
            for r, w in zip(row, filters, strict=True):
                e = w(r)
                parts.append(e if self.mask is None else e[..., self.mask[i]])
        return np.concatenate(parts, axis=-1)

    def solve(
        self,
        x: np.ndarray | Sequence[np.ndarray],
        chosen: Sequence[int],
        free: frozenset[str] = frozenset(),
        evaluations: int = 12,
        tolerance: float = 1e-4,
    ) -> Fit:
        """Least squares over the chosen entries from x. `free` effects lose the prior that they have as a nuisance."""
        model = self.records[0].model
        starts = [np.array(x, dtype=float)] * len(self.records) if isinstance(x, np.ndarray) else list(x)
        shared = [i for i in chosen if i not in self.own]
        each = [i for i in chosen if i in self.own]
        size = len(shared) + len(each) * len(self.records)
        lower, upper = model.lower, model.upper

        def spread(z: np.ndarray) -> list[np.ndarray]:
            xs = []
            for r, base in enumerate(starts):
                x_r = base.copy()
                x_r[shared] = z[: len(shared)]
                at = len(shared) + r * len(each)
                x_r[each] = z[at : at + len(each)]
                xs.append(x_r)
            return xs

        places = shared + each * len(self.records)
        low, high = lower[places], upper[places]
        z0 = np.concatenate([starts[0][shared], *[s[each] for s in starts]])
        priors = []
        for position, place in enumerate(places):
            name = model.names[place]
            if place in model.of("start"):
                priors.append((position, 0.0, START_STD))
            elif name in PRIORS and model.entries[place].owner not in free:
                mean, std, least, most = PRIORS[name]
                entry = model.entries[place]
                low[position], high[position] = entry.encode(least), entry.encode(most)
                priors.append((position, entry.encode(mean), std / entry.scale))
            else:
                # What changes nothing stays where it is: a singular column would let it go anywhere.
                priors.append((position, z0[position], 1e6))

        def prior(z: np.ndarray) -> np.ndarray:
            return np.array([(z[i] - m) / s for i, m, s in priors])

        def fun(z: np.ndarray) -> np.ndarray:
            outputs = [p.model.run(x_r) for p, x_r in zip(self.records, spread(z), strict=True)]
            if not all(np.isfinite(out).all() for out in outputs):
                return np.full(self._length() + len(priors), STOPPED)
            return np.concatenate([self.whitened(self.residuals(outputs)), prior(z)])

        def jac(z: np.ndarray) -> np.ndarray:
            blocks = np.zeros((self._length() + len(priors), size))
            row = 0
            for r, (p, x_r) in enumerate(zip(self.records, spread(z), strict=True)):
                _, tangents = p.model.columns(x_r, shared + each)
                columns = [[-p.filtered(tangents, c) for c in p.channels]]
                one = Problem([p], [self.whitening[r]], self.own, None if self.mask is None else [self.mask[r]])
                J = one.whitened(columns).T
                rows = slice(row, row + J.shape[0])
                blocks[rows, : len(shared)] = J[:, : len(shared)]
                at = len(shared) + r * len(each)
                blocks[rows, at : at + len(each)] = J[:, len(shared) :]
                row += J.shape[0]
            for k, (i, _, s) in enumerate(priors):
                blocks[row + k, i] = 1 / s
            blocks[~(np.abs(blocks) < _OVERFLOW)] = 0.0
            return blocks

        inside = np.where(np.isfinite(high - low), 1e-6 * (high - low), 1e-6)
        z0 = np.clip(z0, low + inside, high - inside)
        found = scipy.optimize.least_squares(
            fun,
            z0,
            jac,
            bounds=(low, high),
            method="trf",
            x_scale="jac",
            max_nfev=evaluations,
            ftol=tolerance,
            xtol=1e-6,
            gtol=1e-12,
        )
        xs = spread(found.x)
        outputs = [p.model.run(x_r) for p, x_r in zip(self.records, xs, strict=True)]
        return Fit(
            tuple(chosen),
            tuple(xs),
            tuple(outputs),
            self.residuals(outputs),
            float(found.cost),
            found.fun[: self._length()],
            found.jac,
            found.nfev,
        )

    def _length(self) -> int:
        total = 0
        for i, p in enumerate(self.records):
            for c in p.channels:
                total += len(c.observed) if self.mask is None else int(self.mask[i].sum())
        return total
