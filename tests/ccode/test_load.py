"""Load of a processor: told for the mean and the longest step, above a tick a failure."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.processor.rig import Rig
from slipctl.ccode.compile import board, compilers

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)

on_board = pytest.mark.skipif(
    not shutil.which(board.TOOLS + "gcc") or not shutil.which(board.EMULATOR),
    reason="no compiler for ARM, or no QEMU",
)


@step(y=Output("1", "sum"))
def adder(x=State("1", 0.0, "sum", lo=-1e6, hi=1e6), u=Input("1", "number", lo=-1, hi=1)):
    """Sum of what comes."""
    return dict(x=x + u), dict(y=x)


def test_a_load_is_instructions_over_the_cycles_of_a_tick() -> None:
    found = load.load(5_000.0, 30_000, 1e-3, 25e6)
    assert (found["mean"], found["worst"], found["passed"]) == (0.2, 1.2, False)
    assert (
        "worst 120 %, at 25 MHz (25000 cycles), one instruction a cycle: TOO MUCH"
        in load.load_line(found)
    )
    assert load.load(5_000.0, 30_000, 1e-3, 168e6)["passed"]
    assert load.load(5_000.0, 25_000, 1e-3, 25e6)["passed"]  # just done when the next one comes
    assert load.load(1.0, 1.0, None, 25e6) == {}  # a law has no tick


@pytest.mark.parametrize(
    ("text", "hertz"), [(None, 25e6), ("168MHz", 168e6), ("1 GHz", 1e9), ("32768", 32768.0)]
)
def test_clocks(text: str | None, hertz: float) -> None:
    assert load.clock(text) == pytest.approx(hertz, rel=1e-12)


@pytest.mark.parametrize("text", ["0MHz", "-1MHz", "3m", "fast", "inf"])
def test_what_is_no_clock(text: str) -> None:
    with pytest.raises(BadInput):
        load.clock(text)


@pytest.mark.second
@on_board
def test_a_step_that_takes_longer_than_its_tick_fails(tmp_path: Path) -> None:
    """The counts are QEMU's, the same on the rig; a tick of 1 us has 25 cycles."""
    ticks = 20
    u = np.linspace(-1.0, 1.0, ticks)
    report = codegen.export(
        adder, tmp_path / "c", "adder", inputs={"u": u}, check=True, period=1e-6, real="float",
        target="cortex-m4", clock=25e6,
    )  # fmt: skip
    (there,) = report.data["targets"]
    assert there["passed"]  # the C is that of Python
    assert report.failures == ("a step takes longer than its tick",)
    assert there["load"]["worst"] == pytest.approx(there["instructions"]["most"] / 25)
    assert "cortex-m4: load" in (tmp_path / "c/report.md").read_text()
    plan = codegen.Plan(adder, "adder", 1e-6, "float")
    with Rig(plan, codegen.texts(plan), "cortex-m4", {}) as rig:
        for k in range(ticks):
            rig.step(k, u[k : k + 1])
        counts = rig.instructions
    assert len(counts) == ticks
    # another program around it: the linker may place it so that a jump is one instruction more
    assert max(counts) == pytest.approx(there["instructions"]["most"], abs=8)
    slow = codegen.Plan(adder, "adder", 1e-3, "float")
    assert load.load(np.mean(counts), max(counts), slow.period, 25e6)["passed"]
