"""Models of hst_braking: published digits, equations, limits, properties, refusals."""

import math

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Scenario, argmax, sampled, simulate
from slipctl.models.zhang_2021 import ep_valve
from slipctl.models.zhang_2021 import hst_braking as models
from slipctl.models.zhang_2021 import hst_braking_control as control
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc

M, N, I_W, R, G = 13800.0, 4.0, 60.35, 0.43, 9.81
F_Z = M * G / N

LAWS = [models.burckhardt, models.adhesion(True), models.adhesion(False, True)]
BLOCKS = [
    *LAWS, models.davis, models.wheel, models.plant(), models.ideal_plant(),
    *(ep_valve.air_brake(f) for f in ep_valve.FORMS), ep_valve.ep_valve, ep_valve.dead_time(3),
    control.wheel_model, control.accelerometer, control.speed_fusion,
    *(control.slope_identification(f) for f in ("consistent", "printed-41")),
    *(control.gradient_search(f) for f in ("consistent", "printed-40")),
    control.adhesion_meter(), control.family(), control.shaper, control.unshaped,
    *(control.prescribed(f, w, t) for f in ("consistent", "printed-17")
      for w in ("funnel", "barrier") for t in (True, False)),
    control.feedback_linearisation(), control.pid(), control.pid("printed"), control.arbitration,
]  # fmt: skip


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: b.name)
def test_units(block):
    assert block.check_units() == []


# ---- adhesion ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rail", "place", "height"),
    [("dry", 0.1810268, 0.3266569), ("snow", 0.1229218, 0.1382094), ("wet", 0.1556029, 0.2279134)],
)
def test_peaks_have_the_digits_of_the_paper_s_rails(rail, place, height):
    p = models.RAILS[rail]
    best = float(models.peak_slip(**p))
    assert best == pytest.approx(place, abs=0.5e-7 + 1e-7)
    assert float(models.peak_height(**p)) == pytest.approx(height, abs=1e-7)
    assert models.burckhardt(lam=best, **p)["mu"] == pytest.approx(-height, abs=1e-7)
    slope = models.burckhardt.jacobian("mu", "lam")
    assert abs(float(slope(best, *p.values()))) < 1e-12  # the closed form is where it is zero


def test_options_are_off_by_default():
    assert models.adhesion() is models.burckhardt
    snow = models.RAILS["snow"]
    assert abs(models.burckhardt(lam=1.0, **snow)["mu"]) < 1e-11  # a0 = a2: nothing is left
    assert models.adhesion(locked=True)(lam=1.0, **snow)["mu"] == pytest.approx(-0.05, rel=1e-9)
    guessed = models.adhesion(speed=True)
    same = [guessed(lam=0.1, v=50.0, **snow)["mu"], models.burckhardt(lam=0.1, **snow)["mu"]]
    assert same[0] == pytest.approx(same[1], rel=1e-12)
    assert guessed(lam=0.1, v=80.0, **snow)["mu"] > same[0]  # less braking when faster


def test_family_goes_through_the_three_rails():
    family, lam = control.family(), np.linspace(0, 1, 21)
    for p in models.RAILS.values():
        for x in lam:
            ours = family(lam=float(x), a0=p["a0"])["mu"]
            assert ours == pytest.approx(models.burckhardt(lam=float(x), **p)["mu"], abs=1e-12)
        peak = argmax(models.grip(family), "lam", lo=0.005, hi=0.4, at={"a0": p["a0"]})
        assert peak.method == "closed form"
        assert peak.location == pytest.approx(float(models.peak_slip(**p)))


def test_averaged_law_is_the_mean_to_second_order():
    mean = control.mean_adhesion_law(models.burckhardt)
    lam = np.linspace(0.12, 0.13, 2001)
    true = np.mean([models.burckhardt(lam=float(x))["mu"] for x in lam])
    ours = mean(lam=0.125, lam_var=float(lam.var()))["mu"]
    assert ours == pytest.approx(true, abs=1e-7)  # fourth order: a0 a1^4 s^4/120
    assert abs(models.burckhardt(lam=0.125)["mu"] - true) > 2e-5


# ---- plant and brake -----------------------------------------------------------------------------


def test_plant_has_all_terms_of_7():
    v, lam, T_b = 37.0, 0.14, -2500.0
    plant = models.plant()
    omega = v * (1 - lam) / R
    d, y = plant(**{"wheel.v": v, "wheel.omega": omega, "T_b": T_b, "air.c0": 500.0})
    F = F_Z * models.burckhardt(lam=lam)["mu"]
    rate = (d["wheel.v"] * (1 - y["wheel.lam"]) - R * d["wheel.omega"]) / v  # (6)
    formula = (N * (1 - lam) / (M * v) + R**2 / (I_W * v)) * F - R * T_b / (I_W * v)
    formula -= (1 - lam) * 500.0 / (M * v)
    assert y["wheel.lam"] == pytest.approx(lam, rel=1e-12)
    assert rate == pytest.approx(formula, rel=1e-10)


