"""What one gives to a public door stays one's own, and what is wrong with it is said in a line."""

from __future__ import annotations

import functools
import math

import casadi as ca
import numpy as np
import pytest
from calls import SCENARIO, T, car, hump, line, tick

import slipctl as sc
from slipctl import BadInput, Input, Output, State


def last(loop: sc.Block, scenario: sc.Scenario) -> float:
    return float(sc.simulate(loop, scenario, compile=False)["y"][-1])


@pytest.mark.parametrize("feed", [1.0, [(0.0, 1.0)], np.ones(5)])
def test_a_scenario_is_what_it_was_when_it_was_made(feed):
    """The same dictionary, list or array serves for the next one, with other values."""
    inputs, numbers = {"u": feed}, {"k": 1.0}
    made = SCENARIO.but(inputs=inputs, params=numbers)
    before = last(tick, made)
    if isinstance(feed, float):
        inputs["u"] = 5.0
    else:
        feed[0] = (0.0, 5.0) if isinstance(feed, list) else 5.0
    numbers["k"] = 7.0
    assert last(tick, made) == before


def test_what_is_given_to_a_declaration_may_change_later():
    values, places, wires = {"k": 1.0}, np.array([1.0, 2.0]), {"b.u": "a.y"}
    section = sc.Section(0, None, values)
    table = sc.Param("1", places, shape=(2,))
    loop = sc.connect("l", wires, a=tick, b=sc.unit_delay("m"))
    outputs = list(loop.outputs)
    values["k"], places[0], wires["q"] = 9.0, 9.0, "a.y"
    assert section.values == {"k": 1.0}
    assert list(table.value) == [1.0, 2.0]
    assert list(loop.with_params(**{"a.k": 2.0}).outputs) == outputs


def test_a_declaration_serves_for_two_functions():
    made = sc.law(name="both", y=Output("1"))
    assert [made(f).name for f in (lambda u=Input("1"): u, lambda u=Input("1"): 2 * u)] == [
        "both",
        "both",
    ]


def of_a_law(value):
    """A law that gives what a function gives."""
    return sc.law(name="f", y=Output("1"))(lambda u=Input("1"): value(u))


FAILING = {
    "rows": lambda u: (e for e in [u]),
    "object": lambda u: object(), "MX": lambda u: ca.MX.sym("q"), "free": lambda u: ca.SX.sym("q"),
}  # fmt: skip


@pytest.mark.parametrize("what", FAILING)
def test_equations_that_give_no_expression_of_their_signals_are_refused(what):
    with pytest.raises(BadInput, match=r"^f\b") as error:
        of_a_law(FAILING[what])(u=1.0)
    assert "\n" not in str(error.value)


def made(body, **more):
    return sc.make_block("b", "law", body, outputs=[Output("1").named("y")], **more)


@pytest.mark.parametrize(
    "call",
    [
        lambda: made(lambda x: 1)(),
        lambda: made(lambda x, u, p: {"y": 1})(),
        lambda: made(lambda x, u, p: (1, 2))(),
        lambda: made(lambda x, u, p: ({}, {"y": 1}), inputs=[Output("1").named("u")]),
        lambda: sc.flow(name="f")(lambda x=State("1"): (1, 2))(),
        lambda: sc.law(y=Output("1"))(int),
        lambda: sc.law(y=Output("1"))(None),
        lambda: sc.law(y=Output("1"))(hump),
        lambda: sc.law(y=Output("1"))(functools.partial(lambda u=Input("1"): u)),
        *(lambda n=n: made(lambda x, u, p: ({}, {n: 1}), params=[sc.Param("1", 1.0).named(n)])
          for n in ("", "a b", None, "a+b")),
        *(lambda n=n: sc.connect("l", {}, **{n: tick}) for n in ("", "a b", "a.b")),
        lambda: sc.Signal("place", "m"),
        lambda: sc.Input("m").as_role("place"),
        lambda: sc.Param("1", 1.0, shape=(10**9,)),
        lambda: tick[0],
        lambda: list(tick),
        lambda: sc.every(tick, True),
        lambda: sc.sampled(car, True),
        lambda: SCENARIO.but(seed=True),
        lambda: sc.ranged(tick, Output("m", hi=1).named("y"), y=Output("m", hi=2)),
        lambda: sc.interpolated(0.5, ["0", "1"], [0, 1]),
        lambda: sc.prepare(tick, SCENARIO, compile=False)(SCENARIO),
        lambda: sc.prepare(tick, SCENARIO, compile=False, runs=0),
        lambda: sc.End("x", below=math.nan),
        lambda: sc.End("x", below=-1.0),
        lambda: sc.End("x", above=math.inf),
        lambda: sc.Rail([sc.Section(0)]).at("x"),
        lambda: sc.luenberger(car, [-1, -2], measured=["x", "x"]),
        lambda: sc.ekf(car, "x", "v", prior=np.ones((3, 3)), noise=0.1, period=0.01),
        lambda: sc.peak_bound(hump, "v", 1.0, {"v": []}, 1e-3),
    ],
)  # fmt: skip
def test_what_means_nothing_is_refused_in_one_line(call):
    with pytest.raises(BadInput) as error:
        call()
    assert "\n" not in str(error.value)


ODD = {
    "a generator": lambda: (t for t in T), "texts": lambda: [str(t) for t in T],
    "a text": lambda: "1 2 3", "masked": lambda: np.ma.masked_array(T, T > 2),
    "complex": lambda: T + 1j, "dates": lambda: T.astype("M8[s]"), "nothing": list,
}  # fmt: skip


@pytest.mark.parametrize("what", ODD)
def test_samples_that_are_no_real_numbers_are_refused(what):
    """A masked number would be taken for a good one, of a complex one half be lost."""
    decay = sc.from_text("x' = -k*x where x = 1 m, k = 2 1/s")
    for call in (
        lambda x: sc.fit(hump, {"v": x, "mu": T}),
        lambda x: sc.fit_over_time(decay, {"time": T, "x": x}, "x", unknown=["k"]),
        lambda x: sc.identify(line, {"v": x, "mu": T}),
        lambda x: sc.peak_bound(hump, "v", 1.0, {"v": x}, 1e-3),
    ):
        with pytest.raises(BadInput, match=r"\b[vx]\b"):
            call(ODD[what]())
