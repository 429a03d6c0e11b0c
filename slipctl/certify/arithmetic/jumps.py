"""Jumps of a function over a box: what no slope bounds.

A function of comparisons, signs and floors is continuous wherever none of them can change. Boxes in
which one can are halved. In those that are left, every value that such an instruction may take is
put in its place. The spread of the function over all of them bounds its jump.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import casadi as ca
import numpy as np

from slipctl.certify.arithmetic.enclosure import Interval, enclose, scalar_function

HALVINGS = 40
MOST_CASES = 256
MOST_BOXES = 4000


class Jump(NamedTuple):
    """Where a function may jump.

    Attributes:
        bound: proven upper bound of any jump in the box; infinite where nothing can be said. Where
            the function is continuous it is what is left in the narrowest boxes.
        at: middle of the box with the largest one; empty if nothing can jump.
        width: largest width of that box.
    """

    bound: float
    at: tuple[float, ...]
    width: float


def largest_jump(f: ca.Function, lo: np.ndarray, hi: np.ndarray) -> Jump:
    """Largest jump of the first output of a function over a box.

    Args:
        f: as of ``enclosure.enclose``. lo, hi: ends of the box.
    """
    f = scalar_function(f)
    x = ca.SX.sym("x", f.numel_in(0))
    f = ca.Function("f", [x], [ca.cse(f(x))])  # the same comparison is one instruction
    low, high = lo.reshape(-1, 1).astype(float), hi.reshape(-1, 1).astype(float)
    wide = np.where(hi > lo, hi - lo, 1.0)
    for _ in range(HALVINGS * len(lo)):
        open_: dict[int, Interval] = {}
        enclose(f, low, high, open_)
        keep = np.zeros(low.shape[1], bool)
        for a, b in open_.values():
            keep |= a < b
        low, high = low[:, keep], high[:, keep]
        along = np.argmax((high - low) / wide[:, None], axis=0)
        cut = np.arange(low.shape[0])[:, None] == along
        middle = low + (high - low) / 2
        splits = ((middle > low) & (middle < high) & cut).any()
        if not low.shape[1] or not splits or low.shape[1] > MOST_BOXES:
            break
        low, high = (np.hstack([low, np.where(cut, middle, low)]),
                     np.hstack([np.where(cut, middle, high), high]))  # fmt: skip
    if not low.shape[1]:
        return Jump(0.0, (), 0.0)
    open_ = {}
    enclose(f, low, high, open_)
    least, most = np.full(low.shape[1], np.inf), np.full(low.shape[1], -np.inf)
    for forced in _cases(open_, low.shape[1]):
        a, b = enclose(f, low, high, forced=forced)
        least, most = np.minimum(least, a[0]), np.maximum(most, b[0])
    spread = most - least
    worst = int(np.argmax(spread))
    where = tuple(float(v) for v in (low[:, worst] + high[:, worst]) / 2)
    return Jump(float(spread[worst]), where, float((high - low)[:, worst].max()))


def _cases(open_: dict[int, Interval], many: int) -> Iterator[dict[int, np.ndarray]]:
    """All combinations of the values of what may change; none forced where there are too many."""
    choices = {}
    for k, (a, b) in open_.items():
        if (a < b).any():
            span = int(np.nanmax(b - a)) if np.isfinite(b - a).all() else MOST_CASES
            choices[k] = [np.clip(a + i, a, b) for i in range(span + 1)]
    if np.prod([float(len(c)) for c in choices.values()]) > MOST_CASES:
        yield {}
        return
    for values in product(*choices.values()):
        yield dict(zip(choices, values, strict=True))
