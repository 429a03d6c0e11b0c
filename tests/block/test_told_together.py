"""What is wrong in one place hides nothing behind it, in whatever order the places stand."""

from __future__ import annotations

from itertools import permutations

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, connect, from_text, step
from slipctl.block.reach import with_reach
from slipctl.block.transforms.adaptors import ratio_to_speed
from slipctl.block.transforms.discretisation import check_sample_times
from slipctl.errors import Faults
from slipctl.models.huang_2020.subway_braking import double_exponential

UNREAD = {
    "a [N] = 3": "is no equation",
    "exp = 3": "exp is a function or constant",
    "b = 2 +": "b: ",
    "c = foo(2)": "there is no function foo",
}
UNDECLARED = {"d = unknown_d": "'unknown_d' is not declared", "f = unknown_f": "'unknown_f'"}
UNITS = {"g = v + 3": "'v' [m/s] cannot be added", "h = exp(v)": "exp takes"}


@pytest.mark.parametrize("kinds", [UNREAD, UNDECLARED, UNITS])
def test_faults_of_a_kind_are_all_told_in_any_order(kinds):
    for texts in permutations(kinds, 2):
        with pytest.raises(Faults) as told:
            from_text("; ".join(["ok = 2", *texts]) + " where v [m/s]")
        lines = told.value.lines
        assert len(lines) >= 2
        for text in texts:
            assert any(kinds[text] in line for line in lines), (texts, lines)


def test_what_is_wrong_of_the_meanings_is_all_told_in_any_order():
    """A result among the inputs, and a name that nothing gives among the states."""
    wrong = {"mu": ("inputs", "mu has an equation"), "z": ("states", "z has no equation"),
             "w": ("outputs", "w has no equation")}  # fmt: skip
    for names in permutations(wrong):
        keys = {wrong[n][0]: {n: "1"} for n in names}
        with pytest.raises(Faults) as told:
            from_text("mu = 2; y = 3", **keys)
        for n in names:
            assert any(wrong[n][1] in line for line in told.value.lines), told.value.lines


def test_what_follows_from_a_wrong_unit_is_not_told_twice():
    """mu is used by y, which is no fault of its own; z is."""
    with pytest.raises(Faults) as told:
        from_text("mu = v + 3; y = 2*mu; z = exp(v) where v [m/s]")
    assert [line[:2] for line in told.value.lines] == ["mu", "z:"]


def test_units_of_a_printed_form_are_not_asked():
    text = "mu = v + 3 where v [m/s]"
    printed = from_text(text, units="printed")
    assert float(printed(v=2.0)["mu"]) == 5.0
    with pytest.raises(Faults, match="cannot be added"):
        from_text(text)


@pytest.mark.parametrize("before", [True, False])
def test_a_text_leaves_the_simplification_of_casadi_as_it_was(before):
    was = ca.GlobalOptions.getSimplificationOnTheFly()
    try:
        ca.GlobalOptions.setSimplificationOnTheFly(before)
        from_text("mu = a*(1/b) where a [1], b = 2")
        assert ca.GlobalOptions.getSimplificationOnTheFly() == before
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(was)


def test_both_ends_of_what_a_law_reaches_are_kept_in_any_order():
    ends = {"meant_to": "locked", "measured_to": "3 km/h"}
    for keys in permutations(ends):
        data = with_reach(double_exponential, {k: ends[k] for k in keys}).law_data
        assert data.meant_to == np.inf
        assert data.measured_to == pytest.approx(3 / 3.6, rel=1e-12)


@step(period=0.01, y=Output("1"))
def steady(u=Input("1"), T=Param("1", 0.5), T_o=Param("s", 0.01), T_s=Param("s", 0.01)):
    """Not each of the names is a sample time here: T is a number of its own."""
    return {}, dict(y=u * T)


def test_a_wrong_sample_time_is_refused_behind_what_is_none():
    for name in ("T_o", "T_s"):
        loop = connect("loop", {"a.u": "u"}, a=steady.with_params(**{name: 0.02}))
        with pytest.raises(BadInput, match=rf"\b{name} = 0.02 s, but it runs every 0.01 s"):
            check_sample_times(loop)
    check_sample_times(connect("loop", {"a.u": "u"}, a=steady))


def test_a_ratio_of_a_slow_car_is_of_the_least_speed_that_is_told():
    block = ratio_to_speed()
    for v in (-20.0, -0.3, 0.0, 0.5, 30.0):
        for least in (1.0, 2.0):
            given = {} if least == 1.0 else {"v_min": least}
            assert float(block(u=0.1, v=v, **given)["y"]) == pytest.approx(0.1 * max(abs(v), least))
