"""The loop is the documented one: its law at every sample, its motion that of an independent SciPy simulation.

The reference here shares nothing with the package: NumPy's numbers, equations 2-5 written out again, and
scipy.integrate.solve_ivp at tolerances near rounding.
"""

from typing import ClassVar

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from didim_jax.chain import Chain
from didim_jax.control import ContinuousPD, Drive, SampledPD
from didim_jax.effects import AbstractEffect, Block
from didim_jax.params import names, pack, unpack, values
from didim_jax.plant import AbstractFriction, AsymmetricCoulombViscous, CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.rig import continuous_loop, sampled_loop
from didim_jax.simulate import ContinuousLoop, Excitation, SampledLoop, Start, simulate

DT = 1e-3
KP, KV, GAIN = 160.18, 243.45, 35.15
N = 300  # samples wherever any length will do: one compilation serves many tests
V_EPS = 5e-3  # m/s; slow enough for a few steps per sample to resolve a reversal to many digits


def rigid(v_eps=V_EPS, **changes):
    p = {"M": 107.0, "Fv": 200.0, "Fc": 20.0, "offset": -3.0} | changes
    return RigidDrive(p["M"], CoulombViscous(p["Fv"], p["Fc"], v_eps), p["offset"])


def flexible(v_eps=V_EPS, **changes):
    p = {"M1": 68.0, "Fv1": 104.0, "Fc1": 10.0, "M2": 38.0, "Fv2": 96.5, "Fc2": 9.5, "K12": 8.8e5, "offset": -3.0}
    p |= changes
    motor, load = CoulombViscous(p["Fv1"], p["Fc1"], v_eps), CoulombViscous(p["Fv2"], p["Fc2"], v_eps)
    return FlexibleDrive(p["M1"], motor, p["M2"], load, p["K12"], p["offset"])


PLANTS = {"rigid": rigid, "flexible": flexible}
each_plant = pytest.mark.parametrize("make", PLANTS.values(), ids=PLANTS.keys())
each_loop = pytest.mark.parametrize("sampled", [True, False], ids=["sampled", "continuous"])


def around(plant, *, sampled=True, substeps=1, limit=np.inf, kp=KP, kv=KV, effects=()):
    """The loop around a plant with the bench's gains."""
    chain = Chain(Drive(GAIN, limit), plant, tuple(effects))
    if sampled:
        return SampledLoop(controller=SampledPD(kp, kv), chain=chain, substeps=substeps)
    return ContinuousLoop(controller=ContinuousPD(kp, kv), chain=chain, substeps=substeps)


def drive(n, dt=DT):
    """Reference with reversals, and small known volts on top."""
    t = dt * np.arange(n)
    qg = 0.1 + 0.01 * np.sin(2 * np.pi * 1.5 * t) ** 2 + 4e-5 * np.sin(2 * np.pi * 12 * t) ** 2
    volts = 0.5 * np.sin(2 * np.pi * 31 * t)
    return Excitation(jnp.asarray(dt), jnp.asarray(qg), jnp.asarray(volts))


def run(loop, excitation, *, v=0.0):
    out = simulate(loop, excitation, loop.start(excitation.qg[0], v, excitation.dt))
    assert bool(out.ok)
    return out


def law(qm, qg, memory, dt=DT):
    """vir[k] = kv (kp (qg[k] - qm[k]) - (qm[k] - qm[k-2]) / (2 dt)), V; memory = qm[-1], qm[-2]."""
    past = np.concatenate([[memory[1], memory[0]], qm])
    return KV * (KP * (qg - qm) - (qm - past[:-2]) / (2 * dt))


# Rounding of positions of 0.1 m, times kv / (2 dt) = 1.2e5 V/m: 2e-12 V, and a few more such roundings.
LAW = {"rtol": 0, "atol": 1e-11}


# -- the sampled law ---------------------------------------------------------------------------------------------


@each_plant
def test_the_command_is_the_documented_law_at_every_sample(make):
    excitation = drive(N)
    loop = around(make())
    start = eqx.tree_at(lambda s: s.memory, loop.start(0.1, 0.02, DT), jnp.asarray([0.09997, 0.09995]))
    out = simulate(loop, excitation, start)
    qm, qg = np.asarray(out.qm), np.asarray(excitation.qg)
    expected = law(qm, qg, [0.09997, 0.09995]) + np.asarray(excitation.injected)
    np.testing.assert_allclose(out.vir, expected, **LAW)
    np.testing.assert_array_equal(out.qm, out.motor.q)  # no effect in the sensor
    np.testing.assert_array_equal(out.tau, GAIN * np.asarray(out.vir))


