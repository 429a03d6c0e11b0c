"""A search for the worst disturbance of one case: differential evolution over when it turns.

The simulators are those of this folder. A candidate is a start, and how long the disturbance, and
the noise, keep each of their signs; a run repeats that to its end. What is sought is the largest
share of the promised bound that a run comes to: 1 breaks the promise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import differential_evolution

from . import holding, super_twisting
from .common import Cases

TURNS = 12
"""Signs of a candidate, for the disturbance and for the noise each."""


def turns(genes: np.ndarray, ticks: int) -> Iterator[np.ndarray]:
    """Sign of each candidate (candidates, turns), tick by tick; kept for an eighth at most."""
    lengths = np.round((ticks / 8) ** np.clip(genes, 0, 1)).astype(int)
    ends = np.cumsum(lengths, axis=1)
    for tick in range(ticks):
        at = (ends <= (tick % ends[:, -1])[:, None]).sum(axis=1)
        yield np.where((at + tick // ends[:, -1] * TURNS) % 2, -1.0, 1.0)


def pushes(genes: np.ndarray, ticks: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Disturbance and noise of each candidate as shares of their bounds, tick by tick."""
    return zip(
        turns(genes[:, 3 : 3 + TURNS], ticks), turns(genes[:, 3 + TURNS :], ticks), strict=True
    )


def twisted(n: Cases, genes: np.ndarray) -> np.ndarray:
    """Share of the band that |x1| comes to, in the end or, if the promise is of rest, at all."""
    loop = super_twisting.Loop(n, 1)
    if not loop.rests.any():
        size = 10 ** (3 * genes[:, 0] - 1.5) * loop.k2
        loop.y, loop.phi = (size * 3 * (2 * genes[:, 1] - 1))[None], (size * genes[:, 2])[None]
    worst = np.zeros(len(genes))
    ticks = 1000
    for i, (d, noise) in enumerate(pushes(genes, ticks)):
        loop.tick(d[None], noise[None])
        if i >= ticks // 2 or loop.rests.any():
            worst = np.maximum(worst, np.abs(loop.y[0]))
    return worst * n["L"] * n["T"] ** 2 / n["band"]


def held(
    kind: type[holding.Loop], rate: Callable[[Cases], np.ndarray]
) -> Callable[[Cases, np.ndarray], np.ndarray]:
    """Share of its bounds that the error comes to, in twenty times what the law needs to answer."""

    def share(n: Cases, genes: np.ndarray) -> np.ndarray:
        start = holding.told(n, "start", 0.5)
        with np.errstate(all="ignore"):
            loop = kind(n, ((2 * genes[:, 0] - 1) * start)[None])
            worst = loop.far()[0]
            ticks = int(np.clip(20 / (rate(n) * n["T"]).min(), 500, 20_000))
            for w, noise in pushes(genes, ticks):
                loop.tick(w[None], noise[None])
                worst = np.maximum(worst, np.where(loop.out[0], 1.0, loop.far()[0]))
        return worst

    return share


SHARES: dict[str, Callable[[Cases, np.ndarray], np.ndarray]] = {
    "super_twisting": twisted,
    "prescribed_performance": held(holding.FunnelLoop, lambda n: n["K1"]),
    "barrier_lyapunov": held(holding.BarrierLoop, lambda n: 2 * n["k"] * n["k_s"] ** 2),
}
"""Systems that have such a search."""


def worst(system: str, numbers: dict[str, float], runs: int, seed: int) -> float:
    """Largest share of the bound that a search of at least so many runs finds."""
    genes, size, tried = 3 + 2 * TURNS, 8, 0

    def least(x: np.ndarray) -> np.ndarray:
        nonlocal tried
        x = np.atleast_2d(x.T)
        tried += len(x)
        tiled = {k: np.full(len(x), v) for k, v in numbers.items()}
        return -SHARES[system](tiled, x)

    found = differential_evolution(
        least, [(0.0, 1.0)] * genes, popsize=size, maxiter=-(-runs // (size * genes)), tol=0,
        atol=-1, polish=False, vectorized=True, updating="deferred", rng=seed,
    )  # fmt: skip
    assert tried >= runs
    return -float(found.fun)
