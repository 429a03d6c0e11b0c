"""Letters of parts of equations: which results have their name, and where long ones are parted."""

from __future__ import annotations

import casadi as ca
import pytest
from graphs_by_hand import built, summed

from slipctl import BadInput, Input, Output, connect, law
from slipctl.block.text import formula
from slipctl.block.text.formula import Graph, Node
from slipctl.block.text.intermediates import named_inside
from slipctl.block.text.plain_text import Text

a, b, c = (ca.SX.sym(n) for n in "abc")


def written(equations, names):
    g = formula.graph(equations, names)
    return {k: [Text(g).root(n) for n in root] for k, root in g.roots.items()}, g.letters


def test_results_behind_one_without_a_letter_have_theirs():
    """A symbol among the elements, a name that a symbol has, one that is used nowhere."""
    names = {"a": a * b, "lost": a - c, "w": ca.vertcat(a, a * b, a + b), "F": ca.exp(c)}
    texts, letters = written({"y": a * b + 3 * (a + b) * ca.exp(c)}, names)
    assert texts == {"y": ["w[1] + 3*w[2]*F"]}
    assert sorted(letters.values()) == ["F", "w[1]", "w[2]"]


def test_an_equation_has_its_own_name_and_no_other():
    texts, letters = written({"y": a * b, "z": a * b + c}, {"q": a * b, "y": a * b})
    assert texts == {"y": ["a*b"], "z": ["y + c"]}
    assert list(letters.values()) == ["y"]
    assert formula.named_nodes(formula.graph({"y": a * b, "z": a * b + c}, {"y": a * b})) == []
    texts, letters = written({"y": a * b, "z": c}, {"q": a * b, "z": a + b})
    assert (texts, letters) == ({"y": ["a*b"], "z": ["c"]}, {})


def parted(made, long, letters=(), prefixes="azqhw"):
    """Text of a formula after it was parted, and its letters with what they stand for."""
    g, places = built(made, *(part for part, _ in letters))
    g.roots = {"y": places[:1]}
    g.letters |= {n: name for n, (_, name) in zip(places[1:], letters, strict=True)}
    formula.shorten(g, long, prefixes)
    return Text(g).root(places[0]), {k: Text(g).root(n) for k, n in formula.named_nodes(g)}


def test_a_long_formula_is_parted_behind_what_has_a_letter():
    """Of six operations at most: a letter counts as one."""
    made = summed(("mul", "a", "b"), *"cdefghi")
    text, letters = parted(made, 6, [(("mul", "a", "b"), "F")])
    assert text == "a2 + i"
    assert letters == {"F": "a*b", "a1": "F + c + d + e", "a2": "a1 + f + g + h"}
    assert parted(made, 40) == ("a*b + c + d + e + f + g + h + i", {})
    assert parted(summed("a1", *"cdefgh"), 6)[1] == {"z1": "a1 + c + d + e"}
    assert parted(summed("a1", *"cdefgh"), 6, prefixes="a")[1] == {"part1": "a1 + c + d + e"}


@pytest.mark.parametrize(("long", "text"), [(8, "sin(a1) + cos(a1)"), (11, "sin(a1) + cos(a1)"),
                                            (12, "sin(x*y) + cos(x*y)")])  # fmt: skip
def test_what_is_used_twice_has_a_letter_from_a_quarter_of_that_on(long, text):
    made = ("add", ("sin", ("mul", "x", "y")), ("cos", ("mul", "x", "y")))
    assert parted(made, long)[0] == text


def test_conditions_have_no_letters():
    """Parts of them and what stands behind them have; a tie of min and max is no part."""
    low = ("lt", summed(*"abcd"), summed(*"efgijkl"))
    made = ("mul", ("if_else_zero", low, "x"), summed(*"abcdefgh"))
    text, letters = parted(made, 6)
    assert text == "(x if a1 < a3 else 0)*(a4 + h)"
    assert letters == {"a1": "a + b + c + d", "a2": "e + f + g + i", "a3": "a2 + j + k + l",
                       "a4": "a1 + e + f + g"}  # fmt: skip
    g, (tie,) = built(("add", ("le", "x", "y"), ("le", "y", "x")))
    assert formula.is_tie(g, tie)
    for other in (("add", ("le", "x", "y"), ("le", "x", "y")), ("add", ("le", "x", "y"), "x"),
                  ("sub", ("le", "x", "y"), ("le", "y", "x")),
                  ("add", ("lt", "x", "y"), ("lt", "y", "x"))):  # fmt: skip
        g, (n,) = built(other)
        assert not formula.is_tie(g, n)


def test_nodes_below_are_those_that_something_is_made_of():
    g, (sum_, product, other) = built(("add", ("mul", "a", "b"), "c"), ("mul", "a", "b"), "d")
    names = {n.name or n.op for n in (g.nodes[k] for k in g.below([sum_]))}
    assert names == {"add", "mul", "a", "b", "c"}
    assert {g.nodes[k].name or g.nodes[k].op for k in g.below([sum_], {product})} == {"add", "c"}
    assert g.below([product, other]) == sorted(
        [product, other, g.nodes.index(Node("symbol", name="a")),
         g.nodes.index(Node("symbol", name="b"))])  # fmt: skip
    assert Graph().below([]) == []


def test_variables_of_a_law_are_named_but_for_those_with_a_line_in_front():
    @law(y=Output("1"))
    def curve(u=Input("1"), w=Input("1")):
        _own = u * w
        area, x = u + _own, u - w
        return ca.sin(area) * x + _own

    inside = named_inside(curve.f)
    assert inside is not None
    assert sorted(inside.name_out()) == ["area", "x"]
    assert [float(v) for v in inside([], [3.0, 2.0], [])] in ([9.0, 1.0], [1.0, 9.0])


@law(y=Output("1"))
def gain(u=Input("1"), w=Input("1", value=0.0)):
    return 2 * u + w


def test_names_of_a_function_are_told_apart():
    """a.b and a_b are one name in C: further ones have letters behind."""
    wires = {"p.u": "x_u", "q.u": "x__u", "r.u": "r_w", "y": "p.y"}
    loop = connect("loop", wires, p=gain, q=gain, r=gain)
    assert list(loop.inputs) == ["x_u", "x__u", "r_w", "p.w", "q.w", "r.w"]
    assert loop._io_names("input", "u") == ["u_x_u", "u_x_ua", "u_r_w", "u_p_w", "u_q_w", "u_r_wa"]


def test_a_loop_is_told_without_the_way_to_it():
    """The first part waits for the second, which waits for the third, which waits for it."""
    wires = {"p.u": "q.y", "q.u": "r.y", "r.u": "q.y"}
    with pytest.raises(BadInput, match=r"loop: algebraic loop r\.y -> q\.y -> r\.y; break it"):
        connect("loop", wires, p=gain, q=gain, r=gain)
