"""Observer, anti-slip limit and control laws of Wang 2025, apart from the train."""

import math

import casadi as ca
import numpy as np
import pytest
from reduced_train import BY_MU, G, R, W, observed, reduced_run

from slipctl import BadInput, RunFailed
from slipctl.models.wang_2025 import hst_traction_adhesion as adhesion
from slipctl.models.wang_2025 import hst_traction_control as control
from slipctl.models.wang_2025.certificate import adhesion_observer as bounds
from slipctl.models.wang_2025.certificate import higher_order as proofs
from slipctl.models.wheel_rail.contact import SURFACES, peak, polach


@pytest.mark.parametrize(
    "block",
    [
        adhesion.adhesion_observer(),
        adhesion.adhesion_observer("explicit"),
        adhesion.linear_observer,
        adhesion.usable_adhesion(2),
        adhesion.antislip_limit(2),
        adhesion.characteristic,
        control.tracking,
        control.higher_order("printed"),
        control.higher_order(compensation=False),
        *control.laws().values(),
    ],
    ids=lambda b: b.name,
)
def test_units(block):
    assert block.check_units() == []


# ---- observer ------------------------------------------------------------------------------------


def rms(e):
    return float(np.sqrt(np.mean(np.square(e))))


def test_implicit_form_has_its_bound_and_explicit_euler_chatters():
    for T in (5e-3, 1e-3, 1e-4):
        implicit = observed(adhesion.adhesion_observer(), T)
        explicit = observed(adhesion.adhesion_observer("explicit"), T)
        assert np.abs(implicit).max() <= BY_MU * bounds.implicit_error(1500.0, T) * 1.001
        assert rms(implicit) < 0.4 * rms(explicit)
    ratio = rms(explicit) / rms(observed(adhesion.adhesion_observer("explicit"), 1e-3))
    assert ratio == pytest.approx(0.1, rel=0.2)  # an error of order T


def test_linear_observer_does_not_gain_by_a_shorter_step():
    slow, fast = (rms(observed(adhesion.linear_observer, T)) for T in (1e-3, 1e-4))
    assert slow == pytest.approx(fast, rel=0.05)
    assert fast > 100 * rms(observed(adhesion.adhesion_observer(), 1e-4))


@pytest.mark.parametrize("discretisation", ["implicit", "explicit"])
def test_a_step_of_the_adhesion_is_seen_within_the_bound(discretisation):
    """A jump of f by 80 rad/s^2, mu by 0.11, after which f stands still."""
    T, jump = 1e-4, 80.0
    block = adhesion.adhesion_observer(discretisation).with_params(T_o=T, B_t=0.0, K_3=0.0)
    p = block.param_values()
    limit = bounds.convergence_time(float(p["K_1"]), float(p["K_2"]), 1e-3, 0.0, jump)
    ticks = math.ceil(limit / T)
    u = np.vstack([100 - jump * T * np.arange(ticks), np.zeros(ticks)])
    x = block.pack("state", block.start(z1=100.0))
    _, y = block.f.mapaccum(ticks)(x, u, ca.repmat(block.pack("param", p), 1, ticks))
    assert float(y[-1]) == pytest.approx(BY_MU * jump, abs=BY_MU * 2 * float(p["K_2"]) * T)


def test_torque_and_adhesion_in_balance():
    """A wheel that turns evenly under a torque: mu W g r = T - B_t omega."""
    block, T = adhesion.adhesion_observer(), 3000.0
    x = block.start(z1=90.0, T_last=T)
    for _ in range(400):
        x, y = block(**x, omega=90.0, T=T)
    assert y["mu_hat"] == pytest.approx((T - 0.01 * 90) / (R * W * G), rel=1e-9)


def test_gains_that_do_not_hold_the_slope_are_refused():
    with pytest.raises(BadInput, match="K2 above 4000"):
        adhesion.adhesion_observer(gains=(98.5, 3000.0, 0.5))
    with pytest.raises(BadInput, match=r"K1 above 44\.33"):
        adhesion.adhesion_observer(gains=(40.0, 4400.0, 0.5))
    adhesion.adhesion_observer(gains=(45.0, 4400.0, 0.5))
    with pytest.raises(BadInput, match="implicit, explicit"):
        adhesion.adhesion_observer("tustin")


