"""A step function for each rate of a controller, beside the one step.

Parts that run every few ticks stand between others in the order of the wires. So a tick is a row of
groups: the parts of one rate, then those of the next. Each group is a function. Called in their
order they do what the step does, to the bit, with the same guards. The first one looks at the
inputs, the last one takes or refuses the tick.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from slipctl.ccode.module import guard
from slipctl.ccode.module.comments import comment
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.wires import POINTERS
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import number
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import define, if_
from slipctl.ccode.tree.printer import signature
from slipctl.errors import BadInput


class Group(NamedTuple):
    """Parts of one rate that run one behind the other.

    Attributes:
        name: of their step, without that of the module, ``step_5ms``.
        ticks: from one run to the next.
        calls: of the parts.
    """

    name: str
    ticks: int
    calls: tuple[Node, ...]


def groups(plan: Plan) -> tuple[Group, ...]:
    """Groups of a tick, in order; the last one has the rate of the step, if only to end the tick.

    Raises:
        BadInput: all parts have one rate, or the controller is not written by parts.
    """
    made = plan.equations
    if made.static:
        raise BadInput(
            f"--rates: {plan.block.name} has a solver of CasADi, which may fail; leave it out"
        )
    rates = [made.ticks.get(called_function(line), 1) for line in made.lines]
    if set(rates) <= {1}:
        why = "; its copies run every few ticks, but each in another tick" * bool(plan.counters)
        raise BadInput(f"--rates: all of {plan.block.name} runs in every tick{why}; leave it out")
    waits = _waits(made.lines, made.functions)
    orders = [_order(rates, waits, first) for first in dict.fromkeys(rates)]
    rows = [_rows(order, rates) for order in orders if order]
    rows = [row if row[-1][0] == 1 else [*row, (1, [])] for row in rows]
    best = min(rows, key=len)
    found: list[Group] = []
    for ticks, places in best:
        name = f"step_{_rate(plan, ticks)}"
        before = sum(g.ticks == ticks for g in found)
        name += f"_{before + 1}" if before else ""
        found.append(Group(name, ticks, tuple(made.lines[k] for k in places)))
    return tuple(found)


def called_function(line: Node) -> str:
    """Function that a line of the equations calls, in a loop over copies too."""
    return next((n.head for n in line.walk() if n.kind == "call"), "")


def _rate(plan: Plan, ticks: int) -> str:
    """``5ms``, ``200us``, or ``every_5`` where no period is known."""
    if not plan.period:
        return f"every_{ticks}"
    for unit, size in (("ms", 1e-3), ("us", 1e-6)):
        many = ticks * plan.period / size
        if round(many) and math.isclose(many, round(many), rel_tol=1e-9):
            return f"{round(many)}{unit}"
    return f"every_{ticks}"


def _waits(calls: Sequence[Node], functions: Mapping[str, Node]) -> list[set[int]]:
    """Earlier calls that each call has to wait for: those that write what it reads, or reverse.

    A member of ``now`` or ``next`` is written where it first appears, where it stands to the left
    of ``=``, and where it is passed on whole.
    """
    bodies = [_with_called(call, functions) for call in calls]
    members = [{n.text for n in _members(b)} for b in bodies]
    waits: list[set[int]] = []
    seen: set[str] = set()
    writes: list[set[str]] = []
    for k, body in enumerate(bodies):
        writes.append({m for m in members[k] if m not in seen} | _written(body))
        seen |= members[k]
        waits.append({
            j for j in range(k)
            if writes[j] & members[k] or members[j] & writes[k]
        })  # fmt: skip
    return waits


def _with_called(call: Node, functions: Mapping[str, Node]) -> list[Node]:
    """A call with the statements of what it calls, and of what that calls."""
    found, left = [call], list(call.calls())
    known: set[str] = set()
    while left:
        name = left.pop()
        if name in functions and name not in known:
            known.add(name)
            found.append(functions[name].parts[1])
            left += found[-1].calls()
    return found


def _members(nodes: Sequence[Node]) -> list[Node]:
    """Members of ``now`` and ``next``."""
    return [n for x in nodes for n in x.walk() if _is_member(n)]


def _is_member(n: Node) -> bool:
    return n.kind == "member" and n.parts[0] in (c.name("now"), c.name("next"))


def _written(nodes: Sequence[Node]) -> set[str]:
    """Members that may be written: they are assigned to, or passed on."""
    found: set[str] = set()
    for n in (n for x in nodes for n in x.walk()):
        given = n.parts if n.kind == "call" else n.parts[:1] if n.head in ("=", "&") else ()
        found |= {p.base.text for p in given if p.kind != "index" or n.kind != "call"}
    return found


def _order(rates: Sequence[int], waits: Sequence[set[int]], first: int) -> list[int]:
    """Calls in an order that keeps what waits for what, with few changes of the rate."""
    order: list[int] = []
    rate, done = first, set[int]()
    while len(order) < len(rates):
        ready = [k for k in range(len(rates)) if k not in done and waits[k] <= done]
        now = [k for k in ready if rates[k] == rate]
        if not now:
            if not order:
                return []  # nothing of this rate can come first
            rate = rates[ready[0]]
            continue
        order.append(now[0])
        done.add(now[0])
    return order


def _rows(order: Sequence[int], rates: Sequence[int]) -> list[tuple[int, list[int]]]:
    rows: list[tuple[int, list[int]]] = []
    for k in order:
        if not rows or rows[-1][0] != rates[k]:
            rows.append((rates[k], []))
        rows[-1][1].append(k)
    return rows


# ---- text ---------------------------------------------------------------------------------------


def prototypes(plan: Plan) -> dict[str, str]:
    """Declarations of the steps of the groups, by their short names."""
    n = plan.name
    return {
        g.name: signature("int", f"{n}_{g.name}", [
            f"const {n}_in *in", f"const {n}_param *param", f"{n}_state *state", f"{n}_out *out"])
        for g in groups(plan)
    }  # fmt: skip


def rate_docs(plan: Plan) -> dict[str, str]:
    """What the header says of each."""
    row = groups(plan)
    listed = ", ".join(f"{plan.name}_{g.name}" for g in row)
    found = {}
    for k, g in enumerate(row):
        when = "every tick" if g.ticks == 1 else f"every {g.ticks}th tick"
        parts = (
            ", ".join(n for x in g.calls if (n := called_function(x)) not in ("", "copy"))
            or "no part"
        )
        found[g.name] = (
            f"A piece of the tick: {parts}; for {when}. Together, in the order {listed}, they do"
            f" what {plan.name}_step does, to the bit. What is left out the next of them does."
        )
        if k == len(row) - 1:
            found[g.name] += " This one ends the tick: status and outputs are those of step."
        else:
            found[g.name] += " Outputs are left alone; the status is what is known so far."
    return found


TICK = """struct {n}_tick {{
        {n}_out now; /* outputs so far */
        {real} done; /* groups of parts that are done, 0 where no tick is in hand */
        {real} status; /* what the inputs gave */
    }}"""
"""Struct of a tick in hand."""


def functions(
    plan: Plan, looked: Sequence[str], rest: Sequence[str | Node], hold: Sequence[str]
) -> list[Node]:
    """Functions of the groups, and the step, which is the last of them at the begin of a tick.

    Args:
        plan: the module.
        looked: statements that look at the inputs, ``status`` among them.
        rest: statements that take or refuse the tick, with ``used``, ``status`` and ``now``.
        hold: statements that give the outputs of a tick that is refused.
    """
    n, big = plan.name, plan.layout.big
    row = groups(plan)
    made = [_go_on(plan, row, looked)]
    texts = prototypes(plan)
    for k, g in enumerate(row[:-1], start=1):
        body = ["(void)param; /* those in force are used */", "(void)out;",
                f"return (int)go_on(in, state, {number(float(k))});"]  # fmt: skip
        made.append(define(texts[g.name], body))
    nothing = "start_outputs(out);" if plan.layout.outputs else "out->unused = 0.0;"
    end: list[str | Node] = [
        "(void)param; /* those in force are used */",
        f"const {n}_param *const used = &state->in_force;",
        f"{n}_out now;",
        f"unsigned int status = go_on(in, state, {number(float(len(row)))});",
        if_(f"(status & (unsigned int){big}_NO_INIT) != 0U", nothing, "return (int)status;"),
        "state->tick.done = 0.0;",
        if_(f"(status & (unsigned int){big}_REFUSED) != 0U", *hold, "return (int)status;"),
        "now = state->tick.now;",
        *rest,
    ]
    made.append(define(texts[row[-1].name], end))
    return [*_groups(plan, row), *made]


def step(plan: Plan) -> list[str]:
    """Body of the one step: the last function, as nothing of the tick is done."""
    return [
        "state->tick.done = 0.0;",
        f"return {plan.name}_{groups(plan)[-1].name}(in, param, state, out);",
    ]


def _used(g: Group) -> list[str]:
    """Structs that the parts of a group take."""
    used = c.variables(g.calls)
    return [p for p in POINTERS if p in used]


def _groups(plan: Plan, row: Sequence[Group]) -> list[Node]:
    """A static function for each group that has parts."""
    found = []
    for g in row:
        if g.calls:
            what = comment("Parts that run " + (
                "in every tick." if g.ticks == 1 else f"every {g.ticks}th tick."))  # fmt: skip
            given = [plan.types[p] for p in _used(g)]
            found.append(define(f"static void parts_of_{g.name}", g.calls, what, given))
    return found


def _go_on(plan: Plan, row: Sequence[Group], looked: Sequence[str]) -> Node:
    n, big = plan.name, plan.layout.big
    place = {"in": "seen" if plan.layout.inputs else "in", "param": "used",
             "derived": "&state->derived", "state": "&state->kept", "next": "&state->next",
             "now": "&state->tick.now", "work": "&state->work"}  # fmt: skip
    calls = list[Node]()
    for k, g in enumerate(row):
        if g.calls:
            call = f"parts_of_{g.name}({', '.join(place[p] for p in _used(g))});"
            condition = f"state->tick.done < {number(k + 1.0)}"
            if k:
                condition = f"({condition}) && (groups > {number(float(k))})"
            calls.append(if_(condition, call))
    used = {p for g in row for p in _used(g)}
    struct = {
        "in": [f"const {n}_in *const seen = &state->guard.last;"] * bool(plan.layout.inputs),
        "param": [f"const {n}_param *const used = &state->in_force;"],
    }
    begin = [*looked, "state->tick.status = (double)status;", "state->tick.done = 0.0;",
             "state->next = state->kept;"]  # fmt: skip
    lines: list[str | Node] = [
        *(line for p, declared in struct.items() if p in used for line in declared),
        *["(void)in;"] * (not plan.layout.inputs and "in" not in used),
        "unsigned int status;",
        if_(f"state->guard.mark != {guard.MARK_NAME}",
            f"return (unsigned int){big}_NO_INIT | (unsigned int){big}_REFUSED;"),
        if_("!((state->tick.done >= 1.0) && (state->tick.done < groups))", *begin),
        "status = (unsigned int)(int)state->tick.status;",
        if_(f"(status & (unsigned int){big}_REFUSED) == 0U", *calls),
        "state->tick.done = groups;",
        "return status;",
    ]  # fmt: skip
    what = comment(
        "Go on with the tick in hand until so many groups of parts are done. Begin one if there"
        " is none or it has come as far already. Gives what is known of its status."
    )
    given = [f"const {n}_in *in", f"{n}_state *state", "double groups"]
    return define("static unsigned int go_on", lines, what, given)
