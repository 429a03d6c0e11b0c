"""Physics of the freight models: peaks, creep dynamics, resistance, barrier laws in closed loop."""

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
    connect,
    law,
    linear,
    locking_seek,
    luenberger,
    sampled,
    simulate,
)
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022 import freight_traction_control as control
from slipctl.models.cheng_2022.certificate import barrier as bounds

T = 2e-4
BEST = float(freight.peak_creep(0.54, 1.2))
START = {"plant.train.omega_m": (5.0 + BEST) * 6.294 / 0.625}


@law(mu_hat=Output("1", "adhesion estimate", positive="traction"))
def wrong(
    mu=Input("1", "adhesion coefficient", positive="traction"),
    error=Param("1", 0.0, "relative error of the estimate"),
):
    return mu * (1 + error)


def held(form, error=0.0, seconds=2.0, surface="dry", motor=None, start=None, **values):
    """Creep held at the best one, with an adhesion estimate that is wrong by a share."""
    wires = {
        "see.mu": "plant.adh.mu",
        "ctl.mu_hat": "see.mu_hat",
        "ctl.F_Z_hat": "plant.res.F_Z",
        "ctl.v_s": "plant.train.v_s",
        "ctl.v_ref": "v_ref",
        "ctl.rate": "rate",
        "plant.T_cmd": "ctl.T_cmd",
    }
    plant = sampled(freight.plant(motor=motor), T, "rk4")
    block = control.controller(form, T, **values)
    see = wrong.with_params(error=error)
    loop = connect("loop", wires, plant=plant, ctl=block, see=see)
    p = freight.adhesion.conditions[surface]
    params = {f"plant.adh.{k}": v for k, v in p.items()}
    inputs = {"v_ref": BEST, "rate": 0.0}
    scenario = Scenario("s", seconds, inputs=inputs, start=START | (start or {}), params=params)
    return simulate(loop, scenario)


@pytest.mark.parametrize(
    ("surface", "creep", "height"),
    [("dry", 1.2098601, 0.286172), ("wet", 1.2098601, 0.206044),
     ("wet_printed", 1.5982337, 0.0217266), ("dry_printed", 1.3395351, 0.2677889),
     ("wet_moving", 1.8147902, 0.206044), ("damp_moving", 0.8065734, 0.25)],
)  # fmt: skip
def test_peaks_of_the_surfaces(surface, creep, height):
    """Places and heights to half a unit of the last digit; the slope is zero, the bend exact."""
    p = freight.adhesion.conditions[surface]
    best = float(freight.peak_creep(**p))
    assert best == pytest.approx(creep, abs=5e-8)
    assert freight.adhesion(v_s=best, **p)["mu"] == pytest.approx(height, abs=5e-7)
    assert freight.adhesion(v_s=-best, **p)["mu"] == pytest.approx(-height, abs=5e-7)
    h = 1e-4
    y = [freight.adhesion(v_s=best + d, **p)["mu"] for d in (-h, 0, h)]
    assert y[2] - y[0] == pytest.approx(0, abs=1e-11)
    bend = (y[0] - 2 * y[1] + y[2]) / h**2
    assert float(freight.peak_curvature(**p)) == pytest.approx(bend, rel=1e-5)
    slope = freight.adhesion(v_s=1e-7, **p)["mu"] / 1e-7
    assert float(freight.steepest_slope(**p)) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize(("v", "kN"), [(5, 45), (10, 68), (20, 138)])
def test_running_resistance(v, kN):
    assert freight.resistance(v=v)["F_Z"] == pytest.approx(1e3 * kN, abs=500)
    assert freight.resistance(v=0.0)["F_Z"] == 0


def test_largest_load_torque():
    """T_L = mu W g r/R_g = 8350 N m at the peak with the radius, half with .625 as diameter."""
    for r, torque in ((0.625, 8350), (0.3125, 4175)):
        y = freight.train(
            x=0.0, v_t=5.0, omega_m=0.0, T_m=0.0, mu=0.286, F_Z=0.0, r=r
        )[1]  # fmt: skip
        assert y["T_L"] == pytest.approx(torque, abs=1)


