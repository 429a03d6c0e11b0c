"""The site has every page, each once; its build is a step of ``.ci/run``."""

from __future__ import annotations

import re
from pathlib import Path

from slipctl.study import doors

DOCS = Path(__file__).parents[2] / "docs"


def test_every_page_stands_once_in_the_index():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```$", index, re.M | re.S)
    named = [n for t in trees for n in t.splitlines() if n and not n.startswith(":")]
    there = [p.relative_to(DOCS).with_suffix("").as_posix() for p in DOCS.rglob("*.md")]
    assert sorted(named) == sorted(n for n in there if n != "index")


def test_every_file_of_models_with_blocks_has_its_page():
    """Each page writes all blocks of its file; what only others are made of has none."""
    inner = {"ranges"}
    files = {name for name, (_, blocks) in doors.models().items() if blocks} - inner
    pages = {p.stem: p.read_text(encoding="utf-8") for p in (DOCS / "models").glob("*.md")}
    assert set(pages) == files
    assert all(f"```{{models}} {name}\n" in text for name, text in pages.items())


def test_parts_stand_in_the_order_in_which_people_want_them():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    captions = re.findall(r"^:caption: (.*)$", index, re.M)
    assert captions == ["Start", "How to", "Models", "Studies", "Theory", "Reference", "Errata"]
