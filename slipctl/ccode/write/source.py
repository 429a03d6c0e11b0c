"""The source of a C module: equations, checks, init, tune and step."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import casadi as ca

from slipctl.ccode.write import guard, rates
from slipctl.ccode.write.comments import comment
from slipctl.ccode.write.expressions import number
from slipctl.ccode.write.guarding import (
    check_inputs,
    limit_outputs,
    part_off,
    recover,
    within,
)
from slipctl.ccode.write.header import (
    head,
    identifier_free,
    next_struct,
    prototype,
    prototypes,
)
from slipctl.ccode.write.kernel import Kernel, definitions
from slipctl.ccode.write.layout import Member
from slipctl.ccode.write.plan import Plan, first_sentence
from slipctl.ccode.write.precision import in_precision
from slipctl.ccode.write.shapes import constant
from slipctl.ccode.write.splitting import in_place, prepare, taken
from slipctl.ccode.write.statements import broken, conjunction, define, if_
from slipctl.ccode.write.structure import assign


def source(plan: Plan) -> str:
    """Text of the source."""
    n, lay = plan.name, plan.layout
    functions = "\n\n".join(
        [_equations(plan), _default(plan), _param_ok(plan), _tune(plan)]
        + [made for made in (_start(plan), limit_outputs(plan), _start_outputs(plan)) if made]
        + [_init(plan)]
        + [made for made in (check_inputs(plan), _finite(plan), part_off(plan),
                             recover(plan), _hold(plan), prepare(plan)) if made] + [_step(plan)]
    )  # fmt: skip
    parts = [
        head(plan, f"{n}.c"),
        f'#include "{n}.h"\n\n#include <float.h>\n#include <math.h>\n#include <stdbool.h>',
        "#if defined(__FAST_MATH__) \\\n"
        "    || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))\n"
        "#error compile without -ffast-math and -ffinite-math-only: NaN must be seen\n#endif",
    ]
    if plan.equations.copied:
        parts.append(
            comment(
                "Functions casadi_... are copied from the templates of CasADi"
                f" {ca.CasadiMeta.version()} (MIT-0, see LICENSE)."
            )
        )
    if lay.states and not plan.next_in_state:
        parts.append(f"/* State of the next tick. */\n{next_struct(plan)};")
    parts.append(
        definitions(
            [plan.equations, Kernel(helpers=frozenset({*plan.start.helpers, *plan.bound_helpers}))],
            plan.real,
        )
    )
    parts.append(
        checks(functions).replace("MEMORY_", number(guard.memory(plan.period, plan.stale)))
    )
    text = "\n\n".join(p.strip("\n") for p in [*parts, functions] if p.strip()) + "\n"
    if re.search(r"\bNULL\b", text):
        text = text.replace(
            "#include <stdbool.h>\n", "#include <stdbool.h>\n#include <stddef.h>\n", 1
        )
    return broken(in_precision(text, plan.real, plan.block.name))


# ---- equations ----------------------------------------------------------------------------------


def _equations(plan: Plan) -> str:
    n, made = plan.name, plan.equations
    lines = _call_lines(plan) if made.entry else _own_lines(plan)
    text = "\n".join(lines)
    voids = [f"    (void){a};" for a in ("in", "param", "state") if identifier_free(text, a)]
    arguments = [
        f"const {n}_in *in", f"const {n}_param *param",
        f"{n}_state *state" if plan.work_in_state else f"const {n}_state *state",
    ]  # fmt: skip
    if plan.layout.states:
        arguments.append(f"struct {n}_next *next")
    arguments.append(f"{n}_out *now")
    result = "static int" if plan.can_fail else "static void"
    signature = prototype(plan, result, "equations", *arguments)
    told = "The parts, in the order of the wires" if made.functions else "Equations"
    what = comment(f"{told} of {plan.block.name}; {n}.h says where they come from.")
    whole = "\n".join([what, signature, "{", *voids, *lines, "}"])
    return "\n\n".join([*made.functions.values(), *[whole] * (not plan.rates)])


def _own_lines(plan: Plan) -> list[str]:
    """Statements of the equations; a part's text stands before its first output."""
    made = plan.equations
    places, lines = _memory(plan) if made.calls else ({}, [])
    lines += ["    int failed = 0;"] * made.calls
    part_of = {m.c: m.name.rpartition(".")[0] for m in plan.layout.outputs if "." in m.name}
    docs = {path: first_sentence(leaf.doc) for path, leaf in plan.part_docs()}
    for line in made.lines:
        named = re.match(r"const \w+ (\w+) =", line)
        part = part_of.get(named[1], "") if named else ""
        if part in docs:
            lines.append(comment(f"{part}: {docs.pop(part)}", "    "))
        for placeholder, place in places.items():
            line = line.replace(placeholder, place)
        lines.append(f"    {line}")
    if made.functions:
        return lines
    lines += [""] * bool(lines)
    for i, (m, pointer) in enumerate(plan.results):
        texts = [made.results[i, k] for k in range(m.size)]
        lines += [f"    {line}" for line in assign(f"{pointer}{m.c}", texts, not m.scalar)]
    return in_place(plan, lines) + ["    return failed;"] * made.calls


