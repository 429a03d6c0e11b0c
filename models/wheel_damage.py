"""What sliding does to a wheel: wear by the energy in its contact, flash temperature, flats.

    T-gamma = F s/v                              energy by the metre, N; I = T-gamma/A, N/mm^2
    k(I)    = 5.3 I to 10.4,  55 to 77.2,  then 55 + 61.9 (I - 77.2)       ug by m rolled and mm^2
    flash   = 1.5 (1.064/K) q sqrt(a chi)/(sqrt(u_A) + sqrt(u_B)),   q = Q/A              peak, K
    flat    depth L^2/(8 R), area of its section L^3/(12 R)

Wear: function of Sheffield (USFD) for wheel R8T on rail UIC60 900A, Lewis and Dwyer-Joyce (2004),
Braghin (2006). Its last branch is made continuous here. A code that is passed around subtracts
4778.7: then wear falls to nothing at I = 77.2. Some print 61.9 I: then it jumps to 4779.

Flash: band source that moves fast over two bodies, each of which would take all heat alone. The
mean is two thirds of the peak. u_A and u_B are the speeds of the contact over rail and wheel. A
locked wheel is always at the same spot, u_B = 0, so that the rail alone limits the heat. Steel
turns to martensite at about 720 degrees C.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from slipctl import BadInput

PATCH, HALF_LENGTH = 120e-6, 5e-3
"""Area in m^2 and half length in m of the contact of a wheel; of an example."""

CONDUCTIVITY, HEAT = 45.0, 7850 * 480.0
"""Steel: W/(m K), and J/(m^3 K)."""

MILD, SEVERE = 10.4, 77.2
"""Energy by the metre and area, in N/mm^2, at which wear changes its kind."""


def wear_rate(t_gamma: Any, patch: float = PATCH) -> Any:
    """Wear of a wheel in kg by metre rolled, of T-gamma in N and the patch in m^2.

    Raises:
        BadInput: a patch that is not positive.
    """
    _check("patch", patch)
    I = np.abs(np.asarray(t_gamma, dtype=float)) / (patch * 1e6)
    k = np.where(I < MILD, 5.3 * I, np.where(I <= SEVERE, 55.0, 55.0 + 61.9 * (I - SEVERE)))
    return k * 1e-9 * patch * 1e6


def flash_temperature(
    heat: Any, over_rail: Any, over_wheel: Any, patch: float = PATCH,
    half_length: float = HALF_LENGTH, conductivity: float = CONDUCTIVITY, capacity: float = HEAT,
) -> Any:  # fmt: skip
    """Peak rise of temperature in K in a contact.

    Args:
        heat: of the contact in W.
        over_rail, over_wheel: speeds in m/s at which it moves over rail and wheel.
        patch, half_length: its area in m^2, its half length in the way of rolling in m.
        conductivity, capacity: of the steel, W/(m K) and J/(m^3 K).

    Raises:
        BadInput: a length or a number of the steel that is not positive.
    """
    for name, value in (("patch", patch), ("half_length", half_length),
                        ("conductivity", conductivity), ("capacity", capacity)):  # fmt: skip
        _check(name, value)
    q = np.abs(np.asarray(heat, dtype=float)) / patch
    bodies = np.sqrt(np.abs(over_rail)) + np.sqrt(np.abs(over_wheel))
    mean = 1.064 / conductivity * sqrt(half_length * conductivity / capacity) * q
    return 1.5 * mean / np.maximum(bodies, 1e-3)


def flat_depth(length: float, radius: float) -> float:
    """Depth in m of a flat of a length in m on a wheel of a radius in m."""
    return length**2 / (8 * radius)


def flat_area(length: float, radius: float) -> float:
    """Area in m^2 of the section that a flat of a length has lost."""
    return length**3 / (12 * radius)


def _check(name: str, value: float) -> None:
    if not value > 0:
        raise BadInput(f"{name} = {value:g} must be positive")
