"""Estimators that begin further off than they say themselves: any kind, any name, said."""

import numpy as np
import pytest

from slipctl import (
    Input,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    ctukf,
    ekf,
    flow,
    law,
    rls,
    sampled,
    simulate,
)
from slipctl.study.case_setup import warnings_of_run

H = 1e-3


@flow(F=Output("N", "contact force"))
def cart(
    v=State("m/s", 4.0, "speed"),
    mu=Input("1", "adhesion"),
    m=Param("kg", 100.0, "mass"),
):
    """A cart that adhesion slows."""
    F = mu * m * 9.81
    return dict(v=-F / m), dict(F=F)


@law(mu=Output("1", "adhesion"), conditions={"dry": {"c": 0.4}, "ice": {"c": 0.1}})
def linear(v=Input("m/s", "speed"), c=Param("1", 0.2, "height", lo=1e-3)):
    """Adhesion."""
    return 0.1 * c * v


@flow()
def known(
    v=State("m/s", 4.0, "speed"),
    F=Input("N", "contact force"),
    m=Param("kg", 100.0, "mass"),
):
    """The cart as a filter knows it."""
    return dict(v=-F / m), {}


@law(mu=Output("1", "adhesion"))
def level(v=Input("m/s", "speed"), h=Param("1", 0.2, "height", lo=1e-3)):
    """Adhesion, its height by another name."""
    return 0.1 * h * v


SCENARIO = Scenario("s", 0.1, Rail([Section(0, "dry")]))


def loop(**parts):
    plant = sampled(connect("plant", {"c.mu": "a.mu", "a.v": "c.v"}, c=cart, a=linear), H, "rk4")
    wires = {}
    for n, block in parts.items():
        wires |= {f"{n}.v": "plant.c.v"} | (
            {f"{n}.mu": "plant.a.mu"} if "mu" in block.inputs else {}
        )
    return connect("loop", wires, plant=plant, **parts)


@pytest.mark.parametrize("make", [ctukf, ekf])
@pytest.mark.parametrize("form", ["sampled", "differential"])
def test_filters_say_it_of_states_and_inputs(make, form):
    """At 4 m/s on dry rail F = 0.1 * 0.4 * 4 * 100 * 9.81 = 156.96 N; the filter begins at 0."""
    for sigma, wanted in ((156.9, 1), (157.0, 0)):
        f = make(known, "v", "F", prior=sigma**2, noise=1.0, form=form)
        lines = warnings_of_run(loop(f=f), SCENARIO)
        assert len(lines) == wanted
        assert all(
            line.startswith("f.held_F begins at 0 N, plant.c.F at 156.96 N") for line in lines
        )
    f = make(known, "v", ("v", "F"), prior={"v": 0.25, "F": 1e6}, noise=1.0, form=form)
    assert not warnings_of_run(loop(f=f), SCENARIO)
    said = warnings_of_run(loop(f=f), SCENARIO.but(start={"plant.c.v": 4.6}))
    assert len(said) == 1
    assert "f.held_v begins at 4 m/s, plant.c.v at 4.6 m/s: 0.6 m/s away" in said[0]
    assert said[0].endswith("more than its own standard deviation of 0.5 m/s")


@pytest.mark.parametrize("form", ["recursive", "window"])
def test_fits_say_it_of_the_law_on_the_first_rail(form):
    """log(0.2) to log(0.4) is 0.693; on ice, to log(0.1), as far; to 0.2 itself it is nothing."""
    for spread, wanted in ((0.69, 1), (0.70, 0)):
        fit = rls(linear, form=form, period=H, spread=spread)
        for rail in ("dry", "ice"):
            lines = warnings_of_run(loop(f=fit), SCENARIO.but(rail=Rail([Section(0, rail)])))
            assert len(lines) == wanted
        assert not warnings_of_run(loop(f=fit), SCENARIO.but(rail=None))
    assert (
        "f.theta for log(c) begins at -1.60944, the plant at -2.30259"
        in warnings_of_run(
            loop(f=rls(linear, form=form, period=H, spread=0.6)),
            SCENARIO.but(rail=Rail([Section(0, "ice"), Section(0.05, "dry")])),
        )[0]
    )


