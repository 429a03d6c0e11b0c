"""The source of a C module: equations, checks, init, tune and step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import fill
from typing import Any

import casadi as ca
import numpy as np

from slipctl.ccode.module import guard, rates, tick_counter
from slipctl.ccode.module.comments import WIDTH, comment
from slipctl.ccode.module.guard_functions import (
    catch_up,
    check_inputs,
    check_inputs_call,
    finite,
    finite_calls,
    limit_outputs,
    limit_outputs_call,
    part_off,
    part_off_call,
    range_condition,
    recover,
)
from slipctl.ccode.module.header import head as first_comment
from slipctl.ccode.module.header import prototypes
from slipctl.ccode.module.kernel import KERNEL
from slipctl.ccode.module.layout import Member, c_elements, own_name
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.part_structs import nest_parts
from slipctl.ccode.passes.precision import in_precision, tolerant
from slipctl.ccode.passes.scratch import in_section
from slipctl.ccode.passes.split_step import equations_call, prepare, take_state
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import constant, number
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, define, expression, if_, statements
from slipctl.ccode.tree.printer import file_text


def sources(plan: Plan, section: str | None = None) -> dict[str, str]:
    """Text of the source by file: its parts, and the module around them.

    Args:
        plan: the module.
        section: for the linker, that the tables of the module lie in.
    """
    *headers, file = plan.files
    n = plan.name
    made = (
        _equations, _default, _param_ok, _tune, _start, limit_outputs, _start_outputs, _init,
        check_inputs, finite, part_off, recover, catch_up, _hold, prepare, _step,
    )  # fmt: skip
    around = [f for make in made for f in make(plan)]
    around += tick_counter.functions(plan, _hold_call(plan)) if plan.counter else []
    parts, around = nest_parts(plan.layout, plan.equations.functions, around)
    static = [tolerant(n) if plan.real == "float" else n for n in plan.equations.static]
    shared = helpers([*parts.values(), *static])
    if static:
        static = [c.remark(KERNEL[0]), *static, c.remark(KERNEL[1])]
    bits = {
        f"{bit}_": expression(f"(unsigned int){plan.layout.big}_{bit}")
        for bit in ("OFF_RANGE", "BAD_INPUT", "REFUSED", "LIMITED")
    }
    tests = c.swap_all(helpers(around, shared), bits)
    named = c.words([*tests, *around])
    forgotten = int(guard.memory(plan.period, plan.stale))
    before = [c.raw(_NAN_IS_SEEN), c.raw("\n".join(
        f"#define {name} {value or forgotten} /* {what} */"
        for name, (value, what) in guard.NUMBERS.items() if name in named
    ))]  # fmt: skip

    def finished(
        name: str, opening: Sequence[Node], libraries: Sequence[str], nodes: Iterable[Node]
    ) -> str:
        made = [in_precision(x, plan.real, plan.block.name) for x in nodes]
        made = made if section is None else [in_section(x, section) for x in made]
        words = c.words(made)
        more = [h for h, names in _MACROS.items() if names & words and h not in libraries]
        included = "\n".join(f"#include <{x}.h>" for x in (*libraries, *more))
        return file_text([c.raw(first_comment(plan, name)), *opening, c.raw(included), *made])

    openings = "\n".join(f'#include "{h}"' for h in headers)
    mark = f"{plan.layout.big}_PARTS_H"
    told = f"The parts of {n}, in the order of the wires; {file} alone includes this file."
    opening = [c.remark(told), c.raw(f"#ifndef {mark}\n#define {mark}"),
               c.raw(f'#include "{n}.h"')]  # fmt: skip
    copied = "Functions casadi_... are copied from the templates of CasADi" \
             f" {ca.CasadiMeta.version()} (MIT-0, see LICENSE)."  # fmt: skip
    opening += [c.remark(copied)] * plan.equations.copied
    whole = [*_enums(plan), *shared, *static, *parts.values(), c.raw(f"#endif /* {mark} */")]
    found = {headers[-1]: finished(headers[-1], opening, ["math", "stdbool"], whole)}
    libraries = ["float", "math", "stdbool"]
    whole = [*before, *tests, *around]
    return found | {file: finished(file, [c.raw(openings)], libraries, whole)}


_MACROS = {
    "float": {"DBL_MIN", "DBL_MAX", "DBL_EPSILON", "FLT_MIN", "FLT_MAX", "FLT_EPSILON"},
    "stddef": {"NULL"},
}
"""Headers by the macros that need them."""


def _enums(plan: Plan) -> list[Node]:
    """Places of numbers in vectors, a group for what each vector is."""
    groups: dict[str, list[tuple[int, str]]] = {}
    for name, (what, at) in plan.equations.enums.items():
        groups.setdefault(what, []).append((at, name))
    lines = [
        fill(", ".join(f"{name}={at}" for at, name in sorted(rows)), WIDTH - len(rows),
             initial_indent="enum { ", subsequent_indent="    ").replace("=", " = ") + " };"
        for _, rows in sorted(groups.items())
    ]  # fmt: skip
    told = "Where numbers lie in the vectors of the plan and of its quadratic program."
    return [c.remark(told), c.raw("\n".join(lines))] if lines else []


_NAN_IS_SEEN = """#if defined(__FAST_MATH__) \\
    || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error compile without -ffast-math and -ffinite-math-only: NaN must be seen
