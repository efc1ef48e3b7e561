"""Least squares is NumPy's, and a standard deviation is what it says: as many draws lie within it as should."""

import numpy as np
import pytest
import scipy.linalg
import scipy.stats

from didim_jax.statistics import base_columns, cramer_rao, scores_covariance, solve, spread


def regression(n=400, seed=0):
    """A matrix with columns as an inverse model has them, units from 1e-3 to 1e5, and a theta to match."""
    t = np.linspace(0, 4, n)
    rng = np.random.default_rng(seed)
    v = 0.1 * np.sin(2 * np.pi * t) + 0.02 * rng.normal(size=n)
    W = np.stack([np.gradient(v, t), v, np.sign(v), 1e-5 * rng.normal(size=n), np.ones(n)], axis=1)
    return W, np.array([100.0, 200.0, 20.0, 8.8e5, -3.0])


# -- the solution ------------------------------------------------------------------------------------------------


def test_the_solution_is_that_of_numpy():
    W, theta = regression()
    Y = W @ theta + np.random.default_rng(1).normal(size=len(W))
    solution = solve(W, Y)
    norms = np.linalg.norm(W, axis=0)
    expected = np.linalg.lstsq(W / norms, Y, rcond=None)[0] / norms
    np.testing.assert_allclose(solution.theta, expected, rtol=1e-11)  # rounding times the condition of scaled columns
    np.testing.assert_allclose(solution.rho, Y - W @ expected, rtol=0, atol=1e-10)
    assert solution.relative_error == pytest.approx(np.linalg.norm(solution.rho) / np.linalg.norm(Y), rel=1e-12)
    np.testing.assert_allclose(W.T @ solution.rho / norms, np.zeros(5), atol=1e-10)  # rho is normal to every column
    assert solution.spread.condition_number == pytest.approx(np.linalg.cond(W), rel=1e-9)


def test_noiseless_data_give_theta_back():
    W, theta = regression()
    solution = solve(W, W @ theta)
    np.testing.assert_allclose(solution.theta, theta, rtol=1e-11)
    assert solution.relative_error < 1e-13


def test_units_of_the_columns_do_not_matter():
    """A spring in N/m or kN/m: the same estimate and spread in the other unit, to rounding."""
    W, theta = regression()
    Y = W @ theta + np.random.default_rng(1).normal(size=len(W))
    units = np.array([1.0, 1e-6, 1e3, 1e9, 1e-3])
    one, other = solve(W, Y), solve(W * units, Y)
    np.testing.assert_allclose(other.theta * units, one.theta, rtol=1e-10)
    np.testing.assert_allclose(other.spread.std * units, one.spread.std, rtol=1e-10)


def test_equations_13_and_14_are_those_of_the_paper():
    W, theta = regression()
    Y = W @ theta + np.random.default_rng(2).normal(size=len(W))
    solution = solve(W, Y)
    r, b = W.shape
    sigma2 = np.sum(solution.rho**2) / (r - b)
    C = sigma2 * np.linalg.inv(W.T @ W)
    np.testing.assert_allclose(solution.spread.covariance, C, rtol=1e-6)  # the plain inverse squares cond(W) = 1e5
    np.testing.assert_allclose(solution.spread.std, np.sqrt(np.diag(C)), rtol=1e-6)


def test_a_zero_column_is_refused_by_its_place():
    W, theta = regression()
    W[:, 2] = 0
    with pytest.raises(ValueError, match="column 2 of W is zero"):
        solve(W, W @ theta)
    with pytest.raises(ValueError, match="column 2 of W is zero"):
        spread(W, np.ones(len(W)))


@pytest.mark.parametrize("rows", [1, 4, 5])
def test_too_few_rows_are_refused(rows):
    W, theta = regression()
    with pytest.raises(ValueError, match=f"5 parameters need more than {rows} rows"):
        solve(W[:rows], (W @ theta)[:rows])


# -- coverage ----------------------------------------------------------------------------------------------------

DRAWS = 1000


def draws(noise, n_draws=DRAWS, n=400):
    """Errors and both standard deviations over draws of a noise, (n_draws, n_theta) each."""
    W, theta = regression(n)
    solutions = [solve(W, W @ theta + rho) for rho in noise[:n_draws]]
    return (
        np.array([s.theta - theta for s in solutions]),
        np.array([s.spread.std for s in solutions]),
        np.array([s.spread.std_autocorrelated for s in solutions]),
    )


