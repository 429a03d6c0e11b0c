"""Names of what is inside a Function: which of the expressions seen are its own."""

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.block.text.intermediates import named_inside, of_symbols, remember_locals
from slipctl.predict.qp.interior import Interior
from slipctl.studies.predictive.slip_problem import make


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
@given(chosen=st.lists(st.sets(st.integers(0, 5), min_size=1), max_size=12))
def test_those_of_some_symbols_are_those_asked_one_by_one(kind, chosen):
    """In their order; the first three of six symbols are the Function's own."""
    x = [kind.sym(f"x{k}") for k in range(6)]
    values = [ca.sin(sum(x[k] for k in sorted(which))) for which in chosen]
    key = ca.SX.element_hash if kind is ca.SX else hash
    own = {key(s) for s in x[:3]}
    found = of_symbols(values, own, key)
    wanted = [v for v, which in zip(values, chosen, strict=True) if which <= {0, 1, 2}]
    assert [key(v) for v in found] == [key(v) for v in wanted]


def test_the_outermost_name_of_an_expression_counts():
    def inner(x):
        squared = x**2
        return squared

    @remember_locals
    def make_it():
        x, other = ca.SX.sym("x"), ca.SX.sym("other")
        area, foreign = inner(x), other + 1  # noqa: F841  what has other symbols is left out
        return ca.Function("f", [x], [ca.sin(area) + 1], ["x"], ["y"])

    inside = named_inside(make_it())
    assert inside is not None
    assert inside.name_out() == ["area"]
    assert inside(3.0) == 9


def test_a_plan_of_many_iterations_makes_its_second_method_once(monkeypatch):
    """Each would be the same: with 30 iterations it took 20 times as long."""
    made = []
    monkeypatch.setattr(
        Interior, "function", lambda self, f=Interior.function: made.append(1) or f(self)
    )
    rail = dict(v=10.0, q=10.15, T=5.0, xi=0.0, mu_p=0.3, s_ref=0.02)
    assert make(iterations=4)(**rail)[1]["status"] == 0
    assert made == [1]
