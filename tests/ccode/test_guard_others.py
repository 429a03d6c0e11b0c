"""Ends that follow other inputs: what one sensor says must fit what the others said last."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, c_module, connect, every, ranged, step
from slipctl.ccode.check import comparison
from slipctl.ccode.check.vectors import expected_outputs
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan

STALE, PERIOD = 5, 0.02


@step(period=PERIOD, y=Output("m/s", lo=-1e3, hi=1e3))
def driven(
    n=State("1", 0.0, lo=0, hi=1e9),
    v=Input("m/s", lo=0, hi=(60, "q + play"), change=0.5, stale=STALE),
    w=Input("m/s", shape=(2,), lo=(0, "v - play"), hi=400, change=4, stale=STALE),
    q=Input("m/s", lo=(0, "v - play"), hi=400, change=2, noise=0.1, stale=STALE),
    play=Param("m/s", 0.2, lo=0, hi=5),
):
    """A driven rim is no slower than its train."""
    return dict(n=n + 1), dict(y=v + q + w[0] + w[1] + 0 * play)


def by_hand(rows, play):
    """Taken values and bits by the words of the page, one tick after the other."""
    lo, hi, change, noise = [0] * 4, [60, 400, 400, 400], [0.5, 4, 4, 2], [0, 0, 0, 0.1]
    last, age = [0.0] * 4, [-1.0] * 4
    taken, told = [], []
    for row in rows:
        known = [u if a < 0 or a >= 50 else x for u, a, x in zip(row, age, last, strict=True)]
        ends = [(lo[0], min(hi[0], known[3] + play))]
        ends += [(max(lo[k], known[0] - play), hi[k]) for k in (1, 2, 3)]
        bits = 0
        for k, u in enumerate(row):
            whole = np.floor(age[k])
            free = age[k] < 0 or whole >= 50
            way = abs(u - last[k])
            if ends[k][0] <= u <= ends[k][1] and (
                free or way <= noise[k] + change[k] * (whole + 1)
            ):
                if not free and age[k] > whole and way > noise[k] + change[k]:
                    bits |= guard.OFF_RANGE
                last[k], age[k] = u, whole - 0.5 if whole > 1 else 0.0
            else:
                bits |= guard.OFF_RANGE if np.isfinite(u) else guard.BAD_INPUT
                bits |= guard.REFUSED if age[k] < 0 or whole >= STALE else 0
                age[k] = whole if free else whole + 1
        taken.append(list(last))
        told.append(bits)
    return np.array(taken), np.array(told)


def course(ticks, seed):
    """A train that gains speed, its rims, and wrong samples of each for some ticks."""
    rng = np.random.default_rng(seed)
    v = 10 + 0.03 * np.arange(ticks) + rng.uniform(-0.01, 0.01, ticks)
    rows = np.column_stack([v, *(v + rng.uniform(0, 1, ticks) for _ in range(3))])
    for _ in range(ticks // 20):
        k, at, many = rng.integers(4), rng.integers(1, ticks), rng.integers(1, 15)
        wrong = rng.choice([np.nan, np.inf, 0.0, 1.1, 2.0, -1.0, 50.0])
        rows[at : at + many, k] = rows[at : at + many, k] * wrong if wrong < 3 else wrong
    return rows


@pytest.mark.parametrize("seed", range(4))
def test_taken_values_are_those_by_hand(seed):
    rows, plan = course(600, seed), Plan(driven)
    taken, told = expected_outputs.accepted_rows(plan, rows, plan.block.param_values(play=0.5))
    wanted, said = by_hand(rows, 0.5)
    good = said & guard.REFUSED == 0
    np.testing.assert_array_equal(told, said)
    np.testing.assert_array_equal(taken[good], wanted[good])
    assert 50 < np.count_nonzero(said) < 590


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("real", ["double", "float"])
def test_c_takes_the_same(tmp_path, real):
    rows = course(3000, 9).astype(np.float32).astype(float)
    run = comparison.expected_run(Plan(driven, real=real), rows, {})
    module = c_module(driven, tmp_path, "ctl", real=real).compile().load().reset()
    outputs, states = module.replay_rows(rows)
    np.testing.assert_allclose(outputs, run.outputs, rtol=0 if real == "double" else 1e-6)
    np.testing.assert_array_equal(states, run.states)
    np.testing.assert_array_equal(module.status, run.status)
    assert module.status[0] == 0  # before a first good value each speaks for itself
    text = (tmp_path / "ctl.h").read_text(encoding="utf-8")
    assert "range 0.0 and v - play to 400.0" in " ".join(text.split())


def test_a_rim_at_rest_under_a_train_is_never_believed():
    """Its own change would allow it after 6 ticks; the end of its range is the train's speed."""
    rows = np.full((60, 4), 10.0)
    rows[5:, 3] = 0.0
    plan = Plan(driven)
    taken, told = expected_outputs.accepted_rows(plan, rows, plan.block.param_values())
    assert (taken[:, 3] == 10).all()
    assert (told[5:] & guard.OFF_RANGE > 0).all()


@pytest.mark.parametrize("to", [2.0, 55.0])
def test_what_was_away_for_long_need_not_fit_what_the_others_said_before(tmp_path, to):
    """After a second without samples all begin anew, at once, however far they are."""
    rows = np.full((90, 4), 10.0)
    rows[10:70], rows[70:] = np.nan, to
    plan = Plan(driven)
    taken, told = expected_outputs.accepted_rows(plan, rows, plan.block.param_values())
    assert (told[10:70] & guard.BAD_INPUT > 0).all()
    assert (told[70:] == 0).all()
    assert (taken[70:] == to).all()
    if compilers.first_compiler() is not None:
        module = c_module(driven, tmp_path, "ctl").compile().load().reset()
        module.replay_rows(rows)
        np.testing.assert_array_equal(module.status, told)


def test_ends_that_follow_inputs_stand_beside_a_range_of_numbers():
    """Where no input is known, and from outside of the part, only the numbers are left."""
    plan = Plan(driven)
    assert plan.coupled
    assert not Plan(every(ranged(driven, q=Input("m/s", lo=0), v=Input("m/s"),
                                 w=Input("m/s", lo=0)), 2)).coupled  # fmt: skip
    lo, hi, *_ = plan.ends(plan.layout.inputs, plan.block.param_values())
    assert lo.tolist() == [0, 0, 0, 0]
    assert hi.tolist() == [60, 400, 400, 400]
    assert Plan(every(driven, 3)).coupled
    whole = connect("whole", {"a.v": "v", "a.q": "rim", "a.w": "w", "y": "a.y"}, a=driven)
    assert whole.ends(whole.inputs["rim"], whole.param_values())[0] == [0]
    assert driven.without_range() == []
    with pytest.raises(BadInput, match="uses 'speed'"):
        ranged(driven, q=Input("m/s", lo=(0, "speed - play")))
    with pytest.raises(BadInput, match="is not an expression"):
        Input("m/s", lo=(0, "v -"))
