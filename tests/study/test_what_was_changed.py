"""What a setting or a swap changes, which claims that touches, and what results answer."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import toy_study

from slipctl import (
    BadInput,
    Input,
    Known,
    Output,
    Rail,
    Section,
    State,
    flow,
    over_distance,
    sampled,
)
from slipctl.run.results import NotRun, Results, known_column
from slipctl.run.warnings.wheels import RELEASES, _ended_releases, _wrong_speed
from slipctl.study import case_setup, resolve
from slipctl.study.claim_scope import changes
from slipctl.study.declaration import FAILED, OPEN
from slipctl.study.verdicts import CHANGED, judge

STUDY = toy_study.study
CASES, MODELS = case_setup.prepare(STUDY, quick=True)
RESULTS = Results(STUDY, CASES, left=("far",))
CLAIM = {c.id: c for c in STUDY.claims}
NUMBER = replace(CLAIM["way"], scenario="", loop="")


@pytest.mark.parametrize(
    ("setting", "claim", "asked", "said"),
    [
        ("ctl.K=5000N s", CLAIM["ripple"], "base/soft", "ctl.K of base/soft was changed"),
        ("ctl.K=5000N s", CLAIM["ripple"], "noisy/soft", "ctl.K of noisy/soft was changed"),
        ("ctl.K=5000N s", CLAIM["ripple"], "noisy/hard", ""),  # there is none
        ("hard:ctl.K=5000N s", CLAIM["ripple"], "base/soft", ""),
        ("hard:ctl.K=5000N s", CLAIM["ripple"], "base/hard", "ctl.K of base/hard was changed"),
        ("car.m=9t", CLAIM["ripple"], "base/soft", ""),  # an order speaks of the law
        ("car.m=9t", NUMBER, "base/soft", "plant.car.m of base/soft was changed"),
        ("car.m=9t", replace(NUMBER, bound="at most"), "base/soft", ""),
        ("car.m=9t", CLAIM["way"], "", "plant.car.m of base/soft was changed"),
        ("car.v=10m/s", CLAIM["ripple"], "base/soft", "plant.car.v of base/soft was changed"),
        ("car.m=9t", CLAIM["ripple"], "seeds", "experiment seeds is of the study as it stands"),
    ],
)
def test_a_setting_touches_the_claims_that_speak_of_it(setting, claim, asked, said):
    changed = changes(RESULTS, [setting], [], MODELS)
    assert changed(claim, {asked} - {""}) == said
    assert changed(claim, {asked} - {""}) == said  # and when it is asked again


def test_a_swap_touches_numbers_and_of_a_part_of_the_controller_all():
    ripple = CLAIM["ripple"]
    changed = changes(RESULTS, [], ["adh = my.py:law"], MODELS)
    assert changed(NUMBER, {"base/hard"}) == "adh of base/hard was changed"
    assert changed(ripple, {"base/hard"}) == ""
    ctl = CASES[0].loops["soft"]["ctl"]
    changed = changes(RESULTS, [], ["law=my.py:law"], {"law": ctl})
    assert changed(ripple, {"base/soft"}) == "law of base/soft was changed"
    changed = changes(RESULTS, [], ["law=my.py:law"], {"law": lambda: ctl})  # may be anywhere
    assert changed(ripple, {"base/soft"}) == "law of base/soft was changed"
    assert changes(RESULTS, [], [], MODELS) is None


def test_an_answer_that_divides_by_what_is_nought_now_has_no_value():
    nought = replace(CLAIM["ripple"], ours=lambda results: 1.0 / len(results.failed))
    for wrong, left, verdict in (("", "", FAILED), ("car.m was changed", CHANGED, OPEN)):
        told = judge(nought, RESULTS, lambda claim, asked, wrong=wrong: wrong)
        assert (told.ours, told.left, told.verdict) == (None, left, verdict)
    with pytest.raises(ZeroDivisionError):  # of the study as it stands it is a fault
        judge(nought, RESULTS)


def test_swaps_and_settings_are_done_each_in_turn_and_told_as_typed(tmp_path):
    for n in ("a", "b"):
        (tmp_path / f"{n}.py").write_text(
            "from slipctl import Input, Output, Param, law\n"
            f"@law(mu=Output('1'))\ndef {n}(s=Input('m/s'), c=Param('s/m', 1)):\n"
            "    'A law.'\n    return c*s\n")  # fmt: skip
    study = replace(STUDY, models={"adh": toy_study.adhesion, "other": toy_study.adhesion})
    texts = [f"adh={tmp_path / 'a.py'}:a", f"other = {tmp_path / 'b.py'}:b"]
    for order in (texts, texts[::-1]):
        swapped = case_setup.read_swaps(study, order)
        assert {n: b.name for n, b in swapped.items()} == {"adh": "a", "other": "b"}
    mixed = ["other = mu = 2*k*v_s where v_s [m/s], k = 1 s/m", *texts[:1]]
    for order in (mixed, mixed[::-1]):
        swapped = case_setup.read_swaps(study, order)
        assert swapped["adh"].name == "a"
        assert float(swapped["other"](v_s=3.0, k=0.5)["mu"]) == 3.0
    said = case_setup.in_words(["adh = my.py:law", "b=c"], [" car.m=8.2t "])
    assert said == "adh swapped for my.py:law, b swapped for c, car.m=8.2t set"


def test_gains_of_a_file_are_settings_of_its_loop(tmp_path):
    (tmp_path / "g.toml").write_text(
        'format = 1\nloop = "toy.py:soft@base"\n[gains]\n"ctl.K" = 5.0\n'
        '"ctl.k" = 2.0\n')  # fmt: skip
    texts = ["car.m=9t", str(tmp_path / "g.toml"), "car.J=1"]
    wanted = ["car.m=9t", "soft:ctl.K=5.0", "soft:ctl.k=2.0", "car.J=1"]
    assert case_setup.open_gain_files(texts) == wanted
    for wrong in ('format = 1\nloop = "a:b"\n', 'format = 1\n[gains]\n"a" = 1\n'):
        (tmp_path / "w.toml").write_text(wrong)
        with pytest.raises(BadInput, match="holds no gains"):
            case_setup.open_gain_files([str(tmp_path / "w.toml")])


def test_a_plain_run_takes_its_scenarios_and_what_else_is_wanted():
    def kept(plain, also):
        cases = case_setup._plain(replace(STUDY, plain=plain), CASES, also)
        return {c.scenario.name: list(c.loops) for c in cases}

    whole = {"base": ["soft", "hard"], "noisy": ["soft"]}
    assert kept((), {}) == whole
    assert kept(("noisy",), {}) == {"noisy": ["soft"]}
    assert kept(("noisy",), {"base": ["hard"]}) == {"base": ["hard"], "noisy": ["soft"]}
    assert kept(("base", "noisy"), {"base": ["hard"]}) == whole


def test_results_give_a_loop_and_its_numbers_or_say_why_not():
    assert RESULTS.loop("noisy", "soft") is CASES[1].loops["soft"]
    assert RESULTS.number("base", "hard", "ctl.k") == 40000.0
    with pytest.raises(BadInput, match=r"hard has no parameter 'ctl\.q'"):
        RESULTS.number("base", "hard", "ctl.q")
    for scenario, loop in (("noisy", "hard"), ("gone", "soft")):
        with pytest.raises(NotRun, match=f"{scenario}/{loop} was not run"):
            RESULTS.loop(scenario, loop)
    for ask in (RESULTS.loop, RESULTS.log):
        with pytest.raises(NotRun, match=r"^((?!was not run).)*$"):
            ask("far", "soft")
    failed = replace(RESULTS, failed={"base/soft": "it broke", "seeds": "no disk"})
    with pytest.raises(NotRun, match="base/soft failed: it broke"):
        failed.log("base", "soft")
    with pytest.raises(NotRun, match="experiment seeds failed: no disk"):
        failed.table("seeds")


def test_what_is_known_follows_the_sections_under_each_axle():
    rail, log = Rail([Section(0), Section(100)], by="position"), {"time": np.arange(4.0)}
    at = np.array([0.0, 100 - 1e-10, 110.0, 130.0])
    known = Known("1", [0.25, 0.025], "peak")
    column = known_column(known, rail, at, log)
    np.testing.assert_array_equal(column, [0.25, 0.025, 0.025, 0.025])
    np.testing.assert_array_equal(known_column(known, None, None, log), [0.25] * 4)
    each = known_column(replace(known, behind=(0.0, 20.0)), rail, at, log)
    np.testing.assert_array_equal(each.T, [[0.25, 0.025, 0.025, 0.025], [0.25, 0.25, 0.25, 0.025]])
    timed = known_column(replace(known, behind=(0.0, 20.0)), Rail([Section(0), Section(100)]), at,
                         log)  # fmt: skip
    np.testing.assert_array_equal(timed[:, 0], timed[:, 1])
    made = Known("1", lambda log: 2 * log["time"], "double")
    np.testing.assert_array_equal(known_column(made, rail, at, log), [0, 2, 4, 6])


@pytest.mark.parametrize("name", RELEASES)
def test_a_release_that_ended_is_told_by_axle_time_and_count(name):
    given = np.zeros((10, 2))
    given[[3, 4, 7], 1] = 1.0
    (line,) = _ended_releases({"time": np.arange(10.0), name: given})
    assert line.startswith(RELEASES[name][0].format(2))
    assert "at 3 s, 2 times; " in line
    assert line.endswith(RELEASES[name][1])


def test_the_limit_of_a_train_is_not_told_again_of_its_axles():
    train = np.zeros(10)
    train[3:6] = 1.0
    log = {"time": np.arange(10.0)} | dict.fromkeys(RELEASES, train[:, None])
    assert len(list(_ended_releases(log))) < len(RELEASES)
    assert list(_ended_releases({"time": np.arange(10.0)})) == []


def test_a_speed_that_is_further_off_than_it_says_is_told_where_it_is_worst():
    log = {"time": np.arange(5.0), "speed.v_m": np.array([10.0, 10.0, 8.0, 13.0, 10.0]),
           "speed.error": np.full(5, 0.5), "plant.train.v": np.full(5, 10.0)}  # fmt: skip
    (line,) = _wrong_speed(log)
    assert "is 13 m/s at 3 s, the true speed 10 m/s: the error exceeds the 0.5 m/s" in line
    assert list(_wrong_speed(log | {"speed.error": np.full(5, 3.0)})) == []
    assert list(_wrong_speed({k: v for k, v in log.items() if k != "speed.error"})) == []


@flow(y=Output("m/s"))
def timed(v=State("m/s", 1.0), clock=State("s", 0.0), a=Input("m/s^2", value=0.0)):
    """A flow with a clock."""
    return dict(v=a, clock=1), dict(y=v)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: over_distance(sampled(toy_study.car, 1e-3, "rk4"), "v"), "give the flow"),
        (lambda: over_distance(toy_study.car, "x"), r"x \[m\] is no speed"),
        (lambda: over_distance(timed, "v"), "it has a state clock"),
        (lambda: over_distance(toy_study.car, "v", least=0.0), "least"),
        (lambda: Input("m/s", noise=-0.1), "noise = -0.1 is no finite number from 0 on"),
        (lambda: replace(STUDY, claims=STUDY.claims[:1] * 2), "two claims 'ripple'"),
        (lambda: replace(STUDY, headline="gnoe"), "has no claim 'gnoe'"),
        (lambda: resolve.find_block(SimpleNamespace(x=3), "x", "f.py"), "decorate it with"),
    ],
)
def test_what_cannot_be_is_refused(wrong, said):
    with pytest.raises(BadInput, match=said):
        wrong()
