"""Equations of laws and observers at points where every number is another one, written again."""

from __future__ import annotations

import math

import pytest
from scipy.optimize import brentq

from slipctl import BadInput
from slipctl.models.wang_2025 import hst_traction
from slipctl.models.wang_2025 import hst_traction_adhesion as adhesion
from slipctl.models.wang_2025 import hst_traction_control as control
from slipctl.models.zhang_2021 import hst_braking, hst_braking_laws, hst_braking_reference

AXLE = dict(J=130.0, r=0.43, B_t=3.0, m_axle=11e3, g=9.7, T_o=4e-3)


def sign(x: float) -> float:
    return (x > 0) - (x < 0)


# ---- observers of Wang 2025 ----------------------------------------------------------------------


@pytest.mark.parametrize("e", [0.03, -0.4, 2.5])
def test_the_explicit_observer_is_eulers_step(e: float) -> None:
    gains = dict(K_1=90.0, K_2=4500.0, K_3=0.7)
    nxt, y = adhesion.adhesion_observer("explicit")(
        z1=60.0 + e, z2=15.0, T_last=700.0, omega=60.0, T=900.0, **AXLE, **gains
    )
    phi1 = sign(e) * (abs(e) ** 0.5 + 0.7 * abs(e) ** 1.5)
    phi2 = sign(e) * (0.5 + 2 * 0.7 * abs(e) + 1.5 * 0.49 * e * e)
    assert nxt["z1"] == pytest.approx(
        60 + e + 4e-3 * (900 / 130 - 3 / 130 * 60 + 15 - 90 * phi1), rel=1e-12
    )
    assert nxt["z2"] == pytest.approx(15 - 4e-3 * 4500 * phi2, rel=1e-12)
    assert nxt["T_last"] == 900
    assert y["mu_hat"] == pytest.approx(-130 * 15 / (0.43 * 11e3 * 9.7), rel=1e-12)
    nxt, y = adhesion.linear_observer(
        z1=60.0 + e, z2=15.0, omega=60.0, T=900.0, K_1=80.0, K_2=3000.0, **AXLE
    )
    assert nxt["z1"] == pytest.approx(60 + e + 4e-3 * (900 / 130 - 180 / 130 + 15 - 80 * e))
    assert nxt["z2"] == pytest.approx(15 - 4e-3 * 3000 * e)
    assert y["mu_hat"] == pytest.approx(-130 * 15 / (0.43 * 11e3 * 9.7))


@pytest.mark.parametrize("e_0", [0.004, -0.02, 0.9, -6.0])
def test_the_implicit_observer_solves_for_the_error_after_the_tick(e_0: float) -> None:
    """e + T K1 Phi1(e) + T^2 K2 Phi2(e) = e_0 by bisection; where that is too small, e = 0."""
    T, K1, K2, K3 = 4e-3, 90.0, 4500.0, 0.7
    ahead = T * ((900 + 700) / 260 - 3 / 130 * 60 + 15)
    nxt, y = adhesion.adhesion_observer()(
        z1=60 + e_0 - ahead, z2=15.0, T_last=700.0, omega=60.0, T=900.0, K_1=K1, K_2=K2, K_3=K3,
        **AXLE,
    )  # fmt: skip

    def rest(e: float) -> float:
        phi2 = 0.5 + 2 * K3 * e + 1.5 * K3**2 * e * e
        return e + T * K1 * (e**0.5 + K3 * e**1.5) + T**2 * K2 * phi2 - abs(e_0)

    if abs(e_0) <= T**2 * K2 / 2:
        e, phi2 = 0.0, e_0 / (T**2 * K2)
    else:
        e = sign(e_0) * brentq(rest, 0, abs(e_0), xtol=1e-15, rtol=1e-14)
        phi2 = sign(e_0) * (0.5 + 2 * K3 * abs(e) + 1.5 * K3**2 * e * e)
    assert nxt["z1"] == pytest.approx(60 + e, abs=1e-9)
    assert nxt["z2"] == pytest.approx(15 - T * K2 * phi2, rel=1e-7)
    assert y["mu_hat"] == pytest.approx(-130 * nxt["z2"] / (0.43 * 11e3 * 9.7), rel=1e-12)


# ---- laws of Wang 2025 ---------------------------------------------------------------------------

TRAIN = dict(e1=0.3, e2=-0.2, a_ff=0.15, F_hi=1e5, F_lo=-3e5, m=4e5)


