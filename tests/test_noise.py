"""A residual's own noise, and what of a residual is not noise."""

import numpy as np
import pytest
import scipy.fft
import scipy.signal

from didim_jax.gap.noise import CORRELATION_TIME, Noise
from didim_jax.gap.relevance import halves
from didim_jax.gap.remainder import bursts, line

DT, N = 8e-3, 1250


def coloured(rms: float, memory: float, draw: np.random.Generator) -> np.ndarray:
    """A first-order process, stationary."""
    keep = np.exp(-DT / memory)
    kicks = draw.normal(0, rms * np.sqrt(1 - keep**2), N)
    x, _ = scipy.signal.lfilter([1.0], [1.0, -keep], kicks, zi=[keep * draw.normal(0, rms)])
    return np.asarray(x)


def test_a_known_spectrum_comes_back():
    draw = np.random.default_rng(2)
    f = np.arange(N) / (2 * N * DT)
    drift = 4 * CORRELATION_TIME / (1 + (2 * np.pi * f * CORRELATION_TIME) ** 2) / (2 * DT)
    spectrum = 2.0**2 / (1 + (f / 12.0) ** 2) + 0.6**2 * drift
    lines = np.sqrt(spectrum) * draw.normal(size=(20, N))
    found = [Noise.of(r, DT) for r in scipy.fft.idct(lines, norm="ortho")]
    assert np.median([n.sigma for n in found]) == pytest.approx(2.0, rel=0.1)
    assert np.median([n.corner for n in found]) == pytest.approx(12.0, rel=0.1)
    assert np.median([n.slow for n in found]) == pytest.approx(0.6, rel=0.25)


def test_its_whitening_makes_unit_variance_at_any_level():
    draw = np.random.default_rng(3)
    r = coloured(1.0, 0.01, draw) + coloured(1.0, CORRELATION_TIME, draw)
    for scale in (1e-6, 1.0, 1e4):
        noise = Noise.of(scale * r, DT)
        e = noise.whitening(N, DT)(scale * r)
        assert np.mean(e**2) == pytest.approx(1.0, abs=0.1)
        assert abs(np.mean(e[1:] * e[:-1])) < 0.1


def test_likelihoods_differ_by_what_was_explained_and_not_by_the_unit():
    draw = np.random.default_rng(4)
    noise = coloured(1.0, 0.01, draw)
    wave = 0.5 * np.sin(2 * np.pi * 7.0 * DT * np.arange(N))
    falls = [
        Noise.of(scale * noise, DT).log_likelihood - Noise.of(scale * (noise + wave), DT).log_likelihood
        for scale in (1.0, 1e-6)
    ]
    assert falls[0] > 20
    assert falls[1] == pytest.approx(falls[0], rel=1e-3)


def test_a_constant_force_is_worth_little_beside_drift_and_much_without():
    draw = np.random.default_rng(5)
    quiet, drifting = coloured(1.0, 0.01, draw), coloured(0.5, CORRELATION_TIME, draw)
    worth = [Noise.of(r, DT).log_likelihood - Noise.of(r + 1.0, DT).log_likelihood for r in (quiet, quiet + drifting)]
    assert worth[0] > 3 and worth[0] > worth[1] + 2


def test_a_residual_that_is_all_but_zero_has_a_finite_likelihood():
    assert np.isfinite(Noise.of(np.zeros(N), DT, 1e-4).log_likelihood)
    assert np.isfinite(Noise.of(np.full(N, 1e-12), DT, 1e-4).log_likelihood)


def test_bursts_are_found_and_noise_has_none():
    draw = np.random.default_rng(6)
    noise, moves = draw.normal(size=(200, N)), np.linspace(0.0, 0.1, N)
    assert np.mean([bursts(x, moves, DT) > 0.05 for x in noise]) < 0.05
    noise[:, 300:320] *= 8
    assert np.mean([bursts(x, moves, DT) > 0.3 for x in noise]) > 0.95


def test_silence_at_rest_is_no_quiet_noise():
    draw = np.random.default_rng(7)
    rests = np.concatenate([np.zeros(N // 2), np.linspace(0.0, 0.1, N - N // 2)])
    noise = draw.normal(size=(200, N)) * np.where(np.arange(N) < N // 2, 0.1, 1.0)
    assert np.mean([bursts(x, rests, DT) > 0.05 for x in noise]) < 0.05


def test_a_steady_line_is_found_with_its_frequency_and_noise_has_none():
    draw = np.random.default_rng(8)
    noise, t = draw.normal(size=(200, N)), DT * np.arange(N)
    assert np.mean([line(x, DT)[0] > 0.03 for x in noise]) < 0.02
    found = [line(x + np.sin(2 * np.pi * 49.93 * t), DT) for x in noise]  # a third of the energy
    assert np.mean([share for share, _ in found]) == pytest.approx(1 / 3, abs=0.03)
    assert np.median([f for _, f in found]) == pytest.approx(49.93, abs=0.03)


@pytest.mark.parametrize("period", [0.4, 0.5, 0.8, 1.0, 2.0])
def test_blocks_left_out_do_not_keep_time_with_a_motion_that_repeats(period):
    phase = (DT * np.arange(N) / period % 1 * 5).astype(int)
    shares = np.array([halves(N, DT)[phase == k].mean() for k in range(5)])
    assert np.all((shares > 0.15) & (shares < 0.85)), shares
