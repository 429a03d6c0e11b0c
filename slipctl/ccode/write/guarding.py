"""Functions of the C that guard a step: inputs, next states, and what to do when they stay bad."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from slipctl.ccode.write import guard
from slipctl.ccode.write.comments import comment
from slipctl.ccode.write.expressions import number
from slipctl.ccode.write.header import identifier_free, prototype
from slipctl.ccode.write.layout import Member
from slipctl.ccode.write.plan import Plan
from slipctl.ccode.write.statements import conjunction, define, if_


def check_inputs(plan: Plan) -> str:
    """Function that takes what is good of the inputs, and says what was not."""
    n, lay = plan.name, plan.layout
    if not lay.inputs:
        return ""
    lines, ends = plan.ends_text(lay.inputs)
    good = ["(state->guard.fresh > 0.0)", *_all_good(lay.inputs, ends)]
    lines += [
        "unsigned int told = 0U;",
        if_([conjunction(good)], "state->guard.last = *in;", "return told;"),
    ]
    at = 0
    for m in lay.inputs:
        each = [
            ", ".join(
                [
                    *(ends[m.c, k, what] for what in ("lo", "hi", "change")),
                    number(float(m.signal.stale)),
                ]
            )
            for k in range(m.size)
        ]
        if m.size > 1 and len(set(each)) == 1:
            last = f"{m.address('state->guard.last.')}, &state->guard.age[{at}]"
            lines += _call("told |= accept_all(", [m.address("in->"), str(m.size), each[0], last])
        else:
            for k, given in enumerate(each):
                last = f"&{m.at('state->guard.last.', k)}, &state->guard.age[{at + k}]"
                lines += _call("told |= accept(", [m.at("in->", k), given, last])
        at += m.size
    lines.append("state->guard.fresh = (told == 0U) ? 1.0 : 0.0;")
    what = comment("Take the inputs, of one that is bad its last good value; bits of the status.")
    text = "\n".join(lines)
    void = ["(void)param;"] * identifier_free(text, "param")
    signature = prototype(plan, "static unsigned int", "check_inputs", f"const {n}_in *in",
                          f"const {n}_param *param", f"{n}_state *state")  # fmt: skip
    return f"{what}\n" + define(signature, [*void, *lines, "return told;"])


def _all_good(inputs: Iterable[Member], ends: dict[Any, str]) -> list[str]:
    """Conditions that ``accept`` finds each input good, when it did so in the tick before."""
    found = []
    for m in inputs:
        each = [tuple(ends[m.c, k, what] for what in ("lo", "hi", "change")) for k in range(m.size)]
        if m.size > 1 and len(set(each)) == 1:
            rows = [("all_", f"{m.address('in->')}, {m.size}", m.address("state->guard.last."))]
            each = each[:1]
        else:
            rows = [("", m.at("in->", k), m.at("state->guard.last.", k)) for k in range(m.size)]
        for (many, value, last), (lo, hi, change) in zip(rows, each, strict=True):
            found.append(f"{many}within({value}, {lo}, {hi})")
            if change != "DBL_MAX":
                found.append(f"{many}can_follow({value}, {last}, {change})")
    return found


def _call(start: str, arguments: list[str]) -> list[str]:
    """Statement of a call, on two lines if it is long."""
    line = f"{start}{', '.join(arguments)});"
    if len(line) <= 90:
        return [line]
    return [f"{start}{', '.join(arguments[:-1])},", f"        {arguments[-1]});"]


def early_good(plan: Plan) -> tuple[list[str], str]:
    """Statements, and the condition that the inputs which ``prepare`` reads are in their ranges."""
    lines, ends = plan.ends_text(plan.early)
    open_ = {k: "DBL_MAX" if k[2] == "change" else v for k, v in ends.items()}
    return lines, conjunction(_all_good(plan.early, open_))


def part_off(plan: Plan) -> str:
    """Function that says of which part a next state is out of its range."""
    n = plan.name
    members = [m for m in plan.layout.states if plan.ranged(m)]
    if not members:
        return ""
    lines, ends = plan.ends_text(members)
    tests: list[str] = []
    for k, own in enumerate(plan.parts.values(), start=1):
        found: list[str] = []
        for m in own:
            if not plan.ranged(m):
                continue
            each = [f"{ends[m.c, i, 'lo']}, {ends[m.c, i, 'hi']}" for i in range(m.size)]
            if m.scalar:
                found.append(f"within(next->{m.c}, {each[0]})")
            elif len(set(each)) == 1:
                found.append(f"all_within(next->{m.c}, {m.size}, {each[0]})")
            else:
                found += [f"within({m.at('next->', i)}, {e})" for i, e in enumerate(each)]
        if found:
            tests.append(if_([f"!({conjunction(found)})"], f"return {k};"))
    text = "\n".join([*lines, *tests])
    void = [f"(void){a};" for a in ("param", "state") if identifier_free(text, a)]
    what = comment("The first part of which a next state is out of its range, 0 for none.")
    signature = prototype(plan, "static int", "part_off", f"const struct {n}_next *next",
                          f"const {n}_param *param", f"const {n}_state *state")  # fmt: skip
    return f"{what}\n" + define(signature, [*void, *lines, *tests, "return 0;"])


def recover(plan: Plan) -> str:
    """Function that counts refused ticks and resets parts of the state when they are too many."""
    n, parts = plan.name, len(plan.parts)
    if not parts:
        return ""
    rule = guard.text(
        guard.patience(parts), ["state->guard.refused", "(double)off"],
        ["state->guard.refused", "part"],
    )  # fmt: skip
    which = f"(part > {number(parts + 0.5)}) ? 0 : (int)part"
    computed = [m for m in plan.layout.states if m.signal.derived]
    reset = [f"start(param, state, {which});"]
    if computed:  # parameters may give no good start: then it is that of the defaults
        good = conjunction([within(plan, m, "state->") for m in computed])
        other = [f"{n}_param safe;", f"{n}_default(&safe);", f"start(&safe, state, {which});"]
        reset.append(if_([f"!({good})"], *other))
    lines = [
        "double part = 0.0;",
        *rule,
        if_(["part > 0.0"], *reset, f"return (unsigned int){plan.layout.big}_RESET;"),
        "return 0U;",
    ]
    order = ", ".join(p or "the state" for p in plan.parts)
    what = comment(
        f"One more tick is refused. After {guard.PATIENCE} in a row the part of which a state is"
        " out of its range is put to its start. After as many more it is one part after the other:"
        f" {order}. Then it is all of it."
    )
    signature = prototype(plan, "static unsigned int", "recover", f"const {n}_param *param",
                          f"{n}_state *state", "int off")  # fmt: skip
    return f"{what}\n" + define(signature, lines)


def limit_outputs(plan: Plan) -> str:
    """Function that puts outputs that left their ranges to the ends of them."""
    n = plan.name
    limited = [m for m in plan.layout.outputs if plan.ranged(m)]
    if not limited:
        return ""
    lines, ends = plan.ends_text(limited)
    once: dict[str, str] = {}
    for (c, k, what), end in ends.items():
        if "->" in end and end not in once:
            name = once[end] = f"{what}_{c}" + f"_{k}" * (k > 0)
            lines.append(f"const double {name} = {end};")
    ends = {key: once.get(end, end) for key, end in ends.items()}
    lines = [*lines, "unsigned int limited = 0U;"]
    for m in limited:
        each = [f"{ends[m.c, k, 'lo']}, {ends[m.c, k, 'hi']}" for k in range(m.size)]
        if not m.scalar and len(set(each)) == 1:
            lines.append(f"limited |= limit_all(out->{m.c}, {m.size}, {each[0]});")
        else:
            lines += [f"limited |= limit(&{m.at('out->', k)}, {e});" for k, e in enumerate(each)]
    text = "\n".join(lines)
    void = [f"(void){a};" for a in ("param", "state") if identifier_free(text, a)]
    signature = prototype(plan, "static unsigned int", "limit_outputs",
                          f"const {n}_param *param", f"const {n}_state *state",
                          f"{n}_out *out")  # fmt: skip
    what = comment("Put outputs into their ranges; a bit of the status.")
    return f"{what}\n" + define(signature, [*void, *lines, "return limited;"])


def _ends(plan: Plan, m: Member) -> tuple[str, str]:
    """Least and greatest number of a signal, in C."""
    lo, hi = plan.limits(m)
    return (
        number(lo) if math.isfinite(lo) else "-DBL_MAX",
        number(hi) if math.isfinite(hi) else "DBL_MAX",
    )


def within(plan: Plan, m: Member, pointer: str) -> str:
    """Condition: a finite number in the range of the signal."""
    lo, hi = _ends(plan, m)
    if m.scalar:
        return f"within({pointer}{m.c}, {lo}, {hi})"
    return f"all_within({pointer}{m.c}, {m.size}, {lo}, {hi})"
