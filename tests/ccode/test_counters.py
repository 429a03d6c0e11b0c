"""Refused ticks count for the parts that run every few ticks, in Python and in C."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    Input,
    Output,
    State,
    c_module,
    connect,
    every,
    gated,
    replicate,
    step,
)
from slipctl.block.transforms.discretisation import counters
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison
from slipctl.ccode.check.vectors import expected_outputs
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan
from slipctl.commands.cli import main
from slipctl.study import resolve


@step(y=Output("1", lo=-1e9, hi=1e9))
def adds(x=State("1", 0.0, lo=-1e9, hi=1e9), u=Input("1", lo=-9, hi=9, stale=1)):
    """Sum."""
    return dict(x=x + u), dict(y=x + u)


LOOP = connect(
    "loop", {"fast.u": "u", "slow.u": "u", "late.u": "u", "y": "slow.y", "z": "late.y"},
    fast=adds, slow=every(adds, 5), late=every(every(adds, 2), 3, 1),
)  # fmt: skip


def test_counters_are_those_of_ticks():
    """That of a part inside another one under ``every`` counts its runs."""
    assert counters(LOOP) == {"slow.tick": 5, "late.tick_": 3}
    assert counters(every(adds, 4)) == {"tick": 4}
    assert counters(adds) == {}
    assert Plan(adds).counters == []


def test_what_is_around_a_slow_part_has_no_counter_of_its_own():
    """Copies of it, one for each axle, and a gate say what it is made with, as it does itself."""
    several = replicate(every(adds, 5), 3)
    assert counters(several) == {"tick": 5}
    assert counters(gated(every(adds, 5))) == {"tick": 5}
    assert counters(every(several, 2)) == {"tick_": 2}
    assert [(m.name, m.size) for m, _ in Plan(several).counters] == [("tick", 3)]


@pytest.mark.second
@pytest.mark.parametrize(
    "name",
    ["pid", *(pytest.param(n, marks=pytest.mark.long) for n in ("super_twisting", "predictive"))],
)
def test_each_controller_of_the_file_that_new_writes_becomes_c(name, tmp_path, monkeypatch):
    """That of a four-axled vehicle has parts for each axle, and some that run every few ticks."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "metro", "-q"]) == 0
    study = resolve.load_study("metro.toml")
    loop, _ = resolve.find_loop(study, name)
    plan = Plan(loop[study.controller], "ctl", loop.period)
    text = codegen.texts(plan)["ctl.c"]
    moved = re.findall(r"(?:k < (\d+); \+\+k\) \{\s*)?x->[\w.]+(?:\[k\])? = later\(", text)
    assert len(moved) == len(plan.counters) > 0
    assert sum(int(n or 1) for n in moved) == sum(m.size for m, _ in plan.counters)


@given(st.integers(0, 6), st.integers(0, 1000), st.integers(7, 40))
def test_a_counter_that_missed_ticks_stands_where_it_would_be(tick, missed, ticks):
    assert float(guard.counter_after()(tick, missed, ticks)) == (tick + missed) % ticks


def test_ticks_before_each_good_one():
    good = np.array([0, 0, 1, 1, 0, 1, 0], dtype=bool)
    assert expected_outputs.missed_ticks(good).tolist() == [2, 0, 1]
    assert comparison._pieces(expected_outputs.missed_ticks(good), 3) == [(0, 1), (1, 3)]
    assert comparison._pieces(None, 4) == [(0, 4)]
    assert comparison._pieces(np.array([0, 2]), 2) == [(0, 2)]


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize(("real", "rates"), [("double", False), ("float", False), ("double", True)])
def test_a_part_keeps_its_place_in_time(tmp_path, real, rates):
    """After any gap it runs in the ticks in which it would without: each fifth from the start."""
    rng = np.random.default_rng(3)
    u = np.ones(400)
    gaps = [(13, 1), (40, 4), (61, 5), (90, 11), (150, 37), (200, 100)]
    for at, many in gaps:
        u[at : at + many] = np.nan
    u[310:] = np.where(rng.random(90) < 0.4, np.nan, 1.0)
    codegen.export(LOOP, tmp_path / "ctl", name="ctl", real=real, rates=rates)
    module = c_module(LOOP, tmp_path / "c", "ctl", real=real).compile().load().reset()
    y = module.replay({"u": u})["y"]
    run = comparison.expected_run(Plan(LOOP, real=real), u[:, np.newaxis], {})
    names = [m.name for m in Plan(LOOP).layout.outputs]
    np.testing.assert_array_equal(run.outputs[:, names.index("y")], y)
    np.testing.assert_array_equal(run.status, module.status)
    ran = 1 + np.flatnonzero(np.diff(y))
    caught_up = np.zeros(400, dtype=bool)  # a tick after a gap goes on where the last one was
    caught_up[1:] = np.isnan(u[:-1]) & np.isfinite(u[1:])
    assert {int(k) % 5 for k in ran if not caught_up[k]} == {0}
    missing = [k for k in range(5, 300, 5) if k not in ran and np.isfinite(u[k])]
    assert all(caught_up[k] for k in missing)
    assert ("missed" in (tmp_path / "c" / "ctl.h").read_text(encoding="utf-8")) == bool(gaps)


@pytest.mark.second
@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_the_folder_tests_itself_with_counters(tmp_path):
    """Vectors with gaps, the misuse of its own test, and the A2L file."""
    rows = {"u": np.where(np.arange(300) % 7 < 3, 20.0, np.sin(np.arange(300)))}
    report = codegen.check(LOOP, rows, tmp_path / "ctl")
    assert report["passed"]
    a2l = codegen.export(LOOP, tmp_path / "out", name="ctl")
    assert a2l is not None
    assert "guard.missed" in (tmp_path / "out" / "ctl.a2l").read_text(encoding="utf-8")


@pytest.mark.second
@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.others("long")
def test_the_own_test_counts_calls_of_slow_parts(tmp_path, real):
    """A late call finds them behind by the ticks that were missed; it did not expect that."""
    assert codegen.export(LOOP, tmp_path / "ctl", check=True, real=real, counter=True).passed
