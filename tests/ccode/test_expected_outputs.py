"""What the C is expected to give: guards by hand, roundings, limits, differences."""

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, RunFailed, State, step
from slipctl.ccode.check import comparison
from slipctl.ccode.check.float_error import Trials
from slipctl.ccode.check.vectors import expected_outputs
from slipctl.ccode.module.plan import Plan


@step(period=0.01, y=Output("1", "lagged"))
def lag(x=State("1", 0.7, "lagged"), u=Input("1", "wanted")):
    return {"x": 0.5 * x + u}, {"y": x}


def test_roundings_of_a_stable_module_do_not_grow():
    """x+ = x/2 + u: each tick moves x by its rounding, and forgets half of what came before."""
    u = 0.3 + 0.1 * np.sin(np.arange(80))
    x = [0.7]
    for v in u:
        x.append(0.5 * x[-1] + v)
    states, outputs = np.array(x[1:])[:, None], np.array(x[:-1])[:, None]
    plan = Plan(lag, None, None, "float")
    status = np.zeros(len(u), dtype=int)
    run = expected_outputs.Expected(u[:, None], outputs, states, status, {}, frozenset())
    worst = expected_outputs._spread(plan, run, {})
    eps = 2.0**-24
    assert worst.min() > 0
    assert worst.max() <= 4 * eps * np.abs(x).max()  # geometric series of 1/2, and the input's own


@step(period=0.01, y=Output("1", "sum", lo=-2, hi=1.5), z=Output("1", "held", safe=0.25))
def sums(
    n=State("1", 0.0, "ticks"), s=State("1", 0.3, "sum"),
    u=Input("1", "summand", lo=-1, hi=1, stale=2), w=Input("1", "other", lo=0, hi=4),
):  # fmt: skip
    """A sum, and a counter, which is exact in float."""
    return {"n": n + 1, "s": 0.5 * s + u}, {"y": s + w, "z": n - s}


NONE, OFF, LIMITED, REFUSED = 1, 8, 16, 32
ROWS = np.array([
    [3.0, 1.0], [0.4, np.nan], [0.4, 1.0], [0.7, 9.0], [np.nan, 0.5], [5.0, 0.1], [7.0, 0.2],
    [-0.6, 3.9], [0.2, -1.0], [0.1, 1.0],
])  # fmt: skip


def by_hand(rows):
    """Outputs, states and status of the sums, with the promises of the header, tick by tick."""
    last, age, x, held, found = [None, None], [-1, -1], (0.0, 0.3), (0.0, 0.0), []
    for row in rows:
        status = 0
        for k, (v, lo, hi, stale) in enumerate(zip(row, (-1, 0), (1, 4), (2, 200), strict=True)):
            if lo <= v <= hi:
                last[k], age[k] = v, 0
                continue
            status |= OFF if np.isfinite(v) else NONE
            if age[k] < 0 or age[k] >= stale:
                status |= REFUSED
            age[k] = age[k] + 1 if age[k] >= 0 else -1
        if not status & REFUSED:
            n, s = x
            y, x = s + last[1], (n + 1, 0.5 * s + last[0])
            status |= LIMITED if not -2 <= y <= 1.5 else 0
            held = (min(max(y, -2), 1.5), n - s)
            found.append((*held, *x, status))
        else:
            found.append((held[0], 0.25, *x, status))
    return np.array(found)


def test_a_run_with_its_guards_is_that_by_hand():
    run = comparison.expected_run(Plan(sums), ROWS, {})
    wanted = by_hand(ROWS)
    np.testing.assert_array_equal(np.hstack([run.outputs, run.states]), wanted[:, :4])
    np.testing.assert_array_equal(run.status, wanted[:, 4])
    status = wanted[:, 4].astype(int)
    assert run.refused == np.count_nonzero(status & (OFF | NONE))
    assert run.limited == np.count_nonzero(status & LIMITED) > 0
    assert run.undecided == 0
    assert {REFUSED, OFF, NONE} <= {int(b) for b in (1, 8, 32) if (status & b).any()}
    given = run.status.copy()
    given[[2, 5]] ^= LIMITED
    given[7] ^= REFUSED
    assert (run.faults(given, 63), run.faults(given, REFUSED), run.faults(given, NONE)) == (3, 1, 0)


def limited(real, **more):
    plan = Plan(sums, real=real)
    run = comparison.expected_run(plan, ROWS.astype(np.float32 if real == "float" else float), {})
    return plan, run, expected_outputs.with_limits(plan, run, {}, **more)


