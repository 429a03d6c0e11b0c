"""A step function for each rate: the bits and the status of the one step, whatever comes in."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, State, connect, every, step
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers, files
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.rates import groups
from slipctl.models.huang_2020 import subway_braking_control as control
from slipctl.study import resolve

CC = compilers.first_compiler()
pytestmark = pytest.mark.skipif(not CC, reason="no C compiler")


@step(period=0.002, x=Output("1", "of this tick"))
def quick(z=State("1", 0.0, "kept", lo=-50.0, hi=50.0), u=Input("1", "measured", lo=-9, hi=9)):
    """Before the slow part."""
    return dict(z=0.9 * z + u), dict(x=z + u)


@step(period=0.01, y=Output("1", "every fifth tick"))
def slow(s=State("1", 1.0, "kept", lo=-20.0, hi=20.0), x=Input("1", "of the quick one")):
    """Between them; its state leaves its range where x is large, and the tick is refused."""
    return dict(s=0.5 * s + 0.6 * x), dict(y=s * x)


@step(period=0.002, T=Output("1", "command", lo=-30.0, hi=30.0))
def law(
    i=State("1", 0.0, "integral", lo=-1e3, hi=1e3),
    x=Input("1", "of the quick one"),
    y=Input("1", "of the slow one"),
):
    """Behind the slow part."""
    return dict(i=0.99 * i + y), dict(T=x + 0.1 * i - y)


def whole(offset=0):
    return connect(
        "whole",
        {"slow.x": "quick.x", "law.x": "quick.x", "law.y": "slow.y", "T": "law.T"},
        quick=quick, slow=every(slow, 5, offset), law=law,
    )  # fmt: skip


PROGRAM = """#include "ctl.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
int main(void)
{{
    static ctl_state one, pieces;
    static ctl_param p;
    static ctl_in in;
    static ctl_out a, b;
    int tick, differ = 0, seen = 0;
    ctl_default(&p);
    {began}
    memset(&a, 0, sizeof a);
    memset(&b, 0, sizeof b);
    for (tick = 0; tick < {ticks}; ++tick) {{
        int sa, sb = 0;
        double row[{n}];
        ctl_in other;
        if (fread(row, sizeof row, 1, stdin) != 1) return 2;
        memcpy(&in, row, sizeof in);
        memcpy(&other, row, sizeof in);
        sa = ctl_step(&in, &p, &one, &a);
        {calls}
        seen |= sa;
        differ += (sa != sb) || memcmp(&a, &b, sizeof a) != 0
            || memcmp(&one, &pieces, {states} * sizeof(double)) != 0
            || memcmp(&one.guard, &pieces.guard, sizeof one.guard) != 0;
    }}
    printf("%d %d\\n", differ, seen);
    return 0;
}}
"""


INIT = "(void)ctl_init(&p, &one);\n    (void)ctl_init(&p, &pieces);"


def differ(block, folder: Path, rows: np.ndarray, calls: str, began=INIT) -> tuple[int, int]:
    """Ticks in which the pieces differ from the step, and all bits of the status that came."""
    codegen.export(block, folder, "ctl", rates=True)
    states = sum(s.size for s in block.states.values())
    text = PROGRAM.format(ticks=len(rows), n=rows.shape[1], calls=calls, began=began,
                          states=states)  # fmt: skip
    (folder / "main.c").write_text(text)
    subprocess.run([CC, "-std=c99", "-O1", *files.WARNINGS.split(), "-Werror", "-ffp-contract=off",
                    "-c", "ctl.c"], cwd=folder, check=True)  # fmt: skip
    subprocess.run([CC, "-O1", "main.c", "ctl.o", "-o", "main", "-lm"], cwd=folder, check=True)
    said = subprocess.run(
        [str(folder / "main")], input=rows.tobytes(), capture_output=True, check=True
    )
    found = said.stdout.split()
    return int(found[0]), int(found[1])


def noise(ticks: int, size: float, seed: int = 7) -> np.ndarray:
    """Inputs in and out of their ranges, NaN now and then, and a stretch of NaN."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-size, size, (ticks, 1))
    u[rng.random(ticks) < 0.02] = np.nan
    u[ticks // 2 : ticks // 2 + 300] = np.nan
    return u


def called(row, slow_when: str) -> str:
    """Calls of a tick; what is not the last gets other inputs and outputs than it may look at."""
    text = []
    for k, g in enumerate(row):
        when = "" if g.ticks == 1 else f"if ({slow_when}) "
        given = "&in" if k == 0 else "&other"
        text.append(f"{when}sb = ctl_{g.name}({given}, &p, &pieces, &b);")
    return "\n        ".join(text)


@pytest.mark.parametrize("offset", [0, 3])
def test_the_pieces_in_their_order_are_the_step_to_the_bit(tmp_path, offset):
    """Faults of inputs, refused ticks, resets and limited outputs are among them."""
    block = whole(offset)
    row = groups(Plan(block, "ctl", rates=True))
    assert [g.name for g in row] == ["step_2ms", "step_10ms", "step_2ms_2"]
    rows = noise(5000, 10.0)
    found, seen = differ(block, tmp_path, rows, called(row, f"tick % 5 == {offset}"))
    assert found == 0
    assert seen & 59 == 59  # BAD_INPUT, BAD_RESULT, OFF_RANGE, LIMITED, REFUSED


def test_a_piece_that_is_left_out_is_done_by_the_next(tmp_path):
    """Slow ones never called, called twice, or at the wrong time: nothing is lost."""
    block = whole()
    row = groups(Plan(block, "ctl", rates=True))
    for k, when in enumerate(("0", "1", "tick % 7 == 3")):
        found, _ = differ(block, tmp_path / str(k), noise(1500, 9.0), called(row, when))
        assert found == 0
    last = "sb = ctl_step_2ms_2(&in, &p, &pieces, &b);"
    assert differ(block, tmp_path / "last", noise(500, 9.0), last)[0] == 0
    again = (
        "(void)ctl_step_2ms(&other, &p, &pieces, &b);\n        sb = ctl_step(&in, &p, &pieces, &b);"
    )
    calm = np.full((300, 1), 0.5)  # an input that is looked at twice ages twice
    assert differ(block, tmp_path / "again", calm, again)[0] == 0


def test_without_init_every_piece_is_refused(tmp_path):
    """As the step is: the same status, outputs in their ranges, a state that stays as it is."""
    block = whole()
    calls = called(groups(Plan(block, "ctl", rates=True)), "1")
    found, seen = differ(block, tmp_path, noise(50, 1.0), calls, began="")
    assert (found, seen) == (0, 160)  # REFUSED, NO_INIT


@pytest.mark.second
def test_the_loops_that_have_several_rates():
    """Few groups, though estimator and search stand between quick parts; what reads waits."""
    for name, wanted in (
        ("hst_braking:eppfc@real", ["step_1ms", "step_5ms", "step_1ms_2"]),
        ("subway_braking:sta_online", ["step_16ms", "step_1ms"]),
    ):
        study, _, loop_name = name.partition(":")
        declared = resolve.load_study(study)
        loop, _ = resolve.find_loop(declared, loop_name)
        plan = Plan(loop[declared.controller], "ctl", loop.period, rates=True)
        row = groups(plan)
        assert [g.name for g in row] == wanted
        assert sorted(c.text for g in row for c in g.calls) == sorted(
            c.text for c in plan.equations.lines
        )


@pytest.mark.second
def test_the_folder_tests_its_pieces(tmp_path):
    report = codegen.export(whole(), tmp_path, "ctl", check=True, rates=True)
    assert report.passed
    said = subprocess.run(["make", "test"], cwd=tmp_path, capture_output=True, text=True)
    assert said.returncode == 0
    assert "stepped rate by rate: 0 ticks differ" in said.stdout
    assert "`ctl_step_10ms` (every 5th tick)" in (tmp_path / "README.md").read_text()
    assert re.search(r"int ctl_step_2ms_2\(const ctl_in", (tmp_path / "ctl.h").read_text())


def test_who_has_one_rate_is_told(tmp_path):
    with pytest.raises(BadInput, match="runs in every tick; leave it out"):
        codegen.export(control.super_twisting(), tmp_path / "one", rates=True)
    assert not (tmp_path / "one").exists()
