"""Functions of the C that guard a step: inputs, next states, and what to do when they stay bad."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from slipctl.ccode.module import guard
from slipctl.ccode.module.comments import comment
from slipctl.ccode.module.layout import Member, spans
from slipctl.ccode.module.plan import Ends, Plan
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import number
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import define, expression, if_


def check_inputs(plan: Plan) -> list[Node]:
    """Function that takes what is good of the inputs, and says what was not."""
    n, lay = plan.name, plan.layout
    if not lay.inputs:
        return []
    known, ends = _known(plan)
    lines: list[str | Node] = [*known]
    good = " && ".join(["(guard->fresh != 0U)", *_all_good(lay.inputs, ends)])
    lines += ["unsigned int told = 0U;", if_(good, "guard->last = *in;", "return told;")]
    for m, here in spans(lay.inputs):
        at = here.start
        if m.signal.judged:  # by the block: it has to see what is wrong
            many = f"_all({m.address('in->')}, {m.size}, {m.address('guard->last.')}"
            one = f"({m.at('in->', 0)}, &{m.at('guard->last.', 0)}"
            lines.append(f"told |= hand_over{many if m.size > 1 else one});")
            continue
        stale = str(math.ceil(m.signal.stale))
        each = [
            ", ".join([*(ends[m.c, k, what] for what in Ends._fields), stale])
            for k in range(m.size)
        ]
        if m.size > 1 and len(set(each)) == 1:
            last = f"{m.address('guard->last.')}, &guard->age[{at}], &guard->back[{at}]"
            given = ", ".join([m.address("in->"), str(m.size), each[0], last])
            lines.append(f"told |= accept_all({given});")
        else:
            for k, given in enumerate(each):
                own = f"&guard->age[{at + k}], &guard->back[{at + k}]"
                last = f"&{m.at('guard->last.', k)}, {own}"
                lines.append(f"told |= accept({m.at('in->', k)}, {given}, {last});")
    lines += ["guard->fresh = 0U;", if_("told == 0U", "guard->fresh = 1U;")]
    what = comment("Take the inputs, of one that is bad its last good value; bits of the status.")
    used = [*known, *map(expression, ends.values())]
    structs = [f"const {n}_in *in", *_types(plan, used), f"struct {n}_guard *guard"]
    lines.append("return told % UNSURE;")
    return [define("static unsigned int check_inputs", lines, what, structs)]


def _known(plan: Plan) -> tuple[list[Node], dict[Any, str]]:
    """Ends of inputs in C. What follows other inputs is worked out before this tick changes them.

    Before its first good value, and where the last one is forgotten, an input speaks for itself.
    """
    lines, ends = plan.ends_text(plan.layout.inputs, last=True)
    read = {n.text for end in ends.values() for n in expression(end).walk()}
    read |= {n.text for line in lines for n in line.walk() if n.kind in ("member", "index")}
    made, known = dict[str, Node](), list[Node]()
    for m, here in spans(plan.layout.inputs):
        for k in range(m.size):
            last = m.at("guard->last.", k)
            if last in read:
                name = f"known_{m.c}" + f"_{k}" * (m.size > 1)
                made[last] = c.name(name)
                age = f"guard->age[{here.start + k}]"
                there = f"({age} >= 0) && ({age} < FORGOTTEN)"
                given = expression(f"({there}) ? {last} : {m.at('in->', k)}")
                known.append(c.declare("const double", name, given))

    def rule(n: Node) -> Node | None:
        return made.get(n.text) if n.kind in ("member", "index") else None

    lines = [line.change(rule) for line in lines]
    once: dict[str, str] = {}
    for (m_c, k, what), end in ends.items() if made else ():
        new = expression(end).change(rule)
        ends[m_c, k, what] = new.text
        letters = any(w[:1] == "a" and w[1:].isdecimal() for w in new.words)
        if new.calls() or letters or any(w.startswith("known_") for w in new.words):
            if new.text not in once:
                once[new.text] = f"{what}_{m_c}" + f"_{k}" * (k > 0)
                lines.append(c.declare("const double", once[new.text], new))
            ends[m_c, k, what] = once[new.text]
    return [*known, *lines], ends


def _all_good(inputs: Iterable[Member], ends: dict[Any, str]) -> list[str]:
    """Conditions that ``accept`` finds each input good, when it did so in the tick before."""
    found = []
    for m in inputs:
        each = [tuple(ends[m.c, k, what] for what in Ends._fields) for k in range(m.size)]
        if m.size > 1 and len(set(each)) == 1:
            rows = [("all_", f"{m.address('in->')}, {m.size}", m.address("guard->last."))]
            each = each[:1]
        else:
            rows = [("", m.at("in->", k), m.at("guard->last.", k)) for k in range(m.size)]
        for (many, value, last), (lo, hi, change, noise) in zip(rows, each, strict=True):
            found.append(f"{many}within({value}, {lo}, {hi})")
            if change != "DBL_MAX":
                step = change if noise == "0.0" else f"{noise} + {change}"
                found.append(f"{many}can_follow({value}, {last}, {step})")
    return found


def early_good(plan: Plan) -> tuple[list[Node], str]:
    """Statements, and the condition that the inputs which ``prepare`` reads are in their ranges."""
    lines, ends = plan.ends_text(plan.early)
    open_ = {k: "DBL_MAX" if k[2] == "change" else v for k, v in ends.items()}
    return lines, " && ".join(_all_good(plan.early, open_))


def _types(plan: Plan, nodes: Iterable[Node]) -> list[str]:
    """Declarations of what the ends of ranges are expressions of."""
    used = c.variables(nodes)
    return [plan.types[p] for p in ("param", "derived") if p in used]


def ends_given(plan: Plan, members: Sequence[Member], param: str) -> list[str]:
    """Arguments for them, where the parameters are ``param``."""
    lines, ends = plan.ends_text(members, last=members == plan.layout.inputs)
    used = c.variables([*lines, *map(expression, ends.values())])
    places = {"param": param, "derived": "&state->derived"}
    return [place for p, place in places.items() if p in used]


def check_inputs_call(plan: Plan, param: str) -> str:
    """Call of the function that takes what is good of the inputs."""
    given = ends_given(plan, plan.layout.inputs, param)
    return f"check_inputs({', '.join(['in', *given, '&state->guard'])})"


def part_off_call(plan: Plan, next_: str) -> str:
    """Call of the function that says of which part a next state is out of its range."""
    members = [m for m in plan.layout.states if plan.ranged(m)]
    return f"part_off({', '.join([next_, *ends_given(plan, members, 'used')])})"


def limit_outputs_call(plan: Plan, out: str, param: str = "&state->in_force") -> str:
    """Call of the function that puts outputs into their ranges."""
    limited = [m for m in plan.layout.outputs if plan.ranged(m)]
    return f"limit_outputs({', '.join([*ends_given(plan, limited, param), out])})"


def part_off(plan: Plan) -> list[Node]:
    """Function that says of which part a next state is out of its range."""
    members = [m for m in plan.layout.states if plan.ranged(m)]
    if not members:
        return []
    lines, ends = plan.ends_text(members)
    tests: list[Node] = []
    for k, own in enumerate(plan.parts.values(), start=1):
        found = [
            test for m in own if plan.ranged(m)
            for test in _all_within(
                m, "x->", [f"{ends[m.c, i, 'lo']}, {ends[m.c, i, 'hi']}" for i in range(m.size)]
            )
        ]  # fmt: skip
        if found:
            tests.append(if_(f"!({' && '.join(found)})", f"return {k};"))
    what = comment("The first part of which a next state is out of its range, 0 for none.")
    given = [f"const struct {plan.name}_kept *x", *_types(plan, [*lines, *tests])]
    return [define("static int part_off", [*lines, *tests, "return 0;"], what, given)]


def recover(plan: Plan) -> list[Node]:
    """Function that counts refused ticks and resets parts of the state when they are too many."""
    n, parts = plan.name, len(plan.parts)
    if not parts:
        return []
    rule: list[str | Node] = [
        "const unsigned int refused = state->guard.refused + 1U;",
        "const unsigned int turn = refused / PATIENCE;",
        f"state->guard.refused = (turn < {parts + 2}U) ? refused : 0U;",
        if_("(refused % PATIENCE) != 0U", "return 0U;"),
        f"int part = (turn <= {parts + 1}U) ? ((int)turn - 1) : 0;",
        if_("turn == 1U", "part = (off != 0) ? off : 1;"),
    ]
    call = "start(%s, &state->kept, part)"
    reset: list[str | Node] = [f"{call % 'param'};"]
    if any(m.signal.derived for m in plan.layout.states):
        # parameters may give no good start: then it is that of the defaults
        other = [f"(void){call % '&defaults'};"]
        if not plan.layout.params:
            other = [f"{n}_param safe;", f"{n}_default(&safe);", f"(void){call % '&safe'};"]
        reset = [if_(f"!{call % 'param'}", *other)]
    lines: list[str | Node] = [
        *rule, *reset, f"return (unsigned int){plan.layout.big}_RESET;",
    ]  # fmt: skip
    order = ", ".join(p or "the state" for p in plan.parts)
    what = comment(
        f"One more tick is refused. After {guard.PATIENCE} in a row the part of which a state is"
        " out of its range is put to its start. After as many more it is one part after the other:"
        f" {order}. Then it is all of it."
    )
    given = [f"const {n}_param *param", f"{n}_state *state", "int off"]
    return [define("static unsigned int recover", lines, what, given)]


def catch_up(plan: Plan) -> list[Node]:
    """Function that moves on the counters of parts that run every few ticks."""
    if not plan.counters:
        return []
    lines, missed = list[str](), "double missed"
    for m, ticks in plan.counters:
        at = m.at("x->", 0) if m.size == 1 else f"x->{m.c}[k]"
        line = f"{at} = later({at}, missed, {number(float(ticks))});"
        if plan.layout.kind(m, plan.real) != plan.real:
            line, missed = f"{at} = ({at} + (missed % {ticks}U)) % {ticks}U;", "unsigned int missed"
        lines.append(line if m.size == 1 else f"for (int k = 0; k < {m.size}; ++k) {{ {line} }}")
    what = comment(
        "Ticks that were refused count for the parts that run every few ticks: they go on in step"
        " with the others."
    )
    return [define("static void catch_up", lines, what, [f"struct {plan.name}_kept *x", missed])]


def _tested(plan: Plan) -> dict[str, list[tuple[Member, str, int]]]:
    """What comes out of the equations and has to be finite, by the function that says whether."""
    rest = [place for place in plan.untested if place[0] not in plan.ahead]
    first = [place for place in plan.untested if place[0] in plan.ahead]
    every = {"result_finite": rest, "ahead_finite": first}
    return {name: places for name, places in every.items() if places}


def finite(plan: Plan) -> list[Node]:
    """Functions that say whether what comes out of the equations is finite."""
    arguments = [f"const struct {plan.name}_kept *next", f"const {plan.layout.now} *now"]
    return [
        define(f"static bool {name}", _zero(places), given=_with_results(arguments, places))
        for name, places in _tested(plan).items()
    ]


def finite_calls(plan: Plan, both: list[str]) -> dict[str, str]:
    """Calls of these functions by their names, with what stands for next states and for outputs."""
    return {name: f"{name}({', '.join(_with_results(both, places))})"
            for name, places in _tested(plan).items()}  # fmt: skip


def _with_results(both: list[str], places: Iterable[tuple[Member, str, int]]) -> list[str]:
    """What stands for next states and for outputs, of those that have results to be tested."""
    there = {pointer for _, pointer, _ in places}
    return [
        x for x, p in zip(both[-2:], ("next->", "now->")[-len(both) :], strict=True) if p in there
    ]


_CHAIN = 6
"""Factors of a product: several short ones do not wait for each other."""


def _zero(elements: Iterable[tuple[Member, str, int]]) -> list[str]:
    """Statements that tell whether elements are finite: then their product with 0 is 0, not NaN.

    That is one multiplication for each and one comparison for all, without a branch.
    """
    products: list[str] = []
    chain: list[str] = []
    for m, pointer, k in elements:
        if m.size > 1:
            whole = f"zero_of({pointer}{m.c}, {m.size})"
            products += [whole] * (whole not in products)
            continue
        factor = m.at(pointer, k)
        if chain and (len(chain) == _CHAIN or len(" * ".join([*chain, factor])) > 70):
            products.append(" * ".join(["0.0", *chain]))
            chain = []
        chain.append(factor)
    products += [" * ".join(["0.0", *chain])] if chain else []
    first, *rest = products
    what = "/* 0 times a finite number is 0; times NaN or infinity it is NaN */"
    if not rest:
        return [what, f"return ({first}) == 0.0;"]
    return [what, f"double zero = {first};", *(f"zero *= {p};" for p in rest),
            "return zero == 0.0;"]  # fmt: skip


def limit_outputs(plan: Plan) -> list[Node]:
    """Function that puts outputs that left their ranges to the ends of them."""
    limited = [m for m in plan.layout.outputs if plan.ranged(m)]
    if not limited:
        return []
    lines, ends = plan.ends_text(limited)
    once: dict[str, str] = {}
    for (m_c, k, what), end in ends.items():
        if "->" in end and end not in once:
            name = once[end] = f"{what}_{m_c}" + f"_{k}" * (k > 0)
            lines.append(c.declare("const double", name, expression(end)))
    ends = {key: once.get(end, end) for key, end in ends.items()}
    calls: list[str] = []
    for m in limited:
        each = [f"{ends[m.c, k, 'lo']}, {ends[m.c, k, 'hi']}" for k in range(m.size)]
        if m.size > 1 and len(set(each)) == 1:
            calls.append(f"limit_all(out->{m.c}, {m.size}, {each[0]})")
        else:
            calls += [f"limit(&{m.at('out->', k)}, {e})" for k, e in enumerate(each)]
    lines.append(c.give(expression(" | ".join(calls))))
    given = [*_types(plan, lines), f"{plan.name}_out *out"]
    what = comment("Put outputs into their ranges; a bit of the status.")
    return [define("static unsigned int limit_outputs", lines, what, given)]


def _all_within(m: Member, pointer: str, ends: Sequence[str]) -> list[str]:
    """Conditions that all elements lie between their ends; one where these are the same."""
    if m.size > 1 and len(set(ends)) == 1:
        return [f"all_within({pointer}{m.c}, {m.size}, {ends[0]})"]
    return [f"within({m.at(pointer, k)}, {e})" for k, e in enumerate(ends)]


def range_condition(plan: Plan, m: Member, pointer: str) -> str:
    """Condition: a finite number in the range of the signal."""
    lo, hi = plan.limits(m)
    least = number(lo) if math.isfinite(lo) else "-DBL_MAX"
    most = number(hi) if math.isfinite(hi) else "DBL_MAX"
    (found,) = _all_within(m, pointer, [f"{least}, {most}"] * m.size)
    return found
