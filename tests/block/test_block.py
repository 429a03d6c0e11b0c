"""A block is one definition: called, a CasADi Function, exactly differentiated, all the same."""

import cmath
import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    differential_evolution,
    every,
    flow,
    law,
    make_block,
    sampled,
    simulate,
    step,
)
from slipctl.block.block import doc_of_maker
from slipctl.block.text.failures import failures_of
from slipctl.ccode.codegen import c_module
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.huang_2020 import subway_braking_control as control

ROUNDING = 1e-13
"""Relative: CasADi may reorder and share operations, a few units in the last place each."""

NUMBER = st.floats(-3, 3).map(lambda v: round(v, 6))


# ---- three ways to one number -------------------------------------------------------------------

Tree = tuple
UNARY = ("sin", "tanh", "atan", "exp(-x^2)", "sqrt(1+x^2)", "neg", "sq")
BINARY = ("add", "sub", "mul", "div", "ratio")


def trees() -> st.SearchStrategy[Tree]:
    """Random smooth expressions of a, b, c without poles near the numbers that are tried."""
    leaves = st.one_of(st.sampled_from("abc"), NUMBER)
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(st.sampled_from(UNARY), inner),
            st.tuples(st.sampled_from(BINARY), inner, inner),
        ),
        max_leaves=12,
    )


def evaluated(tree, values, m):
    """Value of a tree with the functions of module ``m`` (CasADi, math or cmath)."""
    if isinstance(tree, str):
        return values[tree]
    if isinstance(tree, float):
        return tree
    op, *args = tree
    a, *rest = (evaluated(t, values, m) for t in args)
    match op:
        case "sin" | "tanh" | "atan":
            return getattr(m, op)(a)
        case "exp(-x^2)":
            return m.exp(-a * a)
        case "sqrt(1+x^2)":
            return m.sqrt(1 + a * a)
        case "neg":
            return -a
        case "sq":
            return a**2
        case "add":
            return a + rest[0]
        case "sub":
            return a - rest[0]
        case "mul":
            return a * rest[0]
        case "div":
            return a / 7.0 - rest[0] / 3.0
    return a / (2 + rest[0] * rest[0])


def block_of(tree, sx=True) -> Block:
    return make_block(
        "b", "step", lambda x, u, p: (x, {"y": evaluated(tree, {**x, **u, **p}, ca)}),
        states=[State("1", 0.5).named("a")], inputs=[Input("1").named("b")],
        params=[Param("1", 1.0).named("c")], outputs=[Output("1").named("y")], sx=sx,
    )  # fmt: skip


class smath:  # noqa: N801
    """cmath with the one function it names otherwise."""

    sin, tanh, atan, exp, sqrt = cmath.sin, cmath.tanh, cmath.atan, cmath.exp, cmath.sqrt


@given(trees(), NUMBER, NUMBER, NUMBER)
def test_call_function_and_plain_python_agree(tree, a, b, c):
    """One body: with numbers, as CasADi Function (SX and MX), in plain floats."""
    plain = evaluated(tree, {"a": a, "b": b, "c": c}, math)
    for sx in (True, False):
        block = block_of(tree, sx)
        _, out = block(a=a, b=b, c=c)
        named = block.function()(x_a=a, u_b=b, p_c=c)
        assert out["y"] == pytest.approx(plain, rel=ROUNDING, abs=ROUNDING)
        assert float(named["y_y"]) == pytest.approx(out["y"], rel=ROUNDING, abs=ROUNDING)
        assert float(block.f(a, b, c)[1]) == out["y"]
        assert float(named["n_a"]) == a


@given(trees(), NUMBER, NUMBER, NUMBER)
def test_jacobian_is_exact(tree, a, b, c):
    """Against the complex step, which is exact to rounding: Im f(x + ih)/h with h = 1e-30."""
    block = block_of(tree)
    J = np.array(block.jacobian("y", ["a", "b", "c"])(a, b, c).full()).ravel()
    at = {"a": a, "b": b, "c": c}
    for k, name in enumerate("abc"):
        shifted = evaluated(tree, at | {name: at[name] + 1e-30j}, smath)
        slope = complex(shifted).imag / 1e-30
        assert J[k] == pytest.approx(slope, rel=1e-11, abs=1e-11)  # up to 12 chained roundings


