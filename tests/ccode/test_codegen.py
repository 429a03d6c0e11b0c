"""Generated C gives the numbers of the block, refuses what it must, and keeps to its folder."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from module_text import of_folder

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    Rail,
    RunFailed,
    Scenario,
    Section,
    State,
    connect,
    differential_evolution,
    every,
    flow,
    from_text,
    gated,
    law,
    make_block,
    replicate,
    rls,
    sampled,
    simulate,
    step,
)
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison
from slipctl.ccode.compile import compilers
from slipctl.ccode.tree.expressions import Writer
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.parser import define, expression
from slipctl.ccode.tree.printer import file_text
from slipctl.models import brakes
from slipctl.models.huang_2020 import subway_braking, subway_braking_control

try:
    compilers.compilers()
    HAS_COMPILER = True
except BadInput:
    HAS_COMPILER = False

needs_compiler = pytest.mark.skipif(not HAS_COMPILER, reason="no C compiler on this machine")


# ---- blocks --------------------------------------------------------------------------------------


@step(y=Output("1", "trace", lo=-50, hi=50), z=Output("1", "scaled", shape=(3,)))
def matrices(
    x=State("1", [1.0, 2.0, 3.0], "vector", shape=(3,)),
    P=State("1", np.eye(2) * 3, "matrix", shape=(2, 2)),
    u=Input("1", "vector", shape=(3,)),
    Q=Input("1", "matrix", shape=(2, 3), value=0.5),
    A=Param("1", np.arange(6).reshape(2, 3), "matrix", shape=(2, 3)),
    k=Param("1", 2.0, "gain", lo=0),
):
    """Vectors and matrices in every role."""
    return (
        dict(x=0.9 * x + 0.1 * u, P=0.5 * P + (A * Q) @ A.T * 0.01),
        dict(y=ca.sum1(x) + ca.trace(P), z=k * u),
    )


@step(y=Output("m", "position", lo=1, hi=1000))
def derived(
    x=State("m", "2*r", "starts at the diameter"),
    w=State("m", "x + d", "starts from another start"),
    u=Input("1", "speed"),
    double=Param("1", 2.0, "a word of C", lo=0),
    r=Param("m", "d/2", "radius", lo=0.1, hi=10),
    d=Param("m", 3.0, "diameter", lo=0),
    e=Param("m", "r*double + d", "needs another derived one"),
):
    """Derived parameters and computed start values."""
    return dict(x=0.5 * x + r * u, w=0.5 * w + e), dict(y=x + w)


_s, _q = ca.SX.sym("s", 2), ca.SX.sym("q")
_inner = ca.Function(
    "inner", [_s, _q],
    [ca.vertcat(_s[0] + 0.1 * ca.sin(_s[1]) * _q,
                ca.if_else(_s[1] > 0.3, _s[1] * 0.9, _s[1] + 0.1))],
)  # fmt: skip


def _looping(x: Any, u: Any, p: Any) -> Any:
    s, q = x["s"], u["u"]
    end = _inner.fold(25)(s, ca.repmat(q, 1, 25))
    chosen = s[ca.fmin(1, ca.fmax(0, ca.floor(q)))]
    return {"s": 0.5 * end}, {
        "y": chosen + ca.mtimes(s.T, end),
        "path": _inner.mapaccum(7)(s, ca.repmat(q, 1, 7)),
        "fan": ca.sum2(_inner.map(5)(ca.repmat(s, 1, 5), ca.linspace(0, 1, 5).T)),
        "size": ca.norm_2(end) + ca.mmax(end) + ca.cumsum(end)[1],
    }


looping = make_block(
    "looping", "step", _looping, sx=False, doc="Loops, maps and an element chosen by number.",
    states=[State("1", 0.2, shape=(2,)).named("s")],
    inputs=[Input("1", lo=-1, hi=3).named("u")],
    outputs=[Output("1").named("y"), Output("1", shape=(2, 7)).named("path"),
             Output("1", shape=(2,)).named("fan"), Output("1").named("size")],
)  # fmt: skip


def _nested(x: Any, u: Any, p: Any) -> Any:
    """Choices within choices, of which some results are never used."""
    q, r = ca.MX.sym("q"), ca.MX.sym("r")
    keep = ca.Function("keep", [q, r], [r, q])

    def deeper(depth: int) -> ca.Function:
        found = [ca.sin(depth * q) + r, r / (depth + q**2)]
        if depth < 3:
            found = deeper(depth + 1).call([found[0] > depth / 4, q, found[0]])
        more = ca.Function(f"more{depth}", [q, r], found)
        return ca.Function.if_else(f"due{depth}", more, keep)

    y, _ = deeper(1).call([u["u"] > 0, u["u"], x["s"]])
    return {"s": 0.5 * y}, {"y": y}


nested = make_block(
    "nested", "step", _nested, sx=False, doc="Choices within choices.",
    states=[State("1", 0.2).named("s")], inputs=[Input("1", lo=-1, hi=3).named("u")],
    outputs=[Output("1").named("y")],
)  # fmt: skip


def _tables(x: Any, u: Any, p: Any) -> Any:
    grid = [0, 1, 2, 3, 4, 5]
    linear = ca.interpolant("linear", "linear", [grid], [0, 1, 4, 9, 3, 1])
    spline = ca.interpolant("spline", "bspline", [grid], [0, 1, 4, 9, 3, 1])
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    root = ca.rootfinder("root", "fast_newton", {"x": a, "p": b, "g": a**3 + a - b})
    silent = {"print_iter": False, "print_header": False, "print_info": False}
    qp = ca.conic("qp", "qrqp", {"h": ca.DM.eye(2).sparsity(), "a": ca.DM.ones(1, 2).sparsity()},
                  silent)  # fmt: skip
    q = u["u"]
    best = qp(h=ca.DM.eye(2), g=ca.vertcat(q, -q), a=ca.DM.ones(1, 2), lba=-1, uba=1)["x"]
    solved = ca.solve(ca.MX(ca.DM([[2, 1], [1, 3]])), ca.vertcat(q, 1))
    return {"s": 0.9 * x["s"] + q}, {
        "linear": linear(q), "spline": spline(q), "root": root(0.1, q), "best": best,
        "solved": solved,
    }  # fmt: skip


tables = make_block(
    "tables", "step", _tables, sx=False, doc="Tables and solvers that CasADi writes out.",
    states=[State("1", 0.2).named("s")],
    inputs=[Input("1", lo=0.1, hi=4.9).named("u")],
    outputs=[*(Output("1").named(n) for n in ("linear", "spline", "root")),
             *(Output("1", shape=(2,)).named(n) for n in ("best", "solved"))],
)  # fmt: skip


def _elementwise(x: Any, u: Any, p: Any) -> Any:
    a, b, c = x["s"], u["u"], ca.MX(ca.DM([1, 0, 2]))
    parts = [
        ca.logic_not(a), ca.logic_and(a, c), ca.logic_or(b, c), ca.if_else(a, c, b),
        ca.logic_and(b, a[0]), ca.logic_not(a[0]), ca.fmin(a, c), ca.fmax(b, a), ca.sign(a), a**2,
        ca.fabs(a), ca.sqrt(ca.fabs(a)), ca.floor(a), a < c, a == c, ca.norm_inf(a), ca.norm_1(a),
        ca.mmin(a), ca.dot(a, c), ca.sum1(a), ca.vec(a @ c.T), ca.diff(a), ca.atan2(a, c),
        ca.logsumexp(a), ca.vec(ca.densify(ca.diag(a))),
    ]  # fmt: skip
    return {"s": 0.9 * a + 0.1 * b}, {"y": ca.vertcat(*parts)}


elementwise = make_block(
    "elementwise", "step", _elementwise, sx=False, doc="Operations on whole vectors.",
    states=[State("1", 0.2, shape=(3,)).named("s")],
    inputs=[Input("1", lo=-1, hi=3, shape=(3,)).named("u")],
    outputs=[Output("1", shape=(72,)).named("y")],
)  # fmt: skip

mixed = connect(
    "mixed",
    {"slow.u": "loops.y", "loops.u": "u", "tables.u": "clip.y", "clip.u": "slow.y"},
    slow=every(derived, 3), loops=looping, tables=tables,
    clip=make_block(
        "clip", "law", lambda x, u, p: ({}, {"y": ca.fmin(4.9, ca.fmax(0.1, u["u"]))}),
        inputs=[Input("m").named("u")], outputs=[Output("1").named("y")], doc="Limits.",
    ),
)  # fmt: skip

BLOCKS = {
    "mixed": mixed,
    "elementwise": elementwise,
    "matrices": matrices,
    "derived": derived,
    "every": every(derived, 3),
    "loops": looping,
    "nested": nested,
    "tables": tables,
    "law": subway_braking.double_exponential,
    "no_state_no_input": subway_braking.curve_resistance(),
}

SEARCH: dict[str, Any] = {"over": "v_s", "lo": 0.01, "hi": 10.0, "generations": 12}
MADE = {
    "rls": lambda law: rls(law),
    "search": lambda law: differential_evolution(law, **SEARCH),
    "search_spread": lambda law: differential_evolution(law, **SEARCH, generations_per_tick=3),
}
"""Blocks that the engine makes from a law."""


def subway(controller: Block) -> Block:
    """Loop of the subway study with the best slip given."""
    plant = sampled(subway_braking.plant(brake=brakes.brake()), 1e-3, "rk4", substeps=10)
    wires = {
        "ctl.v": "plant.wheel.v", "ctl.v_s": "plant.wheel.v_s", "ctl.mu_hat": "plant.adh.mu",
        "ctl.f_hat": "plant.air.f", "ctl.W_hat": "plant.curve.W", "plant.T_cmd": "ctl.T_b",
        "ctl.v_opt": "v_opt",
    }  # fmt: skip
    return connect("loop", wires, plant=plant, ctl=controller)


def control(**choices: Any) -> Block:
    return subway_braking_control.controller(subway_braking_control.super_twisting(**choices))


@pytest.fixture(scope="module")
def run() -> tuple[Block, Any]:
    rails = [Section(2.0 * k, n, {"v_opt": 1.2098601}) for k, n in enumerate(("dry", "wet", "ice"))]
    loop = subway(control())
    return loop, simulate(loop, Scenario("base", 6.0, Rail(rails)))


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory) -> codegen.CModule:
    return codegen.c_module(derived, tmp_path_factory.mktemp("derived")).compile().load()


# ---- the same numbers ----------------------------------------------------------------------------


@pytest.mark.second
@needs_compiler
def test_controller_in_c_repeats_the_run(run: Any, tmp_path: Path) -> None:
    loop, log = run
    inputs = codegen.logged_inputs(loop, "ctl", log)
    report = codegen.check(loop["ctl"], inputs, tmp_path / "c")
    assert report["passed"]
    assert report["ticks"] == 6000
    assert set(report["signals"]) == {*loop["ctl"].outputs, *loop["ctl"].states}
    assert report["largest_relative"] <= codegen.LIMIT == 1e-12
    # and what C gives is what the loop's own log holds
    ctl = codegen.c_module(loop["ctl"], tmp_path / "c").compile().load()
    torque = ctl.replay(inputs)["T_b"]
    np.testing.assert_allclose(torque, log["ctl.T_b"].values, rtol=0, atol=1e-12 * torque.max())


@pytest.mark.second
@needs_compiler
@pytest.mark.parametrize("choices", [{"discretisation": "proper_implicit"}, {"gains": "printed"}])
@pytest.mark.others("long")
def test_other_forms_of_the_controller(choices: Any, run: Any, tmp_path: Path) -> None:
    loop, log = run
    inputs = codegen.logged_inputs(loop, "ctl", log)
    assert codegen.check(control(**choices), inputs, tmp_path)["passed"]


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize("name", [*BLOCKS, *MADE])
def test_every_kind_of_block_agrees(name: str, tmp_path: Path) -> None:
    made = MADE.get(name)
    block = made(subway_braking.double_exponential) if made else BLOCKS[name]
    report = codegen.export(block, tmp_path, check=True)
    assert report.passed, str(report)
    assert report.data["ticks"] == comparison.TRIAL
    for c in report.data["compiled"]:
        assert c["bytes"] is None or c["bytes"]["bss"] == 0
        public = [f"{block.name}_{f}" for f in ("default", "init", "step", "tune")]
        assert c["symbols"]["defined"] == public
        assert not {"malloc", "calloc", "free", "printf"} & set(c["symbols"]["needed"])
    assert "passed" in str(report)


def test_held_step_is_a_branch_and_calls_only_what_must_be_called(tmp_path: Path) -> None:
    codegen.c_module(every(control(), 3), tmp_path / "a")
    text = of_folder(tmp_path / "a", "ctl")
    assert "if (state->tick == 0.0) {" in text
    assert "casadi" not in text.lower()
    codegen.c_module(mixed, tmp_path / "b")
    text = of_folder(tmp_path / "b", "mixed")
    assert "static void slow(" in text  # what needs no solver is written as ever
    assert "if (state->tick == 0.0) {" in text
    assert "casadi_qrqp" in text
    assert not re.search(r"_(checkout|n_in|sparsity_out|work_bytes|casadi_version)\b", text)


@pytest.mark.second
@pytest.mark.parametrize("around", [
    pytest.param(lambda b: replicate(b, 3, ["u"]), marks=pytest.mark.long),
    pytest.param(lambda b: gated(b), marks=pytest.mark.long),
    lambda b: replicate(every(b, 2), 2),
    pytest.param(lambda b: connect("two", {"a.u": "u", "b.u": "a.linear", "y": "b.root"}, a=b, b=b),
                 marks=pytest.mark.long),
])  # fmt: skip
def test_a_part_with_solvers_runs_wherever_it_stands(around: Any, tmp_path: Path) -> None:
    """Copies, at times, behind itself: CasADi's text is that of this part alone, to the bit."""
    block = around(tables)
    rng = np.random.default_rng(3)
    given = {n: rng.uniform(0.2, 0.9, (20, *s.shape)) for n, s in block.inputs.items()}
    found = codegen.check(block, given, tmp_path, name="ctl", period=0.01)
    assert found["passed"]
    assert all(s["absolute"] == 0 for s in found["signals"].values())
    assert "work->failed = 1;" in (tmp_path / "ctl_parts.h").read_text()


