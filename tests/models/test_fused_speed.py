"""Speed of a vehicle while all of its wheels slide, and what wheel sensors that fail cost."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from slipctl import BadInput, simulate
from slipctl.models.sensors import tooth_wheel
from slipctl.models.vehicle import (
    Constant,
    Exact,
    Lag,
    Sensors,
    SlideProtection,
    SlipLaw,
    SlipRatio,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)
from slipctl.models.vehicle.measurement.fused_speed import fused_speed, largest_wheel
from slipctl.models.vehicle.parts import (
    Accelerometer,
    Fused,
    LargestWheel,
    SensorFault,
    SlipControl,
    WheelsOnly,
)
from slipctl.models.vehicle.slip.takeover import turns
from slipctl.models.vehicle.wheels import bounded_speed
from slipctl.studies.leaf_fall.trains import RIVALS, trip
from tests.models.test_slide_protection import dry, train

R, G = 0.42, 9.81


def outputs(block, columns, start=None):
    """Outputs of a step over columns of its inputs, by name."""
    many = np.atleast_2d(next(iter(columns.values()))).shape[1]
    inputs = np.vstack([np.broadcast_to(columns.get(n, s.value), (max(s.size, 1), many))
                        for n, s in block.inputs.items()])  # fmt: skip
    x, p = (
        block.pack("state", block.start(**(start or {}))),
        block.pack("param", block.param_values()),
    )
    y = np.array(block.f.mapaccum(many)(x, inputs, ca.repmat(p, 1, many))[1])
    found, at = {}, 0
    for n, s in block.outputs.items():
        found[n] = y[at : at + s.size].squeeze()
        at += s.size
    return found


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 3), st.floats(0.05, 0.45), st.floats(5, 60))
def test_the_largest_wheel_leaves_the_truth_as_its_closed_form(a_max, a_true, v_0):
    """All wheels slide from the first tick on: (a_max - a) t too low, to rounding."""
    T, t = 0.01, 0.01 * np.arange(1, 201)
    v = v_0 - a_true * t
    block = largest_wheel(2).with_params(a_max=a_max, T=T, v_start=v_0, r=R, most=50.0)
    got = outputs(block, {"omega": np.zeros((2, 200)) - 1e3}, {"v_h": v_0})
    np.testing.assert_allclose(v - got["v_m"], (a_max - a_true) * t, atol=1e-9)
    assert (v - got["v_m"] <= got["error"]).all()
    # one wheel that rolls free gives the speed, and after it the bound is narrow again
    omega = np.vstack([np.zeros(200), v / R])
    np.testing.assert_allclose(outputs(block, {"omega": omega}, {"v_h": v_0})["v_m"], v, rtol=1e-12)
    back = np.zeros((2, 200)) - 1e3
    back[1, 100:] = v[100:] / R
    error = outputs(block, {"omega": back}, {"v_h": v_0})["error"]
    assert error[99] > 0.5 + 0.9 * a_max
    assert error[-1] < 0.5 + a_true * 1.0 + 1e-6


def slide(many, T, slip, seconds=10.0, mu=0.05, v_0=25.0):
    """Time, speed, acceleration and wheel speeds of a vehicle all of whose axles slide."""
    t = T * np.arange(round(seconds / T))
    a = np.full(len(t), -mu * G)
    v = v_0 + a * t
    s = np.minimum(8 * t, slip * v)  # the wheels run into the slide in half a second
    return v, a, np.tile((v - s) / R, (many, 1))


@pytest.mark.second
@pytest.mark.long
def test_ten_seconds_of_sliding_leave_the_speed_within_three_percent_and_its_bound():
    """200 seeds of bias and slope of .02 m/s^2: 99 % at least, by the closed form 99.7 %.

    A bias b leaves b t: .2 m/s of 20.1 m/s is one deviation, 3 % are three.
    """
    T, many = 5e-3, 4
    v, a, omega = slide(many, T, 0.15)
    block = fused_speed(many, 0.02, 1e-3, 0.02, T, 25.0).with_params(r=R, T=T)
    torque = np.full(omega.shape, 0.05 * R * 9500 * G)
    rng = np.random.default_rng(3)
    near, inside = 0, 0
    for _ in range(200):
        a_m = np.r_[0.0, a[:-1]] + 0.02 * rng.normal() + 0.02 * rng.normal(size=len(a))
        got = outputs(block, {"omega": omega, "torque": torque, "a": a_m})
        off = np.abs(got["v_m"] - v)
        near += bool((off < 0.03 * v).all())
        inside += bool((off <= got["error"]).all())
    assert near >= 198
    assert inside >= 198


def test_without_an_accelerometer_pads_that_differ_by_a_tenth_forbid_it():
    """An error d of the brake force is one of d mu g t: 3 % of 20.1 m/s is d = 12 %, 2.576 x 4.8 %.

    What the wheels' own estimate does with it: it moves by that, and says that it is not sound.
    """
    T, many = 1e-3, 4
    v, _, omega = slide(many, T, 0.15)
    assert 0.03 * v[-1] / (2.576 * 0.05 * G * 10) == pytest.approx(0.048, abs=5e-4)
    block = bounded_speed(many).with_params(v_start=25.0, r=R, m=9500.0 * many)
    ends = []
    for share in (0.9, 1.1):
        torque = np.full(omega.shape, share * 0.05 * R * 9500 * G)
        got = outputs(block, {"omega": omega, "torque": torque})
        assert (np.abs(got["v_m"] - v) <= got["error"]).all()
        assert got["sound"][-1] == 0
        ends.append(got["v_m"][-1])
    margin = 1 + float(block.param_values()["margin"])
    assert ends[0] - ends[1] == pytest.approx(0.2 * margin * 0.05 * G * 10, rel=0.02)


def band(v):
    """Error in m/s that ETCS allows a measured speed: 2 km/h up to 30, 12 km/h at 500 km/h."""
    return (2 + 10 * np.maximum(3.6 * np.abs(v) - 30, 0) / 470) / 3.6


@settings(max_examples=3, deadline=None)
@given(st.floats(1.0, 2.0), st.floats(0.1, 0.4), st.floats(30, 50))
def test_the_largest_wheel_leaves_the_band_of_etcs_when_its_closed_form_says(a_max, a_true, v_0):
    """R3: all wheels slide; the share outside, and the way by which it is short, are closed forms.

    The error is (a_max - a_true) t. It leaves the band of some 1.2 m/s after about a second.
    """
    T, t = 0.01, 0.01 * np.arange(1, 401)
    v = v_0 - a_true * t
    block = largest_wheel(2).with_params(a_max=a_max, T=T, v_start=v_0, r=R, most=50.0)
    short = v - outputs(block, {"omega": np.zeros((2, 400)) - 1e3}, {"v_h": v_0})["v_m"]
    rate, slope = a_max - a_true, 10 / 470
    leaves = float(band(v_0)) / (rate + slope * a_true)  # the band falls with the speed
    assert (short > band(v)).mean() == pytest.approx(1 - leaves / 4, abs=0.01)
    assert short.sum() * T == pytest.approx(rate * 4**2 / 2, rel=0.01)


@pytest.mark.second
@settings(max_examples=4, deadline=None, phases=[Phase.generate])
@given(st.floats(-0.005, 0.005), st.floats(-0.02, 0.02), st.integers(0, 2**31))
def test_wheels_of_other_diameters_that_roll_again_keep_the_speed_in_the_band(apart, bias, seed):
    """R2, R4, R5: 5 s of sliding, then a better rail; wheels of 100 teeth, one diameter is wrong.

    The speed is never lower than the true one by more than the band, and of wheels that roll free
    the largest one's error is its diameter's, and that of its teeth: a microsecond of the time
    between them, and what the speed falls in a tick.
    """
    T, many = 5e-3, 4
    v, a, omega = slide(many, T, 0.15)
    again = T * np.arange(len(v)) > 5
    omega[:, again] = (v / R)[again]
    omega[1] *= 1 + apart
    tooth = tooth_wheel.with_params(T=T, omega_start=omega[0, 0])
    angles = T * (np.cumsum(omega, axis=1) - omega[:, :1])
    omega = np.vstack([outputs(tooth, {"phi": phi})["omega_m"] for phi in angles])
    noise = 0.02 * np.random.default_rng(seed).normal(size=len(a))
    block = fused_speed(many, 0.02, 1e-3, 0.02, T, 25.0).with_params(r=R, T=T)
    torque = np.full(omega.shape, 0.05 * R * 9500 * G)
    got = outputs(block, {"omega": omega, "torque": torque, "a": a + bias + noise})
    assert (got["v_m"] > v - band(v)).all()
    assert (np.abs(got["v_m"] - v) <= got["error"] + 0.005 * v).all()
    block = largest_wheel(many).with_params(T=T, v_start=25.0, r=R, most=50.0)
    free = outputs(block, {"omega": omega}, {"v_h": 25.0})["v_m"][again]
    off = free / (v * (1 + max(apart, 0)))[again] - 1
    between = T - 2 * np.pi * R / 100 / v[-1]  # edges that are counted, at least
    assert np.abs(off[2:]).max() < 1e-6 / between + 0.05 * G * T / v[-1]


def test_a_wheel_that_rolls_free_teaches_the_speed_and_the_bias():
    T, many = 5e-3, 4
    v, a, omega = slide(many, T, 0.15)
    t = T * np.arange(len(v))
    free = (t > 6) & (t < 7)
    omega[2, (t > 6.2) & (t < 7)] = (v / R)[(t > 6.2) & (t < 7)]
    torque = np.full(omega.shape, 0.05 * R * 9500 * G)
    torque[2, free] = 0.0
    block = fused_speed(many, 0.1, 1e-3, 0.02, T, 25.0).with_params(r=R, T=T)
    got = outputs(block, {"omega": omega, "torque": torque, "a": a + 0.1})
    k = [int(s / T) for s in (5.9, 6.9, 9.9)]
    off = np.abs(got["v_m"] - v)
    assert off[k[0]] > 0.5  # .1 m/s^2 for 5.9 s
    assert off[k[1]] < 0.1
    assert off[k[2]] < 0.2
    assert got["filter.b"][k[2]] == pytest.approx(0.1, abs=0.03)
    assert (off <= got["error"]).all()
    assert got["error"][k[1]] < got["error"][k[0]] / 3


def test_axles_are_let_go_one_after_the_other_while_wheels_slide_and_not_else():
    block = turns(3).with_params(T=0.01, time=0.5, every_=2.0, T_max=1e3)
    full, part = np.full((3, 900), 1e3), np.full((3, 900), 1e3)
    part[1] = 500
    common = {"v": np.full(900, 20.0), "T_demand": np.full(900, 1e3)}
    assert not outputs(block, common | {"T_b": full})["free"].any()
    free = outputs(block, common | {"T_b": part})["free"]
    assert (free.sum(axis=0) <= 1).all()
    at = np.flatnonzero(np.diff(free.sum(axis=0), prepend=0) > 0)
    assert free[:, at].argmax(axis=0).tolist() == [2, 1, 0, 2][: len(at)]
    np.testing.assert_allclose(np.diff(at), 200, atol=3)
    np.testing.assert_allclose(free.sum() / len(at), 50, atol=2)
    assert not outputs(block, common | {"T_b": part, "v": np.full(900, 2.0)})["free"].any()


# ---- in the loop ---------------------------------------------------------------------------------


def end_of(made, name):
    found = case(made)
    loop = found.loops[name]
    log = simulate(loop, found.scenario, log=["plant.train.x", "plant.train.v"], every=20)
    assert log["plant.train.v"].values[-1] < 0.05
    return float(log["plant.train.x"].values[-1])


def sliding(speed, bias=0.0, let_go=1.0):
    fused = isinstance(speed, Fused)
    meter = Accelerometer(bias=bias, deviation=0.02) if fused else None
    return train(
        4, sensors=Sensors(wheel_speed=Exact(), vehicle_speed=speed, accelerometer=meter),
        control=SlipControl(period=0.01, let_go=let_go if fused else None),
        reference=SlipRatio(slip=0.15), controllers={"sta": SlipLaw(kind="sta")},
    )  # fmt: skip


@pytest.mark.long
def test_a_slip_that_is_held_on_all_axles_stops_as_with_the_true_speed():
    """4 axles, bias .05 m/s^2: 6 % longer at most. 8 axles, bias +-.1: 834.5, 833.3 for 824.1 m."""
    true = end_of(sliding(Exact()), "sta")
    assert end_of(sliding(Fused(), 0.05), "sta") < 1.06 * true


@pytest.mark.long
@pytest.mark.parametrize("bias", [0.05, -0.05])
def test_sixteen_axles_that_hold_a_slip_bear_a_bias(bias):
    """731.3 and 731.0 m for 725.6 m with the true speed: 3 % longer at most."""
    law = {"super_twisting": RIVALS["super_twisting"]}
    true = end_of(trip(16, patches=(), true_speed=True, rivals=law), "super_twisting")
    made = trip(16, patches=(), rivals=law)
    meter = Accelerometer(bias=bias, deviation=0.02)
    made = replace(made, sensors=replace(made.sensors, accelerometer=meter))
    assert end_of(made, "super_twisting") < 1.03 * true


@pytest.mark.second
@pytest.mark.parametrize(("kind", "speed"), [
    ("missing", Fused()),
    *(pytest.param(*pair, marks=pytest.mark.long) for pair in (
        ("frozen", Exact()), ("jumps", Fused()), ("frozen", LargestWheel()),
        ("missing", WheelsOnly()))),
], ids=lambda s: getattr(s, "kind", s))  # fmt: skip
def test_one_wheel_sensor_that_fails_costs_no_tenth_on_dry_rail_behind_valves(kind, speed):
    """336.6 m with none; the worst is 345.0 m."""
    meter = Accelerometer(bias=0.05, deviation=0.02) if isinstance(speed, Fused) else None
    sensors = Sensors(wheel_speed=Exact(), vehicle_speed=speed, accelerometer=meter,
                      faults=(SensorFault(axle=2, kind=kind, time=8.0, share=0.2),))  # fmt: skip
    made = dry(sensors=sensors, controllers={"wsp": SlideProtection()})
    assert 330 < end_of(made, "wsp") < 1.1 * 336.6


@pytest.mark.parametrize(("changes", "said"), [
    (dict(vehicle_speed=Fused()), "needs an accelerometer"),
    (dict(accelerometer=Accelerometer()), "no estimator uses it"),
])  # fmt: skip
def test_what_does_not_fit_is_refused(changes, said):
    with pytest.raises(BadInput, match=said):
        Sensors(**changes)


def test_a_fault_of_an_axle_that_is_not_there_is_refused():
    with pytest.raises(BadInput, match="is 5 of 4 axles"):
        dry(sensors=Sensors(faults=(SensorFault(axle=5),)))
    with pytest.raises(BadInput, match="more than half of let_go_every"):
        SlipControl(let_go=5.0)
    replace(dry(), control=SlipControl(let_go=1.0))


def test_a_sensor_may_fail_twice():
    """It freezes, then its pulses are missing: neither of both is left out; in any order."""
    faults = (SensorFault(axle=2, kind="missing", time=0.3), SensorFault(axle=2, time=0.1),
              SensorFault(axle=1, kind="jumps", share=0.5, time=0.2))  # fmt: skip
    made = Trip(
        duration=0.5, vehicle=Vehicle(mass=19e3, axles=2, inertia=100.0, speed=15.0),
        actuator=Lag(torque=5e3), demand=Constant(deceleration=0.8),
        rail=Track(sections=(Stretch(place=0.0, condition="dry"),)),
        sensors=Sensors(wheel_speed=Exact(), faults=faults), controllers={"pid": SlipLaw()},
    )  # fmt: skip
    found = case(made)
    names = ["plant.train.omega", "fault_again.y"]
    log = simulate(found.loops["pid"], found.scenario, compile=False, log=names)
    true, read = (log[n].values for n in names)
    np.testing.assert_array_equal(read[:100], true[:100])
    assert (read[105:295, 1] == read[105, 1]).all()
    assert read[105, 1] > true[294, 1]
    assert (read[305:, 1] == 0).all()
    np.testing.assert_allclose(read[205:, 0], 1.5 * true[205:, 0], rtol=1e-12)
