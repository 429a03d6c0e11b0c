"""Bounds of the robust adhesion observer of Wang 2025, Theorem 1.

    e1' = e2 - K1 Phi1(e1),  e2' = -K2 Phi2(e1) - f',  |f'| < L
    Phi1 = |e|^(1/2) sgn e + K3 |e|^(3/2) sgn e,  Phi2 = Phi1 Phi1'

Near e1 = 0 this is the super-twisting law with gains K1 and K2/2, and |f'|/Phi1' <= 2 L |Phi1| with
equality at e1 = 0 only: K3 neither helps nor hurts L. So each bound is one of
``super_twisting`` at (K1, K2/2, L). K1 in rad^.5/s^1.5, K2 and L in rad/s^3.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.bisection import bisect
from slipctl.models.super_twisting.certificate import super_twisting as sta


def exact(K1: float, K2: float, L: float) -> bool:
    """Necessary and sufficient: the error vanishes in finite time for every |f'| <= L, any K3 >= 0.

    K2 > 2 L and q(K1, K2/2, L) < 1 with the ``worst_ratio`` q of the super-twisting law.
    """
    return sta.exact(K1, K2 / 2, L)


def h_infinity(K1: float, K2: float, L: float) -> bool:
    """Sufficient, what the proof of Theorem 1 needs: the peak gain of 2 L/(s^2 + K1 s + K2) < 1.

    (K1^2 >= 2 K2 and K2 > 2 L) or (K1^2 < 2 K2 and K1^2 (4 K2 - K1^2) > 16 L^2).

    Proof note: the gain peaks at w = 0 with 2 L/K2 for K1^2 >= 2 K2, else at w^2 = K2 - K1^2/2 with
    2 L/(K1 sqrt(K2 - K1^2/4)).
    """
    return bool(sta.quadratic(K1, K2 / 2, L))


def root_form(K1: float, K2: float, L: float) -> bool:
    """Theorem 1 with the root that our text of it lost: K1 > sqrt(2 K2) and K2 > 2 L."""
    return K1 * K1 > 2 * K2 and K2 > 2 * L


def printed_verdict(K1: float, K2: float, L: float) -> bool:
    """Theorem 1 as printed: K1 > 2 K2 and K2 > 2 L; its verdict depends on the unit."""
    return K1 > 2 * K2 and K2 > 2 * L


def peak_gain(K1: float, K2: float, L: float) -> float:
    """Peak over all frequencies of |2 L/((jw)^2 + K1 jw + K2)|; see ``h_infinity``."""
    if K1 * K1 >= 2 * K2:
        return 2 * L / K2
    return 2 * L / (K1 * math.sqrt(K2 - K1 * K1 / 4))


def largest_slope(K1: float, K2: float) -> float:
    """Largest L in rad/s^3 that the gains hold by the exact criterion."""
    if exact(K1, K2, K2 / 2 * (1 - 1e-12)):
        return K2 / 2
    return bisect(lambda L: sta.log_ratio(K1, K2 / 2, L), 0.0, 0.0, K2 / 2)


def smallest_K1(K2: float, L: float) -> float:
    """Smallest K1 by the exact criterion; infinite unless K2 > 2 L."""
    if K2 <= 2 * L:
        return math.inf
    top = 2 * math.sqrt(K2)  # above 1.1462 sqrt(K2/2), which holds for every L < K2/2
    return bisect(lambda K: sta.log_ratio(K, K2 / 2, L), 0.0, 1e-9 * top, top)


def convergence_time(
    K1: float, K2: float, L: float, e1: float, e2: float, K3: float = 0.0
) -> float:
    """Bound in s of the time to e1 = e2 = 0: 4 sqrt((P^-1)_11 V(0))/mu; inf without proof.

    V = zeta' P zeta, zeta = (Phi1(e1), e2), Q = -(A'P + PA + 4 L^2 C'C + PBB'P), mu the smallest
    eigenvalue of P^-1 Q.

    Proof note: V' <= -Phi1' zeta'Q zeta <= -mu V/(2 |e1|^(1/2)), and |e1|^(1/2) <= |Phi1| <=
    sqrt((P^-1)_11 V). P is twice the matrix of the super-twisting law (``quadratic_matrix``),
    because A is twice its A and K2 twice its k2. What K3 adds far from zero is ignored.

    Args:
        K1, K2, K3: gains. L: bound of |f'|. e1: error of the wheel speed in rad/s. e2: of f in
            rad/s^2.
    """
    if not h_infinity(K1, K2, L):
        return math.inf
    P, Q = _matrices(K1, K2, L)
    (p, m, q), (a, b, c) = P, Q
    det = p * q - m * m
    if not det > 0:
        return math.inf  # too near to the edge for doubles
    half, product = (q * a - 2 * m * b + p * c) / (2 * det), (a * c - b * b) / det
    mu = product / (half + math.sqrt(max(half * half - product, 0.0)))
    return 4 * math.sqrt(q / det * _energy(P, e1, e2, K3)) / mu if mu > 0 else math.inf


def convergence_time_printed(
    K1: float, K2: float, L: float, e1: float, e2: float, K3: float = 0.0
) -> float:
    """Bound in s as the proof of Theorem 1 has it, 4 sqrt(lambda_max V(0))/eps; inf without proof.

    lambda_max is that of P, eps the smallest eigenvalue of Q. Both add rad to rad/s^2, so the
    number depends on the unit of time; ``convergence_time`` does not, from the same P.

    Args:
        K1, K2, K3, L, e1, e2: as of ``convergence_time``.
    """
    if not h_infinity(K1, K2, L):
        return math.inf
    P, (a, b, c) = _matrices(K1, K2, L)
    eps = -_largest(-a, -b, -c)
    return 4 * math.sqrt(_largest(*P) * _energy(P, e1, e2, K3)) / eps if eps > 0 else math.inf


Symmetric = tuple[float, float, float]


def _matrices(K1: float, K2: float, L: float) -> tuple[Symmetric, Symmetric]:
    """P and Q of V' <= -Phi1' zeta'Q zeta, each as (11, 12, 22)."""
    k2 = K2 / 2
    p, m, q = (2 * x for x in sta.quadratic_matrix(K1, k2, L, math.sqrt(k2 * k2 - L * L)))
    M11 = -2 * (K1 * p + K2 * m) + 4 * L * L + m * m
    return (p, m, q), (-M11, -(p - K1 * m - K2 * q + m * q), -(2 * m + q * q))