@pytest.mark.parametrize(("form", "compensation"), [
    ("consistent", True), ("printed-40", True), ("consistent", False),
])  # fmt: skip
@pytest.mark.parametrize("k_a", [0.05, 0.2])
@pytest.mark.parametrize(("e1", "e2"), [(0.3, -0.2), (-0.3, 0.1)])
def test_the_higher_order_law_is_29_to_39(form, compensation, k_a, e1, e2) -> None:
    numbers = dict(k_1=0.9, k_3=0.25, k_4=0.12, alpha=0.03, beta=0.11, sigma=0.002, k_max=3.0)
    numbers |= TRAIN | {"e1": e1, "e2": e2}
    made = control.higher_order(form=form, compensation=compensation)
    rates, y = made(v_H=0.04, k_a=k_a, lam=0.02, **numbers)
    s = 0.9 * e1 + e2 - (0.02 if form == "consistent" else -0.02)
    gain, size = max(k_a, 0.12), abs(s)
    phi1, phi2 = sign(s) * (size**0.5 + size), sign(s) * (0.5 + 1.5 * size**0.5 + size)
    F = 4e5 * (-0.9 * e2 + 0.15 - 0.25 * 0.02 - gain * phi1 + 0.04)
    assert (y["s"], y["k_1H"]) == (pytest.approx(s), gain)
    assert y["F_wanted"] == pytest.approx(F)
    assert y["F_contr"] == pytest.approx(min(1e5, max(-3e5, F)))
    assert rates["v_H"] == pytest.approx(-2 * 0.11 * gain * phi2)
    assert rates["k_a"] == pytest.approx(phi1 * phi2 * 2 * 0.03 / (1 + 4 * 0.11**2))
    left = -0.25 * 0.02 - (F - y["F_contr"]) / 4e5 if compensation else 0
    assert rates["lam"] == pytest.approx(left)
    full, _ = made(v_H=0.04, k_a=3.5, lam=0.02, **numbers)
    assert (full["k_a"] == 0) == (form == "consistent" and compensation)
    near, _ = made(v_H=0.04, k_a=k_a, lam=0.02, **numbers | {"sigma": 1.0})
    wanted = -rates["k_a"] if k_a > 0.12 else 0  # within its band it falls, to k_4
    assert near["k_a"] == pytest.approx(wanted)


def test_the_sliding_modes_switch_or_saturate_and_one_learns() -> None:
    s = 0.9 * 0.3 - 0.2
    for e2, side in ((-0.2, 1), (-0.4, -1)):
        y = control.sliding_mode(k_1=0.9, k_smc=0.06, **TRAIN | {"e2": e2})
        F = 4e5 * (-0.9 * e2 + 0.15 - side * 0.06)
        assert (y["F_wanted"], y["F_contr"]) == (pytest.approx(F), 1e5)
        assert y["s"] == pytest.approx(0.27 + e2)
    y = control.sliding_mode(k_1=0.9, k_smc=0.06, **TRAIN | {"a_ff": -2.0})
    assert y["F_contr"] == -3e5
    for sigma, share in ((10.0, s / 10), (0.01, 1.0)):
        nxt, y = control.adaptive_sliding_mode(
            d_hat=0.05, k_1=0.9, sigma=sigma, k_2=1.5, d_1=8.0, T=0.004, **TRAIN
        )
        F = 4e5 * (0.18 + 0.15 - 1.5 * share - 0.05)
        assert y["F_wanted"] == pytest.approx(F)
        assert y["F_contr"] == pytest.approx(min(1e5, max(-3e5, F)))
        assert nxt["d_hat"] == pytest.approx(0.05 + 0.004 * 8 * s)
    y = control.robust(k_v=1.7, k_x=0.8, **TRAIN)
    assert y["F_wanted"] == pytest.approx(4e5 * (0.15 + 1.7 * 0.2 - 0.8 * 0.3))


# ---- laws of Zhang 2021 --------------------------------------------------------------------------

WHEEL = dict(m=14e3, n=3.0, J=65.0, r=0.44)


@pytest.mark.parametrize("motion", [True, False])
def test_feedback_linearisation_gives_the_error_its_rate(motion: bool) -> None:
    """Put into (7): lam' = (1 - lam) v'/v - r omega'/v with the torque that it wants."""
    lam, v, F_a = 0.12, 40.0, -9e3
    y = hst_braking_laws.feedback_linearisation(motion)(
        lam=lam, lam_ref=0.08, rate=0.3, v=v, F_a=F_a, K=70.0, v_min=0.5, **WHEEL
    )
    dv = 3 * F_a / 14e3 if motion else 0.0
    domega = (y["T_wanted"] - 0.44 * F_a) / 65
    assert (1 - lam) * dv / v - 0.44 * domega / v == pytest.approx(-70 * 0.04 + 0.3)
    assert y["e"] == pytest.approx(0.04)