def _memory(plan: Plan) -> tuple[dict[str, str], list[str]]:
    """Where CasADi's functions work: text for each placeholder, and declarations."""
    sz_arg, sz_res, sz_iw, sz_w = plan.equations.work
    lines = [f"    const double *arg[{max(sz_arg, 1)}];", f"    double *res[{max(sz_res, 1)}];"]
    places = {}
    for name, size, kind in (("iw", sz_iw, "int"), ("w", sz_w, "double")):
        place = "NULL" if not size else f"state->work.{name}" if plan.work_in_state else name
        places[f"WORK_{name.upper()}_"] = place
        if place == name:
            lines.append(f"    {kind} {name}[{size}];")
    return places, lines


def _call_lines(plan: Plan) -> list[str]:
    """Leave it all to CasADi's function: pass it the struct members."""
    places, lines = _memory(plan)
    lines += [f"    arg[{i}] = {m.address(p)};" for i, (m, p) in enumerate(plan.arguments)]
    lines += [f"    res[{i}] = {m.address(p)};" for i, (m, p) in enumerate(plan.results)]
    call = f"{plan.equations.entry}(arg, res, {places['WORK_IW_']}, {places['WORK_W_']}, 0)"
    return [*lines, f"    return {call};"]


# ---- parameters and start -----------------------------------------------------------------------


def _default(plan: Plan) -> str:
    lines: list[str] = []
    for m in plan.layout.params:
        lines += _constant(m, "param->", m.signal.value)
    lines = lines or ["param->unused = 0.0;"]
    return define(prototypes(plan)["default"], lines)


def _constant(m: Member, pointer: str, value: Any) -> list[str]:
    """Statements that give a member a constant value."""
    flat = constant(m.signal, value).ravel(order="F")
    if m.scalar:
        return [f"{pointer}{m.c} = {number(float(flat[0]))};"]
    if m.size > 2 and (flat == flat[0]).all():
        return [f"fill({pointer}{m.c}, {m.size}, {number(float(flat[0]))});"]
    return [f"{pointer}{m.c}[{k}] = {number(float(v))};" for k, v in enumerate(flat)]


def _param_ok(plan: Plan) -> str:
    checks = [within(plan, m, "param->") for m in plan.layout.params]
    checks += [f"rising(param->{m.c}, {m.size})" for m in plan.layout.params if m.signal.rising]
    void = [] if checks else ["(void)param;"]
    return define(
        f"static bool param_ok(const {plan.name}_param *param)",
        [*void, f"return {conjunction(checks) or 'true'};"],
    )


def _tune(plan: Plan) -> str:
    n, big, derived = plan.name, plan.layout.big, plan.layout.derived
    lines = [f"struct {n}_derived now;"] * bool(derived)
    lines.append(if_(["!param_ok(param)"], f"return {big}_BAD_PARAM;"))
    if derived:
        lines += plan.start_lines(derived, 0, "now.")
        good = conjunction([within(plan, m, "now.") for m in derived])
        lines += [if_([f"!({good})"], f"return {big}_BAD_PARAM;"), "state->derived = now;"]
    lines += ["state->in_force = *param;", f"return {big}_OK;"]
    return define(prototypes(plan)["tune"], lines)


