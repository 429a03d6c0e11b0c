"""Inputs of a part as they were in a run; no more of a run than is wanted."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import Input, Output, Param, Rail, RunFailed, Scenario, Section, State, connect, step
from slipctl.ccode import codegen
from slipctl.ccode.check.vectors import expected_outputs, run_inputs
from slipctl.run.simulation import simulate

TICKS = 500


@step(period=0.01, y=Output("1", "sum so far"))
def adder(s=State("1", 0.0, "sum"), u=Input("1", "number")):
    """Sum of what came."""
    return dict(s=s + u), dict(y=s + u)


@step(y=Output("1", "as it is"))
def source(u=Input("1", "number")):
    """Pass a number on."""
    return {}, dict(y=u)


def scenario() -> Scenario:
    """A feed with a number for each tick, and a rail that changes near the end."""
    numbers = np.random.default_rng(3).standard_normal(TICKS)
    rail = Rail([Section(0, values={"other": 0.0}), Section(4.0, values={"other": 1.0})])
    return Scenario("random", TICKS * 0.01, rail, inputs={"u": numbers})


@pytest.fixture(scope="module")
def loop():
    """Source before sum; ``other`` is fed by the rail."""

    @step(y=Output("1", "sum"))
    def both(u=Input("1", "number"), other=Input("1", "another")):
        """Sum of two."""
        return {}, dict(y=u + other)

    wires = {"both.u": "u", "both.other": "other", "ctl.u": "both.y"}
    return connect("loop", wires, both=both, ctl=adder)


@pytest.mark.parametrize("ticks", [1, 30, TICKS, 10 * TICKS])
def test_the_first_ticks_are_those_of_the_whole_run(loop, ticks):
    """A folder that is only written needs no more of a run than its vectors keep."""
    whole, _ = codegen.record_part(loop, "ctl", scenario())
    first, _ = codegen.record_part(loop, "ctl", scenario(), ticks)
    assert first["u"].tobytes() == whole["u"][:ticks].tobytes()
    assert len(first["u"]) == min(ticks, TICKS)


@pytest.mark.second
def test_a_folder_that_is_only_written_rolls_what_it_keeps(tmp_path, monkeypatch):
    """The reference in Python is as long as the vectors; with ``check`` it has every tick."""
    monkeypatch.setattr(codegen, "KEPT", 40)
    inputs = {"u": np.ones(TICKS)}
    assert codegen.export(adder, tmp_path / "a", inputs=inputs).data["ticks"] == 40
    assert codegen.export(adder, tmp_path / "b", inputs=inputs, check=True).data["ticks"] == TICKS


@pytest.mark.second
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.others("long")
def test_states_of_a_large_file_stand_in_some_ticks(tmp_path, monkeypatch, real):
    """All inputs and outputs are replayed; a state that goes astray is seen at the next look."""
    inputs = {"u": np.random.default_rng(5).standard_normal(TICKS)}
    whole = codegen.export(adder, tmp_path / "whole", inputs=inputs, real=real)
    monkeypatch.setattr(expected_outputs, "LARGEST_FILE", 30_000)
    few = codegen.export(adder, tmp_path / "few", inputs=inputs, check=True, real=real)
    sizes = [(f.folder / "vectors.txt").stat().st_size for f in (whole, few)]
    assert sizes[1] < 30_000 < sizes[0]
    assert few.data["vectors"]["states_every"] > 1 == whole.data["vectors"]["states_every"]
    assert not few.failures
    assert f"{TICKS} ticks, 0 faults" in few.data["compiled"][0]["own_test"]


def test_a_run_that_breaks_stops_there(loop):
    """States after the tick that breaks are none of the reference."""

    @step(y=Output("1", "square"))
    def grows(x=State("1", 2.0, "number"), u=Input("1", "factor")):
        """Square again and again."""
        return dict(x=u * x * x), dict(y=x)

    from slipctl.ccode.check.comparison import reference
    from slipctl.ccode.module.plan import Plan

    with pytest.raises(RunFailed, match="itself gives NaN or infinity at tick"):
        reference(Plan(grows), np.ones((30, 1)), {})
    outputs, states = reference(Plan(grows), np.ones((30, 1)), {}, whole=False)
    assert len(outputs) == len(states) == 9  # 2^(2^10) is beyond double
    assert states[:, 0].tolist() == [2.0**2**k for k in range(1, 10)]
    assert outputs[1:, 0].tolist() == states[:-1, 0].tolist()


def test_what_a_part_sees_is_logged(loop):
    """Only what feeds the part is kept of the run, and it is what the whole log has."""
    data = simulate(loop, scenario(), log=["both.y", "u"])
    found = run_inputs.logged_inputs(loop, "ctl", data)
    assert found["u"].tobytes() == codegen.record_part(loop, "ctl", scenario())[0]["u"].tobytes()


def test_shared_numbers_are_those_of_the_run():
    """A mass and a start that plant and controller have in common."""

    @step(period=0.01, y=Output("1", "what it began with, and the number"))
    def keeper(s=State("1", "begin", "kept"), u=Input("1", "number"),
               begin=Param("1", 0.0, "start"),
               m=Param("1", 1.0, "weight", lo=0, hi=10)):  # fmt: skip
        """Keep the start."""
        return dict(s=s), dict(y=s + m * u)

    @step(y=Output("1", "as it is"), period=0.01)
    def plant(u=Input("1", "number"), begin=Param("1", 0.0, "start"),
              m=Param("1", 1.0, "weight", lo=0, hi=10)):  # fmt: skip
        """Pass a number on."""
        return {}, dict(y=m * u + begin)

    share = {"m": ["plant.m", "ctl.m"], "begin": ["plant.begin", "ctl.begin"]}
    loop = connect(
        "loop", {"plant.u": "u", "ctl.u": "plant.y"}, share=share, plant=plant, ctl=keeper
    )
    run = Scenario("one", 0.1, Rail([Section(0)]), inputs={"u": 1.0},
                   params={"m": 3.0, "begin": 7.0})  # fmt: skip
    _, params = run_inputs.record_part(loop, "ctl", run)
    assert {n: float(v) for n, v in params.items()} == {"begin": 7.0, "m": 3.0}
    apart = run.but(params={"m": 3.0, "ctl.m": 4.0})
    _, params = run_inputs.record_part(loop, "ctl", apart)
    assert {n: float(v) for n, v in params.items()} == {"begin": 0.0, "m": 4.0}
