"""What models and files declare, and what they refuse, where no run shows it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from slipctl import BadInput, Block, probe, registry
from slipctl.models import best_slip, sensors, vehicle
from slipctl.models.cheng_2022 import freight_resistance
from slipctl.models.huang_2020 import subway_braking
from slipctl.models.predictive import predictive_speed
from slipctl.models.ranges import probe_ranged
from slipctl.models.vehicle import control, of_study, parts
from slipctl.models.vehicle.certificate import gains
from slipctl.models.wang_2025 import hst_traction_adhesion, hst_traction_control
from slipctl.models.wheel_rail import contact_reference
from slipctl.models.wheel_rail.axles import Axles, rolling
from slipctl.models.wheel_rail.contact import polach
from slipctl.models.zhang_2021.hst_braking_reference import adhesion_meter
from slipctl.study.files import trip_files


def leaves(block: Block):
    """Parts that have none of their own."""
    return [leaf for part in block.parts.values() for leaf in leaves(part)] or [block]


def test_files_are_read_into_what_nobody_changes():
    """Each part of a trip is frozen, and is made by names only: no order of fields is relied on."""
    found = [c for c in vars(parts).values() if isinstance(c, type) and issubclass(c, parts.Part)]
    made = [c for c in found if dataclasses.is_dataclass(c)]
    assert len(made) > 20
    for c in made:
        assert c.__dataclass_params__.frozen, c
        assert all(f.kw_only for f in dataclasses.fields(c)), c


def test_a_number_of_a_file_that_is_none_is_told():
    meta = {"unit": "m/s", "lo": 0, "hi": 20}
    assert parts.off_range("fast", meta) == "'fast' is no number in m/s"
    assert parts.off_range(True, meta | {"unit": "1"}) == "True is no number"
    assert parts.off_range(3.0, meta) == ""


def test_noise_is_a_hundred_times_its_own_at_most():
    (noise,) = (f for f in dataclasses.fields(parts.Trip) if f.name == "noise")
    assert parts.off_range(100.0, noise.metadata) == ""
    assert "outside 0 .. 100" in parts.off_range(100.1, noise.metadata)


@pytest.mark.parametrize("window", [0, -3, 2.5, 0.5])
def test_a_window_is_a_whole_number_of_ticks(window):
    with pytest.raises(BadInput, match="whole number of ticks"):
        adhesion_meter(window)
    assert adhesion_meter(3).kind == "step"


def test_flags_are_zero_or_one():
    block = probe_ranged(probe(subway_braking.double_exponential, "v_s", within=(0.1, 6.0)))
    for signals in (block.states, block.outputs):
        for n in {"probing", "changed"} & set(signals):
            assert (signals[n].lo, signals[n].hi) == (0, 1), n
    assert "changed" in block.inputs
    assert (block.inputs["changed"].lo, block.inputs["changed"].hi) == (0, 1)


def test_a_search_starts_near_the_rails():
    """The first guess lies among the known rails, or a tenth of its size beyond them."""
    rails = subway_braking.double_exponential.conditions.values()
    for n, first in best_slip.START.items():
        known = [r[n] for r in rails if n in r]
        assert 0.9 * min(known) <= first <= 1.1 * max(known), n


def test_a_freight_train_has_sixty_four_driven_axles_at_most():
    (n_d,) = (
        p
        for b in leaves(freight_resistance.balance(1.0))
        for n, p in b.params.items()
        if n == "n_d"
    )
    assert (n_d.lo, n_d.hi) == (1, 64)


def test_an_axle_that_nobody_brakes_rolls():
    """Without a torque of its brakes a train has none."""
    block = rolling(polach, Axles((4,), (0.0,), (False,)), 1e-3)
    assert {n: s.value for n, s in block.inputs.items()} == {"T_b": 0.0, "F_d": 0.0}


def test_the_planned_force_is_kept_for_the_observer():
    """Within the limits of a run, beside what was wanted and what was held before."""
    after, told = predictive_speed.held(F_h=2.0, F=5.0, F_hi=3.0, F_lo=-1.0)
    assert after == {"F_h": 3.0}
    assert told == {"F_contr": 3.0, "F_wanted": 5.0, "F_last": 2.0}


def test_a_law_of_ones_own_asks_for_what_there_is(tmp_path):
    """Signals of the axle, and inputs that have a value; of others the first is named."""
    path = tmp_path / "my_law.py"
    text = """from slipctl import Input, Output, law

@law(T_wanted=Output("N m", "torque", positive="braking"))
def mine(v=Input("m/s", "speed"), v_s=Input("m/s", "slip"), more=Input("N m", "more", value=7.0)):
    \"\"\"More where it rolls.\"\"\"
    return more
