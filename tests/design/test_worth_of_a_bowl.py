"""What is told of tuned numbers, on metrics with a known best: draws, slices, tables, files."""

from __future__ import annotations

import math
import re
import tomllib
from typing import Any

import numpy as np
import pytest
from test_search_of_a_bowl import FAR, FREES, LEVEL, searched

from slipctl.design import gain_files, page
from slipctl.design.fronts import FrontSearch
from slipctl.design.goals import Limit, Objective
from slipctl.design.judgement import judge, runs_of_slices, slices
from slipctl.design.tune import Tuned

DRAWS = 12


def tuned(kind: Any = None, promises: Any = None, **more: Any) -> Tuned:
    search, _ = searched(**({"kind": kind} if kind else {}), **more)
    found = search.run()
    search.promises.gains, search.promises.wanted = [], []
    return Tuned(
        search.loop, "toy:loop@base", tuple(FREES), found.numbers, search,
        judge(search, DRAWS), tuple(slices(search)), {},
    )  # fmt: skip


@pytest.fixture(scope="module")
def one() -> Tuned:
    return tuned(limits=[Limit("level <= 20 N m", "level", True, 20.0, "N m")])


@pytest.fixture(scope="module")
def two() -> Tuned:
    return tuned(FrontSearch, others=[LEVEL], runs=2500)


def test_both_are_judged_on_the_same_draws_that_the_search_has_not_seen(one):
    """A draw lifts both alike, so that the difference is the same in each: its error is 0."""
    judged, metrics = one.judged, one.search.rolls.metrics
    hand = {f.name: f.now for f in FREES}
    for score, numbers in ((judged.tuned, one.gains), (judged.by_hand, hand)):
        assert score.values == [metrics(numbers, 20 + k)["far"].value for k in range(DRAWS)]
    wanted = metrics(one.gains, 0)["far"].value - metrics(hand, 0)["far"].value
    assert judged.difference == pytest.approx(wanted, rel=1e-12)
    assert judged.error == pytest.approx(0.0, abs=1e-12)
    assert judged.kept(one.search.limits) == [(one.search.limits[0], DRAWS, 0)]  # 29 by hand
    (line,) = page.differences(one)
    assert "of 12 held-out draws:" in line
    assert f"difference {wanted:+.4g} +- {judged.error:.2g} m" in line
    numbers = [float(x) for x in re.findall(r"([\d.]+) m (?:tuned|by hand)", line)]
    assert numbers == pytest.approx([np.mean(s.values) for s in (judged.tuned, judged.by_hand)])


def test_a_slice_is_the_bowl_along_one_number(one):
    """Mean of the draws plus the square of the way; within 1 % of it is a known way, too."""
    lifts = [one.search.rolls.metrics(one.gains, k)["far"].value for k in range(10)]
    assert [s.free for s in one.slices] == FREES
    for s, scale in zip(one.slices, (1.0, 10.0), strict=True):
        here = one.gains[s.free.name]
        assert s.at == pytest.approx(np.mean(lifts), rel=1e-12)
        assert list(s.values) == pytest.approx(np.linspace(s.free.lo, s.free.hi, 9))
        bottom = {"ctl.a": 1.6, "ctl.b": 14.0}[s.free.name]

        def mean(x: float, s=s, here=here, bottom=bottom, scale=scale) -> float:
            return s.at + ((x - bottom) / scale) ** 2 - ((here - bottom) / scale) ** 2

        for x, m in zip(s.values, s.means, strict=True):
            assert math.isnan(m) == (s.free.name == "ctl.b" and x > 20), x  # beyond the limit
            assert math.isnan(m) or m == pytest.approx(mean(x), rel=1e-9)
        slope = (mean(1.1 * here) - mean(0.9 * here)) / 0.2 / s.at
        assert s.answer == pytest.approx(slope, rel=1e-6, abs=1e-9)
        assert s.lo < here < s.hi
        known = sorted([(x, m) for x, m in zip(s.values, s.means, strict=True) if m == m]
                       + [(here, s.at)])  # fmt: skip
        for end in (s.lo, s.hi):  # where the line between the points rises above 1 %
            height = np.interp(end, *zip(*known, strict=True))
            assert height == pytest.approx(1.01 * s.at, rel=1e-9)


def test_a_slice_costs_no_more_runs_than_is_told_before(one):
    search, _ = searched()
    search.run()
    before = search.rolls.done
    slices(search)
    assert 0 < search.rolls.done - before <= runs_of_slices(search) == 2 * 11 * 10


def test_numbers_set_by_hand_that_are_the_best_are_kept_and_said_so():
    from dataclasses import replace

    best = [replace(FREES[0], now=1.6), replace(FREES[1], now=14.0)]
    found = tuned(frees=best)
    assert found.search.best is found.search.by_hand
    assert (found.judged.difference, found.judged.error) == (0.0, 0.0)
    assert page.differences(found) == [
        "no candidate was better than the gains set by hand, so they are kept"
    ]


