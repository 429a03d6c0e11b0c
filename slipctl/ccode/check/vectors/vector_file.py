"""A person's own test vectors: a table with a column for each input, a row for each tick."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.block.units.unit_algebra import factor
from slipctl.errors import BadInput, nearest

_HEAD = re.compile(r"(?P<name>[^\s\[]+)(\[(?P<element>\d+)\])?(\s+\[(?P<unit>[^\]]+)\])?")
"""``v_s [m/s]``, ``omega[2] [rad/s]``: name, element of an array, unit."""

LARGEST = 2**28
"""Bytes of a file that is read."""


def read_vectors(path: Path | str, block: Block) -> dict[str, np.ndarray]:
    """Inputs of a block, tick by tick, from a CSV file.

    Args:
        path: of a table with commas; its head is ``v_s [m/s],omega[0],omega[1]``, elements of a
            matrix column by column. Without a unit, numbers are in that of the input. A column
            ``time`` is passed over: a row is a tick.
        block: whose inputs they are; one without a column keeps its value.

    Returns:
        Array over ticks by input, ``(ticks, *shape)``.

    Raises:
        BadInput: no such file, no ticks, a column that is no input or has another dimension, an
            array of which an element is missing, a cell that is no finite number.
    """
    rows = _rows(Path(path))
    head, cells = rows[0], rows[1:]
    columns = [_column(path, text, block) for text in head]
    named = [c[:2] for c in columns if c is not None]
    for n, k in named:
        if named.count((n, k)) > 1:
            raise BadInput(f"{path}: its head has {_said(block.inputs[n], n, k)} twice; leave one")
    if not named:
        raise BadInput(f"{path}: no column is an input of {block.name}; {_wanted(block)}")
    if not cells:
        raise BadInput(f"{path} has no row below its head; write one for each tick")
    found: dict[tuple[str, int], np.ndarray] = {}
    numbers = _numbers(path, cells, [c is not None for c in columns])
    for column, values in zip(columns, numbers.T, strict=True):
        if column is not None:
            found[column[:2]] = values * column[2]
    return {n: _whole(path, block.inputs[n], n, found) for n in dict.fromkeys(n for n, _ in named)}


def _rows(path: Path) -> list[list[str]]:
    try:
        if path.stat().st_size > LARGEST:
            raise BadInput(f"{path} is larger than {LARGEST >> 20} MB; write fewer ticks")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise BadInput(f"{path} is no text in UTF-8; write a table with commas") from None
    try:
        rows = [r for r in csv.reader(text.splitlines()) if r]  # without empty lines
    except csv.Error as error:
        raise BadInput(f"{path} is no table with commas: {error}") from None
    if not rows or not any(c.strip() for c in rows[0]):
        raise BadInput(f"{path} begins with no head; write one, such as v_s [m/s]")
    return rows


def _column(path: Path | str, text: str, block: Block) -> tuple[str, int, float] | None:
    """Input, element and factor of a column; None for the time."""
    match = _HEAD.fullmatch(text.strip())
    name = match["name"] if match else text.strip()
    if name == "time" and name not in block.inputs:
        return None
    if match is None or name not in block.inputs:
        close = nearest(name, block.inputs)
        raise BadInput(f"{path}: {text.strip()!r} is no input of {block.name}{close}")
    signal = block.inputs[name]
    element = int(match["element"] or 0)
    size = int(np.prod(signal.shape, dtype=int))
    if element >= size or (match["element"] is None and size > 1):
        raise BadInput(
            f"{path}: {text.strip()!r}: {name} has {size} elements; write {name}[0] to"
            f" {name}[{size - 1}]"
        )
    try:
        scale = factor(match["unit"], signal.unit) if match["unit"] else 1.0
    except BadInput as error:
        raise BadInput(f"{path}: column {name}: {error}") from None
    return name, element, scale


def _numbers(path: Path | str, rows: Sequence[Sequence[str]], read: Sequence[bool]) -> np.ndarray:
    """Cells as numbers, 0 in the columns that are not read."""
    numbers = np.zeros((len(rows), len(read)))
    for tick, row in enumerate(rows):
        if len(row) != len(read):
            raise BadInput(
                f"{path}, row {tick + 1}: {len(row)} cells below a head of {len(read)};"
                " write one for each column"
            )
        for k, cell in enumerate(row):
            if not read[k]:
                continue
            try:
                numbers[tick, k] = float(cell)
            except ValueError:
                numbers[tick, k] = np.nan
            if not np.isfinite(numbers[tick, k]):
                raise BadInput(
                    f"{path}, row {tick + 1}: {cell.strip()!r} is no finite number; the test in the"
                    " folder tries NaN and infinity itself"
                )
    return numbers


def _whole(
    path: Path | str, signal: Signal, name: str, found: Mapping[tuple[str, int], np.ndarray]
) -> np.ndarray:
    """An input from its elements, each a column."""
    size = int(np.prod(signal.shape, dtype=int))
    missing = [k for k in range(size) if (name, k) not in found]
    if missing:
        raise BadInput(f"{path} has no column {_said(signal, name, missing[0])}; write it too")
    flat = np.column_stack([found[name, k] for k in range(size)])
    whole = flat.reshape(len(flat), *signal.shape[::-1])  # column by column
    return whole.transpose(0, *range(whole.ndim - 1, 0, -1))


def _said(signal: Signal, name: str, element: int) -> str:
    return f"{name}[{element}]" if signal.shape else name


def _wanted(block: Block) -> str:
    return "write " + ", ".join(f"{n} [{s.unit}]" for n, s in block.inputs.items())
