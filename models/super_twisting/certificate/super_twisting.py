"""Bounds of the super-twisting law.

x1' = -k1 |x1|^(1/2) sgn x1 + x2 + r1, x2' = -k2 sgn x1 + d, |r1| <= delta |x1|^(1/2), |d| <= L.
Gains in SI: k1 and delta in m^.5/s^1.5, k2 and L in m/s^3. Scaling x1 leaves only k1/sqrt(L),
k2/L and delta/sqrt(L); a criterion that is no function of these changes its verdict with the unit
of length.

``exact`` is necessary and sufficient. The others are sufficient, and are inequalities that take
arrays too. None of them knows r1: with delta, give k1 - delta (see ``log_ratio``).
"""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Interval, arctan_over

DIGITS = 30
"""Digits of the enclosure that is given."""

UNITS = {"k1": "m^.5/s^1.5", "k2": "m/s^3", "L": "m/s^3", "delta": "m^.5/s^1.5"}
"""Unit of each number."""


def log_ratio(k1: float, k2: float, L: float, delta: float = 0.0) -> float:
    """Logarithm of ``worst_ratio``; -inf without overshoot, inf when k2 <= L or k1 <= delta.

    Proof note: with y = |x1|^(1/2) and ds = dt/(2y) each half plane is linear: y_s = -(k1 - r) y +
    x2, x2_s = -2 (k2 - d) y. The velocities at a point fill a rectangle. Its outermost corner has
    r1 = +delta y always, so k = k1 - delta replaces k1. d = +L while |x1| can grow and d = -L while
    it cannot, one switch per half plane. Both arcs of y_ss + k y_s + 2 c y = 0 (c = a, then b) are
    solved in closed form:

        ln q = ln(b/a)/2 - z1 G(z1) - z2 (pi - acos z2)/sqrt(1 - z2^2)
        a = k2 - L, b = k2 + L, z1 = k/(2 sqrt(2 a)), z2 = k/(2 sqrt(2 b))
        G(z) = acos z/sqrt(1 - z^2), continued through z = 1 by acosh

    For z2 >= 1 the second arc ends in the origin.

    Args:
        k1, k2: gains. L: bound of the disturbance's slope. delta: bound of |r1| over |x1|^(1/2).
    """
    k = k1 - delta
    if k2 <= L or k <= 0:
        return math.inf
    a, b = k2 - L, k2 + L
    z1, z2 = k / (2 * math.sqrt(2 * a)), k / (2 * math.sqrt(2 * b))
    if z2 >= 1:
        return -math.inf
    back = (math.pi - math.acos(z2)) / math.sqrt((1 - z2) * (1 + z2))
    return 0.5 * math.log(b / a) - z1 * _G(z1) - z2 * back


def _G(z: float) -> float:
    """Give acos z/sqrt(1 - z^2), written so that nothing cancels near z = 1."""
    if z > 2:
        return math.acosh(z) / math.sqrt((z - 1) * (z + 1))
    u = (1 - z) / (1 + z)
    if u == 0:
        return 1.0
    t = math.sqrt(abs(u))
    return 2 / (1 + z) * (math.atan(t) if u > 0 else math.atanh(t)) / t


def enclosed_log_ratio(
    k1: Fraction, k2: Fraction, L: Fraction, delta: Fraction, digits: int
) -> Interval:
    """Enclose ``super_twisting.log_ratio`` for k2 > L, k1 > delta, (k1 - delta)^2 < 8 (k2 + L).

    Proof note: with u = (1 - z)/(1 + z), acos z/sqrt(1 - z^2) = 2/(1 + z) A(u) on both sides of
    z = 1, and (pi - acos z)/sqrt(1 - z^2) = 2/(1 - z) A(1/u). z^2 is rational, and 1 - z is taken
    as (1 - z^2)/(1 + z).
    """
    k, a, b = k1 - delta, k2 - L, k2 + L
    square_1, square_2 = k * k / (8 * a), k * k / (8 * b)
    z1, z2 = Interval.of(square_1, digits).sqrt(), Interval.of(square_2, digits).sqrt()
    w1, w2 = Interval.of(1 - square_1, digits), Interval.of(1 - square_2, digits)
    out = z1 * 2 / (z1 + 1) * arctan_over(w1 / (z1 + 1) / (z1 + 1))
    back = z2 * 2 * (z2 + 1) / w2 * arctan_over((z2 + 1) * (z2 + 1) / w2)
    return Interval.of(b / a, digits).ln() / 2 - out - back


