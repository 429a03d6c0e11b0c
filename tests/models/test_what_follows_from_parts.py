"""Numbers that follow from the parts of a trip, and what does not fit, from both sides."""

from __future__ import annotations

from dataclasses import replace

import pytest

from slipctl import BadInput
from slipctl.models.vehicle import (
    Air,
    Constant,
    Lag,
    SlideProtection,
    SlipLaw,
    SlipRatio,
    Stretch,
    Track,
    TrainSlip,
    Valve,
    WheelsOnly,
)
from slipctl.models.vehicle.air.pneumatics import ATMOSPHERE, rate_of_choke
from slipctl.models.vehicle.parts import Contamination, Davis, Slope
from slipctl.models.vehicle.parts.rail import Patch, Sand
from slipctl.models.vehicle.parts.sensors import LargestWheel, SensorFault
from tests.models.test_ends_and_demands_of_trips import LAYERED, TRIP

PLACED = replace(TRIP, rail=replace(TRIP.rail, gradient=(
    Slope(place=0.0, gradient=0.01), Slope(place=40.0, gradient=-0.03),
    Slope(place=90.0, gradient=0.002))))  # fmt: skip
DRIVEN = replace(TRIP, vehicle=replace(TRIP.vehicle, mode="drive", driven=(1, 3),
                                       radius=(0.5, 0.45, 0.4)))  # fmt: skip


def test_lags_of_actuators():
    lag = Lag(torque=5e3, lag=0.07)
    assert (lag.usual_lag, lag.longest_lag) == (0.07, 0.07)
    valve = Valve(torque=5e3, fill=0.3, vent=0.1)
    assert (valve.usual_lag, valve.longest_lag) == (pytest.approx(0.2), 0.3)
    assert replace(valve, vent=0.5).longest_lag == 0.5
    air = Air(torque=5e3, pressure=3.6e5, supply=5.2e5, fill_rate=0.6, vent_rate=1.7)
    up, down = 0.6 * (5.2e5 + ATMOSPHERE), 1.7 * (1.8e5 + ATMOSPHERE)
    assert air.rates == (0.6, 1.7)
    assert air.usual_lag == pytest.approx((3.6e4 / up + 3.6e4 / down) / 2)
    assert air.longest_lag == pytest.approx(max(1.2 * 3.6e5 / up, 3 / 1.7))
    slow = replace(air, fill_rate=0.05)
    assert slow.longest_lag == pytest.approx(1.2 * 3.6e5 / (0.05 * (5.2e5 + ATMOSPHERE)))
    assert replace(air, fill_rate=100.0, vent_rate=150.0).usual_lag == 1e-3
    assert replace(air, fill_rate=1e-3, vent_rate=1e-3).usual_lag == 5.0
    wide = Air(torque=5e3, volume=5e-3, fill=5e-3, vent=7e-3, discharge=0.8, air=280.0)
    assert wide.rates == pytest.approx(
        [rate_of_choke(d, 5e-3, 0.8, 280.0) for d in (5e-3, 7e-3)])  # fmt: skip
    mixed = replace(wide, vent_rate=2.2).rates
    assert mixed == (wide.rates[0], 2.2)


def test_what_beside_the_torques_moves_a_vehicle():
    drag = (300 + 20 * 20 + 5 * 400) / 27e3
    assert TRIP.beside_torques == pytest.approx(drag)
    assert PLACED.beside_torques == pytest.approx(drag + 9.7 * 0.03)
    given = 8e3 * (1 / 0.5 + 1 / 0.4) / 27e3
    assert DRIVEN.pulled == pytest.approx(given)
    assert replace(DRIVEN, demand=Constant(acceleration=0.3)).pulled == 0.3
    assert replace(DRIVEN, demand=Constant(force=27e2)).pulled == pytest.approx(0.1)
    assert replace(DRIVEN, demand=Constant(acceleration=9.0)).pulled == pytest.approx(given)


def test_how_fast_and_how_far_a_vehicle_gets():
    assert TRIP.fastest == 20.0
    assert PLACED.fastest == pytest.approx(20 + 9.7 * 0.03 * 6)
    assert DRIVEN.fastest == pytest.approx(20 + 6 * DRIVEN.pulled)
    assert replace(DRIVEN, duration=1e3).fastest == 150.0
    assert TRIP.farthest == 120.0
    assert replace(TRIP, end="90 m").farthest == 90.0
    assert replace(TRIP, end="190 m").farthest == 120.0
    assert replace(TRIP, end="standstill").farthest == 120.0
    assert PLACED.farthest == float("inf")
    assert replace(PLACED, end="190 m").farthest == 190.0
    assert DRIVEN.farthest == float("inf")


