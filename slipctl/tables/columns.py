"""Expressions of columns as a person types them: names, their units, arithmetic behind them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from slipctl.block.units.unit_algebra import says_what_counts, unit
from slipctl.errors import BadInput
from slipctl.tables.heads import is_offset, is_unit, other_unit_in_name, unit_in_name, why_no_unit
from slipctl.tables.table import Table


@dataclass(frozen=True)
class Expression:
    """Arithmetic with columns.

    Attributes:
        text: with an identifier for each column.
        columns: by identifier, in the order of the text.
        told: unit behind a column, by identifier; empty where there is none.
    """

    text: str
    columns: Mapping[str, str]
    told: Mapping[str, str]

    @property
    def plain(self) -> bool:
        """Whether it is one column as it is."""
        return self.text in self.columns


def identifier_of(name: str) -> str:
    """Identifier for a column of any name: the name itself if it is one."""
    return (
        name
        if name.isidentifier()
        else re.sub(r"\W", "_", f"{name}__").lstrip("_0123456789") or "c__"
    )


def expression_of(text: str, table: Table) -> Expression:
    """Find the columns in a text, longest names first, each with its unit in brackets.

    Raises:
        BadInput: two units of one column.
    """
    text = text.strip()
    names = {n: n for n in table.cells} | {h: n for n, h in table.heads.items() if h}
    found = _found(text, names, 0)
    return found if found.columns else _found(text, names, re.IGNORECASE)


def _found(text: str, names: Mapping[str, str], flags: int) -> Expression:
    """The columns in a text, by name or by head."""
    parts = [_edged(n) for n in sorted(names, key=len, reverse=True)]
    pattern = re.compile(rf"({'|'.join(parts)})(?:\s*\[([^\]]*)\])?", flags)
    lower = {n.lower(): c for n, c in names.items()}
    columns: dict[str, str] = {}
    told: dict[str, str] = {}

    def put(match: re.Match[str]) -> str:
        column = names.get(match[1]) or lower[match[1].lower()]
        key = identifier_of(column)
        while columns.get(key, column) != column:
            key += "_"
        said = (match[2] or "").strip()
        if said and told.get(key) and said != told[key]:
            raise BadInput(f"--map gives {column} in {told[key]} and in {said}; write one unit")
        columns[key] = column
        told[key] = said or told.get(key, "")
        return key

    return Expression(pattern.sub(put, text) if parts else text, columns, told)


def _edged(name: str) -> str:
    """Pattern of a name that is no part of a longer word."""
    left = r"(?<![\w.])" if name[:1].isalnum() or name[:1] == "_" else ""
    right = r"(?!\w)" if name[-1:].isalnum() or name[-1:] == "_" else ""
    return left + re.escape(name) + right


def turned_twice(text: str, scales: Mapping[str, float]) -> list[str]:
    """A line on each number of an expression that turns a column which its unit has turned.

    Args:
        text: as a person typed it.
        scales: by column, what has made its unit the SI one.
    """
    numbers = map(float, re.findall(r"(?<![\w.])\d+\.?\d*(?:[eE][+-]?\d+)?", text))
    return [
        f"{text}: {number:g} turns {column} a second time; leave it out where it is there for the"
        " unit"
        for number in numbers
        for column, scale in scales.items()
        if scale != 1.0
        and any(math.isclose(number * s, 1, rel_tol=2e-3) for s in (scale, 1 / scale))
    ]


def unit_of_column(table: Table, column: str, told: str, wanted: str, notes: list[str]) -> str:
    """Unit of a column by the person, its head or its name; empty where nobody says one.

    Args:
        table: the table.
        column: its name.
        told: by the person, or empty.
        wanted: unit that is wanted there, or empty.
        notes: a line is added where the name says it, or the head says what is not known.

    Raises:
        BadInput: two that contradict each other, a unit that is not known, a scale with an offset.
    """
    head = table.units[column]
    where = f"{table.path}: {column}"
    if head and not is_unit(head):
        if not told or is_offset(head):
            raise BadInput(f"{where}: {why_no_unit(head)}")
        notes.append(
            f"{column} is read in {told}, as --map says; the unit {head!r} in its head is not known"
        )
        head = ""
    elif head and told and says_what_counts(head, told):
        notes.append(f"{column} is in {told}, as --map says; its head says {head}")
        head = ""
    named = unit_in_name(column, told or head or wanted) if told or head or wanted else ""
    said = {
        w: u for w, u in (("as told", told), ("by its head", head), ("by its name", named)) if u
    }
    first = next(iter(said.values()), "")
    for who, u in said.items():
        if not unit(u).same(unit(first)):
            raise BadInput(f"{where} is in {first} {next(iter(said))} and in {u} {who}; units are"
                           " never overruled, leave out the wrong one")  # fmt: skip
    if named and len(said) == 1:
        notes.append(f"{column} is in {named} by its name")
    if not said and wanted and (other := other_unit_in_name(column, wanted)):
        raise BadInput(
            f"{where} is in {other} by its name, and {wanted} is wanted, another dimension; say"
            f" the unit behind its name, {column}[{wanted}], or convert it by an expression"
        )
    return first
