"""The bench of tune says what a search took and what it brought."""

from __future__ import annotations

import pytest

from bench import tuning

pytestmark = pytest.mark.second


@pytest.mark.long
def test_a_search_is_told():
    found = tuning.row("subway_braking:sta", samples=4, held_out=2, runs=16)
    assert found["numbers"] == 2
    assert 16 <= found["runs"] < 80  # a generation is ended
    assert found["fewer"] == 100**2 * 4 / found["runs"]
    assert found["tuned_minus_by_hand_m"] < found["standard_error_m"]
    assert found["not_worse"]
    assert found["margins"]["sta"][0] >= 1  # what was proved stays proved
