"""Each thing that a vehicle's file may not say, and each that no train has, is told at its key."""

from __future__ import annotations

import re

import pytest

from slipctl.errors import BadInput, Faults
from slipctl.models.vehicle.parts.plausibility import unusual_numbers
from slipctl.study.files import trip_files
from tests.edited_files import EMU, METRO, edited

DRIVEN = (
    METRO.replace('mode = "brake"', 'mode = "drive"').replace("deceleration =", "acceleration =")
    .replace('stopping_distance = "140 m"\n', "")
)  # fmt: skip
SECTIONS = METRO[METRO.index("[[rail.sections]]") : METRO.index("[demand]")]

LENGTHS = 'wheelbase = "2.1 m"\nbogie_centres = "11 m"\n'

FAULTS = {
    "resistance by mass in kN": (
        {'a = "1.2 kN"': 'a = "12 kN/t"'},
        r"vehicle\.resistance\.a: is 12 m/s\^2 of the mass; it must be at most 1 m/s\^2",
    ),
    "no section": ({SECTIONS: "\n"}, "rail.*section"),
    "both": (
        {'place = "0 m"\n': 'place = "0 m"\ntime = "0 s"\n'},
        "a section begins at a place or at a time; both is given",
    ),
    "neither": ({'place = "45 m"\n': ""}, "a section begins at a place or at a time; neither"),
    "mixed": ({'place = "45 m"': 'time = "45 s"'}, "some begin at a place and some at a time"),
    "not at 0": ({'place = "0 m"': 'place = "1 m"'}, "the first one must begin at 0 m"),
    "order": ({'place = "75 m"': 'place = "45 m"'}, "begins at 45 m, not after the one before"),
    "gradient": (
        {
            "[rail]\n": '[rail]\ngradient = [{ place = "0 m", gradient = "5 ‰" }]\n',
            SECTIONS: '[[rail.sections]]\ntime = "0 s"\ncondition = "dry"\n\n',
        },
        "a gradient by place goes with sections by place",
    ),
    "one axle": (
        {
            "axles = 4 ": "axles = 1 ",
            'wheelbase = "2.1 m"\n': "",
            'bogie_centres = "11 m"\n': "",
            'mass = "38 t"': 'mass = "9 t"',
            '{ kind = "noisy", deviation = "0.05 m/s" }': '{ kind = "wheels" }',
        },
        "one axle that slips tells no speed; use another kind",
    ),
    "patches": (
        {
            "draw = {": 'patches = { number = [1, 2], peak = [0.1, 0.2], to = "90 m",'
            ' length = ["2 m", "3 m"] }\ndraw = {'
        },
        "the rail is not contaminated; add .rail.contamination.",
    ),
    "ideal": (
        {"[controllers.none]": "[controllers.ideal]"},
        "write a name of letters, digits and _",
    ),
    "places": (
        {LENGTHS: 'places = ["1 m", "3 m", "9 m", "11 m"]\n'},
        "must begin with 0 m and rise from axle to axle",
    ),
    "unsorted": (
        {LENGTHS: 'places = ["0 m", "3 m", "2 m", "11 m"]\n'},
        "must begin with 0 m and rise from axle to axle",
    ),
    "overlap": (
        {'wheelbase = "2.1 m"': 'wheelbase = "0.8 m"'},
        "axles 1 and 2 are 0.8 m apart; wheels of 0.42 m and 0.42 m need 0.84 m",
    ),
    "load": ({'mass = "38 t"': 'mass = "250 t"'}, r"an axle carries 6.25e\+04 kg; it must be"),
    "inertia": (
        {'inertia = "110 kg m^2"': "rotating_mass = 0.001", 'mass = "38 t"': 'mass = "8 t"'},
        "the inertia of a wheelset is 0.3528 kg",
    ),
    "two": (
        {'inertia = "110 kg m^2"': 'inertia = "110 kg m^2"\nrotating_mass = 0.08'},
        "write inertia or rotating_mass; both are given",
    ),
    "none": (
        {'inertia = "110 kg m^2"': "# none"},
        "write inertia or rotating_mass; neither of them is given",
    ),
    "radii": ({'radius = "0.42 m"': 'radius = ["0.42 m", "0.41 m"]'}, "has 2 values for 4 axles"),
    "driven": ({"axles = 4 ": "driven = [1]\naxles = 4 "}, "is for a driven vehicle; write mode"),
    "faults": (
        {"[sensors]": '[sensors]\nfaults = [{ axle = 5, kind = "frozen" }]'},
        "is 5 of 4 axles",
    ),
    "acceleration": (
        {"deceleration = ": "acceleration = "},
        "the vehicle's mode is 'brake'; write deceleration",
    ),
    "band of all": (
        {
            'kind = "lag" ': 'kind = "air"\npressure = "0.5 bar"\nband = "0.6 bar" # ',
            'lag = "60 ms"': "# ",
        },
        "actuator.band: is 0.6 bar, the full pressure 0.5 bar",
    ),
    "no point": (
        {'kind = "constant" ': 'kind = "table"\nat = [] # ', '"1.2 m/s^2" ': "[] # "},
        "demand.at: has no point",
    ),
    "layer above 1 where it is slow": (
        {
            "[demand]": '[rail.contamination]\nlaw = "mu = c*tanh(v_s/w)/(1 + v/u) where v_s [m/s],'
            ' v [m/s], c = 0.3, w = 0.5 m/s, u = 10 m/s"\npeak = 0.5\n[demand]'
        },
        "rail.contamination.peak: with 0.5 at the speed at the start, adhesion is 1.17",
    ),
    "no adhesion where it is slow": (
        {
            'law = "exponential_tail"': 'law = "mu = c*tanh(v_s/w)*(1 if v > u else 0) where'
            ' v_s [m/s], v [m/s], c = 0.3, w = 0.5 m/s, u = 4 m/s"',
            "leaves = { c = 0.09, s = 0.03 }": "dry = {}\nleaves = { c = 0.1 }",
        },
        "rail.conditions.dry: adhesion is 0 at all slips, but not at all speeds",
    ),
    "train": (
        {'kind = "searched" ': 'kind = "train" # ', "start = { c = 0.7 } ": "# "},
        r"kind = 'train' knows the layer from \[rail.contamination\]",
    ),
}