def test_radii_that_are_believed_and_whether_they_are_learnt():
    assert DRIVEN.believed == (0.5, 0.4)
    assert DRIVEN.one_radius == pytest.approx(0.45)
    told = replace(DRIVEN, control=replace(DRIVEN.control, radius=(0.48, 0.41)))
    assert (told.believed, told.one_radius) == ((0.48, 0.41), pytest.approx(0.445))
    one = replace(DRIVEN, control=replace(DRIVEN.control, radius=0.47))
    assert (one.believed, one.one_radius) == ((0.47, 0.47), 0.47)
    wheels = replace(TRIP.sensors, vehicle_speed=WheelsOnly())
    assert not TRIP.learns
    assert replace(TRIP, sensors=wheels).learns
    alone = replace(DRIVEN.vehicle, driven=(2,))
    assert not replace(DRIVEN, vehicle=alone, sensors=wheels).learns
    for given in (True, False):
        control = replace(TRIP.control, learn=given)
        assert replace(TRIP, control=control).learns == given


def test_slips_that_are_wanted_by_where_they_stand():
    own = SlipLaw(kind="pid", reference=SlipRatio(slip=0.2))
    made = replace(TRIP, controllers={"a": own, "b": TRIP.controllers["none"]})
    assert made.references == {"reference": TRIP.reference,
                               "controllers.a.reference": SlipRatio(slip=0.2),
                               "controllers.b.reference": None}  # fmt: skip


NEAR = replace(TRIP.vehicle, places=(0.0, 5.0, 8.0))


def layer(**changes):
    return replace(LAYERED, rail=replace(LAYERED.rail, contamination=replace(
        LAYERED.rail.contamination, **changes)))  # fmt: skip


REFUSED = [
    (lambda: replace(TRIP, end="90 kg"), "end"),
    (lambda: replace(TRIP, demand=Constant(acceleration=1.0)), "write deceleration"),
    (lambda: replace(DRIVEN, demand=Constant(deceleration=1.0)), "write acceleration"),
    (lambda: replace(TRIP, controllers={}), "there is no controller"),
    (lambda: replace(DRIVEN, actuator=Air(torque=5e3)), "air brakes"),
    (lambda: replace(DRIVEN, actuator=Valve(torque=5e3)), "a valve brakes"),
    (lambda: replace(DRIVEN, control=replace(TRIP.control, radius=(0.5, 0.5, 0.5))),
     "has 3 values for 2 axles"),
    (lambda: replace(DRIVEN, vehicle=replace(DRIVEN.vehicle, driven=(2,)),
                     control=replace(TRIP.control, learn=True)), "one axle has no ratio"),
    (lambda: replace(DRIVEN, sensors=replace(TRIP.sensors, vehicle_speed=LargestWheel())),
     "is for a braked vehicle"),
    (lambda: replace(DRIVEN, sensors=replace(TRIP.sensors, faults=(
        SensorFault(axle=2, kind="frozen", time=1.0),
        SensorFault(axle=3, kind="frozen", time=1.0)))), r"faults\.1\.axle: is 3 of 2"),
    (lambda: replace(TRIP, controllers={"a": SlideProtection()}), "bits of two valves"),
    (lambda: replace(TRIP, controllers={"ideal": SlipLaw(kind="pid")}), "not 'ideal'"),
    (lambda: replace(TRIP, controllers={"a b": SlipLaw(kind="pid")}), "letters, digits"),
    (lambda: replace(TRIP, limits=replace(TRIP.limits, overrun=3.0)), "limits.overrun: needs"),
    (lambda: replace(TRIP, limits=replace(TRIP.limits, air_used=3.0)), "limits.air_used: needs"),
    (lambda: replace(TRIP, limits=replace(TRIP.limits, extension=0.3)), "limits.extension: needs"),
    (lambda: replace(TRIP, reference=SlipRatio(slip=(0.1, 0.2))), "has 2 values for 3 axles"),
    (lambda: replace(TRIP, reference=TrainSlip()), "knows the layer"),
    (lambda: replace(DRIVEN, rail=LAYERED.rail, reference=TrainSlip()), "for a braked vehicle"),
    (lambda: replace(layer(cell=3.1), vehicle=NEAR), "more than the 3 m between two axles"),
    (lambda: layer(places=(Patch(begin=5.0, end=9.0), Patch(begin=120.0, end=130.0))),
     r"places\.1\.from: is 120 m, and the run ends at 120 m"),
    (lambda: layer(places=(Patch(begin=-30.0, end=-12.0),)), r"places\.0\.to: is -12 m"),
    (lambda: layer(sand=Sand(axles=(1, 4))), "sand.axles: names axle 4 of 3"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "said"), REFUSED, ids=[said for _, said in REFUSED])
