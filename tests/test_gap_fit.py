"""A fit finds the parameters that made a force, from a displaced start; it never ends in a simulation that diverged.

The weights of its residuals make white noise and slow drift white, and leave a moment where it was.
"""

import dataclasses

import numpy as np
import pytest
from gap_machine import path, record

from didim_jax.effects.actuator import AmplifierLag
from didim_jax.effects.coupling import CouplingDamping
from didim_jax.effects.friction import Stribeck
from didim_jax.gap.fit import Problem
from didim_jax.gap.noise import CORRELATION_TIME, Whitening
from didim_jax.gap.prepared import Prepared, prepare
from didim_jax.gap.search import Searcher
from didim_jax.gap.spread import standard_deviations

TRUTH = {
    "M": 97.0,
    "Fv": 180.0,
    "Fc": 22.0,
    "v_eps": 1.5e-3,
    "stribeck.dFs": 7.0,
    "stribeck.vs": 0.011,
    "stribeck.a": 1.4,
}
DISPLACED = {
    "M": 80.0,
    "Fv": 250.0,
    "Fc": 15.0,
    "v_eps": 1e-3,
    "stribeck.dFs": 3.0,
    "stribeck.vs": 0.02,
    "stribeck.a": 1.0,
}


def simulated(p: Prepared, values: dict[str, float]) -> Prepared:
    """The record with the force that its own model gives at these values."""
    out = p.model.run(p.model.encode(np.zeros(len(p.model.entries)), values))
    assert np.isfinite(out).all()
    return dataclasses.replace(
        p, channels=tuple(dataclasses.replace(c, observed=p.filtered(out, c)) for c in p.channels)
    )


@pytest.fixture(scope="module")
def other(emps_like) -> Prepared:
    """Another motion of the same machine."""
    return prepare(record(emps_like, path(1)[:1600]), emps_like, (AmplifierLag, Stribeck, CouplingDamping))


@pytest.fixture
def made(emps_like) -> Prepared:
    """1.2 s with the force of TRUTH, started 10 um and 2 mm/s off."""
    p = prepare(record(emps_like, path()[:1600]), emps_like, (AmplifierLag, Stribeck, CouplingDamping))
    return simulated(p, TRUTH | {"start.q1": 1e-5, "start.v1": 2e-3})


def problem(*records: Prepared) -> Problem:
    return Problem(records, [[Whitening.flat(len(c.observed), 0.02 * c.rms) for c in p.channels] for p in records])


def start_of(p: Prepared, **more: float) -> np.ndarray:
    return p.model.encode(np.zeros(len(p.model.entries)), DISPLACED | more)


def moved(p: Prepared) -> list[int]:
    """Drive without an offset, Stribeck, start."""
    return [i for i in [*p.model.of(""), *p.model.of("stribeck"), *p.model.of("start")] if p.model.names[i] != "offset"]


def test_machine_effect_and_start_come_back_from_a_displaced_start(made):
    fit = problem(made).solve(start_of(made), moved(made), frozenset({"stribeck"}), evaluations=30)
    values = made.model.decode(fit.xs[0])
    # the weak prior on the start (ten typical sizes) holds it back, by a few percent of its shift, and little follows
    assert {name: values[name] for name in TRUTH} == pytest.approx(TRUTH, rel=1e-3)
    assert values["start.q1"] == pytest.approx(1e-5, rel=0.1)
    assert fit.ok and fit.cost < 0.05
    untouched = set(range(len(fit.xs[0]))) - set(moved(made))
    assert all(fit.xs[0][i] == start_of(made)[i] for i in untouched)


def test_records_share_the_machine_and_each_has_its_own_start(made, other):
    second = simulated(other, TRUTH | {"start.q1": -2e-5, "start.v1": 0.0})
    both = problem(made, second)
    fit = both.solve([start_of(made), start_of(second)], moved(made), frozenset({"stribeck"}), evaluations=30)
    one, two = (made.model.decode(x) for x in fit.xs)
    assert {name: one[name] for name in TRUTH} == pytest.approx(TRUTH, rel=1e-3)
    assert {name: two[name] for name in TRUTH} == {name: one[name] for name in TRUTH}
    assert (one["start.q1"], two["start.q1"]) == pytest.approx((1e-5, -2e-5), rel=0.1)


def test_what_is_masked_takes_no_part(made):
    """A force that is wrong for half of the record and masked there does no harm."""
    force = made.channels[0]
    wrong = np.arange(len(force.observed)) > len(force.observed) / 2
    spoilt = dataclasses.replace(
        made, channels=(dataclasses.replace(force, observed=force.observed + 50.0 * wrong), *made.channels[1:])
    )
    whitening = [[Whitening.flat(len(c.observed), 0.02 * force.rms) for c in made.channels]]
    chosen = [i for i in moved(made) if i not in made.model.of("stribeck")]
    start = start_of(made, **{name: TRUTH[name] for name in TRUTH if name.startswith("stribeck")})
    fit = Problem([spoilt], whitening, mask=[~wrong]).solve(start, chosen, evaluations=30)
    assert made.model.decode(fit.xs[0])["M"] == pytest.approx(TRUTH["M"], rel=1e-3)
    assert Problem([spoilt], whitening).solve(start, chosen, evaluations=30).cost > 100 * fit.cost


