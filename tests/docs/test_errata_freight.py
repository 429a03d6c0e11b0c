"""Rows 004.1 to 004.13 and 004.22 to 004.33 of docs/errata.md, measured; see test_errata."""

import math
from functools import cache

import numpy as np
import pytest
from errata import shows
from scipy.optimize import brentq

from slipctl import BadInput, Scenario, connect, linear, luenberger, simulate, sliding_seek
from slipctl.certify.bounds import extremum
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022.certificate import barrier as bounds
from slipctl.studies.freight_traction.experiments import dry_map
from slipctl.studies.freight_traction.loops import (
    CHANGES,
    FORMS,
    MODELS,
    SPEED,
    TABLE_1,
    H,
    best,
    knowing,
    rail_of,
    seeking,
)

R, GEAR, J, M, W, G = 0.625, 6.294, 40.0, 6e6, 30e3, 9.8
GAMMA = R / (J * GEAR)
DRY, WET = freight.SURFACES["dry"], freight.SURFACES["wet"]
PEAK = float(freight.peak_creep(0.54, 1.2))
K, K_S = 1200.0, 0.02
K_A = K_S + PEAK


@cache
def in_base(name: str):
    """Creep error, and creep less the best one, of a loop in ``base``."""
    seek, _, ending = name.partition("_")
    law = MODELS["adh"]
    loop = seeking(law, MODELS[seek], FORMS[ending])
    scenario = Scenario("base", 25.0, rail_of(law, TABLE_1, CHANGES))
    log = simulate(loop, scenario, log=["ctl.barrier.e", "plant.train.v_s", "truth.v_best"])
    creep = log["plant.train.v_s"].values - log["truth.v_best"].values
    return log["ctl.barrier.e"].values, creep


def held(form: str, v_ref: float, seconds: float, error: float = 0.0):
    """Creep error and D of a loop that starts at its wanted creep and knows the adhesion."""
    start = {"plant.train.omega_m": (SPEED + v_ref) * GEAR / R}
    scenario = Scenario(
        "held", seconds, inputs={"v_ref": v_ref, "rate": 0.0}, start=start,
        params={"ctl.disturbance.m_axle": W * (1 + error)},
    )  # fmt: skip
    log = simulate(knowing(freight.adhesion, form), scenario,
                   log=["ctl.barrier.e", "plant.train.D"])  # fmt: skip
    return log["ctl.barrier.e"].values, float(log["plant.train.D"][0])


def first(over: np.ndarray) -> float:
    """Time of the first true tick in s."""
    assert over.any()
    return float(np.argmax(over)) * H


def slope(v: float) -> float:
    return 1.2 * math.exp(-1.2 * v) - 0.54 * math.exp(-0.54 * v)


def test_columns_of_table_1():
    for row, texts, ours, printed in (
        ("004.1", ("0.2678", "0.28617"), DRY, freight.PRINTED["dry_printed"]),
        ("004.2", ("0.0217", "0.20604"), WET, freight.PRINTED["wet_printed"]),
    ):
        shows(row, texts[0], float(freight.peak_height(**printed)))
        shows(row, texts[1], float(freight.peak_height(**ours)))


def test_best_creep_does_not_move():
    for p in (DRY, WET):
        shows("004.3", "1.20986", float(freight.peak_creep(**p)))
    for text, p in zip(("1.2099", "1.8148", "0.8066"), freight.MOVING.values(), strict=True):
        shows("004.3", text, float(freight.peak_creep(**p)))
    shows("004.3", "0.72", best(freight.adhesion, "wet")[1] / best(freight.adhesion, "dry")[1])


def test_diameter_is_a_radius():
    shows("004.4", "8350", 0.286 * W * G * R / GEAR)
    shows("004.4", "4175", 0.286 * W * G * R / 2 / GEAR)


def test_one_axle():
    force = float(freight.peak_height(**DRY)) * W * G
    shows("004.5", "84.1", force / 1e3)
    shows("004.5", "0.0140", force / M)
    shows("004.5", "0.112", 8 * force / M)
    shows("004.5", "45", freight.resistance(v=5.0)["F_Z"] / 1e3)


