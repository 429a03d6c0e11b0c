"""Ends, files and names that are none; what a metric takes for the length of a tick."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

from slipctl import BadInput, End, Output, Param, law
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.metrics import Run
from slipctl.run.results import NotRun, Results
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
