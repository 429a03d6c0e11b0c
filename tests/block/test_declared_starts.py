"""Starts and ranges that a signal declares mean what they say."""

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, Signal, State, connect, law, step

VALVE = ("apply", "hold", "release")


@step(period=0.01, y=Output("1"))
def valve(
    at=State("enum", "release", values=VALVE), k=Param("1", 1.0), last=State("m", 0.0, lo=0, hi=1)
):
    """Stays where it began."""
    return dict(at=at, last=last), dict(y=k * at)


@pytest.mark.parametrize(("name", "number"), zip(VALVE, (0, 1, 2), strict=True))
def test_a_start_by_name_is_the_number_of_that_name(name, number):
    assert float(valve.start()["at"]) == 2
    assert float(valve.start(at=name)["at"]) == number


def test_a_name_that_is_no_value_is_refused_with_the_place():
    with pytest.raises(BadInput, match=r"valve\.at.*open"):
        valve.start(at="open")


def test_noise_beside_no_largest_change_is_refused():
    """Noise is what comes on top of a change per tick: without one it says nothing."""
    with pytest.raises(BadInput, match="give change"):
        Signal("input", "m/s", jitter=0.1)
    assert Signal("input", "m/s", jitter=0.1, change=1.0).jitter == 0.1


def test_an_input_without_noise_or_change_is_plain():
    made = Input("m/s", "speed")
    assert (made.jitter, made.change) == (0.0, np.inf)


@law(y=Output("1"))
def twice(u=Input("1", "in"), k=Param("1", 2.0, "gain")):
    """Twice."""
    return k * u


@pytest.mark.parametrize("order", [("a", "b", "c"), ("c", "a", "b"), ("b", "c", "a")])
def test_a_wildcard_reaches_every_part_in_whatever_order_they_stand(order):
    """A part without the number ends no search for it in those behind."""
    parts = {"a": twice, "b": valve, "c": twice}
    made = connect("all", {"a.u": "u", "c.u": "a.y"}, **{n: parts[n] for n in order})
    assert {n: float(v) for n, v in made.with_params(**{"*.k": 5.0}).param_values().items()} == {
        f"{n}.k": 5.0 for n in order
    }


def test_a_range_that_is_given_anew_follows_no_parameter_any_more():
    """The other end goes on following it; so do both where only the role changes."""
    made = Output("N", lo="-k", hi="2*k").named("y")
    assert {(b.what, b.expression) for b in made.bounds} == {("lo", "-k"), ("hi", "2*k")}
    other = made.as_role("input", lo=-3.0)
    assert {(b.what, b.expression) for b in other.bounds} == {("hi", "2*k")}
    assert (other.role, other.lo) == ("input", -3.0)
    assert made.as_role("input").bounds == made.bounds
