"""Tables that a person wrote: CSV with comments, a head, and rows that all fit it."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import NamedTuple

from slipctl.errors import BadInput


class Table(NamedTuple):
    """A table as read.

    Attributes:
        path: where from.
        names: of its columns.
        units: of its columns, ``"1"`` in ``creep [1]``; empty where the head says none.
        rows: line number and cells of each row.
        settings: ``name = value`` of its comments ``# set name = value``, with their lines.
    """

    path: str
    names: list[str]
    units: list[str]
    rows: list[tuple[int, list[str]]]
    settings: list[tuple[int, str, str]]

    def number(self, line: int, cell: str) -> float:
        """Value of a cell.

        Raises:
            BadInput: it is no finite number, or its square is none.
        """
        try:
            value = float(cell)
        except ValueError:
            value = float("nan")
        if value - value != 0.0:
            raise BadInput(f"{self.path}, line {line}: {cell!r} is no number")
        if abs(value) > LARGEST:
            raise BadInput(f"{self.path}, line {line}: {cell!r} is beyond what can be squared")
        return value


LARGEST = 1e100
"""Largest number of a table: sums of squares stay far from what a number can hold."""


EXCEL = re.compile(r"\s*#(N/A|DIV/0!|VALUE!|REF!|NAME\?|NUM!|NULL!)", re.I)
"""What a spreadsheet writes for a number it has not; a row that begins so is no comment."""


DECIMAL_COMMA = re.compile(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$")
"""A number with a decimal comma, which a table with ``;`` between its columns may have."""


def read_table(path: str | Path) -> Table:
    """Read a table: comments begin with ``#``, the first other line is its head.

    Columns are parted by commas, or by semicolons if the head has one; then numbers may have a
    decimal comma.

    Raises:
        BadInput: no such file, no text, no rows, or a row with a wrong number of columns.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise BadInput(f"{path} is no text; save it as CSV in UTF-8") from None
    except ValueError as error:
        raise BadInput(f"cannot read {str(path)!r}: {error}") from None
    if "\0" in text:
        raise BadInput(f"{path} is no text; save it as CSV in UTF-8")
    names: list[str] = []
    units: list[str] = []
    rows, settings, mark = [], [], ","
    for line, content in enumerate(text.splitlines(), 1):
        if content.lstrip().startswith("#") and not (names and EXCEL.match(content)):
            said = re.fullmatch(r"\s*#\s*set\s+(\w+)\s*=\s*(.+?)\s*", content)
            if said:
                settings.append((line, said[1], said[2]))
            continue
        try:
            if not names:
                mark = ";" if ";" in content else ","
            cells = [c.strip() for c in next(csv.reader([content], delimiter=mark), [])]
        except csv.Error as error:
            raise BadInput(f"{path}, line {line}: {error}") from None
        if not any(cells):
            continue
        if not names:
            for cell in cells:
                head = re.fullmatch(r"([A-Za-z_][\w.]*)\s*(?:\[\s*(.+?)\s*\])?", cell)
                if head is None:
                    raise BadInput(
                        f"{path}, line {line}: {cell!r} is no name of a column; the head is such as"
                        f" 'creep,force' or 'creep [1],force [kN]'"
                    )
                names.append(head[1])
                units.append(head[2] or "")
            if len(set(names)) < len(names):
                raise BadInput(f"{path}, line {line}: two columns have one name")
            continue
        if mark == ";":  # as spreadsheets write where the comma is the decimal mark
            cells = [DECIMAL_COMMA.sub(r"\1.\2", c) for c in cells]
        if len(cells) != len(names):
            raise BadInput(
                f"{path}, line {line} has {len(cells)} columns, its head {len(names)}:"
                f" {', '.join(names)}"
            )
        rows.append((line, cells))
    if not rows:
        raise BadInput(f"{path} has no rows; give a head and a row per line")
    return Table(str(path), names, units, rows, settings)
