"""The page as one text that stands in a cell: its modules as one script, its styles inside."""

from __future__ import annotations

import re
from importlib.resources import files

MODULE = re.compile(r'^import \{([^}]*)\} from "\./(\w+)\.js";\n', re.M)
EXPORT = re.compile(r"^export (?:async )?(?:function|class|const) (\w+)", re.M)


def page_text() -> str:
    """HTML of the page that asks the notebook it stands in, and no server."""
    text = _file("index.html")
    text = re.sub(r'<link rel="icon"[^>]*>\n', "", text)
    text = re.sub(
        r'<link rel="stylesheet" href="/page/([\w.]+)">',
        lambda m: f"<style>{_file(m[1])}</style>", text,
    )  # fmt: skip
    text = re.sub(r"<script[^>]*></script>\n", "", text)
    scripts = [_file("uPlot.iife.min.js"), _file("codemirror.iife.min.js"), joined_modules("main")]
    inside = "".join(f"<script>{s.replace('</script', '<' + chr(92) + '/script')}</script>\n"
                     for s in scripts)  # fmt: skip
    text = text.replace('<html lang="en">', '<html lang="en" data-notebook="yes">')
    return text.replace("</body>", f"{inside}</body>")


def joined_modules(first: str) -> str:
    """A module and all that it imports as one script; each keeps its names to itself.

    Args:
        first: name of the module, without its ending.
    """
    done: dict[str, str] = {}
    _take(first, done)
    return "\n".join(["'use strict';", *done.values()])


def _take(name: str, done: dict[str, str]) -> None:
    if name in done:
        return
    text = _file(f"{name}.js")
    for _, other in MODULE.findall(text):
        _take(other, done)
    body = MODULE.sub(lambda m: f"const {{{m[1]}}} = module_{m[2]};\n", text)
    names = ", ".join(EXPORT.findall(text))
    body = re.sub(r"^export ", "", body, flags=re.M)
    done[name] = f"const module_{name} = (() => {{\n{body}\nreturn {{ {names} }};\n}})();"


def _file(name: str) -> str:
    return (files("slipctl.workbench.web") / "page" / name).read_text(encoding="utf-8")
