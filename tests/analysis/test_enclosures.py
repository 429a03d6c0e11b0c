"""Ranges that are proved hold what is sampled, and are not much wider."""

import numpy as np
import pytest
from casadi import acos, asin, sin
from enclosures import LAWS, case

import slipctl as sc
from slipctl import BadInput
from slipctl.analysis.bounding import enclosure


@pytest.mark.parametrize("name", LAWS)
def test_an_enclosure_holds_every_sample_and_is_not_much_wider(name):
    """1.3 times at most, over slips and parameters; ``.ci/full`` tries 10 000 boxes."""
    for seed in range(5):
        found = case(name, seed)
        assert found.ends[0] <= found.seen[0]
        assert found.seen[1] <= found.ends[1]
        assert found.wide <= 1.3


def test_a_range_in_closed_form():
    """The arc cosine falls, the arc sine rises, and their sum is pi/2 everywhere."""

    @sc.law(y=sc.Output("1"))
    def arc(u=sc.Input("1")):
        return acos(u) + asin(u) + sin(3 * u)

    low, high = enclosure(arc, "y", {"u": (0.0, 0.9)}, 1e-3)
    assert low <= np.pi / 2
    assert high >= np.pi / 2 + 1
    assert high - low <= 1.01


def test_what_has_no_range_is_refused():
    @sc.law(y=sc.Output("1"))
    def law(u=sc.Input("1")):
        return u

    with pytest.raises(BadInput, match="has no output 'z'"):
        enclosure(law, "z", {"u": (0, 1)})
    with pytest.raises(BadInput, match=r"range 1\.\.1 of u is empty"):
        enclosure(law, "y", {"u": (1, 1)})
    with pytest.raises(BadInput, match=r"range 0\.\.inf of u is empty"):
        enclosure(law, "y", {"u": (0, np.inf)})


def test_a_number_without_effect_and_a_long_box_cost_no_width():
    """Polach's law over slips on both sides of its peak, with a speed that it does not use."""
    found = case("contact.polach", 8)
    assert found.ends[0] <= found.seen[0]
    assert found.seen[1] <= found.ends[1]
    assert found.wide <= 1.3
