"""A recorded log: text with a head and a row per sample, read as people have it, or Parquet, MDF.

Any of ``;``, ``,`` and tab between, decimal comma or point, a byte order mark, lines before the
head, units in the head or in a row below it. What had to be put in order is told.
"""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import factor, unit
from slipctl.errors import BadInput, nearest
from slipctl.run.logs import binary_logs
from slipctl.run.logs.binary_logs import Columns

LARGEST = 2**28
"""Bytes of a log that is read whole."""

PREAMBLE = 60
"""Lines among which the head is looked for."""

GAP = 5.0
"""Usual distances of two samples from which on there is a gap."""

TIMES = ("time", "t", "timestamp", "zeit", "time_s", "seconds", "sec")
"""Names of a column of times, if none is told."""

EMPTY = ("", "-", "--", "na", "n/a", "nan", "null", "none", "#n/a", "#nv", "inf", "-inf")
"""What stands in a cell where nothing was measured."""

_UNIT = re.compile(r"^(.*?)\s*(?:\[([^\]]*)\]|\(([^)]*)\))\s*$")


@dataclass
class Recording:
    """A log in order of time.

    Attributes:
        source: file.
        time: of each sample in s, from the first on; strictly increasing.
        texts: cells of each column by its name, in the same order.
        units: unit of each column, empty where the head says none.
        comma: whether numbers have a decimal comma.
        notes: what had to be put in order, a line each.
        gap: distance of two samples in s from which on there is a gap.
        others: columns of the file that were not read.
        own: rows that belong to a column, where its times are not those of all.
        usual: usual distance of two samples in s, where rows of several columns lie between.
    """

    source: str
    time: np.ndarray
    texts: dict[str, np.ndarray]
    units: dict[str, str]
    comma: bool
    notes: list[str] = field(default_factory=list)
    gap: float = 0.0
    others: Sequence[str] = ()
    own: dict[str, np.ndarray] = field(default_factory=dict)
    usual: float = 0.0

    @property
    def spacing(self) -> float:
        """Usual distance of two samples in s."""
        return self.usual or float(np.median(np.diff(self.time)))

    @property
    def names(self) -> list[str]:
        """Names of all columns."""
        return [*self.texts, *self.others]

    def rows(self, name: str) -> np.ndarray:
        """Whether each row is one in which a column could have a value."""
        return self.own.get(name, np.ones(self.time.size, dtype=bool))

    def held(self, name: str) -> np.ndarray:
        """Numbers of a column, in rows that are not its own those of the last one that is."""
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
        return replace(
            self, time=self.time[inside], texts={n: v[inside] for n, v in self.texts.items()},
            own={n: v[inside] for n, v in self.own.items()},
        )  # fmt: skip

    def channel(self, name: str) -> np.ndarray:
        """Numbers of a column, NaN where nothing was measured.

        Raises:
            BadInput: a cell that is no number and not empty; says its row.
        """
        return _numbers(self.source, name, self.texts[name], self.comma)

    def find(self, name: str) -> str:
        """Name of a column.

        Raises:
            BadInput: there is none, with the nearest.
        """
        if name in self.texts:
            return name
        same = [n for n in self.texts if n.lower() == name.lower()]
        if len(same) == 1:
            return same[0]
        raise BadInput(f"{self.source} has no column {name!r}{nearest(name, self.names)}")


def read_recording(
    file: str | Path, time: str = "", gap: float | None = None,
    wanted: Collection[str] | None = None,
) -> Recording:  # fmt: skip
    """Read a log.

    Args:
        file: text with a head, Parquet (extra ``parquet``) or MDF (extra ``mdf4``).
        time: column of the times, with its unit if the head says none, ``"t[ms]"``; by default
            the one that is called so, else the first.
        gap: distance of two samples in s from which on there is a gap; five usual ones by default.
        wanted: texts that name columns; of a file that is no text no others are read.

    Raises:
        BadInput: no such file, no table, fewer than two samples, a time that is none, an extra
            that is missing.
    """
    source = str(file)
    if (read := binary_logs.reader(Path(file))) is not None:
        asked = None if wanted is None else [*wanted, time]
        found = _of_columns(source, read(Path(file), asked, TIMES), time)
        found.gap = GAP * found.spacing if gap is None else gap
        return found
    lines, notes = _text(Path(file)).splitlines(), []
    head, first, mark = _head(source, lines)
    names, units = _names(source, head)
    rows = [r for r in csv.reader(lines[first:], delimiter=mark) if any(c.strip() for c in r)]
    if rows and not units and _unit_row(rows[0]):
        units = {n: u.strip(" []()") for n, u in zip(names, rows[0], strict=False)}
        rows = rows[1:]
    whole = [r for r in rows if len(r) >= len(names)]
    if len(whole) < len(rows):
        notes.append(f"{len(rows) - len(whole)} rows with fewer cells than the head left out")
    if len(whole) < 2:
        raise BadInput(f"{source} has {len(whole)} whole rows; a log needs two or more")
    comma = mark != "," and any(
        re.fullmatch(r"\s*[-+]?\d*,\d+\s*", c) for r in whole[:50] for c in r
    )
    texts = {n: np.array([r[k].strip() for r in whole], dtype=object) for k, n in enumerate(names)}
    found = Recording(
        source, np.empty(0), texts, {n: units.get(n, "") for n in names}, comma, notes
    )
    _in_order(found, time)
    found.gap = GAP * found.spacing if gap is None else gap
    return found


