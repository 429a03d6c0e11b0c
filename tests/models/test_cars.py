"""A vehicle by its cars: where axles are, what they carry, and how the load moves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput, simulate
from slipctl.models.brake_pads import friction
from slipctl.models.vehicle import (
    Constant,
    Davis,
    DemandAlone,
    Exact,
    Lag,
    Sensors,
    SlipSpeed,
    Stretch,
    Track,
    Trip,
    Vehicle,
    loop,
    parts,
    scenario,
)
from slipctl.models.vehicle.parts import Car, Pads, plausibility

COACH = Car(
    mass=32e3 + 2 * 2.615e3 + 4 * 1.813e3, wheelbase=2.56, bogie_centres=19.0, length=26.4,
    height=1.8, pivot_height=0.8, bogie_mass=2.615e3, bogie_height=0.6, wheelset_mass=1.813e3,
)  # fmt: skip
BOBO = Car(
    mass=59.364e3 + 2 * 5.631e3 + 4 * 1.8435e3, wheelbase=3.0, bogie_centres=11.46, length=19.0,
    height=1.9, pivot_height=0.5, bogie_mass=5.631e3, bogie_height=0.7, wheelset_mass=1.8435e3,
)  # fmt: skip


def train(*cars, **changes):
    given_ = dict(cars=cars, inertia=100.0, radius=0.46, speed=20.0)
    return Vehicle(**given_ | changes)


def trip(vehicle, **changes):
    given_ = dict(
        duration=4.0, vehicle=vehicle, actuator=Lag(torque=12e3),
        rail=Track(law="falling_creep", sections=(Stretch(place=0.0, condition="clean"),)),
        demand=Constant(deceleration=1.0), controllers={"none": DemandAlone()},
        sensors=Sensors(wheel_speed=Exact()), reference=SlipSpeed(slip=1.0),
    )  # fmt: skip
    return Trip(**given_ | changes)


def run(trip_, name="none"):
    return simulate(loop(trip_, name), scenario(trip_))


def test_load_moves_in_a_coach_as_computed_apart():
    """practice_cases section 4, coach at 1 m/s2: +6.51, -4.97, +4.97, -6.51 %."""
    vehicle = train(COACH)
    moved = np.array(vehicle.moved) / (np.array(vehicle.carried) * 9.81)
    assert 100 * moved == pytest.approx([6.51, -4.97, 4.97, -6.51], abs=0.005)


def test_load_moves_in_a_locomotive_as_computed_apart():
    """BoBo at mean adhesion .3: the first axle loses 16.2 %, equal forces use 83.8 %."""
    vehicle = train(BOBO, radius=0.525)
    moved = -0.3 * np.array(vehicle.moved) / np.array(vehicle.carried)  # it accelerates
    assert 100 * moved[0] == pytest.approx(-16.2, abs=0.05)
    assert 1 + moved.min() == pytest.approx(0.838, abs=5e-4)


@given(st.floats(1.0, 3.0), st.floats(0.2, 1.2), st.floats(0.0, 4e3), st.floats(0.0, 2e3),
       st.integers(0, 3), st.integers(1, 3))  # fmt: skip
def test_moments_about_the_rail_agree(height, pivot, bogie, wheelset, bogies, each):
    """Sum of dN x is the moment of the inertial forces, of any car; the sum of dN is 0."""
    axles = max(bogies, 1) * each
    car = Car(mass=40e3, axles=axles, bogies=bogies, length=60.0, height=height, bogie_mass=bogie,
              pivot_height=pivot, wheelbase=2.5, wheelset_mass=wheelset,
              bogie_centres=14.0)  # fmt: skip
    dN, x = np.array(car.moved(0.46)), np.array(car.offsets)
    below = bogies * bogie + axles * wheelset
    moment = (40e3 - below if bogies else 40e3 - axles * wheelset) * height
    moment += bogies * bogie * 0.6 + axles * wheelset * 0.46
    if not bogies and axles == 1:
        return  # one axle alone carries no moment
    if bogies == 1 or (bogies and each == 1):  # what no pair of supports takes up is left out
        return
    assert dN @ (x.mean() - x) == pytest.approx(moment, rel=1e-9)
    assert dN.sum() == pytest.approx(0, abs=1e-9 * moment)


def test_places_follow_the_lengths_of_the_cars():
    """The first axle is at 0; couplers between the cars take no length."""
    vehicle = train(replace(COACH, count=2), BOBO)
    assert vehicle.axles == 12
    first, second, third = (np.array(vehicle.behind[k : k + 4]) for k in (0, 4, 8))
    assert first.tolist() == [0, 2.56, 19, 21.56]
    assert second - first == pytest.approx(26.4)
    last_gap = (26.4 - 21.56) / 2 + (19.0 - 14.46) / 2
    assert third[0] - second[-1] == pytest.approx(last_gap)
    assert vehicle.total == pytest.approx(2 * COACH.total + BOBO.total)


@pytest.mark.second
def test_an_axle_that_loses_load_slides_first():
    """At a demand that the mean load carries, the last axle of a coach slides, the first does not.

    The bound: an axle holds while demand m_i a < mu_max N_i.
    """
    vehicle = train(COACH)
    demand = 0.97 * 0.131 * 9.81  # the peak of clean rail is 0.131 at 20 m/s
    log = run(trip(vehicle, demand=Constant(deceleration=demand)))
    slip = np.abs(log["plant.train.v_s"].values)
    assert slip[-1, 3] > 5.0
    assert slip[-1, 0] < 0.5
    even = run(trip(train(replace(COACH, height=None)), demand=Constant(deceleration=demand)))
    assert np.ptp(even["plant.train.v_s"].values[-1]) < 1e-9
    F, a = log["plant.train.F"].values, log["plant.train.a"].values
    N = np.array(vehicle.carried) * 9.81 - np.array(vehicle.moved) * np.append(0, a[:-1])[:, None]
    assert log["plant.train.mu"].values == pytest.approx(F / N, rel=1e-12)


def test_cars_of_different_mass_brake_as_one():
    """Unequal loads and inertias: on rail that carries it, m a is the sum of rims and wheels."""
    light, heavy = Car(mass=30e3, inertia=80.0), Car(mass=60e3, inertia=200.0, radius=0.5)
    vehicle = train(light, heavy, inertia=None, rotating_mass=0.1)
    assert vehicle.carried == (7.5e3,) * 4 + (15e3,) * 4
    log = run(trip(vehicle, duration=2.0, demand=Constant(deceleration=0.6)))
    turning = 4 * 80 / 0.46**2 + 4 * 200 / 0.5**2
    T = log["plant.T"].values
    force = (T[:, :4] / 0.46).sum(axis=1) + (T[:, 4:] / 0.5).sum(axis=1)
    wanted = force / (90e3 + turning)
    assert -log["plant.train.a"].values[-1] == pytest.approx(wanted[-1], rel=2e-3)
    powers = sum(log[f"plant.train.P_{n}"].values.sum() for n in ("brake", "slip", "d", "bearing"))
    v, w = (log[f"plant.train.{n}"].values for n in ("v", "omega"))
    J = np.array(vehicle.inertias)
    energy = 90e3 * v**2 / 2 + (J * w**2).sum(axis=1) / 2
    taken = (powers - sum(log[f"plant.train.P_{n}"].values[-1] for n in
                          ("brake", "slip", "d", "bearing"))) * 1e-3  # fmt: skip
    assert energy[0] - energy[-1] == pytest.approx(taken, rel=1e-12)


def test_the_mass_of_a_train_of_cars_can_be_set():
    """The loads of the axles keep their shares of it."""
    found = loop(trip(train(Car(mass=30e3), Car(mass=60e3))), "none").with_params(m=180e3)
    loads = found.param_values()["plant.train.m_axle"]
    assert loads == pytest.approx([15e3] * 4 + [30e3] * 4)
    assert float(found.param_values()["m"]) == 180e3


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: train(COACH, mass=40e3), "mass: the cars have it"),
        (lambda: train(COACH, places=(0.0, 2.0, 14.0, 16.0)), "places: the cars have it"),
        (lambda: train(COACH, axles=8), "axles: is 8, and the cars have 4"),
        (lambda: train(replace(COACH, count=9)), "cars: the cars have 36 axles"),
        (lambda: Car(mass=40e3, axles=5), "bogies: 5 axles"),
        (lambda: Car(mass=40e3, length=12.0), "length: is 12 m"),
        (lambda: Car(mass=4e3, bogie_mass=3e3), "bogie_mass: bogies and wheelsets"),
        (lambda: Car(load=1e3), "mass: the car has neither"),
        (lambda: Car(mass=4e4, load=1e3), "load: load is for a car with tare"),
        (lambda: train(Car(mass=40e3, bogie_centres=2.5)), "cars: axles 2 and 3 are 0.4 m apart"),
        (lambda: train(Car(mass=40e3, inertia=90.0), inertia=None, rotating_mass=0.1), None),
    ],
)  # fmt: skip
def test_cars_that_do_not_fit_are_refused(make, words):
    if words is None:
        assert make().inertias == (90.0,) * 4
        return
    with pytest.raises(BadInput) as refused:
        make()
    assert words in str(refused.value)


def test_running_resistance_by_mass_is_that_of_all_cars():
    vehicle = train(Car(mass=30e3), Car(mass=60e3), resistance=Davis(a=900.0))
    assert vehicle.resistance.of(vehicle.total)[0] == 900.0


# ---- pads ----------------------------------------------------------------------------------------


def test_friction_of_the_materials_has_the_numbers_of_its_source():
    """practice_models 6.5: cast iron at 20 kN .305, .122, .096 at 0, 60, 120 km/h."""
    found = [friction("cast_iron", 20e3, v / 3.6) for v in (0, 60, 120)]
    assert found == pytest.approx([0.305, 0.122, 0.096], abs=5e-4)
    assert friction("composite", 20e3, 100 / 3.6) == pytest.approx(0.3 - 0.081)
    assert friction("cosid", 1e3, 50.0) == 0.27
    assert friction("disc", 10e3, 0.0) == pytest.approx(0.2375 + 0.00885 - 0.0345)


@pytest.mark.second
def test_cast_iron_brakes_harder_as_the_train_slows():
    """The torque at the wheel is that of the actuator times the friction by the nominal one."""
    vehicle = train(Car(mass=60e3), pads=Pads(material="cast_iron", nominal=0.15, blocks=16))
    log = run(trip(vehicle, demand=Constant(deceleration=0.4), duration=30.0))
    k = [np.argmax(log["plant.train.v"].values < v) for v in (18.0, 10.0, 2.0)]
    T, T_b = log["plant.T"].values[:, 0], log["plant.pads.T_b"].values[:, 0]
    for row in k:
        force = T[row] / (0.15 * 0.46 * 16)
        rim = log["plant.train.omega"].values[row, 0] * 0.46
        assert T_b[row] / T[row] == pytest.approx(friction("cast_iron", force, rim) / 0.15)
    assert T_b[k[2]] / T[k[2]] > 1.5 * T_b[k[0]] / T[k[0]]


@pytest.mark.second
def test_hot_pads_fade_and_their_heat_is_that_of_the_brake():
    """C theta is the energy that the brake has taken, where nothing cools."""
    pads = Pads(material="cosid", heat_capacity=1e4, fade=1e-3, fade_from=20.0)
    log = run(trip(train(Car(mass=60e3), pads=pads), demand=Constant(deceleration=0.6)))
    theta = log["plant.pads.theta"].values
    taken = np.cumsum(log["plant.train.P_brake"].values)[:-1] * 1e-3
    assert 1e4 * theta[1:].sum(axis=1) == pytest.approx(taken, rel=1e-3, abs=200)
    hot = theta[-1, 0] - 20
    assert hot > 20
    assert log["plant.pads.mu_pad"].values[-1, 0] == pytest.approx(0.27 * (1 - 1e-3 * hot))


def test_pads_that_say_nothing_are_refused():
    with pytest.raises(BadInput, match="fade: pads without heat_capacity"):
        Pads(fade=0.01)
    with pytest.raises(BadInput, match="pads: are of a braked vehicle"):
        train(Car(mass=60e3), pads=Pads(), mode="drive")
    strong = train(Car(mass=60e3), Car(mass=60e3, pads=Pads(material="disc", blocks=2)))
    with pytest.raises(BadInput, match=r"vehicle.cars.1.pads.blocks: 12000 N m are"):
        trip(strong)


@pytest.mark.parametrize("mode", ["brake", "drive"])
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_an_axle_that_carries_nothing_is_told(mode, share):
    """Of a car of two axles the rear one lifts at a = g b/(2 h) of the body on wheels without mass.

    Braked it is the second axle, driven the first one.
    """
    car = parts.Car(mass=24e3, axles=2, bogies=0, wheelbase=2.5, height=3.0, length=10.0)
    vehicle = parts.Vehicle(cars=(car,), speed=20.0, mode=mode, inertia=100.0)
    level = share * 9.81 * 2.5 / (2 * 3.0)
    word = "deceleration" if mode == "brake" else "acceleration"
    demand = parts.Constant(**{word: level})
    lines = list(plausibility._lifted(SimpleNamespace(vehicle=vehicle, demand=demand)))
    assert len(lines) == (share > 1)
    assert all(f"axle {2 if mode == 'brake' else 1} carries nothing" in k for k in lines)
