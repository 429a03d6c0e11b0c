"""Logs that are no text: Parquet by pyarrow, MDF by asammdf; only the columns that are asked for.

An MDF file has times of its own for each group of channels. The rows of a log are all of these
times; a column has values in its own rows alone.
"""

from __future__ import annotations

import gc
import sys
import traceback
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import factor
from slipctl.errors import BadInput, nearest
from slipctl.tables.heads import is_time_unit, is_unit, name_and_unit
from slipctl.tables.times import is_time_name

LARGEST = 2**31
"""Bytes of the columns that are read."""


@dataclass
class Columns:
    """What a file gave.

    Attributes:
        values: of each column that was read, numbers or texts.
        units: by column.
        others: names of the columns that were not read.
        time: of the rows in s, where the file has times of its own.
        own: rows that belong to a column, where not all do.
        spacing: usual distance in s of the rows of the fastest column, likewise.
        notes: what had to be put in order.
        typed: columns of times by their type.
    """

    values: dict[str, np.ndarray] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    others: list[str] = field(default_factory=list)
    time: np.ndarray | None = None
    own: dict[str, np.ndarray] = field(default_factory=dict)
    spacing: float = 0.0
    notes: list[str] = field(default_factory=list)
    typed: list[str] = field(default_factory=list)


def reader(path: Path) -> Callable[..., Columns] | None:
    """What reads a file, by the bytes that it begins with; None for text."""
    try:
        with path.open("rb") as file:
            begin = file.read(4)
    except OSError:
        return None  # who reads it as text says why
    return {b"PAR1": parquet, b"MDF ": mdf, b"UnFi": mdf}.get(begin)


def _asked(name: str, wanted: Collection[str] | None) -> bool:
    """Whether a column may be meant by one of the texts."""
    return wanted is None or any(name.lower() in text.lower() for text in wanted)


def _check_size(path: Path, numbers: int) -> None:
    if 8 * numbers > LARGEST:
        raise BadInput(
            f"{path}: the columns asked for have {8 * numbers >> 20} MB; cut it into logs of at"
            f" most {LARGEST >> 20} MB"
        )


def parquet(path: Path, wanted: Collection[str] | None) -> Columns:
    """Read a Parquet file.

    Args:
        path: of the file.
        wanted: texts that name the columns to read; None reads all. Those that are called as times
            or dates are read too, and the first one.

    Raises:
        BadInput: the extra is missing, the file is damaged or too large.
    """
    try:
        import pyarrow
        import pyarrow.parquet as pq
    except ImportError:
        raise BadInput(
            f"{path} is Parquet, which needs the extra parquet: pip install 'slipctl[parquet]'"
        ) from None
    found = Columns()
    try:
        file = pq.ParquetFile(path)
        schema = file.schema_arrow
        index = [n for n in (schema.pandas_metadata or {}).get("index_columns", ())
                 if isinstance(n, str)]  # fmt: skip
        names = [*index, *(n for n in schema.names if n not in index)]
        chosen = [n for k, n in enumerate(names)
                  if k == 0 or is_time_name(n) or _asked(name_and_unit(n)[0], wanted)]  # fmt: skip
        found.others = [n for n in names if n not in chosen]
        _check_size(path, file.metadata.num_rows * len(chosen))
        table = file.read(columns=chosen)
        for name in chosen:
            found.values[name], unit = _numbers(pyarrow, table[name])
            about = schema.field(name).metadata or {}
            told = about.get(b"unit") or about.get(b"units") or b""
            found.typed += [name_and_unit(name)[0]] if unit else []
            found.units[name] = unit or told.decode("utf-8", errors="replace")
    except BadInput:
        raise
    except Exception as error:  # whatever a damaged file makes of it
        raise _damaged(path, "Parquet", error) from None
    return found


def _numbers(pyarrow: Any, column: Any) -> tuple[np.ndarray, str]:
    """Values of a column as numbers, else as texts; and their unit, if the type has one."""
    kind, types = column.type, pyarrow.types
    if types.is_timestamp(kind) or types.is_duration(kind):
        scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
        missing = column.is_null().to_numpy()
        ticks = column.cast(pyarrow.int64()).fill_null(0).to_numpy()
        first = ticks[~missing][0] if (~missing).any() else 0
        # from the first one on, so that no digit is lost
        return np.where(missing, np.nan, scale * (ticks - first)), "s"
    if types.is_dictionary(kind):
        return _numbers(pyarrow, column.cast(kind.value_type))
    if types.is_integer(kind) and not column.null_count and kind != pyarrow.uint64():
        return column.to_numpy().astype(np.int64), ""
    try:
        return column.cast(pyarrow.float64()).to_numpy().astype(float), ""
    except (pyarrow.ArrowInvalid, pyarrow.ArrowNotImplementedError):
        return np.array(["" if v is None else str(v) for v in column.to_pylist()], dtype=object), ""


