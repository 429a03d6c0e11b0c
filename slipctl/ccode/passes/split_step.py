"""Functions of the C of a tick that may be made in two parts, and the taking of its results."""

from __future__ import annotations

import re
from collections.abc import Sequence

from slipctl.ccode.module import guard
from slipctl.ccode.module.guard_functions import early_good
from slipctl.ccode.module.header import prototypes
from slipctl.ccode.module.layout import Member
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.expressions import number
from slipctl.ccode.tree.statements import define, if_


def in_place(plan: Plan, lines: list[str]) -> list[str]:
    """Statements with calls that write where their result is copied to, and only to there."""
    text = "\n".join(lines)
    copies = re.findall(r"^    copy\((\w+->\w+), (r\d+), (\d+)\);$", text, re.M)
    for to, local, n in copies:
        if len(re.findall(rf"\b{local}\b", text)) != 3:
            continue  # read elsewhere too
        steps = (f"    double {local}[{n}];", f"    copy({to}, {local}, {n});")
        text = "\n".join(line for line in text.split("\n") if line not in steps)
        text = re.sub(rf"= {local};", f"= {to};", text)
    for m in plan.ahead:  # what is prepared is not written again
        text = text.replace(f"= next->{m.c};", f"= ({due(plan)}) ? next->{m.c} : NULL;")
    return text.split("\n")


def equations_call(plan: Plan, seen: str) -> str:
    """Call of the equations on the inputs that they see."""
    lay, following = plan.layout, "&state->next" if plan.next_in_state else "&next"
    given = [seen, "used", *["&state->derived"] * bool(lay.derived)]
    given += ["&state->kept", following] * bool(lay.states) + ["&now"]
    return f"equations({', '.join([*given, *['&state->work'] * plan.work_in_state])})"


def due(plan: Plan) -> str:
    """Condition that the equations prepare, not only go on from what is prepared."""
    split = plan.block.composition.split
    assert split is not None
    only, prepared = (plan.state_named(n).c for n in (split.only, split.prepared))
    return f"(state->{only} > 0.0) || !(state->{prepared} > 0.0)"


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


def prepare(plan: Plan) -> str:
    """Function that makes the first part of a tick, where it may be made in two."""
    if plan.block.composition.split is None:
        return ""
    n, big = plan.name, plan.layout.big
    only = plan.state_named(plan.block.composition.split.only).c
    following = "state->next" if plan.next_in_state else "next"
    ends, good = early_good(plan)
    refused = f"(int){big}_REFUSED"
    lines = ["(void)param; /* those in force are used */"]
    lines += [f"{n}_out now;"] + [f"struct {n}_kept next;"] * (not plan.next_in_state)
    lines.append(f"const {n}_param *const used = &state->in_force;")
    lines.append(
        if_([f"!(state->guard.mark == {number(guard.MARK)})"],
            f"return (int){big}_NO_INIT | {refused};")
    )  # fmt: skip
    lines += [
        line.replace("param->", "used->").replace("derived->", "state->derived.") for line in ends
    ]
    if good:
        good = good.replace("param->", "used->").replace("derived->", "state->derived.")
        lines.append(if_([f"!({good})"], f"return (int){big}_OFF_RANGE | {refused};"))
    call = f"{equations_call(plan, 'in')};"
    tests = ["(failed != 0)"] * plan.can_fail + [f"!result_finite(&{following}, &now)"]
    lines += [
        f"state->kept.{only} = 1.0;",
        f"const int failed = {call}" if plan.can_fail else call,
        f"state->kept.{only} = 0.0;",
        if_([" || ".join([*tests, f"!ahead_finite(&{following})"])],
            f"return (int){big}_BAD_RESULT | {refused};"),
        *take_state(plan, plan.layout.states),
        f"return {big}_OK;",
    ]  # fmt: skip
    return define(prototypes(plan)["prepare"], lines)
