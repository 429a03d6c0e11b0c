"""Limits of the commands are the parameters, and no integral winds up behind them."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.study import resolve

LIMITS = ("T_max", "F_top", "F_brake")
"""Parameters that limit what a controller commands, by their last name."""

FREE = ("T_out", "T_b", "T_cmd", "F_contr")
"""Commands, by their last name."""


@pytest.mark.second
@pytest.mark.parametrize("name", ["subway_braking", "hst_braking", "freight_traction",
                                  "hst_traction"])  # fmt: skip
@pytest.mark.others("long")
def test_a_limit_that_is_raised_is_not_cut_by_a_number(name):
    """Of each law of a study: with twice the limit the range of the command has room for it."""
    study = resolve.load_study(name)
    cases = resolve.build_cases(study, quick=True)
    blocks = {
        n: loop[study.controller]
        for case in cases for n, loop in case.loops.items() if study.controller in loop.parts
    }  # fmt: skip
    tried = 0
    for loop_name, block in blocks.items():
        settable = [n for n, s in block.params.items()
                    if n.rpartition(".")[2] in LIMITS and not s.derived]  # fmt: skip
        commands = [s for n, s in block.outputs.items() if n in FREE]
        assert commands, loop_name
        for n in settable:
            raised = 2 * float(block.params[n].value)
            values = block.param_values(**{n: raised})
            for s in commands:
                lo, hi, *_ = block.ends(s, values)
                assert max(min(map(float, hi)),
                           -max(map(float, lo))) >= raised, (loop_name, n)  # fmt: skip
                tried += 1
    assert tried


CASES = {
    "subway_braking:sta": (
        dict(v=20.0, mu_hat=0.3, v_opt=1.2, a_demand=20.0, f_hat=0.0, W_hat=0.0),
        ("v_s", 0.2, 1.6), "T_b", 1,
    ),
    "hst_braking:pid_true_reference": (
        dict(v=50.0, T_b=-15e3, omega=115.0, lam_opt=0.15, a_demand=20.0),
        ("lam", 0.01, 0.25), "T_out", -1,
    ),
}  # fmt: skip
"""Inputs, the slip that first is far too small and then too large, the command and its sign."""


@pytest.mark.parametrize("name", CASES)
def test_no_integral_winds_up_behind_a_limit(name, tmp_path):
    """2 s at a limit of 30 kN m: when the slip is too large the torque falls within 100 ms.

    With a clamp at a number below the parameter it stayed for 1959 ms.
    """
    try:
        compilers.compilers()
    except BadInput:
        pytest.skip("no C compiler on this machine")
    given, (slip, small, large), command, sign = CASES[name]
    study = resolve.load_study(name.partition(":")[0])
    loop, _ = resolve.find_loop(study, name.partition(":")[2])
    block = loop[study.controller]
    module = codegen.c_module(block, tmp_path, "ctl", period=loop.period).compile().load()
    limit = next(n for n in block.params if n.rpartition(".")[2] == "T_max")
    module.reset(**{limit: 30e3})
    rows = {n: np.full(2100, given[n]) for n in block.inputs if n in given}
    rows[slip] = np.where(np.arange(2100) < 2000, small, large)
    torque = sign * module.replay(rows)[command]
    top = torque[1990:2000].max()
    assert top > 20e3  # beyond the number that was
    assert torque[2000:].min() < 0.8 * top
