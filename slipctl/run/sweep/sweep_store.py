"""The store of a sweep: one SQLite file, written by one process, a transaction as runs end.

A run that is in it is whole, whatever ends the process. The number of a run is its key, so that
the same sweep again does only what is missing.
"""

from __future__ import annotations

import errno
import json
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

FILE = "sweep.sqlite"
"""Name of the store in the folder of a sweep."""

_TABLES = """
create table if not exists about (key text primary key, value text not null);
create table if not exists metrics (name text primary key, unit text not null, rows text not null);
create table if not exists runs (run integer primary key, numbers text not null,
    metrics text not null, failed text);
create table if not exists logs (run integer, name text, shape text not null, data blob not null,
    primary key (run, name));
"""

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
    except (sqlite3.Error, zlib.error, ValueError, TypeError, KeyError, AttributeError) as error:
        raise BadInput(_broken(path, error)) from None


class Store:
    """An open store; see :func:`begin` and :func:`find`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path, self._db = path, connection

    def close(self) -> None:
        """Close it."""
        self._db.close()

    def about(self) -> dict[str, Any]:
        """What the sweep is."""
        with _used(self.path):
            return {k: json.loads(v) for k, v in self._db.execute("select key, value from about")}

    def done(self) -> set[int]:
        """Numbers of the runs that ended."""
        with _used(self.path):
            return {int(k) for (k,) in self._db.execute("select run from runs")}

    def units(self) -> dict[str, tuple[str, tuple[str, ...]]]:
        """Unit and row names of each metric."""
        with _used(self.path):
            rows = self._db.execute("select name, unit, rows from metrics order by rowid")
            return {n: (u, tuple(json.loads(r))) for n, u, r in rows}

    def runs(self) -> Iterator[tuple[int, dict[str, float], dict[str, Any], str]]:
        """Number, numbers, metrics and failure of each run that ended, in order."""
        with _used(self.path):
            rows = self._db.execute("select run, numbers, metrics, failed from runs order by run")
            for run, numbers, metrics, failed in rows:
                yield int(run), json.loads(numbers), json.loads(metrics), failed or ""

    def log(self, run: int) -> dict[str, np.ndarray]:
        """Signals over time that were kept of a run."""
        with _used(self.path):
            rows = self._db.execute(
                "select name, shape, data from logs where run = ? order by rowid", (run,)
            )
            return {
                name: np.frombuffer(zlib.decompress(data), dtype="<f8").reshape(json.loads(shape))
                for name, shape, data in rows
            }

    def longest(self) -> int:
        """Ticks of the longest log."""
        with _used(self.path):
            shapes = self._db.execute("select distinct shape from logs")
            return max((int(json.loads(s)[0]) for (s,) in shapes), default=0)

    def tell(self, about: Mapping[str, Any]) -> None:
        """Keep what the sweep is."""
        with _used(self.path), self._db:
            self._db.executemany(
                "insert or replace into about values (?, ?)",
                [(k, json.dumps(store.plain(v))) for k, v in about.items()],
            )

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
                self._db.executemany(
                    "insert or ignore into metrics values (?, ?, ?)",
                    [(n, m.unit, json.dumps(m.rows)) for n, m in e.metrics.items()],
                )
                self._db.executemany(
                    "insert or ignore into logs values (?, ?, ?, ?)",
                    [
                        (e.run, n, json.dumps(v.shape), zlib.compress(v.astype("<f8").tobytes(), 1))
                        for n, v in e.logs.items()
                    ],
                )
                self._db.execute(
                    "insert or ignore into runs values (?, ?, ?, ?)",
                    (e.run, json.dumps(e.numbers), json.dumps(values), e.failed or None),
                )


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
    found = _opened(folder / file)
    try:
        with _used(found.path):
            found._db.executescript(_TABLES)
            found._db.execute("pragma journal_mode=wal")
            found._db.execute("pragma synchronous=normal")  # a killed process loses nothing
        before = found.about()
        if not before and found.done():
            raise BadInput(_broken(found.path, "it has runs, and does not say of which sweep"))
        if before:
            store.check_format(str(found.path), before.get("format"))
            now = {k: store.plain(v) for k, v in about.items()}
            if mixed:
                found.tell_mixed([str(about.get("processor", ""))])
                now |= {k: before[k] for k in OF_A_MACHINE if k in before}
                about = {**about, **now}
            _same(folder, before, now, what)
        most = max(int(about["samples"]), int(before.get("samples", 0)))
        found.tell({"format": store.FORMAT, **about, "samples": most})
    except (BadInput, OSError):
        found.close()
        raise
    return found


def find(folder: Path) -> Store:
    """Open the store of a sweep that there is.

    Raises:
        BadInput: there is none, or it is no store.
    """
    path = folder / FILE if folder.is_dir() else folder
    if not path.is_file():
        raise BadInput(f"there is no sweep in {folder}; slipctl sweep ... --out {folder} makes one")
    found = _opened(path)
    try:
        about = found.about()
    except (BadInput, OSError):
        found.close()
        raise
    store.check_format(str(path), about.get("format"))
    return found


def _opened(path: Path) -> Store:
    try:
        return Store(path, sqlite3.connect(path, timeout=30.0))
    except sqlite3.Error as error:
        raise BadInput(_broken(path, error)) from None


def _broken(path: Path, error: object) -> str:
    return f"{path} cannot be used as the store of a sweep: {error}; choose another --out"


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
