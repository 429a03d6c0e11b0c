"""The plan over the axles of a train: its values, what axles make of it, and where it stands.

Adhesions are written anew; best sums over one rail point are those of brute force and of a
nonlinear program with exact slopes.
"""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput
from slipctl.ccode.codegen import c_module
from slipctl.ccode.compile import compilers
from slipctl.models.vehicle import SlideProtection, SlipLaw, TrainSlip
from slipctl.models.vehicle.control import vehicle_control
from slipctl.models.vehicle.slip.train_plan import train_plan
from slipctl.models.vehicle.slip.train_slip import NODES, train_slip
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.sliding_train import SlidingTrain
from slipctl.models.wheel_rail.train_optimum import program, refined_point
from tests.models.test_slide_protection import train
from tests.models.test_train_slip import LEAVES, curves

LOAD = 58860.0
AXLE = train_slip(LEAVES, falling_creep, plan=True).with_params(T=0.1, least=0.01)


try:
    HAS_COMPILER = bool(compilers.compilers())
except BadInput:
    HAS_COMPILER = False


@cache
def plan_of(axles, learn=False):
    return train_plan(LEAVES, falling_creep, axles, learn=learn).with_params(load=LOAD, most=2.0)


def planned(axles, v, **numbers):
    """Values of a plan at one speed, shape (nodes, axles), and its rate."""
    block = plan_of(axles)
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values(**numbers))
    u = block.pack("input", {"v": v})
    for _ in range(axles):  # one more than it takes: what goes out is of the tick before
        x, y = block.f(x, u, p)
    out = block.unpack("output", y)
    return np.asarray(out["value"]), float(out["rate"])


def slips_of(axles, v, tau, value, rate):
    """Slips of axles that go by a plan over one rail point that nobody has cleaned; their sum."""
    slips, W, total = [], 0.0, 0.0
    for k in range(axles):
        share = -np.expm1(-tau * W)
        low, high = curves(0.2, v)
        x, p = AXLE.pack("state", AXLE.start()), AXLE.pack("param", AXLE.param_values())
        u = AXLE.pack("input", {"v": v, "mu": (1 - share) * low + share * high, "v_s": 0.2 * v,
                                "value": value[:, k], "rate": rate})  # fmt: skip
        y = AXLE.f.mapaccum(400)(x, ca.repmat(u, 1, 400), ca.repmat(p, 1, 400))[1]
        slips.append(float(y[0, -1]) / v)
        low, high = curves(slips[-1], v)
        total += (1 - share) * low + share * high
        W += LOAD * slips[-1] * ((1 - share) * low + share * high)
    return np.array(slips), total


def local_sum(axles, v, tau):
    """Sum of the adhesions by the law of each axle, written anew, on a fine grid."""
    e = np.geomspace(1e-3, 0.3, 4000)
    low, high = curves(e, v)
    k, W, total = tau * LOAD * (high.max() - low.max()), 0.0, 0.0
    for behind in range(axles - 1, -1, -1):
        share = -np.expm1(-tau * W)
        f = (1 - share) * low + share * high
        at = (np.log(f) + behind * k * np.maximum(1 - f / high.max(), 0) * e).argmax()
        total, W = total + f[at], W + LOAD * f[at] * e[at]
    return total


@pytest.mark.parametrize(("axles", "tau", "v"), [
    (2, 1e-4, 20.0), (4, 1.8e-4, 25.0), (8, 3.4e-5, 20.0), (8, 1e-4, 12.0), (16, 1e-4, 20.0),
])  # fmt: skip
def test_axles_that_go_by_the_plan_reach_the_optimum_over_a_rail_point(axles, tau, v):
    """Started from the fine program, a nonlinear program with exact slopes finds 2e-4 at most."""
    _, found = slips_of(axles, v, tau, *planned(axles, v, strength=tau))
    made = SlidingTrain(LEAVES, falling_creep, tuple(2.0 * np.arange(axles)), LOAD, tau, most=2.0)
    table, W, begin = program(made, v), 0.0, []
    for m in range(axles - 1, -1, -1):
        begin.append(float(np.interp(W, table.W, table.slip[m])))
        low, high = curves(begin[-1], v)
        share = -np.expm1(-tau * W)
        W += LOAD * begin[-1] * ((1 - share) * low + share * high)
    _, best = refined_point(made, v, np.array(begin))
    assert (1 - 1e-4) * best < found < (1 + 1e-6) * best


def test_three_axles_reach_what_brute_force_reaches():
    """.143733 at .300, .300, .0350 over 240^3 slips, computed apart from slipctl; tau 3e-4."""
    slips, total = slips_of(3, 20.0, 3e-4, *planned(3, 20.0, strength=3e-4))
    assert total == pytest.approx(0.143733, rel=1e-4)
    assert slips == pytest.approx([0.3, 0.3, 0.035], abs=2e-3)


@settings(max_examples=5, deadline=None)
@given(st.integers(2, 12), st.floats(1e-5, 3e-4), st.floats(6, 40))
def test_it_is_no_worse_than_the_law_of_each_axle(axles, tau, v):
    _, found = slips_of(axles, v, tau, *planned(axles, v, strength=tau))
    assert found > (1 - 1e-3) * local_sum(axles, v, tau)


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 8), st.floats(0, 3e-4), st.floats(2, 40))
def test_its_values_rise_with_the_share_and_with_each_axle_behind(axles, tau, v):
    """On cleaner rail nobody transmits less, and an axle more behind transmits something."""
    value, rate = planned(axles, v, strength=tau)
    assert rate == pytest.approx(tau * LOAD)
    assert (value[:, -1] == 0).all()
    assert (np.diff(value, axis=0) >= -1e-12).all()
    assert (np.diff(value, axis=1) < 0).all()
    # at the clean end each axle behind has the peak of the clean curve
    peak = curves(np.geomspace(1e-3, 0.3, 4000), v)[1].max()
    assert value[-1] == pytest.approx(peak * np.arange(axles - 1, -1, -1), rel=0.02)


