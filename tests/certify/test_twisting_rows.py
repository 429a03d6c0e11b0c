"""Rows of the sets of super-twisting, tick by tick: against every row and corner by itself."""

from __future__ import annotations

import math
import random
from fractions import Fraction

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.certify.entries import DoesNotHold
from slipctl.models.super_twisting.certificate import (
    twisting_late,
    twisting_levels,
    twisting_proof,
    twisting_rows,
    twisting_sampled,
    twisting_turns,
)
from slipctl.models.super_twisting.certificate.twisting_late import Late
from slipctl.models.super_twisting.certificate.twisting_levels import Levels
from slipctl.models.super_twisting.certificate.twisting_rows import EMPTY, Grid, Law, Rows
from slipctl.models.super_twisting.certificate.twisting_turns import falling_bounds, sweep

F = Fraction

QUIET = Grid(Law(F(5, 2), F(3), F(5, 4)), 4, 6)
NOISY = Grid(Law(F(5, 2), F(3), F(5, 4), F(1, 3), F(1, 7)), 4, 6)

UP = np.array([EMPTY, -3.0, 5.0, 900.0, 140.0, 260.0, 31.0, -2.0])
"""Upper ends of y, units of 7/1024, in rows of w from -7/4 on; each row other than its mirror."""


def test_sizes_of_a_grid_are_those_of_its_law() -> None:
    assert (NOISY.height, NOISY.unit) == (F(7, 16), F(7, 1024))
    assert (NOISY.reach, NOISY.still) == (10, 3)  # 17/4 and 5/4 over 7/16, rounded up
    assert (NOISY.noise, NOISY.matched) == (49, 21)  # 1/3 and 1/7 over 7/1024, rounded up
    assert (NOISY.turn, NOISY.square) == (229, pytest.approx(6400 / 7))
    assert (QUIET.noise, QUIET.matched) == (0, 0)
    y = np.array([0.0, 4.0, 81.0])
    roots = [5 / 2 * math.sqrt(v * 7 / 1024) * 1024 / 7 for v in y]
    assert list(NOISY.least_root(y)) == [math.floor(r) for r in roots]
    assert list(NOISY.most_root(y)) == [math.ceil(r) for r in roots]


def plainly(grid: Grid, up: np.ndarray) -> list[float]:
    """Upper ends a tick later, in units: each row by itself, y at 400 places and at its ends."""
    n, k1 = len(up) // 2, math.sqrt(float(grid.law.k1**2 / grid.unit))
    noise, one = float(grid.law.N / grid.unit), 2.0**grid.bits
    found = dict.fromkeys(range(-n - grid.reach, n + grid.reach), -math.inf)
    for i, (high, other) in enumerate(zip(up, up[::-1], strict=True)):
        low, top = -other, (i - n + 1) * one + float(grid.law.M / grid.unit)
        if high == EMPTY or low > high:
            continue
        at = np.concatenate([np.linspace(low, high, 400), [low, high]])
        inner = [x for x in (0.0, noise, -noise, k1**2 / 4 - noise, noise - k1**2 / 4)
                 if low <= x <= high]  # fmt: skip
        y = np.concatenate([at, inner])
        for side, first, last in ((1, -grid.reach, -grid.parts), (-1, grid.parts, grid.reach),
                                  (0, -grid.still, grid.still)):  # fmt: skip
            if side:
                seen = np.maximum(side * y - noise, 0) if side > 0 else noise - y
                here = side * y >= -noise
                after = y - side * k1 * np.sqrt(np.maximum(seen, 0))
            else:
                here, after = abs(y) <= noise, y
            if here.any():
                for row in range(i - n + first, i - n + last + 1):
                    found[row] = max(found[row], after[here].max() + top)
    return [found[k] for k in sorted(found)]


