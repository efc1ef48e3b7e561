"""From findings to a verdict: what was refuted, eliminated or seen in one record alone."""

import dataclasses

import numpy as np
import pytest

from didim_jax.gap import decide
from didim_jax.gap.verdict import Findings, Quality, conclude

QUIET = Quality(
    gain=0.9, followed=0.02, bursts=0.0, line=0.02, line_hz=9.0, drift=0.2, structured=0.02, left=0.01, law_left=0.0
)


def evidence(**likelihoods: float) -> decide.Evidence:
    return decide.Evidence(
        tuple(likelihoods), np.array(list(likelihoods.values())), np.full(len(likelihoods), 2.0), before=0.0
    )


def test_what_is_not_missed_any_more_does_not_lead_the_ranking():
    """Stribeck came first, presliding beside it made it needless: it is presliding that is named, and ranked."""
    steps = (evidence(stribeck=400.0, presliding=300.0, cogging=20.0), evidence(presliding=500.0))
    found = Findings((), ("presliding",), QUIET, steps, ("stribeck", "presliding"), foreign=False)
    verdict = conclude(found)
    assert (verdict.verdict, verdict.effects) == ("effect", ("presliding",))
    assert next(iter(verdict.ranking)) == "presliding" and "stribeck" not in verdict.ranking
    assert sum(verdict.ranking.values()) == pytest.approx(1.0)


def test_a_search_that_refuted_everything_says_none_and_means_it():
    quality = dataclasses.replace(QUIET, gain=0.0, left=1.0)
    verdict = conclude(Findings((), (), quality, (decide.NOTHING,), (), foreign=False))
    assert verdict.verdict == "none" and verdict.ranking["none"] > 0.9


def test_most_of_the_force_left_is_another_machine():
    found = Findings((), ("stribeck",), QUIET, (evidence(stribeck=400.0),), ("stribeck",), foreign=True)
    assert conclude(found).verdict == "unexplained"