def test_the_memory_decides_the_first_two_commands_and_no_others():
    """dq[0] looks back to qm[-2], dq[1] to qm[-1]: moving one moves one command by kv / (2 dt) per metre."""
    excitation = drive(N)
    loop = around(rigid())
    base = loop.start(0.1, 0.0, DT)
    step = 1e-6

    def vir(shift):
        start = eqx.tree_at(lambda s: s.memory, base, base.memory + jnp.asarray(shift))
        return np.asarray(simulate(loop, excitation, start).vir)

    np.testing.assert_allclose((vir([0.0, step]) - vir([0.0, 0.0]))[0], KV * step / (2 * DT), rtol=1e-9)
    later = vir([step, 0.0]) - vir([0.0, 0.0])
    assert later[0] == 0.0
    np.testing.assert_allclose(later[1], KV * step / (2 * DT), rtol=1e-9)
    assert np.all(np.abs(later[2:]) < 0.2 * later[1])  # only through the motion it caused


def test_a_start_in_motion_remembers_where_it_came_from():
    start = around(flexible()).start(0.1, 0.05, DT)
    np.testing.assert_allclose(start.memory, [0.1 - 0.05 * DT, 0.1 - 2 * 0.05 * DT], rtol=1e-15)
    np.testing.assert_array_equal(start.plant, [0.1, 0.05, 0.0, 0.0])


@each_loop
def test_the_clip_acts_on_the_force_and_not_on_the_command(sampled):
    plant, excitation = rigid(), drive(N)
    out = run(around(plant, sampled=sampled, limit=5.0), excitation)
    vir, force = np.asarray(out.vir), np.asarray(out.force)
    beyond = np.abs(vir) > 5.0
    assert 10 < beyond.sum() < N - 10
    np.testing.assert_array_equal(force, GAIN * np.clip(vir, -5.0, 5.0))
    np.testing.assert_array_equal(out.tau, GAIN * vir)
    felt = 107.0 * out.motor.a + plant.friction(out.motor.v) - 3.0
    np.testing.assert_allclose(felt, force, rtol=0, atol=1e-12 * GAIN * 5.0)
    if sampled:
        expected = law(np.asarray(out.qm), np.asarray(excitation.qg), [0.1, 0.1]) + np.asarray(excitation.injected)
        np.testing.assert_allclose(vir, expected, **LAW)


# -- an independent simulation -----------------------------------------------------------------------------------


def rates(p, y, tau):
    """Equations 5 and 9 on plain numbers by name, state (q1, v1) or (q1, v1, q2, v2); friction smoothed as stated."""
    if "M" in p:
        _, v = y
        return [v, (tau - p["Fv"] * v - p["Fc"] * np.tanh(v / V_EPS) - p["offset"]) / p["M"]]
    q1, v1, q2, v2 = y
    spring = p["K12"] * (q2 - q1)
    a1 = (tau - p["Fv1"] * v1 - p["Fc1"] * np.tanh(v1 / V_EPS) - p["offset"] + spring) / p["M1"]
    a2 = (-p["Fv2"] * v2 - p["Fc2"] * np.tanh(v2 / V_EPS) - spring) / p["M2"]
    return [v1, a1, v2, a2]


def solved(field, t_span, y):
    out = solve_ivp(field, t_span, y, method="DOP853", rtol=1e-13, atol=1e-16)
    assert out.success
    return out.y[:, -1]


def reference_sampled(plant, excitation, y, memory, limit):
    """Law, hold and motion, sample after sample."""
    p, qg, injected = values(plant), np.asarray(excitation.qg), np.asarray(excitation.injected)
    before, before_that = memory
    states, commands = [], []
    for k in range(len(qg)):
        vir = KV * (KP * (qg[k] - y[0]) - (y[0] - before_that) / (2 * DT)) + injected[k]
        states.append(y)
        commands.append(vir)
        before, before_that = y[0], before
        tau = GAIN * min(max(vir, -limit), limit)
        y = solved(lambda t, y, tau=tau: rates(p, y, tau), (0.0, DT), y)
    return np.array(states), np.array(commands)


def reference_continuous(plant, excitation, y):
    """The law at every instant; reference and volts are linear between samples, so the solver restarts at each."""
    p, qg, injected = values(plant), np.asarray(excitation.qg), np.asarray(excitation.injected)
    states = [y]
    for k in range(len(qg) - 1):

        def field(t, y, k=k):
            r = t / DT
            error = (1 - r) * qg[k] + r * qg[k + 1] - y[0]
            vir = KV * (KP * error - y[1]) + (1 - r) * injected[k] + r * injected[k + 1]
            return rates(p, y, GAIN * vir)

        states.append(solved(field, (0.0, DT), states[-1]))
    states = np.array(states)
    return states, KV * (KP * (qg - states[:, 0]) - states[:, 1]) + injected


