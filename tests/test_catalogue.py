"""Every effect of the catalogue is nothing at its null, has a derivative there, and follows its closed form beyond.

All of them are in one chain at once, so that one compiled loop per plant serves every test here: an effect under test
has its sizes, and the others stand at their null.
"""

import dataclasses
import inspect
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from jax import Array
from scipy.signal import lfilter

from didim_jax.chain import Chain, State
from didim_jax.control import ContinuousPD, Drive, SampledPD
from didim_jax.effects import AbstractEffect, Bench, Block, EncoderGrid, Forces, Signals, acts_once_per_sample
from didim_jax.effects._check import fault
from didim_jax.effects.catalogue import CATALOGUE, load
from didim_jax.effects.environment import DisturbancePulses, pulses_in
from didim_jax.effects.friction import Presliding
from didim_jax.errors import InputError
from didim_jax.params import pack, parameters, unpack
from didim_jax.plant import AsymmetricCoulombViscous, CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.simulate import ContinuousLoop, Excitation, SampledLoop, simulate
from didim_jax.sliding import Sliding

DT, N = 1e-3, 300
KP, KV, GAIN, LIMIT, LEAD = 160.18, 243.45, 35.15, 10.0, 0.0025
V_EPS = 5e-3
T_ALL = DT * np.arange(N)

FREE = CoulombViscous(0.0, 0.0, V_EPS)
RIGID = RigidDrive(107.0, CoulombViscous(200.0, 20.0, V_EPS))
FLEXIBLE = FlexibleDrive(68.0, CoulombViscous(104.0, 10.0, V_EPS), 38.0, CoulombViscous(96.5, 9.5, V_EPS), 8.8e5)
FREE_RIGID = RigidDrive(107.0, FREE)
FREE_FLEXIBLE = FlexibleDrive(68.0, FREE, 38.0, FREE, 8.8e5)
each_plant = pytest.mark.parametrize("plant", [RIGID, FLEXIBLE], ids=["rigid", "flexible"])

NAMES = tuple(effect.label() for effect in CATALOGUE)
BENCH = Bench(lead=LEAD, limit=LIMIT, gain=GAIN, dt=DT, q_low=0.1, q_high=0.115, duration=DT * N)

# The table of names by block; a friction effect may sit on either side.
BLOCKS = {
    "controller": "position_gain velocity_gain velocity_filter",
    "actuator": "amplifier_lag time_delay saturation amplifier_dead_zone gain_nonlinearity drive_gain cogging",
    "motor side, load side": "asymmetric_coulomb asymmetric_viscous stribeck quadratic_viscous position_friction "
    "lead_friction local_friction presliding load_dependent_friction friction_drift",
    "coupling": "coupling_damping cubic_stiffness backlash transmission_error",
    "load side": "second_flexible_mode payload_change",
    "sensor": "encoder_periodic_error encoder_quantisation",
    "base": "base_flexibility",
    "environment": "offset cable_spring disturbance_pulses",
}
STATEFUL_SAMPLED = {"amplifier_lag", "time_delay", "velocity_filter"}


def with_sizes(bench: Bench = BENCH, only=NAMES, **sizes: dict[str, float]) -> tuple[AbstractEffect, ...]:
    """The whole catalogue, at its null but for the sizes given by effect and parameter (or setting)."""
    assert set(sizes) <= set(only) <= set(NAMES)
    made = [effect.at(bench) for effect in CATALOGUE if effect.label() in only]
    return tuple(dataclasses.replace(effect, **sizes.get(effect.label(), {})) for effect in made)


def around(plant, effects=(), *, controlled=True, sampled=True, limit=LIMIT):
    chain = Chain(Drive(GAIN, limit), plant, effects)
    kp, kv = (KP, KV) if controlled else (0.0, 0.0)
    if sampled:
        return SampledLoop(controller=SampledPD(kp, kv), chain=chain)
    return ContinuousLoop(controller=ContinuousPD(kp, kv), chain=chain)


def reference(n=N):
    """Positions with reversals; up to 0.05 m/s, and mostly within 10 V."""
    t = DT * np.arange(n)
    return 0.1 + 0.01 * np.sin(2 * np.pi * 1.5 * t) ** 2 + 4e-5 * np.sin(2 * np.pi * 12 * t) ** 2


def drive(qg=None, volts=0.0):
    qg = reference() if qg is None else qg
    return Excitation(jnp.asarray(DT), jnp.asarray(qg), jnp.zeros(len(qg)) + volts)


def run(loop, excitation=None, *, v=0.0):
    excitation = drive() if excitation is None else excitation
    out = simulate(loop, excitation, loop.start(excitation.qg[0], v, excitation.dt))
    assert bool(out.ok)
    return out


def coasting(plant, volts, *, v=0.0, q=0.1, **sizes):
    """The drive without its controller, under these volts."""
    return run(around(plant, with_sizes(**sizes), controlled=False), drive(np.full(N, q), volts), v=v)


def held(t: Array) -> Signals:
    """What an effect sees at rest while the drive holds a sample from t on."""
    return eqx.tree_at(lambda s: s.held_since, signals(dt=DT), t)


def signals(**given: Any) -> Signals:
    """What an effect sees, all of it zero but what is given."""
    zero = dict.fromkeys(("q1", "v1", "q2", "v2", "coupling", "command", "incoming"), 0.0)
    return Signals(**{name: jnp.asarray(value, dtype=float) for name, value in (zero | given).items()})


# -- the list ----------------------------------------------------------------------------------------------------


def test_every_promised_effect_is_there_under_its_name_and_on_its_block():
    promised = {name: blocks.split(", ") for blocks, names in BLOCKS.items() for name in names.split()}
    assert len(NAMES) == len(set(NAMES))
    assert set(promised) <= set(NAMES)
    for effect in CATALOGUE:
        assert effect.block.value in promised.get(effect.label(), [effect.block.value]), effect.label()


@pytest.mark.parametrize("effect", CATALOGUE, ids=NAMES)
def test_an_effect_says_what_a_reader_wants_to_know(effect):
    assert effect.equation and effect.size and effect.source
    assert (effect.__doc__ or "").strip() and "null" in inspect.cleandoc(effect.__doc__).lower()
    assert set(effect.twins) <= set(NAMES) - {effect.label()}
    assert set(effect.own_to_record) <= {field.name for field in dataclasses.fields(effect)}
    for p in parameters(effect.at(BENCH)):
        assert p.unit and np.isfinite(p.scale) and p.scale > 0
        assert p.lower <= float(getattr(effect.at(BENCH), p.name)) <= p.upper


