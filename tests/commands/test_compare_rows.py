"""Rows of ``slipctl compare``: what differs, metric by metric, as its numbers say by definition."""

import math
import time
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.commands import compare
from slipctl.commands.compare import Side
from slipctl.run.sweep.sweep_store import FILE

values = st.lists(st.floats(-1e3, 1e3) | st.just(math.inf), min_size=1, max_size=9)


def numbers(**given):
    """Parameters as a run tells them."""
    return {n: {"value": v, "unit": "kg"} for n, v in given.items()}


def test_every_loop_that_two_sides_have_is_compared_whatever_one_has_alone():
    """In any order of the loops: one that stands alone ends nothing."""
    same, other = numbers(m=1.0), numbers(m=2.0)
    for order in (("alone", "both"), ("both", "alone")):
        one = {"alone": same, "both": same}
        sides = [Side("a", parameters={n: one[n] for n in order}),
                 Side("b", parameters={"both": other})]  # fmt: skip
        assert compare.changes(sides) == [{"what": "both: m", "unit": "kg", "values": ["1", "2"]}]


def test_what_a_side_does_not_say_is_a_dash_and_what_is_alike_is_no_row():
    sides = [Side("a", {"seed": "1", "study": "s"}), Side("b", {"study": "s"})]
    assert compare.changes(sides) == [{"what": "seed", "unit": "", "values": ["1", "-"]}]
    sides = [Side("a", parameters={"x": numbers(m=1.0, J=3.0)}),
             Side("b", parameters={"x": numbers(m=1.0)})]  # fmt: skip
    assert compare.changes(sides) == [{"what": "x: J", "unit": "kg", "values": ["3", "-"]}]


@pytest.mark.parametrize(
    ("value", "labels", "names"),
    [
        ([1.0, 2.0, 3.0], ("dry", "wet", "ice"), ["m, dry", "m, wet", "m, ice"]),
        ([1.0, 2.0, 3.0], ("dry", "wet"), ["m, 1", "m, 2", "m, 3"]),
        ([1.0, 2.0], (), ["m, 1", "m, 2"]),
        ([1.0], ("dry",), ["m"]),
        (1.0, (), ["m"]),
    ],
)
def test_rows_of_a_metric_have_the_names_of_their_sections_or_their_numbers(value, labels, names):
    side, rows = Side("a"), {}
    compare._put(side, rows, "m", value, "s", labels)
    assert list(rows) == names
    assert side.units == dict.fromkeys(names, "s")
    assert [float(v[0]) for v in rows.values()] == (value if isinstance(value, list) else [value])


@given(values, values)
def test_a_row_has_medians_spread_and_the_difference_of_medians(a, b):
    """Of sides on other draws; a value that never came is infinite and counts."""
    sides = [Side(n, metrics={"s/x": {"m": np.array(v)}}, units={"m": "s"})
             for n, v in (("a", a), ("b", b))]  # fmt: skip
    row = compare._row(sides, ["s/x", "s/x"], "m")
    assert row["unit"] == "s"
    assert row["never"] == [sum(map(math.isinf, v)) for v in (a, b)]
    for k, v in enumerate((a, b)):
        assert row["values"][k] == compare.quantiles(np.array(v), (0.5,))[0]
        assert (row["spread"][k] is None) == (len(v) == 1)
    first, second = row["values"]
    if math.isinf(first) and math.isinf(second):
        assert row["difference"] == [None]
        assert row["beyond_spread"] == [False]
    else:
        assert row["difference"] == [second - first]
    assert row["paired"] == [None]


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=8))
def test_runs_on_the_same_draws_are_compared_run_by_run(pairs):
    """However the other side has ordered them, and beside draws that it has alone."""
    a, b = (np.array(v) for v in zip(*pairs, strict=True))
    draws = [f"draw {k}" for k in range(len(pairs))]
    one = Side("a", draws=draws)
    other = Side("b", draws=[*reversed(draws), "alone"])
    each = compare._paired(one, a, other, np.r_[b[::-1], 99.0])
    assert sorted(each) == sorted(b - a)
    assert compare._paired(Side("a"), a, other, b) is None


