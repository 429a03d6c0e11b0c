"""Gains from an ensemble: proved first, raced draw by draw, searched by differential evolution.

A candidate whose certificates fail is not rolled. A certificate whose proof takes long is asked of
those that would be the best, and who has it not is beaten by every other one.

What is rolled runs on the draws one after the other, the same ones for every candidate. It is given
up as soon as its paired difference from the member that it would replace says so. All that is
decided follows from the seed: the number of cores changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.design.goals import (
    Limit,
    Objective,
    Score,
    paired_difference,
    read_limits,
    read_objective,
    single,
)
from slipctl.design.promises import Promises
from slipctl.design.ranges import Free
from slipctl.design.rolls import Rolls
from slipctl.errors import BadInput, check_known
from slipctl.run.metrics import Metric
from slipctl.seek import population
from slipctl.study.report.texts import with_unit

STAGES = (4, 8, 14)
"""Draws after which a candidate may be given up; then come all of them."""

SURE = 2.0
"""Standard errors by which a candidate has to be behind to be given up."""

RUNS = 250
"""Most runs of a search for each number that is free."""

REDRAWN = 12
"""Trials that are made in place of one that has no certificate."""

TRIED = 200
"""Points at which certificates are asked for, to fill the first population."""

IDLE = 3
"""Generations without a trial after which a search for a machine with a proof has arrived."""

DOUBT = 0.7
"""A candidate is left out where one without a proof is nearer than this share of the way to the
nearest that has one."""

ALIKE = 2e-3
"""Spread of all members, in shares of the ranges, at which a search has arrived."""

TRAINING, HELD_OUT, FIRST_PROOF = 0, 1, 2
"""Streams of draws: of the search, of the judgement, of the first statement."""


@dataclass
class Candidate:
    """A set of numbers and what is known of it.

    Attributes:
        number: in the order in which it was thought of; -1 is the hand-set one.
        numbers: by name. share: the same as a point of the cube. score: so far.
        more: scores of further objectives.
    """

    number: int
    numbers: Mapping[str, float]
    share: np.ndarray
    score: Score = field(default_factory=lambda: Score([], []))
    more: tuple[Score, ...] = ()

    @property
    def scores(self) -> tuple[Score, ...]:
        """Of all objectives."""
        return (self.score, *self.more)


@dataclass
class Search:
    """A search, and how far it is.

    Attributes:
        loop: with its hand-set numbers. frees: what is searched. rolls: what runs candidates.
        objective, limits, promises: what is wanted.
        samples: draws of a candidate. runs: most runs. seed: of the search.
        tell: told a line when there is something to say. others: further objectives.
        by_hand, best: the hand-set candidate, and the best one so far.
        refused: candidates that were not run, by reason. thought: all candidates.
        course: runs, mean of the best and how far it misses its limits, after each generation.
        spent: runs of the search.
        shown: by number of a candidate whether the proofs that take long were found.
    """

    loop: Block
    frees: Sequence[Free]
    rolls: Rolls
    objective: Objective
    limits: Sequence[Limit]
    promises: Promises
    samples: int
    runs: int
    seed: int
    tell: Callable[[str], None] = lambda text: None
    others: Sequence[Objective] = ()
    by_hand: Candidate = field(init=False)
    best: Candidate = field(init=False)
    refused: dict[str, int] = field(default_factory=dict)
    course: list[tuple[int, float, float]] = field(default_factory=list)
    thought: int = 0
    spent: int = 0
    shown: dict[int, bool] = field(default_factory=dict)
    _asked: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.box = population.Box([f.lo for f in self.frees], [f.hi for f in self.frees])
        now = np.array([f.now for f in self.frees])
        share = np.clip(self.box.share(now), 0.0, 1.0)
        self.by_hand = self.made(-1, {f.name: f.now for f in self.frees}, share)
        self.best = self.by_hand

    @property
    def objectives(self) -> tuple[Objective, ...]:
        """All that is made small."""
        return (self.objective, *self.others)

    # ---- candidates ------------------------------------------------------------------------------

    def made(self, number: int, numbers: Mapping[str, float], share: np.ndarray) -> Candidate:
        """Candidate that has not run."""
        more = tuple(Score([], []) for _ in self.others)
        return Candidate(number, numbers, share, more=more)

    def ran(self, c: Candidate, metrics: Mapping[str, Metric] | None) -> None:
        """Add what a draw gave to the scores of a candidate."""
        for score, goal in zip(c.scores, self.objectives, strict=True):
            add(score, metrics, goal, self.limits)

    def behind(self, one: Candidate, other: Candidate, final: bool) -> bool:
        """Whether one candidate is behind another on the draws that both have."""
        return is_behind(one, other, self.limits, final)

    def candidate(self, share: np.ndarray) -> Candidate | None:
        """Candidate at a point of the cube; None where its certificates fail."""
        point = self.box.point(share)
        numbers = {f.name: float(x) for f, x in zip(self.frees, point, strict=True)}
        self.thought += 1
        made = self.made(self.thought, numbers, share)
        why = self._doubt(share) or self.refusal(numbers)
        if why:
            self.refused[why] = self.refused.get(why, 0) + 1
            return None
        return made

    def refusal(self, numbers: Mapping[str, float]) -> str:
        """Why numbers are not rolled, empty where they are."""
        if not self.promises.needed():
            return ""
        try:
            loop = self.loop.with_params(**numbers)
        except BadInput as error:
            return str(error)
        return self.promises.fails(loop)

    def holds(self, c: Candidate) -> bool:
        """Whether the proofs that take long are found of a candidate; asked once."""
        if not self.promises.has_last():
            return True
        if c.number not in self.shown:
            self.tell(f"to be proved: {self._in_words(c)}")
            failed = self.promises.fails_last(self.loop.with_params(**c.numbers))
            self.shown[c.number] = not failed
            self._asked.append(c.share)
        return self.shown[c.number]

    def _doubt(self, share: np.ndarray) -> str:
        """Why a point is not worth a long proof: the nearest ones that were asked have none."""
        if not self._asked:
            return ""
        far = np.linalg.norm(np.array(self._asked) - share, axis=1)
        proved = np.array(list(self.shown.values()))
        best, worst = (np.min(far, where=w, initial=np.inf) for w in (proved, ~proved))
        return "being near to one without a proof" if worst < DOUBT * best else ""

    def failed(self, c: Candidate) -> bool:
        """Whether a proof that takes long was asked of a candidate, and not found."""
        return not self.shown.get(c.number, True)

    @property
    def best_proved(self) -> Candidate:
        """The best one so far of which all is proved; the hand-set one where there is none."""
        asked = self.shown.get(self.best.number, not self.promises.has_last())
        return self.best if asked else self.by_hand

    def extend(self, candidates: Sequence[Candidate], draws: int) -> None:
        """Run candidates on all draws up to this one."""
        asked = [(c.number, c.numbers, k) for c in candidates
                 for k in range(len(c.score.values), draws)]  # fmt: skip
        for (number, _, _), metrics in zip(asked, self.rolls.all(TRAINING, asked), strict=True):
            c = next(c for c in candidates if c.number == number)
            self.ran(c, metrics)

    def race(self, pairs: Sequence[tuple[Candidate, Candidate]]) -> list[bool]:
        """Run each first one of a pair until it is behind the second; whether it got through.

        The second one has to have run on as many draws as it is compared on. Where it was given up
        itself, the first is compared on the draws that it has.
        """
        racing = dict(enumerate(pairs))
        for draws in (*[s for s in STAGES if s < self.samples], self.samples):
            if not racing:
                break
            self.extend([one for one, _ in racing.values()], draws)
            racing = {k: p for k, p in racing.items()
                      if self.failed(p[1])
                      or not self.behind(*p, final=draws == self.samples)}  # fmt: skip
        return [k in racing for k in range(len(pairs))]

    # ---- the search ------------------------------------------------------------------------------

    def run(self) -> Candidate:
        """Search, and give the best one.

        Raises:
            BadInput: what is wanted is met by nothing; says how close it came.
        """
        self._populate(6 + 2 * len(self.frees))
        self._begin()
        generation = 0
        idle = 0  # generations in a row without a trial
        while self.rolls.done < self.runs and self._spread() > ALIKE and generation < 200:
            generation += 1
            idle = 0 if self._generation(generation) else idle + 1
            if idle == IDLE and self.promises.has_last():
                break
        self.spent = self.rolls.done
        self._end()
        return self.best

    def _populate(self, many: int) -> None:
        """First members: the hand-set one, if it may be, and others that are proved.

        Raises:
            BadInput: too few are.
        """
        self.extend([self.by_hand], self.samples)
        inside = all(f.lo <= f.now <= f.hi for f in self.frees)
        fit = inside and not self.refusal(self.by_hand.numbers)
        self.members = [*([self.by_hand] if fit else []), *self._first(many - fit)]
        if len(self.members) < 4:
            raise BadInput(self._unproved())

    def _end(self) -> None:
        """Refuse a best one that misses a limit, or that reaches its objective in no draw.

        Raises:
            BadInput: says how close it came.
        """
        if not self.holds(self.best):
            raise BadInput(self._unproved())
        nothing = any(s.lost() == len(s.values) for s in self.best.scores)
        if self.best.score.missed(self.limits) > 0 or nothing:
            raise BadInput(self._unmet())
        for goal, score in zip(self.objectives, self.best.scores, strict=True):
            if score.lost():
                self.tell(
                    f"{goal.text} is never reached in {score.lost()} of {len(score.values)} draws,"
                    " with the best numbers too; such a draw counts as worst"
                )

    def _first(self, wanted: int) -> list[Candidate]:
        """First members, spread over the ranges, all proved."""
        found: list[Candidate] = []
        for batch in range(TRIED):
            for share in population.first(max(wanted, 4), len(self.frees), self.seed + batch):
                made = self.candidate(share)
                found += [made] if made else []
                if len(found) == wanted or self.thought >= TRIED:
                    return found
        return found

    def _begin(self) -> None:
        """Race the first members against the hand-set one, or against each other."""
        self.best = self.members[0]
        self.extend([self.best], self.samples)
        pairs = [(m, self.best) for m in self.members[1:]]
        self._crown(pairs, self.race(pairs))
        self._say(0)

    def _generation(self, generation: int) -> int:
        """A trial for each member, raced against it; gives how many there were."""
        pairs = self.trials(generation, 1, [self.members.index(self.best)])
        through = self.race(pairs)
        self._crown(pairs, through)
        for (trial, member), better in zip(pairs, through, strict=True):
            if better and not self.failed(trial):
                self.members[self.members.index(member)] = trial
        self._say(generation)
        return len(pairs)

    def trials(
        self, generation: int, kind: int, leads: Sequence[int]
    ) -> list[tuple[Candidate, Candidate]]:
        """A trial for each member that has one which may be run, towards leading ones in turn."""
        shares = np.array([m.share for m in self.members])
        pairs: list[tuple[Candidate, Candidate]] = []
        for i, member in enumerate(self.members):
            lead = leads[(generation + i) % len(leads)]
            for again in range(REDRAWN):
                key = (self.seed, kind, generation, i, again)
                trial = self.candidate(population.trial(shares, lead, i, key))
                if trial:
                    pairs.append((trial, member))
                    break
        return pairs

    def _crown(self, pairs: Sequence[tuple[Candidate, Candidate]], through: Sequence[bool]) -> None:
        """Take the best of those that got through, on all draws; the best ones are proved first."""
        ahead = [trial for (trial, _), better in zip(pairs, through, strict=True) if better]
        if self.promises.has_last():
            ahead.sort(key=lambda c: (c.score.missed(self.limits), c.score.mean()))
        for trial in ahead:
            beaten = self.holds(self.best) and self.behind(trial, self.best, final=True)
            if not beaten and self.holds(trial):
                self.best = trial

    def _spread(self) -> float:
        """Largest distance of the members from each other along a number."""
        shares = np.array([m.share for m in self.members])
        return float(np.ptp(shares, axis=0).max())

    # ---- what is said ----------------------------------------------------------------------------

    def _say(self, generation: int) -> None:
        """Tell the best so far."""
        score = self.best.score
        self.course.append((self.rolls.done, score.mean_reached(), score.missed(self.limits)))
        numbers = self._in_words(self.best)
        missed = "" if score.missed(self.limits) <= 0 else ", limits not met yet"
        hand = f"{self.by_hand.score.in_words()} by hand"
        self.tell(
            f"generation {generation}: {self.rolls.done} runs, {self.objective.text}"
            f" {score.in_words()} ({hand}){missed}, {numbers}"
        )

    def _in_words(self, c: Candidate) -> str:
        """Numbers of a candidate."""
        return ", ".join(f"{f.short} = {with_unit(c.numbers[f.name], f.unit)}" for f in self.frees)

    def _unproved(self) -> str:
        """That nothing is proved, and how close the best certificate came."""
        if self.shown:
            wanted = " and ".join(dict.fromkeys(repr(t) for _, _, t in self.promises.needed()))
            return (f"nothing that was found meets {wanted}: none of the {len(self.shown)} best"
                    f" ones of {self.thought} candidates is proved")  # fmt: skip
        text = max(self.refused, key=lambda k: self.refused[k], default="")
        close = ""
        for gains, margin, wanted in self.promises.needed():
            if wanted != text or self.promises.has_last():
                continue
            found, at = -1.0, self.by_hand.numbers
            for share in population.first(16, len(self.frees), self.seed):
                point = self.box.point(share)
                numbers = {f.name: float(x) for f, x in zip(self.frees, point, strict=True)}
                reached = self.promises.margin(gains, self.loop.with_params(**numbers))
                if reached > found:
                    found, at = reached, numbers
            where = ", ".join(f"{f.short}={at[f.name]:.4g}" for f in self.frees)
            close = (
                f"; the closest, {where}, is proved up to {found:.3g} times the bounds"
                if found > 0
                else "; no candidate is proved at all"
            ) + (f", {margin:g} are wanted" if found > 0 else "")
        return f"nothing in the ranges meets {text!r} ({self.thought} candidates){close}"

    def _unmet(self) -> str:
        """Which limit is not met, and how close the best candidate came."""
        score = self.best.score
        where = ", ".join(f"{f.short}={self.best.numbers[f.name]:.4g}" for f in self.frees)
        for k, limit in enumerate(self.limits):
            overs = [row[k] for row in score.overs]
            if limit.missed(overs) > 0:
                by = limit.missed(overs) * (abs(limit.value) or 1.0)
                came = limit.value + by if limit.upper else limit.value - by
                return (
                    f"nothing in the ranges meets {limit.text!r}: the closest, {where}, comes to"
                    f" {with_unit(came, limit.unit)}"
                )
        wanted = " and ".join(goal.text for goal in self.objectives)
        return f"no candidate has a finite {wanted}; its runs fail or never end"


def add(
    score: Score, metrics: Mapping[str, Metric] | None, objective: Objective,
    limits: Sequence[Limit],
) -> None:  # fmt: skip
    """Add what a draw gave; a run that broke, or has no such metric, is beyond everything."""
    if metrics is None or any(m not in metrics for m in objective.metrics):
        score.values.append(math.inf)
    else:
        score.values.append(objective.value(metrics))
    score.overs.append([
        limit.over(metrics) if metrics is not None and limit.metric in metrics else math.inf
        for limit in limits
    ])  # fmt: skip


def is_behind(
    one: Candidate, other: Candidate, limits: Sequence[Limit], final: bool = False
) -> bool:
    """Whether one candidate is behind another on the draws that both have.

    Limits come first: who misses them by more is behind, at any number of draws. Then the
    objective: at the end whose mean is larger, before that whose paired mean is larger by
    :data:`SURE` standard errors.
    """
    draws = min(len(one.score.values), len(other.score.values))
    a, b = (c.score.missed(limits, draws, final) for c in (one, other))
    if a != b:
        return a > b and (final or b <= 0)
    mean, error = paired_difference(one.score.values[:draws], other.score.values[:draws])
    if final:
        return not mean < 0
    return mean > SURE * error or mean == math.inf


# ---- what a person may ask ----------------------------------------------------------------------


def goals_of_loop(
    objective: str | Sequence[str], subject_to: Sequence[str], there: Mapping[str, Metric],
    name: str, certificates: Sequence[str],
) -> tuple[list[Objective], list[Limit], list[Any]]:  # fmt: skip
    """Objectives and constraints of a loop that has these metrics.

    Raises:
        BadInput: a metric or certificate that the loop has not, an objective twice.
    """
    texts = [objective] if isinstance(objective, str) else list(objective)
    goals = [read_objective(text) for text in texts or [""]]
    for goal in goals:
        for metric in goal.metrics:
            check_known(f"{name} has no metric", metric, there, " to minimise")
            if math.isnan(single(there[metric])):
                raise BadInput(f"{name}: {metric} has no number")
        if sum(g.terms == goal.terms for g in goals) > 1:
            raise BadInput(f"--minimise names {goal.text!r} twice; write it once")
    limits, proved = read_limits(subject_to, there, certificates, name)
    return goals, limits, proved