#endif"""


# ---- equations ----------------------------------------------------------------------------------


def _equations(plan: Plan) -> list[Node]:
    """Function that calls the parts in their order; whether one did not come to its end."""
    if plan.rates:
        return []
    n, lines = plan.name, list(plan.equations.lines)
    if plan.can_fail:
        lines = [*code("work->failed = 0;"), *lines, *code("return work->failed;")]
    used = c.variables(lines)
    given = ["in", "param", *["derived"] * bool(plan.layout.derived)]
    given += [*["state", "next"] * bool(plan.layout.states), "now", *["work"] * plan.work_in_state]
    voids = [c.mark_unused(a) for a in given if a not in used]
    head = f"static {'int' if plan.can_fail else 'void'} equations"
    told = f"The parts, in the order of the wires of {plan.block.name}"
    what = comment(f"{told}; {n}.h says where they come from.")
    return [define(head, [*voids, *lines], what, (plan.types[a] for a in given))]


# ---- parameters and start -----------------------------------------------------------------------


def _default(plan: Plan) -> list[Node]:
    if not plan.layout.params:
        return [define(prototypes(plan)["default"], ["param->unused = 0.0;"])]
    given = _values((m, m.signal.value) for m in plan.layout.params)
    declared = code(f"static const {plan.name}_param defaults = {{{given}}};")
    return [*declared, define(prototypes(plan)["default"], ["*param = defaults;"])]


def _values(values: Iterable[tuple[Member, Any]]) -> str:
    """Members of a constant struct with their values; those that are left out are 0."""
    rows = []
    for m, value in values:
        given = ", ".join(number(float(v)) for v in c_elements(m, value))
        rows.append(f".{m.c} = {given if m.scalar else f'{{{given}}}'}")
    return ", ".join(rows)


def _constant(m: Member, pointer: str, value: Any, kind: str = "") -> list[str]:
    """Statements that give a member a constant value."""
    flat = c_elements(m, value)
    if kind in ("bool", "int", "unsigned int"):
        end = "U" * (kind == "unsigned int")
        told = [("true" if v else "false") if kind == "bool" else f"{int(v)}{end}" for v in flat]
        if m.size > 2 and len(set(told)) == 1:
            return [f"for (int k = 0; k < {m.size}; ++k) {{ {pointer}{m.c}[k] = {told[0]}; }}"]
        return [f"{m.at(pointer, k)} = {v};" for k, v in enumerate(told)]
    if m.scalar:
        return [f"{pointer}{m.c} = {number(float(flat[0]))};"]
    if m.size > 2 and (flat == flat[0]).all():
        return [f"fill({pointer}{m.c}, {m.size}, {number(float(flat[0]))});"]
    again = next((n for n in range(1, m.size) if (flat[n:] == flat[:-n]).all()), m.size)
    lines = [f"{pointer}{m.c}[{k}] = {number(float(v))};" for k, v in enumerate(flat[:again])]
    if m.size - again > 1:  # the same numbers for each copy
        before = f"{pointer}{m.c}[k - {again}]"
        each = f"for (int k = {again}; k < {m.size}; ++k) {{ {pointer}{m.c}[k] = {before}; }}"
        return [*lines, each]
    return [f"{pointer}{m.c}[{k}] = {number(float(v))};" for k, v in enumerate(flat)]


