"""An effect acts on its block and nowhere else, in its unit and sign, and at its null it is not there.

The signs are held by closed forms: what a constant contribution to each block does to a drive that is otherwise free.
"""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from scipy.integrate import solve_ivp

from didim_jax.chain import Chain, State
from didim_jax.control import ContinuousPD, Drive, SampledPD
from didim_jax.effects import SAMPLED, AbstractEffect, Block, EncoderGrid
from didim_jax.params import param
from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.simulate import ContinuousLoop, Excitation, SampledLoop, Start, simulate

DT, N = 1e-3, 300
KP, KV, GAIN = 160.18, 243.45, 35.15
EPS = np.finfo(float).eps

FREE = CoulombViscous(0.0, 0.0)
RIGID = RigidDrive(107.0, CoulombViscous(200.0, 20.0, 5e-3))
FLEXIBLE = FlexibleDrive(68.0, CoulombViscous(104.0, 10.0, 5e-3), 38.0, CoulombViscous(96.5, 9.5, 5e-3), 8.8e5)
FREE_RIGID = RigidDrive(107.0, FREE)
FREE_FLEXIBLE = FlexibleDrive(68.0, FREE, 38.0, FREE, 8.8e5)

each_loop = pytest.mark.parametrize("sampled", [True, False], ids=["sampled", "continuous"])
both_ways = pytest.mark.parametrize(
    ("plant", "sampled"), [(RIGID, True), (FLEXIBLE, False)], ids=["rigid, sampled", "flexible, continuous"]
)
each_plant = pytest.mark.parametrize("plant", [RIGID, FLEXIBLE], ids=["rigid", "flexible"])


def around(plant, *effects, sampled=True, controlled=True, gain=GAIN, limit=np.inf, substeps=1):
    """The loop with effects; `controlled=False` sets both gains of the controller to zero."""
    chain = Chain(Drive(gain, limit), plant, effects)
    kp, kv = (KP, KV) if controlled else (0.0, 0.0)
    if sampled:
        return SampledLoop(controller=SampledPD(kp, kv), chain=chain, substeps=substeps)
    return ContinuousLoop(controller=ContinuousPD(kp, kv), chain=chain, substeps=substeps)


def reference():
    """Positions with reversals, small enough for the drive to stay within 10 V."""
    t = DT * np.arange(N)
    return 0.1 + 0.01 * np.sin(2 * np.pi * 1.5 * t) ** 2 + 4e-5 * np.sin(2 * np.pi * 12 * t) ** 2


def drive(qg=None, volts=0.0):
    qg = reference() if qg is None else qg
    return Excitation(jnp.asarray(DT), jnp.asarray(qg), jnp.zeros(N) + volts)


def run(loop, excitation=None, start=None, *, v=0.0):
    excitation = drive() if excitation is None else excitation
    start = loop.start(excitation.qg[0], v, excitation.dt) if start is None else start
    out = simulate(loop, excitation, start)
    assert bool(out.ok)
    return out


def on(where, contribution):
    """An effect on a block whose contribution is a function of (p, t, signals)."""

    class Effect(AbstractEffect):
        block: ClassVar[Block] = where
        p: Array = param("unit of its block")

        def __call__(self, t, x, signals):
            return contribution(self.p, t, signals), x

    return Effect


def constant(where):
    return on(where, lambda p, t, signals: p + jnp.zeros_like(t))


def scaled(where):
    return on(where, lambda p, t, signals: p * signals.incoming)


CONSTANT = {block: constant(block) for block in Block}
SCALED = {block: scaled(block) for block in Block}


def constants(**sizes):
    """One constant effect on every block, those not named at zero: one chain, compiled once, for many tests."""
    assert set(sizes) <= {block.name for block in Block}
    return [CONSTANT[block](sizes.get(block.name, 0.0)) for block in Block]


# -- every block: unit and sign ----------------------------------------------------------------------------------

P = 12.0
ACCELERATIONS = {  # of a free drive under a contribution P: rigid, then motor side and load side of the flexible one
    Block.CONTROLLER: (GAIN * P / 107, GAIN * P / 68, 0.0),  # V, through the drive
    Block.ACTUATOR: (P / 107, P / 68, 0.0),
    Block.MOTOR_SIDE: (P / 107, P / 68, 0.0),
    Block.COUPLING: (0.0, P / 68, -P / 38),  # pulls the motor on and holds the load back
    Block.LOAD_SIDE: (P / 107, 0.0, P / 38),
    Block.SENSOR: (0.0, 0.0, 0.0),  # m, on what is measured
    Block.BASE: (-P, -P, -P),  # m/s2 of the frame
    Block.ENVIRONMENT: (P / 107, 0.0, P / 38),
}


