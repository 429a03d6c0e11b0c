"""Largest step of a one-step integration method on a stable linear mode."""

from __future__ import annotations

import math

import numpy as np

METHODS = {"euler": 1, "rk4": 4, "implicit_euler": 1, "sdirk2": 2}
"""Order of each method."""

TAYLOR = {"euler": (1.0, 1.0), "rk4": (1.0, 1.0, 1 / 2, 1 / 6, 1 / 24)}
"""Coefficients of the stability function of each explicit method."""


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

    Along the ray z = h lambda an explicit R starts below 1 and leaves the unit disc once before
    |z| = 3: at the first root of |R|^2 - 1, a polynomial in h. An excess of 1e-12 is rounding.
    """
    if eigenvalue.real >= 0 or method not in TAYLOR:
        return math.inf
    terms = np.array(TAYLOR[method]) * (eigenvalue / abs(eigenvalue)) ** np.arange(
        len(TAYLOR[method])
    )
    square = np.convolve(terms.real, terms.real) + np.convolve(terms.imag, terms.imag)
    square[0] = -2e-12
    roots = np.roots(square[::-1])
    exits = roots.real[(abs(roots.imag) < 1e-9 * abs(roots)) & (roots.real > 0)]
    return float(exits.min()) / abs(eigenvalue)
