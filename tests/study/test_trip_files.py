"""Files that describe a vehicle: what they say, and what is told of a fault."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slipctl.commands.cli import main
from slipctl.errors import BadInput, Faults
from slipctl.models import vehicle
from slipctl.models.vehicle import parts
from slipctl.run.results import Results
from slipctl.study import resolve
from slipctl.study.files import trip_files

METRO = (Path(vehicle.__file__).parent / "files" / "metro.toml").read_text(encoding="utf-8")


def read(tmp_path, text):
    path = tmp_path / "my.toml"
    path.write_text(text, encoding="utf-8")
    return trip_files.load_trip(str(path))


def told(tmp_path, text):
    with pytest.raises(BadInput) as refused:
        read(tmp_path, text)
    error = refused.value
    return list(error.lines) if isinstance(error, Faults) else [str(error)]


def line_with(text, part):
    return next(k for k, line in enumerate(text.split("\n"), start=1) if part in line)


def test_the_file_of_slipctl_new_is_what_it_says(tmp_path):
    trip = read(tmp_path, METRO)
    assert trip.vehicle.total == 38e3
    assert trip.vehicle.speed == pytest.approx(60 / 3.6, rel=1e-15)
    assert trip.actuator == parts.Lag(torque=8e3, lag=0.06, dead_time=0.02)
    assert trip.sensors.wheel_speed == parts.ToothWheel(teeth=120)
    assert [s.place for s in trip.rail.sections] == [0, 45, 75]
    assert (trip.limits.stopping_distance, trip.limits.lock_time) == (140, 0.3)
    assert trip.controllers["super_twisting"].gains == {"k1": "20 m^.5/s^1.5", "k2": "10 m/s^3"}


@pytest.mark.second
def test_a_file_that_is_edited_is_read_again(tmp_path, monkeypatch):
    """In one process, by the same name, and in another folder too: the old vehicle was given."""
    for folder, mass in (("a", 38), ("a", 42), ("b", 40)):
        (tmp_path / folder).mkdir(exist_ok=True)
        monkeypatch.chdir(tmp_path / folder)
        Path("car.toml").write_text(METRO.replace('"38 t"', f'"{mass} t"'), encoding="utf-8")
        loop, _ = resolve.find_loop(resolve.load_study("car.toml"), "none")
        assert float(loop.param_values()["m"]) == mass * 1e3


OWN = """
[adh]
mu = "0.3*tanh(v_s/w)"
inputs = { v_s = "m/s" }
parameters = { w = "0.5 m/s" }
[pull]
T_wanted = "K*v_s*J/r"
inputs = { v_s = "m/s" }
parameters = { K = "3 1/s", J = "110 kg m^2", r = "0.42 m" }
"""


def test_files_that_a_file_names_lie_beside_it(tmp_path, monkeypatch):
    """Wherever slipctl runs; where it is not there, in the folder in which slipctl runs."""
    text = METRO[: METRO.index("[ensemble]")].replace('"exponential_tail"', '"own.toml:adh"')
    text = re.sub(r"(?m)^leaves = .*$", "leaves = {}\ndry = {}", text)
    text += '[controllers.own]\nkind = "file"\nblock = "own.toml:pull"\n'
    for folder in ("car", "away"):
        (tmp_path / folder).mkdir()
    monkeypatch.chdir(tmp_path / "away")
    path = tmp_path / "car" / "car.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput, match=r"cannot read .*car/own.toml"):
        resolve.load_study(str(path))
    (tmp_path / "car" / "own.toml").write_text(OWN, encoding="utf-8")
    resolve.find_loop(resolve.load_study(str(path)), "own")
    trip = trip_files.load_trip(str(path))
    assert trip.controllers["own"].block == f"{tmp_path / 'car' / 'own.toml'}:pull"
    (tmp_path / "car" / "own.toml").rename(tmp_path / "away" / "own.toml")
    path.write_text(text + "\n", encoding="utf-8")
    assert trip_files.load_trip(str(path)).controllers["own"].block == "own.toml:pull"


def test_a_loop_that_cannot_be_made_names_the_line_of_its_controller(tmp_path, monkeypatch):
    """What only the whole loop refuses: a tick that all blocks share, off the range of a law."""
    monkeypatch.chdir(tmp_path)
    ranged = 'T = { value = "9 ms", range = ["5 ms", "20 ms"] }, J ='
    own = OWN.replace("K*v_s*J/r", "K*v_s*J/r*T/T").replace("J =", ranged)
    Path("own.toml").write_text(own, encoding="utf-8")
    text = METRO + '[controllers.own]\nkind = "file"\nblock = "own.toml:pull"\n'
    Path("car.toml").write_text(text, encoding="utf-8")
    line = text.splitlines().index("[controllers.own]") + 1
    study = resolve.load_study("car.toml")
    resolve.find_loop(study, "none")
    with pytest.raises(BadInput, match=rf"^car.toml, line {line}: controllers.own: .*T = 0.001 s"):
        resolve.find_loop(study, "own")


def test_a_file_declares_its_ensemble(tmp_path):
    table = '[ensemble]\nseeds = true\ndraw = { m = "36t:42t" }\n'
    path = tmp_path / "my.toml"
    without = METRO[: METRO.index("[ensemble]")] + METRO[METRO.index("[controllers.none]") :]
    path.write_text(without + table, encoding="utf-8")
    found = resolve.load_study(str(path)).ensembles["base"]
    assert (found.seeds, found.draw, found.scale) == (True, {"m": "36t:42t"}, {})
    assert "write a table" in told(tmp_path, without + "[ensemble]\nseeds = true\ndraw = 3\n")[0]
    assert "empty" in told(tmp_path, without + "[ensemble]\n")[0]


def test_new_writes_a_file_and_its_schema_and_never_over_another(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "metro"]) == 0
    assert Path("metro.toml").read_text(encoding="utf-8") == METRO
    defined = json.loads(Path("slipctl.schema.json").read_text(encoding="utf-8"))["$defs"]
    assert set(tomllib.loads(METRO)) <= set(defined["Trip"]["properties"])
    assert defined["Vehicle"]["additionalProperties"] is False
    assert main(["new", "metro"]) == 2
    assert "metro.toml exists" in capsys.readouterr().err
    assert main(["new", "metto"]) == 2
    assert "did you mean 'metro'" in capsys.readouterr().err


@pytest.mark.long
def test_show_and_certify_know_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("metro.toml").write_text(METRO, encoding="utf-8")
    assert main(["show", "metro.toml"]) == 0
    assert "none, pid, super_twisting, predictive" in capsys.readouterr().out
    assert main(["certify", "metro.toml:pid"]) == 0
    assert "axle_loop: CERTIFIED" in capsys.readouterr().out
    assert main(["certify", "metro.toml:predictive"]) == 2
    assert "declares no gains of predictive to certify: what it does" in capsys.readouterr().err
    loop, case = resolve.find_loop(resolve.load_study("metro.toml"), "none")
    assert case.scenario.duration == 17.0
    assert loop["plant.train"].choices["axles"] == 4


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('mass = "38 t" ', 'mass = "38 km" ', "another dimension"),
        ('mass = "38 t" ', "mass = 38 ", "38 has no unit; write '38 kg'"),
        ('mass = "38 t" ', 'mass = "38000" ', "'38000' has no unit; write '38000 kg'"),
        ('mass = "38 t" ', 'mass = "-38 t" ', "outside"),
        ('wheelbase = "2.1 m"', 'wheelbase = "2.1 m"\nplaces = ["0 m"]', "places tells it already"),
        ('wheelbase = "2.1 m"', 'wheelbase = "2.1 m"\ncars = [{}]', "cars tells it already"),
        ("leaves = { c = 0.09,", 'leaves = { c = "9 m",', "write for instance '9'"),
        ('mass = "38 t" ', 'masss = "38 t" ', "did you mean 'mass'"),
        ("axles = 4 ", "axles = 33 ", "outside 1 .. 32"),
        ("axles = 4 ", "axles = 3.5 ", "whole number"),
        ('"tooth_wheel"', '"toothwheel"', "did you mean 'tooth_wheel'"),
        ('mode = "brake"', 'mode = "braek"', "did you mean 'brake'"),
        ('kind = "sta"', 'kind = "st"', "did you mean 'sta'"),
        ('k1 = "20 m', 'k9 = "20 m', "k9"),
        ('k1 = "20 m^.5/s^1.5"', 'k1 = "20 m"', "another dimension"),
        ("leaves = { c = 0.09", "leaves = { d = 0.18", "has no parameter of this name"),
        ('condition = "leaves"', 'condition = "leafs"', "did you mean 'leaves'"),
        ('place = "45 m"', 'place = "85 m"', "not after the one before"),
        ('law = "exponential_tail"', 'law = "exponential_tial"', "exponential_tail"),
        ('torque = "8 kN m" ', "", "needs torque"),
        ('end = "standstill"', 'end = "standstil"', "or 'standstill'"),
        ('end = "standstill"', 'end = "130"', "write a number in m"),
        ('end = "standstill"', 'end = "-3 m"', "not above 0"),
        ('deceleration = "1.2 m/s^2"', 'until = "12 kg"\ndeceleration = "1.2 m/s^2"', "s or m"),
    ],
)  # fmt: skip
def test_a_fault_is_told_with_its_line_and_what_is_meant(tmp_path, old, new, why):
    assert METRO.count(old) == 1, old
    lines = told(tmp_path, METRO.replace(old, new))
    assert any(why in line for line in lines), lines
    assert all(re.search(r"my\.toml, line \d+: ", line) for line in lines), lines
    if new and why != "not after the one before":
        number = line_with(METRO, old)
        # a table's own line where the key is within an inline table or follows from another key
        assert any(f"line {n}: " in lines[0] for n in range(number - 3, number + 1)), lines


def test_all_faults_are_told_at_once(tmp_path):
    text = METRO.replace('"38 t" ', '"38 km" ').replace('"toothwheel"', "").replace(
        "axles = 4 ", "axles = 99 ").replace('"2.1 m"', "2.1")  # fmt: skip
    assert len(told(tmp_path, text)) == 3


def test_all_faults_of_a_law_of_ones_own_are_told_at_once(tmp_path):
    """Conditions of another law stay in the file: each number of them, and each section."""
    text = METRO.replace(
        'law = "exponential_tail"', 'law = "mu = m*v_s where v_s [m/s], m = 1 s/m"'
    )
    text = text.replace("leaves = { c = 0.09, s = 0.03 }", 'leaves = { c = 0.09, m = "2 kg" }')
    lines = told(tmp_path, text)
    paths = [re.search(r"line \d+: (\S+): ", line)[1] for line in lines]
    assert paths == ["rail.conditions.leaves.c", "rail.conditions.leaves.m",
                     "rail.sections.0.condition", "rail.sections.2.condition"]  # fmt: skip


def test_a_fault_on_the_command_line_is_one_line_each_and_exit_code_2(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(METRO.replace('"38 t" ', '"38 km" '), encoding="utf-8")
    assert main(["run", "my.toml"]) == 2
    said = capsys.readouterr().err.strip().split("\n")
    assert len(said) == 1
    assert said[0].startswith("slipctl: my.toml, line 19: vehicle.mass: ")
    assert main(["run", "absent.toml"]) == 2
    assert "there is no file absent.toml" in capsys.readouterr().err


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
@pytest.mark.second
def test_an_altered_file_is_read_or_refused(tmp_path_factory, data):
    lines = METRO.split("\n")
    for _ in range(data.draw(st.integers(1, 3))):
        k = data.draw(st.integers(0, len(lines) - 1))
        junk = data.draw(
            st.sampled_from(
                ["", "[", "x = 1", "[vehicle]", 'kind = "none"', "place = true", "= 3", "a = nan",
                 'mass = "1e999 t"', "seed = -1", "[[rail.sections]]", 'axles = "4"',
                 'radius = ["0.4 m"]', "gradient = [1, 2]", "start = { c = [] }", "[controllers]"]
            ) | st.text(max_size=12)
        )  # fmt: skip
        how = data.draw(st.integers(0, 3))
        if how == 0:
            lines[k] = junk
        elif how == 1:
            lines.insert(k, junk)
        elif how == 2:
            del lines[k]
            lines = lines or [""]
        else:
            cut = data.draw(st.integers(0, len(lines[k])))
            lines[k] = lines[k][:cut] + junk + lines[k][cut:]
    folder = tmp_path_factory.mktemp("altered")
    try:
        found = read(folder, "\n".join(lines))
    except BadInput as error:
        found = error
    assert isinstance(found, (parts.Trip, BadInput))


@pytest.mark.second
def test_what_the_loops_of_a_file_have_in_common_is_made_and_drawn_once(tmp_path, monkeypatch):
    from slipctl.draw.diagrams import diagram
    from slipctl.models.vehicle import trip as made
    from slipctl.study.report import report_page

    counts = {"plant": 0, "drawing": 0}

    def counted(name, make):
        def once_more(*given):
            counts[name] += 1
            return make(*given)

        return once_more

    monkeypatch.setattr(made, "plant", counted("plant", made.plant))
    monkeypatch.setattr(diagram, "Drawing", counted("drawing", diagram.Drawing))
    path = tmp_path / "my.toml"
    path.write_text(METRO, encoding="utf-8")
    study = resolve.load_study(str(path))
    results = Results(study, study.cases(study.models, True), True)
    page = report_page.constant(results)["loops"]()
    assert counts["plant"] == 1
    assert counts["drawing"] == page.count("<img") == len(set(re.findall(r'src="[^"]+"', page)))


OWN_RAIL = 'law = "mu = c*exp(1)*v_s/v_0*exp(-v_s/v_0) where v_s [m/s], c = 0.3, v_0 = 0.8 m/s"'
SPUN = f"""
duration = "0.4 s"
[vehicle]
mode = "drive"
mass = "40 t"
axles = 4
driven = [2, 4]
rotating_mass = "8 %"
speed = "20 km/h"
[actuator]
kind = "lag"
torque = "9 kN m"
lag = "10 ms"
[rail]
{OWN_RAIL}
[rail.conditions]
dry = {{ c = 0.3 }}
ice = {{ c = 0.03 }}
[[rail.sections]]
place = "0 m"
condition = "dry"
[[rail.sections]]
place = "0.5 m"
condition = "ice"
[demand]
kind = "constant"
force = "45 kN"
[sensors]
wheel_speed = {{ kind = "exact" }}
vehicle_speed = {{ kind = "exact" }}
[reference]
kind = "searched"
{OWN_RAIL}
[controllers.none]
kind = "none"
[controllers.pid]
kind = "pid"
"""


@pytest.mark.second
def test_some_driven_axles_on_a_rail_of_ones_own(tmp_path, monkeypatch, capsys):
    """The first axle stands on ice and the others on dry rail, each is told by its own rail; slip
    is that of the driven axles, and a wheel that spins does not lock."""
    monkeypatch.chdir(tmp_path)
    Path("spun.toml").write_text(SPUN, encoding="utf-8")
    assert main(["run", "spun.toml", "--no-compile", "--out", "out"]) == 0
    said = capsys.readouterr()
    assert "no wire feeds" not in said.out + said.err
    found = json.loads(Path("out/metrics.json").read_text())["scenarios"]["base"]
    for loop in ("none", "pid"):
        assert 0 < found[loop]["adhesion_use"]["value"] <= 1
        assert found[loop]["lock_time"]["value"] == 0
    assert found["pid"]["slip_max"]["value"] > 0
    assert "slip_error_rms" in found["pid"]


def test_a_number_of_a_law_of_ones_own_is_no_gravity(tmp_path, monkeypatch):
    """A gain g in N s stays what it is; tau in s is the lag of the actuator."""
    monkeypatch.chdir(tmp_path)
    own = 'block = "own.toml:mine"\ng = "8 kN s"\nreference = { kind = "speed", slip = "1 m/s" }'
    assert 'kind = "pid"\nK = "10 1/s"' in METRO
    text = METRO.replace('kind = "pid"\nK = "10 1/s"', f'kind = "file"\n{own}')
    Path("my.toml").write_text(text, encoding="utf-8")
    Path("own.toml").write_text(
        '[mine]\nT_wanted = "g*(v_best - v_s)*tau/T_0"\n'
        'inputs = { v_best = "m/s", v_s = "m/s" }\n'
        'parameters = { g = "5 kN s", tau = "10 ms", T_0 = "1 s" }\n',
        encoding="utf-8",
    )
    loop, _ = resolve.find_loop(trip_files.load("my.toml"), "pid")
    values = loop.values_by_place()
    assert float(values["ctl.law.g"]) == 8000
    assert float(values["ctl.law.tau"]) == 0.06
    assert float(values["g"]) == 9.81


def test_a_file_of_blocks_is_no_vehicle(tmp_path):
    """One line says so, in place of all that a vehicle needs."""
    path = tmp_path / "mine.toml"
    path.write_text('[soft]\nT_wanted = "k*u"\n', encoding="utf-8")
    with pytest.raises(BadInput, match="describes no vehicle, it has soft; slipctl new"):
        trip_files.load(str(path))