@given(
    v=st.floats(1, 30), creep=st.floats(-2, 5), torque=st.floats(-1e4, 1e4), mu=st.floats(0, 0.4),
    n_d=st.floats(1, 16), J=st.floats(1, 500),
)  # fmt: skip
def test_creep_rate_is_that_of_the_spec(v, creep, torque, mu, n_d, J):
    """v_s' = (r/(J R_g)) T_m - D, from the two accelerations; the law's D is the plant's."""
    omega = (v + creep) * 6.294 / 0.625
    F_Z = freight.resistance(v=v)["F_Z"]
    n, y = freight.train(x=0.0, v_t=v, omega_m=omega, T_m=torque, mu=mu, F_Z=F_Z, n_d=n_d, J=J)
    rate = 0.625 / 6.294 * n["omega_m"] - n["v_t"]
    assert rate == pytest.approx(0.625 / (J * 6.294) * torque - y["D"], abs=1e-9 * (1 + abs(rate)))
    assert y["v_s"] == pytest.approx(creep, abs=1e-9)
    D_hat = control.disturbance(mu_hat=mu, F_Z_hat=F_Z, n_d=n_d, J=J)["D_hat"]
    assert D_hat == pytest.approx(y["D"], rel=1e-9, abs=1e-12)


def test_exact_estimates_keep_the_creep():
    for form in ("robust", "consistent"):
        e = held(form)["ctl.barrier.e"].values
        assert abs(e).max() < 1e-3


def test_printed_law_rests_where_its_pull_is_twice_the_disturbance():
    """-f in place of D: e' = -2 D - kappa(e), held off by the k_a side alone, 11.5 mm/s too low."""
    run = held("printed-42", seconds=1.0)
    e, D = float(run["ctl.barrier.e"][-1]), float(run["plant.train.D"][-1])
    assert -e == pytest.approx(bounds.settled_error(2 * D, 1200.0, bounds_k_a()), rel=1e-3)
    assert -e == pytest.approx(0.0115, abs=5e-5)


def bounds_k_a():
    return 0.02 + BEST


@pytest.mark.parametrize(("share", "kept"), [(0.99, True), (1.01, False)])
def test_consistent_law_holds_what_its_bound_says(share, kept):
    """Adhesion error whose D is .99 and 1.01 of 4 k k_s^3/(3 sqrt 3); it is about .036 %."""
    D = float(held("consistent", seconds=0.01)["plant.train.D"][0])
    error = share * bounds.largest_disturbance(1200.0, 0.02) / D
    assert error == pytest.approx(0.00036, rel=0.05)
    e = held("consistent", error, seconds=40.0)["ctl.barrier.e"].values
    assert (e.max() < 0.02) == kept
    e = held("robust", error, seconds=2.0)["ctl.barrier.e"].values
    assert abs(e).max() < 0.001


def test_escape_of_the_consistent_law_at_a_tenth_of_a_percent():
    """The barrier is left where the bound says, to 5 %: D changes by a percent with the creep."""
    D = float(held("consistent", seconds=0.01)["plant.train.D"][0])
    run = held("consistent", 1e-3, seconds=5.0)
    left = float(run.time[np.argmax(run["ctl.barrier.e"].values >= 0.02)])
    assert left == pytest.approx(bounds.escape_time(1e-3 * D, 1200.0, 0.02), rel=0.05)


@pytest.mark.parametrize("surface", ["dry", "wet"])
@pytest.mark.parametrize("error", [-0.05, 0.05])
def test_robust_law_holds_five_percent(surface, error):
    run = held("robust", error, surface=surface)
    e, D = run["ctl.barrier.e"].values, float(run["plant.train.D"][-1])
    assert -bounds_k_a() < e.min()
    assert e.max() < 0.02
    if error > 0:  # the side of k_s
        settled = bounds.robust_settled(error * D, 50.0, 0.02)
        assert e[-1] == pytest.approx(settled, rel=0.01)


def test_robust_law_behind_a_lag():
    """20 ms of motor lag and 5 % error: q = 10 1/s holds 0.2 m/s, and e comes to rest."""
    torque = {"plant.motor.T_m": 8355.0}
    motor = freight.motor(lag=True)
    run = held("robust", 0.05, seconds=5.0, motor=motor, start=torque, k_s=0.2, q=10.0)
    e = run["ctl.barrier.e"].values
    assert e.max() < 0.2
    assert np.ptp(e[-5000:]) < 1e-3


