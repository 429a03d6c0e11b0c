"""Small blocks that together enter each branch of what writes C, and what is asked of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from test_a2l import curve
from test_autosar import alone
from test_bus import SCALED, part
from test_codegen import BLOCKS, _random_function
from test_codegen_guards import bounded, careful, guarded, products, wave
from test_fmu import lag
from test_parameters_in_force import gain
from test_proof import sums
from test_rates import whole
from test_reach import full, law
from test_readability import pushed
from test_rolled_loops import repeating

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    State,
    argmax_table,
    connect,
    ctukf,
    differential_evolution,
    ekf,
    every,
    flow,
    gated,
    make_block,
    mhe,
    nmpc,
    rls,
    sampled,
    step,
)
from slipctl import law as as_law
from slipctl.models.huang_2020 import subway_braking

Made = tuple[Block, dict[str, Any]]
"""A block, and how it is written: arguments of Plan and of texts."""


@flow(F_out=Output("N", "resistance"))
def cart(
    x=State("m", 0.0, "place"), v=State("m/s", 1.0, "speed"),
    F=Input("N", "force", value=0.0, lo=-4, hi=4), w=Input("N", "wind", value=0.1),
    m=Param("kg", 2.0, "mass", lo=0.5, hi=8), c=Param("kg/m", 0.3, "drag", lo=0, hi=3),
):  # fmt: skip
    """A cart against the wind."""
    drag = c * v * ca.fabs(v)
    return dict(x=v, v=(F - drag - w) / m), dict(F_out=drag)


@as_law(e=Output("m/s"), f=Output("N"))
def wish(v=Input("m/s"), F=Input("N"), v_ref=Input("m/s", value=2.0)):
    """Speed, with little force."""
    return dict(e=v - v_ref, f=F)


@as_law(mu=Output("1", "adhesion"))
def hill(
    s=Input("m/s", "slip", lo=0, hi=10), a=Param("s/m", 0.54, lo=0.1, hi=2),
    b=Param("s/m", 1.2, lo=0.1, hi=4),
):  # fmt: skip
    """Two exponentials."""
    return ca.exp(-a * s) - ca.exp(-b * s)


@as_law(mu=Output("1", "adhesion"))
def peaked(s=Input("m/s", "slip", lo=0, hi=10), w=Input("m/s", "speed", lo=0, hi=2),
           a=Param("s/m", 0.54, lo=0.1, hi=2)):  # fmt: skip
    """A peak that moves with the speed."""
    return a * s / (1 + (a * s) ** 2 + w * a)


@step(period=0.01, y=Output("1", "many", shape=(9,)), z=Output("1", "held", lo=-3, hi=3, safe=1.0))
def long_names(
    a_state_with_a_rather_long_name=State("1", 0.5, "first", lo=-3, hi=3),
    another_state_with_a_long_name=State("1", [0.5] * 9, "second", shape=(9,), lo=-3, hi=3),
    third=State("1", "2 * a_number_with_a_long_name", "from a parameter"),
    an_input_with_a_rather_long_name=Input("1", "input", lo=-2, hi=2, change=0.5, stale=3),
    many_inputs_of_one_name=Input("1", "vector", shape=(9,), lo=-1, hi=1),
    a_number_with_a_long_name=Param("1", 0.25, "\u00b5 \u2264 1", lo=0.1, hi=1),
    numbers_of_one_name=Param("1", np.linspace(0, 1, 9), "table", shape=(9,), lo=0, hi=1),
):  # fmt: skip
    """Names so long that statements go over several lines.

    A second paragraph of the text, with a list:

        one
        two */ three
    """
    gained = a_number_with_a_long_name * an_input_with_a_rather_long_name
    moved = 0.5 * another_state_with_a_long_name + numbers_of_one_name * many_inputs_of_one_name
    rest = 0.5 * a_state_with_a_rather_long_name + gained
    held = ca.if_else(rest > third, rest - third, ca.if_else(rest < -third, rest + third, 0))
    return dict(
        a_state_with_a_rather_long_name=rest,
        another_state_with_a_long_name=moved,
        third=third,
    ), dict(y=moved + rest, z=held)


def _once(x: Any, u: Any, p: Any) -> Any:
    """Vectors cut, joined, turned and chosen from; a choice of two functions, of which one runs."""
    a, b = ca.MX.sym("a", 3), ca.MX.sym("b")
    more = ca.Function("more", [a, b], [a[::-1] * b, ca.sum1(a)], ["a", "b"], ["turned", "whole"])
    less = ca.Function("less", [a, b], [ca.vertcat(a[1:], b), a[0]], ["a", "b"], ["moved", "first"])
    either = ca.Function.if_else("either", more, less)
    turned, whole_ = either(u["on"] > 0.5, x["s"], u["v"][0])
    square = ca.mtimes(u["A"], x["s"])
    picked = u["v"][[2, 0, 1]]
    cells = ca.reshape(ca.vertcat(picked, turned), 2, 3)
    placed = ca.MX(ca.DM.zeros(4, 1))
    placed[1:3] = square[:2]
    return {"s": 0.5 * turned + square * 0.1, "kept": placed}, {
        "y": whole_ + ca.dot(picked, square), "cells": cells, "placed": placed + x["kept"],
        "ends": ca.horzcat(ca.mmin(picked), ca.mmax(square), ca.norm_2(turned)),
    }  # fmt: skip


once = make_block(
    "once", "step", _once, sx=False, doc="Vectors in pieces, and one of two functions.", period=0.1,
    states=[State("1", [1.0, 2.0, 3.0], shape=(3,)).named("s"),
            State("1", 0.0, shape=(4,)).named("kept")],
    inputs=[Input("1", lo=0, hi=1).named("on"), Input("1", lo=-1, hi=1, shape=(3,)).named("v"),
            Input("1", lo=-1, hi=1, shape=(3, 3)).named("A")],
    outputs=[Output("1").named("y"), Output("1", shape=(2, 3)).named("cells"),
             Output("1", shape=(4,)).named("placed"), Output("1", shape=(1, 3)).named("ends")],
)  # fmt: skip


def drawn(seed: int) -> Block:
    """Operations at random."""
    f = _random_function(np.random.default_rng(seed), f"drawn{seed}")
    return make_block(
        f"drawn{seed}", "law", lambda x, u, p: ({}, {"y": f(u["u"])}), doc="Drawn.",
        inputs=[Input("1", lo=-3, hi=3, shape=(4,)).named("u")],
        outputs=[Output("1", shape=(6,)).named("y")],
    )  # fmt: skip


def in_parts() -> Block:
    """Parts of several rates, one of them twice, and a law behind a gate."""
    return connect(
        "in_parts",
        {"one.u": "u", "two.u": "one.y", "slow.u": "two.y", "gate.u": "slow.y", "gate.on": "on",
         "y": "gate.y", "z": "one.y"},
        one=adds, two=adds.with_params(k=2.0), slow=every(rare, 4, 1), gate=gated(adds),
    )  # fmt: skip


@step(period=0.01, y=Output("1", "sum", lo=-9, hi=9))
def adds(s=State("1", 0.0, "kept", lo=-9, hi=9), u=Input("1", "given", lo=-1, hi=1),
         k=Param("1", 0.5, "share", lo=0, hi=4)):  # fmt: skip
    """Some of what was and of what comes."""
    return dict(s=0.9 * s + k * u), dict(y=s + u)


@step(period=0.04, y=Output("1", "sum", lo=-9, hi=9))
def rare(s=State("1", 0.0, "kept", lo=-9, hi=9), u=Input("1", "given", lo=-1, hi=1)):
    """The same, less often."""
    return dict(s=0.8 * s + u), dict(y=s - u)


def predictive(**options: Any) -> Block:
    """A small predictive controller."""
    return nmpc(cart, wish, "F", h=0.1, horizon=5, weights={"e": 3.0, "f": 0.1}, **options)


EKF = {"prior": {"x": 1.0, "v": 0.5, "m": 0.1}, "noise": 1e-4,
       "drift": {"x": 0.0, "v": 1e-2, "m": 1e-3}, "period": 0.01}  # fmt: skip

MADE: dict[str, Callable[[], Block]] = {
    **{n: (lambda b=b: b) for n, b in BLOCKS.items()},
    "curve": lambda: curve, "alone": lambda: alone, "bounded": lambda: bounded,
    "careful": lambda: careful, "guarded": lambda: guarded, "products": lambda: products,
    "wave": lambda: wave, "lag": lambda: lag, "gain": lambda: gain, "sums": lambda: sums,
    "full": lambda: full, "reached": lambda: law, "pushed": lambda: pushed,
    "repeating": repeating, "long_names": lambda: long_names, "once": lambda: once,
    "part": lambda: part, "in_parts": in_parts, "whole": whole,
    "plant": lambda: sampled(cart, 0.01, "rk4", substeps=3),
    "stiff": lambda: sampled(cart, 0.01, "implicit_euler"),
    "rls": lambda: rls(subway_braking.double_exponential),
    "evolved": lambda: differential_evolution(
        hill, over="s", lo=0.01, hi=10.0, generations=6, generations_per_tick=2),
    "table": lambda: argmax_table(peaked, "s", "w", lo=0.1, hi=6.0, span=(0.0, 2.0), error=1e-2,
                                  conditions={"dry": {"a": 0.54}, "wet": {"a": 0.3}}),
    "ekf": lambda: ekf(cart, "x", ("x", "v", "m"), **EKF),
    "ctukf": lambda: ctukf(cart, "x", ("x", "v", "m"), **EKF),
    "nmpc": predictive,
    "nmpc_all": lambda: predictive(
        rates={"F": 9.0}, soft={"v": (-3.0, 3.0, 5.0, 1.0)}, hard={"x": (-9.0, 9.0)},
        preview=["v_ref"], moves=(1, 1, 3), split=True),
    "mhe": lambda: mhe(cart, "x", 1e-4, {"x": 1.0, "v": 0.5}, drift={"x": 0.0, "v": 0.1},
                       samples=5, period=0.01),
    "adds": lambda: adds, "drawn1": lambda: drawn(1),
    "drawn2": lambda: drawn(2), "drawn3": lambda: drawn(3),
}  # fmt: skip
"""Block by name; each is made once."""

ASKED: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    **{n: (n, {}, {}) for n in MADE},
    **{f"{n} in float": (n, {"real": "float"}, {})
       for n in ("part", "careful", "tables", "evolved", "long_names", "once", "table", "drawn1",
                 "bounded", "loops", "nmpc_all")},
    "rates": ("whole", {"rates": True}, {}),
    "rates in float": ("whole", {"rates": True, "real": "float"}, {}),
    "rates of parts": ("in_parts", {"rates": True}, {}),
    "another name": ("law", {"name": "other", "period": 0.004}, {}),
    "bus": ("part", {}, {"scaled": SCALED}),
    "bus in float": ("part", {"real": "float"}, {"scaled": SCALED}),
    "sections": ("curve", {}, {"const_section": ".tables", "calibration_section": ".cal"}),
    "sections of tables": ("tables", {}, {"const_section": ".tables"}),
    "xcp": ("careful", {"period": 1e-3}, {"with_xcp": True}),
    "autosar": ("part", {}, {"with_autosar": True}),
    "autosar of parts": ("in_parts", {"real": "float"}, {"with_autosar": True}),
}  # fmt: skip
"""What is written by name: of which block, how it is planned, what is asked of the texts."""

FOLDERS: dict[str, dict[str, Any]] = {
    "lag": {"inputs": {"u": np.linspace(-3, 3, 40)}},
    "part": {"period": 0.002},
    "adds": {},
    "plant": {"params": {"m": 3.0}},
}
"""Whose folders are made whole, and with what: in plain arithmetic, the same everywhere."""
