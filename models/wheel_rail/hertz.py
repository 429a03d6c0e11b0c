"""Patch of two elastic bodies pressed together: Hertz ellipse and Kalker's coefficient c11.

With the curvatures A (in rolling direction) and B (across) of the gap z = A x^2 + B y^2, the load Q
and the modulus 1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2. Johnson, Contact Mechanics, 1985,
section 4.2. Let c be the larger semi-axis, g <= 1 the ratio of the axes, m = 1 - g^2:

    B/A       = (E(m)/g^2 - K(m))/(K(m) - E(m))         (4.26), A the curvature along c
    c^3       = 3 Q E(m)/(2 pi g^2 E* (A + B))
    p_0       = 3 Q/(2 pi a b)

K and E are the complete elliptic integrals of parameter m. a is the semi-axis in rolling
direction, b the other one. Valid for smooth surfaces and a patch much smaller than both radii.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from slipctl import BadInput

E_STEEL = 210e9
"""Young's modulus of rail steel in Pa."""
NU_STEEL = 0.28
"""Poisson's ratio of rail steel."""

NU_OF_TABLE = (0.0, 0.25, 0.5)
_WIDE = (  # a < b: g = a/b = .1, .2, ... 1; columns nu = 0, .25, .5
    (2.51, 3.31, 4.85), (2.59, 3.37, 4.81), (2.68, 3.44, 4.80), (2.78, 3.53, 4.82),
    (2.88, 3.62, 4.83), (2.98, 3.72, 4.91), (3.09, 3.81, 4.97), (3.19, 3.91, 5.05),
    (3.29, 4.01, 5.12), (3.40, 4.12, 5.20),
)  # fmt: skip
_LONG = (  # a > b: g = b/a
    (10.7, 11.7, 12.9), (6.96, 7.78, 8.82), (5.57, 6.34, 7.34), (4.84, 5.57, 6.57),
    (4.37, 5.10, 6.11), (4.06, 4.78, 5.80), (3.82, 4.54, 5.58), (3.65, 4.36, 5.42),
    (3.51, 4.22, 5.30), (3.40, 4.12, 5.20),
)  # fmt: skip
TABLE_E3: dict[float, tuple[float, float, float]] = {
    k / 10: row for k, row in enumerate(_WIDE, 1)
} | {10 / k: row for k, row in reversed(list(enumerate(_LONG, 1)))}
"""c11 at nu = 0, .25, .5, by axis ratio a/b.

Kalker, Three-Dimensional Elastic Bodies in Rolling Contact, 1990, Table E.3.
"""


class Ellipse(NamedTuple):
    """Contact ellipse.

    Attributes:
        a, b: semi-axes in rolling direction and across in m.
        p_0: pressure in the middle in Pa.
        approach: how far the bodies approach each other in m.
    """

    a: float
    b: float
    p_0: float
    approach: float


def elliptic(m: float) -> tuple[float, float, float]:
    """Complete elliptic integrals K(m), E(m) and D(m) = (K - E)/m, 0 <= m < 1.

    By the arithmetic-geometric mean, to rounding; D has no cancellation at small m (Abramowitz and
    Stegun, 17.6.3, 17.6.4).
    """
    a, b = 1.0, math.sqrt(1.0 - m)
    c = m / (2 * (1 + b))
    total, weight = 0.5 + m / (4 * (1 + b) ** 2), 1.0
    a, b = (a + b) / 2, math.sqrt(b)
    while c > 1e-9:
        c = c * c / (4 * ((a + b) / 2))
        a, b = (a + b) / 2, math.sqrt(a * b)
        weight *= 2
        total += weight * c * c / m
    K = math.pi / (2 * a)
    return K, K * (1 - m * total), K * total


def ellipse(Q: float, A: float, B: float, E: float = E_STEEL, nu: float = NU_STEEL) -> Ellipse:
    """Contact ellipse of two bodies of one material.

    Args:
        Q: load in N.
        A, B: curvature of the gap z = A x^2 + B y^2 in rolling direction and across, in 1/m; of
            bodies with radii R, A = 1/(2 R_1x) + 1/(2 R_2x).
        E, nu: Young's modulus in Pa and Poisson's ratio.

    Raises:
        BadInput: something is not positive, or nu is not in [0, 0.5].
    """
    _check_material(E, nu)
    for name, value, unit in (("Q", Q, "N"), ("A", A, "1/m"), ("B", B, "1/m")):
        if not 0 < value < math.inf:
            raise BadInput(f"ellipse: {name} = {value:g} {unit} must be positive")
    g = _ratio_of(min(A, B) / max(A, B))
    return _ellipse(Q, A + B, g, A <= B, E, nu)


