"""A vehicle from parts: its physics against closed forms and another integrator, its parts."""

import os
import subprocess
import sys
from dataclasses import replace
from math import atan, exp, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from slipctl import BadInput, connect, gated, replicate, sampled, simulate
from slipctl.models.brakes import brake
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.huang_2020.subway_braking import plant as subway_plant
from slipctl.models.vehicle import (
    Constant,
    Davis,
    DemandAlone,
    Exact,
    Lag,
    Most,
    NoisySpeed,
    NoisyWheel,
    Predictive,
    Profile,
    Sensors,
    SlipLaw,
    SlipRatio,
    SlipSpeed,
    Slope,
    Stretch,
    ToothWheel,
    Track,
    Trip,
    Valve,
    Vehicle,
    WheelsOnly,
    case,
    loop,
    scenario,
)
from slipctl.models.vehicle.adhesion import rail_law
from slipctl.models.vehicle.parts import SLIP_LAWS
from slipctl.models.vehicle.plant import on_train
from slipctl.models.vehicle.trip import best_of_rail
from slipctl.models.wheel_rail.contact import patch
from slipctl.models.wheel_rail.contact import peak as peak_at

DRY = Track(sections=(Stretch(place=0.0, condition="dry"),))
CAR = Vehicle(mass=38e3, inertia=110.0, speed=20.0)
M_EFF = 38e3 + 4 * 110.0 / 0.42**2


def trip(**changes):
    given = dict(
        duration=10.0, vehicle=CAR, actuator=Lag(torque=8e3), rail=DRY,
        demand=Constant(deceleration=1.0), controllers={"none": DemandAlone()},
        sensors=Sensors(wheel_speed=Exact()), reference=SlipSpeed(slip=1.2),
    )  # fmt: skip
    return Trip(**given | changes)


def run(made, name="none", **how):
    found = case(made)
    return simulate(found.loops[name], found.scenario, compile=False, **how)


@pytest.mark.second
def test_a_loop_is_the_same_in_every_process():
    # Python orders sets of texts by a number of the process; what depends on it is compiled anew
    # each time, and may sum in another order
    code = (
        "import hashlib; from slipctl.study import doors; from slipctl import prepare;"
        "from slipctl.models import vehicle; from pathlib import Path;"
        "file = Path(vehicle.__file__).parent / 'files' / 'metro.toml';"
        "loop, case = doors.find_loop(doors.load_study(str(file)), 'none');"
        "rolled = prepare(loop, case.scenario, compile=False)._roller[0];"
        "print(hashlib.sha256(rolled.serialize().encode()).hexdigest())"
    )
    said = {
        subprocess.run([sys.executable, "-c", code], env=os.environ | {"PYTHONHASHSEED": seed},
                       capture_output=True, text=True, check=True).stdout
        for seed in ("1", "2", "3")
    }  # fmt: skip
    assert len(said) == 1


def test_a_demand_ends_at_a_time_or_at_a_place():
    # what is demanded is zero from the tick on at which it ends, and as it was until then
    made = trip(duration=1.0, demand=Constant(deceleration=1.0, until="0.3 s"))
    log = run(made)
    wanted = log["demand.wanted"].values
    np.testing.assert_array_equal(wanted, np.where(np.arange(1000) < 300, 1.0, 0.0))
    log = run(trip(duration=1.0, demand=Constant(force=9e3, until="12 m")))
    at = log["plant.train.x"].values
    np.testing.assert_array_equal(log["demand.wanted"].values, np.where(at < 12, 9e3, 0.0))
    with pytest.raises(BadInput, match="write a number in s or m"):
        Constant(deceleration=1.0, until="12")


@pytest.mark.second
def test_a_trip_ends_at_standstill_or_at_a_place():
    slow = replace(CAR, speed=1.0)
    log = run(trip(vehicle=slow, end="standstill"))
    v = log["plant.train.v"].values
    assert log["time"].size < 4000
    assert (np.abs(v[-500:]) <= 0.02).all() and abs(v[-501]) > 0.02  # noqa: PT018
    x = run(trip(end="15 m"))["plant.train.x"].values
    assert x[-1] >= 15 > x[-2]


# ---- physics -------------------------------------------------------------------------------------


