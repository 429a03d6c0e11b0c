"""Sphinx extension: the first use of a term on a page links to its entry in the glossary."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from glossary_words import entries, linked, slug

APART = {"glossary", "api", "commands", "index", "claims", "errata"}
"""Pages without such links: lists, and the glossary itself."""

CLOSED = (nodes.title, nodes.reference, nodes.literal, nodes.literal_block, nodes.math,
          nodes.math_block, nodes.raw, nodes.caption, nodes.table)  # fmt: skip
"""Where no link is put."""


def link(app: Any, doctree: nodes.document, docname: str) -> None:
    """Give the rows of the glossary anchors, and other pages their links."""
    if docname == "glossary":
        for row in doctree.findall(nodes.row):
            word = re.sub(r"\s*\(.*?\)", "", row[0].astext().split(",")[0]).strip()
            row["ids"].append(slug(word))
        return
    if docname in APART or docname.startswith("models/"):
        return
    left = dict(entries())
    base = app.builder.get_relative_uri(docname, "glossary")
    for node in [n for n in doctree.findall(nodes.Text) if not _closed(n)]:
        pieces, text = [], str(node)
        while left and (hit := linked(text, left)):
            start, stop, anchor = hit
            there = nodes.reference("", text[start:stop], internal=True, classes=["term"],
                                    refuri=f"{base}#{anchor}")  # fmt: skip
            pieces += [nodes.Text(text[:start]), there]
            text = text[stop:]
            left = {w: a for w, a in left.items() if a != anchor}
        if pieces:
            node.parent.replace(node, [*pieces, nodes.Text(text)])


def _closed(node: nodes.Node) -> bool:
    parent = node.parent
    while parent is not None:
        if isinstance(parent, CLOSED):
            return True
        parent = parent.parent
    return False


def setup(app: Any) -> dict[str, bool]:
    """Register the extension."""
    app.connect("doctree-resolved", link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