def ellipse_of_ratio(
    Q: float, A: float, ratio: float, E: float = E_STEEL, nu: float = NU_STEEL
) -> Ellipse:
    """Contact ellipse where the curvature A in rolling direction and the ratio a/b are given.

    Raises:
        BadInput: as :func:`ellipse`.
    """
    _check_material(E, nu)
    for name, value, unit in (("Q", Q, "N"), ("A", A, "1/m"), ("ratio", ratio, "1")):
        if not 0 < value < math.inf:
            raise BadInput(f"ellipse_of_ratio: {name} = {value:g} {unit} must be positive")
    g = min(ratio, 1 / ratio)
    curvatures = _curvatures(g)
    B = A * curvatures if ratio >= 1 else A / curvatures
    return _ellipse(Q, A + B, g, ratio >= 1, E, nu)


def c11(ratio: float, nu: float) -> float:
    """Kalker's coefficient c11 of an ellipse with axes a/b = ``ratio``; Table E.3.

    A cubic through the four nearest rows in ln(a/b) and ln(c11), and a parabola through the three
    columns in 1/c11, as CONTACT takes it (subroutine ``linrol``). The cubic through every other row
    misses the rows between by at most 0.04. At the table's own spacing that is 1/16 of it, less
    than half a unit of its second decimal (which it has below 10).

    Args:
        ratio: a/b, rolling to lateral semi-axis, in [0.1, 10].
        nu: Poisson's ratio, in [0, 0.5].

    Raises:
        BadInput: outside the table.
    """
    axes = list(TABLE_E3)
    if not axes[0] <= ratio <= axes[-1]:
        raise BadInput(
            f"c11: axis ratio a/b = {ratio:g} is outside Kalker's table;"
            f" it must lie in [{axes[0]:g}, {axes[-1]:g}]"
        )
    if not 0 <= nu <= 0.5:
        raise BadInput(f"c11: nu = {nu:g} is outside Kalker's table; it must lie in [0, 0.5]")
    above = next(k for k, r in enumerate(axes) if ratio <= r)
    rows = axes[(first := min(max(above - 2, 0), len(axes) - 4)) : first + 4]
    weights = _lagrange([math.log(r) for r in rows], math.log(ratio))
    columns = [
        math.exp(sum(w * math.log(TABLE_E3[r][k]) for w, r in zip(weights, rows, strict=True)))
        for k in range(3)
    ]
    return 1 / sum(w / c for w, c in zip(_lagrange(NU_OF_TABLE, nu), columns, strict=True))


def _check_material(E: float, nu: float) -> None:
    if not 0 < E < math.inf:
        raise BadInput(f"ellipse: E = {E:g} Pa must be positive")
    if not 0 <= nu <= 0.5:
        raise BadInput(f"ellipse: nu = {nu:g} must lie in [0, 0.5]")


def _lagrange(nodes: Sequence[float], x: float) -> list[float]:
    """Weights of the values at ``nodes`` in the polynomial through them, at x."""
    return [
        math.prod((x - other) / (node - other) for other in nodes if other != node)
        for node in nodes
    ]


def _curvatures(g: float) -> float:
    """Curvature along the smaller axis by that along the larger one, of an ellipse of ratio g.

    B/A = (E/g^2 - K)/(K - E) = (E - g^2 K)/(g^2 m D), and E - g^2 K = m (K - D).
    """
    K, _, D = elliptic(1 - g * g)
    return (K - D) / (g * g * D)


def _ratio_of(smaller_by_larger: float) -> float:
    """Ratio of the axes g, by bisection in ln g: the curvatures' ratio falls as g rises."""
    lo, hi = math.log(1e-8), 0.0
    while (middle := (lo + hi) / 2) not in (lo, hi):
        if _curvatures(math.exp(middle)) * smaller_by_larger > 1:
            lo = middle
        else:
            hi = middle
    return math.exp(hi)


def _ellipse(Q: float, curvature: float, g: float, long: bool, E: float, nu: float) -> Ellipse:
    """Ellipse of axis ratio g <= 1 under Q, where ``curvature`` is A + B."""
    K, integral, _ = elliptic(1 - g * g)
    modulus = E / (2 * (1 - nu * nu))
    c = (3 * Q * integral / (2 * math.pi * g * g * modulus * curvature)) ** (1 / 3)
    p_0 = 3 * Q / (2 * math.pi * g * c * c)
    a, b = (c, g * c) if long else (g * c, c)
    return Ellipse(a, b, p_0, p_0 * g * c * K / modulus)
