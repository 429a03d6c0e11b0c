"""Samples in order of time: runs, rows that were written late, times that are out of place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from slipctl.errors import BadInput

LATE = 5
"""Rows by which a row may have been written late."""

MOST = 50
"""Runs of a file, and times out of place, beyond which it is refused."""

COARSE = 0.2
"""Share of rows with the time of the row before from which on times are too coarse."""


@dataclass
class Order:
    """Rows in order of time.

    Attributes:
        rows: that are kept, in order.
        begins: places in ``rows`` where a further run begins.
        notes: what was done.
    """

    rows: np.ndarray
    begins: list[int] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def in_order(
    t: np.ndarray, place: Callable[[int], str], same: Callable[[int, int], bool], where: str
) -> Order:
    """Put rows in order of time.

    A row that fits into a hole a few rows above was written late and goes there. One time that
    fits nowhere is left out. Where the clock goes back for good, a further run begins.

    Args:
        t: time of each row in s, NaN where there is none.
        place: what a row is called, such as ``line 12``.
        same: whether two rows have the same cells.
        where: file and column.

    Raises:
        BadInput: fewer than two times, times too coarse or in no order.
    """
    rows = [int(k) for k in np.flatnonzero(np.isfinite(t))]
    notes = []
    if len(rows) < t.size:
        lost = [int(k) for k in np.flatnonzero(~np.isfinite(t))]
        notes.append(f"{many_rows(len(lost))} without a time, left out: {first_of(lost, place)}")
    if len(set(t[rows])) < 2:
        raise BadInput(f"{where} has fewer than two different times")
    steps = np.diff(t[rows])
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if (steps <= 0).all():
        raise BadInput(f"{where}: the times fall from row to row; sort the rows by time")
    found = _walk(t, rows, usual, place, same, where)
    return Order(found.rows, found.begins, notes + found.notes)


def _walk(
    t: np.ndarray, rows: list[int], usual: float, place: Callable[[int], str],
    same: Callable[[int, int], bool], where: str,
) -> Order:  # fmt: skip
    """Take row after row, and settle each that does not come after the one before."""
    kept: list[int] = []
    begins: list[int] = []
    late, wild, twice, equal = [], [], [], []
    for n, row in enumerate(rows):
        if not kept or t[row] > t[kept[-1]]:
            kept.append(row)
            continue
        last = begins[-1] if begins else 0
        tail = kept[max(last, len(kept) - 3 * LATE) :]
        if t[row] == t[kept[-1]]:
            equal.append(row)
            kept[-1] = row
        elif any(t[k] == t[row] and same(k, row) for k in tail):
            twice.append(row)
        elif (at := _hole(t, kept, last, row, usual)) is not None:
            kept.insert(at, row)
            late.append(row)
        elif n + 1 < len(rows) and 1.5 * usual <= t[rows[n + 1]] - t[kept[-1]] <= 2.5 * usual:
            wild.append(row)
        elif len(kept) - last > 1 and 1.5 * usual <= t[row] - t[kept[-2]] <= 2.5 * usual:
            wild.append(kept[-1])
            kept[-1] = row
        else:
            if len(kept) - last < 2:
                raise BadInput(f"{where}: the time goes back in {place(row)}, after a single row;"
                               " sort the rows by time")  # fmt: skip
            begins.append(len(kept))
            kept.append(row)
        if len(begins) > MOST or len(wild) + len(late) + len(twice) > max(3, 0.05 * len(rows)):
            raise BadInput(f"{where}: the time goes back again and again, the last time in"
                           f" {place(row)}; sort the rows by time")  # fmt: skip
    if len(equal) > max(3.0, COARSE * len(rows)):
        raise BadInput(f"{where}: {len(equal)} rows have the time of the row before, the first in"
                       f" {place(equal[0])}; write times with more digits,"
                       " or one vehicle in a log")  # fmt: skip
    if begins and len(kept) - begins[-1] < 2:
        raise BadInput(f"{where}: the time goes back in {place(kept[-1])}, the last row; remove it")
    return Order(np.array(kept), begins, _lines(t, kept, begins, (late, wild, twice, equal), place))


def _hole(t: np.ndarray, kept: list[int], last: int, row: int, usual: float) -> int | None:
    """Where a late row goes: between two rows that are so far apart as if some were missing."""
    for at in range(len(kept) - 1, max(last, len(kept) - LATE - 1), -1):
        low, high = t[kept[at - 1]], t[kept[at]]
        if low < t[row] < high:
            parts = np.array([t[row] - low, high - t[row]]) / usual
            fits = parts.min() >= 0.75 and parts.sum() <= LATE + 2
            return at if fits and (np.abs(parts - np.round(parts)) <= 0.25).all() else None
    return None


def _lines(
    t: np.ndarray, kept: list[int], begins: list[int], odd: tuple[list[int], ...],
    place: Callable[[int], str],
) -> list[str]:  # fmt: skip
    """What was done."""
    late, wild, twice, equal = odd
    notes = []
    for rows, done in (
        (late, "written late, sorted by time"),
        (wild, "with a time out of order, left out"),
        (twice, "repeated, left out"),
        (equal, "with the time of the row before, which was left out"),
    ):
        if rows:
            notes.append(f"{many_rows(len(rows))} {done}: {first_of(rows, place)}")
    for n, k in enumerate(begins, 2):
        before, after = t[kept[k - 1]] - t[kept[0]], t[kept[k]] - t[kept[0]]
        notes.append(f"{place(kept[k])}: the time goes back from {before:.6g} s to {after:.6g} s"
                     f" behind the first row; run {n} begins there")  # fmt: skip
    return notes


def many_rows(many: int, what: str = "row") -> str:
    """Number of rows, or of something else, in words."""
    return f"{many} {what}{'s' * (many != 1)}"


def first_of(rows: Sequence[int], place: Callable[[int], str]) -> str:
    """Where rows are: the place of the first one."""
    return f"{'the first in ' * (len(rows) > 1)}{place(rows[0])}"


def continuous_clock(t: np.ndarray, period: float) -> tuple[np.ndarray, list[int]]:
    """Times of a clock that begins anew after a period (midnight), and the rows where it did.

    Only a step that is short once the period is added is one; other steps back stay.
    """
    found = t.copy()
    at: list[int] = []
    if not period:
        return found, at
    rows = np.flatnonzero(np.isfinite(t))
    steps = np.diff(t[rows])
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for n in np.flatnonzero(steps < 0):
        if 0 < steps[n] + period <= max(20 * usual, 1e-6):
            found[rows[n + 1] :] += period
            at.append(int(rows[n + 1]))
    return found, at