def _start(plan: Plan) -> str:
    """Function that puts a part of the state to its start, or all of it."""
    n = plan.name
    if not plan.layout.states:
        return ""
    lines: list[str] = []
    for k, (path, members) in enumerate(plan.parts.items(), start=1):
        body: list[str] = []
        for m in members:
            if not m.signal.derived:
                body += _constant(m, "state->", m.signal.value)
        firsts = {m.c: i for i, m in enumerate(plan.layout.states, start=len(plan.layout.derived))}
        for m in members:
            if m.signal.derived:
                body += plan.start_lines((m,), firsts[m.c], "state->")
        made = if_([f"(part == 0) || (part == {k})"], *_distinct(body))
        lines.append(made.replace("{\n", f"{{ {comment(path)}\n", 1) if path else made)
    text = "\n".join(lines)
    void = ["(void)param;"] * identifier_free(text, "param")
    what = comment("Put a part of the state to its start, by the order of the parts; 0 is all.")
    signature = prototype(plan, "static void", "start", f"const {n}_param *param",
                          f"{n}_state *state", "int part")  # fmt: skip
    return f"{what}\n" + define(signature, [*void, *lines])


def _distinct(lines: list[str]) -> list[str]:
    """Lines without those that are there already."""
    return list(dict.fromkeys(lines))


def _init(plan: Plan) -> str:
    n, big, lay = plan.name, plan.layout.big, plan.layout
    computed = [m for m in lay.states if m.signal.derived]
    lines = [f"int status = {n}_tune(param, state);"]
    instead = [f"{n}_param safe;", f"{n}_default(&safe);", f"(void){n}_tune(&safe, state);"]
    if lay.params:  # without any, none is refused
        lines.append(if_([f"status != {big}_OK"], *instead))
    if lay.states:
        lines.append("start(&state->in_force, state, 0);")
    if computed:
        good = conjunction([within(plan, m, "state->") for m in computed])
        again = [*instead, "start(&state->in_force, state, 0);"]
        lines.append(if_([f"!({good})"], f"status = {big}_BAD_PARAM;", *again))
    for m in lay.inputs:
        lines += _constant(m, "state->guard.last.", 0.0)
    if plan.n_in:
        lines += [f"fill(state->guard.age, {plan.n_in}, -1.0);", "state->guard.fresh = 0.0;"]
    lines += ["state->guard.refused = 0.0;", f"state->guard.mark = {number(guard.MARK)};"]
    lines += ["state->tick.done = 0.0;"] * plan.rates
    if lay.outputs:
        lines.append("start_outputs(&state->held);")
    if plan.follows(lay.outputs):
        lines.append("(void)limit_outputs(&state->in_force, state, &state->held);")
    lines.append("return status;")
    return define(prototypes(plan)["init"], lines)


def _start_outputs(plan: Plan) -> str:
    """Function that gives the outputs before the first good step."""
    if not plan.layout.outputs:
        return ""
    flat = {m.c: constant(m.signal, plan.before(m)).ravel(order="F") for m in plan.layout.outputs}
    others = [m for m in plan.layout.outputs if flat[m.c].any()]
    first = plan.layout.outputs[0]
    rows = [f".{m.c} = {number(float(flat[m.c][0]))}" for m in others if m.scalar]
    rows = rows or [f".{first.c} = {'0.0' if first.scalar else '{0.0}'}"]
    lines = [f"const {plan.name}_out safe = {{ /* the others are 0 */"]
    lines += [*(f"    {row}," for row in rows), "};", "*out = safe;"]
    for m in others:
        lines += [] if m.scalar else _constant(m, "out->", plan.before(m))
    what = comment("Outputs before the first good step: safe, or in their ranges and next to 0.")
    return f"{what}\n" + define(f"static void start_outputs({plan.name}_out *out)", lines)


# ---- step ---------------------------------------------------------------------------------------


def _finite(plan: Plan) -> str:
    """Functions that say whether what comes out of the equations is finite."""
    n, lay, ahead = plan.name, plan.layout, plan.ahead
    if not plan.untested:
        return ""
    rest = [place for place in plan.untested if place[0] not in ahead]
    first = [place for place in plan.untested if place[0] in ahead]
    arguments = [f"const struct {n}_next *next"] * bool(lay.states) + [f"const {n}_out *now"]
    made = []
    for name, places, given in (
        ("result_finite", rest, arguments), ("ahead_finite", first, arguments[:1])
    ):  # fmt: skip
        if not places:
            continue
        lines = _zero(places)
        text = "\n".join(lines)
        voids = [f"(void){a};" for a in ("next", "now") if identifier_free(text, a)]
        signature = prototype(plan, "static bool", name, *given)
        there = " ".join(given)
        made.append(define(signature, [*(v for v in voids if f"*{v[6:-1]}" in there), *lines]))
    return "\n\n".join(made)


