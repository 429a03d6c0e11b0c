"""Physics of the subway models: peaks, steady slip, sliding orbits and the arbitration.

What is wrong in print is in test_errata.py.
"""

import math

import numpy as np
import pytest
from conftest import BEST, closed_loop, three_rails
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    flow,
    operating_point,
    sampled,
    simulate,
)
from slipctl.models import brakes, sensors
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.huang_2020 import subway_braking_control as control

J, R = 240.0, 0.5


# ---- adhesion and wheel -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rail", "location", "height"),
    [
        ("dry", 1.2098601, 0.286172), ("wet", 1.2098601, 0.29 * 0.286172),
        ("ice", 1.2098601, 0.0286172), ("dry_moving", 1.2099, 0.286172),
        ("wet_moving", 1.8148, 0.29 * 0.286172), ("ice_moving", 2.4197, 0.0286172),
    ],
)  # fmt: skip
def test_peaks_of_the_rails(rail, location, height):
    """Places and heights as in the issue's tables, to half a unit of their last digit."""
    p = subway.double_exponential.conditions[rail]
    best = float(subway.peak_slip(**p))
    assert best == pytest.approx(location, abs=5e-8 if "moving" not in rail else 5e-5)
    assert subway.double_exponential(v_s=best, **p)["mu"] == pytest.approx(height, rel=2e-6)
    slope = subway.double_exponential.jacobian("mu", "v_s")(best, p["c"], p["a"], p["b"])
    assert float(slope) == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("torque", [2e3, 6e3, 10e3])
def test_a_held_torque_settles_at_its_steady_slip(torque):
    """The slip that a run comes to is the one where v_s' = 0, T = r F + (J/(r m)) (F + f + W)."""
    plant = sampled(subway.plant(), 1e-3)
    run = simulate(plant, Scenario("s", 1.0, inputs={"T_cmd": torque}))
    v, slip = float(run["wheel.v"][-1]), float(run["wheel.v_s"][-1])
    point = operating_point(
        subway.plant(), {"v": v, "T_cmd": torque}, {"omega": 2 * v}, steady=["wheel.v_s"]
    )
    # the slip follows v, which falls by 2.6 m/s each second and moves it by 1e-4 m/s per m/s
    assert slip == pytest.approx(point.outputs["wheel.v_s"], rel=1e-4)
    m, mu, f = 8000.0, point.outputs["adh.mu"], point.outputs["air.f"]
    F = mu * m * 9.81
    assert torque == pytest.approx(R * F + J / (R * m) * (F + f), rel=1e-9)


def test_beyond_the_peak_the_wheel_locks_and_stays_locked():
    """A brake holds a wheel and cannot turn it backwards: omega within the fade of omega_0."""
    plant = sampled(subway.plant(), 1e-4)
    run = simulate(plant, Scenario("s", 3.0, inputs={"T_cmd": 14e3}))
    omega = run["wheel.omega"].values
    assert omega.min() > -0.1
    assert (np.abs(omega[-10000:]) < 0.1).all()
    assert float(run["wheel.v"][-1]) > 5


def test_curve_resistance_is_in_newtons_and_bounded():
    """600/R N/kN on the share of the train in the curve: 58.9 N at 800 m, 117.7 N at 400 m, 8 t."""
    curve = subway.curve_resistance()
    assert curve(kappa=1 / 800)["W"] == pytest.approx(58.9, abs=0.05)
    assert curve(kappa=1 / 400)["W"] == pytest.approx(117.7, abs=0.05)
    assert curve(kappa=1 / 400, l_r=68.0)["W"] == pytest.approx(117.72 / 2, rel=1e-12)
    assert curve(kappa=1 / 400, l_r=1e6) == curve(kappa=1 / 400, l_r=136.0)


@given(st.floats(-1e5, 1e5), st.floats(1e3, 4e4))
def test_a_brake_cannot_drive_and_has_a_limit(command, limit):
    assert brakes.brake()(T_cmd=command, T_max=limit)["T_b"] == min(max(command, 0.0), limit)
    lagging = brakes.brake(lag=True)
    rate, _ = lagging(T_b=limit / 2, T_cmd=command, T_max=limit)
    assert rate["T_b"] == pytest.approx((min(max(command, 0), limit) - limit / 2) / 0.05, rel=1e-12)


# ---- sliding orbits on the ideal integrator -----------------------------------------------------


