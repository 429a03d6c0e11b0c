"""Claims and their verdicts, settings and swaps, running a study and the files it leaves."""

from __future__ import annotations

import contextlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toy_study
import xarray
from casadi import exp, sqrt

from slipctl import BadInput, Case, Claim, Input, Known, Output, Param, RunFailed, Table, law
from slipctl.block.shared_numbers import targets
from slipctl.run import store
from slipctl.run.metrics import Metric
from slipctl.run.results import NotRun, Results
from slipctl.study import case_setup, execution
from slipctl.study.declaration import Context, half_last_digit
from slipctl.study.files import results_folder
from slipctl.study.jobs import Cores
from slipctl.study.report.texts import metric_table, number, ranked_rows
from slipctl.study.resolve import load_study
from slipctl.study.verdicts import judge

EMPTY = Results(toy_study.study, [])


def verdict(answer, **claim) -> tuple[str, str]:
    given = {"kind": "number", "ours": lambda r: answer} | claim
    found = judge(Claim("id", "here", "it holds", **given), EMPTY)
    return found.verdict, found.why


# ---- verdicts -----------------------------------------------------------------------------------


def test_last_digit_is_half_a_unit_of_what_is_printed() -> None:
    assert half_last_digit("254.0479") == pytest.approx(0.00005)
    assert half_last_digit("0.5") == pytest.approx(0.05)
    assert half_last_digit("33") == 0.5
    assert half_last_digit("8.0239e-5") == pytest.approx(0.00005e-5)


def test_number_within_the_last_digit() -> None:
    assert verdict(254.04794, paper="254.0479", tolerance="last digit")[0] == "reproduced"
    assert verdict(254.04797, paper="254.0479", tolerance="last digit")[0] == "not reproduced"


def test_number_within_percent_or_absolute() -> None:
    assert verdict(104.9, paper=100, tolerance="5 %")[0] == "reproduced"
    assert verdict(105.1, paper=100, tolerance="5 %")[0] == "not reproduced"
    assert verdict(-95.1, paper=-100, tolerance="5 %")[0] == "reproduced"
    assert verdict(100.4, paper=100, tolerance=0.5)[0] == "reproduced"
    assert "off by +5.1 (+5.1 %)" in verdict(105.1, paper=100, tolerance="5 %")[1]


def test_number_as_a_bound() -> None:
    assert verdict(0.39, paper=0.4, bound="at most")[0] == "reproduced"
    assert verdict(0.41, paper=0.4, bound="at most")[0] == "not reproduced"
    assert verdict(0.41, paper=0.4, bound="at least")[0] == "reproduced"
    assert verdict(0.41, paper=0.4, bound="at most", tolerance=0.02)[0] == "reproduced"


def test_order() -> None:
    ours = {"dry": 3.0, "wet": 2.0, "ice": 1.0}
    assert verdict(ours, kind="order", paper="dry > wet > ice")[0] == "reproduced"
    assert verdict(ours, kind="order", paper="ice < wet")[0] == "reproduced"
    text, why = verdict(ours, kind="order", paper="wet > dry > ice")
    assert (text, why) == ("not reproduced", "wet is not above dry")
    assert verdict(ours, kind="order", paper="dry > wet", tolerance=1.5)[0] == "not reproduced"
    assert verdict(ours, kind="order", paper="dry > wet", tolerance="30 %")[0] == "reproduced"
    assert verdict({"a": None, "b": 1.0}, kind="order", paper="a > b")[0] == "not reproduced"
    with pytest.raises(BadInput, match="gives no 'snow'"):
        verdict(ours, kind="order", paper="dry > snow")


def test_a_close_verdict_says_what_turns_it() -> None:
    """Within a tenth of the tolerance, and for an order within 1 % of the larger number."""
    near, far = (verdict(x, paper="0.04", tolerance="last digit")[1] for x in (0.0446, 0.042))
    assert near.endswith("allowed 0.005: close, 0.0004 more turns the verdict")
    assert "close" not in far
    beyond = verdict(0.0453, paper="0.04", tolerance="last digit")
    assert beyond[0] == "not reproduced"
    assert beyond[1].endswith("close, 0.0003 less turns the verdict")
    order = {"kind": "order", "paper": "a > b"}
    assert verdict({"a": 1.0, "b": 0.995}, **order) == (
        "reproduced", "a above b: close, 0.005 (0.5 %) turns the verdict"
    )  # fmt: skip
    found = verdict({"a": 0.995, "b": 1.0}, **order)
    assert found == (
        "not reproduced", "a is not above b: close, 0.005 (0.5 %) turns the verdict"
    )  # fmt: skip
    assert verdict({"a": 1.0, "b": 1.0}, **order) == ("not reproduced", "a and b tie")