def test_the_effects_of_a_machine_take_its_numbers():
    bench = Bench(lead=0.005, limit=4.0, q_low=-0.1, q_high=0.3, duration=8.0)
    made = {effect.label(): effect.at(bench) for effect in CATALOGUE}
    for name in ("cogging", "lead_friction", "transmission_error", "encoder_periodic_error"):
        assert made[name].lead == 0.005
    assert made["saturation"].limit == 4.0
    assert (made["position_friction"].middle, made["position_friction"].half_stroke) == pytest.approx((0.1, 0.2))
    assert made["friction_drift"].duration == 8.0


@pytest.mark.parametrize("effect", CATALOGUE, ids=NAMES)
def test_a_probe_is_a_place_away_from_the_null_within_bounds(effect):
    force = np.zeros(1000)
    force[300:340] = 20.0  # what a pulse would be looked for in
    bench = dataclasses.replace(BENCH, volts=np.linspace(-9, 9, 500), disturbance=force)
    made = effect.at(bench)
    known = {p.name: p for p in parameters(made)}
    assert bool(made.probes(bench)) is bool(known)
    for probe in made.probes(bench):
        assert not set(probe.sizes) & set(probe.shape)
        for name, value in {**probe.sizes, **probe.shape}.items():
            assert known[name].lower <= value <= known[name].upper, name
        assert any(value != float(getattr(made, name)) for name, value in probe.sizes.items())


# -- the null ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effect", CATALOGUE, ids=NAMES)
def test_an_effect_alone_is_nothing_at_its_null_and_has_a_derivative_there(effect):
    """Forward, backward and at rest; that is what `fault` tries."""
    assert fault(effect) is None


@pytest.mark.slow
@each_plant
def test_the_whole_catalogue_at_its_null_changes_no_bit_of_a_run(plant):
    """Operation by operation, as IEEE has it: from a moving start, through a reversal and into the drive's limit.

    Compiled, it holds to rounding only (below): the compiler contracts products and sums, and a null term between
    them moves which.
    """
    excitation = drive(0.1 - 3e-4 * np.sin(2 * np.pi * 40 * DT * np.arange(20)))
    with jax.disable_jit():
        plain, full = (around(plant, effects) for effects in ((), with_sizes()))
        one, two = (loop.run(excitation, loop.start(0.1, 0.02, DT)) for loop in (plain, full))
    assert np.any(np.abs(one.vir) > LIMIT) and np.ptp(np.sign(one.motor.v)) == 2
    for name in ("qm", "vir", "tau"):
        np.testing.assert_array_equal(getattr(two, name), getattr(one, name))
    for side in ("motor", "load"):
        a, b = getattr(one, side), getattr(two, side)
        np.testing.assert_array_equal((b.q, b.v), (a.q, a.v))
        # read off all samples at once, where XLA divides by one mass with its reciprocal, by many without
        np.testing.assert_allclose(b.a, a.a, rtol=4e-16, atol=1e-14)
    np.testing.assert_array_equal(two.force, one.force)


@each_plant
def test_the_whole_catalogue_at_its_null_leaves_a_compiled_run_to_rounding(plant):
    one, two = run(around(plant), v=0.02), run(around(plant, with_sizes()), v=0.02)
    np.testing.assert_allclose(two.motor.q, one.motor.q, rtol=0, atol=1e-15)
    np.testing.assert_allclose(two.tau, one.tau, rtol=0, atol=1e-8)  # 1e-17 m times 4e6 N/m, a few times


# -- derivatives -------------------------------------------------------------------------------------------------

PLACES = [(effect.label(), p.name, p.scale) for effect in with_sizes() for p in parameters(effect)]
WIDTH = 16
SHORT = 200


class Derivatives:
    """tau of a short run as a function of every parameter of the catalogue, and its exact derivative."""

    def __init__(self, plant) -> None:
        effects = with_sizes(dataclasses.replace(BENCH, duration=DT * SHORT))
        loop = SampledLoop(
            controller=SampledPD(KP, KV), chain=Chain(Drive(GAIN, LIMIT), plant, effects), substeps=4, solver=Sliding()
        )
        # around the reversal at 1/3 s, at its fastest 0.1 m/s, and above the limit for a while at the start
        excitation = drive(reference(500)[-SHORT:])
        start = loop.start(excitation.qg[0] - 1e-4, 0.0, DT)
        self.null = np.concatenate([pack(effect) for effect in effects])

        def tau(values: Array) -> Array:
            at, made = 0, []
            for effect in effects:
                chosen = parameters(effect)
                made.append(unpack(effect, values[at : at + len(chosen)], chosen))
                at += len(chosen)
            return loop_with(made).run(excitation, start).tau

        def loop_with(made):
            return eqx.tree_at(lambda one: one.chain.effects, loop, tuple(made))

        self.tau = jax.jit(tau)
        self._columns = jax.jit(lambda at, basis: jax.vmap(lambda b: jax.jvp(tau, (at,), (b,))[1])(basis))

    def columns(self, values: np.ndarray, chosen: list[int]) -> np.ndarray:
        """Derivative by the chosen parameters, each in its typical size, (len(chosen), n): N."""
        parts = []
        for k in range(0, len(chosen), WIDTH):
            part = chosen[k : k + WIDTH]
            basis = np.zeros((WIDTH, len(values)))
            basis[np.arange(len(part)), part] = [PLACES[i][2] for i in part]
            parts.append(np.asarray(self._columns(values, basis))[: len(part)])
        return np.concatenate(parts)


@pytest.fixture(scope="module")
def flexible():
    return Derivatives(FLEXIBLE)


# Where the derivative is compared: usual sizes, and times and delays that lie between samples.
POINTS: dict[str, dict[str, float]] = {
    "position_gain": {"e": 0.03},
    "velocity_gain": {"e": 0.03},
    "velocity_filter": {"T": 8e-4},
    "saturation": {"limit": 3.0, "soft": 0.1},
    "amplifier_dead_zone": {"d": 0.05},
    "gain_nonlinearity": {"k": 0.01},
    "drive_gain": {"e": 0.03},
    "amplifier_lag": {"T": 8e-4},
    "time_delay": {"T": 1.3e-3},
    "cogging": {"a1": 2.0, "b1": -1.0, "a2": 0.5, "b2": 1.0},
    "asymmetric_coulomb": {"dFc": 2.0},
    "asymmetric_viscous": {"dFv": 30.0},
    "stribeck": {"dFs": 4.0},
    "quadratic_viscous": {"c": 400.0},
    "position_friction": {"c1": 2.0, "c2": -1.0, "c3": 1.0, "c4": 0.5},
    "lead_friction": {"a": 2.0, "b": 1.0},
    "local_friction": {"A": 4.0, "w": 5e-3},
    "presliding": {"share": 0.9, "T": 2e-3},
    "load_dependent_friction": {"mu": 0.05},
    "friction_drift": {"d_coulomb": 0.3, "d_viscous": 0.2},
    "coupling_damping": {"C": 300.0},
    "cubic_stiffness": {"k3": 0.03},
    "backlash": {"b": 5e-6},
    "transmission_error": {"a": 2e-6, "b": -1e-6},
    "second_flexible_mode": {"m3": 4.0},
    "payload_change": {"dm": 4.0, "t0": 0.0803},
    "encoder_periodic_error": {"a": 1e-6, "b": 5e-7},
    "base_flexibility": {"mu": 2e-3},
    "offset": {"F0": 2.0},
    "cable_spring": {"kc": 40.0},
    "disturbance_pulses": {"A": 20.0, "t0": 0.0503, "width": 0.0204, "period": 0.0708, "n": 1.0, "count": 2.5},
}


