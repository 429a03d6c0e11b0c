"""Blocks at many drawn points at once, for tests that work the same out apart from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl import Block

Rows = dict[str, np.ndarray]


class Draw:
    """Draws of so many points; every element of every signal differs."""

    def __init__(self, many: int, seed: int) -> None:
        self.many, self.rng = many, np.random.default_rng(seed)

    def even(self, low: float, high: float, size: int = 1) -> np.ndarray:
        return self.rng.uniform(low, high, (self.many, size))

    def bits(self, size: int = 1, share: float = 0.5) -> np.ndarray:
        return (self.rng.uniform(size=(self.many, size)) < share) * 1.0

    def one_of(self, *rows: Any) -> np.ndarray:
        """Of each element one of some rows; a row is a number or of the shape that is wanted."""
        rows = np.broadcast_arrays(*rows)
        pick = self.rng.integers(len(rows), size=rows[0].shape)
        return np.choose(pick, rows)


def values(block: Block, given: Mapping[str, np.ndarray], many: int) -> tuple[Rows, Rows, Rows]:
    """States and parameters as they are, next states, and outputs; a row per point.

    What is not given is as it is declared.
    """
    start, numbers = block.start(), block.param_values()
    at: Rows = {}
    for signals, usual in ((block.states, start), (block.inputs, {}), (block.params, numbers)):
        for name, s in signals.items():
            value = given[name] if name in given else np.ravel(usual.get(name, s.value), "F")
            at[name] = np.broadcast_to(np.asarray(value, dtype=float), (many, s.size))
    packed = [
        np.concatenate([np.zeros((many, 0)), *(at[n] for n in signals)], axis=1).T
        for signals in (block.states, block.inputs, block.params)
    ]
    assert set(given) <= set(at), set(given) - set(at)
    found = [np.array(k.full()).T for k in block.f.map(many)(*packed)]
    after: list[Rows] = [{}, {}]
    for k, signals in enumerate((block.states, block.outputs)):
        column = 0
        for name, s in signals.items():
            after[k][name] = found[k][:, column : column + s.size]
            column += s.size
    return at, after[0], after[1]


def numbers(block: Block) -> dict[str, Any]:
    """Its parameters: a number, or a list of several."""
    found = {n: np.ravel(v) for n, v in block.param_values().items()}
    return {n: v[0] if len(v) == 1 else v.tolist() for n, v in found.items()}


def assert_same(found: Mapping[str, np.ndarray], wanted: Mapping[str, Any], **close: Any) -> None:
    """Each name has the same number at each point."""
    assert set(found) == set(wanted)
    for name, rows in found.items():
        here = np.broadcast_to(np.asarray(wanted[name], dtype=float), rows.shape)
        np.testing.assert_allclose(
            rows, here, **({"rtol": 1e-9, "atol": 1e-9} | close), err_msg=name
        )
