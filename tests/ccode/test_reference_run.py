"""What C is held against: the block in Python, until it breaks or leaves its range."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.ccode.check import comparison
from slipctl.ccode.module.plan import Plan
from slipctl.errors import RunFailed


@step(period=0.01, y=Output("1"), z=Output("1"))
def sums(
    n=State("1", (1.0, -1.0), "two sums", shape=(2,), lo=-40, hi=40),
    last=State("1", 0.5, "last input", lo=-20, hi=9),
    u=Input("1", "first", lo=-20, hi=20),
    w=Input("1", "two", shape=(2,), lo=-20, hi=20),
    k=Param("1", 2.0, "gain", lo=0, hi=9),
):
    """Sums of two numbers, and a root that is none beyond a sum of 30."""
    return dict(n=n + k * w, last=u), dict(y=ca.sqrt(30 - n[0]), z=n[1] + last)


PLAN = Plan(sums, "sums", 0.01)
ROWS = st.lists(st.tuples(*[st.integers(-20, 9)] * 3), min_size=1, max_size=12).map(
    lambda rows: np.array(rows, dtype=float)
)


def by_hand(rows: np.ndarray, k: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Outputs of each tick and states behind it, by sums of numpy."""
    n = np.vstack([[1.0, -1.0], np.array([1.0, -1.0]) + np.cumsum(k * rows[:, 1:], axis=0)])
    last = np.concatenate([[0.5], rows[:, 0]])
    with np.errstate(invalid="ignore"):
        y = np.sqrt(30 - n[:-1, 0])
    outputs = np.column_stack([y, n[:-1, 1] + last[:-1]])
    return outputs, np.column_stack([n[1:], last[1:]])


@given(ROWS, st.sampled_from([0.0, 0.5, 2.0]))
def test_it_is_the_sum_until_the_root_or_the_range_ends_it(rows, k):
    outputs, states = by_hand(rows, k)
    fine = np.isfinite(outputs).all(axis=1)
    inside = (np.abs(states[:, :2]) <= 40).all(axis=1)
    breaks = int(np.argmin(fine)) if not fine.all() else len(rows)
    leaves = int(np.argmin(inside)) if not inside.all() else len(rows)
    end = min(breaks, leaves)
    got, after = comparison.reference(PLAN, rows, {"k": k}, whole=False)
    assert got == pytest.approx(outputs[:end], rel=1e-14)
    assert after == pytest.approx(states[:end], rel=1e-14)
    if end == len(rows):
        whole, _ = comparison.reference(PLAN, rows, {"k": k})
        assert (whole == got).all()
        return
    said = (
        f"NaN or infinity at tick {breaks}" if breaks < len(rows) else "leaves its declared range"
    )
    with pytest.raises(RunFailed, match=said):
        comparison.reference(PLAN, rows, {"k": k})


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (1, (0, 0, -30), r"n = -61 leaves its declared range \[-40, 40\] at tick 1 of the run"),
        (2, (0, -30, 0), r"n = -59 leaves its declared range \[-40, 40\] at tick 2 of the run"),
        (0, (10, 0, 0), r"last = 10 leaves its declared range \[-20, 9\] at tick 0 of the run"),
    ],
)  # fmt: skip
def test_the_state_that_leaves_its_range_is_named_with_its_number_and_tick(at, value, said):
    rows = np.zeros((4, 3))
    rows[at] = value
    with pytest.raises(RunFailed, match=rf"sums: {said} itself; widen the range"):
        comparison.reference(PLAN, rows, {})
    outputs, states = comparison.reference(PLAN, rows, {}, whole=False)
    assert len(outputs) == len(states) == at


@given(st.lists(st.integers(0, 3), max_size=9))
def test_pieces_end_behind_what_follows_a_refused_tick_and_are_all_of_the_run(gaps):
    pieces = comparison._pieces(np.array(gaps), len(gaps))
    assert [k for a, b in pieces for k in range(a, b)] == list(range(len(gaps)))
    ends = {k + 1 for k, n in enumerate(gaps) if n}
    assert ends <= {b for _, b in pieces}
    assert comparison._pieces(None, len(gaps)) == [(0, len(gaps))]


