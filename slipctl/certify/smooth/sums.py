"""Method "sums": a box about the rest that no push leaves, for smooth loops of many states.

The loop is compared with a linear one (``sampled_loop``); what each tick adds is summed up
(``sums_check``). Here is the search, in floats: the box is grown from that of the linear loop until
it holds what its own remainders do. Nothing here has to be believed: the check repeats the proof.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.smooth.sampled_loop import (
    Cell,
    Nominal,
    SampledLoop,
    boxes,
    decimals,
    input_enclosures,
    remainders,
    slope_ranges,
)
from slipctl.certify.smooth.sums_check import (
    GRID,
    Decay,
    check_decay,
    peaks,
    response,
    whole_entries,
)

MOST_TICKS = 60_000
"""Most ticks of a sum."""

BLOCK = 64
"""Ticks that are summed up at once."""

ROOM = 1e-3
"""Share by which the box is wider than what the search says of it."""

SMALL = 1e-7
"""Share of a state's box below which what a row adds has no sum of its own."""


class NoProof(Exception):
    """Why there is no proof, in words."""


@dataclass(frozen=True)
class Bounds:
    """What a proof withstands: the largest of each push, and how far states may start off rest."""

    push: tuple[Fraction, ...]
    start: tuple[Fraction, ...]


# ---- search -------------------------------------------------------------------------------------


def find_cell(loop: SampledLoop, cell: Cell, bounds: Bounds) -> tuple[dict[str, Any], np.ndarray]:
    """Entries of a proof over a cell, and the half-widths of its box.

    Raises:
        NoProof: there is none; the words say why.
    """
    start = _Search(loop, cell, bounds)
    best: tuple[np.ndarray, np.ndarray] | None = None
    for A in start.candidates():
        for _ in range(2):
            try:
                box = start.grown(A)
                if best is None or box[0] < best[1][0]:
                    best = (A, box)
                A = start.slopes(box * 0.7)
            except NoProof as error:
                start.why = start.why or str(error)
                break
    if best is None:
        raise NoProof(start.why or "no box was found that holds what its own remainders do")
    return start.entries(*best), best[1]


