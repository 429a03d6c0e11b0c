"""Curves of a run whose numbers are made up, panel by panel, and their bytes."""

from __future__ import annotations

import json
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl.workbench import curves, texts
from slipctl.workbench.curves import Curves, Panel, Series

TIME = np.array([0.5, 1.0, 1.5])


def run(units: dict[str, str], roles: dict[str, Any], sign: int = 1, **more: Any) -> Any:
    """A run of three ticks: columns of each role, a column for each axle that has it."""
    columns = {k: np.asarray(v, float).reshape(3, -1) for k, v in roles.items()}
    made = dict(time=TIME, changes=[1.0, 1.25], rows=["dry", "wet", "ice"], travelled=None,
                signals=SimpleNamespace(axles=more.pop("axles", None)), slip_sign=sign,
                each=columns.get, unit=lambda role: units.get(role, ""))  # fmt: skip
    return SimpleNamespace(**made | more)


def told(panel: Panel) -> list[tuple[str, int, str, list[float]]]:
    return [(s.name, s.axle, s.looks, [round(float(v), 9) for v in s.values])
            for s in panel.series]  # fmt: skip


def test_a_run_of_several_axles_has_a_curve_of_each_beside_what_is_best_and_wanted() -> None:
    slip = [[1, 2, 3], [2, 4, 5], [3, 6, 8]]
    of = run(
        {"slip": "m/s", "torque": "N m", "pressure": "Pa", "adhesion": "1"},
        {"speed": [20, 19, 17], "slip": slip, "best_slip": [[5, 6, 7]] * 3,
         "reference": [4, 4, 4.5], "torque": np.multiply(slip, 1000), "pressure": [1e5, 3e5, 2e5],
         "adhesion": np.multiply(slip, -0.01), "best_adhesion": [0.2, 0.3, 0.25],
         "holding": [[0, 1, 0], [1, 0, 1], [0, 1, 1]],
         "venting": [[1, 0, 0], [0, 0, 1], [0, 1, 0]]},
        sign=-1, travelled=np.array([0.0, 10.0, 19.5, 28.0]),
    )  # fmt: skip
    known = {"a": SimpleNamespace(behind=()), "b": SimpleNamespace(behind=(0.0, 2.5, 18.0)),
             "c": SimpleNamespace(behind=(1.0,))}  # fmt: skip
    made = curves.curves_of_run(of, known)
    assert made.rails == [(0.5, "dry"), (1.0, "wet"), (1.25, "ice")]
    assert made.behind == (0.0, 2.5, 18.0)
    assert made.time is TIME
    named = {(p.name, p.unit): told(p) for p in made.panels}
    assert list(named) == [
        ("speed", "km/h"), ("slip", "m/s"), ("torque", "kN m"), ("pressure", "bar"),
        ("adhesion", "1"), ("valves, 1 fill, 0 hold, -1 vent", "1"), ("distance", "m"),
    ]  # fmt: skip
    each = np.array(slip, float).T  # as driven: the rim is faster than the vehicle
    assert named["speed", "km/h"] == [
        ("vehicle", 0, "best", [72.0, 68.4, 61.2]),
        *(("rim", k + 1, "axle", [round(3.6 * v, 9) for v in np.array([20, 19, 17]) + each[k]])
          for k in range(3)),
    ]  # fmt: skip
    assert named["slip", "m/s"] == [
        *(("slip", k + 1, "axle", list(-each[k])) for k in range(3)),
        *(("best", k + 1, "best", [-5.0 - k] * 3) for k in range(3)),
        ("wanted", 0, "wanted", [-4.0, -4.0, -4.5]),
    ]  # fmt: skip
    assert named["torque", "kN m"] == [
        ("at the wheel", k + 1, "axle", list(each[k])) for k in range(3)
    ]
    assert named["pressure", "bar"] == [("in the cylinder", 0, "main", [1.0, 3.0, 2.0])]
    assert named["adhesion", "1"] == [  # that of a model that counts it negative is turned
        *(("used", k + 1, "axle", [round(v, 9) for v in 0.01 * each[k]]) for k in range(3)),
        ("best", 0, "best", [0.2, 0.3, 0.25]),
    ]
    assert named["valves, 1 fill, 0 hold, -1 vent", "1"] == [
        ("valve", 1, "axle", [-1, 0, 1]), ("valve", 2, "axle", [0, 1, -1]),
        ("valve", 3, "axle", [1, -1, 0]),
    ]  # fmt: skip
    assert named["distance", "m"] == [("way", 0, "main", [0.0, 10.0, 19.5])]


def test_a_run_of_one_axle_has_its_ratio_and_only_what_it_has() -> None:
    of = run({"slip": "1"}, {"speed": [20, 10, 5], "slip": [0.1, 0.2, 0.4], "holding": [0, 0, 0]})
    made = curves.curves_of_run(of)
    assert [p.name for p in made.panels] == ["speed", "slip"]
    rim = [round(3.6 * v, 9) for v in (18.0, 8.0, 3.0)]
    assert told(made.panels[0])[1] == ("rim", 0, "main", rim)
    assert told(made.panels[1]) == [("slip", 0, "main", [0.1, 0.2, 0.4])]
    assert made.behind == ()
    assert curves.curves_of_run(run({}, {}, time=TIME[:0])).rails[0] == (0.0, "dry")


