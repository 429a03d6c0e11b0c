"""Largest step of a one-step integration method on a stable linear mode."""

from __future__ import annotations

import math

METHODS = {"euler": 1, "rk4": 4, "implicit_euler": 1, "sdirk2": 2}
"""Order of each method."""


def growth(z: complex, method: str) -> float:
    """Modulus of the stability function R(z), z = h lambda.

    Euler 1+z; RK4 the Taylor polynomial of degree 4; implicit Euler 1/(1-z); SDIRK2 (gamma =
    1 - 1/sqrt 2) (1 + (1-2 gamma) z) / (1 - gamma z)^2, L-stable. Source: Hairer and Wanner,
    Solving Ordinary Differential Equations II, section IV.3.
    """
    if method == "euler":
        return abs(1 + z)
    if method == "rk4":
        return abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)
    if method == "implicit_euler":
        return 1 / abs(1 - z)
    if method == "sdirk2":
        g = 1 - 1 / math.sqrt(2)
        return abs((1 + (1 - 2 * g) * z) / (1 - g * z) ** 2)
    raise ValueError(method)


def largest_step(eigenvalue: complex, method: str) -> float:
    """Largest h in s with |R(h lambda)| <= 1 for a mode with Re(lambda) < 0; inf when A-stable.

    Proof note: along the ray z = h lambda the explicit R starts below 1 and leaves the unit disc
    once before |z| = 3. The exit is found by bisection to 12 digits.
    """
    if eigenvalue.real >= 0 or method in ("implicit_euler", "sdirk2"):
        return math.inf
    direction = eigenvalue / abs(eigenvalue)
    if growth(direction * 1e-3, method) > 1 + 1e-12:
        # nearly undamped: first-order exit 2 |Re| / |lambda|^2 of Euler
        low, high = 0.0, 1e-3
    else:
        low, high = 1e-3, 4.0
        radius = low
        while radius < high and growth(direction * radius, method) <= 1 + 1e-12:
            low, radius = radius, radius + 0.01
        high = radius
    for _ in range(60):
        middle = (low + high) / 2
        inside = growth(direction * middle, method) <= 1 + 1e-12
        low, high = (middle, high) if inside else (low, middle)
    return low / abs(eigenvalue)