@lru_cache(maxsize=64)  # a report, its file and the check of that ask for the same gains
def enclosure_of_log_ratio(
    k1: Fraction, k2: Fraction, L: Fraction, delta: Fraction = Fraction(0)
) -> tuple[Decimal, Decimal] | None:
    """Enclosure of ln q, 30 digits, that tells its sign; None when 240 digits cannot tell it."""
    for digits in (60, 120, 240):
        found = enclosed_log_ratio(k1, k2, L, delta, digits)
        if found.low > 0 or found.high < 0:
            down = Context(prec=DIGITS, rounding=ROUND_FLOOR)
            up = Context(prec=DIGITS, rounding=ROUND_CEILING)
            return down.plus(found.low), up.plus(found.high)
    return None


def worst_ratio(k1: float, k2: float, L: float, delta: float = 0.0) -> float:
    """Worst case q of |x2| from one crossing of x1 = 0 to the next; stable if and only if q < 1.

    Proof note: see ``log_ratio``; q < 1 makes the half turns, each at most (1 + q) |x2|/(k2 - L)
    long, a convergent series. q >= 1 is an admissible disturbance that never settles.

    Args:
        k1, k2: gains. L: bound of the disturbance's slope. L >= k2 or k1 <= delta gives infinity.
        delta: bound of |r1| over |x1|^(1/2).
    """
    ln_q = log_ratio(k1, k2, L, delta)
    return math.exp(ln_q) if ln_q < 700 else math.inf


def exact(k1: float, k2: float, L: float, delta: float = 0.0) -> bool:
    """Necessary and sufficient: finite-time stable for every |d| <= L, |r1| <= delta |x1|^(1/2).

    Equivalent to the criterion announced by Seeber and Horn (VSS 2018); derived here.
    """
    return log_ratio(k1, k2, L, delta) < 0


def quadratic(k1: Any, k2: Any, L: Any) -> Any:
    """Some V = zeta' P zeta with zeta = (|x1|^.5 sgn x1, x2) proves it.

    (k1^2 >= 4 k2 and k2 > L) or (k1^2 < 4 k2 and k1^2 (8 k2 - k1^2) > 16 L^2).

    Proof note: M = A'P + PA + L^2 C'C + P B B' P < 0 with A = [[-k1/2, 1/2], [-k2, 0]]. Write m for
    -P12 and p for P22. M22 < 0 is p^2 < m; with the best P11, det M > 0 is (k1 p - k2 - m)^2 <
    k2^2 - L^2. The best m is k1^2/4. The S-procedure is lossless for one quadratic constraint, so
    "no" means that no quadratic function proves it, not that the gains are unstable.
    """
    near = (k1**2 >= 4 * k2) & (k2 > L)
    far = (k1**2 < 4 * k2) & (k1**2 * (8 * k2 - k1**2) > 16 * L**2)
    return (k1 > 0) & (k2 > 0) & (near | far)


def quadratic_matrix(k1: Any, k2: Any, L: Any, root: Any) -> tuple[Any, Any, Any]:
    """Matrix (P11, P12, P22) of a V = zeta' P zeta that proves ``quadratic``, multiplier 1.

    Proof note: see ``quadratic``: m = k1^2/4, p amid what is allowed, P11 where det M is largest.
    Rational for rational arguments.

    Args:
        k1, k2: gains. L: bound of the disturbance's slope.
        root: a number at most sqrt(k2^2 - L^2) and near it.
    """
    m = k1**2 / 4
    low, high = (k2 + m - root) / k1, (k2 + m + root) / k1
    p = (low + min(high, k1 / 2)) / 2
    return 2 * (k2 + m) * p - k1 * m + 2 * k1 * (m - p * p), -m, p


