"""A table as read: columns with names, units and cells, and what was decided to read them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slipctl.block.units.unit_algebra import unit
from slipctl.errors import BadInput, nearest
from slipctl.tables import numerals
from slipctl.tables.heads import is_unit, name_and_unit, time_in_name
from slipctl.tables.layout import layout_of
from slipctl.tables.order import first_of, many_rows

LARGEST = 1e100
"""Largest number of a table: sums of squares stay far from what a number can hold."""


MISSING = (999, 999.25, 999.9, 9999, 99999, 999999, 32767, 32768, 65279, 65535, 2**31 - 1, 2**31,
           2**32 - 1, 1e20, 1e30, 9.969209968386869e36, 3.4028235e38)  # fmt: skip
"""Numbers of either sign that loggers write where nothing was measured."""


@dataclass
class Table:
    """A table.

    Attributes:
        path: where from.
        cells: of each column by its name, texts or numbers.
        units: of each column, as written; empty where the head says none.
        lines: of the file, or numbers, of the rows.
        line: what these are called.
        heads: names as they are written in the file, with their units.
        settings: ``name = value`` of comments ``# set name = value``, with their lines.
        done: how the file was read.
        notes: what was decided or left out, a line each.
        decimal: the decimal mark, if a person told it.
        mark: between the cells of a text.
        others: columns that were not read.
        typed: columns of times by their type, in s.
        twice: names that several columns have, none of which is read.
    """

    path: str
    cells: dict[str, np.ndarray]
    units: dict[str, str]
    lines: Sequence[int]
    line: str = "line"
    heads: dict[str, str] = field(default_factory=dict)
    settings: list[tuple[int, str, str]] = field(default_factory=list)
    done: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    decimal: str = ""
    mark: str = ""
    others: Sequence[str] = ()
    typed: Collection[str] = ()
    twice: Collection[str] = ()
    _read: dict[str, numerals.Column] = field(default_factory=dict)
    _numbers: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the columns that were read."""
        return list(self.cells)

    def find(self, name: str) -> str:
        """Name of a column, given as it is written in the file or in other letters.

        Raises:
            BadInput: there is none, with the nearest; or there are two.
        """
        if name in self.cells:
            return name
        if name in self.twice:
            raise BadInput(f"{self.path}: its head has two columns {name!r}; rename one")
        same = [n for n in self.cells if n.lower() == name.lower()]
        same = same or [n for n, h in self.heads.items() if h == name]
        if len(same) == 1:
            return same[0]
        known = [*self.cells, *self.others]
        raise BadInput(f"{self.path} has no column {name!r}{nearest(name, known)}")

    def column(self, name: str) -> numerals.Column:
        """The numbers of a column of texts, as written."""
        if name not in self._read:
            self._read[name] = numerals.column_of(self.cells[name].tolist())
        return self._read[name]

    def numbers(self, name: str) -> np.ndarray:
        """Numbers of a column, NaN where nothing was measured.

        Raises:
            BadInput: a cell that is no number, or one that can be read in two ways; says its row.
        """
        if name not in self._numbers:
            self._numbers[name] = self._as_numbers(name)
        return self._numbers[name]

    def _as_numbers(self, name: str) -> np.ndarray:
        cells = self.cells[name]
        if cells.dtype != object:
            found = cells.astype(float)
            found[~np.isfinite(found)] = np.nan
            self._judge(f"{self.path}: {name}", name, found)
            return found
        column = self.column(name)
        reading = None
        if column.wrong is None and column.clash is None:
            others = [n for n, c in self.cells.items() if n != name and c.dtype == object]
            marks = {self.column(n).decimal for n in others if column.open} - {""}
            said = self.units[name] or (time_in_name(name) or (0, ""))[1]
            reading = numerals.marks_of_column(column, self.decimal, marks, self.mark, said)
        where = f"{self.path}: {name}"
        if reading is None:
            raise numerals.refuse(
                where, self.line, self.lines, column, cells.tolist(), self.decimal
            )
        self._tell(name, column, reading)
        found = column.values(reading)
        self._judge(where, name, found)
        if (np.abs(found) > LARGEST).any():
            k = int(np.flatnonzero(np.abs(found) > LARGEST)[0])
            raise BadInput(f"{where}: {cells[k]!r} in {self.line} {self.lines[k]} is beyond what"
                           " can be squared")  # fmt: skip
        return found

    def _judge(self, where: str, name: str, x: np.ndarray) -> None:
        """Tell of lone numbers; refuse an overflow, and a number that marks a missing one."""
        lone, over, marks = lone_values(x), overflows(x), marks_of_missing(x)
        if time_in_name(name) and (x >= 0).all():
            over = over[:0]  # a count of time without a sign begins anew: a further run

        def place(k: int) -> str:
            return f"{self.line} {self.lines[k]}"

        for rows in (lone, marks):
            if rows[1:].size and np.ptp(x[rows]) == 0 and _beyond(x, rows):
                raise BadInput(f"{where}: {x[rows[0]]:g} ({first_of(list(rows), place)}) is far"
                               " beyond all other values; where it marks a missing value, empty"
                               " the cell")  # fmt: skip
        if over.size:
            k = over[0]
            raise BadInput(f"{where}: {x[k]:g} in {self.line} {self.lines[k]} follows {x[k - 1]:g}:"
                           " the logger's number overflows; log it with more bits")  # fmt: skip
        self.notes += [
            f"{name}: {x[first]:g} stands in {stop - first} rows from {place(first)} on, then it"
            " jumps; where nothing was measured, empty the cells"
            for first, stop in held_values(x)
        ]
        if not lone.size and marks.size == 1 and _beyond(x, marks):
            lone = marks  # at an end, or in a few rows
        if not lone.size:
            return
        at = first_of(list(lone), place)
        self.notes.append(
            f"{name}: {many_rows(lone.size, 'value')} far from the values before and after,"
            f" {x[lone[0]]:g} ({at}); where it marks a missing value, empty the cell"
        )

    def _tell(self, name: str, column: numerals.Column, reading: tuple[str, str]) -> None:
        decimal, group = reading
        if any("," in s for s in column.firsts) and decimal == "," and column.firsts:
            self.notes.append(f"{name} has a decimal comma")
        grouped = [k for s, k in column.firsts.items() if group and group in s]
        if grouped:
            cell = str(self.cells[name][grouped[0]]).strip()
            self.notes.append(
                f"{name}: {group!r} parts thousands, so {cell} in {self.line}"
                f" {self.lines[grouped[0]]} is {column.values(reading)[grouped[0]]:g}"
            )