def _param_ok(plan: Plan) -> list[Node]:
    checks = [range_condition(plan, m, "p->") for m in plan.layout.params]
    checks += [f"rising(p->{m.c}, {m.size})" for m in plan.layout.params if m.signal.rising]
    void = [] if checks else ["(void)p;"]
    signature = f"static bool param_ok(const {plan.name}_param *p)"
    return [define(signature, [*void, f"return {' && '.join(checks) or 'true'};"])]


def _tune(plan: Plan) -> list[Node]:
    n, big, derived = plan.name, plan.layout.big, plan.layout.derived
    lines: list[str | Node] = [f"struct {n}_derived now;"] * bool(derived)
    lines.append(if_("!param_ok(param)", f"return {big}_BAD_PARAM;"))
    if derived:
        lines += plan.start_lines(derived, 0, "now.")
        good = " && ".join(range_condition(plan, m, "now.") for m in derived)
        lines += [if_(f"!({good})", f"return {big}_BAD_PARAM;"), "state->derived = now;"]
    lines += ["state->in_force = *param;", f"return {big}_OK;"]
    return [define(prototypes(plan)["tune"], lines)]


def _start(plan: Plan) -> list[Node]:
    """Function that puts a part of the state to its start, or all of it; whether that can be."""
    n = plan.name
    if not plan.layout.states:
        return []
    lines: list[Node] = []
    for k, (path, members) in enumerate(plan.parts.items(), start=1):
        body = _begun(plan, members)
        if len(plan.parts) == 1:  # whichever part is meant, it is this one
            lines += body
            break
        told = f" {comment(path)}" if path else ""
        lines.append(c.branch(expression(f"all || (part == {k})"), body, told=told))
    if len(plan.parts) > 1:
        lines = [*code("const bool all = part == 0;"), *lines]
    used = c.variables(lines)
    void = [c.mark_unused(a) for a in ("param", "part") if a not in used]
    told = "Put a part of the state to its start, by the order of the parts; 0 is all."
    computed = [range_condition(plan, m, "state->") for m in plan.layout.states if m.signal.derived]
    if computed:
        told += " Whether what is computed of it is in its range."
        lines += code(f"return {' && '.join(computed)};")
    head = f"static {'bool' if computed else 'void'} start"
    given = [plan.types["param"], f"struct {n}_kept *state", "int part"]
    return [define(head, [*void, *lines], comment(told), given)]


def _begun(plan: Plan, members: Sequence[Member]) -> list[Node]:
    """Statements that put the states of a part to their start: its struct, then its arrays."""
    firsts = {m.c: i for i, m in enumerate(plan.layout.states, start=len(plan.layout.derived))}
    kinds = {m.c: plan.layout.kind(m, plan.real) for m in members}
    made = [
        (m, plan.start_lines((m,), firsts[m.c], "state->") if m.signal.derived
         else statements(_constant(m, "state->", m.signal.value, kinds[m.c])))
        for m in members
    ]  # fmt: skip
    struct = plan.layout.places[members[0].c].rpartition(".")[0]
    zero = next((m for m in members if m.scalar), None)
    if not struct or zero is None or len(members) == 1:
        made.sort(key=lambda row: row[0].signal.derived)
        return _distinct([line for _, lines in made for line in lines])
    before, given, behind = list[Node](), list[str](), list[Node]()
    for m, lines in made:
        before += [line for line in lines if line.kind == "declare"]
        values = [c.value(line) for line in lines if line.kind == "do" and c.target(line)]
        if any(line.kind == "for" for line in lines):
            again = kinds[m.c] == plan.real or m.signal.value  # what is left out is 0
            behind += [line for line in lines if line.kind != "declare"] * bool(np.any(again))
        elif not values:  # filled
            behind += [x for x in lines if x.kind == "do" and x.parts[0].parts[-1] != _ZERO]
        elif any(v not in _NOTHING for v in values):
            text = ", ".join(v.text for v in values)
            given.append(f".{own_name(m)} = {text if m.scalar else f'{{{text}}}'}")
    given = given or [f".{own_name(zero)} = 0.0"]  # what is left out is 0; C wants one
    whole = code(f"state->{struct} = (struct {plan.name}_kept_{struct}){{{', '.join(given)}}};")
    return [*_distinct(before), *whole, *behind]


