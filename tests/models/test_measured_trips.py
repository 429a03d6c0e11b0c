"""What a trip's own metrics say, where the air and the stop are known in closed form."""

from dataclasses import replace

import pytest

from slipctl.errors import BadInput
from slipctl.models.vehicle import (
    Air,
    Constant,
    Contamination,
    DemandAlone,
    Exact,
    Sensors,
    SlideProtection,
    SlipControl,
    Stretch,
    Track,
    Trip,
    Vehicle,
)
from slipctl.models.vehicle.parts import Limits
from slipctl.models.vehicle.parts.rail import Patch
from slipctl.models.vehicle.study import study
from slipctl.study.execution import run

TRIP = Trip(
    duration=40.0, end="standstill", mark=120.0,
    vehicle=Vehicle(mass=48e3, places=(0.0, 2.0, 14.0, 16.0), inertia=100.0, radius=0.46,
                    speed=15.0),
    actuator=Air(torque=5.52e3, dead_time=0.06, reservoir=0.1, reserve=8e5),
    rail=Track(law="falling_creep", sections=(Stretch(place=0.0, condition="clean"),),
               contamination=Contamination(condition="leaves", places=(Patch(begin=40, end=90),))),
    demand=Constant(deceleration=0.8),
    sensors=Sensors(wheel_speed=Exact()),
    control=SlipControl(period=0.01),
    controllers={"none": DemandAlone(), "wsp": SlideProtection()},
)  # fmt: skip


@pytest.mark.long
def test_a_stop_in_leaves_is_told_beside_the_same_on_clean_rail():
    """Air of a stop without release is the volume times the gauge pressure over the atmosphere."""
    asked = study(TRIP)
    results = run(asked, asked.cases({}, False))
    assert set(results.data) == {"base", "clean"}
    here, clean = results.metrics["base"], results.metrics["clean"]
    torque = 0.46 * 48e3 * 0.8 / 4 + 100 * 0.8 / 0.46
    for name in ("none", "wsp"):
        litres = 4 * 4.0 * 3.8 * torque / 5520 / 1.013
        assert clean[name]["air_used"].value == pytest.approx(litres, rel=1e-3)
        # isothermal: what leaves a reservoir of 100 l lowers it by that share of an atmosphere
        assert clean[name]["air_left"].value == pytest.approx(8 - 1.013 * litres / 100, rel=1e-3)
        assert clean[name]["valve_operations"].value == 0
        stops = [m[name]["stopping_distance"].value for m in (here, clean)]
        assert here[name]["extension"].value == pytest.approx(stops[0] / stops[1] - 1)
        assert here[name]["overrun"].value == pytest.approx(max(stops[0] - 120, 0), abs=1e-3)
        assert "extension" not in clean[name]
    assert here["wsp"]["extension"].value > 0.02
    assert here["wsp"]["valve_operations"].value > 5
    assert here["wsp"]["air_used"].value > 1.2 * clean["wsp"]["air_used"].value


@pytest.mark.second
@pytest.mark.long
def test_the_clean_rail_takes_nothing_from_the_wheels():
    """Without its layer a trip ends where one with a layer as good as clean does."""
    asked = study(TRIP)
    clean = next(c for c in asked.cases({}, False) if c.scenario.name == "clean")
    alone = replace(clean, loops=clean.loops.only("none"))
    ends = float(run(asked, [alone]).data["clean"]["none"]["plant.train.x"][-1])
    bare = replace(TRIP, rail=replace(TRIP.rail, contamination=Contamination(condition="clean")))
    same = study(bare)
    base = replace(same.cases({}, False)[0], clean="")
    base = replace(base, loops=base.loops.only("none"))
    assert ends == pytest.approx(
        float(run(same, [base]).data["base"]["none"]["plant.train.x"][-1]), abs=1e-9
    )


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"overrun": 5.0}, "limits.overrun: needs the mark"),
        ({"air_used": 5.0}, "limits.air_used: needs kind = 'air'"),
        ({"valve_operations": 5}, "limits.valve_operations: needs kind = 'air'"),
        ({"extension": 0.1}, "limits.extension: needs .rail.contamination"),
    ],
)
def test_a_limit_of_what_no_run_tells_is_refused(limits, says):
    from slipctl.models.vehicle import Lag

    plain = dict(mark=None, actuator=Lag(torque=5e3), controllers={"none": DemandAlone()},
                 rail=replace(TRIP.rail, contamination=None))  # fmt: skip
    with pytest.raises(BadInput, match=says):
        replace(TRIP, **plain, limits=Limits(**limits))


@pytest.mark.second
@pytest.mark.long
def test_a_limit_beside_clean_rail_is_judged_where_there_is_one():
    from slipctl.study.report.texts import values_beyond_limit

    asked = study(replace(TRIP, limits=Limits(extension=0.01)))
    cases = [replace(c, loops=c.loops.only("wsp")) for c in asked.cases({}, False)]
    results = run(asked, cases)
    assert values_beyond_limit(results, "base")["wsp"] == {"extension": [0]}
    assert values_beyond_limit(results, "clean")["wsp"] == {}


@pytest.mark.parametrize("period", [0.001, 0.004, 0.01, 0.02])
def test_a_best_slip_is_searched_at_any_period_of_the_controllers(period):
    """The fit has a period of its own, which has to be a whole number of the controllers'."""
    from slipctl.models.vehicle import ScheduledPI, Searched, loop

    made = replace(
        TRIP, control=SlipControl(period=period),
        controllers={"pi": ScheduledPI(reference=Searched())},
    )  # fmt: skip
    assert loop(made, "pi").period == pytest.approx(1e-3)