def lone_values(x: np.ndarray) -> np.ndarray:
    """Rows whose number is far from those before and after, which are near each other.

    Far is 100 usual steps and more. A logger writes such a number where it has no value. Of a
    sensor that is slower than the log, only the rows count in which its number changes.
    """
    rows = np.flatnonzero(np.isfinite(x))
    changes = np.diff(x[rows], prepend=np.nan) != 0
    if 2 * np.count_nonzero(changes) <= rows.size:
        rows = rows[changes]
    if rows.size < 20:
        return rows[:0]
    steps = np.abs(np.diff(x[rows]))
    usual = float(np.median(steps))
    across = np.abs(x[rows][2:] - x[rows][:-2])
    lone = (np.minimum(steps[:-1], steps[1:]) > 100 * usual) & (across < 10 * usual)
    return rows[1:-1][lone]


def marks_of_missing(x: np.ndarray) -> np.ndarray:
    """Rows whose number is the one of those that loggers write for a missing value."""
    size = np.where(np.isfinite(x), np.abs(x), 0.0)
    top = float(size.max(initial=0.0))
    marks = any(math.isclose(top, m, rel_tol=1e-6) for m in MISSING)
    return np.flatnonzero(size == top) if marks else np.zeros(0, dtype=int)


def _beyond(x: np.ndarray, rows: np.ndarray) -> bool:
    """Whether the numbers of these rows are ten times as large as all others."""
    rest = np.abs(np.delete(x, rows))
    return bool(abs(x[rows[0]]) > 10 * rest[np.isfinite(rest)].max(initial=0.0))


def held_values(x: np.ndarray) -> list[tuple[int, int]]:
    """First row, and the row behind the last, of each stretch where a column holds a false number.

    The column moves from row to row, holds one number in two rows or more, and jumps away from it
    by 100 usual steps: a mark of missing values. Or it jumps by 20 after 20 rows: a value held.
    """
    rows = np.flatnonzero(np.isfinite(x))
    if rows.size < 20:
        return []
    y = x[rows]
    with np.errstate(over="ignore"):
        steps = np.abs(np.diff(y))
    usual = float(np.median(steps))
    if usual == 0:
        return []
    moves = np.flatnonzero(steps > 0) + 1
    firsts, stops = np.r_[0, moves], np.r_[moves, y.size]
    sizes = np.r_[np.inf, steps, np.inf] / usual  # an end of the file is as far as can be
    before, after, many = sizes[firsts], sizes[stops], stops - firsts
    frozen = (many >= 20) & (y[firsts] != 0) & (after > 20) & (stops < y.size)
    far = (np.minimum(before, after) > 100) & (many >= 2) & (many < y.size)
    return [(int(rows[firsts[k]]), int(rows[stops[k] - 1]) + 1)
            for k in np.flatnonzero(frozen | far)]  # fmt: skip


