"""Times as people write them: clock times, dates in any order of day and month, with zones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from fractions import Fraction
from itertools import pairwise

from slipctl.errors import BadInput

MONTHS = {
    n: k for k, names in enumerate(
        ("jan january januar jän", "feb february februar", "mar march mär märz mrz",
         "apr april", "may mai", "jun june juni", "jul july juli", "aug august",
         "sep sept september", "oct october okt oktober", "nov november",
         "dec december dez dezember"), 1,
    ) for n in names.split()
}  # fmt: skip

_CLOCK = re.compile(
    r"(?:(?P<days>\d{1,5})\s+days?,?\s+)?(?P<h>\d{1,3}):(?P<m>\d{1,2})(?::(?P<s>\d{1,2}))?"
    r"(?:(?P<mark>[.,:])(?P<f>\d{1,12}))?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
    r"\s*(?:(?P<zone>Z|UTC|GMT)|(?P<sign>[+-])(?P<zh>\d{2}):?(?P<zm>\d{2})?)?"
)
_DATES: dict[str, tuple[re.Pattern[str], tuple[str, ...]]] = {
    "year": (re.compile(r"(\d{4})([-/.])(\d{1,2})\2(\d{1,2})"), ("ymd",)),
    "dots": (re.compile(r"(\d{1,2})(\.)(\d{1,2})\.(\d{4}|\d{2})"), ("dmy",)),
    "slashes": (re.compile(r"(\d{1,2})([-/])(\d{1,2})\2(\d{4}|\d{2})"), ("dmy", "mdy", "ymd")),
    "name": (re.compile(r"(\d{1,2})([-. ]+)([^\W\d_]{3,9})[-., ]+(\d{4}|\d{2})"), ("dmy",)),
    "name first": (re.compile(r"([^\W\d_]{3,9})([-. ]+)(\d{1,2}),? +(\d{4})"), ("mdy",)),
}


def _clock(text: str) -> tuple[Fraction, int] | None:
    """Seconds of a clock time, and seconds after which it begins anew (0 where it does not)."""
    match = _CLOCK.fullmatch(text.strip())
    if match is None:
        return None
    h, m = int(match["h"]), int(match["m"])
    s = None if match["s"] is None else int(match["s"])
    if s is None and match["mark"] == ":":
        return None
    if match["mark"] == ":" and len(match["f"]) != 3:
        return None
    part = Fraction(int(match["f"] or 0), 10 ** len(match["f"] or ""))
    if s is None:  # 59:58.0 is minutes and seconds, as a spreadsheet shows them
        if not match["f"] or match["half"] or m > 59:
            return None
        return Fraction(60 * h + m) + part, 3600 if h < 60 else 0
    if m > 59 or s > 60 or (match["half"] and not 1 <= h <= 12):
        return None
    if match["half"]:
        h = h % 12 + 12 * (match["half"][0] in "pP")
    zone = 0
    if match["sign"]:
        zone = (3600 * int(match["zh"]) + 60 * int(match["zm"] or 0)) * (
            -1 if match["sign"] == "-" else 1
        )
    total = 86400 * int(match["days"] or 0) + 3600 * h + 60 * m + s - zone
    return Fraction(total) + part, 86400 if h < 24 and not match["days"] else 0


def _day(text: str) -> dict[str, int] | None:
    """Day number of a date in each order of day and month that it may have."""
    for pattern, orders in _DATES.values():
        match = pattern.fullmatch(text.strip())
        if match is None:
            continue
        found = {}
        for order in orders:
            parts = dict(zip(order, (match[1], match[3], match[4]), strict=True))
            if len(parts["y"]) == 1:
                continue
            year = int(parts["y"]) + (2000 if len(parts["y"]) == 2 else 0)
            month = (
                parts["m"]
                if parts["m"].isdigit()
                else MONTHS.get(parts["m"].lower().rstrip("."), 0)
            )
            try:
                found[order] = date(year, int(month), int(parts["d"])).toordinal()
            except ValueError:
                continue
        return found or None
    return None


def _split(text: str) -> tuple[str, str]:
    """Date and clock time of a cell, either of which may be empty."""
    text = text.strip()
    if "T" in text[8:11]:
        left, _, right = text.partition("T")
        return left, right
    match = re.search(r"(?:^|[\s,]+)(\d{1,3}:\d{1,2}.*)$", text)
    if match is None:
        return text, ""
    if re.match(r"\d+\s+days?\b", text):
        return "", text
    return text[: match.start()].rstrip(" ,"), match[1]


def is_date(text: str) -> bool:
    """Whether a cell is a date without a clock time."""
    return _day(text) is not None


def is_time(text: str) -> bool:
    """Whether a cell is a clock time, or a date with or without one."""
    day, clock = _split(text)
    return bool((not day or _day(day)) and (not clock or _clock(clock)) and (day or clock))


def seconds_of(
    cells: Sequence[str], rows: Sequence[int], where: str
) -> tuple[list[Fraction | None], int]:
    """Seconds of each cell, None of an empty one.

    Args:
        cells: a clock time, or a date with or without one; empty where there is none.
        rows: of the cells, for a message.
        where: file, column and what a row is called.

    Returns:
        The seconds, and after how many the clock begins anew, 0 where it does not.

    Raises:
        BadInput: a cell that is no time, or dates of which day and month cannot be told apart.
    """
    days: dict[str, list[int | None]] = {"ymd": [], "dmy": [], "mdy": []}
    clocks: list[Fraction | None] = []
    wraps, dated = [], False
    cache: dict[str, dict[str, int] | None] = {}
    for cell, row in zip(cells, rows, strict=True):
        if not cell:
            clocks.append(None)
            for each in days.values():
                each.append(None)
            continue
        day, clock = _split(cell)
        if day not in cache:
            cache[day] = _day(day) if day else {}
        said, at = cache[day], _clock(clock) if clock else (Fraction(0), 0)
        if said is None or at is None:
            raise BadInput(
                f"{where} {row}: {cell[:40]!r} is no time that is known; write seconds, hh:mm:ss.f"
                " or 2024-05-01 hh:mm:ss.f"
            )
        if clocks and dated != bool(day) and any(c is not None for c in clocks):
            raise BadInput(f"{where} {row}: {cell[:40]!r} has other parts than the times before")
        dated = bool(day)
        clocks.append(at[0])
        wraps.append(at[1])
        for order, each in days.items():
            each.append(said.get(order))
    if not dated:
        return clocks, wraps[0] if len(set(wraps)) == 1 else 0
    return _joined(days, clocks, rows, where), 0


def _joined(
    days: dict[str, list[int | None]],
    clocks: list[Fraction | None],
    rows: Sequence[int],
    where: str,
) -> list[Fraction | None]:
    """Seconds of dates and clock times, in the one order of day and month that fits all."""
    some = [k for k, c in enumerate(clocks) if c is not None]
    ways = {}
    for order, each in days.items():
        if all(each[k] is not None for k in some):
            first = each[some[0]] or 0
            ways[order] = tuple((each[k] or 0) - first for k in some)
    if not ways:
        k = next((k for k in some if all(d[k] is None for d in days.values())), some[0])
        raise BadInput(f"{where} {rows[k]}: the dates are not written alike")
    if len(set(ways.values())) > 1:  # day and month change within the log
        likely = {o: w for o, w in ways.items() if all(abs(b - a) <= 1 for a, b in pairwise(w))}
        if len(likely) != 1:
            raise BadInput(f"{where} {rows[some[0]]}: which is the day and which the month cannot"
                           " be told; write 2024-05-01")  # fmt: skip
        ways = likely
    order = next(iter(ways))
    found: list[Fraction | None] = [None] * len(clocks)
    for k in some:
        found[k] = 86400 * Fraction(days[order][k] or 0) + (clocks[k] or 0)
    return found