# ---- limit ---------------------------------------------------------------------------------------


USABLE = adhesion.usable_adhesion(1)


def usable(surface, v, v_s, last=0.0, mu=None):
    """Usable adhesion and class of an axle on a surface, observed exactly."""
    block = USABLE
    seen = polach(v_s=v_s, v=v, **SURFACES[surface])["mu"] if mu is None else mu
    start = block.start(**{"axle.class.last": [last]})
    _, y = block(**start, omega=[(v + v_s) / R], mu_hat=[seen], v=v)
    return float(np.ravel(y["axle.class.mu_lim"])[0]), int(np.ravel(y["axle.class.surface"])[0])


NAMES = list(SURFACES)


@pytest.mark.parametrize("v", [3.0, 12.0, 40.0, 70.0])
@pytest.mark.parametrize("surface", NAMES)
@pytest.mark.parametrize("side", [1, -1])
def test_class_and_limit(surface, v, side):
    tops = {n: peak(v, n).value for n in NAMES}
    v_s = side * 0.6 * peak(v, surface).location
    mu_lim, found = usable(surface, v, v_s)
    assert NAMES[found] == surface
    poorer = [m for m in tops.values() if m < tops[surface]]
    wanted = max(poorer) if poorer else 0.9 * tops[surface]
    assert mu_lim == pytest.approx(wanted, rel=5e-3)  # straight lines between the table's speeds


def test_order_is_that_of_the_present_speed():
    """Wet rail is the next poorer one of oily rail below 5 m/s, and the other way round above."""
    slow = {n: peak(3.0, n).value for n in NAMES}
    fast = {n: peak(40.0, n).value for n in NAMES}
    assert slow["wet"] < slow["oily"]
    assert fast["wet"] > fast["oily"]
    at_3 = usable("oily", 3.0, 0.6 * peak(3.0, "oily").location)[0]
    at_40 = usable("wet", 40.0, 0.6 * peak(40.0, "wet").location)[0]
    assert at_3 == pytest.approx(slow["wet"], rel=5e-3)
    assert at_40 == pytest.approx(fast["oily"], rel=5e-3)


def test_beyond_the_peak_less_than_the_rail_carries_is_allowed():
    v_s = 4 * peak(40.0, "ice").location
    seen = polach(v_s=v_s, v=40.0, **SURFACES["ice"])["mu"]
    assert usable("ice", 40.0, v_s)[0] == pytest.approx(0.7 * seen, rel=1e-9)


def test_class_is_kept_where_the_curves_do_not_differ():
    assert usable("ice", 40.0, 1e-4, last=2.0)[1] == 2
    assert usable("ice", 40.0, 0.3, last=2.0)[1] == NAMES.index("ice")


def test_poorest_axle_decides_and_characteristic_limits():
    limit = adhesion.antislip_limit(3)
    y = limit(mu_lim=[0.2, 0.05, 0.1], F_hi_0=2e5, F_lo_0=-4.8e5)
    assert y["F_hi"] == pytest.approx(10 * 0.05 * W * G)
    assert y["F_lo"] == pytest.approx(-32 * 0.05 * W * G)
    y = limit(mu_lim=[0.2, 0.3, 0.4], F_hi_0=2e5, F_lo_0=-4.8e5)
    assert (y["F_hi"], y["F_lo"]) == (2e5, -4.8e5)


def test_the_controller_is_not_told_the_rail():
    block = control.controller(control.robust)
    assert block.conditions == {}


# ---- laws ----------------------------------------------------------------------------------------


def test_sliding_variable_does_not_know_the_saturation():
    """s' = u - delta/M whatever is cut off; linear in the states, so RK4 keeps it to rounding."""
    free, _, _ = reduced_run(1e9)
    limited, e1, gain = reduced_run(150e3)
    assert np.abs(e1).max() > 10  # the limit bites
    # a rounding of 1e-14 m/s in s is 1e-7 behind the root; 150 kN are 0.3 m/s^2
    assert np.abs(limited - free).max() < 1e-7
    assert gain.max() < 1.0