def test_what_does_not_fit_is_refused(make, said):
    with pytest.raises(BadInput, match=said):
        make()


def test_what_just_fits_is_taken():
    assert replace(layer(cell=3.0), vehicle=NEAR).rail.contamination.cell == 3.0
    kept = layer(places=(Patch(begin=119.0, end=130.0), Patch(begin=-30.0, end=-11.9)))
    assert len(kept.rail.contamination.places) == 2
    assert layer(sand=Sand(axles=(1, 3))).rail.contamination.sand.axles == (1, 3)
    marked = replace(TRIP, mark=90.0, limits=replace(TRIP.limits, overrun=3.0))
    assert marked.limits.overrun == 3.0
    air = replace(TRIP, actuator=Air(torque=5e3), controllers={"a": SlideProtection()},
                  limits=replace(TRIP.limits, air_used=3.0))  # fmt: skip
    assert air.limits.air_used == 3.0
    assert replace(TRIP, reference=SlipRatio(slip=(0.1, 0.2, 0.3))).reference.each == (
        0.1,
        0.2,
        0.3,
    )


@pytest.mark.parametrize(("changes", "said"), [
    (dict(pressure=9e4, band=9e4), "band"), (dict(supply=3.6e5), "cannot fill"),
    (dict(reserve=4.9e5, reservoir=0.1), "below the supply"), (dict(reserve=6e5), "reservoir"),
    (dict(charge=0.1), "reservoir"), (dict(reaction=0.0205), "reaction"),
    (dict(pulse=0.0205), "pulse"),
])  # fmt: skip
def test_an_air_brake_that_cannot_be(changes, said):
    base = Air(torque=5e3, pressure=3.6e5)
    assert replace(base, pressure=9e4, band=8.9e4).band == 8.9e4
    fine = replace(base, supply=3.61e5, reserve=3.61e5, reservoir=0.1, charge=0.1,
                   reaction=0.02, pulse=0.02)  # fmt: skip
    assert fine.supply == 3.61e5
    with pytest.raises(BadInput, match=said):
        replace(base, **changes)


def test_resistance_by_mass_and_as_it_is():
    assert Davis(a=3.0, b=2.0, c=1.0).of(9e3) == (3.0, 2.0, 1.0)


def test_sections_of_a_track_follow_each_other():
    begin = Stretch(place=0.0, condition="dry")
    for sections, said in (
        ((), "no section"), ((begin, Stretch(time=3.0, condition="wet")), "use one of both"),
        ((Stretch(place=1.0, condition="dry"),), "must begin at 0 m"),
        ((begin, Stretch(place=9.0, condition="a"), Stretch(place=9.0, condition="b")),
         r"sections\.2: begins at 9 m"),
        ((Stretch(time=0.0, condition="dry"), Stretch(time=0.0, condition="b")), "begins at 0 s"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            Track(sections=sections)
    for slopes, said in (
        ((Slope(place=2.0, gradient=0.0),), r"gradient\.0: the first"),
        (
            (
                Slope(place=0.0, gradient=0.0),
                Slope(place=7.0, gradient=0.01),
                Slope(place=5.0, gradient=0.0),
            ),
            r"gradient\.2: begins at 5 m",
        ),
    ):
        with pytest.raises(BadInput, match=said):
            Track(sections=(begin,), gradient=slopes)
    with pytest.raises(BadInput, match="goes with sections by place"):
        Track(sections=(Stretch(time=0.0, condition="dry"),),
              gradient=(Slope(place=0.0, gradient=0.0),))  # fmt: skip
    track = Track(sections=(begin,), gradient=PLACED.rail.gradient)
    assert (track.slopes, track.falls, track.placed) == ([0.01, -0.03, 0.002], True, True)
    assert not Track(sections=(begin,), gradient=0.01).falls
    assert not Track(sections=(begin,)).falls
    for ahead, fine in ((0.25, True), (0.24, False), (0.3, True)):
        if fine:
            assert Contamination(cell=0.25, sand=Sand(axles=(1,), ahead=ahead)).sand.ahead == ahead
            continue
        with pytest.raises(BadInput, match=r"sand\.ahead: is 0.24 m, within a cell"):
            Contamination(cell=0.25, sand=Sand(axles=(1,), ahead=ahead))
    for axles in ((), (1, 1)):
        with pytest.raises(BadInput, match="none twice"):
            Sand(axles=axles)
