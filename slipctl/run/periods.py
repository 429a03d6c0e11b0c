"""Whole periods of a ripple: means and rms values over a part of one say where it was cut.

A peak-to-peak value needs no such care: a window of a period or more holds the whole ripple.
"""

from __future__ import annotations

import numpy as np

SHARE = 0.25
"""How far, of the peak-to-peak value, a signal must go to either side to count as swung."""


def whole_periods(values: np.ndarray) -> slice:
    """Longest end of a window that consists of whole periods of what the signal does there.

    A period runs from one rise through the middle to the next, or from fall to fall, whichever
    fills more of the window. The middle is the mean over the whole periods themselves, so that a
    boundary between two samples costs nothing to first order. A rise counts if the signal was a
    quarter of its peak-to-peak value below the middle before it and gets as far above it after.
    Noise on a ripple makes no periods, and a drift has none.

    Args:
        values: samples of one signal.

    Returns:
        The samples from the first rise to before the last one; all of them without a period.
    """
    y = np.asarray(values, dtype=float)
    found, middle = slice(0, len(y)), float(y.mean()) if len(y) else 0.0
    for _ in range(4):  # the middle and the rises through it settle at once
        far = SHARE * float(np.ptp(y)) if len(y) else 0.0
        each = [k for k in (_rises(y - middle, far), _rises(middle - y, far)) if len(k) > 1]
        if not each:
            return slice(0, len(y))
        ends = max(each, key=lambda k: k[-1] - k[0])
        found = slice(ends[0], ends[-1])
        following = float(y[found].mean())
        if following == middle:
            break
        middle = following
    return found


def _rises(error: np.ndarray, far: float) -> list[int]:
    """First sample above zero of each swing from ``-far`` to ``far``."""
    found: list[int] = []
    side = np.where(error > far, 1, np.where(error < -far, -1, 0))
    swung = np.flatnonzero(side)
    turns = swung[1:][(side[swung[1:]] > 0) & (side[swung[:-1]] < 0)]
    lows = swung[:-1][(side[swung[1:]] > 0) & (side[swung[:-1]] < 0)]
    for low, high in zip(lows, turns, strict=True):
        found.append(int(low + np.flatnonzero(error[low : high + 1] <= 0)[-1] + 1))
    return found


def mean(values: np.ndarray) -> float:
    """Mean over whole periods."""
    return float(np.mean(values[whole_periods(values)]))


def rms(values: np.ndarray) -> float:
    """Root of the mean square over whole periods."""
    return float(np.sqrt(np.mean(np.square(values[whole_periods(values)]))))
