"""docs/measure_house.py: its rules, and the rows of the house that are reached stay reached."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from scripts import script

ROOT = Path(__file__).parents[2]
house = script("measure_house")

REACHED = {
    "most files side by side", "longest function, lines",
    "public functions whose names say nothing", "modules whose names say nothing",
    "files in the largest circle", "parameters of export", "parameters of Block",
    "parameters of nmpc", "files to touch: a controller", "files to touch: a metric",
    "files to touch: a command", "files to touch: a kind of plant",
}  # fmt: skip
"""What is reached joins here, and stays."""


@pytest.fixture(scope="module")
def rows():
    return {r.what: r for r in house.static()}


@pytest.mark.second
def test_what_was_reached_stays_reached(rows):
    assert rows.keys() >= REACHED
    assert [rows[what] for what in sorted(REACHED) if not rows[what].reached] == []


@pytest.mark.long
def test_a_run_of_a_file_is_counted():
    found = {r.what: r.now for r in house.running()}
    assert found["own calls of `run metro.toml --set m=40t`"] > 1e4
    assert found["resolutions of its name"] >= 1


def test_a_circle_is_of_those_that_come_back_to_themselves():
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}
    assert max(house.circles(graph), key=len) == {"b", "c"}


def test_the_walk_leads_from_the_command_to_the_slip():
    """Ten steps of CONTRIBUTING: each names a function that stands there, the ninth the line."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    steps = re.findall(r"^(\d+)\. `([\w/]+\.py)`, `(\w+)`:(.*)$", text, re.M)
    assert [int(number) for number, *_ in steps] == list(range(1, 11))
    for _, file, name, says in steps:
        source = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^(def|class) {name}\b", source, re.M), (file, name)
        for line in re.findall(r"\*\*`(.+?)`\*\*", says):
            assert line in source, (file, line)
    assert "plant.wheel.v_s" in (ROOT / "studies/subway_braking/study.py").read_text("utf-8")


def test_the_drawing_of_the_main_path_names_what_is_there():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    drawing = page.partition("## The main path")[2].partition("\n## ")[0]
    named = re.findall(r"(slipctl/[\w/]+\.py) +(\w+)", drawing)
    ends = drawing.splitlines()
    line = next(k for k, text in enumerate(ends) if text.count(".py") == 3)
    named += [
        (f"slipctl/{f}", n) for f, n in zip(ends[line].split(), ends[line + 1].split(), strict=True)
    ]
    assert len(named) == 11
    for file, name in named:
        source = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^(def|class) {name}\b", source, re.M), (file, name)
