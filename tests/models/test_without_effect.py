"""Each key of a vehicle's file that changes no run, or not as a reader takes it, is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from slipctl.study.files import trip_files
from tests.edited_files import EMU, METRO, edited

CAR = 'wheelbase = "2.5 m"\n'
LEVEL = METRO[METRO.index('kind = "constant"') : METRO.index("# until =")]
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
    "points before the start": (
        METRO, LEVEL, 'kind = "table"\nat = ["-2 s", "-1 s"]\ndeceleration ='
        ' ["1 m/s^2", "0 m/s^2"]', "demand.at.0: has no effect",
    ),
    "point too far": (
        METRO, LEVEL, 'kind = "table"\nover = "position"\nat = ["0 m", "9 km"]\ndeceleration ='
        ' ["1 m/s^2", "0 m/s^2"]', "demand.at.1: 9000 m is not before the end",
    ),
    "demand until too far": (
        METRO, LEVEL, f'until = "9 km"\n{LEVEL}', "demand.until: 9000 m is not before",
    ),
    "slope too far": (
        METRO, "[rail]\n", '[rail]\ngradient = [{ place = "0 m", gradient = 0 },'
        ' { place = "9 km", gradient = 0.01 }]\n', "rail.gradient.1.place: 9000 m is not before",
    ),
    "dead time of a whole run": (
        METRO.replace('"17 s"', '"1 s"'), '"20 ms"', '"2 s"', "actuator.dead_time: 2 s is not",
    ),
    "control that is off": (
        METRO.replace('"60 km/h"', '"20 km/h"'), "[control]\n", '[control]\noff = "8 m/s"\n',
        "control.off: is 8 m/s, the vehicle begins at 5.55556 m/s; slip control never",
    ),
    "slip that is never reached": (
        METRO, 'least = "0.5 m/s"', 'least = "18 m/s"', "control.least: is 18 m/s, the vehicle",
    ),
    "protection that is off": (
        EMU.replace("gradient = -0.015\n", "").replace('"140 km/h"', '"60 km/h"'),
        'kind = "wsp"', 'kind = "wsp"\ncut_off = "20 m/s"',
        "controllers.wsp.cut_off: is 20 m/s, the vehicle begins at 16.6667 m/s",
    ),
    "safe torque above all": (
        METRO, "[control]\n", '[control]\nsafe = "9 kN m"\n', "control.safe: is 9000 N m, an axle",
    ),
    "motors that faded": (
        METRO, "\n[actuator]", '\n[vehicle.dynamic_brake]\ntorque = "4 kN m"\nfades_from ='
        ' "30 m/s"\nfades_to = "20 m/s"\n[actuator]', "vehicle.dynamic_brake.fades_to: is 20 m/s",
    ),
    "motors lost at once": (
        METRO, "\n[actuator]", '\n[vehicle.dynamic_brake]\ntorque = "4 kN m"\nlost = "0 s"\n'
        "[actuator]", "vehicle.dynamic_brake.lost: is 0 s",
    ),
    "no sand": (
        EMU, 'tau = "3.4e-5 m/J"', 'sand = { axles = [1], rate = "0 kg/s" }',
        "rail.contamination.sand.rate: is 0",
    ),
    "centres of one bogie": (
        EMU, 'wheelbase = "2.5 m"', 'axles = 2\nbogies = 1', "vehicle.cars.0.bogie_centres: has",
    ),
    "bogies of one axle": (
        EMU, 'wheelbase = "2.5 m"', 'axles = 2\nwheelbase = "2.5 m"',
        "vehicle.cars.0.wheelbase: has no effect",
    ),
    "radius of no car": (
        EMU, 'wheelbase = "2.5 m"', 'wheelbase = "2.5 m"\nradius = "0.45 m"',
        "vehicle.radius: has no effect, as each car has its own",
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
