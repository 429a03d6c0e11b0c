"""Guards of generated C: what is out of range never reaches the state, outputs stay in range."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from module_text import changed, of_folder

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    differential_evolution,
    law,
    replicate,
    rls,
    step,
)
from slipctl.ccode import codegen
from slipctl.ccode.check import back_to_back, float_error, isolation
from slipctl.ccode.check.vectors import expected_outputs
from slipctl.ccode.compile import board, compilers, targets
from slipctl.ccode.module import guard
from slipctl.ccode.module.guard import BAD_INPUT, BAD_RESULT, LIMITED, OFF_RANGE, REFUSED, RESET
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes import precision
from slipctl.ccode.passes.precision import MATH, in_precision, literal
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.printer import lines_of
from slipctl.draw import show
from slipctl.models.huang_2020 import subway_braking, subway_braking_control
from slipctl.seek.random import advance, quick_floor, rounder, state_from_seed

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)

REALS = precision.REALS
STALE = 10


@step(T=Output("N m", "torque", lo=-5, hi=20), v=Output("1", "both", shape=(2,), lo=0, hi=0.3))
def guarded(
    i=State("1", 0.0, "integral"),
    e=Input("1", "error", lo=-1, hi=0.6, stale=STALE),
    w=Input("1", "vector", shape=(2,), lo=0),
    free=Input("1", "no range", value=0.0),
    k=Param("1", 10.0, "gain", lo=0),
):
    """Integral of an error; the last input divides."""
    return dict(i=i + e), dict(T=k * (i + e) + free, v=w)


def control() -> Block:
    return subway_braking_control.controller(subway_braking_control.super_twisting())


BLOCKS: dict[str, Any] = {
    "guarded": lambda: guarded,
    "subway": control,
    "rls": lambda: rls(subway_braking.double_exponential),
    "search": lambda: differential_evolution(
        subway_braking.double_exponential, over="v_s", lo=0.01, hi=10.0, generations=6
    ),
}


@pytest.mark.parametrize("real", REALS)
def test_what_is_bad_is_replaced_by_the_last_good_value(real: str, tmp_path: Path) -> None:
    """Each input by its own; told in the same tick; gone with the first good value."""
    c = codegen.c_module(guarded, tmp_path, real=real).compile().load()
    w = [0.125, 0.25]
    good = c.step(e=0.5, w=w)
    assert (c.status, good["T"], c.state) == (0, 5.0, {"i": 0.5})
    i = 0.5
    for bad in ({"e": 0.7}, {"e": -1.5}, {"w": [0.125, -0.25]}):
        held = c.step(**{"e": 0.5, "w": w} | bad)
        i += 0.5
        assert (c.status, held["T"], c.state) == (OFF_RANGE, 10 * i, {"i": i})
        np.testing.assert_array_equal(held["v"], w)
    held = c.step(e=np.nan, w=[-1.0, 0.0], free=-3.0)
    assert (c.status, held["T"], c.state) == (BAD_INPUT | OFF_RANGE | LIMITED, 20.0, {"i": 2.5})
    assert c.step(e=-0.5, w=w, free=-3.0)["T"] == 17.0
    assert (c.status, c.state) == (0, {"i": 2.0})
    for end in (-1.0, 0.6):  # the ends belong to the range, in float too
        c.step(e=end, w=w)
        assert c.status == 0


@pytest.mark.parametrize("real", REALS)
def test_a_stale_input_refuses_the_tick(real: str, tmp_path: Path) -> None:
    """A value may be missing for a while; then nothing moves any more, until there is one."""
    c = codegen.c_module(guarded, tmp_path, real=real).compile().load()
    w = [0.125, 0.25]
    c.step(e=2.0, w=w)  # none was good yet
    assert (c.status, c.state) == (OFF_RANGE | REFUSED, {"i": 0.0})
    c.step(e=0.125, w=w)
    status = []
    for _ in range(STALE + 5):
        c.step(e=np.nan, w=w)
        status.append(c.status)
    wanted = [BAD_INPUT] * STALE + [BAD_INPUT | REFUSED] * 5
    assert status == wanted
    assert c.state == {"i": 0.125 * (STALE + 1)}
    c.step(e=0.125, w=w)
    assert (c.status, c.state) == (0, {"i": 0.125 * (STALE + 2)})


@step(
    T=Output("N m", "torque", lo="-T_max", hi=0),
    whole=Output("1", "an end that is a number, and one that follows"),
)
def bounded(
    i=State("1", 0.0, "integral", lo=-2, hi="3 * v_max"),
    omega=Input("rad/s", "wheel speed", lo=0, hi="v_max / r", change="2 * a * T"),
    v_max=Param("m/s", 50.0, "greatest speed", lo=1),
    r=Param("m", 0.5, "radius", lo=0.1),
    a=Param("rad/s^2", 100.0, "greatest acceleration", lo=1),
    T=Param("s", 0.01, "period", lo=1e-3),
    T_max=Param("N m", 40.0, "greatest torque", lo=1),
):
    """Ranges and changes that follow parameters."""
    return dict(i=i + 1), dict(T=-omega, whole=i)


@pytest.mark.parametrize("real", REALS)
def test_ends_and_changes_follow_parameters(real: str, tmp_path: Path) -> None:
    """In the block itself, and as a part of another one with a number that is shared."""
    wires = {"part.omega": "omega", "T": "part.T"}
    whole = connect("whole", wires, part=bounded)
    for block, prefix in ((bounded, ""), (whole, "part.")):
        c = codegen.c_module(block, tmp_path / block.name, real=real).compile().load()
        assert (c.step(omega=30.0)["T"], c.status) == (-30.0, 0)
        assert (c.step(omega=33.0)["T"], c.status) == (-30.0, OFF_RANGE)  # by more than 2 rad/s
        assert (c.step(omega=33.0)["T"], c.status) == (-33.0, 0)  # in two ticks it may
        assert c.step(omega=1e30)["T"] == -33.0
        c.reset(**{f"{prefix}T_max": 20.0, f"{prefix}v_max": 20.0})
        assert (c.step(omega=30.0)["T"], c.status) == (-20.0, LIMITED)
        assert c.step(omega=40.5)["T"] == -20.0
        assert c.status == OFF_RANGE | LIMITED  # beyond 20 / 0.5
    assert "range -T_max to 0.0" in (tmp_path / "bounded" / "bounded.h").read_text()
    assert "changes by at most 2 * a * T in a tick" in (tmp_path / "bounded/bounded.h").read_text()


def test_states_out_of_their_range_are_refused_and_reset(tmp_path: Path) -> None:
    """The part that leaves its range is put to its start, whichever it is in the order."""

    @step(y=Output("1", "sum"))
    def adder(x=State("1", 1.0, "sum", lo=-5, hi=5), u=Input("1", "number")):
        """Sum of what comes."""
        return dict(x=x + u), dict(y=x + u)

    wires = {"a.u": "u", "b.u": "w", "y": "a.y", "z": "b.y"}
    both = connect("both", wires, a=adder, b=adder)
    c = codegen.c_module(both, tmp_path).compile().load()
    c.step(u=3.0, w=0.0)
    assert (c.status, c.state) == (0, {"a.x": 4.0, "b.x": 1.0})
    refused = BAD_RESULT | REFUSED
    for _ in range(guard.PATIENCE - 1):
        held = c.step(u=3.0, w=2.0)
        assert (c.status, held["y"], c.state) == (refused, 4.0, {"a.x": 4.0, "b.x": 1.0})
    c.step(u=3.0, w=2.0)
    assert (c.status, c.state) == (refused | RESET, {"a.x": 1.0, "b.x": 1.0})
    c.step(u=3.0, w=2.0)
    assert (c.status, c.state) == (0, {"a.x": 4.0, "b.x": 3.0})
    for _ in range(guard.PATIENCE):
        c.step(u=0.0, w=3.0)
    assert (c.status, c.state) == (refused | RESET, {"a.x": 4.0, "b.x": 1.0})
    c.step(u=0.0, w=3.0)
    assert (c.status, c.state["b.x"]) == (0, 4.0)


def test_resets_go_on_until_the_cause_is_reached(tmp_path: Path) -> None:
    """What keeps a part off its range may be the state of another one: its turn comes later."""

    @step(y=Output("1", "sum"))
    def feeds(x=State("1", 1.0, "sum"), u=Input("1", "number")):
        """Sum of what comes, without a range."""
        return dict(x=x + u), dict(y=x)

    @step(y=Output("1", "last"))
    def heard(x=State("1", 0.0, "last", lo=-50, hi=50), u=Input("1", "number")):
        """What came last."""
        return dict(x=u), dict(y=x)

    wires = {"heard.u": "feeds.y", "feeds.u": "u", "y": "heard.y"}
    both = connect("both", wires, heard=heard, feeds=feeds)
    assert list(Plan(both).parts) == ["heard", "feeds"]
    c = codegen.c_module(both, tmp_path).compile().load()
    c.step(u=100.0)
    said = []
    for _ in range(3 * guard.PATIENCE):  # the one that is off, the first in order, the second
        c.step(u=0.0)
        said.append(c.status)
    turns = [k + 1 for k, status in enumerate(said) if status & RESET]
    assert turns == [guard.PATIENCE, 2 * guard.PATIENCE, 3 * guard.PATIENCE]
    assert c.state["feeds.x"] == 1.0
    assert c.step(u=0.0)["y"] == 0.0
    assert c.status == 0


@pytest.mark.parametrize("off", [0, 1, 3])
def test_every_part_has_its_turn(off: int, tmp_path: Path) -> None:
    """Of three parts: the one that is off or the first, then 1, 2, 3, then all, and anew."""

    @step(y=Output("1", "sum"))
    def sums(x=State("1", 0.0, "sum"), u=Input("1", "number")):
        """Sum of what comes."""
        return dict(x=x + u), dict(y=x)

    three = connect("three", {f"{p}.u": "u" for p in "abc"}, a=sums, b=sums, c=sums)
    codegen.c_module(three, tmp_path)
    places = [f"state.kept.{Plan(three).layout.places[f'{p}_x']}" for p in "abc"]
    marked, seen = "".join(f"{p} = 1.0;" for p in places), " + ".join(
        f"(({p} == 0.0) ? {2**k} : 0)" for k, p in enumerate(places))  # fmt: skip
    (tmp_path / "main.c").write_text(f"""#include "three.c"
