"""Certificates of a vehicle of one's own: their bounds against its equations in plain NumPy."""

import json
from dataclasses import replace

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.commands import cli
from slipctl.models.vehicle.certificate import gains as asked
from slipctl.models.vehicle.trip import loop
from slipctl.study.files import trip_files

FILE = """
[vehicle]
mass = "38 t"
axles = {axles}
inertia = "110 kg m^2"
radius = "0.42 m"
speed = "60 km/h"
resistance = {{ a = "1.2 kN", b = "12 N s/m", c = "4.5 N s^2/m^2" }}
[actuator]
kind = "lag"
torque = "12 kN m"
lag = "60 ms"
dead_time = "20 ms"
[rail]
law = "double_exponential"
gradient = 0.02
[rail.conditions]
leaves = {{ c = 0.18 }}
[[rail.sections]]
place = "0 m"
condition = "dry"
[[rail.sections]]
place = "45 m"
condition = "leaves"
{reference}
{ensemble}
[controllers.sta]
kind = "sta"
k1 = 20
k2 = 10
[controllers.smc]
kind = "smc"
[controllers.eppfc]
kind = "eppfc"
[controllers.efc]
kind = "efc"
[controllers.hosm]
kind = "hosm"
[controllers.pid]
kind = "pid"
[controllers.predictive]
kind = "nmpc"
"""

ENSEMBLE = """
[ensemble]
draw = { m = "34 t:42 t" }
scale = { peak = "0.8:1.2 of plant.train.adh.c" }
"""
FITTED = ""
MEASURED = '[reference]\nkind = "speed"\nslip = "1.1 m/s"'


def written(folder, reference=FITTED, axles=4, ensemble=ENSEMBLE):
    path = folder / "own.toml"
    text = FILE.format(reference=reference, axles=axles, ensemble=ensemble)
    path.write_text(text, encoding="utf-8")
    return str(path)


def mu(c, slip):
    """Huang 2020 eq (4) with the numbers of dry rail."""
    return c * (np.exp(-0.54 * slip) - np.exp(-1.2 * slip))


@pytest.mark.parametrize(("reference", "goal"), [(FITTED, 1.2098601), (MEASURED, 1.1)])
def test_no_motion_in_the_tube_is_worse_than_the_bounds(tmp_path, reference, goal):
    """Random axles in their tubes on any rails of the ensemble: s' = v' - r omega' by hand."""
    trip = trip_files.load_trip(written(tmp_path, reference))
    over, left = asked.ranges(trip)
    met = asked.slip_law_bounds(trip, loop(trip, "sta"), over, trip.reference)
    assert left == ()
    rng, n, axles = np.random.default_rng(7), 20_000, 4
    M = rng.uniform(34e3, 42e3, (n, 1))
    c = rng.choice([1.0, 0.18], (n, axles)) * rng.uniform(0.8, 1.2, (n, 1))
    slip = goal * (1 + rng.choice([-0.05, 0.05, 0], (n, axles)) * rng.random((n, axles)))
    J, r, g, v = 110.0, 0.42, 9.81, 60 / 3.6
    rate = rng.uniform(-1, 1, (n, axles))  # of the slip; the bound is of the largest of them
    load = M * g / axles
    force = mu(c, slip) * load
    resistance = 1200 + 12 * v + 4.5 * v * v + M * g * 0.02
    falls = force * r**2 / J + (force.sum(axis=1, keepdims=True) + resistance) / M
    held = axles / M + r**2 / J
    if reference == FITTED:
        seen = held * force * (1 + 0.1 * rng.choice([-1, 1], (n, axles)))
    else:
        before = goal * (1 + 0.05 * rng.uniform(-1, 1, (n, axles)))
        seen = held * mu(c, before) * load
    wrong = np.abs(seen - falls).max()
    assert 0.4 * met.largest < wrong <= met.largest  # a bound, and no wild one
    slope = c * (-0.54 * np.exp(-0.54 * slip) + 1.2 * np.exp(-1.2 * slip)) * load
    moving = slope * rate
    change = moving * r**2 / J + moving.sum(axis=1, keepdims=True) / M
    if reference == FITTED:
        told = held * moving * (1 + 0.1 * rng.choice([-1, 1], (n, axles)))
    else:  # the mean of a window has at most the rate of what it is the mean of
        told = -change
    fastest = np.abs(rate).max(axis=1)
    assert (np.abs(told - change).max(axis=1) / fastest).max() <= met.slope


