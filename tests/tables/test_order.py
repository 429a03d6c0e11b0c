"""Rows in order of time: what is written late, twice or wildly, and where a further run begins."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl.errors import BadInput
from slipctl.tables.columns import expression_of
from slipctl.tables.order import in_order
from slipctl.tables.table import read_table


def ordered(times, alike=()):
    """Order of times; rows of which a pair stands in ``alike`` have the same cells."""

    def same(k, n):
        return (k, n) in alike

    return in_order(np.array(times, float), lambda k: f"line {k + 2}", same, "log.csv: t")


EVEN = list(range(12))
ODD = [  # times, kept rows, begins of further runs, what is said
    (EVEN, EVEN, [], ""),
    ([0, 1, np.nan, 2, 3], [0, 1, 3, 4], [], "1 row without a time, left out: line 4"),
    # row 6 was written late, by one row and by four; by six is beyond what is looked for
    (
        [0, 1, 3, 2, 4, 5, 6],
        [0, 1, 3, 2, 4, 5, 6],
        [],
        "1 row written late, sorted by time: line 5",
    ),
    ([0, 1, 3, 4, 5, 6, 2, 7, 8], [0, 1, 6, 2, 3, 4, 5, 7, 8], [], "written late"),
    # a time out of order: the row before, or the row itself, is left out
    ([0, 1, 2, 33, 4, 5, 6, 7], [0, 1, 2, 4, 5, 6, 7], [], "out of order, left out: line 5"),
    ([0, 1, 2, 3, -9, 5, 6, 7], [0, 1, 2, 3, 5, 6, 7], [], "out of order, left out: line 6"),
    # left out where one row is missing, to half a step; else a further run begins
    *(
        (
            [0, 1, 2, 3, -9, *(3 + d + k for k in range(8))],
            [*range(4), *range(5, 13)] if 1.5 < d < 2.5 else list(range(13)),
            [] if 1.5 < d < 2.5 else [4],
            "out of order" if 1.5 < d < 2.5 else "goes back",
        )
        for d in (1.4, 1.6, 2.4, 2.6)
    ),
    *(
        (
            [0, 1, 2, 33, *(2 + d + k for k in range(8))],
            [0, 1, 2, *range(4, 12)] if 1.5 < d < 2.5 else list(range(12)),
            [] if 1.5 < d < 2.5 else [4],
            "out of order" if 1.5 < d < 2.5 else "goes back",
        )
        for d in (1.4, 1.6, 2.4, 2.6)
    ),
    # written late by a quarter of a step off its place, and by more
    ([0, 1, 4, 2.24, *range(5, 12)], [0, 1, 3, 2, *range(4, 11)], [], "written late"),
    ([0, 1, 4, 1.8, *range(5, 12)], [0, 1, 3, 2, *range(4, 11)], [], "written late"),
    ([0, 1, 4, 2.26, *range(5, 12)], list(range(11)), [3], "the time goes back"),
    ([0, 1, 2, 2, 3, 4], [0, 1, 3, 4, 5], [], "1 row with the time of the row before"),
    ([0, 1, 2, 3, 0, 1, 2, 3], list(range(8)), [4], "line 6: the time goes back from 3 s to 0 s"),
    ([5, 6, 7, 5, 6, 5, 6, 7], list(range(8)), [3, 5], "run 3 begins there"),
]


@pytest.mark.parametrize(("times", "rows", "begins", "said"), ODD)
def test_rows_are_put_in_order_and_what_was_done_is_said(times, rows, begins, said):
    found = ordered(times)
    assert list(found.rows) == rows
    assert found.begins == begins
    assert any(said in line for line in found.notes) if said else not found.notes
    t = np.array(times, float)[found.rows]
    for begin, end in zip([0, *begins], [*begins, len(t)], strict=True):
        assert (np.diff(t[begin:end]) > 0).all()


def test_a_row_that_was_written_twice_is_left_out():
    found = ordered([0, 1, 2, 3, 2, 4, 5], alike={(2, 4)})
    assert list(found.rows) == [0, 1, 2, 3, 5, 6]
    assert "1 row repeated, left out: line 6" in found.notes


REFUSED = [
    ([1, np.nan], "fewer than two different times"),
    ([1, 1, 1], "fewer than two different times"),
    ([3, 2, 1], "the times fall from row to row"),
    ([5, 0, 1, 2, 3], "the time goes back in line 3, after a single row"),
    ([0, 1, 2, 3, 0], "the time goes back in line 6, the last row; remove it"),
    ([0, 1, 2, 3, 0, 1, 2, 3, 0], "the time goes back in line 10, the last row; remove it"),
    ([*range(9)] * 60, "the time goes back again and again"),
    ([k // 2 for k in range(20)], "10 rows have the time of the row before, the first in line 3"),
]


@pytest.mark.parametrize(("times", "said"), REFUSED)
def test_times_in_no_order_are_refused(times, said):
    with pytest.raises(BadInput, match=said):
        ordered(times)


@pytest.mark.parametrize(("many", "fine"), [(118, False), (122, True)])
def test_one_row_of_twenty_may_be_late(many, fine):
    """Six of them."""
    times = list(range(many))
    for k in range(10, 70, 10):
        times[k], times[k + 1] = times[k + 1], times[k]
    if fine:
        found = ordered(times)
        assert np.array(times)[found.rows].tolist() == list(range(many))
        assert found.notes == ["6 rows written late, sorted by time: the first in line 13"]
    else:
        with pytest.raises(BadInput, match="again and again, the last time in line 63; sort the"):
            ordered(times)


@pytest.mark.parametrize(("equal", "fine"), [(20, True), (21, False)])
def test_one_row_of_five_may_have_the_time_of_the_row_before(equal, fine):
    times = sorted([*range(100 - equal), *range(10, 10 + equal)])
    if fine:
        assert len(ordered(times).rows) == 80
    else:
        with pytest.raises(BadInput, match="21 rows have the time of the row before, the first in"):
            ordered(times)


def test_a_row_that_stands_in_a_run_before_is_not_written_twice():
    """It begins a further run: what is like it stands before the run that is read."""
    times = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 1, 2]
    found = ordered(times, alike={(k, 12) for k in (1, 5)})
    assert found.begins == [4, 8, 12]
    assert list(found.rows) == list(range(14))
    again = ordered([*times[:12], 1.0, 4, 5], alike={(9, 12)})
    assert again.begins == [4, 8]
    assert "1 row repeated, left out: line 14" in again.notes


def test_columns_are_found_in_an_expression_with_their_units(tmp_path):
    """The longest name first, letters as they stand before any others, one unit of each."""
    path = tmp_path / "log.csv"
    path.write_text("time [s];V;v;wheel speed;wheel\n0;1;2;3;4\n1;5;6;7;8\n", encoding="utf-8")
    table = read_table(path)

    def found(text):
        made = expression_of(text, table)
        return made.text, dict(made.columns), {k: u for k, u in made.told.items() if u}

    assert found("V [m/s] - v") == ("V - v", {"V": "V", "v": "v"}, {"V": "m/s"})
    assert found("v [km/h]") == ("v", {"v": "v"}, {"v": "km/h"})
    assert found("WHEEL") == ("wheel", {"wheel": "wheel"}, {})
    (key,) = expression_of("2*wheel speed [rpm]", table).columns
    assert found("2*wheel speed [rpm]") == (f"2*{key}", {key: "wheel speed"}, {key: "rpm"})
    assert key.isidentifier()
    assert found("2*wheels") == ("2*wheels", {}, {})
    with pytest.raises(BadInput, match="--map gives v in m/s and in km/h; write one unit"):
        expression_of("v [m/s] + v [km/h]", table)


def test_columns_that_would_have_one_identifier_have_two(tmp_path):
    """Each keeps its unit."""
    path = tmp_path / "log.csv"
    path.write_text("time [s];wheel speed;wheel.speed;v\n0;1;2;3\n1;5;6;7\n", encoding="utf-8")
    made = expression_of("wheel.speed [rpm] - wheel speed [km/h]*v", read_table(path))
    first, second = "wheel_speed__", "wheel_speed___"
    assert made.text == f"{first} - {second}*v"
    assert made.columns == {first: "wheel.speed", second: "wheel speed", "v": "v"}
    assert made.told == {first: "rpm", second: "km/h", "v": ""}
    assert not made.plain
    assert expression_of(" wheel speed ", read_table(path)).plain
