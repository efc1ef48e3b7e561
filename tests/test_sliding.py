"""Coulomb friction solved with the step: it holds at rest, lets go above its force, and has an exact derivative."""

import dataclasses
import functools

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from didim_jax.chain import Chain, State
from didim_jax.control import Drive, SampledPD
from didim_jax.effects import Bench
from didim_jax.effects.catalogue import CATALOGUE
from didim_jax.effects.friction import AbstractGripEffect
from didim_jax.params import names, pack, parameters, unpack
from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.simulate import Excitation, SampledLoop, Start, simulate
from didim_jax.sliding import Sliding, rubbed
from didim_jax.solver import Unrolled

DT, N = 1e-3, 600
KP, KV, GAIN, LIMIT = 160.18, 243.45, 35.15, 10.0
SHARP = 1e-6  # m/s
BENCH = Bench(lead=0.0025, limit=LIMIT, gain=GAIN, dt=DT, q_low=0.08, q_high=0.13, duration=DT * N)


def rigid(v_eps, viscous=200.0, offset=3.0):
    return RigidDrive(107.0, CoulombViscous(viscous, 20.0, v_eps), offset)


def flexible(v_eps, offset=3.0):
    return FlexibleDrive(
        68.0, CoulombViscous(104.0, 10.0, v_eps), 38.0, CoulombViscous(96.5, 9.5, v_eps), 8.8e5, offset
    )


each_plant = pytest.mark.parametrize("plant", [rigid, flexible], ids=["rigid", "flexible"])


def around(plant, effects=(), *, controlled=True, substeps=4, solver=None):
    kp, kv = (KP, KV) if controlled else (0.0, 0.0)
    chain = Chain(Drive(GAIN, LIMIT), plant, effects)
    return SampledLoop(SampledPD(kp, kv), chain, substeps, Sliding() if solver is None else solver)


def moves():
    """There, a dwell of 0.18 s, and part of the way back."""
    t = DT * np.arange(N)
    there, back = (np.sin(0.5 * np.pi * np.clip((t - t0) / T, 0, 1)) ** 2 for t0, T in ((0.02, 0.2), (0.4, 0.15)))
    return 0.1 + 0.02 * there - 0.01 * back


DWELL = slice(300, 400)


def run(loop, start=None):
    excitation = Excitation(jnp.asarray(DT), jnp.asarray(moves()), jnp.zeros(N))
    out = simulate(loop, excitation, loop.start(excitation.qg[0], 0.0, DT) if start is None else start)
    assert bool(out.ok)
    return out


@functools.cache
def pushed_loop(viscous):
    return around(rigid(SHARP, viscous, 0.0), controlled=False)


def pushed(force, *, viscous=0.0, v=0.0):
    """1 s of a mass of 107 kg with 20 N of Coulomb friction under a constant force (N)."""
    loop = pushed_loop(viscous)
    excitation = Excitation(jnp.asarray(DT), jnp.zeros(1001), jnp.full(1001, force / GAIN))
    return simulate(loop, excitation, loop.start(0.0, v, DT))


# -- the speed that friction leaves ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("k", "bound"), [(0.0, 0.0), (0.1, 1e-3), (1.0, 0.01), (10.0, 0.25), (100.0, 1.0), (1000.0, 1.2)]
)
def test_the_speed_left_is_that_of_the_implicit_equation(k, bound):
    """w + k tanh(w) = v in units of v_eps: exact far from rest, close to it at rest, and within `bound` between."""
    v_eps = 2e-5
    pulled = np.concatenate([np.geomspace(1e-4, 1e5, 150), (1 + k) * np.linspace(0.5, 3.0, 100)])
    exact = np.array([brentq(lambda w, v=v: w + k * np.tanh(w) - v, 0.0, v, xtol=1e-16) for v in pulled])
    for sign in (1.0, -1.0):
        left = sign * np.asarray(rubbed(sign * v_eps * pulled, jnp.asarray(k * v_eps), v_eps)) / v_eps
        error = np.abs(left - exact)
        assert error.max() <= bound + 1e-14 * pulled.max()
        assert np.all(error[exact > 20] <= 1e-14 * pulled[exact > 20])
        assert np.all(error[exact < 0.1] <= 2e-7 * exact[exact < 0.1])
    assert np.any(exact > 20) and np.any(exact < 0.1)


