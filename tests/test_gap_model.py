"""One compiled loop holds every effect: at their nulls it is the plain loop, and its columns are exact derivatives."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from gap_machine import path, record
from jax import Array

from didim_jax.chain import Chain
from didim_jax.control import Drive, SampledPD
from didim_jax.effects import AbstractEffect, Block
from didim_jax.effects.actuator import AmplifierLag, Cogging
from didim_jax.effects.catalogue import CATALOGUE
from didim_jax.effects.coupling import CouplingDamping
from didim_jax.effects.environment import Offset
from didim_jax.effects.friction import Presliding, Stribeck
from didim_jax.effects.sensor import EncoderPeriodicError
from didim_jax.gap.model import SOLVER, SUBSTEPS, WIDTH, Model
from didim_jax.gap.prepared import prepare
from didim_jax.gap.rounded import RoundedCoulombViscous
from didim_jax.params import param
from didim_jax.plant import CoulombViscous, FlexibleDrive, RigidDrive
from didim_jax.rig import excitation, first_state
from didim_jax.simulate import SampledLoop, simulate

FEW = (AmplifierLag, Cogging, Stribeck, Presliding, CouplingDamping, EncoderPeriodicError, Offset)
SIZES = {
    "rigid": {"M": 90.0, "Fv": 220.0, "Fc": 18.0, "v_eps": 2e-3},
    "flexible": {
        "M1": 66.0,
        "Fv1": 120.0,
        "Fc1": 11.0,
        "M2": 31.0,
        "Fv2": 90.0,
        "Fc2": 7.0,
        "K12": 6e5,
        "v_eps": 2e-3,
    },
}


@pytest.fixture(scope="module")
def short(emps_like):
    """0.6 s of the machine, in motion from the first sample on."""
    return record(emps_like, path()[:1000])


def model_of(short, machine, kind, catalogue) -> Model:
    return prepare(short, dataclasses.replace(machine, model=kind), catalogue).model


@pytest.fixture(scope="module")
def few(short, emps_like) -> Model:
    return model_of(short, emps_like, "flexible", FEW)


@pytest.mark.parametrize("kind", ["rigid", "flexible"])
def test_with_every_effect_at_its_null_it_is_the_plain_loop(short, emps_like, kind):
    model = model_of(short, emps_like, kind, CATALOGUE)
    sizes = SIZES[kind]
    x = model.encode(np.zeros(len(model.entries)), sizes)
    out = model.run(x)

    friction = [
        CoulombViscous(sizes[f"Fv{k}"], sizes[f"Fc{k}"], sizes["v_eps"]) for k in ("", "1", "2") if f"Fv{k}" in sizes
    ]
    plant = (
        RigidDrive(sizes["M"], *friction)
        if kind == "rigid"
        else FlexibleDrive(sizes["M1"], friction[0], sizes["M2"], friction[1], sizes["K12"])
    )
    law, drive = emps_like.controller, emps_like.drive
    chain = Chain(Drive(drive.gain, drive.limit), plant, ())
    loop = SampledLoop(controller=SampledPD(law.kp, law.kv), chain=chain, substeps=SUBSTEPS, solver=SOLVER)
    plain = simulate(loop, excitation(short, emps_like), first_state(short, emps_like, loop))
    # rounding of positions, 1e-17 m and a few times that, times kv gain / (2 dt) = 4e6 N/m
    np.testing.assert_allclose(out[0], plain.tau, rtol=0, atol=1e-8)
    np.testing.assert_allclose(out[1], plain.load.q - plain.qm, rtol=0, atol=1e-14)
    assert np.ptp(out[0]) > 100  # N: there is a motion


def with_everything(model: Model, x: np.ndarray) -> np.ndarray:
    """x for the one program that holds every effect: where there is none, its size is next to nothing."""
    owned = [bool(e.owner) and e.owner != "start" for e in model.entries]
    return np.where(owned & (x == 0.0), 1e-300, x)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "flexible"])
def test_a_small_program_is_the_whole_one(short, emps_like, kind):
    """Every effect in one loop, all but those that are there at their null: to rounding, nothing of it is felt."""
    model = model_of(short, emps_like, kind, CATALOGUE)
    x = model.encode(np.zeros(len(model.entries)), SIZES[kind])
    chosen = [model.index[name] for name in ("Fc" if kind == "rigid" else "Fc1", "v_eps", "stribeck.dFs", "offset.F0")]
    for present in ({}, {"stribeck.dFs": 5.0}, {"stribeck.dFs": 5.0, "offset.F0": 2.0}):
        few = model.encode(x, present)
        (out, columns), (whole, wholly) = (model.columns(at, chosen) for at in (few, with_everything(model, few)))
        np.testing.assert_allclose(whole[0], out[0], rtol=0, atol=1e-8)  # N
        np.testing.assert_allclose(whole[1], out[1], rtol=0, atol=1e-14)  # m
        scale = np.abs(columns).max(axis=2, keepdims=True)
        assert np.all(scale[:, 0] > 0)
        differences = (wholly - columns) / np.where(scale > 0, scale, 1.0)
        np.testing.assert_allclose(differences, 0.0, rtol=0, atol=1e-9)


def away_from_the_null(model: Model) -> np.ndarray:
    """Every entry somewhere else than at its null."""
    x = model.encode(np.zeros(len(model.entries)), SIZES["flexible"])
    sizes = {
        "amplifier_lag.T": 1.2e-3,
        "cogging.a1": 1.0,
        "cogging.b1": -0.7,
        "stribeck.dFs": 5.0,
        "stribeck.vs": 0.012,
        "stribeck.a": 1.3,
        "presliding.share": 0.4,
        "presliding.z_s": 3e-4,
        "coupling_damping.C": 60.0,
        "encoder_periodic_error.a": 4e-7,
        "encoder_periodic_error.b": 3e-7,
        "offset.F0": 2.0,
    }
    x = model.encode(x, sizes)
    rest = [i for i, name in enumerate(model.names) if x[i] == 0.0]
    x[rest] = 0.1
    return x


def test_columns_are_those_of_central_differences(few):
    """By every parameter of the drive, of the effects and of the start, more of them than are computed at once."""
    x, h = away_from_the_null(few), 1e-5
    chosen = list(range(len(few.entries)))
    assert len(chosen) > WIDTH
    value, columns = few.columns(x, chosen)
    np.testing.assert_allclose(value, few.run(x), rtol=0, atol=1e-8)
    ends = few.batch(np.concatenate([x + h * np.eye(len(x)), x - h * np.eye(len(x))]))
    assert np.isfinite(ends).all() and np.isfinite(columns).all()
    differences = (ends[: len(x)] - ends[len(x) :]) / (2 * h)
    for row, name in enumerate(few.names):
        for signal, unit in enumerate(("N", "m")):
            exact, told = differences[row, signal], columns[row, signal]
            # the step's square leaves 1e-7 or less; rounding, 1e-9 N and 1e-16 m, over the step
            rounding = (1e-4, 1e-11)[signal]
            largest = np.abs(exact).max()
            np.testing.assert_allclose(told, exact, rtol=0, atol=1e-5 * largest + rounding, err_msg=f"{name}, {unit}")
        assert np.abs(columns[row]).max() > 0, name


def test_a_batch_is_the_same_runs_side_by_side(few):
    x = away_from_the_null(few)
    xs = x + 0.01 * np.random.default_rng(0).normal(size=(5, len(x)))
    together = few.batch(xs)
    assert together.shape == (5, 2, few.n)
    for one, out in zip(xs, together, strict=True):
        np.testing.assert_allclose(out, few.run(one), rtol=0, atol=1e-8)
    assert few.batch(xs[:0]).shape == (0, 2, few.n)


@pytest.mark.parametrize("kind", ["rigid", "flexible"])
def test_values_survive_the_way_to_x_and_back(short, emps_like, kind):
    model = model_of(short, emps_like, kind, CATALOGUE)
    assert len(set(model.names)) == len(model.entries)
    draw = np.random.default_rng(1)
    for entry in model.entries:
        least = 0.1 * entry.scale if entry.logarithmic else entry.null - 3 * entry.scale
        low, high = (max(entry.lower, least), min(entry.upper, least + 6 * entry.scale))
        for value in draw.uniform(low, high, 3):
            assert entry.decode(entry.encode(value)) == pytest.approx(value, rel=1e-12, abs=1e-15 * entry.scale)
    x = model.encode(np.zeros(len(model.entries)), SIZES[kind])
    values = model.decode(x)
    assert {name: values[name] for name in SIZES[kind]} == pytest.approx(SIZES[kind], rel=1e-12)
    for entry, name in zip(model.entries, model.names, strict=True):
        if entry.owner and not entry.logarithmic:
            assert values[name] == entry.null, name
    inside = (model.lower <= x) & (x <= model.upper)
    assert [name for name, good in zip(model.names, inside, strict=True) if not good] == []


class Swing(AbstractEffect):
    """An effect as a user may write it, one of its parameters positive."""

    block: ClassVar[Block] = Block.ENVIRONMENT
    A: Array = param("N", scale=2.0, default=0.0)
    w: Array = param("rad/s", positive=True, scale=1.0, default=10.0)

    def __call__(self, t, x, signals):
        return self.A * jnp.sin(self.w * t), x


def test_at_x_zero_every_effect_has_its_defaults(short, emps_like):
    model = model_of(short, emps_like, "rigid", (Swing,))
    values = model.decode(np.zeros(len(model.entries)))
    assert (values["swing.A"], values["swing.w"]) == (0.0, pytest.approx(10.0))


def test_the_smoothing_speed_stays_positive_and_has_its_range(few):
    place = few.index["v_eps"]
    x = away_from_the_null(few)
    x[place] = -40.0
    assert few.decode(x)["v_eps"] > 0
    x[place] = few.lower[place]
    assert few.decode(x)["v_eps"] == pytest.approx(1e-6)


def test_the_sign_blends_three_shapes():
    v = np.linspace(-0.05, 0.05, 2001)
    x = v / 2e-3

    def made(tail, knee):
        return np.asarray(RoundedCoulombViscous(0.0, 10.0, 2e-3, tail, knee)(jnp.asarray(v)))

    np.testing.assert_array_equal(made(0.0, 0.0), np.asarray(CoulombViscous(0.0, 10.0, 2e-3)(jnp.asarray(v))))
    np.testing.assert_allclose(made(1.0, 0.0), 10 * x / (1 + np.abs(x)), atol=0.03)
    np.testing.assert_allclose(made(0.0, 1.0), 10 * x / np.sqrt(1 + x**2), atol=0.03)
    blend = made(0.3, 0.5)
    np.testing.assert_allclose(blend, 0.2 * made(0.0, 0.0) + 0.3 * made(1.0, 0.0) + 0.5 * made(0.0, 1.0), atol=1e-9)
    narrower = np.asarray(RoundedCoulombViscous(0.0, 10.0, 0.9 * 2e-3, 0.46, 0.59)(jnp.asarray(v)))
    np.testing.assert_allclose(narrower, 10 * 2 / np.pi * np.arctan(0.5 * np.pi * x), atol=0.1)
