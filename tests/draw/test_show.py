"""Showing blocks: formulas that mean what was computed, tables, differences, drawings."""

import functools
import math
import re
from xml.etree import ElementTree

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    Input,
    Noise,
    Output,
    Param,
    State,
    connect,
    flow,
    law,
    make_block,
    one,
    sampled,
    step,
    unit_delay,
)
from slipctl.block.smooth import root
from slipctl.block.text import formula
from slipctl.block.text.plain_text import Text, cut
from slipctl.draw import show
from slipctl.draw.typeset import Latex, letter


@flow(v_s=Output("m/s", "slip speed", positive="braking", per="speed"))
def wheelset(
    v=State("m/s", 20.0, "vehicle speed", lo=0),
    omega=State("rad/s", "v / r", "wheel speed"),
    T_b=Input("N m", "brake torque", positive="braking"),
    mu=Input("1", "adhesion coefficient", lo=0, hi=0.6),
    m=Param("kg", 8000.0, "load on the wheel", "Table 3", lo=1000, hi=40000),
    J=Param("kg m^2", 240.0, "wheel inertia", "Table 3", lo=1),
    r=Param("m", 0.5, "wheel radius", "Table 3"),
    g=Param("m/s^2", 9.81, "gravity"),
):
    """Braked wheel and the mass it carries."""
    F_a = mu * m * g
    return {"v": -F_a / m, "omega": (r * F_a - T_b) / J}, {"v_s": v - r * omega}


@law(mu=Output("1", "adhesion"), conditions={"dry": {"c": 1.0}, "ice": {"c": 0.1}})
def curve(
    v_s=Input("m/s", "slip speed"),
    c=Param("1", 1.0, "height"),
    a=Param("s/m", 0.54, "decay"),
    b=Param("s/m", 1.2, "decay"),
):
    """Two exponentials."""
    return c * (ca.exp(-a * v_s) - ca.exp(-b * v_s))


def controller(form="consistent"):
    @step(T_b=Output("N m", "torque"), name="ctl", choices={"form": form})
    def ctl(
        u=State("m/s^2", 0.0, "integral"),
        s=Input("m/s", "sliding variable"),
        jitter=Noise(),
        k1=Param("m^.5/s^1.5", 20.0, "gain"),
        k2=Param("m/s^3", 10.0, "gain", lo=0),
        J=Param("kg m", 480.0, "inertia over radius"),
        T=Param("s", 1e-3, "period"),
    ):
        """Super-twisting."""
        rooted = root(s) if form == "consistent" else s * one("s^.5/m^.5", "printed form")
        nu = u - k1 * rooted
        return {"u": u - T * k2 * ca.sign(s)}, {"T_b": J * nu}

    return ctl


def loop():
    world = connect(
        "plant",
        {"wheel.T_b": "T_cmd", "adh.v_s": "wheel.v_s", "wheel.mu": "adh.mu", "v": "wheel.v"},
        wheel=wheelset,
        adh=curve,
    )
    return connect(
        "loop",
        {"ctl.s": "plant.wheel.v_s", "plant.T_cmd": "hold.y", "hold.u": "ctl.T_b"},
        plant=sampled(world, 1e-3, "rk4"),
        ctl=controller(),
        hold=unit_delay("N m"),
    )


# ---- formulas ---------------------------------------------------------------------------------


def written(expression, names=None):
    g = formula.graph({"y": expression}, names)
    return Text(g).root(g.roots["y"][0])


