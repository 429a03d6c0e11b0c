"""Stages of growing length: against a least-squares problem by hand; how a plan is shifted."""

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, State, flow, law, nmpc, one
from slipctl.draw import show
from slipctl.predict.stages.stage_lengths import plan_shift
from slipctl.predict.trials import Driver
from slipctl.studies.predictive.slip_problem import closed_loop
from slipctl.studies.predictive.slip_problem import make as slip

H = 0.1


@flow()
def cart(v=State("m/s", 0.0, "speed"), F=Input("N", "force", lo=-50, hi=50)):
    """One kilogram."""
    return dict(v=F / one("kg")), {}


@law(e=Output("m/s"), f=Output("N"))
def speed(v=Input("m/s", "speed"), w=Input("m/s", "wanted"), F=Input("N", "force")):
    """Speed error and force."""
    return dict(e=v - w, f=F)


def make(**options):
    """Controller of the cart."""
    weights = {"e": 3.0, "f": 0.3}
    return nmpc(cart, speed, "F", h=H, horizon=6, weights=weights, **options)


@pytest.mark.parametrize("solver", ["riccati", "osqp", "ipopt"])
def test_a_stage_counts_by_its_length(solver):
    """1e-6: the comparison solvers end there."""
    s = 1.3 ** np.arange(6)
    rows, right = [], []
    for k in range(7):
        weight = 3 * np.sqrt([*s, 1][k])
        rows.append(weight * np.r_[H * s[:k], np.zeros(6 - k)])
        right.append(weight * (1.0 - 0.2))
    rows += list(0.3 * np.diag(np.sqrt(s)))
    force = np.linalg.lstsq(np.array(rows), np.r_[right, np.zeros(6)], rcond=None)[0][0]
    out = make(grow=1.3, solver=solver)(v=0.2, w=1.0)[1]
    assert out["F"] == pytest.approx(force, abs=1e-6)


def test_a_plan_is_shifted_by_the_first_stage():
    """What is linear in time stays so; controls come from the stage that is there then."""
    s = (1.0, 1.5, 2.25)
    places, stages = plan_shift(s)
    ends = np.r_[0, np.cumsum(s), sum(s) + 1]  # one first stage more
    assert ends @ places.full() == pytest.approx(ends[:-1] + 1)
    assert stages == [1, 2, 2]  # middles .5, 1.75, 3.625, later 1.5, 2.75, 4.625


@pytest.mark.second
@pytest.mark.long
def test_half_as_many_stages_cost_the_same_and_rates_are_kept():
    """Reference problem, 20 stages against 10 to the same end."""
    assert closed_loop(slip(horizon=10, grow=1.18))[0] == pytest.approx(29.031, abs=5e-3)
    block = make(grow=1.3, rates={"F": 2.0})
    tick, v = Driver(block, compile=False), 0.0
    for k in range(12):
        F, status, *_ = tick(v, 5.0)
        assert status == 0
        assert pytest.approx(0.2 * (k + 1)) == F
        v += H * F
    plan = block.unpack("state", tick.x)["U"]
    most = 50 * np.abs(np.diff(np.array(plan).ravel())) / (H * 2.0)
    s = 1.3 ** np.arange(6)
    assert (most <= (s[1:] + s[:-1]) / 2 + 1e-9).all()


def test_it_is_told_and_bad_input_is_one_line():
    text = show.text(make(grow=1.3, rates={"F": 2.0}), False)
    assert "6 stages of 0.1 to 0.371 s, s[k] of the first each" in text
    assert "sum for k = 0 .. 5 of s[k] [(weight_e e)^2" in text
    for grow in (0.9, 5.0, "x"):
        with pytest.raises(BadInput, match="grow") as error:
            make(grow=grow)
        assert "\n" not in str(error.value)