@pytest.mark.parametrize("grid", [QUIET, NOISY], ids=["without noise", "with noise"])
@pytest.mark.parametrize("seed", range(6))
def test_a_tick_of_rows_is_that_of_each_row(grid, seed) -> None:
    """Never less, and more by some units only, of roots and errors that are rounded."""
    rng = np.random.default_rng(seed)
    up = UP if not seed else rng.choice([EMPTY, -40, 0, 12, 55, 230, 500, 4000], 2 * seed + 4)
    up = np.maximum(up, np.where(up[::-1] > EMPTY, -up[::-1], EMPTY))  # no row of less than none
    up = np.where(up[::-1] > EMPTY, up, EMPTY)
    wanted = np.array(plainly(grid, up))
    found = Rows(grid, up.astype(float)).tick()
    n, m = len(wanted) // 2, len(found.ends) // 2
    assert np.isneginf(wanted[: n - m]).all()
    assert np.isneginf(wanted[n + m :]).all()
    wanted = wanted[n - m : n + m]
    live = wanted > EMPTY
    assert (live == (found.ends > EMPTY)).all()
    assert (found.ends[live] >= wanted[live] - 1e-6).all()
    assert (found.ends[live] <= wanted[live] + 6).all()
    assert m == max(np.flatnonzero(live)[-1] + 1 - m, m - np.flatnonzero(live)[0])


def test_rows_of_nothing_stay_nothing() -> None:
    for grid in (QUIET, NOISY):
        found = Rows(grid, np.full(6, EMPTY)).tick()
        assert len(found.ends) == 0
        assert (found.largest(), found.widest()) == (0, 0)


def test_ends_of_a_set_are_those_of_its_rows() -> None:
    rows = Rows(QUIET, UP)
    assert rows.largest() == 900 * F(7, 1024)
    assert rows.widest() == 4 * F(7, 16)
    inner = Rows(QUIET, np.array([EMPTY, 3.0, 8.0, 5.0, EMPTY, EMPTY]))
    assert inner.widest() == F(7, 16)
    assert Rows(QUIET, np.array([-3.0, -8.0])).largest() == 0
    fine = rows.finer(3)
    assert (fine.grid.parts, fine.grid.bits, fine.grid.law) == (12, 6, QUIET.law)
    assert list(fine.ends) == [e * 3 for e in UP for _ in range(3)]
    assert fine.largest() == rows.largest()
    assert list(twisting_rows.origin(QUIET).ends) == [0, 0]


@pytest.mark.parametrize("width", range(1, 10))
def test_windows_are_the_largest_of_so_many_neighbours(width) -> None:
    values = np.array([3.0, -1, 4, 1, -5, 9, -2, 6, 5, -3, 5])
    wanted = [max(values[k : k + width]) for k in range(len(values) - width + 1)]
    assert list(twisting_rows.windows(values, width)) == wanted
    two = np.stack([values, values[::-1]], axis=1)
    both = twisting_rows.windows(two, width)
    assert list(both[:, 0]) == wanted
    assert list(both[:, 1]) == wanted[::-1]


@pytest.mark.parametrize(("first", "last"), [(-4, -2), (1, 3), (-1, 1), (2, 2), (-4, 4)])
def test_moved_rows_are_those_that_any_move_brings(first, last) -> None:
    values, room = np.array([3.0, EMPTY, 4, 1, -5, 9]), 4
    found = twisting_rows.moved_rows(values, first, last, room)
    assert len(found) == len(values) + 2 * room
    for t, value in enumerate(found):
        sources = [t - room - s for s in range(first, last + 1)]
        assert value == max((values[k] for k in sources if 0 <= k < 6), default=EMPTY)


def test_a_set_of_too_many_rows_or_units_is_given_up(monkeypatch) -> None:
    after = Rows(QUIET, UP).tick()
    for name, most in (("MOST_ROWS", len(after.ends)), ("LONGEST", after.ends.max())):
        monkeypatch.setattr(twisting_rows, name, most)
        assert len(Rows(QUIET, UP).tick().ends) == len(after.ends)
        monkeypatch.setattr(twisting_rows, name, most - 1)
        with pytest.raises(OverflowError, match="the set has too many rows"):
            Rows(QUIET, UP).tick()
        monkeypatch.undo()