_ZERO = constant(0.0)
_NOTHING = (_ZERO, c.name("false"), Node("number", "0U"))


def _distinct(lines: list[Node]) -> list[Node]:
    """Statements without those that are there already."""
    return [line for k, line in enumerate(lines) if line not in lines[:k]]


def _init(plan: Plan) -> list[Node]:
    n, big, lay = plan.name, plan.layout.big, plan.layout
    computed = any(m.signal.derived for m in lay.states)
    ages = f".age = {{{', '.join(['-1'] * plan.n_in)}}}"
    untouched = [*[ages] * bool(plan.n_in), f".mark = {guard.MARK_NAME}"]
    lines: list[str | Node] = [f"int status = {n}_tune(param, state);"]
    start = "start(&state->in_force, &state->kept, 0)"
    if lay.params or computed:  # without any, none is refused
        good = f"status == {big}_OK"
        if computed:
            lines += [f"bool good = ({good});", if_("good", f"good = {start};")]
        elif lay.states:
            lines.append(f"{start};")
        defaults = [f"(void){n}_tune(&defaults, state);"]
        if not lay.params:
            defaults = [
                f"{n}_param safe;",
                f"{n}_default(&safe);",
                f"(void){n}_tune(&safe, state);",
            ]
        lines.append(if_(
            "!good" if computed else good.replace("==", "!="), *defaults,
            *[f"{'(void)' * computed}{start};"] * bool(lay.states),
            *[f"status = {big}_BAD_PARAM;"] * computed,
        ))  # fmt: skip
    elif lay.states:
        lines.append(f"{start};")
    lines.append(f"state->guard = (struct {n}_guard){{{', '.join(untouched)}}};")
    lines += ["state->tick.done = 0.0;"] * plan.rates
    lines += ["state->counter.begun = 0U;", "state->counter.last = 0U;"] * plan.counter
    if lay.outputs:
        lines.append("start_outputs(&state->held);")
    if lay.measured:
        lines.append(f"state->measured = ({lay.now}){{.{_values([(lay.outputs[0], 0.0)])[1:]}}};")
    if plan.follows(lay.outputs):
        lines.append(f"(void){limit_outputs_call(plan, '&state->held')};")
    lines.append("return status;")
    return [define(prototypes(plan)["init"], lines)]


def _start_outputs(plan: Plan) -> list[Node]:
    """Function that gives the outputs before the first good step."""
    if not plan.layout.outputs:
        return []
    others = [m for m in plan.layout.outputs if c_elements(m, plan.before(m)).any()]
    given = _values((m, plan.before(m)) for m in others or plan.layout.outputs[:1])
    what = comment("Outputs before the first good step: safe, or in their ranges and next to 0.")
    signature = f"static void start_outputs({plan.name}_out *out)"
    return [define(signature, [f"*out = ({plan.name}_out){{{given}}};"], what)]


# ---- step ---------------------------------------------------------------------------------------


def _hold(plan: Plan) -> list[Node]:
    """Function that gives the outputs of a step that is refused, where some have a safe value."""
    n, safe = plan.name, plan.safe
    if not _has_hold(plan):
        return []
    lines = ["*out = state->held;"]
    for m in plan.layout.outputs:
        if m.c in safe:
            lines += _constant(m, "out->", safe[m.c])
    if plan.follows(plan.layout.outputs):  # parameters may have changed since
        lines.append(f"(void){limit_outputs_call(plan, 'out')};")
    what = comment(
        "Outputs of a step that is refused: the safe value, or that of the last good step."
    )
    return [define(f"static void hold(const {n}_state *state, {n}_out *out)", lines, what)]


def _hold_call(plan: Plan) -> str:
    """Statement that gives the outputs of a step that is refused."""
    return "hold(state, out);" if _has_hold(plan) else "*out = state->held;"


def _has_hold(plan: Plan) -> bool:
    """Whether the outputs of a refused step are more than a copy of those held."""
    return bool(plan.safe) or plan.follows(plan.layout.outputs)