def test_an_input_off_its_range_is_bridged_and_a_run_of_such_ticks_alone_is_none():
    """In the second tick the last input that was good, 1, is taken for 99."""
    rows = np.array([[1.0, 1.0, 1.0], [99.0, 1.0, 1.0], [2.0, 1.0, 1.0]])
    run = comparison.expected_run(PLAN, rows, {})
    assert run.refused == 1
    bridged = np.where(rows == 99.0, 1.0, rows)
    assert run.states == pytest.approx(by_hand(bridged)[1])
    with pytest.raises(BadInput, match="sums: no tick has all its inputs in their declared ranges"):
        comparison.expected_run(PLAN, rows[1:2], {})


@step(period=0.01, y=Output("1"))
def followed(
    n=State("1", 0.0), a=Input("1", lo=2, hi=4, change=0.3), b=Input("1", value=5.0, lo=0),
    c=Input("1", value=(-3.0, 1.0), shape=(2,), hi=0.5),
):  # fmt: skip
    """Inputs with both ends, one, and a largest change."""
    return dict(n=n), dict(y=a + b + c[0])


@pytest.mark.parametrize("width", [1.0, 0.1, 1e-3])
def test_made_up_inputs_fill_their_ranges_about_what_is_declared(width):
    """a: 2 .. 4 about 3, a step of at most 0.27; b: from 0 up; c: up to 0.5, each element."""
    rows = comparison.trial_rows(Plan(followed, "followed", 0.01), width)
    assert rows.shape == (comparison.TRIAL, 4)
    a, b, *c = rows.T
    assert np.abs(np.diff(a)).max() <= 0.27 + 1e-12
    ends = {"a": (2.0, 4.0, 2.0), "b": (0.0, 10.0, 5.0), "c": (-2.0, 0.5, -1.0)}
    for column, (lo, hi, centre) in zip((a, b, *c), (ends[n] for n in "abcc"), strict=True):
        assert column.min() >= lo * width + centre * (1 - width) - 1e-9
        assert column.max() <= hi * width + centre * (1 - width) + 1e-9
    assert np.ptp(b) > 0.9 * 10 * width
    assert np.ptp(c[0]) > 0.9 * 2.5 * width
    assert not np.allclose(c[0], c[1])
    assert len(np.unique(b)) > 150


@step(period=0.01, y=Output("1"))
def open_ended(
    a=Input("1", value=20.0, hi=50), b=Input("1", value=0.25, shape=(2,), lo=-1e38, hi=1e38),
    c=Input("1", value=-6.0, lo=-3), d=Input("1", value=7.0, lo=0, hi=8, change=0.5),
    e=Input("1"),
):  # fmt: skip
    """Inputs without an end, and one that follows."""
    return {}, dict(y=a + b[0] + c + d + e)


@pytest.mark.parametrize("width", [1.0, 0.1, 1e-4])
def test_made_up_inputs_are_multiples_of_the_golden_ratio_each_begun_elsewhere(width):
    """Without an end it is as far away as the value is from 0, and 1 at least."""
    rows = comparison.trial_rows(Plan(open_ended, "open_ended", 0.01), width)
    tick = np.arange(1, comparison.TRIAL + 1)
    ends = [(0.0, 50.0, 20.0), *[(-0.75, 1.25, 0.25)] * 2, (-3.0, 0.0, -3.0), (0.0, 8.0, 7.0),
            (-1.0, 1.0, 0.0)]  # fmt: skip
    for k, (lo, hi, centre) in enumerate(ends):
        share = (tick * (5**0.5 - 1) / 2 + (k + 1) * 2**0.5) % 1.0
        wanted = centre * (1 - width) + (lo + (hi - lo) * share) * width
        if k == 4:
            wanted = comparison._followed(wanted, 0.5)
        assert rows[:, k] == pytest.approx(wanted, abs=2e-6)


def test_a_column_follows_by_nine_tenths_of_a_change_and_stays_where_it_came_to():
    column = np.array([3.0, 3.25, 4.0, 4.0, 0.0, 2.5])
    assert comparison._followed(column, 0.5).tolist() == pytest.approx(
        [3.0, 3.25, 3.7, 4.0, 3.55, 3.1])  # fmt: skip
