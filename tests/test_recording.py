"""A recording is whole, finite and cannot be altered after it was made."""

import dataclasses

import numpy as np
import pytest

from didim_jax.errors import InputError
from didim_jax.recording import Recording


def _channels(n=5):
    k = np.arange(n, dtype=float)
    return {"t": 1e-3 * k, "qg": k, "qm": k + 0.5, "vir": -k}


def test_derived_quantities_are_the_definitions():
    r = Recording(**_channels(), gain=35.0)
    assert len(r) == 5
    assert r.dt == pytest.approx(1e-3, rel=1e-15)
    np.testing.assert_array_equal(r.tau, 35.0 * r.vir)


def test_channels_are_read_only_float64_copies():
    mine = {**_channels(), "qg": np.arange(5, dtype=np.uint8)}
    r = Recording(**mine, gain=35.0, ql=[0, 1, 2, 3, 4])
    for values in r.channels.values():
        assert values.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    mine["vir"][0] = 99.0
    assert r.vir[0] == 0.0


def test_a_recording_is_frozen():
    r = Recording(**_channels(), gain=35.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        r.gain = 1.0


def test_one_channel_altered_keeps_the_rest():
    r = Recording(**_channels(), gain=35.0, name="a", documented={"kp": 160.0})
    other = dataclasses.replace(r, vir=2 * r.vir)
    assert (other.name, other.documented) == ("a", {"kp": 160.0})
    np.testing.assert_array_equal(other.tau, 2 * r.tau)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"qm": np.zeros(4)}, "channels differ in length: t 5, qg 5, qm 4, vir 5"),
        ({"ql": np.zeros(6)}, "channels differ in length: .*ql 6"),
        ({"qg": np.array([0, 1, np.nan, 3, np.nan])}, r"channel qg is nan at row 3 \(2 such values\)"),
        ({"injected": np.array([0, np.inf, 0, 0, 0])}, "channel injected is inf at row 2"),
        ({"vir": np.zeros((5, 1))}, r"channel vir has the shape \(5, 1\)"),
        ({"gain": 0.0}, "gain gtau = 0.0 N/V must be a positive number"),
        ({"gain": float("nan")}, "gain gtau = nan N/V"),
    ],
)
def test_a_broken_record_is_one_line_with_the_name_of_the_channel(change, line):
    with pytest.raises(InputError, match=line) as caught:
        Recording(**{**_channels(), "gain": 35.0, "source": "run.mat", **change})
    assert str(caught.value).startswith("run.mat: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("n", [0, 1])
def test_an_empty_record_is_refused(n):
    with pytest.raises(InputError, match=f"{n} samples"):
        Recording(**_channels(n), gain=35.0)