@pytest.mark.parametrize(("share", "close"), [(0.096, True), (0.104, False)])
def test_close_is_a_tenth_of_what_is_allowed_and_a_hundredth_in_an_order(share, close) -> None:
    """On either side of the end."""
    for sign in (1, -1):
        ours = 0.045 - sign * share * 0.005
        assert ("close" in verdict(ours, paper="0.04", tolerance="last digit")[1]) == close
        both = {"a": 1.0, "b": 1.0 - share / 10}
        found = verdict(
            both if sign > 0 else {"a": both["b"], "b": 1.0}, kind="order", paper="a > b"
        )
        assert ("close" in found[1]) == close


def test_yes_or_no() -> None:
    assert verdict(np.bool_(True), kind="yes/no", paper=True)[0] == "reproduced"
    assert verdict(False, kind="yes/no", paper=True)[0] == "not reproduced"
    assert verdict(False, kind="yes/no", paper=False)[0] == "reproduced"


def test_no_answer_does_not_reproduce() -> None:
    assert verdict(None, paper=1, tolerance="5 %") == ("not reproduced", "ours has no value")
    assert verdict(math.nan, paper=1, tolerance="5 %")[0] == "not reproduced"


def test_not_checkable_and_not_run() -> None:
    assert verdict(1.0, paper=1, not_checkable="no data") == ("not checkable", "no data")
    claim = Claim("id", "", "", "number", 1, lambda r: r.metric("base", "soft", "distance"),
                  tolerance="5 %")  # fmt: skip
    found = judge(claim, EMPTY)
    assert (found.verdict, found.why) == ("not checkable", "base/soft was not run")


def test_why_is_added_and_why_not_only_where_it_fails() -> None:
    texts = {"why": "as in Fig. 3", "why_not": "gains saturate"}
    assert verdict(True, kind="yes/no", paper=True, **texts)[1] == "as in Fig. 3"
    assert verdict(False, kind="yes/no", paper=True, **texts)[1] == "as in Fig. 3; gains saturate"


def test_a_reason_may_be_read_off_the_run_and_stays_away_without_it() -> None:
    def reason(results: Results) -> str:
        return f"settles after {results.metric('base', 'soft', 'settling_time')} s"

    assert verdict(True, kind="yes/no", paper=True, why=lambda r: "of 3")[1] == "of 3"
    assert verdict(True, kind="yes/no", paper=True, why=reason)[1] == ""
    assert verdict(False, kind="yes/no", paper=True, why_not=lambda r: "so")[1] == "so"
    assert verdict(True, kind="yes/no", paper=True, why_not=lambda r: "so")[1] == ""


@pytest.mark.parametrize(
    ("claim", "message"),
    [
        ({"kind": "nmber", "paper": 1}, "kind 'nmber'"),
        ({"paper": 1}, "needs a tolerance"),
        ({"paper": 1, "tolerance": "last digit"}, "'last digit' of a number written as printed"),
        ({"paper": 1, "tolerance": "some"}, "is no number, percentage"),
        ({"paper": 1, "tolerance": 1, "bound": "below"}, "neither at most nor at least"),
        ({"paper": 1, "tolerance": 1, "ours": None}, "say what ours is"),
    ],
)
def test_claims_that_cannot_be_judged_are_refused(claim, message) -> None:
    with pytest.raises(BadInput, match=message):
        verdict(1.0, **claim)


# ---- tables -------------------------------------------------------------------------------------


def test_table() -> None:
    t = Table("Peaks", {"rail": ("1", ["dry", "ice"]), "peak": ("m/s", [1.2, 2.4])})
    assert t.where("peak", rail="ice") == 2.4
    assert t.where("peak", rail="snow") is None
    with pytest.raises(BadInput, match=r"no column 'peek'; did you mean 'peak'\?"):
        t["peek"]
    with pytest.raises(BadInput, match="unequal length"):
        Table("Peaks", {"a": ("1", [1]), "b": ("1", [])})


