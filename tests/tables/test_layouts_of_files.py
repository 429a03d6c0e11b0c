"""Files whose head stands behind other lines, and letters in which a file is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from slipctl.errors import BadInput
from slipctl.tables.layout import PREAMBLE, SAMPLE, layout_of, text_of


def read(tmp_path: Path, text: str):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    found = layout_of(path)
    told = [line.removeprefix(f"{path}: ") for line in (*found.done, *found.notes)]
    return found, told


def lines(first: int, last: int, mark: str = ";") -> str:
    return "".join(f"{k}{mark}{k + 1}{mark}{k + 2}\n" for k in range(first, last + 1))


def test_a_head_that_stands_three_times_is_left_out_with_its_units(tmp_path):
    head = "t;v;w\ns;m/s;%\n"
    text = ("Wagen\n" + head + lines(4, 6) + head + lines(9, 10) + head + lines(13, 15)
            + "end\nbye;to;all\n")  # fmt: skip
    found, told = read(tmp_path, text)
    assert (found.head, found.units, found.mark) == (["t", "v", "w"], ["s", "m/s", "%"], ";")
    assert found.rows == [(k, [f"{k}", f"{k + 1}", f"{k + 2}"]) for k in (4, 5, 6, 9, 10, 13, 14,
                                                                        15)]  # fmt: skip
    assert told == [
        "read as utf-8, ';' between cells",
        "head in line 2 behind 1 other lines, units in a row of their own",
        "the head stands again in line 7 and 1 times more",
        "2 lines behind the table, left out: the first in line 16",
    ]


def test_a_head_stands_behind_two_short_tables_and_not_behind_a_long_one(tmp_path):
    """Pairs of names and numbers come before; more than 30 rows of numbers are a table."""
    text = "a;b;c\n" + lines(2, 21) + "d;e;f\n" + lines(23, 42)
    found, told = read(tmp_path, text + "t;v;w\n" + lines(44, 46))
    assert found.head == ["t", "v", "w"]
    assert [n for n, _ in found.rows] == [44, 45, 46]
    assert told == ["read as utf-8, ';' between cells", "head in line 43 behind 42 other lines"]
    text = "a;b;c\n" + lines(2, 3) + "d;e;f\n" + lines(5, 34) + "t;v;w\n"
    assert read(tmp_path, text + lines(36, 38))[0].head == ["t", "v", "w"]
    text = "a;b;c\n" + lines(2, 3) + "d;e;f\n" + lines(5, 35) + "t;v;w\n"
    with pytest.raises(BadInput, match="line 36: a second table begins; cut the file there"):
        read(tmp_path, text + lines(37, 38))


def test_tables_that_take_turns_are_two(tmp_path):
    text = "".join(f"{head};v;w\n" + lines(0, 1) for head in "abab")
    with pytest.raises(BadInput, match="line 10: two tables in one file; cut it there"):
        read(tmp_path, text)
    again = "t;v;w\ns;m;K\n" + lines(3, 4) + "t;v;w\n" + lines(6, 7)
    assert [n for n, _ in read(tmp_path, again)[0].rows] == [3, 4, 6, 7]
    other = "t;v;w\ns;m;K\n" + lines(3, 4) + "t;v;w\nms;m;K\n" + lines(7, 8)
    found = read(tmp_path, other)[0]  # of other units: a table of its own
    assert found.units == ["ms", "m", "K"]
    assert [n for n, _ in found.rows] == [7, 8]


def test_settings_in_comments_have_their_lines(tmp_path):
    text = "# set v = 3 km/h\n# a;b;c\nt;v;w\n  #set x_1= a  b \n" + lines(5, 7) + "# set z=1\n"
    found, told = read(tmp_path, text)
    assert found.settings == [(1, "v", "3 km/h"), (4, "x_1", "a  b"), (8, "z", "1")]
    assert [n for n, _ in found.rows] == [5, 6, 7]
    assert told == ["read as utf-8, ';' between cells", "head in line 3 behind 2 other lines"]


@pytest.mark.parametrize(("before", "fine"), [("", 1), ("# a\n", 1), ("# a\n# b\n", 1),
                                              ("# a\n# b\n# c\n", 0)])  # fmt: skip
def test_a_mark_that_is_declared_parts_the_cells(before, fine, tmp_path):
    """In one of the first three lines; one that nobody would look for."""
    text = f'{before}"sep=:"\nt:v:w\n' + lines(0, 3, ":")
    if fine:
        found, told = read(tmp_path, text)
        assert (found.head, found.rows[2][1]) == (["t", "v", "w"], ["2", "3", "4"])
        assert told[0] == "read as utf-8, ':' between cells"
    else:
        with pytest.raises(BadInput, match="has no head"):
            read(tmp_path, text)


@pytest.mark.parametrize(
    ("mark", "name"),
    [("\t", "tab"), (";", "';'"), ("|", "'|'"), (",", "','"), ("   ", "two blanks or more"),
     (" ", "blanks")],
)  # fmt: skip
def test_the_mark_that_is_found_is_told(mark, name, tmp_path):
    found, told = read(tmp_path, mark.join("tvw") + "\n" + lines(0, 3, mark))
    assert told[0] == f"read as utf-8, {name} between cells"
    assert [c for _, c in found.rows] == [[f"{k}", f"{k + 1}", f"{k + 2}"] for k in range(4)]


def test_a_mark_is_found_by_the_begin_of_a_text(tmp_path):
    """What comes 600 lines further on is another matter: here lines of another log."""
    text = "t;v;w\n" + lines(2, SAMPLE) + "a\tb\n1\t2\n3\t4\n"
    found, told = read(tmp_path, text)
    assert found.mark == ";"
    assert len(found.rows) == SAMPLE - 1
    assert told[-1] == f"3 lines behind the table, left out: the first in line {SAMPLE + 1}"


@pytest.mark.parametrize(("at", "fine"), [(PREAMBLE, True), (PREAMBLE + 1, False)])
def test_a_comment_is_a_head_among_the_first_lines_alone(at, fine, tmp_path):
    text = "# made\n" * (at - 1) + "## t;v;w\n" + lines(0, 2)
    if fine:
        found, told = read(tmp_path, text)
        assert found.head == ["t", "v", "w"]
        assert told[1] == f"head in line {at} behind {at - 1} other lines"
    else:
        with pytest.raises(BadInput, match="has no head above rows of numbers"):
            read(tmp_path, text)


@pytest.mark.parametrize("coding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize(("latin", "fine"), [(74, True), (65, False)])
def test_two_bytes_of_a_letter_are_told_where_most_letters_are_latin(coding, latin, fine, tmp_path):
    """Seven of ten have a byte 0, all in one half; what has it in both is no text."""
    text = "a" * latin + "\u4e41" * (100 - latin)
    path = tmp_path / "log.csv"
    path.write_bytes((text * 10).encode(coding))
    if fine:
        assert text_of(path) == (text * 10, coding)
    else:
        with pytest.raises(BadInput, match="is no text"):
            text_of(path)
    path.write_bytes(("a" * 98 + "\u4e00\u0100").encode(coding))
    with pytest.raises(BadInput, match="is no text"):
        text_of(path)


def test_a_file_that_begins_as_a_workbook_is_none_and_western_letters_are_read(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("T [°C];v\r1;2\r\n3;4".encode("cp1252"))
    assert text_of(path) == ("T [°C];v\n1;2\n3;4", "cp1252")
    for raw in (b"PK\x03\x04 a;b\n1;2\n", b"\xff\xfea\0;\0b", b"a;b\n1;2\n\0\xff" + b"3" * 9):
        path.write_bytes(raw)
        with pytest.raises(BadInput, match="is no text; save it as CSV"):
            text_of(path)
    path.write_bytes("a;b\n".encode("utf-16"))
    assert text_of(path) == ("a;b\n", "utf-16")
    with pytest.raises(BadInput, match=r"cannot read 'a\\x00b'"):
        text_of(Path("a\0b"))


def test_a_file_of_the_largest_size_is_read_and_no_larger_one(monkeypatch, tmp_path):
    monkeypatch.setattr("slipctl.tables.layout.LARGEST", 3 << 20)
    path = tmp_path / "log.csv"
    path.write_bytes(b"1" * (3 << 20))
    assert len(text_of(path)[0]) == 3 << 20
    path.write_bytes(b"1" * (5 << 20))
    with pytest.raises(BadInput, match="has 5 MB or more; cut it into files of at most 3 MB"):
        text_of(path)


def test_a_row_of_ones_above_a_head_is_no_row_of_units(tmp_path):
    """It is a row of the table before."""
    found, told = read(tmp_path, "a;b;c\n0;0;0\n1;1;1\nu;v;w\n2;1;1\n1;1;1\n3;1;1\n")
    assert (found.head, found.units) == (["u", "v", "w"], ["", "", ""])
    assert told[1] == "head in line 4 behind 3 other lines"
