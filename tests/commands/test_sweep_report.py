"""What ``slipctl sweep`` prints of its runs, number by number."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl.commands import sweep
from slipctl.run.sweep.sweep_plan import Axis, Plan
from slipctl.study.report import sweep_page

AXES = (Axis("car.m", 7e3, 12e3, 5, "kg"), Axis("ctl.K", 1.0, 2.0, None, "1"))


def swept(**more: Any) -> Any:
    """A sweep of eleven runs; the second metric is not reached in ``never`` of them."""
    never = more.pop("never", 0)
    x = np.arange(11.0)
    second = np.where(x < never, math.inf, 2 * x)
    found = {
        "folder": Path("out"), "about": {"loop": "a:b", "scenario": "base"},
        "plan": Plan(AXES, 11, 7, "lhs"), "runs": [None] * 11, "failed": {}, "missing": 0,
        "kept": None, "labelled": lambda: [("first", "m", 10 * x), ("second", "1", second)],
    }  # fmt: skip
    return SimpleNamespace(**(found | more))


@pytest.mark.parametrize("never", [0, 3])
def test_each_metric_has_a_row_of_quantiles(never):
    lines = sweep.report(swept(never=never)).splitlines()
    head = next(line for line in lines if line.startswith("metric"))
    assert ("never" in head) == bool(never)
    row = next(line for line in lines if line.startswith("first")).split()
    assert row[:2] == ["first", "m"]
    assert [float(c) for c in row[2:7]] == [0, 5, 50, 95, 100]
    assert len(row) == 7
    second = next(line for line in lines if line.startswith("second")).split()
    assert (second[-1] == "3") == bool(never)
    assert (sweep.NEVER in "\n".join(lines)) == bool(never)
    assert lines[-1] == "out: slipctl.open_sweep('out') has each run"


def test_the_head_tells_runs_and_what_varied():
    plain = sweep.head_lines(swept())
    assert plain[0] == "a:b@base: 11 runs"
    assert "car.m = 7000 .. 12000 kg (5 values)" in plain[1]
    assert "ctl.K = 1 .. 2 (drawn)" in plain[1]
    assert plain[2] == "design lhs, seed 7"
    odd = sweep.head_lines(swept(failed={3: "broke"}, missing=2))
    assert odd[0] == "a:b@base: 11 runs, 1 failed, 2 missing"
    assert len(sweep.head_lines(swept(plan=Plan(AXES[:1], 5, 7, "lhs")))) == 2
    kept = sweep.report(swept(kept="9 of 11 within")).splitlines()
    assert kept[1] == "9 of 11 within"


def test_a_page_of_a_sweep_has_a_row_for_each_number_that_varied():
    drawn = sweep_page._varied(swept())
    assert "Design lhs, seed 7." in drawn
    assert "7000 to 12000" in drawn
    assert "5 values" in drawn
    assert "1 to 2" in drawn
    assert "<td>drawn" in drawn or ">drawn<" in drawn
    assert "Design" not in sweep_page._varied(swept(plan=Plan(AXES[:1], 5, 7, "lhs")))