def test_what_has_two_meanings_or_none_is_not_judged():
    plant = sampled(connect("plant", {"c.mu": "a.mu", "a.v": "c.v"}, c=cart, a=linear), H, "rk4")
    f = ekf(known, "v", "F", prior=1.0, noise=1.0)
    twice = connect("l", {"f.v": "plant.c.v"}, plant=plant, other=plant, f=f)
    assert not warnings_of_run(twice, SCENARIO)
    alone = connect("l", {}, f=f)
    assert not warnings_of_run(alone.with_params(), Scenario("s", 0.1, inputs={"f.v": 1.0}))


def test_what_has_the_name_and_another_unit_is_not_meant():
    """The acceleration of a train was the truth of a slope called a, and its logarithm -inf."""

    @law(F=Output("Pa", "pressure"), c=Output("m", "distance"))
    def other(v=Input("m/s", "speed")):
        """A pressure with the letter of a force."""
        return {"F": 0 * v, "c": 0 * v}

    f = ekf(known, "v", "F", prior=1.0, noise=1.0)
    lines = warnings_of_run(loop(f=f, other=other), SCENARIO)
    assert [line.partition(" away")[0] for line in lines] == [
        "f.held_F begins at 0 N, plant.c.F at 156.96 N: 157 N"
    ]
    fit = rls(linear, period=H, spread=0.1)
    wires = {f"{n}.v": "plant.v" for n in ("f", "other", "level")} | {"f.mu": "level.mu"}
    blocks = {"plant": sampled(cart, H, "rk4"), "f": fit, "other": other, "level": level}
    assert not warnings_of_run(connect("l", wires, **blocks), Scenario("s", 0.1))


def test_two_estimators_are_not_each_others_truth():
    f = ekf(known, "v", "F", prior=1.0, noise=1.0)
    lines = warnings_of_run(loop(f=f, g=f), SCENARIO)
    assert [line.partition(" ")[0] for line in lines] == ["f.held_F", "g.held_F"]
    assert all("plant.c.F at 156.96 N" in line for line in lines)


def test_an_element_of_an_estimate_is_judged_by_its_own_deviation():
    @law(mu=Output("1", "adhesion"))
    def two(v=Input("m/s", "speed"), c=Param("1", 0.2, lo=1e-3), d=Param("1", 0.3, lo=1e-3)):
        """Adhesion with a level."""
        return 0.1 * c * v + d

    plant = connect(
        "plant", {"c.mu": "a.mu", "a.v": "c.v"}, c=cart, a=two.with_params(c=0.5, d=0.5)
    )
    f = rls(two, period=H, start={"c": 0.2, "d": 0.3}).with_params(spread=np.array([2.0, 0.4]))
    wires = {"f.v": "plant.c.v", "f.mu": "plant.a.mu"}
    lines = warnings_of_run(
        connect("loop", wires, plant=sampled(plant, H, "rk4"), f=f), Scenario("s", 0.1)
    )
    assert len(lines) == 1
    assert "log(d)" in lines[0]


@pytest.mark.parametrize("every", [1, 10])
def test_a_run_from_python_carries_what_the_command_says(every):
    """Whatever is logged; a run with nothing to tell carries nothing."""
    for sigma in (1.0, 200.0):
        whole = loop(f=ctukf(known, "v", "F", prior=sigma**2, noise=1.0))
        lines = warnings_of_run(whole, SCENARIO)
        run = simulate(whole, SCENARIO, compile=False, log=["plant.c.v"], every=every)
        assert run.attrs.get("told", "").splitlines() == lines
        assert bool(lines) == (sigma == 1.0)
