"""C of an FMU: the interface of FMI 2.0 or 3.0 for Co-Simulation, around init, tune and step.

The text lies in ``templates``. Its declarations are our own, written from the
specifications, so that the sources compile with nothing beside them. What a sampled module cannot
do (Model Exchange, derivatives, clocks) is there and refuses.
"""

from __future__ import annotations

import casadi as ca

from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.ccode.compile.files import input_values
from slipctl.ccode.compile.state_numbers import numbers_of, take_numbers
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.guard_functions import range_condition
from slipctl.ccode.module.header import head
from slipctl.ccode.module.layout import Member, dense_value, matrix, spans
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.part_structs import nest_states
from slipctl.ccode.passes.precision import in_precision
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import Writer, number
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import expression
from slipctl.ccode.tree.printer import file_text, lines_of


def interface(plan: Plan, version: int, token: str, now: bool) -> str:
    """Text of ``fmi2.c`` or ``fmi3.c``.

    Args:
        plan: the module.
        version: of FMI, 2 or 3.
        token: what the description and the binary must agree on.
        now: outputs are those of the present state and inputs, not those of the last tick.
    """
    file = f"fmi{version}.c"
    return fill_template(
        file, head=head(plan, file), core=core(plan, token, now).strip(), n=plan.name
    )


def core(plan: Plan, token: str, now: bool) -> str:
    """Text that both versions of the interface share."""
    lay = plan.layout
    words = lay.words(plan.real)
    places = (
        ("n_in", "k < FIRST_PARAM", "in", "k"),
        ("n_param", "k < FIRST_DERIVED", "param", "k - FIRST_PARAM"),
        ("n_derived", "k < FIRST_STATE", "state.derived", "k - FIRST_DERIVED"),
        ("n_state", "k < FIRST_OUT", "seen", "k - FIRST_STATE"),
        ("n_out", "k < STATUS", "out", "k - FIRST_OUT"),
    )
    lines: list[str] = []
    for count, condition, member, at in places:
        if words[count]:
            word = "    if" if not lines else "    } else if"
            lines += [f"{word} ({condition}) {{", f"        found = (real *)&m->{member} + ({at});"]
    lines += ["    }"] if lines else ["    (void)m;", "    (void)k;"]
    starts = _starts(plan)
    tests = [
        expression(f"!{range_condition(plan, m, 'm->state.kept.')}")
        for m in lay.states
        if lay.kind(m, plan.real) == plan.real
    ]

    def real(n: Node) -> Node:
        return in_precision(nest_states(lay, n), plan.real, plan.block.name)

    return fill_template(
        "fmu.c", **words, token=token, now=int(now),
        access=numbers_of(lay, plan.real) + take_numbers(lay, plan.real),
        period=number(plan.period) if plan.period else "0.0", places="\n".join(lines),
        inputs=input_values(plan, "m->in."), starts="\n".join(lines_of(map(real, starts), " " * 8)),
        helpers=file_text(map(real, helpers([*starts, *tests]))),
        wrong="\n            || ".join(real(t).text for t in tests) or "false",
    )  # fmt: skip


def _starts(plan: Plan) -> list[Node]:
    """Statements that compute the start values that were not set from those that were.

    ``init`` of the module computes them from its own start values only. Each is computed after
    those that it uses.
    """
    block, lay = plan.block, plan.layout
    groups = ((lay.params, "m->param."), (lay.derived, "m->state.derived."),
              (lay.states, "m->state.kept."))  # fmt: skip
    places = {m.name: (m, pointer) for group, pointer in groups for m in group}
    symbols = {n: ca.SX.sym("x", *matrix(m.signal)) for n, (m, _) in places.items()}
    first = {m.name: here.start for m, here in spans(lay.states)}
    waiting = [m for m in lay.states if m.signal.derived]
    lines = list[Node]()
    while waiting:
        for m in list(waiting):
            value = str(m.signal.value)
            used = {k: block._sibling(m.name, k) for k in names_in(value)}
            if not set(used.values()).isdisjoint(w.name for w in waiting):
                continue
            result = evaluate(value, {k: symbols[n] for k, n in used.items()}, m.name)
            names = list(dict.fromkeys(used.values()))
            f = ca.Function("start", [symbols[n] for n in names],
                            [dense_value(block, m.signal, ca.SX(result))],
                            {"cse": True})  # fmt: skip
            writer = _written(f, [places[n] for n in names])
            lines.append(_if_not_given(first[m.name], m, writer))
            waiting.remove(m)
    return lines


def _written(f: ca.Function, places: list[tuple[Member, str]]) -> Writer:
    return Writer(f, lambda i, k: places[i][0].node(places[i][1], k)).run()


def _if_not_given(first: int, m: Member, writer: Writer) -> Node:
    """Statements that give a state, whose elements count from ``first``, its start value."""
    at = dict(writer.results)
    return c.block([*writer.lines, *(
        c.branch(expression(f"!m->given[{first + k}]"),
                 [c.assign(m.node("m->state.kept.", k), writer.result(at[0, k]))])
        for k in range(m.size)
    )])  # fmt: skip
