"""How large each unit is in SI, as standards define it: exact numbers, typed here once more."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from slipctl.block.reach import measured_reach
from slipctl.block.units.unit_algebra import unit
from slipctl.block.units.unit_names import PLAIN, PREFIXED, PREFIXES
from slipctl.models.huang_2020.subway_braking import double_exponential

POUND, STANDARD, FOOT = Fraction("0.45359237"), Fraction("9.80665"), Fraction("0.3048")

SIZES = {
    "": "m s Hz N J W Pa K A mol C V ohm Ω F H T Wb rad cd second sec meter metre kilogram newton"
        " watt joule pascal volt ampere kelvin hertz radian count",
    "0.001": "g l L millisecond millimeter millimetre gram liter litre ‰ permille",
    "0.000001": "microsecond ppm", "0.01": "% percent", "0.00001": "dyn", "100000": "bar",
    "1000": "t tonne kilometer kilometre", "1000000000": "Mt", "60": "min minute",
    "3600": "h hr hour Wh Ah", "86400": "d day", "0.0254": "in inch inches",
    "0.3048": "ft foot feet", "0.9144": "yd yard", "1609.344": "mi mile", "0.44704": "mph",
    "5/18": "kph", "463/900": "knot", "1016.0469088": "long_ton", "907.18474": "short_ton",
    "9.80665": "kgf", "101325": "atm", "4.184": "cal", "1055.05585262": "Btu",
    "735.49875": "metric_horsepower",
}  # fmt: skip
MORE = {
    **dict.fromkeys(("lb", "lbs", "pound"), POUND), "oz": POUND / 16,
    **dict.fromkeys(("lbf", "pound_force"), POUND * STANDARD), "kip": 1000 * POUND * STANDARD,
    "psi": POUND * STANDARD / (FOOT / 12) ** 2, "hp": 550 * FOOT * POUND * STANDARD,
}  # fmt: skip
TURNS = {"turn": 1, "revolution": 1, "cycle": 1, "deg": 1 / 360, "degree": 1 / 360, "°": 1 / 360,
         "arcmin": 1 / 21600, "arcsec": 1 / 1296000, "rpm": 1 / 60}  # fmt: skip
EVERY = {name: float(Fraction(size or "1")) for size, names in SIZES.items()
         for name in names.split()}  # fmt: skip
EVERY |= {name: float(size) for name, size in MORE.items()}
EVERY |= {name: 2 * math.pi * share for name, share in TURNS.items()}


def test_each_unit_is_as_large_as_it_is_defined():
    assert EVERY.keys() == PLAIN.keys() | PREFIXED.keys()
    for name, size in EVERY.items():
        assert unit(name).scale == pytest.approx(size, rel=4e-16), name


def test_a_prefix_is_a_power_of_ten():
    powers = {"n": -9, "µ": -6, "u": -6, "m": -3, "c": -2, "d": -1, "da": 1, "h": 2, "k": 3,
              "M": 6, "G": 9}  # fmt: skip
    assert {p: float(Fraction(10) ** k) for p, k in powers.items()} == PREFIXES
    for p, k in powers.items():
        assert unit(f"{p}N").scale == pytest.approx(10.0**k, rel=4e-16)
        assert unit(f"{p}g").scale == pytest.approx(10.0 ** (k - 3), rel=4e-16)


def test_the_reach_of_points_is_their_largest_slip():
    found = measured_reach(double_exponential, {"other": [9.0], "v_s": [0.5, -3.25, 2.0]})
    assert found == {"measured_to": "3.25 m/s"}
    assert measured_reach(double_exponential, {"other": [9.0]}) == {}