def test_observer_of_the_paper():
    """Poles at -40 instead of gains of -40."""
    block = luenberger(freight.shaft, [-40, -40], measured="omega_m")
    p = block.param_values()
    assert float(p["L_omega_m"]) == pytest.approx(80, rel=1e-6)
    assert float(p["L_T_L"]) == pytest.approx(-1600 * 40, rel=1e-6)
    poles = linear(block, dict.fromkeys(block.inputs, 0.0)).poles()
    assert poles.real == pytest.approx([-40, -40], rel=1e-5)
    with pytest.raises(BadInput, match=r"pole 39\.97 1/s, which is unstable"):
        luenberger(freight.shaft, gains={"L_omega_m": -40, "L_T_L": -40}, measured="omega_m")
    assert freight.adhesion_of_load(T_L_hat=8350.0)["mu_hat"] == pytest.approx(0.286, abs=5e-5)
    assert [freight.adhesion_of_load(T_L_hat=T)["mu_hat"] for T in (-1e6, 1e6)] == [-2, 2]


def test_reference_knows_its_rate():
    """v_ref' is what it says, limited, and follows a ramp 1/w_r late."""
    feed = {"v": lambda t: np.where(t < 0.5, 1.0 * t, 1.0)}
    run = simulate(control.reference(T), Scenario("ramp", 1.2, inputs=feed))
    v, rate = run["v_ref"].values, run["rate"].values
    assert np.diff(v) == pytest.approx(T * rate[:-1], abs=1e-12)
    assert abs(rate).max() == pytest.approx(1.5)  # the jump from .5 to 1 m/s
    assert 0.4 - v[2000] == pytest.approx(1 / 200, rel=0.01)
    assert v[-1] == pytest.approx(1.0, abs=1e-9)


def test_lead_makes_the_motor_faster():
    """Step of 2 kN m: time constant of 5 ms in place of 20 ms."""
    motor = sampled(freight.motor(lag=True), T, "rk4")
    wires = {"lead.T_m": "motor.T_m", "lead.T_wanted": "wanted", "motor.T_cmd": "lead.T_cmd"}
    loop = connect("loop", wires, motor=motor, lead=control.lead)
    run = simulate(loop, Scenario("step", 0.1, inputs={"wanted": 2000.0}))
    rise = float(run.time[np.argmax(run["motor.T_m"].values >= 2000 * (1 - np.exp(-1)))])
    assert rise == pytest.approx(0.005, abs=3e-4)  # a tick and a half


def test_creep_as_measured_is_that_of_the_train():
    y = freight.train(x=0.0, v_t=7.0, omega_m=80.0, T_m=0.0, mu=0.2)[1]
    assert control.creep(omega_m=80.0, v_t=7.0)["v_s"] == pytest.approx(y["v_s"], abs=1e-12)


def test_seeking_controller_takes_speeds_and_gives_a_torque():
    block = control.seeking_controller(locking_seek(T), lag=0.02)
    assert set(block.inputs) == {"omega_m", "v_t", "T_m"}
    assert float(block.params["lead.tau_d"].value) == pytest.approx(0.005)
    assert "lead.T_cmd" not in control.seeking_controller(locking_seek(T)).outputs
    with pytest.raises(BadInput, match="unstable"):
        control.seeking_controller(locking_seek(T), pole=40.0)
    with pytest.raises(BadInput, match="1/s would pass"):
        control.seeking_controller(locking_seek(T), q=5000.0)


def test_refusals():
    with pytest.raises(BadInput, match="barrier_law has no form 'best'"):
        control.barrier_law("best")
    with pytest.raises(BadInput, match=r"0\.00028 s would pass"):
        control.controller("consistent", 1e-3)
    with pytest.raises(BadInput, match="1/s would pass"):
        control.controller("robust", 1e-3, q=500.0)


def test_units_of_the_freight_models():
    blocks = [
        freight.adhesion, freight.resistance, freight.train, freight.motor(), freight.motor(True),
        freight.plant(), freight.plant(motor=freight.motor(True)), freight.shaft,
        freight.adhesion_of_load, control.disturbance,
        *(control.barrier_law(form) for form in control.FORMS), control.controller(),
        control.creep, control.reference(), control.lead, freight.motor_speed_sensor,
        control.seeking_controller(locking_seek(T), lag=0.02),
    ]  # fmt: skip
    for block in blocks:
        assert block.check_units() == []
