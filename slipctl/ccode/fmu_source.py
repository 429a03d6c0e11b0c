"""C of an FMU: the interface of FMI 2.0 or 3.0 for Co-Simulation, around init, tune and step.

The text lies in ``slipctl/templates``. Its declarations are our own, written from the
specifications, so that the sources compile with nothing beside them. What a sampled module cannot
do (Model Exchange, derivatives, clocks) is there and refuses.
"""

from __future__ import annotations

import re
from pathlib import Path

from slipctl.ccode.expressions import number
from slipctl.ccode.files import spoken, starting
from slipctl.ccode.header import head
from slipctl.ccode.plan import Plan

TEMPLATES = Path(__file__).parent.parent / "templates"


def _template(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def interface(plan: Plan, version: int, token: str, now: bool) -> str:
    """Text of ``fmi2.c`` or ``fmi3.c``.

    Args:
        plan: the module.
        version: of FMI, 2 or 3.
        token: what the description and the binary must agree on.
        now: outputs are those of the present state and inputs, not those of the last tick.
    """
    file = f"fmi{version}.c"
    parts = (head(plan, file), core(plan, token, now), _template(file))
    return "\n\n".join(p.strip() for p in parts) + "\n"


def core(plan: Plan, token: str, now: bool) -> str:
    """Text that both versions of the interface share."""
    lay = plan.layout
    counts = {
        k: sum(m.size for m in g)
        for k, g in (
            ("n_in", lay.inputs), ("n_param", lay.params), ("n_derived", lay.derived),
            ("n_state", lay.states), ("n_out", lay.outputs),
        )
    }  # fmt: skip
    places = (
        ("n_in", "k < FIRST_PARAM", "in", "k"),
        ("n_param", "k < FIRST_DERIVED", "param", "k - FIRST_PARAM"),
        ("n_derived", "k < FIRST_STATE", "state.derived", "k - FIRST_DERIVED"),
        ("n_state", "k < FIRST_OUT", "state", "k - FIRST_STATE"),
        ("n_out", "k < STATUS", "out", "k - FIRST_OUT"),
    )
    lines: list[str] = []
    for count, condition, member, at in places:
        if counts[count]:
            word = "    if" if not lines else "    } else if"
            lines += [f"{word} ({condition}) {{", f"        found = (real *)&m->{member} + ({at});"]
    lines += ["    }"] if lines else ["    (void)m;", "    (void)k;"]
    inputs = [
        f"    {m.at('m->in.', k)} = {spoken(v, plan)};"
        for m in lay.inputs for k, v in enumerate(starting(m))
    ]  # fmt: skip
    filled = {
        "n": plan.name, "big": lay.big, "real": plan.real, "token": token, "now": int(now),
        "period": number(plan.period) if plan.period else "0.0", "places": "\n".join(lines) + "\n",
        "inputs": "".join(f"{line}\n" for line in inputs), **counts,
    }  # fmt: skip
    return re.sub(r"@(\w+)@", lambda m: str(filled[m[1]]), _template("fmu.c"))
