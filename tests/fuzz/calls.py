"""Valid calls of the public functions, and values that are wrong in each place of them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np

import slipctl as sc


@sc.law(mu=sc.Output("1", "adhesion"), conditions={"dry": {"c": 1.0}, "wet": {"c": 0.5}})
def hump(
    v=sc.Input("m/s", "slip speed"),
    c=sc.Param("1", 1.0, "height", lo=1e-3, hi=5),
    a=sc.Param("s/m", 1.0, "decay", lo=1e-3, hi=10),
):
    return c * v * a * ca.exp(-a * v)


@sc.law(mu=sc.Output("1", "adhesion"), conditions={"dry": {"c": 1.0}})
def twin(
    v=sc.Input("m/s", "slip speed"),
    w=sc.Input("m/s", "vehicle speed"),
    c=sc.Param("1", 1.0, "height", lo=1e-3, hi=5),
):
    return c * v / w * ca.exp(-v / w)


@sc.law(mu=sc.Output("1", "adhesion"))
def line(
    v=sc.Input("1", "slip"),
    a=sc.Param("1", 1.0, "offset"),
    b=sc.Param("1", 1.0, "slope"),
):
    return a + b * v


@sc.flow(y=sc.Output("m/s", "speed"))
def car(
    x=sc.State("m", 0.0, "position"),
    v=sc.State("m/s", 1.0, "speed"),
    u=sc.Input("m/s^2", "push", value=0.0),
    d=sc.Param("1/s", 0.1, "drag", lo=0, hi=10),
):
    return {"x": v, "v": u - d * v}, {"y": v}


@sc.step(period=0.01, y=sc.Output("m", "place"))
def tick(x=sc.State("m", 0.0, "place"), u=sc.Input("m/s", "speed"), k=sc.Param("1", 1.0, lo=0)):
    return {"x": x + 0.01 * k * u}, {"y": x}


T = np.linspace(0.1, 3, 40)
SCENARIO = sc.Scenario("short", 0.05, inputs={"u": 1.0})

VALID: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
    "State": (("m", 0.0, "place"), {"lo": 0, "hi": 1}),
    "Input": (("m", "place"), {"value": 0.0}),
    "Param": (("m", 1.0, "length"), {"lo": 0, "hi": 2, "shape": ()}),
    "Noise": (("1",), {}),
    "Output": (("m", "place"), {"positive": "braking"}),
    "connect": (("pair", {"b.u": "a.x"}), {"a": tick, "b": sc.unit_delay("m", 0.01)}),
    "sampled": ((car, 0.01, "rk4"), {"substeps": 2}),
    "every": ((tick, 2), {}),
    "unit_delay": (("m", 0.01), {}),
    "replicate": ((tick, 2), {}),
    "flip_sign": (("N m",), {}),
    "mirror": (("m/s", "braking"), {}),
    "Section": ((0.0, "dry", {"c": 1.0}), {"length": None}),
    "Rail": (([sc.Section(0.0, "dry")],), {"by": "time"}),
    "Scenario": (("short", 1.0),
                 {"inputs": {}, "start": {}, "params": {}, "noise": 1.0, "seed": 1}),
    "simulate": ((tick, SCENARIO), {"compile": False, "every": 1, "log": ["x"]}),
    "argmax": ((hump, "v", "mu"), {"lo": 0.0, "hi": 5.0, "at": {}}),
    "argmax_block": ((hump, "v", "mu"), {"lo": 0.0, "hi": 5.0}),
    "differential_evolution": ((hump, "v", "mu"), {"lo": 0.0, "hi": 5.0}),
    "rls": ((hump, "mu"), {}),
    "peak_bound": ((hump, "v", 1.0, {"v": T}, 1e-3), {"spread": {"c": 1.0}}),
    "least_squares": ((np.column_stack([T, T**2]), T + 1e-3 * np.sin(9 * T)), {}),
    "luenberger": ((car, [-1.0, -2.0]), {"measured": "x"}),
    "linear": ((car,), {}),
    "operating_point": ((car, {"x": 0.0}, ["v"]), {"steady": ["v"]}),
    "ctukf": ((car, "x", "v"), {"prior": 1.0, "noise": 0.1, "drift": 0.1, "period": 0.01}),
    "ekf": ((car, "x", "v"), {"prior": 1.0, "noise": 0.1, "start": {"v": 1.0}, "period": 0.01}),
    "observability": ((car, "x", "v"), {"scale": 1.0, "horizon": 1.0}),
    "lipschitz": ((car, "x", "v", {"v": (0.0, 1.0)}), {"tolerance": 0.1}),
    "locking_seek": ((0.01,), {"k": 1.0, "planes": 3, "start": 0.0}),
    "perturbation_seek": ((0.01,), {"dither": "fixed", "w": 12.0}),
    "seek_limits": ((sc.sliding_seek(0.01),), {"steepest": 0.5, "curvature": -1.0}),
    "particle_swarm": ((hump, {"v": (0.0, 2.0)}, "mu"), {"particles": 4, "iterations": 3}),
    "argmax_table": ((twin, "v", "w"), {"lo": 0.1, "hi": 5.0, "span": (1.0, 2.0), "error": 0.01}),
    "identify": ((line, {"v": T, "mu": 2 * T + 1}), {"accuracy": 0.05}),
    "linear_fit": ((line,), {"period": 0.01, "spread": [1.0, 1.0]}),
    "fit": ((hump, {"v": T, "mu": T * np.exp(-T)}), {"start": {"c": 0.9}}),
    "fit_over_time": ((sc.from_text("x' = -k*x where x = 1 m, k = 2 1/s"),
                       {"time": T, "x": np.exp(-T)}, "x"),
                      {"unknown": ["k"], "start": {"k": 1.0}}),
    "opened": ((hump, "c"), {}),
    "probe": ((hump, "v", (0.1, 5.0)), {"period": 0.016}),
    "make_block": (("b", "law", lambda x, u, p: ({}, {"y": 1})),
                   {"outputs": [sc.Output("1").named("y")]}),
    "nonlinear": ((car,), {}),
    "sliding_seek": ((0.01,), {}),
    "one": (("m",), {}),
    "law": ((), {"y": sc.Output("1")}),
    "flow": ((), {"y": sc.Output("1")}),
    "step": ((0.01,), {"y": sc.Output("1")}),
    "Table": (("t", {"a": ("1", [1, 2])}), {"doc": ""}),
    "Claim": (("i", "s", "c", "number", "1.0"), {"ours": lambda r: 1.0, "tolerance": 0.1}),
    "Known": (("m", 1.0), {}),
    "interpolated": ((0.5, [0, 1, 2], [0, 1, 4]), {}),
    "End": (("x",), {"below": 0.5, "hold": 0.01}),
    "Ensemble": (({"k": "0.5:1"},), {"scale": {}, "seeds": False}),
    "Case": ((SCENARIO, {"l": tick}), {"known": {}, "log": ["x"], "every": 1}),
    "Signals": ((), {"speed": "u", "slip": "x"}),
    "Experiment": (("t", lambda c: None), {"doc": ""}),
    "Figure": (("c", lambda r: None), {"source": ""}),
    "Gains": (("n", "l", "super_twisting", lambda b: {}), {}),
    "Block": (("b", "law", lambda x, u, p: ({}, {}), [sc.Output("1").named("y")]), {}),
    "ranged": ((tick, sc.Output("m", "place", lo=0, hi=1).named("y")), {}),
    "state_machine": (("m", ("a", "b"), [("a", "b", "v > hi"), ("b", "a", "v < hi")]),
                      {"v": sc.Input("m/s"), "hi": sc.Param("m/s", 1.0), "start": "a"}),
    "gated": ((tick,), {"by": "on"}),
    "from_text": (("x' = -k*x where x = 1 m, k = 2 1/s",), {"name": "q"}),
    "over_distance": ((car,), {"speed": "v", "least": 0.1}),
    "prepare": ((tick, SCENARIO), {"compile": False, "log": ["x"], "every": 1, "runs": 1}),
    "misfit_search": ((line, {"a": (0.0, 2.0), "b": (0.0, 2.0)}),
                      {"particles": 3, "iterations": 2}),
    "speed_to_ratio": ((), {}),
    "ratio_to_speed": ((), {}),
}  # fmt: skip


def lists_in_lists(depth: int) -> list[Any]:
    """A list in a list in a list."""
    found: list[Any] = []
    for _ in range(depth):
        found = [found]
    return found


METHODS: dict[str, tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]] = {
    "expr": (tick.expr, ({"x": 0.0}, {"u": 1.0}, {"k": 1.0}), {}),
    "jacobian": (hump.jacobian, ("mu", ["c", "a"]), {}),
    "hump": (hump, (), {"v": 1.0, "c": 0.5}),
    "with_params": (tick.with_params, (), {"k": 2.0}),
    "but": (SCENARIO.but, (), {"duration": 0.1, "seed": 2, "noise": 0.0, "params": {"k": 1.0}}),
}
"""Methods that a user calls, and calls of them that are right."""

WRONG: tuple[Any, ...] = (
    None, 3, -1, 0, 2.5, math.nan, math.inf, -math.inf, 1e308, 1 + 2j, True, "x", "", "a b", b"x",
    [], [1, "x"], [None], (), {}, {"x": 1}, {1: 2}, {"v": None}, {"x": math.nan}, object(), int,
    lambda *a: None, np.array([]), np.array([math.nan]), np.array(["x"]), ca.SX.sym("s"), tick,
    hump, slice(3), range(0), set(), float, "unit^", 10**400,
    lists_in_lists(3000),
)  # fmt: skip


def wrong_calls() -> Iterator[tuple[str, str, Callable[[], Any]]]:
    """Name of the function, place of the argument with the value in words, and the call."""
    rows = {n: (getattr(sc, n), *given) for n, given in VALID.items()} | METHODS
    for name, (function, args, kwargs) in rows.items():
        for value in WRONG:
            shown = type(value).__name__ if callable(value) else _words(value)
            for k in range(len(args)):
                put = [*args[:k], value, *args[k + 1 :]]
                yield name, f"{k}={shown}", lambda f=function, a=put, w=kwargs: f(*a, **w)
            for key in kwargs:
                swapped = kwargs | {key: value}
                yield name, f"{key}={shown}", lambda f=function, a=args, w=swapped: f(*a, **w)


def _words(value: Any) -> str:
    """A value, short."""
    try:
        return repr(value)[:40]
    except RecursionError:
        return "nested"


def answer(name: str, call: Callable[[], Any]) -> str:
    """What is wrong with how a call ends: an error from inside, or a hang; else empty."""
    start = time.process_time()
    try:
        call()
    except (sc.BadInput, sc.RunFailed):
        pass
    except TypeError as error:  # a missing or unknown argument, as Python says it
        if not str(error).startswith(name):
            return f"TypeError: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "hangs" if time.process_time() - start > 5 else ""  # not one that is slow today
