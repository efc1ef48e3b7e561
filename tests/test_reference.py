"""A reference goes where and as fast as it says, from rest to rest, and within its limits or not at all."""

import numpy as np
import pytest

from didim_jax.errors import InputError
from didim_jax.reference import (
    Chirp,
    Dwell,
    Limits,
    Multisine,
    Sequence,
    Together,
    Trapezoid,
    check,
    load_reference,
)

DT = 1e-3
WIDE = Limits(stroke=(-1.0, 1.0), speed=10.0, acceleration=1e3)

MOTIONS = (
    Dwell(0.1),
    Trapezoid(0.1, 0.12, 0.8, repeats=2, dwell=0.05),
    Trapezoid(-0.01, 0.5, 0.8),
    Chirp(1e-3, 1.0, 60.0, 2.0, exponent=1.0, taper=0.2),
    Multisine(1e-3, base=1.0, harmonics=(1, 3, 5, 7), periods=2),
    Sequence((Trapezoid(0.05, 0.1, 1.0), Dwell(0.1), Chirp(1e-3, 60.0, 10.0, 1.0))),
    Together((Trapezoid(0.05, 0.1, 1.0), Chirp(1e-4, 10.0, 60.0, 0.5))),
)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("dt", [1e-3, 0.7e-3])
def test_every_motion_starts_at_zero_at_rest_and_ends_where_it_started(motion, dt):
    q = motion.sample(dt)
    assert q[0] == 0.0
    assert abs(q[-1]) < 1e-12
    largest = np.abs(np.diff(q, 2)).max(initial=0.0)
    for step in (q[1] - q[0], q[-1] - q[-2]):
        assert abs(step) <= largest + 1e-12  # a start or stop from speed would be a jump beyond any acceleration inside


def test_a_trapezoid_accelerates_at_one_rate_only_and_cruises_at_its_speed():
    q = Trapezoid(0.1, 0.125, 0.8, repeats=2, dwell=0.044).sample(DT)
    v, a = np.diff(q) / DT, np.diff(q, 2) / DT**2
    assert np.max(q) == pytest.approx(0.1, abs=1e-15)
    assert np.max(np.abs(v)) == pytest.approx(0.125, rel=1e-10)
    # bang-bang: but for the few samples across a switch, the acceleration is -0.8, 0 or 0.8
    near = np.min(np.abs(a[:, None] - np.array([-0.8, 0.0, 0.8])), axis=1)
    switches = 2 * 2 * 4
    assert np.sum(near > 1e-6) <= 2 * switches
    assert np.max(np.abs(a)) <= 0.8 * (1 + 1e-8)  # rounding: 1e-17 m / dt^2


def test_a_short_trapezoid_is_a_triangle_of_velocity():
    q = Trapezoid(0.01, 10.0, 1.0).sample(DT)
    assert np.max(np.abs(np.diff(q))) / DT == pytest.approx(np.sqrt(0.01 * 1.0), rel=0.01)  # v = sqrt(d a), to a dt


def test_moves_do_not_drift_over_many_repeats():
    q = Trapezoid(0.02, 0.03, 1.1, repeats=20, dwell=0.0123).sample(DT)
    half = 0.02 / 0.03 + 0.03 / 1.1 + 0.0123
    middles = np.round((np.arange(40) + 0.5) * half / DT - 0.0123 / 2 / DT).astype(int)
    np.testing.assert_allclose(q[middles], 0.01, atol=0.03 * DT)  # half way in the middle of each move, to one sample


@pytest.mark.parametrize(("f_start", "f_end"), [(2.0, 40.0), (40.0, 2.0)])
def test_a_chirp_has_its_frequency_and_amplitude_law(f_start, f_end):
    chirp = Chirp(1e-3, f_start, f_end, 10.0, exponent=2.0, taper=0.1)
    q, t = chirp.sample(1e-4), 1e-4 * np.arange(100001)
    up = np.flatnonzero((q[:-1] < 0) & (q[1:] >= 0))
    crossings = t[up] - 1e-4 * q[up] / (q[up + 1] - q[up])
    middle = (crossings[1:] + crossings[:-1]) / 2
    expected = f_start + (f_end - f_start) * middle / 10.0
    inside = (middle > 0.5) & (middle < 9.5)
    np.testing.assert_allclose(1 / np.diff(crossings)[inside], expected[inside], rtol=2e-2)  # f changes within a period
    for at in (3.0, 7.0):
        f = f_start + (f_end - f_start) * at / 10.0
        around = np.abs(t - at) < 1 / f
        assert np.max(np.abs(q[around])) == pytest.approx(1e-3 * (f_start / f) ** 2, rel=0.2)


def test_a_multisine_has_its_peak_and_only_its_harmonics():
    signal = Multisine(2e-3, base=0.5, harmonics=(2, 5, 9, 20), periods=3, exponent=0.5, taper=0.25)
    q = signal.sample(DT)[250:4250]  # two whole periods
    lines = np.abs(np.fft.rfft(q)) / 2000
    k = np.arange(len(lines)) / 2  # in harmonics of the base
    present = np.isin(k, (2, 5, 9, 20))
    assert np.max(np.abs(q)) == pytest.approx(2e-3, rel=0.01)
    assert np.max(lines[~present]) < 1e-12
    np.testing.assert_allclose(lines[present] / lines[4], (np.array([2, 5, 9, 20]) / 2) ** -0.5, rtol=1e-9)


def test_schroeder_phases_peak_less_than_drawn_ones_and_seeds_differ():
    def crest(seed):
        q = Multisine(1.0, base=1.0, harmonics=tuple(range(1, 31)), exponent=0.0, taper=0.0, seed=seed).sample(DT)
        return 1.0 / np.std(q)  # the peak is 1

    drawn = [crest(seed) for seed in range(5)]
    assert crest(None) < min(drawn)
    assert len(set(drawn)) == 5