# ---- half turns ----------------------------------------------------------------------------------

STRONG = Grid(Law(F(6), F(4), F(1)), 6, 12)


def crossing(law: Law, w: float, y: float, rng: random.Random):
    """|w| at the next crossing of y = 0, and the largest y on the way."""
    k1, k2, L = float(law.k1), float(law.k2), float(law.L)
    top = y
    while y > 0:
        d = rng.choice((L, L, -L, rng.uniform(-L, L)))
        y, w = y - k1 * math.sqrt(y) + w, w - k2 + d
        top = max(top, y)
    return -w, top


def test_a_half_turn_holds_runs_from_its_crossing() -> None:
    """Three bounds at once; the least of them is reached to within a third."""
    most = [90, 60, 40]
    found = sweep(STRONG, most)
    h, rng = float(STRONG.height), random.Random(2)
    for k, bound in enumerate(most):
        far = high = 0.0
        for _ in range(300):
            begin = rng.uniform(0.8, 1) * bound * h
            y = rng.uniform(0.5, 1) * begin + rng.uniform(0, 9)  # k1^2/4 = 9
            w, top = crossing(STRONG.law, rng.uniform(0.9, 1) * begin + 5, y, rng)
            far, high = max(far, w), max(high, top)
        assert far <= found.leads[k] * h
        assert high <= found.highest[k] * float(STRONG.unit)
        assert found.highest[k] * float(STRONG.unit) < 1.6 * high
    assert list(found.leads) == sorted(found.leads, reverse=True)
    assert found.falls() == all(a <= b for a, b in zip(found.leads, most[1:], strict=False))
    y, w = found.bounds()
    assert y == int(found.highest[-1]) * STRONG.unit
    assert w == (min(40, int(found.leads[-1])) + STRONG.reach) * STRONG.height


def test_half_turns_that_fall_end_where_nothing_is_gained(monkeypatch) -> None:
    found = falling_bounds(STRONG, 90 * STRONG.height)
    assert found.most[0] == 90
    assert found.falls()
    assert all(a > b for a, b in zip(found.most, found.most[1:], strict=False))
    assert found.most[-1] < 60
    slacks = []
    own = twisting_turns._chain
    monkeypatch.setattr(twisting_turns, "_chain", lambda t, s: slacks.append((t, s)) or own(t, s))
    monkeypatch.setattr(twisting_turns.Sweep, "falls", lambda self: False)
    with pytest.raises(OverflowError, match="no bounds were found"):
        falling_bounds(STRONG, 90 * STRONG.height)
    assert len({id(tried) for tried, _ in slacks}) == len(slacks) > 1  # each from the one before
    assert sorted(s for _, s in slacks) == [s for _, s in slacks]


def test_a_sweep_that_takes_too_much_is_given_up(monkeypatch) -> None:
    most = [60, 40]
    first = sweep(STRONG, most)
    top = most[0] + STRONG.reach
    for name, limit, said in (
        ("MOST_ROWS", top, "the sweep has too many rows"),
        ("MOST_CELLS", 2 * (2 * top + 3 * STRONG.reach), "the sweep has too many rows"),
        ("LONGEST", first.highest.max(), "y has too many units"),
    ):
        monkeypatch.setattr(twisting_turns, name, limit)
        assert list(sweep(STRONG, most).leads) == list(first.leads)
        monkeypatch.setattr(twisting_turns, name, limit - 1)
        with pytest.raises(OverflowError, match=said):
            sweep(STRONG, most)
        monkeypatch.undo()
    for law in (Law(F(6), F(4), F(1), F(1, 9)), Law(F(6), F(4), F(1), F(0), F(1, 9))):
        with pytest.raises(OverflowError, match="the sweep has too many rows"):
            sweep(Grid(law, 6, 12), most)
    with pytest.raises(OverflowError, match="a half turn grows"):
        sweep(Grid(Law(F(1, 10), F(4), F(39, 10)), 1, 12), [60])


