"""No verdict falls to an adversary that shares no code with the criteria; see ``adversary``."""

from __future__ import annotations

import pytest
from adversary import common

pytestmark = pytest.mark.second

ADVERSARIES = common.adversaries()


@pytest.mark.parametrize("name", ADVERSARIES)
def test_no_verdict_is_false(name):
    """200 cases near the place where the search first succeeds; 10 000 by ``adversary/run.py``."""
    found = common.trial(ADVERSARIES[name], 200, seed=0, every=10, effort=2)
    print(f"{name}: {found.share_undecided:.0%} UNDECIDED")
    assert not found.false_certified
    assert not found.false_refuted
    assert min(found.certified, found.refuted) > 10
    assert found.share_undecided < 0.2
