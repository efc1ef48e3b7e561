"""Linear regression on groups of columns, only as many as the evidence asks for, judged on blocks of time left out."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
import scipy.linalg

BLOCK_S = 0.4
"""Longer than most of what ties neighbouring samples, short enough that slow functions of time bridge a gap."""

FOLDS = 5

TEMPER = 3.0
"""Noise inside the band, and what no column fits, is correlated over a few samples: that many count as one."""


def blocks(n: int, dt: float, folds: int = FOLDS, seed: int = 0) -> np.ndarray:
    """Fold of every sample: blocks of 0.4 s (less if the record is short), shuffled within each run of `folds`.

    In order they would fall on the same place of a stroke that repeats every two seconds, and never be fitted there.
    """
    length = max(1, min(round(BLOCK_S / dt), n // (2 * folds)))
    count = -(-n // length)
    rng = np.random.default_rng(seed)
    order = np.concatenate([rng.permutation(folds) for _ in range(-(-count // folds))])
    return np.repeat(order[:count], length)[:n]


@functools.lru_cache(maxsize=64)
def halves(n: int, dt: float) -> np.ndarray:
    """Half of every sample, 0 or 1: such blocks, no part of a motion that repeats in one half alone.

    Of many shuffles the one is taken in which every fifth of a period, over periods of 0.4 to 3 s, has most of both.
    """
    t = dt * np.arange(n)
    phases = [(5 * (t / period % 1)).astype(int) for period in np.arange(0.4, 3.05, 0.1)]
    counts = [np.maximum(np.bincount(phase, minlength=5), 1) for phase in phases]

    def fairness(half: np.ndarray) -> float:
        shares = [np.bincount(p, weights=half, minlength=5) / c for p, c in zip(phases, counts, strict=True)]
        return -float(sum(max(0.0, 0.3 - min(s.min(), 1 - s.max())) ** 2 for s in shares))

    return max((blocks(n, dt, 2, seed) for seed in range(300)), key=fairness)


@dataclasses.dataclass(frozen=True)
class Prior:
    """Groups of columns, the variance of the weights of each (N^2), and that of the noise (N^2)."""

    groups: tuple[int, ...]
    sizes: np.ndarray
    noise: float


class Regression:
    """r = sum_g X_g w_g + noise, w_g ~ N(0, s_g I): a size s_g for each group of columns, found from the evidence.

    A group that the residual does not need gets the size 0 and costs nothing, however many columns it has. The sizes
    come from the whole record, a dozen numbers; the weights never see the block they are judged on.

    References: MacKay, *Bayesian interpolation*, Neural Computation 4 (1992), section 4, with a size for each group.
    """

    def __init__(self, groups: Sequence[np.ndarray], r: np.ndarray, folds: np.ndarray) -> None:
        self.X, self.r, self.folds = np.concatenate(groups, axis=1), r, folds
        ends = np.cumsum([x.shape[1] for x in groups])
        self.places = [np.arange(e - x.shape[1], e) for e, x in zip(ends, groups, strict=True)]
        parts = [folds == k for k in range(FOLDS)]
        self.grams = np.array([self.X[p].T @ self.X[p] for p in parts])
        self.products = np.array([self.X[p].T @ r[p] for p in parts])
        self.energies = np.array([r[p] @ r[p] for p in parts])
        self.energy = float(r @ r)

    def prior(self, groups: Sequence[int], start: np.ndarray | None = None, rounds: int = 12) -> Prior:
        """The sizes for which r is likeliest, with all groups in at first; enough rounds that shares settle."""
        n, mean = len(self.r), self.energy / len(self.r)
        gram_all, product_all = self.grams.sum(axis=0), self.products.sum(axis=0)
        sizes = np.full(len(groups), 0.1 * mean) if start is None else np.maximum(start, 1e-3 * mean)
        noise = 0.5 * mean
        for _ in range(rounds):
            active = np.flatnonzero(sizes > 0)
            if active.size == 0:
                break
            at, h = self._active(Prior(tuple(groups), sizes, noise))
            gram, product = gram_all[np.ix_(at, at)] * h[:, None] * h, product_all[at] * h
            precision = TEMPER * noise
            root = _inverse_root(gram / precision)
            w = root.T @ (root @ product) / precision
            counts = np.array([len(self.places[groups[int(k)]]) for k in active])
            firsts = np.cumsum(counts) - counts
            determined = counts - np.add.reduceat(np.sum(root**2, axis=0), firsts)  # weights that the data decide
            new = sizes[active] * np.add.reduceat(w**2, firsts) / np.maximum(determined, 1e-12)
            new[(determined < 1e-6) | (new < 1e-5 * mean)] = 0.0
            unexplained = self.energy - 2 * w @ product + w @ gram @ w
            last, noise = noise, max(unexplained / max(n - determined.sum(), 1.0), 1e-12 * mean)
            settled = (new > 0).all() and (np.abs(np.log(new / sizes[active])) < 0.1).all()
            sizes[active] = new
            if settled and abs(np.log(noise / last)) < 0.02:
                break
        return Prior(tuple(groups), sizes, noise)

    def share(self, prior: Prior) -> float:
        """Share of the energy that is closed on the blocks left out; 0 where it grows."""
        if not np.any(prior.sizes > 0):
            return 0.0
        at, _ = self._active(prior)
        left = self.energy
        for k, w in enumerate(self._weights(prior)):
            left += w @ self.grams[k][np.ix_(at, at)] @ w - 2 * w @ self.products[k][at]
        return max(float(1 - left / self.energy), 0.0)

    def residual(self, prior: Prior) -> np.ndarray:
        """What is left at every sample, predicted from the folds that it is not in."""
        at, _ = self._active(prior)
        left = self.r.copy()
        for k, w in enumerate(self._weights(prior)):
            part = self.folds == k
            left[part] -= self.X[np.ix_(part, at)] @ w
        return left

    def _active(self, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
        """Columns of the groups whose size is not 0, and the root of each one's size."""
        chosen = [(self.places[g], s) for g, s in zip(prior.groups, prior.sizes, strict=True) if s > 0]
        return np.concatenate([p for p, _ in chosen]), np.sqrt(np.concatenate([np.full(len(p), s) for p, s in chosen]))

    def _weights(self, prior: Prior) -> list[np.ndarray]:
        """Weights of the active columns, fitted without each fold in turn."""
        at, h = self._active(prior)
        grams, products = self.grams[:, at[:, None], at] * h[:, None] * h, self.products[:, at] * h
        precision = TEMPER * prior.noise
        out = []
        for gram, product in zip(grams.sum(axis=0) - grams, products.sum(axis=0) - products, strict=True):
            A = gram / precision + np.eye(len(at))
            factor = scipy.linalg.cho_factor(A, lower=True, overwrite_a=True, check_finite=False)
            out.append(h * scipy.linalg.cho_solve(factor, product / precision, check_finite=False))
        return out


def _inverse_root(gram: np.ndarray) -> np.ndarray:
    """L^-1 with L L' = I + gram; the squares in its columns sum to the diagonal of the inverse."""
    L = scipy.linalg.cholesky(gram + np.eye(len(gram)), lower=True, overwrite_a=True, check_finite=False)
    return scipy.linalg.lapack.dtrtri(L, lower=1)[0]
