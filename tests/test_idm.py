"""W theta is the simulated force on the model's own motion, and W is the paper's IDM of equations 4 and 7."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from didim_jax.chain import Chain
from didim_jax.control import ContinuousPD, Drive, SampledPD
from didim_jax.idm import known_force, observation_matrix
from didim_jax.params import names, pack, parameters, select, unpack
from didim_jax.plant import AsymmetricCoulombViscous, Axis, CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.simulate import ContinuousLoop, Excitation, SampledLoop, simulate

DT, N = 1e-3, 1000
V_EPS = 1e-3
SYMMETRIC = CoulombViscous(104.0, 10.0, V_EPS)
ASYMMETRIC = AsymmetricCoulombViscous(104.0, 10.0, 120.0, 13.0, V_EPS)
PLANTS = {
    "rigid": RigidDrive(107.0, SYMMETRIC, -3.0),
    "rigid, asymmetric": RigidDrive(107.0, ASYMMETRIC, -3.0),
    "flexible": FlexibleDrive(68.0, SYMMETRIC, 38.0, CoulombViscous(96.5, 9.5, V_EPS), 8.8e5, -3.0),
    "flexible, asymmetric": FlexibleDrive(68.0, ASYMMETRIC, 38.0, ASYMMETRIC, 8.8e5, -3.0),
}
each_plant = pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS.keys())


def simulated(plant, *, sampled=True, limit=10.0):
    """One second of closed loop with reversals and the mode excited."""
    t = DT * np.arange(N)
    qg = 0.1 + 0.02 * np.sin(2 * np.pi * t) ** 2 + 2e-5 * np.sin(2 * np.pi * 12 * t) ** 2
    chain = Chain(Drive(35.15, limit), plant)
    if sampled:
        loop = SampledLoop(controller=SampledPD(160.18, 243.45), chain=chain)
    else:
        loop = ContinuousLoop(controller=ContinuousPD(160.18, 243.45), chain=chain)
    out = simulate(loop, Excitation(jnp.asarray(DT), jnp.asarray(qg), jnp.zeros(N)), loop.start(qg[0], 0.0, DT))
    assert bool(out.ok)
    assert np.sum(np.diff(np.sign(out.motor.v)) != 0) >= 3
    return out


def matrix(plant, out, chosen=None):
    chosen = parameters(plant) if chosen is None else chosen
    return np.asarray(observation_matrix(plant, out.motor, out.load, chosen))


# -- the simulated force comes back ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "sampled"), [*((kind, True) for kind in PLANTS), ("rigid", False), ("flexible, asymmetric", False)]
)
def test_the_model_s_own_motion_gives_its_force_back(kind, sampled):
    """At every sample, by algebra: no integration error enters."""
    plant = PLANTS[kind]
    out = simulated(plant, sampled=sampled)
    W = matrix(plant, out)
    rows = W @ np.asarray(pack(plant))
    assert W.shape == (len(rows), N, len(names(plant)))
    assert len(rows) == {"rigid": 1, "flexible": 2}[plant.model]
    force = np.asarray(out.force)
    largest = np.abs(force).max()
    np.testing.assert_allclose(rows[0], force, rtol=0, atol=1e-9 * largest)
    np.testing.assert_array_equal(out.force, out.tau)  # never in the limit here
    for balance in rows[1:]:
        np.testing.assert_allclose(balance, np.zeros(N), rtol=0, atol=1e-9 * largest)


def test_beyond_the_drive_s_limit_it_is_the_force_felt_that_comes_back():
    plant = PLANTS["flexible"]
    out = simulated(plant, limit=3.0)
    force, tau = np.asarray(out.force), np.asarray(out.tau)
    assert np.abs(tau - force).max() > 10
    np.testing.assert_allclose((matrix(plant, out) @ np.asarray(pack(plant)))[0], force, rtol=0, atol=1e-7)


# -- the paper's matrices ----------------------------------------------------------------------------------------


def smooth_sign(v):
    return np.tanh(v / V_EPS)


def test_the_rigid_matrix_is_equation_7():
    """(a, v, sign v), and a column of ones for the offset."""
    plant = PLANTS["rigid"]
    out = simulated(plant)
    a, v = np.asarray(out.motor.a), np.asarray(out.motor.v)
    expected = np.stack([a, v, smooth_sign(v), np.ones(N)], axis=1)
    assert names(plant) == ("M", "Fv", "Fc", "offset")
    np.testing.assert_allclose(matrix(plant, out)[0], expected, rtol=1e-13, atol=1e-15)


def test_the_flexible_matrix_is_equation_4():
    """Columns M1 Fv1 Fc1 M2 Fv2 Fc2 K12 as in the paper, then the offset; the paper's q2 is q2 - q1 here."""
    plant = PLANTS["flexible"]
    out = simulated(plant)
    (q1, v1, a1), (q2, v2, a2) = (tuple(map(np.asarray, (s.q, s.v, s.a))) for s in (out.motor, out.load))
    delta, none, one = q2 - q1, np.zeros(N), np.ones(N)
    motor = np.stack([a1, v1, smooth_sign(v1), none, none, none, -delta, one], axis=1)
    load = np.stack([none, none, none, a2, v2, smooth_sign(v2), delta, none], axis=1)
    assert names(plant) == ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12", "offset")
    np.testing.assert_allclose(matrix(plant, out), np.stack([motor, load]), rtol=1e-13, atol=1e-15)
    assert np.ptp(delta) > 1e-5