def test_a_coasting_vehicle_follows_the_closed_form():
    # (M + sum J/r^2) v' = -c v^2 has v = v0/(1 + c v0 t/M_eff); and with a constant part the arctan
    quadratic = replace(CAR, resistance=Davis(c=30.0))
    log = run(trip(vehicle=quadratic, demand=Constant(deceleration=0.0), duration=2.0))
    t, v = log["time"].values, log["plant.train.v"].values
    # the closed form has no creep: that which slows the wheels is 3.5 mm/s, of 6 % of the mass
    np.testing.assert_allclose(v, 20 / (1 + 30 * 20 * t / M_EFF), atol=3e-4)
    both = replace(CAR, resistance=Davis(a=2e3, c=30.0))
    log = run(trip(vehicle=both, demand=Constant(deceleration=0.0), duration=2.0))
    ratio = sqrt(2e3 / 30)
    wanted = ratio * np.tan(atan(20 / ratio) - sqrt(2e3 * 30) * t / M_EFF)
    np.testing.assert_allclose(log["plant.train.v"].values, wanted, atol=3e-4)


def test_stopping_distance_is_that_of_lag_and_dead_time():
    # a (1 - exp(-(t - t_d)/tau)) integrated twice, until the speed is zero. The demand is a torque,
    # r M a/4 + J a/r; what the rims slip is braked from them and not from the vehicle
    act = Lag(torque=9e3, lag=0.1, dead_time=0.2)
    log = run(trip(duration=5.0, actuator=act, vehicle=replace(CAR, speed=4.0)))
    v, x = log["plant.train.v"].values, log["plant.train.x"].values
    slip = brentq(lambda s: exp(-0.54 * s) - exp(-1.2 * s) - 1.0 / 9.81, 0, 1)
    v_0 = 4.0 + slip * (1 - 38e3 / M_EFF)
    stop = v_0 + 0.2 + 0.1
    s = stop - 0.2
    wanted = v_0 * stop - (s**2 / 2 - 0.1 * s + 0.1**2 * (1 - exp(-s / 0.1)))
    # below the slip speed the rims stand, and the contact gives what the brake takes, T/r = M_EFF a
    wanted += slip**2 / 2 * (38e3 / M_EFF - 1)
    plain = 4.0**2 / 2
    assert wanted - plain > 1.2  # lag and dead time matter
    assert abs(x[-1] - wanted) < 5e-3  # a tick of the start speed is 4 mm
    assert v[-1] == 0


def test_energy_goes_where_the_powers_say():
    leaves = Track(
        conditions={"leaves": {"c": 0.18}},
        sections=(Stretch(place=0.0, condition="dry"), Stretch(place=30.0, condition="leaves")),
    )
    made = trip(
        duration=3.5, rail=leaves, vehicle=replace(CAR, resistance=Davis(a=1e3, b=10.0)),
        demand=Constant(deceleration=1.2),
    )  # fmt: skip
    log = run(made)
    v, omega = log["plant.train.v"].values, log["plant.train.omega"].values
    energy = 38e3 * v**2 / 2 + 110.0 * (omega**2).sum(axis=1) / 2
    names = ("P_brake", "P_bearing", "P_slip", "P_d")
    power = sum(log[f"plant.train.{n}"].values for n in names) - log["plant.train.P_drive"].values
    spent = 1e-3 * power[:-1].sum()
    assert omega[-1].max() < 1  # the wheels lock, so that every path was taken
    # the step keeps the energy as an identity, up to what Newton's method leaves of the force
    assert abs(energy[0] - energy[-1] - spent) < 1e-6 * energy[0]


SLOPES = {"down": (-0.04, "dry"), "up": (0.04, "dry"), "weak": (-0.02, "leaves")}


