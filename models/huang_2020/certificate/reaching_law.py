"""Bounds of the sampled reaching law s' = -g1 s - g2 sgn s."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


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


def tick(g1: float, g2: float, T: float, lag: float) -> tuple[tuple[float, ...], float, float]:
    """Exact tick of s' = a, lag a' = u - a, u = -g1 s - g2 sgn s held over T.

    Returns:
        ``(m11, m12, m21, m22), b1, b2`` of s+ = m11 s + m12 a - b1 sgn s, a+ = m21 s + m22 a -
        b2 sgn s. Without a lag m12 = m22 = 0.
    """
    x = T / lag if lag > 0 else math.inf
    E, taken = math.exp(-x), -math.expm1(-x)
    reach = lag * taken
    # T - reach cancels where the lag is long; its series is good to x^4/120 there
    held = T * x * (0.5 - x / 6 + x * x / 24) if x < 1e-3 else T - reach
    return (1 - g1 * held, reach, -g1 * taken, E), g2 * held, g2 * taken


def orbit(g1: float, g2: float, T: float, lag: float = 0.0, most: int = 2000) -> tuple[int, float]:
    """Symmetric orbit behind a lag: ticks of a half period, and half-swing of s in m/s.

    Proof note: while s > 0 the loop is x+ = M x - b. The orbit of n ticks has x_n = -x_0, so
    x_0 = (I + M^n)^-1 (I + ... + M^(n-1)) b. It is one if s_0, ..., s_(n-1) > 0; it attracts if M
    is stable. Without a lag n = 1 and the swing is that of ``chatter``. Between ticks |s| may be a
    little larger: s' is a, which turns once; that is counted.

    Args:
        g1, g2, T: as of ``chatter``. lag: time constant of the actuator in s.
        most: longest half period looked at; the search ends at three times what it has found.

    Returns:
        The largest symmetric orbit: it can be reached, so no smaller band holds for every start
        (smaller orbits exist beside it, and the start decides). (0, inf) if there is none.
    """
    import numpy as np

    (a, b, c, d), b1, b2 = tick(g1, g2, T, lag)
    M, push = np.array([[a, b], [c, d]]), np.array([b1, b2])
    if not stable_sampled(g1, T, lag):
        return 0, math.inf
    power, total, rows, offsets, found = np.eye(2), np.zeros(2), [], [], (0, np.zeros(2))
    for n in range(1, most + 1):
        rows.append(power[0])
        offsets.append(total[0])
        total, power = M @ total + push, M @ power
        start = np.linalg.solve(np.eye(2) + power, total)
        if (np.array(rows) @ start > offsets).all():
            found = (n, start)
        elif n > 3 * found[0] + 30:
            break
    ticks, x = found
    swing = 0.0 if ticks else math.inf
    for _ in range(ticks):
        swing = max(swing, abs(x[0]), _peak(x, -g1 * x[0] - g2, T, lag))
        x = M @ x - push
    return ticks, float(swing)


def _peak(x: Any, u: float, T: float, lag: float) -> float:
    """Largest |s| inside a tick: where a crosses zero."""
    if lag <= 0 or x[1] * u >= 0:
        return 0.0
    t = lag * math.log((x[1] - u) / -u)
    return abs(x[0] + u * t + (x[1] - u) * lag * (1 - math.exp(-t / lag))) if t < T else 0.0


def stable_sampled(g1: float, T: float, lag: float = 0.0) -> bool:
    """Whether large errors die out in the sampled loop: the poles of ``tick`` lie inside 1.

    Proof note: Jury's conditions of a 2 x 2 matrix; without a lag |1 - T g1| < 1.
    """
    (a, b, c, d), _, _ = tick(g1, 0.0, T, lag)
    det, trace = a * d - b * c, a + d
    return det <= 1 - (g1 > 0) * 1e-15 and 1 + trace + det > 0 and 1 - trace + det > -1e-12


def lyapunov(s: Any, d: Any, g1: float, g2: float) -> tuple[Any, Any]:
    """V and V', V = s^2/2 of the reaching law s' = -g1 s - g2 sgn s + d; Huang 2020 (23).

    V' = -g1 s^2 - g2 |s| + s d, negative for |d| < g2. The paper prints no proof of this law.
    """
    return s * s / 2, -g1 * s * s - g2 * np.abs(s) + s * d
