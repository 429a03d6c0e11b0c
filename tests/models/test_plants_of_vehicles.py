"""Which blocks a vehicle's plant is made of, and what its motors may give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, law
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.vehicle import Air, Lag, Vehicle
from slipctl.models.vehicle.parts import DynamicBrake
from slipctl.models.vehicle.plant import motor_limit, on_train, plant

VEHICLE = Vehicle(
    mass=40e3, places=(0.0, 8.0, 16.0), axles=3, inertia=100.0, radius=0.5, speed=20.0
)
AIR = Air(torque=6e3, reaction=0.05)


@pytest.mark.parametrize(
    ("power", "top", "omega", "torque", "given"),
    [
        (1e5, None, 10.0, 5e3, 5e3), (1e5, None, -40.0, 5e3, 2500.0), (1e5, None, 40.0, 2e3, 2e3),
        (None, 20.0, 39.9, 5e3, 5e3), (None, 20.0, 40.1, 5e3, 0.0), (None, 20.0, -40.1, 5e3, 0.0),
        (1e5, 20.0, 30.0, 5e3, 1e5 / 30), (1e5, 20.0, 0.0, 5e3, 5e3),
    ],
)  # fmt: skip
def test_a_motor_gives_its_power_and_nothing_above_its_top(power, top, omega, torque, given):
    made = motor_limit(Lag(torque=9e3, lag=0.1, power=power, top=top), 0.5)
    assert float(made(T=torque, omega=omega)["T_m"]) == pytest.approx(given)


@pytest.mark.parametrize(
    ("reaction", "motors", "shape"), [(0.05, True, (3,)), (0.05, False, ()), (0.0, True, None)]
)
def test_a_demand_waits_for_the_reaction_of_each_axle_where_motors_take_a_share(
    reaction, motors, shape
):
    brake = DynamicBrake(torque=2e3, axles=(1, 3)) if motors else None
    vehicle = replace(VEHICLE, dynamic_brake=brake)
    made = plant(vehicle, replace(AIR, reaction=reaction), double_exponential)
    if shape is None:
        assert "reaction" not in made.parts
    else:
        assert made.parts["reaction"].outputs["y"].shape == shape
    assert ("motors" in made.parts) == motors
    if motors:
        tops = made.param_values()["motors.T_top"]
        assert list(np.ravel(tops)) == [2e3, 0.0, 2e3]


@pytest.mark.parametrize("names", [("v_s", "T"), ("v",), ("lam", "v_s")])
def test_what_is_no_law_of_a_train_is_refused(names):
    units = {"v_s": "m/s", "v": "m/s", "lam": "1", "T": "N m"}
    given = ", ".join(f"{n}=Input('{units[n]}', 'in')" for n in names)
    made: dict = {"Input": Input}
    exec(f"def odd({given}): return 0.1", made)
    block = law(mu=Output("1", "adhesion"))(made["odd"])
    with pytest.raises(BadInput, match=f"odd has the inputs {', '.join(names)}"):
        on_train(block)
