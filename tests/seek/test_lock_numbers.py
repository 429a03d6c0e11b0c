"""Numbers of a seeker that locks: each has the unit that makes its equation fit."""

from __future__ import annotations

import pytest

from slipctl.block.units.unit_algebra import unit
from slipctl.seek import lock

GIVEN = dict.fromkeys(
    ("k", "rho", "beta", "planes", "gain", "a", "w", "w_h", "w_l", "r", "q", "reach", "tolerance",
     "forget", "wait"), 1.5)  # fmt: skip


@pytest.mark.parametrize(("place", "value"), [("m/s", "1"), ("1", "N"), ("m/s", "kN")])
def test_units_are_those_of_the_place_and_of_the_value(place: str, value: str) -> None:
    found = {s.name: s for s in lock._numbers(place, value, **GIVEN)}
    quotient = {
        "k": (place, "s"), "rho": (value, "s"), "beta": (value, "1"), "a_0": (place, "1"),
        "gain": (place, f"({value}) s"), "r": (place, f"({value})"), "reach": (place, "1"),
        "planes": ("1", "1"), "w": ("rad", "s"), "w_h": ("1", "s"), "w_l": ("1", "s"),
        "q": ("1", "s"), "tolerance": ("1", "1"), "forget": ("1", "s"), "wait": ("s", "1"),
    }  # fmt: skip
    assert set(found) == set(quotient)
    for name, (top, bottom) in quotient.items():
        wanted = unit(f"({top})/({bottom})")
        ours = unit(found[name].unit)
        assert ours.dims == wanted.dims, name
        assert ours.scale == pytest.approx(wanted.scale), name
        assert found[name].value == 1.5
        assert found[name].hi == 1e12
    outputs = {s.name: s.unit for s in lock._outputs(place, value)}
    assert outputs == {"v": place, "delta": value, "mode": "1", "amplitude": place, "kept": value}
