"""Functions of the C of a tick that may be made in two parts, and the taking of its results."""

from __future__ import annotations

from collections.abc import Sequence

from slipctl.ccode.module import guard
from slipctl.ccode.module.guard_functions import early_good, finite_calls
from slipctl.ccode.module.header import prototypes
from slipctl.ccode.module.layout import Member
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import define, expression, if_


def equations_call(plan: Plan, seen: str) -> str:
    """Call of the equations on the inputs that they see."""
    lay, following = plan.layout, "&state->next" if plan.next_in_state else "&next"
    given = [seen, "used", *["&state->derived"] * bool(lay.derived)]
    given += ["&state->kept", following] * bool(lay.states) + ["&now"]
    return f"equations({', '.join([*given, *['&state->work'] * plan.work_in_state])})"


def take_state(plan: Plan, members: Sequence[Member]) -> list[str]:
    """Statements that take the next state, or some of it."""
    following = "state->next" if plan.next_in_state else "next"
    if len(members) == len(plan.layout.states):
        return [f"state->kept = {following};"] * bool(members)
    return [
        f"state->kept.{m.c} = {following}.{m.c};" if m.scalar
        else f"copy(state->kept.{m.c}, {following}.{m.c}, {m.size});"
        for m in members
    ]  # fmt: skip


def prepare(plan: Plan) -> list[Node]:
    """Function that makes the first part of a tick, where it may be made in two."""
    if plan.block.composition.split is None:
        return []
    n, big = plan.name, plan.layout.big
    only = plan.state_named(plan.block.composition.split.only).c
    following = "state->next" if plan.next_in_state else "next"
    ends, good = early_good(plan)
    refused = f"(int){big}_REFUSED"
    in_force = {"param": c.name("used"), "derived": expression("state->derived")}

    def rule(x: Node) -> Node | None:
        place = in_force.get(x.parts[0].head) if x.kind == "member" else None
        sign = "." if place is not None and place.kind == "member" else "->"
        return None if place is None else Node("member", sign + x.head[2:], (place,))

    lines: list[str | Node] = ["(void)param; /* those in force are used */"]
    lines += [f"{n}_out now;"] + [f"struct {n}_kept next;"] * (not plan.next_in_state)
    lines.append(f"const {n}_param *const used = &state->in_force;")
    unset = f"state->guard.mark != {guard.MARK_NAME}"
    lines.append(if_(unset, f"return (int){big}_NO_INIT | {refused};"))
    lines += [line.change(rule) for line in ends]
    if good:
        tested = if_(f"!({good})", f"return (int){big}_OFF_RANGE | {refused};")
        lines.append(tested.change(rule))
    call = f"{equations_call(plan, 'in')};"
    tests = ["(failed != 0)"] * plan.can_fail
    tests += [f"!{tested}" for tested in finite_calls(plan, [f"&{following}", "&now"]).values()]
    lines += [
        f"state->kept.{only} = 1.0;",
        f"const int failed = {call}" if plan.can_fail else call,
        f"state->kept.{only} = 0.0;",
        *([if_(" || ".join(tests), f"return (int){big}_BAD_RESULT | {refused};")] * bool(tests)),
        *take_state(plan, plan.layout.states),
        f"return {big}_OK;",
    ]  # fmt: skip
    return [define(prototypes(plan)["prepare"], lines)]