#include <stdio.h>
int main(void)
{{
    static three_state state;
    static three_param param;
    three_default(&param);
    (void)three_init(&param, &state);
    for (int k = 0; k < {6 * guard.PATIENCE}; ++k) {{
        {marked}
        if (recover(&param, &state, {off}) != 0U) {{ (void)printf("%d %d ", k, {seen}); }}
    }}
    return 0;
}}
""")
    (cc, *_) = compilers.compilers()
    subprocess.run([cc, "-std=c99", "main.c", "-o", "main", "-lm"], cwd=tmp_path, check=True)
    said = subprocess.run(["./main"], cwd=tmp_path, check=True, capture_output=True, text=True)
    ticks, parts = (list(map(int, said.stdout.split()))[k::2] for k in (0, 1))
    assert ticks == [guard.PATIENCE * k - 1 for k in range(1, 7)]
    first = 2 ** (max(off, 1) - 1)
    assert parts == [first, 1, 2, 4, 7, first]


@pytest.mark.parametrize("real", REALS)
def test_outputs_are_limited_and_the_step_counts(real: str, tmp_path: Path) -> None:
    c = codegen.c_module(guarded, tmp_path, real=real).compile().load()
    out = c.step(e=0.5, w=[0.5, 0.25], free=100.0)
    assert (c.status, out["T"], c.state) == (16, 20.0, {"i": 0.5})
    np.testing.assert_allclose(out["v"], [0.3, 0.25], rtol=precision.epsilon(real))
    assert c.step(e=0.0, w=[0.0, 0.0], free=-100.0)["T"] == -5.0
    assert c.step(e=2.0, w=[0.0, 0.0], free=-100.0)["T"] == -5.0  # so with what is held
    assert c.status == OFF_RANGE | LIMITED


@pytest.mark.second
@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.others("long")
def test_any_bytes_as_inputs(name: str, real: str, tmp_path: Path) -> None:
    """Outputs finite and in range, states finite, whatever the bits of the inputs are."""
    block = BLOCKS[name]()
    c = codegen.c_module(block, tmp_path, real=real).compile().load()
    rng = np.random.default_rng(3)
    ticks, kind = 4000, c._kind
    width = sum(max(int(np.prod(s.shape)), 1) for s in block.inputs.values())
    raw = rng.bytes(ticks * width * np.dtype(kind).itemsize)
    rows = np.frombuffer(raw, kind).reshape(ticks, width).copy()
    usual = rng.normal(size=rows.shape) * rng.choice([1e-3, 1.0, 30.0, 1e30], size=rows.shape)
    rows = np.where(rng.random(rows.shape) < 0.05, rows, usual.astype(kind))
    out, states = c.replay_rows(rows)
    assert np.isfinite(out).all()
    assert np.isfinite(states).all()
    at = 0
    for s in block.outputs.values():
        n = max(int(np.prod(s.shape)), 1)
        lo, hi = precision.round_to_real((s.lo, s.hi), real)
        assert (out[:, at : at + n] >= lo).all()
        assert (out[:, at : at + n] <= hi).all()
        at += n
    assert 0 < np.count_nonzero(c.status & ~LIMITED) < ticks
    before = np.vstack([states[:1], states[:-1]])
    held = (c.status & (REFUSED | RESET)) == REFUSED
    held[0] = False
    np.testing.assert_array_equal(states[held], before[held])


@pytest.mark.second
@pytest.mark.parametrize("real", REALS)
@pytest.mark.others("long")
def test_replay_with_ticks_off_range_agrees_with_the_guarded_block(
    real: str, tmp_path: Path
) -> None:
    e = np.where(np.arange(50) % 7 == 0, 0.9, 0.01)
    inputs = {"e": e, "w": np.full((50, 2), 0.2), "free": np.linspace(-30, 30, 50)}
    report = codegen.check(guarded, inputs, tmp_path, real=real)
    assert report["passed"]
    assert report["ticks_off_range"] == 8
    assert report["ticks_limited"] > 5
    with pytest.raises(BadInput, match="no tick has all its inputs in their declared ranges"):
        codegen.check(guarded, {**inputs, "e": np.full(50, 2.0)}, tmp_path)


# ---- results -------------------------------------------------------------------------------------


@law(
    y=Output("1", shape=(8,)), z=Output("1", shape=(2,)), T=Output("1"), copy=Output("1"),
    same=Output("1"), positive=Output("1"),
)  # fmt: skip
def products(u=Input("1", shape=(11,)), v=Input("1", "passed on"), w=Input("1", value=2.0)):
    """Products that become infinite, a value twice, an input as it is, a condition."""
    T = u[10] * w
    return dict(y=u[:8] * w, z=u[8:10] * w, T=T, copy=T, same=v, positive=u[0] > 0)


@pytest.mark.parametrize("real", REALS)
def test_each_result_is_tested_once_and_by_every_compiler(real: str, tmp_path: Path) -> None:
    """0 times what is finite is 0; no compiler may know better, and no value may be forgotten."""
    made = codegen.c_module(products, tmp_path, real=real)
    source = (tmp_path / "products.c").read_text()
    tested = source.partition("bool result_finite")[2].partition("\n}")[0]
    found = re.findall(r"now->\w+(?:\[\d\])?", tested)
    assert sorted(found) == ["now->T", "now->y", "now->z"]
    assert "zero_of(now->z, 2)" in tested
    limits = np.finfo(np.float32 if real == "float" else np.float64)
    usual = [0.0, -0.0, 1.0, -float(limits.max) / 2, float(limits.max) / 2, float(limits.tiny) / 4]
    for compiler in compilers.compilers():
        c = made.compile(compiler).load()
        for value in usual:
            c.step(u=np.full(11, value), v=value)
            assert c.status == 0
        for k in range(11):
            u = np.full(11, limits.max / 2)
            u[k] *= -1.9
            c.step(u=u, v=0.0)
            assert c.status == BAD_RESULT | REFUSED, k
        c.step(u=np.zeros(11), v=np.inf)
        assert c.status == BAD_INPUT


def test_results_of_different_parts_are_different_ones() -> None:
    """Each part divides, and each result is tested, whatever memory is used anew meanwhile."""

    @law(y=Output("1", "inverse"))
    def inverse(u=Input("1", "to divide by")):
        return dict(y=1 / u)

    parts = {f"p{k}": inverse for k in range(40)}
    plan = Plan(connect("all", {f"{n}.u": f"u_{n}" for n in parts}, **parts), "ctl")
    assert [m.c for m, _, _ in plan.untested] == [f"{n}_y" for n in parts]


def test_fast_mathematics_is_refused(tmp_path: Path) -> None:
    codegen.c_module(guarded, tmp_path)
    for compiler in compilers.compilers():
        for flag, fine in (("-O2", True), ("-ffast-math", False), ("-ffinite-math-only", False)):
            call = [compiler, "-std=c99", flag, "-c", "guarded.c", "-o", "guarded.o"]
            done = subprocess.run(call, cwd=tmp_path, capture_output=True, check=False)
            assert (done.returncode == 0) == fine, (compiler, flag)


def test_smaller_and_greater_are_those_of_casadi_to_the_sign_of_zero(tmp_path: Path) -> None:
    """One comparison where a value is never NaN: same choice, same zero, NaN gives way."""

    @law(y=Output("1", shape=(12,)), sign=Output("1", shape=(12,)))
    def choices(a=Input("1"), b=Input("1"), c=Input("1"), p=Param("1", 0.5)):
        """NaN where a and b are zero."""
        q = a / b
        pairs = [(a, c), (q, c), (c, q), (q, p), (p, q), (q, b + c), (a * c, q), (a - a, c),
                 (q, c / a), (ca.fmin(q, c), q), (0.0, a), (a, 0.0)]  # fmt: skip
        found = [ca.fmin(*pair) for pair in pairs[:6]] + [ca.fmax(*pair) for pair in pairs[6:]]
        y = ca.vertcat(*found)
        return dict(y=y, sign=ca.copysign(1.0, y))

    module = codegen.c_module(choices, tmp_path).compile().load()
    text = of_folder(tmp_path, "choices")
    assert {"below", "above", "at_most", "greater"} <= set(
        re.findall(r"static double (\w+)\(", text)
    )
    for a in (0.0, -0.0, 1.0, -2.5, 1e308):
        for b in (0.0, -0.0, 3.0, -1e-300):
            for c in (0.0, -0.0, 0.5, -7.0):
                wanted, got = choices(a=a, b=b, c=c), module.step(a=a, b=b, c=c)
                if np.isfinite(wanted["y"]).all():
                    assert module.status == 0
                    for name in wanted:
                        np.testing.assert_array_equal(wanted[name], got[name])
                else:
                    assert module.status == BAD_RESULT | REFUSED


# ---- safe outputs --------------------------------------------------------------------------------


@step(
    period=0.01,
    T=Output("N m", "torque", lo=-5, hi=20, safe=-1.5),
    v=Output("1", "both", shape=(2,), lo=0.1, hi=0.3, safe=0.2),
    last=Output("1", "held"),
)
def careful(
    i=State("1", 0.0, "integral"),
    e=Input("1", "error", lo=-1, hi=0.6),
    w=Input("1", "divisor"),
    k=Param("1", 10.0, "gain", lo=0),
):
    """Integral of an error over something."""
    return dict(i=i + e / w), dict(T=k * (i + e / w), v=[e, w], last=e)


@pytest.mark.parametrize("real", REALS)
def test_safe_values_are_given_while_a_step_is_refused(real: str, tmp_path: Path) -> None:
    c = codegen.c_module(careful, tmp_path, real=real).compile().load()
    eps = precision.epsilon(real)
    before = ((2.0, 1.0, OFF_RANGE), (np.nan, 1.0, BAD_INPUT), (0.5, 0.0, BAD_RESULT))
    for e, w, status in before:  # a good step
        out = c.step(e=e, w=w)
        assert (c.status, out["T"], out["last"]) == (status | REFUSED, -1.5, 0.0)
        assert c.state == {"i": 0.0}
        np.testing.assert_allclose(out["v"], 0.2, rtol=eps)
    assert c.step(e=0.5, w=1.0)["T"] == 5.0
    out = c.step(e=0.5, w=0.0)
    assert (c.status, out["T"], out["last"]) == (BAD_RESULT | REFUSED, -1.5, 0.5)
    assert c.state == {"i": 0.5}
    np.testing.assert_allclose(out["v"], 0.2, rtol=eps)
    assert c.step(e=0.25, w=1.0)["T"] == 7.5  # the next good step goes on
    assert (c.status, c.state) == (LIMITED, {"i": 0.75})  # v is limited


@pytest.mark.second
@pytest.mark.parametrize("real", REALS)
@pytest.mark.others("long")
def test_safe_values_are_told_tested_and_replayed(real: str, tmp_path: Path) -> None:
    ticks = 200
    inputs = {"e": np.where(np.arange(ticks) % 5 == 0, 0.9, 0.01), "w": np.full(ticks, 2.0)}
    report = codegen.check(careful, inputs, tmp_path, real=real)
    assert report["passed"]
    assert report["ticks_off_range"] == 40
    header = " ".join((tmp_path / "careful.h").read_text().replace(" * ", " ").split())
    assert "range 0.1 to 0.3; safe value 0.2, given while a step is refused" in header
    assert "or their safe value where one is stated" in header
    assert "but `T` -1.5 N m, `v` 0.2 1" in (tmp_path / "README.md").read_text()
    assert '"T: torque; safe value -1.5"' in (tmp_path / "careful.a2l").read_text()
    # the test that goes with the module finds a step that holds instead
    source = tmp_path / "careful.c"
    honest = source.read_text()
    out_t = "out->T = -1.5f;" if real == "float" else "out->T = -1.5;"
    assert out_t in honest
    source.write_text(honest.replace(out_t, ""))
    done = subprocess.run(["make", "test"], cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode != 0
    plain = codegen.texts(codegen.Plan(guarded, real=real))["guarded.c"]
    assert "hold(" not in plain


@given(
    lo=st.floats(-1e6, 1e6), width=st.floats(0, 1e6), share=st.floats(0, 1),
    bad=st.lists(st.booleans(), min_size=1, max_size=20),
)  # fmt: skip
def test_guarded_block_gives_safe_values_in_its_range(
    lo: float, width: float, share: float, bad: list[bool]
) -> None:
    """Whatever the ticks: refused ones give the safe value, the others are those of the run."""
    hi = lo + width
    safe = min(max(lo + share * width, lo), hi)

    @step(period=1.0, y=Output("1", lo=lo, hi=hi, safe=safe), n=Output("1"))
    def counting(n=State("1", 0.0), u=Input("1", lo=-1, hi=1)):
        """Ticks so far."""
        return dict(n=n + 1), dict(y=n + 1, n=n + 1)

    plan = codegen.Plan(counting)
    rows = np.where(bad, 2.0, 0.0)[:, np.newaxis]
    count = np.arange(1, np.count_nonzero(rows == 0) + 1)[:, np.newaxis]
    told = np.where(rows[:, 0] == 0, 0, OFF_RANGE | REFUSED)
    run = expected_outputs.run_with_guards(plan, rows, told, np.hstack([count, count]), count, {})
    so_far = np.cumsum(rows == 0)
    np.testing.assert_array_equal(run.outputs[:, 1], so_far)
    np.testing.assert_array_equal(run.states[:, 0], so_far)
    np.testing.assert_array_equal(run.outputs[:, 0], np.where(bad, safe, so_far.clip(lo, hi)))


def test_safe_values_stay_with_their_output() -> None:
    wires = {"a.e": "e", "a.w": "w", "b.e": "a.last", "b.w": "w", "T": "b.T"}
    whole = connect("both", wires, a=careful, b=careful.with_params(k=3.0))
    assert {k: y.safe for k, y in whole.outputs.items()} == {
        "a.T": -1.5, "a.v": 0.2, "a.last": None, "b.T": -1.5, "b.v": 0.2, "b.last": None, "T": -1.5,
    }  # fmt: skip
    assert {s.safe for s in whole.inputs.values()} == {None}
    wide = replicate(careful.with_params(k=3.0), 3)
    assert (wide.outputs["T"].safe, wide.outputs["T"].shape) == (-1.5, (3,))
    assert careful.outputs["T"].as_role("input").safe is None
    assert "-5 .. 20, safe -1.5" in show.text(careful)


@pytest.mark.parametrize(
    ("safe", "said"),
    [
        (30, r"safe value of f.T = 30 N m is out of range; it must lie in \[-5, 20\] N m"),
        (np.nan, r"safe value of f.T is NaN"),
        (np.inf, r"safe value of f.T is infinite"),
        ("zero", r"safe value of f.T takes a number in N m, not 'zero'"),
        ([0, 1], r"Output: safe is \[0, 1\], which is no number"),
    ],
)
def test_safe_value_that_cannot_be_given(safe: Any, said: str) -> None:
    with pytest.raises(BadInput, match=said):

        @law(T=Output("N m", "torque", lo=-5, hi=20, shape=(2,), safe=safe))
        def f(u=Input("1", shape=(2,))):
            return u


# ---- float ---------------------------------------------------------------------------------------


def test_float_leaves_nothing_of_double() -> None:
    text = "/* double 1.5 */ const double x = exp(1.5) + 3e-9 * (double)p->exp + n[2] * DBL_MAX;"
    made = lines_of(in_precision(n, "float", "here") for n in code(text))
    assert made == [
        "/* double 1.5 */",
        "const float x = expf(1.5f) + 3e-09f * (float)p->exp + n[2] * FLT_MAX;",
    ]
    assert literal(1e-60, "float", "here") == "1.1754944e-38f"
    # what is below 1 stays so: 1 - zeta may divide, or stand in a logarithm
    assert [literal(v, "float", "here") for v in (0.999999999, 0.99999991, -1.0)] == (
        ["0.99999994f", "0.9999999f", "-1.0f"]
    )
    with pytest.raises(BadInput, match="here: the number 1e60 is too large for float"):
        literal(1e60, "float", "here")
    with pytest.raises(BadInput, match="did you mean 'float'"):
        codegen.c_module(guarded, "unused", real="flaot")


@pytest.mark.second
def test_every_call_of_mathematics_has_a_float_form(tmp_path: Path) -> None:
    @law(y=Output("1", shape=(9,)))
    def calls(u=Input("1", lo=0.1, hi=0.9), v=Input("1", lo=0.1, hi=2)):
        """Functions of math.h."""
        return ca.vertcat(
            ca.exp(u), ca.log(u), ca.sqrt(u), ca.sin(v), ca.atan2(u, v), ca.floor(v), u**v,
            ca.fmax(u, v) + ca.tanh(u), ca.fmod(v, u) + ca.hypot(u, v),
        )  # fmt: skip

    report = codegen.check(calls, {"u": [0.3, 0.5], "v": [0.7, 1.9]}, tmp_path, real="float")
    assert report["passed"]
    assert report["real"] == "float"
    for c in report["compiled"]:
        assert not MATH & set(c["symbols"]["needed"])
        assert {"expf", "logf", "sinf", "powf"} <= set(c["symbols"]["needed"])
        assert c["stack"]["worst"] >= 0
    source = of_folder(tmp_path, "calls")
    assert "double" not in re.sub(r"/\*.*?\*/", "", source, flags=re.DOTALL)
    assert report["memory_bytes"]["in"] == 8


@pytest.mark.second
@pytest.mark.parametrize("name", [pytest.param("subway", marks=pytest.mark.long), "rls"])
def test_float_agrees_within_its_arithmetic(name: str, tmp_path: Path) -> None:
    block = BLOCKS[name]()
    report = codegen.export(block, tmp_path, check=True, real="float").data
    assert report["passed"]
    assert 0 < report["largest_relative"] < 1e-4
    assert report["ticks_undecided"] == 0
    if name == "subway":  # no loose limit
        # inputs fill their ranges: the torque that is wanted, a sum of two terms, comes to 150 kN m
        # before it is limited; each of the two roundings there is one last place of it at most
        wanted = report["signals"]["law.T_wanted"]
        place = float(np.spacing(np.float32(wanted["absolute"] / wanted["relative"])))
        allowed = expected_outputs.AMPLIFIED * 2 * place + 2 * precision.epsilon("float") * 20e3
        assert report["signals"]["T_b"]["limit"] < allowed < 0.6
        # a module that is wrong by a millionth of the torque in one part is found out
        honest = codegen.texts

        def wrong(plan: Any, *more: Any) -> dict[str, str]:
            made = honest(plan, *more)
            return changed(made, "ctl", "param->law_k1 *", "1.0001f * param->law_k1 *")

        monkey = pytest.MonkeyPatch()
        monkey.setattr(codegen, "texts", wrong)
        try:
            trials = codegen._trials
            monkey.setattr(
                codegen,
                "_trials",
                lambda plan, made, rows, p, hurry: trials(plan, honest(plan), rows, p, hurry),
            )
            assert not codegen.export(block, tmp_path / "w", check=True, real="float").passed
        finally:
            monkey.undo()


@pytest.mark.second
def test_start_values_stand_in_the_order_of_the_struct(tmp_path: Path) -> None:
    """As C++ wants them, in which float is tried: those of expressions among those of numbers."""

    @step(period=0.01, y=Output("1", "sum", lo=-1e6, hi=1e6))
    def sums(
        x=State("1", "2 * k", "sum", lo=-1e6, hi=1e6),
        z=State("1", 1.0, "half", lo=-1e6, hi=1e6),
        w=State("1", [1.0, 2.0, 3.0], "as they are", shape=(3,), lo=-9, hi=9),
        u=Input("1", "step", lo=-1, hi=1),
        k=Param("1", 0.3, "start", lo=0, hi=1),
    ):
        return dict(x=0.9 * x + u, z=z / 2 + u / (k + 1), w=w), dict(y=x + z + w[0])

    block = connect("two", {"a.u": "u", "b.u": "a.y"}, a=sums, b=sums)
    codegen.export(block, tmp_path / "two", check=True, real="float")
    text = (tmp_path / "two/two.c").read_text()
    assert ".x = 2.0f * param->a_k, .z = 1.0f, .w = {1.0f, 2.0f, 3.0f}" in " ".join(text.split())


def test_roundings_of_trials_are_those_of_float(tmp_path: Path) -> None:
    """Directed runs bound a sum from both sides, whole numbers are exact, and runs repeat."""

    @step(period=1.0, y=Output("1"), n=Output("1"))
    def sums(
        s=State("1", 0.0, "sum of a tenth"),
        k=State("1", 0.0, "number of ticks"),
        u=Input("1", value=0.1),
    ):
        """A sum that rounds in every tick, and one that never does."""
        return dict(s=s + u, k=k + 1), dict(y=s, n=k)

    plan = codegen.Plan(sums, real="float")
    made, rows = codegen.texts(plan), np.full((1000, 1), np.float32(0.1), dtype=float)
    found = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        found.append(float_error.trials(plan, made, rows, {}, tmp_path / name))
    np.testing.assert_array_equal(found[0].rows, found[1].rows)
    exact = np.arange(1, 1001) * float(np.float32(0.1))
    tried = np.array(found[0].rows, dtype=float)
    up, down, zero, *random = tried[:, :, 2]
    assert (up >= exact - 1e-12).all()
    assert (down <= exact + 1e-12).all()
    np.testing.assert_array_equal(zero, down)  # all are positive
    assert all(down[-1] < r[-1] < up[-1] for r in random)
    # random roundings average out, directed ones add up
    assert max(abs(r[-1] - exact[-1]) for r in random) < 0.2 * (up[-1] - exact[-1])
    assert (tried[:, :, 3] == np.arange(1, 1001)).all()
    nearest = np.cumsum(rows[:, 0].astype(np.float32), dtype=np.float32)
    assert ((down <= nearest) & (nearest <= up)).all()


def test_random_numbers_are_the_same_in_float(tmp_path: Path) -> None:
    @step(K=Output("1", "1.5/eps"))
    def noise(s=State("1", state_from_seed(5), "random", shape=(3,)), off=Input("1", value=0.0)):
        """Wichmann and Hill, with the quick floor."""
        K = rounder()(s)
        return dict(s=advance(s, quick_floor([K[0], K[1]]))), dict(K=K[0] + off)

    double = codegen.c_module(noise, tmp_path / "d").compile().load()
    single = codegen.c_module(noise, tmp_path / "f", real="float").compile().load()
    rows = np.zeros((20_000, 1))
    (k_double, a), (k_single, b) = double.replay_rows(rows), single.replay_rows(rows)
    np.testing.assert_array_equal(a, b)
    assert (k_double == 1.5 * 2.0**52).all()
    assert (k_single == 1.5 * 2.0**23).all()


@pytest.mark.second
@pytest.mark.parametrize("real", REALS)
@pytest.mark.others("long")
def test_cmake_builds_and_tests(real: str, tmp_path: Path) -> None:
    cmake, ctest = shutil.which("cmake"), shutil.which("ctest")
    if cmake is None or ctest is None:
        pytest.skip("no cmake on this machine")
    codegen.c_module(guarded, tmp_path / "c", real=real)
    build = tmp_path / "build"
    for command in ([cmake, "-S", tmp_path / "c", "-B", build], [cmake, "--build", build],
                    [ctest, "--test-dir", build]):  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in done.stderr
    assert json.loads((tmp_path / "c" / "report.json").read_text())["real"] == real


@pytest.mark.second
@pytest.mark.parametrize("real", REALS)
@pytest.mark.others("long")
def test_cmake_builds_for_a_board_and_ctest_runs_it_there(real: str, tmp_path: Path) -> None:
    tools = ("cmake", "ctest", targets.EMULATOR, "gcc")
    missing = [t for t in tools if shutil.which(t) is None]
    if missing:
        pytest.skip(f"not on this machine: {', '.join(missing)}")
    target = "cortex-m4" if real == "float" else "cortex-m7"
    try:
        targets.tool(target)
    except BadInput as error:
        pytest.skip(str(error))
    folder = tmp_path / "c"
    codegen.c_module(guarded, folder, real=real)
    configure = ["cmake", "-S", folder, "-B", tmp_path / "b",
                 "-DCMAKE_TOOLCHAIN_FILE=arm-none-eabi.cmake"]  # fmt: skip
    build, test = (
        ["cmake", "--build", tmp_path / "b"],
        ["ctest", "-V", "--test-dir", tmp_path / "b"],
    )
    for command in ([*configure, f"-DTARGET={target}"], build, test):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in done.stderr
    assert "instructions per step: mean" in done.stdout
    (tmp_path / "b" / "vectors.bin").write_bytes(b"slipctl-vectors 3 other")
    spoilt = subprocess.run(test, cwd=folder, capture_output=True, text=True, check=False)
    assert spoilt.returncode != 0
    assert "does not belong to guarded" in spoilt.stdout
    wrong = subprocess.run([*configure[:4], tmp_path / "no", *configure[5:], "-DTARGET=cortex-m0"],
                           cwd=folder, capture_output=True, text=True, check=False)  # fmt: skip
    assert "TARGET cortex-m0 is not known; give cortex-m4 or cortex-m7" in wrong.stderr


def test_make_builds_again_with_another_compiler(tmp_path: Path) -> None:
    if shutil.which("make") is None or len(compilers.compilers()) < 2:
        pytest.skip("no make, or one compiler only")
    codegen.c_module(guarded, tmp_path)
    first, second = compilers.compilers()[:2]
    for compiler, again in ((first, True), (first, False), (second, True)):
        said = subprocess.run(["make", f"CC={compiler}", "test"], cwd=tmp_path, capture_output=True,
                              text=True, check=True).stdout  # fmt: skip
        assert ("-c guarded.c" in said) == again
        assert "relative difference" in said


# ---- targets -------------------------------------------------------------------------------------


@pytest.mark.second
@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.others("long")
def test_float_links_nothing_of_double_on_a_cortex_m4(name: str, tmp_path: Path) -> None:
    """In double the helpers are there, so the search for them finds what it looks for."""
    try:
        targets.tool("cortex-m4")
    except BadInput as missing:
        pytest.skip(str(missing))
    found = {}
    for real in REALS:
        report = codegen.export(BLOCKS[name](), tmp_path / real, real=real, target="cortex-m4")
        assert report.passed
        assert "cortex-m4: no warning" in str(report)
        found[real] = report.data["targets"][0]
    assert "aeabi_dmul" in found["double"]["double_helpers"]
    assert found["float"]["double_helpers"] == []
    assert not any("aeabi" in n for n in found["float"]["needed"])
    for what in ("bytes", "linked_bytes"):
        assert found["float"][what]["text"] < found["double"][what]["text"]
    assert (found["float"]["bytes"]["data"], found["float"]["bytes"]["bss"]) == (0, 0)
    assert found["float"]["stack"]["worst"] < found["double"]["stack"]["worst"]


@law(y=Output("1", "wave"))
def wave(phase=Input("rad", "phase", lo=0, hi=10)):
    """A sine, for which newlib has a text in double too."""
    return ca.sin(phase)


def test_float_links_nothing_of_double_on_a_cortex_m7(tmp_path: Path) -> None:
    try:
        targets.tool("cortex-m7")
    except BadInput as missing:
        pytest.skip(str(missing))
    report = codegen.export(wave, tmp_path, real="float", target="cortex-m7")
    found = report.data["targets"][0]
    assert found["needed"] == ["sinf"]
    assert (report.passed, found["double_helpers"]) == (True, [])


def test_limits_of_the_first_ticks_are_theirs() -> None:
    """A decision that arithmetic makes earlier or later loosens no tick that is not replayed."""

    @step(y=Output("1", "flag"))
    def late(y=State("1", 0.0, "flag")):
        """Jumps once."""
        return dict(y=y), dict(y=y)

    plan = codegen.Plan(late, real="float")
    jumps = np.array([(np.arange(20) >= k).astype(float) for k in (15, 16, 17)])
    both = np.stack([jumps, jumps], axis=2)  # output and state
    calm = np.zeros(20, dtype=int)
    run = expected_outputs.Expected(np.zeros((20, 0)), jumps[0][:, None], jumps[0][:, None], calm,
                                    {}, frozenset())  # fmt: skip
    tried = float_error.Trials(both[1:], np.array([calm, calm]))
    whole = expected_outputs.with_limits(plan, run, {}, tried)
    assert (whole.envelope, whole.limits["y"]) == ({"y"}, expected_outputs.ENVELOPE)
    short, few = expected_outputs.first_ticks(run, tried, 10)
    first = expected_outputs.with_limits(plan, short, {}, few)
    assert (first.envelope, first.limits["y"]) == (frozenset(), 2 * precision.epsilon("float"))
    assert len(first.rows) == len(first.status) == 10


@pytest.fixture
def on_board() -> None:
    try:
        targets.tool("cortex-m4")
        targets.emulator("cortex-m4")
    except BadInput as missing:
        pytest.skip(str(missing))


@pytest.mark.second
def test_a_board_stops_after_enough_instructions(
    on_board: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not before its least number of ticks; the host compares them all."""
    monkeypatch.setattr(back_to_back, "ENOUGH", 1.0)
    monkeypatch.setattr(back_to_back, "AT_LEAST", 3)
    inputs = {"e": np.full(50, 0.01), "w": np.full((50, 2), 0.2), "free": np.linspace(-30, 30, 50)}
    report = codegen.check(guarded, inputs, tmp_path, target="cortex-m4")
    there = report["targets"][0]
    assert report["passed"]
    assert there["passed"]
    assert (report["ticks"], there["ticks"]) == (50, 3)
    assert there["instructions"]["mean"] > 1