@pytest.mark.parametrize(("unit", "there"), [("m/s", True), ("rad/s", False)])
def test_without_a_slip_the_rim_is_the_speed_of_the_wheel(unit, there) -> None:
    """Of the axles that have it, by their numbers."""
    of = run({"wheel_speed": unit}, {"speed": [20, 10, 5], "wheel_speed": [[9, 8], [7, 6], [5, 4]]},
             axles=(1, 3))  # fmt: skip
    (speed,) = curves.curves_of_run(of).panels
    assert told(speed)[1:] == ([
        ("rim", 2, "axle", [32.4, 25.2, 18.0]), ("rim", 4, "axle", [28.8, 21.6, 14.4]),
    ] if there else [])  # fmt: skip


# ---- thinned, and as bytes -----------------------------------------------------------------------


def test_of_each_stretch_its_ends_in_time_and_its_ends_in_value() -> None:
    """Seven rows in three stretches, of two, two and three; what falls ends with its smallest."""
    time = np.array([0.0, 1.0, 2.5, 3.0, 4.0, 6.0, 9.0])
    up = np.array([1.0, 2.0, 0.0, 7.0, 5.0, 3.0, 6.0])
    gaps = np.array([4.0, 3.0, np.nan, 2.0, 9.0, np.nan, 8.0])
    t, a, b = curves.thin_columns([time, up, gaps], 3)
    assert t.tolist() == [0.0, 1.0, 2.5, 3.0, 4.0, 9.0]
    assert a.tolist() == [1.0, 2.0, 0.0, 7.0, 3.0, 6.0]
    assert b.tolist() == [4.0, 3.0, 2.0, 2.0, 9.0, 8.0]
    whole = curves.thin_columns([time[:6], up[:6]], 3)
    assert [c.tolist() for c in whole] == [time[:6].tolist(), up[:6].tolist()]


def test_an_answer_is_its_head_and_then_columns_of_32_bits() -> None:
    made = Curves(
        np.array([0.0, 0.25, 0.75]),
        [Panel("slip", "m/s", [Series("slip", 1, "axle", np.array([1.0, -2.0, 3.0])),
                               Series("slip", 2, "axle", np.array([4.0, 5.0, 6.5]))]),
         Panel("torque", "kN m", [Series("at the wheel", 0, "main", np.array([7.0, 8.0, 9.0]))])],
        [(0.0, "dry"), (0.5, "wet")], (0.0, 2.5),
    )  # fmt: skip
    for extra in ("", "a", "ab", "abc"):
        raw = curves.frame({"id": np.int64(3), "ä": extra}, made)
        (long,) = struct.unpack("<I", raw[:4])
        assert long % 4 == 0
        head = json.loads(raw[4 : 4 + long])
        assert head == {
            "id": 3, "ä": extra, "rows": 3, "rails": [[0.0, "dry"], [0.5, "wet"]],
            "behind": [0.0, 2.5],
            "panels": [
                {"name": "slip", "unit": "m/s",
                 "series": [{"name": "slip", "axle": 1, "looks": "axle"},
                            {"name": "slip", "axle": 2, "looks": "axle"}]},
                {"name": "torque", "unit": "kN m",
                 "series": [{"name": "at the wheel", "axle": 0, "looks": "main"}]},
            ],
        }  # fmt: skip
        body = np.frombuffer(raw[4 + long :], "<f4").reshape(4, 3)
        assert body.tolist() == [[0.0, 0.25, 0.75], [1.0, -2.0, 3.0], [4.0, 5.0, 6.5], [7, 8, 9]]
    assert curves.frame({}) == struct.pack("<I", 4) + b"{}  "
    assert [curves.finite(v) for v in (2, None, float("nan"), float("inf"))] == [2.0, *[None] * 3]


# ---- the text of a file --------------------------------------------------------------------------


@pytest.mark.parametrize(("row", "value", "made"), [
    ('mass = "8 t"    # heavy', '"8.25 t"', 'mass = "8.25 t" # heavy'),
    ('mass = "8.25 t" # heavy', '"8 t"', 'mass = "8 t"    # heavy'),
    ('mass = 8 # heavy', "8000", "mass = 8000 # heavy"),
    ('other_mass = 1, "mass" = 8', "9", None),
    ('mass = 8', "9", "mass = 9"),
    ("mass = 8   ", "12", "mass = 12   "),
    ("speed = 8", "12", None),
])  # fmt: skip
def test_a_value_is_put_where_it_stands_and_its_comment_stays_at_its_column(
    row, value, made
) -> None:
    text = f"# top\n[a]\nmass = 8\n[b.c]\nk = 1\n{row}\n\n[d]\nmass = 8\n"
    if made is None:
        with pytest.raises(texts.BadInput):
            texts.with_value(text, ("b", "c", "mass"), value)
        return
    assert texts.with_value(text, ("b", "c", "mass"), value) == text.replace(
        f"\n{row}\n\n", f"\n{made}\n\n"
    )


def test_keys_of_a_number_are_those_of_its_name_first_and_the_nearer_ones() -> None:
    text = '[a]\nspeed = "72 km/h"\n[a.b]\nv = 20.0\n[a.b.c]\nV = 20\nw = 21\non = true\n'
    text += '[v]\nx = "20"\n'
    found = texts.keys_with_number(text, "plant.v", 20.0, "m/s")
    assert found == [("a", "b", "v"), ("a", "b", "c", "V"), ("a", "speed"), ("v", "x")]
    assert texts.keys_with_number(text, "a.speed", 20.0, "m/s")[0] == ("a", "speed")
    assert texts.keys_with_number(text, "x", 20.0 * (1 + 2e-9), "m/s") == []
    assert len(texts.keys_with_number(text, "x", 20.0 * (1 + 5e-10), "m/s")) == 4
