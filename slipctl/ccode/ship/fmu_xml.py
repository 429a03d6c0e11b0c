"""modelDescription.xml of an FMU: variables with units and ranges, and what depends on what."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator
from dataclasses import dataclass
from fractions import Fraction
from xml.sax.saxutils import escape, quoteattr

from slipctl.block.block import Block
from slipctl.block.units import unit_algebra
from slipctl.ccode.compile.files import start_elements
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.comments import ascii_text, first_sentence
from slipctl.ccode.module.layout import Member, c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.expressions import number

DISPLAY = {
    "m/s": ("km/h", 3.6), "rad/s": ("r/min", 30 / math.pi), "rad": ("deg", 180 / math.pi),
    "Pa": ("bar", 1e-5), "N": ("kN", 1e-3), "N m": ("kN m", 1e-3), "W": ("kW", 1e-3),
    "kg": ("t", 1e-3), "s": ("ms", 1e3),
}  # fmt: skip
"""Units that a tool may show instead: name, and how many of them one of the unit is."""


@dataclass(frozen=True)
class Variable:
    """One scalar variable: an element of a signal.

    Attributes:
        name: name of the signal, and indices from 1 on where it is an array.
        reference: value reference.
        causality, variability, initial: as FMI has them.
        start: start value, where it has one.
    """

    name: str
    reference: int
    causality: str
    variability: str
    initial: str
    member: Member
    start: float | None = None


def is_plant(block: Block) -> bool:
    """Whether a block is a discretised flow, whose outputs belong to its present state.

    A controller's outputs are those of its last tick, held until the next one.
    """
    kinds = {leaf.kind for _, leaf in block.leaves()}
    return "step" not in kinds


def variables(plan: Plan) -> list[Variable]:
    """Variables of the FMU in the order of their value references."""
    lay = plan.layout
    groups = (
        ("input", "discrete", "", lay.inputs), ("parameter", "tunable", "exact", lay.params),
        ("calculatedParameter", "tunable", "calculated", lay.derived),
        ("output" if is_plant(plan.block) else "local", "discrete", "exact", lay.states),
        ("output", "discrete", "calculated", lay.outputs),
    )  # fmt: skip
    start = plan.block.start()
    outside = {m.name for m in (*lay.inputs, *lay.outputs)}
    taken = outside | {m.name for m in (*lay.params, *lay.derived)}
    found: list[Variable] = []
    for causality, variability, initial, members in groups:
        for m in members:
            name = ascii_text(m.name)
            # an output may have the name of a state or of a parameter
            if members is lay.states and m.name in taken:
                name = f"state.{name}"
            elif causality.endswith("arameter") and m.name in outside:
                name = f"parameter.{name}"
            values: list[float | None] = [None] * m.size
            if causality == "input":
                values = list(start_elements(m))
            elif causality == "parameter":
                values = [float(v) for v in c_elements(m, m.signal.value)]
            elif members is lay.states:
                values = [float(v) for v in c_elements(m, start[m.name])]
            # what is computed from others unless it is set has no exact start value
            begins = "approx" if members is lay.states and m.signal.derived else initial
            for k, indices in enumerate(_indices(m)):
                found.append(
                    Variable(name + indices, len(found), causality, variability, begins, m,
                             values[k])
                )  # fmt: skip
    return found


def _indices(m: Member) -> Iterator[str]:
    """Indices of the elements of a signal in the order of C: column by column."""
    shape = m.signal.shape
    if shape == ():
        yield ""
    elif len(shape) == 1:
        yield from (f"[{k + 1}]" for k in range(shape[0]))
    else:
        yield from (f"[{i + 1},{j + 1}]" for j in range(shape[1]) for i in range(shape[0]))


def feedthrough(plan: Plan) -> dict[int, list[int]]:
    """For each output element the input elements that it depends on at once, by number."""
    f = plan.block.f
    found: dict[int, list[int]] = {}
    if not f.nnz_in(1) or not f.nnz_out(1):
        return found
    pattern = f.jac_sparsity(1, 1)
    for row, column in zip(*pattern.get_triplet(), strict=True):
        found.setdefault(int(row), []).append(int(column))
    return found


def unit_definitions(plan: Plan) -> list[str]:
    """Lines of UnitDefinitions; the same in FMI 2.0 and 3.0."""
    names = sorted({v.member.signal.unit for v in variables(plan)})
    lines = []
    for name in names:
        inner = ""
        u = unit_algebra.unit(name)
        rad = sum((e for n, e in u.names if n in ("rad", "deg")), Fraction(0))
        dims = dict(u.dims) | ({"rad": rad} if rad else {})
        whole = all(e.denominator == 1 for e in dims.values())
        if whole and set(dims) <= {"kg", "m", "s", "A", "K", "mol", "cd", "rad"}:
            powers = "".join(f' {n}="{int(e)}"' for n, e in sorted(dims.items()))
            factor = "" if u.scale == 1.0 else f' factor="{u.scale!r}"'
            inner += f"<BaseUnit{powers}{factor}/>"
        if name in DISPLAY:
            shown, factor_ = DISPLAY[name]
            inner += f'<DisplayUnit name={quoteattr(shown)} factor="{factor_!r}"/>'
        lines.append(f"    <Unit name={quoteattr(name)}>{inner}</Unit>")
    return lines


def _description(m: Member) -> str:
    s = m.signal
    said = [s.doc or s.name]
    if s.positive:
        said.append(f"positive = {s.positive}")
    if s.source:
        said.append(f"source: {s.source}")
    return quoteattr(ascii_text(" ".join("; ".join(said).split())))


def _numbers(v: Variable) -> str:
    """Attributes unit, min, max, start."""
    s = v.member.signal
    text = f" unit={quoteattr(s.unit)}"
    if math.isfinite(s.lo):
        text += f' min="{number(s.lo)}"'
    if math.isfinite(s.hi):
        text += f' max="{number(s.hi)}"'
    return text + (f' start="{number(v.start)}"' if v.start is not None else "")


def _structure(plan: Plan, now: bool) -> list[tuple[Variable, list[int]]]:
    """Each output with the inputs that it depends on at a communication point.

    Outputs that a tick gave do not change with the inputs until the next one.
    """
    outputs = [v for v in variables(plan) if v.causality == "output"]
    through = feedthrough(plan) if now else {}
    states = sum(v.initial != "calculated" for v in outputs)  # of a plant; they stand first
    return [(v, sorted(through.get(k - states, []))) for k, v in enumerate(outputs)]


def _unknown_at_first(plan: Plan, now: bool) -> list[int]:
    """References of what has no exact start value: derived parameters, then outputs."""
    derived = [v for v in variables(plan) if v.causality == "calculatedParameter"]
    return [v.reference for v in (*derived, *(v for v, _ in _structure(plan, now)))
            if v.initial != "exact"]  # fmt: skip


def description(plan: Plan, version: int, token: str, now: bool) -> str:
    """Text of modelDescription.xml.

    Args:
        plan: the module.
        version: of FMI, 2 or 3.
        token: what the description and the binary must agree on.
        now: outputs are those of the present state and inputs, not those of the last tick.
    """
    from slipctl import __version__

    found, period = variables(plan), number(plan.period) if plan.period else ""
    taken, status = {v.name for v in found}, len(found)
    output, unknown, key, first = ("Unknown", "Unknown", "index", 1)
    if version == 3:
        output, unknown, key, first = "Output", "InitialUnknown", "valueReference", 0
    rows = []
    for v in found:
        initial = f' initial="{v.initial}"' if v.initial else ""
        said = (
            f'name={quoteattr(v.name)} valueReference="{v.reference}"'
            f' description={_description(v.member)} causality="{v.causality}"'
            f' variability="{v.variability}"{initial}'
        )
        rows.append(
            f"    <ScalarVariable {said}><Real{_numbers(v)}/></ScalarVariable>"
            if version == 2 else f"    <Float64 {said}{_numbers(v)}/>"
        )  # fmt: skip
    told = [(v.reference, depends) for v, depends in _structure(plan, now)]
    outputs = [
        f'    <{output} {key}="{k + first}" dependencies="{" ".join(str(d + first) for d in of)}"/>'
        for k, of in [*told, (status, [])]
    ]
    begin = [*_unknown_at_first(plan, now), status]
    return fill_template(
        f"fmi{version}.xml", n=plan.name, token=token, tool=f"slipctl {__version__}",
        about=quoteattr(ascii_text(first_sentence(plan.block.doc))),
        step=f' stepSize="{period}"' if period else "",
        fixed=f' fixedInternalStepSize="{period}"' if period else "",
        units="\n".join(unit_definitions(plan)), variables="\n".join(rows),
        status=_free("status", taken), time=_free("time", taken), number=status, last=status + 1,
        status_said=quoteattr(_STATUS), outputs="\n".join(outputs),
        first="\n".join(f'    <{unknown} {key}="{k + first}"/>' for k in begin),
    )  # fmt: skip


_STATUS = "bits of the last communication step: 1 NaN in, 2 bad result, 8 off range, 16 limited"


def _free(name: str, taken: Container[str]) -> str:
    """A name that no variable has."""
    while name in taken:
        name += "_"
    return name


def page(plan: Plan) -> str:
    """Text of documentation/index.html."""
    rows = "".join(
        f"<tr><td>{escape(v.name)}</td><td>{escape(v.member.signal.unit)}</td>"
        f"<td>{v.causality}</td><td>{escape(ascii_text(v.member.signal.doc))}</td></tr>\n"
        for v in variables(plan)
    )
    return (
        f"<!DOCTYPE html>\n<meta charset='utf-8'><title>{plan.name}</title>\n<h1>{plan.name}</h1>\n"
        f"<p>{escape(ascii_text(plan.block.doc))}</p>\n<p>A binary for another platform is built"
        " from the C files in sources, which need nothing but the C library: <code>cc -std=c99 -O2"
        f" -ffp-contract=off -fPIC -shared sources/*.c -o {plan.name}.so -lm</code></p>\n"
        "<table>\n<tr><th>variable</th><th>unit</th>"
        f"<th>causality</th><th>meaning</th></tr>\n{rows}</table>\n"
    )