@pytest.mark.second
@pytest.mark.parametrize(
    "name", ["down", *(pytest.param(n, marks=pytest.mark.long) for n in ("up", "weak"))]
)
def test_a_braked_car_stands_on_a_slope_and_starts_again_when_released(name):
    gradient, condition = SLOPES[name]
    rail = Track(conditions={"leaves": {"c": 0.18}}, gradient=gradient,
                 sections=(Stretch(place=0.0, condition=condition),))  # fmt: skip
    level = 0.45 if name == "weak" else 1.0
    made = trip(
        duration=14.0, rail=rail, vehicle=replace(CAR, speed=1.0), sensors=Sensors(
        wheel_speed=Exact()), demand=Constant(deceleration=level, until="12 s"),
    )  # fmt: skip
    log = run(made)
    t, v, x = (log[n].values for n in ("time", "plant.train.v", "plant.train.x"))
    omega, F = log["plant.train.omega"].values, log["plant.train.F_all"].values
    assert (v > 0).any()
    first = int(np.argmax(v == 0))
    if name != "weak":  # rolls until its speed is the slip, then with locked wheels
        slip = brentq(lambda s: exp(-0.54 * s) - exp(-1.2 * s) - level * M_EFF / 38e3 / 9.81, 0, 1)
        pull = 9.81 * gradient * 38e3 / M_EFF
        v_0 = 1.0 + slip * (1 - 38e3 / M_EFF) - 0.05 * pull  # the brake is late by its lag, 50 ms
        rolled = (v_0**2 - slip**2) / 2 / (level + pull) + 0.05
        locked = slip**2 / 2 / (level + pull) * 38e3 / M_EFF
        assert x[first] == pytest.approx(rolled + locked, abs=5e-3)
    stands = (np.arange(t.size) > first) & (t < 12.0)
    assert (v[stands] == 0).all()
    assert (omega[stands] == 0).all()
    assert (x[stands] == x[first]).all()
    np.testing.assert_allclose(F[stands], 38e3 * 9.81 * gradient, rtol=1e-12)  # no more, no less
    # the torque falls by exp(-t/tau) until it is below the pull: then it goes, that way
    asked = 38e3 * 9.81 * abs(gradient)
    holds = level * M_EFF
    late = 12.0 + 0.05 * np.log(holds / asked)
    assert t[np.argmax((t > 12) & (v != 0))] == pytest.approx(late, abs=3e-3)
    pull = -9.81 * gradient * 38e3 / M_EFF
    assert np.sign(v[-1]) == -np.sign(gradient)
    assert (v[-1] - v[-501]) / 0.5 == pytest.approx(pull, rel=0.01)


@pytest.mark.second
def test_a_car_slides_on_where_the_rail_does_not_carry_it():
    # 40 per mille down on ice, which carries 0.0286: it slides, and ever faster
    made = trip(duration=6.0, vehicle=replace(CAR, speed=1.0), rail=Track(
        gradient=-0.04, sections=(Stretch(place=0.0, condition="ice"),)))  # fmt: skip
    log = run(made)
    v = log["plant.train.v"].values
    assert (v > 0).all()
    assert v[-1] > v[0] + 6.0 * 9.81 * (0.04 - 0.0287) * 0.9
    # with the brake of one axle of four alone it stands, on four times the adhesion
    one = trip(duration=8.0, vehicle=replace(CAR, speed=1.0), demand=Constant(deceleration=2.0),
               rail=replace(DRY, gradient=-0.02))  # fmt: skip
    braked = case(one).loops["none"].with_params(**{"plant.train.braked": np.eye(4)[0]})
    log = simulate(braked, scenario(one), compile=False)
    assert log["plant.train.v"].values[-1] == 0
    np.testing.assert_allclose(log["plant.train.mu"].values[-1], [-0.08, 0, 0, 0], atol=1e-12)


def test_a_car_stands_on_a_law_that_is_negative_far_beyond_its_peak():
    """Burckhardt's line is -0.43 at a creep of 5 m/s: once taken for the peak of a slow car."""
    car = replace(CAR, speed=1.0, radius=(0.42, 0.418, 0.44, 0.437))
    rail = Track(law="burckhardt", sections=(Stretch(place=0.0, condition="wet"),))
    log = run(trip(duration=2.0, vehicle=car, rail=rail, demand=Constant(deceleration=1.4)))
    v, x = log["plant.train.v"].values, log["plant.train.x"].values
    first = int(np.argmax(v == 0))
    assert log["time"].values[first] == pytest.approx(1 / 1.4 + 0.05, abs=0.03)
    assert (np.diff(v[:first]) <= 0).all()
    assert not v[first:].any()
    assert (x[first:] == x[first]).all()
    assert log["plant.train.residual"].values.max() < 1
    assert (log["plant.train.mu"].values[:first] < 1e-12).all()  # no wheel pushes


