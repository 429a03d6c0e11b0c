"""A2L (ASAM MCD-2 MC, ASAP2 1.71): parameters and measurements for a calibration tool.

One CHARACTERISTIC per parameter, one MEASUREMENT per input, state and output, each with unit,
limits, and a COMPU_METHOD per unit or enumeration. A table is a CURVE, or a
MAP, over AXIS_PTS. Derived parameters, the status with its bits,
and how long inputs have been bad are measured too. Its place (SYMBOL_LINK: name and offset) is one
in an instance of the module's structs. The firmware names that ``ctl_param_instance``,
``ctl_in_instance`` and so on, and keeps what the step returns in ``ctl_status_instance``.
The module itself has no addresses; a tool puts them in from the firmware's ELF file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from slipctl.ccode.module import guard
from slipctl.ccode.module.comments import ascii_text, first_sentence
from slipctl.ccode.module.header import CONTENT, place_in_state, statuses
from slipctl.ccode.module.layout import Member, places_of, spans
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import size
from slipctl.ccode.tree.expressions import number

Methods = dict[str | tuple[str, ...], str]
"""Conversion by unit, or by the names of an enumeration."""


ORDERS = {"little": "MSB_LAST", "big": "MSB_FIRST"}
"""Byte orders of processors, as ASAP2 calls them."""


def a2l(plan: Plan) -> str:
    """Text of the description."""
    from slipctl import __version__

    lay = plan.layout
    kind = "FLOAT64_IEEE" if plan.real == "double" else "FLOAT32_IEEE"
    rows = _rows(plan)
    every = [r.member for r in rows]
    units = sorted({m.signal.unit for m in every if not m.signal.values})
    methods: Methods = {u: f"CM_{k}" for k, u in enumerate(units)}
    blocks = [
        f'/begin COMPU_METHOD {methods[u]} {_quoted(u)} IDENTICAL "%.9" {_quoted(u)}\n'
        "/end COMPU_METHOD"
        for u in units
    ]
    for m in every:
        if m.signal.values not in ((), *methods):
            k = len(methods) - len(units)
            methods[m.signal.values] = f"CM_choice_{k}"
            blocks += _choice(m.signal.values, k)
    blocks.append(
        f"/begin RECORD_LAYOUT RL_VALUE FNC_VALUES 1 {kind} COLUMN_DIR DIRECT\n/end RECORD_LAYOUT"
    )
    if any(m.signal.rising for m in lay.params):
        blocks.append(
            f"/begin RECORD_LAYOUT RL_PLACES AXIS_PTS_X 1 {kind} INDEX_INCR DIRECT\n"
            "/end RECORD_LAYOUT"
        )
    status = _status(plan, methods.setdefault("1", "CM_none"))
    blocks += [_characteristic(plan, r.member, r.offset, methods)
               for r in rows if r.struct == "param"]  # fmt: skip
    blocks += [_measurement(plan, r, methods, kind) for r in rows if r.struct != "param"]
    blocks += _METHODS if "1" in units else [*_METHODS, _NONE]
    blocks += status.values()
    blocks += _grouped(plan, rows, list(status))
    body = "\n".join(blocks)
    return f"""ASAP2_VERSION 1 71
