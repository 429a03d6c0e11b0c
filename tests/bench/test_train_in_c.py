"""The laws of the whole train in C: any bytes, missing samples, a train that goes on.

A tick is 8 axles of two seeks and, with ``train_ahead``, a field of cells, so these are few.
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

LAWS = ("train", "train_ahead")


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
def test_missing_samples_are_forgotten(name, tmp_path):
    """In the leaves, ten ticks: its own plausibility tells them, so the status need not.

    Outputs are those without the fault in time, and no wheel locks that would not.
    """
    loop, case = resolve.find_loop(resolve.load_study("leaf_fall"), name)
    found = ws.faults(
        loop, "ctl", case.scenario.but(duration=12.0, end=None), tmp_path, [8.0],
        "plant.train.omega", kinds=("NaN", "times 1e30"), lengths=(10,), signals=["v"],
    )  # fmt: skip
    assert len(found) == 2
    assert [f for f in found if not f.forgotten] == []