def test_a_quarter_of_a_car_by_another_integrator():
    # one axle with a quarter of the mass, braked into a slide; Radau of scipy on the same equations
    car = Vehicle(mass=9.5e3, axles=1, inertia=110.0, speed=15.0)
    wet = Track(sections=(Stretch(time=0.0, condition="ice"),))
    made = trip(duration=1.0, vehicle=car, rail=wet, demand=Constant(deceleration=0.4),
                actuator=Lag(torque=8e3, lag=0.05))  # fmt: skip
    log = run(made)

    def rate(t, y):
        v, omega, T = y
        s = v - 0.42 * omega
        F = 0.1 * (exp(-0.54 * s) - exp(-1.2 * s)) * 9.5e3 * 9.81
        wanted = 0.42 * 9.5e3 * 0.4 + 110.0 * 0.4 / 0.42
        return [-F / 9.5e3, (0.42 * F - T) / 110.0, (wanted - T) / 0.05]

    times = log["time"].values[::100]
    true = solve_ivp(rate, (0, 1), [15.0, 15.0 / 0.42, 0.0], "Radau", times, rtol=1e-10, atol=1e-10)
    found = log["plant.train.omega"].values[::100, 0]
    assert true.y[1][-1] * 0.42 < 14.6  # it slips
    # first order in the tick: 1 ms of the largest acceleration of the wheel, 8 rad/s^2
    np.testing.assert_allclose(found, true.y[1], atol=8e-3)


def test_the_subway_wheelset_is_the_one_of_its_study():
    # same wheel, brake and law, the plant of subway_braking by RK4 in 10 substeps. The train's step
    # is backward Euler with 1 ms and holds the torque over it: half a tick of 2 m/s^2 is 1 mm/s
    wheel = Vehicle(mass=8e3, axles=1, radius=0.5, inertia=240.0, speed=20.0)
    made = trip(
        duration=1.0, vehicle=wheel, actuator=Lag(torque=20e3, lag=0.05),
        demand=Constant(deceleration=2.0),
    )  # fmt: skip
    ours = run(made)
    theirs = sampled(subway_plant(double_exponential, brake(lag=True)), 1e-3, "rk4", substeps=10)
    silent = {"air.k0": 0.0, "air.k1": 0.0, "air.k2": 0.0}
    torque = float(ours["demand.T_demand"].values[0])
    log = simulate(
        connect("loop", {"plant.T_cmd": "T_cmd"}, plant=theirs.with_params(**silent)),
        scenario(made).but(rail=None, inputs={"T_cmd": torque}), compile=False,
    )  # fmt: skip
    for a, b in (("plant.train.v", "plant.wheel.v"), ("plant.act.T_b", "plant.brake.T_b")):
        np.testing.assert_allclose(
            ours[a].values.ravel(), log[b].values, atol=2e-3 if a.endswith("v") else 1e-6
        )
    np.testing.assert_allclose(
        ours["slip.y"].values[:, 0], log["plant.wheel.v_s"].values, atol=5e-3
    )


def test_an_axle_slips_when_it_gets_there():
    patch = Track(
        conditions={"oil": {"c": 0.05}},
        sections=(Stretch(place=0.0, condition="dry"), Stretch(place=30.0, condition="oil")),
    )
    log = run(trip(duration=3.0, rail=patch))
    slips = log["slip.y"].values > 1.0
    first = log["plant.train.x"].values[slips.argmax(axis=0)]
    # the slide needs the same way after each axle's own place: 0, 2.1, 11, 13.1 m behind the first
    np.testing.assert_allclose(first - first[0], CAR.behind, atol=0.1)


def test_a_gradient_pulls_up_and_down_along_the_track():
    hill = replace(
        DRY, gradient=(Slope(place=0.0, gradient=0.02), Slope(place=40.0, gradient=-0.01))
    )
    log = run(trip(duration=4.0, rail=hill, demand=Constant(deceleration=0.0)))
    t, v, x = (log[n].values for n in ("time", "plant.train.v", "plant.train.x"))
    share = 38e3 / M_EFF  # rotating mass has inertia and no weight
    up, down = x < 39, x > 41
    rise, fall = (np.polyfit(t[s], v[s], 1)[0] for s in (up, down))
    np.testing.assert_allclose([rise, fall], [-9.81 * 0.02 * share, 9.81 * 0.01 * share], rtol=1e-3)


