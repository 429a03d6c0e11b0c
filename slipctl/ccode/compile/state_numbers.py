"""What a module keeps as numbers, in the order of its states: for tests, FMUs and Python.

Where all of it is numbers they lie in this order already. Where some is true or false, 1 and 0
stand for that, and what is not 0 is true.
"""

from __future__ import annotations

from slipctl.ccode.module.layout import Layout


def numbers_of(layout: Layout, real: str) -> str:
    """Text of the C function ``numbers_of``, which gives the numbers of what is kept."""
    rows, at = list[str](), 0
    for m in layout.states:
        place = f"kept->{layout.places[m.c]}"
        if layout.kind(m, real) == "bool":
            one = f"x[{at}] = ({real})({place} ? 1 : 0);"
            each = f"x[{at} + k] = ({real})({place}[k] ? 1 : 0);"
        else:
            one = f"x[{at}] = {place};"
            each = f"x[{at} + k] = {place}[k];"
        rows.append(one if m.scalar else f"for (k = 0; k < {m.size}; ++k) {{ {each} }}")
        at += m.size
    return _function(f"numbers_of(const struct {layout.name}_kept *kept, {real} *x)", rows)


def take_numbers(layout: Layout, real: str) -> str:
    """Text of the C function ``take_numbers``, which keeps numbers that it is given."""
    rows, at = list[str](), 0
    for m in layout.states:
        place, number = f"kept->{layout.places[m.c]}", f"x[{at}]" if m.scalar else f"x[{at} + k]"
        value = f"({number} != ({real})0)" if layout.kind(m, real) == "bool" else number
        each = f"{place}{'' if m.scalar else '[k]'} = {value};"
        rows.append(each if m.scalar else f"for (k = 0; k < {m.size}; ++k) {{ {each} }}")
        at += m.size
    return _function(f"take_numbers(const {real} *x, struct {layout.name}_kept *kept)", rows)


def _function(head: str, rows: list[str]) -> str:
    counts = ["int k;"] * any(row.startswith("for") for row in rows)
    body = "".join(f"    {row}\n" for row in [*counts, *rows])
    return f"static void {head}\n{{\n{body}}}\n\n"