def at_start(plant, q, v):
    return np.array([q, v] if plant.model == "rigid" else [q, v, q, v])


def compare(out, states, commands, plant):
    """Positions (m), speeds (m/s), commanded force (N), against the reference.

    With 8 steps per sample the simulator converges to 1e-14 m (its error falls 30 times per halving, next section);
    the law turns 1e-14 m into kv gain / (2 dt) = 4e6 N/m times that.
    """
    sides = (out.motor,) if plant.model == "rigid" else (out.motor, out.load)
    for side, q, v in zip(sides, states.T[::2], states.T[1::2], strict=True):
        np.testing.assert_allclose(side.q, q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(side.v, v, rtol=0, atol=1e-12)
    np.testing.assert_allclose(out.tau, GAIN * commands, rtol=0, atol=1e-7)


@each_plant
def test_the_sampled_loop_agrees_with_an_independent_simulation(make):
    """From a start in motion, in and out of the drive's limit."""
    plant, excitation = make(), drive(N)
    loop = around(plant, substeps=8, limit=7.0)
    start = loop.start(0.1, 0.03, DT)
    out = simulate(loop, excitation, start)
    states, commands = reference_sampled(plant, excitation, at_start(plant, 0.1, 0.03), np.asarray(start.memory), 7.0)
    assert 10 < np.sum(np.abs(commands) > 7.0) < 200
    assert np.any(np.diff(np.sign(states[:, 1])) != 0)
    compare(out, states, commands, plant)


@each_plant
def test_the_continuous_loop_agrees_with_an_independent_simulation(make):
    plant, excitation = make(), drive(N)
    out = run(around(plant, sampled=False, substeps=8), excitation, v=0.03)
    states, commands = reference_continuous(plant, excitation, at_start(plant, float(excitation.qg[0]), 0.03))
    assert np.any(np.diff(np.sign(states[:, 1])) != 0)
    compare(out, states, commands, plant)


# -- steps -------------------------------------------------------------------------------------------------------


@each_loop
def test_the_integration_error_falls_with_the_fifth_power_of_the_step(sampled):
    excitation = drive(N, 2 * DT)
    plant = flexible(v_eps=0.05)  # smooth on the scale of a step, so that the order shows
    position = {
        substeps: np.asarray(run(around(plant, sampled=sampled, substeps=substeps), excitation).load.q)
        for substeps in (1, 2, 8)
    }
    best = position.pop(8)
    errors = [np.sqrt(np.mean((q - best) ** 2)) for q in position.values()]
    order = np.log2(errors[0] / errors[1])
    assert order > 4.8  # Tsit5: 5; more where the leading terms cancel along a swing
    assert errors[-1] > 1e-15  # m: still above rounding, so these are orders of the method


@each_plant
def test_the_sampled_loop_tends_to_the_continuous_one(make):
    """The held command is half a sample late, the two-sample velocity a whole one: the difference falls as dt."""
    errors = []
    for step in (1, 2, 4):  # as many samples each time, so that one compilation serves all
        excitation = drive(2000, DT / 2 / step)
        one, other = (run(around(make(), sampled=sampled), excitation) for sampled in (True, False))
        gap = np.asarray(one.motor.q - other.motor.q)[: 500 * step : step]
        errors.append(np.sqrt(np.mean(gap**2)))
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 1.0, atol=0.02)  # the next term is dt^2


@each_plant
@each_loop
def test_at_constant_speed_both_loops_follow_with_the_error_of_the_closed_form(make, sampled):
    """Started in its steady state the drive stays there: the motor carries friction and offset, K12 the load's."""
    v, p = 0.05, values(make())
    sides = [""] if "M" in p else ["1", "2"]
    friction = [p["Fv" + side] * v + p["Fc" + side] * np.tanh(v / V_EPS) for side in sides]
    error = (v + (sum(friction) + p["offset"]) / (GAIN * KV)) / KP
    deflection = [] if "M" in p else [-friction[1] / p["K12"], 0.0]
    qg = 0.1 + v * DT * np.arange(N)
    loop = around(make(), sampled=sampled)
    start = loop.start(qg[0] - error, v, DT)
    start = eqx.tree_at(lambda s: s.plant, start, jnp.asarray([qg[0] - error, v, *deflection]))
    out = simulate(loop, Excitation(jnp.asarray(DT), jnp.asarray(qg), jnp.zeros(N)), start)
    # roundings of positions of 0.1 m enter the command through kv / (2 dt), and the loop forgets them in 10 ms
    np.testing.assert_allclose(qg - np.asarray(out.motor.q), error, rtol=0, atol=1e-14)
    np.testing.assert_allclose(out.motor.v, v, rtol=0, atol=1e-13)


