"""A plant is the paper's equations 2-9: its direct and inverse models are one, it keeps energy, and its limits hold."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from didim_jax.chain import Chain
from didim_jax.control import ContinuousPD, Drive
from didim_jax.params import names, pack, param, parameters, part, select, unpack, values
from didim_jax.plant import (
    AbstractFriction,
    AsymmetricCoulombViscous,
    Axis,
    CoulombViscous,
    FlexibleDrive,
    RigidDrive,
    mass_ratio,
    mode,
    smooth_sign,
    split,
)
from didim_jax.simulate import ContinuousLoop, Excitation, Start, simulate

EPS = np.finfo(float).eps
SYMMETRIC = CoulombViscous(104.0, 10.0)
ASYMMETRIC = AsymmetricCoulombViscous(104.0, 10.0, 120.0, 13.0)
LOAD = CoulombViscous(96.5, 9.5)

RIGID = RigidDrive(107.0, SYMMETRIC, 3.0)
FLEXIBLE = FlexibleDrive(68.0, SYMMETRIC, 38.0, LOAD, 8.8e5, 3.0)
PLANTS = {
    "rigid": RIGID,
    "rigid, asymmetric": RigidDrive(107.0, ASYMMETRIC, 3.0),
    "flexible": FLEXIBLE,
    "flexible, asymmetric": FlexibleDrive(68.0, ASYMMETRIC, 38.0, ASYMMETRIC, 8.8e5, 3.0),
}
each_plant = pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS.keys())


# -- direct and inverse ------------------------------------------------------------------------------------------


def motion(plant, y, tau, **forces):
    """Axes of both sides at a state, as the direct model moves them."""
    q1, v1, q2, v2 = plant.sides(y)
    a1, a2 = plant.accelerations(y, plant.vector_field(y, tau, **forces))
    return Axis(q1, v1, a1), Axis(q2, v2, a2)


def random_states(plant, n=200):
    """States of the size met on the drive, with speeds on both sides of the smooth sign's scale, and motor forces."""
    rng = np.random.default_rng(1)
    sizes = {"q1": 0.2, "v1": 0.05, "delta": 1e-4, "ddelta": 5e-3}
    y = np.stack([sizes[name] * rng.normal(size=n) for name in plant.state_names], axis=1)
    y[::3, 1] *= 0.01
    return jnp.asarray(y), jnp.asarray(200 * rng.normal(size=n))


def there_and_back(plant, y, tau):
    """Rows of the inverse model along the direct model's motion, one column per state."""
    return jax.vmap(lambda y, tau: plant.inverse(*motion(plant, y, tau)))(y, tau)


# K12 (q2 - q1) loses the digits of q: 8.8e5 N/m times one rounding of 0.5 m is 5e-11 N, beside forces of 200 N
INVERSE = {"rtol": 0, "atol": 2e-10}


@each_plant
def test_the_inverse_model_gives_the_force_of_the_direct_one_back(plant):
    y, tau = random_states(plant)
    motor_force, *balances = there_and_back(plant, y, tau)
    np.testing.assert_allclose(motor_force, tau, **INVERSE)
    for balance in balances:
        np.testing.assert_allclose(balance, np.zeros(len(tau)), **INVERSE)
    assert len(balances) == {"rigid": 0, "flexible": 1}[plant.model]


@each_plant
def test_without_a_large_position_the_force_comes_back_to_the_last_digits(plant):
    """At q1 = 0 the deflection loses nothing, so 1e-12 of the largest force is algebra alone."""
    y, tau = random_states(plant)
    rows = there_and_back(plant, y.at[:, 0].set(0.0), tau)
    expected = [tau, np.zeros(len(tau))][: len(rows)]
    np.testing.assert_allclose(rows, expected, rtol=0, atol=1e-12 * np.abs(tau).max())


