"""The ``{models}`` block: every block of a file of models, as ``slipctl show`` knows it.

Equations are set as MathML, which browsers know: no script, nothing from the network. A connected
block shows its parts as a diagram. An adhesion law is drawn over its slip, on each rail, to
six times the best slip. Everything is made when the pages are built.
"""

from __future__ import annotations

import importlib
import math
from html import escape
from typing import Any

import numpy as np
from docutils import nodes
from pictures import drawn
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

from slipctl.block.block import Block
from slipctl.draw.diagrams import diagram
from slipctl.errors import BadInput
from slipctl.study import resolve
from slipctl.study.report import page_style, report_page
from slipctl.study.report.texts import number

LONG = 50_000
"""Letters of equations beyond which a page does not have them: a table of a hundred numbers."""

EXAMPLES: dict[str, tuple[Any, ...]] = {
    "converters.converter": ("V", -1.0, 1.0),
    "ep_valve.dead_time": (3,),
    "sensors.reading": ("m/s",),
    "sensors.speed_of_wheels": (4,),
}
"""Arguments with which a function that needs some is shown."""

ROLES = {"param": "parameter", "input": "input", "state": "state", "output": "output"}


class Models(SphinxDirective):
    """Every block of a file of models, in its order."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        module = self.arguments[0]
        try:
            return [section(module, name) for name in resolve.models()[module][1]]
        except (BadInput, KeyError) as error:
            raise ExtensionError(f"{self.env.docname}: {module}: {error}") from error


def section(module: str, name: str) -> nodes.section:
    """A block with its title, or what the function that makes it says."""
    found = nodes.section(ids=[name.replace("_", "-")])
    found += nodes.title(name, name)
    try:
        block = _example(module, name) or resolve.load_block(f"{module}.{name}")
    except BadInput:  # a function that needs arguments: one of its blocks stands in a study
        text = resolve.models()[module][1][name]
        found += nodes.paragraph(
            text, f"{text} A function that needs arguments; see the API reference."
        )
        return found
    if curve := _curve(module, name, block):
        found += nodes.image(uri=f"/{drawn(curve)}", alt=f"{name}: adhesion over slip")
    if given := EXAMPLES.get(f"{module}.{name}"):
        call = f"{name}({', '.join(map(repr, given))})"
        found += nodes.paragraph(call, f"As {call} makes it.")
    found += nodes.raw("", _html(block), format="html")
    return found


def _example(module: str, name: str) -> Block | None:
    """Block that a function makes of the arguments above, None for another one."""
    given = EXAMPLES.get(f"{module}.{name}")
    if given is None:
        return None
    made: Block = getattr(importlib.import_module(f"slipctl.models.{module}"), name)(*given)
    return made


def _html(block: Block) -> str:
    """Meaning, diagram or equations, and numbers of a block."""
    out = [report_page._paragraphs(report_page._meaning(block))]
    if block.parts:
        out.append(f"<details><summary>diagram</summary>{diagram.svg(block)}</details>")
        parts = ", ".join(f"{path} ({leaf.name})" for path, leaf in block.leaves())
        out.append(f"<p>Parts: {escape(parts)}.</p>")
    elif len(equations := report_page.equations(block)) < LONG:
        out.append(equations)
    else:
        out.append(
            f"<p>Its equations are long; <code>slipctl show {block.name}</code> has them.</p>"
        )
    out.append(f"<details><summary>signals and parameters</summary>{_table(block)}</details>")
    return "".join(out)


def _table(block: Block) -> str:
    rows = []
    for role, called in ROLES.items():
        for name, s in block._signals[role].items():
            value = s.value if isinstance(s.value, str) or s.value is None else number(s.value, 6)
            unit = "" if s.unit == "1" else report_page.pretty(s.unit)
            rows.append([called, name, value or "", unit, _range(s), s.doc, s.source])
    return page_style.table(["", "name", "value", "unit", "range", "meaning", "source"], rows)


def _range(s: Any) -> str:
    if s.values:
        return s.meanings
    low, high = ("" if x is None or x in (math.inf, -math.inf) else str(x) for x in (s.lo, s.hi))
    if low and high:
        return f"{low} to {high}"
    return f"from {low}" if low else f"to {high}" if high else ""


def _curve(module: str, name: str, block: Block) -> str:
    """Lines that draw an adhesion law; nothing for another block."""
    made = getattr(importlib.import_module(f"slipctl.models.{module}"), name)
    if made is not block or not block.conditions or "mu" not in block.outputs:
        return ""
    slip = next(iter(block.inputs))
    rest = {n: 20.0 for n in block.inputs if n != slip}
    top = 0.0
    for values in block.conditions.values():
        law = block.with_params(**values)
        at = np.geomspace(1e-3, 1.0 if block.inputs[slip].unit == "1" else 20.0, 200)
        mu = [abs(float(law(**{slip: s}, **rest)["mu"])) for s in at]
        top = max(top, float(at[int(np.argmax(mu))]))
    upto = min(6 * top, 1.0) if block.inputs[slip].unit == "1" else 6 * top
    if not rest:
        return (
            "from slipctl.draw import plots\n"
            f"from slipctl.models.{module} import {name}\n\n"
            f"fig = plots.laws({name}, upto={upto:.2g})\n"
        )
    given = ", ".join(f"{n}={v}" for n, v in rest.items())
    return (
        "import numpy as np\n"
        "from slipctl.draw.plots import lines\n"
        f"from slipctl.models.{module} import {name} as law\n\n"
        f"slip = np.linspace(0.0, {upto:.2g}, 121)\n"
        "curves = {\n"
        f"    n: (slip, [law.with_params(**p)({slip}=s, {given})['mu'] for s in slip])\n"
        "    for n, p in law.conditions.items()\n"
        "}\n"
        f'fig = lines(curves, x=("slip speed at {rest.get("v", 0):g} m/s", "m/s"),'
        ' y=("adhesion coefficient", "1"))\n'
    )


def setup(app: Sphinx) -> dict[str, Any]:
    """Tell Sphinx of the block."""
    app.add_directive("models", Models)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
