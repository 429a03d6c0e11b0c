"""A vehicle's file with contaminated rail: what it runs to, what it is refused for."""

import numpy as np
import pytest

from slipctl.errors import BadInput, Faults
from slipctl.models.vehicle import case, loop, scenario
from slipctl.run.preparation import prepare
from slipctl.study import resolve
from slipctl.study.files import trip_files

FILE = """
duration = "70 s"
end = "standstill"
[vehicle]
mass = "48 t"
places = ["0 m", "2 m", "14 m", "16 m"]
radius = "0.46 m"
inertia = "100 kg m^2"
speed = "25 m/s"
[actuator]
kind = "lag"
torque = "8 kN m"
lag = "100 ms"
[rail]
law = "falling_creep"
[[rail.sections]]
place = "0 m"
condition = "clean"
[rail.contamination]
condition = "leaves"
tau = "1e-4 m/J"
[[rail.contamination.places]]
from = "60 m"
to = "360 m"
[demand]
kind = "constant"
deceleration = "1.0 m/s^2"
[sensors]
wheel_speed = { kind = "exact" }
[controllers.none]
kind = "none"
"""
PLACES = FILE[FILE.index("[[rail.contamination.places]]") : FILE.index("[demand]")]


def read(tmp_path, text):
    path = tmp_path / "my.toml"
    path.write_text(text, encoding="utf-8")
    return trip_files.load_trip(str(path))


def rolled(trip, *names, **options):
    names = ["plant.train.x", "plant.train.v", *names]
    return prepare(loop(trip, "none"), scenario(trip), log=names, **options)()


def test_wheels_that_lock_in_leaves_stop_shorter_for_the_next_ones(tmp_path):
    """Behind the first axle adhesion rises from axle to axle; outside it is the rail's."""
    trip = read(tmp_path, FILE)
    log = rolled(trip, "plant.field.recovered", "plant.train.P_contact", "plant.train.P_slip")
    x = log["plant.train.x"][:, None] - np.array(trip.vehicle.behind)
    inside = (x >= 60) & (x < 360)
    share = log["plant.field.recovered"]
    assert (share[~inside] == 1).all()
    assert (share[:, 0][inside[:, 0]] == 0).all()  # nobody is before the first axle
    at_200 = [share[np.argmax(x[:, k] >= 200), k] for k in range(4)]
    assert at_200 == sorted(at_200)
    assert at_200[3] > 0.3
    heat = log["plant.train.P_contact"].sum(axis=1)
    assert heat == pytest.approx(log["plant.train.P_slip"], rel=1e-12, abs=1e-6)


def test_a_layer_that_nothing_cleans_is_a_rail_condition(tmp_path):
    everywhere = FILE.replace(PLACES, "").replace("1e-4 m/J", "0 m/J")
    alone = everywhere.replace('condition = "leaves"\ntau = "0 m/J"\n', "")
    alone = alone.replace("[rail.contamination]\n", "").replace('"clean"', '"leaves"')
    ways = [rolled(read(tmp_path, text))["plant.train.x"][-1] for text in (everywhere, alone)]
    assert ways[0] == pytest.approx(ways[1], rel=1e-12)


@pytest.mark.parametrize("law", ["falling_creep", "contact.polach", "exponential_tail"])
def test_the_peak_of_a_place_is_the_number_that_it_has(tmp_path, law):
    """Of any creep law, in any sign convention, at the speed at the start."""
    own = law == "falling_creep"
    text = FILE.replace('"falling_creep"', f'"{law}"').replace(
        '"clean"', '"clean"' if own else '"dry"'
    )
    text = text.replace('condition = "leaves"\n', 'condition = "leaves"\n' if own else "")
    text = text.replace('tau = "1e-4 m/J"', 'tau = "0 m/J"\npeak = 0.05')
    text = text.replace('to = "360 m"', 'to = "100 m"\n[[rail.contamination.places]]\n'
                        'from = "90 m"\nto = "200 m"\npeak = 0.03')  # fmt: skip
    if law == "contact.polach":
        load = 'Q = "58860 N"\na = "7.2 mm"\nb = "5.5 mm"\nc11 = "4.6"\n'
        numbers = "[rail.conditions.dry]\n" + load + "[[rail.sections]]"
        text = text.replace("[[rail.sections]]", numbers)
        text = text.replace(
            "peak = 0.05", f"peak = 0.05\nnumbers = {{ {', '.join(load.split(chr(10))[:-1])} }}"
        )
    trip = read(tmp_path, text)
    found = loop(trip, "none")["plant"]
    law_, field = found["train"]["adh"], found["field"]
    assert field.param_values()["start"].tolist() == [60, 90]
    for factor, peak in zip(field.param_values()["factor"], (0.05, 0.03), strict=True):
        slips = np.geomspace(1e-3, 25, 4000)
        curve = [float(law_(v_s=-s, v=25.0, recovered=0.0, height=factor)["mu"]) for s in slips]
        assert -min(curve) == pytest.approx(peak, rel=1e-4)