def test_every_parameter_has_a_point_to_be_compared_at():
    assert set(POINTS) == {owner for owner, _, _ in PLACES}


@pytest.mark.slow
def test_the_force_s_derivative_is_finite_at_the_null(flexible):
    columns = flexible.columns(flexible.null, list(range(len(PLACES))))
    assert np.isfinite(columns).all()
    # What only shapes an effect does nothing at its null. Of the sizes all act but those that need to be there first:
    # exp(-dt / T), a limit that is the drive's own, and a pulse after the record's end.
    silent = {f"{owner}.{name}" for (owner, name, _), c in zip(PLACES, columns, strict=True) if not c.any()}
    sizes = {f"{owner}.{next(iter(point))}" for owner, point in POINTS.items()}
    assert silent & sizes == {"velocity_filter.T", "saturation.limit", "disturbance_pulses.A"}


@pytest.mark.slow
def test_the_force_s_derivative_is_finite_at_the_null_of_a_rigid_drive():
    rigid = Derivatives(RIGID)
    assert np.isfinite(rigid.columns(rigid.null, list(range(len(PLACES))))).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", POINTS)
def test_the_force_s_derivative_is_that_of_central_differences(flexible, name):
    """Of every parameter of the effect, in its typical size: thresholds too, once the motion crosses them."""
    values = flexible.null.copy()
    chosen = [i for i, (owner, _, _) in enumerate(PLACES) if owner == name]
    for i in chosen:
        values[i] = POINTS[name].get(PLACES[i][1], values[i])
    exact = flexible.columns(values, chosen)
    for i, column in zip(chosen, exact, strict=True):
        h = 1e-4 * PLACES[i][2]
        ahead, behind = (np.asarray(flexible.tau(values + s * h * (np.arange(len(values)) == i))) for s in (1, -1))
        difference = (ahead - behind) / 2e-4
        largest = np.abs(difference).max()
        assert largest > 1e-2  # N
        # rounding of the loop, 1e-10 N, over 2e-4; truncation by a third derivative as large as 1e4 typical sizes
        np.testing.assert_allclose(column, difference, rtol=0, atol=5e-6 + 2e-4 * largest)


# -- closed forms: what acts on the masses -----------------------------------------------------------------------


def forces(out, plant=FLEXIBLE):
    """(motor, load): what acted on each mass beyond drive, coupling and the plant's own friction, N per sample."""
    motor, load = (np.asarray(row) for row in plant.inverse(out.motor, out.load))
    return motor - np.asarray(out.force), load


class Motion:
    """NumPy's view of a simulated run. What is slow in time is held for a sample, at its middle."""

    def __init__(self, out, middle=0.5 * DT) -> None:
        self.t, self.vir, self.qm = (np.asarray(x) for x in (out.t, out.vir, out.qm))
        self.q1, self.v1, self.a1 = (np.asarray(x) for x in (out.motor.q, out.motor.v, out.motor.a))
        self.q2, self.v2, self.a2 = (np.asarray(x) for x in (out.load.q, out.load.v, out.load.a))
        self.middle = self.t + middle
        self.delta = self.q2 - self.q1
        self.s1, self.s2 = np.tanh(self.v1 / V_EPS), np.tanh(self.v2 / V_EPS)
        self.phi = 2 * np.pi * self.q1 / LEAD

    def rubs(self, g, load_share):
        """A friction of size g (N) on both masses."""
        return -(1 - load_share) * g * self.s1, -load_share * g * self.s2

    def damped(self, C, eta):
        """A damper and a loss factor in the coupling of 8.8e5 N/m."""
        rate = self.v2 - self.v1
        force = C * rate + eta * 8.8e5 * np.abs(self.delta) * rate / np.hypot(rate, 1e-3)
        return force, -force

    @staticmethod
    def pushes(f, load_share):
        """f (N) against the direction of positive motion, on both masses."""
        return -(1 - load_share) * f, -load_share * f


def legendre(x, *c):
    return np.polynomial.legendre.legval(x, (0.0, *c))


def warming(t, T, D):
    return (1 - np.exp(-t / T)) / (1 - np.exp(-D / T))


X = (0.1075, 0.0075)  # middle and half of the stroke, m

