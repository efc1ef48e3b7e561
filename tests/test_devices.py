"""Compiled programs are dropped before they fill what a process may map, and only then."""

import jax
import jax.numpy as jnp
import pytest

from didim_jax import devices


@jax.jit
def doubled(x):
    return 2 * x


def test_programs_are_forgotten_where_they_fill_too_much_and_work_again():
    assert float(doubled(jnp.asarray(1.5))) == 3.0 and doubled._cache_size() == 1
    if not devices._MAPS.exists():
        pytest.skip("no /proc on this system: nothing limits the programs")
    assert not devices.forget_programs(1.0) and doubled._cache_size() == 1
    assert devices.forget_programs(0.0) and doubled._cache_size() == 0
    assert float(doubled(jnp.asarray(1.5))) == 3.0


def test_without_such_a_limit_nothing_is_forgotten(monkeypatch, tmp_path):
    monkeypatch.setattr(devices, "_MAPS", tmp_path / "maps")
    assert not devices.forget_programs(0.0)