def test_every_block_has_its_closed_form_here():
    assert set(ACCELERATIONS) == set(Block)
    assert {Block.CONTROLLER, Block.SENSOR} == SAMPLED


@each_loop
@pytest.mark.parametrize("block", Block)
def test_a_constant_contribution_accelerates_what_it_acts_on(block, sampled):
    effects = constants(**{block.name: P})
    rigid, *flexible = ACCELERATIONS[block]
    still = drive(qg=np.zeros(N))
    out = run(around(FREE_RIGID, *effects, sampled=sampled, controlled=False), still)
    t = np.asarray(out.t)
    # constant acceleration is a polynomial of degree 2, which every step integrates exactly
    np.testing.assert_allclose(out.motor.a, rigid, rtol=4 * EPS)
    np.testing.assert_allclose(out.motor.v, rigid * t, rtol=1e-13)
    np.testing.assert_allclose(out.motor.q, 0.5 * rigid * t**2, rtol=1e-12)

    out = run(around(FREE_FLEXIBLE, *effects, sampled=sampled, controlled=False), still)
    np.testing.assert_allclose([out.motor.a[0], out.load.a[0]], flexible, rtol=4 * EPS, atol=1e-14)
    momentum = 68 * np.asarray(out.motor.v) + 38 * np.asarray(out.load.v)  # the spring is inside
    np.testing.assert_allclose(momentum, (68 * flexible[0] + 38 * flexible[1]) * t, rtol=1e-12, atol=1e-12)
    measured = 0.0 if block is not Block.SENSOR else P
    np.testing.assert_array_equal(out.qm, np.asarray(out.motor.q) + measured)
    np.testing.assert_array_equal(out.vir, P if block is Block.CONTROLLER else 0.0)


@each_loop
def test_a_force_in_the_coupling_is_balanced_by_its_deflection(sampled):
    """K12 delta + c = 0 is rest: c N in the coupling are as a spring whose rest length is -c/K12."""
    loop = around(FREE_FLEXIBLE, *constants(COUPLING=88.0), sampled=sampled, controlled=False)
    still = drive(qg=np.zeros(N))
    start = Start(jnp.asarray([0.0, 0.0, -88.0 / 8.8e5, 0.0]), jnp.zeros(2 * sampled))
    out = run(loop, still, start)
    np.testing.assert_allclose(out.load.q, -1e-4, rtol=1e-12)
    np.testing.assert_allclose(out.motor.q, 0.0, atol=1e-16)


@each_loop
def test_a_moving_base_is_an_inertial_force_on_both_masses(sampled):
    """Frame accelerated by b: what it carries feels -M b on each mass, in closed loop and with friction."""
    waves = [on(b, lambda p, t, signals: p * jnp.sin(40 * t)) for b in (Block.BASE, Block.MOTOR_SIDE, Block.LOAD_SIDE)]

    def shaken(plant, *sizes):
        return run(around(plant, *(wave(p) for wave, p in zip(waves, sizes, strict=True)), sampled=sampled))

    one, other, nothing = (shaken(FLEXIBLE, *p) for p in ((0.5, 0, 0), (0, -68 * 0.5, -38 * 0.5), (0, 0, 0)))
    # rounding of positions, 1e-17 m and a few times that, times kv gain / (2 dt) = 4e6 N/m
    np.testing.assert_allclose(one.tau, other.tau, rtol=0, atol=1e-8)
    assert np.abs(one.tau - nothing.tau).max() > 10  # N of 53: it is a base that shakes

    one, other = (shaken(RIGID, *p) for p in ((0.5, 0, 0), (0, -107 * 0.5, 0)))
    np.testing.assert_allclose(one.tau, other.tau, rtol=0, atol=1e-8)


@each_loop
def test_a_load_side_force_and_the_environment_are_one_force(sampled):
    forces = ({"LOAD_SIDE": 5.0}, {"ENVIRONMENT": 5.0}, {"LOAD_SIDE": 2.0, "ENVIRONMENT": 3.0})
    one, two, both = (run(around(FLEXIBLE, *constants(**p), sampled=sampled)) for p in forces)
    np.testing.assert_allclose(one.tau, two.tau, rtol=0, atol=1e-8)
    np.testing.assert_allclose(one.tau, both.tau, rtol=0, atol=1e-8)


