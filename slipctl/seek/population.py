"""Differential evolution over several numbers, asked for trials and told what became of them.

For objectives that take long: who asks decides how a trial is judged, and all trials of a
generation may be judged side by side. The block of ``seek.evolution`` is the same search over one
number, for a controller that carries it along.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

LOGARITHMIC = 10.0
"""Ends of a range of this ratio or more are searched on a logarithmic scale."""


class Box:
    """Ranges of the numbers that are searched, as the unit cube.

    Args:
        lo, hi: ends of each range; one of positive ends, at least :data:`LOGARITHMIC` apart, is
            logarithmic in the cube.
    """

    def __init__(self, lo: Sequence[float], hi: Sequence[float]) -> None:
        self.lo, self.hi = (np.asarray(x, dtype=float) for x in (lo, hi))
        self.logarithmic = (self.lo > 0) & (self.hi >= LOGARITHMIC * self.lo)

    def point(self, share: np.ndarray) -> np.ndarray:
        """Numbers at a point of the cube."""
        lo, hi, log = self.lo, self.hi, self.logarithmic
        safe = np.where(log, lo, 1.0)
        ratio = np.where(log, hi, 1.0) / safe
        found = np.where(log, safe * ratio**share, lo + (hi - lo) * share)
        return np.clip(found, lo, hi)

    def share(self, point: np.ndarray) -> np.ndarray:
        """Point of the cube that has these numbers."""
        lo, hi, log = self.lo, self.hi, self.logarithmic
        safe, at = np.where(log, lo, 1.0), np.where(log, np.maximum(point, 1e-300), 1.0)
        ratio = np.where(log, hi, math.e) / safe
        return np.where(log, np.log(at / safe) / np.log(ratio), (point - lo) / (hi - lo))

    def by_share(self, share: np.ndarray) -> np.ndarray:
        """Slopes of the numbers by the shares."""
        ratio = np.where(self.logarithmic, self.hi, 1.0) / np.where(self.logarithmic, self.lo, 1.0)
        return np.where(self.logarithmic, self.point(share) * np.log(ratio), self.hi - self.lo)


def first(members: int, numbers: int, seed: int) -> np.ndarray:
    """Points of the cube, a row each, one in each stratum of each number (a Latin hypercube)."""
    random = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 0])))
    strata = np.array([random.permutation(members) for _ in range(numbers)]).T
    return (strata + random.random((members, numbers))) / members


def trial(
    members: np.ndarray, best: int, i: int, key: Sequence[int], crossover: float = 0.9
) -> np.ndarray:
    """Trial of member i: DE/current-to-best/1/bin, reflected into the cube.

    Each number is, with probability ``crossover``, x_i + F (x_best - x_i) + F (x_a - x_b), else
    that of x_i; a, b are other members, and one number at least is new. F is uniform in 0.4..0.9.
    R. Storn, K. Price, J. Global Optimization 11 (1997) 341-359.

    Args:
        members: points of the cube, a row each. best: row of the best one. i: row of the member.
        key: of the random numbers; the same key gives the same trial.
    """
    random = np.random.Generator(np.random.PCG64(np.random.SeedSequence(list(key))))
    others = [k for k in range(len(members)) if k not in (i, best)]
    a, b = random.choice(others, 2, replace=False)
    F = random.uniform(0.4, 0.9)
    x = members[i]
    moved = x + F * (members[best] - x) + F * (members[a] - members[b])
    new = random.random(x.size) < crossover
    new[random.integers(x.size)] = True
    return reflect_at_faces(np.where(new, moved, x))


def reflect_at_faces(x: np.ndarray) -> np.ndarray:
    """Point folded back into the cube at its faces."""
    folded = np.mod(x, 2.0)
    return np.where(folded > 1.0, 2.0 - folded, folded)
