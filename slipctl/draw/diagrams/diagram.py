"""Block diagrams: one level of a connected block as Graphviz text, or drawn as SVG."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from slipctl.draw.diagrams.diagram_svg import FONT, Drawing
from slipctl.draw.diagrams.levels import Level, level

if TYPE_CHECKING:
    from slipctl.block.block import Block

# ---- Graphviz ---------------------------------------------------------------------------------


def graph(block: Block) -> str:
    """Write the block diagram as Graphviz text, for ``dot -Tsvg``."""
    lv = level(block)
    out = [f"digraph {_quoted(lv.title)} {{", "  rankdir=LR;", "  node [shape=box];"]
    for key, node in lv.nodes.items():
        label = node.title + (f"\n{node.note}" if node.note else "")
        style = "" if node.box else ", shape=plaintext"
        out.append(f"  {_quoted(key)} [label={_quoted(label)}{style}];")
    for (start, port), ends in lv.nets.items():
        label = lv.label((start, port))
        for end, _ in ends:
            out.append(f"  {_quoted(start)} -> {_quoted(end)} [label={_quoted(label)}];")
    return "\n".join([*out, "}"]) + "\n"


def _quoted(text: str) -> str:
    clean = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{clean}"'


# ---- SVG ---------------------------------------------------------------------------------------


def svg(block: Block) -> str:
    """Draw the block diagram as SVG; a block without parts is a box with its signals."""
    return levels_svg([level(block)])


def boxes_of_svg(block: Block) -> dict[str, tuple[float, float, float, float]]:
    """Where the boxes of :func:`svg` are: left, top, width and height in its units, by name."""
    return Drawing(level(block)).boxes()


def levels_svg(levels: Sequence[Level]) -> str:
    """Draw levels of blocks below each other as SVG."""
    drawings = [Drawing(lv) for lv in levels]
    width = max(d.width for d in drawings)
    out, y = [], 0.0
    for d in drawings:
        out.append(d.body(0.0, y))
        y += d.height + 10
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {y:g}"'
        f' width="{width:g}" height="{y:g}" font-family="{FONT}">\n'
        f'<rect width="{width:g}" height="{y:g}" fill="white"/>\n' + "\n".join(out) + "\n</svg>\n"
    )