@both_ways
def test_an_encoder_that_is_off_shifts_the_reference(plant, sampled):
    """qm = q + b: the loop holds the drive b short of where it should be, and does not notice."""
    b = 2e-4
    loop = around(plant, *constants(SENSOR=b), sampled=sampled)
    out = run(loop, drive(), loop.start(reference()[0] - b, 0.0, DT))  # past samples were measured off too
    plain = run(around(plant, sampled=sampled), drive(reference() - b))
    np.testing.assert_allclose(out.motor.q, plain.motor.q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(out.tau, plain.tau, rtol=0, atol=1e-7)  # 1e-14 m times 4e6 N/m
    np.testing.assert_array_equal(out.qm, np.asarray(out.motor.q) + b)


@each_loop
def test_volts_of_an_effect_are_volts_of_the_excitation(sampled):
    one = run(around(FLEXIBLE, *constants(CONTROLLER=0.7), sampled=sampled, limit=3.0))
    other = run(around(FLEXIBLE, sampled=sampled, limit=3.0), drive(volts=0.7))
    assert np.any(np.abs(one.vir) > 3.0)  # both come before the clip
    np.testing.assert_allclose(one.vir, other.vir, rtol=0, atol=1e-9)


@both_ways
def test_a_wrong_gain_of_the_drive_is_felt_and_not_commanded(plant, sampled):
    """`tau` is the documented gain times the command; `force` is the one that moved the plant."""
    g = 0.1
    out = run(around(plant, SCALED[Block.ACTUATOR](g), sampled=sampled, limit=4.0))
    other = run(around(plant, sampled=sampled, gain=GAIN * (1 + g), limit=4.0))
    np.testing.assert_allclose(out.vir, other.vir, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(out.tau, GAIN * np.asarray(out.vir))
    vir = np.asarray(out.vir)
    assert np.any(np.abs(vir) > 4.0)
    np.testing.assert_allclose(out.force, GAIN * (1 + g) * np.clip(vir, -4, 4), rtol=4 * EPS)
    moved = np.asarray(plant.inverse(out.motor, out.load)[0])
    np.testing.assert_allclose(moved, out.force, rtol=0, atol=1e-9)


# -- what an effect sees -----------------------------------------------------------------------------------------


def test_an_effect_sees_the_speed_and_position_of_its_side():
    """Viscous friction and a spring to the ground written as effects are those of the closed form."""
    slower = CoulombViscous(104.0 + 50, 10.0, 5e-3), CoulombViscous(96.5 + 70, 9.5, 5e-3)
    motor = on(Block.MOTOR_SIDE, lambda p, t, signals: -p * signals.v1)
    load = on(Block.LOAD_SIDE, lambda p, t, signals: -p * signals.v2)
    one = run(around(FLEXIBLE, motor(50.0), load(70.0)))
    other = run(around(FlexibleDrive(68.0, slower[0], 38.0, slower[1], 8.8e5)))
    np.testing.assert_allclose(one.tau, other.tau, rtol=0, atol=1e-8)

    w = 20.0  # rad/s
    still = drive(qg=np.full(N, 0.1))
    spring = on(Block.LOAD_SIDE, lambda p, t, signals: -p * (0.75 * signals.q1 + 0.25 * signals.q2))
    out = run(around(FREE_RIGID, spring(107.0 * w**2), controlled=False), still)
    # w dt = 0.02: some 1e-4 (w dt)^6 = 6e-15 per step
    np.testing.assert_allclose(out.motor.q, 0.1 * np.cos(w * np.asarray(out.t)), rtol=0, atol=1e-12)


def test_an_effect_sees_the_coupling_s_force_on_the_motor():
    """Taken away from the motor and given back to the load, it leaves two masses that know nothing of each other."""
    cut = (
        on(Block.MOTOR_SIDE, lambda p, t, signals: -p * signals.coupling)(1.0),
        on(Block.LOAD_SIDE, lambda p, t, signals: p * signals.coupling)(1.0),
    )
    loop = around(FREE_FLEXIBLE, *cut, controlled=False)
    out = run(loop, drive(qg=np.zeros(N), volts=1.0), Start(jnp.asarray([0.0, 0.0, 1e-4, 2e-3]), jnp.zeros(2)))
    t = np.asarray(out.t)
    np.testing.assert_allclose(out.motor.q, 0.5 * GAIN / 68 * t**2, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(out.load.q, 1e-4 + 2e-3 * t, rtol=1e-9)


@each_loop
def test_an_effect_sees_the_command_that_the_drive_holds(sampled):
    feed = on(Block.MOTOR_SIDE, lambda p, t, signals: p * signals.command)
    one = run(around(FLEXIBLE, feed(3.0), sampled=sampled))
    other = run(around(FLEXIBLE, gain=GAIN + 3.0, sampled=sampled))
    np.testing.assert_allclose(one.vir, other.vir, rtol=0, atol=1e-9)


@each_loop
def test_an_effect_sees_the_time_within_a_sample_too(sampled):
    w = 300.0  # rad/s; a force frozen for one sample would be wrong by 15 %
    shaker = on(Block.ENVIRONMENT, lambda p, t, signals: p * jnp.cos(w * t))
    out = run(around(FREE_RIGID, shaker(50.0), sampled=sampled, controlled=False, substeps=4), drive(qg=np.zeros(N)))
    expected = 50 / (107 * w) * np.sin(w * np.asarray(out.t))
    np.testing.assert_allclose(out.motor.v, expected, rtol=0, atol=1e-9 * expected.max())  # (w h)^6 = 2e-7, times 1e-4


# -- chains ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("block", [Block.ACTUATOR, Block.CONTROLLER, Block.SENSOR])
def test_effects_of_one_block_act_in_the_order_given(block):
    g, p = 0.1, {Block.ACTUATOR: 5.0, Block.CONTROLLER: 0.3, Block.SENSOR: 1e-5}[block]

    def passed(*kinds):
        """What comes out of the block and what went in, the pair of effects also on the other two, there at null."""
        effects = [
            kind[b](value if b is block else 0.0)
            for kind, value in kinds
            for b in (Block.CONTROLLER, Block.ACTUATOR, Block.SENSOR)
        ]
        out = run(around(RIGID, *effects))
        qm, vir = np.asarray(out.qm), np.asarray(out.vir)
        if block is Block.ACTUATOR:
            return np.asarray(out.force), GAIN * vir
        if block is Block.SENSOR:
            return qm, np.asarray(out.motor.q)
        past = np.concatenate([reference()[:1], reference()[:1], qm])
        return vir, KV * (KP * (reference() - qm) - (qm - past[:-2]) / (2 * DT))

    gain, offset = (SCALED, g), (CONSTANT, p)
    out, into = passed(gain, offset)
    np.testing.assert_allclose(out, into * (1 + g) + p, rtol=1e-11, atol=1e-11)
    out, into = passed(offset, gain)
    np.testing.assert_allclose(out, (into + p) * (1 + g), rtol=1e-11, atol=1e-11)


def test_the_order_of_blocks_in_the_list_does_not_matter():
    sizes = (0.1, 3.0, 2.0, 4.0, 5.0, 1e-5, 0.1, 6.0)
    effects = constants(**{block.name: p for block, p in zip(Block, sizes, strict=True)})
    one, other = run(around(FLEXIBLE, *effects)), run(around(FLEXIBLE, *effects[::-1]))
    np.testing.assert_allclose(one.tau, other.tau, rtol=0, atol=1e-8)


@each_loop
def test_one_effect_serves_two_plants_and_touches_neither(sampled):
    effects = constants(LOAD_SIDE=5.0)
    before = jax.tree.leaves((RIGID, FLEXIBLE))
    plain = [run(around(plant, sampled=sampled)) for plant in (RIGID, FLEXIBLE)]
    pushed = [run(around(plant, *effects, sampled=sampled)) for plant in (RIGID, FLEXIBLE)]
    again = [run(around(plant, sampled=sampled)) for plant in (RIGID, FLEXIBLE)]
    for a, b, c in zip(plain, pushed, again, strict=True):
        np.testing.assert_array_equal(a.tau, c.tau)
        assert np.abs(a.tau - b.tau).max() > 1.0
    assert all(a is b for a, b in zip(before, jax.tree.leaves((RIGID, FLEXIBLE)), strict=True))


# -- effects with a state ----------------------------------------------------------------------------------------


class Lag(AbstractEffect):
    """The amplifier's force follows its command with a time constant: T dF/dt = incoming - F."""

    block: ClassVar[Block] = Block.ACTUATOR
    T: Array = param("s", positive=True)
    share: Array = param("1", default=1.0)

    def init(self, signals):
        return {"F": jnp.zeros(())}

    def __call__(self, t, x, signals):
        late = x["F"] - signals.incoming
        return self.share * late, {"F": -late / self.T}


class Delay(AbstractEffect):
    """The encoder's value of one sample ago."""

    block: ClassVar[Block] = Block.SENSOR

    def init(self, signals):
        return signals.q1

    def __call__(self, t, x, signals):
        return x - signals.incoming, signals.incoming


class Count(AbstractEffect):
    """The number of the sample, in volts."""

    block: ClassVar[Block] = Block.CONTROLLER

    def init(self, signals):
        return jnp.zeros((), int)

    def __call__(self, t, x, signals):
        return x.astype(float), x + 1


def lagged(T, qg, sampled):
    """The rigid drive behind lags in series, in plain NumPy and SciPy: states (q, v, F of each lag), volts."""

    def rates(y, tau):
        _, v, *F = y
        into = [tau, *F[:-1]]
        return [
            v,
            (F[-1] - 200 * v - 20 * np.tanh(v / 5e-3)) / 107,
            *((f_in - f) / lag for f_in, f, lag in zip(into, F, T, strict=True)),
        ]

    y = np.array([qg[0], 0.02, *(0.0 for _ in T)])
    before, before_that = qg[0] - 0.02 * DT, qg[0] - 0.04 * DT
    states, commands = [], []
    for k in range(len(qg)):
        speed = (y[0] - before_that) / (2 * DT) if sampled else y[1]
        vir = KV * (KP * (qg[k] - y[0]) - speed)
        states.append(y)
        commands.append(vir)
        before, before_that = y[0], before
        slope = (qg[min(k + 1, len(qg) - 1)] - qg[k]) / DT

        def field(t, y, vir=vir, qg_k=qg[k], slope=slope):
            return rates(y, GAIN * (vir if sampled else KV * (KP * (qg_k + slope * t - y[0]) - y[1])))

        y = solve_ivp(field, (0.0, DT), y, method="DOP853", rtol=1e-13, atol=1e-16).y[:, -1]
    return np.array(states), np.array(commands)


@each_loop
@pytest.mark.parametrize("T", [(2e-3,), (2e-3, 1e-3)], ids=["one lag", "two lags"])
def test_an_amplifier_lag_is_the_augmented_system_of_an_independent_simulation(T, sampled):
    qg = reference()
    loop = around(RIGID, *(Lag(T_i) for T_i in T), sampled=sampled, substeps=4)
    out = run(loop, drive(qg), v=0.02)
    states, commands = lagged(T, qg, sampled)
    # 4 steps per sample, h/T = 0.25 at most: (h/T)^6 = 2e-4, times 1e-4, of 200 N, over the 3 steps a lag remembers
    np.testing.assert_allclose(out.motor.q, states[:, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(out.tau, GAIN * commands, rtol=0, atol=1e-6)  # 1e-13 m times 4e6 N/m
    np.testing.assert_allclose(out.force, states[:, -1], rtol=0, atol=2e-5)
    assert np.abs(out.force - out.tau).max() > 5  # N: it does lag


def test_a_sensor_may_be_one_sample_late():
    out = run(around(RIGID, Delay(), substeps=3), v=0.02)
    q, qm = np.asarray(out.motor.q), np.asarray(out.qm)
    # q + (x - q) is x but for the rounding of the difference
    np.testing.assert_allclose(qm, np.concatenate([q[:1], q[:-1]]), rtol=0, atol=2 * EPS * 0.1)
    past = np.concatenate([[q[0] - 0.04 * DT, q[0] - 0.02 * DT], qm])
    law = KV * (KP * (reference() - qm) - (qm - past[:-2]) / (2 * DT))
    np.testing.assert_allclose(out.vir, law, rtol=0, atol=1e-11)  # roundings of 0.1 m times kv / (2 dt)


@pytest.mark.parametrize("substeps", [1, 3])
def test_the_state_of_a_sampled_effect_moves_once_per_sample(substeps):
    """Whatever stands beside it in the chain, and however many steps a sample has."""
    loop = around(RIGID, Lag(2e-3), Count(), EncoderGrid(5e-8), Delay(), controlled=False, substeps=substeps)
    out = run(loop, drive(qg=np.zeros(N)))
    np.testing.assert_array_equal(out.vir, np.arange(N))


@pytest.mark.parametrize("effect", [Delay(), Count()], ids=["sensor", "controller"])
def test_the_continuous_loop_refuses_a_state_between_samples(effect):
    loop = around(RIGID, CONSTANT[Block.LOAD_SIDE](1.0), effect, sampled=False)
    with pytest.raises(ValueError, match=rf"{type(effect).__name__} keeps a state between samples.*SampledLoop"):
        run(loop)


# -- null effects ------------------------------------------------------------------------------------------------


def nulls(block):
    """Effects that are nothing at p = 0: a constant, one that depends on time and motion, one on what arrives."""
    moving = on(block, lambda p, t, signals: p * jnp.cos(3 * t) * signals.v1 + p * signals.coupling)
    return CONSTANT[block](0.0), moving(0.0), SCALED[block](0.0)


@each_plant
@pytest.mark.parametrize("block", Block)
def test_a_null_effect_changes_no_bit_of_the_model(plant, block):
    """Operation by operation, as IEEE has it: adding zero is nothing at all."""
    rng = np.random.default_rng(2)
    plain, chain = Chain(Drive(GAIN, 10.0), plant), Chain(Drive(GAIN, 10.0), plant, nulls(block))
    for y in rng.normal(size=(5, len(plant.state_names))) * np.array([0.1, 0.05, 1e-4, 1e-3])[: len(plant.state_names)]:
        t, vir = jnp.asarray(rng.uniform()), jnp.asarray(rng.normal())
        bare, attached = State(jnp.asarray(y), ()), State(jnp.asarray(y), ((), (), ()))
        held = plain.hold(t, bare, vir, DT)[0]
        one = plain.derivative(t, bare, held)
        two = chain.derivative(t, attached, held)
        np.testing.assert_array_equal(chain.hold(t, attached, vir, DT)[0].force, held.force)
        np.testing.assert_array_equal(one.plant, two.plant)
        signals = plain.signals(jnp.asarray(y), vir)
        np.testing.assert_array_equal(chain.along(block, t, ((), (), ()), signals, vir)[0], vir)


@each_loop
@each_plant
def test_null_effects_outside_the_mechanics_change_no_bit_of_the_compiled_run(plant, sampled):
    effects = [CONSTANT[block](0.0) for block in (Block.CONTROLLER, Block.SENSOR)]
    one, two = run(around(plant, sampled=sampled)), run(around(plant, *effects, sampled=sampled))
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True):
        np.testing.assert_array_equal(a, b)


@both_ways
def test_null_effects_on_the_mechanics_leave_the_compiled_run_to_rounding(plant, sampled):
    """The compiler contracts a product and the sum after it into one rounding, and a null term between them moves
    which: not bits, then, but their last ones, as the loop carries them on (1e-17 m times 4e6 N/m, a few times)."""
    effects = [null for block in Block for null in nulls(block)]
    one, two = run(around(plant, sampled=sampled)), run(around(plant, *effects, sampled=sampled))
    np.testing.assert_allclose(two.motor.q, one.motor.q, rtol=0, atol=1e-15)
    np.testing.assert_allclose(two.tau, one.tau, rtol=0, atol=1e-8)


def test_a_null_effect_with_a_state_leaves_the_run_to_rounding():
    one, two = run(around(RIGID)), run(around(RIGID, Lag(2e-3, share=0.0)))
    np.testing.assert_allclose(two.tau, one.tau, rtol=0, atol=1e-8)


def test_an_effect_without_state_takes_none():
    class Bare(AbstractEffect):
        block: ClassVar[Block] = Block.BASE

        def __call__(self, t: Array, x: Any, signals: Any) -> tuple[Array, Any]:
            return jnp.zeros_like(t), x

    assert Chain(Drive(GAIN), RIGID, (Bare(),)).init(jnp.zeros(2)).effects == ((),)


# -- the encoder's grid ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [5e-8, 1e-6, 3.3e-5])
def test_the_encoder_counts(resolution):
    out = run(around(FLEXIBLE, EncoderGrid(resolution)))
    qm, q = np.asarray(out.qm), np.asarray(out.motor.q)
    np.testing.assert_allclose(qm, resolution * np.round(qm / resolution), rtol=0, atol=2 * EPS * 0.1)
    assert np.abs(qm - q).max() <= 0.5 * resolution * (1 + 1e-6)  # the nearest count
    assert np.abs(qm - q).max() > 0.4 * resolution


@each_loop
def test_an_encoder_without_steps_is_no_encoder(sampled):
    one, two = run(around(FLEXIBLE, sampled=sampled)), run(around(FLEXIBLE, EncoderGrid(0.0), sampled=sampled))
    np.testing.assert_array_equal(one.tau, two.tau)
    np.testing.assert_array_equal(one.qm, two.qm)
