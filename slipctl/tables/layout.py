"""The layout of a text: encoding, what stands between cells, lines before the head, units."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from slipctl.errors import BadInput
from slipctl.tables.clock import is_time
from slipctl.tables.heads import is_offset, is_unit, is_unit_row
from slipctl.tables.numerals import is_empty, is_number
from slipctl.tables.order import first_of, many_rows

LARGEST = 2**28
"""Bytes of a text that is read whole."""

COMMAS = "; a decimal comma between commas? Part cells by ;"

LONGEST = 2**17
"""Letters of a line."""

SAMPLE = 600
"""Lines by which it is decided what stands between cells."""

PREAMBLE = 200
"""Rows among which the head is looked for."""

MARKS = {"\t": "tab", ";": "';'", "|": "'|'", ",": "','", "  ": "two blanks or more", " ": "blanks"}
"""What may stand between cells."""

TYPES = frozenset(
    ("float", "double", "real", "single", "int", "integer", "uint8", "int8", "uint16", "int16",
     "uint32", "int32", "float32", "float64", "bool", "boolean", "string", "text", "number",
     "datetime", "char", "str")
)  # fmt: skip
"""Words of a row below the head that says how columns are stored."""

_SETTING = re.compile(r"\s*#\s*set\s+(\w+)\s*=\s*(.+?)\s*")
_ERROR = re.compile(r"\s*#(N/?[AV]|DIV/0!|VALUE!|REF!|NAME\?|NUM!|NULL!|WERT!|BEZUG!|ZAHL!)", re.I)
"""What a spreadsheet writes for a number it has not; a row that begins so is no comment."""

Row = tuple[int, list[str]]


@dataclass
class Layout:
    """A text as rows.

    Attributes:
        head: cells of the head.
        units: cells of a row of units, as long as the head, empty where there is none.
        rows: line and cells of each row, as many as the head has.
        mark: between cells.
        settings: ``name = value`` of comments ``# set name = value``, with their lines.
        done: how the text was read.
        notes: what was left out.
    """

    head: list[str]
    units: list[str]
    rows: list[Row]
    mark: str
    settings: list[tuple[int, str, str]]
    done: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def text_of(path: Path) -> tuple[str, str]:
    """Text of a file, and its encoding.

    Raises:
        BadInput: no such file, no text, too large.
    """
    try:
        with path.open("rb") as file:  # a device tells no size, and may have no end
            size = max(path.stat().st_size, len(raw := file.read(LARGEST + 1)))
        if size > LARGEST:
            raise BadInput(f"{path} has {size >> 20} MB or more; cut it into files of at most"
                           f" {LARGEST >> 20} MB")  # fmt: skip
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:
        raise BadInput(f"cannot read {str(path)!r}: {error}") from None
    coding = "utf-8-sig"
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        coding = "utf-16"
    elif b"\0" in raw[:4096] and len(raw) > 8:
        odd, even = raw[1:4096:2].count(0), raw[:4096:2].count(0)
        coding = "utf-16-le" if odd > 0.7 * len(raw[1:4096:2]) and not even else "utf-16-be" if (
            even > 0.7 * len(raw[:4096:2]) and not odd) else ""  # fmt: skip
    try:
        text = raw.decode(coding) if coding else "\0"
    except UnicodeDecodeError:
        western = raw.decode("cp1252", errors="replace")
        text, coding = (western, "cp1252") if coding == "utf-8-sig" else ("\0", "")
    if "\0" in text or raw[:4] == b"PK\x03\x04":  # a workbook
        raise BadInput(f"{path} is no text; save it as CSV, a head and a row per sample")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text, "utf-8" if coding == "utf-8-sig" else coding


def layout_of(path: Path) -> Layout:
    """Read the layout of a text.

    Raises:
        BadInput: no text, no head above rows of numbers, rows that do not fit the head; says which.
    """
    text, coding = text_of(path)
    lines = text.split("\n")
    settings, declared = [], ""
    for k, line in enumerate(lines):
        if len(line) > LONGEST:
            raise BadInput(f"{path}, line {k + 1} has {len(line)} letters; a row has {LONGEST} at"
                           " most")  # fmt: skip
        if said := _SETTING.fullmatch(line):
            settings.append((k + 1, said[1], said[2]))
        if k < 3 and (sep := re.fullmatch(r'\s*"?sep=(.)"?[;,\t|]*\s*', line)):
            declared, lines[k] = sep[1], ""
    scores: dict[str, float] = {}
    try:
        for mark in [declared] if declared else MARKS:
            tables = _tables(lines[:SAMPLE], mark, strict=False)
            if tables.groups:
                scores[mark] = _score(tables, mark)
        if not scores:
            heads = [x.strip() for x in lines if x.strip() and not _comment(x)]
            if len(heads) == 1 and re.search(r"[^\W\d_]", heads[0]):
                raise BadInput(f"{path} has a head, {heads[0]}, and no row of numbers below it")
            raise BadInput(f"{path} has no head above rows of numbers; write one, such as"
                           " time [s];speed [km/h], and a row for each sample")  # fmt: skip
        mark = max(scores, key=lambda m: scores[m])
        layout = _of_rows(path, mark, _tables(lines, mark, strict=True))
    except csv.Error as error:
        raise BadInput(f"{path}: {error}; quotes stand in pairs") from None
    layout.settings = settings
    layout.done.insert(0, f"{path}: read as {coding}, {MARKS.get(mark, repr(mark))} between cells")
    return layout


def _rows(lines: Sequence[str], mark: str, strict: bool) -> list[Row]:
    """Line and cells of each row that is no comment and has a cell."""
    if mark in ("  ", " "):
        pattern = r"\s{2,}|\t" if mark == "  " else r"\s+"
        parted = [(k, re.split(pattern, x.strip())) for k, x in enumerate(lines, 1) if x.strip()]
        return [r for r in parted if not _comment(r[1][0])]
    kept = ["" if _comment(x) else x for x in lines]
    reader = csv.reader(io.StringIO("\n".join(kept), newline=""), delimiter=mark,
                        skipinitialspace=mark != "\t", strict=strict)  # fmt: skip
    found, before = [], 0
    for cells in reader:
        line, before = before + 1, reader.line_num
        if reader.line_num - line > 20:
            raise csv.Error(f"line {line}: a quote is not closed")
        pure = [c.strip() for c in cells]
        if any(pure):
            found.append((line, pure))
    return found


def _comment(line: str) -> bool:
    return line.lstrip().startswith("#") and not _ERROR.match(line)


_is_plain = re.compile(r"[+-]?[0-9]+(?:[.,][0-9]+)?").fullmatch
"""Whether a cell is a number, said quickly."""


def _kind(cells: Sequence[str]) -> str:
    """Whether a row is one of a head (words alone), of data (a number or a time), or neither."""
    some = [c for c in cells if c]
    if any(_is_plain(c) for c in some) or any(is_number(c) or is_time(c) for c in some):
        return "data"
    if len(some) > 1 and not all(is_empty(c) for c in some):
        return "head"
    only = some[0].strip("[]() ") if len(some) == 1 and len(cells) > 1 else ""
    if is_unit(only) or is_offset(only):
        return "head"  # a row of one unit
    return "gap" if all(is_empty(c) for c in cells) and len(cells) > 1 else ""


@dataclass
class _Tables:
    """Rows with their kinds, and the groups of heads that data follow."""

    rows: list[Row]
    kinds: list[str]
    groups: list[tuple[int, int]]


def _tables(lines: Sequence[str], mark: str, strict: bool) -> _Tables:
    """Rows of a text, with the last comment as its head where it has no other.

    Raises:
        csv.Error: a quote that is not closed.
    """
    tables = _grouped(_rows(lines, mark, strict))
    if tables.groups:
        return tables
    said = [re.sub(r"^\s*#+\s*", "", x) if _comment(x) and not _SETTING.fullmatch(x) else x
            for x in lines[:PREAMBLE]]  # fmt: skip
    return _grouped(_rows(said + list(lines[PREAMBLE:]), mark, strict))


def _score(tables: _Tables, mark: str) -> float:
    """How well a mark parts the text: share of rows that fit the head, and of numbers."""
    stop = tables.groups[-1][1]
    width = len(tables.rows[stop - 1][1])
    body = tables.rows[stop : stop + 300]
    fit = sum(len(c) == width for _, c in body) / len(body)
    cells = [c for _, r in body for c in r]
    good = sum(is_number(c) or is_time(c) or is_empty(c) for c in cells) / max(1, len(cells))
    return round(good, 2) + 0.5 * round(fit, 2) - 0.1 * (mark in ("  ", " "))


def _grouped(rows: list[Row]) -> _Tables:
    kinds = [_kind(c) for _, c in rows]
    groups, k = [], 0
    while k < len(rows):
        if kinds[k] != "head":
            k += 1
            continue
        end = k
        while end < len(rows) and kinds[end] == "head":
            end += 1
        below = [x for x in kinds[end : end + 9] if x and x != "gap"][:2]
        if below in (["data", "data"], ["data"]):
            groups.append((k, end))
        k = end
    return _Tables(rows, kinds, groups)


def _of_rows(path: Path, mark: str, tables: _Tables) -> Layout:
    """The table below the last head; heads that stand again between runs are left out."""
    rows, notes = tables.rows, []
    parts = [(_head_of(rows[a:b]), a, b) for a, b in tables.groups]
    (at, head, units), _, stop = parts[-1]
    same = [p for p in parts if p[0][1] == head and (p[0][2] == units or not units)]
    first = same[0]
    if parts.index(first) + len(same) != len(parts):
        raise BadInput(f"{path}, line {rows[stop - 1][0]}: two tables in one file; cut it there")
    before = [p for p in parts if p[2] <= first[1]]
    if before and sum(tables.kinds[b] == "data" for b in range(before[-1][2], first[1])) > 30:
        raise BadInput(
            f"{path}, line {rows[first[1]][0]}: a second table begins; cut the file there"
        )
    (at, head, units), _, stop = first
    skipped = {k for (_, a, b) in same[1:] for k in range(a, b)}
    if skipped:
        notes.append(f"{path}: the head stands again in line {rows[same[1][1]][0]}"
                     + f" and {len(same) - 2} times more" * (len(same) > 2))  # fmt: skip
    end = max(k for k, kind in enumerate(tables.kinds) if kind == "data") + 1
    if end < len(rows):
        notes.append(_left_out(path, "line", "behind the table", rows[end:]))
    body = [r for k, r in enumerate(rows[stop:end], stop) if k not in skipped]
    ones = len(body) > 2 and all(c == "1" for c in body[0][1] if is_number(c))
    if ones and not any(units) and is_unit_row(body[0][1], head):  # 1 is a unit and a number
        units, body = body[0][1], body[1:]
    done = [f"{path}: head in line {at}" + (f" behind {at - 1} other lines" if at > 1 else "")
            + (", units in a row of their own" if any(units) else "")]  # fmt: skip
    layout = Layout(head, units, body, mark, [], done, notes)
    _fit_rows(path, layout)
    return layout


def _head_of(group: Sequence[Row]) -> tuple[int, list[str], list[str]]:
    """Line and cells of the head among rows of words, and the row of units."""
    rows = [r for r in group if not all(c.lower() in TYPES for c in r[1] if c)] or list(group)
    line, cells = rows[-1]
    if len(rows) > 1:
        above = rows[-2]
        if is_unit_row(cells, above[1]):
            return above[0], above[1], cells
        if len(above[1]) == len(cells) and is_unit_row(above[1], cells):
            return line, cells, above[1]
    return line, cells, []


def _check_split(path: Path, rows: Sequence[Row]) -> None:
    """Refuse whole numbers behind whole numbers that begin with a zero, as the 05 of 79,05."""
    for before, cells in pairwise(zip(*(c for _, c in rows), strict=True)):
        odd = next((k for k, c in enumerate(cells) if len(c) > 1 and c[0] == "0" and c.isdigit()),
                   None)  # fmt: skip
        if odd is not None and all(c.isdigit() for pair in zip(before, cells, strict=True)
                                   for c in pair if c):  # fmt: skip
            line, cell = rows[odd][0], f"{before[odd]},{cells[odd]}"
            raise BadInput(f"{path}, line {line}: {cell!r} looks like one number{COMMAS}")


def _left_out(path: Path, what: str, where: str, rows: Sequence[Row]) -> str:
    at = [n for n, _ in rows]
    return f"{path}: {many_rows(len(at), what)} {where}, left out: {first_of(at, 'line {}'.format)}"


def _fit_rows(path: Path, layout: Layout) -> None:
    """Give all rows as many cells as the head; refuse what does not fit."""
    head = layout.head
    while head and not head[-1]:
        head.pop()
    width = len(head)
    for line, cells in layout.rows:
        beyond = [c for c in cells[width:] if c]
        if beyond:
            comma = COMMAS if layout.mark == "," else ""
            raise BadInput(f"{path}, line {line} has {len(cells)} cells, its head {width}:"
                           f" {beyond[0][:20]!r} is beyond it{comma}")  # fmt: skip
    if layout.mark == ",":
        for k, name in enumerate(head[1:], 1):
            stray = next((r for r in layout.rows if not name and len(r[1]) > k and r[1][k]), None)
            if stray:
                raise BadInput(f"{path}, line {stray[0]}: cell {k + 1}, {stray[1][k][:20]!r}, has"
                               f" no name in the head{COMMAS}")  # fmt: skip
    whole = [(n, c[:width]) for n, c in layout.rows if len(c) >= width]
    short = [(n, c) for n, c in layout.rows if len(c) < width]
    last = whole[-1][0] if whole else 0
    below = [r for r in short if r[0] > last]
    inside = [r for r in short if r[0] < last]
    if inside and short[0] == layout.rows[0] and all(is_unit(c) for c in short[0][1] if c):
        raise BadInput(f"{path}, line {short[0][0]} looks like a row of units, but has fewer cells"
                       " than the head; write one for each column, - for none")  # fmt: skip
    if not whole:
        n, c = short[0]
        raise BadInput(
            f"{path}, line {n} has {len(c)} cells, its head {width}, and no line has all"
        )
    if len(inside) > max(3, 0.05 * len(layout.rows)):
        n, c = inside[0]
        raise BadInput(f"{path}, line {n} has {len(c)} cells, its head {width}; so have"
                       f" {len(inside) - 1} others; write all cells of a row")  # fmt: skip
    for rows, what, where in ((inside, "row", "with fewer cells than the head"),
                              (below, "line", "behind the table")):  # fmt: skip
        if rows:
            layout.notes.append(_left_out(path, what, where, rows))
    if layout.mark == ",":
        _check_split(path, whole)
    layout.rows = whole
    layout.units = (layout.units + [""] * width)[:width]