def test_resistance_presets():
    at = {n: models.davis(v=50.0, **p)["F_R"] for n, p in models.DAVIS.items()}
    assert at["zero"] == 0
    assert 500 < at["crh3"] < at["shinkansen"] < 1500  # 4 to 11 N/kN
    assert models.davis(v=0.0, c0=100.0)["F_R"] == 0


def test_wheel_stops_and_stays():
    world = sampled(models.plant(brake=ep_valve.air_brake()), 1e-3, "rk4", substeps=10)
    run = Scenario("stop", 3.0, inputs={"T_cmd": -5e3}, start={"wheel.v": 2.0})
    log = simulate(world, run)
    v, omega = log["wheel.v"].values, log["wheel.omega"].values
    assert v.min() > -1e-9
    assert omega.min() > -1e-6
    assert v[-1] < 1e-3


def test_brake_limits_and_theta():
    ideal = ep_valve.air_brake()
    assert ideal(T_cmd=-3356.0) == {"T_b": -3356.0, "P_c": 100e3}
    assert ideal(T_cmd=1e3)["T_b"] == 0
    assert ideal(T_cmd=-1e6)["T_b"] == pytest.approx(-33.56 * 600)
    lag = ep_valve.air_brake("lag")(P_c=50e3, T_cmd=-3356.0)
    assert lag[0]["P_c"] == pytest.approx((100e3 - 50e3) / 0.02)


def test_valve_fills_holds_and_vents():
    valve, cylinder = ep_valve.ep_valve, ep_valve.air_brake("valve")
    for wanted, has, position in ((-5e3, -1e3, 1), (-1e3, -5e3, -1), (-3e3, -3.05e3, 0)):
        assert valve(T_cmd=wanted, T_b=has)["position"] == position
    rates = [cylinder(P_c=300e3, position=float(p))[0]["P_c"] for p in (1, 0, -1)]
    assert rates[0] == pytest.approx(300e3 / 0.15 - 300)
    assert rates[1] == pytest.approx(-300)
    assert rates[2] == pytest.approx(-300e3 / 0.10 - 300)


def test_dead_time():
    block, x, seen = ep_valve.dead_time(3), {"waiting": np.zeros(3)}, []
    for k in range(6):
        x, y = block(u=float(k), **x)
        seen.append(y["y"])
    assert seen == [0, 0, 0, 0, 1, 2]


# ---- sensors and reference -----------------------------------------------------------------------


def test_fusion_learns_the_bias_while_the_wheel_rolls():
    block = control.speed_fusion

    def rolled(ticks, x, **inputs):
        u, p = block.pack("input", inputs), block.pack("param", block.param_values())
        x, y = block.f.mapaccum(ticks)(x, ca.repmat(u, 1, ticks), ca.repmat(p, 1, ticks))
        return x[:, -1], block.unpack("state", x[:, -1]), block.unpack("output", y[:, -1])

    x = block.pack("state", block.start())
    x, state, y = rolled(6000, x, omega=50 / R, a_m=0.02, F_a=0.0)
    assert float(state["b_h"]) == pytest.approx(0.02, abs=1e-3)
    assert float(y["v"]) == pytest.approx(50.0, abs=1e-3)
    before = float(y["variance_v"])
    # braked: only the accelerometer, so that the variance grows
    _, _, y = rolled(2000, x, omega=40 / R, a_m=0.02, F_a=-8e3)
    assert float(y["variance_v"]) > before
    assert float(y["v"]) == pytest.approx(50.0, abs=5e-3)


def test_accelerometer_takes_a_gradient_for_a_bias():
    at = control.accelerometer(a=-1.0, n=0.0, slope=0.01)["a_m"]
    assert at == pytest.approx(-1.0 + 0.0981)


def test_meter_is_exact_and_starts_afresh_after_a_change():
    block = control.adhesion_meter(10)
    x = block.start()
    omega, F, lam = 50 / R, -5e3, 0.1
    for k in range(40):
        x, y = block(omega=omega, T_b=-1500.0, lam=lam, changed=float(k == 20), **x)
        if k == 20:
            F = -9e3
        omega += (-1500.0 - R * F) / I_W * 1e-3
        if k > 10:
            assert y["mu_m"] == pytest.approx((-5e3 if k <= 20 else -9e3) / F_Z, rel=1e-9)


