"""The site has every page, each once; its build is a step of ``.ci/run``."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_every_page_stands_once_in_the_index():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```$", index, re.M | re.S)
    named = [n for t in trees for n in t.splitlines() if n and not n.startswith(":")]
    assert sorted(named) == sorted(p.stem for p in DOCS.glob("*.md") if p.stem != "index")


def test_parts_stand_in_the_order_in_which_people_want_them():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    captions = re.findall(r"^:caption: (.*)$", index, re.M)
    assert captions == ["Start", "How to", "Models", "Studies", "Reference", "Errata"]
