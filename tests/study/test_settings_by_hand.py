"""Cases and numbers that a person asks for, of a study of stubs; declarations that are none."""

from __future__ import annotations

import logging
from types import SimpleNamespace

import pytest

from slipctl import (
    BadInput,
    Case,
    Input,
    Known,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    Signals,
    State,
    Study,
    connect,
    step,
)
from slipctl.study import case_setup
from slipctl.study.case_setup import Setting
from slipctl.study.declaration import Claim, Context, Experiment, Figure, Gains


@step(period=0.1, y=Output("1"))
def car(v=State("m/s", 5.0), u=Input("1", value=0.0), m=Param("kg", 100.0, "mass", lo=1),
        c=Param("1", 0.5, "height"), row=Param("m", (1.0, 2.0), "places", shape=(2,))):  # fmt: skip
    """Goes on."""
    return dict(v=v + 0 * u * m), dict(y=c + row[0])


A = connect("a", {}, car=car)
B = connect("b", {}, car=car, other=car)
WET = Rail([Section(0, None, {"car.c": 0.2}), Section(1, None, {"car.c": 0.1})])


def cases():
    return [
        Case(Scenario("base", 1.0), {"a": A, "b": B}), Case(Scenario("wet", 1.0, WET), {"a": A}),
        Case(Scenario("real", 1.0), {"b": B, "c": B}),
    ]  # fmt: skip


def study(**more):
    return Study("toy", "t", "s", "d", lambda models, quick: cases(), Signals(), **more)


def names_of(found):
    return [(c.scenario.name, list(c.loops)) for c in found]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("car.m=8.2t", ("", "car.m", "8.2t")), (" sta : car.m = 8.2 t ", ("sta", "car.m", "8.2 t")),
        ("a:b=c=d", ("a", "b", "c=d")),
    ],
)  # fmt: skip
def test_a_setting_has_a_loop_a_name_and_a_value(text, parts):
    found = Setting.read(text)
    assert (found.loop, found.name, found.value) == parts
    for wrong in ("car.m", "=3", "a:=3", "car.m=", "car.m = "):
        with pytest.raises(BadInput, match=r"write \[loop:\]block"):
            Setting.read(wrong)


@pytest.mark.parametrize(
    ("loops", "scenarios", "found"),
    [
        ([], [], [("base", ["a", "b"]), ("wet", ["a"]), ("real", ["b", "c"])]),
        (["b"], [], [("base", ["b"]), ("real", ["b"])]), ([], ["wet", "real"], [("wet", ["a"]),
        ("real", ["b", "c"])]), (["c", "a"], ["base"], [("base", ["a"])]),
    ],
)  # fmt: skip
def test_loops_and_scenarios_that_are_asked_for_are_kept(loops, scenarios, found):
    assert names_of(case_setup._select(study(), cases(), loops, scenarios)) == found


@pytest.mark.parametrize(
    ("loops", "scenarios", "said"),
    [(["z"], [], "toy has no loop 'z'"),
     ([], ["base", "we"], "no scenario 'we'; did you mean 'wet'"),
     (["c"], ["wet", "base"], "toy has no loop c in wet or base")],
)  # fmt: skip
def test_what_is_not_there_is_not_kept(loops, scenarios, said):
    with pytest.raises(BadInput, match=said):
        case_setup._select(study(), cases(), loops, scenarios)


def test_a_plain_run_has_its_scenarios_and_what_is_wanted_of_others():
    found = case_setup._plain(study(), cases(), {"wet": ["a"], "base": ["a"]})
    assert names_of(found) == [("base", ["a", "b"]), ("wet", ["a"]), ("real", ["b", "c"])]
    assert names_of(case_setup._plain(study(), cases(), {})) == [
        ("base", ["a", "b"]), ("real", ["b", "c"])]  # fmt: skip
    assert names_of(case_setup._plain(study(plain=["real"]), cases(), {"base": ["b", "z"]})) == [
        ("base", ["b"]), ("real", ["b", "c"])]  # fmt: skip
    assert len(case_setup._plain(study(plain=["none"]), cases(), {})) == 3