def test_ninety_five_percent_of_white_noise_draws_lie_within_their_interval():
    error, std, robust = draws(2.0 * np.random.default_rng(3).normal(size=(DRAWS, 400)))
    quantile = scipy.stats.t.ppf(0.975, 400 - 5)
    # binomial: 5 parameters, two sides, one chance in a thousand each that a right interval falls outside
    low, high = scipy.stats.binom.interval(0.999, DRAWS, 0.95)
    inside = np.sum(np.abs(error) < quantile * std, axis=0)
    assert np.all((low <= inside) & (inside <= high)), inside
    # the estimates are unbiased, and the rms of their errors is the std: 1000 draws know it to 1/sqrt(2000) = 2.2 %
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), np.mean(std, axis=0), rtol=4 / np.sqrt(2 * DRAWS))
    assert np.all(np.abs(np.mean(error, axis=0)) < 4 * np.mean(std, axis=0) / np.sqrt(DRAWS))
    # the sandwich keeps that where noise is white
    np.testing.assert_allclose(np.mean(robust, axis=0), np.mean(std, axis=0), rtol=0.15)


# -- residuals that are not white --------------------------------------------------------------------------------


def autoregressive(phi, size, rng):
    """AR(1) noise of unit variance along the last axis, stationary from its first sample."""
    e = rng.normal(size=size)
    e[..., 1:] *= np.sqrt(1 - phi**2)
    for k in range(1, size[-1]):
        e[..., k] += phi * e[..., k - 1]
    return e


def columns(phi, n, rng):
    """Three columns: a constant, and two that are AR(1) themselves."""
    return np.stack([np.ones(n), *autoregressive(phi, (2, n), rng)], axis=1)


PHI, LENGTH = 0.8, 2000


@pytest.mark.parametrize(
    ("column_phi", "residual_phi"), [(0.8, 0.8), (0.0, 0.8), (0.8, 0.0)], ids=["both slow", "fast columns", "white"]
)
def test_the_autocorrelated_std_is_right_whatever_the_spectrum(column_phi, residual_phi):
    """Against the exact covariance of the estimate, (W^T W)^-1 W^T S W (W^T W)^-1 with S of the AR(1)."""
    rng = np.random.default_rng(4)
    W = columns(column_phi, LENGTH, rng)
    S = scipy.linalg.toeplitz(residual_phi ** np.arange(LENGTH)) if residual_phi else np.eye(LENGTH)
    A = np.linalg.inv(W.T @ W) @ W.T
    exact = np.sqrt(np.diag(A @ S @ A.T))
    noise = autoregressive(residual_phi, (40, LENGTH), rng)
    found = [solve(W, rho).spread for rho in noise]
    white, robust = (np.mean([getattr(s, name) for s in found], axis=0) for name in ("std", "std_autocorrelated"))
    np.testing.assert_allclose(
        robust, exact, rtol=0.15
    )  # rho lost what the columns took of its lines: some percent; 40 draws scatter less
    # eq. 13-14 are short by sqrt((1 + p) / (1 - p)), p the product of both correlations: 3 for a constant
    p = residual_phi * np.array([1.0, column_phi, column_phi])
    expected = np.sqrt((1 + p) / (1 - p))
    np.testing.assert_allclose(exact / white, expected, rtol=0.15)
    assert expected[0] == pytest.approx(3.0 if residual_phi else 1.0)


def test_intervals_of_the_autocorrelated_std_cover_where_the_white_ones_do_not():
    rng = np.random.default_rng(6)
    W = columns(PHI, LENGTH, rng)
    noise = autoregressive(PHI, (200, LENGTH), rng)
    found = [solve(W, rho) for rho in noise]
    inside = {
        name: np.mean([np.abs(s.theta) < 1.96 * getattr(s.spread, name) for s in found], axis=0)
        for name in ("std", "std_autocorrelated")
    }
    # a std short by 3 (by 2.1) covers 49 % (65 %); one short by 15 % still 90 %; 200 draws know a share to 3.5 %
    assert np.all(inside["std_autocorrelated"] > 0.90 - 2 * 0.035), inside
    assert np.all(inside["std"] < 0.75), inside
    assert inside["std"][0] < 0.60


