"""Each thing that a vehicle's file may not say, and each that no train has, is told at its key."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from slipctl.errors import BadInput, Faults
from slipctl.models import vehicle
from slipctl.models.vehicle.parts.plausibility import unusual_numbers
from slipctl.study.files import trip_files

METRO = (Path(vehicle.__file__).parent / "files" / "metro.toml").read_text(encoding="utf-8")
DRIVEN = (
    METRO.replace('mode = "brake"', 'mode = "drive"').replace("deceleration =", "acceleration =")
    .replace('stopping_distance = "140 m"\n', "")
)  # fmt: skip
SECTIONS = METRO[METRO.index("[[rail.sections]]") : METRO.index("[demand]")]

LENGTHS = 'wheelbase = "2.1 m"\nbogie_centres = "11 m"\n'


def edited(tmp_path: Path, changes: dict[str, str], text: str = METRO):
    for before, after in changes.items():
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    path = tmp_path / "my.toml"
    path.write_text(text, encoding="utf-8")
    return path


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


UNUSUAL = {
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


EMU = (Path(vehicle.__file__).parent / "files" / "emu.toml").read_text(encoding="utf-8")
CAR = 'wheelbase = "2.5 m"\n'
NO_EFFECT = {
    "late fault": (
        METRO, "\n[reference]", '\nfaults = [{ axle = 1, time = "17 s" }]\n[reference]',
        "sensors.faults.0.time: 17 s is not before the end of the run, 17 s",
    ),
    "share of a frozen sensor": (
        METRO, "\n[reference]", "\nfaults = [{ axle = 1, share = 0.9 }]\n[reference]",
        "sensors.faults.0.share: has no effect, as kind = 'frozen'",
    ),
    "jump by nothing": (
        METRO, "\n[reference]",
        '\nfaults = [{ axle = 1, kind = "jumps", share = 0 }]\n[reference]',
        "sensors.faults.0.share: has no effect, as it is 0",
    ),
    "torque without unit": (
        METRO, "[control]\n", "[control]\nsafe = 3000\n",
        "control.safe: 3000 has no unit; it is read as 3000 N m",
    ),
    "late magnets": (
        METRO, "\n[actuator]",
        '\n[vehicle.track_brake]\nattraction = "80 kN"\ndelay = "20 s"\n[actuator]',
        "vehicle.track_brake.delay: 20 s is not before",
    ),
    "motors that fail late": (
        METRO, "\n[actuator]",
        '\n[vehicle.dynamic_brake]\ntorque = "4 kN m"\nlost = "17 s"\n[actuator]',
        "vehicle.dynamic_brake.lost: 17 s is not before",
    ),
    "pause of motors without valves": (
        METRO, "\n[actuator]",
        '\n[vehicle.dynamic_brake]\ntorque = "4 kN m"\npause = "1 s"\n[actuator]',
        "vehicle.dynamic_brake.pause: has no effect without the valves",
    ),
    "late point": (
        METRO, 'kind = "constant"                        # "table" over time, speed or position;'
        ' or "adhesion"\ndeceleration = "1.2 m/s^2"',
        'kind = "table"\nat = ["0 s", "20 s"]\ndeceleration = ["1 m/s^2", "0 m/s^2"]',
        "demand.at.1: 20 s is not before",
    ),
    "demand before its first point": (
        METRO, 'kind = "constant"                        # "table" over time, speed or position;'
        ' or "adhesion"\ndeceleration = "1.2 m/s^2"',
        'kind = "table"\nover = "position"\nat = ["5 m"]\ndeceleration = ["1 m/s^2"]',
        "demand.at.0: is 5 m; the demand there holds from the start on, write 0 m and",
    ),
    "patch of clean rail": (
        METRO, 'mode = "brake" ', 'patch = "90 mm^2"\nmode = "brake" ',
        "vehicle.patch: has no effect without [rail.contamination]",
    ),
    "every without let go": (
        METRO, "[control]\n", '[control]\nlet_go_every = "5 s"\n',
        "control.let_go_every: has no effect without let_go",
    ),
    "length of one car": (
        METRO, 'mode = "brake" ', 'car_length = "20 m"\nmode = "brake" ',
        "vehicle.car_length: has no effect, as axles = 4",
    ),
    "bogie without height": (
        EMU, CAR, CAR + 'bogie_mass = "2 t"\n',
        "vehicle.cars.0.bogie_mass: has no effect without height",
    ),
    "pivot of a wagon without bogies": (
        EMU, CAR, CAR.replace("2.5", "4") + 'bogies = 0\nheight = "1.8 m"\n'
        'pivot_height = "0.5 m"\n',
        "vehicle.cars.0.pivot_height: has no effect, as bogies = 0",
    ),
    "cooling of cold pads": (
        EMU, "[[vehicle.cars]]",
        '[vehicle.pads]\nradius = "0.25 m"\ncooling = "50 W/K"\n[[vehicle.cars]]',
        "vehicle.pads.cooling: has no effect without heat_capacity",
    ),
    "choke and rate": (
        EMU, 'fill = "4 mm" ', 'fill = "3 mm"\nfill_rate = "0.44 1/s" ',
        "actuator.fill: has no effect, as fill_rate is given",
    ),
    "own of a layer that stays": (
        EMU, 'tau = "3.4e-5 m/J"', 'tau = "0 m/J"\nown = true',
        "rail.contamination.own: has no effect, as tau = 0",
    ),
    "sand at a speed that is never reached": (
        EMU.replace("gradient = -0.015\n", ""), 'tau = "3.4e-5 m/J"',
        'sand = { axles = [1], above = "150 km/h" }',
        "rail.contamination.sand.above: is 41.6667 m/s, the vehicle begins at 38.8889 m/s",
    ),
    "seed where there is no noise": (
        METRO, "seed = 1  ", "noise = 0\nseed = 2  ", "seed: has no effect, as noise = 0",
    ),
    "noise where no sensor has any": (
        METRO.replace('"tooth_wheel", teeth = 120', '"exact"').replace('"0.05 m/s" }', '"0 m/s" }'),
        "seed = 1  ", "noise = 2  ", "noise: has no effect, no sensor has noise",
    ),
    "gain without unit": (
        METRO, 'K = "10 1/s"', "K = 10", "controllers.pid.K: 10.0 has no unit; it is read as 10 1/s"
    ),
    "text without unit": (
        METRO, 'k2 = "10 m/s^3"', 'k2 = "10"', "controllers.super_twisting.k2: 10 has no unit"
    ),
    "condition without unit": (
        EMU, 'B = "0.3 s/m"', "B = 0.3",
        "rail.conditions.dry.B: 0.3 has no unit; it is read as 0.3 s/m, write '0.3 s/m'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(NO_EFFECT))
def test_what_changes_no_run_is_told_at_its_key(tmp_path: Path, name: str) -> None:
    """And nothing is told of the files that slipctl writes."""
    text, before, after, said = NO_EFFECT[name]
    assert not trip_files.load(str(edited(tmp_path, {}, text))).without_effect
    told = trip_files.load(str(edited(tmp_path, {before: after}, text))).without_effect
    assert [line for line in told if line.startswith(said)], told