@given(st.floats(0, 12), st.floats(0.02, 1.2), st.floats(0.2, 1), st.floats(1.05, 2.5))
def test_adhesion_law_and_its_slopes(v_s, c, a, ratio):
    """double_exponential against its formula and the derivatives taken by hand."""
    b = a * ratio
    law_ = subway.double_exponential
    ea, eb = math.exp(-a * v_s), math.exp(-b * v_s)
    assert law_(v_s=v_s, c=c, a=a, b=b)["mu"] == pytest.approx(c * (ea - eb), rel=1e-12, abs=1e-15)
    J = law_.jacobian("mu", ["v_s", "c", "a", "b"])(v_s, c, a, b)
    by_hand = [c * (b * eb - a * ea), ea - eb, -c * v_s * ea, c * v_s * eb]
    assert np.array(J).ravel() == pytest.approx(by_hand, rel=1e-12, abs=1e-14)


def test_wheelset_against_plain_python():
    """Right-hand side of (5)-(9), written once more in plain Python, on random states."""
    rng = np.random.default_rng(1)
    wheel = subway.wheelset()
    for _ in range(50):
        v, omega, T_b, mu = rng.uniform([0, 0, 0, 0], [40, 80, 2e4, 0.4])
        m, J, r = rng.uniform([4e3, 50, 0.3], [2e4, 500, 0.6])
        F = mu * m * 9.81
        d, y = wheel(v=v, omega=omega, T_b=T_b, mu=mu, f=100.0, W=50.0, m=m, J=J, r=r)
        fade = min(1.0, omega / 0.1)
        assert d["v"] == pytest.approx(-(F + 150) / m, rel=ROUNDING)
        assert d["omega"] == pytest.approx((r * F - T_b * fade) / J, rel=1e-11)  # a difference
        assert y["v_s"] == pytest.approx(v - r * omega, rel=1e-11, abs=1e-14)
        assert (d["x"], d["phi"], y["F_a"]) == pytest.approx((v, omega, F), rel=ROUNDING)


@pytest.mark.parametrize("sx", [True, False])
@pytest.mark.parametrize(
    ("text", "depends"),
    [
        ("sign(u)", True), ("floor(u)", True), ("u > 0", True), ("if_else(u > 0, 1, 2)", True),
        ("if_else(x > 0, u, 2)", True), ("fmod(u, 1)", True), ("logic_and(u > 0, x > 0)", True),
        ("0*u + x", False), ("x**2", False), ("3.0 + 0*x", False),
    ],
)  # fmt: skip
def test_feedthrough_sees_jumps_too(text, depends, sx):
    """Dependence is by structure: a jump has slope 0 and yet needs its argument first."""

    def body(x, u, p):
        names = {k: getattr(ca, k) for k in ("sign", "floor", "if_else", "fmod", "logic_and")}
        return x, {"y": eval(text, {**names, "x": x["x"], "u": u["u"]})}

    block = make_block(
        "b", "step", body, states=[State("1").named("x")], inputs=[Input("1").named("u")],
        outputs=[Output("1").named("y")], sx=sx,
    )  # fmt: skip
    assert block.feedthrough() == {"y": ["u"] if depends else []}


# ---- values: derived, started, changed, refused -------------------------------------------------


@flow(energy=Output("J"), name="body")
def moving_body(
    v=State("m/s", "v_0"),
    omega=State("rad/s", "v / r"),
    m=Param("kg", 100.0, lo=1),
    r=Param("m", 0.5, lo=0.1),
    J=Param("kg m^2", "m * r**2 / 2", lo=0.01, hi=1e4),
    I=Param("kg m^2", "J + sqrt(m)**2 * r**2"),
    v_0=Param("m/s", 10.0),
):
    """Disc that rolls; J and I are derived, and I needs J first."""
    return dict(v=-v, omega=-omega), dict(energy=m * v**2 / 2 + J * omega**2 / 2 + 0 * I)


def wrapped(block: Block) -> dict[str, tuple[Block, str]]:
    """The block alone, sampled, every third tick, inside a composite, and all of that at once."""
    slow = every(sampled(block, 0.03, "euler"), 3)
    car = connect("car", {}, body=block)
    return {
        "alone": (block, ""),
        "sampled": (sampled(block, 0.01), ""),
        "every": (slow, ""),
        "composite": (car, "body."),
        "nested": (connect("train", {}, car=car, other=block), "car.body."),
        "sampled composite": (sampled(car, 0.01), "body."),
        "composite of every": (connect("car", {}, body=slow), "body."),
        "every of sampled composite": (every(sampled(car, 0.02), 2), "body."),
    }