def test_printed_9_is_the_negative():
    rng = np.random.default_rng(1)
    for _ in range(5):
        T, mu, F_Z = rng.uniform(0, 1e4), rng.uniform(0, 0.3), rng.uniform(0, 1e5)
        n, _ = freight.train(x=0.0, v_t=5.0, omega_m=60.0, T_m=T, mu=mu, F_Z=F_Z, n_d=1.0)
        ours = R / GEAR * n["omega_m"] - n["v_t"]
        F_a = mu * W * G
        printed = (F_a - F_Z) / M - GAMMA * T + R**2 / (J * GEAR**2) * F_a
        assert ours == pytest.approx(-printed, rel=1e-9, abs=1e-12)


def test_literal_law_rests_or_escapes():
    e, D = held("printed-42", PEAK, 3.0)
    shows("004.7", "11.5", -1e3 * e[-1])
    assert e[-1] == pytest.approx(-bounds.settled_error(2 * D, K, K_A), rel=1e-3)
    low, _ = held("printed-42", -0.05, 0.1)
    shows("004.7", "0.0056", first(low >= K_S))
    e, _ = in_base("smes_printed")
    shows("004.7", "0.0358", first(e >= K_S))
    shows("004.7", "0.187", first(e >= 1.0))


def test_proof_with_one_plant():
    """V' = e e'/(k_x^2 - e^2) of (43), (46), with e' = g T - D - v' and the corrected T."""
    rng = np.random.default_rng(2)
    for e in rng.uniform(-K_A, K_S, 20):
        D, rate, k_x = rng.uniform(0, 30), rng.uniform(-1, 1), K_A if e < 0 else K_S
        T = (D + rate - bounds.pull(e, K, k_x)) / GAMMA
        slope_of_e = GAMMA * T - D - rate
        assert e * slope_of_e / (k_x**2 - e**2) == pytest.approx(-2 * K * e**2, rel=1e-6)


def test_what_the_barrier_holds():
    bound = bounds.largest_disturbance(K, K_S)
    shows("004.9", "0.00739", bound)
    shows("004.9", "2.98", bound / GAMMA)
    e, D = held("consistent", PEAK, 3.0, 1e-3)
    shows("004.9", "0.0355", 100 * bound / D)
    shows("004.9", "1.269", first(e >= K_S))
    shows("004.9", "1.90", first(e >= 1.0))
    told = bounds.escape_time(1e-3 * (D + 45e3 / M), K, K_S)
    assert first(e >= K_S) == pytest.approx(told, rel=1e-3)
    e, _ = in_base("improved_corrected")
    shows("004.9", "4.4", 1e3 * (first(e >= K_S) - 10.0))
    e, _ = held("robust", PEAK, 3.0, 0.05)
    shows("004.9", "0.0126", e.max())


def test_gains_of_the_two_sides():
    shows("004.10", "0.96", bounds.rate(K, K_S))
    shows("004.10", "3630", bounds.rate(K, K_A))
    shows("004.10", "3781", bounds.rate(K, K_A) / bounds.rate(K, K_S))
    shows("004.10", "0.551", 1e3 * bounds.stable_period(K, K_A, K_S))
    shows("004.10", "0.310", 1e3 * bounds.largest_period(K, K_A, K_S))


def test_printed_observer_gains():
    def poles(L1: float, L2: float, sign: float = -1.0) -> list[float]:
        A = np.array([[0, -1 / J], [0, 0]]) + sign * np.array([[L1, 0], [L2, 0]])
        return sorted(np.linalg.eigvals(A).real)

    for texts, found in (
        (("0.025", "39.97"), poles(-40, -40)),
        (("-40.02", "0.025"), poles(-40, -40, 1.0)),
        (("-39.97", "-0.025"), poles(40, -40)),
    ):
        for text, value in zip(texts, found, strict=True):
            shows("004.11", text.lstrip("-"), abs(value))
    for inertia in (1.0, 1000.0):
        A = np.array([[40, -1 / inertia], [40, 0]])
        assert np.linalg.eigvals(A).real.max() > 0
    with pytest.raises(BadInput, match=r"39\.97 1/s, which is unstable"):
        luenberger(freight.shaft, gains={"L_omega_m": -40.0, "L_T_L": -40.0}, measured="omega_m")
    meant = luenberger(freight.shaft, [-40, -40], measured="omega_m")
    poles_found = linear(meant, dict.fromkeys(meant.inputs, 0.0)).poles().real
    assert poles_found == pytest.approx([-40, -40], rel=1e-5)
    shows("004.11", "80", float(meant.param_values()["L_omega_m"]))
    shows("004.11", "64 000", -float(meant.param_values()["L_T_L"]))


