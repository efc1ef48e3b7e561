"""IDIM-LS gives the benchmark authors' figures on their own record, and the plant's parameters on a simulated one."""

import dataclasses

import numpy as np
import pytest

from didim_jax import AsymmetricCoulombViscous, CoulombViscous, FlexibleDrive, InputError, RigidDrive
from didim_jax.formats import load_recording
from didim_jax.identify import Filtering, idim_ls
from didim_jax.identify.idim_ls import WITH_LOAD_ENCODER
from didim_jax.params import names, values

RIGID = RigidDrive(1.0, CoulombViscous(0.0, 0.0))
FLEXIBLE = FlexibleDrive(1.0, CoulombViscous(0.0, 0.0), 1.0, CoulombViscous(0.0, 0.0), 1.0)


def test_the_authors_figures_on_their_record(emps_dir):
    result = idim_ls(RIGID, names(RIGID), [load_recording(emps_dir / "DATA_EMPS.mat")])
    # Their values and standard deviations (data set's README); what is left comes from how filters end at the edges.
    np.testing.assert_allclose([result[n] for n in ("M", "Fv", "Fc")], [95.1089, 203.5034, 20.3935], rtol=1e-3)
    assert result["offset"] == pytest.approx(-3.1648, rel=3e-3)
    np.testing.assert_allclose(result.std, [0.1085, 1.1460, 0.1012, 0.0444], rtol=0.1)
    assert result.condition_number == pytest.approx(25.9883, abs=0.1)
    assert 100 * result.relative_error == pytest.approx(4.0834, abs=0.1)


def test_the_authors_asymmetric_friction(emps_dir):
    drive = RigidDrive(1.0, AsymmetricCoulombViscous(0.0, 0.0, 0.0, 0.0))
    free = ("M", "Fv_pos", "Fc_pos", "Fv_neg", "Fc_neg")
    result = idim_ls(drive, free, [load_recording(emps_dir / "DATA_EMPS.mat")])
    np.testing.assert_allclose(result.theta, [95.1540, 166.7061, 20.1440, 240.4236, 20.6277], rtol=3e-3)


def test_both_encoders_give_the_flexible_drive(twin_run, twin_plant):
    free = ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12")
    result = idim_ls(FLEXIBLE, free, [twin_run], WITH_LOAD_ENCODER)
    truth = values(twin_plant)
    # Noise, filtered positions, the hard sign for the plant's smooth one: the paper's reference, but not exact.
    for name in ("M1", "M2", "K12"):
        assert result[name] == pytest.approx(truth[name], rel=0.02), name
    for name in ("Fv1", "Fc1", "Fv2", "Fc2"):
        assert result[name] == pytest.approx(truth[name], rel=0.1), name


def test_a_held_force_counted_half_a_sample_early_is_booked_as_friction(twin_run, twin_plant):
    free = ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12")
    early = idim_ls(FLEXIBLE, free, [twin_run], dataclasses.replace(WITH_LOAD_ENCODER, centred_force=False))
    centred = idim_ls(FLEXIBLE, free, [twin_run], WITH_LOAD_ENCODER)
    assert early.relative_error > 3 * centred.relative_error
    assert abs(early["Fv1"] - 104) > 3 * abs(centred["Fv1"] - 104)


def test_a_flexible_drive_without_load_encoder_is_refused_in_one_line(clean_run):
    with pytest.raises(InputError, match="load position ql") as caught:
        idim_ls(FLEXIBLE, names(FLEXIBLE), [dataclasses.replace(clean_run, ql=None)])
    assert "\n" not in str(caught.value)


def test_two_records_are_fitted_together(emps_dir):
    record = load_recording(emps_dir / "DATA_EMPS.mat")
    once, twice = (idim_ls(RIGID, names(RIGID), [record] * k) for k in (1, 2))
    np.testing.assert_allclose(once.theta, twice.theta, rtol=1e-9)
    np.testing.assert_allclose(twice.std, once.std / np.sqrt(2), rtol=1e-3)  # twice the rows, the same residual


def test_columns_that_a_record_cannot_tell_apart_are_regrouped(clean_run):
    # A load encoder that repeats the motor's: K12 has no column, both sides' masses and frictions one each in two rows.
    twin = dataclasses.replace(clean_run, ql=clean_run.qm)
    result = idim_ls(FLEXIBLE, ("M1", "Fv1", "Fc1", "M2", "Fv2", "Fc2", "K12"), [twin], Filtering(trim=10))
    assert "K12" not in result.names
    assert np.isfinite(result.theta).all()
