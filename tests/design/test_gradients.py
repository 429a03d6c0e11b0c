"""Slopes along a run against differences of runs that are simulated one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    Block,
    Ensemble,
    Input,
    Known,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    Signals,
    State,
    connect,
    flow,
    law,
    make_block,
    sampled,
    simulate,
    step,
)
from slipctl.design import page
from slipctl.design.slopes import gradients
from slipctl.design.slopes.gradients import Slopes
from slipctl.design.tune import Tuned, tune
from slipctl.run.sweep.ensemble import World

T = 1e-2


@flow(a=Output("m/s^2", "acceleration"))
def car(
    x=State("m", 0.0, "place"),
    v=State("m/s", "3 * w", "speed"),
    F=Input("N", "force"),
    w=Param("m/s", 2.0, "a third of the speed at the start"),
    m=Param("kg", 3.0, "mass"),
    c=Param("N s/m", 0.5, "drag"),
):
    """A mass with drag."""
    a = (F - c * v * ca.fabs(v)) / m
    return dict(x=v, v=a), dict(a=a)


@step(F=Output("N", "force"), period=T)
def pi(
    I=State("N", 0.0, "integral"),
    v=Input("m/s", "speed"),
    v_w=Input("m/s", "wanted speed"),
    K=Param("N s/m", 4.0, "gain", lo=0, hi=100),
    T_I=Param("s", 0.7, "time of the integral", lo=0.01, hi=100),
    most=Param("N", 15.0, "limit", lo=0),
    rate=Param("N/m", "K / T_I", "gain of the integral"),
):
    """PI with a limit."""
    F = ca.fmin(ca.fmax(K * (v_w - v) + I, -most), most)
    return dict(I=I + T * rate * (v_w - v)), dict(F=F)


def loop(change: Callable[[Any], Any] = lambda F: F) -> Block:
    @law(F=Output("N", "force"))
    def after(F_w=Input("N", "wanted force")):
        return change(F_w)

    wires = {"ctl.v": "car.v", "ctl.v_w": "v_w", "after.F_w": "ctl.F", "car.F": "after.F"}
    parts = {"car": sampled(car, T, "rk4"), "ctl": pi, "after": after}
    return connect("loop", wires, **parts)


SIGNALS = Signals(speed="car.v", position="car.x", slip="car.a", reference="ctl.F",
                  wanted_speed="v_w", wanted_position="goal")  # fmt: skip
KNOWN = {"goal": Known("m", [1.0, 9.0])}
RAIL = Rail([Section(0.0, None, {"v_w": 7.0, "car.c": 0.5}),
             Section(0.6, None, {"v_w": 4.0, "car.c": 0.9})])  # fmt: skip
SCENARIO = Scenario("change", 1.5, RAIL)
NOW = {"ctl.K": 4.0, "ctl.T_I": 0.7, "car.w": 2.0}


def world(of: Block | None = None, scenario: Scenario = SCENARIO) -> World:
    return World(of or loop(), scenario, Ensemble({"car.m": "2kg:4kg"}), signals=SIGNALS,
                 known=KNOWN, free=list(NOW), compile=False)  # fmt: skip


def metrics(numbers: Mapping[str, float], mass: float) -> dict[str, float]:
    """Metrics by hand, from a run that nothing of the module had a part in."""
    log = simulate(loop().with_params(**numbers, **{"car.m": mass}), SCENARIO, compile=False)
    v, x, F, a = (log[n].values for n in ("car.v", "car.x", "ctl.F", "car.a"))
    t = log["time"].values
    wanted, goal = np.where(t < 0.6 - 1e-9, 7.0, 4.0), np.where(t < 0.6 - 1e-9, 1.0, 9.0)
    return {
        "distance": x[-1] + (1.5 * v[-1] - 0.5 * v[-2]) * T - x[0],
        "speed_error_rms": float(np.sqrt(np.mean((v - wanted) ** 2))),
        "position_error_rms": float(np.sqrt(np.mean((x - goal) ** 2))),
        "slip_error_rms": float(np.sqrt(np.mean((a - F) ** 2))),
    }


@pytest.mark.parametrize("limit", [1e3, 9.0])
def test_every_slope_is_that_of_differences(limit: float) -> None:
    """To 1e-6, by each number: one that others follow, one that a start value follows; the second
    with the limit reached, where the loop has kinks."""
    own = world(loop().with_params(**{"ctl.most": limit}))
    draw = own.draw(0, 3)
    mass = draw.numbers["car.m"]
    found = Slopes(own, list(NOW)).of(NOW, draw, [*gradients.SMOOTH])
    for k, name in enumerate(NOW):
        h = 2e-4 * NOW[name]

        def at(by: float, name: str = name, h: float = h) -> dict[str, float]:
            numbers = {**NOW, name: NOW[name] + by * h, "ctl.most": limit}
            return metrics(numbers, mass)

        points = {by: at(by) for by in (-2, -1, 1, 2)}
        for metric, slopes in found.items():
            d = {by: p[metric] for by, p in points.items()}
            difference = (8 * (d[1] - d[-1]) - (d[2] - d[-2])) / (12 * h)
            assert slopes[k] == pytest.approx(difference, rel=1e-6)


def test_what_jumps_is_refused_and_where_it_does_not_it_is_not() -> None:
    """A quantiser, and a sign that changes; a sign of what never changes it leaves slopes alone."""
    assert Slopes(world(loop(lambda F: F * ca.sign(F + 1e3))), list(NOW))
    for change, said in (
        (lambda F: ca.floor(F * 10) / 10, "a quantiser"),
        (lambda F: F + ca.sign(F - 5), "a sign"),
    ):
        with pytest.raises(BadInput, match=f"{said} in it changes along the run .after"):
            Slopes(world(loop(change)), list(NOW))


def test_what_no_number_reaches_may_jump() -> None:
    """A counter that every run takes alike is no obstacle."""

    @step(s=Output("1"), period=T)
    def clock(n=State("1", 0.0, "ticks")):
        return dict(n=n + 1), dict(s=ca.sign(ca.sin(n)))

    @law(F=Output("N", "force"))
    def add(F_w=Input("N"), s=Input("1")):
        return F_w + s

    wires = {"ctl.v": "car.v", "ctl.v_w": "v_w", "after.F_w": "ctl.F", "after.s": "clock.s",
             "car.F": "after.F"}  # fmt: skip
    both = connect("loop", wires, car=sampled(car, T, "rk4"), ctl=pi, clock=clock, after=add)
    assert Slopes(world(both), list(NOW))


def test_equations_that_cannot_be_written_out_have_no_slope() -> None:
    """Of a linear solver there are no scalar operations."""

    def solved(x, u, p):
        matrix = ca.vertcat(ca.horzcat(4.0, 1.0), ca.horzcat(1.0, 2.0))
        return {}, {"F": ca.solve(ca.MX(matrix), ca.vertcat(u["F_w"], 0.0), "qr")[0]}

    after = make_block(
        "after", "law", solved, inputs=[Input("N").named("F_w")],
        outputs=[Output("N").named("F")], sx=False,
    )  # fmt: skip
    wires = {"ctl.v": "car.v", "ctl.v_w": "v_w", "after.F_w": "ctl.F", "car.F": "after.F"}
    both = connect("loop", wires, car=sampled(car, T, "rk4"), ctl=pi, after=after)
    with pytest.raises(BadInput, match="cannot be written as scalar operations"):
        Slopes(world(both), list(NOW))


@pytest.mark.parametrize(("names", "scenario", "said"), [
    (["car.v"], SCENARIO, "is no parameter"),
    (["ctl.K"], SCENARIO.but(rail=Rail(RAIL.sections, by="position")), "place of the vehicle"),
])  # fmt: skip
def test_what_has_no_slope(names: list[str], scenario: Scenario, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        Slopes(world(scenario=scenario), names)


def tuned(
    change: Callable[[Any], Any] = lambda F: F, goal: str = "speed_error_rms", runs: int = 60
) -> Tuned:
    return tune(
        loop(change), {"ctl.K": (1, 90), "ctl.T_I": (0.05, 5)}, goal,
        Ensemble({"car.m": "2kg:4kg"}), scenario=SCENARIO, signals=SIGNALS, known=KNOWN,
        samples=4, held_out=2, runs=runs, compile=False, jobs=1,
    )  # fmt: skip


@pytest.mark.second
@pytest.mark.long
def test_the_search_ends_along_the_slope(monkeypatch: pytest.MonkeyPatch) -> None:
    """With slopes the mean is lower than without, at the same search; a wrong slope is not used."""
    found = tuned()
    assert found.polished is not None
    assert found.polished.apart <= 1e-6
    assert found.polished.gained > 0
    assert "exact gradient" in page.text(found)
    right = Slopes.of
    monkeypatch.setattr(
        Slopes, "of", lambda *given: {n: 1.001 * v for n, v in right(*given).items()}
    )
    without = tuned()
    assert without.polished is not None
    assert "not used" in without.polished.text()
    assert found.search.best.score.mean() < without.search.best.score.mean()


@pytest.mark.second
def test_it_says_why_there_is_no_slope() -> None:
    assert "a sign in it changes" in page.text(tuned(lambda F: F + 0.1 * ca.sign(F - 5), runs=20))
    found = tuned(goal="speed_error_max", runs=20)
    assert found.polished is not None
    assert found.polished.text() == "no exact gradient: speed_error_max has no slope"


def test_of_several_axles_there_is_no_slope() -> None:
    @step(period=0.1, w=Output("m", shape=(2,)))
    def axles(x=State("m", np.zeros(2), shape=(2,))):
        return dict(x=x), dict(w=x)

    run = SimpleNamespace(signals=SimpleNamespace(find=lambda role, log: "w"), log=None)
    whole = SimpleNamespace(x=np.zeros((3, 2)), y=np.zeros((3, 2)))
    with pytest.raises(BadInput, match="w is of several axles"):
        Slopes._laid(SimpleNamespace(loop=axles), whole, run, [("role", np.ones(3))])  # type: ignore[arg-type]


@pytest.mark.parametrize("jumps", [False, True])
def test_a_rail_of_one_section_is_searched_for_jumps_too(jumps: bool) -> None:
    scenario = SCENARIO.but(rail=Rail([Section(0.0, None, {"v_w": 7.0, "car.c": 0.5})]))
    of = loop(ca.floor) if jumps else loop()
    one = World(of, scenario, Ensemble({"car.m": "2kg:4kg"}), signals=SIGNALS, known={},
                free=list(NOW), compile=False)  # fmt: skip
    with pytest.raises(BadInput, match="a quantiser") if jumps else nullcontext():
        Slopes(one, list(NOW))


@pytest.mark.parametrize("name", ["v", "w", "x", "nobody"])
def test_a_signal_is_seeded_once_where_a_state_and_an_output_have_one_name(name: str) -> None:
    """As an output, if it is one; what the loop does not compute has no slope."""

    @step(period=0.1, w=Output("m"), v=Output("m"))
    def both(x=State("m", 0.0), v=State("m", 0.0)):
        return dict(x=x, v=v), dict(w=x, v=v)

    slope = np.arange(3.0)
    run = SimpleNamespace(signals=SimpleNamespace(find=lambda role, log: name), log=None)
    whole = SimpleNamespace(x=np.zeros((3, 2)), y=np.zeros((3, 2)))
    laid = Slopes._laid(SimpleNamespace(loop=both), whole, run, [("role", slope)])  # type: ignore[arg-type]
    at = {"w": (1, 0), "v": (1, 1), "x": (0, 0)}
    wanted = [np.zeros((3, 2)), np.zeros((3, 2))]
    if name in at:
        which, column = at[name]
        wanted[which][:, column] = slope
    assert np.array_equal(laid, wanted)
