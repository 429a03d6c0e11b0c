"""Runs that cannot be, and runs that break: what is told of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slipctl import (
    BadInput,
    End,
    Input,
    Output,
    Rail,
    Scenario,
    Section,
    State,
    flow,
    law,
    simulate,
    step,
)
from slipctl.errors import RunFailed
from slipctl.run.preparation import LARGEST, _ticks
from slipctl.run.results import LeftToFull, NotRun, Results


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


FED = [
    (lambda t: t[:3], r"its feed gives an array \(3,\), wanted is \(10,\)"),
    (lambda t: 1 / 0, "its feed function fails on 10 times: ZeroDivisionError"),
    ([(0.01, 1.0)], "its feed starts at 0.01 s; say what it is from 0 s on"),
    ([(0.0, 1.0), (0.0, 2.0)], "its feed needs steps .* in order of time"),
    ([(0.0, 1.0), (math.inf, 2.0)], "its feed needs steps .* in order of time"),
    ([], "feed"),
    ([1.0, 2.0, 3.0], "feed"),
]


@pytest.mark.parametrize(("feed", "said"), FED)
def test_a_feed_that_gives_no_number_for_each_tick_is_refused(feed, said):
    with pytest.raises(BadInput, match=said):
        simulate(count, Scenario("s", 0.1, inputs={"rate": feed}), compile=False)


def test_a_feed_is_what_stands_at_the_time_of_each_tick():
    ways = {
        "number": (0.25, [0.25] * 4), "function": (lambda t: 10 * t, [0, 0.1, 0.2, 0.3]),
        "function of one number": (lambda t: 0.5, [0.5] * 4),
        "steps": ([(0.0, 0.1), (0.015, 0.2), (0.03, 0.3)], [0.1, 0.1, 0.2, 0.3]),
        "array": (np.array([0.4, 0.3, 0.2, 0.1]), [0.4, 0.3, 0.2, 0.1]),
    }  # fmt: skip
    for name, (feed, wanted) in ways.items():
        log = simulate(count, Scenario("s", 0.04, inputs={"rate": feed}), compile=False)
        assert list(log["rate"].values) == pytest.approx(wanted), name


SECTIONS = [Section(0.0, "dry"), Section(1.0, "wet")]
KINDS = [
    (lambda: Rail(3), "a Rail takes a list of sections, not 3"),
    (lambda: Rail(SECTIONS, by=3), "a Rail goes by 'time', 'position' or a state's name, not 3"),
    (lambda: Rail([]), "a Rail needs at least one Section"),
    (lambda: Rail([1.0]), "rail section 0 is 1.0; write Section"),
    (lambda: Rail([Section(math.nan, "dry")]), "first rail section starts at nan"),
    (lambda: Rail(SECTIONS[::-1]), "section"),
    (lambda: Rail(SECTIONS[1:]), "section"),
    (lambda: End("v", below=1.0, hold=-1.0), "the end by v: hold -1 s must be 0 or positive"),
    (lambda: End("v", below=1.0, hold=math.inf), "hold inf s must be 0 or positive"),
    (lambda: End("v"), "needs one of below= and above="),
    (lambda: End("v", below=1.0, above=2.0), "needs one of below= and above="),
    (lambda: simulate(count, Scenario("s", 0.1, end=End("rate", above=1.0)), compile=False),
     "scenario s: rate is fed; a run ends by what it"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "said"), KINDS)
def test_what_is_no_rail_and_no_end_is_refused(made, said):
    with pytest.raises(BadInput, match=said):
        made()


@pytest.mark.parametrize(
    ("values", "end", "there"),
    [
        ([0.5, -0.5, 2, -2], {"below": 1.0}, [True, True, False, False]),
        ([[0.5, 2.0], [0.5, -0.5], [3, 3], [1, 1]], {"below": 1.0}, [False, True, False, True]),
        ([1.0, 2.0, -3.0, 0.0], {"above": 1.0}, [True, True, False, False]),
    ],
)
def test_an_end_is_there_where_all_axles_are(values, end, there):
    rows = np.array(values).reshape(4, -1)
    assert list(End("v", **end).there(rows)) == there


def test_a_table_that_was_not_made_is_told():
    found = Results(None, [], tables={"e": {"t": 1}}, failed={"broken": "it broke"}, left=["full"])
    assert found.table("e", "t") == found.table("e") == 1
    with pytest.raises(NotRun, match="experiment e gave no table 'tt'; did you mean 't'"):
        found.table("e", "tt")
    with pytest.raises(NotRun, match="experiment broken failed: it broke"):
        found.table("broken")
    with pytest.raises(NotRun, match="experiment other was not run"):
        found.table("other")
    with pytest.raises(LeftToFull):
        found.table("full")
    assert found.asked == {"e", "broken", "other", "full"}