def test_adhesion_of_the_load():
    y = freight.train(x=0.0, v_t=5.0, omega_m=60.0, T_m=0.0, mu=0.2)[1]
    found = freight.adhesion_of_load(T_L_hat=y["T_L"])["mu_hat"]
    assert found == pytest.approx(0.2, rel=1e-12)


def test_printed_set_never_slides():
    for text, p in (("0.66", DRY), ("0.475", WET)):
        steep = float(freight.steepest_slope(**p))
        shows("004.22", text, steep)
        assert extremum.regime(1.0, 1.0, steep) == extremum.AVERAGED
    shows("004.22", "5.39", extremum.time_constant(1, 1, float(freight.peak_curvature(**DRY))))


def test_printed_threshold_fires_far_below_the_peak():
    """Static dry curve, k = rho = 1, beta = .1, by steps of 10 us; no code of ours."""
    v = g = t = 0.0
    T = 1e-5
    while True:
        mu = math.copysign(math.exp(-0.54 * abs(v)) - math.exp(-1.2 * abs(v)), v)
        if mu - g < -0.3:
            break
        v += T * (1 if math.sin(math.pi * (mu - g) / 0.1) >= 0 else -1)
        g += T
        t += T
    shows("004.23", "0.367", t)
    shows("004.23", "0.111", v)
    shows("004.23", "0.0666", mu)
    shows("004.23", "23", 100 * mu / 0.286172)


def test_derivatives_of_the_sliding_variables():
    beta, d, h = 0.1, 0.037, 1e-6
    x = math.pi * d / (2 * beta)

    def rate(f):
        return (f(d + h) - f(d - h)) / (2 * h)

    found = rate(lambda s: 2 * math.sin(math.pi * s / (2 * beta)))
    assert found == pytest.approx(math.pi / beta * math.cos(x), rel=1e-6)
    found = rate(lambda s: math.cos(math.pi * s / (2 * beta)))
    assert found == pytest.approx(-math.pi / (2 * beta) * math.sin(x), rel=1e-6)
    product = math.sin(x) * rate(lambda s: math.sin(math.pi * s / (2 * beta)))
    assert product == pytest.approx(math.pi / (4 * beta) * math.sin(2 * x), rel=1e-6)


def test_ripple_is_k_beta_over_rho():
    seek = sliding_seek(H, k=1.0, rho=1.0, beta=0.1, start=PEAK)
    loop = connect("loop", {"map.v": "seek.v", "seek.y": "map.y"}, seek=seek, map=dry_map)
    v = simulate(loop, Scenario("map", 30.0), log=["seek.v"])["seek.v"].values
    shows("004.26", "0.1000", float(np.ptp(v[v.size // 2 :])))
    shows("004.26", "0.1", extremum.ripple(1.0, 0.1, 1.0))


def test_zone_where_sliding_stops():
    shows("004.27", "0.988", brentq(lambda v: slope(v) - 0.05, 0.1, PEAK))
    shows("004.27", "1.581", brentq(lambda v: slope(v) + 0.05, PEAK, 2 * PEAK))
    steepest_fall = -min(slope(v) for v in np.linspace(PEAK, 10, 5000))
    shows("004.27", "0.080", steepest_fall)


def test_creep_beyond_the_best():
    _, creep = in_base("improved_robust")
    shows("004.30", "0.093", creep.max())
    shows("004.30", "0.02", K_S)
