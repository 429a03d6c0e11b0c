"""What is added for rounding is added at each tick, to both ends: a proof in decimals needs it."""

from __future__ import annotations

from decimal import Decimal

import pytest

from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.models.bounded_error.certificate import scalar_maps as maps
from slipctl.models.bounded_error.certificate.scalar_maps import Interval
from slipctl.models.zhang_2021.certificate import sampled_funnel

FUNNEL = sampled_funnel.Funnel(
    **{k: Decimal(v) for k, v in {
        "K1": "100", "T": "0.001", "eta_0": "0.1", "eta_inf": "0.005", "k": "30", "lower": "1.2",
        "upper": "1.5", "W": "0.1", "noise": "0.0001"}.items()}
)  # fmt: skip


@pytest.mark.parametrize("slop", ["1e-30", "1e-6", "1e-3"])
@pytest.mark.parametrize("ticks", [1, 2, 7])
def test_a_funnel_is_followed_with_it(slop, ticks):
    """Of one tick it is the slop itself, up to the quantum; of more it grows, never falls below."""
    slop, start = Decimal(slop), Decimal("0.4")
    with precise(maps.DIGITS):
        plain = sampled_funnel.follow(FUNNEL, start, ticks)
        wide = sampled_funnel.follow(FUNNEL, start, ticks, slop)
        for more in (plain.low - wide.low, wide.high - plain.high):
            assert more >= slop - sampled_funnel.QUANTUM
            assert more <= ticks * slop + ticks * sampled_funnel.QUANTUM


@pytest.mark.parametrize("slop", ["1e-30", "1e-6", "1e-3"])
def test_a_set_is_kept_only_with_room_for_it(slop):
    """A set is kept by a tick where what is reached, and the slop, lie in it."""
    slop, tick = Decimal(slop), FUNNEL.standing()
    with precise(maps.DIGITS):
        z = Interval(Decimal("-0.6"), Decimal("0.6"))
        reached = maps.image(tick, z)
        assert maps.image(tick, z, slop) == Interval(reached.low - slop, reached.high + slop)
        room = min(reached.low - z.low, z.high - reached.high)
        assert room > 0
        assert maps.keeps(tick, z, room * Decimal("0.99"))
        assert not maps.keeps(tick, z, room * Decimal("1.01"))
