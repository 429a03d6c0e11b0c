"""Bounds of the super-twisting law.

x1' = -k1 |x1|^(1/2) sgn x1 + x2, x2' = -k2 sgn x1 + d, |d| <= L. Gains in SI: k1 in m^.5/s^1.5,
k2 and L in m/s^3. Scaling x1 leaves only k1/sqrt(L) and k2/L; a criterion that is no function of
these two changes its verdict with the unit of length.
"""

from __future__ import annotations

import math


def worst_ratio(k1: float, k2: float, L: float) -> float:
    """Worst case q of |x2| from one crossing of x1 = 0 to the next; stable if and only if q < 1.

    Proof note: with y = |x1|^(1/2) and ds = dt/(2y) each half plane is linear; the outermost
    trajectory takes d = +L while |x1| grows and d = -L while it falls, one switch per half plane,
    and both arcs are solved in closed form:
    ln q = ln(b/a)/2 - z1 G(z1) - z2 (pi - acos z2)/sqrt(1 - z2^2), a = k2 - L, b = k2 + L,
    z1 = k1/(2 sqrt(2 a)), z2 = k1/(2 sqrt(2 b)); q = 0 when z2 >= 1 (no overshoot).

    Args:
        k1, k2: gains. L: bound of the disturbance's slope. L >= k2 or k1 <= 0 gives infinity.
    """
    if k2 <= L or k1 <= 0:
        return math.inf
    a, b = k2 - L, k2 + L
    z1, z2 = k1 / (2 * math.sqrt(2 * a)), k1 / (2 * math.sqrt(2 * b))
    if z2 >= 1:
        return 0.0
    if z1 < 1:
        G = math.acos(z1) / math.sqrt(1 - z1**2)
    elif z1 == 1:
        G = 1.0
    else:
        G = math.acosh(z1) / math.sqrt(z1**2 - 1)
    ln_q = 0.5 * math.log(b / a) - z1 * G - z2 * (math.pi - math.acos(z2)) / math.sqrt(1 - z2**2)
    return math.exp(ln_q)


def exact(k1: float, k2: float, L: float) -> bool:
    """Necessary and sufficient: finite-time stable for every |d| <= L."""
    return worst_ratio(k1, k2, L) < 1


def quadratic(k1: float, k2: float, L: float) -> bool:
    """Some V = zeta' P zeta with zeta = (|x1|^.5 sgn x1, x2) proves it.

    Proof note: bounded-real lemma, ||1/(2 s^2 + k1 s + k2)||_inf < 1/L, with a lossless
    S-procedure; so "no" means only that no quadratic function does.
    """
    if k1 <= 0 or k2 <= 0:
        return False
    if k1**2 >= 4 * k2:
        return k2 > L
    return k1**2 * (8 * k2 - k1**2) > 16 * L**2


def printed_48(k1: float, k2: float, L: float) -> bool:
    """Condition (48) of Huang 2020 as printed: sufficient, but its verdict depends on the unit.

    k1 > 2 and k2 > (k1^3 + L^2 (4 k1 - 8)) / (k1 (4 k1 - 8)): Young's inequality with weight 1.
    """
    return k1 > 2 and k2 > (k1**3 + L**2 * (4 * k1 - 8)) / (k1 * (4 * k1 - 8))


def homogenised_48(k1: float, k2: float, L: float) -> bool:
    """Same Lyapunov matrix as (48) with the best weight: k2 > L + 2 L^2/k1^2; unit-free."""
    return k1 > 0 and k2 > L + 2 * L**2 / k1**2


def smallest_k2_printed(k1: float, L: float = 0.0) -> float:
    """Smallest k2 that (48) as printed accepts; infinite for k1 <= 2."""
    return math.inf if k1 <= 2 else k1**2 / (4 * k1 - 8) + L**2 / k1


def explicit_amplitude(k1: float, k2: float, T: float) -> float:
    """Half-swing of x1 in m/s of the period-2 orbit of explicit Euler with step T in s.

    x1 = T^2 ((k1 + sqrt(k1^2 - 4 k2))/4)^2, which exists for k1^2 >= 4 k2; about (k1 T/2)^2.
    Below that the largest swing is of the same order T^2 and has no closed form; the value at
    k1^2 = 4 k2 is returned.
    """
    return T**2 * ((k1 + math.sqrt(max(k1**2 - 4 * k2, 0.0))) / 4) ** 2


def proper_implicit_amplitude(L: float, T: float) -> float:
    """Largest |x1| in m/s while sliding, of the proper implicit form: L T^2."""
    return L * T**2