@each_plant
def test_forces_from_outside_enter_where_they_say(plant):
    """A force on one side appears in that side's row, one in the coupling in both, the frame as -M a."""
    flexible = plant.model == "flexible"
    y, tau = (x[0] for x in random_states(plant))
    masses = (plant.M1, plant.M2) if flexible else (plant.M,)
    expected = {
        "on_motor": (7.0, 0.0),
        "on_coupling": (7.0, -7.0) if flexible else (0.0,),
        "on_load": (0.0, 7.0) if flexible else (7.0,),
        "frame": tuple(-7.0 * M for M in masses),
    }
    for name, added in expected.items():
        rows = plant.inverse(*motion(plant, y, tau, **{name: 7.0}))
        np.testing.assert_allclose(rows[0], tau + added[0], **INVERSE, err_msg=name)
        if flexible:
            np.testing.assert_allclose(rows[1], added[1], **INVERSE, err_msg=name)


def test_the_offset_opposes_the_motor_and_friction_opposes_the_motion():
    still = jnp.zeros(2)
    assert float(RIGID.vector_field(still, 0.0)[1]) == -3.0 / 107.0
    assert float(FLEXIBLE.vector_field(jnp.zeros(4), 0.0)[1]) == -3.0 / 68.0
    for friction in (SYMMETRIC, ASYMMETRIC, LOAD):
        v = jnp.linspace(-0.1, 0.1, 41)
        F = np.asarray(friction(v))
        assert np.all(F * np.asarray(v) >= 0)
        assert np.all(np.diff(F) > 0)


# -- friction ----------------------------------------------------------------------------------------------------


def test_asymmetric_friction_with_equal_sides_is_the_symmetric_one():
    v = jnp.concatenate([jnp.linspace(-0.2, 0.2, 1001), jnp.linspace(-3e-3, 3e-3, 1001)])
    one = AsymmetricCoulombViscous(104.0, 10.0, 104.0, 10.0)(v)
    np.testing.assert_allclose(one, SYMMETRIC(v), rtol=8 * EPS)  # two products and a sum more: a few roundings


def test_each_side_of_asymmetric_friction_holds_in_its_direction():
    v = jnp.asarray([0.03, 0.1])  # 30 v_eps and more: tanh is 1 to the last digit
    np.testing.assert_allclose(ASYMMETRIC(v), 104.0 * v + 10.0, rtol=4 * EPS)
    np.testing.assert_allclose(ASYMMETRIC(-v), -(120.0 * v + 13.0), rtol=4 * EPS)


def test_the_smooth_sign_is_the_sign_away_from_rest_and_its_speed_is_that_of_tanh_1():
    v = np.array([-0.5, -0.02, 0.0, 0.02, 0.5])
    np.testing.assert_array_equal(smooth_sign(jnp.asarray(v), 1e-3), np.sign(v))
    assert float(smooth_sign(jnp.asarray(1e-3), 1e-3)) == pytest.approx(np.tanh(1.0), rel=4 * EPS)


def with_v_eps(plant, v_eps):
    """The same plant with another smoothing speed (m/s) in all its frictions."""
    frictions = [x for x in jax.tree.leaves(plant, is_leaf=is_friction) if is_friction(x)]
    assert len(frictions) == (2 if plant.model == "flexible" else 1)

    def change(x):
        return eqx.tree_at(lambda f: f.v_eps, x, jnp.asarray(v_eps)) if is_friction(x) else x

    return jax.tree.map(change, plant, is_leaf=is_friction)


def is_friction(x):
    return isinstance(x, AbstractFriction)


def around(plant, *, kp=160.18, kv=243.45, substeps=1):
    """The drive under the continuous law."""
    return ContinuousLoop(ContinuousPD(kp, kv), Chain(Drive(35.15), plant), substeps=substeps)


def excite(qg, dt, injected=None):
    n = len(qg)
    return Excitation(jnp.asarray(dt), jnp.asarray(qg), jnp.asarray(np.zeros(n) if injected is None else injected))