/begin PROJECT {plan.name} {_quoted(first_sentence(plan.block.doc) or plan.block.name)}
/begin HEADER "written by slipctl {__version__}, content {CONTENT}"
/end HEADER
/begin MODULE {plan.name}_module ""
/begin MOD_COMMON "" BYTE_ORDER {ORDERS[plan.byte_order]} ALIGNMENT_FLOAT64_IEEE 8
/end MOD_COMMON
{body}
/end MODULE
/end PROJECT
"""


def _choice(values: tuple[str, ...], k: int) -> list[str]:
    """Conversion of the numbers of an enumeration to its names."""
    said, pairs = _quoted(", ".join(values)), [f'{i} "{v}"' for i, v in enumerate(values)]
    return [
        f'/begin COMPU_METHOD CM_choice_{k} {said} TAB_VERB "%.0" "" COMPU_TAB_REF VT_choice_{k}\n'
        "/end COMPU_METHOD",
        f"/begin COMPU_VTAB VT_choice_{k} {said} TAB_VERB {len(values)} {' '.join(pairs)}\n"
        "/end COMPU_VTAB",
    ]


class _Row(NamedTuple):
    """A member: its struct, where in this it lies, and bytes from the begin of the struct."""

    struct: str
    within: str
    member: Member
    offset: int


def _rows(plan: Plan) -> list[_Row]:
    """All that a tool may see."""
    lay, width = plan.layout, size(plan.real)

    def plain(members: Iterable[Member], begin: int = 0) -> list[int]:
        return [begin + here.start * width for _, here in spans(members)]

    derived = place_in_state(plan, "derived") if lay.derived else 0
    begin = place_in_state(plan, "measured") if lay.measured else 0
    measured = lay.offsets(plan.real)[len(lay.outputs) :] if lay.measured else []
    groups = (
        ("in", "", lay.inputs, plain(lay.inputs)),
        ("param", "", lay.params, plain(lay.params)),
        ("state", "kept.", lay.states, lay.kept_offsets(plan.real)),
        ("out", "", lay.outputs, plain(lay.outputs)),
        ("state", "derived.", lay.derived, plain(lay.derived, derived)),
        ("state", "measured.", lay.measured, [begin + at for at in measured]),
    )
    return [
        _Row(struct, within, m, at) for struct, within, members, places in groups
        for m, at in zip(members, places, strict=False)
    ]  # fmt: skip


def _type(plan: Plan, m: Member, kind: str) -> str:
    """Type of a member, with numbers of this kind."""
    types = {"bool": "UBYTE", "int": "SLONG", "unsigned int": "ULONG"}
    return types.get(plan.layout.kind(m, plan.real), kind)


_NONE = '/begin COMPU_METHOD CM_none "1" IDENTICAL "%.9" "1"\n/end COMPU_METHOD'
_METHODS = [
    '/begin COMPU_METHOD CM_said "no or yes" TAB_VERB "%.0" "" COMPU_TAB_REF VT_said\n'
    "/end COMPU_METHOD",
    '/begin COMPU_VTAB VT_said "no or yes" TAB_VERB 2 0 "no" 1 "yes"\n/end COMPU_VTAB',
]
"""Conversions of numbers without a unit, and of the bits of the status."""


def _status(plan: Plan, bare: str) -> dict[str, str]:
    """Measurements of the status, of each of its bits, and of what the guards count, by name."""
    n = plan.name
    most = sum(value for _, value, _ in statuses(plan))
    link = f'\n  SYMBOL_LINK "{n}_status_instance" 0'
    found = {
        f"{n}_status": f'/begin MEASUREMENT {n}_status "what the step returns; 0: all is well"\n'
        f"  SLONG {bare} 0 0 0 {most}\n  ECU_ADDRESS 0x0{link}\n/end MEASUREMENT"
    }
    for word, value, meaning in statuses(plan)[1:]:
        name = f"{n}_status.{word}"
        found[name] = (
            f"/begin MEASUREMENT {name} {_quoted(meaning)}\n"
            f"  SLONG CM_said 0 0 0 1\n  BIT_MASK 0x{value:X}\n  ECU_ADDRESS 0x0{link}\n"
            "/end MEASUREMENT"
        )
    at = place_in_state(plan, "guard") + size(plan.real) * max(plan.n_in, 1)
    counts = [
        ("age", plan.n_in, "ticks without a good value, less good ones since; -1: none yet",
         "SLONG", -1, int(guard.MANY)),
        ("back", plan.n_in, "1: good in the last tick, but away before", "ULONG", 0, 1),
        ("fresh", min(plan.n_in, 1), "1 if all were good in the last tick, and are sure", "ULONG",
         0, 1),
        ("refused", 1, "ticks refused in a row since the last good one or reset", "ULONG", 0,
         guard.PATIENCE * (len(plan.parts) + 2)),
        ("missed", int(bool(plan.counters)), "ticks refused since the last good one", "ULONG", 0,
         2**32 - 1),
    ]  # fmt: skip
    for member, many, what, kind, least, most in counts:
        if many:
            name = f"{n}_state.guard.{member}"
            dims = _matrix((many,)) if many > 1 else ""
            found[name] = (
                f"/begin MEASUREMENT {name} {_quoted(what)}\n"
                f"  {kind} {bare} 0 0 {least} {most}\n"
                f"  ECU_ADDRESS 0x{at:X}{dims}{_link(plan, 'state', at)}\n/end MEASUREMENT"
            )
        at += 4 * many
    return found


def _grouped(plan: Plan, rows: Iterable[_Row], status: list[str]) -> list[str]:
    """A group of each struct, of the status, and of each part of the block."""
    groups: dict[str, list[str]] = {}
    parts: dict[str, list[str]] = {}
    for row in rows:
        plain = "parameters" if row.struct == "param" else row.struct
        title = plain if row.within in ("", "kept.") else row.within[:-1]
        name = _name(plan, row.struct, row.member, row.within)
        groups.setdefault(title, []).append(name)
        if part := row.member.name.rpartition(".")[0]:
            parts.setdefault(f"part_{part}", []).append(name)
    groups |= {"status": status, **parts}
    texts = []
    for title, names in groups.items():
        kinds = {
            key: [x for x in names if x.startswith(f"{plan.name}_param.") == calibrated]
            for key, calibrated in (("REF_CHARACTERISTIC", True), ("REF_MEASUREMENT", False))
        }
        inner = " ".join(
            f"/begin {key} {' '.join(listed)} /end {key}" for key, listed in kinds.items() if listed
        )
        if inner:
            said = title.removeprefix("part_")
            texts.append(f'/begin GROUP {plan.name}_{title} "{said}" ROOT {inner}\n/end GROUP')
    return texts


def _name(plan: Plan, struct: str, m: Member, within: str = "") -> str:
    """Identifier of ASAP2: the symbol and the member, with dots."""
    place = plan.layout.places[m.c] if within == "kept." else m.c
    return f"{plan.name}_{struct}.{within}{place}"


def _quoted(text: str) -> str:
    plain = " ".join(ascii_text(text).split()).replace("\\", "/").replace('"', "'")
    return f'"{plain}"'


def _limits(plan: Plan, m: Member) -> str:
    """Range; without one, the largest numbers of the type."""
    most = 1.7976931348623157e308 if plan.real == "double" else 3.4028234663852886e38
    lo, hi = plan.limits(m)
    return f"{number(lo if math.isfinite(lo) else -most)} {number(min(hi, most))}"


def _about(m: Member) -> str:
    s = m.signal
    said = [f"{s.name}: {s.doc or s.name}", *[f"positive = {s.positive}"] * bool(s.positive)]
    said += [] if s.safe is None else [f"safe value {s.safe:g}"]
    return _quoted("; ".join([*said, *[f"source: {s.source}"] * bool(s.source)]))


def _dims(m: Member, measured: bool = False) -> str:
    if m.scalar:
        return ""
    # x counts columns, y rows: of COLUMN_DIR y runs first
    shape: Iterable[int] = m.signal.shape[::-1] if len(m.signal.shape) > 1 else (m.size,)
    layout = "\n  LAYOUT COLUMN_DIR" if measured and len(m.signal.shape) > 1 else ""
    return f"{_matrix(shape)}{layout}"


def _matrix(shape: Iterable[int]) -> str:
    """Dimensions x, y, z; ASAP2 up to 1.6 has always three, and later ones take them."""
    return "\n  MATRIX_DIM " + " ".join(map(str, [*shape, 1, 1][:3]))


def _link(plan: Plan, struct: str, offset: int) -> str:
    return f'\n  SYMBOL_LINK "{plan.name}_{struct}_instance" {offset}'


def _method(m: Member, methods: Methods) -> str:
    return methods[m.signal.values or m.signal.unit]


def _characteristic(plan: Plan, m: Member, offset: int, methods: Methods) -> str:
    """A parameter: a number, an array, the places of a table, or its heights over them."""
    name, link = _name(plan, "param", m), _link(plan, "param", offset)
    if m.signal.rising:
        return (
            f"/begin AXIS_PTS {name} {_about(m)}\n"
            f"  0x{offset:X} NO_INPUT_QUANTITY RL_PLACES 0 {_method(m, methods)} {m.size}"
            f" {_limits(plan, m)}\n  MONOTONY STRICT_INCREASE{link}\n/end AXIS_PTS"
        )
    kind, dims = "VALUE" if m.scalar else "VAL_BLK", _dims(m)
    if there := places_of(plan.block.params, m.name):
        found = {p.name: p for p in plan.layout.params}
        # the columns of a matrix are x, its rows y
        axes = [_axis(plan, found[n], methods) for n in reversed(there)]
        kind, dims = "CURVE" if len(there) == 1 else "MAP", "".join(axes)
    return (
        f"/begin CHARACTERISTIC {name} {_about(m)}\n"
        f"  {kind} 0x{offset:X} RL_VALUE 0 {_method(m, methods)} {_limits(plan, m)}"
        f"{dims}{link}\n/end CHARACTERISTIC"
    )


def _axis(plan: Plan, places: Member, methods: Methods) -> str:
    return (
        f"\n  /begin AXIS_DESCR COM_AXIS NO_INPUT_QUANTITY {_method(places, methods)}"
        f" {places.size} {_limits(plan, places)}\n"
        f"    AXIS_PTS_REF {_name(plan, 'param', places)}\n"
        "    MONOTONY STRICT_INCREASE\n  /end AXIS_DESCR"
    )


def _measurement(plan: Plan, row: _Row, methods: Methods, kind: str) -> str:
    m, kind = row.member, _type(plan, row.member, kind)
    method = "CM_said" if kind == "UBYTE" else _method(m, methods)
    return (
        f"/begin MEASUREMENT {_name(plan, row.struct, m, row.within)} {_about(m)}\n"
        f"  {kind} {method} 0 0 {_limits(plan, m)}\n  ECU_ADDRESS 0x{row.offset:X}"
        f"{_dims(m, True)}{_link(plan, row.struct, row.offset)}\n/end MEASUREMENT"
    )