@flow(s=Output("m/s"), name="integrator")
def integrator(
    s=State("m/s", 0.0),
    phi=State("m/s^2", 0.0, "disturbance"),
    T=Input("N m"),
    T_eq=Input("N m"),
    slope=Input("m/s^3", value=0.0),
    J=Param("kg m^2", J),
    r=Param("m", R),
):
    """s' = (r/J)(T - T_eq) + phi, phi' = slope: what is left of (36) when Phi is known."""
    return dict(s=(r / J) * (T - T_eq) + phi, phi=slope), dict(s=s)


def sliding(law: Block, T: float, seconds: float, slope=0.0, start=0.0, phi=0.0, **params):
    """Run of a slip law on the integrator; the torque has room on both sides of T_eq."""
    wires = {"law.v_s": "plant.s", "law.v_ref": "zero", "law.T_eq": "T_eq", "plant.T_eq": "T_eq",
             "plant.T": "law.T_wanted"}  # fmt: skip
    plant = sampled(integrator, T)
    inputs = {"zero": 0.0, "T_eq": 1e6, "slope": slope}
    if "T_top" in law.inputs:
        inputs["T_top"] = 2e6
        params["T"] = T
    loop = connect("loop", wires, plant=plant, law=law.with_params(**params))
    begin = {"plant.s": start, "plant.phi": phi}
    if "u_sw" in law.states:
        begin["law.u_sw"] = -phi
    return simulate(loop, Scenario("s", seconds, inputs=inputs, start=begin))["plant.s"].values


@pytest.mark.parametrize(("T", "amplitude"), [(1e-3, 6.11e-3), (16e-3, 0.135)])
def test_orbit_of_the_reaching_law(T, amplitude):
    """Period 2 with |s| = T g2/(2 - T g1), from any start; 6.11e-3 m/s at 1 ms, 0.135 at 16 ms.

    s+ = (1 - T g1) s - T g2 sgn s; the orbit attracts by 1 - T g1 = 0.964 per tick at 1 ms.
    """
    g1, g2 = 36.0, 12.0
    exact = T * g2 / (2 - T * g1)
    assert exact == pytest.approx(amplitude, abs=0.005 * 10 ** math.floor(math.log10(amplitude)))
    for start in (0.3, -0.011):
        s = sliding(control.reaching_law(), T, 2.0, start=start)
        # 1e6 N m carries 1e-10 N m of rounding, 2e-13 m/s^2
        assert np.abs(s[-50:]) == pytest.approx(exact, rel=1e-9)
        assert (np.sign(s[-50:-1]) == -np.sign(s[-49:])).all()


def test_torque_ripple_of_the_reaching_law_in_the_loop():
    """2 g2 J/r = 11 520 N m peak to peak on dry rail, whatever the period."""
    run = simulate(closed_loop(control.reaching_law()), three_rails(6.0))
    torque = run["plant.brake.T_b"].values
    dry = np.ptp(torque[1500:2000])
    # the wheel answers within the tick: F moves by F'(v_s) times the slip band, 2 % of the ripple
    assert dry == pytest.approx(2 * 12 * J / R, rel=0.03)


@pytest.mark.parametrize(("k1", "k2"), [(20.0, 10.0), (2000.0, 1.5)])
@pytest.mark.parametrize("T", [1e-3, 16e-3])
def test_orbit_of_explicit_super_twisting(k1, k2, T):
    """Period 2 with |s| = T^2 ((k1 + sqrt(k1^2 - 4 k2))/4)^2, near (T k1/2)^2 for k1^2 >> 4 k2.

    Printed gains: 1.000 m/s at 1 ms and 256 m/s at 16 ms.
    """
    exact = (T * (k1 + math.sqrt(k1**2 - 4 * k2)) / 4) ** 2
    assert exact == pytest.approx((T * k1 / 2) ** 2, rel=2.1 * k2 / k1**2 + 1e-12)
    law = control.super_twisting().with_params(k1=k1, k2=k2)
    wires = {"law.v_s": "plant.s", "law.v_ref": "zero", "law.T_eq": "T_eq", "plant.T_eq": "T_eq",
             "plant.T": "law.T_wanted"}  # fmt: skip
    loop = connect("loop", wires, plant=sampled(integrator, T), law=law.with_params(T=T))
    inputs = {"zero": 0.0, "T_eq": 1e8, "law.T_top": 2e8}
    begin = {"plant.s": exact, "law.u_sw": T * k2 / 2}
    run = simulate(loop, Scenario("s", 60 * T, inputs=inputs, start=begin))
    s = run["plant.s"].values
    # torque of 1e8 N m carries 1e-8 N m of rounding, 3e-11 m/s^2, over 60 ticks
    assert np.abs(s) == pytest.approx(exact, rel=1e-6, abs=1e-10)
    assert (np.sign(s[:-1]) == -np.sign(s[1:])).all()


