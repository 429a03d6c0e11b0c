"""Tables of the page of a sweep, each against runs by hand."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl.models.vehicle.safe_output import safe_command
from slipctl.run.sweep.spread import count_kept
from slipctl.run.sweep.sweep_plan import Axis, Plan
from slipctl.study.report import sweep_page
from slipctl.study.report.page_style import failure_tables

AXES = (Axis("car.m", 7e3, 12e3, None, "kg"), Axis("K", 1.0, 2.0, None, "1"))


def swept(distances: list[float | None], limits: Any = None, **more: Any) -> Any:
    """Sweep of a distance by draw; none broke off, one with None never reached it."""
    runs = [(k, {"car.m": 7e3 + k, "K": 1.5}, {"distance": d, "ripple": 2.0}, "")
            for k, d in enumerate(distances)]  # fmt: skip
    runs = more.pop("runs", runs)
    limits = limits or {}
    columns = {
        n: np.array([math.inf if m.get(n) is None else m[n] for _, _, m, _ in runs])
        for n in ("distance", "ripple")
    }
    return SimpleNamespace(
        runs=runs, limits=limits, units={"distance": ("m", ()), "ripple": ("N m", ())},
        kept=count_kept([m for _, _, m, _ in runs], limits) if limits else None,
        plan=Plan(AXES, max(len(runs), 1), 1, "lhs"), rows=lambda n: None,
        column=lambda n: columns[n], **more,
    )  # fmt: skip


def cells(html: str) -> list[list[str]]:
    """Rows of the tables of a page."""
    rows = re.findall(r"<tr.*?</tr>", html, re.S)
    return [[re.sub(r"<[^>]*>", "", c).strip() for c in re.findall(r"<t[hd].*?</t[hd]>", r, re.S)]
            for r in rows]  # fmt: skip


def test_each_loop_with_limits_has_its_row():
    limits = {"distance": 100.0}
    sweeps = {"a": swept([90, 95, 120], limits), "none": swept([1.0])}
    sweeps["b"] = swept([1, 2, 3], limits)
    head, *rows = cells(sweep_page._limits(sweeps))
    assert head[0] == "loop"
    assert "distance" in head[3]
    assert "100 m" in head[3]
    assert [r[:2] for r in rows] == [["a", "2 of 3"], ["b", "3 of 3"]]
    assert [r[3] for r in rows] == ["1", "0"]
    for row, sweep in zip(rows, (sweeps["a"], sweeps["b"]), strict=True):
        low, high = (100 * v for v in sweep.kept.interval)
        assert row[2] == f"{low:.3g} to {high:.3g} %"
    assert sweep_page._limits({"a": swept([1.0])}) == ""


def test_differences_are_of_the_same_draws():
    first = swept([10.0, 20.0, None, None])
    other = swept([13.0, None, 40.0, None])
    shifted = swept([], runs=[(k + 1, n, m, w) for k, n, m, w in first.runs])
    found = sweep_page.paired_differences({"a": first, "b": other, "c": shifted}, "distance")
    assert list(found) == ["b"]
    assert found["b"].tolist() == [3.0, math.inf, -math.inf, 0.0]


def test_runs_that_miss_a_limit_or_broke_off_stand_with_their_numbers():
    limits = {"distance": 100.0}
    good = swept([90.0] * 3, limits)
    assert sweep_page._failures({"a": good}) == ""
    runs = [*good.runs, (3, {"car.m": 8e3, "K": 1.25}, {"distance": 150.0}, ""),
            (4, {"car.m": 9e3, "K": 2.0}, {"distance": None}, ""),
            (5, {"car.m": 9.5e3, "K": 1.0}, {}, "it broke")]  # fmt: skip
    said = sweep_page._failures({"a": good, "b": swept([], limits, runs=runs)})
    assert "b: 3 of 6" in said
    assert "a:" not in said
    head, *rows = cells(said)
    assert head == ["run", "car.m [kg]", "K", "what it misses"]
    assert rows[0] == ["3", "8000", "1.25", "distance 150"]
    assert rows[1] == ["4", "9000", "2", "distance never"]
    assert rows[2] == ["5", "9500", "1", "it broke"]
    many = swept([150.0 + k for k in range(sweep_page.WORST + 2)], limits)
    said = sweep_page._failures({"a": many})
    assert len(cells(said)) == sweep_page.WORST + 1
    assert "2 more." in said


@pytest.mark.parametrize("limits", [{}, {"distance": 100.0}, {"ripple": 3.0}])
def test_metrics_that_differ_or_have_a_limit_are_drawn(limits):
    found = sweep_page._metrics_to_draw({"a": swept([1.0, 2.0], limits), "b": swept([1.0], limits)})
    assert found[: len(limits)] == list(limits)
    assert "distance" in found
    assert ("ripple" in found) == ("ripple" in limits)
    same = sweep_page._metrics_to_draw({"a": swept([5.0, 5.0], limits)})
    assert same == list(limits)


def test_what_loops_do_when_something_fails_stands_once_for_those_that_do_alike():
    one, other = safe_command("demand"), safe_command("hold")
    said = failure_tables({"a": one, "b": one, "c": other})
    assert said.count("<details>") == said.count("</details>") == 2
    assert "What a, b do when something fails" in said
    assert "What c does when something fails" in said
    assert "<code>trust.ready</code>" in said
    assert "`" not in said
    assert failure_tables({}) == ""