_CHAIN = 6
"""Factors of a product: several short ones do not wait for each other."""


def _zero(elements: Iterable[tuple[Member, str, int]]) -> list[str]:
    """Statements that tell whether elements are finite: then their product with 0 is 0, not NaN.

    That is one multiplication for each and one comparison for all, without a branch.
    """
    products: list[str] = []
    chain: list[str] = []
    for m, pointer, k in elements:
        if m.size > _CHAIN:
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


def _hold(plan: Plan) -> str:
    """Function that gives the outputs of a step that is refused, where some have a safe value."""
    n, safe = plan.name, plan.safe
    if not _has_hold(plan):
        return ""
    lines = ["*out = state->held;"]
    for m in plan.layout.outputs:
        if m.c in safe:
            lines += _constant(m, "out->", safe[m.c])
    if plan.follows(plan.layout.outputs):  # parameters may have changed since
        lines.append("(void)limit_outputs(&state->in_force, state, out);")
    what = comment(
        "Outputs of a step that is refused: the safe value, or that of the last good step."
    )
    return f"{what}\n" + define(f"static void hold(const {n}_state *state, {n}_out *out)", lines)


def _has_hold(plan: Plan) -> bool:
    """Whether the outputs of a refused step are more than a copy of those held."""
    return bool(plan.safe) or plan.follows(plan.layout.outputs)


def _step(plan: Plan) -> str:
    n, big, lay = plan.name, plan.layout.big, plan.layout
    hold = "hold(state, out);" if _has_hold(plan) else "*out = state->held;"
    has_next = bool(lay.states)
    following = "state->next" if plan.next_in_state else "next"
    seen = "&state->guard.last" if lay.inputs else "in"
    first = "check_inputs(in, used, state)" if lay.inputs else "0U"
    lines = ["(void)param; /* those in force are used */", f"{n}_out now;"]
    lines.append(f"const {n}_param *const used = &state->in_force;")
    if has_next and not plan.next_in_state:
        lines.append(f"struct {n}_next next;")
    nothing = ["start_outputs(out);"] if lay.outputs else ["out->unused = 0.0;"]
    lines.append(
        if_([f"!(state->guard.mark == {number(guard.MARK)})"], *nothing,
            f"return (int){big}_NO_INIT | (int){big}_REFUSED;")
    )  # fmt: skip
    lines.append(f"unsigned int status = {first};")
    if lay.inputs:
        lines.append(
            if_([f"(status & (unsigned int){big}_REFUSED) != 0U"], hold, "return (int)status;")
        )
    passed = [f"&{following}"] * has_next + ["&now"]
    if plan.block.split:
        before = plan.state_named(plan.block.split.prepared).c
        lines.append(f"const bool whole = !(state->{before} > 0.0); /* nothing is prepared */")
    call = f"equations({', '.join([seen, 'used', 'state', *passed])})"
    ranged = any(plan.ranged(m) for m in lay.states)
    off = f"part_off(&{following}, used, state)"
    lines.append(f"const int failed = {call};" if plan.can_fail else f"{call};")
    before_it, lines = lines, []
    bad = ["(failed != 0)"] * plan.can_fail
    if ranged:
        lines.append(f"const int off = {'(failed != 0) ? 0 : ' * plan.can_fail}{off};")
        bad.append("(off != 0)")
    if plan.untested:
        bad.append(f"!result_finite({', '.join(passed)})")
    if plan.ahead:
        bad.append(f"(whole && !ahead_finite(&{following}))")
    if bad:
        again = [f"status |= recover(used, state, {'off' if ranged else '0'});"] * has_next
        why = f"status |= (unsigned int){big}_BAD_RESULT | (unsigned int){big}_REFUSED;"
        lines.append(if_([" || ".join(bad)], why, *again, hold, "return (int)status;"))
    if plan.ahead:
        lines.append(if_(["whole"], *taken(plan, plan.ahead)))
    rest = [m for m in lay.states if m not in plan.ahead]
    lines += [*taken(plan, rest), "state->guard.refused = 0.0;"]
    if any(plan.ranged(m) for m in lay.outputs):
        lines.append("status |= limit_outputs(used, state, &now);")
    lines += ["state->held = now;", "*out = now;", "return (int)status;"]
    texts = prototypes(plan)
    if plan.rates:
        looked = [f"status = {first};".replace("used", "&state->in_force")]
        more = rates.functions(plan, looked, lines, hold)
        return f"{more}\n\n{define(texts['step'], rates.step(plan))}"
    lines = before_it + lines
    if not plan.block.split:
        return define(texts["step"], lines)
    whole = define(texts["step"], [f"return {n}_feedback(in, param, state, out);"])
    return f"{define(texts['feedback'], lines)}\n\n{whole}"


