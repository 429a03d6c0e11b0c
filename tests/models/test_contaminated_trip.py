"""A vehicle's file with contaminated rail: what it runs to, what it is refused for."""

import numpy as np
import pytest

from slipctl import simulate
from slipctl.errors import BadInput, Faults
from slipctl.models.vehicle import case, loop, scenario
from slipctl.models.vehicle import study as vehicle_study
from slipctl.models.vehicle.adhesion import layer_law, peak_of_layer
from slipctl.models.vehicle.contamination import patches_of_seed
from slipctl.run.measures.measured_run import Run
from slipctl.run.metrics import measure
from slipctl.run.preparation import prepare
from slipctl.run.sweep.ensemble import World
from slipctl.run.warnings.wheels import wheel_warnings
from slipctl.study import execution, resolve
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


@pytest.mark.second
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


@pytest.mark.second
def test_a_layer_that_nothing_cleans_is_a_rail_condition(tmp_path):
    everywhere = FILE.replace(PLACES, "").replace("1e-4 m/J", "0 m/J")
    alone = everywhere.replace('condition = "leaves"\ntau = "0 m/J"\n', "")
    alone = alone.replace("[rail.contamination]\n", "").replace('"clean"', '"leaves"')
    ways = [rolled(read(tmp_path, text))["plant.train.x"][-1] for text in (everywhere, alone)]
    assert ways[0] == pytest.approx(ways[1], rel=1e-12)


@pytest.mark.second
@pytest.mark.parametrize("law", ["falling_creep", "contact.polach", "exponential_tail"])
@pytest.mark.others("long")
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


@pytest.mark.second
@pytest.mark.long
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


@pytest.mark.second
def test_a_run_has_the_same_bits_compiled_and_not(tmp_path):
    trip = read(tmp_path, FILE.replace('"70 s"', '"4 s"'))
    ways = [
        rolled(trip, "plant.field.W_seen", compile=c)["plant.field.W_seen"] for c in (True, False)
    ]
    assert (ways[0] == ways[1]).all()


@pytest.mark.long
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
    assert not study.certificates.gains
    assert "contaminated" in study.certificates.uncertified["pid"]


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


@pytest.mark.second
def test_a_run_tells_what_its_wheels_have_taken(tmp_path):
    """Metrics of a locked stop: books below 1e-9 (E1), heat that of the train, limits marked."""
    text = FILE.replace(
        "[controllers.none]", '[limits]\nlongest_lock = "0.4 s"\n[controllers.none]'
    )
    trip = read(tmp_path, text)
    found, names = case(trip), {"plant.train.omega", "slip.y", "plant.T"}
    log = simulate(loop(trip, "none"), scenario(trip))
    log = execution.add_known(vehicle_study.study(trip), found, log)
    got = {n: m.value for n, m in measure(Run(log, vehicle_study.SIGNALS)).items()}
    assert names <= set(log)
    assert got["energy_error"] < 1e-9
    assert got["contact_energy"] == pytest.approx(float(log["plant.train.P_slip"].sum()) * 1e-3)
    v, rim = log["plant.train.v"].values[:, None], 0.46 * log["plant.train.omega"].values
    locked = ((rim < 0.05 * v) & (v > 1)).sum(axis=0)  # each axle once
    assert got["longest_lock"] == pytest.approx(locked.max() * 1e-3, abs=2e-3)
    assert got["flash_temperature"] > 720  # martensite: four locked wheels on clean rail
    with pytest.raises(BadInput, match=r"limits.longest_lock: needs"):
        read(tmp_path, text[: text.index("[rail.contamination]")] + text[text.index("[demand]") :])


# ---- patches that are drawn ----------------------------------------------------------------------

DRAWN = """
[ensemble.patches]
number = [1, 4]
length = ["20 m", "80 m"]
peak = [0.02, 0.03]
from = "50 m"
to = "300 m"
"""


def test_patches_are_drawn_by_their_seed_alone(tmp_path):
    """Number, place, length and peak in their ranges; the same for a seed, others for another."""
    trip = read(tmp_path, FILE + DRAWN)
    patches = patches_of_seed(trip)
    factor = peak_of_layer(layer_law(trip, trip.rail.contamination), 25.0)
    counts = set()
    for seed in range(60):
        found = patches(seed)
        assert all((found[k] == v).all() for k, v in patches(seed).items())
        begin, end, by = (found[f"plant.field.{k}"] for k in ("start", "end", "factor"))
        real = begin < 1e6
        counts.add(int(real.sum()))
        assert ((begin[real] >= 50) & (begin[real] <= 300)).all()
        length = (end - begin)[real]
        assert ((length >= 20) & (length <= 80)).all()
        assert ((by[real] * factor >= 0.02 - 1e-12) & (by[real] * factor <= 0.03 + 1e-12)).all()
    assert counts == {1, 2, 3, 4}