def test_meter_takes_no_jump_for_an_acceleration():
    """A speed that is missing and comes back 10 rad/s lower: the window begins with it."""
    block = control.adhesion_meter(10)
    x = block.start()
    omega, F, T_b = 50 / R, -5e3, -1500.0
    for k in range(60):
        gone = 10.0 if k >= 30 else 0.0
        x, y = block(omega=omega - gone, T_b=T_b, lam=0.1, changed=0.0, **x)
        omega += (T_b - R * F) / I_W * 1e-3
        if k == 30:
            assert x["count"] == 1
            assert y["mu_m"] == pytest.approx(T_b / (R * F_Z), rel=1e-9)  # without acceleration
        elif k > 10:
            assert y["mu_m"] == pytest.approx(F / F_Z, rel=1e-9)


def test_shaper_never_falls_faster_than_a_released_wheel():
    block, x = control.shaper, {"limited": 0.2, "smooth": 0.2}
    fastest = ppc.slip_fall_rate(4500.0, 40.0, R, I_W)
    for _ in range(400):
        before = x["smooth"]
        x, y = block(best=0.1, lam=x["smooth"], F_a=-4500.0, v=40.0, **x)
        assert (x["smooth"] - before) / 1e-3 >= -0.8 * fastest - 1e-9
        assert y["rate"] == pytest.approx((x["smooth"] - before) / 1e-3, abs=1e-9)
    assert x["smooth"] == pytest.approx(0.1, abs=1e-4)


# ---- slip laws -----------------------------------------------------------------------------------


TRACKING = [
    control.prescribed(), control.prescribed(law="barrier"), control.feedback_linearisation()
]  # fmt: skip


@pytest.mark.parametrize("law", TRACKING, ids=lambda b: b.name)
@pytest.mark.parametrize("v", [3.0, 45.0])
def test_law_makes_the_slip_move_as_wanted(law, v):
    """With the true adhesion force, lam' on the plant is lam*' + the law's own pull."""
    lam, rate = 0.15, 0.2
    F = F_Z * models.burckhardt(lam=lam)["mu"]
    given = dict(lam=lam, lam_ref=lam, rate=rate, v=v, F_a=F)
    answer = law(**given)
    T = (answer if law.kind == "law" else answer[1])["T_wanted"]
    d, _ = models.plant()(**{"wheel.v": v, "wheel.omega": v * (1 - lam) / R, "T_b": T})
    moved = (d["wheel.v"] * (1 - lam) - R * d["wheel.omega"]) / v
    assert moved == pytest.approx(rate, rel=1e-9)


def test_funnel_law_pulls_as_the_certificate_says():
    law, eta = control.prescribed(motion=False), 0.05
    for z in (-0.9, -0.3, 0.5, 0.7):
        e = z * 1.2 * eta
        given = dict(lam=0.1 + e, lam_ref=0.1, rate=0.0, v=50.0, F_a=0.0, k=0.0, eta_h=eta)
        nu = -law(count=0.0, **given)[1]["T_wanted"] * R / (I_W * 50.0)
        assert nu == pytest.approx(-100 * eta * 1.2 * ppc.restoring_pull(z), rel=1e-9)
    barrier = control.prescribed(law="barrier", motion=False)
    given["lam"] = 0.1 + 0.9 * 1.2 * eta
    nu = -barrier(count=0.0, **given)[1]["T_wanted"] * R / (I_W * 50.0)
    assert nu == pytest.approx(-100 * eta * 1.2 * math.atanh(0.9), rel=1e-9)


def test_printed_minus_is_infinite_at_the_target_and_turns_its_sign():
    law = control.prescribed("printed-17")
    ours = control.prescribed(motion=False)
    torque = {}
    for e in (-1e-6, 1e-6, 1e-3):
        given = dict(lam=0.15 + e, lam_ref=0.15, rate=0.0, v=50.0, F_a=-8e3, eta_h=0.005, count=0.0)
        torque[e] = [b(**given)[1]["T_wanted"] for b in (law, ours)]
    # K1 eps/l does not vanish with the error: it keeps asking for K1 eta delta of slip rate
    constant = 100 * 0.005 * 1.2 * I_W * 50 / R
    for e in (-1e-6, 1e-6):
        assert torque[e][0] - torque[e][1] == pytest.approx(-constant, rel=1e-2)


def test_funnel_restarts_beyond_its_trip():
    law = control.prescribed()
    given = dict(lam_ref=0.1, rate=0.0, v=50.0, F_a=-8e3, eta_h=0.005, count=2.0)
    calm = law(lam=0.1055, **given)[0]
    assert calm["count"] == 2
    assert calm["eta_h"] < 0.005 + 1e-12
    wide = law(lam=0.13, **given)[0]
    assert wide["count"] == 3
    assert wide["eta_h"] == pytest.approx(0.005 + 0.095 * math.exp(-0.03), rel=1e-9)
    asleep = law(lam=0.13, **(given | {"v": 0.5}))
    assert asleep[0]["count"] == 2
    assert abs(asleep[1]["share"]) <= 1 + 1e-12