# -- runs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [400, 401])
def test_the_middle_of_the_sandwich_has_a_closed_form_for_a_flat_spectrum(n):
    """An impulse of size a holds a^2/n at every frequency, so W^T Omega W = a^2/n W^T W, by Parseval.

    White columns take the same small share, 3/n on average, from every line: that is made good, and is the tolerance.
    """
    W = np.random.default_rng(5).normal(size=(n, 3))
    rho = np.zeros(n)
    rho[n // 3] = 7.0
    flat = 49.0 / n * W.T @ W
    np.testing.assert_allclose(scores_covariance(W, rho), flat, rtol=0, atol=0.02 * flat.max())


def test_what_the_columns_took_from_the_residual_is_made_good():
    """A constant takes the mean out of white noise and leaves its line empty: its spread is still white noise's."""
    rng = np.random.default_rng(11)
    W = np.ones((300, 1))
    ratios = []
    for _ in range(400):
        rho = rng.normal(size=300)
        ratios.append(scores_covariance(W, rho - rho.mean())[0, 0] / 300)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)  # 400 draws of a mean over 7 lines: 0.03


def test_records_are_told_apart():
    """The end of one record is no neighbour of the start of the next: each has its own spectrum, and they add."""
    rng = np.random.default_rng(7)
    W, rho = columns(PHI, 1200, rng), autoregressive(PHI, (1200,), rng)
    apart = scores_covariance(W, rho, [700, 500])
    each = scores_covariance(W[:700], rho[:700]) + scores_covariance(W[700:], rho[700:])
    np.testing.assert_allclose(apart, each, rtol=1e-12)
    assert not np.allclose(apart, scores_covariance(W, rho), rtol=1e-6)
    np.testing.assert_array_equal(scores_covariance(W, rho, [1200]), scores_covariance(W, rho))
    np.testing.assert_allclose(apart, apart.T, rtol=1e-12)


def test_a_quiet_record_keeps_its_own_spread():
    """Column 0 lives in a noisy record, column 1 in a quiet one: each parameter's spread follows its own record."""
    rng = np.random.default_rng(10)
    W = np.zeros((2000, 2))
    W[:1000, 0], W[1000:, 1] = rng.normal(size=(2, 1000))
    rho = np.concatenate([10.0 * rng.normal(size=1000), rng.normal(size=1000)])
    found = solve(W, rho, [1000, 1000]).spread
    expected = np.array([10.0, 1.0]) / np.linalg.norm(W, axis=0)
    np.testing.assert_allclose(found.std_autocorrelated, expected, rtol=0.1)  # 1000 samples know an rms to 2 %
    assert found.std[1] > 5 * expected[1]  # eq. 13-14 spread one sigma over both


def test_the_spread_passes_the_records_on():
    rng = np.random.default_rng(8)
    W, rho = columns(PHI, 1200, rng), autoregressive(PHI, (1200,), rng)
    one, two = solve(W, rho, [700, 500]), solve(W, rho)
    np.testing.assert_array_equal(one.theta, two.theta)
    np.testing.assert_array_equal(one.spread.std, two.spread.std)
    assert np.all(one.spread.std_autocorrelated != two.spread.std_autocorrelated)
    inverse = np.linalg.inv(W.T @ W)
    middle = scores_covariance(W, one.rho, [700, 500])
    expected = np.sqrt(np.diag(inverse @ middle @ inverse) * 1200 / 1197)
    np.testing.assert_allclose(one.spread.std_autocorrelated, expected, rtol=1e-9)


# -- base parameters ---------------------------------------------------------------------------------------------


def regrouped(W):
    """Base columns, after checking that they are independent and carry the whole of W."""
    base, beta = base_columns(W)
    others = np.setdiff1d(np.arange(W.shape[1]), base)
    assert beta.shape == (len(base), len(others))
    scaled = W[:, base] / np.linalg.norm(W[:, base], axis=0)
    assert np.linalg.matrix_rank(scaled, tol=1e-8) == len(base)
    np.testing.assert_allclose(W[:, base] @ beta, W[:, others], rtol=0, atol=1e-8 * np.abs(W).max())
    theta = np.random.default_rng(9).normal(size=W.shape[1])
    chi = theta[base] + beta @ theta[others]
    np.testing.assert_allclose(W[:, base] @ chi, W @ theta, rtol=0, atol=1e-8 * np.abs(W @ theta).max())
    return base.tolist(), beta