def test_random_expressions_are_written_operation_for_operation(tmp_path: Path) -> None:
    """DAGs of every operation, compiled, give the bits of CasADi (a zero may lose its sign)."""
    if not HAS_COMPILER:
        pytest.skip("no C compiler on this machine")
    rng = np.random.default_rng(7)
    functions = [_random_function(rng, f"f{k}") for k in range(40)]
    text = []
    for f in functions:
        writer = Writer(f, lambda i, k: expression(f"u[{k}]")).run()
        body = [*writer.lines, *(f"y[{k}] = {writer.result(n)};" for (_, k), n in writer.results)]
        text.append(define(f"void {f.name()}(const double *u, double *y)", body))
    prototypes = [f"void {f.name()}(const double *u, double *y);" for f in functions]
    source = tmp_path / "random.c"
    functions_of = file_text([*helpers(text), *text])
    source.write_text(
        "\n".join(["#include <math.h>\n#include <stdbool.h>", *prototypes, functions_of])
    )
    compiler = compilers.compilers()[0]
    # the lines are compiled as they are in a module, so that no warning escapes
    compilers.compile_object(compiler, source, tmp_path / "random.o", "-fPIC", "-fno-builtin")
    compilers.link(compiler, [tmp_path / "random.o"], tmp_path / "random.so", "-shared")
    lib = ctypes.CDLL(str(tmp_path / "random.so"))
    for f in functions:
        for u in rng.normal(size=(20, 4)) * rng.choice([0.0, 1e-3, 1.0, 30.0], size=(20, 4)):
            wanted = np.array(f(u).full()).ravel()
            got = np.full(wanted.size, 7.0)
            lib[f.name()](*(a.ctypes.data_as(ctypes.c_void_p) for a in (u, got)))
            np.testing.assert_array_equal(got, wanted)


