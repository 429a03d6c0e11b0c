"""Physics of the train of paper 003: energy, order, delays, limits, standstill, no chatter."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import settings

from slipctl import BadInput, Input, Output, Param, Rail, Scenario, Section, connect, law, simulate
from slipctl.models.wang_2025 import hst_traction as hst
from slipctl.models.wheel_rail.axle_forces import axle_at_speed
from slipctl.models.wheel_rail.axles import Axles, rolling
from slipctl.models.wheel_rail.contact import SURFACES, polach


@law(F=Output("N", "force", positive="traction"))
def held(F_held=Input("N", "force", value=0.0), v=Input("m/s", "speed"), k=Param("N s/m", 0.0)):
    """A force that is given."""
    return F_held - k * v


def train(axles=hst.GROUPED, h=1e-3, **options):
    wires = {"ctl.F_held": "F", "ctl.v": "plant.train.v", "plant.F_contr": "ctl.F"}
    return connect("loop", wires, plant=hst.plant(axles=axles, h=h, **options), ctl=held)


def run(loop, seconds, rail="dry", v=20.0, compile=True, **inputs):
    if isinstance(rail, str):
        rail = Rail([Section(0, rail)])
    scenario = Scenario("s", seconds, rail, inputs=inputs, start={"v": v})
    return simulate(loop, scenario, compile=compile)


HARD = {"F": [(0, 250e3), (4, -400e3), (8, 0.0)]}
"""Traction, hard braking, coasting."""
SLIPPERY = Rail([Section(0, "dry"), Section(1, "ice"), Section(3, "damp"), Section(5, "ice")])


# ---- energy --------------------------------------------------------------------------------------


@pytest.mark.parametrize("axles", [hst.GROUPED, hst.DISTINCT], ids=["grouped", "distinct"])
def test_work_is_energy_plus_losses_to_rounding(axles):
    """Through slip, lock and adhesion regained: one force acts on wheel and train."""
    loop = train(axles)
    log = run(loop, 10.0, SLIPPERY, 8.0, **HARD)
    p = loop.param_values()
    omega = log["plant.train.omega"].values
    energy = 0.5 * p["plant.m"] * log["plant.train.v"].values ** 2 + 0.5 * (
        p["plant.train.count"] * p["plant.J"] * omega**2
    ).sum(axis=1)
    power = {k: log[f"plant.train.P_{k}"].values[:-1] for k in ("drive", "brake", "bearing",
                                                                 "slip", "d")}  # fmt: skip
    gained = 1e-3 * (power.pop("drive") - sum(power.values()))
    # rounding of an energy of 1e8 J is 1.5e-8 J, and 10 terms of it
    assert np.abs(np.diff(energy) - gained).max() < 20 * np.spacing(energy.max())
    assert float(log["plant.train.v_s_max"].max()) > 20  # it did slip
    assert (omega == 0).any()  # and lock
    assert (power["slip"] > -1e-9 * energy.max()).all()


def lost(h):
    """Energy lost in the contacts from standing wheels' slip to adhesion, with fixed torque."""
    log = run(train(h=h), 0.4, "wet", 20.0, compile=False, F=100e3)
    return float(h * log["plant.train.P_slip"].sum())


@pytest.mark.second
def test_frictional_loss_converges_with_the_order_of_the_method():
    """Backward Euler: halving the step halves the difference to the next."""
    found = [lost(h) for h in (2e-3, 1e-3, 5e-4, 2.5e-4)]
    steps = np.diff(found)
    assert steps[0] / steps[1] == pytest.approx(2, rel=0.15)
    assert steps[1] / steps[2] == pytest.approx(2, rel=0.1)


def test_small_steps_agree_with_the_continuous_pages():
    """(v+ - v)/h and (omega+ - omega)/h tend to the right-hand sides of body and wheelset."""
    h = 1e-9
    one = rolling(polach, Axles((32,), (0.0,), (True,)), h)
    omega, v, T, F_d = 20.6 / 0.445, 20.0, 3e3, 2e4
    after, outputs = one(v=v, omega=omega, T=T, F_d=F_d)
    mu = polach(v_s=20.6 - v, v=v)["mu"]
    assert outputs["mu"][0] == pytest.approx(mu, rel=1e-4)
    wheel, contact = hst.wheelset(omega=omega, T=T, mu=mu, v=v)
    assert (after["omega"][0] - omega) / h == pytest.approx(wheel["omega"], rel=1e-4)
    body, _ = hst.body(v=v, F_mu=contact["F_mu"], F_d=F_d)
    assert outputs["a"] == pytest.approx(body["v"], rel=1e-4)


