"""Numbers, verdicts and tables as a reader sees them."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.run.metrics import METRICS, Metric
from slipctl.study.declaration import FAILED, OPEN, REPRODUCED, Claim
from slipctl.study.report import texts
from slipctl.study.report.texts import number, telling_digits, with_unit
from slipctl.study.verdicts import CHANGED, NEEDS_FULL, NOT_RUN, Verdict


@given(st.floats(1e-25, 1e25), st.sampled_from([1.0, -1.0]), st.integers(2, 9))
def test_a_number_is_told_to_so_many_digits(size, sign, digits):
    told = number(sign * size, digits)
    assert float(told) == pytest.approx(sign * size, rel=0.5001 * 10.0 ** (1 - digits))
    assert "e+" not in told
    assert "e0" not in told
    if 1e-4 <= size < 1e6:
        assert "e" not in told


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (None, "–"), (True, "yes"), (np.bool_(False), "no"), (3, "3"), (np.int64(-2), "-2"),
        (math.nan, "–"), (math.inf, "–"), (1e-31, "0"), (-0.0, "0"), (1e6, "1000000"),
        (1234567.0, "1234567"), (1.5e7, "1.5e7"), (1.5e-5, "1.5e-5"), (0.25, "0.25"),
        ([1.0, None, 2.5], "1 / – / 2.5"), ({"a": 1.0, "b": 2.0}, "a 1, b 2"), ("text", "text"),
        ({"a": 1.00001, "b": 1.00002}, "a 1.00001, b 1.00002"),
    ],
)  # fmt: skip
def test_a_value_is_told_for_a_reader(value, told):
    assert number(value) == told


def test_digits_are_as_many_as_tell_numbers_apart_and_nine_at_most():
    assert telling_digits([1.0, 2.0], 4) == 4
    assert telling_digits([1.00001, 1.00002, math.inf, None], 4) == 6
    assert telling_digits([1.0, 1.0 + 1e-12], 4) == 9


def test_a_unit_stands_behind_numbers_alone():
    assert [with_unit(v, "m") for v in (2.5, 3, [1.0, 2.0], True, None, "dry")] == [
        "2.5 m", "3 m", "1 / 2 m", "yes", "–", "dry"]  # fmt: skip
    assert with_unit(2.5, "1") == "2.5"
    assert [texts.number_or_never(v) for v in (math.inf, 2.0, None)] == ["never", "2", "–"]


def claim(kind="number", paper="254.05", **more):
    if kind != "yes/no":
        more.setdefault("tolerance", "5 %")
    return Claim("id", "section 1", "it stops", kind, paper, lambda results: 254.0, **more)


def test_a_claim_is_told_with_both_answers_their_units_and_the_verdict():
    way = claim(unit="m")
    assert texts.answers(Verdict(way, 254.0, REPRODUCED, "")) == ("254.05 m", "254 m")
    most = claim(paper=300.0, bound="at most", unit="m")
    assert texts.answers(Verdict(most, 254.0, REPRODUCED, ""))[0] == "at most 300 m"
    order = claim("order", "dry > wet", unit="s")
    ours = {"dry": 2.0, "wet": 1.0}
    assert texts.answers(Verdict(order, ours, REPRODUCED, "")) == ("dry > wet", "dry 2, wet 1 s")
    assert texts.answers(Verdict(claim("yes/no", True), False, FAILED, "")) == ("yes", "no")
    said = texts.claim_line(Verdict(way, 254.0, FAILED, "too short"))
    assert said == f"Claim: it stops. Paper 254.05 m, ours 254 m; {FAILED}: too short."
    assert texts.claim_line(Verdict(way, 254.0, OPEN, "")).endswith(f"; {OPEN}.")
    left = texts.claim_line(Verdict(way, None, OPEN, "", NEEDS_FULL))
    assert left == f"Claim: it stops. Not judged: it {NEEDS_FULL}."


def test_verdicts_are_counted_by_kind_and_by_why_they_are_left_out():
    kinds = [REPRODUCED] * 3 + [FAILED] * 2 + [OPEN]
    verdicts = [Verdict(claim(), 1.0, k, "") for k in kinds]
    assert texts.count(verdicts) == f"3 {REPRODUCED}, 2 {FAILED}, 1 {OPEN}"
    for why, many, words in (
        (NEEDS_FULL, 1, "--full would judge 1 more"),
        (NOT_RUN, 2, "2 left out, because they speak of what was not run"),
        (CHANGED, 3, "3 left out, because they speak of what was changed"),
    ):
        left = [Verdict(claim(), None, REPRODUCED, "", why)] * many
        assert texts.count([*verdicts, *left]).split("; ") == [texts.count(verdicts), words]
        assert texts.count(left) == words
        assert texts.verdicts_of_run([*left, *verdicts]) == verdicts
    table = texts.claim_table([Verdict(claim(unit="m"), 254.0, FAILED, "a reason " * 12)], 90)
    lines = table.split("\n")
    assert all(len(line) <= 90 for line in lines)
    assert lines[-1] == f"1 claims: 1 {FAILED}"
    assert " ".join(table.split()).count("reason") == 12


@given(st.lists(st.tuples(st.text("ab ", max_size=30), st.text("cd ", max_size=30)), min_size=1))
def test_a_wrapped_table_holds_every_word_in_its_column(rows):
    lines = texts.wrap_table(rows, (7, 9)).split("\n")
    ruler = lines.index("-------  ---------")
    assert all(len(line) <= 7 + 2 + 9 for line in lines)
    left = "".join(line[:7] for line in lines[:ruler] + lines[ruler + 1 :])
    right = "".join(line[9:] for line in lines[:ruler] + lines[ruler + 1 :])
    assert left.replace(" ", "") == "".join(a for a, _ in rows).replace(" ", "")
    assert right.replace(" ", "") == "".join(b for _, b in rows).replace(" ", "")


def results_of(**loops):
    metrics = {n: {k: Metric(v, "m") for k, v in m.items()} for n, m in loops.items()}
    return SimpleNamespace(metrics={"base": metrics}, study=SimpleNamespace(limits={"distance": 9}))


def test_what_is_above_a_limit_is_named_with_its_places_and_its_worst():
    found = results_of(
        good={"distance": 9.0}, far={"distance": [8.0, 9.5, 12.0]}, none={},
        never={"distance": [None, 3.0]},
    )  # fmt: skip
    assert texts.values_beyond_limit(found, "base") == {
        "good": {}, "far": {"distance": [1, 2]}, "none": {"distance": []},
        "never": {"distance": [0]},
    }  # fmt: skip
    lines = {line.split()[2]: line for line in texts.limits_broken(found, "base")}
    assert list(lines) == ["far", "none", "never"]
    assert lines["far"].endswith("distance 12 m, at most 9 m")
    assert lines["none"].endswith("it has no distance, which may be 9 at most")
    assert lines["never"].endswith("distance never, at most 9 m")


def test_who_does_not_stop_where_another_does_is_no_competitor():
    found = results_of(a={"stopping_distance": 5.0}, b={"stopping_distance": None},
                       c={"distance": 4.0})  # fmt: skip
    found.study.limits = {}
    assert texts.failed_loops(found, "base") == {"b"}
    rows = texts.ranked_rows(found, "base")
    assert rows[0] == (["metric", "a", "b", "c"], [])
    told = {row[0].split()[0]: (row[1:], best) for row, best in rows[1:]}
    assert told["distance"] == (["", "", "4"], [])
    del found.metrics["base"]["a"]["stopping_distance"]
    assert texts.failed_loops(found, "base") == set()


def test_an_event_that_tells_no_loop_from_another_hides_no_other_metric():
    """Nor does a metric that no loop has; an event that is late in one of them is shown."""
    events = dict.fromkeys((n for n, d in METRICS.items() if d.event), None)
    others = {n: float(k) for k, (n, d) in enumerate(METRICS.items()) if not d.event}
    found = results_of(a=events | others, b=events | others)
    found.study.limits = {}
    assert {row[0].split()[0] for row, _ in texts.ranked_rows(found, "base")[1:]} == set(others)
    for name in events:
        found.metrics["base"]["b"][name] = Metric(3.0, "s")
        assert name in {row[0].split()[0] for row, _ in texts.ranked_rows(found, "base")[1:]}


def test_the_best_is_at_the_better_end_and_where_all_say_the_same_none_is():
    two = results_of(a={"stopping_distance": 5.0, "slip_max": 1.0},
                     b={"stopping_distance": 4.0, "slip_max": 1.0},
                     ideal={"stopping_distance": 1.0})  # fmt: skip
    two.study.limits = {}
    best = {row[0].split()[0]: places for row, places in texts.ranked_rows(two, "base")[1:]}
    assert best["stopping_distance"] == [2]
    assert best["slip_max"] == []


def test_sections_are_named_where_a_metric_has_several():
    found = results_of(a={"distance": 5.0})
    assert texts.sections_line(found, "base") == ""
    for rows, told in ((("dry",), ""), (("dry", "wet"), "Sections in order: dry / wet")):
        found.metrics["base"]["a"]["distance"] = Metric([1.0] * len(rows), "m", rows)
        assert texts.sections_line(found, "base") == told


def test_what_was_left_and_changed_is_said():
    study = SimpleNamespace(experiments={"noise": 1, "mass": 2}, claims=[])
    found = SimpleNamespace(left={"ice", "noise"}, study=study, changed="")
    assert texts.left_to_full(found) == "Left to --full: scenarios ice; experiments noise"
    assert texts.left_to_full(SimpleNamespace(left=set())) == ""
    assert texts.changes(found) == ""
    found.changed = "a set"
    assert texts.changes(found) == "with a set"
    study.claims = [1]
    assert texts.changes(found) == "with a set; claims are of the paper's model"