@pytest.mark.long
@pytest.mark.usefixtures("on_board")
def test_vectors_are_replayed_on_each_board(tmp_path: Path) -> None:
    """Same vectors, same status, in double to the last bits; the limits are in instructions."""
    found = {}
    for real in REALS:
        each = ",".join(targets.TARGETS)  # the module is written and tried here once for all
        report = codegen.export(control(), tmp_path / real, check=True, real=real, target=each)
        assert report.passed, str(report)
        assert str(report).count("instructions per step") == len(targets.TARGETS)
        for told in report.data["targets"]:
            found[told["target"], real] = told
            assert "200 ticks, 0 faults, 7 of 7 inputs are held when NaN" in told["own_test"]
            assert told["stack_used"] <= max(told["stack"]["worst"] + 128, 64)
    for target in targets.TARGETS:
        double, single = (found[target, real] for real in ("double", "float"))
        assert max(double["signals"].values()) <= codegen.LIMIT
        # below 400 before its 7 inputs and its state had ranges; at most 15 more for each of them
        assert 50 < single["instructions"]["mean"] < 500
        if target == "cortex-m4":  # it has no double in hardware
            assert double["instructions"]["mean"] > 10 * single["instructions"]["mean"]


@pytest.mark.second
@pytest.mark.usefixtures("on_board")
def test_board_notices_a_difference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = targets.in_binary

    def spoilt(vectors: str) -> bytes:
        lines = vectors.splitlines()
        row = lines[-1].split()
        row[-2] = repr(float(row[-2]) + 1e-3)
        return honest("\n".join([*lines[:-1], " ".join(row)]))

    monkeypatch.setattr(targets, "in_binary", spoilt)
    report = codegen.export(guarded, tmp_path, check=True, target="cortex-m4")
    assert not report.passed