# ---- axles ---------------------------------------------------------------------------------------


def test_grouped_axles_do_what_distinct_ones_do():
    a, b = (run(train(axles), 6.0, SLIPPERY, 15.0, **HARD) for axles in (hst.GROUPED, hst.DISTINCT))
    driven = np.array(hst.DISTINCT.driven)
    for name in ("v_s", "mu"):
        one, many = a[f"plant.train.{name}"].values, b[f"plant.train.{name}"].values
        # sums over 32 and over 2 axles differ in rounding, which a slipping wheel lets grow
        np.testing.assert_allclose(many[:, driven], one[:, [0]].repeat(10, 1), atol=1e-6)
        np.testing.assert_allclose(many[:, ~driven], one[:, [1]].repeat(22, 1), atol=1e-6)
    np.testing.assert_allclose(a["plant.train.v"], b["plant.train.v"], atol=1e-8)


@pytest.mark.parametrize("compile", [True, False])
def test_each_axle_meets_the_ice_when_it_gets_there(compile):
    """Axle i meets a patch from 100 m to 140 m when it is there, d_i/v after the first axle."""
    rail = Rail([Section(0, "dry"), Section(100.0, "ice"), Section(140, "dry")], by="position")
    loop = train(hst.DISTINCT)
    seconds, start = (8.0 if compile else 0.8), {"v": 40.0, "x": 60.0 if compile else 90.0}
    run = Scenario("s", seconds, rail, inputs={"F": 200e3}, start=start)
    log = simulate(loop, run, compile=compile)
    x, creep = log["plant.train.x"].values, log["plant.train.v_s"].values
    met = 0
    for k in hst.DISTINCT.motors:
        place = x - hst.DISTINCT.behind[k]
        iced = (place >= 100) & (place < 140)
        if iced.any() and not iced[0]:
            met += 1
            # the wheel lets go in the step that begins on the ice
            assert np.argmax(np.diff(creep[:, k]) > 0.005) == np.argmax(iced)
    assert met == (10 if compile else 2)


def test_an_axle_may_have_a_brake_a_load_or_a_wheel_of_its_own():
    n = len(hst.DISTINCT)
    braked = np.ones(n)
    braked[5] = 0.0
    loop = train(hst.DISTINCT).with_params(**{"plant.train.braked": braked})
    log = run(loop, 3.0, "dry", 30.0, F=-200e3)
    mu, a = log["plant.train.mu"].values[-1], float(log["plant.train.a"][-1])
    # an axle without brake is slowed by its contact
    assert mu[5] == pytest.approx(93.75 / 0.445**2 * -a / 153125, rel=0.01)
    assert mu[4] < -10 * mu[5]
    assert np.ptp(np.delete(mu, 5)) == 0


# ---- standstill, brake, motor --------------------------------------------------------------------


def test_brakes_stop_the_train_and_hold_it():
    log = run(train(), 25.0, "damp", 10.0, F=-300e3)
    v, omega = log["plant.train.v"].values, log["plant.train.omega"].values
    assert (omega >= 0).all()
    assert (v > -1e-12).all()
    assert abs(v[-1]) < 1e-9
    assert (omega[-1] == 0).all()


def test_locked_wheel_slides_and_rolls_again():
    rail = Rail([Section(0, "ice"), Section(3, "dry")])
    log = run(train(), 6.0, rail, 25.0, F=-400e3)
    omega, v, mu = (log[f"plant.train.{k}"].values for k in ("omega", "v", "mu"))
    at = 2900
    assert (omega[at] == 0).all()
    sliding = polach(v_s=-v[at + 1], v=v[at], **SURFACES["ice"])["mu"]
    assert mu[at] == pytest.approx(np.full(2, sliding), rel=1e-9)
    assert log["plant.train.v_s_min"].values[-1] > -1


