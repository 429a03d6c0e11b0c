"""Heads, units and clocks of tables, and marks of numbers, of cells that are written here."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl.tables import numerals, table, times
from slipctl.tables.heads import name_and_unit
from slipctl.tables.numerals import column_of
from slipctl.tables.table import Table, table_of


@pytest.mark.parametrize(
    ("cells", "readings", "clash"),
    [
        (["1,5", "2,25"], {(",", g) for g in ("", ".", " ", "'")}, None),
        (["1.5", "1,5"], set(), (1, 0)),
        (["79.200", "79,2"], set(), (0, 1)),
        (["79,2", "79.200"], set(), (1, 0)),
        (["79,200", "79.2", "1"], set(), (0, 1)),
        (["1.234.567,5", "79.200", "79,2"], {(",", ".")}, None),
        (["1 234,5"], {(",", " ")}, None),
        (["1.2.3"], set(), (0, 0)),
    ],
)  # fmt: skip
def test_marks_that_all_cells_fit_are_left(cells, readings, clash):
    """A column in which thousands of one cell are decimals of another has a clash of both."""
    found = column_of(cells)
    assert set(found.readings) == readings
    assert found.wrong is None
    assert (found.clash is None) == (clash is None)
    if clash is not None and clash[0] != clash[1] and "79" in cells[clash[0]]:
        assert found.clash == clash
    assert found.cells == cells


def test_what_is_no_number_ends_a_column_and_empty_cells_do_not():
    found = column_of(["1.5", "", " - ", "NaN", '="2.5"', "−3.5", "x", "4"])
    assert found.cells == ["1.5", None, None, None, "2.5", "-3.5"]
    assert found.wrong == 6
    values = column_of(["1.5", "", "2,5e3".replace(",", ".")]).values((".", ""))
    assert values[0] == 1.5
    assert np.isnan(values[1])
    assert values[2] == 2500


def test_a_mark_stays_open_where_both_readings_fit():
    assert column_of(["1.234"]).open == "."
    assert column_of(["1,234"]).open == ","
    assert column_of(["1.234", "1.5"]).open == ""
    assert column_of(["1.234", "1.5"]).decimal == "."
    assert column_of(["12", "7"]).open == ""
    assert column_of(["12", "7"]).decimal == ""
    assert column_of(["79.200", "79,2"]).decimal == ""


def test_thousands_beside_decimals_are_two_writers():
    mixed = numerals._mixed
    assert mixed(["99.999", "99,9"], (",", "."))
    assert not mixed(["99.999,9", "99.999", "99,9"], (",", "."))  # one cell has both
    assert not mixed(["99.999"], (",", "."))
    assert not mixed(["99,9"], (",", "."))
    for group in ("", " ", "'"):
        assert not mixed(["99.999", "99,9"], (",", group))


@pytest.mark.parametrize(
    ("head", "found"),
    [
        ("Speed [km/h] (raw)", ("Speed (raw)", "km/h")), ("v [km/h] *10", ("v", "km/h *10")),
        ("v [km/h] x 10", ("v", "km/h x 10")), ("v*10 [km/h]", ("v", "km/h *10")),
        ("v [km/h]", ("v", "km/h")), ("v (m/s)", ("v", "m/s")), ("v {m/s}", ("v", "m/s")),
        ("v <m/s>", ("v", "m/s")), ("  v   of  car [m/s] ", ("v of car", "m/s")),
        ("mu [-]", ("mu", "1")), ("mu [--]", ("mu", "1")), ("mu []", ("mu", "1")),
        ("mu [1]", ("mu", "1")), ("v / (m/s)", ("v", "m/s")), ("v in m/s", ("v", "m/s")),
        ("v in (m/s)", ("v", "m/s")), ("mu in -", ("mu", "1")), ("T in degC", ("T", "degC")),
        ("T in words", ("T in words", "")), ("v, m/s", ("v", "m/s")), ("t / s", ("t", "s")),
        ("t, h", ("t", "h")), ("a, b", ("a, b", "")), ("v km/h", ("v", "km/h")),
        ("v_km/h", ("v", "km/h")), ("speed m/s", ("speed", "m/s")), ("n U/min", ("n", "U/min")),
        ("omega rad/s", ("omega", "rad/s")), ("v / km/h", ("v", "km/h")), ("F / kN", ("F", "kN")),
        ("v, km/h", ("v", "km/h")), ("t/s", ("t", "s")), ("v s", ("v s", "")),
        ("plain", ("plain", "")),
        ("a [b] c", ("a [b] c", "")), ("[m/s]", ("[m/s]", "")),
    ],
)  # fmt: skip
def test_a_head_is_parted_into_name_and_unit(head, found):
    assert name_and_unit(head) == found


@pytest.mark.parametrize(
    ("head", "more", "unit"),
    [
        ("v [km/h]", "km/h", "km/h"), ("v [km/h]", "", "km/h"), ("v", "km/h", "km/h"),
        ("v", "[km/h]", "km/h"), ("v", " (km/h) ", "km/h"), ("v", "<km/h>", "km/h"),
        ("v", "{km/h}", "km/h"), ("v", "-", "1"), ("v", "--", "1"), ("v", "", ""),
        ("v [km/h]", "m/s", "km/h | m/s"), ("v [odd]", "m/s", "m/s"), ("v [m/s]", "odd", "m/s"),
        ("v [odd]", "other", "odd"), ("v [m/s]", "m s^-1", "m/s"), ("v", "(km/h]", "(km/h]"),
    ],
)  # fmt: skip
def test_a_unit_of_the_head_and_of_a_row_are_one(head, more, unit):
    """The one that can be read; both, which cannot be read, where they contradict each other."""
    found = table_of(
        "log", [head, "w [s]"], [np.ones(2), np.zeros(2)], [more, ""], [1, 2], mark=";"
    )
    assert found.units == {"v": unit, "w": "s"}
    assert found.heads == {"v": head, "w": "w [s]"}
    assert list(found.cells) == ["v", "w"]
    assert (found.path, found.mark, list(found.lines)) == ("log", ";", [1, 2])


def test_columns_of_one_name_are_left_out_and_one_without_is_counted():
    heads = ["v [m/s]", " ", "v [km/h]", "w"]
    found = table_of("log", heads, [np.full(1, k) for k in range(4)], [""] * 4, [1])
    assert list(found.cells) == ["column 2", "w"]
    assert [int(c[0]) for c in found.cells.values()] == [1, 3]
    assert set(found.twice) == {"v"}


def test_units_are_the_same_by_what_they_are():
    same = table._one_unit
    assert same("odd", "odd")
    assert same("m/s", "m s^-1")
    assert same("N", "kg m/s^2")
    for one, two in (("km/h", "m/s"), ("m/s", "m/s^2"), ("odd", "m/s"), ("m/s", "odd"),
                     ("odd", "other")):  # fmt: skip
        assert not same(one, two)


@pytest.mark.parametrize(
    ("one", "two", "units", "same"),
    [
        ([0, 1, 2, 3], [5000, 6000, 7000, 8000], ("s", "ms"), True),
        ([0, 1, 2, 3], [5000, 6000, 7000, 8000], ("s", "s"), False),
        ([0, 1, 2, 3], [5000, 6000, 7000, 9000], ("s", "ms"), True),  # within a step
        ([0, 1, 2, 3], [5000, 6000, 7000, 9500], ("s", "ms"), False),
        ([0, 1, 2, 3], [5000, 6000, 7000, 8000], ("s", ""), True),  # by their shares
        ([0, 1, 2, 3], [5000, 6000, 7000, 8000], ("", ""), True),
        ([0, 1, 2, 3], [0, 1, 5, 30], ("", ""), False),
        ([0, 1, np.nan, 3], [5000, 6000, 7000, 8000], ("s", "ms"), True),
        ([np.nan, 1, 2, 3], [4000, np.nan, np.nan, 7000], ("s", "ms"), False),
    ],
)  # fmt: skip
def test_two_clocks_tell_the_same_times_within_a_step(one, two, units, same):
    cells = {"a": np.array(one, float), "b": np.array(two, float)}
    made = Table("log", cells, dict(zip("ab", units, strict=True)), range(4))
    assert times._same_clock(made, "a", "b") == same
    assert times._same_clock(made, "a", "a")


def test_clocks_that_are_texts_are_the_same_if_they_are_equal():
    texts = np.array(["10:00:00", "10:00:01"], object)
    other = np.array(["10:00:00", "10:00:02"], object)
    cells = {"a": texts, "b": texts.copy(), "c": other, "d": np.array([0.0, 1.0])}
    made = Table("log", cells, dict.fromkeys(cells, ""), range(2))
    assert times._same_clock(made, "a", "b")
    assert not times._same_clock(made, "a", "c")
    assert times._same_clock(made, "a", "d")  # of two kinds nobody can tell
    assert times._same_clock(made, "d", "a")
