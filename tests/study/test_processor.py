"""A loop held against a board that is the block itself, altered in one place: what is told then."""

from __future__ import annotations

from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
import toy_study
import xarray

from slipctl import BadInput
from slipctl.ccode import codegen
from slipctl.ccode.check.processor.rig import BROKEN, LATE, LOST
from slipctl.ccode.check.vectors.expected_outputs import start_state
from slipctl.ccode.ship.readable import closed_loop_said
from slipctl.run import store
from slipctl.study import processor
from slipctl.study.request import Request


class Board:
    """Answers as the block does; ``alter`` may change the status and the outputs of a tick."""

    def __init__(self, plan: Any, _texts: Any, _on: str, params: Any, alter: Any = None) -> None:
        self.f, self.x = plan.block.f, start_state(plan.block, params)
        self.p = ca.DM(plan.block.pack("param", plan.block.param_values(**params)))
        self.alter = alter or (lambda tick, status, y: (status, y))
        self.instructions: list[int] = []
        self.heard = -1

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def step(self, tick: int, row: Any, now: int | None = None, damage: bool = False) -> Any:
        self.instructions.append(150 if tick == 17 else 100)
        if damage:
            return BROKEN, np.zeros(self.f.size1_out(1))
        status = LATE * (now is not None) | LOST * (tick > self.heard + 1)
        self.heard = tick
        following, y = self.f(self.x, row, self.p)
        self.x = np.ravel(following.full())
        return self.alter(tick, status, np.ravel(y.full()))


@pytest.fixture
def compare(monkeypatch):
    for tool in ("tool", "emulator"):
        monkeypatch.setattr(processor.targets, tool, lambda target: target)

    def run(real: str = "double", alter: Any = None, **more: Any) -> processor.Comparison:
        monkeypatch.setattr(processor, "Rig", partial(Board, alter=alter))
        asked = {"seconds": 0.4, "clock": "1MHz"} | more
        return processor.compare(f"{toy_study.__file__}:soft", "cortex-m4", real, **asked)

    return run


def test_a_board_that_does_as_the_block_passes_with_its_count_and_load(compare, tmp_path):
    found = compare(out=tmp_path / "n.json")
    d = found.data
    assert found.passed
    assert (d["ticks"], d["part"], d["status"], d["wrong_status"]) == (400, "ctl", {}, 0)
    assert d["instructions"] == {"mean": 100 + 50 / 400, "most": 150, "worst_tick": 17}
    assert d["load"]["worst"] == pytest.approx(0.15)  # of the 1000 of 1 ms at 1 MHz
    assert max(d["signals"].values()) == 0
    assert {"ctl.T_b", "plant.car.v", "plant.car.s"} <= set(d["signals"])
    assert not {n for n in d["signals"] if n.startswith("ctl.")} - {"ctl.T_b"}
    assert {"distance", "torque_ripple"} <= set(d["metrics"])
    assert all(a == b for a, b in d["metrics"].values())
    assert store.read_json(tmp_path / "n.json")["instructions"]["most"] == 150
    for said in ("400 ticks", "100 in the mean, most 150 (tick 17)", "other than 0: none",
                 "load 10 % of a tick, worst 15 %", "\n  passed"):  # fmt: skip
        assert said in str(found)
    late = compare(clock="0.14MHz")
    assert late.data["failed"] == ["load"]
    assert str(late).endswith("FAILED: load")


def test_what_differs_is_told_by_what_it_breaks(compare):
    """A millionth is no trajectory in double; a third of the torque is no metric in float."""
    more = compare(alter=lambda tick, status, y: (status, y * (1 + 1e-6)))
    assert more.data["failed"] == ["trajectory"]
    assert 3e-7 < more.data["signals"]["ctl.T_b"] < 3e-6
    fine = compare("float", alter=lambda tick, status, y: (status, y * (1 + 1e-6)))
    assert fine.passed
    assert set(fine.data["metrics_move"]) == set(fine.data["metrics"])
    assert max(fine.data["metrics_move"].values()) > 0
    bad = compare("float", alter=lambda tick, status, y: (status, y * 4 / 3))
    assert bad.data["failed"] == ["metrics"]
    assert "distance" not in bad.data["metrics_differ"]
    assert str(bad).count("DIFFERS") == len(bad.data["metrics_differ"]) > 0
    told = compare(alter=lambda tick, status, y: (5 * (tick in (7, 8)), y))
    assert (told.data["status"], told.data["failed"]) == ({5: 2}, ["status of 2 ticks"])
    assert "0x005 in 2 ticks" in str(told)


