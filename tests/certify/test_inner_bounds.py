"""Pieces of proofs against what they bound, computed here another way."""

from __future__ import annotations

import math
from typing import Any

import pytest

from slipctl import BadInput
from slipctl.models.bounded_error.certificate.interval_systems import replay_drift
from slipctl.models.cheng_2022.certificate.dither_flight import _at_rest
from slipctl.models.wang_2025.certificate.saturated_motion import Saturated, half_turn


@pytest.mark.parametrize("late", [0, 3])
def test_what_is_heard_before_the_first_tick_is_the_lag_at_rest_with_the_dither(late):
    """(start + a sin)^2 for so long that a lag of ten ticks has forgotten where it began."""
    start, a, W, E = 0.3, 0.2, 0.4, 0.9
    heard = start**2
    for i in range(-600, 0):  # 0.9^600 is below 1e-27
        heard = E * heard + (1 - E) * (start + a * math.sin(W * (i - late))) ** 2
    assert _at_rest(start, a, W, late, E) == pytest.approx(heard, rel=1e-12)


@pytest.mark.parametrize("strong", [0.05, 0.5, 2.0])
def test_half_turn_of_a_saturated_motion_is_that_of_its_work(strong):
    """Cut all the way and undamped: strong s = weak R(s), also where R lies within a step of 0."""
    law = Saturated(1e9, 0.0, (strong, 1.0), (1.0, 1.0))
    for above, side in ((True, 1), (False, -1)):
        found = half_turn(law, 1.0, above, steps=10)
        assert found is not None
        # the force turns round within one step of the ten, by rounding before or after it
        assert 0 <= side * (found[0] - strong) <= 0.1 * (1 + strong) + 1e-9
        assert found[0] > 0
    assert half_turn(law, 1.0, True, steps=10)[1] == pytest.approx(
        math.sqrt(2 * strong), rel=0.06
    )  # the largest speed: half its square is the work up to zero, or a step further


@pytest.mark.parametrize("side", [2, -2, 1.5, "above"])
def test_a_drift_has_a_side(side):
    tick: Any = None  # is not looked at
    with pytest.raises(BadInput, match="side"):
        replay_drift({"side": side, "place": "0.1"}, tick)
