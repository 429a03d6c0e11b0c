"""Numbers of a signal over time: settling time, ripple, root mean square, worst column."""

from __future__ import annotations

import numpy as np


def settling_time(
    time: np.ndarray, error: np.ndarray, start: float, stop: float, band: float
) -> float | None:
    """Time in s from ``start`` until ``error`` stays in the band up to ``stop``; None if never."""
    inside = (time >= start - 1e-9) & (time < stop - 1e-9)
    t, large = time[inside], np.abs(error[inside]) > band
    if not len(t) or large[-1]:
        return None
    last = np.flatnonzero(large)
    return float(t[last[-1] + 1] - t[0]) if len(last) else 0.0


def stretches(true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First place of each stretch that is true, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(int)))
    return edges[::2], edges[1::2]


def ripple(values: np.ndarray) -> float:
    """Peak-to-peak value, of the worst column."""
    return float(np.ptp(values, axis=0).max()) if len(values) else 0.0


def worst(values: np.ndarray) -> np.ndarray:
    """Of each row the value furthest from zero."""
    at = np.abs(values).argmax(axis=1)
    return np.take_along_axis(values, at[:, None], axis=1)[:, 0]


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