x, y, z = (ca.SX.sym(n) for n in "xyz")


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (x / 2, "x/2"),
        (2 * x * y, "2*x*y"),
        (x**4, "x^4"),
        (x**1.5, "x^1.5"),
        (x**-2, "1/x^2"),
        (-(x + y) * z, "-(x + y)*z"),
        (x - (y - z), "x - y + z"),
        (x / (y / z), "x/(y/z)"),
        (x / y / z, "x/(y*z)"),
        ((x + y) / (x - z), "(x + y)/(x - z)"),
        (ca.if_else(x > y, x, 3), "x if y < x else 3"),
        (ca.if_else(x > 0, y, ca.if_else(x < -1, z, 0)), "y if x > 0 else z if x < -1 else 0"),
        (2 * ca.if_else(x > 0, y, z), "2*(y if x > 0 else z)"),
        (ca.sqrt(ca.fabs(x)) * ca.sign(x), "sqrt(abs(x))*sign(x)"),
        (ca.log10(x), "log10(x)"),
        (2 * math.pi * x / 100, "2*pi*x/100"),
        (x / (2 * math.pi), "x/(2*pi)"),
        (ca.logic_and(x > 0, y <= 1), "x > 0 and y <= 1"),
        (ca.logic_not(ca.logic_and(x > 0, y <= 1)), "not (x > 0 and y <= 1)"),
        (ca.logic_not(x < y), "x >= y"),
        (ca.logic_or(ca.logic_and(x > 0, y > 0), ca.logic_not(z)), "(x > 0 and y > 0) or (not z)"),
        (ca.if_else(ca.logic_not(x), y, z), "y if not x else z"),
        ((x + y) ** -z, "(x + y)^(-z)"),
        (2**x, "2^x"),
        (2 * ca.fmin(x, y), "2*min(x, y)"),
        (x * (y - z) / 2, "x*(y - z)/2"),
        (-2.5e7 * x, "-2.5e7*x"),
        (ca.SX(0), "0"),
    ],
)
def test_formulas_are_written_as_a_person_would(expression, text):
    assert written(expression) == text


def grown(choose, depth):
    """A random expression of x, y, z without poles."""
    if depth == 0:
        return choose([x, y, z, x, ca.SX(2.0), ca.SX(0.25), ca.SX(-3.0)])
    a = grown(choose, depth - choose([1, 1, 2]) if depth > 1 else 0)
    b = grown(choose, depth - 1)
    return choose(
        [
            lambda: a + b,
            lambda: a - b,
            lambda: a * b,
            lambda: a / (2 + b**2),
            lambda: 1 / (1 + a**2),
            lambda: -a,
            lambda: 2 * a,
            lambda: a**2,
            lambda: ca.fabs(a) ** 1.5,
            lambda: ca.sqrt(1 + a**2),
            lambda: ca.fmin(a, b),
            lambda: ca.fmax(a, b) * a,
            lambda: ca.if_else(a < b, a, b),
            lambda: ca.if_else(ca.logic_or(a < 0, b >= 1), a, ca.if_else(b > 0, b, 1)),
            lambda: ca.logic_not(a < b) * b,
            lambda: ca.sign(a) * ca.tanh(b),
            lambda: ca.exp(-(a**2)),
            lambda: a / b if not b.is_constant() else a,
        ]
    )()


MEANING = {n: getattr(math, n) for n in ("sqrt", "exp", "tanh", "log10", "pi")} | {
    "abs": abs, "min": min, "max": max, "sign": lambda v: (v > 0) - (v < 0),
}  # fmt: skip


@given(st.data(), st.integers(1, 5))
def test_text_means_what_was_computed(data, depth):
    def choose(items):
        return items[data.draw(st.integers(0, len(items) - 1))]

    expression = grown(choose, depth)
    g = formula.graph({"y": expression})
    formula.shorten(g, long=data.draw(st.sampled_from([4, 12, 60])))
    point = {n: data.draw(st.sampled_from([-1.7, -0.3, 0.4, 1.1, 2.9])) for n in "xyz"}
    known = dict(MEANING) | point
    write = Text(g)
    write.digits = 17
    try:
        for name, n in formula.named_nodes(g):
            known[name] = eval(write.root(n).replace("^", "**"), {"__builtins__": {}}, known)
        text = write.root(g.roots["y"][0]).replace("^", "**")
        value = eval(text, {"__builtins__": {}}, known)
    except ZeroDivisionError:
        return
    wanted = float(ca.Function("f", [x, y, z], [expression])(*point.values()))
    # reordered products differ in the last digits, and cancellation enlarges that
    assert value == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@given(st.data(), st.integers(1, 5))