# ---- settings -----------------------------------------------------------------------------------


def param(cases, name, loop="soft", scenario=0):
    return float(cases[scenario].loops[loop].param_values()[name])


def prepared(*settings, **options):
    return case_setup.prepare(toy_study.study, settings=settings, **options)[0]


def test_setting_by_ending_with_unit_in_every_loop() -> None:
    cases = prepared("car.m=8.2t")
    assert param(cases, "plant.car.m") == param(cases, "plant.car.m", "hard") == 8200
    assert param(cases, "plant.car.m", scenario=1) == 8200


def test_setting_of_one_loop() -> None:
    cases = prepared("hard:ctl.K=5e3")
    assert (param(cases, "ctl.K", "hard"), param(cases, "ctl.K", "soft")) == (5000, 4000)


def test_setting_with_a_star_sets_all() -> None:
    assert param(prepared("*.sigma=2cm/s"), "meter.sigma") == pytest.approx(0.02)


def test_setting_of_a_start_value_wins_over_the_scenario() -> None:
    cases = prepared("car.v=36km/h")
    for case in cases:
        assert case.loops["soft"].start()["plant.car.v"] == 10
        assert "car.v" not in case.scenario.start
    results = execution.run(toy_study.study, cases, experiments=False)
    for scenario in ("base", "noisy"):
        assert results.log(scenario, "soft")["plant.car.v"].values[0] == 10


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("car.m", r"write \[loop:\]block.param=VALUE"),
        ("car.m=", r"write \[loop:\]block.param=VALUE"),
        ("car.mm=1", "no loop of toy has a parameter 'car.mm'; did you mean 'car.m'"),
        ("soff:car.m=9t", "no loop 'soff' runs; did you mean 'soft'"),
        ("soft:car.mm=9t", "loop soft has no parameter 'car.mm'; did you mean 'car.m'"),
        ("car.m=5N", "another dimension"),
        ("car.m=nan", "is no number"),
        ("car.m=-1kg", r"-1 kg is out of range; it must lie in \[1000, 40000\] kg"),
        ("car.m=1e9", "out of range"),
        ("adh.c=0.5", "the rail sets soft's plant.adh.c in scenario base"),
        ("s=1", "no loop of toy has a parameter 's'"),
    ],
)
def test_settings_that_cannot_be(setting, message) -> None:
    with pytest.raises(BadInput, match=message):
        prepared(setting)


def test_an_ambiguous_setting_says_between_what() -> None:
    two = toy_study.connect("two", {}, a=toy_study.car, b=toy_study.car)
    with pytest.raises(BadInput, match=r"could be a.m or b.m; write which, or '\*.m' for all"):
        targets(two, "m")
    assert targets(two, "*.m") == ["a.m", "b.m"]


# ---- swaps and selection ------------------------------------------------------------------------


@pytest.fixture
def my_law(tmp_path: Path) -> Path:
    text = """
from slipctl import Input, Output, Param, law
from casadi import tanh

RAILS = {"dry": {"c": .3}, "ice": {"c": .03}}

@law(mu=Output("1", "adhesion", positive="braking"), conditions=RAILS)
def my_law(s=Input("m/s", "slip", positive="braking", per="speed"), c=Param("1", .3, lo=0, hi=1)):
    '''My law.'''
    return c * tanh(2 * s)

@law(mu=Output("1", "adhesion", positive="braking"))
def bare(s=Input("m/s", "slip", positive="braking", per="speed")):
    '''Without rail conditions.'''
    return 0.1 * s

@law(mu=Output("1", "adhesion", positive="traction"), conditions={"dry": {}, "ice": {}})
def wrong_sign(s=Input("m/s", "slip", positive="braking", per="speed")):
    return 0.1 * s

@law(mu=Output("N", "adhesion", positive="braking"), conditions={"dry": {}, "ice": {}})
def wrong_unit(s=Input("m/s", "slip", positive="braking", per="speed")):
    return 0.1 * s

@law(mu=Output("1", "adhesion", positive="braking"), conditions={"dry": {}, "ice": {}})
def broken(s=Input("m/s", "slip", positive="braking", per="speed")):
    return 0.1 * sloop

def needs(x):
    return my_law

number = 3
"""
    file = tmp_path / "my.py"
    file.write_text(text)
    return file


