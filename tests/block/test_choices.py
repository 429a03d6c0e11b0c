"""Whole numbers, what is true or not, and choices: declared, set by name, told, refused."""

import casadi as ca
import pytest

from slipctl import BadInput, Input, Output, Param, State, simulate, step
from slipctl.draw import show
from slipctl.run.rail import Scenario

PHASES = ("apply", "hold", "release")


@step(period=1e-3, at=Output("enum", "phase", values=PHASES, safe="release"))
def valve(
    phase=State("enum", "hold", "phase", values=PHASES),
    ticks=State("int", 3, "ticks", lo=0, hi=10),
    on=Input("bool", "switch", value=1),
    first=Param("enum", "apply", "phase after hold", values=PHASES),
):
    """A valve that goes round."""
    after = ca.if_else(phase == 1, first, ca.if_else(phase == 0, 2, 1))
    after = ca.if_else(on, after, phase)
    return dict(phase=after, ticks=ca.fmin(ticks + 1, 10)), dict(at=phase)


def test_names_are_numbers():
    assert float(valve.start()["phase"]) == 1
    assert float(valve.start(phase="release")["phase"]) == 2
    assert float(valve.with_params(first="hold").param_values()["first"]) == 1
    assert valve.outputs["at"].safe == 2
    log = simulate(valve, Scenario("s", 4e-3))
    assert list(log["at"].values) == [1, 0, 2, 1]
    off = simulate(valve, Scenario("s", 4e-3, inputs={"on": 0.0}, start={"phase": "apply"}))
    assert list(off["at"].values) == [0, 0, 0, 0]


def test_they_are_told():
    assert "0 apply, 1 hold, 2 release" in show.text(valve)
    assert valve.outputs["at"].meanings == "0 apply, 1 hold, 2 release"
    assert valve.inputs["on"].values == ("no", "yes")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: State("enum", 0, "phase"), 'phase: an enumeration has two names or more, each'),
        (lambda: State("enum", 0, "phase", values=("a", "a")), "two names or more, each once"),
        (lambda: State("enum", 0, "phase", values=("a", "b c")), "two names or more, each once"),
        (lambda: State("enum", "hod", "phase", values=PHASES), "no value 'hod'; did you mean 'hol"),
        (lambda: Input("enum", "phase", values=PHASES, lo=0), "its values are its range"),
        (lambda: Param("int", 1, "n", values=PHASES), 'values are those of "enum"'),
        (lambda: Param("bool", 1, "n", values=PHASES), '"bool" is no or yes'),
        (lambda: Param("int", 1.5, "n"), "n is 1.5; it must be a whole number"),
        (lambda: Output("enum", "phase", values=PHASES, safe="x"), "has no value 'x'"),
        (lambda: valve.with_params(first="aply"), "valve.first has no value 'aply'; did you mean"),
        (lambda: valve.with_params(first=0.5), "whole number, one of apply, hold, release"),
        (lambda: valve.with_params(first=7), "valve.first = 7"),
        (lambda: valve.start(ticks=1.5), "it must be a whole number"),
    ],
)  # fmt: skip
def test_what_is_no_choice_is_refused(make, said):
    with pytest.raises(BadInput) as told:
        make()
    assert said in str(told.value)
    assert "\n" not in str(told.value)
