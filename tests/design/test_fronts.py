"""Several objectives: no point of the front is beaten, the knee is what it says, files hold it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_tune import tuned

from slipctl import BadInput
from slipctl.commands.cli import main
from slipctl.design import fronts, gain_files, page
from slipctl.design.fronts import FrontSearch
from slipctl.design.gain_search import Candidate
from slipctl.design.goals import Limit, Score
from slipctl.design.rolls import Rolls
from slipctl.design.tune import Tuned

BOTH = ["slip_error_rms", "torque_ripple"]

places = st.lists(
    st.tuples(st.integers(0, 6), st.integers(0, 6), st.integers(0, 3)), min_size=1, max_size=15
)


@given(places)
def test_the_front_is_what_nothing_beats(found: Sequence[tuple[int, int, int]]) -> None:
    """By definition, point by point; one that misses its limit by more is never on it."""
    search = object.__new__(FrontSearch)
    search.limits, search.front = [Limit("", "a", True, 1.0, "1")], []
    search.shown, search.promises = {}, SimpleNamespace(has_last=lambda: False)
    given_ = [
        Candidate(n, {}, np.zeros(1), Score([float(a)] * 2, [[float(miss > 2)]] * 2),
                  (Score([float(b)] * 2, []),)) for n, (a, b, miss) in enumerate(found)
    ]  # fmt: skip
    half = len(given_) // 2
    search._take(given_[:half] or given_)
    search._take(given_[half:])
    free = [(a, b) for a, b, miss in found if miss <= 2]
    wanted = [
        n for n, (a, b, miss) in enumerate(found)
        if miss <= 2 and not any((c <= a and d <= b) and (c, d) != (a, b) for c, d in free)
    ]  # fmt: skip
    assert sorted(c.number for c in search.front) == wanted
    if not wanted:
        return
    chosen = found[search.best.number]
    ends = [[f(found[n][i] for n in wanted) for f in (min, max)] for i in (0, 1)]

    def loss(p: Sequence[int]) -> float:
        return max((p[i] - lo) / (hi - lo) if hi > lo else 0.0 for i, (lo, hi) in enumerate(ends))

    assert loss(chosen) == pytest.approx(min(loss(found[n]) for n in wanted))


@pytest.mark.parametrize("order", list(permutations(range(5))))
def test_members_are_the_same_in_whatever_order_a_pool_stands(order: Sequence[int]) -> None:
    """Of those that stand apart alike the first one."""
    search = object.__new__(FrontSearch)
    search.limits, search.shown = [], {}
    search.promises = SimpleNamespace(has_last=lambda: False)  # type: ignore[assignment]
    line = [Candidate(n, {}, np.zeros(1), Score([float(n)], []), (Score([4.0 - n], []),))
            for n in range(5)]  # fmt: skip
    found = search._thinned([line[k] for k in order], 4)
    assert [c.number for c in found] == [0, 4, 1, 2]


def test_members_keep_both_ends_and_stand_apart() -> None:
    """Of points on a line the two ends stay; who has near neighbours goes first."""
    apart = fronts.crowding_distance([(0.0, 9.0), (1.0, 8.0), (2.0, 7.0), (6.0, 3.0), (9.0, 0.0)])
    assert apart[0] == apart[4] == np.inf
    assert apart[1:4] == pytest.approx([2 * 2 / 9, 2 * 5 / 9, 2 * 7 / 9])
    assert fronts.crowding_distance([(1.0, 1.0)]) == [np.inf]
    level = fronts.crowding_distance([(1.0, 0.0), (1.0, 1.0), (1.0, 4.0), (1.0, 8.0)])
    assert level == pytest.approx([np.inf, 4 / 8, 7 / 8, np.inf])  # the first is the same for all


@pytest.mark.long
def test_no_point_of_a_grid_beats_the_front(tmp_path: Path) -> None:
    """One gain: of 40 grid points none beats one of the front in both by 2 %; same on any cores."""
    found = tuned(objective=BOTH, runs=160)
    search = found.search
    assert isinstance(search, FrontSearch)
    assert len(found.front) >= 5
    assert search.best in found.front
    rolls = Rolls(search.rolls.world)
    for n, k1 in enumerate(np.geomspace(1, 60, 40)):
        ran = rolls.all(0, [(n, {"ctl.law.k1": float(k1)}, k) for k in range(search.samples)])
        grid = [np.mean([m[o].value for m in ran if m]) for o in BOTH]
        for c in found.front:
            means = [s.mean() for s in c.scores]
            assert any(g > 0.98 * m for g, m in zip(grid, means, strict=True))
    judged = found.judged
    assert judged is not None
    assert [len(j.tuned.values) for j in judged.each] == [4, 4]
    assert judged.each[1].difference == pytest.approx(
        np.mean(np.subtract(judged.each[1].tuned.values, judged.each[1].by_hand.values))
    )
    assert tuned(objective=BOTH, runs=160, jobs=1).gains == found.gains
    text = gain_files.gains_text(found, "")
    assert "# The knee of the front" in text
    assert text.count("stays within 1 %") == 2
    rows = page.front_rows(found)
    assert sum("knee" in row[0] for row in rows) == 1


@pytest.mark.second
def test_the_command_writes_the_front(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                      monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """Picture and data; ``gains.toml`` holds the point that ``front.json`` calls the knee."""
    asked: list[object] = []

    def quick(*given: Any, **more: Any) -> Tuned:
        asked.extend(given[2])
        return tuned(objective=BOTH, runs=48)

    monkeypatch.setattr("slipctl.commands.tune.tune", quick)  # of a loop that runs at once
    monkeypatch.setattr(page, "page", lambda found, command: "")  # drawing takes its time
    line = ["tune", "subway_braking:sta@base", "--free", "k1=15:30", "--minimise", "distance",
            "torque_ripple", "--out", str(tmp_path)]  # fmt: skip
    assert main(line) == 0
    assert asked == ["distance", "torque_ripple"]
    said = capsys.readouterr().out
    assert all(f"mean {m} of 4 held-out draws" in said for m in BOTH)
    data = json.loads((tmp_path / "front.json").read_text())
    k1 = data["knee"]["gains"]["ctl.law.k1"]
    assert f'"ctl.law.k1" = "{k1!r} ' in (tmp_path / "gains.toml").read_text()
    assert data["knee"] in data["front"]
    assert set(data["knee"]["means"]) == set(BOTH)
    assert (tmp_path / "front.svg").stat().st_size > 1000


@pytest.mark.parametrize(("objective", "said"), [
    (["slip_error_rms", "funnel_exits"], "has no metric 'funnel_exits' to minimise"),
    (["slip_error_rms", "1*slip_error_rms"], "twice; write it once"),
    ([], "--minimise names no metric"),
])  # fmt: skip
def test_objectives_that_are_none(objective: list[str], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        tuned(objective=objective, runs=12)


@given(st.lists(st.tuples(st.floats(0, 9), st.floats(0, 9)), max_size=5))
def test_each_generation_is_told_with_its_ends_and_taken_down(found):
    """Least and largest mean of each objective on the front; limits that nothing meets are told."""
    search, said = object.__new__(FrontSearch), []
    front = [Candidate(n, {"k": 2.0}, np.zeros(1), Score([a], []), (Score([b], []),))
             for n, (a, b) in enumerate(found)]  # fmt: skip
    best = front[0] if front else Candidate(9, {"k": 3.0}, np.zeros(1), Score([7.0], []),
                                            (Score([8.0], []),))  # fmt: skip
    search.front, search.best, search.limits, search.course = front, best, [], []
    search.rolls, search.shown = SimpleNamespace(done=12), {}
    search.objective, search.others = SimpleNamespace(text="one"), (SimpleNamespace(text="other"),)
    search.frees = [SimpleNamespace(short="k", name="k", unit="1")]
    search.tell = said.append
    search._say(3)
    assert search.course == [(12, best.score.mean(), 0.0)]
    assert said[0].startswith(f"generation 3: 12 runs, {len(front)} points, ")
    assert ("limits not met yet" in said[0]) == (not front)
    for k, name in enumerate(("one", "other")) if front else ():
        ends = [f([p[k] for p in found]) for f in (min, max)]
        assert f"{name} {ends[0]:.6g} to {ends[1]:.6g}" in said[0]
