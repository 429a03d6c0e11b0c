"""Columns of a log, runs as metrics see them, stretches of a recording, damaged or none at all."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray

from slipctl import BadInput, Input, Output, Scenario, State, connect, step
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.logs.run_log import log_columns
from slipctl.run.metrics import METRICS, Run
from slipctl.run.results import Results
from slipctl.run.roles import Signals
from slipctl.run.sweep import sweep_store as stores
from slipctl.run.warnings import wheels

TIME = 0.5 * np.arange(4)
UNITS = {"v": "m/s", "s": "m/s"}


def run_of(tick=0.5, **signals):
    data = {n: (("time", "axle")[: np.ndim(v)], np.asarray(v, float), {"units": UNITS.get(n, "1")})
            for n, v in signals.items()}  # fmt: skip
    log = xarray.Dataset(data, coords={"time": TIME}, attrs={"period_s": tick})
    return Run(log, Signals(speed="v", slip="s"), ())


def compute(name, run):
    found = METRICS[name].compute(run)
    return None if found is None else found.value


def test_a_run_stops_only_if_it_moves_at_its_begin():
    """From 4 m/s in 0.5 s steps: 1.75 m + 1.25 m + 0.5 m to the tick of standstill."""
    stops = run_of(v=[4.0, 3.0, 2.0, 0.09])
    assert compute("stopping_distance", stops) == pytest.approx(1.75 + 1.25 + 0.5225)
    for v in ([0.0, 3.0, 2.0, 0.0], [0.1, 3.0, 2.0, 0.0]):
        assert METRICS["stopping_distance"].compute(run_of(v=v)) is None
    assert compute("stopping_distance", run_of(v=[4.0, 3.0, 2.0, 0.11])) is None
    assert METRICS["stopping_distance"].compute(run_of(v=[4.0, 3.0, 2.0, 0.11])) is not None


def test_what_several_axles_have_is_their_mean_and_what_one_has_its_own():
    assert run_of(s=[1.0, 2.0, 4.0, 8.0]).get("slip").tolist() == [1, 2, 4, 8]
    assert run_of(s=[[1.0], [2.0], [4.0], [8.0]]).get("slip").tolist() == [1, 2, 4, 8]
    two = run_of(s=[[1.0, 3.0], [2.0, 2.0], [4.0, 0.0], [8.0, 2.0]])
    assert two.get("slip").tolist() == [2, 2, 2, 5]
    assert two.each("slip").shape == (4, 2)
    assert two.get("speed") is None
    assert run_of(v=[1.0] * 4).span(0.5, 1.5) == slice(1, 3)


def test_the_way_of_a_run_ends_behind_its_last_tick():
    """With the speed that the last tick has in its middle."""
    found = run_of(v=[4.0, 3.0, 2.0, 2.5]).travelled
    assert found.tolist() == pytest.approx([0, 1.75, 3.0, 4.125, 4.125 + 0.5 * 2.75])


@pytest.mark.parametrize(("columns", "said"), [(1, ""), (2, " of axle 2"), (4, " of axle 2")])
def test_an_axle_is_told_where_there_are_several(columns, said):
    assert wheels._of_axle(min(1, columns - 1), np.zeros((4, columns))) == said


@step(period=0.1, y=Output("1"), tick=Output("1"), held_y=Output("1"), row=Output("1", shape=(2,)))
def part(n=State("1", 0.0), held_n=State("1", 0.0), tick=State("1", 0.0), u=Input("1", value=0.0)):
    """Counts."""
    import casadi as ca

    return dict(n=n + u, held_n=n, tick=tick), dict(y=n, tick=tick, held_y=n, row=ca.vertcat(n, u))


def test_a_log_keeps_single_numbers_that_are_no_copies():
    """In a part as in a loop; those that are asked for, whatever they are."""
    own = {"u": ("input", 0), "y": ("output", 0), "n": ("state", 0)}
    assert {n: (c.role, c.at) for n, c in log_columns(part, None).items()} == own
    loop = connect("loop", {"out": "b.y"}, a=part, b=part)
    found = {n: (c.role, c.at) for n, c in log_columns(loop, None).items()}
    assert found == {
        "a.u": ("input", 0), "b.u": ("input", 1), "a.y": ("output", 0), "b.y": ("output", 5),
        "out": ("output", 10), "a.n": ("state", 0), "b.n": ("state", 3),
    }  # fmt: skip
    asked = log_columns(loop, {"b.row", "a.tick", "b.held_n"})
    assert {n: (c.role, c.at) for n, c in asked.items()} == {
        "a.tick": ("output", 1), "b.row": ("output", 8), "b.held_n": ("state", 4)}  # fmt: skip


def test_a_stretch_of_a_log_has_the_runs_that_begin_in_it(tmp_path):
    times = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]
    rows = "".join(f"{t};{k}\n" for k, t in enumerate(times))
    (tmp_path / "log.csv").write_text("t [s];v\n" + rows, encoding="utf-8")
    log = read_recording(tmp_path / "log.csv")
    assert log.begins == (4, 8)
    inner = log.between(log.time[2], log.time[9])
    assert inner.begins == (2, 6)
    assert inner.channel("v").tolist() == list(range(2, 10))
    assert log.between(log.time[4], log.time[8]).begins == (4,)
    assert log.between(log.time[5], log.time[7]).begins == ()


def test_notes_of_a_column_are_told_once_and_of_no_other(tmp_path):
    rows = "".join(f"{k};{k},5;{k},25\n" for k in range(4))
    (tmp_path / "log.csv").write_text("time;a;b\n" + rows, encoding="utf-8")
    log = read_recording(tmp_path / "log.csv")
    before = list(log.notes)
    log.table.numbers("a")  # asked for by somebody else
    log.channel("b")
    log.channel("b")
    assert log.notes == [*before, "b has a decimal comma"]


def test_a_signal_that_was_not_logged_is_refused():
    found = Results(SimpleNamespace(signals=Signals(speed="car.v"), claims=(), experiments={}),
                    False)  # fmt: skip
    found.data = {"base": {"a": xarray.Dataset({"car.v": ("time", [1.0]), "x": ("time", [2.0])})}}
    assert found.signal("base", "a", "speed").tolist() == [1]
    assert found.signal("base", "a", "x").tolist() == [2]
    with pytest.raises(BadInput, match=r"base/a logs no car\.w; did you mean 'car\.v'"):
        found.signal("base", "a", "car.w")
    with pytest.raises(BadInput, match="rail is 3; write Rail"):
        Scenario("s", 1.0, rail=3)


def test_a_store_of_another_format_is_refused_and_closed(tmp_path, monkeypatch):
    stores.begin(tmp_path, {"loop": "toy", "samples": 3}).close()
    closed = []
    monkeypatch.setattr(stores.Store, "close", lambda self: closed.append(self))
    monkeypatch.setattr(stores.store, "FORMAT", -1)
    with pytest.raises(BadInput, match=r"sweep\.sqlite"):
        stores.find(tmp_path)
    assert len(closed) == 1
