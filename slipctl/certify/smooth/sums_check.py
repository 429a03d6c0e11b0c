"""Check of a proof by sums: what each tick can add, in whole numbers. No search, no float.

In scaled coordinates the loop is y+ = A y + B w + r with A, B whole multiples of 2^-60. Induction
over ticks: if y has stayed in the box [-Z, Z] until now, then w and r were in their ranges, and

    |y_k| <= sum_t |A^t B|_k W + max_t |sum_(s<t) A^s m|_k + sum_i sum_t |A^t e_i|_k h_i + start

with m the middles and h the half-widths of r. If that is at most Z, the box is never left. The sums
run over so many ticks with 160 bits behind the point. A matrix P >= 1 with A' P A <= decay P bounds
the rest of them and what rounding does. It also bounds what rows add that are too small for a sum
of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.entries import DoesNotHold

GRID = 60
"""Entries of A and B are whole multiples of 2^-60."""

BITS = 160
"""Bits behind the point of a sum."""

Whole = Mapping[tuple[int, int], int]
"""Entries of a matrix over 2^60, by row and column."""


@dataclass(frozen=True)
class Decay:
    """A matrix P >= 1 with A' P A <= decay P.

    Attributes:
        P: entries over 2^20, all of them. decay: share that is left of x' P x after a tick.
    """

    P: Sequence[Sequence[int]]
    decay: Fraction

    def size(self, vector: Sequence[Fraction]) -> Fraction:
        """No less than the root of x' P x."""
        n = range(len(vector))
        total = sum((vector[i] * self.P[i][j] * vector[j] for i in n for j in n), Fraction(0))
        return root_above(total / 2**20)

    def one(self, k: int) -> Fraction:
        """No less than the size of a unit vector."""
        return root_above(Fraction(self.P[k][k], 2**20))

    @property
    def sum(self) -> Fraction:
        """No less than 1 + rho + rho^2 + ..., rho the root of the decay."""
        rho = root_above(self.decay)
        if rho >= 1:
            raise DoesNotHold("decay: it is not below 1")
        return 1 / (1 - rho)


def root_above(value: Fraction) -> Fraction:
    """A rational no smaller than the square root."""
    scale = 2**120
    return Fraction(math.isqrt(math.ceil(value * scale * scale)) + 1, scale)


def check_decay(A: Whole, decay: Decay) -> None:
    """Confirm P >= 1 and A' P A <= decay P, by elimination in outward-rounded decimals.

    Raises:
        DoesNotHold: they are not shown.
    """
    n = len(decay.P)
    rows: list[list[tuple[int, int]]] = [[] for _ in range(n)]
    for (i, j), a in A.items():
        rows[i].append((j, a))
    PA = [[0] * n for _ in range(n)]
    for k in range(n):
        for i in range(n):
            p = decay.P[k][i]
            if p:
                for j, a in rows[i]:
                    PA[k][j] += p * a
    APA = [[0] * n for _ in range(n)]
    for k in range(n):
        for i, a in rows[k]:
            for j in range(n):
                APA[i][j] += a * PA[k][j]
    one = 2**20
    unit = [[Fraction(decay.P[i][j] - (one if i == j else 0), one) for j in range(n)]
            for i in range(n)]  # fmt: skip
    falls = [[decay.decay * Fraction(decay.P[i][j], one) - Fraction(APA[i][j], one * 4**GRID)
              for j in range(n)] for i in range(n)]  # fmt: skip
    for matrix, says in ((unit, "P is not above 1"), (falls, "P does not decay")):
        if not _positive(matrix):
            raise DoesNotHold(f"decay: {says}")


def _positive(matrix: Sequence[Sequence[Fraction]], digits: int = 80) -> bool:
    """Whether a symmetric matrix is positive definite: every pivot of the elimination is."""
    n = len(matrix)
    if any(matrix[i][j] != matrix[j][i] for i in range(n) for j in range(i)):
        return False
    m = [[Interval.of(matrix[i][j], digits) for j in range(n)] for i in range(n)]
    for k in range(n):
        if m[k][k].low <= 0:
            return False
        for i in range(k + 1, n):
            if m[k][i].low == 0 == m[k][i].high:
                continue
            share = m[k][i] / m[k][k]
            for j in range(i, n):
                m[i][j] = m[i][j] - share * m[k][j]
    return True


