"""The atlas finds the variable a residual was made from, and what noise was added, and sees no structure in noise."""

import io
import itertools
import json

import numpy as np
import pytest

from didim_jax.gap.atlas import PHASES, atlas
from didim_jax.gap.variables import LABELS
from didim_jax.report.atlas import atlas_figure
from didim_jax.report.canvas import png

DT, LEAD, NOISE = 8e-3, 5e-3, 0.5


@pytest.fixture(scope="module")
def motion():
    """Strokes of 0.12 m at four speeds, with dwells and a chirp on the slow ones, as on an axis of the EMPS kind."""
    fine = 1e-3
    velocity = []
    for speed, chirp in ((0.09, 0.0), (0.18, 0.0), (0.045, 0.06), (0.13, 0.0)):
        cruise = 0.12 / speed
        ramp = np.linspace(0, 1, 120)
        stroke = speed * np.concatenate([ramp, np.ones(round((cruise - 0.12) / fine)), ramp[::-1]])
        clock = fine * np.arange(len(stroke))
        stroke = stroke + chirp * speed * np.sin(2 * np.pi * (1 + 3 * clock) * clock)
        rest = np.zeros(250)
        velocity += [stroke, rest, -stroke, rest]
    v = np.concatenate(velocity)
    qg = np.cumsum(v) * fine
    q = qg - 2e-4 * np.tanh(v / 1e-2)  # the motor lags its reference
    v = np.gradient(q, fine)
    signals = {"q": q, "v": v, "a": np.gradient(v, fine), "reference": qg}
    signals = {name: x[::8] for name, x in signals.items()}
    return {"t": DT * np.arange(len(signals["q"])), **signals, "dt": DT, "lead": LEAD}


def _bump(motion):
    """Local friction, less the even friction that a nominal fit takes from it."""
    bump = np.exp(-(((motion["q"] - 0.045) / 0.01) ** 2))
    return np.tanh(motion["v"] / 1e-3) * (bump - bump.mean())


def _atlas(motion, clean, seed=0, **more):
    """Atlas of a residual of 2 N rms and white noise of 0.5 N."""
    n = len(motion["t"])
    noise = NOISE * np.random.default_rng(seed).standard_normal(n)
    clean = np.zeros(n) if clean is None else 2 * clean / np.sqrt(np.mean(clean**2))
    return atlas(residual=clean + noise, **motion, **more)


def _late(motion):
    """The reference's acceleration, 40 ms late: what a linear loop makes of it."""
    return np.roll(np.concatenate([[0], np.diff(motion["reference"], 2), [0]]), 5)


MADE_FROM = {
    "constant": lambda m: np.ones_like(m["t"]),
    "v_even": lambda m: np.abs(m["v"]) - 0.05,
    "v_odd": lambda m: np.tanh(m["v"] / 1e-3) * (np.exp(-((m["v"] / 0.03) ** 2)) - 0.3),
    "q": lambda m: m["q"] - m["q"].mean(),
    "direction_q": _bump,
    "screw": lambda m: np.sin(2 * np.pi * m["q"] / LEAD + 0.4),
    "direction_screw": lambda m: np.tanh(m["v"] / 1e-3) * np.sin(2 * np.pi * m["q"] / LEAD + 0.4),
    "time": lambda m: np.exp(-m["t"] / 4) - 0.3,
    "direction_time": lambda m: np.tanh(m["v"] / 1e-3) * (np.exp(-m["t"] / 4) - 0.3),
    "dynamics": _late,
}


@pytest.mark.parametrize("name", MADE_FROM)
def test_the_variable_a_residual_was_made_from_closes_most_and_leaves_the_noise(motion, name):
    found = _atlas(motion, MADE_FROM[name](motion))
    best = {v.name for v in found.variables if v.share > found.variables[0].share - 0.005}
    assert name in best  # a constant is a function of speed, too
    assert found[name].share > 0.8 * found.explainable
    assert found.floor_rms == pytest.approx(NOISE, rel=0.15)
    assert found.closed == pytest.approx(1 - (NOISE / found.rms) ** 2, abs=0.05)
    assert 0 <= found.explainable <= 1


@pytest.mark.parametrize("name", ["direction_q", "screw", "direction_time", "dynamics"])
def test_what_only_one_variable_closes_is_said_to_be_closed_by_no_other(motion, name):
    found = _atlas(motion, MADE_FROM[name](motion))
    others = [v.last_in for v in found.variables if v.name != name]
    assert found[name].last_in > 0.1 > 4 * max(others)