def test_a_step_that_diverges_is_rejected(made, monkeypatch):
    """Beyond a mass just above the truth the simulation gives no numbers: the fit ends on the near side, improved."""
    model, run, tried = made.model, made.model.run, []
    edge = model.encode(np.zeros(len(model.entries)), {"M": 99.0})[model.index["M"]]

    def torn(x: np.ndarray) -> np.ndarray:
        tried.append(x[model.index["M"]])
        return run(x) if x[model.index["M"]] < edge else np.full((2, model.n), np.nan)

    monkeypatch.setattr(model, "run", torn)
    start = start_of(made, M=55.0)  # from here the first step goes too far
    fit = problem(made).solve(start, moved(made), frozenset({"stribeck"}), evaluations=40)
    assert max(tried) > edge
    assert fit.ok and np.isfinite(fit.cost)
    assert model.decode(fit.xs[0])["M"] == pytest.approx(TRUTH["M"], rel=1e-3)


def test_a_fit_that_begins_where_nothing_can_be_simulated_says_so(made, monkeypatch):
    monkeypatch.setattr(made.model, "run", lambda x: np.full((2, made.model.n), np.nan))
    monkeypatch.setattr(made.model, "columns", lambda x, c: (None, np.full((len(c), 2, made.model.n), np.nan)))
    fit = problem(made).solve(start_of(made), moved(made), evaluations=5)
    assert not fit.ok and fit.cost > 1e12


def test_a_parameter_that_changes_nothing_stays_and_is_not_called_certain(made):
    """A rigid drive has no coupling to damp."""
    model = made.model
    place = model.index["coupling_damping.C"]
    start = start_of(made, **{"coupling_damping.C": 150.0})
    fit = problem(made).solve(start, [*moved(made), place], frozenset({"stribeck", "coupling_damping"}), evaluations=30)
    assert model.decode(fit.xs[0])["coupling_damping.C"] == pytest.approx(150.0, rel=1e-3)
    assert model.decode(fit.xs[0])["M"] == pytest.approx(TRUTH["M"], rel=1e-3)
    std = standard_deviations(Searcher([made]), fit)
    assert not std.get(place, np.inf) < 1e3
    assert 0 < std[model.index["M"]] < 1


def test_a_fit_keeps_within_bounds(made):
    fit = problem(simulated(made, TRUTH | {"stribeck.vs": 0.06})).solve(
        start_of(made), moved(made), frozenset({"stribeck"}), evaluations=30
    )
    place = made.model.index["stribeck.vs"]
    assert made.model.decode(fit.xs[0])["stribeck.vs"] == pytest.approx(0.04, rel=1e-2)
    assert made.model.decode(fit.xs[0])["stribeck.vs"] <= 0.04
    assert made.model.bound(fit.xs[0], place) == "most"
    std = standard_deviations(Searcher([made]), fit)
    # m/s, were all else known; it cannot vary, and no other pays for it
    column = fit.jacobian[:, moved(made).index(place)]
    assert std[place] == pytest.approx(made.model.entries[place].scale / np.linalg.norm(column), rel=1e-6)
    assert 0 < std[made.model.index["M"]] < 1


# -- noise -------------------------------------------------------------------------------------------------------

DT = 5e-3


def drifting(rms: float, n: int, draw: np.random.Generator) -> np.ndarray:
    """An Ornstein-Uhlenbeck process, sampled exactly."""
    keep = np.exp(-DT / CORRELATION_TIME)
    x = np.empty(n)
    x[0] = draw.normal(0, rms)
    kicks = draw.normal(0, rms * np.sqrt(1 - keep**2), n)
    for k in range(1, n):
        x[k] = keep * x[k - 1] + kicks[k]
    return x


@pytest.mark.parametrize(("white", "slow"), [(1.0, 0.0), (1.0, 1.0), (0.3, 3.0)])
def test_white_noise_and_slow_drift_become_white_of_unit_variance(white, slow):
    n, runs, draw = 3000, 40, np.random.default_rng(5)
    r = np.array([white * draw.normal(size=n) + drifting(slow, n, draw) for _ in range(runs)])
    e = Whitening.of(n, DT, white, slow)(r)
    # 120,000 samples: 0.4 % of the variance, and as much of the correlation; the model of the drift is that of a
    # process without beginning and end
    assert np.mean(e**2) == pytest.approx(1.0, abs=0.03)
    for lag in (1, 2, 5, 20, 100):
        assert abs(np.mean(e[:, lag:] * e[:, :-lag])) < 0.03
    lowest = np.mean(e, axis=1) * np.sqrt(n)  # the mean of a record, which a drift moves most
    assert np.mean(lowest**2) < 3


def test_flat_weights_divide_by_the_rms():
    r = np.random.default_rng(0).normal(size=(2, 500))
    np.testing.assert_allclose(Whitening.flat(500, 0.3)(r), r / 0.3, rtol=1e-9, atol=1e-12)


def test_a_moment_stays_where_it_was():
    """An impulse keeps most of its height, and what it loses falls off within the drift's own corner."""
    n, at = 3000, 1100
    impulse = np.zeros(n)
    impulse[at] = 1.0
    e = Whitening.of(n, DT, 1.0, 1.0)(impulse)
    assert int(np.argmax(np.abs(e))) == at and e[at] > 0.9
    away = np.abs(np.arange(n) - at) > 0.5 / DT
    assert np.sum(e[away] ** 2) < 1e-3 * np.sum(e**2)
    np.testing.assert_allclose(e[at + 1 : at + 200], e[at - 1 : at - 200 : -1], rtol=0, atol=1e-6)