@pytest.mark.parametrize("k", [0.0, 0.3, 10.0, 1000.0])
def test_the_speed_left_is_continuous_and_grows_with_what_comes_in(k):
    """Of what is added to v no more comes out than went in, and no less than a stuck side gives way."""
    v = np.linspace(-4, 4, 200_001) * (1 + k)
    slope = np.diff(np.asarray(rubbed(v, jnp.asarray(k), 1.0))) / np.diff(v)
    assert slope.min() >= (1 - 1e-6) / (1 + k)
    assert slope.max() <= 1 + 1e-6
    assert float(rubbed(jnp.asarray(0.0), jnp.asarray(k), 1.0)) == 0.0


# -- at rest and away from it ------------------------------------------------------------------------------------


@pytest.mark.parametrize("force", [15.0, -15.0, 5.0, 0.0])
def test_below_coulomb_friction_a_mass_stays(force):
    """75 % of the friction, for a second: it creeps below v_eps, a micrometre a second."""
    out = pushed(force)
    assert np.abs(out.motor.v).max() < SHARP
    assert np.abs(out.motor.q).max() < SHARP * 1.0
    np.testing.assert_allclose(np.asarray(out.motor.v)[10:], SHARP * np.arctanh(force / 20), rtol=0, atol=0.05 * SHARP)
    if force == 0:
        assert not np.any(out.motor.q)


@pytest.mark.parametrize("force", [19.9, -19.9])
def test_up_to_its_very_force_friction_holds(force):
    """It creeps by the smooth sign that carries the force, no faster: 3 v_eps at 99.5 % of the friction."""
    assert np.abs(pushed(force).motor.v).max() < SHARP * np.arctanh(abs(force) / 20)


@pytest.mark.parametrize("force", [20.5, 30.0, -30.0, 200.0])
def test_above_coulomb_friction_a_mass_slides_by_its_closed_form(force):
    out = pushed(force)
    t, a = np.asarray(out.t), np.sign(force) * (abs(force) - 20) / 107
    np.testing.assert_allclose(out.motor.v, a * t, rtol=0, atol=SHARP)  # of the way out of the smooth sign
    np.testing.assert_allclose(out.motor.q, 0.5 * a * t**2, rtol=0, atol=SHARP)
    v = 107 * a / 200 * -np.expm1(-200 * t / 107)
    # the midpoint rule: (200 / 107 h)^2 / 6 = 4e-8 of the speed, and the way out again
    np.testing.assert_allclose(pushed(force, viscous=200.0).motor.v, v, rtol=5e-8, atol=SHARP)


def test_a_mass_comes_to_rest_in_its_time_and_stays_there():
    """v0 = 50 mm/s against 20 N: M v0 / Fc, along M v0^2 / (2 Fc)."""
    out = pushed(0.0, v=0.05)
    v, q = np.asarray(out.motor.v), np.asarray(out.motor.q)
    stop = int(np.argmax(np.abs(v) < SHARP))
    assert stop * DT == pytest.approx(107 * 0.05 / 20, abs=DT)
    assert q[-1] == pytest.approx(0.5 * 107 * 0.05**2 / 20, abs=0.25 * DT * SHARP + 1e-8)
    assert np.all(np.diff(v) <= 0) and v.min() >= 0.0
    assert np.abs(q[stop:] - q[stop]).max() < DT * SHARP


