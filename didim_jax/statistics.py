"""Least squares and its uncertainty: standard deviations, condition number, base parameters, bounds."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg


@dataclasses.dataclass(frozen=True)
class Spread:
    """How far an estimate may be from the truth, (n_theta,) and (n_theta, n_theta).

    `std` and `covariance` are eq. 13-14, right where rho is white; `std_autocorrelated` holds for any spectrum.
    `condition_number` is that of the matrix as it is, in SI units.
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

    References: paper, eq. 13-14; L. Ljung, *System Identification*, 1999, section 9.2 (the sandwich).
    """
    r, b = W.shape
    norms, _, s, Vt = _scaled_svd(W)
    inverse = (Vt.T / s**2) @ Vt / np.outer(norms, norms)  # (W^T W)^-1
    covariance = (rho @ rho) / (r - b) * inverse
    sandwich = inverse @ scores_covariance(W, rho, runs) @ inverse * (r / (r - b))
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


def scores_covariance(W: np.ndarray, rho: np.ndarray, runs: Sequence[int] | None = None) -> np.ndarray:
    """W^T Omega W for a stationary rho of any spectrum, (b, b): the middle of the sandwich.

    Omega, the covariance of rho, is diagonal over frequencies: W^T Omega W = sum over f of W(f)^H S(f) W(f), S the
    periodogram of rho smoothed over neighbouring lines, made good for what the columns themselves took from each line.
    A closed loop rejects slow disturbances, so its residual has next to nothing at low frequencies, where the columns
    of W are largest; sums over a few lags do not see that.

    References: M. Priestley, *Spectral Analysis and Time Series*, 1981, section 6.2 (Daniell's window).
    """
    total = np.zeros((W.shape[1],) * 2)
    ends = np.cumsum([len(rho)] if runs is None else runs)
    for columns, residual in zip(np.split(W, ends[:-1]), np.split(rho, ends[:-1]), strict=True):
        n = len(residual)
        lines = np.abs(np.fft.rfft(residual)) ** 2 / n
        basis = np.linalg.svd(columns, full_matrices=False)[0]
        left = 1 - np.sum(np.abs(np.fft.rfft(basis, axis=0)) ** 2, axis=1) / n  # of each line, after the fit
        half = min(round(n**0.5 / 5), len(lines) - 1)  # narrow beside any feature, wide beside the noise of one line
        window = np.full(2 * half + 1, 1 / (2 * half + 1))
        smooth, kept = (np.convolve(np.pad(a, half, mode="reflect"), window, mode="valid") for a in (lines, left))
        spectrum = smooth / np.maximum(kept, 1 / (2 * half + 1))
        transformed = np.fft.rfft(columns, axis=0)
        both_sides = np.where((np.arange(len(lines)) == 0) | (2 * np.arange(len(lines)) == n), 1.0, 2.0)
        total += np.real((transformed.conj().T * (both_sides * spectrum)) @ transformed) / n
    return total


def base_columns(W: np.ndarray, tolerance: float = 1e-8) -> tuple[np.ndarray, np.ndarray]:
    """Indices of b independent columns of W, and the (b, n - b) matrix beta that regroups the others into them.

    W[:, others] = W[:, base] @ beta, so that chi_base = theta[base] + beta @ theta[others]. The rank is read off a QR
    with column pivoting, columns scaled to one; which columns stay, off an orthogonalisation in the order given: each
    is kept unless those before it already give it.

    References: paper, eq. 12; M. Gautier, *Numerical calculation of the base inertial parameters of robots*, 1991.
    """
    norms = np.linalg.norm(W, axis=0)
    scaled = W / np.where(norms > 0, norms, 1.0)
    pivots = np.abs(np.diag(scipy.linalg.qr(scaled, mode="r", pivoting=True)[0]))
    rank = int(np.sum(pivots > tolerance))
    in_order = _new_in_order(scaled, tolerance)
    base = np.sort(np.argsort(-in_order, kind="stable")[:rank])
    others = np.setdiff1d(np.arange(W.shape[1]), base)
    beta = np.linalg.lstsq(W[:, base], W[:, others], rcond=None)[0] if len(others) else np.zeros((rank, 0))
    return base, beta


def _new_in_order(columns: np.ndarray, tolerance: float) -> np.ndarray:
    """Norm of what each column adds to those before it, (n,). A plain QR would orthogonalise against rounding too."""
    basis = np.zeros((len(columns), 0))
    added = np.zeros(columns.shape[1])
    for i, column in enumerate(columns.T):
        for _ in range(2):  # twice is enough
            column = column - basis @ (basis.T @ column)
        added[i] = np.linalg.norm(column)
        if added[i] > tolerance:
            basis = np.column_stack([basis, column / added[i]])
    return added


def cramer_rao(jacobian: np.ndarray, sigma: float) -> np.ndarray:
    """Smallest covariance an unbiased estimate can have: sigma^2 (J^T J)^-1, white noise of rms sigma on each row.

    A parameter whose column is zero has an infinite variance, and covariances of zero.
    """
    norms = np.linalg.norm(jacobian, axis=0)
    seen = norms > 0
    bound = np.diag(np.where(seen, 0.0, np.inf))
    _, s, Vt = scipy.linalg.svd(jacobian[:, seen] / norms[seen], full_matrices=False)
    with np.errstate(divide="ignore"):
        bound[np.ix_(seen, seen)] = sigma**2 * ((Vt.T / s**2) @ Vt) / np.outer(norms[seen], norms[seen])
    return bound
