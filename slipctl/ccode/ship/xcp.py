"""An XCP slave beside a module, and a program for the emulated board that offers it a serial line.

A tool measures and calibrates the instances that the A2L file names, ``ctl_param_instance`` and so
on. Frames are those of XCP on a serial line (SxI) with a header of length and counter, a byte each.
"""

from __future__ import annotations

from slipctl.ccode.compile.files import input_values
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.header import head
from slipctl.ccode.module.plan import Plan

FILES = ("xcp.h", "xcp.c")


def texts(plan: Plan) -> dict[str, str]:
    """Text of each file by name."""
    n = plan.name
    given = input_values(plan, f"{n}_in_instance.") or f"    {n}_in_instance.unused = 0;"
    board = fill_template(
        "xcp_board.c", n=n, big=plan.layout.big, head=head(plan, "xcp_board.c"), given=given
    )
    return {**{name: fill_template(name) for name in FILES}, "xcp_board.c": board}
