"""What a file of a vehicle asks for seldom, and what it becomes in the loop or as a refusal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import BadInput, Block, Input, Output, Param, Scenario, law
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.vehicle import (
    Lag,
    Sensors,
    Stretch,
    Track,
    TrainSlip,
    Vehicle,
    control,
    description,
    study,
)
from slipctl.models.vehicle.adhesion import layer_law
from slipctl.models.vehicle.contamination import field_of_rail
from slipctl.models.vehicle.description import VEHICLE_FILES, _faults_of_laws
from slipctl.models.vehicle.measurement import sensor_parts
from slipctl.models.vehicle.of_study import OfStudy, Reading, StudyLoop, StudyTrip, _figure
from slipctl.models.vehicle.parts import Accelerometer, Car, Contamination, Fused
from slipctl.models.vehicle.plant import actuator, plant
from slipctl.models.vehicle.slip import own_law
from slipctl.models.vehicle.slip.common_numbers import numbers_of_wheel
from tests.models.test_slide_protection import train

LEAVES = Contamination(condition="leaves", tau=3e-5)


def layered(**changes):
    section = Stretch(place=0.0, condition="clean")
    rail = Track(law="falling_creep", sections=(section,), contamination=replace(LEAVES, **changes))
    return train(3, rail=rail)


def numbers(block: Block) -> dict:
    return {n: np.ravel(v).tolist() for n, v in block.param_values().items()}


# ---- rail ----------------------------------------------------------------------------------------


def test_a_layer_dries_and_is_fouled_again_in_the_times_of_its_file():
    found = numbers(field_of_rail(layered(drying=321.0, fouling=123.0)))
    assert (found["T_dry"], found["T_foul"]) == ([321.0], [123.0])
    for name, other, changes in (("T_dry", "T_foul", {"drying": 50.0}),
                                 ("T_foul", "T_dry", {"fouling": 70.0})):  # fmt: skip
        found = numbers(field_of_rail(layered(**changes)))
        assert found[name] == [*changes.values()]
        assert other not in found


def test_a_layer_that_no_rail_is_like_is_refused():
    trip = layered()
    assert layer_law(trip, replace(trip.rail.contamination, numbers={"mu_0": 0.05})).params
    twice = replace(trip.rail.contamination, law="double_exponential", condition="",
                    numbers={"c": 4.9, "a": 0.1, "b": 5.0})  # fmt: skip
    with pytest.raises(BadInput, match=r"rail.contamination.law: .*above 1"):
        layer_law(trip, twice)


def test_the_reference_of_a_trip_is_refused_where_it_stands(monkeypatch):
    for name in ("rail_law", "field_of_rail"):  # which are right, and take their time
        monkeypatch.setattr(description, name, lambda trip: None)
    trip = layered()
    assert _faults_of_laws(replace(trip, reference=TrainSlip())) == []
    ((keys, why),) = _faults_of_laws(replace(trip, reference=TrainSlip(layer={"mu_9": 1.0})))
    assert keys == ("reference", "layer", "mu_9")
    assert "mu_9" in why or "mu_0" in why


def test_a_file_names_its_own_law_and_not_that_of_a_study():
    block, name = VEHICLE_FILES.adhesion_law(layered())
    assert name == "falling_creep"
    assert "clean" in block.conditions
    of_study = StudyTrip(vehicle=OfStudy(study="hst_braking"), controllers={"a": StudyLoop()})
    assert VEHICLE_FILES.adhesion_law(of_study) is None


def test_a_search_begins_at_the_numbers_of_its_file_or_of_its_law(monkeypatch):
    @law(mu=Output("1", "adhesion", positive="braking"))
    def hyperbola(
        v_s=Input("m/s", "slip", positive="braking", per="speed"),
        top=Param("1", 0.21, "height", "test", lo=0.01, hi=1),
        bend=Param("m/s", 0.37, "bend", "test", lo=0.01, hi=5),
    ):
        """Rises and falls."""
        return 2 * top * bend * v_s / (bend**2 + v_s**2)

    asked = []
    monkeypatch.setattr(control, "load_block", lambda name: asked.append(name) or hyperbola)
    found, begin = control.law_and_guess(SimpleNamespace(law="mine.py:hyperbola", start={}))
    assert (found, begin) == (hyperbola, {"top": 0.21, "bend": 0.37})
    part = SimpleNamespace(law="mine.py:hyperbola", start={"bend": 0.5})
    assert control.law_and_guess(part)[1] == {"top": 0.21, "bend": 0.5}
    assert asked == ["mine.py:hyperbola"] * 2


# ---- vehicle -------------------------------------------------------------------------------------


def test_an_actuator_has_the_rate_of_its_file():
    found = numbers(actuator(Lag(torque=7e3, lag=0.13, rate=2.3e4)))
    assert found == {"T_max": [7e3], "tau": [0.13], "R_max": [2.3e4]}
    assert "R_max" not in numbers(actuator(Lag(torque=7e3, lag=0.13)))


CAR = Car(mass=40e3, axles=4, bogies=2, wheelbase=2.5, bogie_centres=14.0, length=20.0, height=1.8,
          pivot_height=0.6, bogie_mass=3e3, bogie_height=0.5, wheelset_mass=1500.0)  # fmt: skip


def test_load_moves_onto_leading_axles_where_a_car_has_heights():
    base = Vehicle(cars=(CAR,), inertia=100.0, radius=0.46, speed=20.0)
    made = plant(base, Lag(torque=8e3, lag=0.1), double_exponential)
    assert made.wires["transfer.a"] == "train.a"
    assert made.wires["train.dN"] == "transfer.dN"
    assert not {"dN", "train.dN"} & set(made.inputs)
    flat = plant(replace(base, cars=(replace(CAR, height=None),)), Lag(torque=8e3, lag=0.1),
                 double_exponential)  # fmt: skip
    assert "transfer" not in flat.parts
    assert not {"transfer.a", "train.dN"} & set(flat.wires)


def test_a_fused_speed_has_the_numbers_of_its_sensors_and_hears_who_is_controlled():
    meter = Accelerometer(bias=0.03, deviation=0.07, gradient=False)
    fused = Fused(spread=0.11, wander=0.013)
    trip = train(3, sensors=Sensors(vehicle_speed=fused, accelerometer=meter))
    for outputs, heard in (({"wake.on": 1}, True), ({}, False)):
        parts = {"ctl": SimpleNamespace(outputs=outputs)}
        wires = {"ctl.omega": "wheel.y"}
        assert sensor_parts.vehicle_speed(trip, parts, wires) == "speed.v_m"
        assert wires == {
            "ctl.omega": "wheel.y", "speed.omega": "wheel.y", "speed.torque": "plant.T",
            "accel.a": "plant.train.a", "speed.a": "accel.a_m",
        } | ({"speed.controlled": "ctl.wake.on"} if heard else {})  # fmt: skip
        accel, speed = numbers(parts["accel"]), numbers(parts["speed"])
        assert [accel[n] for n in ("bias", "sigma", "feels")] == [[0.03], [0.07], [0.0]]
        assert parts["speed"].period == 1e-3
        assert parts["speed"].inputs["omega"].shape == (3,)
        assert speed["filter.prior_b"] == [pytest.approx(0.11**2)]
        assert speed["filter.drift_b"] == [pytest.approx(0.013**2)]
        assert speed["filter.drift_v"] == [pytest.approx((0.07**2 + 1e-6) * 1e-3)]
        assert parts["speed"].start()["filter.held_v"] == 25.0


def test_a_law_that_scales_by_its_own_mass_hears_that_of_the_vehicle():
    wheel = SimpleNamespace(J=101.0, r=0.43, g=9.7, tau=0.08, T_max=7e3, W=9e3, m=8.5e3)
    names = ("law.m", "m", "J", "r", "g", "tau", "T_max", "m_axle")
    lag = SimpleNamespace(actuator=Lag(torque=7e3))
    for own in (names, names[1:], names[:1]):
        block = SimpleNamespace(params={n: SimpleNamespace(derived=n == "g") for n in own})
        wanted = {"law.m": 8.5e3, "m": 8.5e3, "J": 101.0, "r": 0.43, "tau": 0.08, "T_max": 7e3,
                  "m_axle": 9e3}  # fmt: skip
        found = numbers_of_wheel(block, lag, wheel)
        assert found == {n: v for n, v in wanted.items() if n in own}
        air = SimpleNamespace(actuator=train(3).actuator)
        more = {"trust.tau": 1e-3, "trust.other": 0.15}
        assert numbers_of_wheel(block, air, wheel) == found | more


def test_a_flow_is_no_block_of_a_controller(monkeypatch):
    trip = train(3)
    for kind, period in (("flow", None), ("step", 0.025), ("step", 0.001)):
        block = SimpleNamespace(kind=kind, period=period)
        monkeypatch.setattr(own_law, "load_block", lambda name, block=block: block)
        said = "is a flow" if kind == "flow" else "whole number"
        with pytest.raises(BadInput, match=said):
            own_law.own_block(trip, SimpleNamespace(block="mine.py:mine"))
    monkeypatch.setattr(own_law, "every", lambda block, n: (block, n))
    for period, n in ((0.03, 3), (0.01, None), (None, None)):
        block = SimpleNamespace(kind="step", period=period)
        monkeypatch.setattr(own_law, "load_block", lambda name, block=block: block)
        found = own_law.own_block(trip, SimpleNamespace(block="mine.py:mine"))
        assert found == ((block, n) if n else block)


# ---- studies of files ----------------------------------------------------------------------------


@dataclass(frozen=True)
class SmallCase:
    scenario: Scenario
    loops: dict
    known: dict
    log: object = None
    clean: str = ""


def test_a_trip_on_a_layer_has_its_case_and_that_of_clean_rail(monkeypatch):
    made = SmallCase(Scenario(name="base", duration=90.0), {}, {})
    for name in ("parts_without_effect", "numbers_without_unit", "unusual_numbers"):
        monkeypatch.setattr(study, name, lambda trip: ())
    monkeypatch.setattr(study, "case", lambda trip, name: made)
    monkeypatch.setattr(study, "clean_case", lambda trip, found: replace(found, known={"rail": 1}))
    mine = study.study(layered(), "mine", "a file")
    logged = replace(made, log=study.LOG)
    assert mine.cases(None, False) == [
        replace(logged, clean=study.CLEAN), replace(logged, known={"rail": 1})
    ]  # fmt: skip
    assert [c.scenario.duration for c in mine.cases(None, True)] == [0.5, 0.5]
    plain = Track(law="falling_creep", sections=(Stretch(place=0.0, condition="clean"),))
    assert study.study(train(3, rail=plain), "mine", "a file").cases(None, False) == [logged]


def reading(**given):
    made = object.__new__(Reading)
    made.__dict__ |= {"wrong": []} | given
    return made


def test_a_quick_case_of_a_study_lasts_half_a_second_at_most():
    class Asked(Reading):
        def scenario(self):
            return self.given

        def conditions(self, loop):
            return self.of_loop

        def loop(self, name):
            return f"loop of {name}"

    for lasts, quick, wanted in ((3.0, True, 0.5), (3.0, False, 3.0), (0.2, True, 0.2)):
        for of_loop, kept in (({"dry": 1}, {"a": 2}), ({"wet": 1}, {})):
            made = object.__new__(Asked)
            scenario = Scenario(name="base", duration=lasts)
            old = SmallCase(scenario, {"theirs": SimpleNamespace(conditions={"dry": 1})}, {"a": 2})
            made.__dict__ |= {"given": scenario, "case": old, "asked": {"mine": "theirs"},
                              "of_loop": of_loop}  # fmt: skip
            found = made.own_case(quick)
            assert found.scenario.duration == wanted
            assert found.known == kept
            assert list(found.loops) == ["mine"]


def test_a_number_is_asked_of_the_loops_that_may_have_it(monkeypatch):
    """A full name of the second loop is none of the first, which then is not asked."""
    first, second, third = (SimpleNamespace(name=n, _signals={"param": []}) for n in "abc")
    asked = []

    def targets(loop, name, roles):
        asked.append(loop.name)
        return ["x"] if loop is third else []

    monkeypatch.setattr("slipctl.models.vehicle.of_study.targets", targets)
    monkeypatch.setattr("slipctl.models.vehicle.of_study.in_unit", lambda value, signal: value)
    monkeypatch.setattr("slipctl.models.vehicle.of_study._signal", lambda loop, name: None)
    made = reading(case=None, asked={})
    made._of_others = lambda loop, name: loop is first
    made._checked([first, second, third], ("numbers", "x"), 1, 2.0, ("param",))
    assert (asked, made.wrong) == (["b", "c"], [])
    made._checked([first, second], ("numbers", "plant", "x"), 1, 2.0, ("param",))
    ((keys, why),) = made.wrong
    assert keys == ("numbers", "plant", "x")
    assert why.startswith("b has no number 'plant.x'")


def test_the_figure_of_a_loop_has_what_its_first_case_logs(monkeypatch):
    from slipctl.draw import plots

    seen = []
    monkeypatch.setattr(plots, "traces", lambda *a, **k: seen.append((a, k)) or "figure")
    cases = [SimpleNamespace(scenario=SimpleNamespace(name=n)) for n in ("one", "two")]
    results = SimpleNamespace(
        cases=cases, data={"one": {"a": {"v"}, "b": {"T"}}, "two": {"a": {"v", "s"}}},
        study=SimpleNamespace(signals=SimpleNamespace(
            find=lambda role, log: {"speed": "v", "slip": "s", "torque": "T"}[role] in log)),
    )  # fmt: skip
    assert _figure(results) == "figure"
    assert seen == [((results, "one"), {"signals": ["speed", "torque"]})]
