"""What tune shows: its tables hold the numbers of the search, its pictures draw them."""

from __future__ import annotations

import math
import re
from html import unescape
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_tune import GAINS, tuned

from slipctl.design import judgement, page
from slipctl.design.goals import Score
from slipctl.design.tune import Tuned
from slipctl.study.report.texts import number

BOTH = ["slip_error_rms", "torque_ripple"]


@pytest.fixture(scope="module")
def one() -> Tuned:
    return tuned(gains=GAINS, runs=24, subject_to=["slip_error_rms<=9m/s"])


@pytest.fixture(scope="module")
def two() -> Tuned:
    return tuned(objective=BOTH, runs=24)


@pytest.fixture(params=["one", pytest.param("two", marks=pytest.mark.second)])
def found(request: pytest.FixtureRequest) -> Tuned:
    return request.getfixturevalue(request.param)


def cells(rows: list[list[str]], first: str) -> list[str]:
    return next(r for r in rows if r[0] == first)[1:]


def curve(axis: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    line = next(k for k in axis.get_lines() if k.get_label() == name)
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def drawn(found: Tuned, begins: str) -> list[Any]:
    """Axes of the picture whose caption begins so."""
    fig = next(f for c, f in page.pictures(found).items() if c.startswith(begins))
    return fig.get_axes()


def test_the_judgement_is_that_of_its_values(found: Tuned) -> None:
    rows = page.judged_rows(found)
    for goal, its in zip(found.search.objectives, found.judged.each, strict=True):
        unit = next(r[0] for r in rows if r[0].startswith(f"mean {goal.text}"))[5:]
        for what, of in (("least", min), ("largest", max), ("mean", np.mean),
                         ("median", np.median)):  # fmt: skip
            both = [of(s.values) for s in (its.by_hand, its.tuned)]
            assert cells(rows, f"{what} {unit}") == [number(float(v), 6) for v in both]
        gap = np.subtract(its.tuned.values, its.by_hand.values)
        assert its.difference == pytest.approx(gap.mean())
        assert its.error == pytest.approx(gap.std(ddof=1) / math.sqrt(gap.size))


def test_draws_that_keep_a_limit_are_counted(one: Tuned) -> None:
    kept = [sum(v <= 9 for v in s.values)
            for s in (one.judged.by_hand, one.judged.tuned)]  # fmt: skip
    limit = one.search.limits[0]
    assert cells(page.judged_rows(one), f"draws with {limit.text}") == [f"{k} of 4" for k in kept]
    assert limit.text in page.text(one)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2)])
def test_an_objective_that_is_never_reached_ends_no_list_of_differences(order, monkeypatch) -> None:
    """Its lost draws are told; of each other one the mean, of the draws that both reach."""
    never, some = [math.inf, math.inf, math.inf, math.inf], [1.0, 2.0, math.inf, 4.0]
    values = [(never, never), (some, [2.0, 3.0, 4.0, 6.0]), ([1.0] * 4, [2.0, 2.0, 2.0, 2.5])]
    each = [
        SimpleNamespace(
            tuned=Score(a, []), by_hand=Score(b, []), error=0.1,
            difference=math.nan if a is never else -1.0,
        )
        for a, b in values
    ]  # fmt: skip
    judged = SimpleNamespace(each=[each[k] for k in order])
    names = [SimpleNamespace(text="abc"[k]) for k in order]
    search = SimpleNamespace(best=1, by_hand=2, objectives=names)
    monkeypatch.setattr(page, "_units", lambda found: ["m", "m", "m"])
    lines = page.differences(SimpleNamespace(judged=judged, search=search))
    told = [line for line in lines if line.startswith("mean")]
    assert [line.split()[1] for line in told] == ["abc"[k] for k in order if k]
    assert "b of 3 held-out draws that both reach: 2.33333 m tuned, 3.66667 m" in "".join(told)
    lost = sorted(line for line in lines if "never reached" in line)
    assert [line.split(" in ")[1:] for line in lost] == [
        ["4 of 4 held-out draws tuned,", "4 by hand"], ["1 of 4 held-out draws tuned,", "0 by hand"]
    ]  # fmt: skip


def test_the_differences_are_told_for_each_objective(found: Tuned) -> None:
    assert len(page.differences(found)) == len(found.search.objectives)
    for line, its in zip(page.differences(found), found.judged.each, strict=True):
        mean, error = (float(x) for x in re.findall(r"(\S+) \+- (\S+).* \(standard", line)[0])
        assert mean == pytest.approx(its.difference, rel=1e-3)
        assert error == pytest.approx(its.error, rel=0.06)
        assert ("more than" in line) == (abs(its.difference) > 2 * its.error)


def test_the_gains_are_those_found(found: Tuned) -> None:
    rows = page.gains_rows(found)
    assert len(rows[0]) == 5 + 2 * len(found.search.objectives)
    for f in found.frees:
        row = cells(rows, f.name)
        assert row[:4] == [f.unit, f"{number(f.lo)} .. {number(f.hi)}", number(f.now),
                           number(found.gains[f.name], 6)]  # fmt: skip
        for k, goal in enumerate(found.search.objectives):
            s = next(s for s in found.slices if (s.objective, s.free.name) == (goal.text, f.name))
            assert row[4 + 2 * k] == f"{number(s.lo)} .. {number(s.hi)}"
            assert s.lo <= found.gains[f.name] <= s.hi


