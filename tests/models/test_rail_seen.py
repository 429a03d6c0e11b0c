"""The field of the rail under a train: where it is clean, and how well wheels clean; filling ahead.

The rail here is written anew: axles pass points of it one after the other.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl.models.vehicle import SlipLaw, TrainSlip, case
from slipctl.models.vehicle.slip.fill_ahead import LONGEST, fill_ahead
from slipctl.models.vehicle.slip.rail_seen import FARTHEST, rail_seen
from slipctl.models.vehicle.slip.train_reference import filling_rate
from slipctl.models.wheel_rail.falling_creep import falling_creep
from tests.models.test_slide_protection import train
from tests.models.test_train_slip import LEAVES, curves

BEHIND = (0.0, 2.0, 14.0, 16.0)
LOAD, T = 58860.0, 0.01
SEEN = rail_seen(LEAVES, falling_creep, BEHIND).with_params(T=T, load=LOAD)


def passed(tau, v, slips, ends, seconds, block=SEEN, noise=0.0, wrong=1.0):
    """Outputs of the field while axles pass a rail that they clean, fouled from 0 m to ``ends``.

    Args:
        tau: strength in m/J. v: speed in m/s. slips: ratio of each axle. ends: in m.
        noise: deviation of each sample of the adhesion. wrong: factor on all of them.
    """
    cell, random = 0.05, np.random.default_rng(1)
    W = np.zeros(int((v * seconds + 60) / cell))
    both, rows = [curves(e, v) for e in slips], []
    for k in range(round(seconds / T)):
        for e, behind, (low, high) in zip(slips, BEHIND, both, strict=True):
            at = v * T * k - behind
            here = slice(round((at + 20) / cell), round((at + v * T + 20) / cell))
            q = -np.expm1(-tau * W[here].mean()) if 0 <= at < ends else 1.0
            rows.append((1 - q) * low + q * high)
            W[here] += LOAD * rows[-1] * e
    mu = wrong * np.reshape(rows, (-1, 4)).T
    mu += noise * random.standard_normal(mu.shape)
    return outputs(block, v, mu, v * np.array(slips))


def outputs(block, v, mu, v_s):
    """Outputs tick by tick of samples mu, shape (axles, ticks)."""
    n = mu.shape[1]
    u = ca.vertcat(ca.repmat(v, 1, n), mu, ca.repmat(ca.DM(v_s), 1, n))
    assert list(block.inputs) == ["v", "mu", "v_s"]
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values())
    return block.f.mapaccum(n)(x, u, ca.repmat(p, 1, n))[1].full().T


@pytest.mark.parametrize(("tau", "v", "e"), [(2e-5, 25, 0.3), (1e-4, 12, 0.1), (2e-4, 20, 0.2)])
def test_the_strength_is_that_of_the_rail_from_a_guess_three_times_off(tau, v, e):
    """Axles that slide alike; with a factor of 3 either way it is known to a tenth after 12 s."""
    for guess in (0.4, 2.5):
        block = SEEN.with_params(tau_0=guess * tau, sure=100.0)
        factor = passed(tau, v, (e,) * 4, 1e3, 12.0, block)[-1, -1]
        assert guess * factor == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize(("noise", "wrong"), [(5e-3, 1.0), (0.0, 1.15), (0.0, 0.9)])
def test_noise_and_a_layer_that_is_believed_wrong_spoil_little_of_it(noise, wrong):
    """Adhesion off by a tenth is a curve that is: within a factor of 1.6, from one 3 times off."""
    block = SEEN.with_params(tau_0=3e-4)
    factor = passed(1e-4, 20.0, (0.3, 0.3, 0.1, 0.05), 1e3, 12.0, block, noise, wrong)[-1, -1]
    assert 1 / 1.6 < 3 * factor < 1.6


def test_a_rail_that_tells_nothing_leaves_what_was_believed():
    """On clean rail, and where the samples are not believed."""
    assert passed(1e-4, 20.0, (0.1,) * 4, 0.0, 3.0)[-1, -1] == 1.0
    assert outputs(SEEN, 20.0, np.zeros((4, 99)), np.zeros(4))[-1].tolist() == [FARTHEST] * 4 + [1]


@pytest.mark.parametrize(("v", "ends"), [(8.0, 30.0), (20.0, 50.0), (35.0, 60.0)])
def test_the_distance_to_cleaner_rail_is_that_to_the_end_of_the_layer(v, ends):
    """Once the first axle has passed it, of each axle behind; to a cell and what is filtered."""
    rows = passed(3e-5, v, (0.2,) * 4, ends, (ends + 13.0) / v)
    for k in (2, 3):
        ticks = np.arange(len(rows))
        at = v * T * ticks - BEHIND[k]  # the place of that axle
        seen = (v * T * ticks > ends + 4 + 0.1 * v) & (at < ends - 1) & (at > 2)
        assert seen.any()
        off = rows[seen, k] - (ends - at[seen])
        assert -1.3 < off.min() <= off.max() < 1.3 + 0.12 * v
    assert (rows[:, 0] == FARTHEST).all()  # nobody is ahead of the first axle


@settings(max_examples=25, deadline=None)
@given(st.floats(4, 40), st.floats(0.5, 30), st.floats(0.01, 0.29), st.floats(2e3, 3e4))
def test_it_fills_where_the_slip_stays_within_the_limit_at_the_place(v, ahead, e, rate):
    """The wheel is integrated anew from there on, its torque rising beside what the rail takes."""
    given = {"rate": rate, "dead": 0.06, "J": 100.0, "r": 0.46}
    _, found = fill_ahead.with_params(**given)(v=v, v_s=e * v, own=e * v, ahead=ahead)
    slip, t = e * v, max(ahead / v - 0.06, 0.0)
    for k in range(1000):
        slip += t / 1000 * rate * (k + 0.5) * t / 1000 * 0.46 / 100.0
    if abs(slip - 0.3 * v) > 1e-3 * v:
        assert (float(found["v_best"]) > e * v + 1e-9) == (slip < 0.3 * v)


def test_it_goes_back_when_the_wheel_has_run_up_and_never_fills_for_long():
    block = fill_ahead.with_params(T=T)
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values())

    def after(x, **u):
        x, y = block.f(x, block.pack("input", {"v": 20.0, "own": 0.5} | u), p)
        return x, float(y)

    x, best = after(x, v_s=0.5, ahead=2.0)
    assert best == pytest.approx(6.0)
    y, best = after(x, v_s=4.0, ahead=FARTHEST)  # the place is passed, the wheel still slides
    assert best == pytest.approx(6.0)
    assert after(y, v_s=0.4, ahead=FARTHEST)[1] == 0.5
    for _ in range(round(LONGEST / T) + 1):  # a place that never comes
        x, best = after(x, v_s=0.5, ahead=2.0)
    assert best == 0.5


@pytest.mark.second
def test_a_train_has_one_field_and_each_axle_fills_by_its_own_brake():
    law = SlipLaw(kind="sta", reference=TrainSlip(ahead=True, learn=True))
    made = train(4, controllers={"x": law})
    loop = case(made).loops["x"]
    assert filling_rate(made) == pytest.approx(5520 / 3.8e5 * 0.44 * 6.013e5)
    assert float(loop.params["ctl.fill.rate"].value) == pytest.approx(filling_rate(made))
    assert float(loop.params["ctl.rail.tau_0"].value) == pytest.approx(3.4e-5)
    assert loop.states["ctl.rail.seen"].size == 38 - 20
    without = case(replace(made, controllers={"x": replace(law, reference=TrainSlip())})).loops["x"]
    assert "ctl.rail.seen" not in without.states
