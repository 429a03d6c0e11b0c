"""Straight lines that repeat become loops in C, with the same bits; what looks alike does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from module_text import laid_out, of_folder, with_pass

from slipctl import BadInput, Input, Output, Param, State, make_block
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.passes import rolled_loops
from slipctl.ccode.passes.lanes import in_lanes
from slipctl.ccode.passes.loop_fusion import fuse_loops
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.printer import lines_of

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


@pytest.mark.second
@pytest.mark.skipif(not HAS_COMPILER, reason="no C compiler on this machine")
def test_filter_and_grid_are_loops_with_the_same_bits(tmp_path: Path) -> None:
    report = codegen.export(repeating(), tmp_path, check=True)
    assert report.passed, str(report)
    assert report.data["largest_relative"] == 0  # the same operations in the same order
    assert sum(report.data["reading"]["lines"].values()) < 500  # written out they are above 700


def test_a_loop_has_what_the_lines_had() -> None:
    """Lines and their loop, both run by Python on the same numbers."""
    lines = ["const double s0 = x[0] * x[1];"]
    for k in range(9):
        lines.append(f"const double p{k} = x[{k}] * x[{k + 1}] + {k + 1}.0;")
        lines.append(f"const double s{k + 1} = s{k} - p{k} * {2 * k + 3}.0;")
    lines += [f"y[{3 * k + 1}] = p{k} * s9;" for k in range(9)]
    short = with_pass(roll_lines, lines, set())
    assert len(short) < len(lines) / 2
    rng = np.random.default_rng(7)
    x = rng.normal(size=12)
    assert _run(lines, x) == _run(short, x)


def test_what_does_not_go_up_evenly_stays_as_it_is() -> None:
    lines = [f"y[{k}] = x[{k * k}] * 2.0;" for k in range(12)]
    assert with_pass(roll_lines, lines, set()) == lines
    moved = [f"y[{k}] = x[{k}];" for k in range(12)]
    assert with_pass(roll_lines, moved, {"i"})[0] == "y[0] = x[0];"


def _run(lines: list[str], x: np.ndarray) -> list[float]:
    """Run the few forms of C that stand here, as Python."""
    text, indent = [], ""
    for line in "\n".join(lines).replace("{ ", "{\n").replace(" }", "\n}").splitlines():
        bare = line.strip().rstrip(";")
        if bare == "}":
            indent = ""
        elif bare.startswith("for ("):
            count = int(bare.partition("i < ")[2].partition(";")[0])
            text.append(f"for i in range({count}):")
            indent = "    "
        elif "=" not in bare:
            for item in bare.removeprefix("double ").split(", "):
                name, _, size = item.partition("[")
                text.append(f"{name} = [0.0] * {size.rstrip(']') or 1}")
        else:
            for word in ("const ", "double "):
                bare = bare.removeprefix(word)
            text.append(indent + bare.replace("(double)i", "float(i)"))
    y, z = [0.0] * 40, [0.0] * 4
    exec("\n".join(text), {"x": x, "y": y, "z": z, "u": x[8:12]})
    return [*y, *z]


def _mixed(rng: np.random.Generator) -> list[str]:
    """A program of four axles of which the statements are mixed, with what they share."""
    lines, shared = list[str](), ["x[4]"]
    begun: list[tuple[str, int, str]] = []  # name, lanes that are there, how one is worked out
    for step in range(60):
        name, given = f"f{step}", rng.choice(shared)
        sources = ["u[{k}]", "z[{k}]", *(f"{n}_{{k}}" for n, lanes, _ in begun if lanes == 4)]
        kind = rng.integers(7)
        behind = [k for k, (_, lanes, _) in enumerate(begun) if lanes < 4]
        if kind < 4 and behind:
            at = behind[rng.integers(len(behind))]
            name, k, made = begun[at]
            before = made.replace("{before}", f"{name}_{k - 1}" if k else "x[5]")
            lines.append(f"const double {name}_{k} = {before.replace('{k}', str(k))};")
            begun[at] = name, k + 1, made
        elif kind == 4:
            lines += [f"z[{k}] = {rng.choice(sources[2:] or ['u[{k}]']).replace('{k}', str(k))};"
                      for k in range(4)]  # fmt: skip
        elif kind == 5:
            one = rng.choice(sources).replace("{k}", str(rng.integers(4)))
            lines.append(f"const double s{step} = {given} - {one};")
            shared.append(f"s{step}")
        else:
            more = " + {before}" * (rng.random() < 0.3)
            begun.append((name, 0, f"{rng.choice(sources)} * {given}{more}"))
    return [*lines, f"y[7] = {shared[-1]};"]


@pytest.mark.parametrize("seed", range(40))
def test_sorted_by_axle_each_statement_has_what_it_had(seed: int) -> None:
    """What one needs of another, or overwrites of it, keeps its turn; so do chains over axles."""
    rng = np.random.default_rng(seed)
    lines, x = _mixed(rng), rng.normal(size=12)
    moved, runs = in_lanes(code("\n".join(lines)))
    now = lines_of(moved, "")
    assert sorted(now) == sorted(lines_of(code("\n".join(lines)), ""))
    assert _run(now, x) == _run(lines, x)
    assert all(begin + 4 * period <= len(moved) for begin, period in runs)


def test_statements_of_axles_are_loops_though_the_first_has_what_all_share(monkeypatch) -> None:
    monkeypatch.setattr(rolled_loops, "WORTH", 1)  # a short program has little to save
    lines = list[str]()
    for k in range(4):
        lines += [f"const double w_{k} = u[{k}] * x[4];"]
        lines += ["const double lift = x[5] * x[6];"] * (k == 0)
        lines += [f"const double e_{k} = lift - w_{k};", f"const double f_{k} = e_{k} * e_{k};"]
        lines += ["const double turn = x[6] - x[7];"] * (k == 0)
        lines += [f"const double m_{k} = f_{k} + {f'm_{k - 1}' if k else 'x[7]'};"]
        lines += [f"const double g_{k} = w_{k} * turn + f_{k};"]
    lines += ["const double most = m_3 * 2.0;"]
    for k in range(4):
        lines += [f"const double h_{k} = most - g_{k};", f"z[{k}] = h_{k} * e_{k};"]
        lines += ["const double wide = most * x[7];"] * (k == 0)
        lines += [f"const double j_{k} = h_{k} * wide;", f"y[{k}] = j_{k};"]
    x = np.random.default_rng(3).normal(size=12)
    short = with_pass(roll_lines, lines, set(), True)
    assert sum("for (int i = 0; i < 4; ++i)" in line for line in short) == 2
    assert len(short) < 0.7 * len(lines)
    assert _run(short, x) == _run(lines, x)


@pytest.mark.second
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


def test_the_first_and_the_last_step_are_in_the_loop() -> None:
    """The first reads an element or 1 * step, what all need is before; the last is a result."""
    lines = ["const double s_2 = x[0] * (lo + step);", "const double twice = 2.0 * lo;"]
    lines += ["const double y_2 = s_2 + twice;"]
    for k in range(3, 8):
        lines.append(f"const double s_{k} = y_{k - 1} * (lo + {k - 1}.0 * step);")
        lines.append(f"const double y_{k} = s_{k} + twice;")
    lines += ["const double s_8 = y_7 * (lo + 7.0 * step);", "*y = s_8 + twice;"]
    assert with_pass(roll_lines, lines, {"x", "lo", "step", "y"}) == [
        "const double twice = 2.0 * lo;", "double y_now = x[0];",
        "for (int i = 1; i < 8; ++i) {", "    const double s = y_now * (lo + (double)i * step);",
        "    y_now = s + twice;", "}", "*y = y_now;",
    ]  # fmt: skip


def test_the_last_of_a_chain_that_is_a_result_becomes_a_local_beside_any_other_result() -> None:
    chain = [f"const double p_{k + 1} = sin(p_{k});" for k in range(3)]
    lines = [*chain, "*a = p_1 + p_2;", "*b = sin(p_3);", "*d = 2.0;"]
    assert with_pass(lambda n: rolled_loops._with_locals(n, {"p_0"})[0], lines) == [
        *chain, "const double b_now = sin(p_3);", "*a = p_1 + p_2;", "*b = b_now;", "*d = 2.0;",
    ]  # fmt: skip
    assert with_pass(lambda n: rolled_loops._with_locals(n, {"b_now"})[0], lines) == lines


def test_a_result_that_is_in_no_loop_stays_as_it_was() -> None:
    lines = [f"const double s{k} = x[{k * k}] + {k}.0 * u;" for k in range(5)]
    lines.append("*y = s4 + 9.0 * u;")
    assert with_pass(roll_lines, lines, {"y"}) == lines


FILLED = ["double a[4];", "for (int i = 0; i < 4; ++i) {", "    a[i] = x[i] * 2.0;", "}"]


def test_loops_over_the_same_elements_are_one_and_need_no_array() -> None:
    lines = [*FILLED, "const double u = v + 1.0;", "double s = v;"]
    lines += ["for (int i = 0; i < 4; ++i) {", "    s = s + a[i];", "}", "*y = s * u;"]
    assert with_pass(fuse_loops, lines) == [
        "double s = v;", "for (int i = 0; i < 4; ++i) {", "    const double a = x[i] * 2.0;",
        "    s = s + a;", "}", "const double u = v + 1.0;", "*y = s * u;",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("between", "body", "after"),
    [
        ("double s = a[3];", "    s = s + a[i];", "*y = s;"),  # begins with what the first gave
        ("double s = v;", "    s = s + a[3 - i];", "*y = s;"),  # reads what is not there yet
        ("double s = v;", "    s = s + a[i + 1];", "*y = s;"),
        ("x[0] = a[2];", "    b[i] = x[i] + a[i];", ""),  # reads what is written between
        ("b[1] = v;", "    b[i] = a[i];", ""),  # writes what is written between
        ("double s = v;", "    x[i] = a[i];", ""),  # writes what the first reads
    ],
)
def test_loops_of_which_one_needs_the_other_stay_two(between: str, body: str, after: str) -> None:
    lines = [*FILLED, between, "for (int i = 0; i < 4; ++i) {", body, "}", *[after] * bool(after)]
    assert with_pass(fuse_loops, lines) == laid_out(lines)


def test_an_array_that_is_read_later_stays_one() -> None:
    lines = [*FILLED, "*y = a[2];"]
    assert with_pass(fuse_loops, lines) == laid_out(lines)


ONCE = ["double s = v;", "for (int i = 0; i < 4; ++i) {", "    s = s + a[i];", "}", "*z = s;"]
LOOP = "for (int i = 0; i < 4; ++i) {"


@pytest.mark.parametrize(
    "before",
    [
        ["double w = v;"],  # no array
        ["double b[4];", LOOP, "    b[i] = x[i];", "}", "*y = b[2];"],  # read later
        ["double b[4];", "b[0] = v;", "b[1] = v;", "*y = b[0];"],  # filled in no loop
        ["double b[4];", LOOP, "    b[i] = x[i];", "    w[i] = b[3 - i];", "}"],  # not at hand
        ["double b[4];", LOOP, "    b[i] = x[i];", "    b[i] = b[i] + v;", "}"],  # given twice
        ["double b[4];", LOOP, "    b[i] = b[i] + v;", "}"],  # of itself
        ["double b[4];", "b[0] = v;", LOOP, "    b[i] = x[i];", "}"],  # given before too
        ["bool b[4];", LOOP, "    b[i] = x[i] > v;", "    y[i] = b[i] ? v : w;", "}"],
    ],
)
def test_one_that_stays_an_array_keeps_no_other_from_being_a_number(before: list[str]) -> None:
    lines = [*before, *FILLED, *ONCE]
    found = with_pass(fuse_loops, lines)
    assert "    const double a = x[i] * 2.0;" in found
    assert "double a[4];" not in found
    stays = before[0].endswith("b[4];") and not before[0].startswith("bool")
    assert (before[0] in found) == (stays or before[0] == "double w = v;")
    behind = with_pass(fuse_loops, [*FILLED, *ONCE, *before])
    assert "    const double a = x[i] * 2.0;" in behind
    assert (before[0] in behind) == (before[0] in found)


@pytest.mark.second
@pytest.mark.skipif(not HAS_COMPILER, reason="no C compiler on this machine")
def test_sums_over_a_window_and_slopes_at_a_corner_have_the_bits_of_python(tmp_path: Path) -> None:
    """A mask, a sum and squares; and the slope of a clipped value, on its corner too."""

    def body(x: Any, u: Any, p: Any) -> Any:
        inside = ca.vertcat(*[k >= 5 - u["n"] for k in range(5)])
        mean = ca.dot(inside, x["window"]) / u["n"]
        spread = ca.dot(inside, (x["window"] - mean) ** 2) / u["n"]
        clipped = ca.fmax(ca.fmin(u["u"], 1.0), -1.0)
        slope = ca.jacobian(clipped**2, u["u"])
        window = ca.vertcat(x["window"][1:], u["u"])
        return {"window": window}, {"mean": mean, "spread": spread, "slope": slope}

    block = make_block(
        "windowed", "step", body, period=1e-3,
        states=[State("1", 0.0, shape=(5,), lo=-10, hi=10).named("window")],
        inputs=[Input("1", lo=-10, hi=10).named("u"), Input("1", lo=1, hi=5).named("n")],
        outputs=[Output("1", lo=-1e9, hi=1e9).named(n) for n in ("mean", "spread", "slope")],
    )  # fmt: skip
    rng = np.random.default_rng(4)
    u = rng.choice([-2.0, -1.0, -0.5, 0.0, 1.0, 1.5, 0.1], size=400)
    inputs = {"u": u, "n": rng.integers(1, 6, size=400).astype(float)}
    report = codegen.export(block, tmp_path / "c", inputs=inputs, check=True)
    assert report.passed, str(report)
    assert report.data["largest_relative"] == 0
    text = of_folder(tmp_path / "c", "windowed")
    assert text.count("slope_of_lesser(") == 3  # what it is, and twice
    assert "for (int i = 1; i < 5; ++i)" in text
    assert "sum_" not in text  # all are called by their mask