@pytest.mark.parametrize(
    ("spreads", "medians", "beyond"),
    [
        (([0.0, 1.0], [2.0, 3.0]), (0.5, 2.5), True),
        (([2.0, 3.0], [0.0, 1.0]), (2.5, 0.5), True),
        (([0.0, 2.0], [1.0, 3.0]), (1.0, 2.0), False),
        (([0.0, 2.0], [2.0, 3.0]), (1.0, 2.5), False),
        ((None, [2.0, 3.0]), (1.0, 2.5), True),
        ((None, None), (1.0, 1.0), False),
    ],
)
def test_spreads_are_apart_where_they_do_not_touch(spreads, medians, beyond):
    runs = [[m] if s is None else [s[0]] * 9 + [m] * 3 + [s[1]] * 9
            for s, m in zip(spreads, medians, strict=True)]  # fmt: skip
    sides = [Side(n, metrics={"s/x": {"m": np.array(v)}}) for n, v in zip("ab", runs, strict=True)]
    row = compare._row(sides, ["s/x", "s/x"], "m")
    assert row["spread"] == list(spreads)
    assert row["beyond_spread"] == [beyond]


def test_sides_of_which_some_runs_alone_reach_a_metric_differ():
    """Both medians are *never*, and one of three that stop there is not left out of the table."""
    stop = {"none": [math.inf] * 3, "wsp": [math.inf, 560.0, math.inf]}
    sides = [Side(n, metrics={"s/x": {"m": np.array(v)}}, draws=list("abc"))
             for n, v in stop.items()]  # fmt: skip
    row = compare._row(sides, ["s/x", "s/x"], "m")
    assert row["difference"] == [0.0]
    assert compare.tells_apart(row)
    assert not compare.tells_apart(compare._row([sides[0]] * 2, ["s/x", "s/x"], "m"))
    told = "\n".join(compare.metric_tables(["none", "wsp", "wsp"], {"metric": [
        compare._row([*sides, sides[1]], ["s/x"] * 3, "m")]}))  # fmt: skip
    assert "never (never .. never), 3 never" in told
    assert "-inf" in told


def test_spreads_go_from_5_to_95_percent_of_the_runs():
    """Of the values of each side, and of the differences of runs on the same draws."""
    every = np.arange(101.0)
    draws = [str(k) for k in range(101)]
    sides = [Side(n, metrics={"s/x": {"m": v}}, draws=draws)
             for n, v in (("a", 0 * every), ("b", every))]  # fmt: skip
    row = compare._row(sides, ["s/x", "s/x"], "m")
    assert row["values"] == [0.0, 50.0]
    assert row["spread"] == [[0.0, 0.0], pytest.approx([5.0, 95.0])]
    assert row["paired"] == [pytest.approx([5.0, 95.0])]
    assert row["difference"] == [50.0]


@pytest.mark.parametrize("order", list(permutations(["none", "never", "draws", "far"])))
def test_a_side_without_a_metric_ends_no_row(order):
    """Each side behind the first has its difference, whatever stands before it."""
    first = Side("a", metrics={"s/x": {"m": np.array([math.inf])}}, draws=["one"])
    values = {"none": {}, "never": {"m": np.array([math.inf])}, "draws": {"m": np.array([2.0])},
              "far": {"m": np.array([3.0])}}  # fmt: skip
    sides = [Side(n, metrics={"s/x": values[n]}, draws=["one"] * (n == "draws")) for n in order]
    row = compare._row([first, *sides], ["s/x"] * 5, "m")
    found = dict(zip(order, row["difference"], strict=True))
    assert found == {"none": None, "never": None, "draws": -math.inf, "far": -math.inf}
    assert [p is not None for p in row["paired"]] == [n == "draws" for n in order]
    assert dict(zip(order, row["beyond_spread"], strict=True)) == {
        "none": False, "never": False, "draws": True, "far": True}  # fmt: skip