@pytest.mark.parametrize("e", [0.004, -0.003])
@pytest.mark.parametrize("law", ["funnel", "barrier"])
def test_the_funnel_law_gives_its_transformed_error_its_rate(e: float, law: str) -> None:
    """zeta = e/eta has l (e' - e eta'/eta) = -K1 eps, with 1/l from (12), or as at zeta = 0."""
    numbers = dict(eta_0=0.1, eta_inf=0.004, k=25.0, delta_l=1.1, delta_u=1.3, K1=90.0, trip=0.95,
                   reserve=0.6, v_min=0.5, v_off=1.0, T=1e-3)  # fmt: skip
    lam, v, F_a, eta = 0.08 + e, 40.0, -9e3, 0.006
    nxt, y = hst_braking_laws.prescribed(law=law)(
        eta_h=eta, count=2.0, lam=lam, lam_ref=0.08, rate=0.2, v=v, F_a=F_a, **numbers, **WHEEL
    )
    zeta = e / eta
    eps = math.log((zeta + 1.1) / (1.3 - zeta)) / 2
    ell = (1 / (zeta + 1.1) + 1 / (1.3 - zeta)) / (2 * eta)
    ell = ell if law == "funnel" else 1 / (eta * 1.2)
    deta = -25 * (eta - 0.004)
    domega = (y["T_wanted"] - 0.44 * F_a) / 65
    de = (1 - lam) * 3 * F_a / 14e3 / v - 0.44 * domega / v - 0.2
    assert ell * (de - e * deta / eta) == pytest.approx(-90 * eps, rel=1e-9)
    assert nxt["eta_h"] == pytest.approx(0.004 + 0.002 * math.exp(-0.025))
    assert (y["upper"], y["lower"]) == (pytest.approx(1.3 * eta), pytest.approx(-1.1 * eta))
    assert y["share"] == pytest.approx(max(e / (1.3 * eta), -e / (1.1 * eta)))
    assert y["restarts"] == nxt["count"] == 2


def test_the_law_as_printed_is_15_and_17() -> None:
    """With the minus of (15) and g' = 1/g of (17); its funnel never restarts."""
    e, eta, v, F_a = 0.02, 0.006, 40.0, -9e3
    nxt, y = hst_braking_laws.prescribed("printed-17")(
        eta_h=eta, count=2.0, lam=0.1, lam_ref=0.08, rate=0.2, v=v, F_a=F_a, eta_0=0.1,
        eta_inf=0.004, k=25.0, delta_l=1.1, delta_u=5.3, K1=90.0, v_min=0.5, T=1e-3, **WHEEL,
    )  # fmt: skip
    zeta = e / eta
    ell = (1 / (zeta + 1.1) - 1 / (5.3 - zeta)) / (2 * eta)
    deta, b = -25 * 0.002, 0.44 / (65 * v)
    wanted = 90 * math.log((zeta + 1.1) / (5.3 - zeta)) / 2 + 0.44 * b * ell * F_a
    wanted += -ell * deta / eta * e - ell * 0.2
    assert y["T_wanted"] == pytest.approx(wanted / (b * ell))
    assert nxt["eta_h"] == pytest.approx(0.004 + 0.002 * math.exp(-0.025))
    assert nxt["count"] == 2


@pytest.mark.parametrize(("e", "widened"), [
    (0.95 * 1.3 * 0.006 + 1e-6, None), (-0.95 * 1.1 * 0.006 - 1e-6, None), (0.4, 0.4 / 1.3 / 0.6),
    (-0.4, 0.4 / 1.1 / 0.6),
])  # fmt: skip
def test_a_funnel_restarts_wider_where_the_error_comes_near_its_bound(e, widened) -> None:
    numbers = dict(eta_0=0.1, eta_inf=0.004, k=25.0, delta_l=1.1, delta_u=1.3, trip=0.95,
                   reserve=0.6, v_off=1.0, T=1e-3)  # fmt: skip
    for v, counted in ((40.0, 3), (0.9, 2)):
        nxt, y = hst_braking_laws.prescribed()(
            eta_h=0.006, count=2.0, lam=0.08 + e, lam_ref=0.08, rate=0.2, v=v, F_a=-9e3, **numbers
        )
        eta = widened or 0.1
        assert nxt["eta_h"] == pytest.approx(0.004 + (eta - 0.004) * math.exp(-0.025))
        assert nxt["count"] == counted
        shown = 0.006 if v > 1 else max(eta, abs(e) / 1.1)
        assert y["upper"] == pytest.approx(1.3 * shown)