def _given(plan: Plan) -> list[str]:
    """Statements that give the outputs, of a module that measures more than it gives."""
    return [
        f"out->{m.c} = now.{m.c};" if m.scalar else f"copy(out->{m.c}, now.{m.c}, {m.size});"
        for m in plan.layout.outputs
    ]


def _step(plan: Plan) -> list[Node]:
    n, big, lay = plan.name, plan.layout.big, plan.layout
    hold = [_hold_call(plan)]
    hold += ["++state->guard.missed;"] * bool(plan.counters)
    has_next = bool(lay.states)
    following = "state->next" if plan.next_in_state else "next"
    seen = "&state->guard.last" if lay.inputs else "in"
    first = check_inputs_call(plan, "used") if lay.inputs else "0U"
    lines: list[str | Node] = ["(void)param; /* those in force are used */", f"{lay.now} now;"]
    lines.append(f"const {n}_param *const used = &state->in_force;")
    if has_next and not plan.next_in_state:
        lines.append(f"struct {n}_kept next;")
    nothing = ["start_outputs(out);"] if lay.outputs else ["out->unused = 0.0;"]
    lines.append(
        if_(f"state->guard.mark != {guard.MARK_NAME}", *nothing,
            f"return (int){big}_NO_INIT | (int){big}_REFUSED;")
    )  # fmt: skip
    lines.append(f"unsigned int status = {first};")
    if lay.inputs:
        lines.append(
            if_(f"(status & (unsigned int){big}_REFUSED) != 0U", *hold, "return (int)status;")
        )
    if plan.equations.ticks:  # what does not run in this tick keeps its state
        lines.append(f"{following} = state->kept;")
    passed = [f"&{following}"] * has_next + ["&now"]
    if plan.block.composition.split:
        before = plan.state_named(plan.block.composition.split.prepared).c
        lines.append(f"const bool whole = !(state->kept.{before} > 0.0); /* nothing is prepared */")
    call = equations_call(plan, seen)
    ranged = any(plan.ranged(m) for m in lay.states)
    off = part_off_call(plan, f"&{following}") if ranged else ""
    lines.append(f"const int failed = {call};" if plan.can_fail else f"{call};")
    before_it, lines = lines, []
    bad = ["(failed != 0)"] * plan.can_fail
    if ranged:
        lines.append(f"const int off = {'(failed != 0) ? 0 : ' * plan.can_fail}{off};")
        bad.append("(off != 0)")
    for name, tested in finite_calls(plan, passed).items():
        bad.append(f"(whole && !{tested})" if name == "ahead_finite" else f"!{tested}")
    if bad:
        again = [f"status |= recover(used, state, {'off' if ranged else '0'});"] * has_next
        why = f"status |= (unsigned int){big}_BAD_RESULT | (unsigned int){big}_REFUSED;"
        lines.append(if_(" || ".join(bad), why, *again, *hold, "return (int)status;"))
    if plan.ahead:
        lines.append(if_("whole", *take_state(plan, plan.ahead)))
    rest = [m for m in lay.states if m not in plan.ahead]
    lines += [*take_state(plan, rest), "state->guard.refused = 0U;"]
    if plan.counters:
        counts = all(lay.kind(m, plan.real) != plan.real for m, _ in plan.counters)
        missed = "state->guard.missed" if counts else "(double)state->guard.missed"
        moved = f"catch_up(&state->kept, {missed});"
        lines.append(if_("state->guard.missed > 0U", moved, "state->guard.missed = 0U;"))
    told = "out" if lay.measured else "&now"
    lines += ["state->measured = now;", *_given(plan)] if lay.measured else []
    if any(plan.ranged(m) for m in lay.outputs):
        lines.append(f"status |= {limit_outputs_call(plan, told, 'used')};")
    lines += ["state->held = *out;"] if lay.measured else ["state->held = now;", "*out = now;"]
    lines.append("return (int)status;")
    texts = prototypes(plan)
    if plan.rates:
        looked = [f"status = {first};".replace("used", "&state->in_force")]
        more = rates.functions(plan, looked, lines, hold)
        return [*more, define(texts["step"], rates.step(plan))]
    lines = before_it + lines
    if not plan.block.composition.split:
        return [define(texts["step"], lines)]
    whole = define(texts["step"], [f"return {n}_feedback(in, param, state, out);"])
    return [define(texts["feedback"], lines), whole]
