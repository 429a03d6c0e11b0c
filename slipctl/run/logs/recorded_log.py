"""A recorded log: samples of a table in order of time, in runs.

:mod:`slipctl.tables` reads the table, from text, Parquet or MDF. What was decided is told.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from slipctl.errors import BadInput
from slipctl.run.logs import binary_logs
from slipctl.run.logs.binary_logs import Columns
from slipctl.tables.order import in_order
from slipctl.tables.table import Table, named_columns, read_table, table_of
from slipctl.tables.times import seconds_of_table

GAP = 5.0
"""Usual distances of two samples from which on there is a gap."""


@dataclass
class Recording:
    """A log in order of time.

    Attributes:
        source: file.
        time: of each sample in s, from the first on; strictly increasing. A further run of the
            file follows behind a gap.
        table: columns, in the order of the file.
        rows: of the table, one for each sample.
        notes: what had to be decided, a line each.
        gap: distance of two samples in s from which on there is a gap.
        own: rows that belong to a column, where its times are not those of all.
        usual: usual distance of two samples in s, where rows of several columns lie between.
        begins: samples at which a further run begins.
        hidden: columns that hold the times.
    """

    source: str
    time: np.ndarray
    table: Table
    rows: np.ndarray
    notes: list[str] = field(default_factory=list)
    gap: float = 0.0
    own: dict[str, np.ndarray] = field(default_factory=dict)
    usual: float = 0.0
    begins: tuple[int, ...] = ()
    hidden: Collection[str] = ()

    @property
    def spacing(self) -> float:
        """Usual distance of two samples in s."""
        return self.usual or float(np.median(np.diff(self.time)))

    @property
    def columns(self) -> list[str]:
        """Names of the columns that were read, without those of the times."""
        return [n for n in self.table.cells if n not in self.hidden]

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column as the head says it, empty where it says none."""
        return {n: self.table.units[n] for n in self.columns}

    @property
    def names(self) -> list[str]:
        """Names of all columns."""
        return [*self.columns, *self.table.others]

    @property
    def done(self) -> list[str]:
        """How the file was read, and what had to be decided."""
        return [*self.table.done, *self.notes]

    def rows_of(self, name: str) -> np.ndarray:
        """Whether each sample is one in which a column could have a value."""
        return self.own.get(name, np.ones(self.time.size, dtype=bool))

    def held(self, name: str) -> np.ndarray:
        """Numbers of a column, in samples that are not its own those of the last one that is."""
        x = self.channel(name)
        if name not in self.own:
            return x
        last = np.maximum.accumulate(np.where(self.own[name], np.arange(x.size), -1))
        return np.where(last < 0, np.nan, x[last])

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Ends in s of each stretch without samples."""
        far = np.flatnonzero(np.diff(self.time) > self.gap)
        return [(float(self.time[k]), float(self.time[k + 1])) for k in far]

    def between(self, start: float, end: float) -> Recording:
        """The samples from one time to another, both in s behind the first sample.

        Raises:
            BadInput: there are fewer than two.
        """
        inside = (self.time >= start) & (self.time <= end)
        if np.count_nonzero(inside) < 2:
            raise BadInput(f"{self.source} has fewer than two samples from {start:g} s to {end:g} s"
                           f" behind its first one; it ends at {self.time[-1]:.6g} s")  # fmt: skip
        first = int(np.flatnonzero(inside)[0])
        begins = [k - first for k in self.begins if inside[k] and k > first]
        return replace(
            self, time=self.time[inside], rows=self.rows[inside], begins=tuple(begins),
            own={n: v[inside] for n, v in self.own.items()},
        )  # fmt: skip

    def channel(self, name: str) -> np.ndarray:
        """Numbers of a column, NaN where nothing was measured.

        Raises:
            BadInput: a cell that is no number and not empty, or can be read in two ways; says its
                row.
        """
        known = len(self.table.notes)
        found = self.table.numbers(name)[self.rows]
        self.notes += [n for n in self.table.notes[known:] if n not in self.notes]
        return found


def read_recording(
    file: str | Path, time: str = "", gap: float | None = None,
    wanted: Collection[str] | None = None, decimal: str = "",
) -> Recording:  # fmt: skip
    """Read a log.

    Args:
        file: text with a head, Parquet (extra ``parquet``) or MDF (extra ``mdf4``).
        time: column of the times, with its unit if the head says none, ``"t[ms]"``; by default
            the one that is called so.
        gap: distance of two samples in s from which on there is a gap; five usual ones by default.
        wanted: texts that name columns; of a file that is no text no others are read.
        decimal: decimal mark, where numbers can be read in two ways.

    Raises:
        BadInput: no such file, no table, fewer than two samples, a time that is none, an extra
            that is missing.
    """
    source = str(file)
    if (read := binary_logs.reader(Path(file))) is None:
        return _in_order(read_table(file, decimal), time, gap)
    asked = None if wanted is None else [*wanted, time]
    columns = read(Path(file), asked)
    table = _table_of_columns(source, columns, decimal)
    if columns.time is None:
        return _in_order(table, time, gap)
    if time:
        raise BadInput(f"{source} has times of its own; leave --time out")
    if columns.time.size < 2:
        raise BadInput(f"{source} has {columns.time.size} different times; a log needs two or more")
    found = Recording(
        source, columns.time - columns.time[0], table, np.arange(columns.time.size),
        list(table.notes), own=columns.own, usual=columns.spacing,
    )  # fmt: skip
    found.gap = GAP * found.spacing if gap is None else gap
    return found


def _table_of_columns(source: str, columns: Columns, decimal: str) -> Table:
    """A table of what a file gave."""
    arrays = list(columns.values.values())
    rows = range(1, (arrays[0].size if arrays else 0) + 1)
    return table_of(
        source, list(columns.values), arrays, [columns.units[n] for n in columns.values], rows,
        line="row", notes=columns.notes, decimal=decimal, typed=columns.typed,
        others=named_columns(columns.others)[0] if columns.others else (),
    )  # fmt: skip


def _in_order(table: Table, wanted: str, gap: float | None) -> Recording:
    """The samples in order of time, run after run."""
    t, hidden = seconds_of_table(table, wanted)
    order = in_order(
        t, lambda k: f"{table.line} {table.lines[k]}",
        lambda a, b: all(c[a] == c[b] for c in table.cells.values()), f"{table.path}: {hidden[0]}",
    )  # fmt: skip
    time = t[order.rows]
    inner = np.delete(np.diff(time), [k - 1 for k in order.begins])
    spacing = float(np.median(inner))
    gap = GAP * spacing if gap is None else gap
    for k in order.begins:  # behind a gap that is told as one
        time[k:] += time[k - 1] - time[k] + 2 * max(gap, spacing)
    return Recording(
        table.path, time - time[0], table, order.rows, [*table.notes, *order.notes], gap,
        usual=spacing if order.begins else 0.0, begins=tuple(order.begins), hidden=hidden,
    )  # fmt: skip


def csv_of(columns: dict[str, np.ndarray]) -> str:
    """Columns as text, ten digits."""
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(columns)
    row = ",".join(["%.10g"] * len(columns))
    table = np.column_stack(list(columns.values())).tolist()
    return head.getvalue() + "".join(row % tuple(r) + "\n" for r in table)
