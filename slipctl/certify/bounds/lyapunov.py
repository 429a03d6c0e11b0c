"""Lyapunov functions of the papers' proofs, each with its derivative along the motion.

Each function takes numbers or arrays and gives ``(V, V')``. V' is by the chain rule from the
equations and the disturbance, not by differences, so that a run can be checked against it.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def _root(x: Any) -> Any:
    return np.sqrt(np.abs(x)) * np.sign(x)


def reaching_law(s: Any, d: Any, g1: float, g2: float) -> tuple[Any, Any]:
    """V = s^2/2 of the reaching law s' = -g1 s - g2 sgn s + d; Huang 2020 (23).

    V' = -g1 s^2 - g2 |s| + s d, negative for |d| < g2. The paper prints no proof of this law.
    """
    return s * s / 2, -g1 * s * s - g2 * np.abs(s) + s * d


def super_twisting(
    x1: Any, x2: Any, d: Any, k1: float, k2: float, P: tuple[float, float, float] | None = None
) -> tuple[Any, Any]:
    """V = zeta' P zeta, zeta = (|x1|^.5 sgn x1, x2); Huang 2020 (44)-(48).

    V' = (1/|zeta1|) zeta' (A'P + PA) zeta + 2 (P zeta)_2 d, A = [[-k1/2, 1/2], [-k2, 0]].

    Args:
        x1, x2: state; V' is infinite at x1 = 0. d: disturbance of x2'. k1, k2: gains.
        P: (P11, P12, P22); by default (46), [[4 k2 + k1^2, -k1], [-k1, 2]]/2.
    """
    p, r, q = P or ((4 * k2 + k1 * k1) / 2, -k1 / 2, 1.0)
    z = _root(x1)
    V = p * z * z + 2 * r * z * x2 + q * x2 * x2
    rate1 = (-k1 * z + x2) / (2 * np.abs(z))
    rate2 = -k2 * np.sign(z) + d
    return V, 2 * (p * z + r * x2) * rate1 + 2 * (r * z + q * x2) * rate2


def funnel(z: Any, w: Any, K1: float, width: float) -> tuple[Any, Any]:
    """V = eps^2/2 of prescribed performance, eps = atanh z; Zhang 2021 (35)-(37).

    eps' = -K1 eps + l w, l = 1/(width (1 - z^2)): V' = -K1 eps^2 + l eps w.

    Args:
        z: share of the half-width. w: disturbance of the slip ratio's rate in 1/s. K1: gain.
        width: eta (delta_l + delta_u)/2.
    """
    eps = np.arctanh(z)
    return eps * eps / 2, -K1 * eps * eps + eps * w / (width * (1 - z * z))


def observer(
    e: Any, z: Any, d: Any, K1: float, K2: float, K3: float, P: tuple[float, float, float]
) -> tuple[Any, Any]:
    """V = zeta' P zeta, zeta = (Phi1(e), z); Wang 2025, proof of Theorem 1.

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


def higher_order(
    s: Any, v: Any, d: Any, k: Any, k_rate: Any, k_wanted: float, alpha: float, beta: float
) -> tuple[Any, Any]:
    """V = zeta' P zeta + (1 + 4 beta^2)/2 (k - k_wanted)^2; Wang 2025, proof of Theorem 2.

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


def barrier(e: Any, w: Any, k: float, k_a: float, k_s: float) -> tuple[Any, Any]:
    """V = ln(k_x^2/(k_x^2 - e^2))/2, k_x = k_a for e < 0, else k_s; Cheng 2022 (43)-(48).

    V' = e e'/(k_x^2 - e^2) = -2 k e^2 + e w/(k_x^2 - e^2) with the printed shape.
    """
    width = np.where(np.asarray(e) < 0, k_a, k_s)
    room = width**2 - e * e
    return np.log(width**2 / room) / 2, -2 * k * e * e + e * w / room


def seeker(delta: Any, slope: Any, k: float, rho: float, beta: float) -> tuple[Any, Any]:
    """V = x^2/2 with x = sin(pi delta/beta) of the sliding-mode seeker; Cheng 2022 (25)-(28).

    delta' = k mu' sgn x - rho; V' = x cos(pi delta/beta) (pi/beta) delta', negative around odd
    multiples of beta for k mu' > rho, and around even ones for k mu' < -rho.
    """
    x = np.sin(np.pi * delta / beta)
    rate = np.pi / beta * np.cos(np.pi * delta / beta) * (k * slope * np.sign(x) - rho)
    return x * x / 2, x * rate
