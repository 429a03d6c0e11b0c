"""Of several parts each that gives reason to doubt is told, in whatever order they stand."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from slipctl import Input, Output, Param, Scenario, State, connect, make_block, step
from slipctl.run.warnings.doubts import doubt_signals, warnings_of_log, warnings_of_loop

H = 0.01
TIME = 5.0 + H * np.arange(1001)
RUN = Scenario("s", 10.0)
DEMAND = RUN.but(inputs={"a_demand": 1.0})


@step(period=H, heat=Output("W", "taken", lo=0), other=Output("W", "free"), F=Output("N", lo=0))
def brake(n=State("1", 0.0, "count", lo=0.0, hi=2.0), free=State("1", 0.0)):
    """A power that should take energy; one that may do either; a force, which is no power."""
    return dict(n=n, free=free), dict(heat=n, other=n, F=n)


@step(period=H, y=Output("m/s", "measured"))
def coarse(u=Input("m/s", "speed"), q=Param("m/s", 0.1), sigma=Param("m/s", 0.01)):
    """Noise below the error of its own steps."""
    return {}, dict(y=u + 0 * q * sigma)


@step(period=H, y=Output("m/s", "measured"))
def stepped(u=Input("m/s", "speed"), q=Param("m/s", 0.1)):
    """Steps, and no noise to compare them with."""
    return {}, dict(y=u + 0 * q)


@step(period=H, slip=Output("m/s", "slip"), y=Output("1"))
def gives(slip_in=Input("1", value=0.0)):
    """A slip for whoever wants it."""
    return {}, dict(slip=slip_in, y=slip_in)


@step(period=H, y=Output("1"))
def wants(slip=Input("m/s", "slip", value=0.5), a_demand=Input("m/s^2", value=0.0)):
    """Of the slip, if it is wired."""
    return {}, dict(y=slip / 1 + 0 * a_demand)


def loops(**parts):
    for names in permutations(parts):
        yield connect("loop", {}, **{n: parts[n] for n in names})


def names_of(lines):
    return {line.split()[0] for line in lines}


def test_each_power_that_gives_is_told_behind_one_that_does_not():
    """Half the time 100 W in, half 60 W out: 300 J come back of 800 J moved."""
    back = np.where(np.arange(1001) < 500, 100.0, -60.0)
    log = {"b.heat": back, "a.other": back, "b.other": back, "a.F": back, "c.heat": np.abs(back)}
    for loop in loops(a=brake, b=brake, c=brake):
        assert {"a.heat", "b.heat", "c.heat", "a.n"} <= doubt_signals(loop)
        assert not {"a.other", "a.F", "a.free"} & doubt_signals(loop)
        lines = warnings_of_log(loop, RUN, log | {"time": TIME})
        assert names_of(lines) == {"b.heat"}
        assert "delivers 300.6 J in this run" in lines[0]  # 501 ticks of 0.01 s by 60 W


@pytest.mark.parametrize(("back", "lines"), [(0.9, 0), (1.1, 1)])
def test_a_power_may_give_back_a_thousandth_of_what_it_moves(back, lines):
    """Of 10 MJ moved that is 10 kJ; of little it is 1 J."""
    power = np.full(1001, 1e6)
    power[500] = -back * 1e-3 * (1e6 * 1000 * H) / H
    loop = connect("loop", {}, a=brake)
    assert len(warnings_of_log(loop, RUN, {"time": TIME, "a.heat": power})) == lines
    little = np.where(np.arange(1001) == 500, -back / H, 0.0)
    assert len(warnings_of_log(loop, RUN, {"time": TIME, "a.heat": little})) == (back > 1.0)


def test_each_state_off_its_range_is_told_behind_one_that_is_not_logged():
    beyond = np.where(np.arange(1001) == 300, 2.5, 1.0)
    log = {"time": TIME, "b.n": beyond, "b.free": 9 * beyond, "c.n": beyond / 2}
    for loop in loops(a=brake, b=brake, c=brake):
        lines = warnings_of_log(loop, RUN, log)
        assert names_of(lines) == {"b.n"}
        assert "leaves its range, 0 .. 2, at 8 s, and comes to 2.5:" in lines[0]


@step(period=H)
def sure(held=State("m/s", 5.0, "estimate", deviation="sqrt(P)", truth="y"),
         P=State("(m/s)^2", 0.01, "its variance"), v=Input("m/s", "truth")):  # fmt: skip
    """Estimates a speed that it hears."""
    return dict(held=held + 0 * v, P=P), {}


def test_each_estimate_that_is_off_is_told_behind_one_that_is_not_logged():
    """a and b are 10 deviations off, and only b says its own; c is one off."""
    for names in permutations("abc"):
        wires = {f"{n}.v": "car.y" for n in names}
        loop = connect("loop", wires, car=stepped, **dict.fromkeys(names, sure))
        log = {"time": TIME, "car.y": np.full(1001, 4.0)}
        for n, known in (("a", ("held",)), ("b", ("held", "P")), ("c", ("held", "P"))):
            log |= {f"{n}.{k}": np.full(1001, {"held": 5.0, "P": 0.01}[k]) for k in known}
        log["c.held"] = np.full(1001, 4.1)
        assert names_of(warnings_of_log(loop, RUN, log)) == {"b.held"}


@step(period=H)
def doubled(held=State("1", 5.0, "estimate", deviation="sqrt(P)", truth="2*c"),
            P=State("1", 0.01, "its variance"), c=Param("1", 1.0)):  # fmt: skip
    """Estimates twice a number of a law."""
    return dict(held=held + 0 * c, P=P), {}


def law_of(unit, **more):
    params = [Param(unit, 2.0).named("c"), *(Param("1", 1.0).named(n) for n in more)]
    return make_block("law", "law", lambda x, u, p: ({}, {"mu": p["c"] + u["s"]}), params=params,
                      inputs=[Input(unit, value=0.0).named("s")],
                      outputs=[Output(unit).named("mu")])  # fmt: skip


@pytest.mark.parametrize(
    ("parts", "lines"),
    [({"law": law_of("1")}, 1), ({"law": law_of("1"), "force": law_of("N")}, 1),
     ({"force": law_of("N"), "law": law_of("1")}, 1), ({"force": law_of("N")}, 0),
     ({"law": law_of("1"), "other": law_of("1")}, 0),
     ({"law": law_of("1").with_conditions(dry={"c": 2.0})}, 1),
     ({"law": law_of("1", a=1).with_conditions(dry={"c": 2.0})}, 0)],
)  # fmt: skip
def test_an_estimate_is_held_against_the_one_number_of_its_name_and_unit(parts, lines):
    """Not against that of a law with a number more, of which the estimator knows nothing."""
    log = {"time": TIME, "est.held": np.full(1001, 5.0), "est.P": np.full(1001, 0.01)}
    told = warnings_of_log(connect("loop", {}, est=doubled, **parts), RUN, log)
    assert len(told) == lines
    assert all("for a true 4" in line for line in told)


def test_each_sensor_with_less_noise_than_steps_is_told_behind_one_without():
    """A tenth in steps errs by 0.1/sqrt(12) = 0.0289."""
    fine, still = coarse.with_params(sigma=0.03), coarse.with_params(sigma=0.0)
    for loop in loops(a=stepped, b=coarse, c=fine, d=still):
        lines = warnings_of_loop(loop, RUN)
        assert names_of(lines) == {"b.sigma"}
        assert "= 0.01 m/s is below the 0.0289 m/s" in lines[0]


def test_each_input_that_nothing_feeds_is_told_behind_one_that_is_fed():
    for loop in loops(gives=gives, wants=wants, coarse=coarse.with_params(sigma=0.03)):
        assert warnings_of_loop(loop, DEMAND) == [
            "no wire feeds wants.slip, so it keeps 0.5 m/s; wire it to gives.slip?"
        ]
    fed = RUN.but(inputs={"slip": 1.0, "a_demand": 0.0})
    assert warnings_of_loop(connect("loop", {}, gives=gives, wants=wants), fed) == []
