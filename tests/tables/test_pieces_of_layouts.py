"""Steps of reading a layout: kinds of rows, heads among them, what a mark is worth, what fits."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from slipctl.errors import BadInput
from slipctl.tables import layout
from slipctl.tables.layout import Layout

PATH = Path("log.csv")


@pytest.mark.parametrize(
    ("cells", "kind"),
    [
        (["a", "1.5"], "data"), (["a", "-1,5"], "data"), (["a", "b", "1e5"], "data"),
        (["a", "10:00:00"], "data"), (["#N/A", "7"], "data"), (["a", "b"], "head"),
        (["a", "-"], "head"), (["a", "", "b"], "head"), (["[km/h]", ""], "head"),
        (["", "( °C)"], "head"), (["km/h"], ""), (["word", ""], ""), (["word"], ""),
        (["", ""], "gap"), (["-", "nan", ""], "gap"), (["-", ""], "gap"), ([""], ""), (["-"], ""),
    ],
)  # fmt: skip
def test_a_row_is_of_a_head_of_data_a_gap_or_none(cells, kind):
    assert layout._kind(cells) == kind


H, D, GAP, WORD = ["a", "b"], ["1", "2"], ["", ""], ["word"]


@pytest.mark.parametrize(
    ("rows", "groups"),
    [
        ([H, D, D], [(0, 1)]), ([H, D], [(0, 1)]), ([WORD, H, H, GAP, WORD, D, D], [(1, 3)]),
        ([H, D, H, D, D], [(2, 3)]), ([H, D, D, H, H, D, D, H], [(0, 1), (3, 5)]),
        ([H, *8 * [GAP], D, D], [(0, 1)]), ([H, *9 * [GAP], D, D], []), ([D, D], []), ([H, H], []),
    ],
)  # fmt: skip
def test_a_group_of_heads_has_data_below(rows, groups):
    """Two rows of data, or one that ends the text, within nine rows."""
    found = layout._grouped(list(enumerate(rows, 1)))
    assert found.groups == groups
    kinds = {"a": "head", "1": "data", "": "gap", "word": ""}
    assert found.kinds == [kinds[r[0]] for r in rows]


def test_a_mark_is_worth_as_many_cells_as_fit_below_the_last_head():
    """Of 300 rows 240 are as long as the last row of the head; of 840 cells 60 are words."""
    good, odd = ["1", "10:00:00", ""], ["1", "word"]
    rows = [["x"], H, *3 * [odd], ["t", "v", "w", "x"], ["s", "m", "m"], *240 * [good], *60 * [odd],
            *50 * [["so", "on"]]]  # fmt: skip
    tables = layout._Tables(list(enumerate(rows, 1)), [], [(1, 2), (5, 7)])
    for mark, worth in ((";", 1.33), (",", 1.33), ("  ", 1.23), (" ", 1.23)):
        assert layout._score(tables, mark) == pytest.approx(worth, abs=1e-12)


LINES = ["# c", "a;b; c", '"x', 'y"; 2;3', "", "  # d;e;f", '4; "5;6";7', " ; ;", "#N/A;8;9"]


def test_rows_have_the_lines_in_which_they_begin():
    """A cell of two lines, comments between, and a blank before a quote."""
    wanted = [(2, ["a", "b", "c"]), (3, ["x\ny", "2", "3"]), (7, ["4", "5;6", "7"]),
              (9, ["#N/A", "8", "9"])]  # fmt: skip
    assert layout._rows(LINES, ";", True) == wanted
    text = ["a  b c", "", "# d  e", "  1 \t 2  3"]
    assert layout._rows(text, "  ", True) == [(1, ["a", "b c"]), (4, ["1", "2", "3"])]
    assert layout._rows(text, " ", True) == [(1, ["a", "b", "c"]), (4, ["1", "2", "3"])]
    assert layout._rows(["1\t 2", "3\t4"], "\t", True) == [(1, ["1", "2"]), (2, ["3", "4"])]
    loose = ['1;"2"3', "4;5"]
    assert layout._rows(loose, ";", False) == [(1, ["1", "23"]), (2, ["4", "5"])]
    with pytest.raises(csv.Error):
        layout._rows(loose, ";", True)


@pytest.mark.parametrize(("lines", "fine"), [(21, True), (22, False)])
def test_a_cell_has_not_many_lines(lines, fine):
    text = ["t;v", "0;1", '2;"' + "\n" * (lines - 1) + '"', "3;4"]
    text = "\n".join(text).split("\n")
    if fine:
        assert [n for n, _ in layout._rows(text, ";", True)] == [1, 2, 3, 3 + lines]
    else:
        with pytest.raises(csv.Error, match="line 3: a quote is not closed"):
            layout._rows(text, ";", True)


HEADS = [
    ([["t", "v"]], 0, []),
    ([["x", "y", "z"], ["t", "v"], ["s", "m/s"]], 1, ["s", "m/s"]),
    ([["x", "y"], ["s", "m/s"], ["t", "v"]], 2, ["s", "m/s"]),
    ([["x", "y"], ["t", "v"], ["float", "Int"], ["s", "m/s"]], 1, ["s", "m/s"]),
    ([["t", "v"], ["float", "int"]], 0, []),
    ([["float", "int"]], 0, []),
    ([["s", "m/s", "x"], ["t", "v"]], 1, []),
    ([["x", "y"], ["go", "by"]], 1, []),
]


@pytest.mark.parametrize(("rows", "at", "units"), HEADS)
def test_a_head_is_the_last_row_of_words_but_for_units_and_types(rows, at, units):
    found = layout._head_of(list(enumerate(rows, 11)))
    assert found == (11 + at, rows[at], units)


def fitted(head, units, rows, mark=";"):
    made = Layout(head, units, list(enumerate(rows, 2)), mark, [])
    layout._fit_rows(PATH, made)
    return made


def test_rows_are_as_long_as_the_head():
    rows = [["1", "2", "3", "", ""], ["4", "5"], ["6", "7", "8"], ["km/h"], ["9", "10", "11", ""],
            ["end"], ["of", "it"]]  # fmt: skip
    found = fitted(["t", "v", "w", "", ""], ["s"], rows)
    assert found.head == ["t", "v", "w"]
    assert found.units == ["s", "", ""]
    assert found.rows == [(2, ["1", "2", "3"]), (4, ["6", "7", "8"]), (6, ["9", "10", "11"])]
    assert found.notes == [
        "log.csv: 2 rows with fewer cells than the head, left out: the first in line 3",
        "log.csv: 2 lines behind the table, left out: the first in line 7",
    ]
    longer = fitted(["t", "v"], ["s", "m", "K"], [["1", "2"], ["3", "4"]])
    assert longer.units == ["s", "m"]
    assert not longer.notes


@pytest.mark.parametrize(("many", "fine"), [(118, False), (122, True)])
def test_one_row_of_twenty_may_be_short(many, fine):
    """Six of them; of a few rows three may be."""
    rows = [["1"] if 10 <= k < 16 else ["1", "2"] for k in range(many)]
    if fine:
        assert len(fitted(["t", "v"], [], rows).rows) == many - 6
    else:
        with pytest.raises(BadInput, match=r"line 12 has 1 cells, its head 2; so have 5 others"):
            fitted(["t", "v"], [], rows)
    few = [["1", "2"], *3 * [["1"]], ["3", "4"]]
    assert fitted(["t", "v"], [], few).rows == [(2, ["1", "2"]), (6, ["3", "4"])]
    with pytest.raises(BadInput, match=r"line 3 .* so have 3 others"):
        fitted(["t", "v"], [], [["1", "2"], *4 * [["1"]], ["3", "4"]])


MISFIT = [
    (";", [["0", "1"], ["1", "2", "", "3"], ["2", "3", "4"]], r"line 3 has 4 cells, its head 2: '3'"
     " is beyond it$"),
    (",", [["0", "1"], ["1", "2"], ["2", "3", "45"]], "line 4 .* 3 cells, its head 2: '45' is bey.*"
     "Part cells by ;"),
    (",", [["0", "01"], ["1", "2"]], "line 2: '0,01' looks like one number; a decimal comma"),
    (",", [["7", "2"], ["8", ""], ["9", "30"], ["10", "05"]], "line 5: '10,05' looks like one"),
    (";", [["0"], ["1"]], "line 2 has 1 cells, its head 2, and no line has all"),
    (";", [["s"], ["0", "1"], ["1", "2"]], "line 2 looks like a row of units, but has fewer"),
]  # fmt: skip


@pytest.mark.parametrize(("mark", "rows", "said"), MISFIT)
def test_the_first_row_that_does_not_fit_is_told(mark, rows, said):
    with pytest.raises(BadInput, match=said):
        fitted(["t", "v"], [], rows, mark)


@pytest.mark.parametrize(
    "rows",
    [
        [["0", "5"], ["1", "10"], ["2", "0"]], [["0", "05"], ["1", "x"]], [["a", "05"], ["1", "6"]],
        [["1.5", "05"], ["2", "6"]],
    ],
)  # fmt: skip
def test_numbers_that_are_no_halves_are_kept(rows):
    assert [c for _, c in fitted(["t", "v"], [], rows, ",").rows] == rows


def test_a_cell_below_no_name_is_told_where_commas_part_cells():
    rows = [["0", "", "1", ""], ["1", "", "2", "7.5"], ["2", "3", "4", ""]]
    head = ["t", "", "v", "", "w"]
    full = [[*r, "0"] for r in rows]
    with pytest.raises(BadInput, match=r"line 4: cell 2, '3', has no name in the head; a decimal"):
        fitted(list(head), [], full, ",")
    full[2][1] = ""
    with pytest.raises(BadInput, match=r"line 3: cell 4, '7\.5', has no name"):
        fitted(list(head), [], full, ",")
    assert fitted(list(head), [], full, ";").rows[1] == (3, ["1", "", "2", "7.5", "0"])