def test_a_driven_vehicle_is_driven():
    car = replace(CAR, mode="drive", driven=(1, 2), speed=5.0)
    log = run(trip(vehicle=car, demand=Constant(acceleration=0.5), duration=3.0))
    v = log["plant.train.v"].values
    lag = 0.05  # after it the force of both driven axles gives 0.5 m/s^2 to mass and their inertia
    wanted = 5.0 + 0.5 * (38e3 + 2 * 110.0 / 0.42**2) / M_EFF * (3.0 - lag)
    assert abs(v[-1] - wanted) < 0.01  # the creep, 0.2 m/s, of 3 % of the mass
    assert log["slip.y"].values[-1, 0] > 0  # a driven wheel is seen in the mirror


# ---- parts ---------------------------------------------------------------------------------------


def test_demand_over_time_speed_and_place():
    steps = Profile(over="time", at=(0.0, 1.0), deceleration=(0.0, 1.0))
    log = run(trip(duration=2.0, demand=steps))
    assert list(log["demand.wanted"].values[[0, 999, 1000, 1999]]) == [0, 0, 1, 1]
    line = Profile(over="speed", at=(0.0, 20.0), force=(0.0, 20e3))
    log = run(trip(duration=1.0, demand=line))
    np.testing.assert_allclose(
        log["demand.wanted"].values, 1e3 * log["plant.train.v"].values, rtol=1e-12
    )
    place = Profile(over="position", at=(0.0, 10.0), deceleration=(0.2, 1.0))
    log = run(trip(duration=1.0, demand=place))
    beyond = log["plant.train.x"].values >= 10
    assert set(log["demand.wanted"].values[beyond]) == {1.0}
    assert set(log["demand.wanted"].values[~beyond]) == {0.2}


def test_a_valve_holds_the_torque_within_its_band():
    air = Valve(torque=8e3, fill=0.2, vent=0.1, band=0.02, dead_time=0.01)
    log = run(trip(duration=3.0, actuator=air))
    T = log["plant.T"].values[-500:]
    wanted = float(log["demand.T_demand"].values[-1])
    # the band, and what a tick fills: 8 kN m/0.2 s 1 ms; the dead time lets it run on for ten
    assert np.abs(T - wanted).max() < 0.02 * 8e3 + 11 * 8e3 / 0.1 * 1e-3


def test_sensors_lose_round_and_hold():
    noisy = Sensors(
        wheel_speed=NoisyWheel(deviation=0.1, step=0.01, dropout=0.3),
        vehicle_speed=NoisySpeed(deviation=0.1),
    )
    made = trip(duration=1.0, sensors=noisy, controllers={"pid": SlipLaw(kind="pid")})
    log = run(made, "pid")
    y = log["wheel.y"].values
    np.testing.assert_allclose(y / 0.01, np.round(y / 0.01), atol=1e-9)
    off = log["speed.y"].values - log["plant.train.v"].values
    assert 0.09 < off[1:].std() < 0.11  # 1000 samples: the deviation is known to 2.2 %
    same = (y[1:] == y[:-1]).mean()
    assert 0.3 < same < 0.36  # lost ones, and those that are equal by chance, 2 %


def test_speed_of_wheels_leaves_the_truth_by_its_rate():
    # all axles lock: v_m falls by a_max, the vehicle by what ice gives
    ice = Track(sections=(Stretch(place=0.0, condition="ice"),))
    made = trip(
        duration=4.0, rail=ice, demand=Constant(deceleration=2.0),
        sensors=Sensors(wheel_speed=Exact(), vehicle_speed=WheelsOnly(rate=1.5)),
        controllers={"pid": SlipLaw(kind="pid")},
    )  # fmt: skip
    pid = loop(made, "pid").with_params(**{"ctl.wake.v_off": 100.0})  # slip control is off
    log = simulate(pid, scenario(made), compile=False)
    v = log["speed.v_m"].values
    slope = np.polyfit(log["time"].values[-1000:], v[-1000:], 1)[0]
    assert abs(slope + 1.5) < 1e-6