def _random_function(rng: np.random.Generator, name: str) -> ca.Function:
    u = ca.SX.sym("u", 4)
    pool = [*ca.vertsplit(u), ca.SX(-2.5), ca.SX(1e-9), ca.SX(3)]
    one = (ca.exp, ca.sqrt, ca.sin, ca.cos, ca.tan, ca.atan, ca.tanh, ca.fabs, ca.sign, ca.floor,
           ca.ceil, ca.log1p, ca.expm1, ca.erf, lambda a: -a, lambda a: a**2, lambda a: 2 * a,
           lambda a: 1 / a, lambda a: a**3, lambda a: a**-0.5, ca.logic_not)  # fmt: skip
    two = (lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / b,
           ca.fmin, ca.fmax, ca.atan2, ca.fmod, ca.hypot, ca.copysign, lambda a, b: a < b,
           lambda a, b: a <= b, lambda a, b: a == b, lambda a, b: a != b, ca.logic_and,
           ca.logic_or)  # fmt: skip
    for _ in range(30):
        a, b, c = (pool[k] for k in rng.integers(len(pool), size=3))
        kind = rng.integers(5)
        if kind == 0:
            pool.append(one[rng.integers(len(one))](a))
        elif kind == 4:
            pool.append(ca.if_else(a > b, c, b))
        else:
            pool.append(two[rng.integers(len(two))](a, b))
    return ca.Function(name, [u], [ca.vertcat(*pool[-6:])])


