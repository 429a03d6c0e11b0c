"""How much of a strength of the cleaning a train may count on that knows it within a factor.

With a strength that is too large, axles slide where nothing is to be gained, and the train stops
later than with each axle at its own peak. How much later depends on the train: two axles gain next
to nothing, and sixteen nearly always win. So it is worked out for each train, over one rail point
and some speeds, with the curves that are believed and each true strength within the factor.
"""

from __future__ import annotations

import numpy as np

from slipctl.models.wheel_rail.sliding_train import SlidingTrain

SHARES = np.linspace(0.0, 1.0, 21)
"""Shares of the strength that are tried."""

FACTORS = 7
"""True strengths that are tried: an odd number, so that the one believed is among them."""


FEW = 2
"""Axles of a train that does not try: all that it may gain is less than a falling curve costs."""

WORTH = 0.015
"""Share of the distance that has to be gained if the strength is as believed."""


def cautious_share(
    train: SlidingTrain, speed: float, within: float = 3.0, worse: float = 0.01
) -> float:
    """Largest share of the believed strength with which a train never stops much later.

    Where a train with that share gains next to nothing it is 0, which is each axle's own peak.

    Args:
        train: the train, with the strength that is believed.
        speed: from which it brakes, in m/s.
        within: factor by which the true strength may be larger or smaller.
        worse: share of the distance of best slips that may be lost. Valves and a slip that is not
            held exactly cost as much again.
    """
    if train.axles <= FEW:
        return 0.0
    later = _later(train, speed, within)
    over = np.flatnonzero(later.max(axis=1) > worse)
    most = int(over[0]) - 1 if over.size else SHARES.size - 1
    as_believed = later[: most + 1, FACTORS // 2]
    return float(SHARES[most]) if as_believed.min() < -WORTH else 0.0


def _later(train: SlidingTrain, speed: float, within: float) -> np.ndarray:
    """By what share the way is longer than with own peaks, by share and true strength."""
    speeds = np.linspace(0.15, 1.0, 7) * speed
    factors = np.geomspace(1 / within, within, FACTORS)
    ways = np.array([
        [v / np.maximum(train.gravity * f / train.axles + train.lost(v), 1e-9) for f in rows]
        for v, rows in ((v, _forces(train, float(v), factors)) for v in speeds)
    ])  # fmt: skip
    whole = np.trapezoid(ways, speeds, axis=0)
    return np.asarray(whole / whole[0] - 1)


def _forces(train: SlidingTrain, v: float, factors: np.ndarray) -> np.ndarray:
    """Sum of the adhesions over one rail point, by share of the strength and true strength."""
    e = np.geomspace(1e-3, train.slip, 150)
    low, high = train.heights(e, v)
    most = float(high.max())
    k = SHARES[:, None, None] * train.tau * train.load * max(most - float(low.max()), 0.0)
    W = np.zeros((SHARES.size, factors.size))
    total = np.zeros_like(W)
    for behind in range(train.axles - 1, -1, -1):
        share = -np.expm1(-((factors * train.tau * W) ** train.layers))[..., None]
        f = np.minimum((1 - share) * low + share * high, train.most)
        worth = np.log(f) + behind * k * np.maximum(1 - f / most, 0) * e
        at = worth.argmax(axis=2)
        own = np.take_along_axis(f, at[..., None], axis=2)[..., 0]
        total += own
        W = W + train.load * own * e[at]
    return total