def test_pid_rule_puts_both_poles_at_half_the_gain():
    law = control.pid()
    v = 30.0
    b = R / (I_W * v)
    jac = law.function().factory("j", law.function().name_in(), ["jac:y_T_wanted:u_lam"])
    at = {"x_integral": 0.0, "x_e_last": 0.0, "u_lam": 0.1, "u_lam_ref": 0.1, "u_v": v}
    at |= {f"p_{n}": float(s.value) for n, s in law.params.items()}
    K_p = float(ca.DM(jac(*[at[n] for n in law.function().name_in()])))
    given = dict(lam=0.101, lam_ref=0.1, v=v, integral=-5e3, e_last=0.0)
    K_i = (law(**given)[0]["integral"] + 5e3) / 1e-3 / 1e-3
    assert np.roots([1, b * K_p, b * K_i]) == pytest.approx([-50, -50], rel=1e-5)


def test_pid_integral_stands_still_while_limited():
    law = control.pid()
    given = dict(lam=0.0, lam_ref=0.1, v=50.0, integral=0.0, e_last=-0.1)
    assert law(**given)[0]["integral"] == 0


def test_low_speed_torque_stays_below_what_the_rail_carries():
    law = control.arbitration
    given = dict(F_a=-3000.0, carried=4000.0, T_wanted=-50e3)
    assert law(v=0.5, **given)[1]["T_b"] == pytest.approx(-0.7 * R * 4000)
    assert law(v=0.5, **given)[0]["carried"] == 4000
    assert law(v=5.0, **given)[1]["T_b"] == -20e3
    mild = law(v=0.5, a_demand=0.1, **given)[1]["T_b"]
    assert mild == pytest.approx(-(R * M * 0.1 / N + I_W * 0.1 / R))


# ---- refusals ------------------------------------------------------------------------------------


def test_settings_that_cannot_work_are_refused_with_what_would_pass():
    with pytest.raises(BadInput, match="K1 = 2000 1/s would pass"):
        control.controller(_raised(K1=3000.0))
    with pytest.raises(BadInput, match=r"eta_0 = .* would pass"):
        control.controller(_raised(eta_0=0.05))
    with pytest.raises(BadInput, match=r"a step of .* would pass"):
        control.controller(
            control.prescribed(), "gradient", search=control.gradient_search("printed-40"),
            shape=control.unshaped,
        )  # fmt: skip
    with pytest.raises(BadInput):
        control.adhesion_filter().with_params(gamma=-0.1)
    with pytest.raises(BadInput):
        control.adhesion_filter().with_params(sigma=-1.5)
    with pytest.raises(BadInput):
        control.adhesion_filter().with_params(prior_F_a=0.0)


def _raised(**numbers):
    return control.prescribed().with_params(**numbers)


def test_a_gain_set_later_is_refused_before_the_run():
    loop = control.controller(control.prescribed()).with_params(**{"law.K1": 5000.0})
    with pytest.raises(BadInput, match="kappa"):
        loop.param_values()


@pytest.mark.parametrize(
    "make",
    [lambda: control.prescribed("printed-15"), lambda: control.pid("tuned"),
     lambda: control.controller(control.pid(), "guess"), lambda: ep_valve.air_brake("magnetic"),
     lambda: ep_valve.dead_time(0), lambda: control.adhesion_meter(0),
     lambda: control.family({"dry": models.RAILS["dry"]})],
)  # fmt: skip
def test_unknown_choices_are_refused(make):
    with pytest.raises(BadInput):
        make()


@pytest.mark.parametrize("locked", [False, True])
@pytest.mark.parametrize("speed", [False, True])
@pytest.mark.parametrize("rail", ["dry", "wet", "snow"])
def test_a_locked_wheel_keeps_adhesion_only_where_that_is_asked(locked, speed, rail):
    """With neither option it is the printed curve; the floor is 0 without the first one."""
    block = models.adhesion(locked=locked, speed=speed)
    printed, numbers = models.burckhardt, models.RAILS[rail]
    assert (block is printed) == (not locked and not speed)
    if block is printed:
        return
    assert float(block.params["mu_l"].value) == (0.05 if locked else 0.0)
    assert block.choices == {"locked": locked, "speed": speed}
    assert block.law_data.meant_to == (1.0 if locked else printed.law_data.meant_to)
    for lam in (0.02, 0.1, 0.5, 1.0):
        plain = -float(printed(lam=lam, **numbers)["mu"])
        floor = (0.05 if locked else 0.0) * (1 - np.exp(-numbers["a1"] * lam))
        for v in (0.0, 50.0, 80.0) if speed else (None,):
            got = -float(block(lam=lam, **numbers, **({} if v is None else {"v": v}))["mu"])
            falls = 1.0 if v is None else np.exp(-0.005 * (v - 50.0))
            assert got == pytest.approx(falls * max(plain, floor), rel=1e-12, abs=1e-15)