def overflows(x: np.ndarray) -> np.ndarray:
    """Rows whose number jumps from one end of its range to the other, as an integer overflows.

    One without a sign jumps between 0 and 255, 65535 and so on, in either direction.
    """
    if np.isfinite(x).sum() < 20:
        return np.zeros(0, dtype=int)
    with np.errstate(over="ignore"):
        steps = np.abs(np.diff(x))
    usual = float(np.nanmedian(steps))
    ends = np.minimum(np.abs(x[:-1]), np.abs(x[1:])) > 0.99 * np.nanmax(np.abs(x))
    apart = np.sign(x[:-1]) != np.sign(x[1:])
    turns = ends & apart & (np.abs(np.abs(x[:-1]) - np.abs(x[1:])) < 50 * usual)
    low, top = np.minimum(x[:-1], x[1:]), np.maximum(x[:-1], x[1:])
    tops = np.min([np.abs(top - 2.0**k) for k in (8, 16, 24, 32)], axis=0)
    turns |= (low >= 0) & (low + tops < 10 * usual)
    turns &= steps > 1000 * usual
    return np.flatnonzero(turns) + 1 if usual > 0 else np.zeros(0, dtype=int)


def named_columns(heads: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names and units of heads; a head without a name is ``column 3``."""
    found = [name_and_unit(h) if h.strip() else (f"column {k}", "") for k, h in enumerate(heads, 1)]
    return [n for n, _ in found], [u for _, u in found]


def table_of(
    path: str, heads: Sequence[str], columns: Sequence[np.ndarray], units: Sequence[str],
    lines: Sequence[int], **rest: object,
) -> Table:  # fmt: skip
    """A table of columns; those that share a name are left out and can be named by nobody.

    Args:
        path: where from.
        heads: of the columns, as written.
        columns: cells.
        units: that stand elsewhere than in the heads, empty where there is none.
        lines: of the rows.
        rest: other attributes of the table.

    A head and a row of units that contradict each other make a unit that cannot be read.
    """
    names, own = named_columns(heads)
    twice = {n for n in names if names.count(n) > 1}
    found: dict[str, np.ndarray] = {}
    said: dict[str, str] = {}
    written: dict[str, str] = {}
    for n, u, more, head, cells in zip(names, own, units, heads, columns, strict=True):
        if n in twice:
            continue
        row = more.strip()
        row = row[1:-1].strip() if row[:1] + row[-1:] in ("[]", "()", "{}", "<>") else row
        row = "1" if row in ("-", "--") else row
        if u and row and not _one_unit(u, row):
            u = f"{u} | {row}" if is_unit(u) and is_unit(row) else (row if is_unit(row) else u)
        found[n], said[n], written[n] = cells, u or row, head.strip()
    return Table(path, found, said, lines, heads=written, twice=twice, **rest)  # type: ignore[arg-type]


def _one_unit(first: str, second: str) -> bool:
    if first == second:
        return True
    return is_unit(first) and is_unit(second) and unit(first).same(unit(second))


def read_table(path: str | Path, decimal: str = "") -> Table:
    """Read a text with a head and a row per sample, as people have it.

    Args:
        path: of the file. Any of ``;``, comma, tab, ``|`` and blanks parts its cells. Lines before
            the head, comments, a row of units, quotes, UTF-16 and cp1252 are read.
        decimal: decimal mark of all numbers, where they can be read in two ways.

    Raises:
        BadInput: no such file, no text, no table, or a row with cells beyond the head.
    """
    layout = layout_of(Path(path))
    lines = [n for n, _ in layout.rows]
    columns = [np.array(c, dtype=object) for c in zip(*(c for _, c in layout.rows), strict=True)]
    return table_of(
        str(path), layout.head, columns, layout.units, lines, settings=layout.settings,
        done=layout.done, notes=layout.notes, mark=layout.mark, decimal=decimal,
    )  # fmt: skip
