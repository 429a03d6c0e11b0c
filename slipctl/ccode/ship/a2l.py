"""A2L (ASAM MCD-2 MC, ASAP2 1.71): parameters and measurements for a calibration tool.

One CHARACTERISTIC per parameter, one MEASUREMENT per input, state and output, each with unit,
limits, and a COMPU_METHOD per unit. Its place (SYMBOL_LINK: name and offset) is one in an instance
of the module's structs. The firmware names that ``ctl_param_instance``, ``ctl_in_instance`` and so
on.
The module itself has no addresses; a tool puts them in from the firmware's ELF file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from slipctl.ccode.write.comments import spelled
from slipctl.ccode.write.expressions import number
from slipctl.ccode.write.header import CONTENT
from slipctl.ccode.write.layout import Member
from slipctl.ccode.write.plan import Plan, first_sentence
from slipctl.ccode.write.precision import size

_STRUCTS = ("in", "param", "state", "out")


def a2l(plan: Plan) -> str:
    """Text of the description."""
    from slipctl import __version__

    lay = plan.layout
    kind = "FLOAT64_IEEE" if plan.real == "double" else "FLOAT32_IEEE"
    units = sorted({m.signal.unit for g in _groups(plan).values() for m in g})
    methods = {u: f"CM_{k}" for k, u in enumerate(units)}
    blocks = [
        f'/begin COMPU_METHOD {name} {_quoted(u)} IDENTICAL "%.9" {_quoted(u)}\n/end COMPU_METHOD'
        for u, name in methods.items()
    ]
    blocks.append(
        f"/begin RECORD_LAYOUT RL_VALUE FNC_VALUES 1 {kind} COLUMN_DIR DIRECT\n/end RECORD_LAYOUT"
    )
    offset = 0
    for m in lay.params:
        blocks.append(_characteristic(plan, m, offset, methods))
        offset += m.size * size(plan.real)
    for struct, members in _groups(plan).items():
        offset = 0
        for m in members if struct != "param" else ():
            blocks.append(_measurement(plan, struct, m, offset, methods, kind))
            offset += m.size * size(plan.real)
    names = {
        "parameters": ("REF_CHARACTERISTIC", [_name(plan, "param", m) for m in lay.params]),
        **{
            s: ("REF_MEASUREMENT", [_name(plan, s, m) for m in g])
            for s, g in _groups(plan).items() if s != "param"
        },
    }  # fmt: skip
    for title, (key, listed) in names.items():
        if listed:
            inner = f"/begin {key} {' '.join(listed)} /end {key}"
            blocks.append(f'/begin GROUP {plan.name}_{title} "{title}" ROOT {inner}\n/end GROUP')
    body = "\n".join(blocks)
    return f"""ASAP2_VERSION 1 71
/begin PROJECT {plan.name} {_quoted(first_sentence(plan.block.doc) or plan.block.name)}
/begin HEADER "written by slipctl {__version__}, content {CONTENT}"
/end HEADER
/begin MODULE {plan.name}_module ""
/begin MOD_COMMON "" BYTE_ORDER MSB_LAST ALIGNMENT_FLOAT64_IEEE 8
/end MOD_COMMON
{body}
/end MODULE
/end PROJECT
"""


def _groups(plan: Plan) -> dict[str, tuple[Member, ...]]:
    """Members by struct; of the state those that lie before what is derived and held."""
    lay = plan.layout
    return dict(zip(_STRUCTS, (lay.inputs, lay.params, lay.states, lay.outputs), strict=True))


def _name(plan: Plan, struct: str, m: Member) -> str:
    """Identifier of ASAP2: the symbol and the member, with dots."""
    return f"{plan.name}_{struct}.{m.c}"


def _quoted(text: str) -> str:
    plain = " ".join(spelled(text).split()).replace("\\", "/").replace('"', "'")
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
    return f"\n  MATRIX_DIM {' '.join(map(str, shape))}{layout}"


def _link(plan: Plan, struct: str, offset: int) -> str:
    return f'\n  SYMBOL_LINK "{plan.name}_{struct}_instance" {offset}'


def _characteristic(plan: Plan, m: Member, offset: int, methods: dict[str, str]) -> str:
    kind = "VALUE" if m.scalar else "VAL_BLK"
    return (
        f"/begin CHARACTERISTIC {_name(plan, 'param', m)} {_about(m)}\n"
        f"  {kind} 0x{offset:X} RL_VALUE 0 {methods[m.signal.unit]} {_limits(plan, m)}"
        f"{_dims(m)}{_link(plan, 'param', offset)}\n/end CHARACTERISTIC"
    )


def _measurement(
    plan: Plan, struct: str, m: Member, offset: int, methods: dict[str, str], kind: str
) -> str:
    return (
        f"/begin MEASUREMENT {_name(plan, struct, m)} {_about(m)}\n"
        f"  {kind} {methods[m.signal.unit]} 0 0 {_limits(plan, m)}\n  ECU_ADDRESS 0x{offset:X}"
        f"{_dims(m, True)}{_link(plan, struct, offset)}\n/end MEASUREMENT"
    )