def test_swap_replaces_a_model_before_the_loops_are_built(my_law: Path) -> None:
    cases, models = case_setup.prepare(toy_study.study, swaps=[f"adh={my_law}:my_law"])
    assert models["adh"].name == "my_law"
    for case in cases:
        assert all(loop["plant.adh"].name == "my_law" for loop in case.loops.values())


@pytest.mark.parametrize(
    ("swap", "message"),
    [
        ("adh", "write name=file.py:block"),
        ("ahd={}:my_law", "has no model 'ahd' to swap; did you mean 'adh'"),
        ("adh=no_such.py:my_law", "there is no file no_such.py"),
        ("adh={}:mylaw", "has no block 'mylaw'; did you mean 'my_law'"),
        ("adh={}:number", "is no block"),
        ("adh={}:needs", "is a function that needs x"),
        ("adh={}:bare", "knows no rail condition 'dry'"),
        ("adh={}:wrong_sign", "flip_sign"),
        ("adh={}:wrong_unit", r"cannot feed .* \[1\]"),
        ("adh={}:broken", r"my.py, line 27: NameError: name 'sloop' is not defined"),
    ],
)
def test_swaps_that_cannot_be(my_law: Path, swap: str, message: str) -> None:
    with pytest.raises(BadInput, match=message):
        case_setup.prepare(toy_study.study, swaps=[swap.format(my_law)])


