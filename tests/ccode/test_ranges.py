"""Every number of every shipped controller has a range, and the guards keep it there."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, every, ranged, step
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison
from slipctl.ccode.compile import compilers
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan
from slipctl.study import resolve

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)


@pytest.mark.second
@pytest.mark.parametrize("name", [
    pytest.param(n, marks=pytest.mark.long) if n == "leaf_fall" else n for n in resolve.studies()
])  # fmt: skip
@pytest.mark.others("long")
def test_every_signal_of_a_controller_has_a_range(name):
    """Both ends, numbers or expressions; and each input and each output says why it is so."""
    study = resolve.load_study(name)
    seen: set[str] = set()
    for case in resolve.build_cases(study, quick=True):
        for loop_name, loop in case.loops.items():
            if study.controller not in loop.parts or loop_name in seen:
                continue
            seen.add(loop_name)
            block = loop[study.controller]
            assert block.without_range() == [], loop_name
            # an input that the block judges itself may be anything
            told = {n for n, s in block.inputs.items() if s.source or s.bounds or s.judged}
            assert set(block.inputs) - told <= {"a_demand"}, loop_name
    assert seen


def test_a_block_of_ones_own_is_generated_and_the_report_says_what_has_no_range(tmp_path):
    @step(y=Output("1", "sum", lo=-1, hi=1))
    def own(
        x=State("1", 0.0, "sum", lo=-9, hi=9),
        u=Input("1", "number", lo=0),
        k=Param("1", 2.0, "gain", lo=0, hi=1e3),
    ):
        """A block whose input has one end."""
        return dict(x=x + u), dict(y=k * x)

    report = codegen.export(own, tmp_path)
    assert report.data["without_range"] == ["input u"]
    assert "1 have no range" in (tmp_path / "report.md").read_text(encoding="utf-8")


def _spoilt(rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rows in which one element in ten is wrong in some way."""
    wrong = np.array([np.nan, np.inf, -np.inf, 1e30, -1e30])
    spoil = rng.random(rows.shape) < 0.1
    return np.where(spoil, rng.choice(wrong, rows.shape), rows)


@pytest.mark.second
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("subway_braking:sta_online", marks=pytest.mark.long),
        "hst_traction:hosm_limited",
    ],
)
def test_python_and_c_give_the_same_bits_and_status_of_wrong_inputs(name, tmp_path):
    """Guarded block and module, on a recorded run in which every tenth number is wrong.

    Both are double and have the same text, so what differs is rounding in calls of the mathematics
    library at most: 1e-12 of the largest value.
    """
    study = resolve.load_study(name.partition(":")[0])
    loop, case = resolve.find_loop(study, name.partition(":")[2])
    inputs, params = codegen.record_part(loop, study.controller, case.scenario, 400)
    plan = Plan(loop[study.controller], "ctl", loop.period)
    rows = np.column_stack([np.reshape(inputs[m.name], (400, -1), order="F") for m in
                            plan.layout.inputs if m.name in inputs])  # fmt: skip
    if rows.shape[1] != plan.n_in:
        pytest.skip("an input is fed by nothing")
    rows = _spoilt(rows, np.random.default_rng(3))
    wanted = comparison.expected_run(plan, rows, dict(params), whole=True)
    assert isinstance(wanted.status, np.ndarray)
    module: CModule = codegen.c_module(loop[study.controller], tmp_path, "ctl").compile().load()
    module.reset(**params)
    status, outputs = [], []
    for row in rows:
        module._in[: row.size] = row
        status.append(module._call("step", module._in, module._param, module._state, module._out))
        outputs.append(module._out[: wanted.outputs.shape[1]].copy())
    assert status == wanted.status.tolist()
    assert (np.array(status) & (guard.OFF_RANGE | guard.BAD_INPUT) != 0).mean() > 0.1
    scale = np.abs(wanted.outputs).max(axis=0) + 1e-300
    assert (np.abs(np.array(outputs) - wanted.outputs) / scale).max() <= 1e-12


def test_a_held_output_keeps_the_range_that_follows_parameters():
    """``every`` holds 0 until the first run: the range is widened to it."""

    @step(period=0.01, y=Output("N", "force", lo="F_min", hi="F_max"))
    def made(
        x=State("1", 0.0, "count", lo=0, hi=9),
        F_min=Param("N", 1.0, "least", lo=0, hi=5),
        F_max=Param("N", 2.0, "most", lo=0, hi=5),
    ):
        """Force."""
        return dict(x=x), dict(y=F_min + 0 * F_max)

    block = every(made, 3)
    ends = block.ends(block.states["held_y"], {"F_min": 1.0, "F_max": 2.0})
    assert [[float(v) for v in given] for given in ends] == [[0.0], [2.0], [], []]


def test_ranges_of_a_table_reach_whatever_has_the_name():
    @step(y=Output("1", "sum"))
    def made(x=State("1", 0.0, "sum"), y_0=Param("1", 0.0, "start"), u=Input("1", "number")):
        """Sum."""
        return dict(x=x + u), dict(y=x + y_0)

    rows = {"x": (-5, 5, "sum"), "u": (-1, "y_0 + 1", "one", 0.5), "y": (-9, 9, "both")}
    block = ranged(made, table=rows | {"y_0": (0, 1, "start")})
    assert block.without_range() == []
    assert block.ends(block.inputs["u"], {"y_0": 2.0}) == ([-1.0], [3.0], [0.5], [])
    assert block.states["x"].source == "sum"
    with pytest.raises(BadInput, match="made has no signal 'w'"):
        ranged(made, table={"w": (0, 1, "")})
