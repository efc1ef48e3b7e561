"""Probabilities from evidence: what counts as left, and who has the mass that nobody claims."""

import numpy as np
import pytest

from didim_jax.gap import decide


def test_a_gap_that_is_left_counts_by_how_much_of_it_is_structure():
    """Much of a little, or a little of much; at `LEFT` the odds are even, where structure is certain."""
    for structured in (0.3, 0.6, 1.0):
        assert decide.other(decide.LEFT / structured, structured, 0.0, 0.0) == pytest.approx(0.5, abs=0.01)
    assert decide.other(0.15, 0.03, 0.0, 0.0) < 0.02  # noise, however much it is of a small gap
    assert decide.other(0.01, 0.9, 0.0, 0.0) < 0.05 < 0.9 < decide.other(0.1, 0.7, 0.0, 0.0)


def test_none_has_what_nothing_else_claims():
    """Where every effect was refuted, a small chance of none was said of something that is in question no more."""
    found = decide.probabilities(decide.NOTHING, none=0.02, other=0.1)
    assert found == {"none": pytest.approx(0.9), "other": pytest.approx(0.1)}
    seen = decide.Evidence(("stribeck",), np.array([30.0]), np.array([2.0]), 0.0)
    assert decide.probabilities(seen, none=0.02, other=0.1)["stribeck"] == pytest.approx(0.88)


def test_probabilities_are_never_below_zero():
    """1 - none - other can round to less than nothing: a ranking with -4e-18 in it is none."""
    seen = decide.Evidence(("stribeck", "offset"), np.array([30.0, 29.0]), np.array([2.0, 1.0]), 0.0)
    for other in np.linspace(1e-3, 0.4, 400):
        found = decide.probabilities(seen, none=1 - other, other=other)
        assert min(found.values()) >= 0 and sum(found.values()) == pytest.approx(1)