@pytest.mark.parametrize("what", FAULTS)
def test_what_a_file_may_not_say_is_refused_at_its_key(what, tmp_path):
    changes, said = FAULTS[what]
    with pytest.raises(BadInput, match=said) as told:
        trip_files.load_trip(str(edited(tmp_path, changes)))
    lines = told.value.lines if isinstance(told.value, Faults) else (str(told.value),)
    assert all(line.startswith(f"{tmp_path}/my.toml") for line in lines)


OF_DRIVEN = {
    "rotor of almost all": (
        {
            "[actuator]": '[vehicle.torsion]\nstiffness = "6 MN m"\nshaft = "1 MN m"\nrotor ='
            ' "109.99 kg m^2"\n[actuator]'
        },
        "torsion.rotor: is 109.99 kg m.2, the wheelset with it 110 kg m.2; the wheels alone",
    ),
    "twice": ({"axles = 4 ": "driven = [1, 1]\naxles = 4 "}, "must name each driven axle once"),
    "nobody": ({"axles = 4 ": "driven = []\naxles = 4 "}, "must name each driven axle once"),
    "axle 5": ({"axles = 4 ": "driven = [2, 5]\naxles = 4 "}, "names axle 5 of 4"),
    "speed": (
        {'{ kind = "noisy", deviation = "0.05 m/s" }': '{ kind = "largest_wheel" }'},
        "is for a braked vehicle; write kind = 'wheels'",
    ),
    "valve": (
        {'kind = "lag" ': 'kind = "valve" ', 'lag = "60 ms"': "# "},
        "brakes; a driven vehicle takes kind",
    ),
    "demand": (
        {"acceleration = ": "deceleration = "},
        "the vehicle's mode is 'drive'; write acceleration",
    ),
}


