"""C gives what is asked of a connection; what its parts give each other is measured."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest
from casadi import fabs, fmin, if_else

from slipctl import Input, Output, State, connect, law, step
from slipctl.block.transforms.asked_outputs import asked_outputs, inner_outputs
from slipctl.ccode.codegen import export


@step(period=0.01, level=Output("1", "mean", lo=-1e3, hi=1e3))
def mean(x=State("1", 0.0, "mean", lo=-1e3, hi=1e3), u=Input("1", "sample", lo=-1, hi=1)):
    """A mean that forgets."""
    now = x + 0.1 * (u - x)
    return dict(x=now), dict(level=now)


@law(
    y=Output("1", "twice", lo=-2e3, hi=2e3), low=Output("1", "1 while it is low", lo=0, hi=1),
    z=Output("1", "half", lo=-1e3, hi=1e3), share=Output("1", "a number from 0 on", lo=0, hi=1),
)  # fmt: skip
def scaled(u=Input("1", "level")):
    """Twice and half, and whether that is low."""
    return dict(y=2 * u, low=if_else(u < 0.15, 1, 0), z=u / 2, share=fmin(fabs(u), 1))


def pair():
    """Both, of which the mean and the half are nobody's outputs."""
    wires = {"mean.u": "u", "scaled.u": "mean.level", "y": "scaled.y"}
    return connect("pair", wires, mean=mean, scaled=scaled)


def test_outputs_that_no_wire_leads_out_are_inner():
    inner = ["mean.level", "scaled.y", "scaled.low", "scaled.z", "scaled.share"]
    assert inner_outputs(pair()) == inner
    assert list(asked_outputs(pair()).outputs) == ["y"]
    alone = connect("alone", {"mean.u": "u"}, mean=mean)
    assert asked_outputs(alone) is alone


@pytest.mark.second
def test_c_gives_the_outputs_and_keeps_the_rest_as_measurements(tmp_path):
    report = export(pair(), tmp_path, check=True, asked=True)
    assert report.data["passed"]
    text = (tmp_path / "pair.h").read_text(encoding="utf-8")
    given = re.search(r"struct pair_out \{(.*?)\} pair_out;", text, re.DOTALL)
    assert re.findall(r"double (\w+)", given[1]) == ["y"]
    (tmp_path / "main.c").write_text(READ, encoding="utf-8")
    run = tmp_path / "run"
    compiler = shutil.which("cc") or "gcc"
    subprocess.run([compiler, "main.c", "pair.c", "-lm", "-o", run], cwd=tmp_path, check=True)
    told = subprocess.run([run], capture_output=True, text=True, check=True).stdout.split()
    y, level, twice, low, half, size, at = map(float, told)
    np.testing.assert_array_equal([y, level, twice, low, half], [0.2, 0.1, 0.2, 1, 0.05])
    assert report.data["memory_bytes"]["state"] == size
    signals = re.search(r"struct pair_signals \{(.*?)\};", text, re.DOTALL)
    assert re.findall(r"bool (\w+)", signals[1]) == ["scaled_low"]  # a share may be 0.1 too
    a2l = (tmp_path / "pair.a2l").read_text(encoding="utf-8")
    place = re.search(r'SYMBOL_LINK "\w+" (\d+)', a2l.split("pair_state.measured.scaled_z")[1])
    assert int(place[1]) == at


READ = """
#include <stddef.h>
#include <stdio.h>
#include "pair.h"
int main(void)
{
    static pair_state state;
    pair_param param;
    pair_in in = {.u = 1.0};
    pair_out out;
    pair_default(&param);
    (void)pair_init(&param, &state);
    (void)pair_step(&in, &param, &state, &out);
    printf("%.17g %.17g %.17g %d %.17g %zu %zu", out.y, state.measured.mean_level,
        state.measured.scaled_y, state.measured.scaled_low, state.measured.scaled_z, sizeof state,
        offsetof(pair_state, measured) + offsetof(struct pair_signals, scaled_z));
    return 0;
}
"""