def seeber_horn(k1: Any, k2: Any, L: Any) -> Any:
    """After Seeber and Horn (Automatica 84, 2017): k2 > L and k1 > sqrt(k2 + L).

    Proof note: k1/sqrt(L) > sqrt 2 there, and every k1 >= 1.1462 sqrt(L) with k2 > L is exact's.
    """
    return (k1 > 0) & (k2 > L) & (k1**2 > k2 + L)


def levant(k1: Any, k2: Any, L: Any) -> Any:
    """After Levant (1993, 1998): k2 > L and k1^2 >= 4 L (k2 + L)/(k2 - L).

    Proof note: k1/sqrt(L) > 2 there, and every k1 >= 1.1462 sqrt(L) with k2 > L is exact's.
    """
    return (k1 > 0) & (k2 > L) & (k1**2 * (k2 - L) >= 4 * L * (k2 + L))


def polyakov_poznyak(k1: Any, k2: Any, L: Any) -> Any:
    """After Polyakov and Poznyak (2009): k2 > 5 L and 32 L < k1^2 < 8 (k2 - L).

    Proof note: k1/sqrt(L) > 5.6 there, and every k1 >= 1.1462 sqrt(L) with k2 > L is exact's.
    """
    return (k1 > 0) & (k2 > 5 * L) & (k1**2 > 32 * L) & (k1**2 < 8 * (k2 - L))


def no_overshoot(k1: Any, k2: Any, L: Any) -> Any:
    """x1 never changes its sign: k2 > L and k1^2 >= 8 (k2 + L).

    Proof note: y_ss + k1 y_s + 2 (k2 + L) y = 0 then has real modes, so y = 0 is not crossed.
    """
    return (k1 > 0) & (k2 > L) & (k1**2 >= 8 * (k2 + L))


def printed_48(k1: Any, k2: Any, L: Any) -> Any:
    """Condition (48) of Huang 2020 as printed: sufficient, but its verdict depends on the unit.

    k1 > 2 and k2 > (k1^3 + L^2 (4 k1 - 8)) / (k1 (4 k1 - 8)).

    Proof note: the matrix (46), after Moreno and Osorio, and Young's inequality with the fixed
    weight 1.
    """
    return (k1 > 2) & (k2 * k1 * (4 * k1 - 8) > k1**3 + L**2 * (4 * k1 - 8))


def homogenised_48(k1: Any, k2: Any, L: Any) -> Any:
    """Same Lyapunov matrix as (48) with the best weight: k2 > L + 2 L^2/k1^2; unit-free.

    Proof note: weight w gives k2 > w L^2/k1 + k1^2/(4 (w k1 - 2)), least at w k1 = 2 +
    k1^2/(2 L). The matrix (after Moreno and Osorio) is P = [[4 k2 + k1^2, -k1], [-k1, 2]]/2.
    """
    return (k1 > 0) & ((k2 - L) * k1**2 > 2 * L**2)


def drift(k1: Any, k2: Any, delta: Any) -> Any:
    """Matrix (46), after Moreno and Osorio, against r1 alone (d = 0).

    k1 > 2 delta and k2 > k1 delta^2/(8 (k1 - 2 delta)); the exact bound is k1 > delta, k2 > 0.

    Proof note: V' is linear in r1, so both ends r1 = +-delta |x1|^(1/2) decide, each by the
    determinant of a 2 x 2 matrix.
    """
    return (k1 > 2 * delta) & (8 * k2 * (k1 - 2 * delta) > k1 * delta**2)


