"""Mean and covariance through a function, by sigma points or by the exact Jacobian.

Both work on scalars, so that the unit of every entry of a covariance can be checked.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import casadi as ca

Vector = list[Any]
Matrix = list[list[Any]]
Function = Callable[[Vector], Vector]


class Through(NamedTuple):
    """What comes out of a function: its mean, covariance with the input, own covariance."""

    mean: Vector
    cross: Matrix
    own: Matrix


Moments = Callable[[Function, Vector, Matrix, Vector], Through]
"""(function, mean, covariance, floor) -> Through."""


def sigma_points(sigma: Any) -> Moments:
    """Sigma points x, x +- sqrt((N + sigma) P), weights sigma/(N + sigma), 1/(2 (N + sigma)).

    P = L D L' gives the root: column j is L_j sqrt(D_j). Of the extra weight 1 - alpha^2 + beta
    that the centre may get in a covariance, nothing is used. It has no effect where the function is
    linear, and Zhang 2021 gives no alpha.
    """

    def moments(g: Function, x: Vector, P: Matrix, floor: Vector) -> Through:
        n = len(x)
        columns = _scaled(_root(P, floor), ca.sqrt(n + sigma))
        centre, *pairs = [g(x), *((g(_add(x, c, 1)), g(_add(x, c, -1))) for c in columns)]
        w_0, w = sigma / (n + sigma), 1 / (2 * (n + sigma))
        m = range(len(centre))
        mean = [w_0 * centre[k] + _total(w * (up[k] + down[k]) for up, down in pairs) for k in m]
        cross = [
            [
                _total(w * c[i] * (up[k] - down[k])
                       for c, (up, down) in zip(columns, pairs, strict=True))
                for k in m
            ]
            for i in range(n)
        ]  # fmt: skip
        off = [_add(v, mean, -1) for pair in pairs for v in pair]
        middle = _add(centre, mean, -1)
        own = [
            [w_0 * middle[k] * middle[j] + _total(w * v[k] * v[j] for v in off) for j in m]
            for k in m
        ]
        return Through(mean, cross, own)

    return moments


def printed_22(sigma: Any, beta: Any) -> Moments:
    """Return (22)-(27) of Zhang 2021 as printed: spread sqrt(sigma P), weights of N = 3, alpha = 1.

    With one unknown there are three points, not seven. Their weights add up to 0.6, so the mean
    shrinks to 0.6 of itself in every prediction, and what is missing widens every covariance.
    """
    N = 3

    def moments(g: Function, x: Vector, P: Matrix, floor: Vector) -> Through:
        columns = _scaled(_root(P, floor), ca.sqrt(sigma))
        points = [x, *(_add(x, c, sign) for c in columns for sign in (1, -1))]
        values = [g(v) for v in points]
        w = [sigma / (N + sigma), *[1 / (2 * N + 2 * sigma)] * (len(points) - 1)]
        w_c = [w[0] + beta, *w[1:]]

        def centred(rows: Sequence[Vector]) -> tuple[Vector, list[Vector]]:
            mean = [
                _total(a * v[k] for a, v in zip(w, rows, strict=True)) for k in range(len(rows[0]))
            ]
            return mean, [_add(v, mean, -1) for v in rows]

        def product(a: list[Vector], b: list[Vector]) -> Matrix:
            return [
                [
                    _total(c * u[i] * v[k] for c, u, v in zip(w_c, a, b, strict=True))
                    for k in range(len(b[0]))
                ]
                for i in range(len(a[0]))
            ]

        _, dx = centred(points)
        mean, dy = centred(values)
        return Through(mean, product(dx, dy), product(dy, dy))

    return moments


def linear_moments(g: Function, x: Vector, P: Matrix, floor: Vector) -> Through:
    """First order: mean g(x), covariances P G' and G P G' with the exact Jacobian G."""
    n = len(x)
    make: Any = ca.MX if any(isinstance(v, ca.MX) for v in x) else ca.SX
    at = [make.sym(f"x{i}") for i in range(n)]
    values = [make(v) for v in g(at)]
    y = ca.vertcat(*values)
    G = ca.densify(ca.jacobian(y, ca.vertcat(*at)))
    entries = [*values, *(G[k, i] for k in range(len(values)) for i in range(n))]
    found: Any = ca.substitute(entries, at, [make(v) for v in x])
    m = range(len(values))
    slopes = [[found[len(values) + k * n + i] for i in range(n)] for k in m]
    cross = [[_total(P[i][j] * slopes[k][j] for j in range(n)) for k in m] for i in range(n)]
    own = [[_total(slopes[k][i] * cross[i][j] for i in range(n)) for j in m] for k in m]
    return Through(found[: len(values)], cross, own)


# ---- small matrices of scalars ------------------------------------------------------------------


def factors(A: Matrix, floor: Vector | None = None) -> tuple[Matrix, Vector]:
    """L and D of A = L D L', L with a unit diagonal; D not below the floor, if there is one."""
    n = len(A)
    L: Matrix = [[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)]
    D: Vector = []
    for j in range(n):
        d = A[j][j] - _total(L[j][k] * L[j][k] * D[k] for k in range(j))
        D.append(d if floor is None else ca.fmax(d, floor[j]))
        for i in range(j + 1, n):
            rest = A[i][j] - _total(L[i][k] * L[j][k] * D[k] for k in range(j))
            L[i][j] = rest / D[j]
    return L, D


def with_floor(P: Matrix, floor: Vector) -> Matrix:
    """P where each unknown, given those before it, has at least the variance ``floor``."""
    L, D = factors(P, floor)
    n = len(P)
    return [
        [_total(L[i][k] * L[j][k] * D[k] for k in range(min(i, j) + 1)) for j in range(n)]
        for i in range(n)
    ]


def solve(L: Matrix, D: Vector, b: Vector) -> Vector:
    """Solution of L D L' x = b."""
    x = [v / d for v, d in zip(forward(L, b), D, strict=True)]
    for i in reversed(range(len(x))):
        x[i] = x[i] - _total(L[k][i] * x[k] for k in range(i + 1, len(x)))
    return x


def forward(L: Matrix, b: Vector) -> Vector:
    """Solution of L x = b."""
    x: Vector = []
    for i, v in enumerate(b):
        x.append(v - _total(L[i][k] * x[k] for k in range(i)))
    return x


def _root(P: Matrix, floor: Vector) -> list[Vector]:
    """Columns of a root of P."""
    L, D = factors(P, floor)
    return [[L[i][j] * ca.sqrt(D[j]) for i in range(len(P))] for j in range(len(P))]


def _scaled(columns: list[Vector], factor: Any) -> list[Vector]:
    return [[factor * v for v in c] for c in columns]


def _add(a: Vector, b: Vector, sign: int) -> Vector:
    return [u + v if sign > 0 else u - v for u, v in zip(a, b, strict=True)]


def _total(terms: Any) -> Any:
    """Sum without a leading zero, which would have no unit."""
    result: Any = None
    for t in terms:
        result = t if result is None else result + t
    return 0.0 if result is None else result