def test_sides_have_a_letter_each_and_beyond_z_a_number():
    sides = [Side(f"run{k}", state="stopped" if k == 1 else "") for k in range(28)]
    changed = [{"what": f"p{k}", "unit": "m", "values": ["1"] * 28} for k in range(compare.LISTED)]
    said = compare.text(sides, changed, {})
    lines = said.splitlines()
    assert lines[:2] == ["A  run0", "B  run1 (stopped)"]
    assert lines[25:28] == ["Z  run25", "27  run26", "28  run27"]
    assert "more; --json has all" not in said
    more = compare.text(sides, [*changed, changed[0], changed[0]], {})
    assert "2 more; --json has all" in more
    assert "only metrics differ" in compare.text(sides, [], {})


@pytest.mark.parametrize("many", [2, 3])
def test_every_table_of_metrics_has_its_rows_and_differences(many):
    """Two sides have their difference beside them, more have a table of what differs."""
    names = list("ABC"[:many])
    sides = [Side(n, metrics={"s/x": {"m": np.array([2.0 + k]), "same": np.array([7.0])}},
                  units={"m": "s", "same": "m"}) for k, n in enumerate(names)]  # fmt: skip
    rows = [compare._row(sides, ["s/x"] * many, m) for m in ("m", "same")]
    parts = compare.metric_tables(names, {"first": rows, "second": rows[:1]})
    said = [[" ".join(line.split()) for line in part.splitlines()] for part in parts]
    if many == 2:
        assert [s[0] for s in said] == ["first unit A B B - A", "second unit A B B - A"]
        assert any(line.startswith("m s 2 3 ") for line in said[0])
        assert any(line.startswith("same m 7 7") for line in said[0])
    else:
        heads = ["first unit A B C", "difference unit B - A C - A"]
        assert [s[0] for s in said] == [*heads, "second unit A B C", heads[1]]
        assert any(line == "m s 2 3 4" for line in said[0])
        assert any(line.startswith(("m s 1 2", "m s +1 +2")) for line in said[1])
        assert not any(line.startswith("same") for line in said[1])
    assert not any("median" in line or "never" in line for s in said for line in s)


def test_a_folder_of_several_sweeps_is_these_in_the_order_in_which_they_were_made(tmp_path):
    for name in ("b", "a"):
        (tmp_path / "many" / name).mkdir(parents=True)
        (tmp_path / "many" / name / FILE).write_text("x")
        time.sleep(0.02)
    whole = str(tmp_path / "many")
    assert compare._inside(whole) == [f"{whole}/b", f"{whole}/a"]
    assert compare._inside(f"{whole}/a") == [f"{whole}/a"]
    assert compare._inside(str(tmp_path)) == [str(tmp_path)]
    (tmp_path / "many" / "metrics.json").write_text("{}")
    assert compare._inside(whole) == [whole]
    (tmp_path / "many" / "metrics.json").unlink()
    (tmp_path / "many" / FILE).write_text("x")
    assert compare._inside(whole) == [whole]


def test_of_many_changes_the_first_are_told_and_how_many_more_there_are():
    """A long word is cut, a short one is not."""
    many = compare.LISTED + 3
    sides = [Side(n, {f"key {k:03d}": f"{n}{k}" for k in range(many)}) for n in "ab"]
    text = compare.text(sides, compare.changes(sides), {})
    assert "3 more; --json has all" in text
    assert [f"key {k:03d}" in text for k in range(many)] == [True] * compare.LISTED + [False] * 3
    assert compare._said("x" * 40) == "x" * 40
    assert compare._said("abcdefghijklmnop" + "x" * 30) == "abcdefghijkl..."
