"""What the study freight_traction says: seeking, noise, barrier, lag, and what is refused."""

import logging
from functools import cache

import numpy as np
import pytest

from slipctl import BadInput, Context, simulate
from slipctl.ccode import codegen
from slipctl.models.cheng_2022.certificate import barrier as bounds
from slipctl.run import build
from slipctl.studies.freight_traction import barrier, experiments, study
from slipctl.studies.freight_traction.loops import (
    K_S,
    LAG,
    MODELS,
    NOISE,
    H,
    best,
    cases,
    check,
    holding,
)
from slipctl.study.case_setup import prepare


@cache
def context() -> Context:
    return Context(quick=True, models=MODELS, cases=cases(MODELS, True))


@cache
def outcomes(scenario: str, seed: int = 1, noise: float = 0.0) -> list[dict]:
    """What improved_robust makes of each section."""
    loop, where = context().loop(scenario, "improved_robust")
    params = {"sensor.sigma": noise} if noise else {}
    log = experiments.log_of(loop, where.but(seed=seed, params=params))
    found = []
    for rail, span in experiments.sections(where):
        found.append(experiments.outcome(log, span, *best(MODELS["adh"], rail)))
        found[-1]["mode"] = log["ctl.seek.mode"].values[span][-1]
    return found


# ---- seeking -------------------------------------------------------------------------------------


def test_locks_dry_in_6_s_and_wet_in_2_s_and_holds_still():
    dry, wet, again = outcomes("base")
    assert dry["lock"] < 6
    assert wet["lock"] < 2
    assert again["lock"] < 2
    for section in (dry, wet, again):
        assert section["creep"] < 0.01
        assert section["torque"] < 20
        assert section["mode"] == 2


def test_finds_each_moving_optimum_within_5_percent_in_5_s():
    assert all(s["found"] < 5 for s in outcomes("moving_optimum"))


