"""Limits from which a trip is told to be unlike any train: from both sides, axles that differ."""

from __future__ import annotations

from types import SimpleNamespace as Of

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, law
from slipctl.models.vehicle import adhesion
from slipctl.models.vehicle.parts import (
    Accelerometer,
    Air,
    Constant,
    Lag,
    NoisySpeed,
    NoisyWheel,
    SlipRatio,
    SlipSpeed,
    ToothWheel,
    plausibility,
)

RADII = (0.5, 0.4, 0.25)


def vehicle(**changes):
    usual = dict(radii=RADII, worked=(0, 1, 2), axles=3, total=20e3, speed=20.0, gravity=9.8,
                 wheel_radius=0.4, mode="brake", track_brake=None, dynamic_brake=None,
                 carried=(6e3, 7e3, 7e3), moved=(9e3, 1e3, -1e4))  # fmt: skip
    return Of(**usual | changes)


def told(which, **given):
    return [line.partition(" ")[0] for line in which(Of(**given))]


@pytest.mark.parametrize(("act", "speed", "said"), [
    (Lag(torque=5e3, top=20.1), 20.0, []), (Lag(torque=5e3, top=20.0), 20.0, ["actuator.top:"]),
    # .02 m/s^2 of 20 t at 20 m/s are 8 kW, of three axles
    (Lag(torque=5e3, power=2670.0), 20.0, []),
    (Lag(torque=5e3, power=2660.0), 20.0, ["actuator.power:"]),
    (Lag(torque=5e3, power=134.0), 0.3, []), (Lag(torque=5e3, power=133.0), 0.3,
                                              ["actuator.power:"]),
    (Lag(torque=5e3, rate=501.0), 20.0, []), (Lag(torque=5e3, rate=500.0), 20.0,
                                              ["actuator.rate:"]),
    (Air(torque=5e3, weighed=8.01e3), 20.0, []),
    (Air(torque=5e3, weighed=7.99e3), 20.0, ["actuator.weighed:"]),
    (Air(torque=5e3, weighed=49.9e3), 20.0, []),
    (Air(torque=5e3, weighed=50.1e3), 20.0, ["actuator.weighed:"]),
    (Air(torque=5e3), 20.0, []),
])  # fmt: skip
def test_an_actuator_that_gives_next_to_nothing_or_too_late(act, speed, said):
    trip = dict(vehicle=vehicle(speed=speed), actuator=act, duration=10.0)
    assert told(plausibility._actuated, **trip) == said


def magnets(attraction, friction=0.2):
    return {"track_brake": Of(attraction=attraction, friction=friction)}


def motors(torque, axles=None, power=None):
    return {"dynamic_brake": Of(torque=torque, axles=axles, power=power)}


ATTRACTION, TORQUE, POWER = (f"vehicle.{n}:" for n in (
    "track_brake.attraction", "dynamic_brake.torque", "dynamic_brake.power"))  # fmt: skip


@pytest.mark.parametrize(("parts", "said"), [
    (magnets(2.01e3), []), (magnets(1.99e3), [ATTRACTION]), (magnets(5.99e5), []),
    (magnets(6.01e5), [ATTRACTION]), (magnets(4.01e3, 0.1), []),
    # 400 N of axles of half a metre, of .4 and of a quarter: 1/(2 + 2.5 + 4)
    (motors(400 / 8.4), []), (motors(400 / 8.6), [TORQUE]),
    (motors(400 / 5.9, (1, 3)), []), (motors(400 / 6.1, (1, 3)), [TORQUE]),
    (motors(400 / 2.4, (2,)), []), (motors(400 / 2.6, (2,)), [TORQUE]),
    (motors(1.2e5 / 8.6), []), (motors(1.2e5 / 8.4), [TORQUE]),
    (motors(400.0, None, 2670.0), []), (motors(400.0, None, 2660.0), [POWER]),
    (motors(400.0, (1, 3), 4010.0), []), (motors(400.0, (1, 3), 3990.0), [POWER]),
])  # fmt: skip
def test_magnets_and_motors_that_brake_next_to_nothing_or_more_than_any(parts, said):
    assert told(plausibility._beside, vehicle=vehicle(**parts)) == said


@pytest.mark.parametrize(("demand", "mode", "axle"), [
    # the last axle carries 7 t and loses 10 kN by m/s^2; the first gains, and loses where it drives
    (Constant(deceleration=6.85), "brake", None), (Constant(deceleration=6.87), "brake", 3),
    (Constant(force=1.37e5), "brake", None), (Constant(force=1.374e5), "brake", 3),
    (Constant(acceleration=6.52), "drive", None), (Constant(acceleration=6.54), "drive", 1),
    (Of(deceleration=(1.0, 6.87, 2.0)), "brake", 3), (Of(), "brake", None),
])  # fmt: skip
def test_an_axle_that_carries_nothing_is_named(demand, mode, axle):
    lines = list(plausibility._lifted(Of(vehicle=vehicle(mode=mode), demand=demand)))
    assert len(lines) == (axle is not None)
    if axle:
        assert f"axle {axle} carries nothing" in lines[0]


