"""The filter is zero-phase, is MATLAB's filtfilt and decimate, and is one operation on the host and in JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal

from didim_jax.signals import Decimation, LowPass, TracedDecimation, central_difference

DT = 1e-3
N = 3000
CUTOFFS = (5.0, 60.0, 100.0)


def ba(name):
    """The same filters as polynomials: the form that scipy.signal.filtfilt and MATLAB's filtfilt run."""
    if name == "decimate":
        return scipy.signal.cheby1(8, 0.05, 0.8 / 10)
    return scipy.signal.butter(4, 2 * name * DT)


def decimation(name, factor=None):
    if name == "decimate":
        return Decimation(LowPass.chebyshev(10), 10 if factor is None else factor)
    made = Decimation.at(name, DT)
    return made if factor is None else Decimation(made.low_pass, factor)


every_filter = pytest.mark.parametrize("name", [*CUTOFFS, "decimate"])


@pytest.fixture(scope="module")
def record():
    """A force as a drive gives it: slow motion, a mode, steps of friction, noise."""
    t = DT * np.arange(N)
    slow = 100 * np.sin(2 * np.pi * 0.7 * t) + 20 * np.sign(np.cos(2 * np.pi * 0.7 * t))
    return slow + 30 * np.sin(2 * np.pi * 24 * t) + 5 * np.random.default_rng(0).normal(size=N)


def inside(x, samples=300):
    return x[samples:-samples]


# -- against scipy.signal.filtfilt and between host and JAX ------------------------------------------------------


POLYNOMIAL = {5.0: 1e-9, 60.0: 1e-12, 100.0: 1e-12, "decimate": 1e-7}
"""What the polynomial form leaves of double precision: rounded coefficients move poles that lie close together near 1,
by 3e-10 for order 4 at 5 Hz and by 1e-8 for order 8 at 40 Hz. The next test holds that the sections are the exact one.
"""


@every_filter
def test_the_filter_is_filtfilt(name, record):
    """In the interior and at the edges too, since both extend the record alike."""
    b, a = ba(name)
    y = np.asarray(decimation(name, factor=1).traced()(jnp.asarray(record)))
    expected = scipy.signal.filtfilt(b, a, record)
    np.testing.assert_allclose(y, expected, rtol=0, atol=POLYNOMIAL[name] * np.abs(expected).max())


