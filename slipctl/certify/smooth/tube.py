"""Method "tube": how far a smooth loop comes within so many ticks, stable or not.

The loop is compared with a linear one, as in ``sums``, but for a finite time, and with a box of its
own for each stretch of time. While the boxes have held until now, the state after t ticks is

    c_t +- sum_i |A^t e_i| start_i + sum_(s<t) |A^s B| W + sum_(s<t) sum_i |A^(t-1-s) e_i| h_i(s)

with h_i(s) the half-width of what row i adds in the stretch of tick s, and c_(t+1) = A c_t + m(s)
the path of the middles. No generator is ever put together with others, so nothing is lost but
what the remainders are wider than they need be. No decay is asked for.

The check is in whole numbers. One rounding a tick and row is at most 2^-bits. It grows by at most
the largest row sum of A in each tick, so that enough bits bound all of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np

from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.smooth.sampled_loop import Cell, SampledLoop, decimals, remainders
from slipctl.certify.smooth.sums import Bounds, NoProof, _Search, powers_of, read_linear
from slipctl.certify.smooth.sums_check import GRID

STRETCHES = 12
"""Stretches of time."""

MOST_TICKS = 5000
"""Most ticks of a tube."""

SAFE = 160
"""Bits that are left behind the point when all rounding has grown."""

MOST_BITS = 20_000
"""Most bits of a number of the check."""

ROOM = 1e-3
"""Share by which boxes are wider than what the search says of them."""

ENTRIES = ("slow", "rest", "moves", "sizes", "A", "B", "bends", "ends", "boxes")


def stretches(ticks: int) -> list[int]:
    """Ticks at which a stretch begins, and the last one."""
    many = min(STRETCHES, ticks)
    return [ticks * k // many for k in range(many + 1)]


# ---- search -------------------------------------------------------------------------------------


def find_tube(
    loop: SampledLoop, cell: Cell, bounds: Bounds, ticks: int
) -> tuple[dict[str, Any], np.ndarray]:
    """Entries of a proof for so many ticks, and the largest distance of each state from its rest.

    Raises:
        NoProof: there is none; the words say why.
    """
    if not 1 <= ticks <= MOST_TICKS:
        raise NoProof(f"a tube has 1 to {MOST_TICKS} ticks")
    search = _Search(loop, cell, bounds, stable=False)
    A, B, n = search.at_rest, search.B, search.n
    ends = stretches(ticks)
    powers = powers_of(A, ticks + 1)
    if not np.isfinite(powers).all() or np.abs(powers).max() > 1e12:
        raise NoProof("the linear loop grows too fast for so many ticks")
    size = np.abs(powers)
    linear = size @ np.array([float(s) for s in bounds.start])
    pushed = np.abs(powers[:-1] @ B) @ search.push
    linear[1:] += np.cumsum(pushed, axis=0)
    prefix = np.concatenate([np.zeros((1, n, n)), np.cumsum(size[:-1], axis=0)])
    half, middle = linear.copy(), np.zeros((ticks + 1, n))
    found: list[np.ndarray] = []
    for a, b in pairwise(ends):
        box = _stretch(search, A, prefix, (half, middle), (a, b), ticks)
        found.append(box)
    far = np.abs(middle) + half
    entries = {
        **search.linear_entries(A, np.max(found, axis=0)), "ends": ends,
        "boxes": [[str(Fraction(z)) for z in box.tolist()] for box in found],
    }  # fmt: skip
    return entries, far.max(axis=0)


def _stretch(
    search: _Search, A: np.ndarray, prefix: np.ndarray, paths: tuple[np.ndarray, np.ndarray],
    span: tuple[int, int], ticks: int,
) -> np.ndarray:  # fmt: skip
    """Box of a stretch; what it adds is put into the paths of half-widths and middles.

    Raises:
        NoProof: none holds what its own remainders do.
    """
    (half, middle), (a, b) = paths, span
    far = (np.abs(middle[a:b]) + half[a:b]).max(axis=0)
    box = far * (1 + ROOM) + 1e-12
    first = far.copy()
    for _ in range(60):
        added = search._added(A, box, search._bends(box))
        h, m = (added[:, 1] - added[:, 0]) / 2, added.mean(axis=1)
        own = np.zeros((ticks + 1 - a, len(h)))
        t = np.arange(ticks + 1 - a)
        own += (prefix[t] - prefix[np.maximum(t - (b - a), 0)]) @ h
        path = np.zeros_like(own)
        path[0] = middle[a]
        for k in range(ticks - a):
            path[k + 1] = A @ path[k] + (m if k < b - a else 0)
        new = (np.abs(path[: b - a]) + half[a:b] + own[: b - a]).max(axis=0)
        if not np.isfinite(new).all() or (new > 1e3 * (first + 1e-9)).any():
            break
        if (new * (1 + 2e-5) <= box).all():
            half[a:] += own
            middle[a:] = path
            return box
        box = np.maximum(box, new * (1 + ROOM))
    raise NoProof(f"what the ticks add outgrows every box after {a} ticks")


# ---- check --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Exact:
    """The scaled linear loop in whole numbers."""

    A: Mapping[tuple[int, int], int]
    n: int
    bits: int

    def path(self, first: Sequence[int], added: Sequence[Sequence[int]], ticks: int) -> np.ndarray:
        """States by tick from a first one on; ``added`` is what each tick adds, or empty."""
        row: list[list[tuple[int, int]]] = [[] for _ in range(self.n)]
        for (i, j), a in self.A.items():
            row[i].append((j, a))
        one = 1 << GRID
        now, found = list(first), [list(first)]
        for t in range(ticks):
            after = []
            for i in range(self.n):
                if len(row[i]) == 1 and row[i][0][1] == one:
                    after.append(now[row[i][0][0]])
                else:
                    after.append(sum(a * now[j] for j, a in row[i]) >> GRID)
            now = [x + y for x, y in zip(after, added[t], strict=True)] if added else after
            found.append(now)
        return np.array(found, object)


def check_tube(loop: SampledLoop, bounds: Bounds, given: Any) -> tuple[Cell, list[Fraction], int]:
    """Confirm a tube; gives the cell, how far each state comes, and for how many ticks.

    Raises:
        DoesNotHold: it proves nothing. BadInput: it is malformed.
    """
    entry = read_mapping(given, ENTRIES, "evidence.tube", True)
    n = len(loop.states)
    cell, unit, A, B, nominal = read_linear(loop, entry)
    ends = [whole(t, "evidence.ends", 0, MOST_TICKS)
            for t in rows(entry["ends"], "evidence.ends", STRETCHES + 1)]  # fmt: skip
    if len(ends) < 2 or ends[0] != 0 or any(b <= a for a, b in pairwise(ends)):
        raise DoesNotHold("evidence.ends: stretches follow each other from 0 on")
    many = len(ends) - 1
    given_boxes = [[rational(z, "evidence.boxes") for z in rows(box, "evidence.boxes", n, n)]
                   for box in rows(entry["boxes"], "evidence.boxes", many, many)]  # fmt: skip
    if any(z < 0 for box in given_boxes for z in box):
        raise DoesNotHold("evidence.boxes: a half-width is negative")
    added = []
    for box in given_boxes:
        try:
            added.append(remainders(loop, cell, nominal, box, bounds.push, decimals))
        except ArithmeticError:
            raise DoesNotHold("evidence: nothing bounds a slope in a box") from None
    scaled = [[(a / u, b / u) for (a, b), u in zip(one, unit, strict=True)] for one in added]
    half, middle, bits = _paths(A, B, n, ends, scaled, bounds, unit)
    far = [Fraction(0)] * n
    for j, (a, b) in enumerate(pairwise(ends)):
        for k in range(n):
            most = Fraction(int((abs(middle[a:b, k]) + half[a:b, k]).max()), 1 << bits)
            if most * unit[k] > given_boxes[j][k]:
                raise DoesNotHold("evidence: what the ticks add leaves a box")
    for k in range(n):
        most = (abs(middle[:, k]) + half[:, k]).max()
        far[k] = Fraction(int(most), 1 << bits) * unit[k]
    return cell, far, ends[-1]


def _paths(
    A: Mapping[tuple[int, int], int], B: Mapping[tuple[int, int], int], n: int,
    ends: Sequence[int], added: Sequence[Sequence[tuple[Fraction, Fraction]]], bounds: Bounds,
    unit: Sequence[Fraction],
) -> tuple[np.ndarray, np.ndarray, int]:  # fmt: skip
    """Half-widths and middles by tick and state, in whole numbers of so many bits.

    Every rounding is at most one unit a tick and row, and grows at most by the largest row sum of
    A. All of it is below ``slack``, which is added to each value that is used.

    Raises:
        DoesNotHold: the numbers would be too long.
    """
    ticks = ends[-1]
    total = [0] * n
    for (i, _), a in A.items():
        total[i] += abs(a)
    grows = max(0.0, math.log2(max(total)) - GRID) * (1 + 1e-9) + 1e-9 if any(total) else 0.0
    bits = SAFE + math.ceil(ticks * grows)
    if bits > MOST_BITS:
        raise DoesNotHold("evidence: the linear loop grows too fast")
    slack = ((ticks + 1) << (bits - SAFE)) + 1
    exact = _Exact(A, n, bits)
    zero = [0] * n

    def up(value: Fraction) -> int:
        return math.ceil(value * (1 << SAFE))

    half: Any = np.zeros((ticks + 1, n), object)
    size: Any
    for i, s in enumerate(bounds.start):
        if s:
            first = list(zero)
            first[i] = 1 << bits
            size = abs(exact.path(first, [], ticks)) + slack
            half += (size * up(s / unit[i]) >> SAFE) + 1
    for j, w in enumerate(bounds.push):
        if w:
            first = [B.get((i, j), 0) << (bits - GRID) for i in range(n)]
            size = abs(exact.path(first, [], ticks - 1)) + slack
            half[1:] += (np.cumsum(size, axis=0) * up(w) >> SAFE) + 1
    for i in range(n):
        if all(low == 0 == high for low, high in (one[i] for one in added)):
            continue
        widths = [(one[i][1] - one[i][0]) / 2 + Fraction(1, 1 << (SAFE - 40)) for one in added]
        first = list(zero)
        first[i] = 1 << bits
        size = abs(exact.path(first, [], ticks - 1)) + slack
        prefix = np.concatenate([np.zeros((1, n), object), np.cumsum(size, axis=0)])
        for (a, b), h in zip(pairwise(ends), widths, strict=True):
            t = np.arange(a, ticks + 1)
            own = prefix[t - a] - prefix[np.maximum(t - b, 0)]
            half[a:] += (own * up(h) >> SAFE) + 1
    adds = []
    for (a, b), one in zip(pairwise(ends), added, strict=True):
        middles = [math.floor((low + high) / 2 * (1 << bits)) for low, high in one]
        adds += [middles] * (b - a)
    middle = exact.path(zero, adds, ticks)
    return half + slack * 2, middle, bits