def test_the_simulated_force_tends_to_that_of_the_hard_sign():
    """Through reversals, the motor force differs the less from that of the smallest v_eps, the smaller v_eps."""
    dt, n = 1e-3, 1000
    t = dt * np.arange(n)
    qg = 0.1 + 0.02 * (1 - np.cos(2 * np.pi * 3 * t))
    assert np.sum(np.diff(np.sign(np.diff(qg))) != 0) >= 5
    drive = excite(qg, dt)
    forces = {}
    for v_eps in (1e-1, 1e-2, 1e-3, 1e-4, 1e-5):
        # friction at rest is as stiff as Fc/(M v_eps) = 1e4/s at the smallest: 20 steps per sample keep it stable
        loop = around(with_v_eps(RIGID, v_eps), substeps=20)
        run = simulate(loop, drive, loop.start(qg[0], 0.0, dt))
        assert bool(run.ok)
        forces[v_eps] = np.asarray(run.tau)
    hardest = forces.pop(1e-5)
    errors = [np.sqrt(np.mean((force - hardest) ** 2)) for force in forces.values()]
    assert np.all(np.diff(errors) < 0), errors
    assert errors[0] > 1.0  # N: a tenth of a metre per second is most of the speed, so friction is far off
    assert errors[-1] < 0.05 * errors[0], errors  # a crossing lasts v_eps/a: at worst sqrt(v_eps), 0.03 in 3 decades


# -- mass ratio, mode, stiffness ---------------------------------------------------------------------------------


def test_split_gives_the_values_printed_in_the_paper():
    """Tables 2 and 3, without payload: 107 kg, 0.62, 23.85 Hz give 66.3 kg, 40.7 kg, 9.13e5 N/m, digits as printed."""
    M1, M2, K12 = map(float, split(107.0, 0.62, 23.85))
    assert (f"{M1:.1f}", f"{M2:.1f}", f"{K12:.2e}") == ("66.3", "40.7", "9.13e+05")
    as_printed_in_equation_29 = 4 * np.pi**2 * (1 - 0.62) * 23.85 * 107.0
    assert pytest.approx(as_printed_in_equation_29 * 23.85) == K12


@pytest.mark.parametrize(("M", "lam", "f_n"), [(107.0, 0.62, 23.85), (117.0, 0.57, 20.89), (30.0, 0.05, 80.0)])
def test_split_mode_and_mass_ratio_are_inverse_to_each_other(M, lam, f_n):
    M1, M2, K12 = split(M, lam, f_n)
    np.testing.assert_allclose([M1 + M2, mass_ratio(M1, M2), mode(M2, K12)], [M, lam, f_n], rtol=8 * EPS)
    np.testing.assert_allclose(split(M1 + M2, mass_ratio(M1, M2), mode(M2, K12)), [M1, M2, K12], rtol=32 * EPS)


FREE = CoulombViscous(0.0, 0.0)


def coast(plant, y0, *, n=1000, dt=1e-3, volts=0.0, substeps=4):
    """The drive without control, from a state, under constant volts."""
    loop = around(plant, kp=0.0, kv=0.0, substeps=substeps)
    run = simulate(loop, excite(np.zeros(n), dt, np.full(n, volts)), Start(jnp.asarray(y0), jnp.zeros(0)))
    assert bool(run.ok)
    return run


def test_the_mode_is_that_of_the_load_with_the_motor_locked():
    """With a motor side that cannot move, the load swings at f_n, and at no other frequency."""
    M2, K12 = 38.0, 8.8e5
    f_n = float(mode(M2, K12))
    run = coast(FlexibleDrive(1e15, FREE, M2, FREE, K12), [0.0, 0.0, 1e-4, 0.0])
    expected = 1e-4 * np.cos(2 * np.pi * f_n * np.asarray(run.t))
    # Tsit5, order 5, w h = 0.04: an error of some 1e-4 (w h)^6 = 4e-13 per step, over 4000 steps, with room
    np.testing.assert_allclose(np.asarray(run.load.q), expected, rtol=0, atol=1e-4 * 1e-8)


