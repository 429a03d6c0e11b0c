"""Sums of terms that are alike, each of the next elements: a window, taps, a polynomial of points.

CasADi keeps ``((t0 + t1) + t2) + ...``. Where the terms differ in indices alone, that is a variable
to which a loop adds them, in the same order and from the first one on. So the bits stay.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

LEAST = 4
"""Terms from which on a sum is a loop."""


@dataclass(frozen=True)
class Total:
    """A sum: nodes of its terms, and of the additions before the last one."""

    terms: tuple[int, ...]
    partial: tuple[int, ...]


def totals(nodes: Sequence[Any], uses: Sequence[int], names: Mapping[int, str]) -> dict[int, Total]:
    """Sums of terms that are alike, by the node of the last addition.

    Args:
        nodes: operations in order.
        uses: how often each is used.
        names: names that values have.
    """
    chains: dict[int, list[int]] = {}  # last addition -> the additions, in order
    for k, node in enumerate(nodes):
        if node.op != ca.OP_ADD or not uses[k]:
            continue
        before = node.args[0]
        inside = before in chains and uses[before] == 1 and before not in names
        chains[k] = [*chains.pop(before), k] if inside else [k]
    found: dict[int, Total] = {}
    for adds in chains.values():
        terms = [nodes[adds[0]].args[0], *(nodes[k].args[1] for k in adds)]
        n = next(
            (n for n in range(len(terms), LEAST - 1, -1) if _alike(nodes, uses, names, terms[:n])),
            0,
        )
        if n:
            found[adds[n - 2]] = Total(tuple(terms[:n]), tuple(adds[: n - 2]))
    return found


def _alike(
    nodes: Sequence[Any], uses: Sequence[int], names: Mapping[int, str], here: Sequence[int]
) -> bool:
    """Whether nodes differ in indices and whole numbers alone, which go up evenly."""
    if len(set(here)) == 1:
        return True
    known = [re.fullmatch(r"(\w*?)_(\d+)", names.get(k, "")) for k in here]
    if all(known):
        stems = {m[1] for m in known if m}
        return len(stems) == 1 and _even([int(m[2]) for m in known if m])
    ops = {nodes[k].op for k in here}
    if len(ops) != 1 or any(k in names for k in here):
        return False
    (op,) = ops
    if op == ca.OP_INPUT:
        places = [nodes[k].place for k in here]
        return len({p[0] for p in places}) == 1 and _even([p[1] for p in places])
    if op == ca.OP_CONST:
        values = [nodes[k].value for k in here]
        return all(v == int(v) for v in values) and _even([int(v) for v in values])
    if any(uses[k] != 1 for k in here) or not nodes[here[0]].args:
        return False
    columns = zip(*(nodes[k].args for k in here), strict=True)
    return all(_alike(nodes, uses, names, column) for column in columns)


def _even(values: Sequence[int]) -> bool:
    steps = {b - a for a, b in pairwise(values)}
    return len(steps) == 1 and steps.pop() > 0
