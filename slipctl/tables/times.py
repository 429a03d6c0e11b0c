"""The times of a table: which column holds them, in which unit, and as seconds from the first."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import numpy as np

from slipctl.block.units.unit_algebra import dimension_equal, factor, unit
from slipctl.errors import BadInput
from slipctl.tables import clock
from slipctl.tables.heads import DATES, is_time_unit, is_unit, name_and_unit, time_in_name, words
from slipctl.tables.numerals import is_empty, is_number
from slipctl.tables.order import continuous_clock
from slipctl.tables.table import Table

SLOW, FAST = 10.0, 1e-5
"""Steps in s that a log has not: beyond them times without a unit are refused."""

DAYS = (36525.0, 55000.0)
"""Days of a spreadsheet, from 2000 to 2050."""

EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}
"""Size of the seconds since 1970, in each unit; from .9 (1998) to 2.5 (2049) times this."""


_COMPACT = re.compile(r"0\d{5}(?:[.,]\d*)?|(?:19|20)\d{6}[ T]?\d{6}(?:[.,]\d*)?").fullmatch
"""Digits of a clock time or a date that stand together."""


def _is_compact(t: np.ndarray) -> bool:
    """Whether numbers are hours, minutes and seconds that stand together, as 123559 then 123600.

    They jump by 41 and more at each full minute, and read as a clock they go on evenly.
    """
    whole, t = np.floor(t), t.astype(float)
    if (t < 0).any() or (whole >= 240000).any() or (whole % 100 > 59).any():
        return False
    if (whole // 100 % 100 > 59).any():
        return False
    steps, even = np.diff(t), np.diff(t - 40 * (whole // 100) - 2400 * (whole // 10000))
    usual = np.median(steps) if steps.size else np.inf
    return bool(usual < SLOW and steps.max() > 40 and even.max() < 2.5 * usual)


def is_time_name(name: str) -> bool:
    """Whether a column may hold times or dates by its name."""
    pure = name_and_unit(name)[0]
    return time_in_name(pure) is not None or "".join(words(pure)) in DATES


def seconds_of_table(table: Table, wanted: str = "") -> tuple[np.ndarray, list[str]]:
    """Seconds of each row behind the first one that has a time, NaN where it has none.

    What was decided is told in the notes of the table.

    Args:
        table: the table.
        wanted: column of the times, with its unit if the head says none, ``"t[ms]"``; by default
            the one that is called so.

    Returns:
        The seconds, and the columns that they are from.

    Raises:
        BadInput: no such column, a unit that the head contradicts, times that cannot be read.
    """
    name, told = _column(table, wanted)
    told = _unit(table, name, told)
    cells = table.cells[name]
    where = f"{table.path}: {name}"
    if cells.dtype != object or _are_numbers(cells):
        return _of_numbers(table, name, told), [name]
    if (told and not is_time_unit(told)) or (told not in ("", "s") and is_unit(told)):
        raise BadInput(f"{where} is told in {told}, but {cells[0]!r} in {table.line}"
                       f" {table.lines[0]} is no number")  # fmt: skip
    texts = ["" if is_empty(c) else c.strip() for c in cells]
    day = _day_column(table, name, texts)
    if day:
        texts = [f"{d.strip()} {c}" if c and not is_empty(d) else "" for d, c in
                 zip(table.cells[day], texts, strict=True)]  # fmt: skip
        table.notes.append(f"times are {day} and {name}")
    found, period = clock.seconds_of(texts, table.lines, f"{where}: {table.line}")
    first = next((f for f in found if f is not None), 0)
    t = np.array([np.nan if f is None else float(f - first) for f in found])
    t, again = continuous_clock(t, period)
    for k in again:
        what = "midnight" if period == 86400 else "the full hour"
        table.notes.append(f"{name}: the clock passes {what} in {table.line} {table.lines[k]}")
    return t, [name, day] if day else [name]


def _column(table: Table, wanted: str) -> tuple[str, str]:
    """Column of the times, and the unit that a person told."""
    if wanted:
        try:
            return table.find(wanted), ""
        except BadInput:
            name, told = name_and_unit(wanted)
            return table.find(name), told
    ranked = []
    for k, n in enumerate(table.cells):
        said, own = time_in_name(n), table.units[n]
        if said is None or (own and not is_time_unit(own)) or (n == "T" and k and not own):
            continue
        ranked.append((said[0], n == "T", n))
    if ranked:
        best = min(ranked)[:2]
        return _only_one(table, [r[2] for r in sorted(ranked) if r[:2] == best]), ""
    alike = [
        n for n, cells in table.cells.items()
        if is_time_unit(table.units[n]) or (
            cells.dtype == object and clock.is_time(str(cells[0]))
            and not clock.is_date(str(cells[0]))
        )
    ]  # fmt: skip
    if alike:
        found = _only_one(table, alike)
        table.notes.append(f"{found} is taken for the time")
        return found, ""
    if same := [n for n in table.twice if time_in_name(n)]:
        table.find(same[0])
    raise BadInput(f"{table.path} has no column of times; say which by --time COLUMN[s]; it has"
                   f" {', '.join([*table.cells, *table.others][:12])}")  # fmt: skip


def _only_one(table: Table, names: list[str]) -> str:
    """Of columns that may all be the time, the one that rises; refused where clocks differ."""
    rising = [n for n in names if len(names) == 1 or _rises(table, n)] or names[:1]
    if other := [n for n in rising[1:] if not _same_clock(table, rising[0], n)]:
        raise BadInput(f"{table.path}: {rising[0]} and {other[0]} may both be the time, and they"
                       " differ; say which by --time COLUMN[s]")  # fmt: skip
    return rising[0]


def _rises(table: Table, name: str) -> bool:
    """Whether nine steps of ten between its numbers go up; clock times are taken for such."""
    cells = table.cells[name]
    if cells.dtype == object and not _are_numbers(cells):
        return True
    try:
        times = table.numbers(name).astype(float)
    except BadInput:
        return False
    steps = np.diff(times[np.isfinite(times)])
    return bool(steps.size and np.mean(steps > 0) > 0.9)


def _same_clock(table: Table, one: str, other: str) -> bool:
    """Whether two columns that rise tell the same times, within a step; texts, if they are equal.

    Where only one has a unit, or none, times in shares of the whole are compared.
    """
    a, b = table.cells[one], table.cells[other]
    if not all(c.dtype != object or _are_numbers(c) for c in (a, b)):
        return a.dtype != b.dtype or bool((a == b).all())
    units = [table.units[n] or (time_in_name(n) or (0, ""))[1] for n in (one, other)]
    known = all(is_time_unit(u) for u in units)
    past = []
    for n, u in zip((one, other), units, strict=True):
        t = table.numbers(n).astype(float)
        t = t - t[np.isfinite(t)][0]
        past.append(t * (unit(u).scale if known else 1 / np.nanmax(np.abs(t))))
    apart = np.abs(past[0] - past[1])
    both = np.isfinite(apart)
    return bool(both.sum() > 1 and apart[both].max() <= np.median(np.diff(past[0][both])))


def _unit(table: Table, name: str, told: str) -> str:
    """Unit of the times by all who say one; refused where they differ."""
    if name in table.typed:
        return "s"
    head, named = table.units[name], (time_in_name(name) or (0, ""))[1]
    if len(words(name)) == 1 and words(name)[0] == named:
        named = ""
    who = {"--time": told, "its head": head, "its name": named}
    said = {w: u for w, u in who.items() if u and not re.fullmatch(r"(?i)[dmyhs:.\-/ T]{4,}", u)}
    for w, u in said.items():
        if not is_unit(u) or not dimension_equal(u, "s"):
            raise BadInput(f"{table.path}: {name} is a time, but {w} says {u}, which is no unit of"
                           " time")  # fmt: skip
    if len({unit(u).scale for u in said.values()}) > 1:
        both = " and ".join(f"{w} {u}" for w, u in said.items())
        raise BadInput(f"{table.path}: {name} is in two units: {both}; leave out the wrong one")
    if list(said) == ["its name"]:
        table.notes.append(f"{name} is in {named} by its name")
    return next(iter(said.values()), "")


def _are_numbers(cells: np.ndarray) -> bool:
    first = next((c for c in cells if not is_empty(c)), "0")
    return is_number(first)


def _day_column(table: Table, name: str, texts: list[str]) -> str:
    """Column of dates that belongs to one of clock times; empty if there is none."""
    first = next((t for t in texts if t), "")
    if re.search(r"\d[-/.]\d+[-/.]\d", first.split(":")[0]):
        return ""
    for n, cells in table.cells.items():
        if n != name and "".join(words(n)) in DATES and cells.dtype == object and all(
            clock.is_date(c) for c in cells if not is_empty(c)
        ):  # fmt: skip
            return n
    return ""


def _of_numbers(table: Table, name: str, told: str) -> np.ndarray:
    """Times that are numbers, in s from the first one on."""
    cells = table.cells[name]
    t = cells if cells.dtype.kind in "iu" else table.numbers(name)
    if cells.dtype == object and (odd := [k for k, c in enumerate(cells) if _COMPACT(c)]):
        raise BadInput(f"{table.path}: {name}: {cells[odd[0]]!r} in {table.line}"
                       f" {table.lines[odd[0]]} may be hours, minutes and seconds; write"
                       " hh:mm:ss.f")  # fmt: skip
    finite = t[np.isfinite(t)]
    if not told and _is_compact(finite):
        raise BadInput(f"{table.path}: {name} has no unit, and {finite[0]:.10g} may be hours,"
                       " minutes and seconds; write hh:mm:ss.f, or"
                       f" say the unit by --time '{name}[s]'")  # fmt: skip
    if not finite.size:
        return np.full(len(t), np.nan)
    first = finite[0]
    passed = (t.astype(np.int64) - int(first)).astype(float) if t.dtype.kind in "iu" else t - first
    steps = np.abs(np.diff(passed[np.isfinite(passed)]))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    where = f"{table.path}: {name}"
    if told and (u := _epoch(first, step)) and unit(u).scale < unit(told).scale:
        raise BadInput(f"{where} is told in {told}, and {first:.6g} in {table.line}"
                       f" {table.lines[0]} looks like {u} since 1970; write that unit")  # fmt: skip
    if told and step * factor(told, "s") >= SLOW:
        table.notes.append(f"{name} goes on by {step * factor(told, 's'):.4g} s from row to row;"
                           f" look at its unit, {told}")  # fmt: skip
    if not told:
        told = _epoch(first, step)
        if told:
            day = datetime.fromtimestamp(float(first) * factor(told, "s"), UTC)
            table.notes.append(f"{name} has no unit; read in {told} since 1970, {day:%Y-%m-%d} on")
        elif DAYS[0] < first < DAYS[1] and 1e-4 < 86400 * step < SLOW and step < FAST * SLOW:
            told = "d"
            table.notes.append(f"{name} has no unit; read in days, as spreadsheets count them")
        elif step >= SLOW or 0 < step < FAST:
            raise BadInput(f"{where} has no unit, and s would be {step:.3g} s from row to row; say"
                           f" the unit by --time '{name}[ms]'")  # fmt: skip
        else:
            told = "s"
            table.notes.append(f"{name} has no unit in the head; read in s,"
                               f" {step:.4g} s from row to row")  # fmt: skip
    return passed * factor(told, "s")


def _epoch(first: float, step: float) -> str:
    """Unit in which times count from 1970 on, by the first one and the usual step; or empty."""
    return next((u for u, size in EPOCHS.items() if 0.9 * size < first < 2.5 * size
                 and step * factor(u, "s") < SLOW), "")  # fmt: skip