@needs_compiler
def test_module_is_called_like_the_block(module: codegen.CModule) -> None:
    numbers = {"x": 1.5, "w": 2.0, "u": 0.25, "d": 4.0}
    assert module(**numbers) == derived(**numbers)
    # C limits an output, the block does not
    states, outputs = derived(x=1.5, w=-2.0, u=0.25)
    assert outputs == {"y": -0.5}
    assert module(x=1.5, w=-2.0, u=0.25) == (states, {"y": 1.0})
    assert module.status == 16
    with pytest.raises(BadInput, match="did you mean 'double'"):
        module(doubl=1)


@needs_compiler
def test_step_carries_the_state_and_replay_does_the_same(module: codegen.CModule) -> None:
    speeds = np.linspace(-1, 1, 11)
    module.reset(d=5.0)
    single = [module.step(u=v)["y"] for v in speeds]
    end = module.state
    module.reset(d=5.0)
    assert module.replay({"u": speeds})["y"].tolist() == single
    assert module.state == end
    assert module.status.tolist() == [0] * 11


# ---- parameters and start ------------------------------------------------------------------------


@needs_compiler
def test_derived_parameters_and_start_values_are_computed_in_c(module: codegen.CModule) -> None:
    for d in (0.5, 3.0, 8.0):
        module.reset(d=d)
        assert module.status == 0
        wanted = derived.with_params(d=d).start()
        assert module.state == {k: float(v) for k, v in wanted.items()}
    with pytest.raises(BadInput, match="is derived"):
        module.reset(r=1.0)


@needs_compiler
def test_init_and_tune_refuse_parameters_off_range(module: codegen.CModule) -> None:
    """0.15 is in range for d but gives a radius that is not; NaN is in no range."""
    for value in (0.15, np.nan, np.inf, -1.0):
        module.reset()
        good = module._state.copy()
        module._param[1] = value  # d
        assert module._call("tune", module._param, module._state) == 4
        np.testing.assert_array_equal(module._state, good)
        assert module._call("init", module._param, module._state) == 4
        np.testing.assert_array_equal(module._state, good)  # starts as with the defaults
    module._param[1] = 6.0
    assert module._call("tune", module._param, module._state) == 0
    assert module.step(u=1.0)["y"] == 9.0  # x and w stay, only the derived ones change
    assert module.state == {"x": 1.5 + 3.0, "w": 3.0 + 3.0 * 2 + 6.0}


