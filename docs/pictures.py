"""Pictures of these pages: the ``{picture}`` block, and the ``{study}`` block.

``{picture}`` has code, and above it the picture that the code makes. ``{study} NAME`` has the
options ``figure``, ``scenarios`` and ``loops``: these runs of a study, and one of its figures.

The code ends with ``fig``, a figure of matplotlib. The build runs it in a namespace of its own and
keeps the picture under ``docs/made``, by a hash of the code and of slipctl's own files. So only
what changed is drawn again. ``tests/pages.py`` runs the same code.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

import slipctl.models
import slipctl.studies
from slipctl.draw import plots
from slipctl.study import case_setup, execution, resolve

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


def kept(key: str, draw: Callable[[], Any]) -> str:
    """File of a figure, below ``docs``; drawn where there is none of this key."""
    name = hashlib.sha256(sources() + key.encode()).hexdigest()[:20] + ".svg"
    if not (MADE / name).exists():
        text = plots.svg_text(draw())
        MADE.mkdir(exist_ok=True)
        (MADE / name).write_text(text, encoding="utf-8", newline="\n")
    return f"made/{name}"


def drawn(code: str) -> str:
    """File of the picture that the code makes."""
    names: dict[str, Any] = {"__name__": "__main__"}

    def draw() -> Any:
        exec(compile(code, "picture", "exec"), names)
        return names["fig"]

    return kept(code, draw)


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


class OfStudy(SphinxDirective):
    """A figure of a study, of the runs that it is about."""

    required_arguments = 1
    option_spec: ClassVar = dict.fromkeys(("figure", "scenarios", "loops"), directives.unchanged)

    def run(self) -> list[nodes.Node]:
        study = resolve.load_study(self.arguments[0])
        figure = study.figures[self.options["figure"]]
        scenarios, loops = (self.options[k].split() for k in ("scenarios", "loops"))

        def draw() -> Any:
            cases, models = case_setup.prepare(study, loops=loops, scenarios=scenarios)
            return figure.draw(execution.run(study, cases, models, experiments=False))

        uri = "/" + kept(f"{study.name} {sorted(self.options.items())}", draw)
        caption = nodes.caption(figure.caption, figure.caption)
        return [nodes.figure("", nodes.image(uri=uri, alt=figure.caption), caption)]


def setup(app: Sphinx) -> dict[str, Any]:
    """Tell Sphinx of the block."""
    app.add_directive("picture", Picture)
    app.add_directive("study", OfStudy)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