def test_draws_that_are_never_reached_are_told_of_both():
    """By hand a = 2.9 breaks in each draw; 1.6 breaks in none."""
    found = tuned(broken=2.0)
    lines = page.differences(found)
    assert lines == ["far is never reached in 0 of 12 held-out draws tuned, in 12 by hand"]
    assert ["draws that never reach far", "12", "0"] in page.judged_rows(found)
    assert gain_files.found_of(found, "")["judged"]["never"] == {"tuned": 0, "by_hand": 12}


def test_the_tables_have_a_row_of_each_number_limit_and_objective(one):
    head, *rows = page.gains_rows(one)
    assert head == ["number", "unit", "range", "by hand", "tuned", "within 1 %", "slope [%/%]"]
    for f, s, row in zip(FREES, one.slices, rows, strict=True):
        assert row[:2] == [f.name, f.unit]
        assert row[3] == f"{f.now:g}"
        assert float(row[4]) == pytest.approx(one.gains[f.name], rel=1e-5)
        ends = [float(x) for x in row[5].split(" .. ")]
        assert ends == [pytest.approx(x, rel=1e-2) for x in (s.lo, s.hi)]
        assert float(row[6]) == pytest.approx(s.answer, rel=0.1, abs=1e-3)
    held = page.judged_rows(one)
    assert held[0] == ["held-out draws", "by hand", "tuned"]
    assert ["draws with level <= 20 N m", "0 of 12", "12 of 12"] in held
    spread = {row[0].partition(" ")[0]: [float(x) for x in row[1:]] for row in held[1:-1]}
    for k, score in enumerate((one.judged.by_hand, one.judged.tuned)):
        assert spread["mean"][k] == pytest.approx(np.mean(score.values), rel=1e-5)
    said = page.text(one)
    assert "toy:loop@base, minimise far, subject to level <= 20 N m" in said
    assert f"{one.search.thought} candidates, 0 refused" in said
    assert f"{one.search.spent} runs on 16 draws" in said


def test_the_file_of_gains_holds_them_to_the_last_bit_with_what_they_are_worth(one):
    text = gain_files.gains_text(one, "slipctl tune ...")
    content = tomllib.loads(text)
    assert content["loop"] == "toy:loop@base"
    assert text.startswith("# slipctl tune ...\n")
    for f in FREES:
        told = content["gains"][f.name].split(" ", 1)
        assert float(told[0]) == one.gains[f.name]
        assert told[1:] == ([] if f.unit == "1" else [f.unit])
    assert text.count("# far stays within 1 % from ") == 2
    assert text.count("1 % more of it changes that by ") == 2
    assert "knee" not in text
    assert "stopped" not in text


def test_what_a_command_prints_of_it_is_what_was_found(one):
    said = gain_files.found_of(one, "c")
    assert {n: g["value"] for n, g in said["gains"].items()} == one.gains
    assert {n: g["unit"] for n, g in said["gains"].items()} == {f.name: f.unit for f in FREES}
    assert (said["candidates"], said["runs"], said["samples"], said["refused"]) == (
        one.search.thought, one.search.spent, 16, 0)  # fmt: skip
    judged = one.judged
    assert said["judged"]["difference"] == judged.difference
    assert said["judged"]["tuned"] == pytest.approx(np.mean(judged.tuned.values))
    assert said["judged"]["by_hand"] == pytest.approx(np.mean(judged.by_hand.values))
    assert [(w["number"], w["lo"], w["hi"]) for w in said["worth"]] == [
        (s.free.name, s.lo, s.hi) for s in one.slices
    ]
    assert "front" not in said
    assert "judged_each" not in said


def test_the_front_is_told_with_its_knee_in_files_and_tables(two):
    said = gain_files.found_of(two, "c")
    front = gain_files.front_of(two, "c")
    assert said["front"] == front["front"]
    assert front["minimise"] == ["far", "level"]
    assert front["knee"] in front["front"]
    assert front["knee"]["gains"] == two.gains
    assert front["by_hand"]["gains"] == {f.name: f.now for f in FREES}
    for point, c in zip(front["front"], two.front, strict=True):
        assert point["means"] == {"far": c.score.mean(), "level": c.more[0].mean()}
    assert set(said["judged_each"]) == {"far", "level"}
    assert said["judged_each"]["level"]["difference"] == pytest.approx(two.gains["ctl.b"] - 29.0)
    for most in (3, 100):
        head, *rows = page.front_rows(two, most)
        assert head == ["front", "a", "b", "far", "level"]
        assert sum("knee" in row[0] for row in rows) == 1
        levels = [float(row[4]) for row in rows]
        assert levels == sorted(levels, reverse=True)
        assert len(rows) == len(two.front) if most == 100 else 3 <= len(rows) <= 4
    assert "# The knee of the front" in gain_files.gains_text(two, "")
    lines = page.differences(two)
    assert [line.split()[1] for line in lines] == ["far", "level"]
    assert "N m (standard error)" in lines[1]


def test_a_sum_has_no_unit_and_one_metric_its_own(one):
    metrics = one.search.rolls.metrics(one.gains, 0)
    assert FAR.unit(metrics) == "m"
    assert Objective("", ((-1.0, "level"),)).unit(metrics) == "N m"
    assert Objective("", ((2.0, "level"),)).unit(metrics) == "1"
    assert Objective("", ((1.0, "far"), (0.5, "level"))).unit(metrics) == "1"
