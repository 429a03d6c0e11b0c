"""The part of a module's own test that uses it wrongly: what its vectors, a good run, never do.

It runs on the host alone, after the vectors. Nothing of it is compared with Python: it looks at
what docs/c_interface.md promises of parameters, states, calls and inputs that are wrong.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

import numpy as np

from slipctl.ccode.compile.state_numbers import take_numbers
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.expressions import number

WALK, BETWEEN = 2000, 20
"""Ticks with inputs that wander through all of their ranges, and as many with states that are
shaken once in so many ticks: a part that runs every few ticks sees them."""

SHAKEN = WALK + 4000
"""Ticks with states, parameters and inputs that are shaken; after the first of them once in as many
ticks as every part runs in."""

FAR = 1e6
"""Where an input without an end turns round."""

STEPS = 4000
"""Steps after which no further state is broken: one of a predictive controller takes long."""


def misuse(plan: Plan) -> str:
    """C of ``misused``, for the test program; it needs ``copied`` and ``same``."""
    lay = plan.layout
    places = [sum(m.size for m in lay.states[:k]) for k in range(len(lay.states))]
    recovery = guard.PATIENCE * (len(plan.parts) + 2) + 1
    memory = int(guard.memory(plan.period, plan.stale))
    ends = [
        "{" + ", ".join(number(min(max(v, -1e30), 1e30)) for v in plan.limits(m)) + "}"
        for m in lay.params for _ in range(m.size)
    ]  # fmt: skip
    return fill_template(
        "misuse.c",
        **lay.words(plan.real), recovery=recovery, taken=memory + 1 + recovery if plan.n_in else 0,
        steps=STEPS, firsts=len(places), shaken=SHAKEN, longer=WALK, most=BETWEEN, ticks=WALK,
        damages=3 * (sum(m.size for m in lay.params) + 1), jumps=4 * plan.n_in, memory=memory,
        least=int(max((ticks for _, ticks in plan.counters), default=1)),  # all parts have run
        places=_rows(map(str, places or [0])), ends=_rows(ends or ["{0.0, 0.0}"]),
        wandered=_rows(input_travel(plan, 0.1)), take=take_numbers(lay, plan.real),
        last="kept->guard.last" if plan.n_in else "{0}",
        coupled=plan.coupled, counter=plan.counter,
        counters=bool(plan.counters), late=plan.n_in or plan.counters,
    )  # fmt: skip


def input_travel(plan: Plan, most: float) -> list[str]:
    """Ends of each input element and its largest change, with the defaults of the parameters.

    Args:
        plan: the module.
        most: largest change over the width of the range, where none is declared or a larger one.
    """
    lows, highs, change, noise = plan.ends(plan.layout.inputs, plan.block.param_values())
    rows, steps = [], np.minimum(change, FAR) + noise
    for lo, hi, step in zip(lows.clip(-FAR, FAR), highs.clip(-FAR, FAR), steps, strict=True):
        found = (lo, hi, min(step, most * (hi - lo)))
        rows.append("{" + ", ".join(number(float(v)) for v in found) + "}")
    return rows


def _rows(numbers: Iterable[str]) -> str:
    """Numbers of a table on lines of their own."""
    text = textwrap.fill(", ".join(numbers), 90, break_long_words=False)
    return "\n" + textwrap.indent(text, "    ") + "\n"