def test_latex_is_balanced(data, depth):
    expression = grown(lambda items: items[data.draw(st.integers(0, len(items) - 1))], depth)
    g = formula.graph({"y": expression})
    formula.shorten(g)
    text = Latex(g).root(g.roots["y"][0])
    level = 0
    for c in text:
        level += {"{": 1, "}": -1}.get(c, 0)
        assert level >= 0
    assert level == 0
    assert text.count(r"\left") == text.count(r"\right")
    assert text.count(r"\begin") == text.count(r"\end")


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("omega", r"\omega"),
        ("mu_max", r"\mu_{\mathrm{max}}"),
        ("v_s", "v_{s}"),
        ("v_s_ref", r"v_{s,\mathrm{ref}}"),
        ("F_a_hat", r"\hat{F}_{a}"),
        ("eta_inf", r"\eta_{\infty}"),
        ("k1", "k_{1}"),
        ("lambda_", r"\lambda"),
        ("car.v", r"v^{\mathrm{car}}"),
        ("theta[2]", r"\theta_{2}"),
        ("Delta", r"\Delta"),
    ],
)
def test_letters(name, latex):
    assert letter(name) == latex


def test_latex_of_equations_can_be_set():
    pytest.importorskip("matplotlib")
    from matplotlib.mathtext import MathTextParser

    parse = MathTextParser("path").parse
    for block in (wheelset, curve, controller()):
        rows = show.latex(block).split("aligned}")[1].split("\\end{")[0].split("\\\\\n")
        for row in rows:
            if "cases" not in row:
                assert parse(f"${row.replace('&', '').strip()}$").glyphs


def test_latex_of_a_wheelset():
    assert show.latex(wheelset) == (
        "$$\n\\begin{aligned}\n"
        "F_{a} &= \\mu \\, m \\, g \\\\\n"
        "\\dot{v} &= -\\frac{F_{a}}{m} \\\\\n"
        "\\dot{\\omega} &= \\frac{r \\, F_{a} - T_{b}}{J} \\\\\n"
        "v_{s} &= v - r \\, \\omega\n"
        "\\end{aligned}\n$$"
    )
    assert "_repr_latex_" in dir(wheelset)
    assert wheelset._repr_latex_() == show.latex(wheelset)
    assert r"u^{+} &= " in show.latex(controller())
    assert r"\frac{\partial \mu}{\partial v_{s}} &= " in show.latex(curve, jacobian=True)


def test_intermediate_results_keep_their_letters_but_never_a_misleading_one():
    def body():
        F = x * y
        z = F + 1  # the letter of a symbol, for something else
        a = b = F * F  # noqa: F841 - two letters for one result
        return {"p": b + ca.sin(F), "q": z * 2 + x}

    with formula.letters(body.__code__) as names:
        equations = body()
    g = formula.graph(equations | {"r": ca.SX.sym("z")}, names)
    write = Text(g)
    assert [(n, write.root(k)) for n, k in formula.named_nodes(g)] == [("F", "x*y"), ("a", "F^2")]
    assert write.root(g.roots["p"][0]) == "a + sin(F)"
    assert write.root(g.roots["q"][0]) == "2*(F + 1) + x"


@pytest.mark.parametrize(
    ("product", "told"),
    [(((x * x) * y) * y, "x^2*y^2"), ((x * y) * y * y, "x*y^3"), ((x * y) * x, "x*y*x"),
     (x * x * x * y / z / z, "x^3*y/z^2")],
)  # fmt: skip
def test_factors_that_follow_each_other_are_one_power(product, told):
    assert written(product) == told


def test_an_element_has_its_letter_whatever_the_others_are():
    """The first is a signal, the second no part of the equation."""
    row = ca.vertcat(x, ca.cos(x), ca.sin(x) * y)
    assert written(1 + row[2] * z, {"row": row}) == "1 + row[2]*z"


@pytest.mark.parametrize("t", [x, ca.if_else(x < y, x, y), -x])
def test_long_formulas_are_cut_into_pieces_and_the_profile_hook_is_given_back(t):
    """A condition is no piece, and no end of them."""
    import sys

    before = sys.getprofile()
    named = t
    for _ in range(40):
        t = t + ca.sin(t) * y
    g = formula.graph({"t": t}, {"named": named})
    formula.shorten(g)
    write = Text(g)
    pieces = [write.root(n) for _, n in formula.named_nodes(g)] + [write.root(g.roots["t"][0])]
    assert 5 < len(pieces) < 40
    assert max(map(len, pieces)) < 400
    assert sys.getprofile() is before
    assert cut("a" * 100, 40).startswith("aaa")
    assert len(cut("a" * 100, 40)) <= 40