@pytest.mark.parametrize(("scenario", "noise"), [("base", NOISE), ("real", 0.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_makes_no_false_lock(scenario, noise, seed):
    """``real`` has its noise and 20 ms of lag built in."""
    for section in outcomes(scenario, seed, noise):
        assert section["mode"] == 2
        assert section["use"] > 99.7
        assert section["torque"] < 80


def test_sliding_mode_follows_its_formulas_to_2_percent():
    assert np.abs(experiments.theory(context())["difference"]).max() < 2


def test_locks_off_the_peak_open_and_find_it():
    table = experiments.reopen(context())
    assert None not in table["opens after"]
    assert max(table["within 0.3 % of the peak for good after"]) < 6


def test_seekers_tell_their_ripple():
    """To 10 %: the loop's lag turns the sliding mode late, a dither is deformed by the limit."""
    table = experiments.told(context())
    told = np.array(table["ultimate ripple, told"])
    found = np.array(table["ripple of the last second"])
    still = told == 0
    assert found[still].max() < 0.005
    assert found[~still] == pytest.approx(told[~still], rel=0.1)


# ---- barrier -------------------------------------------------------------------------------------


@pytest.mark.second
def test_robust_form_holds_what_it_must():
    table = barrier.kept(context())
    rows = list(zip(table["law"], table["barrier held"], table["lag"], strict=True))
    assert all(held for law, held, _ in rows if law == "robust")
    assert {lag for law, _, lag in rows if law == "robust"} == {0.0, 1e3 * LAG}
    assert not all(held for law, held, _ in rows if law == "consistent")


@pytest.mark.second
def test_lag_at_a_rail_change():
    """Below the bound with the torque there is no law comes; back inside in 0.2 s."""
    table = barrier.lagged(context())["summary"]
    rows = {
        (lag, lead): (bound, least, balance, back)
        for lag, lead, bound, least, balance, back in zip(
            *(table[c] for c in ("lag", "lead", "bound with the torque there is",
                                 "smallest k_s that survives", "jump times lag",
                                 "back inside 0.02 after")), strict=True,
        )
    }  # fmt: skip
    for bound, least, balance, back in rows.values():
        assert bound < least < balance
        assert back < 200
    for lag in (5.0, 20.0):
        assert rows[lag, True][1] < 0.6 * rows[lag, False][1]
    assert rows[20.0, True][1] < K_S
    jump = table["jump of D"][0]
    assert rows[20.0, False][2] == pytest.approx(0.02 * jump)


@cache
def escapes() -> dict:
    return barrier.escape(context())


@pytest.mark.second
def test_escape_is_where_the_bound_says():
    """The barrier is left at the predicted time, to 1 % and a tick; below the bound never."""
    table = escapes()["escape"]
    for share, told, found in zip(*(list(table.columns.values())[k][1] for k in (2, 3, 4)),
                                  strict=True):  # fmt: skip
        assert (share > 1) == (found is not None) == (told is not None)
        if found is not None:
            assert found == pytest.approx(told, rel=0.01, abs=H)


def test_literal_law_rests_below():
    laws = escapes()["laws"]
    rest = laws.where("creep error after 6 s", law="printed-42")
    told = laws.where("creep error that its balance predicts", law="printed-42")
    assert rest == pytest.approx(told, rel=1e-3)
    assert rest == pytest.approx(-0.0115, abs=5e-5)


def test_authority_of_the_motor():
    assert barrier.torque_gain() == pytest.approx(0.625 / (40 * 6.294))
    assert bounds.lag_excursion(5.84, 0.02, 50.6) == pytest.approx(0.0070, abs=5e-5)


@pytest.mark.second
@pytest.mark.skipif(build.compiler() is None, reason="no C compiler on this machine")
@pytest.mark.parametrize(
    ("scenario", "name"),
    [("real", "improved_robust"), ("base", "smes_corrected")],
)
@pytest.mark.others("long")
def test_controller_in_c_repeats_the_run(scenario, name, tmp_path):
    """Observer, seeker, reference, law and lead as one step."""
    loop, where = context().loop(scenario, name)
    log = simulate(loop, where.but(duration=0.4))
    inputs = codegen.logged_inputs(loop, "ctl", log)
    assert codegen.check(loop["ctl"], inputs, tmp_path)["passed"]


# ---- what is refused before the run --------------------------------------------------------------


def checked(loop="improved_robust", **params):
    block, scenario = context().loop("base", loop)
    return check(loop, block.with_params(**params) if params else block, scenario)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("ctl.observer.L_omega_m", -40.0, r"unstable; poles at -1 1/s or to the left would pass"),
     ("ctl.observer.L_T_L", -40.0, r"slower than slowest=1 1/s; poles at -1 1/s"),
     ("ctl.reference.x", -0.1, r"outside the barrier .* k_s = 0\.111 would pass"),
     ("ctl.barrier.q", 5000.0, r"q = 1\.88e\+03 1/s would pass"),
     ("ctl.seek.w", 10.0, r"near the filter corners .* 25 rad/s or more would pass"),
     ("ctl.seek.beta", 1e-5, r"beta = 4e-05 or a period")],
)  # fmt: skip
def test_bad_input_is_told_before_the_run(name, value, said):
    with pytest.raises(BadInput, match=said) as caught:
        checked(**{name: value})
    assert str(caught.value).startswith("base/improved_robust: ctl.")
    assert "\n" not in str(caught.value)


def test_what_would_pass_passes():
    """Take the proposal, and nothing is refused any more."""
    for taken in (
        {"ctl.reference.x": -0.1, "ctl.barrier.k_s": 0.111},
        {"ctl.barrier.q": 1.88e3},
        {"ctl.seek.w": 25.0},
        {"ctl.seek.beta": 4e-5},
    ):
        assert checked(**taken) is None


def test_period_of_the_printed_shape():
    with pytest.raises(BadInput, match="can jump over its barrier"):
        checked("improved_corrected", **{"ctl.barrier.k": 2000.0})


def test_a_seeker_that_never_slides_is_named(caplog):
    with caplog.at_level(logging.WARNING):
        checked("smes_robust")
    assert "averaged regime); rho below 0.66 would slide" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        checked()
    assert caplog.text == ""


def test_the_command_asks_before_it_runs():
    with pytest.raises(BadInput, match="these gains give the pole"):
        prepare(
            study, settings=["observer.L_omega_m=-40"], loops=["improved_robust"],
            scenarios=["base"],
        )  # fmt: skip


def test_every_loop_of_the_issue_is_there():
    wanted = {f"{s}_{f}" for s in ("smes", "improved", "esa") for f in
              ("printed", "corrected", "robust")}  # fmt: skip
    for case in context().cases:
        assert wanted <= set(case.loops)
    assert [c.scenario.name for c in context().cases] == ["base", "moving_optimum", "real"]


def test_ideal_and_held_loops_are_not_checked_for_seekers():
    check("ideal", context().loop("base", "ideal")[0], context().loop("base", "ideal")[1])
    assert holding(MODELS["adh"]).check_units() == []


def test_units_of_the_loops():
    for case in context().cases[::2]:
        for name in ("ideal", "smes_printed", "improved_robust", "esa_corrected"):
            assert case.loops[name].check_units() == []