@pytest.mark.long
def test_an_ensemble_runs_on_the_patches_of_its_draws(tmp_path):
    """Each draw is a run of its own: wheels find the drawn layer, and stop elsewhere for it."""
    path = tmp_path / "my.toml"
    path.write_text(FILE + DRAWN, encoding="utf-8")
    study = resolve.load_study(str(path))
    found = study.cases(None, False)[0]
    world = World(found.loops["none"], found.scenario, study.ensembles["base"],
                  signals=study.signals, known=found.known)  # fmt: skip
    draws = [world.draw(0, k) for k in range(2)]
    ways = [world.metrics({}, d)["stopping_distance"].value for d in draws]
    again = world.metrics({}, world.draw(0, 0))["stopping_distance"].value
    assert ways[0] == again != ways[1]
    alone = prepare(found.loops["none"], found.scenario)(draws[1].numbers)
    v = alone["plant.train.v"]
    assert ways[1] == pytest.approx(alone["plant.train.x"][np.argmax(np.abs(v) <= 0.1)], abs=1e-3)
    without = study.ensembles["base"].hash
    path.write_text(FILE + DRAWN.replace("300 m", "310 m"), encoding="utf-8")
    assert resolve.load_study(str(path)).ensembles["base"].hash != without


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("number = [1, 4]", "number = [4, 1]", "ensemble.patches.number: is a pair"),
        ("number = [1, 4]", "number = [1, 99]", "outside 0 .. 40"),
        ('to = "300 m"', 'to = "30 m"', "ensemble.patches.to: is 30 m"),
        ('to = "300 m"', 'to = "30 km"', "ensemble.patches.to: is 30000 m, and the run ends at"),
        ("peak = [0.02, 0.03]", "", "needs peak"),
    ],
)
def test_patches_that_cannot_be_drawn_are_refused(tmp_path, old, new, words):
    with pytest.raises(BadInput) as refused:
        read(tmp_path, FILE + DRAWN.replace(old, new))
    assert words in str(refused.value)


# ---- sand ----------------------------------------------------------------------------------------

SAND = """
[rail.contamination.sand]
axles = [1, 3]
rate = "30 g/s"
"""


@pytest.mark.second
@pytest.mark.long
def test_sand_is_found_by_the_axles_behind_its_nozzle(tmp_path):
    """rate/v by metre on each rail, less the share that each wheel takes; none before the delay."""
    slow = FILE.replace("1e-4 m/J", "0 m/J").replace(PLACES, "")
    log = rolled(read(tmp_path, slow + SAND), "plant.field.S_seen", "plant.field.sand",
                 "plant.train.omega")  # fmt: skip
    v, seen, sand = (log[f"plant.{n}"] for n in ("train.v", "field.S_seen", "field.sand"))
    slides = np.argmax(np.abs(v - 0.46 * log["plant.train.omega"][:, 0]) > 0.05 * v)
    assert seen[: slides + 999].max() == 0
    k = slides + 4000  # all have come to the sand; the speed falls by less than 1 % meanwhile
    flow = 0.03 / v[k]
    wanted = [flow, 0.7 * flow, 0.49 * flow + flow, 0.7 * (0.49 * flow + flow)]
    assert seen[k] == pytest.approx(wanted, rel=0.02)
    poured = np.flatnonzero(np.diff(sand) > 0)
    assert sand[-1] == pytest.approx(4 * 0.03 * poured.size * 1e-3, rel=1e-9)  # both rails
    assert v[poured[-1]] == pytest.approx(25 / 3.6, abs=0.05)
    dry = rolled(read(tmp_path, slow))
    assert log["plant.train.x"][-1] < 0.9 * dry["plant.train.x"][-1]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("axles = [1, 3]", "axles = [1, 3]\nahead = '-0.3 m'", "the nozzle is behind its axle"),
        ("axles = [1, 3]", "axles = [1, 3]\nahead = '0.1 m'", "within a cell of 0.25 m"),
        ("axles = [1, 3]", "axles = [5]", "names axle 5 of 4"),
        ("axles = [1, 3]", "axles = [1, 1]", "none twice"),
        ("axles = [1, 3]", "", "needs axles"),
    ],
)
def test_sand_that_falls_behind_its_wheel_is_refused(tmp_path, old, new, words):
    with pytest.raises(BadInput) as refused:
        read(tmp_path, FILE + SAND.replace(old, new))
    assert words in str(refused.value)
    assert "rail.contamination.sand" in str(refused.value)


@pytest.mark.second
@pytest.mark.parametrize(("peak", "tau", "axles"), [
    (0.2, "0 m/J", "1234"), pytest.param(0.03, "0 m/J", "", marks=pytest.mark.long),
    (0.03, "3e-4 m/J", "34"),
])  # fmt: skip
@pytest.mark.others("long")
def test_a_brake_that_is_held_back_is_told_where_the_layer_carries_the_demand(
    tmp_path, peak, tau, axles
):
    """The rail is as it is under each axle then: the first finds the layer, the last does not.

    Asked are 1 m/s^2, an adhesion of 0.102; each axle alone is given a tenth of it.
    """
    text = FILE.replace(PLACES, "").replace('tau = "1e-4 m/J"', f'tau = "{tau}"\npeak = {peak}')
    trip = read(tmp_path, text)
    log = prepare(loop(trip, "none"), scenario(trip), compile=False)(doubt=True)
    assert log.told() == []
    told = ""
    for axle in range(4):
        command = np.array(log.watched["ctl.T_cmd"], copy=True)
        command[:, axle] *= 0.1
        changed = {n: log.watched[n] for n in log.watched} | {"ctl.T_cmd": command}
        lines = wheel_warnings(log.loop, log.scenario, changed)
        told += str(axle + 1) * any(f"of axle {axle + 1} below the demand" in x for x in lines)
    assert told == axles
