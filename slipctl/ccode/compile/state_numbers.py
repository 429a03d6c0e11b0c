"""What a module keeps as numbers, in the order of its states: for tests, FMUs and Python.

Where all of it is real numbers they lie in this order already. For true and false stand 1 and 0,
and what is not 0 is true. What no counter can be is its 0.
"""

from __future__ import annotations

from slipctl.ccode.module.layout import Layout


def numbers_of(layout: Layout, real: str) -> str:
    """Text of the C function ``numbers_of``, which gives the numbers of what is kept."""
    rows, at = list[str](), 0
    for m in layout.states:
        place = f"kept->{layout.places[m.c]}"
        place += "" if m.scalar else "[k]"
        wide = {"bool": f"({real})({place} ? 1 : 0)", "unsigned int": f"({real}){place}"}
        value = wide.get(layout.kind(m, real), place)
        each = f"x[{at}{'' if m.scalar else ' + k'}] = {value};"
        rows.append(each if m.scalar else f"for (k = 0; k < {m.size}; ++k) {{ {each} }}")
        at += m.size
    return _function(f"numbers_of(const struct {layout.name}_kept *kept, {real} *x)", rows)


def take_numbers(layout: Layout, real: str) -> str:
    """Text of the C function ``take_numbers``, which keeps numbers that it is given."""
    rows, at = list[str](), 0
    for m in layout.states:
        place, number = f"kept->{layout.places[m.c]}", f"x[{at}]" if m.scalar else f"x[{at} + k]"
        there = f"({number} >= ({real})0) && ({number} <= ({real})1e6)"
        whole = {"bool": f"({number} != ({real})0)",
                 "unsigned int": f"({there}) ? (unsigned int){number} : 0U"}  # fmt: skip
        value = whole.get(layout.kind(m, real), number)
        each = f"{place}{'' if m.scalar else '[k]'} = {value};"
        rows.append(each if m.scalar else f"for (k = 0; k < {m.size}; ++k) {{ {each} }}")
        at += m.size
    return _function(f"take_numbers(const {real} *x, struct {layout.name}_kept *kept)", rows)


def _function(head: str, rows: list[str]) -> str:
    counts = ["int k;"] * any(row.startswith("for") for row in rows)
    body = "".join(f"    {row}\n" for row in [*counts, *rows])
    return f"static void {head}\n{{\n{body}}}\n\n"
