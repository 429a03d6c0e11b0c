"""Which blocks a vehicle's plant is made of, and what its motors may give."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, law, make_block
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.vehicle import Air, Lag, Vehicle
from slipctl.models.vehicle.cars import load_transfer, masses_of_axles, wheelset_that_twists
from slipctl.models.vehicle.parts import Car, DynamicBrake, Torsion
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


UNITS = {"v_s": "m/s", "v": "m/s", "lam": "1", "mu": "1"}


@pytest.mark.parametrize(
    ("name", "unit"),
    [("v_s", "rad/s"), ("v_s", "km/h"), ("v_s", "1"), ("v", "km/h"), ("lam", "%"), ("mu", "N")],
)
def test_a_law_in_other_units_than_the_wheels_is_refused(name, unit):
    """The train gives it metres per second, whatever it calls them."""
    given = UNITS | {name: unit}
    slip = "lam" if name == "lam" else "v_s"
    inputs = [Input(given[n], n).named(n) for n in (slip, "v")]
    out = [Output(given["mu"], "adhesion").named("mu")]

    def body(x, u, p):
        return {}, {"mu": u[slip] / (1 + abs(u["v"]))}

    with pytest.raises(BadInput, match=rf"odd: {name} is in \[{unit}\]"):
        on_train(make_block("odd", "law", body, inputs=inputs, outputs=out))


@pytest.mark.parametrize(
    "body", [lambda s: (s, 3.0), lambda s: ca.vertcat(s, s), lambda s: s * ca.SX.sym("q")],
    ids=["tuple", "vector", "stranger"],
)  # fmt: skip
def test_a_law_that_gives_no_one_number_is_refused_by_its_name(body):
    def odd(v_s=Input("m/s", "slip")):
        return body(v_s)

    with pytest.raises(BadInput, match=r"odd.*mu"):
        on_train(law(mu=Output("1", "adhesion"))(odd))


def test_a_law_is_meant_up_to_the_end_of_the_range_of_its_slip():
    def ranged(v_s=Input("m/s", "slip", lo=-1.5, hi=1.5)):
        return 0.1 * v_s

    assert on_train(law(mu=Output("1", "mu"))(ranged)).law_data.meant_to == 1.5
    assert on_train(law(mu=Output("1", "mu"), meant_to=1.0)(ranged)).law_data.meant_to == 1.0


def test_a_driven_wheelset_has_a_half_of_what_is_left_beside_its_rotor_in_each_wheel():
    driven = replace(VEHICLE, mode="drive", inertia=130.0, radius=(0.5, 0.4, 0.4),
                     driven=(2, 3), gravity=9.8)  # fmt: skip
    assert wheelset_that_twists(driven) is None
    two = wheelset_that_twists(replace(driven, torsion=Torsion(stiffness=3e6, damping=0.02)))
    assert (two.inertias, two.stiffness, two.wheels) == ((65, 65), (3e6,), (0, 1))
    part = Torsion(stiffness=3e6, rotor=30.0, shaft=1e6)
    three = wheelset_that_twists(replace(driven, torsion=part))
    assert (three.inertias, three.stiffness) == ((30, 50, 50), (1e6, 3e6))
    assert (three.wheels, three.damping, two.damping) == ((1, 2), 0.005, 0.02)
    for one in (two, three):
        assert (one.load, one.radius) == pytest.approx((40e3 / 3 * 9.8 / 2, 0.4))


CAR = Car(mass=40e3, axles=4, bogies=2, wheelbase=2.5, bogie_centres=14.0, length=20.0, height=1.8,
          pivot_height=0.6, bogie_mass=3e3, bogie_height=0.5, wheelset_mass=1500.0)  # fmt: skip


@pytest.mark.parametrize(
    "car",
    [CAR, replace(CAR, bogies=0, axles=2, wheelbase=8.0, bogie_mass=0.0)],
    ids=["bogies", "axles"],
)
def test_load_that_moves_has_the_moment_of_the_inertial_forces(car):
    """Its sum is 0; about the rail it balances body, bogies and wheelsets at their heights."""
    radius = 0.46
    moved, at = np.array(car.moved(radius)), np.array(car.offsets)
    assert moved.sum() == pytest.approx(0, abs=1e-6)
    sets, frames = car.axles * car.wheelset_mass, car.bogies * car.bogie_mass
    moment = (car.total - sets - frames) * car.height + frames * car.bogie_height + sets * radius
    assert -(moved @ at) == pytest.approx(moment)
    assert moved[0] > 0  # the first axle is loaded by deceleration
    assert car.moved(radius)[0] < replace(car, height=2.5).moved(radius)[0]
    assert replace(car, height=None).moved(radius) == (0.0,) * car.axles


def test_what_each_axle_carries_and_gains_stands_in_the_train():
    alike = masses_of_axles(VEHICLE)
    assert alike == {"J": 100.0, "m_axle": pytest.approx(40e3 / 3)}
    cars = replace(VEHICLE, mass=None, places=None, axles=None,
                   cars=(CAR, replace(CAR, mass=20e3)))  # fmt: skip
    found = masses_of_axles(cars)
    each = np.array([10e3] * 4 + [5e3] * 4)
    assert found["share"] == pytest.approx(each / 60e3)
    transfer = load_transfer(cars)
    dN = np.ravel(transfer(a_last=-1.5, a=0.0)[1]["dN"])
    assert dN == pytest.approx(1.5 * np.array(cars.moved))
    assert float(transfer(a_last=-1.5, a=0.7)[0]["a_last"]) == 0.7
