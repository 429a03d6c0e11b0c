"""Steps of reading cells, heads and times, each with what it gives of a few of them."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.tables import clock, numerals, table, times
from slipctl.tables.columns import expression_of, turned_twice, unit_of_column
from slipctl.tables.heads import unit_in_name
from slipctl.tables.table import Table, read_table


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("2024-05-01T10:00:00", ("2024-05-01", "10:00:00")),
        ("  2024-05-01T10:00:00 ", ("2024-05-01", "10:00:00")),
        ("1.5.24T10:00:00", ("1.5.24T10:00:00", "")),
        ("1 October 2024 10:00:00 UTC", ("1 October 2024", "10:00:00 UTC")),
        ("2 days, 01:00:00", ("", "2 days, 01:00:00")), ("10:00:00.5 pm", ("", "10:00:00.5 pm")),
        ("1.5.24, 10:00:00", ("1.5.24", "10:00:00")), ("noon", ("noon", "")),
        ("01-May-2024 10:00:00", ("01-May-2024", "10:00:00")),
    ],
)  # fmt: skip
def test_a_cell_has_a_date_and_a_clock_time(text, parts):
    assert clock._split(text) == parts


def test_a_date_may_have_several_orders():
    assert set(clock._day("3/4/2024") or {}) == {"dmy", "mdy"}
    assert list(clock._day("4/13/2024") or {}) == ["mdy"]
    assert list(clock._day("13/4/24") or {}) == ["dmy", "ymd"]
    assert set(clock._day("11/12/10") or {}) == {"dmy", "mdy", "ymd"}
    found = clock._day(" 3-4-24 ")
    assert found is not None
    assert found["mdy"] - found["dmy"] == -30  # March the fourth and the third of April
    assert clock._day("31.2.2024") is None
    assert clock._day("5. Foo 2024") is None


@pytest.mark.parametrize(
    ("number", "shape"),
    [("12,5", "99,9"), ("0.50", "0.90"), ("-100.25e3", "999.99E"), ("7", "9"), (".5", ".9"),
     ("5.", "9."), ("+1.050", "9.990"), ("1'234.5", "9'999.9"), ("0", "0"), ("70", "90"),
     ("3D-2", "9E")],
)  # fmt: skip
def test_a_number_has_a_shape(number, shape):
    assert numerals._shape(number) == shape


def test_the_first_row_of_each_shape_is_kept():
    found = numerals.column_of(["1.50", "1.25", "1.05", "10", "0.5", "2.75e3", "4.20"])
    assert found.firsts == {"9.90": 0, "9.99": 1, "90": 3, "0.9": 4, "9.99E": 5}
    assert found.decimal == "."
    assert numerals.column_of(["1.234.567,5"]).decimal == ","
    values = numerals.column_of(["1e999", "-1e999", '="2"', " 3 "]).values((".", ""))
    assert np.isnan(values[:2]).all()
    assert values[2:].tolist() == [2, 3]


@pytest.mark.parametrize(
    ("shape", "reading", "so"),
    [
        ("9.999", (".", ""), True), ("9.999", (",", "."), True), ("9.999", (",", ""), False),
        ("0.999", (",", "."), False), ("9.999.999,9", (",", "."), True),
        ("9.999.99,9", (",", "."), False), ("9999.999", (",", "."), False), (".9", (".", ""), True),
        (".", (".", ""), False), ("9.9,9", (".", ""), False), ("9.999E", (",", "."), False),
        ("9'999.9", (".", "'"), True), ("99'99.9", (".", "'"), False), ("99", (",", " "), True),
    ],
)  # fmt: skip
def test_a_shape_fits_a_reading(shape, reading, so):
    assert numerals._fits(shape, reading) == so


@pytest.mark.parametrize(
    ("text", "scales", "lines"),
    [
        ("v/3.6", {"v": 1 / 3.6}, 1), ("0.27778*v", {"v": 1 / 3.6}, 1),
        ("v/3.606", {"v": 1 / 3.6}, 1), ("v/3.6075", {"v": 1 / 3.6}, 0),
        ("1*v", {"v": 1.0}, 0), ("v1*2", {"v1": 1e-3}, 0),
        ("1000*v + 3.6*w", {"v": 1e-3, "w": 1 / 3.6}, 2), ("1e3*v", {"v": 1e-3}, 1),
    ],
)  # fmt: skip
def test_a_number_that_turns_a_column_again_is_told(text, scales, lines):
    found = turned_twice(text, scales)
    assert len(found) == lines
    assert all(line.startswith(f"{text}: ") and "a second time" in line for line in found)


def columns(**units):
    cells = {n: np.array([1.0, 2.0]) for n in units}
    return Table("log.csv", cells, units, range(2), heads={n: f"{n} [?]" for n in units})


UNITS = [
    ("v", "", "", "m/s", "", []), ("v", "km/h", "", "m/s", "km/h", []),
    ("v", "", "km/h", "m/s", "km/h", []),
    ("v", "odd", "km/h", "m/s", "km/h",
     ["v is read in km/h, as --map says; the unit 'odd' in its head is not known"]),
    ("n", "1/min", "rpm", "rad/s", "rpm", ["n is in rpm, as --map says; its head says 1/min"]),
    ("v_kmh", "", "", "m/s", "km/h", ["v_kmh is in km/h by its name"]),
    ("v_kmh", "km/h", "", "m/s", "km/h", []), ("v_kmh", "odd", "km/h", "", "km/h",
     ["v_kmh is read in km/h, as --map says; the unit 'odd' in its head is not known"]),
    ("v_kmh", "", "", "", "", []),
]  # fmt: skip


@pytest.mark.parametrize(("name", "head", "told", "wanted", "unit", "notes"), UNITS)
def test_a_column_has_the_unit_that_somebody_says(name, head, told, wanted, unit, notes):
    said = ["before"]
    assert unit_of_column(columns(**{name: head}), name, told, wanted, said) == unit
    assert said == ["before", *notes]


@pytest.mark.parametrize(
    ("name", "head", "told", "wanted", "words"),
    [
        ("v", "odd", "", "m/s", "log.csv: v: unit 'odd'"), ("v", "", "odder", "m/s", "'odder'"),
        ("v", "km/h", "m/s", "m/s", "v is in m/s as told and in km/h by its head; units are never"),
        ("v_kmh", "m/s", "", "m/s", "v_kmh is in m/s by its head and in km/h by its name"),
        ("v_rpm", "", "", "m/s", "v_rpm is in rpm by its name, and m/s is wanted, another dim"),
        ("T", "degC", "K", "K", "offset"), ("v", "odd", "odder", "m/s", "'odder' is no known"),
    ],
)  # fmt: skip
def test_units_that_contradict_each_other_are_refused(name, head, told, wanted, words):
    with pytest.raises(BadInput, match=words):
        unit_of_column(columns(**{name: head}), name, told, wanted, [])


def test_a_name_is_no_part_of_a_longer_word():
    made = columns(**{"wheel speed": "m/s", "_a": "", "v": "", "x (raw)": ""})
    text = "mywheel speed + wheel speeds + b_a + v2 + x (raw) + 3.v + _a"
    found = expression_of(f"  {text} ", made)
    assert found.text == text.replace("x (raw)", "x__raw___")
    assert dict(found.columns) == {"x__raw___": "x (raw)", "_a": "_a"}


@pytest.mark.parametrize(
    ("name", "wanted", "unit"),
    [("km_2_h", "m/s", "km/h"), ("deg_s_slow", "rad/s", ""), ("slow_deg_s", "rad/s", "deg/s"),
     ("mm_s_2", "m/s", "mm/s"), ("v_km_h_kmh", "m/s", "km/h"), ("v_kmh_mps", "m/s", "")],
)  # fmt: skip
def test_a_unit_of_two_words_ends_a_name(name, wanted, unit):
    assert unit_in_name(name, wanted) == unit


def test_numbers_that_are_none_are_missing():
    cells = {"a": np.array([1.0, np.inf, -np.inf, np.nan, 2.0])}
    found = Table("log", cells, {"a": ""}, range(5)).numbers("a")
    assert np.array_equal(found, [1, np.nan, np.nan, np.nan, 2], equal_nan=True)
    assert np.isinf(cells["a"][1])  # what was read stays


def test_marks_of_numbers_are_told_with_the_first_row_that_has_them(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t [s];F [N];p [bar]\n0;12;1,5\n1;1.234,5;2\n2;5.678,25;3\n", encoding="utf-8")
    found = read_table(path)
    assert found.numbers("F").tolist() == [12, 1234.5, 5678.25]
    assert found.numbers("p").tolist() == [1.5, 2, 3]
    assert found.notes == [
        "F has a decimal comma", "F: '.' parts thousands, so 1.234,5 in line 3 is 1234.5",
        "p has a decimal comma"]  # fmt: skip


@pytest.mark.parametrize(("head", "fine"), [("time_s", True), ("time_ms", False), ("time", True)])
def test_whole_thousands_are_told_by_a_unit_in_the_name(head, fine, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(f"{head};v\n1.000;20.5\n1.100;20.25\n1.200;21.5\n", encoding="utf-8")
    if fine:
        assert read_table(path).numbers(head).tolist() == [1.0, 1.1, 1.2]
    else:
        with pytest.raises(BadInput, match=r"may be 1\.000 or 1000"):
            read_table(path).numbers(head)


@pytest.mark.parametrize("value", table.MISSING)
def test_each_mark_of_a_missing_value_is_known(value):
    """Of either sign, and with six digits."""
    assert value in {
        999, 999.25, 999.9, 9999, 99999, 999999, 32767, 32768, 65279, 65535, 2147483647, 2147483648,
        4294967295, 1e20, 1e30, 9.969209968386869e36, 3.4028235e38,
    }  # fmt: skip
    for x in (value, -value, value * (1 + 5e-7)):
        assert table.marks_of_missing(np.array([1.0, x, np.nan, 2.0])).tolist() == [1]
    assert table.marks_of_missing(np.array([1.0, 1.01 * value, 2.0])).size == 0


def test_a_signal_that_changes_its_sign_all_the_time_overflows_nowhere():
    assert table.overflows(np.tile([1.0, -1.0], 15)).tolist() == []
    counting = (np.arange(32700, 32800) + 32768) % 65536 - 32768.0
    assert table.overflows(counting).tolist() == [68]
    assert table.lone_values(np.tile([1.0, -1.0], 15)).tolist() == []


def stood_together(*seconds):
    whole = [int(s) for s in seconds]
    return np.array([10000 * (w // 3600) + 100 * (w // 60 % 60) + w % 60 + s % 1
                     for w, s in zip(whole, seconds, strict=True)])  # fmt: skip


@pytest.mark.parametrize(("gap", "so"), [(2.4, True), (2.6, False)])
def test_hours_and_minutes_that_stand_together_go_on_evenly(gap, so):
    seconds = [45290.0 + k for k in range(15)]
    seconds += [seconds[-1] + gap + k for k in range(5)]
    assert times._is_compact(stood_together(*seconds)) == so
    assert not times._is_compact(np.array(seconds))
    assert not times._is_compact(np.array([]))
    assert not times._is_compact(stood_together(*(10 * k for k in range(30))))


def seconds_of(tmp_path, text, wanted=""):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    read = read_table(path)
    found, used = times.seconds_of_table(read, wanted)
    return found, used, read.notes


def test_the_likeliest_name_is_the_time(tmp_path):
    """Whatever stands first; of two that cannot be told apart the one that rises."""
    text = "zeit [s];time [s];v\n5;0;1\n5;1;2\n5;2;3\n"
    assert seconds_of(tmp_path, text)[:2][1] == ["time"]
    falls = "".join(f"{30 - k};{k if k != 9 else 7.5};1\n" for k in range(22))
    found, used, notes = seconds_of(tmp_path, "stamp [s];mark [s];v\n" + falls)
    assert used == ["mark"]
    assert found[3] == 3
    assert "mark is taken for the time" in notes
    both = "mark [s];stamp [s];v\n3;9;1\n2;1;2\n1;5;3\n0;2;4\n"
    assert seconds_of(tmp_path, both)[1] == ["mark"]


def test_a_clock_is_known_by_its_first_row(tmp_path):
    found, used, _ = seconds_of(tmp_path, "mark;v\n10:00:00;5\n;6\n10:00:02;7\n")
    assert used == ["mark"]
    assert np.array_equal(found, [0, np.nan, 2], equal_nan=True)
    with pytest.raises(BadInput, match="has no column of times"):
        seconds_of(tmp_path, "mark;v\n1.5.2024;5\n1.5.2024 10:00:00;6\n")
    with pytest.raises(BadInput, match="its head has two columns 'time'; rename one"):
        seconds_of(tmp_path, "time;time;v\n0;1;2\n1;2;3\n")


def test_a_date_stands_beside_a_clock_and_not_beside_another_date(tmp_path):
    rows = ("1.5.2024;23:59:59", "3.5.2024;00:00:01", ";00:00:02", "3.5.2024;")
    found, used, notes = seconds_of(tmp_path, "date;time;v\n" + "".join(f"{r};1\n" for r in rows))
    assert used == ["time", "date"]
    assert np.array_equal(found, [0, 86402, np.nan, np.nan], equal_nan=True)
    assert notes == ["times are date and time"]
    text = "date;time;v\n2.6.2025;1.5.2024 10:00:00;1\n2.6.2025;1.5.2024 10:00:03;2\n"
    found, used, notes = seconds_of(tmp_path, text)
    assert (used, found.tolist(), notes) == (["time"], [0, 3], [])


@pytest.mark.parametrize(
    ("name", "so"),
    [("time [ms]", True), ("speed [km/h]", False), ("datum", True), ("v [s]", False),
     ("Zeit (s)", True), ("day", True), ("t", True), ("my day", False)],
)  # fmt: skip
def test_a_column_of_times_or_dates_is_known_by_its_name(name, so):
    assert times.is_time_name(name) == so


@pytest.mark.parametrize(("shift", "peak", "rows"), [
    (0.0, 500.0, [20]), (0.06, 500.0, [20]), (0.1, 500.0, []), (0.5, 500.0, []),
    (0.0, 1.15, []), (0.0, 1.3, [20]),
])  # fmt: skip
def test_a_number_stands_alone_between_two_that_are_near_each_other(shift, peak, rows):
    """A hundred steps of 0.01 away from either, these not ten steps apart."""
    x = 0.01 * np.arange(40)
    x[21:] += shift
    x[20] = peak
    assert table.lone_values(x).tolist() == rows
    assert table.lone_values(np.r_[x[:10], np.nan, x[10:]]).tolist() == [k + 1 for k in rows]
    assert table.lone_values(x[12:31]).tolist() == []  # fewer than twenty rows
