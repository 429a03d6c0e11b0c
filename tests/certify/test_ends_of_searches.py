"""Searches for a proof or a run: each ends where it says it does, and what is found is shown."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.models.bounded_error.certificate import bounded_error, lagged_runs, scalar_runs
from slipctl.models.bounded_error.certificate.bounded_error import BoundedError
from slipctl.models.bounded_error.certificate.interval_systems import find_drift
from slipctl.models.bounded_error.certificate.lagged_maps import Lagged, lag_numbers
from slipctl.models.bounded_error.certificate.scalar_maps import CubicPull, Interval, Tick
from slipctl.models.bounded_error.certificate.scalar_runs import Move, Run
from slipctl.models.super_twisting.certificate import quadratic, twisting_late, twisting_sampled
from slipctl.models.super_twisting.certificate.twisting_late import Late
from slipctl.models.super_twisting.certificate.twisting_rows import EMPTY, Grid, Law, origin

F = Fraction
LAW = Law(F(3), F(3, 2), F(1))

# ---- super-twisting ------------------------------------------------------------------------------


def test_a_quadratic_function_is_looked_for_with_more_digits(monkeypatch) -> None:
    """Also where few digits give no root: each number of digits once."""
    gains = {"k1": F(3), "k2": F(5, 4), "L": F(1), "delta": F(0)}
    tried, own = [], quadratic._root_below

    def few(x, digits):
        tried.append(digits)
        return None if digits < 9 else own(x, digits)

    plain = quadratic.find_quadratic(gains)
    monkeypatch.setattr(quadratic, "_root_below", few)
    found = quadratic.find_quadratic(gains)
    assert tried == [4, 6, 9]
    for entry in (plain, found):
        P = [[F(x) for x in row] for row in entry["P"]]
        assert [str(x) for x in quadratic.minors(gains, P, F(1))] == [
            *entry["minors"], entry["det_P"]]  # fmt: skip
        assert min(map(F, (*entry["minors"], entry["det_P"]))) > 0
    assert quadratic.find_quadratic(gains | {"delta": F(3)}) is None


def test_a_set_that_takes_too_much_work_is_left() -> None:
    """After the first tick, or after as many as were let: nothing is said of its end."""
    rows = origin(Grid(LAW, 4, 8))
    end, ticks, work = twisting_late._grown(rows, 500, 10.0)
    assert twisting_late._grown(rows, ticks, 10.0)[1] == ticks
    assert twisting_late._grown(rows, ticks - 1, 10.0)[1] is None
    first, none, less = twisting_late._grown(rows, 500, 0.0)
    one = twisting_late._joined(rows, rows.tick())
    assert none is None
    assert list(first.ends) == list(one.ends)
    assert 0 < less < work / 2
    again = twisting_late._joined(end, end.tick())
    assert list(again.ends) == list(end.ends)


def test_rows_that_are_joined_hold_both_sets() -> None:
    grid = Grid(LAW, 4, 8)
    small, large = np.array([3.0, -1.0]), np.array([1.0, EMPTY, 7.0, EMPTY, 2.0, 4.0])
    one, two = (twisting_late.Rows(grid, e) for e in (small, large))
    for pair in ((one, two), (two, one)):
        assert list(twisting_late._joined(*pair).ends) == [1, EMPTY, 7, -1, 2, 4]


@pytest.mark.parametrize("ends", ["without an end", "overflow"])
def test_a_search_behind_a_lag_ends_where_a_set_does(monkeypatch, ends) -> None:
    asked = []

    def grown(rows, most, room):
        asked.append(rows.grid.parts)
        assert len(asked) == 1
        if ends == "overflow":
            raise OverflowError
        return rows, None, 0.1

    monkeypatch.setattr(twisting_late, "_grown", grown)
    assert twisting_late.find(Late(replace_noise("1/10"), F(0), 0)) is None
    assert asked == [4]  # 16 (k2 - L)/(k2 + L), rounded up


def replace_noise(noise: str) -> Law:
    return Law(LAW.k1, LAW.k2, LAW.L, F(noise))


def test_a_bound_that_is_wide_enough_ends_the_search(monkeypatch) -> None:
    asked, own = [], twisting_late._grown
    monkeypatch.setattr(
        twisting_late, "_grown", lambda rows, *a: asked.append(rows.grid.parts) or own(rows, *a)
    )
    late = Late(replace_noise("1/10"), F(0), 0)
    best = twisting_late.find(late)
    many, asked[:] = list(asked), []
    found = twisting_late.find(late, F(10**6))
    assert found.parts == 4
    assert asked == [parts for parts in many if parts == 4]  # and none more
    assert max(many) >= best.parts > 4
    assert best.y < found.y
    for kept in (found, best):
        assert kept.holds()
        for wrong in ({"y": kept.y * F(999, 1000)}, {"ticks": kept.ticks - 1}, {"P": kept.P / 2}):
            assert not twisting_late.Kept(**{**vars(kept), **wrong}).holds()
    assert twisting_late.find(Late(Law(F(3), F(1), F(1)), F(0), 0)) is None


@pytest.mark.parametrize(
    ("sizes", "tried", "best"),
    [([5, 6, 1], 2, 5), ([5, 5, 1], 2, 5), ([5, F(495, 100), 1], 2, F(495, 100)),
     ([5, F(48, 10), 4, 4], 4, 4)],
)  # fmt: skip
def test_finer_rows_behind_a_lag_are_tried_as_long_as_they_gain(
    monkeypatch, sizes, tried, best
) -> None:
    """At least a fiftieth; the smallest set that was found is told."""
    asked = []

    def grown(rows, most, room):
        asked.append(rows.grid.parts)
        assert len(asked) <= tried
        return SimpleNamespace(largest=lambda: sizes[len(asked) - 1]), 7, 0.001

    monkeypatch.setattr(twisting_late, "_grown", grown)
    monkeypatch.setattr(twisting_late, "step", lambda rows: F(1, 2))
    found = twisting_late.find(Late(replace_noise("1/10"), F(0), 0))
    assert asked == [4 * 2**k for k in range(tried)]
    assert (found.y, found.parts) == (best, 4 * 2 ** sizes.index(best))


@pytest.mark.parametrize(
    ("wanted", "sizes", "tried", "best"),
    [
        (None, [10, 8, F(798, 100), 5], 3, F(798, 100)),  # less than a hundredth is gained
        (None, [10, 8, F(79, 10), F(788, 100), 1], 4, F(788, 100)),
        (None, [10, 12, 9], 2, 10),
        (F(4), [10, 8, 7], 1, 10),  # more than twice what is wanted
        (F(5), [10, 8, 7], 2, 8), (F(13, 2), [10, 8, 7.5, 7.4], 3, 7.5),
        (F(10), [10, 8], 1, 10), (F(9), [10, 8, 7], 2, 8),
    ],
)  # fmt: skip
def test_finer_half_turns_are_followed_as_long_as_they_gain(
    monkeypatch, wanted, sizes, tried, best
) -> None:
    asked = []

    def falling(grid, w):
        asked.append((grid.parts, w))
        k = len(asked) - 1
        rows = SimpleNamespace(parts=grid.parts, height=F(1, grid.parts))
        return SimpleNamespace(grid=rows, most=(90 - k, 30 + k), bounds=lambda: (sizes[k], k))

    monkeypatch.setattr(twisting_sampled, "falling_bounds", falling)
    monkeypatch.setattr(twisting_sampled, "cost", lambda grid, most: 0.25)
    levels = SimpleNamespace(law=LAW, kept=F(99))
    found, work = twisting_sampled._by_half_turns(levels, 3, wanted, 100.0)
    assert (len(asked), found.y, work) == (tried, best, 0.75 * tried)
    assert [p for p, _ in asked] == [3 * 2**k for k in range(tried)]
    assert [w for _, w in asked] == [F(99), *(F(30 + k, 3 * 2**k) for k in range(tried - 1))]
    at = sizes.index(best)
    assert found.turns == tuple((3 * 2**k, 90 - k, 30 + k) for k in range(at + 1))
    assert found.w == at


def test_a_run_is_read_back_through_ticks_that_bring_nothing_new() -> None:
    """Rows of a half; y+ = y - 3 root(y) sgn y + w, w+ = w - 3/2 sgn y + d, up to five ticks."""
    n, h = 8, F(1, 2)
    w = np.arange(-n, n + 1) * 0.5
    reach = ((-2, 2), (-5, -1), (1, 5))
    top = np.full(2 * n + 1, EMPTY)
    top[n] = 0.0
    history = [top]
    for _ in range(5):
        new = top.copy()
        for score, (a, b) in zip(twisting_sampled._scores(3.0, top, w), reach, strict=True):
            for at in range(2 * n + 1):
                window = score[:, max(0, at - b) : max(0, at - a + 1)]
                new[at] = max(new[at], window.max(initial=EMPTY))
        history.append(new)
        top = new
    plain = twisting_sampled._read_back(LAW, history, w, reach, h)
    assert len(plain) <= 5
    assert twisting_sampled.replay_run(LAW, plain) == pytest.approx(top.max(), rel=1e-9)
    twice = [part for part in history for _ in (0, 1)]
    assert twisting_sampled._read_back(LAW, twice, w, reach, h) == plain


# ---- one error inside bounds ---------------------------------------------------------------------


def test_a_drift_is_looked_for_on_the_second_side_where_the_first_is_too_narrow() -> None:
    narrow, wide = CubicPull(1.0, 0.5), CubicPull(0.01, 2.0)
    for sides, side in (((wide, narrow), -1), ((narrow, wide), 1)):
        found = find_drift(Tick(*sides, 1.0, 0.3))
        assert found["side"] == side
        place = float(F(found["place"]))
        assert 0.01 * (place - 0.3) * (4 - (place - 0.3) ** 2) == pytest.approx(
            0.01 * (place + 0.3) * (4 - (place + 0.3) ** 2), rel=1e-6
        )  # as high on either side of the noise
    assert find_drift(Tick(narrow, narrow, 1.0, 0.3)) is None


def test_each_law_that_may_refute_is_asked(monkeypatch) -> None:
    """From the start, and from the middle only with a step or where the bounds move."""
    asked = []

    def outward(law, start, far):
        asked.append((law, start, far))
        return Run(0.0, [Move(0.0, 0.0, 0.0)]) if law == "of start" else None

    monkeypatch.setattr(scalar_runs, "outward", outward)
    monkeypatch.setattr(bounded_error.interval_systems, "run_texts", lambda *given: given[1:])
    start = Interval(-1.0, 2.0)

    def made(step, moves):
        return BoundedError(
            "funnel", "it leaves", "m", "", lambda n: 0,
            lambda n, number: {"middle": "of middle", "start": "of start"}, None, None,
            lambda n, number: start, step, lambda n: moves,
        )  # fmt: skip

    middle = ("of middle", Interval(0.0, 0.0), 0.0)
    for step, moves, first in ((None, False, []), (lambda n, number: number(0), False, []),
                               (lambda n, number: number(0), True, [middle]),
                               (lambda n, number: number(0.5), False,
                                [(*middle[:2], 0.5)])):  # fmt: skip
        asked.clear()
        found = made(step, moves)._run({"T": 1.0})
        assert asked == [*first, ("of start", start, 0.0)]
        assert found == ("of start", "start", start, 0.0)


def behind(number, push="0.01"):
    lag, T, gain, one = (number(x) for x in ("0.2", "0.3", "0.9", "1"))
    with precise(50):
        E, c1, c2, scale, left = lag_numbers(lag, T, 0)
    pull = CubicPull(gain, one)
    return Lagged(pull, pull, number(push), number("0.01"), left, E, c1, c2, scale,
                  number("1"), number("0"), number("0"))  # fmt: skip


@pytest.mark.parametrize("step", ["1.25", "0.98"])
def test_a_step_leads_out_behind_a_lag_when_half_of_the_ticks_are_over(step) -> None:
    """One of the size of the bound at once; a little less with what pushes."""
    law, exact = behind(float), behind(Decimal)
    assert lagged_runs.outward(lambda i: law, Interval(0.0, 0.0)) is None
    found = lagged_runs.outward(lambda i: law, Interval(0.0, 0.0), float(step))
    assert found is not None
    assert found.stepped == int(300 + 100 / 0.9) // 2
    assert abs(found.step) == float(step)
    assert (found.start, len(found.signs)) == (0.0, found.stepped + 1)
    middle = Interval(Decimal(0), Decimal(0))
    path = lagged_runs.exact(lambda i: exact, found, Decimal(step), middle)
    assert path is not None
    assert path.step == Decimal(step).copy_sign(Decimal(found.step))
    assert lagged_runs.leaves(lambda i: exact, path)
    assert (path.errors[-1] > 0) == (path.step > 0)
    assert len(path.errors) == len(path.noise) == found.stepped + 1
    small = lagged_runs.exact(lambda i: exact, found, Decimal("0.5"), middle)
    assert small is None
