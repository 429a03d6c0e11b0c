"""Straight lines that repeat become loops in C, with the same bits; what looks alike does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, make_block
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.write.rolling import rolled

TAPS, POINTS = 100, 32

try:
    compilers.compilers()
    HAS_COMPILER = True
except BadInput:
    HAS_COMPILER = False


def _body(x: Any, u: Any, p: Any) -> Any:
    """A filter of many taps, a grid on which the largest value is looked for, shifted memory."""
    window = ca.vertcat(u["u"], x["window"][:-1])
    y = ca.SX(0)
    for k in range(TAPS):
        y = y + p["taps"][k] * window[k]
    place, value = ca.SX(0), ca.SX(-1e9)
    for k in range(POINTS):
        at = k * p["width"] / POINTS
        height = ca.sin(at * u["u"]) * ca.exp(-at)
        better = height > value
        place, value = ca.if_else(better, at, place), ca.if_else(better, height, value)
    return {"window": window}, {"y": y, "place": place, "value": value}


def repeating() -> Any:
    return make_block(
        "repeating", "step", _body, doc="Filter and grid.",
        states=[State("1", 0.0, shape=(TAPS,), lo=-10, hi=10).named("window")],
        inputs=[Input("1", lo=-10, hi=10).named("u")],
        params=[Param("1", np.hanning(TAPS), shape=(TAPS,), lo=0, hi=1).named("taps"),
                Param("1", 2.0, lo=0.1, hi=10).named("width")],
        outputs=[Output("1").named("y"), Output("1").named("place"), Output("1").named("value")],
    )  # fmt: skip


@pytest.mark.skipif(not HAS_COMPILER, reason="no C compiler on this machine")
def test_filter_and_grid_are_loops_with_the_same_bits(tmp_path: Path) -> None:
    report = codegen.export(repeating(), tmp_path, check=True)
    assert report.passed, str(report)
    assert report.data["largest_relative"] == 0  # the same operations in the same order
    assert report.data["reading"]["lines"] < 500  # written out they are above 700


def test_a_loop_has_what_the_lines_had() -> None:
    """Lines and their loop, both run by Python on the same numbers."""
    lines = ["const double s0 = x[0] * x[1];"]
    for k in range(9):
        lines.append(f"const double p{k} = x[{k}] * x[{k + 1}] + {k + 1}.0;")
        lines.append(f"const double s{k + 1} = s{k} - p{k} * {2 * k + 3}.0;")
    lines += [f"y[{3 * k + 1}] = p{k} * s9;" for k in range(9)]
    short = rolled(lines, set())
    assert len(short) < len(lines) / 2
    rng = np.random.default_rng(7)
    x = rng.normal(size=12)
    assert _run(lines, x) == _run(short, x)


def test_what_does_not_go_up_evenly_stays_as_it_is() -> None:
    lines = [f"y[{k}] = x[{k * k}] * 2.0;" for k in range(12)]
    assert rolled(lines, set()) == lines
    assert rolled([f"y[{k}] = x[{k}];" for k in range(12)], {"i"})[0] == "y[0] = x[0];"


def _run(lines: list[str], x: np.ndarray) -> list[float]:
    """Run the few forms of C that stand here, as Python."""
    text, indent = [], ""
    for line in lines:
        bare = line.strip().rstrip(";")
        if bare == "}":
            indent = ""
        elif bare.startswith("for ("):
            count = int(bare.partition("i < ")[2].partition(";")[0])
            text.append(f"for i in range({count}):")
            indent = "    "
        elif "=" not in bare:
            name, _, size = bare.removeprefix("double ").partition("[")
            text.append(f"{name} = [0.0] * {size.rstrip(']') or 1}")
        else:
            for word in ("const ", "double "):
                bare = bare.removeprefix(word)
            text.append(indent + bare.replace("(double)i", "float(i)"))
    y = [0.0] * 40
    exec("\n".join(text), {"x": x, "y": y})
    return y


def test_a_model_may_call_its_numbers_as_counted_locals_are_called(tmp_path):
    """Burckhardt's law has a0, a1, a2; locals without a name are counted a1, a2, ... too."""

    def body(x: Any, u: Any, p: Any) -> Any:
        a1 = ca.sin(u["u"]) * p["r1"]
        a2 = ca.exp(a1) * ca.sin(a1 + p["k1"])
        return {"a3": a1 + a2}, {"y": ca.exp(a2) * ca.sin(a2) * x["a3"]}

    block = make_block(
        "counted", "step", body, period=1e-3,
        states=[State("1", 0.5, lo=-1e3, hi=1e3).named("a3")],
        inputs=[Input("1", lo=-10, hi=10).named("u")],
        params=[Param("1", 2.0, lo=0, hi=5).named("r1"), Param("1", 0.1, lo=0, hi=1).named("k1")],
        outputs=[Output("1").named("y")],
    )  # fmt: skip
    assert codegen.export(block, tmp_path / "c", check=HAS_COMPILER).passed