def test_asymmetric_columns_share_out_the_symmetric_ones():
    out = simulated(PLANTS["rigid, asymmetric"])
    v = np.asarray(out.motor.v)
    forward, backward = 0.5 * (1 + smooth_sign(v)), 0.5 * (1 - smooth_sign(v))
    s = smooth_sign(v)
    expected = np.stack([out.motor.a, forward * v, forward * s, backward * v, backward * s, np.ones(N)], axis=1)
    W = matrix(PLANTS["rigid, asymmetric"], out)[0]
    np.testing.assert_allclose(W, expected, rtol=1e-12, atol=1e-15)
    plain = matrix(PLANTS["rigid"], out)[0]
    np.testing.assert_allclose(W[:, 1] + W[:, 3], plain[:, 1], rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(W[:, 2] + W[:, 4], plain[:, 2], rtol=1e-13, atol=1e-16)


@each_plant
def test_the_matrix_depends_on_the_motion_and_not_on_the_parameters(plant):
    out = simulated(plant)
    other = unpack(plant, 3.0 * pack(plant) + 1.0)
    np.testing.assert_array_equal(matrix(plant, out), matrix(other, out))


# -- chosen and known --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "chosen"),
    [
        ("rigid", ("M",)),
        ("rigid", ("offset", "Fc")),
        ("rigid, asymmetric", ("M", "Fv_neg")),
        ("flexible", ("M1", "M2", "K12")),
        ("flexible", ("Fc2", "Fv1", "offset")),
        ("flexible, asymmetric", ("Fc2_neg", "K12")),
    ],
)
def test_known_force_and_chosen_columns_make_the_whole(kind, chosen):
    plant = PLANTS[kind]
    out = simulated(plant)
    picked = select(plant, chosen)
    W, theta = matrix(plant, out, picked), np.asarray(pack(plant, picked))
    known = np.asarray(known_force(plant, out.motor, out.load, picked))
    assert known.shape == W.shape[:2]
    force = np.asarray(out.force)
    np.testing.assert_allclose((W @ theta + known)[0], force, rtol=0, atol=1e-9 * np.abs(force).max())
    everything = matrix(plant, out)
    where = [names(plant).index(p.name) for p in picked]
    np.testing.assert_array_equal(W, everything[..., where])
    rest = [i for i in range(len(names(plant))) if i not in where]
    without = everything[..., rest] @ np.asarray(pack(plant))[rest]
    np.testing.assert_allclose(known, without, rtol=0, atol=1e-9 * np.abs(force).max())


@each_plant
def test_nothing_is_known_when_everything_is_chosen(plant):
    out = simulated(plant)
    np.testing.assert_array_equal(known_force(plant, out.motor, out.load, parameters(plant)), 0.0)


def test_least_squares_on_noiseless_motion_gives_theta_to_many_digits():
    """Both rows of equation 4 stacked; the error is rounding times the condition of the scaled columns."""
    plant = PLANTS["flexible"]
    out = simulated(plant)
    W = np.concatenate(matrix(plant, out))
    Y = np.concatenate([np.asarray(out.force), np.zeros(N)])
    norms = np.linalg.norm(W, axis=0)
    theta = np.linalg.lstsq(W / norms, Y, rcond=None)[0] / norms
    np.testing.assert_allclose(theta, pack(plant), rtol=1e-8)


def test_the_matrix_may_be_taken_inside_a_jitted_function():
    """As each step of DIDIM does, on motions that are traced themselves."""
    plant = PLANTS["flexible"]
    out = simulated(plant)
    chosen = select(plant, ["M1", "K12"])

    @eqx.filter_jit
    def inside(motor, load):
        return observation_matrix(plant, motor, load, chosen)

    np.testing.assert_array_equal(inside(out.motor, out.load), matrix(plant, out, chosen))
    tangent = Axis(jnp.zeros(N), jnp.zeros(N), jnp.ones(N))
    _, dW = jax.jvp(lambda motor: inside(motor, out.load), (out.motor,), (tangent,))
    np.testing.assert_array_equal(dW[..., 0], np.stack([np.ones(N), np.zeros(N)]))  # d W / d a1: the column of M1
    np.testing.assert_array_equal(dW[..., 1], 0.0)