@pytest.mark.usefixtures("on_board")
@pytest.mark.parametrize("target", targets.TARGETS)
def test_instructions_are_counted_one_by_one(target: str, tmp_path: Path) -> None:
    """So many nops more are so many instructions more."""
    for name, text in board.board_files().items():
        (tmp_path / name).write_text(text)
    body = "\n".join(
        f"    from = clock_now();\n    __asm volatile({nops});\n"
        '    printf("%lu\\n", instructions(from, clock_now()));'
        for nops in ('""', '"nop"', '".rept 7\\n nop\\n .endr"', '".rept 1000\\n nop\\n .endr"')
    )
    (tmp_path / "main.c").write_text(
        '#include "cortex_m.h"\n#include <stdio.h>\nint main(void);\nint main(void)\n{\n'
        f"    unsigned long from;\n    clock_start();\n{body}\n    return 0;\n}}\n"
    )
    targets.build(target, tmp_path, ["main.c"], "main.elf", "float")
    call = [*targets.command(target, "main.elf"), "-serial", "none", *board.COUNT]
    said = targets.run(call, tmp_path)
    empty, *counts = map(int, said.stdout.split())
    assert [c - empty for c in counts] == [1, 7, 1000]


def test_target_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(BadInput, match="is not known; did you mean"):
        codegen.export(guarded, tmp_path / "out", target="cortex-m3")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="apt install gcc-arm-none-eabi libnewlib-arm-none-eabi"):
        codegen.export(guarded, tmp_path / "out", target="cortex-m4")
    monkeypatch.setattr(targets, "tool", lambda target: "")
    with pytest.raises(BadInput, match=r"needs qemu-system-arm; install it .* qemu-system-arm"):
        codegen.export(guarded, tmp_path / "out", check=True, target="cortex-m4")
    assert not (tmp_path / "out").exists()