def test_motor_is_limited_by_the_speed_of_its_own_wheel():
    """With the train's speed, a wheel that slips is fed a power that grows with its own."""
    speeds = {}
    for form in ("consistent", "printed-33"):
        rail = Rail([Section(0, "ice"), Section(5, "oily")])
        log = run(train(motor=hst.motor(form)), 15.0, rail, 40.0, F=250e3)
        T, omega = log["plant.motor.T"].values, log["plant.train.omega_d"].values
        speeds[form] = float(log["plant.train.v_s_max"].max())
        power = 10 * (T * omega).max()
        assert (power < 5.5e6 * (1 + 1e-12)) == (form == "consistent")
    assert speeds["printed-33"] > 3 * speeds["consistent"]


def test_motor_lag_and_corner():
    log = run(train(), 0.5, "dry", 5.0, F=100e3)
    F = log["plant.motor.T"].values[:, 0] / 0.445 * 10
    exact = 100e3 * (1 - np.exp(-log["time"].values / 0.05))
    np.testing.assert_allclose(F, exact, atol=1e-3)
    v = np.array([0.0, 10, 18.212, 18.22, 50])
    wanted = [302e3, 302e3, 302e3, 5.5e6 / 18.22, 110e3]
    np.testing.assert_allclose([float(hst.tractive_effort(x)) for x in v], wanted, rtol=1e-5)


def test_resistance():
    assert hst.resistance(v=200 / 3.6)["F_d"] == pytest.approx(38.2e3, rel=1e-3)
    assert hst.resistance(v=0.0)["F_d"] == 0


def test_brake_loop():
    """The loop cancels the cylinder's pole: K_p/T_p = 10 1/s; the supply limits large steps."""
    log = run(train(), 3.0, "dry", 60.0, F=-32 * 3e3)
    F_b, t = log["plant.brake.F_b"].values, log["time"].values
    np.testing.assert_allclose(F_b, 3e3 * (1 - np.exp(-10 * t)), atol=1.0)
    log = run(train(), 5.0, "dry", 60.0, F=-32 * 15e3)
    p, t = log["plant.brake.p"].values, log["time"].values
    assert p.max() <= 450e3 * (1 + 1e-12)
    np.testing.assert_allclose(p, 450e3 * (1 - np.exp(-t / 0.4)), rtol=1e-6, atol=1.0)
    assert float(log["plant.brake.F_b"][-1]) == pytest.approx(15e3, rel=1e-4)


# ---- no chatter ----------------------------------------------------------------------------------

TICKS = 12
ALIKE = rolling(polach, Axles((32,), (0.0,), (True,)), 1e-3)
"""Train whose axles are all alike, so that creep and train are one equation."""


def cases(count):
    """Random speeds, creeps, torques and surfaces; half below 5 m/s, half braked by friction.

    Returns:
        States, inputs and parameters of ``ALIKE``, a column per case.
    """
    rng = np.random.default_rng(3)
    v = np.where(rng.random(count) < 0.5, rng.uniform(0, 90, count), 5 * rng.random(count) ** 2)
    creep = rng.choice([-1, 1], count) * 10 ** rng.uniform(-4, 1, count)
    torque, braked = 0.445 * 10 ** rng.uniform(2, 4.6, count), rng.random(count) < 0.5
    surface = rng.integers(0, len(SURFACES), count)
    values = {k: np.full(count, np.ravel(p)[0]) for k, p in ALIKE.param_values().items()}
    for k in SURFACES["dry"]:
        values[f"adh.{k}"] = np.array([s[k] for s in SURFACES.values()])[surface]
    x = np.stack([np.zeros(count), v, np.maximum(v + creep, 0) / 0.445])
    u = np.stack([braked * torque, np.zeros(count), ~braked * torque])
    assert list(ALIKE.inputs) == ["T_b", "F_d", "T"]
    return x, u, np.stack(list(values.values()))


def flips(mu, u):
    """Cases in which the adhesion turns to the sign against the torque, between two steps."""
    with_torque = np.where(u[0] > 0, -1, 1)
    turned = (mu[1:] * mu[:-1] < 0) & (mu[1:] * with_torque < -1e-9)
    return int(turned.any(axis=0).sum())


