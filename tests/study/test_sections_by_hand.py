"""Sections of a page of stubs of runs: parts with parts, parameters, rails, claims in a file."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from test_page_of_a_sweep import cells

from slipctl import Input, Output, Param, Table, connect, every, law, step
from slipctl.study.cache import Keep
from slipctl.study.declaration import FAILED, Claim
from slipctl.study.files.results_folder import claim_row
from slipctl.study.report import page_style, report_page
from slipctl.study.verdicts import Verdict


@law(mu=Output("1"), conditions={"dry": {"k": 0.4, "q": 2.0}, "wet": {"k": 0.2}, "ice": {"k": 0.1}})
def curve(
    s=Input("1"), k=Param("1", 0.3, "height", source="a book"), q=Param("N m", 2.5, "torque"),
    two=Param("N m", "2*q", "twice"), row=Param("m", (1.0, 1.0), "places", shape=(2,)),
):  # fmt: skip
    """A curve.

    Args:
        s: slip.
    """
    return k * s + q + two + row[0]


@step(y=Output("1"))
def last(u=Input("1", value=0.0)):
    return {}, {"y": u}


def case_of(name, *conditions, **loops):
    rail = SimpleNamespace(sections=[SimpleNamespace(condition=c) for c in conditions])
    return SimpleNamespace(scenario=SimpleNamespace(name=name, rail=rail), loops=loops)


def test_parts_that_have_parts_are_found_behind_those_that_are_seen_through():
    inner = connect("inner", {}, a=last, b=last)
    deep = connect("deep", {}, i=inner, c=last)
    loop = connect("loop", {}, plain=last, whole=deep, slow=every(inner, 2), single=every(last, 3))
    found = [(path, part.name) for path, part in report_page._composites(loop)]
    assert found == [("whole", "deep"), ("whole.i", "inner"), ("slow", "inner")]
    assert list(report_page._composites(last)) == []


def test_places_of_one_path_are_told_together():
    places = ["ctl in a", "ctl in b", "plant.x in b", "ctl in c"]
    assert report_page._places(places, "abc") == "ctl of every loop; plant.x of b"
    assert report_page._places(places, "abcd") == "ctl of a, b, c; plant.x of b"
    assert report_page._places(["ctl in a"], "a") == "ctl of a"


def test_parameters_of_loops_that_differ_are_told_by_loop():
    other = curve.with_params(q=3.0, row=(1.0, 4.0))
    results = SimpleNamespace(cases=[case_of("base", "wet", "dry", a=curve, b=other, c=curve)])
    head, *rows = cells(report_page._parameters(results).partition("<h3>")[0])
    assert head == ["Parameter", "Value", "Unit", "Meaning", "Source"]
    assert rows == [
        ["k", "0.3 (the rail sets it)", "", "height", "a book"],
        ["q", "2.5 in a, c; 3 in b (the rail sets it)", "N m", "torque", ""],
        ["two", "5 in a, c; 6 in b (= 2*q)", "N m", "twice", ""],
        ["row", "1 in a, c; 1 / 4 in b", "m", "places", ""],
    ]
    head, *rows = cells(report_page._parameters(results).partition("<h3>")[2])
    assert head == ["Condition", "k", "q"]
    assert rows == [["dry", "0.4", "2"], ["wet", "0.2", ""]]
    bare = SimpleNamespace(cases=[case_of("base", a=curve)])
    assert "Rail conditions" not in report_page._parameters(bare)


def test_a_loop_of_another_form_in_a_scenario_is_told_with_it():
    a, b = connect("x", {}, p=curve), connect("x", {}, p=curve, q=last)
    cases = [case_of("one", soft=a, hard=a), case_of("two", soft=connect("x", {}, p=curve), hard=b)]
    found = report_page.distinct_loops(SimpleNamespace(cases=cases))
    assert list(found) == ["soft", "hard", "hard in two"]
    assert found["soft"] is a
    assert found["hard in two"] is b
    assert report_page._alike(np.array([2.0, 2.0])) == 2.0
    assert report_page._alike(np.array([2.0, 3.0])) == [2.0, 3.0]
    assert report_page._meaning(curve) == "A curve."


def test_tables_of_experiments_have_so_many_rows(monkeypatch):
    """Forces in kN; what stands behind them is counted."""
    monkeypatch.setattr(report_page, "ROWS", 3)
    made = Table("Ways", {"name": ("", list("abcde")), "F": ("N", [1e3, 2e3, 3e3, 4e3, 5e3]),
                          "share": ("1", [0.5, 0.25, 0.125, 1.0, 2.0])}, "Each way.")  # fmt: skip
    short = Table("Few", {"x": ("m", [1.0, 2.0, 3.0])})
    experiment = SimpleNamespace(title="An <experiment>", doc="It is\n\nlong.")
    results = SimpleNamespace(tables={"one": {"t": made, "s": short}},
                              study=SimpleNamespace(experiments={"one": experiment}))  # fmt: skip
    said = report_page._experiments(results)
    assert "<h3>An &lt;experiment&gt;</h3><p>It is</p><p>long.</p>" in said
    assert "<b>Ways.</b> Each way." in said
    first, second = said.split("</table>")[:2]
    assert cells(first) == [["name", "F [kN]", "share"], ["a", "1", "0.5"], ["b", "2", "0.25"],
                            ["c", "3", "0.125"]]  # fmt: skip
    assert cells(second)[0] == ["x [m]"]
    assert said.count("2 more rows are in tables.json.") == said.count("more rows") == 1
    assert '<td>a</td><td class="n">1</td><td class="n">0.5</td>' in said


def test_a_metric_has_its_meaning_a_click_away_and_the_best_is_bold():
    told = report_page._told("distance [m]")
    assert "<summary>distance [m]</summary>" in told.text
    assert "distance of the run" in told.text
    assert report_page._told("other [m]") == "other [m]"
    assert report_page._number("1 / <2>", True).text == "<b>1 /<br>&lt;2&gt;</b>"
    assert report_page._number("1", False).text == "1"
    said = page_style.table(["a", "b"], [[report_page._number("1", True), "<x>"]], [1])
    assert '<th>a</th><th class="n">b</th>' in said
    assert '<td><b>1</b></td><td class="n">&lt;x&gt;</td>' in said


def test_a_claim_stands_in_a_file_with_all_that_it_says():
    claim = Claim("way", "section 5", "it stops", "number", "254.05", lambda results: 254.0, "m",
                  "last digit", "", "at most", "no wind", "base", "sta")  # fmt: skip
    row = claim_row(Verdict(claim, 254.0, FAILED, "too short"))
    assert row == {
        "id": "way", "source": "section 5", "claim": "it stops", "kind": "number",
        "paper": "254.05", "ours": 254.0, "unit": "m", "bound": "at most", "tolerance": 0.005,
        "tolerance_why": "half a unit of the last printed digit", "assumption": "no wind",
        "scenario": "base", "loop": "sta", "verdict": FAILED, "why": "too short",
    }  # fmt: skip
    free = Claim("q", "section 1", "so", "yes/no", True, lambda results: True, tolerance=3.0)
    assert (claim_row(Verdict(free, True, "", ""))["tolerance"], claim_row(
        Verdict(free, True, "", ""))["bound"]) == (None, None)  # fmt: skip


@pytest.fixture
def kept(tmp_path):
    pytest.importorskip("netCDF4")
    import xarray

    keep = Keep(tmp_path, "KEY")
    for scenario, loop, key in (("base", "a", "KEY"), ("base", "b", "OTHER"), ("dry", "c", "KEY")):
        folder = tmp_path / "logs" / scenario
        folder.mkdir(parents=True, exist_ok=True)
        data = xarray.Dataset({"v": ("time", [1.0, 2.0])}, coords={"time": [0.0, 0.1]})
        changes = {"rail_changes_s": [0.5, 1.5] if loop == "a" else 0.25}
        data = data.assign_attrs(key=Keep(tmp_path, key).of(scenario, loop), **changes)
        data.to_netcdf(folder / f"{loop}.nc", engine="netcdf4")
        (folder / f"{loop}.csv").write_text("x", encoding="utf-8")
    return keep


def test_logs_of_an_earlier_run_are_read_where_they_are_of_the_same(kept):
    assert kept.logs() == {"base": ["a"], "dry": ["c"]}
    assert kept.log("base", "a").attrs["rail_changes_s"] == [0.5, 1.5]
    assert kept.log("base", "a")["v"].values.tolist() == [1, 2]
    assert kept.log("dry", "c").attrs["rail_changes_s"] == [0.25]
    assert kept.log("base", "b") is None
    assert kept.log("base", "none") is None
    (kept.out / "logs" / "dry" / "c.csv").unlink()
    assert kept.log("dry", "c") is None
    (kept.out / "logs" / "base" / "a.nc").write_bytes(b"damaged")
    assert kept.log("base", "a") is None


def test_what_belongs_to_another_run_is_removed_and_nothing_of_somebody_else(kept):
    files = {"report.html": "x", "claims.json": "{}", "mine.txt": "x", "figures/a.svg": "x",
             "figures/mine.txt": "x", "logs/base/mine.txt": "x", "logs/wet/d.nc": "x",
             "logs/base/.slipctl.part": "x"}  # fmt: skip
    for name, text in files.items():
        (kept.out / name).parent.mkdir(exist_ok=True)
        (kept.out / name).write_text(text, encoding="utf-8")

    def there():
        return sorted(
            p.relative_to(kept.out).as_posix() for p in kept.out.rglob("*") if p.is_file()
        )

    before = there()
    kept.clear({"base": ["a"]})  # no run of ours: nothing but what is half written goes
    assert there() == [n for n in before if ".slipctl." not in n]
    (kept.out / "metrics.json").write_text('{"format": 1, "study": "toy"}', encoding="utf-8")
    kept.clear({"base": ["a"], "dry": ["other"]})
    assert there() == ["figures/mine.txt", "logs/base/a.csv", "logs/base/a.nc",
                       "logs/base/mine.txt", "metrics.json", "mine.txt"]  # fmt: skip
    assert not (kept.out / "logs" / "wet").exists()