def test_a_file_with_a_syntax_error_says_the_line(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("x = 1\ndef f(:\n")
    with pytest.raises(BadInput, match=r"bad.py, line 2: invalid syntax"):
        case_setup.prepare(toy_study.study, swaps=[f"adh={tmp_path / 'bad.py'}:f"])


def test_selection() -> None:
    cases = prepared(loops=["soft"], scenarios=["base"])
    assert [(c.scenario.name, list(c.loops)) for c in cases] == [("base", ["soft"])]
    with pytest.raises(BadInput, match="no loop 'sft'; did you mean 'soft'"):
        prepared(loops=["sft"])
    with pytest.raises(BadInput, match="no scenario 'bass'; did you mean 'base'"):
        prepared(scenarios=["bass"])
    with pytest.raises(BadInput, match="no loop hard in noisy"):
        prepared(loops=["hard"], scenarios=["noisy"])


def test_what_was_built_already_is_not_built_again() -> None:
    cases, models = case_setup.prepare(toy_study.study, quick=True)
    again, same = case_setup.prepare(toy_study.study, quick=True, built=(cases, models))
    assert same is models
    assert [c.scenario.name for c in again] == [c.scenario.name for c in cases]
    assert all(a.loops[n] is c.loops[n] for a, c in zip(again, cases, strict=True) for n in c.loops)


def test_known_values_must_match_the_rail() -> None:
    case = prepared()[0]
    wrong = Case(case.scenario, case.loops, {"best": Known("1", [1.0])})
    with pytest.raises(BadInput, match="best has 1 values for 2 rail sections"):
        case_setup._try(wrong, "soft", case.loops["soft"])


# ---- running and files --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results() -> Results:
    cases, models = case_setup.prepare(toy_study.study, quick=True)
    return execution.run(toy_study.study, cases, models, quick=True)


@pytest.mark.parametrize("count", [1, 2])
def test_jobs_beside_the_runs_are_done_and_not_counted_as_runs(count: int) -> None:
    cases, models = case_setup.prepare(toy_study.study, quick=True)
    heard: dict[str, float] = {}
    found: dict[str, Any] = {}

    def broken(tell: Any) -> str:
        raise ValueError("no page")

    with Cores(count) as cores:
        results = execution.run(
            toy_study.study, cases, models, quick=True, experiments=False, cores=cores,
            report=heard.__setitem__,
            beside={"page": lambda tell: "text", "bad": broken}, take=found.__setitem__,
        )  # fmt: skip
    assert found["page"].get() == "text"
    with pytest.raises(RunFailed, match="no page"):
        found["bad"].get()
    assert set(heard) == {f"{s}/{n}" for s, logs in results.data.items() for n in logs}
    assert set(heard.values()) == {1}  # the share that was told last
    assert not results.failed


def test_run_gives_logs_metrics_and_tables(results: Results) -> None:
    assert {s: list(v) for s, v in results.data.items()} == {
        "base": ["soft", "hard"], "noisy": ["soft"],
    }  # fmt: skip
    assert results.metric("base", "soft", "distance") == pytest.approx(12, rel=0.1)
    assert results.metric("base", "soft", "stopping_distance") is None
    assert results.table("seeds")["seed"] == range(1, 3)
    best = results.signal("base", "soft", "best_adhesion")
    assert (best[0], best[-1]) == (0.25, 0.025)
    with pytest.raises(NotRun, match="base/smc was not run"):
        results.log("base", "smc")
    with pytest.raises(BadInput, match="logs no torque_b"):
        results.signal("base", "soft", "torque_b")


def test_a_failed_run_is_noted_and_the_others_go_on() -> None:
    @law(mu=Output("1", "adhesion", positive="braking"), conditions=toy_study.RAILS)
    def pole(
        s=Input("m/s", "slip", positive="braking", per="speed"), c=Param("m/s", 1.0, lo=0, hi=2)
    ):
        """No number beyond 0.5 m/s of slip, which the run passes."""
        return 0.2 * c * exp(-s) + 0.001 * sqrt(0.5 - s)

    case = prepared()[0]
    loops = {"bad": toy_study.loop(pole, toy_study.controller()), "good": case.loops["soft"]}
    mixed = Case(case.scenario, loops, case.known)
    found = execution.run(toy_study.study, [mixed], experiments=False)
    assert list(found.metrics["base"]) == ["good"]
    assert "plant" in found.failed["base/bad"]
    with pytest.raises(NotRun, match="base/bad failed: "):
        found.metric("base", "bad", "distance")


def test_files_are_whole_strict_and_carry_their_origin(results: Results, tmp_path: Path) -> None:
    verdicts = execution.judge_all(results)
    results_folder.save_metrics(results, tmp_path, "slipctl run toy")
    results_folder.save_claims(results, verdicts, tmp_path, "slipctl run toy")
    results_folder.save_tables(results, tmp_path, "slipctl run toy")
    data = results.data["base"]["soft"].assign_attrs(command="slipctl run toy")
    results_folder.publish(results_folder.draft_log(data, tmp_path / "logs/base", "soft"))
    for name in ("metrics", "claims", "tables"):
        payload = store.read_json(tmp_path / f"{name}.json")
        assert payload["format"] == 1
        assert payload["slipctl_version"]
        assert payload["command"] == "slipctl run toy"
        assert payload["seed"] == {"base": 1, "noisy": 7, "experiments": 1}
        assert payload["parameters"]["soft"]["plant.car.m"] == {"value": 8000.0, "unit": "kg"}
        assert payload["quick"] is True
        assert "NaN" not in (tmp_path / f"{name}.json").read_text()
    metrics = store.read_json(tmp_path / "metrics.json")["scenarios"]["base"]["soft"]
    assert metrics["distance"] == {
        "value": results.metric("base", "soft", "distance"), "unit": "m",
    }  # fmt: skip
    claims = store.read_json(tmp_path / "claims.json")["claims"]
    assert [c["verdict"] for c in claims if c["id"] == "gone"] == ["not checkable"]
    assert {"id", "source", "claim", "kind", "paper", "ours", "unit", "tolerance", "tolerance_why",
            "assumption", "scenario", "loop", "verdict", "why"} <= set(claims[0])  # fmt: skip
    data = xarray.load_dataset(tmp_path / "logs/base/soft.nc")
    assert data["plant.car.v"].attrs["units"] == "m/s"
    assert np.array_equal(data["plant.car.v"], results.log("base", "soft")["plant.car.v"])
    assert json.loads(data.attrs["parameters"])["plant.car.m"]["unit"] == "kg"
    head, first, *rest = (tmp_path / "logs/base/soft.csv").read_text().splitlines()
    assert head.startswith("time [s],")
    assert "plant.car.v [m/s]" in head.split(",")
    assert len(first.split(",")) == len(head.split(","))
    assert len(rest) == 599
    assert not list(tmp_path.rglob(".*"))


def test_a_newer_format_is_refused(results: Results, tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text('{"format": 2}')
    with pytest.raises(BadInput, match="has format 2, this slipctl reads up to 1; update slipctl"):
        store.read_json(tmp_path / "m.json")
    for text in ("{}", "[1]", "no"):
        (tmp_path / "m.json").write_text(text)
        with pytest.raises(BadInput, match=r"no file of slipctl|no JSON file"):
            store.read_json(tmp_path / "m.json")
    with pytest.raises(BadInput, match="cannot read"):
        store.read_json(tmp_path / "none.json")


def test_a_write_that_breaks_leaves_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    store.write_text(file, "old")

    def half(path: Path) -> None:
        path.write_text("ne")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        store.write_with(file, half)
    assert file.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_json_is_strict_and_readable() -> None:
    value = {
        "a": np.float64(math.nan),
        "b": [1, math.inf],
        "c": {"value": np.int64(3), "unit": "m"},
    }
    text = store.json_text(value)
    assert json.loads(text) == {"a": None, "b": [1, None], "c": {"value": 3, "unit": "m"}}
    assert '"c": {"value": 3, "unit": "m"}' in text


def test_what_is_kept_is_read_again_and_a_changed_question_is_computed_anew(tmp_path: Path) -> None:
    context, calls = Context(True, {}, [], folder=tmp_path), []

    def compute() -> dict[str, float]:
        calls.append(1)
        return {"x": 1 / 3, "broken": math.nan}

    first = context.kept({"seed": 1, "gain": (2.0, 3.0)}, compute)
    assert first == {"x": 1 / 3, "broken": None}
    assert context.kept({"gain": (2.0, 3.0), "seed": 1}, compute) == first
    assert len(calls) == 1
    context.kept({"seed": 1, "gain": (2.0, 3.5)}, compute)
    assert len(calls) == 2
    for path in tmp_path.iterdir():  # cut off by a full disk, say
        path.write_text(path.read_text()[:20])
    assert context.kept({"seed": 1, "gain": (2.0, 3.0)}, compute) == first
    assert len(calls) == 3
    assert Context(True, {}, []).kept({"seed": 1}, compute) == first


def test_an_order_is_shown_with_the_digits_that_tell_it() -> None:
    ours = {"pid": 255.70533, "efc": 255.69722, "eppfc": 255.69584, "none": None}
    assert number(ours) == "pid 255.705, efc 255.697, eppfc 255.696, none –"
    assert number({"a": 1.0, "b": 1.0}) == "a 1, b 1"  # equal ones stay equal, and short


@pytest.mark.parametrize("width", [72, 100, 132])
def test_a_table_of_many_loops_goes_on_below_and_never_wraps(width: int) -> None:
    """19 loops: every loop, and every number of each row, stands in some part of the table."""
    loops = {
        f"loop_number_{k}": Metric([k + 0.25, 0.5 if k else None], "s", ("dry", "wet"))
        for k in range(19)
    }
    one = Results(toy_study.study, [], metrics={"base": {
        n: {"settling_time": m} for n, m in loops.items()
    }})  # fmt: skip
    text = metric_table(one, "base", width)
    assert max(map(len, text.splitlines())) <= width
    assert all(text.count(n + " ") + text.count(n + "\n") == 1 for n in list(loops)[:2])
    words = text.split()
    assert [w for w in words if w.startswith("loop_number")] == list(loops)
    assert [float(w) for w in words if w.endswith(".25")] == [k + 0.25 for k in range(19)]
    assert text.count("settling_time [s]") > 1
    assert text.count("dry / wet") == 1, "the sections are named once"


def test_the_best_of_a_row_is_marked_but_not_the_bound() -> None:
    """Low or high as the metric says; equal as shown is equal; nothing where all say the same."""
    values = {"ideal": (90.0, 1.0, 0.0), "one": (100.0, 0.5, 0.0), "two": (120.0, 0.7, 0.0),
              "three": (100.0000001, 0.6, 0.0)}  # fmt: skip
    loops = {
        n: {"stopping_distance": Metric(d, "m"), "adhesion_use": Metric(mu, "1"),
            "lock_time": Metric(lock, "s"), "slip_max": Metric(d, "m/s")}
        for n, (d, mu, lock) in values.items()
    }  # fmt: skip
    results = Results(toy_study.study, [], metrics={"base": loops})
    found = {cells[0]: best for cells, best in ranked_rows(results, "base")[1:]}
    assert found == {"stopping_distance [m]": [2, 4], "adhesion_use": [3], "lock_time [s]": [],
                     "slip_max [m/s]": []}  # fmt: skip


def test_a_settling_time_that_tells_no_loop_from_another_is_left_out_with_the_reason() -> None:
    """Nor does a table show newtons: the same torque has one unit everywhere."""

    def loop(first: float, torque: float) -> dict[str, Metric]:
        return {
            "settling_time": Metric([first, 0.0, 0.0], "s", ("dry", "wet", "ice")),
            "torque_ripple": Metric(torque, "N m"),
        }

    loops = {"one": loop(0.1, 12000.0), "two": loop(0.2, 183.0)}
    rows = ranked_rows(Results(toy_study.study, [], metrics={"base": loops}), "base")
    assert [r for r, _ in rows[1:]] == [["settling_time [s]", "0.1 / 0 / 0", "0.2 / 0 / 0"],
                                        ["torque_ripple [kN m]", "12", "0.183"]]  # fmt: skip
    text = metric_table(Results(toy_study.study, [], metrics={"base": loops}), "base", 60)
    assert "dry / wet / ice" in text
    assert max(map(len, text.splitlines())) <= 60
    loops["two"]["settling_time"] = Metric([0.2, None, 0.3], "s", ("dry", "wet", "ice"))
    rows = ranked_rows(Results(toy_study.study, [], metrics={"base": loops}), "base")
    assert rows[1][0] == ["settling_time [s]", "0.1 / 0 / 0", "0.2 / never / 0.3"]
    for each in ("one", "two"):
        loops[each]["settling_time"] = Metric([None] * 3, "s", ("dry", "wet", "ice"))
    text = metric_table(Results(toy_study.study, [], metrics={"base": loops}), "base", 200)
    assert "settling_time [s]" not in text
    assert "settling_time: no loop settles in the band" in text


def test_a_run_that_failed_is_the_best_of_no_row() -> None:
    """It slid through with the smallest ripple, and did not stop where the others did."""

    def loop(stop: float | None, ripple: float) -> dict[str, Metric]:
        return {"stopping_distance": Metric(stop, "m"), "torque_ripple": Metric(ripple, "N m")}

    loops = {"none": loop(None, 0.0), "a": loop(120.0, 2.0), "b": loop(110.0, 3.0)}
    results = Results(toy_study.study, [], metrics={"base": loops})
    found = {cells[0]: best for cells, best in ranked_rows(results, "base")[1:]}
    assert found == {"stopping_distance [m]": [3], "torque_ripple [kN m]": [2]}


def test_no_minus_zero() -> None:
    assert [number(x) for x in (-0.0, [0.0, -0.0], -1e-9)] == ["0", "0 / 0", "-1e-9"]


@pytest.mark.parametrize("name", ["subway_braking", "hst_braking", "freight_traction"])
def test_figures_of_a_part_of_a_study_are_drawn_or_left_out(name: str) -> None:
    """Nothing was run, and the loops of the paper were not asked for."""
    study = load_study(name)
    case = study.cases(study.models, True)[0]
    last = list(case.loops)[-1]
    results = Results(study, [replace(case, loops={last: case.loops[last]})], quick=True)
    drawn = {}
    for key, figure in study.figures.items():
        with contextlib.suppress(NotRun):
            drawn[key] = figure.draw(results)
    assert any(key.endswith("adhesion_curves") for key in drawn)
    assert None not in drawn.values()


@law(y=Output("N", "sum"))
def weighed(a=Input("N", "in"), w=Param("1", [1.0, 1.0], "weights", shape=(2,)),
            m=Param("kg", 1.0, "mass")):  # fmt: skip
    """A vector of numbers."""
    return a * (w[0] + w[1] + m)


def test_a_vector_is_set_element_by_element_in_its_units():
    made = case_setup._with(weighed, ["w"], case_setup.Setting.read("w=[25 %, 3]"))
    assert np.ravel(made.param_values()["w"]).tolist() == [0.25, 3.0]
    made = case_setup._with(weighed, ["m"], case_setup.Setting.read("m=2t"))
    assert made.param_values()["m"] == 2000
    with pytest.raises(BadInput, match="w"):
        case_setup._with(weighed, ["w"], case_setup.Setting.read("w=[1, 2, 3]"))
