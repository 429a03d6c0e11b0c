"""Words of the glossary in a text: which one is first, and the anchor of its entry."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

EVERYDAY = {"flat", "lock", "reference", "condition", "claim", "jacobians", "also"}
"""Words that also stand in other senses."""


def slug(word: str) -> str:
    """Anchor of an entry."""
    return "term-" + re.sub(r"\W+", "-", word.lower()).strip("-")


@cache
def entries() -> dict[str, str]:
    """Anchor of each word of the glossary, the longest words first."""
    text = (Path(__file__).parent / "glossary.md").read_text(encoding="utf-8")
    found = {}
    for row in re.findall(r"^\| (?!word \|)([^|]+?) \|", text, re.M):
        words = [re.sub(r"\s*\(.*?\)", "", w).strip() for w in row.split(",")]
        found |= {w: slug(words[0]) for w in words if w and w.lower() not in EVERYDAY}
    return dict(sorted(found.items(), key=lambda pair: -len(pair[0])))


def linked(text: str, left: dict[str, str]) -> tuple[int, int, str] | None:
    """Where the first use of a term stands in a text, and its anchor."""
    best = None
    for word, anchor in left.items():
        found = re.search(rf"(?<![\w-]){re.escape(word)}s?(?![\w-])", text, re.I)
        if found and (best is None or found.start() < best[0]):
            best = (found.start(), found.end(), anchor)
    return best