def test_in_double_each_signal_may_differ_by_its_size():
    _, run, given = limited("double")
    for k, n in enumerate(("y", "z")):
        assert given.limits[n] == 1e-12 * np.abs(run.outputs[:, k]).max()
    assert given.limits["n"] == 1e-12 * run.states[-1, 0]
    assert given.envelope == frozenset()
    plan = Plan(lag)
    still = expected_outputs.Expected(np.zeros((3, 1)), np.zeros((3, 1)), np.zeros((3, 1)),
                              np.zeros(3, int), {}, frozenset())  # fmt: skip
    assert expected_outputs.with_limits(plan, still, {}).limits == {"y": 1e-12, "x": 1e-12}


def test_without_trials_what_is_whole_is_exact_and_the_rest_has_its_roundings():
    plan, run, given = limited("float")
    spread = expected_outputs._spread(plan, run, {})[0]
    assert spread[2] == 0  # the counter
    assert np.all((spread[[0, 1, 3]] > 0) & (spread[[0, 1, 3]] < 8 * 2.0**-23 * 4))
    eps = 64 * 2.0**-23
    sizes = np.abs(np.hstack([run.outputs, run.states])).max(axis=0)
    for n, size, s in zip(("y", "z", "n", "s"), sizes, spread, strict=True):
        assert given.limits[n] == pytest.approx(16 * s + eps * size, rel=1e-12)
    assert given.envelope == frozenset()


def trials_of(run, *apart):
    rows = np.hstack([run.outputs, run.states])
    return Trials([rows + a for a in apart], np.tile(run.status, (len(apart), 1)))


@pytest.mark.parametrize(("real", "eps"), [("double", 1e-12), ("float", 2 * 2.0**-23)])
def test_with_trials_it_is_what_they_differ_by(real, eps):
    plan, run, _ = limited(real)
    rows = np.hstack([run.outputs, run.states])
    swing, size = np.ptp(rows, axis=0), np.abs(rows).max(axis=0)
    apart = np.zeros((2, *rows.shape))
    apart[0, 3, 0] = 1e-4  # y: every tick is compared
    apart[0, 4, 1] = 0.08 * swing[1]  # z: 16 times that is above a tenth of its swing
    apart[1, :, 3] = 0.07 * swing[3]  # s: its ends differ
    trials = trials_of(run, *apart)
    trials.status[1, 6] ^= OFF
    trials.status[0, 8] ^= LIMITED  # a limit may be met or not
    given = expected_outputs.with_limits(plan, run, {}, trials)
    assert given.envelope == {"z", "s"}
    assert given.limits == pytest.approx({
        "y": 16e-4 + eps * size[0], "z": 0.1 * swing[1], "n": eps * size[2],
        "s": 2 * 0.07 * swing[3],
    }, rel=1e-9)  # fmt: skip
    assert list(np.flatnonzero(given.status == expected_outputs.UNDECIDED)) == [6]
    assert given.undecided == 1
    other = given.status.copy()
    other[6] = 99
    assert given.faults(other, 127) == 0
    apart[1, :, 3] = 0.6 * swing[3]
    given = expected_outputs.with_limits(plan, run, {}, trials_of(run, *apart))
    assert given.limits["s"] == expected_outputs.UNKNOWN


def test_differences_are_told_as_they_are():
    plan, run, _ = limited("double")
    given = expected_outputs.Expected(run.rows, run.outputs, run.states, run.status,
                              {"y": 1.0, "z": 2.0, "n": expected_outputs.UNKNOWN, "s": 4.0},
                              frozenset({"z"}))  # fmt: skip
    rows = np.hstack([run.outputs, run.states])
    got = rows.copy()
    got[3, 0] += 0.125
    got[[2, 5], 1] = got[[5, 2], 1]  # other ticks, the same ends
    got[rows[:, 1].argmin(), 1] -= 0.5
    got[4, 3] = np.nan
    found = expected_outputs.differences(plan, given, got)
    assert found["y"] == {
        "absolute": pytest.approx(0.125), "relative": pytest.approx(0.125 / 1.5),
        "compared": "every tick", "counted": pytest.approx(0.125), "limit": 1.0,
    }  # fmt: skip
    assert found["z"]["counted"] == pytest.approx(0.5)
    assert found["z"]["absolute"] >= 0.5
    assert (found["z"]["compared"], found["n"]["compared"]) == ("envelope", "nothing")
    assert found["n"]["relative"] == found["n"]["absolute"] == 0
    assert found["s"]["counted"] == np.inf