def values(found, name):
    return {f"{c.scenario.name}/{n}": float(b.param_values()[name]) for c in found
            for n, b in c.loops.items() if name in b.params}  # fmt: skip


def set_to(*texts):
    return case_setup._set(study(), cases(), [Setting.read(t) for t in texts])


def test_numbers_are_set_in_all_loops_or_in_one():
    before = {"base/a": 100, "base/b": 100, "wet/a": 100, "real/b": 100, "real/c": 100}
    assert values(cases(), "car.m") == before
    assert values(set_to("car.m=2t"), "car.m") == dict.fromkeys(before, 2000)
    one = set_to("b:car.m=2t", "c:car.m=3t")
    assert values(one, "car.m") == before | {"base/b": 2000, "real/b": 2000, "real/c": 3000}
    assert values(one, "other.m") == {"base/b": 100, "real/b": 100, "real/c": 100}
    every = set_to("*.m=5 kg")
    assert set(values(every, "other.m").values()) == set(values(every, "car.m").values()) == {5}
    row = set_to("car.row=[3, 4]")
    assert row[0].loops["a"].param_values()["car.row"].tolist() == [3, 4]


def test_a_number_that_the_rail_sets_is_told_and_refused_where_it_has_no_effect(caplog):
    with caplog.at_level(logging.WARNING, "slipctl"):
        found = set_to("car.c=0.3")
    assert values(found, "car.c") == {"base/a": 0.3, "base/b": 0.3, "wet/a": 0.5, "real/b": 0.3,
                                      "real/c": 0.3}  # fmt: skip
    assert "car.c has no effect where the rail sets it: a's car.c in scenario wet" in caplog.text
    wet = [c for c in cases() if c.scenario.name == "wet"]
    with pytest.raises(BadInput, match=r"the rail sets a's car\.c in scenario wet, so a constant"):
        case_setup._set(study(), wet, [Setting.read("car.c=0.3")])
    caplog.clear()
    set_to("car.m=3")
    assert caplog.text == ""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("z:car.m=3", r"--set z:car\.m: no loop 'z' runs; it has a, b, c"),
        ("car.mm=3", r"no loop of toy has a parameter 'car\.mm'; did you mean 'car\.m'"),
        ("a:other.m=3", r"loop a has no parameter 'other\.m'"), ("car.m=3 s", "m"),
        ("x.M=3", "no loop of toy has a parameter 'x.M'"), ("car.m=0", r"car\.m"),
    ],
)  # fmt: skip
def test_a_number_that_no_loop_has_is_refused(text, said):
    with pytest.raises(BadInput, match=said):
        set_to(text)


def test_a_name_that_parts_share_is_proposed():
    both = connect("b", {}, car=car, other=car, share={"m": ["car.m", "other.m"]})
    with pytest.raises(BadInput, match=r"loop b has no parameter 'x\.M'; did you mean 'm', which"):
        case_setup._set(study(), [Case(Scenario("base", 1.0), {"b": both})],
                        [Setting.read("b:x.M=3")])  # fmt: skip
    assert case_setup._endings("plant.car.m") == ["car.m", "plant.car.m"]
    assert case_setup._endings("car.m") == ["car.m"]
    assert case_setup._endings("m") == ["m"]