def regions(k1: Any, k2: Any, L: float, delta: float = 0.0) -> dict[str, Any]:
    """Every criterion over arrays of gains: name -> array of bool; for maps.

    Args:
        k1, k2: arrays that broadcast. L: bound of the disturbance's slope.
        delta: bound of |r1| over |x1|^(1/2); each criterion is asked at k1 - delta.
    """
    import numpy as np

    k, c = np.broadcast_arrays(np.asarray(k1, float) - delta, np.asarray(k2, float))
    found = {name: test(k, c, L) for name, test in SUFFICIENT.items()}
    inside = (c > L) & (k > 0)
    found["exact"] = inside & (k * k >= 8 * (c + L))
    at = inside & ~found["exact"]
    v, a, b = k[at], c[at] - L, c[at] + L
    z1, z2 = v / np.sqrt(8 * a), np.minimum(v / np.sqrt(8 * b), 1 - 1e-16)
    u = (1 - z1) / (1 + z1)
    t = np.sqrt(np.abs(u))
    with np.errstate(divide="ignore", invalid="ignore"):
        G = 2 / (1 + z1) * np.where(u > 0, np.arctan(t), np.arctanh(t)) / t
        large = np.arccosh(z1) / np.sqrt((z1 - 1) * (z1 + 1))
    G = np.where(z1 > 2, large, np.where(u == 0, 1.0, G))
    back = (np.pi - np.arccos(z2)) / np.sqrt((1 - z2) * (1 + z2))
    found["exact"][at] = 0.5 * np.log(b / a) - z1 * G - z2 * back < 0
    return found


# ---- time and amplitude -------------------------------------------------------------------------


def reaching_time(k1: float, k2: float, v0: float) -> float:
    """Time in s from x1 = 0, x2 = v0 to the origin without disturbance; exact.

    Proof note: x2' = -k2 sgn x1, so a half turn from v to -q v takes (1 + q) v/k2, with q of L = 0.
    The sum is v0 (1 + q)/((1 - q) k2).
    """
    q = worst_ratio(k1, k2, 0.0)
    return abs(v0) * (1 + q) / ((1 - q) * k2) if q < 1 else math.inf


def reaching_time_bounds(
    k1: float, k2: float, L: float, v0: float, delta: float = 0.0
) -> tuple[float, float]:
    """Bounds in s of the longest time from x1 = 0, x2 = v0 to the origin over all disturbances.

    v0/(k2 - L) <= T <= v0 (1 + q)/((1 - q) (k2 - L)); equal when x1 does not overshoot.

    Proof note: below: d = +L lets x2 need v0/(k2 - L) to reach 0. Above: in a half turn |x2'| >=
    k2 - L and x2 moves at most (1 + q) v; the half turns are a geometric series.
    """
    q = worst_ratio(k1, k2, L, delta)
    if q >= 1:
        return math.inf, math.inf
    least = abs(v0) / (k2 - L)
    return least, least * (1 + q) / (1 - q)


def half_turn(
    k1: float, k2: float, L: float, delta: float = 0.0, v: float = 1.0
) -> tuple[float, float, float]:
    """Worst half turn from x1 = 0, x2 = v: time of its switch, time of its end, largest |x1|.

    Proof note: the first arc peaks at y = v/sqrt(2 a) exp(-z1 G(z1)), where x2 = k y; x2 falls with
    a before and with b after.

    Args:
        k1, k2: gains. L: bound of the disturbance's slope; k2 > L. delta: bound of |r1| over
            |x1|^(1/2); k1 > delta. v: x2 at the start.
    """
    k, a, b = k1 - delta, k2 - L, k2 + L
    z1 = k / (2 * math.sqrt(2 * a))
    y = v / math.sqrt(2 * a) * math.exp(-z1 * _G(z1))
    first = (v - k * y) / a
    return first, first + (k * y + worst_ratio(k1, k2, L, delta) * v) / b, y * y


def worst_disturbance(
    x1: float, x2: float, k1: float, L: float, delta: float = 0.0
) -> tuple[float, float]:
    """Worst disturbance (r1, d) at a point: outwards, d switching where x1' = 0."""
    side = math.copysign(1.0, x1 if x1 else x2)
    y = math.sqrt(abs(x1))
    return delta * y * side, L * side if side * x2 > (k1 - delta) * y else -L * side


def smallest_k2_printed(k1: float, L: float = 0.0) -> float:
    """Smallest k2 that (48) as printed accepts; infinite for k1 <= 2."""
    return math.inf if k1 <= 2 else k1**2 / (4 * k1 - 8) + L**2 / k1