class _Search:
    """Search over one cell."""

    def __init__(self, loop: SampledLoop, cell: Cell, bounds: Bounds, stable: bool = True) -> None:
        self.loop, self.cell, self.bounds = loop, cell, bounds
        self.n, self.why = len(loop.states), ""
        self.B = np.zeros((self.n, len(loop.pushes)))
        self.push = np.array([float(w) for w in bounds.push])
        self.at_rest = self.slopes(np.zeros(self.n))
        radius = float(np.abs(np.linalg.eigvals(self.at_rest)).max())
        if radius >= 1 and stable:
            raise NoProof(f"at rest the loop is unstable: its spectral radius is {radius:.6g}")

    def slopes(self, box: np.ndarray) -> np.ndarray:
        """Middles of the slopes over a box; at rest those by the pushes are kept."""
        wide = [(-Fraction(z), Fraction(z)) for z in box.tolist()]
        pushed = [(-w, w) for w in self.bounds.push]
        states = [f"x_{s}" for s in self.loop.states]
        names = states + [f"d_{s}" for s in self.loop.pushes]
        try:
            given = input_enclosures(self.loop, self.cell, boxes, wide, pushed)
            found = slope_ranges(self.loop, given, names)
        except (DoesNotHold, ArithmeticError) as error:
            raise NoProof(str(error)) from None
        A = np.zeros((self.n, self.n))
        for (i, name), (low, high) in found.items():
            middle = float((low + high) / 2)
            if name in states:
                A[i, states.index(name)] = middle
            elif not box.any():
                self.B[i, names.index(name) - self.n] = middle
        return A

    def candidates(self) -> list[np.ndarray]:
        """Slopes with which to begin: those at rest, and those of boxes as large as is likely."""
        found = [self.at_rest]
        linear = self._gains(self.at_rest)[0] @ self.push
        for share in (0.5, 1.0):
            try:
                found.append(self.slopes(share * linear))
            except NoProof as error:
                self.why = self.why or str(error)
        return found

    def _ticks(self, A: np.ndarray) -> int:
        radius = float(np.abs(np.linalg.eigvals(A)).max())
        if radius >= 1 - 1e-5:
            raise NoProof(f"the nominal loop has the spectral radius {radius:.6g}")
        ticks = math.ceil(math.log(1e-9) / math.log(max(radius, 1e-3))) + 2 * self.n
        if ticks > MOST_TICKS:
            raise NoProof(f"the loop is too slow: sums of {ticks} ticks")
        return ticks

    def _gains(self, A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """sum_t |A^t B| by push, sum_t |A^t e_i| by row, and max_t |A^t e_i|."""
        ticks, n = self._ticks(A), self.n
        sources = np.hstack([self.B, np.eye(n)])
        sums, most, now = np.zeros_like(sources), np.zeros_like(sources), sources
        powers = powers_of(A, BLOCK + 1)
        flat, jump = powers[:-1].reshape(BLOCK * n, n), powers[-1]
        for _ in range(math.ceil(ticks / BLOCK)):
            part = np.abs(flat @ now).reshape(BLOCK, n, -1)
            sums += part.sum(axis=0)
            most = np.maximum(most, part.max(axis=0))
            now = jump @ now
        m = self.B.shape[1]
        return sums[:, :m], sums[:, m:], most[:, m:]

    def _middle(self, A: np.ndarray, m: np.ndarray) -> np.ndarray:
        """max_t |sum_(s < t) A^s m|."""
        total, now, most = np.zeros(self.n), m.copy(), np.zeros(self.n)
        powers = powers_of(A, BLOCK + 1)
        summed, jump = powers[:-1].cumsum(axis=0), powers[-1]
        for _ in range(math.ceil(min(self._ticks(A), 20_000) / BLOCK)):
            part = total + summed @ now
            most = np.maximum(most, np.abs(part).max(axis=0))
            total, now = part[-1], jump @ now
        return most

    def grown(self, A: np.ndarray) -> np.ndarray:
        """Half-widths of the box that a nominal loop leads to.

        Raises:
            NoProof: it does not come to rest.
        """
        by_push, by_row, most = self._gains(A)
        start = most @ np.array([float(s) for s in self.bounds.start])
        linear = by_push @ self.push + start
        box = linear * (1 + ROOM) + 1e-12
        bends = self._bends(box)
        for _ in range(80):
            added = self._added(A, box, bends)
            half = (added[:, 1] - added[:, 0]) / 2
            middle = self._middle(A, added.mean(axis=1))
            new = linear + by_row @ half + middle
            if not np.isfinite(new).all() or new[0] > 1e3 * linear[0] + 1e3:
                break
            if (new * (1 + 2e-5) <= box).all():
                return box
            box = np.maximum(box, new * (1 + ROOM))
        raise NoProof("what the ticks add grows faster than the box that holds it")

    def _added(
        self, A: np.ndarray, box: np.ndarray, bends: frozenset[tuple[int, int]]
    ) -> np.ndarray:
        """Ends of the remainders over a box, by row."""
        nominal = Nominal(self._rational(A), self._rational(self.B), bends)
        try:
            found = remainders(self.loop, self.cell, nominal, [Fraction(z) for z in box.tolist()],
                               self.bounds.push, boxes)  # fmt: skip
        except (DoesNotHold, ArithmeticError) as error:
            raise NoProof(str(error)) from None
        return np.array([[float(a), float(b)] for a, b in found])

    def _bends(self, box: np.ndarray) -> frozenset[tuple[int, int]]:
        """Entries whose slope varies so much over a box that their integral is taken in parts."""
        wide = [(-Fraction(z), Fraction(z)) for z in box.tolist()]
        pushed = [(-w, w) for w in self.bounds.push]
        names = [f"x_{s}" for s in self.loop.states]
        try:
            given = input_enclosures(self.loop, self.cell, boxes, wide, pushed)
            found = slope_ranges(self.loop, given, names)
        except (DoesNotHold, ArithmeticError) as error:
            raise NoProof(str(error)) from None
        bends = set()
        for (i, name), (low, high) in found.items():
            j = names.index(name)
            if float(high - low) * box[j] > 1e-6 * box[i]:
                bends.add((i, j))
        return frozenset(bends)

    @staticmethod
    def _rational(matrix: np.ndarray) -> dict[tuple[int, int], Fraction]:
        return {(int(i), int(j)): Fraction(float(matrix[i, j]))
                for i, j in zip(*np.nonzero(matrix), strict=True)}  # fmt: skip

    def linear_entries(self, A: np.ndarray, box: np.ndarray) -> dict[str, Any]:
        """What a file holds of the cell and of the linear loop, in units of about the box."""
        sizes, cell = [math.frexp(z)[1] for z in box], self.cell
        scale = np.exp2(sizes)
        return {
            "slow": [[str(a), str(b)] for a, b in cell.slow], "rest": [str(r) for r in cell.rest],
            "moves": [[str(m) for m in moves] for moves in cell.moves], "sizes": sizes,
            "A": _whole(A * scale / scale[:, None]), "B": _whole(self.B / scale[:, None]),
            "bends": sorted(map(list, self._bends(box))),
        }  # fmt: skip

    def entries(self, A: np.ndarray, box: np.ndarray) -> dict[str, Any]:
        """What a file holds of the proof."""
        scale = np.exp2([math.frexp(z)[1] for z in box])
        scaled = A * scale / scale[:, None]
        radius = float(np.abs(np.linalg.eigvals(scaled)).max())
        rho = 1 - (1 - radius) / 2
        P = np.eye(self.n)
        step = scaled / rho
        for _ in range(60):
            added = step.T @ P @ step
            P, step = P + added, step @ step
            if np.abs(added).max() < 1e-14 * np.abs(P).max():
                break
        P = (P + P.T) * (1 + 1e-6)
        return {
            **self.linear_entries(A, box), "box": [str(Fraction(z)) for z in box.tolist()],
            "P": [[str(round(P[i, j] * 2**20)) for j in range(i + 1)] for i in range(self.n)],
            "decay": str(Fraction(rho * rho)), "ticks": self._ticks(A),
        }  # fmt: skip


def powers_of(A: np.ndarray, many: int) -> np.ndarray:
    """A^0, A^1, ..., so many of them."""
    found = np.empty((many, *A.shape))
    found[0] = np.eye(len(A))
    for k in range(1, many):
        found[k] = A @ found[k - 1]
    return found


def _whole(matrix: np.ndarray) -> list[list[Any]]:
    """Entries over 2^60, [row, column, numerator]."""
    found = []
    for i, j in zip(*np.nonzero(matrix), strict=True):
        value = round(Fraction(float(matrix[i, j])) * 2**GRID)
        if value:
            found.append([int(i), int(j), str(value)])
    return found


# ---- check --------------------------------------------------------------------------------------

ENTRIES = ("slow", "rest", "moves", "sizes", "A", "B", "bends", "box", "P", "decay", "ticks")


def check_cell(loop: SampledLoop, bounds: Bounds, given: Any) -> tuple[Cell, list[Fraction]]:
    """Confirm the proof over one cell; gives the cell and the half-widths that are proved.

    Raises:
        DoesNotHold: it proves nothing.
    """
    entry = read_mapping(given, ENTRIES, "evidence.cells", True)
    n = len(loop.states)
    cell, unit, A, B, nominal = read_linear(loop, entry)
    box = [rational(z, "evidence.box") for z in rows(entry["box"], "evidence.box", n, n)]
    if min(box) < 0:
        raise DoesNotHold("evidence.box: a half-width is negative")
    decay = Decay(_read_P(entry["P"], n), rational(entry["decay"], "evidence.decay"))
    ticks = whole(entry["ticks"], "evidence.ticks", 1, MOST_TICKS)
    check_decay(A, decay)
    try:
        added = remainders(loop, cell, nominal, box, bounds.push, decimals)
    except ArithmeticError:
        raise DoesNotHold("evidence: nothing bounds a slope in its box") from None
    half = [(b - a) / 2 / u for (a, b), u in zip(added, unit, strict=True)]
    middles = [(a + b) / 2 / u for (a, b), u in zip(added, unit, strict=True)]
    large = [i for i in range(n) if half[i] + abs(middles[i]) > SMALL * box[i] / unit[i]]
    one = 1 << GRID
    small = [Fraction(0) if i in large else half[i] + abs(middles[i]) for i in range(n)]
    middle = {i: math.floor(middles[i] * one) for i in large}
    terms = [(response(A, {i: b for (i, k), b in B.items() if k == j}, ticks, decay), w)
             for j, w in enumerate(bounds.push) if w]  # fmt: skip
    terms += [(response(A, {i: one}, ticks, decay), half[i] + Fraction(1, one)) for i in large]
    begun = [(response(A, {i: one}, ticks, decay), s / unit[i])
             for i, s in enumerate(bounds.start) if s]  # fmt: skip
    mean = response(A, middle, ticks, decay) if any(middle.values()) else None
    found = peaks(terms, mean, begun, small, decay)
    if any(f * u > z for f, u, z in zip(found, unit, box, strict=True)):
        raise DoesNotHold("evidence: what the ticks add leaves the box")
    return cell, [f * u for f, u in zip(found, unit, strict=True)]


Entered = dict[tuple[int, int], int]
"""Entries of a matrix over 2^60, by row and column."""


def read_linear(
    loop: SampledLoop, entry: Mapping[str, Any]
) -> tuple[Cell, list[Fraction], Entered, Entered, Nominal]:
    """Cell of a file, unit of each state, A and B in these units, and the linear loop without.

    Raises:
        BadInput, DoesNotHold: they are none.
    """
    n, m = len(loop.states), len(loop.pushes)
    sizes = [whole(s, "evidence.sizes", -200, 200)
             for s in rows(entry["sizes"], "evidence.sizes", n, n)]  # fmt: skip
    unit = [Fraction(2) ** s for s in sizes]
    A, B = whole_entries(entry["A"], n, n), whole_entries(entry["B"], n, m)
    bends = rows(entry["bends"], "evidence.bends", n * (n + m))
    return _read_cell(loop, entry), unit, A, B, Nominal(
        {(i, j): Fraction(a, 2**GRID) * unit[i] / unit[j] for (i, j), a in A.items()},
        {(i, j): Fraction(b, 2**GRID) * unit[i] for (i, j), b in B.items()},
        frozenset(_pair(p, n, n + m) for p in bends),
    )  # fmt: skip


def _read_cell(loop: SampledLoop, entry: Mapping[str, Any]) -> Cell:
    n, q = len(loop.states), len(loop.slow)

    def numbers(given: Any, where: str, many: int) -> tuple[Fraction, ...]:
        return tuple(rational(x, where) for x in rows(given, where, many, many))

    ends = [numbers(e, "evidence.slow", 2) for e in rows(entry["slow"], "evidence.slow", q, q)]
    if any(a > b for a, b in ends):
        raise DoesNotHold("evidence.slow: a range is empty")
    moves = [numbers(e, "evidence.moves", n) for e in rows(entry["moves"], "evidence.moves", q, q)]
    return Cell(tuple((a, b) for a, b in ends), numbers(entry["rest"], "evidence.rest", n),
                tuple(moves))  # fmt: skip


def _pair(given: Any, n: int, m: int) -> tuple[int, int]:
    i, j = rows(given, "evidence.bends", 2, 2)
    return whole(i, "evidence.bends", 0, n - 1), whole(j, "evidence.bends", 0, m - 1)


def _read_P(given: Any, n: int) -> Sequence[Sequence[int]]:
    found = [[0] * n for _ in range(n)]
    for i, row in enumerate(rows(given, "evidence.P", n, n)):
        for j, text in enumerate(rows(row, "evidence.P", i + 1, i + 1)):
            value = rational(text, "evidence.P")
            if value.denominator != 1:
                raise DoesNotHold("evidence.P: its entries are whole numbers")
            found[i][j] = found[j][i] = int(value)
    return found