def _of_columns(source: str, columns: Columns, time: str) -> Recording:
    """A log of what a file gave."""
    names, units = _names(source, list(columns.values))
    texts = dict(zip(names, columns.values.values(), strict=True))
    told = {n: units.get(n) or u for n, u in zip(names, columns.units.values(), strict=True)}
    found = Recording(
        source, np.empty(0), texts, told, False, columns.notes,
        others=_names(source, columns.others)[0] if columns.others else (), own=columns.own,
        usual=columns.spacing,
    )  # fmt: skip
    if columns.time is None:
        _in_order(found, time)
        return found
    if time:
        raise BadInput(f"{source} has times of its own; leave --time out")
    if columns.time.size < 2:
        raise BadInput(f"{source} has {columns.time.size} different times; a log needs two or more")
    found.time = columns.time - columns.time[0]
    return found


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise BadInput(
                f"{path} has {size >> 20} MB; cut it into logs of at most {LARGEST >> 20} MB"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror}") from None
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace")
    if b"\x00" in raw[:4096]:
        raise BadInput(f"{path} is no text; export the log as CSV, a head and a row per sample")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _head(source: str, lines: Sequence[str]) -> tuple[list[str], int, str]:
    """Cells of the head, the line behind it, and what stands between cells."""
    for k, line in enumerate(lines[:PREAMBLE]):
        for mark in ("\t", ";", ",", "|"):
            cells = next(csv.reader([line], delimiter=mark), [])
            below = [next(csv.reader([x], delimiter=mark), []) for x in lines[k + 1 : k + 4]]
            if len(cells) < 2 or not below or any(_number(c) is not None for c in cells if c):
                continue
            like = [r for r in below if len(r) == len(cells)]
            if any(sum(_number(c) is not None for c in r) >= 1 for r in like) and any(
                c.strip() for c in cells
            ):
                return cells, k + 1, mark
    raise BadInput(
        f"{source} has no head above rows of numbers; write one, such as time [s];speed [km/h]"
    )


def _names(source: str, head: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    names: list[str] = []
    units: dict[str, str] = {}
    for k, cell in enumerate(head):
        match = _UNIT.match(cell.strip())
        name = (match[1] if match else cell).strip() or f"column {k + 1}"
        if name in names:
            raise BadInput(f"{source}: its head has two columns {name!r}; rename one")
        names.append(name)
        if match:
            units[name] = (match[2] or match[3] or "1").strip() or "1"
    return names, units


def _unit_row(row: Sequence[str]) -> bool:
    """Whether a row below the head holds units."""
    given = [c.strip(" []()") for c in row if c.strip()]
    if not given or any(_number(c) is not None for c in given):
        return False
    try:
        return all(unit(c) is not None for c in given if c != "-")
    except BadInput:
        return False


def _number(text: str) -> float | None:
    try:
        return float(text.strip().replace(",", ".", 1))
    except ValueError:
        return None


def _numbers(source: str, name: str, texts: np.ndarray, comma: bool) -> np.ndarray:
    """Cells as floats, empty ones as NaN."""
    if texts.dtype != object:
        return np.where(np.isfinite(texts), texts, np.nan)
    found = np.full(len(texts), np.nan)
    for k, text in enumerate(texts):
        if text.lower() in EMPTY:
            continue
        try:
            found[k] = float(
                text.replace(".", "").replace(",", ".") if comma and "," in text else text
            )
        except ValueError:
            raise BadInput(
                f"{source}: {name}: {text[:30]!r} in row {k + 1} is no number; leave the cell empty"
            ) from None
    found[np.isinf(found)] = np.nan
    return found


def _in_order(log: Recording, wanted: str) -> None:
    """Put the samples in order of time, and tell what that took."""
    match = _UNIT.match(wanted)
    name = match[1] if match else wanted
    if name:
        name = log.find(name)
    else:
        lower = {n.lower(): n for n in log.texts}
        name = next((lower[t] for t in TIMES if t in lower), next(iter(log.texts)))
    told = (match[2] or match[3]) if match else log.units[name]
    time = _times(log, name)
    if told and told != "1":
        time = time * factor(told, "s")
    good = np.isfinite(time)
    if not good.all():
        log.notes.append(f"{int((~good).sum())} rows without a time left out")
    order = np.flatnonzero(good)[np.argsort(time[good], kind="stable")]
    if (np.diff(time[good]) < 0).any():
        log.notes.append("rows were not in order of time; sorted")
    later = np.diff(time[order], append=np.inf) > 0
    if not later.all():
        log.notes.append(f"{int((~later).sum())} rows with the time of the next one left out")
    order = order[later]
    if order.size < 2:
        raise BadInput(f"{log.source}: {name} has fewer than two different times")
    log.time = time[order] - time[order[0]]
    log.texts = {n: v[order] for n, v in log.texts.items() if n != name}
    log.units.pop(name)


def _times(log: Recording, name: str) -> np.ndarray:
    """Times as numbers; those of a calendar in s."""
    try:
        return log.channel(name)
    except BadInput as error:
        try:
            with warnings.catch_warnings():  # a zone of time is told apart from none, and taken off
                warnings.simplefilter("ignore")
                stamps: Any = np.array(
                    ["NaT" if t.lower() in EMPTY else t.replace(" ", "T").rstrip("Z")
                     for t in log.texts[name]], dtype="datetime64[us]",
                )  # fmt: skip
        except ValueError:
            raise error from None
        log.units[name] = "s"
        return np.where(np.isnat(stamps), np.nan, stamps.astype("int64") / 1e6)


def csv_of(columns: dict[str, np.ndarray]) -> str:
    """Columns as text, ten digits."""
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(columns)
    row = ",".join(["%.10g"] * len(columns))
    table = np.column_stack(list(columns.values())).tolist()
    return head.getvalue() + "".join(row % tuple(r) + "\n" for r in table)
