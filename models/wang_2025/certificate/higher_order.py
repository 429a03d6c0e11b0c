"""Bounds of the higher-order sliding mode of Wang 2025, Theorem 2.

    s' = -k1 phi1(s) + z,  z' = -k2 phi2(s) + d,  k2 = 2 beta k1,  |d| <= eta
    phi1 = |s|^(1/2) sgn s + s,  phi2 = phi1 phi1' = sgn(s)/2 + (3/2)|s|^(1/2) sgn s + s

d = -delta'/M, in m/s^3. V = X'PX with X = (phi1, z), P = [[alpha + 4 beta^2, -2 beta],
[-2 beta, 1]]. (49) is V' < 0 by Young's inequality with the weight 1 and therefore depends on the
unit of length; the bounds below it do not.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.bisection import bisect
from slipctl.models.super_twisting.certificate import super_twisting as sta

SMALLEST = math.sqrt(2) / 8
"""k4 above which the optimum of (49) lies inside its region, beta > 1/16."""


def _cross(alpha: float, beta: float) -> float:
    return (alpha + 4 * beta**2 - beta / 2) ** 2 / (4 * beta - 0.25)


def certified_eta(alpha: float, beta: float, k1: float) -> float:
    """Largest eta in m/s^3 that (49) proves; 0 if none.

    eta^2 = (2 alpha k1 - beta^2 - (alpha + 4 beta^2 - beta/2)^2/(4 beta - 1/4))/16, beta > 1/16.

    Proof note: -Q = [[2 k1 alpha - 16 eta^2 - beta^2, .], [alpha + 4 beta^2 - beta/2,
    4 beta - 1/4]] > 0 by the Schur complement of its second diagonal entry.
    """
    if beta <= 1 / 16:
        return 0.0
    return math.sqrt(max(2 * alpha * k1 - beta**2 - _cross(alpha, beta), 0.0)) / 4


def smallest_gain(alpha: float, beta: float, eta: float) -> float:
    """Smallest k1 (and so k4) by (49) for given alpha and beta; inf for beta <= 1/16."""
    if beta <= 1 / 16 or alpha <= 0:
        return math.inf
    return (16 * eta**2 + beta**2 + _cross(alpha, beta)) / (2 * alpha)


def best(k4: float) -> tuple[float, float, float]:
    """alpha, beta and eta in m/s^3 with the largest eta that (49) proves at k4 > sqrt(2)/8.

    eta = k4^2/(2 sqrt(1 + 8 k4)), beta = k4 (4 k4 + 1)/(2 (8 k4 + 1)),
    alpha = 8 k4^3 (1 + 6 k4)/(1 + 8 k4)^2.

    Proof note: the gradient of ``certified_eta`` squared in (alpha, beta) vanishes there and its
    Hessian is negative; at k4 = sqrt(2)/8 the place reaches the edge beta = 1/16.
    """
    if not k4 > SMALLEST:
        raise ValueError(f"k4 = {k4:g} must be above sqrt(2)/8 = {SMALLEST:.5f}")
    alpha = 8 * k4**3 * (1 + 6 * k4) / (1 + 8 * k4) ** 2
    beta = k4 * (4 * k4 + 1) / (2 * (8 * k4 + 1))
    return alpha, beta, k4**2 / (2 * math.sqrt(1 + 8 * k4))


def smallest_k4(eta: float) -> float:
    """Smallest k4 for which some alpha and beta prove eta by (49): k4^4 = 4 eta^2 (1 + 8 k4).

    Below eta = 0.01006 m/s^3 it gives sqrt(2)/8, where the closed form ends.
    """
    if eta <= SMALLEST**2 / (2 * math.sqrt(1 + 8 * SMALLEST)):
        return SMALLEST
    top = 1 + 4 * eta ** (2 / 3) + 4 * math.sqrt(eta)  # k4^4 > 4 eta^2 (1 + 8 k4) there
    return bisect(lambda k: k**4 - 4 * eta**2 * (1 + 8 * k), 0.0, SMALLEST, top)


def best_weighted(k4: float) -> tuple[float, float, float]:
    """alpha, beta and the supremum of eta with the best weight of Young's inequality; unit-free.

    beta = 3 k4/8, alpha = 4 beta^2, eta -> (3 sqrt 3/16) k4^2, reached in the limit only.

    Proof note: with the weight w, 16 w eta^2 < 2 alpha k - beta^2/w - (alpha + 4 beta^2 -
    beta/(2 w))^2/(4 beta - 1/(4 w)). As w -> 1/(16 beta) the last term stays finite only for
    alpha = 4 beta^2; then eta^2 < beta (8 beta^2 k - 16 beta^3), largest at beta = 3 k/8.
    """
    beta = 3 * k4 / 8
    return 4 * beta**2, beta, 3 * math.sqrt(3) / 16 * k4**2


def quadratic_eta(k1: float, k2: float) -> float:
    """Largest eta in m/s^3 that a quadratic function of X proves: peak gain 2 eta/(...) < 1."""
    if k1 * k1 >= 2 * k2:
        return k2 / 2
    return k1 * math.sqrt(4 * k2 - k1 * k1) / 4


def exact_eta(k1: float, k2: float) -> float:
    """Largest eta in m/s^3 of any proof: above it some d keeps s from vanishing.

    Proof note: near s = 0 it is the super-twisting law with gains k1 and k2/2; the linear terms
    only help. See ``super_twisting.log_ratio``.
    """
    if sta.exact(k1, k2 / 2, k2 / 2 * (1 - 1e-12)):
        return k2 / 2
    return bisect(lambda eta: sta.log_ratio(k1, k2 / 2, eta), 0.0, 0.0, k2 / 2)


def lyapunov(
    s: Any, v: Any, d: Any, k: Any, k_rate: Any, k_wanted: float, alpha: float, beta: float
) -> tuple[Any, Any]:
    """V and V', V = zeta' P zeta + (1 + 4 beta^2)/2 (k - k_wanted)^2; Wang 2025, Theorem 2.

    zeta = (phi1(s), v), P = [[alpha + 4 beta^2, -2 beta], [-2 beta, 1]], s' = -k phi1 + v,
    v' = -2 beta k phi2 + d.

    Proof note: with k' = phi1 phi2 2 alpha/(1 + 4 beta^2) the part of V' that holds k - k_wanted
    vanishes, because (A(k) - A(k_wanted))'P + P(..) = diag(-2 alpha (k - k_wanted), 0).

    Args:
        s, v: state. d: disturbance of v' in m/s^3. k, k_rate: gain and its rate.
        k_wanted: the gain that (49) asks for. alpha, beta: of the law.
    """
    root = np.sqrt(np.abs(s))
    phi1 = (root + root**2) * np.sign(s)
    slope = 1 / (2 * root) + 1
    p, r = alpha + 4 * beta**2, -2 * beta
    rate1 = slope * (v - k * phi1)
    rate2 = -2 * beta * k * phi1 * slope + d
    off = k - k_wanted
    weight = (1 + 4 * beta**2) / 2
    V = p * phi1**2 + 2 * r * phi1 * v + v * v + weight * off * off
    rate = 2 * (p * phi1 + r * v) * rate1 + 2 * (r * phi1 + v) * rate2 + 2 * weight * off * k_rate
    return V, rate
