"""A law of the whole train that knows no curve: each axle searches the slope of its own adhesion.

It moves its slip by a wave and fits over one wave, by least squares,

    f = f_0 + drift (x - x_0) + f' (e - e_0)

and then climbs  d/de [ln f + m k (1 - f/mu_r) e] = f'/f_0 + m k (1 - f_0/mu_r - e f'/mu_r).
Slips are held exactly, so what it loses is lost by the search alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slipctl.models.wheel_rail.sliding_train import SlidingTrain

LEAST, CLIMB = 0.01, 0.2
"""Smallest creep ratio, and the most by which its logarithm climbs in a metre."""


@dataclass
class SlopeSearch:
    """Slips of axles that search; see :data:`~slipctl.models.wheel_rail.sliding_train.Slips`.

    Attributes:
        train: the train.
        start: creep ratio of all axles at the start.
        recovered, layer: peaks of the clean rail and under the layer, as the law believes.
        wave: length of the wave in m.
        swing: its height over the creep ratio.
        rate: how fast it climbs, in 1/m.
        noise: standard deviation of the adhesion that is measured in a cell.
    """

    train: SlidingTrain
    start: float = 0.3
    recovered: float = 0.15
    layer: float = 0.04
    wave: float = 16.0
    swing: float = 0.15
    rate: float = 0.32
    noise: float = 0.002
    _seen: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        self._level = np.full(self.train.axles, np.log(self.start))
        self._e = np.full(self.train.axles, self.start)
        self._rng = np.random.default_rng(1)

    def __call__(self, x: float, v: float, W: np.ndarray, fouled: np.ndarray) -> np.ndarray:
        """Creep ratio of each axle at a place; asked again at the same place it is the same."""
        if self._seen and x == self._seen[-1][0]:
            return self._e
        low, high = self.train.heights(self._e, v)
        share = np.where(fouled, self.train.recovered(W), 1.0)
        f = np.minimum((1 - share) * low + share * high, self.train.most)
        self._seen.append((x, self._e, f + self.noise * self._rng.standard_normal(f.size)))
        if x - self._seen[0][0] >= self.wave:
            self._climb(x - self._seen[-2][0])
            self._seen.pop(0)
        waved = np.exp(self._level + self.swing * np.sin(2 * np.pi * x / self.wave))
        self._e = np.minimum(waved, self.train.slip)
        return self._e

    def _climb(self, way: float) -> None:
        """One step up the slope that was found over the last wave, after so many metres."""
        x, e, f = (np.array(column) for column in zip(*self._seen, strict=True))
        drift, moved = np.tile(x[:, None] - x.mean(), e.shape[1]), e - e.mean(axis=0)
        A = np.stack([np.ones_like(e), drift, moved], axis=-1).transpose(1, 0, 2)
        square = A.transpose(0, 2, 1) @ A + 1e-12 * np.eye(3)
        found = np.linalg.solve(square, A.transpose(0, 2, 1) @ f.T[:, :, None])[:, :, 0]
        f_0, slope = np.maximum(found[:, 0], 0.005), found[:, 2]
        behind, own = np.arange(self.train.axles - 1, -1, -1), np.exp(self._level)
        k = self.train.tau * self.train.load * (self.recovered - self.layer)
        gain = np.where(f_0 < self.recovered, 1 - f_0 / self.recovered - own * slope
                        / self.recovered, 0)  # fmt: skip
        up = self.rate * own * (slope / f_0 + behind * k * gain)
        level = self._level + way * np.clip(up, -CLIMB, CLIMB)
        self._level = np.clip(level, np.log(LEAST), np.log(self.train.slip))
