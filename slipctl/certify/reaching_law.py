"""Bounds of the sampled reaching law s' = -g1 s - g2 sgn s."""

from __future__ import annotations

import math


def chatter(g1: float, g2: float, T: float) -> float:
    """Half-swing in m/s of the period-2 orbit of s+ = s - T (g1 s + g2 sgn s): T g2/(2 - T g1).

    Proof note: s+ = -s gives (2 - T g1) s = T g2. It exists and attracts for 0 < T g1 < 2.

    Args:
        g1: proportional reaching in 1/s. g2: constant reaching in m/s^2. T: sample period in s.
    """
    return T * g2 / (2 - T * g1) if T * g1 < 2 else math.inf


def torque_swing(g1: float, g2: float, T: float, J: float, r: float) -> float:
    """Peak-to-peak torque in N m on that orbit: 2 (J/r)(g1 s + g2) = 4 (J/r) g2/(2 - T g1)."""
    return 2 * (J / r) * (g1 * chatter(g1, g2, T) + g2)
