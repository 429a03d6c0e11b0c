"""Times, numbers, heads and letters of a log mean the same however a person or tool wrote them."""

from __future__ import annotations

import random
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.errors import BadInput
from slipctl.tables.clock import MONTHS, is_date, is_time, seconds_of
from slipctl.tables.heads import name_and_unit
from slipctl.tables.layout import text_of
from slipctl.tables.numerals import column_of, is_number, marks_of_column, plain_cell, refuse

MOMENTS = st.datetimes(datetime(1990, 1, 1), datetime(2060, 12, 31)).map(
    lambda t: t.replace(microsecond=t.microsecond // 1000 * 1000)
)
ZONES = st.sampled_from([0, 60, -60, 330, -210, 720]).map(lambda m: timezone(timedelta(minutes=m)))
FORMATS = (
    "{0:%Y-%m-%d %H:%M:%S}.{1}", "{0:%Y-%m-%dT%H:%M:%S}.{1}", "{0:%Y/%m/%d %H:%M:%S},{1}",
    "{0:%d.%m.%Y %H:%M:%S}.{1}", "{0:%d.%m.%y, %I:%M:%S}.{1} {0:%p}", "{0:%d %B %Y %H:%M:%S}.{1}",
    "{0:%B %d, %Y %H:%M:%S}.{1}", "{0:%d-%b-%Y %H:%M:%S}.{1}",
    "{0.day}. {0:%b}. {0:%Y} {0:%H:%M:%S}.{1}",
)  # fmt: skip


def far(cells: list[str]) -> float:
    found, wrap = seconds_of(cells, range(len(cells)), "row")
    assert wrap == 0
    return float(found[-1] - found[0])


@pytest.mark.parametrize("form", FORMATS)
@given(first=MOMENTS, second=MOMENTS, between=st.integers(0, 2))
def test_two_dates_are_as_far_apart_as_they_are(form, first, second, between):
    """Empty cells between them count for nothing."""
    cells = [form.format(t, f"{t.microsecond // 1000:03d}") for t in (first, second)]
    assert all(is_time(c) and not is_date(c) for c in cells)
    cells[1:1] = [""] * between
    if "%y" in form:  # two digits are of this century
        first, second = (t.replace(year=2000 + t.year % 100) for t in (first, second))
    assert far(cells) == pytest.approx((second - first).total_seconds(), abs=1e-9)


@given(MOMENTS, MOMENTS, ZONES, ZONES, st.sampled_from(["%z", "%:z", "Z"]))
def test_a_zone_is_taken_off(first, second, here, there, how):
    """Of +05:30 the half hour too, and west of Greenwich it is behind."""
    moments = [first.replace(tzinfo=here), second.replace(tzinfo=there)]

    def zone(t: datetime) -> str:
        text = t.strftime("%z")
        return {"%z": text, "%:z": f"{text[:3]}:{text[3:]}", "Z": "Z"}[how]

    if how == "Z":
        moments = [t.astimezone(UTC) for t in moments]
    cells = [f"{t:%Y-%m-%d %H:%M:%S}{zone(t)}" for t in moments]
    whole = [t.replace(microsecond=0) for t in moments]
    assert far(cells) == (whole[1] - whole[0]).total_seconds()


def test_day_and_month_are_told_by_the_date_that_has_one_way():
    """13 is no month: 3/4 beside 13/4 is the third of April; beside 4/13 it is March the fourth."""
    assert far(["3/4/2024", "13/4/2024"]) == 10 * 86400
    assert far(["3/4/2024", "4/13/2024"]) == 40 * 86400
    assert far(["3/4/2024 10:00:00", "3/4/2024 10:00:02.5"]) == 2.5
    assert far(["3/4/2024 23:59:59", "4/4/2024 00:00:01"]) == 2  # a day on, not a month
    assert far(["24-05-01 23:59:59", "24-05-02 00:00:01"]) == 2  # a day on, not a year
    assert far(["24/12/23 23:59:59", "25/12/23 00:00:01"]) == 2
    with pytest.raises(BadInput, match="which is the day and which the month"):
        far(["3/4/2024", "5/7/2024"])
    with pytest.raises(BadInput, match=r"row 0: the dates are not written alike"):
        far(["13/4/2024", "4/13/2024"])
    with pytest.raises(BadInput, match=r"row 2: '2024-05-01' has other parts"):
        far(["10:00:00", "10:00:01", "2024-05-01"])


def test_each_month_has_its_names_in_two_languages():
    assert sorted(set(MONTHS.values())) == list(range(1, 13))
    for name, month in MONTHS.items():
        days = (datetime(2023, month, 5) - datetime(2023, 1, 1)).days
        assert far(["1 jan 2023", f"5. {name.capitalize()} 2023"]) == 86400 * days, name


@pytest.mark.parametrize(
    ("cell", "seconds", "again"),
    [
        ("00:00:01.25", 1.25, 86400), ("23:59:59", 86399, 86400), ("12:00:00 AM", 0, 86400),
        ("12:00:01 pm", 43201, 86400), ("1:02:03 P.M.", 46923, 86400), ("59:58.5", 3598.5, 3600),
        ("99:00.0", 5940, 0), ("30:00:00", 108000, 0), ("2 days, 01:00:00", 176400, 0),
        ("1 day 00:00:01", 86401, 0), ("10:11:12:500", 36672.5, 86400), ("01:00:00+01", 0, 86400),
    ],
)  # fmt: skip
def test_a_clock_time_is_so_many_seconds_and_begins_anew(cell, seconds, again):
    found, wrap = seconds_of([cell], [2], "row")
    assert (float(found[0]), wrap) == (seconds, again)


@pytest.mark.parametrize("cell", [
    "10:60:00", "10:00:61", "13:00:00 pm", "0:10:00 am", "10:00", "10:00:5:5", "75:30.0:1",
    "2024-13-01", "31.2.2024", "noon",
])  # fmt: skip
def test_no_time_is_refused_with_its_row(cell):
    with pytest.raises(BadInput, match=r"row 7: .* is no time that is known"):
        seconds_of([cell], [7], "row")


HEADS = {
    "v [km/h]": ("v", "km/h"), " v  [km/h] ": ("v", "km/h"),
    "Speed [km/h] (raw)": ("Speed (raw)", "km/h"),
    "slip [-]": ("slip", "1"), "slip []": ("slip", "1"), "v (m/s)": ("v", "m/s"),
    "v / (m/s)": ("v", "m/s"), "v in m/s": ("v", "m/s"), "slip in -": ("slip", "1"),
    "wheel [1] [m/s]": ("wheel [1]", "m/s"), "speed": ("speed", ""),
    "gate in front": ("gate in front", ""),
}  # fmt: skip


@pytest.mark.parametrize("head", HEADS)
def test_a_head_is_a_name_and_a_unit(head):
    assert name_and_unit(head) == HEADS[head]


@pytest.mark.parametrize(
    "coding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]
)
def test_a_text_is_read_in_its_letters(coding, tmp_path: Path):
    """Umlauts and degrees in each; both kinds of ends of a line are one."""
    text = "Größe;Temperatur °C\n1;2\n3;4\n"
    path = tmp_path / "log.csv"
    path.write_bytes(text.replace("\n", "\r\n").encode(coding))
    assert text_of(path)[0] == text
    path.write_bytes(text.replace("\n", "\r").encode(coding))
    assert text_of(path)[0] == text


def test_what_is_no_text_or_no_file_is_refused(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_bytes(random.Random(1).randbytes(5000))
    with pytest.raises(BadInput, match="is no text; save it as CSV"):
        text_of(path)
    with pytest.raises(BadInput, match=r"cannot read .*nothing\.csv"):
        text_of(tmp_path / "nothing.csv")
    with pytest.raises(BadInput, match="cannot read"):
        text_of(tmp_path)


NUMBERS = st.lists(st.integers(-(10**7), 10**7), min_size=2, max_size=6)


@given(NUMBERS, st.sampled_from(["1,234.5", "1.234,5", "1 234,5", "1'234.5"]))
def test_groups_and_marks_of_a_column_are_found(whole, how):
    """Thousandths with groups, in each of the ways; one number of a million tells which it is."""
    values = [n / 100 for n in whole] + [1234567.25]
    texts = [f"{v:,.2f}".translate(str.maketrans({",": how[1], ".": how[-2]})) for v in values]
    column = column_of(["", *texts, " "])
    reading = marks_of_column(column, "", (), "")
    assert reading == (how[-2], how[1])
    found = column.values(reading)
    assert list(found[1:-1]) == values
    assert found[0] != found[0]  # NaN: nothing was measured
    assert found[-1] != found[-1]


def test_what_surrounds_a_cell_is_taken_off():
    for text in ("0.5", " 0.5 ", '="0.5"', '=" 0.5"', "\u00a00.5"):
        assert plain_cell(text).strip() == "0.5"
        assert is_number(text)
    assert plain_cell(' ="−3" ') == "-3"


def test_why_a_column_cannot_be_read_is_told_with_row_and_cell():
    def told(cells: list[str], by: str = "") -> str:
        return str(refuse("log.csv", "line", range(10, 20), column_of(cells), cells, by))

    assert "'x1' in line 11 is no number" in told(["1", "x1", "x2"])
    assert "'1,5' in line 11 has other marks than '1.5' in line 10" in told(["1.5", "1,5"])
    assert "'1.2.3' in line 11 is no number" in told(["1", "1.2.3", "4"])
    assert "'1.234' in line 11 may be 1.234 or 1234" in told(["2", "1.234"])
    assert "has no decimal mark ','" in told(["12.5", "2"], ",")


@pytest.mark.parametrize(
    ("cells", "row"),
    [(["1.234,5", "1,234.5", "12,345.67"], 1), (["1.5", "2.25", "1.234,5", "1,2,3,4"], 2)],
)
def test_the_first_cell_that_contradicts_those_before_is_told(cells, row):
    clash = column_of(cells).clash
    assert clash is not None
    assert row in clash


@pytest.mark.parametrize(
    ("cells", "told", "elsewhere", "parted_by", "found"),
    [
        (["1,5"], ".", "", ";", None), (["1,5"], ",", "", ";", ","),
        (["1,5", "2,25"], "", "", ";", ","), (["1.5"], "", "", ",", "."),
        (["1.234"], "", "", ";", None), (["1.234"], "", ".", ";", "."),
        (["1.234"], "", "", ",", "."), (["1.234"], "", ",", ",", None),
        (["1,234"], "", ",", ";", ","), (["1,234", "12"], "", "", ";", None),
        (["1.240", "12"], "", ",", ";", ","), (["1.240", "1234"], "", ",", ";", None),
        (["1.240", "12"], "", ".", ";", None),
    ],
)  # fmt: skip
def test_the_decimal_mark_of_a_column_is_told_or_found(cells, told, elsewhere, parted_by, found):
    reading = marks_of_column(column_of(cells), told, list(elsewhere), parted_by)
    assert (reading and reading[0]) == found


@pytest.mark.parametrize("coding", ["utf-16-le", "utf-16-be", "utf-8"])
def test_letters_of_two_bytes_are_told_by_the_begin_of_a_file(coding, tmp_path: Path):
    """Whatever letters come later, of which a half may be zero too."""
    text = "time,v\n" + "1,2\n" * 1200 + "一ā,3\n"
    (tmp_path / "log.csv").write_bytes(text.encode(coding))
    assert text_of(tmp_path / "log.csv") == (text, coding)
