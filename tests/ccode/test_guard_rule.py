"""What becomes of one input in one tick, by hand: what is taken, its age, and what is told."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl.ccode.module import guard
from slipctl.ccode.module.guard import BAD_INPUT, OFF_RANGE, REFUSED, UNSURE

GOOD = 0
STALE, MEMORY, MOST = 3, 6, 1e300


@pytest.mark.parametrize(
    ("value", "last", "age", "taken", "older", "told"),
    [
        (5.4, 5.0, 0, 5.4, 0, GOOD), (5.6, 5.0, 0, 5.0, 1, OFF_RANGE),
        (4.4, 5.0, 1, 4.4, 0, GOOD),  # the way of two ticks
        (5.9, 5.0, 1, 5.0, 2, OFF_RANGE), (5.2, 5.0, 2, 5.2, 1.5, UNSURE),
        (6.5, 5.0, 4, 6.5, 3.5, UNSURE),  # the first that is good again, as far as it may come
        (6.2, 5.0, 3.5, 6.2, 2.5, OFF_RANGE),  # taken, but no way of a tick after a good one
        (5.3, 5.0, 3.5, 5.3, 2.5, UNSURE), (5.3, 5.0, 1.5, 5.3, 0, GOOD),
        (6.2, 5.0, 1.5, 5.0, 2, OFF_RANGE), (11.0, 10.9, 2, 10.9, 3, OFF_RANGE),
        (-12.0, -11.9, 3, -11.9, 4, OFF_RANGE | REFUSED), (7.0, 0.0, -1, 7.0, 0, GOOD),
        (20.0, 0.0, -1, 0.0, -1, OFF_RANGE | REFUSED),
        (np.inf, 5.0, 1, 5.0, 2, BAD_INPUT), (-np.inf, 5.0, 3, 5.0, 4, BAD_INPUT | REFUSED),
        (-9.0, 5.0, 6, -9.0, 5.5, UNSURE), (-9.0, 5.0, 8, -9.0, 5.5, UNSURE),
        (-9.0, 5.0, 5.5, 5.0, 6, OFF_RANGE | REFUSED),
        (-19.0, 5.0, 6, 5.0, 6, OFF_RANGE | REFUSED), (np.nan, 5.0, 6, 5.0, 6, BAD_INPUT | REFUSED),
    ],
)  # fmt: skip
def test_a_value_is_taken_that_can_have_come_so_far(value, last, age, taken, older, told) -> None:
    """From -11 to 10, a change of 0.4 in a tick and a noise of 0.05."""
    found = guard.accept()(value, last, age, -11, 10, 0.4, 0.05, STALE, MEMORY, MOST)
    assert [float(x) for x in found] == pytest.approx([taken, older, told])


def test_without_a_largest_change_any_value_in_the_range_follows() -> None:
    found = guard.accept()(-9.0, 5.0, 2.5, -11, 10, MOST, 0.0, STALE, MEMORY, MOST)
    assert [float(x) for x in found] == [-9.0, 1.5, UNSURE]


@pytest.mark.parametrize(
    ("period", "stale", "ticks"),
    [
        (0.01, [], 100), (0.03, [2.0, 5.0], 34), (None, [7.0], 1000), (4.0, [], 1),
        (4.0, [3.0, 9.0, 2.0], 9), (1e-9, [3.0], 1e6), (0.5, [2e6], 1e6),
    ],
)  # fmt: skip
def test_a_value_is_known_for_a_second_and_as_long_as_it_is_taken(period, stale, ticks) -> None:
    assert guard.memory(period, np.array(stale)) == ticks


@pytest.mark.parametrize(
    ("tick", "missed", "ticks", "stands"),
    [(2, 0, 5, 2), (2, 2, 5, 4), (2, 3, 5, 0), (4, 17, 5, 1), (0, 7, 1, 0), (np.nan, 1, 5, 0)],
)
def test_a_counter_goes_round(tick, missed, ticks, stands) -> None:
    assert float(guard.counter_after()(tick, missed, ticks)) == stands


def test_only_elements_that_are_not_good_all_along_are_looked_at_and_each_is_told() -> None:
    """The middle one jumps and comes back, the last one the block judges itself."""
    rows = np.array([
        [1.0, 2.0, 3.0, 0.5], [1.2, 9.0, 3.0, np.inf], [1.4, 2.2, 3.0, 0.7],
        [1.6, np.nan, 3.0, 99.0], [1.8, 2.5, 3.0, -0.5],
    ])  # fmt: skip
    ends = [np.array(x) for x in ([0.0, 0, 0, 0], [5.0, 10, 5, 1], [0.3, 0.4, 0.1, 0.2], [0.0] * 4)]
    judged = np.array([False, False, False, True])
    taken, told = guard.accepted_inputs(rows, ends, np.array([1.0, 2, 3, 4]), 1e300, 0.1, judged)
    wanted = rows.copy()
    wanted[1, 1], wanted[3, 1] = 2.0, 2.2
    np.testing.assert_array_equal(taken, wanted)
    assert told.tolist() == [0, OFF_RANGE | BAD_INPUT, 0, BAD_INPUT, 0]
    some, stale = [e[:3] for e in ends], np.array([1.0, 1, 3])
    taken, told = guard.accepted_inputs(rows[:, :3], some, stale, 1e300, 0.1)
    np.testing.assert_array_equal(taken, wanted[:, :3])
    assert told.tolist() == [0, OFF_RANGE, 0, BAD_INPUT, 0]
    _, told = guard.accepted_inputs(rows[3:4, :3], some, stale, 1e300, 0.1)
    assert told.tolist() == [BAD_INPUT | REFUSED]
    good = [0, 2]
    taken, told = guard.accepted_inputs(rows[:, good], [e[good] for e in ends], np.ones(2), 1e300)
    np.testing.assert_array_equal(taken, rows[:, good])
    assert told.tolist() == [0] * 5