def test_position_is_regained_at_the_rates_k1_and_k3():
    """Within the limit lam' = -k3 lam and e2 + k1 e1 = lam, so e1 has the poles -k1 and -k3."""
    _, e1, _ = reduced_run(150e3, seconds=340.0)
    lam = np.gradient(e1, 1e-3) + 0.5 * e1
    large = [np.flatnonzero(np.abs(lam) > level)[-1] for level in (0.1, 0.01)]
    assert math.log(10) / ((large[1] - large[0]) * 1e-3) == pytest.approx(0.2, rel=0.01)
    assert abs(e1[-1]) < 1e-3


def test_without_compensation_it_winds_up():
    s, e1, gain = reduced_run(150e3, compensation=False, seconds=150.0)
    assert np.abs(s).max() > 30
    assert gain.max() > 10
    assert abs(e1[-1]) > 10


def test_printed_40_runs_away_as_soon_as_the_limit_bites():
    with pytest.raises(RunFailed, match="law"):
        reduced_run(150e3, form="printed-40")
    s, _, _ = reduced_run(1e9, form="printed-40", seconds=5.0)  # lam = 0 without a limit
    assert np.abs(s).max() < 1e-3


def test_gains_of_the_sliding_mode():
    p = control.higher_order().param_values()
    proven = proofs.certified_eta(float(p["alpha"]), float(p["beta"]), float(p["k_4"]))
    assert proven == pytest.approx(control.ETA, rel=1e-9)
    p = control.higher_order("printed").param_values()
    proven = proofs.certified_eta(float(p["alpha"]), float(p["beta"]), float(p["k_4"]))
    assert proven == pytest.approx(0.00936143, abs=5e-9)
    with pytest.raises(BadInput, match="optimum, printed"):
        control.higher_order("best")


ERRORS = {"e1": 2.0, "e2": -0.5, "a_ff": 0.3, "F_hi": 1e9, "F_lo": -1e9}


def test_laws_are_their_formulas():
    M, s = 500e3, 0.5 * 2.0 - 0.5
    smc = control.sliding_mode(**ERRORS)["F_contr"]
    assert smc == pytest.approx(M * (0.25 + 0.3 - 0.05 * np.sign(s)))
    _, y = control.adaptive_sliding_mode(d_hat=0.1, **ERRORS)
    assert y["F_contr"] == pytest.approx(M * (0.25 + 0.3 - 15 * s / 10 - 0.1))
    assert control.robust(**ERRORS)["F_contr"] == pytest.approx(M * (0.3 + 0.9 - 2.0))
    rest = {k: v for k, v in ERRORS.items() if k != "a_ff"}
    assert control.pid(**rest)["F_contr"] == pytest.approx(-M * (-0.75 + 0.8))


@pytest.mark.parametrize("name", ["hosm", "smc", "asmc", "mpc", "robust", "pid"])
def test_every_law_keeps_its_limits(name):
    law = control.laws()[name]
    given = {k: v for k, v in ERRORS.items() if k in law.inputs} | {"F_hi": 6e4, "F_lo": -5e4}
    for e1, e2, wanted in ((-50.0, -5.0, 6e4), (50.0, 5.0, -5e4)):
        start = law.start(**({"F_last": wanted} if name == "mpc" else {}))
        called = law(**start, **given | {"e1": e1, "e2": e2})
        y = called if law.kind == "law" else called[1]
        assert y["F_contr"] == pytest.approx(wanted, rel=1e-3)
        assert -5e4 <= y["F_contr"] <= 6e4


def test_first_move_of_predictive_control_keeps_the_jerk():
    law = control.predictive()
    x = law.start(F_last=0.0)
    given = {**ERRORS, "e1": -20.0, "e2": 0.0, "a_ff": 0.0, "F_hi": 3e5, "F_lo": -4e5}
    last = 0.0
    for _ in range(20):
        x, y = law(**x, **given)
        assert y["F_contr"] - last <= 500e3 * 1.0 * 5e-3 + 1e-6
        last = y["F_contr"]
    assert last > 4e4


def test_bad_input():
    with pytest.raises(BadInput, match="axles = 0"):
        control.controller(control.pid, axles=0)
    with pytest.raises(BadInput, match=r"0 rail conditions, it takes 2 or more; name them, pid\."):
        adhesion.typical_surfaces(control.pid)
