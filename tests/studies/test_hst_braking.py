"""What the study hst_braking says: bounds, filter, searches, funnel, standstill, random rails."""

import math
import re
from functools import cache
from itertools import pairwise
from pathlib import Path

import left_out
import numpy as np
import pytest

from slipctl import Context, Results, simulate
from slipctl.certify.bounds import filters
from slipctl.models.zhang_2021 import hst_braking_control as control
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.models.zhang_2021.hst_braking import RAILS, burckhardt, peak_height, peak_slip
from slipctl.run import build
from slipctl.run.metrics import Run, measure
from slipctl.studies.hst_braking import experiments, limits, random_rails, study
from slipctl.studies.hst_braking.loops import MODELS, NAMES, cases, closed_form_distance, sensing
from slipctl.study import case_setup, execution
from slipctl.study.declaration import half_last_digit
from slipctl.study.verdicts import judge


@cache
def context() -> Context:
    return Context(quick=True, models=MODELS, cases=cases(MODELS, True))


@cache
def log(scenario: str, name: str, noise: float = 0.0, seed: int = 1):
    block, where = context().loop(scenario, name)
    if noise:
        block = sensing(block, {"tacho.sigma": noise})
    return simulate(block, where.but(seed=seed))


def distance(scenario: str, name: str) -> float:
    return experiments.distance(log(scenario, name))


@pytest.mark.second
@pytest.mark.parametrize("setting", ["wheel.v=150km/h", "v_start=150km/h"])
def test_another_speed_reaches_filter_and_meter(setting: str) -> None:
    """207.694 m was the distance while they began at the study's speed; it was 205.906 m with all
    places set by hand, and half of its last digit is the tolerance.
    """
    (case,), _ = case_setup.prepare(study, settings=[setting], loops=["eppfc"], scenarios=["real"])
    found = simulate(case.loops["eppfc"], case.scenario)
    assert experiments.distance(found) == pytest.approx(205.906, abs=5e-4)


# ---- bounds --------------------------------------------------------------------------------------


def test_bounds_agree_with_the_closed_form():
    peaks = tuple(float(peak_height(**RAILS[n])) for n in NAMES)
    fixed = tuple(-burckhardt(lam=0.1, **RAILS[n])["mu"] for n in NAMES)
    assert distance("base", "ideal") == pytest.approx(closed_form_distance(peaks), abs=1e-4)
    assert distance("base", "ideal_fixed") == pytest.approx(closed_form_distance(fixed), abs=1e-4)
    # the numbers that the claims name
    assert closed_form_distance(peaks) == pytest.approx(255.3483, abs=5e-5)
    assert closed_form_distance(fixed) == pytest.approx(257.5260, abs=5e-5)


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["base", "noise", "resistance"])
def test_no_loop_beats_the_bound(scenario):
    case = next(c for c in context().cases if c.scenario.name == scenario)
    bound = distance(scenario, "ideal")
    for name in case.loops:
        assert distance(scenario, name) >= bound - 1e-9


# ---- filter --------------------------------------------------------------------------------------


@pytest.mark.second
def test_adhesion_force_within_221_newton_20_ms_after_each_change():
    run = log("base", "eppfc")
    off = np.abs(run["ctl.filter.F_a"].values - run["plant.wheel.F_a"].values)
    for change in (2000, 4000):
        assert off[change + 20 : change + 2000].max() <= 221.0


def test_filter_without_gamma_is_consistent_and_with_gamma_is_not():
    table = experiments.consistency(context())
    for k, name in enumerate(table["filter"]):
        off = abs(table["mean NIS"][k] - table["its expectation"][k])
        # 3500 samples: standard deviation sqrt(2/3500) = 0.024, and a correlation widens it
        assert off < 0.1 * table["its expectation"][k]
        if name.startswith("without gamma"):
            assert table["inside the 95 % band"][k]
            assert table["white"][k]
        elif table["its expectation"][k] != 1.0:
            assert not table["inside the 95 % band"][k]
            assert not table["white"][k]