@pytest.mark.parametrize("e", [0.0, 1e-3, 2.5e-3, 4e-3])
def test_explicit_super_twisting_has_a_family_of_orbits(e):
    """Orbits s = a^2, -b^2 with a - b = e, none of which is preferred: 182.3 to 173.8 N m here.

    From a^2 + b^2 = c a - T d = c b + T (d - T k2), c = T k1, d the integral less what it holds,
    p = a + b solves p^2 - c p + e^2 + T^2 k2 = 0; the torque jumps by (J/r)(k1 p - T k2).
    """
    T, k1, k2 = 1e-3, 20.0, 10.0
    c = T * k1
    p = (c + math.sqrt(c**2 - 4 * (e**2 + T**2 * k2))) / 2
    a, b = (p + e) / 2, (p - e) / 2
    d = (T * k2 + c * e / T) / 2
    held = 3.0  # disturbance that the integral holds
    found = {}
    for start in (a**2, 1.01 * a**2):  # the orbit attracts
        law = control.super_twisting()
        wires = {"law.v_s": "plant.s", "law.v_ref": "zero", "law.T_eq": "T_eq",
                 "plant.T_eq": "T_eq", "plant.T": "law.T_wanted"}  # fmt: skip
        loop = connect("loop", wires, plant=sampled(integrator, T), law=law)
        begin = {"plant.s": start, "plant.phi": -held, "law.u_sw": held + d}
        inputs = {"zero": 0.0, "T_eq": 1e6, "law.T_top": 2e6}
        run = simulate(loop, Scenario("s", 0.2, inputs=inputs, start=begin))
        found[start] = run["plant.s"].values[-2:], np.ptp(run["law.T_wanted"].values[-2:])
    for s, jump in found.values():
        assert s == pytest.approx([a**2, -(b**2)], rel=1e-6)
        assert jump == pytest.approx(J / R * (k1 * p - T * k2), rel=1e-6)


