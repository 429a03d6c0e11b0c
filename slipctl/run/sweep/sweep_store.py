"""The store of a sweep: one SQLite file, written by one process, a transaction as runs end.

A run that is in it is whole, whatever ends the process. The number of a run is its key, so that
the same sweep again does only what is missing. Each row has a sum of what stands in it, and so has
what the sweep is: a store that was altered or damaged is refused. A store that does not say what it
is belongs to nobody. While it is written its folder is locked.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.errors import BadInput
from slipctl.run import interrupts, store
from slipctl.run.metrics import Metric
from slipctl.run.store import FolderLock

FILE = "sweep.sqlite"
"""Name of the store in the folder of a sweep."""

_TABLES = (
    "create table about (key text primary key, value text not null)",
    "create table metrics (name text primary key, unit text not null, rows text not null,"
    " sum text not null)",
    "create table runs (run integer primary key, numbers text not null, metrics text not null,"
    " failed text, sum text not null)",
    "create table logs (run integer, name text, shape text not null, data blob not null,"
    " sum text not null, primary key (run, name))",
)

SUM = "sum"
"""Key of what the sweep is that holds the sum of all others."""


def sum_of_row(*values: int | str | bytes | None) -> str:
    """Sum of a row, 16 digits: another one where anything of it differs."""
    digest = hashlib.blake2b(digest_size=8)
    for value in values:
        raw = value if isinstance(value, bytes) else repr(value).encode(errors="surrogateescape")
        digest.update(len(raw).to_bytes(8, "little") + raw)
    return digest.hexdigest()


def _checked(what: str, sum_: object, *values: Any) -> None:
    """Refuse a row that is not what was written."""
    if sum_of_row(*values) != sum_:
        raise ValueError(f"{what} is not what was written")


GROWS = ("samples", "command", "limits")
"""What of a sweep may change from one call to the next."""

OF_A_MACHINE = ("processor", "machine", "numbers")
"""What may differ where the machines that compute are mixed."""


@dataclass(frozen=True)
class Ended:
    """A run that ended.

    Attributes:
        run: its number.
        numbers: what it ran with.
        metrics: what it gave.
        failed: why it gave nothing; empty where it did.
        logs: signals over time that are kept.
    """

    run: int
    numbers: Mapping[str, float]
    metrics: Mapping[str, Metric] = field(default_factory=dict)
    failed: str = ""
    logs: Mapping[str, np.ndarray] = field(default_factory=dict)


DAMAGED = (sqlite3.Error, zlib.error, ValueError, TypeError, LookupError, AttributeError,
           RecursionError)  # fmt: skip
"""What comes of a store that holds something else than was written."""


@contextmanager
def _used(path: Path) -> Iterator[None]:
    """Tell a full disk by the file's name, and what is damaged in one line.

    Raises:
        OSError: it cannot be written. BadInput: what it holds is not what was written.
    """
    try:
        yield
    except BadInput:
        raise
    except sqlite3.OperationalError as error:
        if any(word in str(error) for word in ("full", "readonly", "disk I/O", "unable to open")):
            raise OSError(errno.ENOSPC, str(error), str(path)) from None
        raise BadInput(_broken(path, error)) from None
    except DAMAGED as error:
        raise BadInput(_broken(path, error)) from None


class Store:
    """An open store; see :func:`begin` and :func:`find`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path, self._db = path, connection
        self.lock: FolderLock | None = None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close it, and let others write."""
        self._db.close()
        if self.lock is not None:
            self.lock.close()

    def tables(self) -> set[str]:
        """Names of its tables; none where nothing was ever written."""
        with _used(self.path):
            return {n for (n,) in self._db.execute("select name from sqlite_master")}

    def about(self) -> dict[str, Any]:
        """What the sweep is."""
        with _used(self.path):
            rows = dict(self._db.execute("select key, value from about order by key"))
            if not rows:
                raise ValueError("it does not say of which sweep it is")
            store.check_format(str(self.path), json.loads(rows.get("format", "null")))
            _checked("what it says of its sweep", rows.pop(SUM, None), *_flat(rows))
            return {k: json.loads(v) for k, v in rows.items()}

    def done(self) -> set[int]:
        """Numbers of the runs that ended."""
        return {run for run, *_ in self.runs()}

    def units(self) -> dict[str, tuple[str, tuple[str, ...]]]:
        """Unit and row names of each metric."""
        found = {}
        with _used(self.path):
            query = "select name, unit, rows, sum from metrics order by rowid"
            for name, unit, rows, sum_ in self._db.execute(query):
                _checked(f"the unit of {name}", sum_, name, unit, rows)
                found[name] = (unit, tuple(json.loads(rows)))
        return found

    def runs(self) -> Iterator[tuple[int, dict[str, float], dict[str, Any], str]]:
        """Number, numbers, metrics and failure of each run that ended, in order."""
        known = self.units()
        query = "select run, numbers, metrics, failed, sum from runs order by run"
        with _used(self.path):
            for run, numbers, metrics, failed, sum_ in self._db.execute(query):
                _checked(f"run {run}", sum_, run, numbers, metrics, failed)
                values = json.loads(metrics)
                if not values.keys() <= known.keys():
                    raise ValueError(f"run {run} has a metric without unit")
                yield run, json.loads(numbers), values, failed or ""

    def log(self, run: int) -> dict[str, np.ndarray]:
        """Signals over time that were kept of a run."""
        query = "select name, shape, data, sum from logs where run = ? order by rowid"
        found = {}
        with _used(self.path):
            for name, shape, data, sum_ in self._db.execute(query, (run,)):
                _checked(f"{name} of run {run}", sum_, run, name, shape, data)
                values = np.frombuffer(zlib.decompress(data), dtype="<f8")
                found[name] = values.reshape(json.loads(shape))
            whole = self._db.execute("select 1 from runs where run = ? and failed is null", (run,))
            wanted = self.about().get("logs", ())
            if whole.fetchone() and not found.keys() >= set(wanted):
                raise ValueError(f"run {run} has lost a log")
        return found

    def longest(self) -> int:
        """Ticks of the longest log."""
        with _used(self.path):
            shapes = self._db.execute("select distinct shape from logs")
            return max((int(json.loads(s)[0]) for (s,) in shapes), default=0)

    def tell(self, about: Mapping[str, Any]) -> None:
        """Keep what the sweep is; in a new file the first of all that is written."""
        with _used(self.path), self._db:
            self._db.execute("begin immediate")
            if not self.tables():
                for table in _TABLES:
                    self._db.execute(table)
            rows = dict(self._db.execute("select key, value from about"))
            rows |= {k: json.dumps(store.plain(v)) for k, v in about.items()}
            rows.pop(SUM, None)
            rows[SUM] = sum_of_row(*_flat(rows))
            self._db.executemany("insert or replace into about values (?, ?)", rows.items())

    def tell_mixed(self, processors: Iterable[str]) -> None:
        """Keep that other processors than the first one computed runs too."""
        about = self.about()
        others = {*about.get("mixed", ()), *processors} - {about.get("processor")}
        if others:
            self.tell({"mixed": sorted(others)})

    def add(self, ended: Iterable[Ended]) -> None:
        """Keep runs that ended, all or none; a person who stops waits for it."""
        with interrupts.hold_interrupts(), _used(self.path), self._db:
            for e in ended:
                values = {n: store.plain(m.value) for n, m in e.metrics.items()}
                units = [(n, m.unit, json.dumps(m.rows)) for n, m in e.metrics.items()]
                logs = [(e.run, n, json.dumps(v.shape), zlib.compress(v.astype("<f8").tobytes(), 1))
                        for n, v in e.logs.items()]  # fmt: skip
                run = (e.run, json.dumps(e.numbers), json.dumps(values), e.failed or None)
                for table, rows in (("metrics", units), ("logs", logs), ("runs", [run])):
                    self._put(table, rows)

    def _put(self, table: str, rows: Iterable[tuple[Any, ...]]) -> None:
        """Rows with their sums, where they are not there yet."""
        with_sums = [(*row, sum_of_row(*row)) for row in rows]
        if with_sums:
            places = ", ".join("?" * len(with_sums[0]))
            self._db.executemany(f"insert or ignore into {table} values ({places})", with_sums)


def begin(
    folder: Path, about: Mapping[str, Any], file: str = FILE, what: str = "sweep",
    mixed: bool = False,
) -> Store:  # fmt: skip
    """Open the store of a sweep, or make it.

    Args:
        folder: of the sweep.
        about: what it is; a store of another sweep is refused.
        file: name of the store.
        what: it belongs to, in words.
        mixed: whether runs of other machines may be in it.

    Raises:
        BadInput: it holds another sweep, told by what differs, or is no store.
    """
    store.check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lock = FolderLock(folder)
    found = None
    try:
        found = _opened(folder / file)
        found.lock = lock
        with _used(found.path):
            found._db.execute("pragma journal_mode=wal")
            found._db.execute("pragma synchronous=normal")  # a killed process loses nothing
        before = found.about() if found.tables() else {}
        if before:
            now = {k: store.plain(v) for k, v in about.items()}
            if mixed:
                found.tell_mixed([str(about.get("processor", ""))])
                now |= {k: before[k] for k in OF_A_MACHINE if k in before}
                about = {**about, **now}
            _same(folder, before, now, what)
        most = max(int(about["samples"]), int(before.get("samples", 0)))
        found.tell({"format": store.FORMAT, **about, "samples": most})
    except BaseException:
        (found or lock).close()
        raise
    return found


def find(folder: Path) -> Store:
    """Open the store of a sweep that there is.

    Raises:
        BadInput: there is none, or it is no store.
    """
    path = folder / FILE if os.path.isdir(folder) else folder
    if not os.path.isfile(path):
        shown = str(folder) if len(str(folder)) <= 200 else f"{str(folder)[:200]}..."
        raise BadInput(f"there is no sweep in {shown}; slipctl sweep ... --out {shown} makes one")
    found = _opened(path)
    try:
        found.about()
    except (BadInput, OSError):
        found.close()
        raise
    return found


def _flat(rows: Mapping[str, str]) -> list[str]:
    """Keys and values in one list, by the keys."""
    return [text for key in sorted(rows) for text in (key, rows[key])]


def _opened(path: Path) -> Store:
    try:
        return Store(path, sqlite3.connect(path, timeout=30.0))
    except sqlite3.Error as error:
        raise BadInput(_broken(path, error)) from None


def _broken(path: Path, error: object) -> str:
    said = " ".join(str(error).split()) or type(error).__name__
    return f"{path} cannot be used as the store of a sweep: {said}; choose another --out"


def _axes(axes: Any) -> str:
    """What is varied, as a person wrote it."""
    return ", ".join(
        f"{name} = {lo:g} .. {hi:g} {unit}" + (f", {points} values" if points else "")
        for name, lo, hi, points, unit in axes
    )


def _same(folder: Path, before: Mapping[str, Any], now: Mapping[str, Any], what: str) -> None:
    """Refuse to mix two sweeps."""
    fixed = ("samples",) if "lhs" in (before.get("design"), now.get("design")) else ()
    keys = [k for k in now if k not in GROWS or k in fixed]
    differs = [k for k in keys if k in before and before[k] != now[k]]
    if not differs:
        return
    k = differs[0]
    if k == "samples":
        raise BadInput(
            f"{folder} holds a Latin hypercube of {before[k]} samples, which cannot be extended to"
            f" {now[k]}; choose another --out, or --design sobol"
        )
    both = ((0, before[k]), (1, now[k]))
    shown = {n: _axes(v) if k == "vary" else v for n, v in both}
    shown = {n: (v if len(str(v)) <= 60 else "other") for n, v in shown.items()}
    said = f" ({shown[0]} there, {shown[1]} now)" if "other" not in shown.values() else ""
    verb = "differ" if k.endswith("s") else "differs"
    raise BadInput(
        f"{folder} holds another {what}: its {k.replace('_', ' ')} {verb}{said};"
        " choose another --out"
    )