# ---- searches ------------------------------------------------------------------------------------


def off(name: str, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    run = log("base", name, noise, seed)
    return np.abs(run["ctl.search.best"].values - run["lam_opt"].values)


@pytest.mark.parametrize(("noise", "seed"), [(0.0, 1), (1e-3, 1), (1e-3, 2), (1e-3, 3)])
def test_best_slip_within_50_ms_with_the_prior(noise, seed):
    assert off("eppfc", noise, seed)[2050:4000].max() <= 0.01


@pytest.mark.long
def test_best_slip_without_a_prior():
    assert off("eppfc_free")[2120:4000].max() <= 0.01
    for seed in (1, 2, 3):
        assert off("eppfc_free", 1e-3, seed)[2250:4000].max() <= 0.01


@pytest.mark.second
@pytest.mark.long
def test_bound_forbids_50_ms_without_a_prior():
    lam = log("base", "eppfc_free")["plant.wheel.lam"].values[2000:]
    snow = RAILS["snow"]
    assert experiments.knowledge(burckhardt, lam[:51], snow, 1e-3) > 0.1
    assert experiments.knowledge(burckhardt, lam[:251], snow, 1e-3) < 0.002
    half = experiments.knowledge(burckhardt, lam[:251], snow, 5e-4)
    assert half == pytest.approx(experiments.knowledge(burckhardt, lam[:251], snow, 1e-3) / 2)


@pytest.mark.second
@pytest.mark.parametrize(
    ("scenario", "name", "price"),
    [("base", "eppfc", 0.02), ("base", "eppfc_gradient", 0.02), ("real", "eppfc", 0.1)],
)
def test_price_of_the_online_reference(scenario, name, price):
    assert distance(scenario, name) - distance(scenario, "eppfc_true_reference") <= price


# ---- funnel --------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", ["base", "noise"])
@pytest.mark.parametrize("name", ["eppfc", "eppfc_barrier", "eppfc_true_reference"])
def test_error_never_leaves_the_funnel(scenario, name):
    run = log(scenario, name)
    assert run["ctl.law.share"].values.max() < 1
    assert run["ctl.law.restarts"].values[-1] == 0


@pytest.mark.parametrize("name", ["eppfc", "eppfc_barrier", "eppfc_true_reference"])
def test_with_50_ms_lag_it_comes_back(name):
    run = log("lag50", name)
    assert run["ctl.law.restarts"].values[-1] > 0
    for change in (2000, 4000, 6000):  # inside, and narrow again, at the end of each rail
        assert run["ctl.law.share"].values[change - 500 : change].max() < 0.1
        assert run["ctl.law.upper"].values[change - 1] == pytest.approx(0.006, abs=1e-6)


@pytest.mark.second
def test_term_of_7_is_needed_where_the_certificate_says():
    table = limits.neglected(context())
    for k in range(3):
        predicted = table["predicted, without the term"][k]
        # the prediction is sufficient: it takes the slip at its reference, not at the bound
        assert 0.94 * predicted < table["without the term"][k] < predicted
        assert table["with the term"][k] is None


# ---- standstill, locked wheel, random rails ------------------------------------------------------


@pytest.mark.second
@pytest.mark.parametrize("name", ["eppfc", "eppfc_estimated"])
@pytest.mark.others("long")
def test_to_standstill_on_snow_without_lock(name):
    run = log("standstill_snow", name)
    v, lam = run["plant.wheel.v"].values, run["plant.wheel.lam"].values
    assert v[-1] < 0.01
    assert lam[v > 1].max() < 0.2
    assert np.isfinite(run["plant.brake.T_b"].values).all()


def test_locked_wheel_on_printed_snow_never_turns_again():
    table = experiments.locked(context())
    times = dict(zip(zip(table["adhesion"], table["rail"], strict=True),
                     table["rolls again after"], strict=True))  # fmt: skip
    assert times["printed", "snow"] is None
    assert times["with a floor of 0.05", "snow"] is not None
    assert times["printed", "dry"] < 1


def test_random_rails_are_what_they_say():
    rng = np.random.default_rng(5)
    for _ in range(200):
        rail = random_rails.random_rail(rng)
        assert 0.03 <= float(peak_height(**rail)) <= 0.35 * (1 + 1e-12)
        assert 0.02 <= float(peak_slip(**rail)) <= 0.2
        assert burckhardt(lam=1.0, **rail)["mu"] <= 1e-9
    run = random_rails.random_run(rng)
    assert 2 <= len(run) <= 5
    assert all(0.5 <= length <= 3 for length, _ in run)


@pytest.mark.long
def test_random_runs_lock_no_wheel_and_beat_no_bound():
    table = experiments.random_rails(context())["random_rails"]
    assert list(table["broke"]) == [0] * len(random_rails.RANDOM)
    assert max(table["longest lock-up"]) == 0
    assert min(table["least distance above the bound"]) > 0


# ---- claims --------------------------------------------------------------------------------------

CLAIMS = {c.id: c for c in study.claims}
CLAIMED = ("ideal", "fixed_slip", "pid", "efc", "eppfc", "pid_printed", "efc_true_reference",
           "eppfc_true_reference", "eppfc_free", "eppfc_gradient", "filter_printed",
           "search_printed")  # fmt: skip


@cache
def results(share: float = 1.0, name: str = "J") -> Results:
    """Scenario base with a parameter of train and controllers times ``share``."""
    case = next(c for c in context().cases if c.scenario.name == "base")
    found = Results(study, [case])
    bound: dict = {}
    for n in CLAIMED:
        block = case.loops[n]
        if name in block.params:
            block = block.with_params(**{name: share * float(block.param_values()[name])})
        data = execution.add_known(study, case, simulate(block, case.scenario))
        found.data.setdefault("base", {})[n] = data
        metrics = measure(Run(data, study.signals, case.scenario.changes, bound))
        found.metrics.setdefault("base", {})[n] = metrics
        bound = metrics if n == "ideal" else bound
    return found


def verdict(id: str, r: Results) -> tuple[str, str]:
    found = judge(CLAIMS[id], r)
    return found.verdict, found.why


@pytest.mark.second
@pytest.mark.long
def test_overshoot_is_that_of_the_torque():
    """The paper's sentence is on Fig. 9, the torque; the slip's has its own row."""
    r = results()
    torque = np.abs(log("base", "eppfc")["plant.brake.T_b"].values)
    steady = torque[1500:2000].mean()
    assert torque[:2000].max() / steady > 3.8
    assert CLAIMS["no_overshoot"].ours(r) == pytest.approx(
        100 * (torque[:2000].max() / steady - 1), rel=1e-3
    )
    assert verdict("no_overshoot", r)[0] == "not reproduced"
    assert verdict("no_overshoot_slip", r)[0] == "reproduced"


@pytest.mark.second
def test_order_of_the_variances_turns_with_the_window_and_says_so():
    r = results()
    assert verdict("variance_order_joint", r)[0] == "not reproduced"
    assert verdict("variance_order_200ms", r)[0] == "not reproduced"
    held, turned = re.search(r"holds with (.*) and turns with (.*)", verdict("variance_order", r)[1]
                             ).groups()  # fmt: skip
    a = {k: log("base", k)["plant.wheel.a"].values for k in ("pid", "efc", "eppfc")}
    for ms in (100, 200, 500, 1000, 2000):
        x = {k: np.mean([v[s : s + ms].var() for s in (0, 2000, 4000)]) for k, v in a.items()}
        holds = x["pid"] > x["efc"] > x["eppfc"]
        assert f"{ms} ms mean" in (held if holds else turned).split(", ")


def test_tolerance_of_a_distance_is_narrower_than_what_it_tells_apart():
    printed = sorted(float(c.paper) for i, c in CLAIMS.items()
                     if i.startswith("distance_") and i.endswith("_resistance"))  # fmt: skip
    gap = min(b - a for a, b in pairwise(printed))
    for i, claim in CLAIMS.items():
        if i.startswith("distance_") and claim.kind == "number":
            assert claim.allowed() < gap / 2


@pytest.mark.second
def test_by_the_torque_two_laws_tie_at_the_start():
    times = CLAIMS["fastest_at_0s"].ours(results())
    assert times["efc"] == times["eppfc"]
    assert verdict("fastest_at_0s", results())[0] == "not reproduced"
    assert verdict("fastest_at_0s_slip", results())[0] == "reproduced"


def test_pid_overshoots_and_adjusts_longest_with_the_printed_gains_and_with_ours():
    for id in ("pid_overshoots", "pid_adjusts_longest"):
        assert verdict(id, results())[0] == "reproduced"
        assert verdict(f"{id}_placed", results())[0] == "reproduced"


def test_no_reason_has_a_number_of_a_run_typed_in():
    measured = re.compile(r"\d\s*(kN|N m|N\b|m/s|ms\b|s\b|m\b|mm\b|%)")
    for claim in study.claims:
        for reason in (claim.why, claim.why_not):
            if isinstance(reason, str):
                assert not measured.search(reason), f"{claim.id}: {reason}"


# ---- errata --------------------------------------------------------------------------------------


@cache
def errata() -> dict[str, str]:
    text = (Path(__file__).parents[2] / "docs" / "errata.md").read_text(encoding="utf-8")
    pieces = re.split(r"^### (\d{3}\.\d+) ", text, flags=re.M)
    return dict(zip(pieces[1::2], pieces[2::2], strict=True))


def shows(row: str, text: str, measured: float) -> None:
    """Check that the row prints ``text`` and that this is the measured number."""
    assert re.search(rf"(?<![\d.]){re.escape(text)}(?!\d)", errata()[row]), f"{row}: no {text}"
    number = text.replace(" ", "")
    allowed = 1.0001 * half_last_digit(number)
    assert abs(measured - float(number)) <= allowed, f"{row}: {text}, measured {measured:.6g}"


def test_errata_numbers():
    W = ppc.largest_disturbance(100, 0.005, 1.2, 1.2)
    shows("001.5", "0.26865", W)
    shows("001.5", "4384", ppc.adhesion_budget(50, W, 0.43, 60.35))
    shows("001.5", "438", ppc.adhesion_budget(5, W, 0.43, 60.35))
    shows("001.5", "30.3", 1e3 * ppc.escape_time(0.4007, 100, 0.005, 1.2, 1.2))
    shows("001.8", "4.35", filters.time_constant(0.23))
    shows("001.8", "4.83", 1e3 * filters.time_constant(0.23, 1e-3))
    shows("001.16", "0.0946", 4 / 13800 / (0.43**2 / 60.35))
    height = {n: float(peak_height(**RAILS[n])) for n in NAMES}
    place = {n: float(peak_slip(**RAILS[n])) for n in NAMES}
    for name, text in zip(NAMES, ("9.77", "4.43", "7.03"), strict=True):
        shows("001.16", text, ppc.lowest_speed(9.81 * height[name], place[name], W))
    table = limits.neglected(context())
    for found, text in zip(table["without the term"], ("9.34", "4.24", "6.72"), strict=True):
        shows("001.16", text, found)
    fall = ppc.slip_fall_rate(
        13800 * 9.81 / 4 * height["snow"], 43.6, 0.43, 60.35, a=9.81 * height["snow"], slip=0.15
    )
    jump = place["dry"] - place["snow"]
    shows("001.13", "0.355", fall)
    shows("001.13", "0.164", jump / fall)
    shows("001.13", "35", 1e3 * ppc.crossing_time(jump, fall, 0.1, 0.005, 30, 1.2))
    shows("001.13", "19.2", ppc.largest_decay(jump, fall, 0.1, 0.005, 1.2))


def test_errata_of_the_printed_loops():
    minus = log("base", "eppfc_printed")
    shows("001.1", "0.0059", float(np.abs(minus["ctl.law.e"].values[1500:2000]).mean()))
    search = log("base", "search_printed")
    shows("001.12", "2", float(np.argmax(search["ctl.law.share"].values > 1)))
    for tick, text in ((5, "0.15"), (10, "0.20"), (20, "0.30"), (50, "0.60")):
        shows("001.12", text, float(search["ctl.search.best"].values[tick]))
    shows("001.12", "258.53", distance("base", "search_printed"))
    shows("001.12", "255.69", distance("base", "eppfc_true_reference"))
    shows("001.20", "256.74", distance("base", "pid_printed"))
    shows("001.21", "36", float(log("base", "eppfc")["plant.wheel.v"].values[-1]))
    shows("001.23", "255.3483", distance("base", "ideal"))
    shows("001.23", "253.94", distance("resistance", "ideal"))
    shows("001.25", "255.6957", distance("base", "eppfc"))
    shows("001.25", "255.6971", distance("base", "efc"))
    points = log("base", "points_printed")
    off = points["ctl.filter.F_a"].values - points["plant.wheel.F_a"].values
    shows("001.6", "11 053", float(np.abs(off[1500:2000]).mean()))
    for scenario, text in (("real", "3"), ("lag50", "10")):
        shows("001.26", text, float(log(scenario, "eppfc")["ctl.law.restarts"].values[-1]))
    law = MODELS["eppfc"]
    asked = law(lam=0.0, lam_ref=0.1, rate=0.0, v=50.0, F_a=0.0, eta_h=0.1, count=0.0)[1]
    shows("001.15", "50.8", abs(asked["T_wanted"]) / 1e3)


def test_errata_of_filter_and_slope():
    slow = log("base", "filter_printed")["ctl.filter.variance_F_a"].values
    assert slow[-1] < 1e-4 * filters.steady_variance(0.23, 1.0, 0.43 / 60.35, 1e-3)  # 6 s later
    shows("001.10", "0.032", math.sqrt(1e-3))
    P = {}
    for form in ("printed-41", "consistent"):
        block = control.slope_identification(form)
        x = block.start()
        for _ in range(100):  # the slip stands still
            x, _ = block(F_a=-8e3, lam=0.0, **x)
        P[form] = float(x["P"])
    assert P["printed-41"] > 5  # 0.98^-k, but for the first tick
    assert P["consistent"] <= 1e4
    run = log("noise", "eppfc")
    change = np.abs(np.diff(run["ctl.filter.F_a"].values)) / 1e-3
    assert np.mean(change > 1.0) > 0.999  # N/s, as printed without a unit
    calm = np.abs(np.diff(log("base", "eppfc")["ctl.filter.F_a"].values)) / 1e-3
    assert np.mean(calm[500:2000] > 1000.0) < 0.01


# ---- speed and study -----------------------------------------------------------------------------


def test_peer_in_c_gives_the_same_numbers(needs_compiler):
    from bench.peers import hst_loop

    assert build.compiler() is not None
    found = hst_loop.bench(pairs=1, simulator=False)
    assert found["ours_vs_c"]["largest_state_difference"] < 1e-8  # m, m/s, rad/s over 6000 ticks


def test_what_did_not_run_is_counted_apart():
    left_out.assert_open_and_counted_apart(results())


def test_figures_and_claims_are_complete():
    assert {f.source for f in study.figures.values() if f.source} == {
        "Fig. 2", "Fig. 5", "Fig. 6", "Fig. 7", "Fig. 8", "Fig. 9"
    }  # fmt: skip
    assert math.isclose(1.01 * 0.26864592 * 60.35 * 50 / 0.43**2, 4428, abs_tol=1)
