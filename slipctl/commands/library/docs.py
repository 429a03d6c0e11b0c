"""``slipctl docs``: the built pages in a browser."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from slipctl.errors import BadInput, nearest

PACKAGE = Path(__file__).resolve().parents[2]
PLACES = (PACKAGE.parent / "out" / "docs", PACKAGE / "pages")
"""Where the pages are: built in a clone, and shipped in a wheel."""

BUILD = "pip install '.[docs]' && sphinx-build -q -W docs out/docs"


def answer(options: argparse.Namespace, command: str) -> int:
    """Open the first page, or print where it is."""
    page = page_file(options.page)
    print(json.dumps({"file": str(page)}) if options.json else page)
    if not (options.where or options.json):
        import webbrowser

        webbrowser.open(page.as_uri())
    return 0


def page_file(name: str) -> Path:
    """File of a page by its name."""
    folder = next((p for p in PLACES if (p / "index.html").is_file()), None)
    if folder is None:
        raise BadInput(f"the pages are not built; in a clone of slipctl write: {BUILD}")
    pages = sorted(p.stem for p in folder.glob("*.html"))
    if name not in pages:
        raise BadInput(f"there is no page {name!r}{nearest(name, pages)}")
    return folder / f"{name}.html"
