"""Sums of ramps, which is how a table of straight pieces is written in CasADi, as a table in C.

A ramp is ``fmin(fmax(x - a, 0), d)``. Of ramps that follow each other along x, all before a place
have risen there and all after it are 0. So a sum of n products is one product and a constant. The
constants are added in the order of the sum: in double the bits stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import casadi as ca

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node as C

PIECES = -2
"""Operation of a node that is read from a table; its place is (table, column)."""

LEAST = 8
"""Ramps from which on a table is less work."""


@dataclass(frozen=True)
class Ramp:
    """A ramp over node x: where it begins, how long it rises."""

    x: int
    begin: float
    length: float


@dataclass
class Table:
    """Ramps over one x, and by column (height, slope) of each piece."""

    ramps: tuple[Ramp, ...]
    columns: list[list[tuple[float, float]]]

    def declared(self, name: str, number: Callable[[float], C]) -> Iterator[C]:
        """Constants in C: begin and length of each piece, then height and slope by column."""
        n = len(self.ramps)
        for what, values in (
            (f"{name}_at", [number(r.begin) for r in self.ramps]),
            (f"{name}_long", [number(r.length) for r in self.ramps]),
        ):
            yield c.declare("static const double", what, C("list", "", tuple(values)), n)
        rows = [
            C("list", "", tuple(number(v) for column in self.columns for v in column[k]))
            for k in range(n)
        ]
        table = c.index(c.index(c.name(name), n), 2 * len(self.columns))
        yield c.declare("static const double", table, C("list", "", tuple(rows)))


def replace_ramps(nodes: Sequence[Any]) -> tuple[list[Any], list[Table]]:
    """Nodes with each sum of many ramps read from a table, and the tables."""
    chains: dict[int, tuple[float, list[tuple[float, Ramp]]]] = {}
    parts: set[int] = set()  # of a longer chain
    ramps = {k: r for k, node in enumerate(nodes) if (r := _ramp(nodes, node)) is not None}
    for k, node in enumerate(nodes):
        if node.op != ca.OP_ADD:
            continue
        for rest, product in (node.args, node.args[::-1]):
            term = _term(nodes, nodes[product], ramps)
            if term is None:
                continue
            if rest in chains:
                base, terms = chains[rest]
                chains[k] = base, [*terms, term]
                parts.add(rest)
            elif nodes[rest].op == ca.OP_CONST:
                chains[k] = nodes[rest].value, [term]
    made = list(nodes)
    tables: list[Table] = []
    by_ramps: dict[tuple[Ramp, ...], int] = {}
    for k, (base, terms) in chains.items():
        key = tuple(r for _, r in terms)
        if k in parts or len(key) < LEAST or not _in_order(key):
            continue
        if key not in by_ramps:
            by_ramps[key] = len(tables)
            tables.append(Table(key, []))
        columns = tables[by_ramps[key]].columns
        place = (by_ramps[key], len(columns))
        made[k] = replace(nodes[k], op=PIECES, args=(key[0].x,), place=place)
        column = []
        for slope, ramp in terms:
            column.append((base, slope))
            base += slope * ramp.length
        columns.append(column)
    return made, tables


def _in_order(ramps: Sequence[Ramp]) -> bool:
    """Whether each ramp is at its end where the next one begins, in double too."""
    one = len({r.x for r in ramps}) == 1
    return one and all(b.begin - a.begin >= a.length for a, b in pairwise(ramps))


def _constant(nodes: Sequence[Any], args: Sequence[int]) -> tuple[float, int] | None:
    """The constant among two arguments, and the other argument."""
    for a, b in (args, args[::-1]):
        if nodes[a].op == ca.OP_CONST:
            return nodes[a].value, b
    return None


def _ramp(nodes: Sequence[Any], node: Any) -> Ramp | None:
    if node.op != ca.OP_FMIN or (upper := _constant(nodes, node.args)) is None:
        return None
    inner = nodes[upper[1]]
    if inner.op != ca.OP_FMAX or (lower := _constant(nodes, inner.args)) is None or lower[0]:
        return None
    over = nodes[lower[1]]
    if over.op != ca.OP_SUB or nodes[over.args[1]].op != ca.OP_CONST:
        return None
    return Ramp(over.args[0], nodes[over.args[1]].value, upper[0])


def _term(nodes: Sequence[Any], node: Any, ramps: dict[int, Ramp]) -> tuple[float, Ramp] | None:
    """Slope and ramp of a product."""
    if node.op != ca.OP_MUL or (factor := _constant(nodes, node.args)) is None:
        return None
    return (factor[0], ramps[factor[1]]) if factor[1] in ramps else None
