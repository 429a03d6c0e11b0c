"""No verdict falls to an adversary that shares no code with the criteria; see ``adversary``."""

from __future__ import annotations

import pytest
from adversary import common, smooth_loops, switched_ticks, user_ticks

pytestmark = pytest.mark.second

ADVERSARIES = common.adversaries()
SLOW = ("perturbation_seek", "reaching_law", "super_twisting")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in SLOW else n for n in ADVERSARIES]
)
def test_no_verdict_is_false(name):
    """200 cases near the place where the search first succeeds; 10 000 by ``adversary/run.py``."""
    found = common.trial(ADVERSARIES[name], 200, seed=0, every=10, effort=2)
    print(f"{name}: {found.share_undecided:.0%} UNDECIDED")
    assert not found.false_certified
    assert not found.false_refuted
    assert min(found.certified, found.refuted) > 10
    assert found.share_undecided < 0.2


def test_no_tick_of_a_person_is_certified_falsely():
    """44 random ticks, also hostile ones; 10 000 by ``adversary/run.py``."""
    found = user_ticks.trial(44, seed=0)
    assert not found.false_certified
    assert not found.false_refuted
    assert min(found.certified, found.refuted, len(found.undecided_cases)) > 6


def test_no_state_machine_is_certified_falsely():
    """8 random machines behind a plant; 10 000 by ``adversary/run.py cells``."""
    found = switched_ticks.trial(8, seed=0)
    assert not found.false_certified
    assert not found.false_refuted
    assert min(found.certified, found.refuted) > 2


@pytest.mark.parametrize("trial", [smooth_loops.trial, smooth_loops.trial_of_tubes])
def test_no_sum_and_no_tube_is_false_and_less_is_never_harder(trial):
    """5 random loops each; 10 000 by ``adversary/run.py sums tube``."""
    found = trial(5, seed=3)
    assert not found.false_certified
    assert not found.false_refuted
    assert min(found.certified, found.refuted) > 0
