"""Order and columns of boxes in a block diagram, against every other order."""

from __future__ import annotations

from itertools import pairwise, permutations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl.draw.diagrams.layers import _order, layers_of


def level(boxes: int, wires: list[tuple[str, str]], ends: int = 2) -> Any:
    """Boxes b0, b1, ..., ends e0, ...; a net for each wire."""
    nodes = {f"b{k}": SimpleNamespace(box=True) for k in range(boxes)}
    nodes |= {f"e{k}": SimpleNamespace(box=False) for k in range(ends)}
    return SimpleNamespace(nodes=nodes, nets={(a, f"p{k}"): [(b, "u")]
                                              for k, (a, b) in enumerate(wires)})  # fmt: skip


def price(order: tuple[str, ...], wires: list[tuple[str, str]]) -> float:
    """Wires that run against an order, and 0.3 of how far ends stand from their edge."""
    total = 0.0
    for k, box in enumerate(order):
        left, share = set(order[:k]), k / len(order)
        total += sum(a == box and b in left for a, b in wires)
        total += 0.3 * share * sum(b == box and a.startswith("e") for a, b in wires)
        total += 0.3 * (1 - share) * sum(a == box and b.startswith("e") for a, b in wires)
    return total


@pytest.mark.parametrize("seed", range(8))
def test_no_other_order_has_fewer_wires_against_it(seed):
    rng = np.random.default_rng(seed)
    names = [*(f"b{k}" for k in range(5)), "e0", "e1"]
    wires = [tuple(rng.choice(names, 2, replace=False)) for _ in range(9)]
    wires = [(str(a), str(b)) for a, b in wires if not (a[0] == b[0] == "e")]
    found = _order(level(5, wires))
    assert sorted(found) == names[:5]
    least = min(price(p, wires) for p in permutations(names[:5]))
    assert price(tuple(found), wires) == pytest.approx(least, abs=1e-5)


def test_a_chain_of_many_boxes_stands_in_its_order():
    many = [f"b{k}" for k in range(14)]
    shuffled = list(np.random.default_rng(1).permutation(many))
    wires = list(pairwise(shuffled))
    assert _order(level(14, [(str(a), str(b)) for a, b in wires])) == shuffled


def test_a_box_stands_behind_all_that_feed_it():
    wires = [("e0", "b0"), ("b0", "b1"), ("b1", "b2"), ("b0", "b2"), ("b2", "b0"), ("b2", "e1")]
    column = layers_of(level(3, wires))
    assert [column[f"b{k}"] for k in range(3)] == [1, 2, 3]
    assert column["e0"] < column["b0"]
    assert column["e1"] > column["b2"]