def test_noise_has_no_structure(motion):
    for seed in range(3):
        found = _atlas(motion, None, seed)
        assert set(LABELS) == {v.name for v in found.variables}
        assert max(v.share for v in found.variables) < 0.02
        assert max(v.last_in for v in found.variables) < 0.02
        assert found.closed < 0.02
        assert found.explainable < 0.15
        assert found.floor_rms == pytest.approx(NOISE, rel=0.1)
        assert "noise" in found.words()


def test_slow_drift_of_friction_is_not_taken_for_a_function_of_position(motion):
    """On a repeated stroke, direction and position are confounded: compared jointly, time keeps its share."""
    found = _atlas(motion, MADE_FROM["direction_time"](motion))
    assert found["direction_q"].last_in < 0.02
    assert "direction × time" in found.words()


def test_parts_sum_to_the_whole(motion):
    found = _atlas(motion, MADE_FROM["direction_q"](motion))
    for parts in (found.bands, found.phases, found.passes, found.segments):
        assert sum(p.energy for p in parts) == pytest.approx(1)
        assert sum(p.size for p in parts) == pytest.approx(1)
    np.testing.assert_allclose(found.table.sum(axis=1), [b.energy for b in found.bands], rtol=1e-9)
    assert found.table.shape == (len(found.bands), len(PHASES))
    assert len(found.passes) == 8
    for one, following in itertools.pairwise(found.passes):
        assert one.span[1] == pytest.approx(following.span[0])


def test_phases_are_those_of_the_reference(motion):
    sizes = {p.name: p.size for p in _atlas(motion, None).phases}
    assert sizes["accelerating"] == pytest.approx(sizes["decelerating"], rel=0.2)
    assert sizes["cruise"] > 0.5
    assert 0.04 < sizes["rest"] + sizes["low speed"] < 0.25


def test_a_pulse_is_an_interval_although_no_variable_explains_it(motion):
    pulse = ((motion["t"] > 5.0) & (motion["t"] < 5.2)).astype(float)
    found = _atlas(motion, pulse)
    (interval,) = found.intervals
    assert interval.span == pytest.approx((5.0, 5.2), abs=0.1)
    assert interval.times > 20
    assert found.closed < 0.1
    assert found.floor_rms == pytest.approx(NOISE, rel=0.15)
    assert "holds" in found.words()


def test_a_tone_lies_in_its_band(motion):
    found = _atlas(motion, np.sin(2 * np.pi * 25.0 * motion["t"]))
    assert max(found.bands, key=lambda b: b.energy).span == (20.0, 35.0)


def test_a_slow_force_on_the_load_bends_the_coupling(motion):
    clean = MADE_FROM["q"](motion)
    bend = 1e-7 * np.random.default_rng(1).standard_normal(len(clean))
    assert _atlas(motion, clean).side is None
    assert _atlas(motion, clean, load=bend).side == "motor"
    assert _atlas(motion, clean, load=bend - 1e-6 * clean / np.std(clean)).side == "load"
    assert _atlas(motion, None, load=bend).side is None


def test_the_same_again_and_as_plain_json(motion):
    documents = [_atlas(motion, MADE_FROM["v_even"](motion)).as_json() for _ in range(2)]
    assert documents[0] == documents[1]
    assert json.loads(json.dumps(documents[0], allow_nan=False)) == documents[0]


def test_odd_records_are_taken_as_they_are(motion):
    n = len(motion["t"])
    assert atlas(residual=np.zeros(n), **motion).closed == 0
    still = motion | {name: np.zeros(n) for name in ("q", "v", "a", "reference")}
    assert atlas(residual=np.random.default_rng(0).standard_normal(n), **still).closed < 0.02
    short = motion | {k: x[:60] for k, x in motion.items() if isinstance(x, np.ndarray)}
    assert np.isfinite(atlas(residual=np.ones(60), **short).floor_rms)
    with pytest.raises(ValueError, match="finite"):
        atlas(residual=np.full(n, np.nan), **motion)


@pytest.mark.parametrize("pair", [False, True])
def test_the_picture_is_drawn(motion, pair):
    before = _atlas(motion, MADE_FROM["direction_q"](motion))
    image = png(atlas_figure(before, _atlas(motion, None) if pair else None))
    assert io.BytesIO(image).read(8) == b"\x89PNG\r\n\x1a\n"
