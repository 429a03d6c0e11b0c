"""A part that runs every few ticks: its module is called once for each of its runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    every,
    flow,
    sampled,
    simulate,
    step,
)
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode import codegen
from slipctl.ccode.check.processor.in_loop import run_in_loop
from slipctl.ccode.module.plan import Plan
from slipctl.models import vehicle
from slipctl.study.request import Request


@flow(y=Output("m/s", "speed"))
def mass(v=State("m/s", 0.0, "speed"), F=Input("N", "force"), m=Param("kg", 2.0, "mass", lo=0.1)):
    """A mass."""
    return dict(v=F / m), dict(y=v)


@step(F=Output("N", "force", lo=-2, hi=2))
def law(
    i=State("N", 0.0, "integral", lo=-9, hi=9),
    v=Input("m/s", "speed", lo=-1, hi=1),
    goal=Input("m/s", "wanted speed", value=0.3, lo=-1, hi=1),
):
    """Proportional and integral."""
    return dict(i=i + 0.2 * (goal - v)), dict(F=2 * (goal - v) + i)


def loop(n: int, offset: int) -> Block:
    control = connect("control", {"law.v": "v", "F": "law.F"}, law=every(law, 2))
    wires = {"ctl.v": "plant.y", "plant.F": "ctl.F"}
    plant = sampled(mass, 0.01, "rk4")
    return connect("loop", wires, plant=plant, ctl=every(control, n, offset))


SCENARIO = Scenario("step", 1.0)


class Other:
    """Another processor: the block in double, with its own state."""

    def __init__(self, block: Block) -> None:
        self.f = block.f
        self.x = block.pack("state", block.start())
        self.p = block.pack("param", block.param_values())
        self.asked: list[int] = []

    def step(self, tick, row, now=None, damage=False):
        self.asked.append(tick)
        self.x, y = self.f(self.x, row, self.p)
        return 0, np.array(y.full()).ravel()


@pytest.mark.parametrize(("n", "offset"), [(1, 0), (5, 0), (5, 3)])
def test_a_module_of_a_slow_controller_makes_a_period_in_each_call(n, offset):
    """Fed with the inputs of its runs it gives what held between them in the loop."""
    whole = loop(n, offset)
    runs = runs_of_part(whole, "ctl")
    assert (runs.ticks, runs.first) == (n, offset)
    assert runs.period == pytest.approx(0.01 * n)
    log = simulate(whole, SCENARIO, log=["plant.y", "ctl.F"])
    inputs, _ = codegen.record_part(whole, "ctl", SCENARIO)
    assert len(inputs["v"]) == len(range(offset, 100, n))
    other = Other(runs.block)
    gave = [float(other.step(k, [v, 0.3])[1][0]) for k, v in enumerate(inputs["v"])]
    held = log["ctl.F"].values
    assert np.repeat(gave, n)[: 100 - offset].tolist() == held[offset:].tolist()
    assert not held[:offset].any()


def test_parts_within_are_called_at_the_product_of_the_ticks():
    whole = loop(5, 3)
    runs = runs_of_part(whole, "ctl.law")
    assert (runs.block.name, runs.ticks, runs.first) == ("law", 10, 3)
    assert runs_of_part(whole, "plant").ticks == 1
    with pytest.raises(BadInput, match="no part"):
        runs_of_part(whole, "ctl.other")


@pytest.mark.parametrize("offset", [0, 3])
def test_a_processor_is_asked_once_in_a_period(offset):
    """Between its runs the last answer holds, so the loop is that of Python to the bit."""
    whole = loop(5, offset)
    other = Other(runs_of_part(whole, "ctl").block)
    got = run_in_loop(whole, "ctl", SCENARIO, other)
    wanted = simulate(whole, SCENARIO, log=["plant.y"])
    assert other.asked == list(range(len(range(offset, 100, 5))))
    assert len(got.status) == len(other.asked)
    assert got.data["plant.y"].values.tolist() == wanted["plant.y"].values.tolist()


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> Block:
    """Loop of the metro with a period of 10 ms."""
    text = (Path(vehicle.__file__).parent / "files" / "metro.toml").read_text(encoding="utf-8")
    file = tmp_path_factory.mktemp("slow") / "metro.toml"
    assert "[control]\n" in text
    file.write_text(text.replace("[control]\n", '[control]\nperiod = "10 ms"\n'), encoding="utf-8")
    return Request.read(f"{file}:pid").chosen[0]


@pytest.mark.second
def test_the_c_of_a_vehicle_has_the_period_of_its_file(slow):
    runs = runs_of_part(slow, "ctl")
    plan = Plan(runs.block, "metro", runs.period)
    assert plan.period == pytest.approx(0.01)
    assert "tick" not in runs.block.states  # nothing in it counts calls of 1 ms
    values = runs.block.param_values()
    times = {n: float(np.ravel(values[n])[0]) for n in values
             if n.rpartition(".")[2] in ("period", "T", "T_s")}  # fmt: skip
    assert times
    assert set(times.values()) == {0.01}
    assert all(runs.block.params[n].derived for n in times)  # none to be tuned
