"""What a block does when something around it fails, as its parts declare it.

A part says it with ``@step(..., failures=[...])``: rows of texts in which ``{name}`` stands for a
parameter, the largest of several, and ``{1/name}`` for the time of a rate. So a table of degraded
modes has the numbers of the block that it is about.
"""

from __future__ import annotations

import re

import numpy as np

from slipctl.block.block import Block

FAILURE_HEAD = ("failure", "how it is seen", "what is done", "what is left", "within")


def failures_of(block: Block) -> list[tuple[str, ...]]:
    """Rows of the table of degraded modes of a block: texts as in ``FAILURE_HEAD``.

    Args:
        block: a block; its own rows and those of its parts, each once.
    """
    rows: dict[tuple[str, ...], None] = {}
    for leaf in _parts(block):
        for row in leaf.law_data.failures:
            rows[tuple(_filled(text, leaf) for text in row)] = None
    return list(rows)


def _parts(block: Block) -> list[Block]:
    found = [block]
    for part in block.parts.values():
        found += _parts(part)
    return found


def _filled(text: str, block: Block) -> str:
    values = block.param_values()

    def number(match: re.Match[str]) -> str:
        unit, value = block.params[match[2]].unit, float(np.max(values[match[2]]))
        if match[1]:
            unit, value = unit.removeprefix("1/"), 1 / value
        return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")

    return re.sub(r"\{(1/)?(\w+)\}", number, text)
