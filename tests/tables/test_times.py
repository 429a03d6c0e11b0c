"""Which column is the time, in what unit, and from when on its clock counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slipctl.errors import BadInput
from slipctl.tables.heads import time_in_name, unit_in_name
from slipctl.tables.table import read_table
from slipctl.tables.times import seconds_of_table


def times(tmp_path: Path, text: str, wanted: str = ""):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    table = read_table(path)
    found, columns = seconds_of_table(table, wanted)
    return found, columns, table.notes


def rows(*columns, head: str) -> str:
    return head + "\n" + "".join(";".join(map(str, r)) + "\n" for r in zip(*columns, strict=True))


V = [5, 6, 7, 8]
STEPS = np.array([0.0, 0.5, 1.0, 1.5])
READ = {
    "s in the head": (rows([10, 10.5, 11, 11.5], V, head="time [s];v"), "", ["time"], ""),
    "ms in the head": (rows([0, 500, 1000, 1500], V, head="t [ms];v"), "", ["t"], ""),
    "by its name": (rows([0, 500, 1000, 1500], V, head="time_ms;v"), "", ["time_ms"],
                    "in ms by its name"),
    "told": (rows([0, 500, 1000, 1500], V, head="k;v"), "k[ms]", ["k"], ""),
    "told beside another": (rows([3, 2, 1, 0], [0, 0.5, 1, 1.5], head="time [s];mine"), "mine[s]",
                            ["mine"], ""),
    "no unit": (rows([0, 0.5, 1, 1.5], V, head="time;v"), "", ["time"],
                "no unit in the head; read in s"),
    "ms in a column s": (rows([0, 500, 1000, 1500], V, head="s [ms];v"), "", ["s"], ""),
    "days": (rows([f"{45000 + s / 86400:.9f}" for s in STEPS], V, head="time;v"), "", ["time"],
             "read in days, as spreadsheets"),
    "since 1970": (rows([1700000000 + s for s in STEPS], V, head="time;v"), "", ["time"],
                   "read in s since 1970, 2023-11-14 on"),
    "ms since 1970": (rows([int(1700000000000 + 1000 * s) for s in STEPS], V, head="time;v"), "",
                      ["time"], "read in ms since 1970, 2023-11-14 on"),
    "a clock": (rows(["23:59:59.0", "23:59:59.5", "00:00:00.0", "00:00:00.5"], V, head="time;v"),
                "", ["time"], "the clock passes midnight in line 4"),
    "the hour": (rows(["59:59.0", "59:59.5", "00:00.0", "00:00.5"], V, head="time;v"), "", ["time"],
                 "the clock passes the full hour in line 4"),
    "day and clock": (rows(["1.5.2024"] * 4, ["10:00:00.0", "10:00:00.5", "10:00:01", "10:00:01.5"],
                           head="date;time"), "", ["time", "date"], "times are date and time"),
    "by its unit": (rows(V, [0, 500, 1000, 1500], head="v [m/s];stamp [ms]"), "", ["stamp"],
                    "stamp is taken for the time"),
    "one of two that agree": (rows([0, 0.5, 1, 1.5], [0, 500, 1000, 1500], head="time [s];time_ms"),
                              "", ["time"], ""),
}  # fmt: skip


@pytest.mark.parametrize("what", READ)
def test_the_time_is_found_and_counts_in_seconds_from_the_first_row(what, tmp_path):
    text, wanted, columns, said = READ[what]
    found, used, notes = times(tmp_path, text, wanted)
    assert found == pytest.approx(STEPS, abs=2e-4)
    assert used == columns
    assert not said or any(said in line for line in notes), notes


def test_a_row_without_a_time_has_none(tmp_path):
    for cells in (["0", "", "1", "1.5"], ["10:00:00", "", "10:00:01", "10:00:01.5"]):
        found, *_ = times(tmp_path, rows(cells, V, head="time [s];v"))
        assert np.isnan(found[1])
        assert found[[0, 2, 3]] == pytest.approx(STEPS[[0, 2, 3]])


REFUSED = {
    "none": (rows(V, V, head="v;w"), "", "has no column of times; say which by --time COLUMN"),
    "two units": (rows([0, 1], [1, 2], head="time_ms [s];v"), "",
                  "time_ms is in two units: its head s and its name ms"),
    "told another": (rows([0, 1], [1, 2], head="time [s];v"), "time[ms]", "is in two units"),
    "no unit of time": (rows([0, 1], [1, 2], head="k;v"), "k[km]", "which is no unit of time"),
    "two that differ": (rows([0, 1, 2, 3], [0, 1, 4, 9], head="mark [s];stamp [s]"), "",
                        "may both be the time, and they differ"),
    "a shorter one of its own": (rows([0, 1, 2, 3], [0, 5, "", ""], head="t_v [s];t_slope [s]"), "",
                                 "may both be the time, and they differ"),
    "never in one row": (rows([0, "", 2, ""], ["", 1, "", 3], head="t_v [s];t_slope [s]"), "",
                         "may both be the time, and they differ"),
    "long steps": (rows([0, 500, 1000], [1, 2, 3], head="time;v"), "",
                   "has no unit, and s would be 500"),
    "hours with a zero": (rows(["235959", "000000", "000001"], [1, 2, 3], head="time [s];v"), "",
                          "time: '000000' in line 3 may be hours, minutes and seconds; write hh"),
    "a date in one word": (rows(["20240501120000", "20240501120001"], [1, 2], head="time;v"), "",
                           "'20240501120000' in line 2 may be hours, minutes and seconds; write"),
    "a clock in ms": (rows(["10:00:00", "10:00:01"], [1, 2], head="time [ms];v"), "",
                      "is told in ms, but '10:00:00' in line 2 is no number"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_times_that_cannot_be_told_are_refused(what, tmp_path):
    text, wanted, said = REFUSED[what]
    with pytest.raises(BadInput, match=said):
        times(tmp_path, text, wanted)


def test_a_unit_that_the_times_contradict_is_refused(tmp_path: Path) -> None:
    ms = rows([1700000000000 + 100 * k for k in range(4)], V, head="time [s];v")
    with pytest.raises(BadInput, match=r"told in s, and 1\.7e\+12 in line 2 looks like ms since"):
        times(tmp_path, ms)
    slow = rows([100 * k for k in range(4)], V, head="time [s];v")
    assert any("goes on by 100 s from row to row" in n for n in times(tmp_path, slow)[2])


BESIDE_A_LIMIT = [
    (0, 9.9, "read in s,"), (0, 10.1, ""), (0, 1.05e-5, "read in s,"), (0, 0.9e-5, ""),
    (36_400, 5e-5, "read in s,"), (36_600, 5e-5, "in days"), (54_900, 5e-5, "in days"),
    (55_100, 5e-5, "read in s,"), (40_000, 0.9e-4, "in days"), (40_000, 1.1e-4, "read in s,"),
    (40_000, 1e-9, ""), (40_000, 1.2e-9, "in days"), (0.89e9, 1, "read in s,"),
    (0.91e9, 1, "in s since 1970"),
    (2.49e9, 1, "in s since 1970"), (2.51e9, 1, "read in s,"), (0.91e12, 9e3, "in ms since 1970"),
    (0.91e12, 11e3, ""), (0.91e15, 1e3, "in us since 1970"), (0.91e18, 1e6, "in ns since 1970"),
]  # fmt: skip
"""First time, step, and how both are read without a unit; empty where they are refused."""


@pytest.mark.parametrize(("first", "step", "said"), BESIDE_A_LIMIT)
def test_a_time_without_a_unit_is_read_as_first_and_step_allow(first, step, said, tmp_path):
    size = {"days": 86400, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    factor = next((f for u, f in size.items() if f"in {u}" in said), 1)
    stamps = [f"{int(first) + k * int(step)}" if step > 99 else f"{float(first + k * step)!r}"
              for k in range(4)]  # fmt: skip
    text = rows(stamps, V, head="time;v")
    if not said:
        with pytest.raises(BadInput, match="has no unit, and s would be"):
            times(tmp_path, text)
        return
    found, _, notes = times(tmp_path, text)
    assert any(said in line for line in notes), notes
    assert found == pytest.approx(factor * step * np.arange(4), rel=0.02)


NAMES = {
    "time": "", "t": "", "Time": "", "time_ms": "ms", "timeus": "us", "TimeUS": "us", "s": "s",
    "seconds": "s", "time in ms": "ms", "zeit_s": "s", "timestamp": "", "millis": "ms", "us": "us",
    "t_s": "s", "Time (min)": "min", "zeitms": "ms", "sec": "s", "elapsed_time_h": "h",
}  # fmt: skip


def test_a_name_of_a_time_says_its_unit_and_how_likely_it_is():
    assert {n: time_in_name(n)[1] for n in NAMES} == NAMES
    ranks = [time_in_name(n)[0] for n in ("time", "t", "timestamp", "zeit", "seconds", "s", "ms")]
    assert ranks == sorted(ranks)
    assert time_in_name("timems") == time_in_name("time_ms") == (time_in_name("time")[0], "ms")
    for name in ("speed", "speed_ms", "time_x", "timems_x", "in_ms", "", "time_of_flight"):
        assert time_in_name(name) is None


def test_a_name_of_one_word_says_no_unit_of_a_time():
    """A column min may be the least; one that is called kmh is in km/h."""
    assert (unit_in_name("kmh", "m/s"), unit_in_name("speed_kmh", "m/s")) == ("km/h", "km/h")
    assert (unit_in_name("min", "s"), unit_in_name("wait_min", "s")) == ("", "min")
    assert unit_in_name("v_km_h", "m/s") == "km/h"
    assert unit_in_name("way_km_m", "m") == ""  # two of them


@pytest.mark.parametrize("step", [0.5, 1, 2])
def test_hours_minutes_and_seconds_that_stand_together_are_no_seconds(tmp_path, step):
    """In them a minute has 100 s; within one minute nothing tells them, and nothing is wrong."""
    seconds = [45290 + step * k for k in range(60)]  # from 12:34:50 on
    stamps = [f"{10000 * (s // 3600) + 100 * (s // 60 % 60) + s % 60:.1f}" for s in seconds]
    with pytest.raises(BadInput, match="123450 may be hours, minutes and seconds"):
        times(tmp_path, rows(stamps, range(60), head="utc;v"))
    found, *_ = times(tmp_path, rows(stamps, range(60), head="utc;v"), "utc[s]")
    assert found[-1] > 59 * step  # whoever says s has s
    found, *_ = times(tmp_path, rows(stamps[:4], range(4), head="utc;v"))
    assert found == pytest.approx(step * np.arange(4))