@pytest.mark.parametrize(("gains", "integral", "e"), [
    ("rule", -500.0, 0.03), ("printed", -500.0, 0.03), ("rule", -4e5, -0.02), ("rule", -4e5, 0.02),
    ("rule", 5e5, 0.02), ("printed", 5e5, -0.02),
])  # fmt: skip
def test_a_pid_of_the_slip_stands_still_where_its_torque_is_limited(gains, integral, e) -> None:
    """Its integral goes on where that leads back."""
    nxt, y = hst_braking_laws.pid(gains)(
        integral=integral, e_last=0.01, lam=0.08 + e, lam_ref=0.08, v=40.0, K=60.0, K_p=7e3,
        K_i=9e3, K_d=20.0, T_max=2e4, v_min=0.5, J=65.0, r=0.44, T=2e-3,
    )  # fmt: skip
    b = 0.44 / (65 * 40)
    P, I = (60 / b, 3600 / (4 * b)) if gains == "rule" else (7e3, 9e3)
    wanted = P * e + integral + (20 * (e - 0.01) / 2e-3 if gains == "printed" else 0)
    assert y["T_wanted"] == pytest.approx(wanted)
    free = -2e4 < wanted < 0 or (wanted >= 0 and e < 0) or (wanted <= -2e4 and e > 0)
    assert nxt["integral"] == pytest.approx(integral + (2e-3 * I * e if free else 0))
    assert nxt["e_last"] == pytest.approx(e)


# ---- reference of Zhang 2021 ---------------------------------------------------------------------

SLOPE = dict(chi_h=-2e4, P=0.3, F_last=-8e3, lam_f=0.05, lam_last=0.052, age=0.5, F_a=-8.03e3,
             lam=0.0528, rho_1=0.85, rho_2=0.6, gate=0.01, P_top=50.0, settle=0.02, gain=0.2,
             T=1e-3)  # fmt: skip


@pytest.mark.parametrize("zeta", [1e3, 1e6])
@pytest.mark.parametrize("form", ["consistent", "printed-41"])
def test_the_slope_is_learnt_by_least_squares_that_forget(form, zeta) -> None:
    """Faster where the force changes fast; the slip has the lag of the filter, as printed none."""
    nxt, y = hst_braking_reference.slope_identification(form)(zeta=zeta, jump=1e9, **SLOPE)
    printed = form == "printed-41"
    now = 0.0528 if printed else 0.05 + 0.2 * (0.0524 - 0.05)
    dF, dlam = -30 / 1e-3, (now - 0.05) / 1e-3
    rho = 0.6 if abs(dF) > zeta else 0.85
    beta = 0.3 * dlam / (rho + 0.3 * dlam**2)
    chi, P = -2e4 + beta * (dF + dlam * 2e4), (1 - beta * dlam) * 0.3 / rho
    assert y["chi"] == nxt["chi_h"] == pytest.approx(chi)
    assert nxt["P"] == pytest.approx(P)
    assert (nxt["lam_f"], nxt["lam_last"]) == (pytest.approx(now), 0.0528)
    assert (nxt["F_last"], y["fresh"]) == (-8.03e3, 1)
    assert nxt["age"] == pytest.approx(0.5 if printed else 0.501)


def test_a_change_of_the_rail_begins_the_slope_anew_and_a_slip_that_stands_teaches_nothing() -> (
    None
):
    made = hst_braking_reference.slope_identification()
    nxt, y = made(zeta=1e3, jump=1e3, **SLOPE)
    assert (nxt["chi_h"], nxt["P"], nxt["age"], y["fresh"]) == (0, 50, 0, 0)
    for changed in ({"age": 0.0}, {"lam": 0.048}):  # too early; (0.048 + 0.052)/2 is lam_f
        nxt, y = made(zeta=1e3, jump=1e9, **SLOPE | changed)
        assert (nxt["chi_h"], nxt["P"], y["fresh"]) == (-2e4, 0.3, 0)
    nxt, _ = made(zeta=1e3, jump=1e9, **SLOPE | {"P_top": 0.2})
    assert nxt["P"] == 0.2