def test_the_first_ticks_are_kept():
    _, run, _ = limited("double")
    trials = trials_of(run, 0.0, 1e-3)
    first, tried = expected_outputs.first_ticks(run, trials.first(7), 9)
    assert [len(v) for v in (first.rows, first.outputs, first.states, first.status)] == [7] * 4
    assert (tried.ticks, len(tried.rows), len(tried.rows[1])) == (7, 2, 7)
    first, tried = expected_outputs.first_ticks(run, None, 4)
    assert (len(first.rows), tried) == (4, None)


def test_parameters_in_float_stay_in_their_ranges():
    @step(period=0.01, y=Output("1"))
    def gained(u=Input("1"), k=Param("1", 0.1, lo=0.0, hi=0.1 + 0.2), q=Param("1", 0.1)):
        """k at its end is above it as a float."""
        return {}, {"y": k * u + q}

    found = expected_outputs.float_params(Plan(gained, real="float"), {"k": 0.1 + 0.2, "q": 0.1})
    assert float(found["k"]) <= 0.1 + 0.2
    assert float(found["q"]) == float(np.float32(0.1))


def test_a_run_that_breaks_names_its_state():
    @step(period=0.01, y=Output("1"))
    def two(a=State("1", 0.0, shape=(2,)), b=State("1", 0.0, lo=-1, hi=1.5), u=Input("1")):
        """b sums up."""
        return {"a": a, "b": b + u}, {"y": 1 / (b - 1)}

    with pytest.raises(RunFailed, match=r"two: b = 1\.6 leaves.*\[-1, 1\.5\] at tick 1 "):
        comparison.expected_run(Plan(two), np.array([[0.8], [0.8], [0.1]]), {})
    with pytest.raises(RunFailed, match="NaN or infinity at tick 2"):
        comparison.expected_run(Plan(two), np.array([[0.5], [0.5], [0.0]]), {})
    begun = comparison.expected_run(Plan(two), np.array([[0.5], [0.5], [0.0]]), {}, whole=False)
    assert len(begun.rows) == 2
    with pytest.raises(BadInput, match="no tick has all its inputs"):
        comparison.expected_run(Plan(sums), np.array([[3.0, 3.0]]), {})


def test_made_up_inputs_fill_their_ranges_and_follow_their_changes():
    @step(period=0.01, y=Output("1"))
    def wide(
        u=Input("1", lo=-1, hi=3), slow=Input("1", lo=0, hi=8, change=0.5), v=Input("1", value=5.0),
        low=Input("1", value=-3.0, hi=-2), high=Input("1", value=8.0, lo=7),
    ):  # fmt: skip
        """Ranges of each kind."""
        return {}, {"y": u + slow + v + low + high}

    rows = comparison.trial_rows(Plan(wide))
    assert rows.shape == (comparison.TRIAL, 5)
    ends = np.array([[-1, 3], [0, 8], [0, 10], [-6, -2], [7, 16]])
    assert np.all(rows.min(axis=0) >= ends[:, 0])
    assert np.all(rows.max(axis=0) <= ends[:, 1])
    for k in (0, 2, 3, 4):  # evenly: each tenth of a range has its share
        share = (rows[:, k] - ends[k, 0]) / np.ptp(ends[k])
        assert np.all(np.abs(np.histogram(share, 10, (0, 1))[0] - comparison.TRIAL / 10) <= 3), k
    moved = np.abs(np.diff(rows[:, 1]))
    assert moved.max() == pytest.approx(0.45)
    near = comparison.trial_rows(Plan(wide), 0.01)
    assert np.abs(near[:, 2] - 5).max() <= 0.05 + 1e-9
    assert np.ptp(near[:, 2]) > 0.09


def test_a_large_signal_that_hardly_moves_is_compared_in_every_tick():
    """What it swings over is less than a rounding of it: no envelope, the size decides."""
    plan = Plan(lag)
    states = 1e9 + 1e-5 * np.arange(4.0)[:, None]
    run = expected_outputs.Expected(
        np.zeros((4, 1)), states, states, np.zeros(4, int), {}, frozenset()
    )
    trials = Trials([np.hstack([states, states]) + 1e-4], np.zeros((1, 4), int))
    given = expected_outputs.with_limits(plan, run, {}, trials)
    assert given.envelope == frozenset()
    assert given.limits["x"] == pytest.approx(16e-4 + 1e-12 * 1e9, rel=1e-3)