@pytest.mark.parametrize("y", [(0.0, 0.0, 3e-4, 0.0), (0.0, 0.05, 0.0, 0.0), (0.0, 0.01, 1e-4, -0.02)])
def test_energy_never_grows_without_a_force_of_the_motor(y):
    """Two masses and their spring ring down, sample by sample, and stand with the spring still bent."""
    loop = around(flexible(SHARP, 0.0), controlled=False)
    out = run(loop, Start(jnp.asarray(y), jnp.zeros(2)))
    v1, v2, delta = (np.asarray(x) for x in (out.motor.v, out.load.v, out.load.q - out.motor.q))
    energy = 0.5 * (68 * v1**2 + 38 * v2**2 + 8.8e5 * delta**2)
    assert np.all(np.diff(energy) < 0)
    assert energy[-1] < 0.01 * energy[0]
    assert max(np.abs(v1[-100:]).max(), np.abs(v2[-100:]).max()) < 2 * SHARP
    assert 1.0 < abs(8.8e5 * delta[-1]) < 9.5  # N: less than either side holds


def test_energy_never_grows_in_a_rigid_drive_either():
    v = np.asarray(pushed(0.0, viscous=200.0, v=0.05).motor.v)
    assert np.all(np.diff(v**2) <= 0) and abs(v[-1]) < 1e-3 * SHARP


@each_plant
def test_in_closed_loop_the_drive_stands_in_a_dwell(plant):
    out = run(around(plant(SHARP)))
    assert max(np.abs(side.v[DWELL]).max() for side in (out.motor, out.load)) < 2 * SHARP
    assert np.ptp(out.motor.q[DWELL]) < 2 * SHARP * DT * 100
    assert np.abs(out.motor.v).max() > 0.1


# -- against the smooth path -------------------------------------------------------------------------------------


@each_plant
def test_it_converges_to_the_smooth_path(plant):
    """Where a sign is soft enough for an explicit method: 0.1 % of the force (rms) at 4 steps, half at 8."""
    exact = run(around(plant(1e-3), solver=Unrolled(dfx.Tsit5())))
    errors = []
    for substeps in (1, 2, 4, 8):
        out = run(around(plant(1e-3), substeps=substeps))
        errors.append(np.sqrt(np.mean((out.tau - exact.tau) ** 2) / np.mean(exact.tau**2)))
        assert np.abs(out.motor.q - exact.motor.q).max() < 1.2e-6 / substeps
    assert errors[2] < 1e-3
    np.testing.assert_allclose(np.array(errors[1:]) / errors[:-1], 0.5, atol=0.05)


def test_in_sliding_it_is_of_second_order():
    """Far from rest nothing tells the two paths apart but h^2."""
    rubs = CoulombViscous(104.0, 10.0, 1e-4), CoulombViscous(96.5, 9.5, 1e-4)
    plant = FlexibleDrive(68.0, rubs[0], 38.0, rubs[1], 8.8e5)
    start = Start(jnp.asarray([0.0, 0.5, 1e-4, 0.0]), jnp.zeros(2))

    def end(substeps, solver=None):
        out = run(around(plant, controlled=False, substeps=substeps, solver=solver), start)
        assert min(np.abs(out.motor.v[:50]).min(), np.abs(out.load.v[:50]).min()) > 0.3
        return np.asarray(out.load.q[50])

    exact = end(4, Unrolled(dfx.Tsit5()))
    coarse, fine = (abs(end(substeps) - exact) for substeps in (2, 4))
    assert fine == pytest.approx(0.25 * coarse, rel=0.05)
    assert fine > 1e-10  # m: it is the step that is seen


# -- its derivative ----------------------------------------------------------------------------------------------