"""
    trip = trip_files.load_trip(str(Path(vehicle.__file__).parent / "files" / "metro.toml"))
    w = control.wheel(trip, None)
    path.write_text(text, encoding="utf-8")
    block, gated = control.slip_law(trip, parts.OwnLaw(block=f"{path}:mine"), w)
    assert (block.name, gated) == ("mine", False)
    path = tmp_path / "no_law.py"
    path.write_text(text.replace("value=7.0", "").replace("mine", "none"), encoding="utf-8")
    with pytest.raises(BadInput, match="it needs more"):
        control.slip_law(trip, parts.OwnLaw(block=f"{path}:none"), w)


def test_a_measured_speed_says_what_it_is():
    assert sensors.tooth_wheel.outputs["omega_m"].doc == "measured wheel speed"
    assert all(s.doc for s in sensors.tooth_wheel.signals)


def test_a_slip_speed_is_a_reference():
    """Held, but never above the vehicle's own; told like every other reference."""
    block = control.fixed_reference(parts.SlipSpeed(slip=2.0))
    other = control.fixed_reference(parts.SlipRatio(slip=0.1, least=0.3))
    assert block.name == other.name == "reference"
    assert block(v=10.0)["v_best"] == 2.0
    assert block(v=-1.5)["v_best"] == 1.5
    for found in (block, other):
        (out,) = found.outputs.values()
        assert (out.name, out.unit, out.positive, out.per) == ("v_best", "m/s", "braking", "speed")


def test_creep_laws_agree_about_friction():
    ranges = {(law.params["mu_0"].lo, law.params["mu_0"].hi)
              for law in (polach, contact_reference.carter, contact_reference.fastsim)}  # fmt: skip
    assert ranges == {(0.001, 1)}


def test_observers_and_sensors_agree_about_the_sample_period():
    period, sensor = hst_traction_adhesion.PERIOD, sensors.tooth_wheel.params["T"]
    assert (period.lo, period.hi) == (sensor.lo, sensor.hi)


def test_the_error_of_the_speed_may_have_both_signs():
    e2 = hst_traction_control.tracking.outputs["e2"]
    assert e2.lo == -e2.hi


def test_a_swarm_flies_as_long_as_is_told():
    settings = freight_resistance.swarm_settings("consistent")
    assert settings["iterations"] == freight_resistance.ITERATIONS
    assert freight_resistance.swarm_settings("printed-21")["iterations"] == settings["iterations"]


def test_draws_of_the_rail_are_heard_and_others_named(tmp_path: Path):
    folder = registry.folder("models") / "vehicle" / "files"
    text = (folder / "metro.toml").read_text(encoding="utf-8")
    text = text.replace("0.8:1.2 of plant.train.adh.c", "0.8:1.2 of rail.leaves.c, act.lag")
    path = tmp_path / "metro.toml"
    path.write_text(text, encoding="utf-8")
    assert gains.ranges(trip_files.load_trip(str(path)))[1] == ("act.lag",)


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ([{"place": 0.0}, {"place": 30.0}], []),
        ([{"time": 0.0}], []),
        ([{"place": 0.0, "time": 0.0}], ["a place or at a time; write one of both"]),
        ([{"place": 0.0}, {}], ["a place or at a time; write one of both"]),
        ([{"place": 0.0}, {"time": 1.0}], ["use one of both"]),
    ],
)
def test_a_section_of_a_study_begins_at_a_place_or_at_a_time(sections, said):
    made = [of_study.StudySection(**s) for s in sections]
    if not said:
        of_study.StudyRail(sections=tuple(made))
        return
    with pytest.raises(BadInput) as found:
        of_study.StudyRail(sections=tuple(made))
    assert all(part in str(found.value) for part in said)


@pytest.mark.parametrize(
    ("given", "ends", "said"),
    [
        ((0.02, "s"), {}, "write the unit, the number"),
        (("s", "0.02"), {}, "write the unit, the number"),
        (("s", 0.02, 5), {}, "write the unit, the number"),
        (("s", float("nan")), {}, "nan s is not finite"),
        (("s", [1, "x"]), {}, "'x' is no number in s"),
        (("s", 0.02), {"lo": 1, "hi": 5}, "0.02 s is outside 1 .. 5 s"),
        (("s", 0.02), {"lo": 5, "hi": 1}, "lo 5 and hi 1 are no range"),
    ],
)
def test_a_number_that_is_declared_wrongly_is_refused(given, ends, said):
    with pytest.raises(BadInput, match=said):
        parts.number(*given, **ends)