# effect: sizes, and (N on the motor side, N on the load side) from the motion
LAWS: dict[str, tuple[dict[str, float], Any]] = {
    "asymmetric_coulomb": (
        {"dFc": 2.0, "v0": 1e-3, "tail": 0.6, "load_share": 0.3},
        lambda m: m.pushes(2 * np.tanh(np.abs(m.v1) / 1e-3) * (1 - 0.6e-3 / (1e-3 + np.abs(m.v1))), 0.3),
    ),
    "asymmetric_viscous": (
        {"dFv": 30.0, "v0": 5e-3, "load_share": 0.8},
        lambda m: m.pushes(30 * (np.abs(m.v1) - 5e-3 * (1 - np.exp(-np.abs(m.v1) / 5e-3))), 0.8),
    ),
    "stribeck": (
        {"dFs": 4.0, "vs": 0.01, "a": 1.5, "load_share": 0.3},
        lambda m: m.rubs(4 * np.exp(-((np.abs(m.v1) / 0.01) ** 1.5)), 0.3),
    ),
    "quadratic_viscous": ({"c": 400.0, "p": 2.0, "load_share": 1.0}, lambda m: m.rubs(400 * m.v1**2, 1.0)),
    "position_friction": (
        {"c1": 2.0, "c2": -1.0, "c3": 0.5, "c4": 1.5, "load_share": 0.0},
        lambda m: m.rubs(legendre((m.q1 - X[0]) / X[1], 2.0, -1.0, 0.5, 1.5), 0.0),
    ),
    "lead_friction": ({"a": 2.0, "b": 1.0}, lambda m: m.rubs(2 * np.sin(m.phi) + np.cos(m.phi), 0.5)),
    "local_friction": (
        {"A": 4.0, "q0": 0.105, "w": 3e-3, "load_share": 0.7},
        lambda m: m.rubs(4 * np.exp(-(((m.q1 - 0.105) / 3e-3) ** 2)), 0.7),
    ),
    "load_dependent_friction": (
        {"mu": 0.05, "preload": 20.0, "load_share": 0.9},
        lambda m: m.rubs(0.05 * (np.hypot(8.8e5 * m.delta, 20.0) - 20.0), 0.9),
    ),
    "friction_drift": (
        {"d_coulomb": 0.3, "d_viscous": 0.2, "T": 0.5},
        lambda m: (
            -warming(m.middle, 0.5, 0.3) * (0.3 * 10 * m.s1 + 0.2 * 104 * m.v1),
            -warming(m.middle, 0.5, 0.3) * (0.3 * 9.5 * m.s2 + 0.2 * 96.5 * m.v2),
        ),
    ),
    "coupling_damping": ({"C": 300.0, "eta": 0.08}, lambda m: m.damped(300.0, 0.08)),
    "cubic_stiffness": (
        {"k3": 0.05, "reach": 6e-5},
        lambda m: (
            8.8e5 * 0.05 * m.delta**3 / 5e-5**2 / (1 + (m.delta / 6e-5) ** 2),
            -8.8e5 * 0.05 * m.delta**3 / 5e-5**2 / (1 + (m.delta / 6e-5) ** 2),
        ),
    ),
    "backlash": (
        {"b": 5e-6},
        lambda m: (-8.8e5 * np.clip(m.delta, -5e-6, 5e-6), 8.8e5 * np.clip(m.delta, -5e-6, 5e-6)),
    ),
    "transmission_error": (
        {"a": 2e-6, "b": -1e-6},
        lambda m: (
            -8.8e5 * (2e-6 * np.sin(m.phi) - 1e-6 * np.cos(m.phi)),
            8.8e5 * (2e-6 * np.sin(m.phi) - 1e-6 * np.cos(m.phi)),
        ),
    ),
    "payload_change": ({"dm": 4.0, "t0": 0.1}, lambda m: (0, -4.0 * (m.t > 0.0995) * m.a2)),
    "offset": ({"F0": 3.0}, lambda m: (0, np.full(N, -3.0))),
    "cable_spring": ({"kc": 60.0, "q0": 0.104}, lambda m: (0, -60 * (m.q2 - 0.104))),
    "disturbance_pulses": (
        {"A": 20.0, "t0": 0.05, "width": 0.03, "period": 0.1, "odd": -0.5, "count": 2.0},
        lambda m: (
            0,
            20.0
            * (m.t < 0.2)
            * (np.round(m.t / DT) % 100 >= 50)
            * (np.round(m.t / DT) % 100 < 80)
            * np.where(np.round(m.t / DT) // 100 % 2 == 0, 1.0, -0.5),
        ),
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_an_effect_of_the_mechanics_is_its_equation(name):
    sizes, law = LAWS[name]
    out = run(around(FLEXIBLE, with_sizes(**{name: sizes})), v=0.02)
    expected = law(Motion(out))
    assert max(np.abs(part).max() for part in expected) > 0.3  # N: it acts
    for found, wanted in zip(forces(out), expected, strict=True):
        # K12 delta from positions rounded to 1e-17 m: 1e-11 N; the law's floor under |v|, 1e-7 m/s, less than that
        np.testing.assert_allclose(found, np.zeros(N) + wanted, rtol=0, atol=1e-9)


def test_the_power_of_speed_is_a_parameter():
    out = run(around(FLEXIBLE, with_sizes(quadratic_viscous={"c": 400.0, "p": 1.6, "load_share": 0.0})), v=0.02)
    m = Motion(out)
    np.testing.assert_allclose(forces(out)[0], -400 * 0.01 * (np.abs(m.v1) / 0.1) ** 1.6 * m.s1, rtol=0, atol=1e-9)


def test_friction_of_a_rigid_drive_grows_with_the_motor_s_force():
    out = run(around(RIGID, with_sizes(load_dependent_friction={"mu": 0.05})), v=0.02)
    own = np.asarray(RIGID.inverse(out.motor, out.load)[0]) - np.asarray(out.force)
    s = np.tanh(np.asarray(out.motor.v) / V_EPS)
    np.testing.assert_allclose(own, -0.05 * (np.hypot(out.force, 1.0) - 1.0) * s, rtol=0, atol=1e-9)


def test_pulses_of_other_shapes_have_the_impulse_of_their_shape():
    """A w, 2/pi A w, A w / 2 for a rectangle, half a sine, a raised cosine; each of the three pulses of a train."""
    for n, share in ((0.0, 1.0), (1.0, 2 / np.pi), (2.0, 0.5)):
        pulses = {"A": 20.0, "t0": 0.0503, "width": 0.0404, "period": 0.0907, "n": n}
        out = coasting(FREE_RIGID, 0.0, disturbance_pulses=pulses)
        momentum = 107 * np.asarray(out.motor.v)[[0, 45, 130, 220, -1]]
        # a rectangle's is exact, wherever its edges lie; sin^n is taken at the middle of each sample, of 40
        np.testing.assert_allclose(
            momentum, 20 * 0.0404 * share * np.array([0, 0, 1, 2, 3]), rtol=2e-3 * (n > 0) + 1e-9
        )


def test_a_pulse_s_derivative_by_its_onset_is_exact():
    """Momentum A (t - t0) within the pulse and A w behind it: -A, then 0, at any onset."""
    since = jnp.asarray(T_ALL)

    def momentum(t0: Array) -> Array:
        effect = DisturbancePulses(A=20.0, t0=t0, width=0.0304)
        return DT * jnp.cumsum(jax.vmap(lambda t: effect(t, (), held(t))[0])(since))

    for t0 in (0.1, 0.1003, 0.1009):
        value, slope = jax.jvp(momentum, (jnp.asarray(t0),), (jnp.asarray(1.0),))
        end = T_ALL + DT
        np.testing.assert_allclose(value, 20 * np.clip(end - t0, 0, 0.0304), rtol=0, atol=1e-12)
        inside, behind = (end > t0 + DT) & (end < t0 + 0.0304), end > t0 + 0.0304 + DT
        np.testing.assert_allclose(slope[inside], -20.0, rtol=1e-9)
        np.testing.assert_allclose(slope[behind], 0.0, rtol=0, atol=1e-9)


# -- closed forms: states of their own ---------------------------------------------------------------------------


def test_the_third_mass_takes_its_momentum_from_the_load():
    """M1 a1 + (M2 - m3) a2 + m3 a3 = tau at any state, and m3 swings at f3 while the load stands."""
    m3, f3, zeta = 4.0, 37.0, 0.03
    effects = with_sizes(only=("second_flexible_mode",), second_flexible_mode={"m3": m3, "f3": f3, "zeta": zeta})
    chain = Chain(Drive(GAIN), FREE_FLEXIBLE, effects)
    y, x = jnp.asarray([0.1, 0.02, 1e-5, 3e-3]), jnp.asarray([0.1003, 0.05])
    state = State(y, (x,))
    change = chain.derivative(jnp.asarray(0.0), state, chain.hold(jnp.asarray(0.0), state, jnp.asarray(2.0), DT)[0])
    a1, a2 = FREE_FLEXIBLE.accelerations(y, change.plant)
    v3, a3 = change.effects[0]
    np.testing.assert_allclose(68 * a1 + (38 - m3) * a2 + m3 * a3, 2 * GAIN, rtol=1e-12)
    w = 2 * np.pi * f3
    np.testing.assert_allclose(a3, -(w**2) * (0.1003 - 0.10001) - 2 * zeta * w * (0.05 - 0.023), rtol=1e-9)
    assert v3 == 0.05


def test_a_stiff_third_mass_is_part_of_the_load():
    """At 110 Hz, damped, under a constant force: M1 + M2 in all, once the ringing has died."""
    mode = {"m3": 6.0, "f3": 110.0, "zeta": 0.5}
    out = coasting(FREE_FLEXIBLE, 1.0, second_flexible_mode=mode, coupling_damping={"C": 5000.0})
    v = np.asarray(out.motor.v)
    np.testing.assert_allclose((v[-1] - v[100]) / (DT * (N - 101)), GAIN / (68 + 38), rtol=1e-6)


@pytest.mark.parametrize("plant", [FREE_RIGID, FREE_FLEXIBLE], ids=["rigid", "flexible"])
def test_the_frame_swings_back_under_the_motor_s_force(plant):
    """A step of force: xb' = -mu tau / wd exp(-zeta w t) sin(wd t), and what it carries is slower by that."""
    mu, f, zeta, at = 1 / 300, 24.0, 0.05, 50
    volts = np.where(np.arange(N) < at, 0.0, 1.5)
    out = coasting(plant, volts, base_flexibility={"mu": mu, "f": f, "zeta": zeta})
    t, w = np.maximum(T_ALL - DT * at, 0.0), 2 * np.pi * f
    wd, tau = w * np.sqrt(1 - zeta**2), 1.5 * GAIN
    frame = -mu * tau / wd * np.exp(-zeta * w * t) * np.sin(wd * t)
    mean = np.asarray(out.motor.v) if plant is FREE_RIGID else (68 * out.motor.v + 38 * out.load.v) / 106
    mass = 107 if plant is FREE_RIGID else 106
    # (w dt)^6 = 1e-5 per step, times 1e-4, of some 10 steps in phase
    np.testing.assert_allclose(mean, tau * t / mass - frame, rtol=0, atol=1e-7 * np.abs(frame).max())
    assert np.abs(frame).max() > 1e-3  # m/s


def test_a_frame_under_a_constant_force_stands_still():
    """It is bent from the first sample on by the force that is there, and does not ring because a record begins."""
    out = coasting(FREE_RIGID, 1.5, base_flexibility={"mu": 1 / 300})
    np.testing.assert_allclose(out.motor.a, 1.5 * GAIN / 107, rtol=1e-12)


def test_the_floor_s_friction_is_that_of_the_speed_over_the_floor():
    """xb' is found by integrating what the frame takes from the motor; the friction then follows v + xb'."""
    plant = RigidDrive(107.0, CoulombViscous(200.0, 20.0, V_EPS))
    mu, f, zeta = 1 / 300, 24.0, 0.05
    volts = 2.0 * np.sin(2 * np.pi * 11 * T_ALL)
    out = coasting(plant, volts, base_flexibility={"mu": mu, "f": f, "zeta": zeta})
    w, x, frame = 2 * np.pi * f, np.zeros(2), []
    x[0] = -mu * GAIN * volts[0] / w**2
    h = DT / 20
    for u in volts:
        frame.append((x[1], -mu * GAIN * u - w**2 * x[0] - 2 * zeta * w * x[1]))
        for _ in range(20):  # Heun
            k1 = np.array([x[1], -mu * GAIN * u - w**2 * x[0] - 2 * zeta * w * x[1]])
            y = x + h * k1
            x = x + 0.5 * h * (k1 + np.array([y[1], -mu * GAIN * u - w**2 * y[0] - 2 * zeta * w * y[1]]))
    speed, acceleration = np.array(frame).T
    over_floor = np.asarray(out.motor.v) + speed
    force = 107 * (np.asarray(out.motor.a) + acceleration) + 200 * over_floor + 20 * np.tanh(over_floor / V_EPS)
    # Heun: (w h)^2 = 6e-5, of the frame's part of the force, 50 N
    np.testing.assert_allclose(force, GAIN * volts, rtol=0, atol=1e-2)


# -- closed forms: the bristle -----------------------------------------------------------------------------------

Z_S = 3e-4
BRISTLE_PLANT = RigidDrive(107.0, CoulombViscous(0.0, 20.0, V_EPS))


def bristle(out) -> np.ndarray:
    """Friction force (N) that the drive felt: the plant's own and what the effect makes of it."""
    return np.asarray(out.force) - 107 * np.asarray(out.motor.a)


def test_a_bristle_bends_with_the_path_and_then_slides_at_coulomb_s_force():
    """F = Fc (1 - exp(-x / z_s)) along a motion that does not turn, at whatever speed: Dahl's curve."""
    out = coasting(BRISTLE_PLANT, 1.2, presliding={"share": 1.0, "z_s": Z_S})  # 42 N against 20
    path = np.asarray(out.motor.q) - 0.1
    assert path[-1] > 20 * Z_S and np.all(np.diff(path) > 0)
    # Tsit5: (v dt / z_s)^6 where z still moves, v dt < 0.2 z_s
    np.testing.assert_allclose(bristle(out), 20 * -np.expm1(-path / Z_S), rtol=0, atol=2e-4)
    np.testing.assert_allclose(bristle(out)[path > 15 * Z_S], 20.0, rtol=0, atol=1e-4)


def test_below_break_away_a_bristle_holds():
    """The drive goes no further than the work of the force allows, F x = Fc (x - z_s (1 - exp(-x / z_s))), and back;
    with Coulomb friction of a smooth sign it creeps on for ever."""
    F = 6.0
    held = np.asarray(coasting(BRISTLE_PLANT, F / GAIN, presliding={"share": 1.0, "z_s": Z_S}).motor.q) - 0.1
    x = np.linspace(0, 5 * Z_S, 20001)[1:]
    farthest = x[np.argmax(20 * (x + Z_S * np.expm1(-x / Z_S)) > F * x)]
    assert held.max() == pytest.approx(farthest, rel=1e-3)
    assert held[-1] < 0.9 * farthest  # it springs back
    creeping = np.asarray(coasting(BRISTLE_PLANT, F / GAIN).motor.q) - 0.1
    assert creeping[-1] > farthest and np.all(np.diff(creeping) > 0)


def test_a_bent_bristle_pulls_at_rest_too_and_stays_calm_at_any_speed():
    effect = Presliding(share=1.0, z_s=Z_S)
    rest = signals(level1=20.0, dt=DT)
    made, rate = effect(jnp.asarray(0.0), jnp.asarray([8.0, 0.0]), rest)
    assert isinstance(made, Forces)
    # it stands in for all of Coulomb's friction
    assert (float(made.motor), float(made.grip_motor), float(rate[0])) == (pytest.approx(-8.0), -20.0, 0.0)
    for v in (1.0, -5.0, 100.0):  # two per sample at the most, where explicit steps of one sample are stable
        fast = signals(v1=v, s1=np.sign(v), coulomb1=20 * np.sign(v), level1=20.0, dt=DT)
        slope = jax.jacobian(lambda F, fast=fast: effect(jnp.asarray(0.0), F, fast)[1])(jnp.zeros(2))
        assert np.all(np.diag(slope) > -2.0001 / DT) and np.all(np.diag(slope) < 0)


def test_a_bristle_takes_in_what_other_effects_add_to_friction_on_its_own_travel():
    """Between screw and nut g = Fc + b cos(2 pi q / lead) varies on the way: dF/dq = sigma0 (1 - F / g), one way."""
    lead, b = 2.5e-3, 6.0
    out = coasting(
        BRISTLE_PLANT,
        1.2,
        lead_friction={"a": 0.0, "b": b, "lead": lead, "load_share": 0.0},
        presliding={"share": 1.0, "z_s": Z_S},
    )
    q = np.asarray(out.motor.q)
    slope = lambda x, F: 20 / Z_S * (1 - F / (20 + b * np.cos(2 * np.pi * x / lead)))  # noqa: E731
    expected = scipy.integrate.solve_ivp(slope, (q[0], q[-1]), [0.0], t_eval=q, rtol=1e-9, atol=1e-9).y[0]
    np.testing.assert_allclose(bristle(out), expected, rtol=0, atol=2e-2)
    plain = 20 + b * np.cos(2 * np.pi * q / lead)
    assert np.max(np.abs(expected - plain)[q > q[0] + 10 * Z_S]) > 2.0  # it lags: no function of position


def test_a_bristle_never_pushes():
    """Where other effects take away more than Coulomb's friction, nothing grips."""
    less = signals(v1=0.05, s1=1.0, coulomb1=20.0, level1=20.0, grip1=-26.0, dt=DT)
    made, rate = Presliding(share=1.0, z_s=Z_S)(jnp.asarray(0.0), jnp.zeros(2), less)
    assert (float(made.motor), float(made.grip_motor), float(rate[0])) == (0.0, 0.0, 0.0)
    assert float(Presliding().init(signals(s1=1.0, level1=-3.0, dt=DT))[0]) == 0.0


@pytest.mark.parametrize("friction", [CoulombViscous(5.0, 20.0), AsymmetricCoulombViscous(5.0, 20.0, 7.0, 26.0)])
def test_the_level_of_friction_is_coulomb_s_part_without_its_sign(friction):
    v = jnp.asarray([-0.3, -1e-3, 1e-4, 0.02])
    np.testing.assert_allclose(friction.level(v) * jnp.tanh(v / 1e-3), friction.split(v)[1], rtol=1e-14)
    assert float(friction.level(jnp.zeros(()))) == pytest.approx(20.0 if isinstance(friction, CoulombViscous) else 23.0)


# -- closed forms: actuator --------------------------------------------------------------------------------------

STEP = np.where(np.arange(N) < 100, 0.5, 2.5)  # V
WAVE = 4 * np.sin(2 * np.pi * 7 * T_ALL)


@pytest.mark.parametrize("T", [2.3e-3, 0.4e-3, 3e-5])
def test_an_amplifier_s_lag_keeps_the_force_s_impulse(T):
    """M v = u0 t + (u1 - u0) (t' - T (1 - exp(-t' / T))) after a step of the held command, and F ends at g u1."""
    out = coasting(FREE_RIGID, STEP, amplifier_lag={"T": T})
    since = np.maximum(T_ALL - 0.1, 0)
    momentum = GAIN * (0.5 * T_ALL + 2 * (since + T * np.expm1(-since / T)))
    np.testing.assert_allclose(107 * np.asarray(out.motor.v), momentum, rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.asarray(out.force)[[0, 99, -1]], GAIN * STEP[[0, 99, -1]], rtol=1e-12)


@pytest.mark.parametrize("T", [0.4e-3, 1e-3, 2.3e-3, 6e-3])
def test_a_delay_shifts_the_force_s_impulse(T):
    """M v = u0 t + (u1 - u0) (t' - T) after a step of the held command, at the ends of samples behind it."""
    out = coasting(FREE_RIGID, STEP, time_delay={"T": T})
    since = T_ALL - 0.1 - T
    momentum = GAIN * (0.5 * T_ALL + 2 * np.maximum(since, 0))
    settled = (since <= -DT) | (since >= DT)  # in the sample where it arrives its mean acts from the beginning on
    np.testing.assert_allclose(107 * np.asarray(out.motor.v)[settled], momentum[settled], rtol=0, atol=1e-10)
    k = int(T / DT + 1e-9)
    share = 1 + k - T / DT
    felt = 0.5 + 2 * np.where(np.arange(N) < 100 + k, 0.0, np.where(np.arange(N) == 100 + k, share, 1.0))
    np.testing.assert_allclose(out.force, GAIN * felt, rtol=1e-11)


def test_a_delay_is_six_samples_at_most():
    (effect,) = (effect for effect in with_sizes(time_delay={"T": 6e-3}) if effect.label() == "time_delay")
    past = jnp.arange(1.0, 7.0)
    contribution, following = effect(jnp.asarray(0.0), past, signals(incoming=10.0, dt=2.5e-4))
    assert float(contribution) == -4.0  # the oldest value, 6, for the incoming 10
    np.testing.assert_array_equal(following, [10.0, 1.0, 2.0, 3.0, 4.0, 5.0])


STATIC: dict[str, tuple[dict[str, float], Any]] = {
    "saturation": ({"limit": 2.7}, lambda u: np.clip(u, -2.7, 2.7)),
    "amplifier_dead_zone": ({"d": 0.2}, lambda u: u - np.clip(u, -0.2, 0.2)),
    "gain_nonlinearity": ({"k": 0.02}, lambda u: u * (1 - 0.02 * np.abs(u))),
    "drive_gain": ({"e": 0.05}, lambda u: 1.05 * u),
}


@pytest.mark.parametrize("name", STATIC)
def test_the_drive_s_force_is_a_function_of_its_command(name):
    sizes, law = STATIC[name]
    out = coasting(FREE_RIGID, WAVE, **{name: sizes})
    np.testing.assert_array_equal(out.vir, WAVE)  # recorded before
    np.testing.assert_allclose(out.force, GAIN * law(WAVE), rtol=0, atol=1e-12)
    np.testing.assert_allclose(107 * np.asarray(out.motor.a), out.force, rtol=0, atol=1e-12)


def test_a_drive_s_gain_cannot_be_seen():
    """M, Fv and Fc in the same ratio take it in: the record is the same."""
    heavier = RigidDrive(107.0 * 1.05, CoulombViscous(200.0 * 1.05, 20.0 * 1.05, V_EPS))
    one, two = run(around(heavier, with_sizes(drive_gain={"e": 0.05}))), run(around(RIGID, with_sizes()))
    np.testing.assert_allclose(one.tau, two.tau, rtol=0, atol=1e-8)


SLOTS = {"a1": 2.0, "b1": -1.0, "a2": 0.5, "b2": 1.0}


def slots(q):
    phi = 2 * np.pi * q / LEAD
    return -(2 * np.sin(phi) - np.cos(phi) + 0.5 * np.sin(2 * phi) + np.cos(2 * phi))


@pytest.mark.parametrize("q", LEAD * np.array([0.0, 0.13, 0.6]))
def test_cogging_at_rest_pulls_by_the_angle(q):
    out = coasting(FREE_RIGID, 0.0, q=q, cogging=SLOTS)
    np.testing.assert_allclose(out.motor.a[0], slots(q) / 107, rtol=1e-12)


def test_cogging_at_speed_is_a_line_at_v_over_lead_that_does_not_flip():
    """At 50 mm/s 20 Hz and 40 Hz, of the coefficients' size, in both directions alike."""
    for v in (0.05, -0.05):
        out = coasting(RigidDrive(1e7, FREE), 0.0, v=v, cogging=SLOTS)  # heavy: the speed stays
        np.testing.assert_allclose(out.force, slots(0.1 + v * T_ALL), rtol=0, atol=1e-4)
        lines = np.fft.rfft(out.force)[[6, 12]] / (N / 2)  # 0.3 s: 20 Hz is the sixth
        np.testing.assert_allclose(np.abs(lines), [np.hypot(2, 1), np.hypot(0.5, 1)], rtol=1e-3)


# -- closed forms: sensor and controller -------------------------------------------------------------------------


def law(out, qg=None, ep=0.0, ev=0.0, filtered=lambda dq: dq, v=0.02):
    """vir = kv (1 + ev) (kp (1 + ep) (qg - qm) - dq), V, from the recorded positions."""
    qm = np.asarray(out.qm)
    past = np.concatenate([qm[0] - v * DT * np.array([2, 1]), qm])  # a start settled at v
    dq = filtered((past[2:] - past[:-2]) / (2 * DT))
    return KV * (1 + ev) * (KP * (1 + ep) * (reference() - qm) - dq)


@pytest.mark.parametrize(("ep", "ev"), [(0.03, 0.0), (0.0, -0.04), (0.03, -0.04)])
def test_wrong_gains_of_the_controller(ep, ev):
    out = run(around(FLEXIBLE, with_sizes(position_gain={"e": ep}, velocity_gain={"e": ev})), v=0.02)
    np.testing.assert_allclose(out.vir, law(out, ep=ep, ev=ev), rtol=0, atol=1e-10)


@pytest.mark.parametrize("T", [4e-4, 2e-3])
def test_the_filter_on_the_velocity_is_scipy_s(T):
    """Settled at the first sample, though the drive moves; and the velocity loop's gain is behind it."""
    a = np.exp(-DT / T)
    out = run(around(FLEXIBLE, with_sizes(velocity_filter={"T": T}, velocity_gain={"e": 0.03})), v=0.02)

    def filtered(dq):
        return lfilter([1 - a], [1, -a], dq, zi=[a * dq[0]])[0]

    np.testing.assert_allclose(out.vir, law(out, ev=0.03, filtered=filtered), rtol=0, atol=1e-10)
    assert np.abs(out.vir - law(out, ev=0.03)).max() > 0.05  # V


def test_the_encoder_s_periodic_error_is_in_what_it_measures():
    out = run(around(FLEXIBLE, with_sizes(encoder_periodic_error={"a": 2e-6, "b": -1e-6})), v=0.02)
    m = Motion(out)
    np.testing.assert_allclose(m.qm - m.q1, 2e-6 * np.sin(m.phi) - 1e-6 * np.cos(m.phi), rtol=0, atol=1e-15)


def test_the_encoder_counts_what_it_reads_with_its_error():
    sizes = {"encoder_periodic_error": {"a": 2e-6, "b": 0.0}, "encoder_quantisation": {"resolution": 1e-6}}
    m = Motion(run(around(FLEXIBLE, with_sizes(**sizes))))
    seen = m.q1 + 2e-6 * np.sin(m.phi)
    assert np.abs(m.qm - seen).max() < 0.5e-6 * (1 + 1e-9)
    np.testing.assert_allclose(m.qm / 1e-6, np.round(m.qm / 1e-6), rtol=0, atol=1e-9)
    assert any(effect is EncoderGrid for effect in CATALOGUE)


# -- pulses that stand out of a record ---------------------------------------------------------------------------


def test_a_train_of_pulses_is_found_in_what_is_left_over():
    rng = np.random.default_rng(0)
    k = np.arange(2000)
    force = 0.5 * rng.normal(size=2000) - 12.0 * ((k >= 300) & ((k - 300) % 500 < 60))
    trains = pulses_in(force, DT)
    assert any(np.allclose(train[:5], (-12.0, 0.3, 0.06, 0.5, 1.0), rtol=0.05) for train in trains), trains
    assert pulses_in(np.zeros(2000), DT) == []


def test_pulses_whose_signs_alternate_are_one_train():
    rng = np.random.default_rng(1)
    k = np.arange(2000)
    sign = np.where((k - 300) // 500 % 2 == 0, 1.0, -1.0)
    force = 0.5 * rng.normal(size=2000) - 12.0 * sign * ((k >= 300) & (k < 1500) & ((k - 300) % 500 < 60))
    trains = pulses_in(force, DT)
    assert any(np.allclose(train, (-12.0, 0.3, 0.06, 0.5, -1.0, 3.0), rtol=0.05) for train in trains), trains


# -- the continuous loop -----------------------------------------------------------------------------------------


def test_effects_without_a_sampled_state_act_in_the_continuous_loop_too():
    """The whole rest of the catalogue in one continuous loop: nothing at its null, its equation beyond."""
    rest = tuple(name for name in NAMES if name not in STATEFUL_SAMPLED)

    def continuous(**sizes):
        return run(around(FLEXIBLE, with_sizes(only=rest, **sizes), sampled=False), v=0.02)

    np.testing.assert_allclose(continuous().tau, run(around(FLEXIBLE, sampled=False), v=0.02).tau, rtol=0, atol=1e-8)
    for name, (sizes, equation) in LAWS.items():
        out = continuous(**{name: sizes})
        motion = Motion(out, middle=0.0)
        away = np.ones(N, dtype=bool)
        if name in {"payload_change", "disturbance_pulses"}:  # a step is spread over one sample about its instant
            away[[50, 80, 100, 150, 180, 250, 280]] = False
        for found, wanted in zip(forces(out), equation(motion), strict=True):
            np.testing.assert_allclose(found[away], (np.zeros(N) + wanted)[away], rtol=0, atol=1e-9, err_msg=name)
    out = continuous(saturation={"limit": 3.0}, position_gain={"e": 0.03}, velocity_gain={"e": 0.02})
    volts = KV * 1.02 * (KP * 1.03 * (reference() - np.asarray(out.motor.q)) - np.asarray(out.motor.v))
    np.testing.assert_allclose(out.vir, volts, rtol=0, atol=1e-10)
    np.testing.assert_allclose(out.force, GAIN * np.clip(volts, -3, 3), rtol=0, atol=1e-9)


@pytest.mark.parametrize("effect", CATALOGUE, ids=NAMES)
def test_only_a_state_that_moves_once_per_sample_needs_a_sampled_loop(effect):
    made = effect.at(BENCH)
    needs = acts_once_per_sample(made) and bool(jax.tree.leaves(made.init(signals())))
    assert needs is (effect.label() in STATEFUL_SAMPLED)
    if needs:
        with pytest.raises(ValueError, match=rf"{effect.__name__} keeps a state between samples.*SampledLoop"):
            run(around(RIGID, (made,), sampled=False))


# -- a file of one's own -----------------------------------------------------------------------------------------

OWN = """
from typing import ClassVar

import jax.numpy as jnp

import didim_jax as dj


class AbstractOwn(dj.AbstractEffect):
    pass


class Wind(AbstractOwn):
    \"\"\"A force that swings; null A = 0.\"\"\"

    block: ClassVar[dj.Block] = dj.Block.ENVIRONMENT
    name: ClassVar[str] = "wind"
    equation: ClassVar[str] = "A cos(w t)"
    A: float = dj.param("N", scale=2.0, default=0.0)
    w: float = dj.param("rad/s", scale=1.0, default=10.0)

    def init(self, signals):
        return jnp.zeros(2)

    def __call__(self, t, x, signals):
        return self.A * jnp.cos(self.w * t), jnp.zeros(2)
"""


def own(tmp_path, old="", new="", text=OWN):
    assert text.count(old) == 1 or not old
    path = tmp_path / "my_effects.py"
    path.write_text(text.replace(old, new) if old else text)
    return path


def test_effects_of_one_s_own_join_those_of_the_catalogue(tmp_path):
    (wind,) = load(own(tmp_path))
    assert wind.label() == "wind" and wind.block is Block.ENVIRONMENT
    assert [path.name for path in tmp_path.iterdir()] == ["my_effects.py"]
    out = run(around(FLEXIBLE, (wind(A=3.0, w=20.0), *with_sizes())), v=0.02)
    np.testing.assert_allclose(forces(out)[1], 3 * np.cos(20 * T_ALL), rtol=0, atol=1e-9)


def test_annotations_may_be_strings(tmp_path):
    (wind,) = load(own(tmp_path, text="from __future__ import annotations\n" + OWN))
    assert [p.name for p in parameters(wind())] == ["A", "w"]


CALL = "return self.A * jnp.cos(self.w * t), jnp.zeros(2)"

MISTAKES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "syntax": ("class Wind(AbstractOwn):", "class Wind(AbstractOwn)", (", line 13", "SyntaxError")),
    "import": ("import jax.numpy as jnp", "import jax.nunpy as jnp", (", line 4", "ModuleNotFoundError", "nunpy")),
    "exit": ("import jax.numpy as jnp", "raise SystemExit(3)", (", line 4", "SystemExit")),
    "no effect": ("class Wind(AbstractOwn):", "class Wind:", ("no effect in it", "didim_jax.AbstractEffect")),
    "no call": ("def __call__", "def call", ("no effect in it", "__call__")),
    "no block": ("block: ClassVar[dj.Block] = dj.Block.ENVIRONMENT", "", ("Wind", "block = Block.")),
    "wrong block": ("dj.Block.ENVIRONMENT", "'environment'", ("Wind", "block = Block.")),
    "sampled off the actuator": (
        'name: ClassVar[str] = "wind"',
        "sampled: ClassVar[bool] = True",
        ("Wind is sampled", "environment"),
    ),
    "taken": ('= "wind"', '= "offset"', ("Wind", "'offset'", "the catalogue")),
    "no default": ('"N", scale=2.0, default=0.0', '"N", scale=2.0', ("Wind cannot be made", "'A'")),
    "not null": ("scale=2.0, default=0.0", "scale=2.0, default=1.5", ("Wind adds 1.1", "at its defaults", "null")),
    "nan": (CALL, "return self.A / self.A, x", ("Wind adds nan", "null")),
    "no derivative": (CALL, "return jnp.sqrt(self.A), x", ("Wind", "no finite derivative by A")),
    "array": (CALL, "return self.A * jnp.ones(3), x", ("Wind", "shape (3,)")),
    "state": (CALL, "return self.A * t, jnp.zeros(1)", ("Wind", "state's shape")),
    "fails": (CALL, "return self.B * t, x", ("Wind fails", "AttributeError", "'B'")),
    "forces where volts belong": (
        "dj.Block.ENVIRONMENT",
        "dj.Block.CONTROLLER",
        ("Wind", "one number, not Forces"),
    ),
}


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_in_it_is_said_in_one_line(tmp_path, old, new, words):
    path = own(tmp_path, old, new)
    if "not Forces" in words[-1]:
        path = own(tmp_path, CALL, "return dj.Forces(motor=self.A), x", text=path.read_text())
    with pytest.raises(InputError) as error:
        load(path)
    said = str(error.value)
    assert said.startswith(str(path)) and len(said.splitlines()) == 1
    assert [word for word in words if word not in said] == [], said


def test_two_effects_of_one_name_and_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"Breeze: the name 'wind' is taken by Wind"):
        load(own(tmp_path, text=OWN + "\nclass Breeze(Wind):\n    pass\n"))
    with pytest.raises(InputError, match=r"nowhere\.py: no such file"):
        load(tmp_path / "nowhere.py")
    with pytest.raises(InputError, match="cannot be read"):
        load(tmp_path)


def test_an_effect_of_the_mechanics_may_add_forces_on_several_blocks():
    class Twist(AbstractEffect):
        block: ClassVar[Block] = Block.MOTOR_SIDE
        p: Array

        def __call__(self, t, x, signals):
            return Forces(motor=self.p, load=-2 * self.p, payload=0.0 * self.p), x

    out = run(around(FLEXIBLE, (Twist(jnp.asarray(3.0)),)), v=0.02)
    motor, load_side = forces(out)
    np.testing.assert_allclose(motor, 3.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(load_side, -6.0, rtol=0, atol=1e-9)