@pytest.mark.second
def test_sanitizers_and_neighbours_find_what_they_look_for(tmp_path: Path) -> None:
    """A module that reads beyond an array, one that keeps global data, one that shows a name."""
    plan = codegen.Plan(guarded)
    codegen.c_module(guarded, tmp_path)
    compiler, source = compilers.compilers()[0], tmp_path / "guarded.c"
    honest = source.read_text()

    def product() -> Path:
        compilers.compile_object(compiler, source, tmp_path / "guarded.o")
        return tmp_path / "guarded.o"

    assert isolation.linked_twice(plan, tmp_path, compiler, product())
    said, sound = isolation.run_sanitizers(plan, tmp_path, compiler)
    assert sound
    head = "guarded_out now;\n"
    if "not run" not in said:
        wild = "    const volatile double *beyond = in->w + 50;\n    (void)*beyond;\n"
        source.write_text(honest.replace(head, head + wild, 1))
        assert not isolation.run_sanitizers(plan, tmp_path, compiler)[1]
    source.write_text(honest + "int shown(void);\nint shown(void)\n{\n    return 1;\n}\n")
    assert not isolation.linked_twice(plan, tmp_path, compiler, product())
    count = "    static double calls = 0.0;\n    calls += 1e-3;\n"
    source.write_text(
        honest.replace(f"    {head}", f"    {head}{count}", 1).replace(
            "state->held = now;", "now.T += calls;\n    state->held = now;"
        )
    )
    module = codegen.CModule(tmp_path, plan).compile(compiler).load()
    rows = np.full((20, 4), 0.1)
    alone = np.hstack(module.replay_rows(rows))
    assert not isolation.same_beside_another(module, rows, alone)


def test_helpers_of_double_are_told_from_those_of_float() -> None:
    double = ["aeabi_dadd", "aeabi_f2d", "aeabi_d2f", "adddf3", "truncdfsf2", "exp", "sqrt"]
    single = ["expf", "fmodf", "aeabi_fadd", "addsf3", "aeabi_i2f", "memcpy", "aeabi_idiv"]
    assert compilers.in_double([*double, *single]) == double


@pytest.mark.second
def test_an_output_and_a_state_may_share_a_name(tmp_path: Path) -> None:
    """Each of the two has its own limit in the vectors that the shipped test reads."""

    @step(period=0.01, y=Output("1", "output"))
    def twin(y=State("1", 0.5, "state"), u=Input("1", "input", lo=-1, hi=1)):
        return dict(y=0.9 * y + u), dict(y=2 * y)

    report = codegen.export(twin, tmp_path, check=True)
    assert report.passed, str(report)