# ---- small text ---------------------------------------------------------------------------------


_LOOP = "    int k;\n    for (k = 0; k < n; ++k) {\n        %s\n    }\n"
_ACCEPT = guard.text(
    guard.accept(),
    ["value", "*last", "*age", "lo", "hi", "change", "stale", "MEMORY_", "DBL_MAX"],
    ["*last", "*age", "told"],
)
_SMALL = {
    "accept_all": (
        "unsigned int accept_all(const double *value, int n, double lo, double hi, double change,\n"
        "                               double stale, double *last, double *age)",
        "    unsigned int told = 0U;\n"
        + _LOOP % "told |= accept(value[k], lo, hi, change, stale, &last[k], &age[k]);"
        + "    return told;\n",
    ),
    "accept": (
        "unsigned int accept(double value, double lo, double hi, double change, double stale,\n"
        "                           double *last, double *age)",
        "    double told = 0.0;\n"
        + "".join(f"    {line}\n" for line in _ACCEPT)
        + "    return (unsigned int)(int)told;\n",
    ),
    "all_can_follow": (
        "bool all_can_follow(const double *x, int n, const double *last, double change)",
        _LOOP % "if (!can_follow(x[k], last[k], change)) {\n            return false;\n        }"
        + "    return true;\n",
    ),
    "can_follow": (
        "bool can_follow(double x, double last, double change)",
        "    return fabs(x - last) <= change; /* from one tick to the next */\n",
    ),
    "zero_of": (
        "double zero_of(const double *x, int n)",
        "    double zero = 0.0;\n" + _LOOP % "zero *= x[k];" + "    return zero;\n",
    ),
    "rising": (
        "bool rising(const double *x, int n)",
        _LOOP.replace("k = 0", "k = 1")
        % "if (!(x[k] > x[k - 1])) {\n            return false;\n        }"
        + "    return true;\n",
    ),
    "all_within": (
        "bool all_within(const double *x, int n, double lo, double hi)",
        _LOOP % "if (!within(x[k], lo, hi)) {\n            return false;\n        }"
        + "    return true;\n",
    ),
    "within": (
        "bool within(double x, double lo, double hi)",
        "    return (x >= lo) && (x <= hi); /* false for NaN */\n",
    ),
    "limit_all": (
        "unsigned int limit_all(double *x, int n, double lo, double hi)",
        "    unsigned int limited = 0U;\n"
        + _LOOP % "limited |= limit(&x[k], lo, hi);"
        + "    return limited;\n",
    ),
    "limit": (
        "unsigned int limit(double *x, double lo, double hi)",
        "    if (!(*x >= lo)) { /* NaN too */\n"
        "        *x = lo;\n        return LIMITED_BITU;\n    }\n"
        "    if (*x > hi) {\n        *x = hi;\n        return LIMITED_BITU;\n    }\n"
        "    return 0U;\n".replace("LIMITED_BIT", str(guard.LIMITED)),
    ),
    "fill": ("void fill(double *x, int n, double value)", _LOOP % "x[k] = value;"),
    "copy": ("void copy(double *to, const double *from, int n)", _LOOP % "to[k] = from[k];"),
}
"""Small functions: signature and body; one that calls another stands before it."""


def checks(text: str) -> str:
    """Definitions of the small functions that ``text`` calls."""
    chosen: list[str] = []
    for name, (signature, body) in _SMALL.items():
        if re.search(rf"\b{name}\(", text):
            definition = f"static {signature}\n{{\n{body}}}"
            chosen.insert(0, definition)
            text += definition
    return "\n\n".join(chosen)