def test_adhesion_does_not_chatter_from_standstill_to_90_m_per_s():
    """50 000 cases with --hypothesis-profile=hunt. Creep of one equation moves to one side."""
    count = 50_000 if settings.default.max_examples > 100 else 2_500
    x, u, p = cases(count)
    step, found, worst = ALIKE.f.map(count), [], 0.0
    names = list(ALIKE.outputs)
    for _ in range(TICKS):
        x, y = (np.array(m.full()) for m in step(x, u, p))
        found.append(y[names.index("mu")])
        worst = max(worst, y[names.index("residual")].max())
    assert flips(np.array(found), u) == 0
    assert worst <= 1e-7 * 153125  # of the load of an axle


def test_linearly_implicit_steps_do_chatter():
    """One Newton step from the creep at hand, as such methods take it."""
    count, h, r, J, N, M = 2_500, 1e-3, 0.445, 93.75, 153125.0, 5e5
    x, u, p = cases(count)
    drive = u[2] > 0  # friction brakes left out
    x, u, p = x[:, drive], u[:, drive], p[:, drive]
    own = [list(ALIKE.params).index(f"adh.{k}") for k in polach.params]
    creep, speed, q = ca.MX.sym("s"), ca.MX.sym("v"), ca.MX.sym("q", len(own))
    mu = polach.f(ca.DM(0, 1), ca.vertcat(creep, speed), q)[1]
    law = ca.Function("law", [creep, speed, q], [mu, ca.jacobian(mu, creep)]).map(x.shape[1])
    v, w, found = x[1], x[2], []
    for _ in range(TICKS):
        height, slope = (np.array(m.full())[0] for m in law(r * w - v, v, p[own]))
        # F+ = F + F'(r dw - dv), J dw/h = T - r F+, M dv/h = 32 F+
        K = N * slope
        F = (N * height + K * h * r * u[2] / J) / (1 + K * h * (r * r / J + 32 / M))
        w, v = w + h * (u[2] - r * F) / J, v + h * 32 * F / M
        found.append(F / N)
    assert flips(np.array(found), u) > 100


# ---- speed ---------------------------------------------------------------------------------------


@pytest.mark.second
def test_numpy_peer_does_the_same(needs_compiler):
    """What the benchmark times is the same work: speeds of 0.3 s agree to rounding."""
    from bench.peers import train_loop

    ours = train_loop._rolling(hst.DISTINCT)(300)
    np.testing.assert_allclose(train_loop.Peer().run(300), ours, rtol=1e-12, atol=1e-15)


# ---- target --------------------------------------------------------------------------------------


def test_target_that_motors_and_brakes_cannot_follow_is_refused():
    t, v = np.arange(4.0), np.array([0.0, 10.0, 30.0, 30.0])
    hst.check_target(t, v, [0.5, 0.5, 0.3, -0.8], "slow")
    with pytest.raises(BadInput) as told:
        hst.check_target(t, v, [0.5, 0.5, 0.5, 0.0], "fast")
    at_30 = hst.resistance(v=30.0)["F_d"]
    best = (5.5e6 / 30 - at_30) / hst.M_EFF
    assert str(told.value) == (
        f"fast: at 2 s and 30 m/s it wants {(0.5 * hst.M_EFF + at_30) / 1e3:.4g} kN of the motors,"
        f" which have 183.3 kN; want {best:.3g} m/s^2 there, not 0.5"
    )
    hst.check_target(t, v, [0, 0, best, 0], "just")
    with pytest.raises(BadInput, match=r"hard: at 1 s and 10 m/s it wants .* of the brakes"):
        hst.check_target(t, v, [0.0, -1.0, 0.0, 0.0], "hard")
    with pytest.raises(BadInput, match="must not be negative"):
        hst.check_target(t, v - 1, t, "back")


def test_an_axle_settles_as_newton_does():
    """Its creep after 24 updates: to rounding; 24 halvings of an interval leave 6e-8 of it."""
    axle = axle_at_speed(polach, list(polach.params))[24]
    values = [float(v) for v in polach.param_values().values()]
    rng, N, left = np.random.default_rng(1), 6e4, []
    for _ in range(200):
        v, k = rng.uniform(2, 40), rng.uniform(1e3, 6e5)
        start, free = rng.uniform(-0.5, 0.5), v + rng.uniform(-0.5, 0.5)
        left.append(float(axle(start, v, v, free, k, N, 0.0, *values)[2]))
    assert max(left) < 1e-14 * N
