"""Graphs of formulas that are built operation by operation."""

from __future__ import annotations

from typing import Any

from slipctl.block.text.formula import Graph, Node


def built(*made: Any) -> tuple[Graph, list[int]]:
    """A graph of nested tuples, and their nodes: names are symbols, numbers constants."""
    g, places = Graph(), []

    def put(part: Any) -> int:
        if isinstance(part, str):
            node = Node("symbol", name=part)
        elif isinstance(part, float):
            node = Node("const", value=part)
        else:
            node = Node(part[0], tuple(put(p) for p in part[1:]))
        if node not in g.nodes:
            g.nodes.append(node)
        return g.nodes.index(node)

    for one in made:
        places.append(put(one))
    return g, places


def summed(*parts: Any, op: str = "add") -> Any:
    """A sum or a difference, from the left."""
    total = parts[0]
    for p in parts[1:]:
        total = (op, total, p)
    return total
