"""The site has every page, each once; its build is a step of ``.ci/run``."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from scripts import script

from slipctl.study import resolve

pytestmark = pytest.mark.second

DOCS = Path(__file__).parents[2] / "docs"


def test_every_page_stands_once_in_the_index():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```$", index, re.M | re.S)
    named = [n for t in trees for n in t.splitlines() if n and not n.startswith(":")]
    there = [p.relative_to(DOCS).with_suffix("").as_posix() for p in DOCS.rglob("*.md")]
    assert sorted(named) == sorted(n for n in there if n != "index")


def test_every_file_of_models_with_blocks_has_its_page():
    """Each page writes all blocks of its file; what only others are made of has none."""
    inner = {"ranges", "hst_traction_peaks"}
    files = {name for name, (_, blocks) in resolve.models().items() if blocks} - inner
    pages = {p.stem: p.read_text(encoding="utf-8") for p in (DOCS / "models").glob("*.md")}
    assert set(pages) == files
    assert all(f"```{{models}} {name}\n" in text for name, text in pages.items())


def test_parts_stand_in_the_order_in_which_people_want_them():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    captions = re.findall(r"^:caption: (.*)$", index, re.M)
    assert captions == ["Start", "How to", "Models", "Studies", "Theory", "Reference", "Errata"]


HOW_TO = {
    "own_vehicle", "own_law", "laws", "own_controller", "replay", "sweeps", "tune", "certify",
    "c_interface", "fmu", "notebook", "python_control", "own_figures",
}  # fmt: skip
"""What a new user wants to do, a page each."""


def test_each_how_to_is_at_most_two_clicks_from_the_first_page():
    """By links in the text alone; the side of each page lists all pages too."""
    reached, seen = {"index"}, set()
    for _ in range(2):
        for page in reached - seen:
            text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
            reached = reached | set(re.findall(r"\]\(([\w/]+)\.md[#)]", text))
            seen.add(page)
    assert reached >= HOW_TO


def test_pages_of_several_versions_stand_side_by_side(tmp_path):
    """The newest first, by number and not by letter; the first page leads to it."""
    made = script("make_site")
    for version in ("0.9.0", "0.10.0", "0.1.2"):
        (tmp_path / version).mkdir()
        (tmp_path / version / "index.html").write_text("a page", encoding="utf-8")
    made.listed(tmp_path)
    assert (tmp_path / "versions.js").read_text(encoding="utf-8") == (
        'window.versions = ["0.10.0", "0.9.0", "0.1.2"];\n'
    )
    first = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert 'url=0.10.0/index.html"' in first
    assert first.count("<li>") == 3


def test_words_of_the_glossary_are_found_once_and_whole():
    """The longest word that begins first; no part of another word."""
    words = script("glossary_words")
    left = words.entries()
    assert words.linked("a stopping distance, and a slip ratio", left) == (
        2, 19, "term-stopping-distance"
    )  # fmt: skip
    assert words.linked("tickets and blocked loops", left)[2] == "term-loop"
    assert words.linked("nothing of it here", left) is None


def test_a_first_use_without_a_link_to_the_glossary_is_seen():
    """In prose alone: a heading, code, a table or another page's name may have the word before."""
    check = script("check_site")
    link = '<a class="term reference internal" href="glossary.html#term-funnel">funnel</a>'
    page = "<aside>funnel</aside><article><h1>A funnel</h1><p>The {} and the funnel.</p></article>"
    assert check.unlinked(check.Page(page.format(link))) == []
    assert check.unlinked(check.Page(page.format("<code>funnel</code>"))) == ["funnel"]
    late = f"<article><p>A funnel.</p><p>The {link}.</p></article>"
    assert check.unlinked(check.Page(late)) == ["funnel"]
