"""A notebook of each how-to page: ``python docs/tools/make_notebooks.py FOLDER [--run]``.

Text becomes text, ``python`` and ``console`` blocks become cells, and a block that begins with the
name of a file writes that file. ``--run`` executes each in an empty folder, as a reader does; one
that fails is told, with 1 as the exit code. The ``notebook`` extra has what that needs.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(\w*|\{\w+\})(?: [^\n]*)?\n(.*?)^```$", re.M | re.S)
FILE = re.compile(r"# ([\w.]+\.(?:py|toml))\n")


def how_tos() -> list[str]:
    """Pages under *How to*, in their order."""
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    tree = re.search(r"^:caption: How to\n:maxdepth: 1\n\n(.*?)^```$", index, re.M | re.S)
    assert tree is not None
    return tree[1].split()


def notebook(page: str) -> dict[str, Any]:
    """Cells of a page, in nbformat 4."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    cells: list[dict[str, Any]] = []
    end = 0
    for found in BLOCK.finditer(text):
        prose(cells, text[end : found.start()])
        code(cells, found[1], found[2])
        end = found.end()
    prose(cells, text[end:])
    for i, cell in enumerate(cells):
        cell["id"] = f"{page}-{i}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"nbformat": 4, "nbformat_minor": 5, "metadata": {"kernelspec": kernel}, "cells": cells}


def prose(cells: list[dict[str, Any]], text: str) -> None:
    """Text between two blocks; what a block prints is left out."""
    if text.strip():
        cells.append({"cell_type": "markdown", "metadata": {}, "source": text.strip()})


def code(cells: list[dict[str, Any]], language: str, body: str) -> None:
    """A block that runs, or one that is only shown."""
    file = FILE.match(body)
    if language in ("python", "toml") and file:
        source = f"%%writefile {file[1]}\n{body}"
    elif language == "python":
        source = body
    elif language == "{picture}":
        source = f"{body}\nfig"
    elif language == "console":
        lines = [line[2:] for line in body.splitlines() if line.startswith("$ ")]
        source = "\n".join(f"!{line}" for line in lines)
    elif language == "text":
        return
    else:
        prose(cells, f"```{language}\n{body}```")
        return
    cells.append({"cell_type": "code", "metadata": {}, "source": source.rstrip(), "outputs": [],
                  "execution_count": None})  # fmt: skip


def faults(found: Any) -> list[str]:
    """Lines of a shell that no page means to show."""
    texts = [o.get("text", "") for c in found.cells for o in c.get("outputs", [])]
    lines = [line for text in texts for line in text.splitlines()]
    return [line for line in lines if "a fault of slipctl" in line or "not found" in line]


def main() -> int:
    """Write them, and run them where asked."""
    import nbformat
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--pages", nargs="*", default=how_tos())
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    failed = 0
    for page in options.pages:
        found = nbformat.from_dict(notebook(page))
        nbformat.validate(found)
        if options.run:
            with tempfile.TemporaryDirectory() as place:
                client = NotebookClient(found, timeout=300, resources={"metadata": {"path": place}})
                try:
                    client.execute()
                except CellExecutionError as error:
                    print(f"{page}: {error}")
                    failed = 1
            for line in faults(found):
                print(f"{page}: {line}")
                failed = 1
        nbformat.write(found, options.folder / f"{page}.ipynb")
    return failed


if __name__ == "__main__":
    sys.exit(main())
