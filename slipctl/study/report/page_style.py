"""How the pages of results look: their style, tables and pictures, and what is around them."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from slipctl import __version__
from slipctl.block.block import Block
from slipctl.block.text.failures import FAILURE_HEAD, failures_of
from slipctl.draw import live

STYLE = """
:root { --ink: #1c1c1c; --soft: #5b6168; --line: #d9dde1; --fill: #f5f6f8; --blue: #0072B2;
  --page: #fff; --warn: #fff3e6; --bad: #fdeceb; --yes: #00694d; --no: #b3261e; --rail: 1; }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e6e8ea; --soft: #a3abb3; --line: #3b4249; --fill: #22272c; --blue: #6db7f2;
    --page: #15181b; --warn: #38291a; --bad: #3b1f1d; --yes: #4fc79f; --no: #f28b82; --rail: .09;
    color-scheme: dark; }
  img { background: #fff; border-radius: 4px; } }
* { box-sizing: border-box; }
body { color: var(--ink); background: var(--page); margin: 0 auto; padding: 2rem 1.5rem 4rem;
  max-width: 68rem; font: 15px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .6rem;
  border-top: 2px solid var(--ink); }
h3 { font-size: 1.02rem; margin: 1.6rem 0 .4rem; }
p { max-width: 48rem; margin: .4rem 0; }
a { color: var(--blue); }
.soft { color: var(--soft); }
.quick { background: var(--warn); border-left: 4px solid #D55E00; padding: .4rem .8rem; }
.failed { background: var(--bad); border-left: 4px solid var(--no); padding: .4rem .8rem; }
nav ul { columns: 2; padding-left: 1.1rem; margin: .4rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: .5rem 0 1rem; font-size: .88rem; }
th, td { padding: .25rem .6rem; border-bottom: 1px solid var(--line); vertical-align: top;
  text-align: left; }
thead th { border-bottom: 2px solid var(--ink); vertical-align: bottom; max-width: 11rem; }
td.n, th.n { text-align: right; } td.n { font-variant-numeric: tabular-nums;
  white-space: nowrap; }
tbody th { font-weight: normal; white-space: nowrap; }
.verdict { white-space: nowrap; font-weight: 600; }
.yes { color: var(--yes); } .no { color: var(--no); } .open { color: var(--soft); }
figure { margin: 1.2rem 0; break-inside: avoid; }
figure img { width: 100%; max-width: 52rem; height: auto; }
figcaption { color: var(--soft); font-size: .9rem; max-width: 48rem; }
.equations td { border: 0; padding: .18rem .3rem; vertical-align: baseline; }
.equations td:first-child { text-align: right; }
.diagram { overflow-x: auto; } .diagram img { max-width: none; }
math { font-size: 1.05rem; }
pre { background: var(--fill); padding: .7rem .9rem; overflow-x: auto; font-size: .82rem;
  white-space: pre-wrap; }
details { margin: .4rem 0; } summary { cursor: pointer; }
td details { margin: 0; } td summary { list-style: none; white-space: nowrap; }
td summary::after { content: " ?"; color: var(--soft); font-size: .8em; }
td details p { max-width: 22rem; margin: .1rem 0 .3rem; }
@media print { td summary::after { content: none; }
  body { max-width: none; padding: 0; font-size: 10pt; } nav { break-after: page; }
  tr, figure { break-inside: avoid; } a { color: inherit; text-decoration: none; }
  .wide { overflow: visible; } .diagram img { max-width: 100%; height: auto; } }
"""


def html_page(title: str, said: str, body: str, style: str = STYLE, head: str = "") -> str:
    """A whole page.

    Args:
        title: plain text. said: line below it, as HTML. body: the rest, as HTML.
        style: CSS. head: further lines of the head, each with its end.
    """
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="slipctl {__version__}">
{head}<title>{escape(title)}</title>
<style>{style}</style>
</head>
<body>
<h1>{escape(title)}</h1>
<p class="soft">{said}</p>
{body}
</body>
</html>
"""


class Html:
    """Text that is markup already."""

    def __init__(self, text: str) -> None:
        self.text = text


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], numbers: Sequence[int] = ()) -> str:
    """Write a table; columns in ``numbers`` are aligned to the right, cells may be ``Html``."""

    def cell(tag: str, k: int, value: Any) -> str:
        mark = ' class="n"' if k in numbers else ""
        text = value.text if isinstance(value, Html) else escape(str(value))
        return f"<{tag}{mark}>{text}</{tag}>"

    top = "".join(cell("th", k, h) for k, h in enumerate(head))
    body = "".join(
        "<tr>" + "".join(cell("td", k, v) for k, v in enumerate(row)) + "</tr>" for row in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def image(svg: str, alt: str) -> str:
    """SVG as an image inside the page."""
    data = base64.b64encode(svg.encode()).decode()
    return f'<img alt="{escape(alt)}" src="data:image/svg+xml;base64,{data}">'


def figure(
    svg: str, alt: str, said: str, curves: live.Live | None, points: int = live.POINTS,
    key: str = "",
) -> str:  # fmt: skip
    """Picture with its caption, and the curves that a page with ``live.script()`` zooms into.

    Args:
        svg: the picture.
        alt: what it shows, for who cannot see it.
        said: caption, as markup.
        curves: what zooms; None where nothing does.
        points: that each curve keeps.
        key: name of the place in the page.
    """
    data = ""
    if curves:
        data = f'<script type="application/json">{live.text(curves, points)}</script>'
        said += "".join(f"<br>{escape(line)}." for line in curves.hidden)
    named = f' id="{escape(key)}"' if key else ""
    caption = f"<figcaption>{said}</figcaption>"
    return f"<figure{named}>{image(svg, alt)}{data}{caption}</figure>"


def code_html(text: str) -> str:
    """Text as markup, whose names in backquotes are code."""
    return re.sub(r"`(.+?)`", r"<code>\1</code>", escape(text, quote=False))


def failure_tables(loops: Mapping[str, Block]) -> str:
    """What each loop, by name, does when something fails, as its parts declare it; folded."""
    by_rows: dict[tuple[tuple[str, ...], ...], list[str]] = {}
    for name, loop in loops.items():
        if rows := failures_of(loop):
            by_rows.setdefault(tuple(rows), []).append(name)
    out = []
    for told, names in by_rows.items():
        head = f"What {', '.join(names)} {'do' if names[1:] else 'does'} when something fails"
        cells = [[Html(code_html(text)) for text in row] for row in told]
        out.append(f"<details><summary>{escape(head)}</summary>{table(FAILURE_HEAD, cells)}")
        out.append("</details>")
    return "".join(out)