@pytest.mark.parametrize("how", wrapped(moving_body))
def test_derived_parameters_and_starts_follow_everywhere(how):
    """J = m r^2/2, I = J + m r^2, omega = v/r: declared, after with_params, and after a start."""
    block, at = wrapped(moving_body)[how]
    for changes in ({}, {"m": 40.0}, {"r": 0.3, "v_0": 6.0}):
        changed = block.with_params(**{at + k: v for k, v in changes.items()})
        want = {"m": 100.0, "r": 0.5, "v_0": 10.0} | changes
        J = want["m"] * want["r"] ** 2 / 2
        p, x = changed.param_values(), changed.start()
        assert p[at + "J"] == pytest.approx(J, rel=ROUNDING)
        assert p[at + "I"] == pytest.approx(J + want["m"] * want["r"] ** 2, rel=ROUNDING)
        assert x[at + "omega"] == pytest.approx(want["v_0"] / want["r"], rel=ROUNDING)
        assert changed.start(**{at + "v": 3.0})[at + "omega"] == pytest.approx(3 / want["r"])
    assert block.param_values()[at + "m"] == 100.0  # the block itself is as it was


@pytest.mark.parametrize("how", wrapped(moving_body))
def test_values_out_of_range_are_refused_everywhere(how):
    """Bad parameters end in one line with the name, the value and the range."""
    block, at = wrapped(moving_body)[how]
    for value, words in (
        (-1.0, "= -1 kg is out of range; it must lie in \\[1, inf\\] kg"),
        (math.nan, "is NaN"),
        (math.inf, "is infinite"),
        ("ten", "uses 'ten'"),
        ("2 *", "is not an expression"),
        ("1 / (2 - 2)", "cannot be computed"),
        ([1.0, 2.0], "takes a number"),
        (None, "is NaN"),
    ):
        with pytest.raises(BadInput, match=words):
            block.with_params(**{at + "m": value}).param_values()
    with pytest.raises(BadInput, match="is derived, m \\* r\\*\\*2 / 2; set m or r"):
        block.with_params(**{at + "J": 3.0})
    with pytest.raises(BadInput, match="out of range"):
        block.with_params(**{at + "m": 1e6}).param_values()  # J = 125 000 kg m^2 > 1e4
    with pytest.raises(BadInput, match="has no parameter"):
        block.with_params(**{at + "q": 3.0})


@pytest.mark.parametrize("wrong", [{"m": "ten"}, {"m": -1.0}, {"r": "ten"}])
@pytest.mark.parametrize("more", [{}, {"v_0": 3.0}, {"v_0": "2 * r"}])
def test_a_value_that_is_refused_is_refused_beside_others(wrong, more):
    """A number or an expression, in whatever order they are given."""
    block, at = wrapped(moving_body)["alone"]
    for values in (wrong | more, more | wrong):
        with pytest.raises(BadInput, match=f"{next(iter(wrong))} "):
            block.with_params(**{at + n: v for n, v in values.items()})


def test_derived_values_that_go_in_a_circle_are_named():
    params = [Param("1", "c + 1").named("b"), Param("1", "b").named("c")]
    circle = make_block("circle", "law", lambda x, u, p: ({}, {}), params=params)
    with pytest.raises(BadInput, match="depends on itself"):
        circle.param_values()


def test_vector_parameters_may_be_derived_by_functions():
    block = make_block(
        "b", "law", lambda x, u, p: ({}, {"y": p["w"]}),
        outputs=[Output("1", shape=(2,)).named("y")],
        params=[Param("1", [0.0, 1.0], shape=(2,)).named("a"),
                Param("1", "2 * exp(a)", shape=(2,)).named("w")],
    )  # fmt: skip
    assert block()["y"] == pytest.approx([2.0, 2 * math.e], rel=ROUNDING)


def test_start_expressions_take_the_numbers_of_the_call():
    """wheelset(v=10) is a rolling wheel at 10 m/s, not one that turns as at 20 m/s."""
    wheel = subway.wheelset()
    assert wheel(v=10.0, T_b=0, mu=0)[1]["v_s"] == 0.0
    assert wheel(r=0.4, T_b=0, mu=0)[1]["v_s"] == pytest.approx(0.0, abs=1e-14)


