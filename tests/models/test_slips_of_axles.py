"""Slips that are given for each axle, and a speed that no held axle pulls down."""

from dataclasses import replace

import numpy as np
import pytest

from slipctl import BadInput, simulate
from slipctl.models.vehicle import ScheduledPI, SlipRatio, case
from slipctl.models.vehicle.certificate.gains import _goal
from slipctl.models.vehicle.measurement.fused_speed import axle_weights
from tests.models.test_slide_protection import train


def test_each_axle_goes_to_its_own_slip():
    slips = (0.2, 0.15, 0.1, 0.05)
    made = train(4, controllers={"x": ScheduledPI(reference=SlipRatio(slip=slips))})
    found = case(made)
    log = simulate(found.loops["x"], found.scenario.but(duration=2.0, end=None),
                   log=["ctl.reference.v_best", "ctl.trust.v"], every=100)  # fmt: skip
    last = log["ctl.reference.v_best"].values[-1] / log["ctl.trust.v"].values[-1]
    assert last == pytest.approx(slips, rel=1e-9)


@pytest.mark.parametrize("slips", [(), (0.1, 0.2), (0.1,) * 5])
def test_slips_of_another_number_of_axles_are_refused(slips):
    with pytest.raises(BadInput, match=r"controllers.x.reference.slip: has \d values for 4 axles"):
        train(4, controllers={"x": ScheduledPI(reference=SlipRatio(slip=slips))})
    with pytest.raises(BadInput, match="outside"):
        SlipRatio(slip=(0.1, 2.0))


def test_a_certificate_is_of_one_slip():
    with pytest.raises(BadInput, match="one slip for all axles"):
        _goal(None, "", {}, 20.0, SlipRatio(slip=(0.1, 0.2)))


@pytest.mark.parametrize(("held", "weight"), [(0.0, True), (1.0, False)])
def test_an_axle_that_slip_control_holds_says_nothing_of_the_speed(held, weight):
    """It slides by 1 % and agrees in speed and acceleration, as one that rolls would."""
    block = axle_weights(2).with_params(r=0.46, v_start=20.0)
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values())
    u = block.pack("input", {"omega": np.full(2, 19.8 / 0.46), "torque": np.full(2, 3e3),
                             "held": np.full(2, held), "a": 0.0, "v": 20.0, "b": 0.0,
                             "P": 1e-3})  # fmt: skip
    for _ in range(2000):
        x, y = block.f(x, u, p)
    assert (float(block.unpack("output", y)["weight"]) > 0) == weight
    # an axle that is let go speaks, whoever holds it
    free = block.unpack("input", u) | {"torque": np.zeros(2)}
    for _ in range(2000):
        x, y = block.f(x, block.pack("input", free), p)
    assert float(block.unpack("output", y)["weight"]) == 1.0


@pytest.mark.long
def test_a_small_slip_on_all_axles_does_not_pull_the_estimated_speed_down():
    """Each axle at its own peak, 2 % of the speed: the estimate would follow the rims."""
    from slipctl.studies.leaf_fall.trains import RIVALS, trip

    made = replace(trip(), controllers={"x": RIVALS["own_slip"]})
    found = case(made)
    log = simulate(found.loops["x"], found.scenario.but(duration=12.0, end=None),
                   log=["speed.v_m", "speed.error", "plant.train.v"], every=10)  # fmt: skip
    off = np.abs(log["speed.v_m"].values - log["plant.train.v"].values)
    assert off.max() < 0.5
    assert (off <= log["speed.error"].values).all()
