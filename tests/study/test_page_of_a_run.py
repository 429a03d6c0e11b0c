"""The page of a run says what the run gave: each number once more, where its head says it is."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser

import pytest
import toy_study

from slipctl import Table
from slipctl.study import case_setup, execution
from slipctl.study.report.report_page import page
from slipctl.study.report.texts import ranked_rows


class Sections(HTMLParser):
    """Text, tables and headings of each section, by its key."""

    def __init__(self, text):
        super().__init__()
        self.tables, self.words, self.heads, self.links = {"": []}, {"": ""}, {"": []}, []
        self.key, self.tag, self.script, self.cell = "", "", {}, False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        at = dict(attrs)
        if tag == "section":
            self.key = None
        if tag == "h2":
            self.key = at["id"]
            self.tables[self.key], self.words[self.key], self.heads[self.key] = [], "", []
        if tag == "a":
            self.links.append(at["href"])
        if tag == "table":
            self.tables[self.key].append([])
        if tag == "tr":
            self.tables[self.key][-1].append([])
        if tag in ("td", "th"):
            self.tables[self.key][-1][-1].append("")
            self.cell = True
        if tag in ("h3", "summary") and not self.cell:
            self.heads[self.key].append("")
        if tag in ("h3", "summary", "script"):
            self.tag = tag

    def handle_endtag(self, tag):
        self.tag = "" if tag == self.tag else self.tag
        self.cell = self.cell and tag not in ("td", "th")
        self.key = "" if tag == "section" else self.key

    def handle_data(self, text):
        if self.cell:
            self.tables[self.key][-1][-1][-1] += text
        if self.tag in ("h3", "summary") and not self.cell:
            self.heads[self.key][-1] += text
        if self.tag == "script":
            self.script[self.key] = text
        elif self.key is not None:
            self.words[self.key] += text


@pytest.fixture(scope="module")
def results():
    cases, models = case_setup.prepare(toy_study.study, quick=True)
    return execution.run(toy_study.study, cases, models, quick=True)


@pytest.fixture(scope="module")
def shown(results):
    verdicts = execution.judge_all(results)
    return Sections(page(results, verdicts, {"fig01": "<svg/>"}, "slipctl run <toy>"))


def test_sections_stand_in_the_order_of_the_contents(shown):
    assert shown.links == [f"#{k}" for k in shown.words if k]
    assert [k for k in shown.words if k] == ["figures", "metrics", "claims", "experiments", "loops",
                                             "equations", "parameters", "provenance"]  # fmt: skip
    assert "A quick run" in shown.words[""]
    assert "Does the soft controller slip less than the hard one?" in shown.words[""]
    assert "fig01 (Fig. 1 of the paper). Slip of both. Quick run." in shown.words["figures"]


def test_each_metric_is_shown_for_each_loop(results, shown):
    assert shown.heads["metrics"][0] == "base"
    assert "noisy" in shown.heads["metrics"]
    assert "No noise." in shown.words["metrics"]
    for scenario, rows in zip(("base", "noisy"), shown.tables["metrics"], strict=True):
        (head, _), *wanted = ranked_rows(results, scenario)
        assert rows[0] == head
        assert rows[0][1:] == list(results.metrics[scenario])
        assert len(rows) == len(wanted) + 1
        for row, (cells, _) in zip(rows[1:], wanted, strict=True):
            assert row[0].startswith(cells[0])
            assert [c.replace(" ", "") for c in row[1:]] == [c.replace(" ", "") for c in cells[1:]]
    way = next(r for r in shown.tables["metrics"][0] if r[0].startswith("distance"))
    assert float(way[1]) == pytest.approx(results.metric("base", "soft", "distance"), rel=1e-5)
    assert len(way[0]) > len("distance [m]")  # what it means is a click away


@pytest.mark.parametrize("scenario", ["base", "noisy"])
def test_a_scenario_that_was_not_run_hides_no_other(results, scenario):
    alone = replace(results, metrics={scenario: results.metrics[scenario]})
    told = Sections(page(alone, [], {}, "slipctl run <toy>"))
    assert told.heads["metrics"] == [scenario]
    assert len(told.tables["metrics"]) == 1


def test_each_claim_has_its_verdict_tolerance_and_assumption(results, shown):
    verdicts = {v.claim.claim: v for v in execution.judge_all(results)}
    ((head, *rows),) = shown.tables["claims"]
    assert head == ["Claim", "Paper", "Ours", "Verdict", "Why"]
    assert len(rows) == len(verdicts) == 4
    for row in rows:
        v = next(v for text, v in verdicts.items() if row[0].startswith(text))
        assert row[3] == v.verdict
        assert v.why in row[4]
        assert v.claim.source in row[0]
        assert (" · base/soft" in row[0]) == (v.claim.id == "way")
        assert ("Tolerance" in row[4]) == (v.claim.id == "way")
        assert ("Assumed: 20 m/s at the start." in row[4]) == (v.claim.id == "way")


def test_rows_of_an_experiment_are_shown_up_to_forty(results, shown):
    ((head, *rows),) = shown.tables["experiments"]
    table = results.table("seeds")
    assert shown.heads["experiments"] == ["Many seeds"]
    assert "How bad can it be?" in shown.words["experiments"]
    assert "Worst error at the end." in shown.words["experiments"]
    assert head == ["seed", "e [m/s]"]
    assert [float(r[0]) for r in rows] == list(table["seed"])
    assert [float(r[1]) for r in rows] == pytest.approx(list(table["e"]), rel=1e-3)
    many = Table("More", {"k": ("1", range(43)), "v": ("m/s", [k / 2 for k in range(43)])})
    more = Sections(page(replace(results, tables={"seeds": {"": many}}), [], {}, ""))
    ((_, *rows),) = more.tables["experiments"]
    assert [float(r[1]) for r in rows] == [k / 2 for k in range(40)]
    assert "3 more rows are in tables.json" in more.words["experiments"]
    assert "claims" not in more.words
    assert "figures" not in more.words


def test_each_parameter_has_its_value_unit_and_source_and_who_sets_it(results, shown):
    main, conditions = shown.tables["parameters"]
    loops = results.cases[0].loops
    rows = {r[0]: r[1:] for r in main[1:]}
    assert list(rows) == list(loops["soft"].params)
    for name, s in loops["soft"].params.items():
        value = loops["soft"].param_values()[name]
        assert float(rows[name][0].split()[0]) == pytest.approx(float(value), rel=1e-5)
        assert rows[name][2:] == [s.doc, s.source]
    assert rows["plant.car.J"][1] == "kg m²"
    assert [n for n, r in rows.items() if "the rail sets it" in r[0]] == ["plant.adh.c"]
    assert conditions == [["Condition", "plant.adh.c"], ["dry", "1"], ["ice", "0.1"]]


def test_a_number_that_loops_have_not_alike_is_told_with_the_loops(results):
    first = results.cases[0]
    loops = first.loops | {"hard": first.loops["hard"].with_params(**{"ctl.K": 8000.0})}
    changed = replace(results, cases=[replace(first, loops=loops)], failed={"base/hard": "it <b>"})
    shown = Sections(page(changed, [], {}, "", state="ended early"))
    rows = {r[0]: r[1] for r in shown.tables["parameters"][0]}
    assert rows["ctl.K"] == "4000 in soft; 8000 in hard"
    assert "; " not in rows["ctl.k"]
    assert "ended early" in shown.words[""]
    assert "base/hard failed: it <b>" in shown.words[""]
    assert len(shown.tables["metrics"]) == 1  # of the scenario that is left


def test_each_loop_is_drawn_and_what_is_inside(shown):
    names = [n for head in shown.heads["loops"][:2] for n in head.split(", ")]
    assert {"soft", "hard"} <= set(names)
    assert any(h.startswith("Inside plant of every loop") for h in shown.heads["loops"])


def test_where_it_comes_from_is_told_and_kept_for_machines(shown):
    ((_, *rows),) = shown.tables["provenance"]
    assert rows[0] == ["Command", "slipctl run <toy>"]
    assert rows[1] == ["Seed by scenario", "base 1, noisy 7, experiments 1"]
    kept = json.loads(shown.script["provenance"])
    assert (kept["format"], kept["command"], kept["quick"]) == (1, "slipctl run <toy>", True)