@pytest.mark.parametrize("what", OF_DRIVEN)
def test_what_a_file_of_a_driven_vehicle_may_not_say_is_refused(what, tmp_path):
    changes, said = OF_DRIVEN[what]
    with pytest.raises(BadInput, match=said):
        trip_files.load_trip(str(edited(tmp_path, changes, DRIVEN)))


def test_a_law_in_a_file_may_tell_more_than_the_adhesion(tmp_path):
    told = METRO.replace(
        'law = "exponential_tail"',
        'law = "mu = c*tanh(v_s/w); half = mu/2 where v_s [m/s], c = 0.3, w = 0.5 m/s"',
    ).replace("leaves = { c = 0.09, s = 0.03 }", "dry = { c = 0.3 }\nleaves = { c = 0.1 }")
    assert trip_files.load(str(edited(tmp_path, {}, told))).cases(None, False)


OF_CARS = {
    "wagons lighter than their wheelsets": (
        'bogies = 0\nwheelset_mass = "10 t"\nheight = "1.8 m"\nmass = "39 t"',
        "vehicle.cars.0.wheelset_mass: bogies and wheelsets are 40000 kg of 39000 kg",
    ),
    "inertia of a toy": ('inertia = "0.1 kg m^2"', "the inertia of a wheelset is 0.1 kg"),
    "two radii": ('radius = "0.45 m"', "vehicle.cars.0.radius: vehicle.radius is a list"),
}


@pytest.mark.parametrize("what", OF_CARS)
def test_what_a_car_may_not_say_is_refused_at_its_key(what, tmp_path):
    given, said = OF_CARS[what]
    changes = {'mass = "48 t"': given if "mass =" in given else f'{given}\nmass = "48 t"'}
    if "radius" in given:
        changes['radius = "0.46 m"'] = "radius = [" + 8 * '"0.46 m", ' + "]"
    with pytest.raises(BadInput, match=said):
        trip_files.load_trip(str(edited(tmp_path, changes, EMU.replace('"2.5 m"', '"4 m"'))))


def test_cars_that_have_their_own_inertia_need_none_of_the_vehicle(tmp_path):
    own = EMU.replace('inertia = "100 kg m^2" ', "# ").replace('count = 2', 'count = 2\n'
                      'inertia = "90 kg m^2"')  # fmt: skip
    assert trip_files.load_trip(str(edited(tmp_path, {}, own))).vehicle.inertias == (90.0,) * 8