def slopes(kind: str, L: float, T: float, seconds: float):
    """Slope of the disturbance: a ramp, a triangle, or +-L at random each tick."""
    n = round(seconds / T)
    rng = np.random.default_rng(3)
    sign = {
        "ramp": np.ones(n),
        "triangle": np.where(np.arange(n) // 40 % 2, -1.0, 1.0),
        "random": rng.choice([-1.0, 1.0], n),
    }[kind]
    return lambda t: L * sign[: len(t)]


@pytest.mark.parametrize("kind", ["ramp", "triangle", "random"])
@pytest.mark.parametrize("T", [1e-3, 16e-3])
def test_proper_implicit_super_twisting_slides_within_L_T_squared(T, kind):
    """Best possible in the worst case: |s| <= L T^2 for |phi'| <= L = 9 < k2 = 10 m/s^3.

    In sliding s(k+1) is T times the change of the disturbance's mean from tick to tick, so a ramp
    reaches the bound. Seeber and Andritsch, Automatica 173 (2025).
    """
    L, seconds = 9.0, 400 * T
    law = control.super_twisting(discretisation="proper_implicit")
    s = sliding(law, T, seconds, slope=slopes(kind, L, T, seconds), phi=2.0)
    bound = L * T**2
    assert np.abs(s).max() <= bound * (1 + 1e-6)  # rounding of 1e6 N m: 2e-13 m/s^2 over a tick
    if kind != "random":
        assert np.abs(s[50:]).max() == pytest.approx(bound, rel=1e-6)


def test_orders_of_the_sliding_error_in_the_period():
    """Slopes in log-log against T: 2 for both forms of super-twisting, 1 for the reaching law."""
    periods = [1e-3, 2e-3, 4e-3]
    laws = {
        "reaching": (control.reaching_law(), 1.0),
        "explicit": (control.super_twisting(), 2.0),
        "proper": (control.super_twisting(discretisation="proper_implicit"), 2.0),
    }
    for name, (law, order) in laws.items():
        seconds = [600 * T for T in periods]
        errors = [
            np.abs(sliding(law, T, n, slope=slopes("triangle", 5.0, T, n), start=T**2)[300:]).max()
            for T, n in zip(periods, seconds, strict=True)
        ]
        found = np.polyfit(np.log(periods), np.log(errors), 1)[0]
        # explicit: which of its orbits it falls into differs with T; reaching: 2 - T g1
        assert found == pytest.approx(order, abs={"proper": 1e-3}.get(name, 0.3)), name


def test_super_twisting_ripples_less_in_the_loop():
    """Torque ripple in steady slip, beside the reaching law: 50 times less on dry and wet."""
    runs = {
        n: simulate(closed_loop(law), three_rails(6.0))["plant.brake.T_b"].values
        for n, law in {"smc": control.reaching_law(), "sta": control.super_twisting()}.items()
    }
    for end, factor in ((2000, 50), (4000, 50), (6000, 35)):
        ripple = {n: np.ptp(T[end - 500 : end]) for n, T in runs.items()}
        assert ripple["smc"] > factor * ripple["sta"]


# ---- arbitration --------------------------------------------------------------------------------


@given(st.floats(-4e4, 4e4), st.floats(0, 30), st.floats(0, 3), st.floats(0, 5e3))
def test_arbitration_is_the_smaller_torque_and_never_drives(wanted, v, a, f):
    """T_b = min(demand, slip control), between 0 and T_max; below v_off the demand up to T_low."""
    y = control.arbitration(T_wanted=wanted, v=v, a_demand=a, f_hat=f)
    demand = R * (8000 * a - f) + J * a / R
    top = max(0.0, min(demand, 20e3 if v >= 1 else 4e3))
    assert y["T_top"] == pytest.approx(top, rel=1e-12, abs=1e-9)
    least = min(top, max(0.0, wanted)) if v >= 1 else top
    assert y["T_b"] == pytest.approx(least, rel=1e-12, abs=1e-9)


def test_hand_over_is_bumpless():
    """A demand that rises through the wish of slip control: the integral sleeps until then.

    The torque never moves by more than the faster of the two wishes, and that is 1 % of it.
    """
    scenario = three_rails(
        1.5, rail=None, inputs={"v_opt": BEST, "a_demand": lambda t: 0.5 + 3.0 * t}
    )
    law = control.super_twisting(discretisation="proper_implicit")
    run = simulate(closed_loop(law), scenario)
    torque, wish = run["ctl.T_b"].values, run["ctl.law.T_wanted"].values
    demand, integral = run["ctl.arbitration.T_top"].values, run["ctl.law.u_sw"].values
    rules = int(np.argmax(torque < demand))  # first tick of slip control
    assert (torque[:rules] == demand[:rules]).all()
    assert (torque[rules:] == wish[rules:]).all()
    assert not integral[: rules + 1].any()
    steps = np.maximum(np.abs(np.diff(wish)), np.abs(np.diff(demand)))[rules - 1 :]
    assert (np.abs(np.diff(torque))[rules - 1 :] <= steps * (1 + 1e-12)).all()
    assert steps.max() < 0.01 * torque.max()


@pytest.mark.parametrize(("rail", "awake"), [("dry", False), ("wet", False), ("ice", True)])
def test_demand_of_0_8_wakes_slip_control_on_ice_only(rail, awake):
    """0.8 m/s^2 needs mu = 0.08: dry offers 0.29, wet 0.083, ice 0.029; also an empty car."""
    for mass in (5500.0, 8000.0):
        heights = subway.TABLE_1[rail]
        loop = closed_loop().with_params(
            **{f"plant.adh.{k}": v for k, v in heights.items()}, **{"plant.m": mass}
        )
        run = simulate(loop, Scenario("s", 5.0, inputs={"v_opt": BEST, "a_demand": 0.8}))
        held = run["ctl.T_b"].values[100:] < run["ctl.arbitration.T_top"].values[100:] - 1e-9
        expected = awake or (mass < 8000 and rail == "wet")  # an empty car needs 45 % more mu
        assert held.any() == expected
        assert float(run["plant.wheel.v_s"].max()) < 1.5


def test_every_block_of_the_models_has_consistent_units():
    blocks = [
        closed_loop(law, lag)
        for law in (control.reaching_law(), control.super_twisting(),
                    control.super_twisting(discretisation="proper_implicit"))
        for lag in (False, True)
    ]  # fmt: skip
    blocks += [sensors.tooth_wheel, sensors.speed_sensor, sensors.slip_sensor, integrator]
    for block in blocks:
        assert block.check_units() == []


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: subway.wheelset("printed"), "wheelset has no form 'printed'; it has consistent, "),
        (lambda: subway.curve_resistance("x"), "curve_resistance has no form 'x'"),
        (lambda: control.super_twisting(gains="big"), "super_twisting has no gains 'big'"),
        (
            lambda: subway.plant(adhesion=control.reaching_law()),
            "plant: adh has no input 'v_s'|adh",
        ),
    ],
)
def test_unknown_forms_are_refused(make, words):
    with pytest.raises(BadInput, match=words):
        make()
