"""Absurd vehicle files and laws are refused, told, or right: a few draws of ``vehicles.py``."""

import copy

import pytest
from vehicles import BASE, absurd_law, absurd_vehicle, ended, number_fields, put, toml

from slipctl.errors import BadInput
from slipctl.study.resolve import load_study


@pytest.mark.parametrize("seed", range(8))
def test_an_absurd_vehicle_is_refused_told_or_right(seed, tmp_path):
    how, lines = ended(absurd_vehicle(seed), "", tmp_path, "none")
    assert how in ("refused", "told", "right"), lines


@pytest.mark.parametrize("seed", range(12))
def test_an_absurd_law_is_refused_told_or_right(seed, tmp_path):
    how, lines = ended(*absurd_law(seed), tmp_path, "none")
    assert how in ("refused", "told", "right"), lines


def changed(**places):
    """The file that is right, with other values at ``table_key``."""
    table = copy.deepcopy(BASE)
    for place, value in places.items():
        put(table, tuple(place.split("__")), value)
    return table


def remarks(table, folder):
    """What a run would tell before it runs."""
    path = folder / "trip.toml"
    path.write_text(toml(table), encoding="utf-8")
    return load_study(str(path)).without_effect


def test_a_usual_vehicle_is_told_nothing(tmp_path):
    assert remarks(BASE, tmp_path) == ()


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        ("vehicle__mass", "90 t", "an axle carries 45 t"),
        ("vehicle__inertia", "2000 kg m^2", "what turns"),
        ("vehicle__resistance", {"a": "30 kN"}, "slows by 0.789 m/s"),
        ("vehicle__resistance", {"b": "1.2 kN s/m"}, "slows by 0.526 m/s"),
        ("vehicle__resistance", {"c": "100 N s^2/m^2"}, "slows by 0.731 m/s"),
        ("vehicle__speed", "125 m/s", "450 km/h"),
        ("vehicle__speed", "0 m/s", "stands at the start"),
        ("rail__conditions", {"leaves": {"c": 0.02}}, "conditions.leaves: adhesion is 0.00572"),
        ("rail__conditions", {"leaves": {"c": 3.0}}, "conditions.leaves: adhesion is up to 0.858"),
        ("reference__slip", "18 m/s", "above the vehicle's speed"),
        ("reference", {"kind": "ratio", "slip": 0.8}, "0.8 of the speed"),
        ("sensors__wheel_speed", {"kind": "tooth_wheel", "teeth": 2}, "every 79.2 ms"),
    ],
)  # fmt: skip
def test_what_no_train_has_is_told(place, value, told, tmp_path):
    found = remarks(changed(**{place: value}), tmp_path)
    assert any(told in line for line in found)


@pytest.mark.parametrize(
    ("place", "value", "key"),
    [
        ("vehicle__mass", "1000 t", "vehicle.mass"),
        ("vehicle__inertia", "0.5 kg m^2", "vehicle.inertia"),
        ("vehicle__resistance__a", "2 MN", "vehicle.resistance.a"),
        ("vehicle__resistance__a", "40 kN", "vehicle.resistance.a"),
        ("actuator", {"kind": "valve", "torque": "700 kN m"}, "actuator.torque"),
        ("rail__conditions", {"leaves": {"c": 4.0}}, "rail.conditions.leaves"),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(place, value, key, tmp_path):
    with pytest.raises(BadInput, match=f"trip.toml, line [0-9]+: {key}"):
        remarks(changed(**{place: value}), tmp_path)


@pytest.mark.parametrize("law", ["mu = k*v_s where v_s [m/s], k = 0 s/m",
                                 "mu = k*tanh(v_s/w)*sin(v/u) where v_s [m/s], v [m/s], k = 0.3,"
                                 " w = 1 m/s, u = 2 m/s"])  # fmt: skip
def test_a_law_is_asked_at_all_speeds_of_the_trip(law, tmp_path):
    """The second one opposes slip at 1 m/s and at 60 km/h, and pushes at 8 m/s."""
    table = changed(rail__law=law, rail__conditions={"x": {}})
    table["rail"]["sections"] = [{"place": "0 m", "condition": "x"}]
    with pytest.raises(BadInput, match=r"conditions.x: adhesion is (0 at all slips|-)"):
        remarks(table, tmp_path)


@pytest.mark.long
def test_every_number_at_its_ends_runs_or_is_refused_by_its_key(tmp_path):
    lost = []
    for keys, meta, _ in number_fields():
        for end in (meta["lo"], meta["hi"]):
            if abs(end) == float("inf") or keys[-1] == "duration":
                continue
            table = changed()
            unit = meta["unit"]
            put(table, keys, end if unit == "1" else f"{end!r} {unit}")
            if keys[-1] in ("tare", "force", "acceleration", "rotating_mass"):
                other = {"tare": "mass", "rotating_mass": "inertia"}.get(keys[-1], "deceleration")
                table[keys[0]].pop(other)
            how, lines = ended(table, "", tmp_path, "none", run=False)
            named = {keys[-1], *(("inertia",) if keys[-1] in ("mass", "tare") else ())}
            unnamed = how == "refused" and not any(word in lines[0] for word in named)
            if how not in ("refused", "right") or unnamed:
                lost.append((keys, end, how, lines))
    assert lost == []
