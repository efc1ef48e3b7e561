"""A synthetic record is what the documented machine would have recorded: law, encoder, drive range, stated noise."""

from pathlib import Path
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from didim_jax.effects import AbstractEffect, Block
from didim_jax.errors import InputError
from didim_jax.hygiene import examine
from didim_jax.machine import Machine
from didim_jax.plant import CoulombViscous, FlexibleDrive
from didim_jax.plant_file import load_plant
from didim_jax.recording import Recording
from didim_jax.reference import Chirp, Dwell, Sequence, Trapezoid, load_reference
from didim_jax.rig import continuous_loop, excitation, first_state, sampled_loop
from didim_jax.simulate import simulate
from didim_jax.synthesize import synthesize

TWIN = Path(__file__).resolve().parents[1] / "configs" / "twin"
DT = 1e-3


@pytest.fixture(scope="module")
def machine():
    return Machine.load(TWIN / "machine.toml")


@pytest.fixture(scope="module")
def plant():
    return load_plant(TWIN / "plant.toml")


@pytest.fixture(scope="module")
def qg():
    motion = Sequence((Dwell(0.1), Trapezoid(0.1, 0.2, 1.5), Chirp(1e-4, 20.0, 36.0, 1.0, exponent=0.0), Dwell(0.1)))
    return 0.05 + motion.sample(DT)


@pytest.fixture(scope="module")
def quiet(machine, plant, qg):
    return synthesize(machine, plant, qg, name="quiet")


def law(machine, record):
    """The documented control law on the recorded positions, V, from the third sample on."""
    c = machine.controller
    dq = (record.qm[2:] - record.qm[:-2]) / (2 * c.sample_time)
    return c.kv * (c.kp * (record.qg[2:] - record.qm[2:]) - dq)


def test_the_recorded_command_is_the_documented_law_of_the_recorded_positions(machine, quiet):
    np.testing.assert_allclose(quiet.vir[2:], law(machine, quiet), atol=1e-9)  # V; rounding of positions times 4e4 V/m
    assert quiet.synthetic
    assert quiet.injected is None
    assert quiet.gain == machine.drive.gain
    assert quiet.documented == {"kp": machine.controller.kp, "kv": machine.controller.kv}


def test_both_positions_are_counted(machine, quiet):
    for q in (quiet.qm, quiet.ql):
        counts = q / machine.encoder.resolution
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert np.ptp(quiet.ql - quiet.qm) > 1e-4  # m: the spring gives, so the two are not one signal


def test_the_checks_of_a_record_find_nothing_odd(machine, quiet):
    assert examine(quiet, machine) == ()


def test_the_load_obeys_newton(machine, plant, quiet):
    """Integrated over the record, the coupling's force and friction give the load's momentum back."""
    friction = 96.5 * np.gradient(quiet.ql, DT) + 9.5 * np.tanh(np.gradient(quiet.ql, DT) / 1e-3)
    impulse = np.cumsum(-8.8e5 * (quiet.ql - quiet.qm) - friction) * DT
    momentum = 38.0 * np.gradient(quiet.ql, DT)
    # one count of deflection is 0.044 N, one of speed 1e-3 kg m/s; sums by rectangles on a 36 Hz motion do the rest
    assert np.std(impulse - momentum) < 0.02 * np.std(momentum)


def test_noise_after_the_loop_changes_the_recorded_command_only(machine, plant, qg, quiet):
    noisy = synthesize(machine, plant, qg, force_noise=3.0, seed=1)
    np.testing.assert_array_equal(noisy.qm, quiet.qm)
    added = noisy.tau - quiet.tau
    n = len(qg)
    assert np.std(added) == pytest.approx(3.0, rel=5 / np.sqrt(2 * n))  # five standard deviations of an estimated rms
    assert abs(np.mean(added[1:] * added[:-1])) < 9.0 * 5 / np.sqrt(n)  # white


def test_noise_inside_the_loop_moves_the_machine_and_is_in_the_command_but_not_in_the_record(machine, plant, qg, quiet):
    noisy = synthesize(machine, plant, qg, force_noise=3.0, noise_inside_loop=True, seed=1)
    assert np.any(noisy.qm != quiet.qm)
    assert noisy.injected is None
    unexplained = machine.drive.gain * (noisy.vir[2:] - law(machine, noisy))
    assert np.std(unexplained) == pytest.approx(3.0, rel=5 / np.sqrt(2 * len(qg)))


