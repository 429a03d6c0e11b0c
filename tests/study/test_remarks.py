"""The answer of a run in a line, and doubts about estimators in a sentence."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

from slipctl.run.metrics import Run, measure
from slipctl.run.roles import Signals
from slipctl.study import resolve
from slipctl.study.report.remarks import (
    answer_html,
    answer_line,
    estimator_remarks,
    remarks_html,
    warnings_of_runs,
)

T = np.arange(0, 20, 0.01)
SIGNALS = Signals(speed="v", slip="s", reference="r")


def log(v, s, off=None, told=""):
    units = {"v": "m/s", "s": "m/s", "r": "m/s"}
    data = {"v": v, "s": s, "r": 0 * T + 0.5}
    attrs = {"period_s": 0.01, "told": told}
    if off:
        attrs["estimates_off"] = json.dumps([{
            "what": "adhesion curve", "axle": 1, "start": off[0], "stop": off[1],
            "to_end": bool(off[1] >= T[-1]), "numbers": "theta is off by 3.2",
        }])  # fmt: skip
    return xarray.Dataset(
        {n: ("time", np.broadcast_to(x, T.shape), {"units": units[n]}) for n, x in data.items()},
        coords={"time": T}, attrs=attrs,
    )  # fmt: skip


def results(limits=None, **logs):
    return SimpleNamespace(
        study=SimpleNamespace(signals=SIGNALS, limits=limits or {}), cases=[], data={"base": logs},
        metrics={"base": {n: measure(Run(x, SIGNALS)) for n, x in logs.items()}},
    )  # fmt: skip


def answer_lines(found, scenario):
    return {loop: answer_line(found, scenario, loop) for loop in found.metrics[scenario]}


def test_a_line_says_where_a_vehicle_stops_and_how_its_wheels_fared():
    stops, rolls = np.maximum(20 - 2 * T, 0), 20 - 0.1 * T
    lines = answer_lines(results(
        {"lock_time": 0.3}, held=log(stops, np.minimum(0.5, stops)), none=log(rolls, rolls)
    ), "base")  # fmt: skip
    assert lines["held"] == "held stops in 100 m; wheels never lock"
    assert lines["none"].startswith("none does not stop: 64.8 km/h after 20 s, 380")
    assert "wheels lock for 20 s; misses its limit of lock_time" in lines["none"]


def test_a_line_says_that_a_vehicle_rolls_back():
    """A driven one that its motors do not hold; one that has stopped, and does not stay there."""
    back, turns = -0.2 * T, 2 - 0.4 * T
    lines = answer_lines(results(started=log(back, back), stopped=log(turns, turns)), "base")
    assert lines["started"].startswith("started goes from 0 km/h to 14.4 km/h backwards in 20 s,")
    assert lines["stopped"].startswith("stopped stops in 4.987 m and rolls back;")


@pytest.mark.parametrize(
    ("slip", "held", "said"),
    [
        (0.5, True, "the controller held the slip all the same"),
        (np.where(T < 6.2, 0.6, 0.64), True, "the controller held the slip all the same"),
        (np.where(T < 6.2, 0.6, 0.66), False, "the slip came to 0.66 m/s then, no wheel locked"),
        (np.where(T > 8, 3.0, 0.5), False, "the slip came to 3 m/s then, no wheel locked"),
        (np.where(T > 8, 20 - 0.5 * T, 0.5), False, "wheels locked for"),
        (np.where(T > 8, 0.952 * (20 - 0.5 * T), 0.5), False, "wheels locked for"),
        (np.where(T > 8, 0.948 * (20 - 0.5 * T), 0.5), False, "no wheel locked"),
    ],
)
def test_a_doubt_is_a_sentence_and_a_warning_only_where_the_slip_was_lost(slip, held, said):
    found = results(a=log(20 - 0.5 * T, slip, (6.2, 20.0)))
    (remark,) = estimator_remarks(found)
    assert remark.text.startswith("the estimated adhesion curve of axle 1 was wrong from 6.2 s on;")
    assert said in remark.text
    assert remark.numbers == ("theta is off by 3.2",)
    assert remark.held is held
    assert [line for line, _ in warnings_of_runs(found)] == ([] if held else [remark.text])


def test_each_loop_that_has_a_doubt_has_a_line_and_no_other():
    v = np.maximum(20 - 0.5 * T, 5)
    found = results(good=log(v, 0.5), off=log(v, 0.5, (2.0, 7.5)), fine=log(v, 0.5),
                    late=log(v, 0.5, (9.0, 20.0)))  # fmt: skip
    remarks = estimator_remarks(found)
    assert [(r.scenario, r.loop) for r in remarks] == [("base", "off"), ("base", "late")]
    assert "from 2.0 s to 7.5 s" in remarks[0].text
    assert "from 9.0 s on" in remarks[1].text


@pytest.mark.parametrize(
    "name", ["subway_braking", "hst_braking", "hst_traction", "freight_traction"]
)
def test_the_answer_of_a_study_is_that_of_its_page(name):
    """A fact has one place: what the page says in short is what the study prints."""
    with open(f"docs/{name}.md", encoding="utf-8") as file:
        text = file.read()
    short = " ".join(text.partition("## In short\n\n")[2].partition("\n\n")[0].split())
    study = resolve.load_study(name)
    assert study.short == short
    assert study.headline in {c.id for c in study.claims}


@pytest.mark.parametrize("name", sorted(resolve.studies()))
def test_the_answer_of_a_study_has_three_sentences_at_most(name):
    short = resolve.load_study(name).short
    assert 1 <= len(re.findall(r"[.?!](?: |$)", short)) <= 3


def test_the_answer_of_a_page_is_its_own_words_or_a_line_for_each_loop():
    """Of a study with claims these are the answer."""
    v = np.maximum(20 - 2 * T, 0)
    found = results(a=log(v, np.minimum(0.5, v)), b=log(v, np.minimum(0.25, v)))
    found.study.short, found.study.claims = "It <stops>.", [1]
    assert answer_html(found) == "<p><b>In short.</b> It &lt;stops&gt;.</p>"
    found.study.short = ""
    assert answer_html(found) == ""
    found.study.claims = []
    said = answer_html(found)
    lines = list(answer_lines(found, "base").values())
    assert said == "<ul>" + "".join(f"<li>{line}.</li>" for line in lines) + "</ul>"
    found.metrics = {}
    assert answer_html(found) == ""


def test_what_is_to_be_doubted_stands_with_all_numbers():
    found = results(good=log(20 - 0.5 * T, 0.5), off=log(20 - 0.5 * T, 0.5, (6.2, 20.0)))
    (remark,) = estimator_remarks(found)
    assert remarks_html(found) == (
        f'<p>base/off: {remark.text}.</p><p class="soft">theta is off by 3.2.</p>'
    )
    assert remarks_html(results(good=log(20 - 0.5 * T, 0.5))) == ""