def test_rows_of_a_polygon_have_an_end(monkeypatch) -> None:
    corners = ((F(0), F(1)), (F(1, 2), F(1)), (F(1, 2), F(1, 5)), (F(0), F(-1, 2)))
    levels, grid = Levels(STRONG.law, corners, F(80), F(1, 100)), STRONG
    rows = levels.rows(grid)
    for name, most, said in (
        ("MOST_ROWS", len(rows.ends), f"{len(rows.ends)} rows are needed"),
        ("LONGEST", rows.ends.max(), "y has too many units"),
    ):
        monkeypatch.setattr(twisting_levels, name, most)
        assert list(levels.rows(grid).ends) == list(rows.ends)
        monkeypatch.setattr(twisting_levels, name, most - 1)
        with pytest.raises(OverflowError, match=said):
            levels.rows(grid)
        monkeypatch.undo()


# ---- as a file holds them ------------------------------------------------------------------------

GAINS = {"k1": F(3), "k2": F(3, 2), "L": F(1), "T": F(1, 1000)}
REST = {"start": {"x1": "0", "x2": "0"}, "d": ["1", "1"]}


def test_a_run_from_rest_comes_as_far_as_its_pushes() -> None:
    """d = 1 for two ticks of 1e-3: x2 is 1e-3 after the first, x1 1e-6 after the second."""
    said = twisting_proof._replay(GAINS | {"band": F(9, 10**7)}, REST)
    assert said.endswith("after 2 ticks")
    assert "from x1 = x2 = 0" in said
    for n, run, words in (
        (GAINS, REST | {"start": {"x1": "1", "x2": "0"}}, "it must start where the law rests"),
        (GAINS, REST | {"start": {"x1": "0", "x2": "1"}}, "it must start where the law rests"),
        (GAINS | {"lag": F(1, 1000)}, REST, "the numbers are out of reach"),
        (GAINS | {"dead": F(1, 1000)}, REST, "the numbers are out of reach"),
        (GAINS | {"k2": F(1)}, REST, "the numbers are out of reach"),
        (GAINS, REST | {"d": ["1", "1001/1000"]}, "does not exceed the band, or"),
        (GAINS, REST | {"d": ["1"]}, "does not exceed the band, or"),
    ):
        with pytest.raises(DoesNotHold, match=words):
            twisting_proof._replay(n | {"band": F(9, 10**7)}, run)


def test_a_run_in_whole_numbers_is_that_of_floats() -> None:
    law, rng = Law(F(5, 2), F(3), F(5, 4)), random.Random(5)
    for _ in range(20):
        d = [F(rng.randint(-10, 10), 8) for _ in range(rng.randint(1, 14))]
        y = w = 0.0
        for push in d:
            y, w = (y - 2.5 * math.copysign(math.sqrt(abs(y)), y) + w,
                    w - 3 * math.copysign(y != 0, y) + float(push))  # fmt: skip
        found = twisting_sampled.replay_run(law, d)
        if found is not None:
            assert float(found) == pytest.approx(abs(y), rel=1e-6, abs=1e-9)
        assert twisting_sampled.replay_run(law, [*d, F(11, 8)]) is None
        assert twisting_sampled.replay_run(law, [F(-11, 8), *d]) is None
    assert twisting_sampled.replay_run(law, [F(1), F(1), F(1)]) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("k1", "k2", "noise", "dead", "d", "heard"),
    [
        (3, 18, 2, 0, "3 7 3 -7 -7 3 -5 -5 -7 -7 7 -5", "2 -2 2 2 0 -2 2 -2 0 2 2 -2"),
        (2, 28, 0, 0, "-7 3 -7 -5 -5 -7 7 -7 -5 3 7 -7", ""),
        (2, 23, 2, 0, "3 7 -7 -5 7 3 7 7 7 -7", "2 2 2 2 2 2 -2 -2 0 2"),
        (4, 27, 0, 1, "3 3 7 -5 -7 7 7 3 7 3 -5 3 -5", ""),
        (4, 13, 0, 1, "-5 -7 -7 7 3 7 7 7 -7 3 -7", ""),
    ],
)
def test_a_replay_behind_a_lag_never_says_more_with_few_digits(
    k1, k2, noise, dead, d, heard
) -> None:
    """In sevenths, behind a lag of 9/5 ticks: what is left of the lag may be either side of it."""
    law = Late(Law(F(k1, 7), F(k2, 7), F(1), F(noise, 7)), F(9, 5), dead)
    pushes = [F(x) / 7 for x in d.split()]
    noises = [F(x) / 7 for x in heard.split()] or [F(0)] * len(pushes)
    true = twisting_late.replay(law, pushes, noises, 900)
    assert true > 0
    for digits in (15, 21, 24, 60, 300):
        found = twisting_late.replay(law, pushes, noises, digits)
        assert found is None or found <= true
    assert float(found) == pytest.approx(float(true), rel=1e-9)


