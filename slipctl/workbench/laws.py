"""The adhesion law beside its equations: curve, peak, slope, how far it was measured; parts."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl.analysis.optimum import Peak, argmax, highest_peak, objective_functions
from slipctl.block.block import Block
from slipctl.block.reach import reach_text, slip_input
from slipctl.draw import mathml, show
from slipctl.draw.diagrams import diagram
from slipctl.errors import BadInput, RunFailed
from slipctl.run.logs.replay import part_of
from slipctl.study import resolve
from slipctl.study.files import declared_parts, trip_files
from slipctl.workbench.curves import finite
from slipctl.workbench.desk import Desk, Rig

UPTO = {"ratio": 0.5, "speed": 5.0}
"""How far a curve goes, by what its slip is: the ratio, or m/s."""

POINTS = 201
"""Of a curve."""

LARGEST = 40
"""Parts from which on a block's diagram is not drawn on the page."""


def equations_of_block(block: Block) -> list[tuple[str, str]]:
    """Equations of a block, left and right side as MathML; right is empty for a title."""
    return [
        (left.replace(' style="font-weight:bold"', ""), right)
        for left, right in mathml.page(show.latex(block))
    ]


def law_of_text(text: str) -> Block:
    """Law that a person wrote: a model by name, ``file.toml:law``, or an equation.

    Raises:
        BadInput: what is wrong with it; also where it has no slip among its inputs.
    """
    law = resolve.load_block(text)
    if slip_input(law) is None:
        raise BadInput(f"{law.name} has no slip among its inputs: name it v_s [m/s] or lam [1]")
    if law.kind != "law":
        raise BadInput(f"{law.name} is a {law.kind}; an adhesion law has no states")
    return law


def law_of_desk(desk: Desk, rig: Rig) -> tuple[Block, str]:
    """Adhesion law of what is open, and the text that a file has for it; empty of a study.

    Raises:
        BadInput: it has none that can be shown.
    """
    if desk.text is not None:
        content = tomllib.loads(desk.text)
        part, _ = declared_parts.read(trip_files.vehicle_files().root(content), content)
        found = trip_files.vehicle_files().adhesion_law(part)
        if found is not None:
            return found
    for model in rig.study.models.values():
        if hasattr(model, "law_data") and slip_input(model) is not None:
            return model, ""
    for _, leaf in rig.loop.leaves():
        if leaf.kind == "law" and slip_input(leaf) is not None and "mu" in leaf.outputs:
            return leaf, ""
    raise BadInput(f"{rig.study.name} has no adhesion law that stands alone")


def law_view(law: Block) -> dict[str, Any]:
    """What the page shows of an adhesion law.

    Returns:
        Name, equations, slip with its unit, and for each rail condition the curve, the place and
        height of its peak, and the slope at no slip; how far it was measured, in words.

    Raises:
        BadInput: a parameter without a value.
    """
    slip = slip_input(law)
    if slip is None:
        raise BadInput(f"{law.name} has no slip among its inputs")
    signal = law.inputs[slip]
    upto = UPTO["ratio" if signal.unit == "1" else "speed"]
    reach = law.law_data
    shown = min(max(upto, reach.measured_to or 0.0), 4 * upto)
    conditions = law.conditions or {"": {}}
    return {
        "name": law.name, "doc": law.doc.partition("\n")[0], "equations": equations_of_block(law),
        "slip": slip, "unit": signal.unit, "upto": shown, "reach": reach_text(law),
        "measured_to": finite(reach.measured_to), "meant_to": finite(reach.meant_to),
        "curves": [_curve(law, slip, shown, n, v) for n, v in conditions.items()],
    }  # fmt: skip


def _curve(
    law: Block, slip: str, upto: float, name: str, values: Mapping[str, Any]
) -> dict[str, Any]:
    """Curve of a rail condition, its peak, and its slope at no slip."""
    at = np.linspace(0.0, upto, POINTS)
    out = next(iter(law.outputs))
    rest = {n: s.value if s.value is not None else 0.0 for n, s in law.inputs.items()}
    columns = [at if n == slip else np.full(at.size, float(v)) for n, v in rest.items()]
    p = law.pack("param", law.param_values(**values))
    y = np.array(ca.DM(law.f.map(at.size)(
        ca.DM(0, at.size), ca.DM(np.array(columns)), ca.repmat(p, 1, at.size))[1]
    ).full())  # fmt: skip
    heights = y[list(law.outputs).index(out)]
    known = [finite(v) for v in heights]
    found: dict[str, Any] = {"name": name, "x": at.tolist(), "y": known}
    given = {**{n: v for n, v in rest.items() if n != slip}, **values}
    try:
        peak = _peak(law, slip, out, upto, given, downwards=bool(np.nansum(heights) < 0))
    except (BadInput, RunFailed) as error:
        return found | {"why": str(error)}
    inside = peak.method != "bound"
    _, slope, fixed = objective_functions(law.name, law, [slip], out, given)
    return found | {
        "peak_at": peak.location if inside else None, "peak": peak.value if inside else None,
        "slope": float(slope(0.0, fixed)[0]),
    }  # fmt: skip


def _peak(
    law: Block, slip: str, out: str, upto: float, given: Mapping[str, Any], downwards: bool
) -> Peak:
    """Peak of a law; of one that is negative in braking its lowest place."""
    if not downwards:
        return argmax(law, slip, out, lo=0.0, hi=upto, at=given)
    value, slope, p = objective_functions(law.name, law, [slip], out, dict(given))
    x, q = ca.MX.sym("x"), ca.MX.sym("q", value.size1_in(1), value.size2_in(1))
    turned = [ca.Function(f.name(), [x, q], [-e for e in f.call([x, q])]) for f in (value, slope)]
    found = highest_peak(law.name, turned[0], turned[1], p, 0.0, upto)
    return found._replace(value=-found.value)


def block_view(loop: Block, path: str) -> dict[str, Any]:
    """What the page shows of a part of a loop: parts, diagram, equations, Jacobian, signals.

    Raises:
        BadInput: there is no such part.
    """
    block = part_of(loop, path) if path else loop
    parts = list(show.inner(block).parts)
    drawn = 0 < len(parts) <= LARGEST
    found = diagram.boxes_of_svg(block) if drawn else {}
    boxes = {k: box for k, box in found.items() if k in parts}
    return {
        "path": path, "name": block.name, "doc": block.doc.partition("\n")[0], "kind": block.kind,
        "parts": parts,
        "diagram": diagram.svg(block) if drawn else "",
        "boxes": boxes,
        "equations": [] if parts else equations_of_block(block),
        "text": "" if parts else show.text(block),
        "signals": [
            {"name": s.name, "role": s.role, "unit": s.unit, "doc": " ".join(s.doc.split())}
            for s in block.signals if s.role in ("input", "output")
        ],
    }  # fmt: skip