def test_a_slope_of_the_values_is_the_worth_of_cleaning_by_finite_differences():
    """dV/dq of the first axle's column, against runs of the axles behind from two shares."""
    v, tau, axles = 20.0, 1e-4, 4
    value, rate = planned(axles, v, strength=tau)
    for k in (2, 6, 10):
        sums = []
        for node in (k, k + 1):
            before = -np.log1p(-NODES[node]) / tau  # what has been left on that rail
            W, total = before, 0.0
            for column in range(1, axles):
                share = -np.expm1(-tau * W)
                e = np.geomspace(1e-3, 0.3, 2000)
                low, high = curves(e, v)
                f = (1 - share) * low + share * high
                left = 1 - (1 - share) * np.exp(-rate * f * e)
                at = (f + np.interp(left, NODES, value[:, column])).argmax()
                total, W = total + f[at], W + LOAD * f[at] * e[at]
            sums.append(total)
        assert value[k + 1, 0] - value[k, 0] == pytest.approx(sums[1] - sums[0], rel=0.1)


def test_it_forgets_its_start_after_one_round_and_takes_the_strength_that_is_learnt():
    axles = 5
    block = plan_of(axles, learn=True)
    p = block.pack("param", block.param_values(strength=5e-5))
    u = block.pack("input", {"v": 20.0, "factor": 2.0})
    ends = []
    for begin in (0.0, 3.0):
        value = np.full((NODES.size, axles), begin)
        value[:, -1] = 0.0
        x = block.pack("state", block.start() | {"value": value})
        for _ in range(axles):
            x, y = block.f(x, u, p)
        ends.append(np.asarray(block.unpack("output", y)["value"]))
    assert (ends[0] == ends[1]).all()
    assert ends[0] == pytest.approx(planned(axles, 20.0, strength=1e-4)[0], rel=1e-12)


def test_no_axle_counts_on_more_than_the_brakes_behind_it_can_hold():
    """On clean rail, where they hold less than the rail gives."""
    value, _ = planned(4, 20.0, strength=1e-4)
    block = plan_of(4)
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values(most=0.08))
    for _ in range(4):
        x, y = block.f(x, block.pack("input", {"v": 20.0}), p)
    held = np.asarray(block.unpack("output", y)["value"])
    assert held[-1] == pytest.approx([0.24, 0.16, 0.08, 0.0])
    assert (held <= value + 1e-12).all()


@pytest.mark.parametrize(("axles", "learn"), [(1, False), (4, True)])
def test_a_train_has_one_plan_which_knows_what_the_file_believes(axles, learn):
    law = SlipLaw(kind="sta", reference=TrainSlip(plan=True, learn=learn, tau=5e-5, caution=0.5))
    block = vehicle_control(train(axles, controllers={"x": law}), law)
    values = block.param_values()
    assert float(values["plan.strength"]) == 5e-5
    assert float(values["plan.caution"]) == 0.5
    assert "reference.behind" not in values  # the plan knows the axles
    assert block.states["plan.value"].shape == (NODES.size, axles)
    assert ("rail.factor" in block.outputs) == learn


def test_a_state_machine_beside_it_has_neither_plan_nor_field():
    """The reference of the file is for those that follow one."""
    made = train(4, reference=TrainSlip(plan=True, learn=True),
                 controllers={"x": SlideProtection()})  # fmt: skip
    parts = {n.partition(".")[0] for n in vehicle_control(made, made.controllers["x"]).params}
    assert "machine" in parts
    assert not parts & {"plan", "rail"}


@pytest.mark.second
@pytest.mark.skipif(not HAS_COMPILER, reason="no C compiler on this machine")
@pytest.mark.parametrize(("block", "given"), [
    (plan_of(8, learn=True).with_params(strength=5e-5), ("factor",)),
    (AXLE, ("value", "rate")),
], ids=["plan", "axle"])  # fmt: skip
@pytest.mark.others("long")
def test_its_c_is_the_model_to_the_bit(block, given, tmp_path):
    """Some hundred ticks of a stop from 40 m/s, the strength and the adhesion on the move."""
    n, random = 300, np.random.default_rng(1)
    v = np.linspace(40.0, 0.0, n)
    value, rate = planned(8, 20.0, strength=1e-4)
    inputs = {
        "v": v, "factor": np.linspace(0.3, 3.0, n), "v_s": v * random.uniform(-0.01, 0.4, n),
        "mu": random.uniform(-0.01, 0.16, n), "rate": np.linspace(0.0, 2 * rate, n),
        "value": np.outer(np.linspace(0.5, 1.0, n), value[:, 0]),
    }  # fmt: skip
    inputs = {k: inputs[k] for k in block.inputs}
    assert set(given) <= set(inputs)
    module = c_module(block, tmp_path, "ctl", period=0.01).compile().load()
    module.reset()
    out = module.replay(inputs)
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values())
    for k in range(n):
        x, y = block.f(x, block.pack("input", {i: u[k] for i, u in inputs.items()}), p)
        for name, told in block.unpack("output", y).items():
            np.testing.assert_array_equal(
                np.ravel(out[name][k]), np.array(told).ravel(), f"{name}, {k}"
            )