def test_results_keep_their_shape_and_order():
    """Matrices by rows as numpy writes them, whoever gives them; what does not fit is refused."""
    A = np.array([[1.0, 2], [3, 4]])
    X = np.arange(6.0).reshape(2, 3)

    def block(body):
        return make_block("b", "step", body, states=[State("1", 0.0, shape=(2, 3)).named("X")],
                          params=[Param("1", [[1, 2], [3, 4]], shape=(2, 2)).named("A")],
                          outputs=[Output("1").named("y")])  # fmt: skip

    product = block(lambda x, u, p: ({"X": p["A"] @ x["X"]}, {"y": np.float64(3)}))
    for given_ in (X, X.tolist()):
        n, y = product(X=given_)
        assert (n["X"] == A @ X).all()
        assert y == {"y": 3.0}
    with pytest.raises(BadInput, match=r"has shape \(3, 2\), declared \(2, 3\)"):
        block(lambda x, u, p: ({"X": x["X"].T}, {"y": 0}))(X=X)


def test_renamed_blocks_keep_their_name():
    car = connect("car", {}, body=moving_body)
    slow = every(sampled(car, 0.01), 2)
    for block, name in ((sampled(moving_body, 0.01), "m"), (car, "body.m"), (slow, "body.m")):
        other = block.renamed("other")
        assert other.with_params(**{name: 50.0}).name == "other"
        assert block.name != "other"
    assert car.renamed("other").swap("body", moving_body).name == "other"


# ---- what cannot be a block ---------------------------------------------------------------------


def rolling(**outputs):
    """Call a flow of two states that returns one, and an output y."""
    body = lambda x=State("1"), y=State("1"): ({"x": x}, {"y": x})  # noqa: E731
    return flow(name="b", **outputs)(body)()