# ---- text -------------------------------------------------------------------------------------


def test_text_of_a_block_has_its_page():
    text = show.text(wheelset)
    for line in (
        "wheelset: flow, x' = f",
        "  Braked wheel and the mass it carries.",
        "  F_a    = mu*m*g",
        "  omega' = (r*F_a - T_b)/J",
        "  v_s    = v - r*omega",
        "  d omega' / d T_b = -1/J",
    ):
        assert line in text.splitlines()
    (row,) = [r for r in text.splitlines() if r.startswith("  param   m ")]
    assert re.split(r"\s{2,}", row.strip()) == [
        "param", "m", "kg", "8000", "1000 .. 40000", "load on the wheel", "Table 3"
    ]  # fmt: skip
    assert "Jacobian" not in show.text(wheelset, jacobian=False)


def test_text_of_a_loop_goes_part_by_part():
    text = show.text(loop())
    assert "plant.wheel: Braked wheel and the mass it carries." in text
    assert "  ctl: step (form = consistent)" in text
    assert "hold.y           ->  plant.T_cmd" in text
    assert "  dry  plant.adh.c = 1" in text
    assert re.search(r"input +ctl\.jitter +1 +noise", text)
    assert "method = rk4" in text
    assert text == show.text(loop())


def test_hidden_unit_constants_and_choices_are_told():
    text = show.text(controller("printed-38"))
    assert "ctl: step, x+ = f (form = printed-38)" in text
    assert "  1 s^.5/m^.5  printed form" in text
    assert show.hidden_units(wheelset) == {}


def test_shift_registers_are_folded_to_one_line():
    def body(x, u, p):
        return {"w": ca.vertcat(x["w"][1:], u["u"])}, {"y": x["w"][0] + x["w"][3]}

    block = make_block(
        "buffer", "step", body,
        states=[State("m", 0.0, shape=(16,)).named("w")],
        inputs=[Input("m", "u").named("u")],
        outputs=[Output("m").named("y")],
    )  # fmt: skip
    text = show.text(block)
    assert "w[i]+  = w[i+1]   for i = 0 .. 14" in text
    assert show.latex(block).count("w}_{") < 12
    assert "w[15]+ = u" in text
    assert "w[16]" in text  # the table tells the shape


@pytest.mark.parametrize("sign", [1, -1])
def test_a_sum_of_elements_in_a_row_is_one_short_term(sign):
    """The first two and the last stand for all; what comes before and behind stays."""
    n = 16

    @step(y=Output("1", "mean"))
    def window(x=State("1", 0.0, "samples", shape=(n,)), u=Input("1", "input")):
        return dict(x=ca.vertcat(x[1:], u)), dict(
            y=(functools.reduce(lambda a, k: a + sign * x[k], range(n), u) + u * u) / n
        )

    s = "+" if sign > 0 else "-"
    assert f"(u {s} x[0] {s} x[1] {s} ... {s} x[15] + u^2)/16" in show.text(window)
    assert r"\dots" in show.latex(window)


def test_blocks_that_are_no_scalar_formulas_are_shown_all_the_same():
    f = ca.Function("f", [x, y], [x + y])

    def body(x, u, p):
        return {}, {"y": f.map(3)(ca.repmat(u["u"], 1, 3), ca.MX(1, 3))[0]}

    block = make_block(
        "mapped", "law", body, sx=False,
        inputs=[Input("m", "u").named("u")], outputs=[Output("m").named("y")],
    )  # fmt: skip
    assert "in matrices and loops" in show.text(block)
    assert "in matrices and loops" in show.latex(block)
    assert "no difference" in show.difference(block, block)
    assert "<svg" in show.svg(block)

    @law(y=Output("m"))
    def mapped(u=Input("m", "u")):
        """Its formula."""
        return 3 * u

    for pair in ((block, mapped), (mapped, block)):
        text = show.difference(*pair)
        assert all(f"{sign} built by a transform" in text for sign in "-+")
    both = connect("both", {"m.u": "u"}, m=block, d=curve)
    assert "in matrices and loops" in show.text(both)
    assert "mu = c*(exp(-a*v_s) - exp(-b*v_s))" in show.text(both)