def test_what_the_rail_carries_follows_the_train(tmp_path):
    """The peak under each axle, in the log of a run, is that of its own blend of curves."""
    trip = read(tmp_path, FILE)
    found = case(trip)
    names = found.known["rail.best_adhesion"].reads
    log = rolled(trip, *(n for n in names if n != "time"))
    peaks = found.known["rail.best_adhesion"].values(log)
    slips = found.known["rail.best_slip"].values(log)
    law_ = loop(trip, "none")["plant.train.adh"]
    for tick, axle in ((200, 0), (4000, 0), (8000, 1), (8000, 3), (15000, 2)):
        v, share = log["plant.train.v"][tick], log["plant.field.recovered"][tick, axle]
        tried = np.geomspace(1e-3, 1, 4000) * v
        curve = [-float(law_(v_s=-s, v=v, recovered=share, height=1.0)["mu"]) for s in tried]
        assert peaks[tick, axle] == pytest.approx(max(curve), rel=2e-3)
        own = -float(law_(v_s=-slips[tick, axle], v=v, recovered=share, height=1.0)["mu"])
        assert own == pytest.approx(max(curve), rel=2e-3)


def test_a_run_has_the_same_bits_compiled_and_not(tmp_path):
    trip = read(tmp_path, FILE.replace('"70 s"', '"4 s"'))
    ways = [
        rolled(trip, "plant.field.W_seen", compile=c)["plant.field.W_seen"] for c in (True, False)
    ]
    assert (ways[0] == ways[1]).all()


def test_dried_and_fouled_again(tmp_path):
    """A layer dries for all; cleaned rail that is fouled again carries less for those behind."""
    ways = []
    for more in ("", 'drying = "5 s"', 'fouling = "0.05 h"', 'fouling = "1 s"', "own = true",
                 "layers = 2"):  # fmt: skip
        text = FILE.replace('"1e-4 m/J"', f'"1e-4 m/J"\n{more}')
        ways.append(rolled(read(tmp_path, text))["plant.train.x"][-1])
    plain, dried, slowly, fouled, own, two = ways
    assert dried < plain < slowly < fouled
    assert own < plain < two


def test_no_certificate_speaks_of_a_rail_that_changes(tmp_path):
    path = tmp_path / "my.toml"
    pid = '[controllers.pid]\nkind = "pid"\n'
    path.write_text(FILE + pid, encoding="utf-8")
    study = resolve.load_study(str(path))
    assert not study.gains
    assert "contaminated" in study.uncertified["pid"]


WRONG = {
    'from = "60 m"\nto = "360 m"': {
        'from = "60 m"\nto = "60 m"': ("places.0.to", "write a larger one"),
        'from = 60\nto = "360 m"': ("places.0.from", "no unit"),
        'to = "360 m"': ("places.0", "needs from"),
        'from = "3 km"\nto = "4 km"': ("places.0.from", "the run ends at 1750 m"),
        'from = "-40 m"\nto = "-20 m"': ("places.0.to", "behind the last axle"),
        'from = "60 m"\nto = "360 m"\npeak = 3': ("places.0.peak", "outside"),
    },
    'condition = "leaves"': {
        'condition = "leafs"': ("condition", "leaves"),
        'condition = "leaves"\nnumbers = { mu_1 = 0.1 }': ("numbers.mu_1", "mu_0"),
        'law = "falling_crepe"\ncondition = "leaves"': ("law", "falling_creep"),
        'condition = "leaves"\ncell = "2.5 m"': ("cell", "2 m between two axles"),
        'condition = "leaves"\ncell = "1 cm"': ("cell", "outside"),
        'condition = "leaves"\nlayers = 0.5': ("layers", "outside"),
        'condition = "leaves"\ntua = 3': ("tua", "tau"),
    },
}  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new"), [(old, new) for old, rows in WRONG.items() for new in rows]
)
def test_bad_input_is_one_line_with_its_key(tmp_path, old, new):
    last = FILE.rindex(old) if old.startswith("from") else FILE.index(old)
    key, words = WRONG[old][new]
    with pytest.raises(BadInput) as refused:
        read(tmp_path, FILE[:last] + new + FILE[last + len(old) :])
    error = refused.value
    lines = list(error.lines) if isinstance(error, Faults) else [str(error)]
    assert len(lines) == 1
    assert f"rail.contamination.{key}" in lines[0]
    assert words in lines[0]


def test_a_place_behind_the_end_of_the_run_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"places.0.from: is 60 m, and the run ends at 50 m"):
        read(tmp_path, FILE.replace('end = "standstill"', 'end = "50 m"'))