def test_faults_are_told_by_the_status_and_the_slip_comes_back(compare):
    faults = ["50=lost", "80=late", "110=broken", "111=lost"]
    found = compare(faults=faults)
    assert found.passed, found.data["failed"]
    assert found.data["status"] == {-1: 2, LOST: 2, LATE: 1, BROKEN: 1}
    assert found.data["faults"] == {"50": "lost", "80": "late", "110": "broken", "111": "lost"}
    assert 0 < found.data["difference_at_the_end"] < 0.01
    assert "no answer in 2 ticks" in str(found)
    gone = compare(faults=faults, alter=lambda tick, status, y: (status, y * (tick < 50)))
    assert gone.data["failed"] == ["no recovery"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"faults": ["5=gone"]}, "write TICK=WHAT"),
        ({"faults": ["-5=lost"]}, "write TICK=WHAT"),
        ({"faults": ["399=lost"]}, "write a tick from 0 to 398"),
        ({"faults": ["7=lost", "7=late"]}, "tick 7 is lost already"),
        ({"seconds": 0.0005}, "holds no tick"),
    ],
)
def test_what_cannot_happen_is_refused(compare, more, said):
    with pytest.raises(BadInput, match=said):
        compare(**more)
    if "faults" in more:
        assert compare(faults=["398=late"]).data["status"] == {LATE: 1}


@pytest.fixture(scope="module")
def float_loop(tmp_path_factory):
    """A loop, its controller in float C, and the two compared."""
    asked = Request.read(f"{toy_study.__file__}:soft").needs_loop()
    loop, case = asked.chosen
    params = codegen.record_part(loop, "ctl", case.scenario, 1)[1]
    module = codegen.c_module(loop["ctl"], tmp_path_factory.mktemp("c"), real="float").compile()
    return processor.closed_loop(asked, "ctl"), module.load(), params


@pytest.mark.parametrize("turned", [False, True])
def test_two_runs_are_compared_while_both_last(turned):
    """One ends two ticks before; the largest difference is in the tick before that."""

    def run(values):
        return xarray.Dataset({"v": ("time", values)}, coords={"time": np.arange(len(values))})

    long, short = run([1.0, 2.0, 3.0, 90.0, 99.0]), run([1.0, 2.5, 2.0])
    pair = (short, long) if turned else (long, short)
    found = processor._farthest(*pair, "v")
    assert (found["absolute"], found["tick"], found["element"]) == (1.0, 2, None)


def test_float_c_in_its_loop_stays_within_rounding(float_loop):
    compared, module, params = float_loop
    found = compared(module, params)
    assert found["passed"]
    assert not found["metrics_move"]  # nothing beyond 1 %, so nothing to try
    (far,) = found["commands"].values()
    assert 0 < far["absolute"] < 1e-5 * far["largest"]
    assert 0 <= far["tick"] < found["ticks"]
    assert found["metrics"]["distance"][1] == pytest.approx(found["metrics"]["distance"][0], 1e-6)


def test_a_controller_that_is_another_one_in_float_fails_by_its_command(float_loop):
    """Its torque is halved from tick 100 on: no rounding excuses that."""
    compared, module, params = float_loop

    class Halved:
        block = module.block
        reset = staticmethod(lambda **p: module.reset(**p) and Halved())

        def __init__(self):
            self.ticks = 0

        def replay_rows(self, rows):
            out, states = module.replay_rows(rows)
            self.status, self.ticks = module.status, self.ticks + 1
            return (out / 2 if self.ticks > 100 else out), states

    found = compared(Halved(), params)
    (far,) = found["commands"].values()
    assert far["tick"] >= 100
    assert far["absolute"] > 0.1 * far["largest"]
    assert not found["passed"]
    assert set(found["metrics_differ"]) <= set(found["metrics_move"])
    said = closed_loop_said(found, "m")
    assert f"by {far['absolute']:.3g} of {far['largest']:.3g}" in said
    assert said.endswith("FAILED")