def mdf(path: Path, wanted: Collection[str] | None) -> Columns:
    """Read a measurement data file, MDF 4 or older; arguments as of :func:`parquet`.

    Raises:
        BadInput: the extra is missing, the file is damaged or too large, no column is asked for.
    """
    try:
        from asammdf import MDF
    except ImportError:
        raise BadInput(
            f"{path} is MDF, which needs the extra mdf4: pip install 'slipctl[mdf4]'"
        ) from None
    found = Columns()
    signals: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    try:
        with MDF(path) as file:
            masters = set(file.masters_db.items())
            places = {n: [p for p in ps if tuple(p) not in masters]
                      for n, ps in file.channels_db.items()}  # fmt: skip
            for name, at in places.items():
                if not at:
                    continue
                if not _asked(name, wanted):
                    found.others.append(name)
                    continue
                if len(at) > 1:
                    found.notes.append(f"{len(at)} channels are called {name}; the first is read")
                group, index = at[0]
                seconds = _seconds(file, group)
                if not seconds:
                    found.notes.append(f"{name} has no times in the file, left out")
                    found.others.append(f"{name} (without times)")
                    continue
                _check_size(path, file.groups[group].channel_group.cycles_nr * len(signals))
                signals[name], unit = _channel(file, group, index, seconds)
                found.units[name] = "" if unit.strip() == "-" else unit.strip()
    except BadInput:
        raise
    except Exception as error:  # whatever a damaged file makes of it
        _end_silently(error)
        raise _damaged(path, "MDF", error) from None
    if not signals:
        near = next((nearest(t, found.others) for t in wanted or ()), "")
        if lost := [n for n in found.others if n.endswith("(without times)")]:
            near = f"; it has {', '.join(lost[:12])}"
        raise BadInput(f"{path} has no channel that is asked for{near}")
    found.time = np.unique(np.concatenate([t for t, _ in signals.values()]))
    for name, (t, x) in signals.items():
        rows = np.searchsorted(found.time, t)
        found.values[name] = np.full(found.time.size, np.nan)
        found.values[name][rows] = x
        if np.unique(rows).size < found.time.size:
            found.own[name] = np.isin(np.arange(found.time.size), rows)
    steps = [np.median(np.diff(t)) for t, _ in signals.values() if t.size > 1]
    found.spacing = float(min(steps, default=0.0))
    bases = {t.tobytes() for t, _ in signals.values()}
    if len(bases) > 1:
        found.notes.append(
            f"the channels have {len(bases)} time bases; each is resampled by itself"
        )
    return found


def _seconds(file: Any, group: int) -> float:
    """What turns the master of a group into s; 0 where it has none, or one of places or angles."""
    at = file.masters_db.get(group)
    master = None if at is None else file.groups[group].channels[at]
    if master is None or getattr(master, "sync_type", 1) > 1:
        return 0.0
    told = str(getattr(master, "unit", "") or "").strip()
    if not is_unit(told):
        return 1.0
    return factor(told, "s") if is_time_unit(told) else 0.0


def _channel(
    file: Any, group: int, index: int, seconds: float
) -> tuple[tuple[np.ndarray, np.ndarray], str]:
    """Times in s and values of a channel, in order, and its unit; what is marked invalid is NaN."""
    signal = file.get(group=group, index=index, ignore_invalidation_bits=True)  # told below
    if signal.samples.dtype.kind not in "biuf":
        signal = file.get(group=group, index=index, ignore_invalidation_bits=True, raw=True)
    if signal.samples.dtype.kind not in "biuf" or signal.samples.ndim != 1:
        values = np.full(len(signal.timestamps), np.nan)
    else:
        values = signal.samples.astype(float)
    invalid = signal.invalidation_bits
    if invalid is not None:
        values[np.asarray(invalid, dtype=bool)] = np.nan
    time = np.asarray(signal.timestamps, dtype=float) * seconds
    order = np.flatnonzero(np.isfinite(time))
    order = order[np.argsort(time[order], kind="stable")]
    return (time[order], values[order]), str(signal.unit or "")


def _end_silently(error: Exception) -> None:
    """Let go of what an error holds: asammdf's half-made file would complain when it ends."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    traceback.clear_frames(error.__traceback__)
    gc.collect()
    sys.unraisablehook = hook


def _damaged(path: Path, what: str, error: Exception) -> BadInput:
    said = (str(error).splitlines() or [""])[0][:120] or type(error).__name__
    return BadInput(f"cannot read {path} as {what}: {said}")
