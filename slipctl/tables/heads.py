"""Heads of columns: name and unit in all the ways that people write both."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

from slipctl.block.units.unit_algebra import dimension_equal, unit
from slipctl.errors import BadInput

_BRACKETS = re.compile(r"^(.*?)[\s_]*(?:\[([^\]]*)\]|\(([^()]*)\)|\{([^}]*)\}|<([^>]*)>)\s*$")
_SPOKEN = re.compile(r"^(.+?)(?:\s*,\s*|\s*/\s*)\(?([^\s()]+(?: [^\s()]+)?)\)?$")
_BLANK = re.compile(r"^(.+?)(?:\s+([^\s_]+)|_([^\s_]+/[^\s_]+))$")

SURE = frozenset(
    ("km/h", "m/s", "mph", "kph", "kmh", "bar", "mbar", "kPa", "hPa", "kN", "Nm", "kNm", "rpm",
     "U/min", "1/min", "rad/s", "m/s2", "m/s²", "m/s^2", "%", "‰", "ms", "us", "µs", "ns", "Km/h",
     "KM/H", "km/s", "mm/s", "°/s")
)  # fmt: skip
"""Units that nobody takes for a word, behind a name without brackets."""

LETTERS = frozenset(
    ("s", "m", "N", "h", "V", "A", "t", "kg", "Pa", "K", "J", "W", "min", "sec", "mm", "km")
)
"""Units that only stand behind a name with a comma or a slash."""

IN_NAMES = {
    **dict.fromkeys(("kmh", "kph", "kmph", "kmperh"), "km/h"), "mph": "mph",
    **dict.fromkeys(("mps", "mpers"), "m/s"), **dict.fromkeys(("cms", "cmps"), "cm/s"),
    "mmps": "mm/s", "fps": "ft/s", **dict.fromkeys(("knots", "kts"), "knot"),
    **dict.fromkeys(("rpm", "upm"), "rpm"),
    **dict.fromkeys(("radps", "rads"), "rad/s"), **dict.fromkeys(("mps2", "mss"), "m/s^2"),
    **{n.lower(): n for n in ("bar", "mbar", "kPa", "hPa", "psi", "kN", "daN", "Nm", "kNm", "kW")},
    **dict.fromkeys(("percent", "pct", "prozent"), "%"),
    **dict.fromkeys(("permille", "promille"), "‰"),
    "degc": "degC", "degf": "degF",
}  # fmt: skip
"""Units within a name, such as speed_kmh."""

AT_END = {
    **{n.lower(): n for n in ("km", "cm", "mm", "deg", "Hz", "kHz", "kV", "kA", "MPa", "kWh")},
    **dict.fromkeys(("degps", "degpers"), "deg/s"), "mmpers": "mm/s",
}  # fmt: skip
"""Units that only end a name, such as way_km."""

IN_TIMES = {
    **dict.fromkeys(("ns", "nanos", "nsec", "nanoseconds"), "ns"),
    **dict.fromkeys(("us", "µs", "μs", "micros", "usec", "microseconds"), "us"),
    **dict.fromkeys(("ms", "millis", "msec", "milliseconds", "millisekunden"), "ms"),
    **dict.fromkeys(("s", "sec", "secs", "seconds", "sekunden", "sek"), "s"),
    **dict.fromkeys(("min", "minutes", "minuten", "mins"), "min"),
    **dict.fromkeys(("h", "hours", "stunden"), "h"), **dict.fromkeys(("days", "tage"), "d"),
}  # fmt: skip
"""Units within the name of a time."""

TIMES = (
    "time", "t", "timestamp", "zeit", "zeitstempel", "uhrzeit", "messzeit", "datetime", "ts",
    "elapsed", "elapsedtime", "epoch", "epochtime", "unixtime", "unix", "clock", "seconds", "sec",
    "utc", "utctime", "gpstime", "systime", "systemtime", "datumuhrzeit", "datetimeutc", "timeutc",
    "localtime", "dateandtime", "reltime", "temps", "tempo", "tiempo", "s", "ms", "us", "ns",
    "millis", "micros", "zeitpunkt", "logtime", "timeofday", "horodatage", "tid", "czas",
)  # fmt: skip
"""Names of a column of times, without their unit, the likeliest first."""

DATES = ("date", "datum", "day", "tag", "fecha", "data", "calendardate")
"""Names of a column of dates beside one of clock times."""


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known; - is none at all."""
    return bool(text) and not why_no_unit(text)


def is_offset(text: str) -> bool:
    """Whether a text is a scale with an offset, such as degC."""
    return "offset" in why_no_unit(text)


@lru_cache(maxsize=1024)
def why_no_unit(text: str) -> str:
    """Why a text is no unit; empty where it is one that somebody may mean in a head."""
    if text in ("Mbar", "Mm", "Ms"):
        return f"unit {text!r} is a million {text[1:]}; write {text[1:]}, or m{text[1:]}"
    try:
        unit(text)
    except BadInput as error:
        return str(error)
    return ""