@pytest.mark.parametrize(("mode", "name"), [
    *(("brake", n) for n in (*SLIP_LAWS, "nmpc")), ("drive", "sta"), ("drive", "pid"),
    *(pytest.param("drive", n, marks=pytest.mark.second)
      for n in (*SLIP_LAWS, "nmpc") if n not in ("sta", "pid")),
])  # fmt: skip
def test_every_slip_law_controls_every_vehicle(mode, name):
    # one axle held at the best slip, two with a demand; on a rail that bears neither demand
    part = Predictive() if name == "nmpc" else SlipLaw(kind=name)
    slippery = Track(sections=(Stretch(place=0.0, condition="ice"),))
    for axles, demand in ((1, Most()), (2, None))[: 1 if name == "nmpc" else 2]:
        wanted = "deceleration" if mode == "brake" else "acceleration"
        car = Vehicle(mass=9.5e3 * axles, axles=axles, inertia=110.0, speed=12.0, mode=mode)
        length = 0.4 if name == "nmpc" else 1.0
        made = trip(
            duration=length, vehicle=car, rail=slippery, controllers={"law": part},
            demand=demand or Constant(**{wanted: 1.2}), reference=SlipSpeed(slip=1.2),
        )  # fmt: skip
        slip = run(made, "law")["slip.y"].values[round(600 * length) :]
        assert 0.5 < slip.mean() < 2.0, (axles, slip.mean())  # about its reference, 1.2 m/s
        assert slip.max() < 4.0


def test_thirty_two_axles_each_with_its_own_control():
    train = Vehicle(mass=32 * 10e3, axles=32, inertia=100.0, speed=15.0)
    assert train.behind[-1] == 7 * 18.0 + 13.1
    made = trip(
        duration=0.05, vehicle=train, controllers={"sta": SlipLaw(kind="sta")},
        reference=SlipRatio(slip=0.05),
    )  # fmt: skip
    log = run(made, "sta")
    assert log["ctl.T_cmd"].shape == (50, 32)


def test_axles_with_radii_of_their_own_turn_as_they_must():
    radii = (0.42, 0.41, 0.42, 0.43)
    log = run(trip(vehicle=replace(CAR, radius=radii), demand=Constant(deceleration=0.0)))
    omega, v = log["plant.train.omega"].values[-1], log["plant.train.v"].values[-1]
    np.testing.assert_allclose(omega * np.array(radii), v, rtol=1e-6)


def test_one_number_changes_everywhere():
    made = loop(trip(controllers={"pid": SlipLaw(kind="pid")}), "pid")
    heavier = made.with_params(m=40e3, r=0.4).values_by_place()
    assert float(heavier["ctl.meter.m"]) == float(heavier["ctl.force.m_axle"]) == 10e3
    assert np.ravel(heavier["plant.train.m_axle"])[0] == 10e3
    assert {float(v) for n, v in heavier.items() if n.endswith(".r")} == {0.4}


def test_polachs_law_is_of_the_wheel_that_it_carries():
    """Patch of the vehicle's own wheel, of a drawn mass too; another wheel's is refused.

    A quarter of 38 t rests on two wheels: 46598 N (9.81 m/s^2).
    """
    laid = replace(DRY, law="polach", conditions={"dry": {"mu_0": 0.128}})
    made = trip(rail=laid, duration=0.01)
    assert float(run(made)["plant.train.v"][-1]) < 20.0
    for mass in (38e3, 46e3):
        values = loop(made, "none").with_params(m=mass).values_by_place()
        fits = patch(mass * 9.81 / 8, 0.42)
        for name, value in fits.items():
            assert float(values[f"plant.train.adh.{name}"]) == pytest.approx(value, rel=1e-12)
    other = replace(laid, conditions={"dry": {"Q": 76e3}})
    with pytest.raises(BadInput, match=r"7.6e\+04 N is .* carries 4.66e\+04 N: set"):
        run(trip(rail=other, duration=0.01))
    measured = {n: 1.1 * v for n, v in patch(46598.0, 0.42).items()} | {"Q": 46598.0}
    own = run(trip(rail=replace(laid, conditions={"dry": measured}), duration=0.01))
    assert float(own["plant.train.v"][-1]) < 20.0


