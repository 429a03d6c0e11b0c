"""A run with every state and output of every tick, and runs that end by what they compute."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import (
    End,
    Input,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    prepare,
    simulate,
    step,
)
from slipctl.errors import RunFailed
from slipctl.run.logs.run_log import log_columns


@step(period=0.1, y=Output("m", "place"), pair=Output("1", "two", shape=(2,)))
def swing(
    x=State("m", 1.0, "place"), v=State("m/s", (0.0, 2.0), "two speeds", shape=(2,)),
    u=Input("m/s^2", "push", value=0.0), c=Param("1", 0.5, "of the rail"), k=Param("1/s", 1.0, "k"),
):  # fmt: skip
    import casadi as ca

    rates = ca.vertcat(u - c * v[0] - x, -k * v[1] / 10)
    return dict(x=x + 0.1 * v[0], v=v + 0.1 * rates), dict(y=x, pair=v)


swing = swing.with_conditions(dry={"c": 0.5}, wet={"c": 0.1})
RAIL = Rail([Section(0.0, "dry"), Section(0.7, "wet"), Section(1.4, "dry")])
SCENARIO = Scenario("s", 2.0, RAIL, inputs={"u": [(0.0, 1.0), (1.0, -1.0)]}, start={"x": 0.2})


def by_hand(k=1.0, ticks=20):
    x, v, rows = 0.2, np.array([0.0, 2.0]), []
    for n in range(ticks):
        c, u = (0.1 if 7 <= n < 14 else 0.5), (1.0 if n < 10 else -1.0)
        rows.append((x, *v))
        rates = np.array([u - c * v[0] - x, -k * v[1] / 10])
        x, v = x + 0.1 * v[0], v + 0.1 * rates
    return np.array(rows)


@pytest.mark.parametrize("numbers", [{}, {"k": 3.0}])
def test_a_whole_run_has_every_state_and_output_of_every_tick(numbers):
    whole = prepare(swing, SCENARIO, compile=False).whole(numbers)
    rows = by_hand(**numbers)
    assert whole.x == pytest.approx(rows)
    assert whole.y == pytest.approx(rows)
    assert [p[:2] for p in whole.parts] == [(0, 7), (7, 14), (14, 20)]
    for first, last, p in whole.parts:
        for k in range(first, last):
            after, y = (v.full().ravel() for v in whole.f(whole.x[k], whole.u[k], p))
            assert y == pytest.approx(rows[k])
            if k < 19:
                assert after == pytest.approx(rows[k + 1])
    assert whole.block.param_values()["k"] == numbers.get("k", 1.0)
    log = simulate(swing.with_params(**numbers), SCENARIO, compile=False)
    assert log["y"].values == pytest.approx(rows[:, 0])


def test_another_rail_and_a_run_that_breaks():
    prepared = prepare(swing, SCENARIO, compile=False)
    alike = prepared.whole({}, rail=Rail([Section(0.0, "wet")]))
    assert [p[:2] for p in alike.parts] == [(0, 20)]
    assert alike.x[:2] == pytest.approx(by_hand()[:2])
    with pytest.raises(RunFailed, match=r"swing: v \[m/s\] became (-?inf|nan) at t = "):
        prepared.whole({"k": 1e300})


@pytest.mark.parametrize(
    ("end", "ticks"),
    [
        (End("x", above=0.6), 0), (End("y", above=0.6), 0), (End("x", above=0.6, hold=0.3), 2),
        (End("pair", below=1.9), None), (End("x", above=99.0), None),
    ],
)  # fmt: skip
def test_a_run_ends_in_the_tick_in_which_its_end_has_been_there(end, ticks):
    """``ticks`` after the first one; of two speeds both have to be slow."""
    rows = by_hand()
    many = simulate(swing, SCENARIO.but(end=end), compile=False).sizes["time"]
    if ticks is not None:
        last = int(np.argmax(rows[:, 0] >= 0.6)) + ticks
    else:
        slow = (np.abs(rows[:, 1:]) <= 1.9).all(axis=1) & (end.signal == "pair")
        last = int(np.argmax(slow)) if slow.any() else 19
    assert many == last + 1


def test_a_whole_run_over_a_rail_that_sets_an_input_is_the_run():
    rail = Rail([Section(0.0, "dry", {"u": 1.0}), Section(0.7, "wet", {"u": 2.0})])
    scenario = Scenario("s", 2.0, rail)
    whole = prepare(swing, scenario, compile=False).whole({"k": 2.0})
    log = simulate(swing.with_params(k=2.0), scenario, compile=False)
    assert whole.x[:, 0] == pytest.approx(log["x"].values)
    assert whole.u[:, 0].tolist() == [1.0] * 7 + [2.0] * 13


def test_a_log_keeps_every_number_but_held_copies_and_counters():
    @step(period=0.1, y=Output("1", "out"))
    def counted(
        tick=State("1", 0.0, "ticks"), held_y=State("1", 0.0, "held"),
        y_1=State("1", 0.0, "before"), u=Input("1", "in", value=0.0),
    ):  # fmt: skip
        return dict(tick=tick + 1, held_y=u, y_1=u), dict(y=u + y_1)

    loop = connect("loop", {"a.u": "go"}, a=counted)
    assert set(log_columns(loop, None)) == {"go", "a.y", "a.y_1"}
    assert set(log_columns(loop, {"a.held_y", "a.tick"})) == {"a.held_y", "a.tick"}
