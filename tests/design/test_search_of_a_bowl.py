"""The searches themselves, on metrics with a known best: a bowl, which each draw lifts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl.design.fronts import FrontSearch, better
from slipctl.design.gain_search import IDLE, STAGES, Search
from slipctl.design.goals import Limit, Objective
from slipctl.design.ranges import Free
from slipctl.errors import BadInput
from slipctl.run.metrics import Metric

FREES = [Free("ctl.a", "a", 1.0, 3.0, "1", 2.9), Free("ctl.b", "b", 10.0, 30.0, "N m", 29.0)]
FAR, LEVEL = Objective("far", ((1.0, "far"),)), Objective("level", ((1.0, "level"),))
DRAWS = np.random.default_rng(3).uniform(-1, 1, (40, 3))


class Rolls:
    """What ``slipctl.design.rolls.Rolls`` gives, from a formula; each draw lifts all alike."""

    def __init__(self, best: tuple[float, float], broken: float = math.inf) -> None:
        self.best, self.broken, self.done, self.seen = best, broken, 0, list[tuple[int, int]]()

    def all(self, stream: int, asked: Sequence[tuple[int, Mapping[str, float], int]]) -> list[Any]:
        if stream == 0:
            self.done += len(asked)
            self.seen += [(number, k) for number, _, k in asked]
        return [self.metrics(numbers, k + 20 * stream) for _, numbers, k in asked]

    def metrics(self, numbers: Mapping[str, float], k: int) -> dict[str, Metric] | None:
        a, b = numbers["ctl.a"], numbers["ctl.b"]
        if a > self.broken:
            return None
        far = (a - self.best[0]) ** 2 + ((b - self.best[1]) / 10) ** 2 + 5 + DRAWS[k, 0]
        return {"far": Metric(far, "m"), "level": Metric(b, "N m"), "a": Metric(a, "1")}


def searched(kind: type[Search] = Search, fails: Any = None, **more: Any) -> tuple[Search, Rolls]:
    rolls = Rolls(more.pop("best", (1.6, 14.0)), more.pop("broken", math.inf))
    told: list[str] = []
    late = more.pop("late", None)
    asked = [("stable", 1.0, "stable holds")] if fails or late else []
    promises = SimpleNamespace(
        needed=lambda: asked,
        fails=fails or (lambda numbers: ""),
        has_last=lambda: late is not None,
        fails_last=late,
        margin=lambda gains, numbers: 1 / numbers["ctl.a"],
    )
    made: dict[str, Any] = dict(
        loop=SimpleNamespace(with_params=lambda **numbers: numbers), frees=FREES, rolls=rolls,
        objective=FAR, limits=[], promises=promises, samples=16, runs=4000, seed=1,
        tell=told.append,
    )  # fmt: skip
    search = kind(**(made | more))
    search.said = told  # type: ignore[attr-defined]
    return search, rolls


@pytest.mark.parametrize("best", [(1.6, 14.0), (2.5, 28.0)])
def test_the_bottom_of_a_bowl_is_found_and_the_way_is_taken_down(best):
    search, rolls = searched(best=best)
    found = search.run()
    assert found is search.best
    assert [found.numbers[f.name] for f in FREES] == pytest.approx(best, rel=0.01)
    assert found.score.values == pytest.approx(
        [rolls.metrics(found.numbers, k)["far"].value for k in range(16)]
    )
    assert search.by_hand.score.mean() > found.score.mean()
    runs, means, missed = (list(column) for column in zip(*search.course, strict=True))
    assert runs == sorted(runs)
    assert runs[-1] == search.spent == rolls.done < search.runs
    assert all(b <= a + 1e-12 for a, b in pairwise(means))
    assert set(missed) == {0}
    assert len(search.said) == len(runs)
    assert "far 5." in search.said[-1]
    assert search.said[-1].startswith(f"generation {len(runs) - 1}: {rolls.done} runs")


def test_nobody_runs_on_a_draw_twice_and_the_worse_end_early():
    """A trial that is behind stops at a stage; all that went on have the draws before."""
    search, rolls = searched()
    search.run()
    assert len(set(rolls.seen)) == len(rolls.seen)
    many = {n: sorted(k for m, k in rolls.seen if m == n) for n, _ in rolls.seen}
    assert {len(draws) for draws in many.values()} <= {*STAGES, 16}
    assert {4, 16} <= {len(draws) for draws in many.values()}
    assert all(draws == list(range(len(draws))) for draws in many.values())


def test_the_same_seed_is_the_same_search_and_another_ends_there_too():
    one, again, other = (searched(seed=s)[0] for s in (1, 1, 2))
    numbers = [search.run().numbers for search in (one, again, other)]
    assert numbers[0] == numbers[1] != numbers[2]
    assert one.course == again.course
    assert list(numbers[2].values()) == pytest.approx([1.6, 14.0], rel=0.01)


def test_a_search_ends_where_its_runs_are_used_up():
    search, rolls = searched(runs=200)
    search.run()
    assert 200 <= rolls.done <= 200 + 10 * 16  # the generation that came to it


@pytest.mark.parametrize("upper", [True, False])
def test_the_best_stands_at_a_limit_that_keeps_it_off_the_bottom(upper):
    """b <= 12, or b >= 20, and the bottom is at 14."""
    limit = Limit("level", "level", upper, 12.0 if upper else 20.0, "N m")
    found = searched(limits=[limit])[0].run()
    assert found.numbers["ctl.b"] == pytest.approx(limit.value, rel=0.01)
    assert (found.numbers["ctl.b"] <= 12.0) is upper
    assert found.numbers["ctl.a"] == pytest.approx(1.6, rel=0.02)


@pytest.mark.parametrize(("upper", "value"), [(True, 5.0), (False, 60.0), (True, 0.0)])
def test_a_limit_that_nothing_meets_is_refused_with_the_closest(upper, value):
    """b is from 10 to 30."""
    limit = Limit("level told", "level", upper, value, "N m")
    with pytest.raises(BadInput, match="nothing in the ranges meets 'level told'") as told:
        searched(limits=[limit], runs=2000)[0].run()
    came = float(str(told.value).rsplit("comes to ", 1)[1].split()[0])
    assert came == pytest.approx(10.0 if upper else 30.0, rel=0.02)


def test_what_has_no_certificate_never_runs_and_is_counted():
    """Of a > 1.4 nothing is proved: the best is at that edge, and the hand-set 2.9 is no member."""
    search, rolls = searched(fails=lambda n: "stable" * (n["ctl.a"] > 1.4))
    found = search.run()
    assert found.numbers["ctl.a"] == pytest.approx(1.4, rel=0.01)
    assert found.numbers["ctl.a"] <= 1.4
    assert search.refused == {"stable": search.thought - len({n for n, _ in rolls.seen if n > 0})}
    assert all(m.numbers["ctl.a"] <= 1.4 for m in search.members)


def test_ranges_without_a_certificate_are_refused_with_the_closest():
    """Margins are 1/a: the closest is near the lower end, where they come to 1."""
    with pytest.raises(BadInput, match=r"nothing in the ranges meets 'stable holds'") as told:
        searched(fails=lambda n: "stable holds")[0].run()
    said = str(told.value)
    assert "(200 candidates)" in said
    assert float(said.split("proved up to ")[1].split()[0]) == pytest.approx(1.0, abs=0.15)
    assert said.endswith(", 1 are wanted")


def test_the_closest_is_that_of_the_promise_that_was_not_kept():
    """Of several that are asked, whichever stands first; the other is kept by all."""
    others, stable = ("other", 1.0, "other holds"), ("stable", 1.0, "stable holds")
    for asked in ([others, stable], [stable, others]):
        search, _ = searched(fails=lambda n: "stable holds")
        search.promises.needed = lambda asked=asked: asked
        search.promises.margin = lambda gains, n: {"other": 9.0, "stable": 0.5}[gains]
        with pytest.raises(BadInput, match=r"is proved up to 0\.5 times the bounds, 1 are wanted"):
            search.run()


@pytest.mark.parametrize(("now", "share"), [((0.5, 40.0), (0, 1)), ((3.5, 10.0), (1, 0))])
def test_numbers_set_by_hand_beyond_their_range_stand_at_its_end(now, share):
    """As a place of a search; they run as they are."""
    frees = [replace(f, now=v) for f, v in zip(FREES, now, strict=True)]
    search, _ = searched(frees=frees)
    assert list(search.by_hand.share) == list(share)
    assert tuple(search.by_hand.numbers.values()) == now


@pytest.mark.parametrize("kind", [Search, FrontSearch])
def test_each_member_has_at_most_one_trial_a_generation(kind, monkeypatch):
    """One that has no certificate is drawn again, one that has is not."""
    more = {"others": [LEVEL]} if kind is FrontSearch else {}
    search, _ = searched(kind, runs=600, fails=lambda n: "no" * (n["ctl.a"] > 2.95), **more)
    raced, race = [], search.race
    monkeypatch.setattr(search, "race", lambda pairs: raced.append(pairs) or race(pairs))
    search.run()
    several = [[id(member) for _, member in pairs] for pairs in raced[1:]]
    assert any(len(members) > 3 for members in several)
    assert all(len(set(members)) == len(members) for members in several)


@pytest.mark.parametrize("late", [True, False])
def test_a_search_without_trials_ends_where_its_proofs_take_long(late, monkeypatch):
    search, _ = searched(late=Late(0.0) if late else None)
    asked = []
    monkeypatch.setattr(search, "_generation", lambda generation: asked.append(generation) or 0)
    search.run()
    assert len(asked) == (IDLE if late else 200)


def test_a_run_that_breaks_counts_as_worst_and_breaks_nothing():
    """Of a > 1.5 each run breaks; the bottom is at 1.6."""
    found = searched(broken=1.5)[0].run()
    assert found.numbers["ctl.a"] == pytest.approx(1.5, rel=0.01)
    assert found.numbers["ctl.a"] <= 1.5
    with pytest.raises(BadInput, match="no candidate has a finite far"):
        searched(broken=0.0, runs=300)[0].run()


@pytest.fixture(scope="module")
def front() -> tuple[FrontSearch, Rolls]:
    search, rolls = searched(FrontSearch, others=[LEVEL], runs=3000)
    search.run()
    assert isinstance(search, FrontSearch)
    return search, rolls


def test_the_front_of_a_bowl_and_a_slope_is_the_line_between_their_best(front):
    """Small b is wanted, and the bottom at b = 14: the front is a = 1.6, b from 10 to 14."""
    search, _ = front
    places = [tuple(s.mean() for s in c.scores) for c in search.front]
    assert len(places) >= 8
    assert not any(better(p, q) for p in places for q in places)
    assert places == sorted(places)
    b = [c.numbers["ctl.b"] for c in search.front]
    assert (min(b), max(b)) == (pytest.approx(10.0, abs=0.2), pytest.approx(14.0, abs=0.3))
    for c in search.front:
        assert c.numbers["ctl.a"] == pytest.approx(1.6, abs=0.15)
        assert len(c.score.values) == 16


def test_the_knee_loses_least_of_both(front):
    """Losses x and (1 - x)^2 in shares of the line are equal at x = (3 - sqrt 5)/2 = 0.382."""
    search, _ = front
    share = (search.best.numbers["ctl.b"] - 10) / 4
    assert search.best in search.front
    assert share == pytest.approx(0.382, abs=0.08)


def test_a_front_keeps_to_its_limits_and_says_what_it_did(front):
    search, rolls = front
    assert search.spent == rolls.done == search.course[-1][0]
    assert len(search.said) == len(search.course)
    assert "points, far " in search.said[-1]
    assert "; knee a = " in search.said[-1]
    limited, _ = searched(FrontSearch, others=[LEVEL], runs=1500,
                          limits=[Limit("level", "level", False, 12.0, "N m")])  # fmt: skip
    limited.run()
    assert min(c.numbers["ctl.b"] for c in limited.front) >= 12.0
    with pytest.raises(BadInput, match="nothing in the ranges meets 'level'"):
        searched(FrontSearch, others=[LEVEL], runs=400,
                 limits=[Limit("level", "level", False, 40.0, "N m")])[0].run()  # fmt: skip


# ---- what takes long to prove --------------------------------------------------------------------


class Late:
    """A proof that takes long: there is none below a = 2."""

    def __init__(self, least: float = 2.0) -> None:
        self.least, self.asked = least, list[tuple[float, ...]]()

    def __call__(self, numbers: Mapping[str, float]) -> str:
        self.asked.append(tuple(numbers.values()))
        return "" if numbers["ctl.a"] >= self.least else "stable holds"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_best_of_what_is_proved_is_found_with_few_proofs(seed):
    """The bottom, at a = 1.6, has no proof: the best stands at a = 2, and b as without."""
    late = Late()
    search, _ = searched(late=late, seed=seed)
    found = search.run()
    assert [found.numbers[f.name] for f in FREES] == pytest.approx([2.0, 14.0], rel=0.03)
    assert found.numbers["ctl.a"] >= 2
    assert search.best_proved is found
    assert len(set(late.asked)) == len(late.asked) < search.thought / 5


def test_where_nothing_is_proved_that_is_told():
    late = Late(least=4.0)
    search, _ = searched(late=late, runs=600)
    with pytest.raises(BadInput, match=r"'stable holds'.*best ones of \d+ candidates is proved"):
        search.run()
    assert search.best_proved is search.by_hand


def test_the_whole_front_is_proved():
    late = Late()
    search, _ = searched(FrontSearch, late=late, objective=FAR, others=[LEVEL], runs=2000)
    search.run()
    assert min(c.numbers["ctl.a"] for c in search.front) >= 2  # type: ignore[attr-defined]
    assert len(search.front) > 5  # type: ignore[attr-defined]
    assert len(set(late.asked)) == len(late.asked)