@dataclass(frozen=True)
class Response:
    """What a vector that enters once does to each state over all ticks.

    Attributes:
        sums: no less than sum_t |A^t b|. most: no less than max_t |A^t b|.
        steps: no less than max_t |sum_(s <= t) A^s b|.
    """

    sums: list[Fraction]
    most: list[Fraction]
    steps: list[Fraction]


def response(A: Whole, b: Mapping[int, int], ticks: int, decay: Decay) -> Response:
    """Response of the loop to a vector, in whole numbers; what comes after and rounding added.

    Args:
        A: the loop. b: the vector over 2^60, by state. ticks: how many. decay: bounds the rest.
    """
    n = len(decay.P)
    rows: list[list[tuple[int, int]]] = [[] for _ in range(n)]
    for (i, j), a in A.items():
        rows[i].append((j, a))
    v = [b.get(i, 0) << (BITS - GRID) for i in range(n)]
    one = 1 << GRID
    copies = [(i, rows[i][0][0]) for i in range(n) if len(rows[i]) == 1 and rows[i][0][1] == one]
    mixed = [(i, rows[i]) for i in range(n) if not (len(rows[i]) == 1 and rows[i][0][1] == one)]
    sums, most, total, steps = [0] * n, [0] * n, [0] * n, [0] * n
    states = range(n)
    for _ in range(ticks):
        for i in states:
            x = v[i]
            if x:
                total[i] += x
                if x < 0:
                    x = -x
                sums[i] += x
                if x > most[i]:
                    most[i] = x
                if abs(total[i]) > steps[i]:
                    steps[i] = abs(total[i])
        after = v[:]
        for i, j in copies:
            after[i] = v[j]
        for i, row in mixed:
            found = 0
            for j, a in row:
                found += a * v[j]
            after[i] = found >> GRID
        v = after
    scale = Fraction(1, 1 << BITS)
    end = decay.size([Fraction(x, 1 << BITS) for x in v]) * decay.sum
    wrong = sum((decay.one(i) for i, _ in mixed), Fraction(0)) * scale * decay.sum
    later = end + wrong * (decay.sum + ticks + 1) * 2  # of each state, because P >= 1
    return Response([x * scale + later for x in sums], [x * scale + later for x in most],
                    [x * scale + later for x in steps])  # fmt: skip


def peaks(
    responses: Sequence[tuple[Response, Fraction]], middle: Response | None,
    started: Sequence[tuple[Response, Fraction]], small: Sequence[Fraction], decay: Decay,
) -> list[Fraction]:  # fmt: skip
    """Bounds of all states: see the module text.

    Args:
        responses: of pushes and rows, with the largest value of each.
        middle: response to the middles of what rows add.
        started: of states that do not start at rest, with how far they may be off.
        small: by row what is added and has no response of its own.
        decay: bounds what the small ones do.
    """
    n = len(decay.P)
    rest = sum((s * decay.one(i) for i, s in enumerate(small) if s), Fraction(0)) * decay.sum
    found = [rest] * n
    for k in range(n):
        for r, size in responses:
            found[k] += r.sums[k] * size
        if middle is not None:
            found[k] += middle.steps[k]
        for r, size in started:
            found[k] += r.most[k] * size
    return found


def whole_entries(entries: Any, n: int, m: int) -> dict[tuple[int, int], int]:
    """Entries of a matrix of a file, [row, column, numerator over 2^60].

    Raises:
        DoesNotHold: they are none.
    """
    found: dict[tuple[int, int], int] = {}
    for entry in entries if isinstance(entries, list) else [None]:
        if not isinstance(entry, list) or len(entry) != 3:
            raise DoesNotHold("evidence: a matrix has entries [row, column, number]")
        i, j, text = entry
        good = type(i) is int and type(j) is int and isinstance(text, str) and len(text) < 60
        if not good or not (0 <= i < n and 0 <= j < m) or (i, j) in found:
            raise DoesNotHold("evidence: an entry of a matrix is out of place")
        try:
            found[i, j] = int(text)
        except ValueError:
            raise DoesNotHold("evidence: an entry of a matrix is no whole number") from None
    return found
