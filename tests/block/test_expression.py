"""Expressions in text: they give what Python's floats give, and nothing but arithmetic is read."""

from __future__ import annotations

import math
import time
from pathlib import Path

import casadi as ca
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from slipctl.block.text.expression import DEEPEST, LONGEST, read
from slipctl.errors import BadInput, Faults

NAMES = {"x": "x", "y": "y", "v_s": "v_s"}
ORACLE = {
    **{n: getattr(math, n) for n in ("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos",
       "atan", "atan2", "sinh", "cosh", "tanh", "fmod", "floor", "ceil", "fabs", "pi")},
    "abs": abs, "min": min, "max": max, "fmin": min, "fmax": max,
    "sign": lambda x: (x > 0) - (x < 0),
    "clip": lambda x, lo, hi: min(max(x, lo), hi),
    "__builtins__": {},
}  # fmt: skip


def _wider(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pair = st.tuples(inner, inner)
    truth = st.one_of(
        st.tuples(inner, st.sampled_from(["<", "<=", ">", ">=", "==", "!="]), inner).map(" ".join),
        st.tuples(inner, inner, inner).map(lambda t: f"{t[0]} < {t[1]} <= {t[2]}"),
    )
    both = st.tuples(truth, st.sampled_from(["and", "or"]), truth).map(" ".join)
    condition = st.one_of(truth, both, truth.map("not ({})".format))
    return st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "**"]), inner).map(
            lambda t: f"({t[0]} {t[1]} {t[2]})"
        ),
        inner.map("-({})".format),
        st.tuples(st.sampled_from(["exp", "log", "sqrt", "sin", "cos", "atan", "tanh", "abs",
                                   "sign", "floor", "ceil"]), inner).map("{0[0]}({0[1]})".format),
        st.tuples(st.sampled_from(["min", "max", "atan2", "fmod"]), pair).map(
            lambda t: f"{t[0]}({t[1][0]}, {t[1][1]})"
        ),
        st.tuples(inner, inner, inner).map("clip({0[0]}, {0[1]}, {0[2]})".format),
        st.tuples(inner, condition, inner).map("({0[0]} if {0[1]} else {0[2]})".format),
    )  # fmt: skip


LEAVES = st.one_of(
    st.sampled_from(["x", "y", "v_s", "pi"]),
    st.floats(0, 8).map(lambda v: repr(round(v, 3))),
    st.integers(0, 9).map(str),
)
EXPRESSIONS = st.recursive(LEAVES, _wider, max_leaves=12)


@given(EXPRESSIONS, st.lists(st.floats(-8, 8), min_size=3, max_size=3))
def test_same_bits_as_python(text: str, numbers: list[float]) -> None:
    """Each node is one operation of C, as Python's own is: the bits agree."""
    values = dict(zip(NAMES, numbers, strict=True))
    try:
        expected = eval(text, dict(ORACLE), values)
    except (ArithmeticError, ValueError, TypeError):
        expected = math.nan
    usable = not isinstance(expected, complex) and math.isfinite(expected)
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)  # x*x for x**2 is another rounding
    try:
        symbols = {n: ca.SX.sym(n) for n in NAMES}
        try:
            tree = read(text)
        except Faults:
            assume(not usable)
            return
        f = ca.Function("f", list(symbols.values()), [ca.SX(tree.value(symbols))])
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)
    assume(usable)
    assert float(f(*numbers)) == expected


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("__import__('os').system('touch made')", "column 1: a name has no dot here"),
        ("().__class__.__bases__[0]", "column 1: an index has no place here"),
        ("open('made', 'w')", "column 1: there is no function open"),
        ("eval('1')", "there is no function eval"),
        ("(lambda: x)()", "lambda has no place"),
        ("[x for x in y]", "have a place here"),
        ("{x: 1}", "have a place here"),
        ("(y := 3)", ":= has no place"),
        ("x.y", "a name has no dot here"),
        ("x[0]", "an index has no place here"),
        ("'a' * x", "column 1: 'a' is no number"),
        ("f'{x}'", "a text has no place here"),
        ("True", "is no number"),
        ("1j", "is no number"),
        ("1e999", "no finite number"),
        ("9**9**9**9", "no finite number"),
        ("1 / (2 - 2)", "no finite number"),
        ("(-8)**(1/3)", "no finite number"),
        ("exp(1000)", "no finite number"),
        ("x ^ 2", "column 1: ^ is no power here; write **"),
        ("x % 2", "write fmod(a, b)"),
        ("x if y else 2", "column 6: a condition is a comparison, such as x > 0"),
        ("x is y", "compare with <"),
        ("1,5*x", "a number has a decimal point"),
        ("exq(x)", "did you mean 'exp'?"),
        ("sin(x, y)", "write sin(x)"),
        ("exp(x=1)", "exp takes no names"),
        ("min(x)", "write min(a, b, ...)"),
        ("exp + 1", "exp is a function; write exp(x)"),
        ("interp(x, [0, 0], [1, 2])", "must increase"),
        ("interp(x, [0, 1], [1])", "equally long"),
        ("one('m/ss') * x", "did you mean 's'?"),
        ("µ * x", "column 1"),
        ("x * (", "column"),
        ("2 x", "column 3: write * for a product, at 'x'"),
        ("x (2 + 1) y", "write * for a product"),
        ("exp(\u2212x)", "column 5: '\\u2212' is no letter of a name or a number here; write -"),
        ("", "there is no expression"),
        ("(" * 400 + "x" + ")" * 400, "nested"),
        ("-" * 1000 + "x", f"nested more than {DEEPEST} deep"),
        ("x" * (LONGEST + 1), "at most"),
        ("9" * 1900, "no finite number"),
        ("x\x00", "is no letter"),
    ],
)
def test_refused(text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is no arithmetic is told with its column, and nothing of it happens."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Faults) as told:
        read(text)
    assert said in str(told.value)
    assert not list(tmp_path.iterdir())


def test_all_faults_at_once() -> None:
    """Four mistakes are four lines in the order in which they stand."""
    with pytest.raises(Faults) as told:
        read("x^2 + y % 3 + foo(2) + sin(1, 2)")
    assert [line.partition(":")[0] for line in told.value.lines] == [
        "column 1", "column 7", "column 15", "column 24",
    ]  # fmt: skip


@given(st.one_of(
    st.text(max_size=60),
    st.text("xy09.+-*/()[]{}'\"<>=!,:;@^%~&|\\ \n\t_if else not and or lambda", max_size=200),
    st.tuples(EXPRESSIONS, st.text(max_size=8), st.integers(0, 40)).map(
        lambda t: t[0][: t[2]] + t[1] + t[0][t[2] :]),
))  # fmt: skip
def test_hostile_text(text: str) -> None:
    """Whatever is typed is read or told within two seconds, never a traceback."""
    begun = time.process_time()
    try:
        tree = read(text)
        tree.value({n: ca.SX.sym("n") for n in tree.names})
    except BadInput:
        pass  # told
    assert time.process_time() - begun < 2.0


def test_interpolation() -> None:
    """Straight lines between the points and the ends held, as numpy.interp has it."""
    import numpy as np

    tree = read("interp(x, [0, 1, 4], [2, 5, -1])")
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [tree.value({"x": x})])
    at = np.linspace(-2, 6, 33)
    # 1e-14: one rounding of each of three terms of size 5
    assert np.allclose([float(f(v)) for v in at], np.interp(at, [0, 1, 4], [2, 5, -1]), atol=1e-14)