def one_law(body):
    """Function of a law with one input."""
    return law(y=Output("1"), name="b")(lambda x=Input("1"): body(x)).function()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: law(name="b")(lambda u: u), "argument 'u' needs a default"),
        (lambda: law(z=Output("1"), name="b")(lambda u=Input("1"): {"y": u})(u=1),
         "b does not return its output 'z'"),
        (lambda: rolling(y=Output("1")), "b does not return its derivative 'y'"),
        (lambda: law(name="b")(lambda x=State("1"): x), "is a law and cannot have states"),
        (lambda: law(y=Input("1")), "must be an Output"),
        (lambda: law(unit="m"), "not unit='m'"),
        (lambda: step(period=0.0), "must be positive"),
        (lambda: make_block("a.b", "law", None), "a block's name must be"),
        (lambda: make_block("jac", "law", None), "CasADi keeps that name"),
        (lambda: make_block("b", "law", len, params=[Param("kg", -1.0, lo=0).named("m")]),
         "b.m = -1 kg is out of range"),
        (lambda: make_block("b", "law", len, params=[Param("1").named("m")]).param_values(),
         "b.m has no value"),
        (lambda: subway.double_exponential(), r"needs the input v_s \[m/s\]"),
        (lambda: subway.double_exponential(vs=1), "has no signal 'vs'; did you mean 'v_s'?"),
        (lambda: subway.double_exponential.jacobian("nu", "v_s"), "'nu'; it has mu"),
        (lambda: subway.double_exponential.jacobian("mu", "vs"), "did you mean 'v_s'?"),
        (lambda: control.super_twisting(form="printed"), "it has consistent, printed-38"),
        (lambda: subway.double_exponential(v_s=[1, 2]), r"double_exponential.v_s takes a number"),
        (lambda: subway.wheelset()(v="fast"), "wheel.v takes a number in m/s, not 'fast'"),
        (lambda: one_law(lambda x: math.exp(x)), "b gives NaN whatever the numbers"),
        (lambda: one_law(lambda x: 2 * x + float(x)), "from casadi import exp"),
        (lambda: one_law(lambda x: x if x > 0 else -x), r"b, line \d+: if, and, or, max"),
        (lambda: one_law(lambda x: max(x, 0)), "fmax and fmin of casadi"),
        (lambda: law(y=Output("1", positive="up"), name="b"), "no sign convention 'up'; it has b"),
        (lambda: law(y=Output("1", per="percent"), name="b"), "no slip convention 'percent'"),
        (lambda: law(y=Output("yards"), name="b")(lambda u=Input("yardz"): u).check_units(),
         "b.u: unit 'yardz' cannot be read"),
        (lambda: connect("loop", {}, ctl=control.super_twisting),
         "loop: ctl is no block but of type function; call it, if it makes one"),
        (lambda: connect("loop", {}, ctl=5), "loop: ctl is no block but of type int; @law"),
        (lambda: sampled("car", 1e-3), "is no block but of type str"),
        (lambda: sampled(subway.wheelset(), "1 ms"), "h takes a number in s, not '1 ms'"),
        (lambda: simulate("car", Scenario("base", 1.0)), "the loop is no block"),
        (lambda: simulate(sampled(subway.wheelset(), 1e-3), "base"),
         "'base' is no scenario; write Scenario"),
        (lambda: connect("loop", ["a.T_b", "b.T"], a=subway.wheelset()),
         "loop: wires name a source by destination"),
        (lambda: c_module(subway.double_exponential, None), "folder to write is None; write its"),
        (lambda: one_law(lambda x: "text"), "b returns 'text' as output 'y'; return an"),
        (lambda: subway.wheelset().with_params(m="heavy"),
         "wheel.m takes a number in kg or an expression; 'heavy' uses 'heavy'; it has"),
        (lambda: subway.wheelset().with_params(omega="v / R"), "uses 'R'; did you mean 'r'"),
        (lambda: law(y=Output("1"), name="b", conditions={"dry": {"C": 1.0}})(lambda u=Input("1"),
         c=Param("1"): u * c), "b: condition 'dry' sets 'C'; did you mean 'c'"),
        (lambda: law(name="b", conditions={"dry": 1.0})(lambda: 0), "b: conditions are values by"),
        (lambda: law(y=Output("1"), name="b", conditions={"dry": {"c": -1.0}})(lambda u=Input("1"),
         c=Param("1", lo=0): u * c), "b: condition 'dry': c = -1 is out of range"),
        (lambda: connect("loop", {}, a=subway.wheelset()).swap("a", None), "the new a is no block"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_block_is_said_in_one_line(make, words):
    with pytest.raises(BadInput, match=words) as error:
        make()
    assert "\n" not in str(error.value)


def test_what_breaks_in_equations_is_told_in_its_own_words():
    @law(y=Output("1", "out"))
    def broken(u=Input("1", "in")):
        raise RuntimeError("too deep")

    with pytest.raises(RuntimeError, match="too deep"):
        broken(u=1.0)


def test_failures_that_a_part_declares_are_told_with_its_numbers():
    """Of a rate the time; of several the largest; of parts that are alike once."""
    said = [("a {n} b", "after {T}", "in {1/rate}", "{row}", "-")]

    @step(period=0.1, failures=said)
    def safe(
        k=State("1", 0.0), n=Param("1", 3.0), T=Param("s", 0.25), rate=Param("1/s", 4.0),
        row=Param("m", (1.0, 7.0), shape=(2,)),
    ):  # fmt: skip
        return dict(k=k + n * T * rate * row[0]), {}

    wanted = ("a 3 b", "after 0.25 s", "in 0.25 s", "7 m", "-")
    assert failures_of(connect("loop", {}, one=safe, two=safe)) == [wanted]
    slow = safe.with_params(T=2.0)
    assert failures_of(connect("loop", {}, one=safe, two=slow)) == [
        wanted, ("a 3 b", "after 2 s", *wanted[2:])]  # fmt: skip


def test_a_block_says_of_itself_what_its_maker_says_without_the_arguments() -> None:
    def made(gain: float) -> Block:
        """Make a gain.

        It only multiplies.

        Args:
            gain: the number.
        """
        raise NotImplementedError

    assert doc_of_maker(made) == "Make a gain.\n\nIt only multiplies."
    seek = differential_evolution(subway.double_exponential, "v_s", lo=0.01, hi=10.0)
    assert seek.doc
    assert "Args:" not in seek.doc


@step(period=0.1, y=Output("1", "doubled", safe=1.0, lo=-9, hi=9))
def doubling(u=Input("1", "given"), k=Param("1", 2.0, "gain", lo=0, hi=5)):
    """A gain."""
    return {}, dict(y=k * u)


def test_numbers_that_are_asked_for_are_the_asker_s_own() -> None:
    found = doubling.param_values()
    found["k"] += 1.0
    assert doubling.param_values()["k"] == 2.0
    other = doubling.with_params(k=3.0)
    assert (other.param_values()["k"], doubling.param_values()["k"]) == (3.0, 2.0)


def test_a_signal_is_checked_anew_where_its_number_or_range_is_another() -> None:
    k, u, y = doubling.params["k"], doubling.inputs["u"], doubling.outputs["y"]
    body = doubling.expr
    Block("again", "step", body, [u, k.named("k"), y], period=0.1)
    for wrong in (k.valued(7.0), replace(k, lo=3.0)):
        with pytest.raises(BadInput, match="out of range"):
            Block("again", "step", body, [u, wrong, y], period=0.1)
    with pytest.raises(BadInput, match="safe value"):
        Block("again", "step", body, [u, k, replace(y, safe=10.0)], period=0.1)
