"""Equations of plants, meters and limits at points where every number is another one, again."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.huang_2020 import subway_braking_control as subway_control
from slipctl.models.wang_2025 import hst_traction, hst_traction_adhesion
from slipctl.models.zhang_2021 import (
    hst_braking_control,
    hst_braking_estimate,
    hst_braking_reference,
)


def sign(x: float) -> float:
    return (x > 0) - (x < 0)


# ---- subway of Huang 2020 ------------------------------------------------------------------------

CAR = dict(m=9e3, J=210.0, r=0.42)


def test_the_braked_wheel_of_the_subway_and_what_resists_it() -> None:
    for form, turned in (("consistent", 1), ("printed-6", -1)):
        for omega, share in ((30.0, 1.0), (0.03, 0.3), (-0.5, -1.0)):
            d, y = subway.wheelset(form)(
                x=5.0, v=15.0, omega=omega, phi=2.0, T_b=4e3, mu=0.12, f=200.0, W=300.0, g=9.7,
                omega_0=0.1, slope=0.02, **CAR,
            )  # fmt: skip
            F = 0.12 * 9e3 * 9.7
            a = (F + 500) / 9e3 + 9.7 * 0.02
            assert (d["x"], d["v"], d["phi"]) == (15.0, pytest.approx(-a), omega)
            assert d["omega"] == pytest.approx((turned * 0.42 * F - 4e3 * share) / 210)
            assert y["v_s"] == pytest.approx(15 - 0.42 * omega)
            assert (y["F_a"], y["a"]) == (pytest.approx(F), pytest.approx(a))
    assert subway.air_resistance(v=12.0, k0=90.0, k1=4.0, k2=0.5)["f"] == 90 + 48 + 72
    curve = dict(kappa=0.004, l_t=120.0)
    for l_r, inside, beyond in ((60.0, 0.5, 1.0), (240.0, 1.0, 2.0)):
        W = subway.curve_resistance()(l_r=l_r, k=0.7, m=9e3, g=9.7, **curve)["W"]
        assert pytest.approx(0.7 * 0.004 * inside * 9e3 * 9.7) == W
        printed = subway.curve_resistance("printed-10")(l_r=l_r, **curve)["W"]
        assert printed == pytest.approx(600 * 0.004 * beyond)
    mu = subway.double_exponential(v_s=0.7, c=0.8, a=0.5, b=1.3)["mu"]
    assert mu == pytest.approx(0.8 * (math.exp(-0.35) - math.exp(-0.91)))
    d, y = subway.ideal_plant()(**{"wheel.v": 12.0, "v_opt": 0.7, "slope": 0.01})
    assert y["wheel.v_s"] == 0.7
    whole = subway.ideal_plant().param_values()
    m, g = (float(whole.get(n, whole.get(f"wheel.{n}"))) for n in ("m", "g"))
    k = [float(whole[f"air.k{i}"]) for i in range(3)]
    a = y["adh.mu"] * g + (k[0] + 12 * k[1] + 144 * k[2]) / m
    assert -d["wheel.v"] == pytest.approx(a + g * 0.01)


def test_the_torque_that_keeps_the_slip_and_the_reaching_law() -> None:
    T = subway_control.equivalent_torque(mu_hat=0.1, f_hat=200.0, W_hat=300.0, g=9.7, **CAR)["T_eq"]
    F = 0.1 * 9e3 * 9.7
    assert pytest.approx(210 / 0.42 * ((F + 500) / 9e3 + F * 0.42**2 / 210)) == T
    for v, best, wanted in ((3.0, 1.2, 0.9), (9.0, 1.2, 1.2), (-1.0, 1.2, 0.0)):
        found = subway_control.slip_reference(v=v, v_opt=best, share=0.3)["v_ref"]
        assert found == pytest.approx(wanted)
    for v_s in (1.5, 0.9):
        y = subway_control.reaching_law()(
            v_s=v_s, v_ref=1.1, T_eq=3e3, g1=30.0, g2=8.0, J=210.0, r=0.42
        )
        s = v_s - 1.1
        assert y["s"] == pytest.approx(s)
        assert y["T_wanted"] == pytest.approx(3e3 + 500 * (-30 * s - 8 * sign(s)))


@pytest.mark.parametrize("form", ["consistent", "printed-38"])
@pytest.mark.parametrize("s", [0.3, -0.2, 1e-7])
@pytest.mark.parametrize("top", [9e3, 100.0])
def test_super_twisting_explicit_and_by_its_inclusion(form, s, top) -> None:
    """y + T k1 |y|^(1/2) sgn y + T^2 k2 xi = s, xi in Sgn(y); limited, its integral stays."""
    turned = 1 if form == "consistent" else -1
    given = dict(u_sw=0.5, v_s=1.1 + s, v_ref=1.1, T_eq=3e3, T_top=top, k1=15.0, k2=8.0, J=210.0,
                 r=0.42, T=2e-3)  # fmt: skip
    nxt, y = subway_control.super_twisting(form)(**given)
    wanted = turned * (3e3 + 500 * (0.5 - 15 * abs(s) ** 0.5 * sign(s)))
    assert y["T_wanted"] == pytest.approx(wanted, rel=1e-6)
    free = 0 <= wanted <= top
    assert nxt["u_sw"] == pytest.approx(0.5 - (2e-3 * 8 * sign(s) if free else 0))
    nxt, y = subway_control.super_twisting(form, discretisation="proper_implicit")(**given)
    nu = (turned * y["T_wanted"] - 3e3) / 500
    size = 4e-6 * 8
    if abs(s) <= size:
        xi, root = s / size, 0.0
    else:
        xi = sign(s)
        root = (math.sqrt((2e-3 * 15) ** 2 + 4 * (abs(s) - size)) - 2e-3 * 15) / 2
        assert root**2 + 2e-3 * 15 * root + size == pytest.approx(abs(s))
    assert nu == pytest.approx(0.5 - 2 * 2e-3 * 8 * xi - 15 * root * sign(s), rel=1e-6)
    free = 0 <= y["T_wanted"] <= top
    assert nxt["u_sw"] == pytest.approx(0.5 - (2e-3 * 8 * xi if free else 0))


@pytest.mark.parametrize(("wanted", "v", "demand", "T_b", "top"), [
    (5e3, 9.0, 2.0, 5e3, 8350.0), (9e3, 9.0, 2.0, 8350.0, 8350.0), (-1e3, 9.0, 2.0, 0.0, 8350.0),
    (5e3, 0.9, 2.0, 3e3, 3e3), (9e3, 9.0, 9.0, 9e3, 1.1e4), (5e3, 9.0, 0.01, 0.0, 0.0),
    (99.0, 0.9, 0.1, 249.8, 249.8),
])  # fmt: skip
def test_what_is_applied_is_the_demand_or_less(wanted, v, demand, T_b, top) -> None:
    y = subway_control.arbitration(
        T_wanted=wanted, v=v, a_demand=demand, f_hat=200.0, W_hat=100.0, T_max=1.1e4, v_off=1.0,
        T_low=3e3, **CAR,
    )  # fmt: skip
    full = 0.42 * (9e3 * demand - 300) + 210 * demand / 0.42
    assert y["T_top"] == pytest.approx(max(0, min(full, 1.1e4 if v >= 1 else 3e3)))
    assert y["T_b"] == pytest.approx(min(y["T_top"], max(0, wanted)) if v >= 1 else y["T_top"])
    assert y["T_b"] <= y["T_top"]
    if wanted == 9e3 and demand == 2.0:
        assert y["T_b"] == pytest.approx(full)


# ---- train of Zhang 2021 -------------------------------------------------------------------------


@pytest.mark.parametrize(("v", "wanted", "demand"), [
    (30.0, -4e3, 5.0), (30.0, 500.0, 5.0), (30.0, -9e4, 9.0), (30.0, -4e3, 0.4), (0.7, -4e3, 5.0),
])  # fmt: skip
def test_arbitration_of_the_fast_train_keeps_what_the_rail_carries(v, wanted, demand) -> None:
    nxt, y = hst_braking_control.arbitration(
        carried=7e3, T_wanted=wanted, v=v, F_a=-9e3, a_demand=demand, m=14e3, n=3.0, J=65.0, r=0.44,
        T_max=1.2e4, v_off=1.0, part=0.6,
    )  # fmt: skip
    full = 0.44 * 14e3 * demand / 3 + 65 * demand / 0.44
    kept = 9e3 if v > 1 else 7e3
    allowed = min(1.2e4, max(0, -wanted)) if v > 1 else 0.6 * 0.44 * 7e3
    assert nxt["carried"] == kept
    assert y["T_b"] == pytest.approx(-min(full, allowed))


@pytest.mark.parametrize(("omega", "F_a", "rolled"), [
    (91.0, 100.0, 5.0), (80.0, 100.0, 5.0), (80.0, 100.0, 20.0), (91.0, -5e3, 7.0),
    (95.0, -5e3, 7.0), (0.0, 100.0, 20.0), (400.0, 900.0, 3.0), (90.5, 100.0, 5.0),
    (90.5, -5e3, 7.0), (88.0, 100.0, 19.0),
])  # fmt: skip
def test_speed_is_fused_where_the_wheel_rolls_or_is_faster(omega, F_a, rolled) -> None:
    """Correction and prediction of a Kalman filter of speed and bias, in matrices."""
    r, T, sw, sc, sa, sb = 0.44, 2e-3, 3e-3, 0.03, 0.06, 2e-3
    P = np.array([[0.02, -0.003], [-0.003, 0.05]])
    nxt, y = hst_braking_estimate.speed_fusion(
        v_h=40.0, b_h=0.1, P_vv=P[0, 0], P_vb=P[0, 1], P_bb=P[1, 1], rolled=rolled, omega=omega,
        a_m=-1.5, F_a=F_a, r=r, sigma_a=sa, sigma_b=sb, sigma_w=sw, sigma_c=sc, F_roll=250.0,
        far=0.9, calm=20.0, v_0=0.1, T=T,
    )  # fmt: skip
    rim = r * omega
    small = abs(F_a) < 250
    used = (small and (abs(rim - 40) < 0.9 or rolled >= 20)) or rim > 40
    H = np.array([1.0, 0.0])
    K = used * P @ H / (P[0, 0] + (r * sw) ** 2 + sc**2)
    v, b = np.array([40.0, 0.1]) + K * (rim - 40)
    A = (np.eye(2) - np.outer(K, H)) @ P
    F = np.array([[1.0, -T], [0.0, 1.0]])
    ahead = F @ A @ F.T + np.diag([(T * sa) ** 2, T * sb**2])
    b = max(-2, min(2, b))
    assert y["v"] == pytest.approx(v)
    assert nxt["v_h"] == pytest.approx(max(-1, min(120, v + T * (-1.5 - b))))
    assert nxt["b_h"] == pytest.approx(b)
    assert [nxt["P_vv"], nxt["P_vb"], nxt["P_bb"]] == pytest.approx(
        [ahead[0, 0], ahead[0, 1], ahead[1, 1]]
    )
    assert nxt["rolled"] == (min(20, rolled + 1) if small else 0)
    lam = max(-1.5, min(1.5, (v - rim) / max(v, 0.1)))
    assert y["lam"] == pytest.approx(lam)
    assert y["variance_v"] == pytest.approx(A[0, 0])
    far = max(v, 0.1)
    assert y["variance_lam"] == pytest.approx(
        ((1 - lam) / far) ** 2 * A[0, 0] + (r * sw / far) ** 2
    )


@pytest.mark.parametrize("torque", ["held", "sampled"])
@pytest.mark.parametrize("count", [4, 3, 1])
def test_the_meter_has_the_mean_of_the_ticks_in_its_window(torque, count) -> None:
    """Increment of the wheel speed, trapezoid of the slip; of the torque as it is held or not."""
    omegas, torques = np.array([80.0, 79.0, 77.5, 77.0]), np.array([-2e3, -2.5e3, -2.2e3, -3e3])
    slips = np.array([0.05, 0.07, 0.06, 0.09])
    made = hst_braking_reference.adhesion_meter(4, torque)
    given: dict[str, Any] = dict(
        omegas=omegas, torques=torques, slips=slips, count=count, before=0.0, omega=76.0,
        T_b=-3.3e3, lam=0.1, m=14e3, n=3.0, J=65.0, r=0.44, g=9.7, T=2e-3, T_most=1e6,
    )  # fmt: skip
    nxt, y = made(changed=0.0, **given)
    w, t, s = omegas[4 - count :], torques[4 - count :], slips[4 - count :]
    mean = t.mean() if torque == "held" else (t.sum() + (-3.3e3 - t[0]) / 2) / count
    load = 0.44 * 14e3 * 9.7 / 3
    assert y["mu_m"] == pytest.approx((mean - 65 * (76 - w[0]) / (count * 2e-3)) / load)
    lam = (s.sum() + (0.1 - s[0]) / 2) / count
    assert y["lam_m"] == pytest.approx(lam)
    square = ((s - lam) ** 2).sum() + ((0.1 - lam) ** 2 - (s[0] - lam) ** 2) / 2
    assert y["var_m"] == pytest.approx(square / count)
    assert np.ravel(nxt["omegas"]).tolist() == [79.0, 77.5, 77.0, 76.0]
    assert np.ravel(nxt["torques"]).tolist() == [-2.5e3, -2.2e3, -3e3, -3.3e3]
    assert np.ravel(nxt["slips"]).tolist() == [0.07, 0.06, 0.09, 0.1]
    assert (nxt["count"], nxt["before"]) == (min(4, count + 1), 0)
    for changed, before, begun in ((1.0, 0.0, True), (1.0, 1.0, False), (0.0, 1.0, False)):
        nxt, _ = made(changed=changed, **given | {"before": before})
        assert (nxt["count"], nxt["before"]) == (1 if begun else min(4, count + 1), changed)
    nxt, y = made(changed=0.0, **given | {"T_most": 3.2e4})  # 65 times 1/2e-3 is more
    assert nxt["count"] == 1
    assert y["mu_m"] == pytest.approx(mean / load)


@pytest.mark.parametrize(("changed", "active", "unsure", "recalled", "wanted", "kept"), [
    (1, 0, 1, 0, 0.6 * 0.12, (0.12, 1)), (0, 1, 1, 0, 0.6 * 0.2, (0.2, 1)),
    (0, 0, 1, 0, 0.08, (0.2, 0)), (1, 0, 0, 0, 0.08, (0.2, 0)), (0, 1, 1, 1, 0.08, (0.2, 0)),
])  # fmt: skip
def test_an_unsure_reference_goes_to_the_safe_side(
    changed, active, unsure, recalled, wanted, kept
) -> None:
    nxt, y = hst_braking_reference.caution(
        first=0.2, active=active, best=0.08, lam=0.12, changed=changed, unsure=unsure,
        recalled=recalled, depth=0.6,
    )  # fmt: skip
    assert y["best_safe"] == pytest.approx(wanted)
    assert (nxt["first"], nxt["active"]) == kept


# ---- train of Wang 2025 --------------------------------------------------------------------------


def test_the_train_its_axles_motors_and_resistance() -> None:
    d, y = hst_traction.body(x=3.0, v=20.0, F_mu=700.0, F_d=9e3, n=30.0, m=4e5)
    assert (d["x"], d["v"], y["a"]) == (20.0, *[pytest.approx((30 * 700 - 9e3) / 4e5)] * 2)
    d, y = hst_traction.wheelset(
        omega=50.0, T=900.0, mu=0.07, v=20.0, m_axle=13e3, J=80.0, B_t=0.5, r=0.43, g=9.7
    )
    F = 0.07 * 13e3 * 9.7
    assert d["omega"] == pytest.approx((900 - 0.43 * F - 25) / 80)
    assert (y["F_mu"], y["v_w"], y["v_s"]) == (
        pytest.approx(F), pytest.approx(21.5), pytest.approx(1.5))  # fmt: skip
    for v, fades in ((25.0, 1.0), (0.004, 0.4), (-3.0, -1.0)):
        found = hst_traction.resistance(
            v=v, w_0=6.0, w_1=0.07, w_2=0.002, m=4e5, v_0=0.01, slope=0.01, g=9.7
        )["F_d"]
        V = 3.6 * v
        rolling = (6 + 0.07 * V + 0.002 * V * V) * 400 * fades
        assert found == pytest.approx(rolling + 4e5 * 9.7 * 0.01)
    for F in (3e4, -5e4):
        y = hst_traction.distribution(F_contr=F, n_m=8.0, n_b=25.0)
        assert (y["F_m"], y["F_b"]) == (max(F, 0) / 8, max(-F, 0) / 25)
    for form, rim in (("consistent", 0.43 * 70.0), ("printed-33", 26.0)):
        for command in (9e4, 1e3, -5.0):
            d, y = hst_traction.motor(form)(
                F_m=2e4, F_cmd=command, omega=70.0, v=26.0, tau=0.07, F_top=3.1e5, P_top=5e6,
                n_m=9.0, r=0.43,
            )  # fmt: skip
            limit = 5e6 / rim / 9
            assert d["F_m"] == pytest.approx((max(0, min(command, limit)) - 2e4) / 0.07)
            assert y["T"] == pytest.approx(0.43 * min(2e4, limit))


@pytest.mark.parametrize(("p", "q", "command"), [
    (1e5, 1.1e5, 5e3), (1e5, 4e5, 9e4), (1e5, -3e6, 5e3), (2e5, 1e5, -10.0),
])  # fmt: skip
def test_the_air_brake_has_a_supply_and_no_more(p, q, command) -> None:
    d, y = hst_traction.air_brake(
        p=p, q=q, F_cmd=command, p_max=4e5, F_max=14e3, z=6.0, phi_k=0.3, R_m=0.25, gamma_z=2.2,
        eta_z=0.9, r=0.43, T_p=0.3, K_p=3.0,
    )  # fmt: skip
    per = 14e3 / 4e5
    ref = min(max(command / per, 0), 4e5)
    u = 3 * (ref - p) + q
    limited = min(max(u, 0), 4e5)
    assert y["p_ref"] == pytest.approx(ref)
    assert (y["F_b"], y["T_b"]) == (pytest.approx(per * p), pytest.approx(per * p * 0.43))
    assert d["p"] == pytest.approx((limited - p) / 0.3)
    assert d["q"] == pytest.approx(10 * (ref - p) + (limited - u) / 0.3)


@pytest.mark.parametrize(("mu_hat", "v_s", "surface", "allowed"), [
    (0.21, 0.8, 2, 0.15), (0.21, 3.5, 2, 0.6 * 0.21), (0.13, 0.8, 1, 0.09),
    (0.06, 0.8, 3, 0.8 * 0.09), (0.4, 0.8, 0, 0.28), (-0.21, -3.5, 2, 0.6 * 0.21),
    (0.21, 0.1, 1, 0.09),
    (0.21, -0.8, 1, 0.09),
])  # fmt: skip
def test_the_surface_is_the_nearest_curve_and_the_next_poorer_peak_is_used(
    mu_hat, v_s, surface, allowed
) -> None:
    """Where creep and adhesion have other signs or there is little creep, it stays what it was."""
    nxt, y = hst_traction_adhesion.classification(4)(
        last=1.0, mu_hat=mu_hat, v_s=v_s, mu=sign(v_s) * np.array([0.35, 0.14, 0.2, 0.07]),
        mu_max=np.array([0.4, 0.15, 0.28, 0.09]), v_best=np.array([1.0, 2.0, 3.0, 4.0]), margin=0.8,
        blind=0.01, least=0.2, cut=0.6,
    )  # fmt: skip
    assert (nxt["last"], y["surface"]) == (surface, surface)
    assert y["mu_lim"] == pytest.approx(allowed)


def test_curves_that_lie_close_together_tell_nothing() -> None:
    given = dict(mu_hat=0.2, v_s=1.0, mu=np.array([0.2, 0.195]), mu_max=np.array([0.4, 0.15]),
                 v_best=np.array([3.0, 2.0]), least=0.0)  # fmt: skip
    for blind, found in ((0.006, 1), (0.004, 0)):
        nxt, _ = hst_traction_adhesion.classification(2)(last=1.0, blind=blind, **given)
        assert nxt["last"] == found


def test_the_poorest_axle_limits_the_train_beside_its_characteristic() -> None:
    made = hst_traction_adhesion.antislip_limit(3)
    for top, low in ((9e5, -9e5), (1e4, -2e4)):
        y = made(mu_lim=np.array([0.2, 0.11, 0.3]), F_hi_0=top, F_lo_0=low, n_m=8.0, n_b=25.0,
                 m_axle=13e3, g=9.7)  # fmt: skip
        assert y["mu_least"] == pytest.approx(0.11)
        assert y["F_hi"] == pytest.approx(min(8 * 0.11 * 13e3 * 9.7, top))
        assert y["F_lo"] == pytest.approx(max(-25 * 0.11 * 13e3 * 9.7, low))
    for v, F in ((5.0, 3e5), (20.0, 5e6 / 20)):
        y = hst_traction_adhesion.characteristic(v=v, F_top=3e5, P_top=5e6, F_brake=4e5)
        assert (y["F_hi"], y["F_lo"]) == (pytest.approx(F), -4e5)
    assert hst_traction_adhesion.creep(omega=50.0, v=20.0, r=0.43)["v_s"] == pytest.approx(1.5)
