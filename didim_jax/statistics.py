"""Least squares and its uncertainty: standard deviations, condition number, base parameters, bounds."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg


@dataclasses.dataclass(frozen=True)
class Spread:
    """How far an estimate may be from the truth, (n_theta,) and (n_theta, n_theta).

    `std` and `covariance` are eq. 13-14, right where rho is white; `std_autocorrelated` drops that assumption
    (Newey-West). `condition_number` is that of the matrix as it is, in SI units.
    """

    std: np.ndarray
    std_autocorrelated: np.ndarray
    covariance: np.ndarray
    condition_number: float


@dataclasses.dataclass(frozen=True)
class LeastSquares:
    """The solution of Y = W theta + rho, its spread, and relative_error = norm(rho) / norm(Y)."""

    theta: np.ndarray
    rho: np.ndarray
    relative_error: float
    spread: Spread


def solve(W: np.ndarray, Y: np.ndarray, runs: Sequence[int] | None = None) -> LeastSquares:
    """Least squares by the singular value decomposition of W, columns scaled to one; no normal equations.

    `runs`: lengths of the stretches of rows that follow each other in time (records, rows of the model).
    ValueError when W has no more rows than columns, or a column that is zero.

    References: paper, eq. 11-12.
    """
    norms, U, s, Vt = _scaled_svd(W)
    theta = (Vt.T @ ((U.T @ Y) / s)) / norms
    rho = Y - W @ theta
    return LeastSquares(theta, rho, float(np.linalg.norm(rho) / np.linalg.norm(Y)), spread(W, rho, runs))


def spread(W: np.ndarray, rho: np.ndarray, runs: Sequence[int] | None = None) -> Spread:
    """sigma_rho^2 = norm(rho)^2 / (r - b), C = sigma_rho^2 (W^T W)^-1, and the sandwich for any spectrum of rho.

    References: paper, eq. 13-14; W. Newey, K. West, *A simple positive semi-definite, heteroskedasticity and
    autocorrelation consistent covariance matrix*, 1987.
    """
    r, b = W.shape
    norms, _, s, Vt = _scaled_svd(W)
    inverse = (Vt.T / s**2) @ Vt / np.outer(norms, norms)  # (W^T W)^-1
    covariance = (rho @ rho) / (r - b) * inverse
    sandwich = inverse @ long_run_covariance(W * rho[:, None], runs) @ inverse * (r / (r - b))
    return Spread(
        std=np.sqrt(np.diag(covariance)),
        std_autocorrelated=np.sqrt(np.maximum(np.diag(sandwich), 0)),
        covariance=covariance,
        condition_number=float(np.linalg.cond(W)),
    )


def _scaled_svd(W: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    r, b = W.shape
    if r <= b:
        raise ValueError(f"{b} parameters need more than {r} rows.")
    norms = np.linalg.norm(W, axis=0)
    if not np.all(norms > 0):
        raise ValueError(f"column {int(np.argmin(norms))} of W is zero: that parameter changes nothing.")
    return (norms, *scipy.linalg.svd(W / norms, full_matrices=False))


def long_run_covariance(scores: np.ndarray, runs: Sequence[int] | None = None) -> np.ndarray:
    """Sum over all lags of the scores' covariance, (b, b): the middle of the Newey-West sandwich, Bartlett weights.

    The number of lags follows the data (Andrews' rule for an AR(1) in each score, pooled), so that white residuals keep
    their small variance and slow ones get the lags they need.

    References: D. Andrews, *Heteroskedasticity and autocorrelation consistent covariance matrix estimation*, 1991.
    """
    total = np.zeros((scores.shape[1],) * 2)
    for part in np.split(scores, np.cumsum(runs)[:-1] if runs else []):
        lags = _bandwidth(part)
        total += part.T @ part
        for k in range(1, lags + 1):
            crossed = part[k:].T @ part[:-k]
            total += (1 - k / (lags + 1)) * (crossed + crossed.T)
    return total


def _bandwidth(scores: np.ndarray) -> int:
    """Andrews' plug-in bandwidth for Bartlett weights: 1.1447 (alpha n)^(1/3), at most a tenth of the samples."""
    n = len(scores)
    energy = np.sum(scores[:-1] ** 2, axis=0)
    energy = np.where(energy > 0, energy, 1.0)
    rho = np.clip(np.sum(scores[1:] * scores[:-1], axis=0) / energy, -0.97, 0.97)
    weight = np.mean(scores**2, axis=0) * (1 - rho**2)  # innovation variance
    weight = weight / max(float(np.max(weight)), np.finfo(float).tiny)
    top = np.sum(4 * rho**2 * weight**2 / ((1 - rho) ** 6 * (1 + rho) ** 2))
    bottom = max(float(np.sum(weight**2 / (1 - rho) ** 4)), np.finfo(float).tiny)
    return int(min(np.ceil(1.1447 * (top / bottom * n) ** (1 / 3)), n // 10))


def base_columns(W: np.ndarray, tolerance: float = 1e-8) -> tuple[np.ndarray, np.ndarray]:
    """Indices of b independent columns of W, and the (b, n - b) matrix beta that regroups the others into them.

    W[:, others] = W[:, base] @ beta, so that chi_base = theta[base] + beta @ theta[others]. The rank is read off a QR
    with column pivoting, columns scaled to one; which columns stay, off a QR in the order given: each is kept unless
    those before it already give it.

    References: paper, eq. 12; M. Gautier, *Numerical calculation of the base inertial parameters of robots*, 1991.
    """
    norms = np.linalg.norm(W, axis=0)
    scaled = W / np.where(norms > 0, norms, 1.0)
    pivots = np.abs(np.diag(scipy.linalg.qr(scaled, mode="r", pivoting=True)[0]))
    rank = int(np.sum(pivots > tolerance))
    in_order = np.abs(np.diag(scipy.linalg.qr(scaled, mode="r")[0]))
    base = np.sort(np.argsort(-in_order, kind="stable")[:rank])
    others = np.setdiff1d(np.arange(W.shape[1]), base)
    beta = np.linalg.lstsq(W[:, base], W[:, others], rcond=None)[0] if len(others) else np.zeros((rank, 0))
    return base, beta


def cramer_rao(jacobian: np.ndarray, sigma: float) -> np.ndarray:
    """Smallest covariance an unbiased estimate can have: sigma^2 (J^T J)^-1, white noise of rms sigma on each row."""
    norms = np.linalg.norm(jacobian, axis=0)
    _, s, Vt = scipy.linalg.svd(jacobian / norms, full_matrices=False)
    with np.errstate(divide="ignore"):
        return sigma**2 * ((Vt.T / s**2) @ Vt) / np.outer(norms, norms)
