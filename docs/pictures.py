"""The ``{picture}`` block of these pages: code, and above it the picture that the code makes.

The code ends with ``fig``, a figure of matplotlib. The build runs it in a namespace of its own and
keeps the picture under ``docs/made``, by a hash of the code and of slipctl's own files. So only
what changed is drawn again. ``tests/pages.py`` runs the same code.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

import slipctl.models
import slipctl.studies
from slipctl.draw import plots

DOCS = Path(__file__).parent
MADE = DOCS / "made"


@cache
def sources() -> bytes:
    """Hash of the code that pictures depend on."""
    found = hashlib.sha256()
    for package in (slipctl, slipctl.models, slipctl.studies):
        for folder in package.__path__:
            for file in sorted(Path(folder).rglob("*.py")):
                found.update(file.read_bytes())
    return found.digest()


def drawn(code: str) -> str:
    """File of the picture that the code makes, below ``docs``."""
    name = hashlib.sha256(sources() + code.encode()).hexdigest()[:20] + ".svg"
    if not (MADE / name).exists():
        names: dict[str, Any] = {"__name__": "__main__"}
        exec(compile(code, "picture", "exec"), names)
        MADE.mkdir(exist_ok=True)
        text = plots.svg_text(names["fig"])
        (MADE / name).write_text(text, encoding="utf-8", newline="\n")
    return f"made/{name}"


class Picture(SphinxDirective):
    """Picture first, then the lines that make it."""

    required_arguments = 1
    final_argument_whitespace = True
    has_content = True

    def run(self) -> list[nodes.Node]:
        code = "\n".join(self.content)
        try:
            uri = "/" + drawn(code)
        except Exception as error:
            where = f"{self.env.docname}, line {self.lineno}"
            raise ExtensionError(f"{where}: the picture fails: {error!r}") from error
        block = nodes.literal_block(code, code, language="python")
        return [nodes.image(uri=uri, alt=self.arguments[0]), block]


def setup(app: Sphinx) -> dict[str, Any]:
    """Tell Sphinx of the block."""
    app.add_directive("picture", Picture)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
