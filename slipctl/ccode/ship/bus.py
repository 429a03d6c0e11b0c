"""Inputs and outputs as a bus has them: integers of which one step is so much, choices, truth.

The module computes with numbers in their units. Two files more, ``ctl_bus.h`` and
``ctl_bus.c``, translate signals that are a whole number, true or not, or a choice (``"int"``,
``"bool"``, ``"enum"``). They also translate integers of a resolution and an offset, on request.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from slipctl.block.units.unit_algebra import parse_quantity, split_quantity
from slipctl.ccode.compile.files import c_number
from slipctl.ccode.module.comments import comment
from slipctl.ccode.module.header import head, member_comment
from slipctl.ccode.module.layout import Member
from slipctl.ccode.module.plan import Plan
from slipctl.errors import BadInput, nearest

TYPES = {
    "uint8": (0, 255), "int8": (-128, 127), "uint16": (0, 65535), "int16": (-32768, 32767),
}  # fmt: skip
"""Smallest and largest number of each type; the smallest that suffices comes first."""

SPELLING = "NAME=TYPE:RESOLUTION[:OFFSET], such as v=uint16:0.01m/s"


class Scaled(NamedTuple):
    """A signal as an integer: the signal is ``resolution`` times the integer, plus ``offset``."""

    type: str
    resolution: float = 1.0
    offset: float = 0.0


def read(plan: Plan, texts: Iterable[str]) -> dict[str, Scaled]:
    """Integers that are asked for, by the name of the signal; ``v=uint16:0.01m/s:-5m/s``.

    Raises:
        BadInput: another form, an unknown signal or type, a wrong unit, a resolution that is not
            positive, a signal without range, or one whose range the integer cannot hold.
    """
    found: dict[str, Scaled] = {}
    members = {m.name: m for m in (*plan.layout.inputs, *plan.layout.outputs)}
    for text in texts:
        name, equals, rest = text.partition("=")
        kind, *numbers = (part.strip() for part in rest.split(":"))
        name = name.strip()
        if not equals or len(numbers) not in (1, 2):
            raise BadInput(f"--scaled {text}: write {SPELLING}")
        if name not in members:
            raise BadInput(f"{plan.name} has no input or output {name!r}{nearest(name, members)}")
        if name in found:
            raise BadInput(f"--scaled names {name} twice; write it once")
        if kind not in TYPES:
            raise BadInput(f"--scaled {name}: {kind!r} is no type{nearest(kind, TYPES)}")
        m = members[name]
        if m.signal.whole:
            raise BadInput(f"--scaled {name}: it is a whole number already; leave it out")
        unit = m.signal.unit
        resolution, *offset = (_quantity(v, unit, name) for v in numbers)
        if not resolution > 0:
            raise BadInput(f"--scaled {name}: its resolution is {resolution:g}; give one above 0")
        found[name] = Scaled(kind, resolution, *offset)
        _check_holds(plan, m, found[name])
    return found


def _quantity(text: str, unit: str, name: str) -> float:
    """A number in SI; only one of a signal with a unit has one."""
    if unit != "1" and not split_quantity(text)[1]:
        raise BadInput(f"--scaled {name}: {text} has no unit; write it in {unit}")
    return parse_quantity(text, unit, f"--scaled {name}")


def _check_holds(plan: Plan, m: Member, s: Scaled) -> None:
    """Refuse an integer that cannot hold the range of its signal.

    Raises:
        BadInput: with what it holds, and what would do.
    """
    least, most, *_ = plan.ends([m], plan.block.param_values())
    lo, hi = float(least.min()), float(most.max())
    if max(abs(lo), abs(hi)) > 1e30:  # the largest number of the type, or the like
        raise BadInput(f"--scaled {m.name}: it has no range, so no integer is known to hold it")
    first, last = (s.offset + s.resolution * end for end in TYPES[s.type])
    if lo < first - s.resolution / 2 or hi > last + s.resolution / 2:
        span = TYPES[s.type][1] - TYPES[s.type][0]
        unit = "" if m.signal.unit == "1" else f" {m.signal.unit}"
        raise BadInput(
            f"--scaled {m.name}: {s.type} of {s.resolution:g}{unit} holds {first:g} to"
            f" {last:g}{unit}, its range is {lo:g} to {hi:g}{unit};"
            f" a resolution of {1.05 * (hi - lo) / span:.2g}{unit} or more holds it, with a fitting"
            " offset"
        )


def texts(plan: Plan, scaled: Mapping[str, Scaled]) -> dict[str, str]:
    """Text of both files by name; none where every signal is a number in its unit."""
    lay = plan.layout
    found = {m: s for m in (*lay.inputs, *lay.outputs) if (s := _as(m, scaled)) is not None}
    if not found:
        return {}
    n = plan.name
    return {f"{n}_bus.h": _header(plan, found), f"{n}_bus.c": _source(plan, found)}


def _as(m: Member, scaled: Mapping[str, Scaled]) -> Scaled | None:
    """How a bus has a signal; None as the number it is."""
    s = m.signal
    if not s.whole:
        return scaled.get(m.name)
    if s.values == ("no", "yes"):
        return Scaled("bool")
    for kind, (first, last) in TYPES.items():
        if s.lo >= first and s.hi <= last:
            return Scaled(kind)
    return None  # 16 bits do not hold it


def _header(plan: Plan, found: Mapping[Member, Scaled]) -> str:
    n, lay, big = plan.name, plan.layout, plan.layout.big
    guard = f"{big}_BUS_H"
    parts = [head(plan, f"{n}_bus.h"), f'#ifndef {guard}\n#define {guard}\n\n#include "{n}.h"']
    parts.append("#include <stdbool.h>\n#include <stdint.h>")
    parts.append('#ifdef __cplusplus\nextern "C" {\n#endif')
    for m in found:
        if m.signal.values and found[m].type != "bool":
            names = [f"{big}_{m.c.upper()}_{v.upper()}" for v in m.signal.values]
            listed = ",\n".join(f"    {name} = {k}" for k, name in enumerate(names))
            parts.append(f"{comment(f'Values of {m.name}.')}\nenum {{\n{listed}\n}};")
    for struct, members, what in (
        ("in", lay.inputs, "Inputs of one tick, as the bus has them."),
        ("out", lay.outputs, "Outputs of one tick, as the bus has them."),
    ):
        if members:
            listed = "\n".join(_member(plan, m, found.get(m)) for m in members)
            name = f"{n}_{struct}_bus"
            parts.append(f"{comment(what)}\ntypedef struct {name} {{\n{listed}\n}} {name};")
    said = "A step with inputs and outputs as the bus has them; its status."
    parts.append(f"{comment(said)}\n{_prototype(plan, '_step_bus')};")
    parts.append("#ifdef __cplusplus\n}\n#endif\n\n#endif")
    return "\n\n".join(parts) + "\n"


def _member(plan: Plan, m: Member, s: Scaled | None) -> str:
    said = member_comment(m)
    if s is None:
        return f"{said}\n    {plan.real} {m.c}{'' if m.scalar else f'[{m.size}]'};"
    if not m.signal.whole:
        unit = "" if m.signal.unit == "1" else f" {m.signal.unit}"
        plus = f", plus {s.offset:.17g}{unit}" if s.offset else ""
        said += f"\n    /* one is {s.resolution:.17g}{unit}{plus} */"
    kind = "bool" if s.type == "bool" else f"{s.type}_t"
    return f"{said}\n    {kind} {m.c}{'' if m.scalar else f'[{m.size}]'};"


def _prototype(plan: Plan, name: str) -> str:
    n, lay = plan.name, plan.layout
    bus = [f"const {n}_in_bus *in"] * bool(lay.inputs) + [f"const {n}_param *param"]
    bus += [f"{n}_state *state"] + [f"{n}_out_bus *out"] * bool(lay.outputs)
    return f"int {n}{name}(" + f",\n{' ' * len(f'int {n}{name}(')}".join(bus) + ")"


def _source(plan: Plan, found: Mapping[Member, Scaled]) -> str:
    n, lay, real = plan.name, plan.layout, plan.real
    given = [line for m in lay.inputs for line in _each(m, _decoded(plan, m, found.get(m)))]
    told = [line for m in lay.outputs for line in _each(m, _encoded(plan, m, found.get(m)))]
    helper = ""
    if any(found.get(m) and found[m].type != "bool" for m in lay.outputs):
        half, zero = c_number(0.5, plan), c_number(0.0, plan)
        helper = (
            "/* the nearest whole number; beyond the ends of a type, and of NaN, an end */\n"
            f"static int32_t whole({real} x, {real} lo, {real} hi)\n{{\n"
            f"    const {real} y = (x > lo) ? ((x < hi) ? x : hi) : lo;\n"
            f"    return (int32_t)(y + ((y < {zero}) ? -{half} : {half}));\n}}\n\n"
        )
    declared = [f"    {n}_in given;", f"    {n}_out told;"]
    if not lay.inputs:
        given = ["    given.unused = 0;"]
    body = "\n".join(
        [*declared, "    int status;", *given,
         f"    status = {n}_step(&given, param, state, &told);", *told, "    return status;"]
    )  # fmt: skip
    return (
        f'{head(plan, f"{n}_bus.c")}\n\n#include "{n}_bus.h"\n\n{helper}'
        f"{_prototype(plan, '_step_bus')}\n{{\n{body}\n}}\n"
    )


def _each(m: Member, line: str) -> list[str]:
    """A line for each element of a signal."""
    if m.scalar:
        return [f"    {line.replace('[k]', '')}"]
    return [f"    for (int k = 0; k < {m.size}; ++k) {{", f"        {line}", "    }"]


def _decoded(plan: Plan, m: Member, s: Scaled | None) -> str:
    there = f"in->{m.c}[k]"
    if s is None:
        value = there
    elif s.type == "bool":
        value = f"{there} ? {c_number(1.0, plan)} : {c_number(0.0, plan)}"
    else:
        value = f"({plan.real}){there}"
        value += f" * {c_number(s.resolution, plan)}" if s.resolution != 1 else ""
        value += f" + {c_number(s.offset, plan)}" if s.offset else ""
    return f"given.{m.c}[k] = {value};"


def _encoded(plan: Plan, m: Member, s: Scaled | None) -> str:
    there = f"told.{m.c}[k]"
    if s is None:
        value = there
    elif s.type == "bool":
        value = f"{there} > {c_number(0.5, plan)}"
    else:
        ends = ", ".join(c_number(float(end), plan) for end in TYPES[s.type])
        inner = f"({there} - {c_number(s.offset, plan)})" if s.offset else there
        inner += f" / {c_number(s.resolution, plan)}" if s.resolution != 1 else ""
        value = f"({s.type}_t)whole({inner}, {ends})"
    return f"out->{m.c}[k] = {value};"


def bus_files(plan: Plan, scaled: Sequence[str]) -> dict[str, str]:
    """Text of the files for what is asked for, and for what is declared as whole."""
    return texts(plan, read(plan, scaled))