def energy(plant, run):
    """Kinetic energy of both masses and that of the spring, J."""
    delta = np.asarray(run.load.q) - np.asarray(run.motor.q)
    v1, v2 = np.asarray(run.motor.v), np.asarray(run.load.v)
    return 0.5 * float(plant.M1) * v1**2 + 0.5 * float(plant.M2) * v2**2 + 0.5 * float(plant.K12) * delta**2


UNDAMPED = FlexibleDrive(68.0, FREE, 38.0, FREE, 8.8e5)


def test_the_free_undamped_drive_keeps_its_energy_and_momentum():
    run = coast(UNDAMPED, [0.01, 0.02, 1e-4, 3e-3])
    E = energy(UNDAMPED, run)
    # w h = 190/s * 0.25 ms = 0.05: some 1e-4 (w h)^6 of the swing's energy per step, over 4000 steps, with room
    np.testing.assert_allclose(E, E[0], rtol=1e-8)
    p = 68.0 * np.asarray(run.motor.v) + 38.0 * np.asarray(run.load.v)
    np.testing.assert_allclose(p, p[0], rtol=1e-12)  # linear in the state: any Runge-Kutta step keeps it to rounding
    swing = np.asarray(run.load.v) - np.asarray(run.motor.v)
    assert np.ptp(swing) > 0.02  # m/s: it does swing


def test_the_motor_s_work_is_the_energy_gained():
    run = coast(UNDAMPED, [0.0, 0.0, 0.0, 0.0], volts=2.0)
    work = 2.0 * 35.15 * np.asarray(run.motor.q)  # a constant force, so its work is force times way
    np.testing.assert_allclose(energy(UNDAMPED, run), work, rtol=0, atol=1e-10 * work[-1])
    np.testing.assert_array_equal(run.force, 70.3)


def test_friction_takes_the_energy_that_viscous_damping_takes():
    """Equal damping rates Fv/M on both sides damp every motion as exp(-r t): a closed form for both masses."""
    r = 2.0
    plant = FlexibleDrive(68.0, CoulombViscous(68.0 * r, 0.0), 38.0, CoulombViscous(38.0 * r, 0.0), 8.8e5)
    run = coast(plant, [0.0, 0.05, 0.0, 0.0])
    t = np.asarray(run.t)
    for side in (run.motor, run.load):  # both start at one speed, so the spring stays slack
        np.testing.assert_allclose(side.v, 0.05 * np.exp(-r * t), rtol=1e-12)  # r h = 5e-4: far below rounding
        np.testing.assert_allclose(side.q, 0.05 * (1 - np.exp(-r * t)) / r, rtol=0, atol=1e-14)


def test_the_flexible_drive_tends_to_the_rigid_one_as_one_over_the_stiffness():
    dt, n = 2e-4, 1500
    t = dt * np.arange(n)
    s = np.clip(t / 0.25, 0, 1)
    qg = 0.1 + 0.01 * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)  # three continuous derivatives: the mode stays quiet
    drive = excite(qg, dt)

    def run(plant, substeps):
        loop = around(plant, substeps=substeps)
        run = simulate(loop, drive, loop.start(qg[0], 0.0, dt))
        assert bool(run.ok)
        return np.asarray(run.tau), np.asarray(run.load.q)

    rigid = run(RigidDrive(106.0, CoulombViscous(200.5, 0.0)), 1)
    stiffness = np.array([1e7, 1e8, 1e9])
    errors = []
    for K12 in stiffness:
        flexible = run(FlexibleDrive(68.0, CoulombViscous(104.0, 0.0), 38.0, CoulombViscous(96.5, 0.0), K12), 4)
        errors.append([np.sqrt(np.mean((a - b) ** 2)) for a, b in zip(flexible, rigid, strict=True)])
    order = -np.diff(np.log10(errors), axis=0)
    np.testing.assert_allclose(order, 1.0, atol=0.1)  # the next term is 1/K12^2: a tenth of the first, and less
    assert errors[0][1] > 1e-7  # m: M2 a/K12 at 1e7 N/m