def test_independent_columns_all_stay():
    W, _ = regression()
    base, beta = regrouped(W)
    assert base == [0, 1, 2, 3, 4]
    assert beta.shape == (5, 0)


def test_dependent_columns_are_found_and_regrouped():
    """A drive that only goes forward: the offset cannot be told from Coulomb friction, nor a sum from its terms."""
    W, _ = regression()
    W = np.column_stack([W, 2.0 * W[:, 1] - 3e-4 * W[:, 3], 5.0 * W[:, 4]])
    base, beta = regrouped(W)
    assert base == [0, 1, 2, 3, 4]
    expected = np.zeros((5, 2))
    expected[[1, 3], 0] = 2.0, -3e-4
    expected[4, 1] = 5.0
    np.testing.assert_allclose(beta, expected, rtol=1e-9, atol=1e-9)


def test_the_first_of_dependent_columns_stays_wherever_they_are():
    W, _ = regression()
    W = W[:, [0, 0, 1, 2, 1, 3]] * np.array([1.0, -2.0, 1.0, 1.0, 1e-3, 1e4])
    base, beta = regrouped(W)
    assert base == [0, 2, 3, 5]
    np.testing.assert_allclose(beta, [[-2, 0], [0, 1e-3], [0, 0], [0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("W", "expected"),
    [
        ([[1, 1, 0], [0, 0, 1], [0, 0, 0], [0, 0, 0]], [0, 2]),  # a copy, then a column with one entry of its own
        ([[1, 0, 2, 0], [0, 0, 0, 3], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]], [0, 3]),
        ([[1, 1, 0, 1], [1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0], [0, 0, 0, 1]], [0, 2, 3]),
    ],
    ids=["copy", "zero column", "blocks"],
)
def test_sparse_columns_hide_no_dependence(W, expected):
    """Columns full of zeros, as the two rows of a flexible drive have them."""
    base, _ = regrouped(np.array(W, dtype=float))
    assert base == expected


def test_a_zero_column_is_never_a_base_parameter():
    W, _ = regression()
    W[:, 1] = 0
    base, beta = regrouped(W)
    assert base == [0, 2, 3, 4]
    np.testing.assert_allclose(beta, np.zeros((4, 1)), atol=1e-12)


def test_the_tolerance_decides_what_counts_as_dependent():
    W, _ = regression()
    nearly = W[:, 1] + 1e-5 * np.linalg.norm(W[:, 1]) / np.sqrt(len(W)) * np.random.default_rng(1).normal(size=len(W))
    W = np.column_stack([W, nearly])
    assert base_columns(W)[0].tolist() == [0, 1, 2, 3, 4, 5]
    assert base_columns(W, tolerance=1e-3)[0].tolist() == [0, 1, 2, 3, 4]


# -- Cramer-Rao --------------------------------------------------------------------------------------------------


def test_the_bound_of_orthogonal_columns_is_sigma_over_their_length():
    J = np.zeros((6, 3))
    J[:2, 0], J[2:4, 1], J[4:, 2] = 3.0, 1e-6, 1e5
    expected = np.diag(0.5**2 / np.array([18.0, 2e-12, 2e10]))
    np.testing.assert_allclose(cramer_rao(J, 0.5), expected, rtol=1e-12, atol=0)


def test_the_bound_of_two_columns_grows_as_they_become_alike():
    """var = sigma^2 / (norm^2 sin^2 phi), correlation -cos phi, phi the angle between the columns."""
    for phi in (1.0, 0.1, 1e-3):
        J = np.array([[1.0, np.cos(phi)], [0.0, np.sin(phi)], [0.0, 0.0]])
        C = cramer_rao(J, 2.0)
        # 1e-16 of a column, over sin(phi) squared
        np.testing.assert_allclose(np.diag(C), 4.0 / np.sin(phi) ** 2, rtol=1e-15 * 30 / phi**2 + 1e-13)
        assert C[0, 1] / C[0, 0] == pytest.approx(-np.cos(phi), rel=1e-8)


def test_least_squares_on_white_noise_reaches_the_bound():
    W, _ = regression()
    rho = np.random.default_rng(1).normal(size=len(W))
    found = spread(W, rho)
    sigma = np.sqrt(rho @ rho / (400 - 5))
    np.testing.assert_allclose(cramer_rao(W, sigma), found.covariance, rtol=1e-10)
