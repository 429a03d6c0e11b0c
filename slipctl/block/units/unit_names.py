"""Names of units, in SI: those of railways, sensors and spreadsheets, and what people write."""

from __future__ import annotations

import math
import re
from fractions import Fraction

Dims = tuple[tuple[str, Fraction], ...]
"""Exponents by symbol (of SI base units, or of units as written), sorted, none of them zero."""


def dims_of(**exponents: int) -> Dims:
    """Exponents by name of the base unit."""
    return tuple(sorted((n, Fraction(e)) for n, e in exponents.items()))


_N, _J = dims_of(kg=1, m=1, s=-2), dims_of(kg=1, m=2, s=-2)
_W, _PA = dims_of(kg=1, m=2, s=-3), dims_of(kg=1, m=-1, s=-2)
_M, _S, _KG, _SPEED = dims_of(m=1), dims_of(s=1), dims_of(kg=1), dims_of(m=1, s=-1)

PREFIXES = {
    "n": 1e-9, "µ": 1e-6, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "da": 10.0, "h": 100.0,
    "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip

PREFIXED: dict[str, tuple[float, Dims]] = {
    "m": (1.0, _M), "g": (1e-3, _KG), "s": (1.0, _S), "Hz": (1.0, dims_of(s=-1)), "N": (1.0, _N),
    "J": (1.0, _J), "W": (1.0, _W), "Pa": (1.0, _PA), "bar": (1e5, _PA),
    "K": (1.0, dims_of(K=1)), "A": (1.0, dims_of(A=1)), "mol": (1.0, dims_of(mol=1)),
    "C": (1.0, dims_of(A=1, s=1)), "V": (1.0, dims_of(kg=1, m=2, s=-3, A=-1)),
    "ohm": (1.0, dims_of(kg=1, m=2, s=-3, A=-2)), "Ω": (1.0, dims_of(kg=1, m=2, s=-3, A=-2)),
    "F": (1.0, dims_of(kg=-1, m=-2, s=4, A=2)), "H": (1.0, dims_of(kg=1, m=2, s=-2, A=-2)),
    "T": (1.0, dims_of(kg=1, s=-2, A=-1)), "Wb": (1.0, dims_of(kg=1, m=2, s=-2, A=-1)),
    "l": (0.1**3, dims_of(m=3)), "L": (0.1**3, dims_of(m=3)), "Wh": (3600.0, _J),
    "Ah": (3600.0, dims_of(A=1, s=1)), "rad": (1.0, ()),
}  # fmt: skip
"""Units that take a prefix."""

PLAIN: dict[str, tuple[float, Dims]] = {
    "t": (1e3, _KG), "Mt": (1e9, _KG), "tonne": (1e3, _KG), "cd": (1.0, dims_of(cd=1)),
    "min": (60.0, _S), "h": (3600.0, _S), "hr": (3600.0, _S), "d": (86400.0, _S),
    "day": (86400.0, _S), "minute": (60.0, _S), "hour": (3600.0, _S), "second": (1.0, _S),
    "sec": (1.0, _S), "millisecond": (1e-3, _S), "microsecond": (1e-6, _S),
    "meter": (1.0, _M), "metre": (1.0, _M), "kilometer": (1e3, _M), "kilometre": (1e3, _M),
    "millimeter": (1e-3, _M), "millimetre": (1e-3, _M), "in": (0.0254, _M), "inch": (0.0254, _M),
    "inches": (0.0254, _M), "ft": (0.3048, _M), "foot": (0.3048, _M), "feet": (0.3048, _M),
    "yd": (0.9144, _M), "yard": (0.9144, _M), "mi": (1609.344, _M), "mile": (1609.344, _M),
    "mph": (0.44704, _SPEED), "kph": (1e3 / 3600, _SPEED), "knot": (1852 / 3600, _SPEED),
    "kilogram": (1.0, _KG), "gram": (1e-3, _KG), "lb": (0.45359237, _KG), "lbs": (0.45359237, _KG),
    "pound": (0.45359237, _KG), "oz": (0.45359237 / 16, _KG), "long_ton": (1016.0469088, _KG),
    "short_ton": (907.18474, _KG), "newton": (1.0, _N), "kgf": (9.80665, _N),
    "lbf": (0.45359237 * 9.80665, _N), "pound_force": (0.45359237 * 9.80665, _N),
    "kip": (453.59237 * 9.80665, _N), "dyn": (1e-5, _N), "watt": (1.0, _W), "joule": (1.0, _J),
    "pascal": (1.0, _PA), "volt": PREFIXED["V"], "ampere": PREFIXED["A"], "kelvin": PREFIXED["K"],
    "hertz": PREFIXED["Hz"], "liter": PREFIXED["l"], "litre": PREFIXED["l"],
    "psi": (0.45359237 * 9.80665 / 0.0254**2, _PA), "atm": (101325.0, _PA),
    "cal": (4.184, _J), "Btu": (1055.05585262, _J),
    "hp": (550 * 0.3048 * 0.45359237 * 9.80665, _W), "metric_horsepower": (75 * 9.80665, _W),
    "rpm": (2 * math.pi / 60, dims_of(s=-1)), "turn": (2 * math.pi, ()),
    "revolution": (2 * math.pi, ()), "cycle": (2 * math.pi, ()), "radian": (1.0, ()),
    "deg": (math.pi / 180, ()), "degree": (math.pi / 180, ()), "°": (math.pi / 180, ()),
    "arcmin": (math.pi / 10800, ()), "arcsec": (math.pi / 648000, ()),
    "%": (1e-2, ()), "percent": (1e-2, ()), "‰": (1e-3, ()), "permille": (1e-3, ()),
    "ppm": (1e-6, ()), "count": (1.0, ()),
}  # fmt: skip
"""Units that take none, and names written in full."""

SPOKEN = {
    **dict.fromkeys(("U/min", "U/Min", "Upm", "UPM", "RPM", "Rpm", "rev/min", "r/min"), "rpm"),
    **dict.fromkeys(("U/s", "rev/s", "r/s", "rps"), "turn/s"),
    **dict.fromkeys(("Km/h", "KM/H", "km/H", "KM/h", "kmh", "Kmh", "KMH", "KPH", "Kph", "kmph",
                     "km/hr", "km/std"), "km/h"),
    **dict.fromkeys(("MPH", "Mph"), "mph"), **dict.fromkeys(("Bar", "BAR"), "bar"),
    **dict.fromkeys(("Prozent", "Percent", "pct"), "%"),
    **dict.fromkeys(("Promille", "promille", "permil"), "‰"),
    **dict.fromkeys(("Sek", "sek", "Sec", "SEC", "Sekunden", "secs"), "s"),
    **dict.fromkeys(("msec", "mSec", "msek"), "ms"),
    **dict.fromkeys(("usec", "µsec"), "us"), "nsec": "ns",
    **dict.fromkeys(("KN", "Kn"), "kN"), **dict.fromkeys(("mps", "MPS"), "m/s"), "KNm": "kN m",
}  # fmt: skip
"""Unit that is meant, by what people write."""

REFUSED = {
    "ton": "ton is the American 2000 lb; write t (1000 kg)",
    "tons": "tons are the American 2000 lb; write t (1000 kg)",
    **{
        k: f"{k} is the {what}, a constant and not a unit"
        for k, what in {
            "c": "speed of light", "k": "Boltzmann constant", "e": "elementary charge",
            "R": "gas constant", "pi": "circle constant",
        }.items()
    },
    **dict.fromkeys(
        ("degC", "degF", "celsius", "fahrenheit", "degree_Celsius", "delta_degC", "dB", "dBm"),
        "it is a scale with an offset, a difference or a logarithm; write K or 1",
    ),
}  # fmt: skip
"""Names that are no unit or another one than is meant, and what is said of them."""

ONE_IN = re.compile(r"\s*([+-]?)\s*1\s*(?:in\s|:)\s*(-?(?:\d+\.?\d*|\.\d+))\s*")
"""A gradient as people say it, 1 in 25 or 1:25."""


def unit_by_name(name: str) -> tuple[float, Dims] | None:
    """Scale and dimensions of a unit with or without a prefix; None of one that is not known.

    A name written in full may be in the plural.
    """
    found = PLAIN.get(name) or PREFIXED.get(name)
    if found is not None:
        return found
    for prefix, scale in PREFIXES.items():
        rest = PREFIXED.get(name.removeprefix(prefix)) if name.startswith(prefix) else None
        if rest is not None:
            return rest[0] / round(1 / scale) if scale < 1 else rest[0] * scale, rest[1]
    if len(name) > 4 and name.endswith("s"):
        return PLAIN.get(name[:-1])
    return None
