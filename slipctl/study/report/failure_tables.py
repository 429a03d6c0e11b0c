"""What loops do when something around them fails: folded tables of a page."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import Any

from slipctl.block.block import Block
from slipctl.block.text.failures import FAILURE_HEAD, failures_of

Table = Callable[[Sequence[str], Iterable[Sequence[Any]]], str]


class Html:
    """Text that is markup already."""

    def __init__(self, text: str) -> None:
        self.text = text


def failure_tables(loops: Mapping[str, Block], table: Table) -> str:
    """What each loop does when something fails, as its parts declare it; folded.

    Args:
        loops: by name. table: writes a table from its head and rows.
    """
    by_rows: dict[tuple[tuple[str, ...], ...], list[str]] = {}
    for name, loop in loops.items():
        if rows := failures_of(loop):
            by_rows.setdefault(tuple(rows), []).append(name)
    out = []
    for told, names in by_rows.items():
        head = f"What {', '.join(names)} {'do' if names[1:] else 'does'} when something fails"
        cells = [[_coded(text) for text in row] for row in told]
        out.append(f"<details><summary>{escape(head)}</summary>{table(FAILURE_HEAD, cells)}")
        out.append("</details>")
    return "".join(out)


def _coded(text: str) -> Html:
    """Text whose names in backquotes are code."""
    return Html(re.sub(r"`(.+?)`", r"<code>\1</code>", escape(text, quote=False)))
