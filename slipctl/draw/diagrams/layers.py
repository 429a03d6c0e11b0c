"""Layers of a block diagram: which column a part stands in, and in which order."""

from __future__ import annotations

from collections import defaultdict
from functools import cache

from slipctl.draw.diagrams.levels import Level


def _order(lv: Level) -> list[str]:
    """Boxes in the order of the stream: as few wires as possible run against it.

    Exact up to 12 boxes, by dynamic programming over the set that stands on the left.
    """
    boxes = [k for k, n in lv.nodes.items() if n.box]
    at = {k: i for i, k in enumerate(boxes)}
    weight: dict[tuple[int, int], int] = defaultdict(int)
    early, late = [0] * len(boxes), [0] * len(boxes)
    for (a, _), ends in lv.nets.items():
        for b, _ in ends:
            if a in at and b in at:
                weight[at[a], at[b]] += 1
            elif b in at:
                early[at[b]] += 1
            elif a in at:
                late[at[a]] += 1
    n = len(boxes)
    backward = [[(1 << j, weight[i, j]) for j in range(n) if weight[i, j]] for i in range(n)]

    def against(left: int, new: int) -> float:
        """Price of putting ``new`` to the right of ``left``."""
        back = sum([many for box, many in backward[new] if left & box])
        share = left.bit_count() / n
        return back + 0.3 * early[new] * share + 0.3 * late[new] * (1 - share)

    @cache
    def best(left: int) -> tuple[float, tuple[int, ...]]:
        if left == (1 << n) - 1:
            return 0.0, ()
        options = []
        for new in range(n):
            if not left >> new & 1:
                cost, rest = best(left | 1 << new)
                options.append((round(against(left, new) + cost, 6), (new, *rest)))
        return min(options)

    if n <= 12:
        return [boxes[i] for i in best(0)[1]]
    left = 0
    out: list[str] = []
    while len(out) < n:
        waiting = [i for i in range(n) if not left >> i & 1]
        new = min(
            waiting,
            key=lambda i: (
                sum(weight[j, i] - weight[i, j] for j in waiting) + against(left, i), i
            ),
        )  # fmt: skip
        out.append(boxes[new])
        left |= 1 << new
    return out


def layers_of(lv: Level) -> dict[str, int]:
    """Column of each node: boxes by their longest path downstream, ends beside their partners."""
    order = {k: i for i, k in enumerate(_order(lv))}
    column = dict.fromkeys(order, 1)
    edges = [(a, b) for (a, _), ends in lv.nets.items() for b, _ in ends]
    for k in order:
        for a, b in edges:
            if b == k and a in order and order[a] < order[k]:
                column[k] = max(column[k], column[a] + 1)
    for k in reversed(order):  # a source stands right before what it feeds
        after = [column[b] for a, b in edges if a == k and b in order and order[b] > order[k]]
        before = [a for a, b in edges if b == k and a in order and order[a] < order[k]]
        if after and not before:
            column[k] = min(after) - 1
    for (a, _), ends in lv.nets.items():
        if a not in order:
            column[a] = min([column[b] for b, _ in ends if b in order], default=1) - 1
    for (a, _), ends in lv.nets.items():
        for b, _ in ends:
            if b not in order:
                column[b] = column[a] + 1
    used = {c: i for i, c in enumerate(sorted(set(column.values())))}
    return {k: used[c] for k, c in column.items()}