@every_filter
def test_the_filter_is_its_squared_gain_in_the_frequency_domain(name):
    """On a burst with silence around it no edge enters: the Fourier transform, with zeros and poles, is the truth."""
    x = np.zeros(8000)
    x[3700:4300] = np.random.default_rng(5).normal(size=600)
    zpk = {"output": "zpk"}
    design = (
        scipy.signal.cheby1(8, 0.05, 0.08, **zpk) if name == "decimate" else scipy.signal.butter(4, name / 500, **zpk)
    )
    _, H = scipy.signal.freqz_zpk(*design, worN=2 * np.pi * np.fft.rfftfreq(len(x)))
    expected = np.fft.irfft(np.abs(H) ** 2 * np.fft.rfft(x), len(x))
    low_pass = decimation(name, factor=1)
    for y in (low_pass(x), low_pass.traced()(jnp.asarray(x))):
        # the slowest pole, 12/s, has forgotten the burst to e^-44 when it comes round; the rest is rounding
        np.testing.assert_allclose(y, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@every_filter
@pytest.mark.parametrize("factor", [None, 1, 7])
def test_host_and_jax_agree_edges_included(name, factor, record):
    on_host = decimation(name, factor)
    y = on_host.traced()(jnp.asarray(record))
    assert y.shape == on_host(record).shape == (-(-N // on_host.factor),)
    np.testing.assert_allclose(y, on_host(record), rtol=0, atol=1e-12 * np.abs(record).max())


@pytest.mark.parametrize("n", [40, 101, 1000])
def test_short_and_odd_records_too(n, record):
    on_host = decimation(60.0)
    np.testing.assert_allclose(on_host.traced()(jnp.asarray(record[:n])), on_host(record[:n]), rtol=0, atol=1e-10)


def test_every_column_passes_through_the_same_filter(record):
    on_host = decimation(60.0)
    W = np.stack([record, np.cumsum(record), record**2], axis=1)
    together = on_host(W)
    for i in range(3):
        np.testing.assert_array_equal(together[:, i], on_host(W[:, i].copy()))


# -- what the filter is ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cutoff", CUTOFFS)
def test_the_cutoff_is_where_two_passes_have_halved_the_signal(cutoff):
    low_pass = LowPass.butterworth(cutoff, DT)
    frequencies = np.array([0.0, cutoff / 4, cutoff, 2 * cutoff])
    gain = np.abs(scipy.signal.freqz_sos(low_pass.sos, worN=frequencies, fs=1 / DT)[1]) ** 2
    warped = np.tan(np.pi * frequencies * DT) / np.tan(np.pi * cutoff * DT)  # the bilinear transform's frequency axis
    np.testing.assert_allclose(gain, 1 / (1 + warped**8), rtol=1e-9)
    assert gain[2] == pytest.approx(0.5, rel=1e-9)


def test_a_sine_comes_out_at_its_gain_without_delay():
    t = DT * np.arange(N)
    for frequency, cutoff in ((2.0, 5.0), (20.0, 60.0), (60.0, 60.0)):
        low_pass = LowPass.butterworth(cutoff, DT)
        gain = float(np.abs(scipy.signal.freqz_sos(low_pass.sos, worN=[frequency], fs=1 / DT)[1][0]) ** 2)
        for wave in (np.sin, np.cos):
            x = wave(2 * np.pi * frequency * t)
            y = Decimation(low_pass, 1).traced()(jnp.asarray(x))
            # edges decay as exp(-0.38 2 pi cutoff t): below 1e-9 after 1.5 s at 5 Hz
            np.testing.assert_allclose(inside(y, 1480), gain * inside(x, 1480), rtol=0, atol=2e-8)


def test_the_filter_is_the_same_forward_and_backward(record):
    """Zero phase: reversing time before and after changes nothing, away from the edges."""
    traced = decimation(60.0, factor=1).traced()
    forward, backward = traced(jnp.asarray(record)), traced(jnp.asarray(record[::-1].copy()))[::-1]
    np.testing.assert_allclose(inside(forward), inside(backward), rtol=0, atol=1e-11 * np.abs(record).max())


def test_straight_lines_pass_unchanged():
    """Gain 1 at rest and no delay, away from the edges."""
    line = 3.0 - 0.01 * np.arange(N)
    for name in CUTOFFS:
        y = decimation(name, factor=1).traced()(jnp.asarray(line))
        np.testing.assert_allclose(inside(y, 1480), inside(line, 1480), rtol=0, atol=1e-7)


# -- derivatives -------------------------------------------------------------------------------------------------


@every_filter
def test_the_derivative_is_the_filter_itself(name, record):
    """A linear map is its own derivative, at any point, in any direction."""
    traced = decimation(name).traced()
    direction = jnp.asarray(np.random.default_rng(1).normal(size=N))
    y, dy = jax.jvp(traced, (jnp.asarray(record),), (direction,))
    np.testing.assert_allclose(y, traced(jnp.asarray(record)), rtol=0, atol=1e-12 * np.abs(record).max())
    np.testing.assert_allclose(dy, traced(direction), rtol=0, atol=1e-12)
    assert np.abs(dy).max() > 1e-2


def test_the_transpose_is_the_adjoint(record):
    """<F x, y> = <x, F^T y>: reverse mode passes through as well."""
    traced = decimation(60.0).traced()
    x = jnp.asarray(record)
    y = jnp.asarray(np.random.default_rng(2).normal(size=-(-N // traced.factor)))
    out, transpose = jax.vjp(traced, x)
    (back,) = transpose(y)
    assert float(out @ y) == pytest.approx(float(x @ back), rel=1e-10)


# -- rules -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cutoff", "dt", "factor"),
    [
        (5.0, 1e-3, 100),
        (60.0, 1e-3, 8),
        (100.0, 1e-3, 5),
        (400.0, 1e-3, 1),
        (10.0, 1e-2, 5),
        (30.0, 1 / 1024, 17),
        (5.0, 1e-3 * (1 + 1e-12), 100),
    ],
)
def test_the_factor_keeps_the_cutoff_below_the_new_nyquist_and_no_lower_than_it_must(cutoff, dt, factor):
    made = Decimation.at(cutoff, dt)
    assert made.factor == factor
    assert 0.5 / (factor * dt) >= cutoff * (1 - 1e-9)
    assert 0.5 / ((factor + 1) * dt) < cutoff


def test_filtered_and_decimated_white_noise_is_nearly_white():
    x = np.random.default_rng(3).normal(size=200_000)
    y = Decimation.at(60.0, DT)(x)
    y = y - y.mean()
    correlation = np.sum(y[1:] * y[:-1]) / np.sum(y**2)
    # the two-pass Butterworth leaves 0.06 to 0.1 at one sample (its gain is 1/2, not 0, at 0.96 of the new Nyquist)
    assert abs(correlation) < 0.15


@pytest.mark.parametrize("cutoff", [0.0, -5.0, 500.0, 600.0, np.nan])
def test_a_cutoff_out_of_range_is_refused_with_the_range(cutoff):
    with pytest.raises(ValueError, match="between 0 and 500 Hz"):
        LowPass.butterworth(cutoff, DT)
    with pytest.raises(ValueError, match="between 0 and 500 Hz"):
        Decimation.at(cutoff, DT)


def test_trimming_drops_the_ends_before_filtering_and_not_in_simulations(record):
    low_pass = LowPass.butterworth(60.0, DT)
    trimmed = Decimation(low_pass, 8, trim=50)
    np.testing.assert_array_equal(trimmed(record), low_pass(record[50:-50])[::8])
    with pytest.raises(ValueError, match="not trimmed"):
        trimmed.traced()


def test_the_traced_filter_is_data_and_not_code(record):
    """Another cutoff of the same order and factor is another value of the same pytree: nothing compiles again."""
    one, other = decimation(60.0, factor=8).traced(), decimation(55.0, factor=8).traced()
    assert isinstance(one, TracedDecimation)
    assert jax.tree.structure(one) == jax.tree.structure(other)


# -- differences -------------------------------------------------------------------------------------------------


def test_central_differences_are_exact_on_parabolas_inside_and_of_second_order():
    t = DT * np.arange(200)
    parabola = 0.3 - 2 * t + 5 * t**2
    np.testing.assert_allclose(central_difference(parabola, DT)[1:-1], (-2 + 10 * t)[1:-1], rtol=0, atol=1e-12)
    w = 2 * np.pi * 20
    inner = central_difference(np.sin(w * t), DT)[1:-1]
    np.testing.assert_allclose(inner, (w * np.cos(w * t) * np.sinc(w * DT / np.pi))[1:-1], rtol=0, atol=1e-10)


def test_central_differences_run_along_samples_for_every_column():
    x = np.random.default_rng(4).normal(size=(50, 3))
    d = central_difference(x, DT)
    np.testing.assert_allclose(d[1:-1], (x[2:] - x[:-2]) / (2 * DT), rtol=1e-12)
    np.testing.assert_allclose(d[[0, -1]], np.stack([x[1] - x[0], x[-1] - x[-2]]) / DT, rtol=1e-12)