@each_plant
def test_the_derivative_is_that_of_central_differences_through_rest(plant):
    """Of force and position, by every parameter of the drive and by v_eps, each by its own size."""
    base = around(plant(1e-5))
    sizes = pack(base.chain.plant)
    where = parameters(base.chain.plant)
    excitation = Excitation(jnp.asarray(DT), jnp.asarray(moves()), jnp.zeros(N))
    start = base.start(excitation.qg[0], 0.0, DT)

    def frictions(p):
        return [friction.v_eps for friction in p.frictions() if friction is not None]

    @jax.jit
    def motion(x):
        one = unpack(base.chain.plant, sizes * (1 + x[:-1]), where)
        one = eqx.tree_at(frictions, one, [1e-5 * jnp.exp(x[-1])] * len(frictions(one)))
        loop = eqx.tree_at(lambda a: a.chain.plant, base, one)
        out = simulate(loop, excitation, start)
        return jnp.stack([out.tau, out.load.q, out.motor.v])

    null = jnp.zeros(len(sizes) + 1)
    rest = np.abs(np.asarray(motion(null))[2]) < 2e-5
    assert 60 < rest.sum() < 300  # it moves, stands for some hundred samples, and moves
    columns = np.asarray(jax.jit(jax.vmap(lambda b: jax.jvp(motion, (null,), (b,))[1]))(jnp.eye(len(null))))
    h = 1e-5
    for name, row, column in zip([*names(base.chain.plant), "v_eps"], np.eye(len(null)), columns, strict=True):
        difference = np.asarray(motion(h * row) - motion(-h * row)) / (2 * h)
        for told, exact, rounding in zip(column[:2], difference[:2], (1e-4, 1e-11), strict=True):
            largest = np.abs(exact).max()
            np.testing.assert_allclose(told, exact, rtol=0, atol=1e-5 * largest + rounding, err_msg=name)
        assert np.abs(column[0]).max() > 1e-3, name  # N


# -- effects -----------------------------------------------------------------------------------------------------

EFFECTS = [effect.at(BENCH) for effect in CATALOGUE]
each_effect = pytest.mark.parametrize("effect", EFFECTS, ids=[effect.label() for effect in CATALOGUE])
GRIPS = {
    "stribeck": {"dFs": 4.0, "vs": 0.04},
    "quadratic_viscous": {"c": 400.0, "p": 1.7},
    "position_friction": {"c1": 2.0, "c2": -1.0, "c3": 0.5, "c4": 1.5},
    "local_friction": {"A": 4.0, "q0": 0.105},
    "lead_friction": {"a": 2.0, "b": 1.0},
    "load_dependent_friction": {"mu": 0.05},
    "friction_drift": {"d_coulomb": 0.3, "d_viscous": 0.2},
    "presliding": {"share": 0.7, "T": 2e-3},
    "base_flexibility": {"mu": 2e-3},
}


def states(plant, effects, *, at_speed=False):
    """Chain, state and held command where it rests, creeps and moves; or only where it moves."""
    chain = Chain(Drive(GAIN, LIMIT), plant, tuple(effects))
    for v1, v2 in [(0.03, 0.028), (-0.05, -0.051)] if at_speed else [(0.0, 0.0), (1e-7, -2e-7), (-0.05, -0.051)]:
        y = jnp.asarray([0.104, v1, 2e-5, v2 - v1])[: len(plant.state_names)]
        state = chain.init(y, 0.8)
        held, _ = chain.hold(jnp.asarray(0.1), state, jnp.asarray(0.8), DT)
        yield chain, state, held


def test_every_effect_that_grips_is_compared_here():
    grips = {effect.label() for effect in CATALOGUE if issubclass(effect, AbstractGripEffect)}
    assert grips | {"friction_drift", "presliding", "base_flexibility"} == set(GRIPS)


