"""Several objectives at once: candidates of which none is better in all, and the knee among them.

Candidates are made, proved and run as in ``tuning``. A trial is given up when it is surely behind
its member in every objective; members are thinned by their rank and by how crowded they stand
(K. Deb et al., IEEE Trans. Evol. Comput. 6 (2002) 182-197; after GDE3 of Kukkonen and Lampinen).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from slipctl.design.gain_search import SURE, Candidate, Search
from slipctl.design.goals import paired_difference

QUIET = 12
"""Generations without a new point of the front after which a search has arrived."""

MOST = 200
"""Most generations."""


@dataclass
class FrontSearch(Search):
    """A search for the front of several objectives; its best one is the knee.

    Attributes:
        front: candidates that ran on all draws, keep the limits, and of which none is better in
            all objectives; in the order of the first objective.
    """

    front: list[Candidate] = field(default_factory=list)

    def run(self) -> Candidate:
        """Search, and give the knee.

        Raises:
            BadInput: what is wanted is met by nothing; says how close it came.
        """
        many = 4 * (len(self.frees) + len(self.objectives))
        self._populate(many)
        self.best = self.members[0]
        self.extend(self.members, self.samples)
        self._take(self.members)
        self._say(0)
        quiet = generation = 0
        while self.rolls.done < self.runs and quiet < QUIET and generation < MOST:
            generation += 1
            through = self._trials(generation)
            before = {c.number for c in self.front}
            self.members = self._thinned([*self.members, *through], many)
            self._take(through)
            quiet = 0 if {c.number for c in self.front} - before else quiet + 1
            self._say(generation)
        self.spent = self.rolls.done
        self._end()
        return self.best

    def behind(self, one: Candidate, other: Candidate, final: bool) -> bool:
        """Whether one candidate misses limits by more, or is behind in every objective."""
        draws = min(len(one.score.values), len(other.score.values))
        a, b = (c.score.missed(self.limits, draws, final) for c in (one, other))
        if a != b:
            return a > b and (final or b <= 0)
        for mine, its in zip(one.scores, other.scores, strict=True):
            mean, error = paired_difference(mine.values[:draws], its.values[:draws])
            if not (mean > (0.0 if final else SURE * error) or mean == math.inf):
                return False
        return True

    def _trials(self, generation: int) -> list[Candidate]:
        """Trials towards points of the front that got through."""
        ahead = [k for k, m in enumerate(self.members) if m in self.front] or [0]
        pairs = self.trials(generation, 2, ahead)
        through = self.race(pairs)
        return [trial for (trial, _), kept in zip(pairs, through, strict=True) if kept]

    def _take(self, candidates: Sequence[Candidate]) -> None:
        """Add candidates to the front, and take its knee as the best one."""
        pool = {c.number: c for c in (*self.front, *candidates)}
        proved = False
        while not proved:  # who has no proof is left out, and others come to the front
            kept = [c for c in pool.values() if self._place(c)[0] <= 0]
            places = [self._place(c)[1] for c in kept]
            self.front = sorted(
                (c for c, p in zip(kept, places, strict=True)
                 if not any(better(q, p) for q in places)),
                key=lambda c: c.score.mean(),
            )  # fmt: skip
            proved = all(self.holds(c) for c in self.front)
        if self.front:
            self.best = self.front[knee([self._place(c)[1] for c in self.front])]
        else:
            self.best = min(pool.values(), key=lambda c: self._place(c)[0])

    def _place(self, c: Candidate) -> tuple[float, tuple[float, ...]]:
        """How far a candidate misses its limits, and its means; a draw that it loses is a miss."""
        lost = math.inf if self.failed(c) else max(s.lost() for s in c.scores)
        return c.score.missed(self.limits) + lost, tuple(s.mean_reached() for s in c.scores)

    def _thinned(self, pool: Sequence[Candidate], many: int) -> list[Candidate]:
        """The best of a pool: by what they miss, then rank by rank, the last rank by crowding."""
        left = {c.number: c for c in pool}
        places = {n: self._place(c) for n, c in left.items()}
        found: list[Candidate] = []
        while len(found) < many and left:
            first = [n for n in left
                     if not any(_ahead(places[m], places[n]) for m in left)]  # fmt: skip
            apart = crowding_distance([places[n][1] for n in first])
            ranked = sorted(zip(first, apart, strict=True), key=lambda p: (-p[1], p[0]))
            found += [left.pop(n) for n, _ in ranked][: many - len(found)]
        return found

    def _say(self, generation: int) -> None:
        self.course.append((self.rolls.done, self.best.score.mean(), self._place(self.best)[0]))
        spans = []
        for k, goal in enumerate(self.objectives):
            means = [c.scores[k].mean() for c in self.front]
            if means:
                spans.append(f"{goal.text} {min(means):.6g} to {max(means):.6g}")
        self.tell(
            f"generation {generation}: {self.rolls.done} runs, {len(self.front)} points,"
            f" {', '.join(spans) or 'limits not met yet'}; knee {self._in_words(self.best)}"
        )


def better(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether one is nowhere worse than the other, and somewhere better."""
    pairs = list(zip(one, other, strict=True))
    return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)


def _ahead(one: tuple[float, Sequence[float]], other: tuple[float, Sequence[float]]) -> bool:
    return one[0] < other[0] if one[0] != other[0] else better(one[1], other[1])


def knee(front: Sequence[Sequence[float]]) -> int:
    """Point of a front whose largest loss is least.

    A loss is counted from the least value of the objective, in shares of its span on the front.
    """
    values = np.asarray(front, dtype=float)
    span = np.ptp(values, axis=0)
    lost = (values - values.min(axis=0)) / np.where(span > 0, span, 1.0)
    return int(np.lexsort((lost.sum(axis=1), lost.max(axis=1)))[0])


def crowding_distance(places: Sequence[Sequence[float]]) -> list[float]:
    """Sum over objectives of the distance between the neighbours of each; infinite at the ends."""
    values = np.asarray(places, dtype=float)
    total = np.zeros(len(values))
    for column in values.T:
        order = np.argsort(column, kind="stable")
        sorted_ = column[order]
        with np.errstate(invalid="ignore"):
            span = sorted_[-1] - sorted_[0]
            inner = (sorted_[2:] - sorted_[:-2]) / span if span > 0 else np.zeros(len(values[2:]))
        total[order[[0, -1]]] = math.inf
        total[order[1:-1]] += np.nan_to_num(inner)
    return [float(t) for t in total]
