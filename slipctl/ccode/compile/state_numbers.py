"""What a module keeps as numbers, in the order of its states: for tests, FMUs and Python.

Where all of it is real numbers they lie in this order already. For true and false stand 1 and 0,
and what is not 0 is true. What no counter can be is its 0.
"""

from __future__ import annotations

from collections.abc import Iterator

from slipctl.ccode.module.layout import Layout

WHOLE = ("int", "unsigned int")
"""Types of what counts."""


def numbers_of(layout: Layout, real: str) -> str:
    """Text of the C function ``numbers_of``, which gives the numbers of what is kept."""
    rows = []
    for size, kind, place, number in _places(layout, real):
        wide = {"bool": f"({real})({place} ? 1 : 0)", **dict.fromkeys(WHOLE, f"({real}){place}")}
        rows.append(_each(size, f"{number} = {wide.get(kind, place)};"))
    return _function(f"numbers_of(const struct {layout.name}_kept *kept, {real} *x)", rows)


def take_numbers(layout: Layout, real: str) -> str:
    """Text of the C function ``take_numbers``, which keeps numbers that it is given."""
    rows = []
    for size, kind, place, number in _places(layout, real):
        there = f"({number} >= ({real})0) && ({number} <= ({real})1e6)"
        whole = {"bool": f"({number} != ({real})0)", "int": f"({there}) ? (int){number} : 0",
                 "unsigned int": f"({there}) ? (unsigned int)(int){number} : 0U"}  # fmt: skip
        rows.append(_each(size, f"{place} = {whole.get(kind, number)};"))
    return _function(f"take_numbers(const {real} *x, struct {layout.name}_kept *kept)", rows)


def _places(layout: Layout, real: str) -> Iterator[tuple[int, str, str, str]]:
    """Of each state the elements, 0 of a number, its type, where it lies, and where among them."""
    at = 0
    for m in layout.states:
        k, among = ("", f"{at}") if m.scalar else ("[k]", f"{at} + k" if at else "k")
        size = 0 if m.scalar else m.size
        yield size, layout.kind(m, real), f"kept->{layout.places[m.c]}{k}", f"x[{among}]"
        at += m.size


def _each(size: int, line: str) -> str:
    return f"for (k = 0; k < {size}; ++k) {{ {line} }}" if size else line


def _function(head: str, rows: list[str]) -> str:
    counts = ["int k;"] * any(row.startswith("for") for row in rows)
    body = "".join(f"    {row}\n" for row in [*counts, *rows])
    return f"static void {head}\n{{\n{body}}}\n\n"