def test_the_margins_are_those_found(one: Tuned) -> None:
    row = page.promise_rows(one)[1]
    margins = one.margins["sta"]
    assert row[3:] == [number(margins[1], 3), number(margins[0], 3)]
    assert row[2] == "CERTIFIED"


def test_slices_draw_their_means_and_range(one: Tuned) -> None:
    axes = drawn(one, "Mean slip_error_rms over draws along")
    assert len(axes) == len(one.slices) == 1
    s, axis = one.slices[0], axes[0]
    x, y = curve(axis, s.free.name)
    assert (list(x), len(x)) == (list(s.values), judgement.POINTS)
    assert np.array_equal(y, s.means, equal_nan=True)
    assert axis.get_xscale() == "log"  # from 1 to 60
    assert s.free.name in axis.get_xlabel()
    assert "m/s" in axis.get_ylabel()
    span = axis.patches[0].get_extents().transformed(axis.transData.inverted())
    assert (span.x0, span.x1) == (pytest.approx(s.lo), pytest.approx(s.hi))
    now = [
        k for k in axis.get_lines() if len(k.get_xdata()) == 2 and k.get_xdata()[0] == s.free.now
    ]
    assert now


def test_the_course_is_drawn_against_its_runs(one: Tuned) -> None:
    axis = drawn(one, "Mean over the draws of the search, against its runs")[0]
    x, y = curve(axis, "best so far")
    wanted = [m if missed <= 0 else math.nan for _, m, missed in one.search.course]
    assert list(x) == [r for r, *_ in one.search.course]
    assert np.array_equal(y, wanted, equal_nan=True)
    x, y = curve(axis, "by hand")
    assert (x[0], x[-1]) == (one.search.course[0][0], one.search.course[-1][0])
    assert set(y) == {one.search.by_hand.score.mean_reached()}
    assert "runs" in axis.get_xlabel()


@pytest.mark.second
def test_the_front_is_drawn_with_its_knee(two: Tuned) -> None:
    axes = drawn(two, "Means over the draws of the search: no candidate is better")
    x, y = curve(axes[0], "front")
    front = [[s.mean() for s in c.scores] for c in two.front]
    assert np.array_equal(np.column_stack([x, y]), front)
    for name, c in (("knee", two.search.best), ("by hand", two.search.by_hand)):
        x, y = curve(axes[0], name)
        assert [x[0], y[0]] == [s.mean() for s in c.scores]
    assert "slip_error_rms" in axes[0].get_xlabel()
    assert "torque_ripple" in axes[0].get_ylabel()
    rows = page.front_rows(two, len(two.front))
    assert len(rows) == 1 + len(two.front)
    assert sum("knee" in r[0] for r in rows) == 1


def test_the_draws_are_drawn_beside_their_limit(one: Tuned) -> None:
    axes = drawn(one, "slip_error_rms on the held-out draws")
    limit = one.search.limits[0]
    levels = [k for k in axes[0].get_lines() if set(np.ravel(k.get_ydata())) == {9.0}]
    assert levels
    assert [t.get_text() for t in axes[0].texts] == [limit.text]
    assert (len(axes) == 2) == (one.search.best is not one.search.by_hand)
    if len(axes) == 2:
        gap = np.subtract(one.judged.tuned.values, one.judged.by_hand.values)
        x, y = curve(axes[1], "tuned - by hand")
        assert y == pytest.approx(np.sort(gap))
        assert x == pytest.approx((np.arange(gap.size) + 0.5) / gap.size * 100)


def test_the_page_says_how_it_was_searched(found: Tuned) -> None:
    text = unescape(re.sub(r"<svg.*?</svg>|<img[^>]*>", "", page.page(found, "THE COMMAND"),
                           flags=re.DOTALL))  # fmt: skip
    search, world = found.search, found.search.rolls.world
    said = [f"Gains of {found.name}", "THE COMMAND", f"Scenario {world.scenario.name}",
            f"{search.thought} candidates", f"{search.spent} runs on {search.samples} draws",
            f"seed {search.seed}", world.ensemble.hash[:16], *(a.name for a in world.axes),
            "peak times 0.8 .. 1.2", page.goals(found), *page.differences(found)]  # fmt: skip
    assert [k for k in said if k not in text] == []
    heads = re.findall(r"<h2>(.*?)</h2>", text)
    assert heads == [*["Front"] * bool(found.front), "Gains", "Held-out draws",
                     *["Certificates"] * bool(found.promises.gains), "Pictures",
                     "Search"]  # fmt: skip
    pictures = page.pictures(found)
    assert len(pictures) == (5 if found.front else 3)
    assert all(c in text for c in pictures)


@pytest.mark.second
@pytest.mark.long
def test_the_terminal_says_it_too(one: Tuned, two: Tuned) -> None:
    shown = page.text(one)
    assert str(one.search.spent) in shown
    assert page.KNEE in page.text(two)
    assert page.KNEE not in shown
    assert "The margin is the factor" in page.page(one, "x")
