"""An XCP slave beside a module, and a program for the emulated board that offers it a serial line.

A tool measures and calibrates the instances that the A2L file names, ``ctl_param_instance`` and so
on. Frames are those of XCP on a serial line (SxI) with a header of length and counter, a byte each.
"""

from __future__ import annotations

from pathlib import Path

from slipctl.ccode.compile.files import c_number, start_elements
from slipctl.ccode.module.header import head
from slipctl.ccode.module.plan import Plan

FILES = ("xcp.h", "xcp.c")


_INSTANCES = ("param", "in", "state", "out", "status")
"""What the tool sees, in this order; it writes parameters and inputs."""


def texts(plan: Plan) -> dict[str, str]:
    """Text of each file by name."""
    folder = Path(__file__).with_name("templates")
    slave = {name: (folder / name).read_text(encoding="utf-8") for name in FILES}
    return {**slave, "xcp_board.c": _board(plan)}


def _instances(plan: Plan) -> tuple[str, str, str]:
    """Start values of the inputs, regions that a tool may ask for, definition of each instance."""
    n = plan.name
    values = "\n".join(
        f"    {m.at(f'{n}_in_instance.', k)} = {c_number(v, plan)};"
        for m in plan.layout.inputs for k, v in enumerate(start_elements(m))
    )  # fmt: skip
    regions = "\n".join(
        f"    regions[{k}] = region((unsigned char *)&{n}_{s}_instance,\n"
        f"                        (uint32_t)sizeof({n}_{s}_instance), {written});"
        for k, s in enumerate(_INSTANCES)
        for written in ["true" if s in ("param", "in") else "false"]
    )
    defined = "\n".join(
        f"{'int' if s == 'status' else f'{n}_{s}'} {n}_{s}_instance;" for s in _INSTANCES
    )
    return values, regions, defined


def _board(plan: Plan) -> str:
    n, big = plan.name, plan.layout.big
    values, regions, defined = _instances(plan)
    declared = "\n".join(f"extern {line}" for line in defined.splitlines())
    return f"""{head(plan, "xcp_board.c")}

/* A step after each command of the tool, with the inputs that it has written. */

#include "cortex_m.h"
#include "{n}.h"
#include "xcp.h"

{declared}

{defined}

int main(void);

static xcp_region region(unsigned char *at, uint32_t size, bool writable)
{{
    const xcp_region found = {{(uint32_t)(uintptr_t)at, at, size, writable}};
    return found;
}}

static unsigned char next_byte(void)
{{
    int byte = -1;
    while (byte < 0) {{
        byte = serial_get(0xFFFFFFFFUL);
    }}
    return (unsigned char)byte;
}}

int main(void)
{{
    xcp_region regions[{len(_INSTANCES)}];
    xcp slave = {{regions, {len(_INSTANCES)}U, false, false, 0U}};
    unsigned char command[256];
    unsigned char answer[XCP_LONGEST];
    unsigned char counter = 0U;

{regions}
    serial_start();
    {n}_default(&{n}_param_instance);
    {n}_status_instance = {n}_init(&{n}_param_instance, &{n}_state_instance);
{values or f"    {n}_in_instance.unused = 0;"}
    for (;;) {{
        const unsigned int length = next_byte();
        (void)next_byte(); /* the tool's counter */
        for (unsigned int k = 0U; k < length; ++k) {{
            command[k] = next_byte();
        }}
        const unsigned int size = xcp_answer(&slave, command, length, answer);
        if (slave.written) {{ /* parameters take effect together, if they are good */
            slave.written = false;
            {n}_status_instance = {n}_tune(&{n}_param_instance, &{n}_state_instance);
        }}
        if ({n}_status_instance != {big}_BAD_PARAM) {{
            {n}_status_instance = {n}_step(&{n}_in_instance, &{n}_param_instance,
                                           &{n}_state_instance, &{n}_out_instance);
        }}
        if (size > 0U) {{
            serial_put((unsigned char)size);
            serial_put(counter);
            ++counter;
            for (unsigned int k = 0U; k < size; ++k) {{
                serial_put(answer[k]);
            }}
        }}
    }}
}}
"""