# -- starts ------------------------------------------------------------------------------------------------------


def uncontrolled(plant, sampled):
    """The plant on its own: both gains zero, no volts."""
    return around(plant, sampled=sampled, kp=0.0, kv=0.0), Excitation(jnp.asarray(DT), jnp.zeros(N), jnp.zeros(N))


@each_loop
def test_a_rigid_drive_in_motion_coasts_as_the_closed_form_says(sampled):
    r = 3.0  # 1/s
    loop, excitation = uncontrolled(rigid(Fv=107.0 * r, Fc=0.0, offset=0.0), sampled)
    out = run(loop, eqx.tree_at(lambda e: e.qg, excitation, jnp.full(N, 0.1)), v=0.05)
    t = np.asarray(out.t)
    np.testing.assert_allclose(out.motor.v, 0.05 * np.exp(-r * t), rtol=1e-13)  # (r dt)^6 is far below rounding
    np.testing.assert_allclose(out.motor.q, 0.1 + 0.05 * (1 - np.exp(-r * t)) / r, rtol=1e-14)
    np.testing.assert_array_equal(out.vir, 0.0)


@each_loop
def test_a_flexible_drive_starts_in_any_state(sampled):
    """Deflected and in relative motion, undamped: the relative swing is a cosine and a sine at its own frequency."""
    loop, excitation = uncontrolled(flexible(Fv1=0.0, Fc1=0.0, Fv2=0.0, Fc2=0.0, offset=0.0), sampled)
    start = Start(jnp.asarray([0.1, 0.02, 1e-4, 5e-3]), jnp.zeros(2 * sampled))
    out = simulate(loop, excitation, start)
    w = np.sqrt(8.8e5 * (1 / 68 + 1 / 38))
    wt = w * np.asarray(out.t)
    # one Tsit5 step per sample, w dt = 0.19: some 1e-4 (w dt)^6 = 5e-9 per sample, 300 samples
    swing = np.asarray(out.load.q - out.motor.q)
    np.testing.assert_allclose(swing, 1e-4 * np.cos(wt) + 5e-3 / w * np.sin(wt), rtol=0, atol=1e-4 * 5e-6)
    centre = (68 * np.asarray(out.motor.q) + 38 * np.asarray(out.load.q)) / 106
    start_centre, speed = 0.1 + 38 * 1e-4 / 106, 0.02 + 38 * 5e-3 / 106
    np.testing.assert_allclose(centre, start_centre + speed * np.asarray(out.t), rtol=1e-13)


def test_the_rig_puts_the_documented_machine_around_the_plant(emps_like):
    """The loops made from a machine are those made by hand from its values, samples for samples."""
    excitation = drive(N)
    for made, sampled in ((sampled_loop, True), (continuous_loop, False)):
        one = run(made(emps_like, flexible()), excitation)
        other = run(around(flexible(), sampled=sampled, limit=10.0), excitation)
        np.testing.assert_array_equal(one.vir, other.vir)


# -- failure -----------------------------------------------------------------------------------------------------


@each_loop
@pytest.mark.parametrize(
    ("plant", "limit"),
    [
        (rigid(M=1e-3), np.inf),  # the loop itself is unstable, and no limit holds it
        (rigid(M=1e-3), 10.0),  # 200 N s/m on a gram: 200 times too fast for the step
        (flexible(M2=1e-6, K12=1e9), 10.0),  # a mode at 5 MHz
        (rigid(M=np.nan), np.inf),
    ],
    ids=["light", "light with limit", "stiff", "nan"],
)
def test_a_diverged_run_is_not_ok_though_the_solver_succeeds(plant, limit, sampled):
    loop = around(plant, sampled=sampled, limit=limit)
    excitation = drive(N)
    out = simulate(loop, excitation, loop.start(0.1, 0.0, DT))
    assert bool(out.result == dfx.RESULTS.successful)
    assert not bool(out.ok)


