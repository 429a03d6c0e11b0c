"""Noise apart from rate: how far an input may be from its last good value, in Python and in C."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput, Input, Output, Param, State, c_module, connect, law, ranged, step
from slipctl.ccode.check import comparison
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan

MOST = float(np.finfo(float).max)
STALE, PERIOD = 4, 0.01
SHORT = 0.1
"""Period in s with which an input is forgotten after ten ticks."""


@step(period=PERIOD, y=Output("m/s", lo=-1e9, hi=1e9))
def heard(
    x=State("m/s", 0.0, lo=-1e9, hi=1e9),
    v=Input("m/s", "speed", lo=-10, hi=10, change=0.1, noise=0.5, stale=STALE),
    w=Input("m/s", "wheels", lo="-9 * a", hi=10, change="a * T", noise="s + s", stale=STALE,
            shape=(3,)),
    a=Param("m/s^2", 4.0, lo=1, hi=100), T=Param("s", PERIOD, lo=1e-4, hi=1),
    s=Param("m/s", 0.25, lo=0, hi=2),
):  # fmt: skip
    """Sum of what is taken."""
    return dict(x=v + w[0] + w[1] + w[2]), dict(y=x + a * T * s)


def by_hand(column, lo, hi, change, noise, memory):
    """Taken values, what is told and refused, without the rule of the guards."""
    last, age, before, taken, told, refused = 0.0, -1, True, [], [], []
    for u in column:
        near = age < 0 or age >= memory or abs(u - last) <= noise + change * (age + 1)
        if np.isfinite(u) and lo <= u <= hi and near:
            told.append(0 <= age < memory and before and abs(u - last) > noise + change)
            before = True
            last, age = u, max(age - 1, 0)
            refused.append(False)
        else:
            told.append(True)
            before = False
            refused.append(age < 0 or age >= STALE)
            age = age if age < 0 or age >= memory else age + 1
        taken.append(last)
    return taken, told, refused


VALUES = st.lists(
    st.one_of(st.floats(-1, 1), st.sampled_from([np.nan, np.inf, 10.0, -10.0, 1e30, 0.5, 0.6])),
    min_size=1, max_size=40,
)  # fmt: skip


@given(VALUES, st.floats(0, 2), st.floats(0.01, 1))
@settings(max_examples=200, deadline=None)
@pytest.mark.second
def test_the_rule_is_noise_and_the_way_since_the_last_good_value(column, noise, change):
    *ends, stale = (np.array([v]) for v in (-10.0, 10.0, change, noise, float(STALE)))
    rows = np.array(column)[:, np.newaxis]
    taken, told = guard.accepted_inputs(rows, ends, stale, MOST, SHORT)
    wanted, said, refused = by_hand(column, -10, 10, change, noise, 10)
    assert (told > 0).tolist() == said
    np.testing.assert_array_equal(taken[:, 0], wanted)
    assert ((told & guard.REFUSED) > 0).tolist() == refused


def test_a_value_that_is_wrong_by_more_than_noise_is_believed_when_it_could_have_come_so_far():
    """Noise of .5 and .1 in a tick: 2 m/s off is believed after 15 ticks, not after 4."""
    rows = np.r_[[0.0], np.full(30, 2.0)][:, np.newaxis]
    first = {}
    for change, noise in ((0.1, 0.5), (0.6, 0.0)):
        *ends, stale = (np.array([v]) for v in (-10.0, 10.0, change, noise, 200.0))
        taken, _ = guard.accepted_inputs(rows, ends, stale, MOST, PERIOD)
        first[noise] = int(np.argmax(taken[:, 0] == 2))
    assert first == {0.5: 15, 0.0: 4}


@pytest.mark.parametrize(("wrong", "away"), [(20, 6), (30, 14), (60, 14), (12, 0)])
def test_a_wrong_value_that_was_believed_late_is_left_as_soon(wrong, away):
    """2 m/s off are believed after 14 ticks. So long the true value was away, however short it was.

    Now it is away for no longer than the wrong one was believed.
    """
    rows = np.r_[[0.0], np.full(wrong, 2.0), np.zeros(100)][:, np.newaxis]
    *ends, stale = (np.array([v]) for v in (-10.0, 10.0, 0.1, 0.5, 200.0))
    taken, told = guard.accepted_inputs(rows, ends, stale, MOST, PERIOD)
    assert np.count_nonzero(taken[wrong + 1 :, 0]) == away
    assert np.count_nonzero(told) == min(wrong, 14) + away
    assert not told[wrong + 1 + away :].any()


def test_a_jump_is_told_though_it_may_be_taken():
    """2 m/s there and back in two ticks: one of them is wrong, and nobody knows which."""
    rows = np.r_[[0.0], np.full(14, np.nan), 2.0, 2.1, 0.5, 0.5][:, np.newaxis]
    *ends, stale = (np.array([v]) for v in (-10.0, 10.0, 0.1, 0.5, 200.0))
    taken, told = guard.accepted_inputs(rows, ends, stale, MOST, PERIOD)
    assert taken[15:, 0].tolist() == [2.0, 2.1, 0.5, 0.5]
    assert told[14:].tolist() == [guard.BAD_INPUT, 0, 0, guard.OFF_RANGE, 0]


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("real", ["double", "float"])
def test_c_takes_the_same_values_to_the_bit(tmp_path, real):
    """Random walks with spikes, by numbers and by expressions of parameters, one by one and all."""
    rng = np.random.default_rng(7)
    rows = np.cumsum(rng.uniform(-0.02, 0.02, (4000, 4)), axis=0)
    rows = 4 * np.sin(rows) + rng.uniform(-0.1, 0.1, rows.shape)
    odd = rng.random(rows.shape) < 0.05
    rows[odd] = rng.choice([np.nan, np.inf, 9.0, -9.0, 3.0, 1e30], odd.sum())
    rows = rows.astype(np.float32).astype(float)
    plan = Plan(heard, real=real)
    params = {"s": 0.125}
    run = comparison.expected_run(plan, rows, params)
    module = c_module(heard, tmp_path, "ctl", real=real).compile().load().reset(**params)
    outputs, states = module.replay_rows(rows)
    tolerance = 0 if real == "double" else 4e-6
    np.testing.assert_allclose(outputs, run.outputs, rtol=0, atol=tolerance)
    np.testing.assert_allclose(states, run.states, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(module.status, run.status)
    assert 300 < np.count_nonzero(run.status) < 3900
    header = " ".join((tmp_path / "ctl.h").read_text(encoding="utf-8").split())
    assert "changes by at most 0.1 in a tick; and by noise of 0.5;" in header.replace("* ", "")
    assert "and by noise of s + s;" in header.replace("* ", "")


def test_what_is_no_noise_is_refused():
    for wrong, said in (
        (dict(change=1, noise=-0.5), "noise = -0.5 is no finite number from 0 on"),
        (dict(change=1, noise=np.inf), "noise = inf"),
        (dict(change=1, noise=np.nan), "noise is NaN"),
        (dict(noise=0.5), "noise widens the limit on the change of a tick; give change, too"),
        (dict(noise="s"), "give change, too"),
        (dict(change="a", noise="s +"), "'s \\+' is not an expression"),
    ):
        with pytest.raises(BadInput, match=said):
            Input("m/s", "speed", **wrong)
    with pytest.raises(BadInput, match="uses 'q'"):
        ranged(heard, v=Input("m/s", change=1, noise="q"))


def test_an_input_of_two_parts_has_the_rate_of_the_tighter_and_the_larger_noise():
    @law(y=Output("m/s"))
    def one(v=Input("m/s", "speed", change=0.1, noise=0.5)):
        """As it is."""
        return v

    other = ranged(one, table={"v": (-5, 5, "source", 0.3, 0.2)})
    both = connect("both", {"a.v": "v", "b.v": "v", "y": "a.y", "z": "b.y"}, a=one, b=other)
    assert both.ends(both.inputs["v"], {}) == ([-5], [5], [0.1], [0.5])
    assert ranged(heard, v=Input("m/s", lo=0, hi=1)).inputs["v"].jitter == 0
    assert heard.inputs["v"].as_role("output").jitter == 0