def measured(**changes):
    sensors = dict(wheel_speed=Of(), vehicle_speed=Of(), accelerometer=None)
    usual = dict(vehicle=vehicle(), references={}, pulled=1.3, believed=RADII,
                 sensors=Of(**sensors | changes.pop("sensors", {})))  # fmt: skip
    return told(plausibility._measured, **usual | changes)


def sensor(**parts):
    return {"sensors": parts}


WHEEL, SPEED = "sensors.wheel_speed.", "sensors.vehicle_speed."


@pytest.mark.parametrize(("changes", "said"), [
    (dict(references={"reference": SlipSpeed(slip=19.9)}), []),
    (dict(references={"reference": SlipSpeed(slip=20.0)}, vehicle=vehicle(speed=19.9)),
     ["reference.slip:"]),
    (dict(references={"a": SlipRatio(slip=0.1, least=5.0)}, vehicle=vehicle(speed=4.9)),
     ["a.least:"]),
    (dict(references={"a": SlipRatio(slip=0.1, least=5.0)},
          vehicle=vehicle(speed=4.9, mode="drive")), []),
    (dict(references={"a": SlipRatio(slip=0.1, least=5.0)}, vehicle=vehicle(speed=0.0)), []),
    (dict(references={"a": SlipRatio(slip=(0.1, 0.51, 0.2))}), ["a.slip:"]),
    (dict(references={"a": SlipRatio(slip=(0.1, 0.5, 0.2)), "b": None}), []),
    (sensor(vehicle_speed=Of(rate=0.49)), [SPEED + "rate:"]),
    (sensor(vehicle_speed=Of(rate=0.51)), []), (sensor(vehicle_speed=Of(rate=None)), []),
    (dict(pulled=0.6) | sensor(vehicle_speed=Of(rate=0.31)), []),
    (dict(pulled=0.6) | sensor(vehicle_speed=Of(rate=0.29)), [SPEED + "rate:"]),
    (dict(believed=(0.5, 0.439, 0.25)), []), (dict(believed=(0.5, 0.441, 0.9)),
                                              ["control.radius:"]),
    (dict(believed=(0.5, 0.361, 0.25)), []), (dict(believed=(0.5, 0.359, 0.25)),
                                              ["control.radius:"]),
    (dict(believed=(0.25,), vehicle=vehicle(worked=(2,))), []),
    # of a wheel of .4 m in rad/s
    (sensor(wheel_speed=NoisyWheel(deviation=2.49)), []),
    (sensor(wheel_speed=NoisyWheel(deviation=2.51)), [WHEEL + "deviation:"]),
    (sensor(vehicle_speed=NoisySpeed(step=0.99)), []),
    (sensor(vehicle_speed=NoisySpeed(step=1.01)), [SPEED + "step:"]),
    (sensor(accelerometer=Accelerometer(bias=-1.01)), ["sensors.accelerometer.bias:"]),
    (sensor(accelerometer=Accelerometer(bias=-0.99)), []),
    (sensor(vehicle_speed=NoisySpeed(dropout=0.5)), []),
    (sensor(vehicle_speed=NoisySpeed(dropout=0.51)), [SPEED + "dropout:"]),
    # a tooth in 2 pi .4/90/20 s, 1.4 ms; a tenth of that, and teeth 50 ms apart
    (sensor(wheel_speed=ToothWheel(teeth=90, clock=1.39e-4)), []),
    (sensor(wheel_speed=ToothWheel(teeth=90, clock=1.41e-4)), [WHEEL + "clock:"]),
    (sensor(wheel_speed=ToothWheel(teeth=90, jitter=1.39e-4)), []),
    (sensor(wheel_speed=ToothWheel(teeth=90, jitter=1.41e-4)), [WHEEL + "jitter:"]),
    (dict(vehicle=vehicle(speed=0.56)) | sensor(wheel_speed=ToothWheel(teeth=90)), []),
    (dict(vehicle=vehicle(speed=0.55)) | sensor(wheel_speed=ToothWheel(teeth=90)),
     [WHEEL + "teeth:"]),
    (dict(vehicle=vehicle(speed=0.0)) | sensor(wheel_speed=ToothWheel(teeth=90)), []),
])  # fmt: skip
def test_what_is_wanted_and_measured_has_limits(changes, said):
    assert measured(**changes) == said


@pytest.mark.parametrize(("sections", "places", "end", "said"), [
    ([(0, None), (1.0, None), (1.99, None), (9, None)], [], None, ["rail.sections.1:"]),
    ([(0, None), (0.99, None), (2.0, None), (9, None)], [], None, ["rail.sections.0:"]),
    ([(None, 0), (None, 0.1), (None, 0.19)], [], None, ["rail.sections.1:"]),
    ([(0, None)], [(5.0, 6.0), (7.0, 7.99)], None, ["rail.contamination.places.1:"]),
    ([(0, None)], [], (0.99, "m"), ["demand.until:"]), ([(0, None)], [], (1.0, "m"), []),
    ([(0, None)], [], (0.099, "s"), ["demand.until:"]), ([(0, None)], [], (0.1, "s"), []),
])  # fmt: skip
def test_what_is_over_before_a_brake_answers(sections, places, end, said):
    demand = Constant(deceleration=1.0, until="" if end is None else f"{end[0]} {end[1]}")
    layer = Of(places=[Of(begin=a, end=b) for a, b in places]) if places else None
    rail = Of(sections=[Of(place=a, time=b) for a, b in sections], contamination=layer)
    assert told(plausibility._short, rail=rail, demand=demand) == said