def test_a_block_of_many_operations_is_cut():
    def body(x, u, p):
        t = u["u"]
        for k in range(1500):
            t = t + ca.sin(t) * (k + 1)
        return {}, {"y": t}

    block = make_block(
        "long", "law", body,
        inputs=[Input("1", "u").named("u")], outputs=[Output("1").named("y")],
    )  # fmt: skip
    text = show.text(block)
    assert len(text.splitlines()) < 100
    assert "operations in all" in text
    assert "Jacobian" not in text
    assert len(show.latex(block)) < 40000
    assert "no difference" in show.difference(block, block)


def test_numbers_of_the_table_are_exact():
    block = curve.with_params(a=0.1 + 0.2)
    assert "0.30000000000000004" in show.text(block)


# ---- difference -------------------------------------------------------------------------------


def test_nothing_differs_between_a_block_and_itself():
    assert "no difference" in show.difference(loop(), loop())
    assert "no difference" in show.difference(wheelset, wheelset)


def test_what_differs_is_told_and_nothing_else():
    changed = show.difference(controller(), controller("printed-38"))
    assert "- form = consistent" in changed
    assert "+ form = printed-38" in changed
    assert "nu" in changed
    assert "u+" not in changed
    values = show.difference(loop(), loop().with_params(**{"plant.wheel.m": 9000.0}))
    assert "param plant.wheel.m, value: 8000 -> 9000" in values
    assert "Equations" not in values


def test_a_profiler_at_work_costs_at_most_the_letters():
    """Up to Python 3.11 there is one place for a profiler; later ones do not meet."""
    import cProfile

    profile = cProfile.Profile()
    profile.enable()
    text = show.text(wheelset)
    profile.disable()
    assert "omega' = (r*mu*m*g - T_b)/J" in text or text == show.text(wheelset)


def test_letters_alone_are_no_difference():
    @law(y=Output("m"))
    def first(a=Input("m", ""), b=Input("1", "")):
        """Product."""
        inner = a * b
        return inner + a

    @law(y=Output("m"))
    def second(a=Input("m", ""), b=Input("1", "")):
        """Product."""
        return a * b + a

    text = show.difference(first, second.renamed("first"))
    assert "Equations" not in text


def test_equations_behind_one_that_is_the_same_are_compared_too():
    @law(p=Output("m"), q=Output("m"), r=Output("m"))
    def first(a=Input("m", ""), b=Input("1", "")):
        """Three products."""
        return dict(p=a * b, q=2 * a, r=a * b * b)

    @law(p=Output("m"), q=Output("m"), r=Output("m"))
    def second(a=Input("m", ""), b=Input("1", "")):
        """Three products."""
        return dict(p=a * b, q=3 * a, r=a * b * b)

    text = show.difference(first, second.renamed("first"))
    assert "- q = 2*a" in text
    assert "+ q = 3*a" in text
    assert "p =" not in text
    assert "r =" not in text


def test_parts_wires_and_signals_that_come_and_go():
    wires = {"a.v_s": "v"}
    one_part = connect("c", wires, a=curve)
    two = connect("c", wires | {"b.v_s": "v"}, a=curve, b=curve)
    text = show.difference(one_part, two)
    assert "+ b: Two exponentials." in text
    assert "+ v -> b.v_s" in text
    assert "+ param b.c [1] = 1" in text


# ---- diagrams ---------------------------------------------------------------------------------


def test_graph_is_text_for_graphviz():
    text = show.graph(loop())
    assert text.startswith('digraph "loop" {')
    assert '"plant" -> "ctl" [label="wheel.v_s [m/s]"];' in text
    assert '"hold" -> "plant" [label="y [N m]"];' in text
    assert text.count("{") == text.count("}")


def test_svg_names_boxes_and_wires_with_units():
    root = ElementTree.fromstring(show.svg(loop()))
    texts = [t.text for t in root.iter("{http://www.w3.org/2000/svg}text")]
    for wanted in ("loop", "plant", "ctl", "hold", "wheel.v_s [m/s]", "T_b [N m]", "rk4, 1 ms"):
        assert wanted in texts
    assert "jitter" not in texts  # fed by the scenario, not by a wire
    assert show.svg(loop()) == show.svg(loop())
    assert 'viewBox="0 0' in show.svg(wheelset)
