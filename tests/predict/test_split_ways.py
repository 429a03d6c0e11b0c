"""A tick in two parts, of functions of numbers: the four ways that it may go."""

from __future__ import annotations

import casadi as ca
import pytest

from slipctl.predict.qp.split_tick import split_results
from slipctl.predict.qp.stage_loops import as_function, if_else_call

PLAN, KEPT, GIVEN, MEASURED, STILL = (
    (2.0, 3.0),
    (5.0, 7.0, 11.0),
    (13.0, 17.0),
    (19.0, 23.0),
    (29.0,),
)


def prepare(a, b, begun, c, shift):
    """Plan of two and three that are prepared."""
    return a + c, b * (1 + shift), a - begun, c * b, 100 * shift + c


def feedback(a, b, k, m, n, y, z):
    """Plan of two and one result."""
    return a * y + k, b - z * m, n + 1000 * y + z


def by_hand(only, prepared, begun):
    plan, given = PLAN, (begun, GIVEN[1])
    if only:
        if begun > 0:
            made = prepare(*plan, *given, float(not prepared))
            return [*made[:2], *STILL], list(made[2:])
        return [*plan, *STILL], list(KEPT)
    if prepared:
        return list(feedback(*plan, *KEPT, *MEASURED)), list(KEPT)
    made = prepare(*plan, *given, 1.0)
    return list(feedback(*made, *MEASURED)), list(made[2:])


@pytest.mark.parametrize("only", [0.0, 1.0])
@pytest.mark.parametrize("prepared", [0.0, 1.0])
@pytest.mark.parametrize("begun", [0.0, 13.0])
def test_a_tick_goes_one_of_four_ways(only, prepared, begun):
    """The rest alone, the whole, preparing alone, or nothing: the plan has not begun."""
    parts = [tuple(map(ca.MX, p)) for p in (PLAN, KEPT, (begun, GIVEN[1]), MEASURED, STILL)]
    results, kept = split_results(
        lambda *a: prepare(*a), lambda *a: feedback(*a), ca.MX(only), ca.MX(prepared), *parts
    )
    wanted, ahead = by_hand(only, prepared, begun)
    assert [float(ca.evalf(v)) for v in results] == pytest.approx(wanted)
    assert [float(ca.evalf(v)) for v in kept] == pytest.approx(ahead)


def test_what_is_not_chosen_is_not_computed_and_what_is_made_is_made_once():
    """Of matrices too; a function is written once, however often it is called."""
    asked = []

    def f(a, b):
        asked.append("f")
        return a @ b, a[0, 1]

    call = as_function("f", f)
    A, b = ca.DM([[1.0, 2], [3, 4]]), ca.DM([5.0, 7])
    for _ in range(2):
        product, corner = call(A, b)
        assert ca.evalf(product).full().ravel().tolist() == [19, 43]
        assert float(ca.evalf(corner)) == 2
    assert asked == ["f"]
    for chosen in (1.0, 0.0):
        first, second = if_else_call(
            "which", ca.MX(chosen), lambda a, b: (a + b, a * b), lambda a, b: (a - b, b / a),
            ca.MX(8.0), ca.MX(2.0),
        )  # fmt: skip
        wanted = (10, 16) if chosen else (6, 0.25)
        assert (float(ca.evalf(first)), float(ca.evalf(second))) == wanted
