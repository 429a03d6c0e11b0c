"""Head, units and rows of a log as text, and what is told of rows that do not fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from slipctl.errors import BadInput
from slipctl.tables.layout import LONGEST, layout_of


def layout(tmp_path: Path, text: str):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    return layout_of(path)


ROWS = "0;1;2\n1;2;3\n2;3;4\n"
READ = {
    "as it is": ("t;v;w\n" + ROWS, ["t", "v", "w"], [2, 3, 4], ["head in line 1"]),
    "behind words": ("My log\n\nt;v;w\n" + ROWS, ["t", "v", "w"], [4, 5, 6], ["line 3 behind 2 "]),
    "a comment": ("# a b\n#t;v;w\n" + ROWS, ["t", "v", "w"], [3, 4, 5], ["head in line 2"]),
    "comments between": ("t;v;w\n0;1;2\n# hm\n1;2;3\n", ["t", "v", "w"], [2, 4], []),
    "empty rows": ("t;v;w\n0;1;2\n\n;;\n1;2;3\n", ["t", "v", "w"], [2, 5], []),
    "units": ("t;v;w\ns;m/s;km/h\n" + ROWS, ["t", "v", "w"], [3, 4, 5], ["units in a row of"]),
    "units above": ("s;m/s;km/h\nt;v;w\n" + ROWS, ["t", "v", "w"], [3, 4, 5], ["units in a row"]),
    "units with a 1": ("t;v;w\ns;1;1\n" + ROWS, ["t", "v", "w"], [3, 4, 5], ["units in a row of"]),
    "types": ("t;v;w\nfloat;float;float\n" + ROWS, ["t", "v", "w"], [3, 4, 5], []),
    "sep": ("sep=|\nt|v|w\n0|1|2\n1|2|3\n", ["t", "v", "w"], [3, 4], []),
    "tabs": ("t\tv\tw\n" + ROWS.replace(";", "\t"), ["t", "v", "w"], [2, 3, 4], []),
    "blanks": ("t   v   w\n" + ROWS.replace(";", "   "), ["t", "v", "w"], [2, 3, 4], []),
    "more marks": ("t;v;w;;\n" + ROWS, ["t", "v", "w"], [2, 3, 4], []),
    "quotes": ('t;"v;x";w\n' + ROWS, ["t", "v;x", "w"], [2, 3, 4], []),
    "the head again": ("t;v;w\n" + ROWS + "t;v;w\n5;6;7\n6;7;8\n", ["t", "v", "w"], [2, 3, 4, 6, 7],
                       ["the head stands again in line 5"]),
    "an end": ("t;v;w\n" + ROWS + "end of log\nbye\n", ["t", "v", "w"], [2, 3, 4],
               ["2 lines behind the table, left out: "]),
    "a short row": ("t;v;w\n0;1;2\n1;2\n2;3;4\n", ["t", "v", "w"], [2, 4],
                    ["1 row with fewer cells than the head, left out: line 3"]),
}  # fmt: skip


@pytest.mark.parametrize("what", READ)
def test_a_text_has_this_head_and_these_rows(what, tmp_path):
    text, head, lines, notes = READ[what]
    found = layout(tmp_path, text)
    assert found.head == head
    assert [n for n, _ in found.rows] == lines
    assert {len(cells) for _, cells in found.rows} == {3}
    assert found.rows[0][1] == ["0", "1", "2"]
    for words in notes:
        assert any(words in line for line in (*found.notes, *found.done)), (found.notes, found.done)
    wanted = {"units": ["s", "m/s", "km/h"], "units above": ["s", "m/s", "km/h"],
              "units with a 1": ["s", "1", "1"]}  # fmt: skip
    assert found.units == wanted.get(what, ["", "", ""])
    if not notes or "left out" not in notes[0]:
        assert not any("left out" in n for n in found.notes)


REFUSED = {
    "no rows": ("t;v;w\n", "has a head, t;v;w, and no row of numbers below it"),
    "no head": ("0;1;2\n1;2;3\n", "has no head above rows of numbers"),
    "nothing": ("\n\n", "has no head above rows of numbers"),
    "beyond the head": ("t;v\n0;1\n1;2;7\n", "line 3 has 3 cells, its head 2: '7' is beyond it$"),
    "a decimal comma": ("t,v\n0,1\n1,2,7\n", "'7' is beyond it; a decimal comma between commas"),
    "a cell without a name": ("t,,w\n0,,2\n1,5,3\n", "line 3: cell 2, '5', has no name"),
    "no row has all": ("t;v;w;x\n0;1;2\n1;2;3\n", "line 2 has 3 cells, its head 4, and no line"),
    "units that lack a cell": ("t v\n km/h\n0 1\n1 2\n2 3\n", "line 2 looks like a row of units"),
    "many short rows": ("t;v;w\n" + "0;1;2\n1;2\n" * 5 + "3;4;5\n",
                        "line 3 has 2 cells, its head 3; so have 4 others"),
    "halves of numbers": ("t,v,w\n0,79,05\n1,79,10\n", "line 2: '79,05' looks like one number"),
    "two tables": ("t;v\n0;1\n1;2\na;b\n1;2\n2;3\nt;v\n3;4\n4;5\n",
                   "line 7: two tables in one file; cut it there"),
    "a second table": ("t;v\n" + "0;1\n" * 31 + "a;b\n1;2\n2;3\n",
                       "line 33: a second table begins; cut the file there"),
    "a quote": ('t;v\n0;"1\n' + "1;2\n" * 30, "a quote is not closed|quotes stand in pairs"),
    "a long line": ("t;v\n0;" + "1" * LONGEST + "\n", f"line 2 has {LONGEST + 2} letters"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_rows_that_do_not_fit_are_refused_with_their_line(what, tmp_path):
    text, said = REFUSED[what]
    with pytest.raises(BadInput, match=said):
        layout(tmp_path, text)