def _energy(P: Symmetric, e1: float, e2: float, K3: float) -> float:
    phi = math.copysign(math.sqrt(abs(e1)) + K3 * abs(e1) ** 1.5, e1)
    return P[0] * phi * phi + 2 * P[1] * phi * e2 + P[2] * e2 * e2


def _largest(a: float, b: float, c: float) -> float:
    """Larger eigenvalue of [[a, b], [b, c]]."""
    return (a + c) / 2 + math.hypot((a - c) / 2, b)


def implicit_error(L: float, T: float) -> float:
    """Largest |z2 - f| in rad/s^2 while the implicit form slides, noise-free: L T/2.

    Proof note: while e1 = 0 at each tick, z2 is the mean of f over the last tick, and f moves by at
    most L s over a time s. No observer that sees samples only does better than O(T): f = L t and
    f = 0 with its mean taken off agree at the ticks up to O(T^2) in w.
    """
    return L * T / 2


def lyapunov(
    e: Any, z: Any, d: Any, K1: float, K2: float, K3: float, P: tuple[float, float, float]
) -> tuple[Any, Any]:
    """V and V', V = zeta' P zeta, zeta = (Phi1(e), z); Wang 2025, proof of Theorem 1.

    Args:
        e, z: error of the speed, and of f. d: f'. K1, K2, K3: gains. P: (P11, P12, P22).
    """
    root = np.sqrt(np.abs(e))
    phi1 = (root + K3 * root**3) * np.sign(e)
    slope = 1 / (2 * root) + 1.5 * K3 * root
    p, r, q = P
    rate1 = slope * (z - K1 * phi1)
    rate2 = -K2 * phi1 * slope + d
    V = p * phi1 * phi1 + 2 * r * phi1 * z + q * z * z
    return V, 2 * (p * phi1 + r * z) * rate1 + 2 * (r * phi1 + q * z) * rate2
