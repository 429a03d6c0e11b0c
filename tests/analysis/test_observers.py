"""Luenberger observers: placed poles, printed gains that are refused, lag on a ramp."""

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Scenario,
    State,
    flow,
    linear,
    luenberger,
    sampled,
    simulate,
)
from slipctl.analysis import observers


@flow(w=Output("rad/s", "speed"), h=Output("N m", "load"))
def shaft(
    omega=State("rad/s", 0.0, "speed"),
    T_L=State("N m", 0.0, "load torque"),
    T_m=Input("N m", "motor torque", value=0.0),
    J=Param("kg m^2", 40.0, "inertia", lo=0.1),
):
    return dict(omega=(T_m - T_L) / J, T_L=0 * T_L / J * 1.0), dict(w=omega, h=T_L)


@flow(y=Output("1", "value"))
def bent(x=State("1", 1.0, "value"), k=Param("1/s", 1.0, "rate")):
    return dict(x=-k * x**2), dict(y=x)


def poles_of(block):
    return linear(block, dict.fromkeys(block.inputs, 0.0)).poles()


@given(p=st.floats(1.0, 300), ratio=st.floats(1.0, 5), J=st.floats(0.5, 500))
def test_gains_are_those_of_the_spec(p, ratio, J):
    """s^2 + L1 s - L2/J: a double pole gives L1 = 2p, L2 = -p^2 J."""
    block = luenberger(shaft.with_params(J=J), [-p, -p * ratio], measured="w")
    found = block.param_values()
    assert float(found["L_omega"]) == pytest.approx(p * (1 + ratio), rel=1e-6)
    assert float(found["L_T_L"]) == pytest.approx(-p * p * ratio * J, rel=1e-6)


def test_poles_of_the_observer_block():
    block = luenberger(shaft, [-40, -40], measured="omega")
    poles = poles_of(block)
    assert poles.real == pytest.approx([-40, -40], rel=1e-5)
    assert block.check_units() == []
    assert block.params["L_T_L"].unit
    pair = luenberger(shaft, [-3 + 4j, -3 - 4j], measured="w")
    assert sorted(poles_of(pair).imag) == pytest.approx([-4, 4])


def test_several_measured_signals():
    block = luenberger(shaft, [-5, -7])
    poles = poles_of(block)
    assert sorted(poles.real) == pytest.approx([-7, -5])
    assert {"L_omega_w", "L_omega_h", "L_T_L_w", "L_T_L_h"} <= set(block.params)


def test_ramp_of_the_load_is_seen_late_by_two_over_p():
    """Steady lag 2/p of a double pole: 50 ms for p = 40."""
    rate, h = 100.0, 1e-3
    observer = sampled(luenberger(shaft, [-40, -40], measured="w"), h)
    t = np.arange(round(1.0 / h)) * h
    speed = np.interp(t, t, -rate * t**2 / 2 / 40)
    feed = {"w_measured": list(zip(t, speed, strict=True))}
    run = simulate(observer, Scenario("ramp", 1.0, inputs=feed))
    lag = (rate * t - run["T_L_hat"].values)[-1] / rate
    assert lag == pytest.approx(2 / 40, rel=0.02)


@pytest.mark.parametrize(
    ("gains", "said"),
    [((-40.0, -40.0), r"pole 39\.97 1/s, which is unstable"),
     ((40.0, -40.0), r"pole -0\.02502 1/s, slower than slowest=1"),
     ((40.0, 40.0), r"pole 0\.02498 1/s, which is unstable")],
)  # fmt: skip
def test_printed_gains_are_refused_with_their_pole(gains, said):
    """L1, L2 = -40 of paper 004, J = 40, in each reading of the signs."""
    given = {"L_omega": gains[0], "L_T_L": gains[1]}
    with pytest.raises(BadInput, match=said):
        luenberger(shaft, gains=given, measured="w")
    shown = luenberger(shaft, gains=given, measured="w", check=False)
    A = np.array([[-gains[0], -1 / 40], [-gains[1], 0]])
    assert sorted(poles_of(shown).real) == pytest.approx(sorted(np.linalg.eigvals(A).real))


def test_what_is_refused():
    refused = [
        (dict(poles=[1, -2], measured="w"), "pole 1 1/s, which is unstable"),
        (dict(poles=[-0.5, -2], measured="w"), "pole -0.5 1/s, slower"),
        (dict(poles=[-2], measured="w"), "1 poles for 2 states"),
        (dict(poles=[-2 + 1j, -2], measured="w"), "conjugate pairs"),
        (dict(poles=[-2, -3], measured="T_L"), "do not show all of omega, T_L"),
        (dict(poles=[-2, -3], measured="v"), "no signal 'v'"),
        (dict(measured="w"), "either poles= or gains="),
        (dict(gains={"L_omega": 1.0}, measured="w"), "give the gain L_T_L"),
        (dict(gains={"L_x": 1.0}, measured="w"), "no gain 'L_x'"),
    ]
    for options, said in refused:
        with pytest.raises(BadInput, match=said):
            luenberger(shaft, **options)
    with pytest.raises(BadInput, match=r"equation of x is not linear"):
        luenberger(bent, [-2])
    with pytest.raises(BadInput, match="only a flow"):
        luenberger(sampled(shaft, 1e-3), [-2, -3])


def test_python_control_places_the_same():
    A, C = np.array([[0, -1 / 40], [0, 0.0]]), np.array([[1.0, 0]])
    L = control.place(A.T, C.T, [-30, -50]).T
    found = luenberger(shaft, [-30, -50], measured="w").param_values()
    assert [float(found["L_omega"]), float(found["L_T_L"])] == pytest.approx(L.ravel())


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_gains_of_one_measured_signal_are_those_of_python_control_to_the_bit(n: int) -> None:
    """Ackermann's formula is written here, so that no loop waits for python-control to load."""
    rng = np.random.default_rng(n)
    A, C = rng.normal(size=(n, n)), rng.normal(size=(1, n))
    poles = -rng.uniform(1, 400, n)
    found = observers._placed("here", shaft, A, C, list(poles))
    assert np.array_equal(found, np.atleast_2d(control.acker(A.T, C.T, poles)).T)