# ---- guards --------------------------------------------------------------------------------------


@needs_compiler
def test_nan_never_reaches_the_state_and_the_last_good_output_is_held(
    module: codegen.CModule,
) -> None:
    for bad in (np.nan, np.inf, -np.inf):
        module.reset()
        before = module.state
        assert module.step(u=bad)["y"] == 1.0  # nothing good yet: the end of the range near zero
        assert module.status == 1 | 32
        assert module.state == before
        module.step(u=0.5)
        assert module.status == 0
        held = module.step(u=bad)
        assert module.status == 1
        after = module.state
        module.reset()
        module.step(u=0.5)
        assert (module.step(u=0.5), module.state) == (held, after)
        assert module.status == 0


@needs_compiler
def test_equations_that_break_do_not_reach_the_state(tmp_path: Path) -> None:
    @step(y=Output("1"))
    def root(x=State("1", 4.0), u=Input("1"), p=Param("1", 1.0)):
        """A root that has no real value for every input."""
        return dict(x=ca.sqrt(x + u) * p), dict(y=x)

    c = codegen.c_module(root, tmp_path).compile().load()
    assert c.step(u=0.0)["y"] == 4.0
    assert c.step(u=-100.0)["y"] == 4.0
    assert (c.status, c.state) == (2 | 32, {"x": 2.0})
    c._param[0] = np.nan  # a parameter spoilt at run time is not in force
    c.step(u=0.0)
    assert (c.status, c.state) == (0, {"x": 2.0**0.5})


@needs_compiler
def test_instances_and_modules_do_not_disturb_each_other(tmp_path: Path) -> None:
    """Two modules linked into one library; two instances of one, interleaved."""
    one = codegen.c_module(matrices, tmp_path / "a", "first").compile().load()
    two = codegen.c_module(matrices, tmp_path / "b", "second").compile().load()
    objects = [one.object_file, two.object_file]
    compilers.link(compilers.compilers()[0], objects, tmp_path / "both.so", "-shared")
    u = np.random.default_rng(1).normal(size=(30, 3))
    alone = one.replay({"u": u})["y"]
    one.reset()
    two.reset(k=5.0)
    mixed = []
    for row in u:
        mixed.append(one.step(u=row)["y"])
        two.step(u=-row)
    assert mixed == alone.tolist()


# ---- the folder ----------------------------------------------------------------------------------


