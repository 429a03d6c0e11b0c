"""How much of a strength of the cleaning a train may count on that knows it within a factor.

With a strength that is too large, axles slide where nothing is to be gained, and the train stops
later than with each axle at its own peak. How much later depends on the train: two axles gain next
to nothing, and sixteen nearly always win. So it is worked out for each train, over one rail point
and some speeds, with the curves that are believed and each true strength within the factor.
"""

from __future__ import annotations

import numpy as np

from slipctl.models.wheel_rail.sliding_train import SlidingTrain

SHARES = np.linspace(0.0, 1.0, 51)
"""Shares of the strength that are tried."""

FACTORS = 7
"""True strengths that are tried: an odd number, so that the one believed is among them."""

SPEEDS = 25
"""Speeds at which the axles over one rail point are worked out."""

FEW = 2
"""Axles of a train that does not try: all that it may gain is less than a falling curve costs."""

WORTH = 0.005
"""Share of the distance that has to be gained if the strength is as believed."""


NODES = np.linspace(0.0, 1.0, 17)
"""Shares of the clean curve at which a plan over the axles has its values."""


def cautious_share(
    train: SlidingTrain, speed: float, within: float = 3.0, worse: float = 0.019,
    plan: bool = False, learn: bool = False,
) -> float:  # fmt: skip
    """Largest share of the believed strength with which a train never stops much later.

    Where a train with that share gains next to nothing it is 0, which is each axle's own peak.

    Args:
        train: the train, with the strength that is believed.
        speed: the largest from which it brakes, in m/s.
        within: factor by which the true strength may be larger or smaller.
        worse: share of the distance of best slips that may be lost, from any speed up to that. A
            whole stop loses .1 % more than one rail point tells; behind valves it loses less, as
            they do not hold best slips exactly either.
        plan: whether slips are planned over all axles, and not by the law of each.
        learn: whether the strength is learnt within the factor. Then a train tries if it may gain
            with the largest one.
    """
    if train.axles <= FEW:
        return 0.0
    later = _later(train, speed, within, plan)
    over = np.flatnonzero(later.max(axis=(0, 2)) > worse)
    most = int(over[0]) - 1 if over.size else SHARES.size - 1
    hoped = later[-1, : most + 1, -1 if learn else FACTORS // 2]
    return float(SHARES[most]) if hoped.min() < -WORTH else 0.0


def _later(train: SlidingTrain, speed: float, within: float, plan: bool) -> np.ndarray:
    """By what share stops are longer than with own peaks.

    Returns:
        By speed of the start, share and true strength, shape (SPEEDS - 1, shares, FACTORS).
    """
    speeds = np.linspace(0.15, 1.0, SPEEDS) * speed
    factors = np.geomspace(1 / within, within, FACTORS)
    ways = np.array([
        [v / np.maximum(train.gravity * f / train.axles + train.lost(v), 1e-9) for f in rows]
        for v, rows in ((v, _forces(train, float(v), factors, plan)) for v in speeds)
    ])  # fmt: skip
    whole = np.cumsum(ways[1:] + ways[:-1], axis=0)  # from each speed down to the least
    return np.asarray(whole / whole[:, :1] - 1)


def _forces(train: SlidingTrain, v: float, factors: np.ndarray, plan: bool) -> np.ndarray:
    """Sum of the adhesions over one rail point, by share of the strength and true strength."""
    e = np.geomspace(1e-3, train.slip, 150)
    curves = train.heights(e, v)
    low, high = curves
    most = float(high.max())
    rate = SHARES[:, None, None] * train.tau * train.load
    k = rate * max(most - float(low.max()), 0.0)
    values = _values(train, e, curves, rate) if plan else []
    W = np.zeros((SHARES.size, factors.size))
    total = np.zeros_like(W)
    for behind in range(train.axles - 1, -1, -1):
        share = train.recovered(factors * W)[..., None]
        f = np.minimum((1 - share) * low + share * high, train.most)
        if plan:
            worth = f + _between(values[behind], 1 - (1 - share) * np.exp(-rate * f * e))
        else:
            worth = np.log(f) + behind * k * np.maximum(1 - f / most, 0) * e
        at = worth.argmax(axis=2)
        own = np.take_along_axis(f, at[..., None], axis=2)[..., 0]
        total += own
        W = W + train.load * own * e[at]
    return total


def _values(
    train: SlidingTrain, e: np.ndarray, curves: tuple[np.ndarray, np.ndarray], rate: np.ndarray
) -> list[np.ndarray]:
    """What 0, 1, ... axles transmit together, in adhesions, by share of the strength and node."""
    f = np.minimum((1 - NODES[:, None]) * curves[0] + NODES[:, None] * curves[1], train.most)
    left = 1 - (1 - NODES[:, None]) * np.exp(-rate * f * e)
    values = [np.zeros((SHARES.size, NODES.size))]
    for _ in range(train.axles - 1):
        values.append((f + _between(values[-1], left)).max(axis=2))
    return values


def _between(values: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Values between the nodes, a row for each share of the strength."""
    place = np.clip(share, 0, 1) * (NODES.size - 1)
    node = np.minimum(place.astype(int), NODES.size - 2)
    row = np.arange(SHARES.size)[:, None, None]
    return np.asarray(
        values[row, node] + (place - node) * (values[row, node + 1] - values[row, node])
    )