def test_a_setting_goes_before_what_a_scenario_gives(caplog):
    """The loop that is not meant keeps the number of the scenario."""
    scenario = Scenario("base", 1.0, params={"car.m": 50.0, "car.c": 0.25}, start={"car.v": 3.0})
    given = [Case(scenario, {"a": A, "b": B})]
    with caplog.at_level(logging.WARNING, "slipctl"):
        found = case_setup._set(study(), given, [Setting.read("a:car.m=2t")])
    assert found[0].scenario.params == {"car.c": 0.25}
    assert found[0].scenario.start == {"car.v": 3.0}
    assert values(found, "car.m") == {"base/a": 2000, "base/b": 50}
    assert "--set car.m replaces car.m of scenario base" in caplog.text
    found = case_setup._set(study(), given, [Setting.read("car.v=36 km/h")])
    assert (found[0].scenario.params, found[0].scenario.start) == (scenario.params, {})
    assert [float(b.start()["car.v"]) for b in found[0].loops.values()] == [10, 10]


def test_the_first_tick_says_what_is_wrong():
    case = Case(Scenario("base", 1.0, params={"none": 3.0}), {"a": A})
    with pytest.raises(BadInput, match=r"^base/a: "):
        case_setup._try(case, "a", A)
    rail = Case(Scenario("wet", 1.0, WET), {"a": A}, {"rail.best": Known("m/s", [1.0, 2.0, 3.0])})
    with pytest.raises(BadInput, match=r"wet: rail\.best has 3 values for 2 rail sections"):
        case_setup._try(rail, "a", A)
    fine = Case(Scenario("base", 1.0), {"a": A}, {"x": Known("m/s", [1.0]), "y": Known("m/s", 2.0)})
    first = case_setup._try(fine, "a", A)
    assert first is not None
    assert first["time"].size == 1


def number(**more):
    return Claim("c", "s", "it is", more.pop("kind", "number"), more.pop("paper", "5"),
                 more.pop("ours", lambda results: 5.0), **more)  # fmt: skip


NONE = [
    (lambda: number(kind="numbers", tolerance=1), "claim c: kind 'numbers' is none of"),
    (lambda: number(bound="most"), "bound 'most' is neither at most nor at least"),
    (lambda: number(ours=None, tolerance=1), "claim c: say what ours is, or why it is not"),
    (lambda: number(), "claim c needs a tolerance, 'last digit' or '5 %'"),
    (lambda: number(tolerance="5"), "claim c: tolerance '5' is no number, percentage or 'last"),
    (lambda: number(tolerance="last digit", paper=5.0), "tolerance 'last digit' is no number"),
    (lambda: number(tolerance=1, unit=3), "unit"),
    (lambda: Figure(3, lambda results: None), "Figu"),
    (lambda: Experiment("t", 3), "Experiment"), (lambda: Gains("g", "l", 3, lambda b: {}), "Gains"),
    (lambda: study(claims=[number(tolerance=1)] * 2), "study toy has two claims 'c'"),
    (lambda: study(claims=[number(tolerance=1)], headline="d"), "study toy has no claim 'd'"),
    (lambda: study(limits={"locktime": 1.0}), "did you mean 'lock_time'"),
    (lambda: study(short=3), "Study"), (lambda: Signals(speed=3), "Signals"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "said"), NONE)
def test_a_declaration_that_is_none_is_refused(made, said):
    with pytest.raises(BadInput, match=said):
        made()


def test_a_tolerance_is_a_number_a_share_or_half_a_digit():
    assert number(tolerance="5 %", paper="-40").allowed() == 2.0
    assert number(tolerance=" 2.5% ", paper="-40").allowed() == 1.0
    assert number(tolerance="last digit", paper="254.05").allowed() == pytest.approx(0.005)
    assert number(tolerance=0.25).allowed() == 0.25
    assert number(bound="at most").allowed() == 0.0
    assert number(kind="order", paper="a > b", tolerance="5 %").allowed() == 0.05
    assert study(claims=[number(tolerance=1)], headline="c").headline == "c"
    assert Context.each.__defaults__ == ((0.0, 1.0),)
    made = study(gains=lambda: "found", uncertified={"a": "why"})
    assert made.certificates == "found"
    assert study(uncertified={"a": "why"}).certificates == ((), {"a": "why"})
    assert SimpleNamespace(**vars(made)).name == "toy"
