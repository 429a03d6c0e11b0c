"""What tuned numbers are worth: beside the hand-set ones on draws of their own, and one by one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slipctl.design.gain_search import HELD_OUT, Candidate, Search
from slipctl.design.goals import Limit, Score, paired_difference
from slipctl.design.ranges import Free

POINTS = 9
"""Points of a slice along the range of a number, both ends included."""

DRAWS = 10
"""Draws of the search on which a slice is taken."""

CLOSE = 0.01
"""Share of the objective within which it counts as kept."""

NUDGE = 0.1
"""Share by which a number is moved to see how the objective answers."""


@dataclass(frozen=True)
class Judged:
    """Tuned and hand-set numbers on the same held-out draws.

    Attributes:
        tuned, by_hand: what both gave. difference: mean of the paired differences of the objective,
            tuned minus hand-set. error: its standard error. more: of further objectives.
    """

    tuned: Score
    by_hand: Score
    difference: float
    error: float
    more: tuple[Judged, ...] = ()

    @property
    def each(self) -> tuple[Judged, ...]:
        """Of all objectives."""
        return (self, *self.more)

    def kept(self, limits: Sequence[Limit]) -> list[tuple[Limit, int, int]]:
        """Each limit with the draws in which the tuned and the hand-set numbers keep it."""
        found = []
        for k, limit in enumerate(limits):
            tuned, by_hand = (sum(r[k] <= 0 for r in s.overs) for s in (self.tuned, self.by_hand))
            found.append((limit, tuned, by_hand))
        return found


@dataclass(frozen=True)
class Slice:
    """The objective along one number, the others as tuned.

    Attributes:
        objective: what is kept, in words. free: the number. values: along its range.
        means: of the objective, NaN where nothing is proved or a limit is missed.
        at: mean of the tuned numbers on the same draws.
        lo, hi: range about the tuned number in which the objective stays within :data:`CLOSE`.
        answer: change of the objective in percent for one percent more of the number; NaN where
            neither neighbour has one.
    """

    objective: str
    free: Free
    values: Sequence[float]
    means: Sequence[float]
    at: float
    lo: float
    hi: float
    answer: float


def judge(search: Search, draws: int) -> Judged:
    """Both sets of numbers on draws that the search has not seen."""
    both = []
    for c in (search.best, search.by_hand):
        both.append(search.made(c.number, c.numbers, c.share))
        asked = [(c.number, c.numbers, k) for k in range(draws)]
        for metrics in search.rolls.all(HELD_OUT, asked):
            search.ran(both[-1], metrics)
    found = []
    for tuned, by_hand in zip(*(c.scores for c in both), strict=True):
        difference, error = paired_difference(tuned.values, by_hand.values)
        if search.best is search.by_hand:
            difference, error = 0.0, 0.0
        found.append(Judged(tuned, by_hand, difference, error))
    return replace(found[0], more=tuple(found[1:]))


def slices(search: Search) -> list[Slice]:
    """Each objective along each number; none where the tuned numbers lose a draw."""
    if any(score.lost() for score in search.best.scores):
        return []
    draws = min(DRAWS, search.samples)
    asked: list[tuple[int, Candidate | None]] = []
    for k, free in enumerate(search.frees):
        here = search.best.numbers[free.name]
        values = [*_along(search, k), *(x for x in (here * (1 - NUDGE), here * (1 + NUDGE)))]
        asked += [(k, _at(search, free, x)) for x in values]
    search.extend([c for _, c in asked if c is not None], draws)
    found = []
    for i, goal in enumerate(search.objectives):
        at = search.best.scores[i].mean(draws)
        for k, free in enumerate(search.frees):
            means = [_mean(c, i, search.limits) for which, c in asked if which == k]
            values = [*_along(search, k)]
            lo, hi = _close(free, values, means[:-2], search.best.numbers[free.name], at)
            answer = _answer(means[-2], means[-1], at)
            found.append(Slice(goal.text, free, values, means[:-2], at, lo, hi, answer))
    return found


def runs_of_slices(search: Search) -> int:
    """Most runs that :func:`slices` makes."""
    return len(search.frees) * (POINTS + 2) * min(DRAWS, search.samples)


def _answer(down: float, up: float, at: float) -> float:
    """Relative change of the objective by that of a number; at an end of its range to one side."""
    if math.isnan(up) or math.isnan(down):
        change = (at - down) / NUDGE if math.isnan(up) else (up - at) / NUDGE
    else:
        change = (up - down) / (2 * NUDGE)
    return change / abs(at) if at else math.nan


def _along(search: Search, k: int) -> list[float]:
    """Values along the range of a number, evenly in the search's own scale."""
    shares = np.tile(search.best.share, (POINTS, 1))
    shares[:, k] = np.linspace(0, 1, POINTS)
    return [float(search.box.point(s)[k]) for s in shares]


def _at(search: Search, free: Free, value: float) -> Candidate | None:
    """The tuned numbers with one of them changed; None where nothing is proved."""
    search.thought += 1
    numbers: Mapping[str, float] = {**search.best.numbers, free.name: value}
    if not free.lo <= value <= free.hi or search.refusal(numbers):
        return None
    return search.made(search.thought, numbers, search.best.share)


def _mean(c: Candidate | None, objective: int, limits: Sequence[Limit]) -> float:
    if c is None or c.score.missed(limits) > 0:
        return math.nan
    return c.scores[objective].mean()


def _close(
    free: Free, values: Sequence[float], means: Sequence[float], here: float, at: float
) -> tuple[float, float]:
    """Range about the tuned number in which the objective is kept, linear between the points."""
    allowed = CLOSE * abs(at)
    others = [(x, y) for x, y in zip(values, means, strict=True) if x != here]
    points = sorted([(here, at), *others])
    middle = points.index((here, at))

    def end(way: int) -> float:
        x, y = here, at
        k = middle + way
        while 0 <= k < len(points):
            x1, y1 = points[k]
            if math.isnan(y1):
                return x
            if y1 > at + allowed:
                return x + (x1 - x) * (at + allowed - y) / (y1 - y)
            x, y, k = x1, y1, k + way
        return x

    return end(-1), end(1)