UNUSUAL = {
    "slip of one controller": (
        {'K = "10 1/s"': 'K = "10 1/s"\nreference = { kind = "speed", slip = "17 m/s" } #'},
        "controllers.pid.reference.slip: 17 m/s is above the vehicle's speed",
    ),
    "least slip": (
        {
            'kind = "searched" ': 'kind = "ratio"\nslip = 0.1\nleast = "4 m/s" # ',
            "start = { c = 0.7 } ": "# ",
            'speed = "60 km/h"': 'speed = "12 km/h"',
        },
        "reference.least: 4 m/s is above the vehicle's speed",
    ),
    "rate of the speed": (
        {'"noisy", deviation = "0.05 m/s"': '"wheels", rate = "0.01 m/s^2"'},
        "sensors.vehicle_speed.rate: is 0.01 m/s.2, and the vehicle may change",
    ),
    "cleaning by kJ": (
        {"[demand]": '[rail.contamination]\npeak = 0.05\ntau = "3.4e-5 m/kJ"\n[demand]'},
        "rail.contamination.tau: is 3.4e-08 m/J",
    ),
    "gravity": ({"[vehicle]\n": '[vehicle]\ngravity = "1.62 m/s^2"\n'}, "vehicle.gravity: is 1.62"),
    "magnets in N": (
        {"[actuator]": '[vehicle.track_brake]\nattraction = "66 N"\n[actuator]'},
        "vehicle.track_brake.attraction: it alone slows by 0.000",
    ),
    "motors in N m": (
        {"[actuator]": '[vehicle.dynamic_brake]\ntorque = "5 N m"\n[actuator]'},
        "vehicle.dynamic_brake.torque: all motors together give 0.00",
    ),
    "motors in W": (
        {"[actuator]": '[vehicle.dynamic_brake]\ntorque = "5 kN m"\npower = "300 W"\n[actuator]'},
        "vehicle.dynamic_brake.power: all motors together have 1.2e.03 W",
    ),
    "power in W": ({'lag = "60 ms"': 'lag = "60 ms"\npower = "300 W"'}, "actuator.power: all axle"),
    "top below the start": ({'lag = "60 ms"': 'lag = "60 ms"\ntop = "10 m/s"'}, "actuator.top: is"),
    "rate": ({'lag = "60 ms"': 'lag = "60 ms"\nrate = "8 N m/s"'}, "actuator.rate: it takes 1e.03"),
    "clock in ms": ({"teeth = 120": 'teeth = 120, clock = "1 ms"'}, "wheel_speed.clock: 1000 us"),
    "lost samples": ({'"0.05 m/s" }': '"0.05 m/s", dropout = 0.9 }'}, "dropout: 90 %"),
    "noise of a wheel": (
        {'"tooth_wheel", teeth = 120': '"noisy", deviation = "5 rad/s"'},
        "sensors.wheel_speed.deviation: 2.1 m/s; of speed",
    ),
    "small noise of a wheel in rad": (
        {'"tooth_wheel", teeth = 120': '"noisy", deviation = "2 rad/s"'},
        None,
    ),
    "believed diameter": (
        {"[control]\n": '[control]\nradius = "0.84 m"\n'},
        "control.radius: is 0.84 m, the wheels",
    ),
    "worn": ({"[control]\n": '[control]\nradius = "0.45 m"\n'}, None),
    "weighed in kg": (
        {'kind = "lag" ': 'kind = "air"\nweighed = "380 kg" # ', 'lag = "60 ms"': "# "},
        "actuator.weighed: is 1 % of the vehicle's mass",
    ),
    "layer that helps": (
        {"[demand]": "[rail.contamination]\npeak = 0.5\n[demand]"},
        "rail.contamination.peak: the layer carries 0.5, more than the rail without it",
    ),
    "adhesion above 1 downhill": (
        {
            'law = "exponential_tail"': 'gradient = -0.1\nlaw = "mu = c*tanh(v_s/w)*(1 if v < u'
            ' else 9) where v_s [m/s], v [m/s], c = 0.3, w = 0.5 m/s, u = 18 m/s"',
            "leaves = { c = 0.09, s = 0.03 }": "dry = { c = 0.3 }\nleaves = { c = 0.1 }",
        },
        "rail.law, dry: at speeds up to 33.3 m/s, where it may get, adhesion is above 1",
    ),
    "metro": ({}, None),
    "light": (
        {'mass = "38 t"': 'mass = "5.6 t"', "110 kg m^2": "60 kg m^2", '"8 kN m"': '"1 kN m"'},
        "vehicle.mass: an axle carries 1.4 t",
    ),
    "heavy": ({'mass = "38 t"': 'mass = "168 t"'}, "vehicle.mass: an axle carries 42 t"),
    "tare": (
        {'mass = "38 t"': 'tare = "166 t"\nload = "2 t"'},
        "vehicle.tare: an axle carries 42 t",
    ),
    "of one axle": (
        {'mass = "38 t"': 'mass = "9.5 t"', '"8 kN m"': '"2 kN m"'},
        "vehicle.mass: an axle carries 2.38 t",
    ),
    "of the car": (
        {'torque = "8 kN m"': 'torque = "32 kN m"'},
        "all axles together give 8.02 m/s.2, more than any rail carries",
    ),
    "noise": (
        {'deviation = "0.05 m/s"': 'deviation = "5 m/s"'},
        "sensors.vehicle_speed.deviation: 5 m/s; of speed sensors",
    ),
    "just not heavy": ({'mass = "38 t"': 'mass = "159 t"'}, None),
    "turning": (
        {'inertia = "110 kg m^2"': 'inertia = "700 kg m^2"'},
        "vehicle.inertia: what turns is as heavy as 41.8 % of the vehicle",
    ),
    "just not turning": ({'inertia = "110 kg m^2"': 'inertia = "660 kg m^2"'}, None),
    "rotating": (
        {'inertia = "110 kg m^2"': "rotating_mass = 0.45"},
        "vehicle.rotating_mass: what turns is as heavy as 45 %",
    ),
    "drag": ({'a = "1.2 kN"': 'a = "19 kN"'}, "vehicle.resistance: it alone slows by 0.538 m/s.2"),
    "just no drag": ({'a = "1.2 kN"': 'a = "17 kN"'}, None),
    "fast": (
        {'speed = "60 km/h"': 'speed = "433 km/h"', 'c = "4.5 N s^2/m^2"': 'c = "0.1 N s^2/m^2"'},
        "vehicle.speed: it begins at 433 km/h",
    ),
    "stands": ({'speed = "60 km/h"': 'speed = "0 km/h"'}, "it stands at the start, and is braked"),
    "slick": (
        {"leaves = { c = 0.09, s = 0.03 }": "leaves = { c = 0.012, s = 0.003 }"},
        "rail.conditions.leaves: adhesion is 0.00[0-9]+ at most; of ice and leaves it is 0.02",
    ),
    "sticky": (
        {"leaves = { c = 0.09, s = 0.03 }": "leaves = { c = 1.4, s = 0.5 }"},
        "rail.conditions.leaves: adhesion is up to 0.[0-9]+; of dry rail it is at most 0.6",
    ),
    "own condition": ({"leaves = { c = 0.09, s = 0.03 }": "leaves = {}"}, None),
    "empty": (
        {
            "leaves = { c = 0.09, s = 0.03 }": "Leaves = {}",
            'condition = "leaves"': 'condition = "Leaves"',
        },
        "rail.conditions.Leaves: it is empty, .* did you mean 'leaves'.* up to 0.3",
    ),
    "slip": (
        {'kind = "searched" ': 'kind = "speed"\nslip = "17 m/s" # ', "start = { c = 0.7 } ": "# "},
        "reference.slip: 17 m/s is above the vehicle's speed",
    ),
    "share": (
        {'kind = "searched" ': 'kind = "ratio"\nslip = 0.55 # ', "start = { c = 0.7 } ": "# "},
        "reference.slip: 0.55 of the speed; slip laws hold 0.01 to 0.3",
    ),
    "diameter": (
        {'radius = "0.42 m"': 'radius = "840 mm"', "110 kg m^2": "300 kg m^2"},
        "vehicle.radius: a wheel of 1.68 m diameter",
    ),
    "thousands": (
        {'torque = "8 kN m"': 'torque = "8.000 N m"'},
        "actuator.torque: all axles together give 0.002 m/s.2",
    ),
    "just enough torque": ({'torque = "8 kN m"': 'torque = "81 N m"'}, None),
    "short": (
        {'place = "75 m"': 'place = "45.3 m"'},
        "rail.sections.1: 0.3 m long; it is over before a brake answers",
    ),
    "just not short": ({'place = "75 m"': 'place = "46 m"'}, None),
    "short layer": (
        {
            "[demand]": "[rail.contamination]\npeak = 0.05\n"
            'places = [{ from = "9 m", to = "9.3 m" }]\n[demand]'
        },
        "rail.contamination.places.0: 0.3 m long",
    ),
    "brief": (
        {'deceleration = "1.2 m/s^2"': 'deceleration = "1.2 m/s^2"\nuntil = "12 ms"'},
        "demand.until: the demand is 0.012 s long",
    ),
    "just not brief": (
        {'deceleration = "1.2 m/s^2"': 'deceleration = "1.2 m/s^2"\nuntil = "0.1 s"'},
        None,
    ),
    "teeth": ({"teeth = 120": "teeth = 3"}, "a tooth passes every 52.8 ms at the start"),
    "just enough teeth": ({"teeth = 120": "teeth = 4"}, None),
}


@pytest.mark.parametrize("what", UNUSUAL)
def test_what_no_train_has_is_told_and_what_some_have_is_not(what, tmp_path):
    changes, said = UNUSUAL[what]
    lines = list(unusual_numbers(trip_files.load_trip(str(edited(tmp_path, changes)))))
    assert len(lines) == (said is not None), lines
    if said:
        assert re.search(said, lines[0])
