"""docs/equations.toml has every numbered item of each paper, and each of its targets exists."""

import importlib
import re
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from slipctl.study.resolve import load_study

DOCS = Path(__file__).parents[2] / "docs"
ROWS = tomllib.loads((DOCS / "equations.toml").read_text(encoding="utf-8"))["row"]
KEYS = {"paper", "item", "where", "figure", "claim", "none", "errata", "note"}

ITEMS = {
    "000": [
        *(f"eq {k}" for k in range(1, 49)),
        *(f"table {k}" for k in range(1, 5)),
        *(f"figure {k}" for k in range(1, 12)),
        "algorithm 1",
    ],
    "001": [
        *(f"eq {k}" for k in range(1, 43)),
        *(f"table {k}" for k in range(1, 5)),
        *(f"figure {k}" for k in range(1, 10)),
        "lemma 1",
        "lemma 2",
        "theorem 1",
    ],
    "003": [
        *(f"eq {k}" for k in range(1, 55)),
        *(f"table {k}" for k in range(1, 6)),
        *(f"figure {k}" for k in range(1, 11)),
        "theorem 1",
        "theorem 2",
    ],
    "004": [
        *(f"eq {k}" for k in range(1, 49)),
        *(f"table {k}" for k in range(1, 4)),
        *(f"figure {k}" for k in range(1, 13)),
    ],
}
"""Numbered items that each paper prints."""


def listed(row: dict, key: str) -> list[str]:
    value = row.get(key, [])
    return [value] if isinstance(value, str) else value


def ids(row: dict) -> str:
    return f"{row['paper']} {row['item']}"


def test_no_number_is_missing_or_told_twice():
    found = Counter((row["paper"], row["item"]) for row in ROWS)
    assert [k for k, n in found.items() if n > 1] == []
    assert {k for k, _ in found} == set(ITEMS)
    for paper, items in ITEMS.items():
        assert {item for p, item in found if p == paper} == set(items)


@pytest.mark.parametrize("row", ROWS, ids=ids)
def test_target_exists(row):
    assert set(row) <= KEYS, "unknown key"
    targets = [t for key in ("where", "figure", "claim") for t in listed(row, key)]
    assert bool(targets) != bool(row.get("none")), "say where it is, or why it is not"
    for target in listed(row, "where"):
        module, _, name = target.partition(":")
        assert hasattr(importlib.import_module(module), name), target
    for target in listed(row, "figure"):
        study, _, stem = target.partition("/")
        assert stem in load_study(study).figures, target
    for target in listed(row, "claim"):
        study, _, claim = target.partition("/")
        assert claim in [c.id for c in load_study(study).claims], target


def test_every_errata_row_is_there():
    text = (DOCS / "errata.md").read_text(encoding="utf-8")
    known = set(re.findall(r"^### (\d{3}\.\d+) ", text, flags=re.M))
    for row in ROWS:
        assert set(listed(row, "errata")) <= known, ids(row)
        for number in listed(row, "errata"):
            assert number.startswith(row["paper"]), ids(row)


def test_every_claim_and_figure_of_the_paper_is_named():
    """What a study answers and draws of a paper belongs to a numbered item, or to its text."""
    named = {t for row in ROWS for key in ("figure", "claim") for t in listed(row, key)}
    for name in {t.partition("/")[0] for t in named}:
        study = load_study(name)
        drawn = {f"{name}/{stem}" for stem, f in study.figures.items() if f.source}
        assert drawn <= named
        printed = {f"{name}/{c.id}" for c in study.claims if re.search(r"Fig|Table|\(\d", c.source)}
        assert printed <= named