def test_a_sequence_goes_on_where_the_part_before_ended_and_together_adds():
    parts = Trapezoid(0.05, 0.1, 1.0), Chirp(1e-3, 5.0, 20.0, 1.0)
    a, b = (part.sample(DT) for part in parts)
    np.testing.assert_array_equal(Sequence(parts).sample(DT), np.concatenate([a, a[-1] + b[1:]]))
    total = Together(parts).sample(DT)
    np.testing.assert_array_equal(total[: len(b)], a[: len(b)] + b)
    np.testing.assert_array_equal(total[len(b) :], a[len(b) :] + b[-1])


@pytest.mark.parametrize(
    ("limits", "named"),
    [
        (Limits(stroke=(-0.01, 0.09), speed=1.0, acceleration=10.0), "stroke, upper end"),
        (Limits(stroke=(0.01, 0.2), speed=1.0, acceleration=10.0), "stroke, lower end"),
        (Limits(stroke=(-0.01, 0.2), speed=0.1, acceleration=10.0), "speed"),
        (Limits(stroke=(-0.01, 0.2), speed=1.0, acceleration=0.5), "acceleration"),
    ],
)
def test_a_limit_that_is_exceeded_is_named_with_time_and_excess(limits, named):
    q = Trapezoid(0.1, 0.12, 0.8).sample(DT)
    check(q, DT, WIDE)
    with pytest.raises(InputError, match=named) as caught:
        check(q, DT, limits)
    excess = {
        "stroke, upper end": "0.01 m",
        "stroke, lower end": "0.01 m",
        "speed": "0.02 m/s",
        "acceleration": "0.3 m/s2",
    }
    assert f"by {excess[named]}" in str(caught.value)


def test_a_reference_may_touch_its_limits():
    check(Trapezoid(0.1, 0.12, 0.8).sample(DT), DT, Limits(stroke=(0.0, 0.1), speed=0.12, acceleration=0.8))


def test_the_time_of_the_first_excess_is_right():
    q = Sequence((Dwell(0.5), Trapezoid(0.1, 0.12, 0.8))).sample(DT)
    with pytest.raises(InputError, match=r"from t = 0\.6"):  # 0.08 m/s after 0.1 s of 0.8 m/s2
        check(q, DT, Limits(stroke=(-1, 1), speed=0.08, acceleration=10.0))


def test_a_frequency_above_half_the_sampling_rate_is_refused():
    with pytest.raises(InputError, match="600 Hz"):
        Chirp(1e-3, 1.0, 600.0, 1.0).sample(DT)


# -- files -------------------------------------------------------------------------------------------------------

HEAD = "start = 0.02\n[limits]\nstroke = [0.0, 0.2]\nspeed = 0.3\nacceleration = 30.0\n"
TRAPEZOID = '[[segment]]\nkind = "trapezoid"\ndistance = 0.1\nspeed = 0.12\nacceleration = 0.8\n'
CHIRP = 'kind = "chirp"\namplitude = 1e-4\nf_start = 5.0\nf_end = 30.0\nduration = 1.0\n'


def test_a_file_gives_the_motions_written_in_it(tmp_path):
    path = tmp_path / "reference.toml"
    path.write_text(HEAD + TRAPEZOID + f'[[segment]]\nkind = "together"\n[[segment.part]]\n{CHIRP}')
    reference = load_reference(path)
    trapezoid, chirp = Trapezoid(0.1, 0.12, 0.8), Chirp(1e-4, 5.0, 30.0, 1.0)
    assert reference.motion == Sequence((trapezoid, Together((chirp,))))
    np.testing.assert_array_equal(reference.sample(DT), 0.02 + Sequence((trapezoid, chirp)).sample(DT))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + TRAPEZOID.replace("speed", "sped"), ["segment 1", "'sped'", "'speed'"]),
        (HEAD + TRAPEZOID.replace("trapezoid", "trapezoidal"), ["segment 1", "'trapezoidal'", "'trapezoid'"]),
        (HEAD + TRAPEZOID.replace('kind = "trapezoid"\n', ""), ["segment 1", "kind"]),
        (HEAD + TRAPEZOID.replace("0.12", "-0.12"), ["segment 1", "speed", "m/s", "-0.12"]),
        (HEAD + TRAPEZOID + "[[segment]]\n" + CHIRP.replace("f_end", "fend"), ["segment 2", "'fend'", "'f_end'"]),
        (HEAD + "[[segment]]\n" + CHIRP + "taper = 0.8\n", ["segment 1", "taper"]),
        (HEAD + '[[segment]]\nkind = "together"\n[[segment.part]]\n' + CHIRP + "x = 1\n", ["segment 1, part 1", "'x'"]),
        (HEAD, ["segment"]),
        (HEAD.replace("stroke = [0.0, 0.2]", "stroke = [0.2, 0.0]") + TRAPEZOID, ["stroke"]),
        (HEAD.replace("speed", "sped") + TRAPEZOID, ["limits.sped", "limits.speed"]),
    ],
)
def test_a_mistake_in_a_file_is_one_line_naming_the_place(tmp_path, text, said):
    path = tmp_path / "reference.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_reference(path)
    message = str(caught.value)
    assert "\n" not in message
    for words in ("reference.toml", *said):
        assert words in message


def test_a_reference_outside_its_limits_is_refused_when_sampled(tmp_path):
    path = tmp_path / "reference.toml"
    path.write_text(HEAD.replace("0.3", "0.1") + TRAPEZOID)
    with pytest.raises(InputError, match="speed"):
        load_reference(path).sample(DT)