def test_same_block_gives_the_same_bytes(tmp_path: Path) -> None:
    codegen.c_module(control(), tmp_path / "a")
    script = (
        "import sys; from slipctl.ccode import codegen; from slipctl.models import"
        " subway_braking_control as c; codegen.c_module(c.controller(c.super_twisting()),"
        " sys.argv[1])"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path / "b")], check=True)
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert names == ["CMakeLists.txt", "LICENSE", "Makefile", "README.md", "arm-none-eabi.cmake",
                     "cortex_m.c",
                     "cortex_m.h", "cortex_m.ld", "ctl.a2l", "ctl.c", "ctl.h", "ctl_parts.h",
                     "example.c",
                     "report.json", "report.md", "test_ctl.c", "vectors.txt"]  # fmt: skip
    for n in names:
        assert (tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes(), n
    text = (tmp_path / "a" / "ctl.h").read_text()
    other = control(gains="printed")
    codegen.c_module(other, tmp_path / "c")
    content = re.search(r"content (\w{16})", text)
    assert content is not None
    assert content[1] not in (tmp_path / "c" / "ctl.h").read_text()


@needs_compiler
def test_folder_builds_and_tests_itself(run: Any, tmp_path: Path) -> None:
    make = shutil.which("make")
    if make is None:
        pytest.skip("no make on this machine")
    loop, log = run
    inputs = codegen.logged_inputs(loop, "ctl", log)
    codegen.export(loop["ctl"], tmp_path, inputs={k: v[:500] for k, v in inputs.items()})
    strict = {"CFLAGS": " ".join(compilers.FLAGS)}
    done = subprocess.run([make, "test", "example"], cwd=tmp_path, capture_output=True, text=True,
                          env={"PATH": "/usr/bin:/bin", **strict})  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "500 ticks, 0 faults, 7 of 7 inputs are held when NaN" in done.stdout
    shown = subprocess.run([str(tmp_path / "example")], capture_output=True, text=True)
    assert "status 0" in shown.stdout
    # the test program notices a wrong number
    lines = (tmp_path / "vectors.txt").read_text().splitlines()
    row = lines[-1].split()
    row[-1] = repr(float(row[-1]) + 1e-9)  # a state of the last tick
    (tmp_path / "vectors.txt").write_text("\n".join([*lines[:-1], " ".join(row)]))
    assert subprocess.run([make, "test"], cwd=tmp_path, capture_output=True).returncode != 0


@pytest.mark.second
@needs_compiler
def test_check_notices_a_difference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = comparison.reference

    def shifted(*args: Any, **options: Any) -> Any:
        outputs, states = honest(*args, **options)
        return outputs, states * (1 + 3e-12)

    monkeypatch.setattr(comparison, "reference", shifted)
    report = codegen.export(derived, tmp_path, check=True)
    assert not report.passed
    assert "FAILED" in str(report)
    assert json.loads((tmp_path / "report.json").read_text())["passed"] is False


@pytest.mark.second
@needs_compiler
@pytest.mark.parametrize("what", ["differences", "_own_test"])
@pytest.mark.others("long")
def test_check_fails_by_each_of_its_two_comparisons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    """Python with the library, and the folder's own program: one of them is enough to fail."""
    honest = getattr(comparison, what)

    def beyond(*args: Any) -> Any:
        found = honest(*args)
        first = next(iter(found))
        return found | {first: found[first] | {"counted": found[first]["limit"] + 1.0}}

    def refused(*args: Any) -> Any:
        return honest(*args)[0], False

    monkeypatch.setattr(comparison, what, beyond if what == "differences" else refused)
    assert not codegen.export(derived, tmp_path, check=True).passed


def test_foreign_files_are_never_touched(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    codegen.c_module(derived, tmp_path)
    codegen.c_module(derived, tmp_path)  # our own files are written again
    assert (tmp_path / "notes.txt").read_text() == "mine"
    changed = tmp_path / "example.c"
    changed.write_text(changed.read_text() + "/* mine */\n")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    with pytest.raises(BadInput, match=r"example\.c was not written by slipctl, or was changed"):
        codegen.c_module(derived.with_params(d=5.0), tmp_path)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_old_files_of_ours_make_room(tmp_path: Path) -> None:
    codegen.c_module(derived, tmp_path, "old")
    codegen.c_module(derived, tmp_path, "new")
    assert not (tmp_path / "old.c").exists()
    assert (tmp_path / "new.c").exists()


def test_report_lists_what_was_written(tmp_path: Path) -> None:
    codegen.c_module(derived, tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["format"] == 1
    assert {*report["files"], "report.json"} == {p.name for p in tmp_path.iterdir()}
    assert report["parameters"]["d"] == {"value": 3.0, "unit": "m"}
    assert {"arg", "res", "iw", "w", "in_state"} == set(report["work"])
    assert str(tmp_path) not in json.dumps(report)
    assert "Nothing was compiled" in (tmp_path / "report.md").read_text()


@pytest.mark.parametrize("name", ["matrices", "derived", "loops"])
@needs_compiler
def test_bytes_of_an_instance_are_known_without_a_compiler(name: str, tmp_path: Path) -> None:
    for real in ("double", "float"):
        module = codegen.c_module(BLOCKS[name], tmp_path / real, "m", real=real)
        said = json.loads((tmp_path / real / "report.json").read_text())["memory_bytes"]
        assert said["state"] == module.compile().load().instance_bytes


def test_readme_tells_which_parameters_go_together_and_which_do_nothing(tmp_path: Path) -> None:
    @step(period=0.01, y=Output("1"))
    def part(
        x=State("1", 0.0),
        u=Input("1"),
        r=Param("m", 0.43, "wheel radius", lo=0.1),
        T=Param("s", 0.01, "sample period", lo=1e-3),
        h=Param("1", 0.5, "step of the printed form"),
        k=Param("1", "2*q", "gain"),
        q=Param("1", 0.25, "half of it"),
    ):
        """Half of | u |."""
        return dict(x=x + T * k * u / r), dict(y=x)

    both = connect("ctl", {"a.u": "u", "b.u": "a.y"}, a=part, b=part.with_params(q=0.5))
    codegen.c_module(both, tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert "| `a` | Half of \\| u \\|. |" in text
    rows = [r for r in text.splitlines() if r.startswith("| wheel radius") or "a_q" in r]
    assert rows == ["| wheel radius, in m | 0.43 | `a_r`, `b_r` |"]
    assert "`a_T`" not in text
    assert "Without effect in this form of the law: `a_h`, `b_h`." in text
    assert "`ctl_param_instance`" in text


@pytest.mark.second
def test_report_to_read_has_the_numbers_of_the_other(tmp_path: Path) -> None:
    data = codegen.export(control(), tmp_path, check=True).data
    text = (tmp_path / "report.md").read_text()
    for n, s in data["signals"].items():
        (row,) = [r for r in text.splitlines() if r.startswith(f"| `{n}` |")]
        assert f"| {s['absolute']:.3g} | {s['relative']:.3g} | {s['limit']:.3g} |" in row
    for c in data["compiled"]:
        assert f"| {c['compiler']} | {c['bytes']['text']} |" in text
    assert f"| one instance | {' | '.join(map(str, data['memory_bytes'].values()))} |" in text


def test_report_tells_what_a_target_counted():
    """A row of the table has each number under its head."""
    from slipctl.ccode.ship import readable

    target = {
        "target": "m4", "compiler": "gcc 12", "bytes": {"text": 11, "data": 12, "bss": 13},
        "stack": {"worst": 14}, "stack_used": 15, "instructions": {"mean": 16, "most": 17},
        "double_helpers": ["a", "b"], "signals": {"x": 0.25, "y": 0.5}, "passed": True,
    }  # fmt: skip
    said = readable._targets({"targets": [target]})[-1].splitlines()
    heads, row = ([c.strip() for c in line.strip("| ").split("|")] for line in (said[0], said[2]))
    told = dict(zip(heads, row, strict=False))
    wanted = {"text": "11", "stack at most": "14", "stack used": "15", "most": "17"}
    assert {k: told[k] for k in wanted} == wanted
    assert told["instructions, mean"] == "16"
    assert told["functions of double"] == "2"


# ---- text ----------------------------------------------------------------------------------------


def test_members_are_documented(tmp_path: Path) -> None:
    codegen.c_module(control(), tmp_path, period=1e-3)
    header = " ".join((tmp_path / "ctl.h").read_text().replace("*", " ").split())
    for said in (
        "mu_hat [1]: adhesion estimate; positive = braking", "slip as a speed",
        "law.k1 [m^.5/s^1.5]: gain of the root; range 0.0 to 1e5; default 20.0; source:",
        "range 0.0 to fmax(T_max, T_low)",
        "Huang 2020 eqs (32)-(38)", "ctl_step is called every 0.001 s",
    ):  # fmt: skip
        assert said in header
    source = of_folder(tmp_path, "ctl")
    assert "now->law_s = in->v_s - now->reference_v_ref;" in source
    assert "casadi" not in source.lower()  # nothing of the template text is needed here
    for line in (tmp_path / "ctl.h").read_text().splitlines():
        assert len(line) <= 100


def test_names_become_c(tmp_path: Path) -> None:
    @law(ω_ü=Output("rad/s", "half */ of it: ω ≤ 1"))
    def names(int=Input("1", "a word of C"), exp=Input("1", "a function of C")):
        """Awkward names."""
        return int + ca.exp(exp)

    codegen.c_module(names, tmp_path)
    header = (tmp_path / "names.h").read_text()
    for member in ("double int_;", "double exp;", "double omega_u;"):
        assert member in header
    assert header.isascii()
    assert "half * / of it: omega <= 1" in header
    if HAS_COMPILER:
        c = codegen.c_module(names, tmp_path).compile().load()
        assert c.step(int=1.0, exp=0.0) == {"ω_ü": 2.0}


@pytest.mark.parametrize("name", ["nan", "memcpy", "round", "fmaxf", "printf", "sin"])
def test_no_function_has_the_name_of_one_of_the_library(name: str, tmp_path: Path) -> None:
    """Compilers know what those take: the part of a block of such a name has another one."""
    block = from_text("y = 2*u where u [1]", name=name)
    module = codegen.c_module(block, tmp_path)
    assert f"static void {name}_part(" in (tmp_path / f"{name}_parts.h").read_text()
    if HAS_COMPILER:
        assert module.compile().load().step(u=3.0) == {"y": 6.0}


# ---- what cannot be ------------------------------------------------------------------------------


def _bad_blocks() -> dict[str, tuple[Any, str]]:
    @flow()
    def continuous(x=State("m"), u=Input("m/s")):
        return dict(x=u), {}

    @law(y=Output("1"))
    def valueless(u=Input("1"), k=Param("1")):
        return k * u

    def wrap(function: ca.Function, name: str) -> Block:
        return make_block(
            name, "law", lambda x, u, p: ({}, {"y": function(u["u"])}), sx=False,
            inputs=[Input("1").named("u")], outputs=[Output("1").named("y")],
        )  # fmt: skip

    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    newton = ca.rootfinder("find", "newton", {"x": a, "p": b, "g": a**3 + a - b})
    quiet = {"print_header": False, "print_iteration": False, "print_time": False, "qpsol": "qrqp",
             "qpsol_options": {"print_iter": False, "print_header": False}}  # fmt: skip
    nlp = ca.nlpsol("nlp", "sqpmethod", {"x": a, "p": b, "f": (a - b) ** 2, "g": a}, quiet)
    u = ca.MX.sym("u")
    rooted = ca.Function("rooted", [u], [newton(0.1, u)])
    planned = ca.Function("planned", [u], [nlp(p=u, x0=0, lbg=0, ubg=1)["x"]])
    part = make_block(
        "part", "law", lambda x, u, p: ({}, {"b_c": u["u"], "c": u["u"]}),
        inputs=[Input("1").named("u")],
        outputs=[Output("1").named("b_c"), Output("1").named("c")],
    )  # fmt: skip
    return {
        "flow": (continuous, r"sampled\(continuous, h, method\) first"),
        "no value": (valueless, r"valueless\.k has no value"),
        "newton": (wrap(rooted, "deep"), r"Newton 'find'; use rootfinder\(\.\.\., 'fast_newton'"),
        "globals": (wrap(planned, "nmpc"), "would keep global data"),
        "clash": (connect("two", {}, a_b=part, a=part), r"'a_b\.c' and 'a\.b_c' would both be"),
    }


@pytest.mark.parametrize("case", ["flow", "no value", "newton", "globals", "clash"])
def test_blocks_that_cannot_be_c(case: str, tmp_path: Path, capfd: Any) -> None:
    block, message = _bad_blocks()[case]
    capfd.readouterr()
    with pytest.raises(BadInput, match=message) as refusal:
        codegen.c_module(block, tmp_path / "out")
    assert "\n" not in str(refusal.value)
    assert not (tmp_path / "out").exists()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["2fast", "a-b", "Math", "test", "fmi2", " ", "vitesse_é"])
def test_names_that_are_none_in_c(name: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot name a C file"):
        codegen.c_module(control().renamed("ctl"), tmp_path / "out", name)
    assert not (tmp_path / "out").exists()


def test_no_compiler_is_said_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    compilers.compilers.cache_clear()
    try:
        with pytest.raises(BadInput, match="no C compiler found; install gcc or clang"):
            codegen.check(derived, {"u": np.zeros(3)}, tmp_path / "out")
        assert not (tmp_path / "out").exists()
        codegen.c_module(derived, tmp_path / "out")  # writing needs none
    finally:
        compilers.compilers.cache_clear()


def test_inputs_that_do_not_fit(tmp_path: Path) -> None:
    for inputs, message in (
        ({}, "needs the input u"),
        ({"v": [1.0]}, "no input 'v'"),
        ({"u": np.array([1.0, np.nan])}, "NaN or infinity"),
        ({"u": np.zeros(0)}, "no ticks"),
        ({"u": np.zeros((3, 2))}, "takes an array"),
    ):
        with pytest.raises(BadInput, match=message):
            codegen.export(derived, tmp_path / "out", inputs=inputs)
    with pytest.raises(BadInput, match="differ in length"):
        codegen.export(matrices, tmp_path / "out",
                       inputs={"u": np.zeros((3, 3)), "Q": np.zeros((4, 2, 3))})  # fmt: skip
    assert not (tmp_path / "out").exists()


@needs_compiler
def test_nothing_is_called_compared_that_was_not(tmp_path: Path) -> None:
    @law(y=Output("1"))
    def never(u=Input("1", lo=0, hi=1)):
        """No number for any input in range."""
        return ca.log(-1 - u)

    with pytest.raises(BadInput, match="gives NaN or infinity on made-up inputs"):
        codegen.export(never, tmp_path / "out", check=True)
    with pytest.raises(RunFailed, match="itself gives NaN or infinity at tick 0"):
        codegen.check(never, {"u": np.ones(3)}, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_unwritable_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="is a file; give a folder"):
        codegen.c_module(derived, tmp_path / "file")


# ---- logged inputs -------------------------------------------------------------------------------


def test_logged_inputs_follow_the_wires(run: Any) -> None:
    loop, log = run
    found = codegen.logged_inputs(loop, "ctl", log)
    assert list(found) == list(loop["ctl"].inputs)
    np.testing.assert_array_equal(found["v"], log["plant.wheel.v"].values)  # a state
    np.testing.assert_array_equal(found["mu_hat"], log["plant.adh.mu"].values)  # an output
    np.testing.assert_array_equal(found["v_opt"], log["v_opt"].values)  # an outer input
    assert (found["a_demand"] == 10.0).all()  # wired to nothing
    inner = codegen.logged_inputs(loop, "ctl.law", log)
    np.testing.assert_array_equal(inner["v_s"], log["plant.wheel.v_s"].values)
    np.testing.assert_array_equal(inner["T_eq"], log["ctl.equivalent.T_eq"].values)
    assert codegen.logged_params(loop, "ctl", log)["law.k1"] == 20.0
    with pytest.raises(BadInput, match="has no part 'ctrl'; did you mean 'ctl'"):
        codegen.logged_inputs(loop, "ctrl", log)
    with pytest.raises(BadInput, match=r"plant\.wheel\.v, which was not logged"):
        codegen.logged_inputs(loop, "ctl", log.drop_vars("plant.wheel.v"))


@needs_compiler
def test_no_local_has_the_name_of_a_counter(tmp_path: Path) -> None:
    """A Function calls an argument ``i``, and a loop counts beside it: gcc refuses a shadow."""
    v, i = ca.SX.sym("v", 3), ca.SX.sym("i")
    peak = ca.Function("peak", [v, i], [ca.sin(v * i)], ["v", "i"], ["g"])
    V, s = ca.MX.sym("V", 3), ca.MX.sym("s")
    h = ca.fmin(ca.fmax(s, 0.5), 2.0)
    g = peak(V, h)
    outer = ca.Function("outer", [V, s], [g.T @ (V @ V.T) @ g / h])

    def body(x: Any, u: Any, p: Any) -> Any:
        return {}, {"y": outer(u["u"], u["s"]) + outer(2 * u["u"], u["s"])}

    block = make_block(
        "counted", "law", body, sx=False, doc="A quadratic form.",
        inputs=[Input("1", shape=(3,)).named("u"), Input("1").named("s")],
        outputs=[Output("1").named("y")],
    )  # fmt: skip
    codegen.c_module(block, tmp_path, "m").compile()
    assert "peak(" in of_folder(tmp_path, "m")
