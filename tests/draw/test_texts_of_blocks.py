"""Derivatives and long formulas of a block as text: what is told, in which order, what is cut."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import Input, Output, Param, State, connect, flow, step
from slipctl.draw import show


@flow(y=Output("m", "way"))
def bent(
    x=State("m", 0.0, "place"),
    w=State("m/s", 1.0, "speed"),
    u=Input("N", "force"),
    m=Param("kg", 2.0, "mass"),
    k=Param("1/s", 3.0, "rate"),
):
    """Two states, one result of both."""
    drive = u / m
    return dict(x=w, w=drive * drive - k * w), dict(y=3 * x)


def test_derivatives_stand_under_each_other_by_what_changes_and_by_what() -> None:
    """None where nothing depends; a letter that the equations tell already is not told again."""
    assert show._jacobian(bent) == [
        "d y / d x  = 3",
        "d x' / d w = 1",
        "d w' / d w = -k",
        "d w' / d u = 2*drive/m",
    ]


@step(period=0.1, y=Output("1", shape=(3,)))
def row(
    x=State("1", np.zeros(3), shape=(3,)),
    A=Param("1", np.arange(6.0).reshape(2, 3), shape=(2, 3)),
    u=Input("1"),
):
    """Three of a kind."""
    return dict(x=ca.vertcat(u, x[0] * x[0], x[1] + u)), dict(y=2 * x)


def test_elements_have_derivatives_of_their_own() -> None:
    told = dict(map(str.strip, line.split(" = ")) for line in show._jacobian(row))
    assert told["d x[0]+ / d u"] == "1"
    assert told["d x[1]+ / d x[0]"] == "2*x[0]"
    assert told["d x[2]+ / d x[1]"] == "1"
    assert told["d x[2]+ / d u"] == "1"
    assert [told[f"d y[{k}] / d x[{k}]"] for k in range(3)] == ["2"] * 3
    assert len(told) == 7


def test_the_jacobian_of_parts_stands_below_their_paths() -> None:
    both = connect("both", {"b.u": "a.y", "o": "b.y"}, a=bent_sampled(), b=waits)
    text = show.text(both)
    part = text.partition("\nJacobian\n")[2].splitlines()
    assert part[0] == "  b"
    assert part[1].startswith("    d x+ / d u")
    assert "Jacobian" not in show.text(both, jacobian=False)


def bent_sampled() -> Any:
    @step(period=0.1, y=Output("m"))
    def still(x=State("m", 0.0)):
        return dict(x=0 * x + 1), dict(y=ca.SX(2.0))

    return still


@step(period=0.1, y=Output("m"))
def waits(x=State("m", 0.0), u=Input("m")):
    """Holds what it got."""
    return dict(x=2 * u), dict(y=ca.SX(1.0) + 0 * x)


def many(count: int) -> Any:
    """So many outputs, each another function of the input."""

    def body(u: Any) -> dict[str, Any]:
        return {f"y{k}": ca.sin((k + 2) * u) for k in range(count)}

    outputs = {f"y{k}": Output("1") for k in range(count)}

    @step(period=0.1, **outputs)
    def wide(x=State("1", 0.0), u=Input("1")):
        """Wide."""
        return dict(x=u), body(u)

    return wide


def test_of_a_long_block_the_first_rows_are_told_and_how_much_more_there_is(monkeypatch) -> None:
    monkeypatch.setattr(show, "LINES", 5)
    block = many(8)
    rows = show._text_rows(block)
    assert [line.split("=")[0].strip() for line in rows[:-1]] == ["x+", "y0", "y1", "y2", "y3"]
    assert rows[-1] == f"... and more, {block.f.n_instructions()} operations in all"
    latex = show.latex(block)
    assert latex.count("y_{") == 4
    assert f"and more, {block.f.n_instructions()} operations" in latex
    assert show._jacobian(block) == ["9 derivatives that are not zero"]
    exact = many(4)
    assert [line.split("=")[0].strip() for line in show._text_rows(exact)] == [
        "x+", "y0", "y1", "y2", "y3"]  # fmt: skip
    assert "more" not in show.latex(exact)
    assert len(show._jacobian(exact)) == 5
    monkeypatch.setattr(show, "LARGE", 3)
    assert show._jacobian(exact) == []


@pytest.mark.parametrize(("lo", "hi", "meanings", "safe", "wanted"), [
    (0, 5, "", None, "0 .. 5"), (-1.5, np.inf, "", None, ">= -1.5"),
    (-np.inf, 2, "", 1.25, "<= 2, safe 1.25"), (-np.inf, np.inf, "", 3.0, "safe 3"),
    (0, 2, "0 off, 1 on", None, "0 off, 1 on"), (-np.inf, np.inf, "", None, ""),
])  # fmt: skip
def test_a_range_is_told_by_its_ends(lo, hi, meanings, safe, wanted) -> None:
    signal: Any = SimpleNamespace(lo=lo, hi=hi, meanings=meanings, safe=safe)
    assert show._range(signal) == wanted


def test_columns_are_as_wide_as_what_stands_in_them() -> None:
    rows = [("a", "long word", "x"), ("bcd", "", "yz"), ("", "w", "")]
    assert show._columns(rows) == ["a    long word  x", "bcd             yz", "     w"]
    assert show._flat([1, [2, (3, [4])], 5]) == [1, 2, 3, 4, 5]
    assert show._left("d F_a' / d v_s") == (
        r"\frac{\partial " + show._left("F_a'") + r"}{\partial " + show._left("v_s") + "}"
    )
    assert show._left("x+").endswith("^{+}")
    assert show._left("x+").startswith(show._left("x"))
    signal: Any = SimpleNamespace(positive="braking", per="ratio")
    assert show._sign(signal) == "braking, per ratio"
    assert show._sign(SimpleNamespace(positive=None, per="speed")) == "per speed"  # type: ignore[arg-type]
    assert show._shape(SimpleNamespace(shape=(2, 3))) == "[2,3]"  # type: ignore[arg-type]


def test_a_table_leaves_out_columns_that_nothing_fills() -> None:
    head, *rows = show._table(row)
    assert head.split() == ["name", "unit", "value"]
    told = [r.split() for r in rows]
    assert [r[:3] for r in told] == [
        ["state", "x[3]", "1"], ["input", "u", "1"], ["param", "A[2,3]", "1"],
        ["output", "y[3]", "1"]]  # fmt: skip
    assert told[0][3:] == ["0", "each"]


def test_what_differs_between_two_blocks_is_told_section_by_section() -> None:
    @step(period=0.2, y=Output("m", "way"), z=Output("s", "time"))
    def other(
        x=State("m", 0.5, "place", lo=0),
        v=Input("m/s"),
        k=Param("1/s", 4.0, "rate"),
    ):
        """Another."""
        return dict(x=x + k * v), dict(y=4 * x, z=x)

    @step(period=0.2, y=Output("m", "way"))
    def one(x=State("m", 0.0, "place"), u=Input("m"), k=Param("1/s", 3.0, "rate")):
        """One."""
        return dict(x=x + k * u), dict(y=4 * x)

    said = show.difference(one, other).splitlines()
    assert said[0].startswith("- one: step")
    assert said[1].startswith("+ other: step")
    at = {name: said.index(name) for name in ("Equations", "Signals")}
    equations = said[at["Equations"] + 1 : at["Signals"] - 1]
    assert equations == ["  - x+ = x + k*u", "  + x+ = x + k*v", "  + z = x"]
    assert [line.strip() for line in said[at["Signals"] + 1 :]] == [
        "state x, value: 0 -> 0.5", "state x, range: none -> >= 0", "- input u [m]",
        "param k, value: 3 -> 4", "+ input v [m/s]", "+ output z [s]",
    ]  # fmt: skip
    assert "Structure" not in said
    assert show.difference(one, one).endswith("\nno difference\n")
