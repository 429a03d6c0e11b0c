"""Ends, files and names that are none; what a metric takes for the length of a tick."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

from slipctl import BadInput, End, Known, Output, Param, Rail, Section, law
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.metrics import Run
from slipctl.run.results import Loops, NotRun, Results, known_column
from slipctl.run.roles import Signals
from slipctl.run.store import check_folder, check_names
from slipctl.study import resolve


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"below": -0.1}, "v: no absolute value is below -0.1"), ({}, "needs one of below= and"),
        ({"below": 1.0, "above": 2.0}, "needs one of below= and"), ({"below": np.inf}, "level"),
        ({"above": 1.0, "hold": -1.0}, "hold -1 s must be 0 or positive"),
        ({"above": 1.0, "hold": np.inf}, "hold inf s must be"),
    ],
)  # fmt: skip
def test_an_end_that_never_comes_is_refused(given, said):
    with pytest.raises(BadInput, match=said):
        End("v", **given)
    values = np.array([[0.0, 0.5], [-1.0, 1.0], [1.0, 1.1], [2.0, -3.0]])
    assert End("v", below=1.0).there(values).tolist() == [True, True, False, False]
    assert End("v", above=1.0).there(values).tolist() == [False, False, True, False]
    assert End("v", below=0.0, hold=0.0).hold == 0


@pytest.mark.parametrize("name", ["con", "NUL.json", "Com3", "lpt9.x.y", "aux .txt", "x" * 256])
def test_a_name_that_another_system_cannot_have_is_refused_everywhere(name, tmp_path):
    for check in (check_names, check_folder):
        with pytest.raises(BadInput, match="cannot write"):
            check(tmp_path / name / "a")
    check_folder(tmp_path / "x" / "console")
    check_names(Path("com0/lpt10/x." + "y" * 250))


@pytest.mark.parametrize(("begin", "what"), [(b"PAR1", "Parquet"), (b"MDF ", "MDF")])
def test_a_damaged_file_is_told_as_what_it_begins_as(begin, what, tmp_path):
    pytest.importorskip({"Parquet": "pyarrow", "MDF": "asammdf"}[what])
    (tmp_path / "log.x").write_bytes(begin + bytes(range(256)) * 3)
    with pytest.raises(BadInput, match=rf"cannot read .*log\.x as {what}: .") as told:
        read_recording(tmp_path / "log.x")
    assert len(str(told.value).partition(f"as {what}: ")[2]) <= 120


def test_a_tick_is_told_by_the_log_or_the_first_two_times():
    data = xarray.Dataset({"v": ("time", [1.0, 2.0, 3.0])}, coords={"time": [4.0, 4.5, 9.0]})
    assert Run(data, Signals(), ()).tick == 0.5
    assert Run(data, Signals(), ()).duration == 1.5
    assert Run(data.assign_attrs(period_s=0.25), Signals(), ()).tick == 0.25


def test_numbers_of_loops_that_ran_are_asked_for_by_their_names():
    @law(y=Output("1"))
    def made(k=Param("1", 2.5), row=Param("1", (7.0, 8.0), shape=(2,))):
        return k + row[0]

    cases = [SimpleNamespace(scenario=SimpleNamespace(name="base"), loops={"a": made})]
    found = Results(SimpleNamespace(signals=Signals(), claims=(), experiments={}), False)
    found.cases = cases
    found.data = {"base": {"a": xarray.Dataset()}}
    assert (found.number("base", "a", "k"), found.number("base", "a", "row")) == (2.5, 7.0)
    with pytest.raises(BadInput, match="a has no parameter 'kk'; did you mean 'k'"):
        found.number("base", "a", "kk")
    with pytest.raises(NotRun):
        found.number("base", "b", "k")


def test_a_file_that_is_nested_too_deeply_is_told(tmp_path):
    (tmp_path / "deep.py").write_text("raise RecursionError('deep')\n", encoding="utf-8")
    with pytest.raises(BadInput, match=r"deep\.py is nested too deeply to be read"):
        resolve.load_file(str(tmp_path / "deep.py"))


def test_loops_are_made_when_they_are_asked_for_and_once():
    """Those of two, of some names, and each changed, ask no other."""
    made = []

    def make(name):
        made.append(name)
        return f"loop {name}"

    loops = Loops({n: partial(make, n) for n in "abc"})
    assert (len(loops), list(loops), "b" in loops, "z" in loops) == (
        3,
        ["a", "b", "c"],
        True,
        False,
    )
    changed = loops.each(lambda loop: loop.upper())
    both = loops | {"b": "mine", "d": "more"}
    other = {"b": "mine", "d": "more"} | loops
    few = loops.only("c", "a")
    assert made == []
    assert changed["b"] == "LOOP B"
    assert (both["b"], both["d"], list(both)) == ("mine", "more", ["a", "b", "c", "d"])
    assert (other["b"], other["d"], list(other)) == ("loop b", "more", ["b", "d", "a", "c"])
    assert (few["c"], list(few)) == ("loop c", ["c", "a"])
    assert loops["c"] == changed["c"].lower() == "loop c"
    assert made == ["b", "c"]


def test_what_a_study_knows_of_the_rail_is_that_under_each_axle():
    """Sections from 0, 10 and 30 m; the second axle is 6 m behind. By time all change at once."""
    log = {"time": np.arange(4.0)}
    rail = Rail([Section(0), Section(10), Section(30)], by="position")
    where = np.array([5.0, 12.0, 17.0, 33.0])
    plain = known_column(Known("1", [1.0, 2.0, 3.0]), rail, where, log)
    assert plain.tolist() == [1, 2, 2, 3]
    axles = known_column(Known("1", [1.0, 2.0, 3.0], behind=(0.0, 6.0)), rail, where, log)
    assert axles.tolist() == [[1, 1], [2, 1], [2, 2], [3, 2]]
    timed = Rail([Section(0), Section(10), Section(30)])
    axles = known_column(Known("1", [1.0, 2.0, 3.0], behind=(0.0, 6.0)), timed, where, log)
    assert axles.tolist() == [[1, 1], [2, 2], [2, 2], [3, 3]]
    assert known_column(Known("1", 4.0), rail, where, log).tolist() == [4] * 4
    assert known_column(Known("1", [7.0, 8.0]), None, None, log).tolist() == [7] * 4
    given = known_column(Known("1", lambda log: 2 * log["time"]), rail, where, log)
    assert given.tolist() == [0, 2, 4, 6]
    with pytest.raises(BadInput, match="Known"):
        Known(3, 1.0)  # type: ignore[arg-type]
