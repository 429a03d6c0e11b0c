"""Spellings of units: what people write who have no table at hand, and what they mean."""

from __future__ import annotations

import re

SPOKEN = {
    **dict.fromkeys(("U/min", "U/Min", "Upm", "UPM", "RPM", "Rpm", "rev/min", "r/min"), "rpm"),
    **dict.fromkeys(("U/s", "rev/s", "r/s", "rps"), "turn/s"),
    **dict.fromkeys(("Km/h", "KM/H", "km/H", "KM/h", "kmh", "Kmh", "KMH", "KPH", "Kph", "kmph",
                     "km/hr", "km/std"), "km/h"),
    **dict.fromkeys(("MPH", "Mph"), "mph"), **dict.fromkeys(("Bar", "BAR"), "bar"),
    **dict.fromkeys(("Prozent", "Percent", "pct"), "%"),
    **dict.fromkeys(("Promille", "promille", "permil"), "‰"),
    **dict.fromkeys(("Sek", "sek", "Sec", "SEC", "Sekunden", "secs"), "s"),
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
