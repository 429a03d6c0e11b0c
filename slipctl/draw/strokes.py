"""Curves as strokes: few points that look like all of them, and an area where a curve chatters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.draw import live

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DENSE = 400
"""Columns of a panel by which a curve is looked at that goes up and down within them."""


def stroke(axis: Axes, curve: tuple[np.ndarray, np.ndarray], **looks: Any) -> Any:
    """Draw a curve from as few points as look the same; a page that zooms has all of them."""
    if _dense(curve[1]):
        return area(axis, *curve, DENSE, **looks)
    line = axis.plot(*envelope(*curve), **looks)[0]
    live.exact(line, *curve)
    return line


def _dense(y: np.ndarray) -> bool:
    """Whether a line would be a solid block: in many columns it goes up and down, and far."""
    many = len(y) // DENSE
    if many < 4 or y.ndim > 1 or not np.isfinite(y).all():
        return False
    parts = y[: many * DENSE].reshape(DENSE, many)
    turns = (np.diff(np.sign(np.diff(parts, axis=1)), axis=1) != 0).sum(axis=1)
    far = np.ptp(parts, axis=1) > 0.03 * np.ptp(y)
    return bool(np.mean(far & (turns >= 3)) > 0.1)


def envelope(t: np.ndarray, y: np.ndarray, columns: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """Fewer points that look the same: the smallest and the largest value of each column."""
    if len(t) <= 2 * columns:
        return t, y
    edges = np.linspace(0, len(t), columns + 1).astype(int)
    first, last = edges[:-1], edges[1:] - 1
    inside = np.minimum(first[:, None] + np.arange(np.diff(edges).max()), last[:, None])
    parts = np.asarray(y)[inside]
    low, high = first + parts.argmin(1), first + parts.argmax(1)
    keep = np.sort([first, low, high, last], axis=0).T.ravel()
    keep = keep[np.diff(keep, prepend=-1) > 0]
    return t[keep], y[keep]


def area(axis: Axes, t: np.ndarray, y: np.ndarray, columns: int, **looks: Any) -> Any:
    """Draw a curve as the mean of each column, and an area over what it covers there."""
    edges = np.linspace(0, len(t), columns + 1).astype(int)[:-1]
    low, high = np.minimum.reduceat(y, edges), np.maximum.reduceat(y, edges)
    many = np.diff([*edges, len(y)])
    mean, middle = np.add.reduceat(y, edges) / many, np.add.reduceat(t, edges) / many
    axis.fill_between(
        middle, low, high, color=looks["color"], alpha=0.25, lw=0, zorder=1.5, label=live.RANGE
    )
    line = axis.plot(middle, mean, **looks)[0]
    live.exact(line, t, y)
    return line