# -- parameters --------------------------------------------------------------------------------------------------

NAMES = {
    "rigid": ("M", "Fv", "Fc", "offset"),
    "rigid, asymmetric": ("M", "Fv_pos", "Fc_pos", "Fv_neg", "Fc_neg", "offset"),
    "flexible": ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12", "offset"),
    "flexible, asymmetric": (
        *("M1", "Fv1_pos", "Fc1_pos", "Fv1_neg", "Fc1_neg"),
        *("M2", "Fv2_pos", "Fc2_pos", "Fv2_neg", "Fc2_neg"),
        *("K12", "offset"),
    ),
}


@pytest.mark.parametrize("kind", PLANTS)
def test_theta_is_named_in_the_paper_s_order_with_the_side_in_the_name(kind):
    assert names(PLANTS[kind]) == NAMES[kind]


def test_units_and_signs_are_those_of_the_declarations():
    declared = {p.name: (p.unit, p.positive) for p in parameters(FLEXIBLE)}
    assert declared == {
        **{name: ("kg", True) for name in ("M1", "M2")},
        **{name: ("N s/m", False) for name in ("Fv1", "Fv2")},
        **{name: ("N", False) for name in ("Fc1", "Fc2", "offset")},
        "K12": ("N/m", True),
    }


@each_plant
def test_packing_and_unpacking_give_the_same_plant(plant):
    theta = pack(plant)
    again = unpack(plant, theta)
    assert all(jax.tree.leaves(jax.tree.map(lambda a, b: bool(a == b), plant, again)))
    doubled = unpack(plant, 2 * theta)
    np.testing.assert_array_equal(pack(doubled), 2 * theta)
    np.testing.assert_array_equal(list(values(doubled).values()), 2 * theta)
    assert tuple(values(plant)) == names(plant)


def test_theta_lists_the_values_in_the_order_of_the_names():
    np.testing.assert_array_equal(pack(FLEXIBLE), [68.0, 104.0, 10.0, 38.0, 96.5, 9.5, 8.8e5, 3.0])


def test_only_the_chosen_parameters_change_in_the_module_s_order():
    chosen = select(FLEXIBLE, ["K12", "Fc1"])
    assert [p.name for p in chosen] == ["Fc1", "K12"]
    np.testing.assert_array_equal(pack(FLEXIBLE, chosen), [10.0, 8.8e5])
    changed = unpack(FLEXIBLE, jnp.asarray([11.0, 9e5]), chosen)
    assert values(changed) == values(FLEXIBLE) | {"Fc1": 11.0, "K12": 9e5}
    assert unpack(FLEXIBLE, jnp.zeros(0), ()) is FLEXIBLE
    assert pack(FLEXIBLE, ()).shape == (0,)


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match=r"RigidDrive has no parameter K12, M1: it has M, Fv, Fc, offset\."):
        select(RIGID, ["M", "M1", "K12"])


def test_smoothing_belongs_to_the_computation_and_is_no_parameter():
    assert not any("v_eps" in name for plant in PLANTS.values() for name in names(plant))
    np.testing.assert_array_equal(pack(with_v_eps(FLEXIBLE, 0.5)), pack(FLEXIBLE))


@pytest.mark.parametrize("value", [107, 107.0, np.float32(107.0), np.int64(107), np.float64(107.0)])
def test_any_number_becomes_one_strongly_typed_array(value):
    M = RigidDrive(value, SYMMETRIC).M
    assert (M.dtype, M.shape, M.weak_type, float(M)) == (jnp.float64, (), False, 107.0)


def test_suffixes_of_nested_modules_add_up():
    class Inner(eqx.Module):
        D: jax.Array = param("N s/m")
        D_pos: jax.Array = param("N s/m")

    class Middle(eqx.Module):
        inner: Inner = part("b")

    class Outer(eqx.Module):
        outer: Middle = part("a")
        plain: float = 1.0

    assert names(Outer(Middle(Inner(1.0, 2.0)))) == ("Dab", "Dab_pos")