@pytest.mark.second
def test_what_is_late_decides(tmp_path, capsys):
    """The same gains hold with a prompt brake; 60 ms of lag and 20 ms of dead time refute them."""
    path = written(tmp_path)
    assert cli.main(["certify", f"{path}:sta", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    found = said["gains"]
    assert {k: found[k]["verdict"] for k in found} == {"sta": "REFUTED", "sta_prompt": "CERTIFIED"}
    assert said["verdict"] == "REFUTED"
    costs = found["sta"]["left_of_the_bound_with_half_a_range"]
    assert set(costs) == {"tube", "m", "c"}
    assert all(0 < v < 1 for v in costs.values())


@pytest.mark.second
def test_each_law_is_asked_as_its_system(tmp_path, capsys):
    """What has no criterion is said with its reason, and no number had to be typed."""
    path = written(tmp_path, MEASURED, axles=1, ensemble="")
    assert cli.main(["certify", path]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for system in ("super_twisting", "reaching_law", "prescribed_performance", "lagged_loop",
                   "higher_order"):  # fmt: skip
        assert f"), {system}: " in out
    assert "), axle_loop: " in out or "pid: no certificate, on every rail" in out
    assert "predictive: no certificate, what it does is the solution of a program" in out
    assert cli.main(["certify", f"{path}:pid"]) == 0
    assert "pid (loop pid), axle_loop: REFUTED" in capsys.readouterr().out
    assert cli.main(["certify", f"{path}:predictive"]) == 2
    assert "gains of predictive to certify: what it does" in capsys.readouterr().err


@pytest.mark.second
def test_the_certificate_of_a_loop_is_written_and_checked(tmp_path, capsys):
    path, file = written(tmp_path, ensemble=""), str(tmp_path / "c.json")
    assert cli.main(["certify", f"{path}:sta_prompt", "--out", file]) == 0
    assert cli.main(["check", file]) == 0
    assert "super_twisting, k1 = 20" in capsys.readouterr().out


def test_a_controller_that_was_told_another_wheel_is_refused(tmp_path):
    trip = trip_files.load_trip(written(tmp_path))
    over, _ = asked.ranges(trip)
    other = loop(trip, "sta").with_params(**{"plant.train.J": 150.0})
    with pytest.raises(BadInput, match="J = 110 and the vehicle J = 150"):
        asked.slip_law_bounds(trip, other, over, trip.reference)


@pytest.mark.parametrize("tube", ["1e-3", "0.05", "0.5"])
def test_a_tube_holds_the_slips_about_its_goal_and_what_they_fall_by(tmp_path, tube):
    """Slips within a share of the goal, with D at each of them by hand; a wide tube holds more."""
    path = written(tmp_path, MEASURED, ensemble=f"[certify]\ntube = {tube}")
    trip = trip_files.load_trip(path)
    over, _ = asked.ranges(trip)
    met = asked.slip_law_bounds(trip, loop(trip, "sta"), over, trip.reference)
    share, spans = float(tube), []
    for rail, c in zip(met.tubes, (1.0, 0.18), strict=True):
        assert rail.slips == pytest.approx((1.1 * (1 - share), 1.1 * (1 + share)))
        slip = np.linspace(*rail.slips, 99)
        force = mu(c, slip) * 38e3 * 9.81 / 4
        falls = force * 0.42**2 / 110 + 4 * force / 38e3
        low, high = rail.falls
        assert low <= falls.min() * (1 + 1e-9)
        assert falls.max() * (1 - 1e-9) <= high
        slope = np.abs(np.gradient(falls, slip)).max()
        assert slope <= met.slope
        spans.append(slope * 2 * 1.1 * share)
    assert met.tube == pytest.approx(1.1 * share)
    assert met.wrong >= max(spans) * (1 - 1e-3)


def test_a_draw_of_one_number_is_no_range(tmp_path):
    """An edit on the way passes through it: refused at its key, no error from inside."""
    from slipctl import registry
    from slipctl.study.files.trip_files import study_of_text

    file = registry.folder("models") / "vehicle" / "files" / "metro.toml"
    text = file.read_text(encoding="utf-8").replace('m = "34 t:42 t"', 'm = "342 t"')
    assert "342 t" in text
    with pytest.raises(BadInput, match=r"ensemble\.draw\.m"):
        study_of_text("metro.toml", text).cases(None, False)


def of_file(folder, name="own.toml", text=None, **choices):
    """What is asked about each controller: its numbers, and what half of each range leaves."""
    path = written(folder, **choices)
    if text:
        old, new = text
        told = (folder / "own.toml").read_text(encoding="utf-8")
        assert old in told
        (folder / "own.toml").write_text(told.replace(old, new), encoding="utf-8")
    trip = trip_files.load_trip(path)
    return trip, {g.name: g for g in asked.certificates(trip).gains}


SYSTEMS = {
    "sta": ("super_twisting", {"k1": 20, "k2": 10}, {"lag": 0.06, "dead": 0.02}),
    "smc": ("reaching_law", {}, {"lag": 0.06}),
    "eppfc": ("prescribed_performance", {}, {"lag": 0.06, "dead": 0.02}),
    "efc": ("lagged_loop", {}, {"lag": 0.06}),
    "hosm": ("higher_order", {}, None),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_law_is_asked_with_its_own_gains_and_the_bounds_of_its_tube(tmp_path, name):
    trip, found = of_file(tmp_path)
    system, gains, late = SYSTEMS[name]
    own = loop(trip, name)
    over, _ = asked.ranges(trip)
    met = asked.slip_law_bounds(trip, own, over, trip.reference)
    prompt = found[name if late is None else f"{name}_prompt"]
    n, law = prompt.numbers(own), {k.removeprefix("ctl.law.law."): float(np.max(v))
                                   for k, v in own.values_by_place().items()}  # fmt: skip
    assert prompt.system == system
    assert prompt.loop == name
    if late is not None:
        assert found[name].numbers(own) == n | late
    assert n.items() >= gains.items()
    if "T" in n:
        assert n["T"] == trip.control.period
    if name == "sta":
        # |x2| <= k1 sqrt(tube) in it, so |s'| <= 2 k1 sqrt(tube)
        assert n["L"] == pytest.approx(met.slope * 40 * met.tube**0.5 + met.drift)
        assert n["band"] == met.tube
    elif name == "smc":
        assert (n["g1"], n["g2"]) == (law["g1"], law["g2"])
        assert (n["D"], n["band"]) == (met.steady + met.wrong, met.tube)
    elif name == "efc":
        assert n == {"K": law["K"], "T": trip.control.period}
    elif name == "hosm":
        fastest = 2 * law["k_4"] * (met.tube**0.5 + met.tube)
        assert n == {"k4": law["k_4"], "alpha": law["alpha"], "beta": law["beta"],
                     "eta": pytest.approx(met.slope * fastest + met.drift)}  # fmt: skip
    else:  # the tube is the steady funnel, in slip ratio
        width = max(law["delta_l"], law["delta_u"]) * law["eta_inf"] * 60 / 3.6
        narrow = replace(over, tube=over.tube * width / met.tube)
        own_met = asked.slip_law_bounds(trip, own, narrow, trip.reference)
        assert own_met.tube == pytest.approx(width, rel=0.02)
        assert n["W"] == pytest.approx(own_met.largest * 3.6 / 60)


@pytest.mark.long
def test_half_a_range_leaves_of_a_bound_what_a_file_with_it_says(tmp_path):
    trip, found = of_file(tmp_path)
    own = loop(trip, "sta")
    whole, left = found["sta"].numbers(own)["L"], found["sta"].costs(own)
    halves = {
        "m": ('"34 t:42 t"', '"36 t:40 t"'), "c": ("0.8:1.2 of", "0.9:1.1 of"),
        "tube": ("[ensemble]", "[certify]\ntube = 0.025\n[ensemble]"),
    }  # fmt: skip
    assert set(left) == set(halves)
    for name, text in halves.items():
        other, narrow = of_file(tmp_path, text=text)
        share = narrow["sta"].numbers(loop(other, "sta"))["L"] / whole
        assert left[name] == pytest.approx(share, rel=asked.COARSE)
        assert 0 < left[name] < 1
    assert set(found["eppfc"].costs(loop(trip, "eppfc"))) == {"m", "c"}  # its tube is its funnel
    assert found["efc"].costs is None


@pytest.mark.parametrize(
    ("ensemble", "says"),
    [('draw = { m = "34 t" }', "ensemble.draw.m"), ('draw = { m = "1 t:2 t:3 t" }', "no range"),
     ('scale = { peak = "1.2" }', "ensemble.scale.peak"),
     ('draw = { m = "34 km:42 km" }', "ensemble.draw.m: .*another dimension"),
     ('draw = { m = "34:42 t" }', "ensemble.draw.m: .*unit at one end"),
     ('scale = { peak = "1.2:0.8 of rail.c" }', "ensemble.scale.peak: .*lower end first"),
     ('scale = { peak = "1 t:2 t of rail.c" }', "ensemble.scale.peak: .*another dimension")],
)  # fmt: skip
def test_what_is_no_range_is_refused_at_its_key(tmp_path, ensemble, says):
    with pytest.raises(BadInput, match=says):
        of_file(tmp_path, ensemble=f"[ensemble]\n{ensemble}")


def test_ranges_are_those_of_the_ensemble_and_what_no_bound_hears_is_told(tmp_path):
    draws = """[ensemble]
draw = { "plant.train.m" = "34 t:42 t", v = "50 km/h:60 km/h" }
scale = { peak = "0.8:1.2 of plant.train.adh.c, rail.c", lag = "0.5:2 of tau" }
"""
    trip, _ = of_file(tmp_path, ensemble=draws)
    over, left = asked.ranges(trip)
    assert over.numbers == {"m": (34e3, 42e3)}
    assert over.scale == {"c": (0.8, 1.2)}
    assert over.together == (("c",),)
    assert (over.untold, over.speed) == (True, pytest.approx(60 / 3.6))
    assert left == ("v", "tau")
    assert not asked.ranges(of_file(tmp_path)[0])[0].untold


def test_the_words_say_over_what_a_bound_is(tmp_path):
    _, found = of_file(tmp_path)
    said = found["sta"].bounds
    assert "within 5% of the best one of each rail condition" in said
    assert "at 60 km/h" in said
    assert "over the ensemble's m, c" in said
    assert "lag and dead time of the actuator" in said
    assert "never late" in found["sta_prompt"].bounds
    assert "steady funnel" in found["eppfc"].bounds
    assert "its dead time left out" in found["smc"].bounds
    _, found = of_file(tmp_path, reference=MEASURED, ensemble="")
    assert "of the reference" in found["sta"].bounds
    assert "measured over a window" in found["sta"].bounds
    assert "ensemble" not in found["sta"].bounds


def test_what_has_no_certificate_says_why(tmp_path):
    trip, found = of_file(tmp_path)
    assert asked.certificates(trip).uncertified == {"predictive": asked.NONE["nmpc"]}
    assert not [g for g in found.values() if g.loop in ("pid", "predictive")]
