"""Small predictive controllers, estimators and what else looks ahead, with each keyword once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from test_offset import car, tracking

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    control_slopes,
    feasibility,
    flow,
    law,
    mhe,
    nmpc,
    one,
    over_distance,
    run_slopes,
    sampled,
    terminal_region,
    tightening,
    trajectory,
)

H = 0.1


@flow(
    power=Output("W", "of the force", lo=-9, hi=9),
    conditions={"good": {"c": 0.3}, "poor": {"c": 0.9}},
)
def cart(
    x=State("m", 0.0, "place", lo=-50, hi=50), v=State("m/s", 1.0, "speed", lo=-20, hi=20),
    F=Input("N", "force", lo=-4, hi=4), B=Input("N", "brake", value=0.0, lo=0, hi=2),
    load=Input("N", "what pushes back", value=0.4),
    m=Param("kg", 2.0, "mass", lo=0.5, hi=8), c=Param("kg/m", 0.3, "drag", lo=0, hi=3),
):  # fmt: skip
    """A cart with a force, a brake and a drag."""
    drag = c * v * ca.sqrt(v * v + 0.01 * one("m^2/s^2"))
    return dict(x=v, v=(F - B - drag - load) / m), dict(power=F * v)


@law(e=Output("m/s"), f=Output("N"), b=Output("N"), p=Output("m"))
def wish(
    v=Input("m/s", "speed"), x=Input("m", "place"), F=Input("N", "force"), B=Input("N", "brake"),
    v_ref=Input("m/s", "wanted", value=2.0), x_ref=Input("m", "wanted", value=0.5),
    soft=Param("1", 0.7, "share of the place", lo=0.1, hi=2),
):  # fmt: skip
    """Speed, place, and both forces."""
    return dict(e=v - v_ref, f=F, b=B, p=soft * (x - x_ref))


@law(e=Output("m/s"), f=Output("N"), p=Output("m"))
def alone(
    v=Input("m/s", "speed"), x=Input("m", "place"), F=Input("N", "force"),
    v_ref=Input("m/s", "wanted", value=0.0),
):  # fmt: skip
    """Speed, place and the force."""
    return dict(e=v - v_ref, f=F, p=x)


@law(w=Output("W", "work"), s=Output("m/s", "way"))
def price(F=Input("N", "force"), v=Input("m/s", "speed")):
    """Energy, and way with a minus."""
    return dict(w=F * v, s=-v)


@law(over=Output("m/s", "speed over the limit", lo=-30, hi=0))
def below(v=Input("m/s", "speed"), top=Input("m/s", "limit", value=1.8)):
    """At most the limit."""
    return v - top


@law(last=Output("m", "place over the end", lo=-30, hi=0))
def at_the_end(x=Input("m", "place")):
    """At most 0.6 m at the end."""
    return x - 0.6 * one("m")


@law(q=Output("m/s"), r=Output("m"))
def to_go(v=Input("m/s", "speed"), x=Input("m", "place"), v_ref=Input("m/s", value=2.0)):
    """What counts at the end."""
    return dict(q=2 * (v - v_ref), r=x)


WEIGHTS = {"e": 3.0, "f": 0.3, "b": 0.5, "p": 1.5}


def make(control: Any = ("F", "B"), **options: Any) -> Block:
    """Controller of the cart."""
    cost = options.pop("cost", wish)
    weights = {n: w for n, w in WEIGHTS.items() if n in cost.outputs} | options.pop("weights", {})
    return nmpc(cart, cost, control, **{"h": H, "horizon": 4, "weights": weights} | options)


POINT = {"at": {"v": 1.0, "F": 0.7, "load": 0.4}}
OPTIONS: dict[str, dict[str, Any]] = {
    "as it comes": {},
    "one control": {"control": "F", "cost": alone, "weights": {"e": 2.0}},
    "named end": {"terminal": ["e"]},
    "end of its own": {"terminal": to_go, "weights": {"q": 2.0, "r": 0.5}},
    "regulator": {"terminal": "lqr", **POINT},
    "matrix": {"terminal": np.array([[2.0, 0.3], [0.3, 1.5]]), **POINT},
    "preview": {"preview": ["load", "F_top"], "bounds": {"F": (-3.0, "F_top")}},
    "bounds by name": {"bounds": {"F": ("F_low", "F_top"), "B": (0.0, 1.5)}},
    "rates": {"rates": {"F": 6.0, "B": 9.0}},
    "rate of one": {"rates": {"B": 2.0}, "moves": (1, 1, 2)},
    "soft": {"soft": {"v": (-1.0, 1.2, 9.0), "power": (None, 1.0, 2.0, 0.5)}},
    "soft and linear": {"soft": {"v": (None, 1.2, 0.0, 30.0)}},
    "hard": {"hard": {"v": (-1.0, 1.4), "x": (None, 0.3)}},
    "hard that cannot be": {"hard": {"v": (-1.0, 0.5), "power": (-1.0, 1.0)}},
    "both": {"hard": {"x": (-1.0, 0.3)}, "soft": {"v": (-1.0, 1.2, 9.0)}, "rates": {"F": 6.0}},
    "prices": {"economic": price, "weights": {"w": 0.2, "s": 0.7}},
    "path": {"path": below},
    "path ahead": {"path": below, "preview": ["top"]},
    "end held": {"final": at_the_end},
    "moves": {"horizon": 6, "moves": (1, 2, 3)},
    "grow": {"grow": 1.4},
    "iterations": {"iterations": 3},
    "exact": {"hessian": "exact", "damping": 0.02},
    "damped": {"damping": 0.5},
    "search": {"search": True, "iterations": 2},
    "few passes": {"passes": 2, "rates": {"F": 6.0}},
    "no rescue": {"rescue": 0},
    "few of both": {"passes": 2, "rescue": 3, "soft": {"v": (-1.0, 1.2, 9.0)}},
    "deadline": {"deadline": True, "passes": 4},
    "scenarios": {"scenarios": [{}, {"m": 0.5, "load": 3.0}], "shared": 2},
    "scenarios apart": {"control": "F", "cost": alone, "scenarios": [{}, {"m": 0.5}, {"c": 2.0}]},
    "euler": {"method": "euler", "substeps": 3},
    "implicit": {"method": "implicit_euler", "substeps": 2},
    "split": {"split": True},
    "split with rates": {"split": True, "rates": {"F": 6.0}, "preview": ["load"]},
    "osqp": {"solver": "osqp", "rates": {"F": 6.0}, "soft": {"v": (-1.0, 1.2, 9.0)}},
    "ipopt": {"solver": "ipopt", "hard": {"v": (-1.0, 1.4)}},
    "another name": {"name": "planner", "horizon": 3},
}  # fmt: skip


def offset(**options: Any) -> Block:
    """Controller that learns what it does not know."""
    return nmpc(car, tracking, "F_cmd", h=H, horizon=4, weights={"e": 9.0}, at={"w": 1.0},
                **options)  # fmt: skip


def distance() -> Block:
    """A plan over distance."""
    return nmpc(
        over_distance(cart, "v"), wish, ["F", "B"], h=0.5, horizon=4, weights=WEIGHTS,
        preview=["v_ref"],
    )  # fmt: skip


ARRIVAL = {"x": 0.5, "v": 1.0, "load": 0.3}
DRIFT = {"x": 0.0, "v": 0.05, "load": 0.2}
SEEN: dict[str, dict[str, Any]] = {
    "as it comes": {},
    "numbers": {"start": {"v": 0.7}, "iterations": 2, "substeps": 2, "name": "seen"},
    "hard": {"limits": {"load": (0.0, 0.3), "v": (None, 1.1)}},
    "soft": {"limits": {"power": (-0.5, 0.2, 9.0)}},
    "late": {"late": "x"},
    "of two": {"measurements": ("x", "v"), "noise": {"x": 0.01, "v": 0.04}, "late": ["v"]},
    "few": {"passes": 2, "rescue": 4, "limits": {"load": (0.0, 0.3)}},
}


def estimator(**options: Any) -> Block:
    """Estimator of the cart."""
    given = {"measurements": "x", "noise": 0.01, "arrival": ARRIVAL, "drift": DRIFT,
             "samples": 4, "period": H} | options  # fmt: skip
    first = (given.pop(n) for n in ("measurements", "noise", "arrival"))
    return mhe(cart, *first, **given)


PROGRAMS: dict[str, Callable[[], Block]] = {
    **{f"nmpc, {n}": lambda o=o: make(**o) for n, o in OPTIONS.items()},
    "nmpc, over distance": distance,
    "nmpc, offset of a load": lambda: offset(offset_free="load"),
    "nmpc, offset of a state": lambda: offset(offset_free=["v"], terminal="lqr"),
    "nmpc, offset in two parts": lambda: offset(
        offset_free=["v"], split=True, rates={"F_cmd": 40.0}
    ),
    **{f"mhe, {n}": lambda o=o: estimator(**o) for n, o in SEEN.items()},
}
"""Blocks by name."""


def loop() -> Block:
    """Controller and cart."""
    wires = {"ctl.x": "plant.x", "ctl.v": "plant.v", "plant.F": "ctl.F", "plant.B": "ctl.B"}
    return connect("loop", wires, ctl=make(iterations=2), plant=sampled(cart, H, "rk4"))


def region(**options: Any) -> Any:
    """Where the regulator may end."""
    weights = {"e": 3.0, "f": 0.3, "p": 1.5}
    given: dict[str, Any] = {"h": H, "weights": weights, "at": {"load": 0.0, "B": 0.0}} | options
    return terminal_region(cart, alone, "F", **given)


def way(end: dict[str, float], scenario: Scenario, **options: Any) -> Any:
    """An optimal trajectory."""
    given = {"intervals": 6, "tolerance": 1e-2} | options
    return trajectory(cart, scenario, ["F", "B"], "time", end=end, **given)


RAIL = Rail([Section(0, "good"), Section(0.4, "poor")])
PLACES = Rail([Section(0, "good"), Section(0.5, "poor")], by="position")
SLOPES = {"x": 0.1, "v": 1.2, "v_ref": 2.0, "x_ref": 0.5, "load": 0.4}

FOUND: dict[str, Callable[[], Any]] = {
    "control_slopes": lambda: control_slopes(
        make(iterations=9, rates={"F": 9.0}), ["v_ref", "plant.m", "weight_e", "F_hi"], **SLOPES),
    "run_slopes": lambda: run_slopes(
        loop(), Scenario("go", 0.4, inputs={"ctl.v_ref": 1.5}), ["plant.m", "ctl.weight_f"]),
    "feasibility": lambda: feasibility(
        make(rates={"F": 9.0}), cart, {"x": (-1.0, 1.0), "v": (-2.0, 2.0), "v_ref": (0.0, 3.0)},
        starts=3, ticks=12, seed=4),
    "region": region,
    "region of limits": lambda: region(hard={"v": (-0.5, 0.4)}),
    "tightening": lambda: tightening(
        cart, wish, ["F", "B"], "v", h=H, horizon=4, noise={"v": 0.05}, weights=WEIGHTS,
        at={"v": 1.0, "F": 0.7, "load": 0.4}, chance=0.9),
    "trajectory": lambda: way({"x": 1.0, "v": 0.0}, Scenario("go", 10.0, start={"v": 0.0})),
    "trajectory by sections": lambda: way(
        {"x": 1.0, "v": 0.5}, Scenario("go", 9.0, RAIL), limits={"v": (0.0, 1.3)}),
    "trajectory by places": lambda: way({"x": 1.0}, Scenario("go", 9.0, PLACES, start={"v": 0.5})),
}  # fmt: skip
"""Results that are no blocks."""
