"""Slopes through the active set against central differences and IPOPT, and where there are none."""

import numpy as np
import pytest
from casadi import floor

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    control_slopes,
    run_slopes,
    sampled,
    step,
)
from slipctl.studies.predictive.slip_problem import axle, make

POINT = dict(v=10.0, q=10.2, T=7.2, xi=0.0, mu_p=0.3, s_ref=0.02)
NUMBERS = ["mu_p", "s_ref", "T", "plant.J", "weight_e_s", "u_hi"]

CASES = {
    "free": (dict(iterations=12), {}, None),
    "bound": (dict(iterations=3), dict(T=6.0), {"u_hi": 1.0}),
    "rate": (dict(iterations=3, rates={"u": 20.0}), {}, {}),
    "soft": (dict(iterations=3, soft={"s": (-0.1, 0.012, 300.0)}), {}, None),
    "hard": (dict(iterations=8, hard={"s": (-0.1, 0.0205)}), dict(s_ref=0.0225), None),
}


@pytest.mark.parametrize(("options", "given", "follows"), CASES.values(), ids=CASES)
def test_slopes_of_a_control_are_central_differences(options, given, follows):
    """1e-6: rounding of a difference over two millionths; at a bound it follows that alone."""
    found = control_slopes(make(horizon=8, **options), NUMBERS, **(POINT | given))
    assert found.doubtful == ()
    assert max(found.apart.values()) < 5e-6
    if follows is None:
        assert abs(found.of["u"]["mu_p"]) > 10
    else:
        assert found.of["u"] == pytest.approx(dict.fromkeys(NUMBERS, 0.0) | follows)


@pytest.mark.second
def test_slopes_at_the_end_of_the_iterations_are_those_of_the_optimum():
    """Differences of IPOPT's controls, 1e-8 of its conditions over 2e-3."""
    exact = control_slopes(make(horizon=8, iterations=12), ["mu_p", "T"], **POINT).of["u"]
    ipopt = make(horizon=8, solver="ipopt")
    for n, h in (("mu_p", 1e-3), ("T", 1e-3)):
        u = [ipopt(**(POINT | {n: POINT[n] + e}))[1]["u"] for e in (h, -h)]
        assert exact[n] == pytest.approx((u[0] - u[1]) / (2 * h), rel=1e-3)


def test_a_limit_that_holds_without_a_multiplier_is_told():
    """The bound is put where the control is without it: the slope is one of two."""
    free = make(horizon=8, iterations=12)
    at = free(**POINT)[1]["u"]
    found = control_slopes(free, ["mu_p"], **POINT, u_hi=at)
    assert found.doubtful == ("mu_p",)


def loop(**parts):
    """Controller and axle."""
    wires = {"ctl.v": "plant.v", "ctl.q": "plant.q", "ctl.T": "plant.T", "ctl.xi": "plant.xi"}
    wires |= {f"{part}.{n}": n for part in ("ctl", "plant") for n in ("mu_p", "s_ref")}
    parts = {"ctl": make(horizon=8), "plant": sampled(axle, 0.02, "rk4", 4)} | parts
    drive = {"plant.u": "dac.u", "dac.raw": "ctl.u"} if "dac" in parts else {"plant.u": "ctl.u"}
    return connect("loop", wires | drive, **parts)


SCENARIO = Scenario("go", 1.0, inputs={"mu_p": 0.3, "s_ref": 0.02})


@pytest.mark.second
def test_slopes_of_a_closed_loop_are_central_differences():
    """Through plan, active set and plant, 50 ticks; 1e-4: rounding of slopes of 3e-4."""
    names = ["ctl.weight_e_u", "ctl.plant.J", "plant.m_q"]
    found = run_slopes(loop(), SCENARIO, names)
    assert found.doubtful == ()
    assert max(found.apart.values()) < 1e-4
    assert np.abs(found.of["plant.s"]["ctl.weight_e_u"]).max() > 1e-4
    assert found.of["plant.v"]["plant.m_q"].shape == (50,)


@step(u=Output("kN m"))
def coarse(
    raw=Input("kN m", "torque"),
    step_=Param("kN m", 1e-7, "smallest step"),
    last=State("kN m", 0.0, "last"),
):
    """Torque in steps."""
    u = step_ * floor(raw / step_)
    return dict(last=u), dict(u=u)


@pytest.mark.second
def test_what_has_no_slope_is_refused_in_one_line():
    with pytest.raises(BadInput, match="something jumps") as error:
        run_slopes(loop(dac=coarse), SCENARIO, ["plant.m_q"])
    assert "\n" not in str(error.value)
    with pytest.raises(BadInput, match=r"'plant\.z' is no scalar parameter"):
        run_slopes(loop(), SCENARIO, ["plant.z"])
    with pytest.raises(BadInput, match="'z' is no scalar input or parameter"):
        control_slopes(make(horizon=4), ["z"], **POINT)
    with pytest.raises(BadInput, match="ends with status 3; only 0 has slopes"):
        control_slopes(make(horizon=8, hard={"s": (-0.1, 0.014)}), ["T"], **POINT)
