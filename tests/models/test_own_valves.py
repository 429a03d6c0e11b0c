"""A slide protection of one's own: a block that gives the bits of two valves, or a state."""

from dataclasses import replace

import numpy as np
import pytest

from slipctl import c_module, simulate
from slipctl.errors import BadInput
from slipctl.models.vehicle import (
    Air,
    Constant,
    Contamination,
    DemandAlone,
    Exact,
    Lag,
    OwnLaw,
    Sensors,
    SlideProtection,
    SlipControl,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)
from slipctl.models.vehicle.air.valve_control import whole_bits, whole_state
from slipctl.models.vehicle.description import VEHICLE_FILES
from slipctl.models.vehicle.study import study

TRIP = Trip(
    duration=6.0,
    vehicle=Vehicle(mass=24e3, places=(0.0, 8.0), axles=2, inertia=100.0, radius=0.46, speed=20.0),
    actuator=Air(torque=5.52e3, dead_time=0.06),
    rail=Track(law="falling_creep", sections=(Stretch(place=0.0, condition="clean"),),
               contamination=Contamination(condition="leaves")),
    demand=Constant(deceleration=0.9),
    sensors=Sensors(wheel_speed=Exact()),
    control=SlipControl(period=0.01),
    controllers={"none": DemandAlone()},
)  # fmt: skip

PYTHON = """
from casadi import if_else
from slipctl import Input, Output, Param, State, step
from slipctl.models.vehicle.air.slide_protection import slide_machine

machine = slide_machine()
SLIP = Input("m/s", "slip", positive="braking", per="speed")


@step(hold=Output("1", "shuts the supply off"), vent=Output("1", "vents"))
def bang(v=Input("m/s", "speed"), v_s=SLIP, share=Param("1", 0.15, "slip over speed")):
    return {}, dict(hold=if_else(v_s > share * v / 2, 1, 0), vent=if_else(v_s > share * v, 1, 0))


@step(hold=Output("1", "shuts the supply off"), vent=Output("1", "vents"))
def breaks(x=State("1", 3.0, "grows", lo=0, hi=4), v_s=SLIP):
    return dict(x=2 * x), dict(hold=1 + 0 * v_s, vent=1 + 0 * v_s)


@step(hold=Output("1", "shuts the supply off"), vent=Output("1", "vents"))
def asks(tilt=Input("1", "nobody tells it")):
    return {}, dict(hold=0 * tilt, vent=0 * tilt)
"""

TEXT = """
[bang]
equations = \"\"\"
hold = 1 if v_s > share*v/2 else 0
vent = 1 if v_s > share*v else 0
\"\"\"
outputs = { hold = "1", vent = "1" }

[bang.inputs]
v_s = { unit = "m/s", doc = "slip speed", positive = "braking", per = "speed" }
v = { unit = "m/s", doc = "vehicle speed" }

[bang.parameters]
share = 0.15
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "mine.py").write_text(PYTHON)
    (folder / "mine.toml").write_text(TEXT)
    return folder


def run(part, **changes):
    made = replace(TRIP, controllers={"own": part}, **changes)
    found = case(made)
    return simulate(found.loops["own"], found.scenario, log=["plant.train.x", "plant.T", "slip.y"],
                    compile=made.duration > 1)  # fmt: skip


@pytest.mark.parametrize("seconds", [0.6, pytest.param(6.0, marks=pytest.mark.long)])
def test_the_machine_of_industry_as_ones_own_runs_to_the_bit(files, seconds):
    parts = OwnLaw(block=f"{files}/mine.py:machine"), SlideProtection()
    own, told = (run(part, duration=seconds) for part in parts)
    for name in ("plant.train.x", "plant.T", "slip.y"):
        assert np.array_equal(own[name].values, told[name].values), name
    assert own["plant.T"].values.min() < 0.5 * own["plant.T"].values.max()  # it has vented


@pytest.mark.long
def test_bits_of_python_and_of_text_are_the_same_and_keep_wheels_from_locking(files):
    python = run(OwnLaw(block=f"{files}/mine.py:bang"))
    text = run(OwnLaw(block=f"{files}/mine.toml:bang"))
    assert np.array_equal(python["plant.train.x"].values, text["plant.train.x"].values)
    alone = run(DemandAlone())
    assert python["slip.y"].values.max() < 0.6 * alone["slip.y"].values.max()
    wide = run(OwnLaw(block=f"{files}/mine.py:bang", gains={"share": 0.3}))
    assert wide["slip.y"].values.max() > python["slip.y"].values.max()


@pytest.mark.long
def test_a_block_that_breaks_gives_the_demand(files):
    """A state beyond its range, or no number: as if there were no slide protection."""
    broken, alone = run(OwnLaw(block=f"{files}/mine.py:breaks")), run(DemandAlone())
    assert np.array_equal(broken["plant.T"].values, alone["plant.T"].values)
    assert whole_bits(hold_by=np.nan, vent_by=np.nan) == {"hold": 0, "vent": 0}
    assert whole_state(state_by=np.nan)["state"] == 0


@pytest.mark.second
def test_its_c_is_made_and_compiled(files, tmp_path):
    made = replace(TRIP, controllers={"own": OwnLaw(block=f"{files}/mine.py:bang")})
    asked = study(made)
    loop = asked.cases({}, False)[0].loops["own"]
    module = c_module(loop[asked.controller], tmp_path, "ctl", period=loop.period)
    assert module.load().instance_bytes > 0
    assert "own" in asked.certificates.uncertified


def test_bits_and_states_are_whole_and_what_is_no_number_fills():
    for given, bit, state in ((0, 0, 0), (0.49, 0, 0), (0.51, 1, 1), (1.49, 1, 1), (1.51, 1, 2),
                              (7, 1, 2), (-3, 0, 0), (np.nan, 0, 0)):  # fmt: skip
        assert whole_bits(hold_by=given, vent_by=0) == {"hold": bit, "vent": 0}
        assert whole_bits(hold_by=0, vent_by=given) == {"hold": 0, "vent": bit}
        assert whole_state(state_by=given)["state"] == state


@pytest.mark.parametrize(
    ("block", "changes", "says"),
    [
        ("mine.py:asks", {}, "gives the bits of two valves, asks for tilt; it has v, omega"),
        ("mine.py:bang", {"actuator": Lag(torque=5e3)}, "write kind = 'air' under .actuator."),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(files, block, changes, says):
    part = OwnLaw(block=f"{files}/{block}")
    with pytest.raises(BadInput, match=says):
        run(part, **changes)
    made = replace(TRIP, controllers={"own": part}, **changes)
    ((keys, line),) = VEHICLE_FILES.faults(made)
    assert keys == ("controllers", "own")
    assert "\n" not in line


def test_an_unknown_gain_of_it_is_told(files):
    part = OwnLaw(block=f"{files}/mine.py:bang", gains={"shore": 0.2})
    with pytest.raises(BadInput, match="did you mean 'share'"):
        run(part)
