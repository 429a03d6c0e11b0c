"""A margin on a range: the larger range holds the smaller one, whatever its lower end is."""

from __future__ import annotations

from fractions import Fraction

import pytest

from slipctl.certify.systems import INPUT, TARGET
from slipctl.design.promises import with_margin
from slipctl.models.vehicle.certificate.slide_kind import NUMBERS, slide_system
from slipctl.models.wang_2025.certificate.saturation_kind import SATURATION


@pytest.mark.parametrize("by", [1.0, 1.2, 3.0])
def test_a_height_goes_both_ways(by):
    """The least height is divided, the largest multiplied; times and targets stay."""
    n = {k: Fraction(k in ("least", "most") or 2) for k, v in NUMBERS.items() if v.role == INPUT}
    n |= {"v": Fraction(10), "demand": Fraction(5), "band": Fraction(3)}
    found = with_margin(slide_system(None), n, by)
    assert found["least"] * Fraction(by) == pytest.approx(1)
    assert found["most"] == found["W"] / 2 == pytest.approx(by)
    assert {k: found[k] for k in ("T", "dead", "v", "demand", "band")} == {
        k: n[k] for k in ("T", "dead", "v", "demand", "band")
    }
    assert NUMBERS["band"].role == TARGET


@pytest.mark.parametrize("low", [-2, 0, 3])
def test_a_need_below_zero_goes_further_below(low):
    found = with_margin(SATURATION, {"F_low": Fraction(low), "F_high": Fraction(5)}, 1.5)
    assert found["F_low"] <= low
    assert found["F_high"] == Fraction(15, 2)