def test_a_seed_gives_the_same_record_again_and_another_seed_another(machine, plant, qg):
    one, same, other = (synthesize(machine, plant, qg, force_noise=3.0, seed=seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.vir, same.vir)
    assert np.all(one.vir != other.vir)


def test_a_command_beyond_the_drive_is_refused_with_the_limit_and_the_time(machine, plant, qg):
    with pytest.raises(InputError, match="10 V") as caught:
        synthesize(machine, plant, qg[0] + 2 * (qg - qg[0]), name="too fast")
    message = str(caught.value)
    assert "too fast" in message
    assert "t = 0.1" in message  # the trapezoid starts there, at 3 m/s2: 9 V of inertia, and what the loop overshoots
    assert "lower" in message


def test_a_run_that_diverges_is_refused(machine, qg):
    friction = CoulombViscous(1.0, 1.0)
    with pytest.raises(InputError, match="diverges"):  # a mode at 5 MHz, far beyond the integration step
        synthesize(machine, FlexibleDrive(68.0, friction, 1e-6, friction, 1e9), qg)


class Counted(AbstractEffect):
    """Nothing, but it counts how often it is traced."""

    block: ClassVar[Block] = Block.LOAD_SIDE
    traced: ClassVar[list[int]] = []

    def __call__(self, t, x, signals):
        self.traced.append(1)
        return jnp.zeros_like(signals.q1), x


def test_other_plants_seeds_and_noises_of_one_length_compile_once(machine, plant, qg):
    Counted.traced.clear()
    synthesize(machine, plant, qg, effects=[Counted()])
    first = len(Counted.traced)
    other = load_plant(TWIN / "plant_payload.toml")
    synthesize(machine, other, qg + 0.01, effects=[Counted()], force_noise=2.0, noise_inside_loop=True, seed=7)
    assert first > 0
    assert len(Counted.traced) == first


@pytest.mark.parametrize("reference", ["reference.toml", "reference_check.toml"])
@pytest.mark.parametrize("name", ["plant.toml", "plant_payload.toml", "plant_plus_10kg.toml"])
def test_the_twin_keeps_within_its_drive_with_a_margin(machine, reference, name):
    record = synthesize(machine, load_plant(TWIN / name), load_reference(TWIN / reference).sample(DT))
    assert 6.0 < np.abs(record.vir).max() < 9.5  # V of 10: excited, and room for noise
    assert record.qm.min() > 0.0
    assert record.qm.max() < 0.25


def test_the_twin_with_a_payload_is_ten_kilograms_heavier_and_nothing_else():
    bare, heavy = (load_plant(TWIN / f"plant{which}.toml") for which in ("", "_plus_10kg"))
    assert float(heavy.M2 - bare.M2) == 10.0
    assert all(float(getattr(heavy, name)) == float(getattr(bare, name)) for name in ("M1", "K12", "offset"))


# -- rig ---------------------------------------------------------------------------------------------------------


def test_a_record_is_simulated_again_from_itself(machine, plant, quiet):
    """Reference and start read off the record give its motion back, but for the counting of the encoder."""
    loop = sampled_loop(machine, plant)
    run = simulate(loop, excitation(quiet, machine), first_state(quiet, machine, loop))
    assert bool(run.ok)
    assert np.abs(np.asarray(run.motor.q) - quiet.qm).max() < 1e-6  # m; one count is 5e-8 m
    assert np.std(np.asarray(run.tau) - quiet.tau) < 0.5  # N; one count in the two-sample velocity is 0.2 N


def test_both_loops_have_the_machine_s_gains_and_drive(machine, plant, quiet):
    sampled, continuous = (make(machine, plant) for make in (sampled_loop, continuous_loop))
    for loop in (sampled, continuous):
        assert float(loop.chain.drive(1e3)) == machine.drive.gain * machine.drive.limit
    runs = [
        simulate(loop, excitation(quiet, machine), first_state(quiet, machine, loop)) for loop in (sampled, continuous)
    ]
    # the sampled law acts a sample and a half later: some percent of the command, a hundredth of the following error
    gap = np.std(np.asarray(runs[0].tau - runs[1].tau)) / np.std(quiet.tau)
    assert 1e-3 < gap < 0.2


def test_a_start_in_motion_is_read_off_the_first_samples(machine, plant):
    q = 0.1 + 0.05 * DT * np.arange(100)
    moving = Recording(t=DT * np.arange(100), qg=q, qm=q, vir=np.zeros(100), gain=machine.drive.gain)
    start = first_state(moving, machine, sampled_loop(machine, plant))
    np.testing.assert_allclose(start.plant, [0.1, 0.05, 0.0, 0.0], rtol=1e-9)
    np.testing.assert_allclose(start.memory, [0.1 - 0.05 * DT, 0.1 - 2 * 0.05 * DT], rtol=1e-12)


def test_a_known_injected_signal_is_driven_in_volts(machine, plant, qg):
    """Whatever unit the record gives it, the excitation has it as the command contains it."""
    noisy = synthesize(machine, plant, qg, force_noise=20.0, noise_inside_loop=True)
    volts = np.concatenate([np.zeros(2), noisy.vir[2:] - law(machine, noisy)])
    known = Recording(**noisy.channels | {"injected": 7.0 * volts}, gain=noisy.gain)
    np.testing.assert_allclose(excitation(known, machine).injected, volts, atol=1e-6)
