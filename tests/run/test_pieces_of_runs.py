"""Pieces of a run by hand: streams of noise, names of rails, guards of parts, what broke."""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import replace

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, Rail, Scenario, Section, State, connect, step
from slipctl.run import numbers, preparation
from slipctl.run.logs import log_signals
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.measures.measured_run import rail_names
from slipctl.run.scenario_inputs import stream
from slipctl.run.sweep import ensemble
from slipctl.run.sweep.sweep_plan import plan_of
from slipctl.run.warnings import doubts


@step(period=0.1, y=Output("m/s", "speed"))
def car(
    v=State("m/s", 5.0, "speed"),
    x=State("m", (1.0, 2.0, 3.0), "places", shape=(3,)),
    a=State("m/s^2", 0.0, "rate"),
    u=Input("m/s^2", "demand", value=0.0),
    mass=Param("kg", 100.0, "mass", lo=1),
    wheel=Param("m", 0.5, "radius"),
):
    """Drives."""
    return dict(v=v + u, x=x, a=u * mass * wheel), dict(y=v)


def test_noise_is_drawn_from_a_stream_of_its_seed_and_path():
    """Four words of the SHA-256 of the path stand behind the seed."""
    for seed, path in ((1, "speed.v"), (77, "wheel.omega")):
        words = struct.unpack("<4I", hashlib.sha256(path.encode()).digest()[:16])
        same = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))
        assert stream(seed, path).random(5).tolist() == same.random(5).tolist()
    assert stream(1, "a").random() != stream(1, "b").random() != stream(2, "b").random()


def railed(by, *sections):
    rail = Rail([Section(start, name, {"c": 0.1 * k}) for k, (start, name) in enumerate(sections)],
                by=by)  # fmt: skip
    return Scenario("s", 9.0, rail)


NAMED = [
    ((0, "dry"), (2, "wet"), (4, "dry"), (6, "ice")),
    ((0, "dry"), (2, "wet")),
    ((0, "dry"), (2, None), (4, "wet")),
]


@pytest.mark.parametrize(
    ("by", "sections", "changes", "names"),
    [
        ("time", 0, [2.0], ["dry", "wet"]), ("time", 0, [2.0, 4.0], ["dry from 0 s", "wet",
                                                                      "dry from 4 s"]),
        ("position", 0, [0.31, 0.62, 0.9], ["dry from 0 m", "wet", "dry from 4 m", "ice"]),
        ("time", 1, [2.0], ["dry", "wet"]), ("time", 1, [2.0, 4.0], []), ("time", 2, [2.0], []),
        ("time", 2, [], ["dry"]),
    ],
)  # fmt: skip
def test_rails_are_called_by_the_sections_that_a_run_came_to(by, sections, changes, names):
    assert rail_names(railed(by, *NAMED[sections]), changes) == names
    assert rail_names(Scenario("s", 9.0), []) == []


def test_a_part_is_found_by_its_path_and_its_guard_asked_with_its_numbers():
    """Behind a part without one, two levels down; the number is that of the scenario's loop."""
    asked = []

    def guard(own):
        asked.append({n: float(v) for n, v in own.items() if np.ndim(v) == 0})
        if own["mass"] > 150:
            raise BadInput("it is too heavy")

    guarded = car._copy(car.signals, composition=replace(car.composition, guard=guard))
    inner = connect("inner", {}, plain=car, heavy=guarded.with_params(wheel=0.25))
    loop = connect("loop", {}, first=car, inner=inner)
    assert numbers._at(loop, "") is loop
    assert numbers._at(loop, "/inner/heavy") is loop.parts["inner"].parts["heavy"]
    assert numbers._at(loop, "/inner/none") is None
    numbers.check_guards(loop)
    assert asked == [{"mass": 100.0, "wheel": 0.25}]
    with pytest.raises(BadInput, match=r"^inner\.heavy: it is too heavy"):
        numbers.check_guards(loop.with_params(**{"inner.heavy.mass": 200.0}))
    numbers.check_guards(loop.with_params(**{"inner.plain.mass": 200.0}))
    with pytest.raises(BadInput, match=r"^car: it is too heavy"):
        numbers.check_guards(guarded.with_params(mass=200.0))


