"""Where the linker puts what a module holds: tables, and an instance of its parameters."""

from __future__ import annotations

import re

from slipctl.ccode.compile.files import c_number
from slipctl.ccode.module.comments import comment
from slipctl.ccode.module.header import head
from slipctl.ccode.module.layout import Member, c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.scratch import attribute
from slipctl.errors import BadInput

_NAME = re.compile(r"[\w.$,\- ]{1,60}")


def check(option: str, section: str) -> None:
    """Refuse what cannot name a section.

    Raises:
        BadInput: with what can.
    """
    if not _NAME.fullmatch(section):
        raise BadInput(f"{option} {section!r} names no section; write one such as .calibration")


def calibration(plan: Plan, section: str) -> dict[str, str]:
    """Text of the files with one instance of the parameters, at their defaults, by name.

    It has the name that the A2L file gives it, so a calibration tool finds it in the ELF file.
    """
    n, big, name = plan.name, plan.layout.big, f"{plan.name}_calibration"
    said = (
        f"Parameters of one instance, in the section {section}; a calibration tool writes them"
        f" there. Give it to {n}_init, {n}_tune and {n}_step."
    )
    if plan.layout.params:
        values = ",\n".join(f"    .{m.c} = {_value(plan, m)}" for m in plan.layout.params)
    else:
        values = f"    .unused = {c_number(0.0, plan)}"
    guard, cpp = f"{big}_CALIBRATION_H", '#ifdef __cplusplus\nextern "C" {\n#endif'
    return {
        f"{name}.h": f"{head(plan, f'{name}.h')}\n\n#ifndef {guard}\n#define {guard}\n\n"
        f'#include "{n}.h"\n\n{cpp}\n\n{comment(said)}\n'
        f"extern const {n}_param {n}_param_instance;\n\n"
        "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
        f"{name}.c": f'{head(plan, f"{name}.c")}\n\n#include "{name}.h"\n\n'
        f"const {n}_param {n}_param_instance {attribute(section)} = {{\n{values}\n}};\n",
    }


def _value(plan: Plan, m: Member) -> str:
    numbers = [c_number(float(v), plan) for v in c_elements(m, m.signal.value)]
    return numbers[0] if m.scalar else f"{{{', '.join(numbers)}}}"
