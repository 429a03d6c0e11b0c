"""The test that goes with a module: a C program that replays vectors, and the vectors."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping

import numpy as np

from slipctl.ccode.check.vectors.expected_outputs import Expected, last_states
from slipctl.ccode.check.vectors.misuse import misuse
from slipctl.ccode.compile.state_numbers import numbers_of
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module import rates
from slipctl.ccode.module.comments import ascii_text
from slipctl.ccode.module.header import CONTENT, STATUS, bit, head
from slipctl.ccode.module.layout import c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.expressions import number

ENOUGH, AT_LEAST = 2e10, 1000
"""Instructions after which a board has replayed enough, some minutes of emulation, and ticks that
it replays anyhow. A windowed estimator in double takes 7e6 a tick on a Cortex-M4."""


def compared_bits(real: str) -> int:
    """Bits of the status that are compared: in float, a limit may be met in another tick."""
    return sum(v for _, v, _ in STATUS) - (bit("LIMITED") if real == "float" else 0)


def test_program(plan: Plan) -> str:
    """Text of the program that replays the vectors and compares."""
    lay, ends = plan.layout, [plan.limits(m) for m in plan.layout.inputs for _ in range(m.size)]
    words, n_signals = lay.words(plan.real), len(lay.outputs) + len(lay.states)
    n_in, n_param, answers = words["n_in"], words["n_param"], words["n_out"] + words["n_state"]
    judged = plan.judged.astype(bool)
    guarded = np.flatnonzero(~judged)
    first = int(guarded[0]) if guarded.size else 0
    return fill_template(
        "test.c",
        **words, content=CONTENT,
        head=head(plan, f"test_{plan.name}.c"),
        enough=repr(ENOUGH), at_least=AT_LEAST, mask=f"{compared_bits(plan.real)}U",
        n_signals=n_signals, n_limits=2 * n_signals, n_first=n_param + 2 * n_signals,
        n_ends=sum(math.isfinite(v) for pair in ends for v in pair), n_answers=answers,
        n_tick=n_in + answers, n_row=n_in + answers + n_param + 1, n_guarded=guarded.size,
        numbers_given=n_in + n_param, rates=plan.rates, judged=judged.any(), guarded=guarded.size,
        stale=int(plan.stale[first]) if guarded.size else 0, first_guarded=first,
        held="N_GUARDED" if judged.any() else "N_IN",
        of_the_guard=" of the guard" * bool(judged.any()),
        flags=", ".join(str(int(j)) for j in judged),
        ranges=",\n".join(f"    {{{number(lo)}, {number(hi)}}}" for lo, hi in ends),
        names=",\n".join(
            f'    {{"{ascii_text(m.name)}", {m.size}}}' for m in (*lay.outputs, *lay.states)
        ),
        sizes="\n".join(
            f"typedef char {w}_has_no_gaps[(sizeof({plan.name}_{w}) == {size} * sizeof(real)) ?"
            " 1 : -1];"
            for w in ("in", "param", "out") if (size := words[f"n_{w}"])
        ),
        safe="\n".join(
            f"        {m.at('good.', k)} = (real){number(plan.safe[m.c])};"
            for m in lay.outputs if m.c in plan.safe for k in range(m.size)
        ),
        numbers=numbers_of(lay, plan.real), misuse=misuse(plan), pieces=_pieces(plan),
    )  # fmt: skip


def _pieces(plan: Plan) -> str:
    """Statements that make the tick by the steps of its rates."""
    calls = []
    for g in rates.groups(plan) if plan.rates else ():
        call = f"got_pieces = {plan.name}_{g.name}(&in, &param, &pieces, &out_pieces);"
        often = [f"if ((tick % {g.ticks}) == 0) {{", f"    {call}", "}"]
        calls += [call] if g.ticks == 1 else often
    return textwrap.indent("\n".join(calls), " " * 8)


def vectors(
    plan: Plan, content: str, params: Mapping[str, np.ndarray], run: Expected, every: int = 1
) -> str:
    """Text of the vectors: parameters, limits, then status, inputs, outputs, states per tick.

    Args:
        plan, params, run: the module, its parameters, what it is to give.
        content: hash of its texts.
        every: ticks from one that has states to the next; the last tick has them too.
    """
    flat = [v for m in plan.layout.params for v in c_elements(m, params[m.name])]
    members = [*plan.layout.outputs, *plan.layout.states]  # an output and a state may share a name
    sizes = f"{len(flat)} {len(members)} {len(run.rows)} {every}"
    lines = [f"slipctl-vectors 4 {plan.name} {content} text {sizes}"]
    lines += [repr(float(v)) for v in flat]
    lines += [f"{float(run.limits[m.name])!r} {int(m.name in run.envelope)}" for m in members]
    whole = last_states(len(run.rows), every) == np.arange(len(run.rows))
    for k, status in enumerate(run.status.tolist()):  # as objects all take five times the memory
        row = np.hstack([run.rows[k], run.outputs[k], *([run.states[k]] if whole[k] else ())])
        lines.append(" ".join(map(repr, [status, *row.tolist()])))
    return "\n".join(lines) + "\n"