def name_and_unit(head: str) -> tuple[str, str]:
    """Name and unit of a head, the unit empty where it says none, ``"1"`` for ``[-]``."""
    head = " ".join(head.split())
    match = _BRACKETS.match(head)
    inner = re.fullmatch(r"(.+?)\s*\[([^\]]+)\]\s*(\S.*)", head)
    if inner and is_unit(inner[2]) and inner[3][0] != "[":  # Speed [km/h] (raw)
        if re.match(r"[x*×·/]\s*\d", inner[3]):  # of v [km/h] *10 nobody can read the unit
            return inner[1], f"{inner[2]} {inner[3]}"
        return f"{inner[1]} {inner[3]}", inner[2]
    spoken = re.fullmatch(r"(.+?)\s+in\s+\(?(\S+?)\)?", head)
    if spoken and (spoken[2] == "-" or is_unit(spoken[2]) or is_offset(spoken[2])):
        return spoken[1], "1" if spoken[2] == "-" else spoken[2]
    if match and match[1].strip():
        said = next(g for g in match.groups()[1:] if g is not None).strip()
        name = match[1].strip().removesuffix("/").rstrip() if "(" in head else match[1].strip()
        if times := re.fullmatch(r"(.*[^\s*×])\s*([*×]\s*\d\S*)", name):  # nor of v*10 [km/h]
            name, said = times[1], f"{said} {times[2]}"
        return name, "1" if said in ("", "-", "--", "1") else said
    match = _BLANK.match(head)
    if match and (match[2] or match[3]) in SURE and match[1][-1] not in ",/":
        return match[1], match[2] or match[3]  # before the next: of v km/h the unit is not h
    match = _SPOKEN.match(head)
    if match and (match[2] in SURE or match[2] in LETTERS):
        return match[1].strip(), match[2]
    return head, ""


def words(name: str) -> list[str]:
    """Words of a name in small letters: TimeUS, time_us and time us are all time and us."""
    found: list[str] = []
    for word in re.split(r"[\W_]+", name):
        # kN, degC are one word
        known = any(word.lower() in units for units in (IN_NAMES, AT_END, IN_TIMES))
        parted = word if known else re.sub(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])", " ", word)
        found += parted.lower().split()
    return found


def unit_in_name(name: str, wanted: str) -> str:
    """Unit of the wanted dimension that a name holds, such as km/h in speed_kmh; else empty.

    It may be the whole name, as in RPM, but for a time: min and s are names. A number behind it
    counts, as in rpm_1 and rpm1.
    """
    parts = words(name)
    if dimension_equal(wanted, "s"):
        found = {IN_TIMES[w] for w in parts[1:] if w in IN_TIMES}
    else:
        bare = [w if w in IN_NAMES else w.rstrip("0123456789") for w in parts]
        bare = [w for w in bare if w]
        pairs = [a + "per" + b for a, b in pairwise(bare)]
        found = {IN_NAMES[w] for w in (*bare, *pairs) if w in IN_NAMES}
        found |= {AT_END[w] for w in (*bare[-1:], *pairs[-1:]) if w in AT_END}
    fitting = [u for u in found if u not in ("degC", "degF") and dimension_equal(u, wanted)]
    return fitting[0] if len(fitting) == 1 else ""


def other_unit_in_name(name: str, wanted: str) -> str:
    """Unit that ends a name and is of another dimension than the wanted one, as in speed_rpm."""
    last = IN_NAMES.get(words(name)[-1], "") if len(words(name)) > 1 else ""
    kind = "K" if last in ("degC", "degF") else last
    return "" if not last or unit_in_name(name, wanted) or dimension_equal(kind, wanted) else last


def time_in_name(name: str) -> tuple[int, str] | None:
    """Rank among names of times, the likeliest first, and the unit that the name says; or None."""
    parts = words(name)
    told = ""
    if len(parts) > 1 and parts[-1] in IN_TIMES:
        told, parts = IN_TIMES[parts[-1]], parts[:-1]
        if parts[-1] == "in" and len(parts) > 1:
            parts = parts[:-1]
    elif parts and parts[0] not in TIMES:
        glued = re.fullmatch(r"(time|timestamp|zeit)(ns|us|µs|ms|s|sec|min)", parts[0])
        if glued and len(parts) == 1:
            told, parts = IN_TIMES[glued[2]], [glued[1]]
    joined = "".join(parts)
    if joined not in TIMES:
        return None
    return TIMES.index(joined), told or IN_TIMES.get(joined, "")


def is_unit_row(cells: Sequence[str], above: Sequence[str]) -> bool:
    """Whether a row holds the units of the heads above it; some may be unknown."""
    given = [c.strip().strip("[](){}<>").strip() for c in cells]
    some = [g for g in given if g]
    if not some or len(cells) > len(above) or not any(a.strip() for a in above):
        return False
    if any(not a.strip() and g for g, a in zip(given, above, strict=False)):
        return False
    times = [g for g, a in zip(given, above, strict=False)
             if g and time_in_name(name_and_unit(a)[0])]  # fmt: skip
    if not all(is_time_unit(t) for t in times):
        return False
    known = sum(g in ("-", "--") or is_unit(g) or is_offset(g) for g in some)
    return bool(times) or (2 * known >= len(some) and not {"t", "time"} & set(given))


def is_time_unit(text: str) -> bool:
    """Whether a text is a unit of time, or says how a clock is written."""
    if re.fullmatch(r"(?i)[dmyhs:.\-/ T]{4,}", text):
        return True
    return is_unit(text) and dimension_equal(text, "s")