@pytest.mark.parametrize(
    ("x", "said"),
    [
        ([1, 2, np.inf, np.nan, 3], r"car: x \[m\] became inf at t = 0.3 s"),
        ([np.nan, 2, np.inf, 4, 3], r"car: v \[m/s\] became nan at t = 0.3 s"),
        ([1, 2, 3, 4, -np.inf], r"car: a \[m/s\^2\] became -inf at t = 0.3 s"),
        ([1, 2, 3, 4, 5], "car: a state became NaN before t = 0.3 s"),
    ],
)  # fmt: skip
def test_the_first_state_that_is_no_number_is_told(x, said):
    assert re.fullmatch(said, preparation._broken(car, np.array(x, float), 0.3))


def test_the_end_of_a_name_is_proposed_for_one_that_is_not_there():
    loop = connect("loop", {}, first=car, second=connect("pair", {}, a=car, b=car))
    with pytest.raises(BadInput, match=r"loop has no parameter 'wheal'; did you mean 'wheel'"):
        plan_of(loop, Scenario("s", 1.0), ["wheal=1:2"])
    with pytest.raises(BadInput, match=r"no parameter 'a.whel'; did you mean 'a.wheel'"):
        plan_of(loop, Scenario("s", 1.0), ["a.whel=1:2"])


@step(period=0.1, y=Output("m"))
def sensor(
    u=Input("m", value=0.0), q=Param("m", 1.0, "steps"), sigma=Param("m", 0.1, "noise"),
    other=Param("m", 0.0, "offset"),
):  # fmt: skip
    """Rounds."""
    return {}, dict(y=u + q + sigma + other)


@pytest.mark.parametrize(("sigma", "lines"), [(0.27, 1), (0.28, 1), (0.30, 0), (0.0, 0)])
def test_noise_below_that_of_the_steps_is_told(sigma, lines):
    """Rounded to steps of 1 m, a value has a standard deviation of 1/sqrt(12) m, 0.289 m."""
    loop = connect("loop", {}, good=sensor.with_params(sigma=0.5), odd=sensor)
    told = list(doubts._quantised(loop.with_params(**{"odd.sigma": sigma})))
    assert len(told) == lines
    assert all(
        f"odd.sigma = {sigma:.3g} m is below the 0.289 m of the quantisation" in line
        and "steps of 1 m" in line for line in told)  # fmt: skip


def test_a_scenario_has_its_noise_and_first_seed():
    found = Scenario("s", 2.0)
    assert (found.noise, found.seed, found.rail, found.end) == (1.0, 1, None, None)


def test_places_of_axles_are_watched_and_no_other_state():
    loop = connect("loop", {}, plant=car, x=sensor)
    assert doubts.doubt_signals(loop) & {"plant.x", "plant.v", "plant.a"} == {"plant.x"}


@pytest.mark.parametrize(
    ("values", "by", "found"),
    [
        (4.0, 0.5, 2.0),
        (3, 1.5, 4.5),
        ([1.0, 2.0, 4.0], 0.25, [0.25, 0.5, 1.0]),
        ((2, 3), 2, [4, 6]),
    ],
)
def test_what_is_known_is_scaled_section_by_section(values, by, found):
    assert ensemble._times(values, by) == found


def test_a_column_of_another_dimension_is_converted_by_the_radius_of_the_block(tmp_path):
    """Named as it is in the block."""

    @step(period=0.1, y=Output("m/s"))
    def wheel(omega=Input("rad/s"), r=Param("m", 0.5)):
        """Rolls."""
        return {}, dict(y=omega * r)

    (tmp_path / "log.csv").write_text("t [s];w [m/s]\n0;1\n0.1;2\n", encoding="utf-8")
    log = read_recording(tmp_path / "log.csv")
    loop = connect("loop", {}, front=wheel)
    for block, radius in ((wheel, "r"), (loop, r"front\.r")):
        name = block.find("omega", "input")
        with pytest.raises(BadInput, match=rf"such as 'w\[m/s\] / {radius}'"):
            log_signals.source_of(block, log, block.inputs[name], "w")
