"""The last steps of a search along exact slopes, where the loop is smooth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from slipctl.design.gain_search import TRAINING, Candidate, Search
from slipctl.design.slopes.gradients import AGREES, SMOOTH, Slopes, slope_error
from slipctl.errors import BadInput, RunFailed

STEPS = 12
"""Most steps."""


@dataclass(frozen=True)
class Polished:
    """What came of it.

    Attributes:
        why: in words, why there are no slopes; empty where there are.
        apart: relative difference of the slope and central differences, along a random direction.
        gained: by which the mean of the objective fell.
    """

    why: str
    apart: float = 0.0
    gained: float = 0.0

    def text(self) -> str:
        """What came of it, in a line."""
        if self.why:
            return f"no exact gradient: {self.why}"
        found = f"exact gradient, apart from central differences by {self.apart:.1e}"
        if self.apart > AGREES:
            return f"{found}: not used"
        return f"{found}: the mean fell by {self.gained:.3g} along it"


def polish(search: Search) -> Polished:
    """Go from the best candidate of a search along slopes, inside the box; the best one stays best.

    A step whose certificates fail, or that misses a limit, ends it. L-BFGS-B (C. Zhu et al., ACM
    Trans. Math. Software 23 (1997) 550-560), from SciPy.
    """
    from scipy.optimize import minimize

    without = [m for m in search.objective.metrics if m not in SMOOTH]
    if without:
        return Polished(f"{', '.join(without)} has no slope")
    if search.best.score.lost():
        return Polished("a draw that never reaches the metric has no gradient")
    names = [f.name for f in search.frees]
    try:
        slopes = Slopes(search.rolls.world, names)
        off = _guard(search, slopes)
    except (BadInput, RunFailed) as error:
        return Polished(str(error))
    if not off <= AGREES:
        return Polished("", off)
    start = search.best.score.mean()
    tried: list[Candidate] = [search.best]

    def fun(share: np.ndarray) -> tuple[float, np.ndarray]:
        made = search.candidate(np.clip(share, 0.0, 1.0))
        if made is None:
            raise StopIteration
        search.extend([made], search.samples)
        tried.append(made)
        if made.score.missed(search.limits) > 0:
            raise StopIteration
        each = [_slope(search, slopes, made.numbers, k) for k in range(search.samples)]
        return made.score.mean(), np.mean(each, axis=0) * search.box.by_share(made.share)

    with suppress(StopIteration, BadInput, RunFailed):  # what was tried before stands
        minimize(fun, search.best.share, jac=True, method="L-BFGS-B",
                 bounds=[(0.0, 1.0)] * len(names), options={"maxiter": STEPS})  # fmt: skip
    for made in tried:
        if not search.behind(made, search.best, final=True) and search.holds(made):
            search.best = made
    search.spent = search.rolls.done
    return Polished("", off, start - search.best.score.mean())


def _slope(search: Search, slopes: Slopes, numbers: Mapping[str, float], k: int) -> np.ndarray:
    found = slopes.of(numbers, search.rolls.draw(TRAINING, k), search.objective.metrics)
    return np.sum([w * found[m] for w, m in search.objective.terms], axis=0)


def _guard(search: Search, slopes: Slopes) -> float:
    """Relative difference of the slope at the best candidate and differences, on the first draw."""
    names: Sequence[str] = [f.name for f in search.frees]
    at = np.array([search.best.numbers[n] for n in names])

    def value(numbers: np.ndarray) -> float:
        given = dict(zip(names, map(float, numbers), strict=True))
        search.thought += 1
        metrics = search.rolls.all(TRAINING, [(search.thought, given, 0)])[0]
        return math.nan if metrics is None else search.objective.value(metrics)

    return slope_error(value, at, _slope(search, slopes, search.best.numbers, 0), search.seed)
