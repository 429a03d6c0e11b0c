"""Runs that cannot be, and runs that break: what is told of them."""

from __future__ import annotations

import math

import pytest

from slipctl import BadInput, Input, Output, Scenario, State, flow, law, simulate, step
from slipctl.errors import RunFailed
from slipctl.run.preparation import LARGEST, _ticks


@step(period=0.01, y=Output("1"), two=Output("1", shape=(2,)))
def count(
    calm=State("m", 0.0), pair=State("kg", (1.0, 1.0), shape=(2,)), late=State("1", 5.0),
    rate=Input("1", value=0.0), grow=Input("1", value=0.0),
):  # fmt: skip
    """The second of the pair grows beyond all numbers, or another one is no number."""
    import casadi as ca

    pair = ca.vertcat(pair[0], pair[1] * (1 + grow))
    return dict(calm=calm, pair=pair, late=late - ca.log(1 - rate)), dict(y=calm, two=pair)


@law(y=Output("1"))
def plain(u=Input("1", value=0.0)):
    """No period."""
    return u


@flow()
def cart(v=State("m/s", 1.0)):
    """Continuous."""
    return dict(v=-v), {}


REFUSED = [
    (cart, Scenario("s", 1.0), {}, r"cart is continuous; sampled\(cart, h, method\) first"),
    (plain, Scenario("s", 1.0), {}, "plain has no period; one of its blocks must say it"),
    (count, 3.0, {}, "3.0 is no scenario; write Scenario"),
    (count, Scenario("s", 0.004), {}, "duration 0.004 s is shorter than one tick of 0.01 s"),
    (count, Scenario("s", 1.0), {"every": 0}, "every"),
    (count, Scenario("s", 1e8), {}, "scenario s: 1e.10 ticks of 0.01 s need 671 GiB; shorten"),
    (count, Scenario("s", 1.0), {"log": ["calm", "calmer"]}, "no signal 'calmer' to log; did you"),
    (count, Scenario("s", 1.0), {"log": ["speed"]}, "count has no signal 'speed' to log"),
]  # fmt: skip


@pytest.mark.parametrize(("loop", "scenario", "more", "said"), REFUSED)
def test_what_is_no_run_is_refused(loop, scenario, more, said):
    with pytest.raises(BadInput, match=said):
        simulate(loop, scenario, compile=False, **more)


@pytest.mark.parametrize("every", [1, 10, 1000])
def test_a_run_fills_its_memory_to_the_limit_and_not_beyond(every):
    """Two inputs in each tick, and of each row that is kept four states and three outputs."""
    ticks = LARGEST / 8 / (2 + 7 / every)
    assert _ticks(count, Scenario("s", 0.01 * math.floor(ticks * 0.999)), every) > 0
    with pytest.raises(BadInput, match="GiB"):
        _ticks(count, Scenario("s", 0.01 * math.ceil(ticks * 1.001)), every)


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ({"grow": 1e200}, r"count: pair \[kg\] became inf at t = 0.02 s"),
        ({"rate": 2.0}, r"count: late \[1\] became nan at t = 0.01 s"),
        ({"rate": 1.0}, r"count: late \[1\] became inf at t = 0.01 s"),
    ],
)
def test_the_state_that_breaks_is_named_with_what_it_became_and_when(inputs, said):
    with pytest.raises(RunFailed, match=said):
        simulate(count, Scenario("s", 0.1, inputs=inputs), compile=False)
