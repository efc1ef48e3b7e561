"""Lasso on the dictionary of the inverse model: least squares with a price on the sum of the coefficients' sizes.

Columns are standardised, the nominal ones projected out and free. The price is the largest within one standard error of
the least cross-validated error, over interleaved blocks of the record; the effect whose columns together make most of
the residual is named. As in `sparse_regression`, the volts are regressed on the control law first. At most one effect.
"""

import numpy as np

from didim_jax.machine import Machine
from didim_jax.recording import Recording

from .answer import FALSE_PRECISION, Answer, weigh
from .control_law import left_by_law
from .dictionary import everything
from .inverse import Inverse, inverse

NONE = 0.1
"""Share of the residual's energy that the largest group must make up. Of 0, 0.03, 0.05, 0.1 ... 0.6 the largest of
those that get most of 73 open cases right (51)."""
FOLDS, BLOCKS, PRICES = 5, 20, 30


def answer(recording: Recording, machine: Machine, *, fitted: Inverse | None = None) -> Answer:
    """The largest group of columns. `fitted` saves fitting the nominal inverse model again."""
    x = fitted or inverse(recording, machine)
    n = len(x.residual) / FALSE_PRECISION
    if law := left_by_law(recording, machine):
        return weigh(law, n, NONE)
    candidates = everything(x)
    names = np.array([c.effect for c in candidates for _ in range(c.columns.shape[1])])
    X = np.hstack([c.columns for c in candidates])
    own = X - x.basis @ (x.basis.T @ X)
    norms = np.linalg.norm(own, axis=0)
    kept = norms > 1e-3 * np.linalg.norm(X, axis=0)
    names, own, y = names[kept], own[:, kept] / norms[kept], x.residual / max(np.linalg.norm(x.residual), 1e-300)
    beta = cross_validated(own, y)
    sizes = {
        str(name): float(np.sum((own[:, names == name] @ beta[names == name]) ** 2)) for name in dict.fromkeys(names)
    }
    return weigh({name: 1 - min(size, 1 - 1e-6) for name, size in sizes.items()}, n, NONE)


def cross_validated(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Coefficients (k,) of the lasso of y (n,) on X (n, k), columns of length one, at the price found by validation."""
    prices = float(np.abs(X.T @ y).max()) * np.geomspace(1.0, 0.01, PRICES)
    fold = (np.arange(len(y)) * BLOCKS // len(y)) % FOLDS
    errors = np.zeros((FOLDS, PRICES))
    for k in range(FOLDS):
        fitted, held = fold != k, fold == k
        share = float(np.mean(fitted))
        for i, beta in enumerate(path(X[fitted], y[fitted], share * prices)):
            errors[k, i] = np.sum((y[held] - X[held] @ beta) ** 2)
    mean, error = errors.mean(axis=0), errors.std(axis=0, ddof=1) / np.sqrt(FOLDS)
    least = int(np.argmin(mean))
    chosen = int(np.flatnonzero(mean <= mean[least] + error[least])[0])
    return path(X, y, prices[: chosen + 1])[-1]


def path(X: np.ndarray, y: np.ndarray, prices: np.ndarray, steps: int = 200) -> list[np.ndarray]:
    """Minima of ||y - X b||^2 / 2 + price |b|_1 at falling prices, each from the last, by accelerated gradients."""
    gram, target = X.T @ X, X.T @ y
    rate = 1 / float(np.linalg.eigvalsh(gram)[-1])
    beta, out = np.zeros(X.shape[1]), []
    for price in prices:
        ahead, momentum = beta, 1.0
        for _ in range(steps):
            step = ahead - rate * (gram @ ahead - target)
            new = np.sign(step) * np.maximum(np.abs(step) - rate * price, 0.0)
            grown = 0.5 * (1 + np.sqrt(1 + 4 * momentum**2))
            ahead, beta, momentum = new + (momentum - 1) / grown * (new - beta), new, grown
        out.append(beta)
    return out