def explicit_amplitude(k1: float, k2: float, T: float) -> float:
    """Half-swing of x1 in m/s of the period-2 orbit of explicit Euler with step T in s.

    x1 = T^2 ((k1 + sqrt(k1^2 - 4 k2))/4)^2, which exists for k1^2 >= 4 k2; about (k1 T/2)^2.
    Below that there is no such orbit, and (k1 T/4)^2 is returned, which is the swing of nothing.
    Other runs swing further in both cases, by the same order T^2; see ``explicit_swing_map``.
    """
    return T**2 * ((k1 + math.sqrt(max(k1**2 - 4 * k2, 0.0))) / 4) ** 2


def explicit_swing_map(k1: Any, k2: Any, L: float, T: float, ticks: int = 150) -> Any:
    """Largest |x1| in m/s of runs of explicit Euler against disturbances, over arrays of gains.

    Runs from a small start against d = L outward while x1' is, then inward; against d that
    alternates every 2, 4 or 9 ticks; and the orbit of ``explicit_amplitude``. The worst run swings
    further, near the boundary of stability several times as far: ``slipctl certify
    super_twisting`` with T gives the bound.

    Args:
        k1, k2: arrays that broadcast. L: bound of the disturbance's slope. T: sample period in s.
        ticks: length of the runs.
    """
    import numpy as np

    k1, k2 = np.broadcast_arrays(np.asarray(k1, float), np.asarray(k2, float))
    orbit = ((k1 + np.sqrt(np.maximum(k1**2 - 4 * k2, 0.0))) / 4) ** 2
    worst = np.where(k1**2 >= 4 * k2, orbit, 0.0)
    for half in (0, 2, 4, 9):
        y, w = np.full(k1.shape, 0.3 * L), np.zeros(k1.shape)
        for i in range(ticks):
            side, root = np.sign(y), k1 * np.sqrt(abs(y))
            outward = np.where(side * w > root, side, -side)
            push = (-1.0) ** (i // half) if half else outward
            y, w = y - root * side + w, w - k2 * side + L * push
            worst = np.maximum(worst, abs(y))
    return worst * T**2


def proper_implicit_amplitude(L: float, T: float) -> float:
    """Largest |x1| in m/s while sliding, of the proper implicit form: L T^2."""
    return L * T**2


def implicit_offset(phi: float, T: float) -> float:
    """Offset of |x1| in m/s that the implicit form leaves under a matched disturbance phi: T phi.

    Proof note: locked, the law is u = -x1/T; x1+ = x1 + T (u + phi) = T phi. The nominal model has
    no phi, the proper implicit form estimates it.

    Args:
        phi: disturbance of x1' in m/s^2. T: sample period in s.
    """
    return T * abs(phi)


SUFFICIENT = {
    "quadratic": quadratic,
    "seeber_horn": seeber_horn,
    "homogenised_48": homogenised_48,
    "levant": levant,
    "printed_48": printed_48,
    "polyakov_poznyak": polyakov_poznyak,
    "no_overshoot": no_overshoot,
}
"""Sufficient criteria by name, of k1, k2, L."""


def lyapunov(
    x1: Any, x2: Any, d: Any, k1: float, k2: float, P: tuple[float, float, float] | None = None
) -> tuple[Any, Any]:
    """V and V', V = zeta' P zeta, zeta = (|x1|^.5 sgn x1, x2); Huang 2020 (44)-(48).

    V' = (1/|zeta1|) zeta' (A'P + PA) zeta + 2 (P zeta)_2 d, A = [[-k1/2, 1/2], [-k2, 0]].

    Args:
        x1, x2: state; V' is infinite at x1 = 0. d: disturbance of x2'. k1, k2: gains.
        P: (P11, P12, P22); by default (46), [[4 k2 + k1^2, -k1], [-k1, 2]]/2.
    """
    p, r, q = P or ((4 * k2 + k1 * k1) / 2, -k1 / 2, 1.0)
    z = np.sqrt(np.abs(x1)) * np.sign(x1)
    V = p * z * z + 2 * r * z * x2 + q * x2 * x2
    rate1 = (-k1 * z + x2) / (2 * np.abs(z))
    rate2 = -k2 * np.sign(z) + d
    return V, 2 * (p * z + r * x2) * rate1 + 2 * (r * z + q * x2) * rate2