def test_bounds_that_cross_fall_one_after_the_other() -> None:
    given = [[4, 90, 60, 41], [8, 70]]
    assert twisting_proof._crossings(given) == ((4, 90, 60, 41), (8, 70))
    for i, wrong in ((0, [4]), (1, [4, 60, 60]), (1, [4, 60, 90]), (0, [4, 90, 60, 61])):
        entry = [*given]
        entry[i] = wrong
        with pytest.raises(DoesNotHold, match=rf"crossings\[{i}\]: no bounds that fall"):
            twisting_proof._crossings(entry)
    for wrong in ([[0, 5]], [[4, 10**6 + 1]], [[4, 0]], [["4", 5]], "x", [[4, 5]] * 41):
        with pytest.raises(BadInput, match=r"evidence\.crossings"):
            twisting_proof._crossings(wrong)


def test_the_unit_of_length_makes_the_disturbance_near_one() -> None:
    for L, c in ((F(1), F(1)), (F(4), F(4)), (F(3), F(1)), (F(17), F(16)), (F(1, 5), F(1, 16))):
        n = {"k1": F(9), "k2": 3 * L, "L": L, "T": F(1, 10)}
        found, unit = twisting_proof.law(n)
        assert unit == c / 100
        assert (found.L, found.k2) == (L / c, 3 * L / c)
        assert found.k1**2 == 81 / c
        assert 1 <= found.L < 4
    for wrong in ({"k1": F(1, 10**4)}, {"k1": F(10**4)}, {"k2": F(1)}, {"k2": F(10**5)}):
        assert twisting_proof.law(GAINS | wrong) is None
        with pytest.raises(DoesNotHold, match="no bound is known at these numbers"):
            twisting_proof._check_late(
                GAINS | wrong | {"noise": F(1, 10**6)},
                {"P": "1", "parts": 4, "ticks": 9, "bound": "1"},
            )


def test_a_late_bound_above_the_band_is_none() -> None:
    n = GAINS | {"lag": F(1, 4000)}
    found = twisting_proof._find_late(n)
    limit = F(found["bound"])
    twisting_proof._check_late(n | {"band": limit}, found)
    with pytest.raises(DoesNotHold, match="the bound is larger than the band"):
        twisting_proof._check_late(n | {"band": limit * F(999, 1000)}, found)
    with pytest.raises(DoesNotHold, match="the set is left, or is larger than that"):
        twisting_proof._check_late(n, found | {"bound": str(limit / 2)})
    for P in ("0", str(10**12)):
        with pytest.raises(DoesNotHold, match="the set is left, or is larger than that"):
            twisting_proof._check_late(n, found | {"P": P})
    with pytest.raises(DoesNotHold, match="no bound is known at these numbers"):
        twisting_proof._check_late(GAINS, found)  # of nothing late
