"""State machines against one that Python walks through, in C too; what is refused; the diagram."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput, Input, Param, State, simulate, state_machine
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.draw import show
from slipctl.run.rail import Scenario

STATES = ("apply", "hold", "release")
SIGNALS = {
    "v_s": Input("m/s", "slip speed", lo=-50.0, hi=100.0),
    "v_hold": Param("m/s", 0.5, "hold above", lo=0.0, hi=9.0),
    "v_release": Param("m/s", 1.0, "release above", lo=0.0, hi=9.0),
    "v_apply": Param("m/s", 0.3, "apply below", lo=0.0, hi=9.0),
}
TRANSITIONS = [
    ("apply", "release", "v_s > 2*v_release"),
    ("apply", "hold", "v_s > v_hold"),
    ("hold", "release", "v_s > v_release"),
    ("*", "apply", "not v_s > v_apply or v_s > 90*v_release"),
]
valve = state_machine("valve", STATES, TRANSITIONS, start="hold", period=1e-3, **SIGNALS)


def walked(speeds):
    """The same by hand: the first transition that holds, one a tick."""
    at, found = "hold", []
    for v in speeds:
        if at == "apply" and v > 2:
            at = "release"
        elif at == "apply" and v > 0.5:
            at = "hold"
        elif at == "hold" and v > 1:
            at = "release"
        elif v <= 0.3 or v > 90:
            at = "apply"
        found.append(STATES.index(at))
    return found


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from([0.1, 0.3, 0.4, 0.6, 1.5, 2.5, 91.0]), min_size=1, max_size=30))
def test_it_goes_where_a_walk_goes(speeds):
    x, found = np.array([1.0]), []
    for v in speeds:
        x, y = valve.f(x, [v], [0.5, 1.0, 0.3])[:2]
        found.append(float(y))
    assert found == walked(speeds)


def test_units_and_log():
    assert valve.check_units() == []
    feed = [(0.0, 0.6), (2e-3, 1.5), (3e-3, 0.2)]
    log = simulate(valve, Scenario("s", 4e-3, inputs={"v_s": feed}))
    assert list(log["state"].values) == [1, 1, 2, 0]


@pytest.mark.second
@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_c_of_it(tmp_path):
    speeds = np.random.default_rng(1).choice([0.1, 0.4, 0.6, 1.5, 2.5, 91.0], 400)
    report = codegen.export(valve, tmp_path, inputs={"v_s": speeds}, check=True)
    assert report.passed
    assert report.data["ticks"] == 400


def test_the_diagram_has_states_and_conditions():
    drawn = show.svg(valve)
    for said in (*STATES, "first", "v_s &gt; v_hold", "v_s &gt; 2*v_release"):
        assert said in drawn
    graph = show.graph(valve)
    assert '"apply" -> "hold" [label="v_s > v_hold"]' in graph
    assert graph.count('-> "apply"') == 2  # "*" leads from every other state


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"transitions": [("aply", "hold", "v_s > 1")]}, "'aply' is no state; did you mean 'apply"),
        ({"transitions": [("apply", "*", "v_s > 1")]}, "'*' is no state"),
        (
            {"transitions": [("hold", "hold", "v_s > 1")]},
            "leads back to its own state",
        ),
        ({"transitions": [("apply", "hold", "v_s + 1")]}, "is no condition; write a comparison"),
        ({"transitions": [("apply", "hold", "v > 1")]}, "'v' is unknown; it has v_s"),
        ({"transitions": [("apply", "hold", "v_s >")]}, "valve: apply -> hold: 'v_s >', column"),
        ({"transitions": [("apply", "hold")]}, "write (from, to, condition)"),
        ({"transitions": [("apply", "hold", 3)]}, "is no text"),
        ({"transitions": [("apply", "hold", "v_s > 1")]}, "no transition leads to 'apply'"),
        ({"start": "off"}, "has no value 'off'"),
        ({"values": ("apply",)}, "an enumeration has two names or more"),
        ({"v_s": 3.0}, "v_s is no signal"),
        ({"v_s": State("m/s")}, "v_s is no signal"),
        ({"state": Input("1")}, "state is its own"),
    ],
)
def test_what_is_no_machine_is_refused(change, said):
    given = {"values": STATES, "transitions": TRANSITIONS, "start": "hold", **SIGNALS} | change
    values, transitions = given.pop("values"), given.pop("transitions")
    with pytest.raises(BadInput) as told:
        state_machine("valve", values, transitions, **given)
    assert said in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_conditions_of_formulas_alone_bring_what_they_call(tmp_path):
    """The larger, the smaller, the sign and the size of numbers, which nothing else in it calls."""
    machine = state_machine(
        "chooser", ("low", "high", "off"),
        [("low", "high", "max(a, b) > 0.5 and sign(b) > 0"), ("high", "low", "min(a, b) < -0.5"),
         ("*", "off", "clip(a, -1, 1) > 0.9 and abs(b) > 1.5"),
         ("off", "low", "sqrt(abs(a)) < 0.4")],
        period=1e-3, a=Input("1", lo=-2, hi=2), b=Input("1", lo=-2, hi=2),
    )  # fmt: skip
    module = codegen.c_module(machine, tmp_path).compile().load()
    rng, at, seen = np.random.default_rng(1), "low", set()
    for a, b in rng.uniform(-2, 2, (150, 2)):
        if at == "low" and max(a, b) > 0.5 and b > 0:
            at = "high"
        elif at == "high" and min(a, b) < -0.5:
            at = "low"
        elif at != "off" and min(max(a, -1), 1) > 0.9 and abs(b) > 1.5:
            at = "off"
        elif at == "off" and abs(a) ** 0.5 < 0.4:
            at = "low"
        module.step(a=a, b=b)
        assert module.state["at"] == ("low", "high", "off").index(at)
        seen.add(at)
    assert len(seen) == 3
