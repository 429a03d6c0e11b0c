"""The laws of the whole train in C: any bytes, and a speed that is missing.

A tick is eight axles of two searches and, with ``train_ahead``, a field of cells: few runs.
"""

from __future__ import annotations

import pytest

from bench.loops import wrong_samples as ws
from slipctl import BadInput
from slipctl.ccode import codegen
from slipctl.ccode.check import fuzz
from slipctl.ccode.compile import compilers
from slipctl.ccode.module.plan import Plan
from slipctl.study import resolve

pytestmark = pytest.mark.long

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)

try:
    fuzz.tool()
    HAS_FUZZER = True
except BadInput:
    HAS_FUZZER = False

LAWS = ("train", "train_plan", "train_ahead")


@pytest.mark.skipif(not HAS_FUZZER, reason="no clang with libFuzzer here")
@pytest.mark.parametrize("name", LAWS)
def test_any_bytes_as_inputs_and_parameters(name):
    loop, _ = resolve.find_loop(resolve.load_study("leaf_fall"), name)
    plan = Plan(loop["ctl"], name, loop.period)
    said = fuzz.run_fuzzer(plan, codegen.texts(plan), 0, runs=64)
    assert said["passed"], f"{said['said']} {said['input'][:200]}"
    assert said["executions"] >= 16
    assert said["features"] > 100


@pytest.mark.parametrize("name", LAWS)
def test_missing_samples_are_told_and_no_wheel_locks(name, tmp_path):
    """In the leaves, ten ticks without the speed.

    Valves switch, so their course after a fault is another one; that the train still stops as
    short, its plausibility checks and their tests hold.
    """
    loop, case = resolve.find_loop(resolve.load_study("leaf_fall"), name)
    found = ws.faults(
        loop, "ctl", case.scenario.but(duration=12.0, end=None), tmp_path, [8.0],
        "plant.train.omega", kinds=["NaN"], lengths=(10,), signals=["v"],
    )  # fmt: skip
    assert [(f.told, f.missed, f.locks) for f in found] == [(10, 0, False)]