# ---- adhesion ------------------------------------------------------------------------------------

SLIPS = np.array([0.0, 1e-6, 0.5, 1.5, 2.5])


@pytest.mark.parametrize(("mu", "said"), [
    ([0, 1e-5, 0.2, 0.3, 0.1], ""), ([0, 1e-5, 0.2, np.nan, np.inf], "no number at a slip of 1.5"),
    ([0.02, 0.021, 0.2, 0.3, 0.1], "adhesion is 0.02 without slip"),
    ([0, 0.011, 0.2, 0.3, 0.1], "adhesion is 0.011 without slip"),
    ([0, 0.0099, 0.2, 0.3, 0.1], ""), ([0, 1e-5, 0.2, -0.03, -0.1], "-0.03 at a slip of 1.5 m/s"),
    ([0, -1e-8, 0.2, -0.03, -0.1], "-0.03 at a slip of 1.5"),
    ([0, 1e-5, 0.2, 1.01, 1.3], "above 1 from a slip of 1.5 m/s at 7 on, 1.3 at"),
    ([0, 1e-5, 1.0, 0.3, 0.1], ""), ([0, 1e-5, 4.9, 6.0, 0.1], "a coefficient in percent"),
    ([0, 1e-10, 0.2, 0.3, -0.9e-9], ""), ([0, 0.0, 0.2, 0.3, -1.1e-9], "wrong sign"),
])  # fmt: skip
def test_what_no_adhesion_is(mu, said):
    found = adhesion._fault(SLIPS, np.array(mu, dtype=float), " at 7")
    assert (said in found) if said else not found
    assert ("percent" in found) == (6.0 in mu)


def test_a_law_is_told_where_it_is_above_its_own_range():
    block = Of(outputs={"mu": Of(lo=-0.4, hi=0.3)})
    assert adhesion._beyond(block, np.array([0.1, 0.4, 0.2])) == ""
    assert "0.41 at most, and the law's own range ends at 0.4" in adhesion._beyond(
        block, np.array([0.1, 0.41, 0.2]))  # fmt: skip


@law(mu=Output("1", "adhesion", positive="traction"))
def rising(
    v_s=Input("m/s", "creep", positive="traction", per="speed"),
    v=Input("m/s", "speed"),
    top=Param("1", 0.3, "height", "test", lo=0.01, hi=1),
    bend=Param("m/s", 2.0, "slip of the peak", "test", lo=0.1, hi=9),
    gain=Param("s/m", 0.01, "rise with the speed", "test", lo=-1, hi=1),
):
    """Odd, its peak at ``bend``."""
    return 2 * top * bend * v_s / (v_s**2 + bend**2) * (1 + gain * (v**2) ** 0.5)


def test_an_adhesion_that_rises_with_the_speed():
    slow, fast = adhesion.rise_with_speed(rising, {"top": 0.2, "gain": 0.03}, 12.0)
    assert slow == pytest.approx(0.2 * 1.09, rel=1e-3)
    assert fast == pytest.approx(0.2 * 1.36, rel=1e-3)
    # the top speed of the trip counts, and below a metre per second none does
    for speed, reach, peak in ((12.0, 12.0, 1.0), (0.2, 1.0, 2 * 2 * 1 / (1 + 4))):
        found = adhesion.highest(rising.with_params(top=0.2, gain=0.03), speed, False)
        assert found == pytest.approx(0.2 * peak * (1 + 0.03 * reach), rel=1e-3)
    driven = adhesion.highest(rising.with_params(bend=9.0, gain=0.0), 2.0, True)
    assert driven == pytest.approx(0.3, rel=1e-3)  # a driven wheel may be faster than its vehicle


def test_numbers_of_a_law_are_read_with_their_units():
    found = adhesion.numbers_of(rising, {"top": 0.25, "bend": "7.2 km/h", "gain": "0.02 s/m"},
                                "rail.x")  # fmt: skip
    assert found == {"top": 0.25, "bend": pytest.approx(2.0), "gain": 0.02}
    with pytest.raises(BadInput) as refused:
        adhesion.numbers_of(rising, {"top": 3.0, "bend": "2 kg", "tap": 1.0}, "rail.x")
    lines = refused.value.lines
    assert len(lines) == 3
    assert "rail.x.top" in lines[0]
    assert "rail.x.bend" in lines[1]
    assert "has no parameter of this name" in lines[2]
    assert "top" in lines[2]
    bare = list(adhesion.without_unit(rising.params, {"bend": "2", "top": "0.3",
                                                      "gain": "0.1 s/m"}, "rail.x"))  # fmt: skip
    assert bare == ["rail.x.bend: 2 has no unit; it is read as 2 m/s, write '2 m/s'"]