@each_effect
@each_plant
def test_at_its_null_an_effect_adds_nothing_on_the_sticking_path(plant, effect):
    """Nor does it change a bit of what friction can hold."""
    t = jnp.asarray(0.1005)
    for (bare, one, held), (full, two, held_too) in zip(
        states(plant(SHARP), ()), states(plant(SHARP), (effect,)), strict=True
    ):
        np.testing.assert_array_equal(held_too.force, held.force)
        (rates, grip), (with_it, gripped) = bare.free(t, one, held), full.free(t, two, held_too)
        np.testing.assert_array_equal(with_it.plant, rates.plant)
        for a, b in zip(jax.tree.leaves(grip), jax.tree.leaves(gripped), strict=True):
            np.testing.assert_array_equal(a, b)
        h = DT / 4
        np.testing.assert_array_equal(
            Sliding().step(full, t, h, two, held_too).plant, Sliding().step(bare, t, h, one, held).plant
        )


@pytest.mark.parametrize("name", GRIPS)
@each_plant
def test_at_speed_both_paths_are_one(plant, name):
    """What grips pulls by its sign: the accelerations without it, less that, are those of the smooth path."""
    (effect,) = (effect for effect in EFFECTS if effect.label() == name)
    effect = dataclasses.replace(effect, **GRIPS[name])
    t = jnp.asarray(0.1005)
    for chain, state, held in states(plant(SHARP), (effect,), at_speed=True):
        if name == "presliding":
            state = State(state.plant, (jnp.asarray([8.0, 4.0]),))
        if name == "base_flexibility":
            state = State(state.plant, (jnp.asarray([1e-5, 4e-3]),))
        rates, grip = chain.free(t, state, held)
        smooth = chain.derivative(t, state, held)
        _, v1, _, v2 = chain.plant.sides(state.plant)
        free = chain.plant.accelerations(state.plant, rates.plant)
        rubbing = [
            a - force * np.sign(v + grip.slide) / mass
            for a, force, mass, v in zip(free, grip.force, grip.mass, (v1, v2), strict=True)
        ]
        expected = chain.plant.accelerations(state.plant, smooth.plant)
        sides = 2 if chain.plant.frictions()[1] is not None else 1
        np.testing.assert_allclose(rubbing[:sides], expected[:sides], rtol=1e-12, atol=1e-13)
        for a, b in zip(jax.tree.leaves(rates.effects), jax.tree.leaves(smooth.effects), strict=True):
            np.testing.assert_array_equal(a, b)
        plain = Chain(chain.drive, chain.plant)
        without = plain.derivative(t, State(state.plant, ()), held).plant
        assert np.abs(np.asarray(smooth.plant) - np.asarray(without)).max() > 1e-3  # m/s2: it acts


@pytest.mark.parametrize(("force", "holds"), [(25.0, True), (-25.0, True), (31.0, False)])
def test_what_grips_holds_at_rest_too(force, holds):
    """20 N of Coulomb friction and 10 N more near rest."""
    (stribeck,) = (effect for effect in EFFECTS if effect.label() == "stribeck")
    loop = around(rigid(SHARP, offset=0.0), (dataclasses.replace(stribeck, dFs=10.0),), controlled=False)
    excitation = Excitation(jnp.asarray(DT), jnp.zeros(N), jnp.full(N, force / GAIN))
    out = simulate(loop, excitation, loop.start(0.0, 0.0, DT))
    if holds:
        assert np.abs(out.motor.v).max() < 2 * SHARP
    else:
        assert out.motor.v[-1] > 5e-3  # m/s


def test_friction_never_drives():
    """Where an effect takes away more than there is, nothing is left: no force along the motion."""
    (stribeck,) = (effect for effect in EFFECTS if effect.label() == "stribeck")
    loop = around(rigid(SHARP, 0.0, 0.0), (dataclasses.replace(stribeck, dFs=-30.0),), controlled=False)
    excitation = Excitation(jnp.asarray(DT), jnp.zeros(N), jnp.zeros(N))
    v = np.asarray(simulate(loop, excitation, loop.start(0.0, 2e-3, DT)).motor.v)
    np.testing.assert_allclose(v, 2e-3, rtol=1e-12)