def test_the_peak_of_a_law_that_depends_on_the_speed_is_that_of_each_tick():
    """It was that at 10 m/s all the way, and a wheel used 102 % of it."""
    laid = replace(DRY, law="polach", conditions={"dry": {}})
    made = trip(rail=laid, duration=0.3)
    log = run(made)
    law, v = rail_law(made), np.asarray(log["plant.train.v"])
    known = best_of_rail(made)
    slip, peak = (known[f"rail.best_{n}"].values(log) for n in ("slip", "adhesion"))
    for k in (0, len(v) // 2, len(v) - 1):
        found = peak_at(float(v[k]), law.conditions["dry"], law)
        assert peak[k] == pytest.approx(found.value, rel=2e-3)
        assert law(v_s=float(slip[k, 0]), v=float(v[k]), **law.conditions["dry"])["mu"] == (
            pytest.approx(found.value, rel=1e-3)
        )


def test_a_gated_block_begins_anew():
    from slipctl import Input, Output, State, step

    @step(y=Output("1", "count"))
    def counter(k=State("1", 3.0, "count"), by=Input("1", "step")):
        """Counts."""
        return dict(k=k + by), dict(y=k)

    block, x = gated(counter), gated(counter).start()
    seen = []
    for on in (1, 1, 0, 1):
        x, y = block(by=1.0, on=on, **x)
        seen.append(float(y["y"]))
    assert seen == [3, 4, 0, 3]


def test_copies_of_a_matrix_stand_beside_each_other():
    from slipctl import Input, Output, State, step

    @step(y=Output("1", "trace"))
    def turning(P=State("1", [[1.0, 2.0], [3.0, 4.0]], "matrix", shape=(2, 2)), u=Input("1", "u")):
        """Scales a matrix."""
        return dict(P=u * P), dict(y=P[0, 0] + P[1, 1])

    x, y = replicate(turning, 2)(u=[1.0, 10.0])
    assert np.asarray(x["P"]).tolist() == [[1, 2, 10, 20], [3, 4, 30, 40]]
    assert np.ravel(y["y"]).tolist() == [5, 5]


def test_a_law_on_the_train_is_odd_and_the_same_where_it_is_positive():
    on = on_train(double_exponential)
    for s in (0.1, 1.2, 5.0):
        here = float(double_exponential(v_s=s)["mu"])
        assert float(on(v_s=-s, v=10.0)["mu"]) == -here
        assert float(on(v_s=s, v=10.0)["mu"]) == here


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda: Vehicle(speed=20.0, inertia=1.0), "neither mass nor tare"),
        (lambda: replace(CAR, rotating_mass=0.08), "both are given"),
        (lambda: replace(CAR, radius=(0.4, 0.4)), "2 values for 4 axles"),
        (lambda: replace(CAR, driven=(1,)), "driven vehicle"),
        (lambda: replace(CAR, mass=-1.0), "outside"),
        (lambda: Track(sections=(Stretch(place=1.0, condition="dry"),)), "begin at 0 m"),
        (lambda: trip(demand=Constant(acceleration=1.0)), "write deceleration"),
        (lambda: Constant(), "none is given"),
        (lambda: trip(controllers={}), "no controller"),
        (lambda: loop(trip(rail=replace(DRY, law="burckhard")), "none"), "burckhardt"),
        (lambda: loop(trip(controllers={"a": SlipLaw(gains={"K9": 1.0})}), "a"), "gains.K9"),
    ],
)
def test_what_does_not_fit_is_told(change, told):
    with pytest.raises(BadInput, match=told):
        change()


@pytest.mark.second
def test_tooth_wheel_and_search_are_the_defaults_and_run():
    made = Trip(
        duration=0.1, vehicle=CAR, actuator=Lag(torque=8e3), rail=DRY,
        demand=Constant(deceleration=1.0), controllers={"sta": SlipLaw(kind="sta")},
    )  # fmt: skip
    assert isinstance(made.sensors.wheel_speed, ToothWheel)
    log = run(made, "sta")
    np.testing.assert_allclose(
        log["wheel.omega_m"].values * 0.42, log["plant.train.omega"].values * 0.42, atol=0.2
    )  # edges 1.3 ms apart with a jitter of 2 us: 0.04 m/s standard deviation, of 400 the largest
