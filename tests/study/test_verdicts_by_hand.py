"""Verdicts and their reasons, each against an answer by hand."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from slipctl import BadInput
from slipctl.run.results import LeftToFull, NotRun
from slipctl.study.declaration import FAILED, OPEN, REPRODUCED, Claim, half_last_digit
from slipctl.study.verdicts import CHANGED, NEEDS_FULL, NOT_RUN, judge, percent

RESULTS = SimpleNamespace(asked={"stale"})


def judged(kind, paper, ours, changed=None, **more):
    answer = ours if callable(ours) or ours is None else lambda results: ours
    claim = Claim("c", "section 1", "it holds", kind, paper, answer, **more)
    return judge(claim, RESULTS, changed)


NUMBERS = [
    ("100", 103.0, {"tolerance": "5 %"}, True, "off by +3 (+3 %), allowed 5"),
    ("100", 96.0, {"tolerance": "5 %", "unit": "m"}, True, "off by -4 m (-4 %), allowed 5"),
    ("100", 106.0, {"tolerance": "5 %"}, False, "off by +6 (+6 %), allowed 5"),
    ("100", 104.6, {"tolerance": "5 %"}, True, "off by +4.6 (+4.6 %), allowed 5: close, 0.4 more"
     " turns the verdict"),
    ("100", 105.4, {"tolerance": "5 %", "unit": "s"}, False, "off by +5.4 s (+5.4 %), allowed 5:"
     " close, 0.4 s less turns the verdict"),
    ("100", 105.6, {"tolerance": "5 %"}, False, "off by +5.6 (+5.6 %), allowed 5"),
    ("254.05", 254.053, {"tolerance": "last digit"}, True, "off by +0.003 (+0.0012 %), allowed"
     " 0.005"),
    ("-2.5e3", -2700.0, {"tolerance": 250, "unit": "N"}, True, "off by -200 N (+8 %), allowed"
     " 2.5e+02"),
    ("40", 30.0, {"tolerance": 20, "unit": "%"}, True, "off by -10 %, allowed 20"),
    ("0", 0.5, {"tolerance": 1}, True, "off by +0.5, allowed 1"),
    ("9", 10.5, {"bound": "at most"}, False, "1.5 beyond"),
    ("9", 8.0, {"bound": "at most", "unit": "m"}, True, "1 m inside"),
    ("9", 10.5, {"bound": "at most", "tolerance": 2}, True, "1.5 beyond"),
    ("9", 8.0, {"bound": "at least", "unit": "m"}, False, "1 m beyond"),
    ("9", 11.0, {"bound": "at least"}, True, "2 inside"),
]  # fmt: skip


@pytest.mark.parametrize(("paper", "ours", "more", "holds", "why"), NUMBERS)
def test_a_number_is_held_against_the_one_of_the_paper(paper, ours, more, holds, why):
    found = judged("number", paper, ours, **more)
    assert (found.verdict, found.why, found.ours) == (REPRODUCED if holds else FAILED, why, ours)
    assert not found.left


ORDERS = [
    ("a > b > c", {"a": 3.0, "b": 2.0, "c": 1.0}, {}, True, ""),
    ("a < b > c", {"a": 1.0, "b": 3.0, "c": 2.0}, {}, True, ""),
    ("a > b > c", {"a": 3.0, "b": 1.0, "c": 2.0}, {}, False, "b is not above c"),
    ("a < b < c", {"a": 3.0, "b": 2.0, "c": 5.0}, {}, False, "b is not above a"),
    ("a > b > c", {"a": 3.0, "b": 2.0, "c": 2.0}, {}, False, "b and c tie"),
    ("a > b > c", {"a": 3.0, "b": 2.0, "c": None}, {}, False, "c has no value"),
    ("a > b > c", {"a": None, "b": 2.0, "c": None}, {}, False, "a has no value"),
    ("a > b > c", {"a": 100.0, "b": 99.5, "c": 50.0}, {"unit": "m"}, True,
     "a above b: close, 0.5 m (0.5 %) turns the verdict"),
    ("a > b > c", {"a": 100.0, "b": 98.5, "c": 98.0}, {}, True,
     "b above c: close, 0.5 (0.51 %) turns the verdict"),
    ("a > b > c", {"a": 100.0, "b": 99.5, "c": 99.0}, {}, True,
     "a above b: close, 0.5 (0.5 %) turns the verdict; b above c: close, 0.5 (0.5 %) turns the"
     " verdict"),
    ("a > b", {"a": 99.5, "b": 100.0}, {}, False,
     "a is not above b: close, 0.5 (0.5 %) turns the verdict"),
    ("a > b", {"a": 98.5, "b": 100.0}, {}, False, "a is not above b"),
    ("a > b", {"a": 110.0, "b": 100.0}, {"tolerance": "5 %"}, True, ""),
    ("a > b", {"a": 104.0, "b": 100.0}, {"tolerance": "5 %"}, False,
     "a is not above b"), ("a < b", {"a": 100.0, "b": 104.0}, {"tolerance": 3}, True,
     "b above a: close, 1 (0.96 %) turns the verdict"),
    ("a < b", {"a": 100.0, "b": 104.0}, {"tolerance": 4.5}, False,
     "b is not above a: close, 0.5 (0.48 %) turns the verdict"),
    ("a > b", {"a": 0.0, "b": -1.0}, {}, True, ""),
]  # fmt: skip


@pytest.mark.parametrize(("paper", "ours", "more", "holds", "why"), ORDERS)
def test_an_order_is_held_step_by_step(paper, ours, more, holds, why):
    found = judged("order", paper, ours, **more)
    assert (found.verdict, found.why) == (REPRODUCED if holds else FAILED, why)


def test_an_order_of_names_that_are_not_there_is_refused():
    for ours in ({"a": 2.0, "b": 1.0}, 3.0):
        with pytest.raises(BadInput, match=r"claim c: ours gives no '[ac]'"):
            judged("order", "a > b > c", ours)


@pytest.mark.parametrize(("paper", "ours"), [(True, 1), (True, 0), (False, 0), (False, 2)])
def test_a_question_has_one_answer(paper, ours):
    found = judged("yes/no", paper, ours)
    assert found.verdict == (REPRODUCED if bool(ours) == paper else FAILED)
    assert judged("yes/no", paper, lambda results: None).why == "ours has no value"


def test_reasons_stand_behind_each_other_and_those_against_only_where_it_fails():
    def lacks(results):
        raise NotRun("loop b was not run")

    more = {"tolerance": 1, "why": "a rounding", "why_not": lambda results: "too long a tick"}
    assert judged("number", "5", 5.5, **more).why == "off by +0.5 (+10 %), allowed 1; a rounding"
    assert judged("number", "5", 8.0, **more).why == (
        "off by +3 (+60 %), allowed 1; a rounding; too long a tick"
    )
    more |= {"why": lacks, "why_not": lacks}
    assert judged("number", "5", 8.0, **more).why == "off by +3 (+60 %), allowed 1"


def test_a_claim_is_left_where_what_it_speaks_of_was_not_run_or_is_another():
    def lacks(error):
        def ours(results):
            raise error

        return ours

    given = {"tolerance": 1}
    full = judged("number", "5", lacks(LeftToFull("it is long")), **given)
    assert (full.verdict, full.why, full.left) == (OPEN, "it is long", NEEDS_FULL)
    missing = judged("number", "5", lacks(NotRun(f"loop a {NOT_RUN}")), **given)
    assert (missing.verdict, missing.ours, missing.left) == (OPEN, None, NOT_RUN)
    broke = judged("number", "5", lacks(NotRun("loop a failed")), **given)
    assert (broke.verdict, broke.why, broke.left) == (OPEN, "loop a failed", "")

    def ours(results):
        results.asked.add("loop a")
        return 5.0

    seen = []
    other = judged("number", "5", ours, lambda claim, asked: seen.append(asked) or "a is another",
                   **given)  # fmt: skip
    assert (other.verdict, other.ours, other.why, other.left) == (OPEN, None, "a is another",
                                                                  CHANGED)  # fmt: skip
    assert seen == [{"loop a"}]  # what was asked for another claim is forgotten
    assert judged("number", "5", ours, lambda claim, asked: "", **given).verdict == REPRODUCED
    open_ = judged("number", "5", lambda results: 5.5, not_checkable="no data")
    assert (open_.verdict, open_.ours, open_.why) == (OPEN, 5.5, "no data")
    for none in (None, lacks(NotRun("no"))):
        assert judged("number", "5", none, not_checkable="no data").ours is None


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.0031, "+0.31 %"), (-1.2, "-120 %"), (0.105, "+10 %"), (0.0949, "+9.5 %"),
     (-0.0625, "-6.2 %"), (0.1, "+10 %"), (0.104, "+10 %"), (0.0, "+0 %"),
     (0.09999, "+10 %"), (0.1044, "+10 %")],
)  # fmt: skip
def test_a_share_is_told_in_per_cent(share, said):
    assert percent(share) == said


@pytest.mark.parametrize(
    ("printed", "half"),
    [("254.0479", 5e-5), ("12", 0.5), ("1.5e3", 50.0), ("2.50E-2", 5e-5), ("-3.1", 0.05)],
)
def test_half_of_the_last_digit_that_is_printed(printed, half):
    assert half_last_digit(printed) == pytest.approx(half, rel=1e-12)