@each_loop
def test_each_lane_of_a_sweep_has_its_own_ok(sampled):
    excitation = drive(N)

    def lane(M):
        loop = around(eqx.tree_at(lambda p: p.M, rigid(), M), sampled=sampled)
        return simulate(loop, excitation, loop.start(0.1, 0.0, DT)).ok

    np.testing.assert_array_equal(jax.vmap(lane)(jnp.asarray([107.0, 1e-3, 80.0])), [True, False, True])


# -- compilation -------------------------------------------------------------------------------------------------


class Counted(AbstractEffect):
    """Nothing, but it counts how often it is traced."""

    block: ClassVar[Block] = Block.LOAD_SIDE
    traced: ClassVar[list[int]] = []

    def __call__(self, t, x, signals):
        self.traced.append(1)
        return jnp.zeros_like(signals.q1), x


@each_loop
def test_parameters_gains_smoothing_and_start_are_traced(sampled):
    """One compilation serves every number; another length or another number of steps needs its own."""

    def traces(make, n=40, dt=DT, v=0.0, **choices):
        Counted.traced.clear()
        loop, excitation = around(make, sampled=sampled, effects=(Counted(),), **choices), drive(n, dt)
        run_ok = simulate(loop, excitation, loop.start(excitation.qg[0], v, excitation.dt)).ok
        assert bool(run_ok)
        return len(Counted.traced)

    assert traces(flexible(), limit=10.0) > 0
    for other in (flexible(M1=60.0, K12=1e6, offset=1.0), flexible(v_eps=2e-2), flexible(Fc1=0, Fv2=np.float64(1.0))):
        assert traces(other, limit=10.0) == 0
    assert traces(flexible(), limit=3.0, kp=100.0, kv=200.0, dt=5e-4, v=0.05) == 0
    assert traces(flexible(), limit=10.0, n=41) > 0
    assert traces(flexible(), limit=10.0, substeps=2) > 0


# -- derivatives -------------------------------------------------------------------------------------------------


def is_friction(x):
    return isinstance(x, AbstractFriction)


def unknowns(plant, start):
    """(names, values, step sizes) of everything a fit may move: theta, v_eps, every entry of the start."""
    entries = [*(f"y{i}" for i in range(len(start.plant))), *(f"m{i}" for i in range(len(start.memory)))]
    theta = np.asarray(pack(plant))
    x = np.concatenate([theta, [V_EPS], start.plant, start.memory])
    scales = {"q1": 1e-6, "v1": 1e-4, "delta": 1e-6, "ddelta": 1e-4}
    steps = [*np.maximum(1e-4 * np.abs(theta), 1e-3), 1e-4 * V_EPS]
    steps += [scales[name] for name in plant.state_names] + [1e-6] * len(start.memory)
    return [*names(plant), "v_eps", *entries], jnp.asarray(x), np.array(steps)


ASYMMETRIC = AsymmetricCoulombViscous(104.0, 10.0, 120.0, 13.0, V_EPS)


@pytest.mark.parametrize(
    "plant", [RigidDrive(107.0, ASYMMETRIC, -3.0), flexible()], ids=["rigid, asymmetric", "flexible"]
)
@each_loop
def test_the_jacobian_of_the_force_is_that_of_central_differences(plant, sampled):
    excitation = drive(N)
    loop = around(plant, sampled=sampled)
    start = loop.start(0.1, 0.03, DT)
    what, x0, steps = unknowns(plant, start)
    n_theta, n_y = len(names(plant)), len(start.plant)

    @jax.jit
    def force(x):
        theta, v_eps, y, memory = jnp.split(x, [n_theta, n_theta + 1, n_theta + 1 + n_y])
        moved = jax.tree.map(
            lambda f: eqx.tree_at(lambda f: f.v_eps, f, v_eps[0]) if is_friction(f) else f,
            unpack(plant, theta),
            is_leaf=is_friction,
        )
        return simulate(eqx.tree_at(lambda a: a.chain.plant, loop, moved), excitation, Start(y, memory)).tau

    exact = np.asarray(jax.jit(jax.jacfwd(force))(x0))
    assert np.all(np.isfinite(exact))
    for i, (name, h) in enumerate(zip(what, steps, strict=True)):
        far, near = (force(x0.at[i].add(k * h)) - force(x0.at[i].add(-k * h)) for k in (2, 1))
        differences = np.asarray(8 * near - far) / (12 * h)  # fourth order, so that h may stay well above rounding
        size = np.linalg.norm(exact[:, i])
        assert size > 0, name
        # rounding of the force, 1e-9 N, over a change of 1e-3 N and more
        assert np.linalg.norm(exact[:, i] - differences) < 1e-5 * size, name
