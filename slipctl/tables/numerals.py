"""Numbers in cells: decimal marks and thousands marks, decided once for each column.

A reading is a decimal mark and a mark between thousands. A cell rules out the readings that it does
not fit. What is left for all cells of a column is taken if it gives one value for each cell.
``1.234`` alone fits two; then the other columns, or a person, decide, or the column is refused.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slipctl.errors import BadInput

EMPTY = frozenset(
    ("", "-", "--", "---", "na", "n/a", "nan", "null", "none", "nil", "nat", "inf", "-inf", "+inf",
     "1.#inf", "1.#qnan", "#n/a", "#nv", "#div/0!", "#value!", "#ref!", "#name?", "#num!", "#null!",
     "#wert!", "#bezug!", "#zahl!")
)  # fmt: skip
"""What stands in a cell where nothing was measured."""

_NUMBER = re.compile(r"[+-]?(?:[0-9][0-9.,' ]*|[.,][0-9]+)(?:[eEdD][+-]?[0-9]{1,3})?")
_PLAIN = str.maketrans({"−": "-", "\u00a0": " ", "\u202f": " ", "\u2009": " ", "’": "'"})
_DIGITS = str.maketrans("12345678", "99999999")
_FORMULA = re.compile(r'="(.*)"')

FINE = frozenset(("ms", "us", "µs", "μs", "ns", "mm", "mm/s", "mbar"))
"""Units in which people write whole thousands: 1.100 ms may be 1100 ms, whatever others have."""

_SIMPLE = re.compile(r"[+-]?([0-9]+)(?:([.,])([0-9]+))?").fullmatch
"""Most numbers; what decides how these are read is quickly told."""

_EXPONENT = re.compile("[eEdD]").search

READINGS = [(d, g) for d in ".," for g in ("", ".", ",", " ", "'") if g != d]


def plain_cell(text: str) -> str:
    """A cell without what a spreadsheet puts around it: ``="0.5"``, typographic signs, blanks."""
    text = text.strip()
    if not text.isascii():
        text = text.translate(_PLAIN)
    formula = _FORMULA.fullmatch(text) if text.startswith("=") else None
    return formula[1].strip() if formula else text


def is_empty(text: str) -> bool:
    """Whether nothing was measured."""
    return plain_cell(text).lower() in EMPTY


def is_number(text: str) -> bool:
    """Whether a cell is a number in some reading."""
    return _NUMBER.fullmatch(plain_cell(text)) is not None


def _shape(number: str) -> str:
    """What decides how a number is read: its marks and digits, each 1 .. 9 as 9."""
    body = number.lstrip("+-").translate(_DIGITS)
    mantissa = re.split("[eEdD]", body)[0] if _EXPONENT(body) else body
    first, last = (c if c in "0,." else "9" for c in (mantissa[0], mantissa[-1]))
    inner = mantissa[1:-1].replace("0", "9")
    return first + (inner + last) * (len(mantissa) > 1) + "E" * (len(body) > len(mantissa))


def _fits(shape: str, reading: tuple[str, str]) -> bool:
    """Whether a number of this shape can be read so."""
    decimal, group = reading
    mantissa = shape.removesuffix("E")
    whole, mark, rest = mantissa.partition(decimal)
    if mark and not re.fullmatch("[0-9]*", rest):
        return False
    if re.fullmatch("[0-9]*", whole):
        return bool(whole or rest)
    if not group or shape.endswith("E") or whole[0] == "0":
        return False
    return re.fullmatch(rf"[0-9]{{1,3}}(?:{re.escape(group)}[0-9]{{3}})+", whole) is not None


def _value(number: str, reading: tuple[str, str]) -> float:
    decimal, group = reading
    text = number.replace(group, "") if group else number
    return float(text.replace(decimal, ".").replace("d", "e").replace("D", "e"))


@dataclass
class Column:
    """Numbers of a column as written, with the readings that all of its cells fit.

    Attributes:
        cells: by row, None where nothing was measured.
        firsts: row of the first cell of each shape.
        readings: that are left.
        clash: rows of two cells that no reading fits together.
        wrong: row of the first cell that is no number, None if there is none.
    """

    cells: list[str | None]
    firsts: dict[str, int]
    readings: list[tuple[str, str]]
    clash: tuple[int, int] | None
    wrong: int | None

    @property
    def open(self) -> str:
        """The mark that may be a decimal or a thousands mark; empty where all is decided."""
        marks = [m for m in ".," if any(m in s for s in self.firsts)]
        decimals = {tuple(d in s for s in self.firsts) for d, _ in self.readings}
        return marks[0] if marks and len(decimals) > 1 else ""

    @property
    def decimal(self) -> str:
        """The decimal mark, where a cell has one and it is decided."""
        if self.clash or self.wrong is not None or not self.readings or self.open:
            return ""
        d = self.readings[0][0]
        return d if any(d in s for s in self.firsts) else ""

    def values(self, reading: tuple[str, str]) -> np.ndarray:
        """Numbers, NaN where nothing was measured."""
        found = [np.nan if c is None else _value(c, reading) for c in self.cells]
        numbers = np.array(found, dtype=float)
        numbers[np.isinf(numbers)] = np.nan
        return numbers


def column_of(cells: Sequence[str]) -> Column:
    """Sort out the cells of a column."""
    found: list[str | None] = []
    firsts: dict[str, int] = {}
    wrong = None
    seen = set()
    for k, cell in enumerate(cells):
        if simple := _SIMPLE(cell):
            found.append(simple[0])
            whole, mark, rest = simple[1], simple[2], simple[3]
            key = (len(whole), whole[0] == "0", mark, rest and (len(rest), rest[-1] == "0"))
            if key not in seen:
                seen.add(key)
                firsts.setdefault(_shape(simple[0]), k)
            continue
        text = plain_cell(cell)
        if text.lower() in EMPTY:
            found.append(None)
            continue
        if _NUMBER.fullmatch(text) is None:
            wrong = k  # no cell behind it can be read either
            break
        firsts.setdefault(_shape(text), k)
        found.append(text)
    readings, clash = list(READINGS), None
    for shape, k in firsts.items():
        left = [r for r in readings if _fits(shape, r)]
        if not left:
            alone = not any(_fits(shape, r) for r in READINGS)
            clash = (k, k) if alone else (k, _other(shape, firsts))
            break
        readings = left
    if clash is None and (kept := [r for r in readings if not _mixed(firsts, r)]) != readings:
        (d, g), readings = next(r for r in readings if r not in kept), kept
        if not kept:
            clash = (next(k for s, k in firsts.items() if g in s and d not in s),
                     next(k for s, k in firsts.items() if d in s))  # fmt: skip
    return Column(found, firsts, [] if clash else readings, clash, wrong)


def _mixed(shapes: Collection[str], reading: tuple[str, str]) -> bool:
    """Whether 79.200 would be thousands beside 79,2: more likely two people wrote the column."""
    d, g = reading
    if not g or g not in ".," or any(d in s and g in s for s in shapes):
        return False
    return any(d in s for s in shapes) and any(g in s for s in shapes)


def _other(shape: str, firsts: Mapping[str, int]) -> int:
    """Row of a cell that fits none of the readings of this one; of the first cell if none does."""
    mine = [r for r in READINGS if _fits(shape, r)]
    apart = (k for s, k in firsts.items() if not any(_fits(s, r) for r in mine))
    return next(apart, next(iter(firsts.values())))


def marks_of_column(
    column: Column, told: str, elsewhere: Collection[str], parted_by: str, unit: str = ""
) -> tuple[str, str] | None:
    """The reading of a column, None where it stays open.

    Args:
        column: its cells.
        told: decimal mark that a person told, or empty.
        elsewhere: decimal marks of the other columns of the table.
        parted_by: mark between the cells of the text, or empty.
        unit: of the column, or empty.
    """
    readings = [r for r in column.readings if not told or r[0] == told]
    if not readings:
        return None
    if not column.open or told:
        return readings[0]
    mark = column.open
    other = "," if mark == "." else "."
    bare = [s for s in column.firsts if mark not in s and s != "0"]
    if not bare:  # every number has three digits behind its one mark
        usual = set(elsewhere) == {mark} and unit not in FINE
        usual = usual or (parted_by == "," and mark == "." and set(elsewhere) <= {mark})
        return next(r for r in readings if r[0] == mark) if usual else None
    trailing = any(mark in s and s.endswith("0") for s in column.firsts)
    small = all(len(s) <= 3 for s in bare)
    if trailing and small and set(elsewhere) <= {other}:
        # a writer that leaves out marks leaves out zeros behind a decimal mark too
        return next((r for r in readings if r[1] == mark), None)
    return None


def refuse(
    where: str, line: str, rows: Sequence[int], column: Column, cells: Sequence[str], told: str
) -> BadInput:
    """Why a column cannot be read: its row and its cause."""

    def at(k: int) -> str:
        return f"{cells[k].strip()[:30]!r} in {line} {rows[k]}"

    if column.wrong is not None:
        return BadInput(f"{where}: {at(column.wrong)} is no number; leave the cell empty")
    if column.clash is not None:
        a, b = column.clash
        why = "is no number" if a == b else f"has other marks than {at(b)}"
        return BadInput(f"{where}: {at(a)} {why}; write all numbers of a column alike")
    mark = column.open
    if told:
        first = next(k for s, k in column.firsts.items() if any(m in s for m in ".,"))
        return BadInput(f"{where}: {at(first)} has no decimal mark {told!r}, as --decimal has it")
    first = next(k for s, k in column.firsts.items() if mark in s)
    number = cells[first].strip()
    return BadInput(
        f"{where}: {at(first)} may be {number.replace(mark, '.')} or {number.replace(mark, '')};"
        " say which by --decimal . or --decimal ,"
    )
