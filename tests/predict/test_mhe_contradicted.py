"""A window whose limits contradict its samples, its equations or each other ends, and says so."""

from functools import cache

import numpy as np
import pytest
import scipy.optimize
from test_mhe import ARRIVAL, DRIFT, H, at_once, data, make, run

from slipctl import Output, State, flow, mhe, one

STILL = dict.fromkeys(DRIFT, 0.0)
"""No noise: a motion is told by where it begins."""


@cache
def limited(samples):
    """Estimator whose d is limited; made once for all that it is asked."""
    return make(samples=samples, limits={"d": (1.0, 2.0)})


@pytest.mark.parametrize("far", [10, 50, 300])
@pytest.mark.parametrize("seed", range(6))
def test_samples_far_from_what_limits_allow_are_no_reason_not_to_settle(seed, far):
    """Five hundred deviations off and more; bounded least squares over all samples at once.

    1e-4: a limit that hardly presses is found to the root of what is left of the conditions.
    """
    samples, forces = data(12, seed)
    found = run(limited(12), far * samples, forces)
    assert not found["status"].any()
    last, squares = at_once(far * samples, forces, np.ones(12), 1.0, 2.0)
    assert [found[n][-1] for n in "xvd"] == pytest.approx(last, abs=1e-5 * far)
    assert found["misfit"][-1] * 12 == pytest.approx(squares, rel=1e-6)
    moving = run(limited(5), far * samples, forces)
    assert not moving["status"].any()


def possible(forces):
    """Whether a motion, of some x, v and d, stays in 0 <= x <= 1 at each tick of the forces."""
    A, rows, right = np.array([[1, H, H * H / 2], [0, 1, H], [0, 0, 1]]), [], []
    M, c = np.eye(3), np.zeros(3)
    for F in forces:
        rows += [M[0], -M[0]]
        right += [1 - c[0], c[0]]
        M, c = A @ M, A @ c + np.array([H * H / 2, H, 0]) * F
    return scipy.optimize.linprog(np.zeros(3), rows, right, bounds=(None, None)).status == 0


@pytest.mark.second
def test_a_limit_that_no_motion_keeps_is_given_up_and_told():
    """Status 3 where linear programming finds no motion, 0 where it finds one, at each tick."""
    rng, told, true = np.random.default_rng(8), [], []
    for strength in (30.0, 100.0, 300.0, 1000.0):
        forces = strength * rng.normal(size=10)
        block = make(samples=10, limits={"x": (0.0, 1.0)}, drift=STILL)
        told += list(run(block, forces * 0, forces)["status"])
        true += [0.0 if possible(forces[: k + 1]) else 3.0 for k in range(10)]
    assert told == true
    assert 5 < sum(np.array(told) > 0) < 35


def test_limits_that_contradict_each_other_are_told_in_every_tick():
    """x <= 1 and 2 x >= 4: the estimate keeps the unknown's own limit, the output's gives way."""

    @flow(two=Output("m", "twice"))
    def doubled(x=State("m", 0.0, "position"), v=State("m/s", 0.0, "speed")):
        return dict(x=v, v=0 * v / one("s")), dict(two=2 * x)

    prior = {n: ARRIVAL[n] for n in "xv"}
    drift = {n: DRIFT[n] for n in "xv"}
    block = mhe(doubled, "x", 0.01, prior, drift=drift, period=H, samples=6,
                limits={"x": (0.0, 1.0), "two": (4.0, 5.0)})  # fmt: skip
    for scale in (0.0, 1.0, 100.0):
        log = run(block, scale * data(10)[0], np.zeros(10))
        assert set(log["status"]) == {3.0}
        assert ((log["x"] >= 0) & (log["x"] <= 1)).all()
        assert log["passes"].max() < 40