@pytest.mark.parametrize(("chi", "lam", "fresh", "moved"), [
    (-1500.0, 0.105, 1, 0.5e-3 * 0.6), (-9e9, 0.105, 1, 0.5e-3), (900.0, 0.095, 1, -0.5e-3 * 0.36),
    (-1500.0, 0.115, 1, 0), (-1500.0, 0.105, 0, 0), (8e3, 0.1, 1, -0.5e-3),
])  # fmt: skip
def test_a_search_goes_up_the_adhesion_by_its_slope_once_the_slip_has_followed(
    chi, lam, fresh, moved
) -> None:
    numbers = dict(rate=0.25, chi_0=2500.0, near=0.01, lo=0.005, hi=0.4, h_1=0.02, T=2e-3)
    nxt, y = hst_braking_reference.gradient_search()(
        best_h=0.1, chi=chi, fresh=fresh, lam=lam, **numbers
    )
    assert y["best"] == nxt["best_h"] == pytest.approx(0.1 + moved, rel=1e-12)
    nxt, _ = hst_braking_reference.gradient_search("printed-40")(
        best_h=0.1, chi=chi, fresh=fresh, lam=lam, **numbers
    )
    assert nxt["best_h"] == pytest.approx(0.1 - 0.02 * sign(chi))
    made = hst_braking_reference.gradient_search()
    for at, slope, end in ((0.4, -9e9, 0.4), (0.005, 9e9, 0.005)):
        nxt, _ = made(best_h=at, chi=slope, fresh=1, lam=at, **numbers)
        assert nxt["best_h"] == end


@pytest.mark.parametrize("lam", [0.02, 0.9])
def test_adhesion_of_a_locked_wheel_has_a_floor_and_falls_with_the_speed(lam: float) -> None:
    a0, a1, a2 = 0.4, 20.0, 0.5
    rise = 1 - math.exp(-20 * lam)
    grip = max(0.4 * rise - 0.5 * lam, 0.06 * rise)
    curve = dict(lam=lam, a0=a0, a1=a1, a2=a2, mu_l=0.06)
    assert hst_braking.adhesion(locked=True)(**curve)["mu"] == pytest.approx(-grip)
    found = hst_braking.adhesion(locked=True, speed=True)(v=30.0, v_n=45.0, k_v=0.01, **curve)
    assert found["mu"] == pytest.approx(-grip * math.exp(0.15))
    assert (grip > 0.4 * rise - 0.5 * lam) == (lam > 0.5)


@pytest.mark.parametrize(("best", "lam", "F_a", "v"), [
    (0.2, 0.11, -9e3, 30.0), (0.02, 0.11, -9e3, 30.0), (0.02, 0.11, -200.0, 30.0),
    (0.1203, 0.11, -9e3, 30.0), (0.2, 0.2, -9e3, 30.0), (0.02, 0.11, -20.0, 0.2),
])  # fmt: skip
def test_a_reference_rises_and_falls_as_fast_as_the_wheel_follows(best, lam, F_a, v) -> None:
    """Then it is smoothed; while the slip is far off it waits."""
    nxt, y = hst_braking_reference.shaper(
        limited=0.12, smooth=0.115, best=best, lam=lam, F_a=F_a, v=v, up=0.4, share=0.7,
        tau_ref=0.02, near=0.03, v_off=1.0, J=65.0, r=0.44, T=2e-3,
    )  # fmt: skip
    down = min(0.4, 0.7 * 0.44**2 * abs(F_a) / (65 * max(v, 1.0)))
    moved = 0.12 + max(-down * 2e-3, min(0.4 * 2e-3, best - 0.12))
    limited = moved if abs(lam - 0.115) < 0.03 else 0.12
    assert nxt["limited"] == pytest.approx(limited, rel=1e-12)
    rate = (limited - 0.115) / 0.022
    assert (y["lam_ref"], y["rate"]) == (0.115, pytest.approx(rate))
    assert nxt["smooth"] == pytest.approx(0.115 + 2e-3 * rate)


@pytest.mark.parametrize("make", [
    hst_braking_reference.slope_identification, hst_braking_reference.gradient_search,
    hst_braking_laws.prescribed, hst_traction.motor,
])  # fmt: skip
def test_a_form_that_there_is_not_is_refused(make) -> None:
    with pytest.raises(BadInput, match="has no form 'own'"):
        make("own")
