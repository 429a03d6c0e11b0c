"""The source of a C module: equations, checks, init, tune and step."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

import casadi as ca

from slipctl.ccode.write.comments import comment
from slipctl.ccode.write.expressions import number
from slipctl.ccode.write.header import (
    head,
    identifier_free,
    next_struct,
    prototype,
    prototypes,
)
from slipctl.ccode.write.kernel import Kernel, definitions
from slipctl.ccode.write.layout import Member
from slipctl.ccode.write.plan import Plan, constant, first_sentence
from slipctl.ccode.write.precision import in_precision
from slipctl.ccode.write.structure import assign


def source(plan: Plan) -> str:
    """Text of the source."""
    n, lay = plan.name, plan.layout
    functions = "\n\n".join(
        [_equations(plan), _default(plan), _param_ok(plan), _tune(plan), _init(plan)]
        + [made for made in (_finite(plan), _hold(plan)) if made] + [_step(plan)]
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
        definitions([plan.equations, Kernel(helpers=frozenset(plan.start.helpers))], plan.real)
    )
    parts.append(checks(functions))
    text = "\n\n".join(p.strip("\n") for p in [*parts, functions] if p.strip()) + "\n"
    if re.search(r"\bNULL\b", text):
        text = text.replace(
            "#include <stdbool.h>\n", "#include <stdbool.h>\n#include <stddef.h>\n", 1
        )
    return in_precision(text, plan.real, plan.block.name)


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
    what = comment(f"Equations of {plan.block.name}; {n}.h says where they come from.")
    return "\n".join([what, signature, "{", *voids, *lines, "}"])


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
    lines += [""] * bool(lines)
    for i, (m, pointer) in enumerate(plan.results):
        texts = [made.results[i, k] for k in range(m.size)]
        lines += [f"    {line}" for line in assign(f"{pointer}{m.c}", texts, not m.scalar)]
    return lines + ["    return failed;"] * made.calls


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
    return _define(prototypes(plan)["default"], lines)


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
    void = [] if checks else ["(void)param;"]
    return _define(
        f"static bool param_ok(const {plan.name}_param *param)",
        [*void, f"return {_conjunction(checks) or 'true'};"],
    )


def _tune(plan: Plan) -> str:
    n, big, derived = plan.name, plan.layout.big, plan.layout.derived
    lines = [f"struct {n}_derived now;"] if derived else ["(void)state;"]
    lines.append(_if(["!param_ok(param)"], f"return {big}_BAD_PARAM;"))
    if derived:
        lines += plan.start_lines(derived, 0, "now.")
        good = _conjunction([within(plan, m, "now.") for m in derived])
        lines += [_if([f"!({good})"], f"return {big}_BAD_PARAM;"), "state->derived = now;"]
    lines.append(f"return {big}_OK;")
    return _define(prototypes(plan)["tune"], lines)


def _init(plan: Plan) -> str:
    n, big, lay = plan.name, plan.layout.big, plan.layout
    computed = [m for m in lay.states if m.signal.derived]
    lines = [f"int status = {n}_tune(param, state);"]
    used = "param->"
    if lay.derived or computed:
        lines[0:0] = [f"{n}_param safe;"]
        lines += [
            *["safe = *param;"] * bool(computed),
            _if([f"status != {big}_OK"], f"{n}_default(&safe);", f"(void){n}_tune(&safe, state);"),
        ]
        used = "safe."
    for m in lay.states:
        if not m.signal.derived:
            lines += _constant(m, "state->", m.signal.value)
    if computed:
        texts = plan.start_lines(lay.states, len(lay.derived), "state->")
        lines += [t.replace("param->", used) for t in texts]
        good = _conjunction([within(plan, m, "state->") for m in computed])
        lines.append(_if([f"!({good})"], f"status = {big}_BAD_PARAM;"))
    for m in lay.outputs:
        before = plan.safe.get(m.c, min(max(0.0, m.signal.lo), m.signal.hi))
        lines += _constant(m, "state->held.", before)
    lines.append("return status;")
    return _define(prototypes(plan)["init"], lines)


# ---- step ---------------------------------------------------------------------------------------


def _finite(plan: Plan) -> str:
    """Functions that say whether what enters the step and what comes out of it is finite."""
    n, lay = plan.name, plan.layout
    inputs = [(m, "in->", k) for m in lay.inputs for k in range(m.size)]
    found = []
    if inputs:
        found.append(_define(f"static bool in_finite(const {n}_in *in)", _zero(inputs)))
    if plan.untested:
        arguments = [f"const struct {n}_next *next"] * bool(lay.states) + [f"const {n}_out *now"]
        lines = _zero(plan.untested)
        text = "\n".join(lines)
        voids = [f"(void){a};" for a in ("next", "now") if identifier_free(text, a)]
        signature = prototype(plan, "static bool", "result_finite", *arguments)
        found.append(_define(signature, [*(v for v in voids if lay.states), *lines]))
    return "\n\n".join(found)


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
    if not safe:
        return ""
    lines = ["*out = state->held;"]
    for m in plan.layout.outputs:
        if m.c in safe:
            lines += _constant(m, "out->", safe[m.c])
    what = comment(
        "Outputs of a step that is refused: the safe value, or that of the last good step."
    )
    return f"{what}\n" + _define(f"static void hold(const {n}_state *state, {n}_out *out)", lines)


def _step(plan: Plan) -> str:
    n, big, lay = plan.name, plan.layout.big, plan.layout
    hold = "hold(state, out);" if plan.safe else "*out = state->held;"
    has_next = bool(lay.states)
    following = "state->next" if plan.next_in_state else "next"
    lines = [f"{n}_out now;"]
    if has_next and not plan.next_in_state:
        lines.append(f"struct {n}_next next;")
    if lay.inputs:
        lines.append(_if(["!in_finite(in)"], hold, f"return {big}_BAD_INPUT;"))
    bounds = [within(plan, m, "in->") for m in lay.inputs if _has_range(plan, m)]
    if bounds:
        lines.append(_if([f"!({_conjunction(bounds)})"], hold, f"return {big}_OFF_RANGE;"))
    passed = [f"&{following}"] * has_next + ["&now"]
    call = f"equations({', '.join(['in', 'param', 'state', *passed])})"
    held = (hold, f"return {big}_BAD_RESULT;")
    lines.append(_if([f"{call} != 0"], *held) if plan.can_fail else f"{call};")
    if plan.untested:
        lines.append(_if([f"!result_finite({', '.join(passed)})"], *held))
    lines += [
        f"state->{m.c} = {following}.{m.c};" if m.scalar
        else f"copy(state->{m.c}, {following}.{m.c}, {m.size});"
        for m in lay.states
    ]  # fmt: skip
    limits = [_limited(plan, m, "now.") for m in lay.outputs if _has_range(plan, m)]
    if limits:
        lines.insert(0, "unsigned int limited = 0U;")
        lines += [f"limited |= {text};" for text in limits]
    status = f"(limited != 0U) ? {big}_LIMITED : {big}_OK" if limits else f"{big}_OK"
    lines += ["state->held = now;", "*out = now;", f"return {status};"]
    return _define(prototypes(plan)["step"], lines)


# ---- small text ---------------------------------------------------------------------------------


def _define(signature: str, lines: Iterable[str]) -> str:
    body = "\n".join(f"    {line}" for line in lines)
    return f"{signature}\n{{\n{body}\n}}"


def _if(condition: list[str], *statements: str) -> str:
    body = "\n".join(f"        {s}" for s in statements)
    return f"if ({condition[0]}) {{\n{body}\n    }}"


def _conjunction(tests: list[str]) -> str:
    """Join conditions with && over as many lines as it takes."""
    text, width = "", 0
    for k, t in enumerate(tests):
        if k and width + len(t) > 80:
            text, width = f"{text}\n          && {t}", len(t) + 13
        else:
            text, width = f"{text}{' && ' if k else ''}{t}", width + len(t) + 4
    return text


def _has_range(plan: Plan, m: Member) -> bool:
    """Whether a signal has a limit that a number in C can pass."""
    return any(math.isfinite(v) for v in plan.limits(m))


def _ends(plan: Plan, m: Member) -> tuple[str, str]:
    """Least and greatest number of a signal, in C."""
    lo, hi = plan.limits(m)
    return (
        number(lo) if math.isfinite(lo) else "-DBL_MAX",
        number(hi) if math.isfinite(hi) else "DBL_MAX",
    )


def _limited(plan: Plan, m: Member, pointer: str) -> str:
    """Expression: put a signal into its range, and say whether that changed it."""
    lo, hi = _ends(plan, m)
    if m.scalar:
        return f"limit(&{pointer}{m.c}, {lo}, {hi})"
    return f"limit_all({pointer}{m.c}, {m.size}, {lo}, {hi})"


def within(plan: Plan, m: Member, pointer: str) -> str:
    """Condition: a finite number in the range of the signal."""
    lo, hi = _ends(plan, m)
    if m.scalar:
        return f"within({pointer}{m.c}, {lo}, {hi})"
    return f"all_within({pointer}{m.c}, {m.size}, {lo}, {hi})"


_LOOP = "    int k;\n    for (k = 0; k < n; ++k) {\n        %s\n    }\n"
_SMALL = {
    "zero_of": (
        "double zero_of(const double *x, int n)",
        "    double zero = 0.0;\n" + _LOOP % "zero *= x[k];" + "    return zero;\n",
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
        "    if (*x < lo) {\n        *x = lo;\n        return 1U;\n    }\n"
        "    if (*x > hi) {\n        *x = hi;\n        return 1U;\n    }\n    return 0U;\n",
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
