"""Tables of straight pieces in C: the bits of the sum of ramps that the block is."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from module_text import of_folder, of_plan

from slipctl import BadInput, Block, Input, Output, law
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes import ramp_tables

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)


def table(xs: np.ndarray, ys: np.ndarray) -> Block:
    """Two results by straight pieces, as ``argmax_table`` writes them, and one beside them."""
    slopes = np.diff(ys, axis=0) / np.diff(xs)[:, None]

    @law(y=Output("1", shape=(2,)), z=Output("1"))
    def pieced(u=Input("1"), w=Input("1", value=1.0)):
        """Ramps."""
        ramps = [ca.fmin(ca.fmax(u - a, 0.0), b - a) for a, b in pairwise(xs.tolist())]
        y = [
            sum((float(s) * r for s, r in zip(slopes[:, i], ramps, strict=True)), float(ys[0, i]))
            for i in range(2)
        ]
        return dict(y=ca.vertcat(*y), z=w * ramps[3] + y[0])

    return pieced


def random_table(seed: int, n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.uniform(0.01, 3.0, n)) - 5.0, rng.normal(size=(n, 2))


def test_the_bits_of_the_sum(tmp_path: Path) -> None:
    for seed in range(3):
        xs, ys = random_table(seed)
        block = table(xs, ys)
        folder = tmp_path / str(seed)
        module = codegen.c_module(block, folder).compile().load()
        source = of_folder(folder, "pieced")
        assert "reached(t" in source
        assert "[11][4]" in source  # height and slope of two results; z takes the first of them
        beside = [np.nextafter(x, side) for x in xs for side in (-np.inf, np.inf)]
        places = [*xs, *beside, -1e308, 1e308, *np.random.default_rng(9).uniform(-9, 30, 200)]
        for u in places:
            wanted, got = block(u=u, w=0.7), module.step(u=u, w=0.7)
            np.testing.assert_array_equal(wanted["y"], got["y"])
            assert wanted["z"] == got["z"]


@given(st.integers(0, 10**6), st.floats(-20, 40))
def test_every_place(seed: int, u: float) -> None:
    """Height plus slope times ramp is the sum, to the bit, with no compiler."""
    xs, ys = random_table(seed)
    f = table(xs, ys).f
    _, tables = ramp_tables.replace_ramps(_nodes(f))
    (found,) = tables
    k = max(int(np.searchsorted([r.begin for r in found.ramps], u, side="right")) - 1, 0)
    ramp = min(max(u - found.ramps[k].begin, 0.0), found.ramps[k].length)
    wanted = np.array(f([], [u, 1.0], [])[1].full()).ravel()
    for i, column in enumerate(found.columns):
        height, slope = column[k]
        assert height + slope * ramp == wanted[i]


def _nodes(f: ca.Function) -> list:
    from slipctl.ccode.tree.expressions import read

    return read(f)[0]


def test_other_sums_stay_sums() -> None:
    """Few ramps, ramps that overlap or begin above 0, another order: written as they are."""
    xs, ys = random_table(1, 6)
    assert "reached" not in of_plan(Plan(table(xs, ys)))
    for apart, order in ((0.5, range(10)), (1.0, reversed(range(10)))):
        text = of_plan(Plan(long_ramps(apart, list(order))))
        assert "reached" not in text
        assert len(re.findall(r"below\(|at_most\(", text)) > 10
    assert "reached" in of_plan(Plan(long_ramps(1.0, list(range(10)))))
    assert "reached" not in of_plan(Plan(long_ramps(1.0, list(range(10)), least=0.25)))


def long_ramps(apart: float, order: list[int], least: float = 0.0) -> Block:
    """Ramps up to 1 that begin so far apart at their least value, summed in an order."""

    @law(y=Output("1"), name="long_ramps")
    def made(u=Input("1")):
        ramps = [ca.fmin(ca.fmax(u - apart * (k + 1), least), 1.0) for k in order]
        return sum((0.1 * (k + 2) * r for k, r in zip(order, ramps, strict=True)), 2.0)

    return made


@pytest.mark.second
def test_float_and_warnings(tmp_path: Path) -> None:
    xs, ys = random_table(4, 40)
    u = np.linspace(-6, 80, 500)
    for real in ("double", "float"):
        report = codegen.check(table(xs, ys), {"u": u}, tmp_path / real, real=real)
        assert report["passed"]
        assert report["largest_relative"] < (1e-15 if real == "double" else 1e-6)
