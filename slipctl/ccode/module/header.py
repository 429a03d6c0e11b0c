"""The header of a C module: documented structs, status, prototypes."""

from __future__ import annotations

import textwrap
from typing import Any, NamedTuple

import numpy as np

from slipctl.ccode.module import guard, rates, tick_counter
from slipctl.ccode.module.comments import comment, first_sentence
from slipctl.ccode.module.layout import Member, change_text, noise_text, own_name, range_text
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import size
from slipctl.ccode.passes.scratch import structs
from slipctl.ccode.tree.expressions import number
from slipctl.ccode.tree.printer import signature

STATUS = (
    ("OK", 0, "all is well"),
    ("BAD_INPUT", guard.BAD_INPUT, "step: an input is NaN or infinite; its last good value is"
     " taken"),
    ("BAD_RESULT", guard.BAD_RESULT, "step: the equations gave NaN, infinity or a state out of its"
     " range, or a solver in them failed; refused"),
    ("BAD_PARAM", guard.BAD_PARAM, "init, tune: a parameter or start value is NaN or out of range"),
    ("OFF_RANGE", guard.OFF_RANGE, "step: an input is out of its range, or has changed by more than"
     " it can; its last good value is taken"),
    ("LIMITED", guard.LIMITED, "step: an output was put back into its range; all else as with 0"),
    ("REFUSED", guard.REFUSED, "step: refused, the state is as it was, outputs are held or safe"),
    ("RESET", guard.RESET, "step: refused so often that a part of the state was put to its start"),
    ("NO_INIT", guard.NO_INIT, "step: refused, this state was never set by init"),
)  # fmt: skip
"""Bits of the status: name, value, meaning."""

TIMING = (
    "TIMING", guard.TIMING, "step_counted: the tick is not the one after the last; the same one"
    " again is refused"
)  # fmt: skip
"""The bit of a step that is told the number of its tick."""


def statuses(plan: Plan) -> tuple[tuple[str, int, str], ...]:
    """Bits of the status of a module."""
    return (*STATUS, *[TIMING] * plan.counter)


CONTENT = "<content-hash-->"
"""Stands for the hash of the content until it is known."""


def head(plan: Plan, file: str) -> str:
    """First comment of a file."""
    from slipctl import __version__

    what = first_sentence(plan.block.doc) or f"block {plan.block.name}"
    return comment(
        f"{file}: {what}\n\n"
        f"Written by slipctl {__version__}, content {CONTENT}. Do not edit it: change the model and"
        " write it again.\n\nSPDX-License-Identifier: Apache-2.0 (see LICENSE)"
    )


def member_comment(m: Member, indent: str = "    ", kind: str = "") -> str:
    """Say what a signal is: unit, meaning, convention, range, value, source; of an integer less."""
    s = m.signal
    if kind in ("bool", "unsigned int"):
        most = "1 stands for true" if kind == "bool" else f"at most {s.hi:g}"
        said = [f"{m.name}: {s.doc or m.name}", most]
        said += [f"start {_short(s.value).replace('.0', '')}"] * (s.value is not None)
        return comment("; ".join(" ".join(x.split()) for x in said), indent)
    said = [f"{m.name} [{s.unit}]: {s.doc or m.name}"]
    if s.positive:
        said.append(f"positive = {s.positive}")
    if s.per:
        said.append(f"slip as a {s.per}")
    if range_text(s):
        said.append(f"range {range_text(s)}")
    if change_text(s):
        said.append(f"changes by at most {change_text(s)} in a tick")
        said += [f"and by noise of {noise_text(s)}"] * bool(noise_text(s))
    if s.role == "input":
        said.append("anything, judged by the model itself" if s.judged else
                    f"when bad, its last good value for {s.stale} ticks")  # fmt: skip
    if len(s.shape) == 2:
        said.append(f"{s.shape[0]} x {s.shape[1]}, column by column")
    if s.value is not None:
        word = {"state": "start", "input": "if not known"}.get(s.role, "default")
        said.append(f"{'=' if s.derived and s.role == 'param' else word} {_short(s.value)}")
    if s.safe is not None:
        said.append(f"safe value {number(float(s.safe))}, given while a step is refused")
    if s.source:
        said.append(f"source: {s.source}")
    return comment("; ".join(" ".join(t.split()) for t in said), indent)


def _short(value: Any) -> str:
    if isinstance(value, str):
        return value
    array = np.asarray(value, dtype=float).ravel()
    if (array == array[0]).all():
        return number(float(array[0]))
    shown = ", ".join(number(float(v)) for v in array[:4])
    return f"({shown}{', ...' if array.size > 4 else ''})"


def header(plan: Plan) -> str:
    """Text of the header."""
    lay, big = plan.layout, plan.layout.big
    states = ",\n".join(
        f"{comment(what, '    ')}\n    {big}_{k} = {v}" for k, v, what in statuses(plan)
    )
    included = "\n#include <stdbool.h>\n" * ("bool" in lay.kinds.values())
    parts = [
        head(plan, f"{plan.name}.h"),
        _about(plan),
        f'#ifndef {big}_H\n#define {big}_H\n{included}\n#ifdef __cplusplus\nextern "C" {{\n#endif',
        f"{comment('Status of a call: 0, or bits of these.')}\nenum {{\n{states}\n}};",
        _struct(plan, "in", "Inputs of one tick.", lay.inputs),
        _struct(
            plan,
            "param",
            "Parameters, to be written one by one. They take effect together, when init or tune has"
            " checked them; until then, and if it refuses them, step goes on with those before.",
            lay.params,
        ),
        _struct(plan, "out", "Outputs of one tick.", lay.outputs),
        _state(plan),
        _prototypes(plan),
        f"#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {big}_H */",
    ]
    return "\n\n".join(parts) + "\n"


def _about(plan: Plan) -> str:
    """What the block is, with its parts, choices and sources, and how it is used."""
    b, n = plan.block, plan.name
    tick = f"every {number(plan.period)} s" if plan.period else "once per tick"
    said = [b.doc.strip() or f"The block {b.name}."]
    if b.choices:
        said.append("Choices: " + ", ".join(f"{k} = {v}" for k, v in b.choices.items()))
    for path, leaf in plan.part_docs():
        choices = "".join(f", {k} = {v}" for k, v in leaf.choices.items())
        text = textwrap.indent(leaf.doc.strip(), "    ")
        said.append(f"{path} ({leaf.name}{choices}):\n\n{text}")
    said.append(
        f"Use: {n}_default fills the parameters, {n}_init sets the start state, {n}_step is called"
        f" {tick}. Every number is in the unit stated beside it. No memory is allocated and nothing"
        f" is global; one {n}_state is one instance. {memory(plan)}"
    )
    return comment("\n\n".join(said))


def memory(plan: Plan) -> str:
    """Say where the step keeps its intermediate results."""
    _, _, sz_iw, sz_w = plan.equations.work
    if not plan.work_in_state:
        return "The step keeps its intermediate results in registers and on the stack."
    many = size(plan.real) * sz_w + 4 * (sz_iw + plan.can_fail)
    return f"Scratch memory of {many} bytes lies in {plan.name}_state.work."


def _struct(plan: Plan, suffix: str, what: str, members: tuple[Member, ...]) -> str:
    lines = [comment(what), f"typedef struct {plan.name}_{suffix} {{"]
    for m in members:
        lines += [member_comment(m), f"    {m.declared(plan.real)}"]
    if not members:
        lines.append(f"    {plan.real} unused; /* there are none; C wants a member */")
    return "\n".join([*lines, f"}} {plan.name}_{suffix};"])


def _state(plan: Plan) -> str:
    n, lay, real = plan.name, plan.layout, plan.real
    lines = []
    if lay.derived:
        lines += [comment("Derived parameters, computed by init and tune.")]
        lines += [f"struct {n}_derived {{"]
        for m in lay.derived:
            lines += [member_comment(m), f"    {m.declared(real)}"]
        lines += ["};", ""]
    ages = [
        f"    int age[{plan.n_in}]; /* ticks without, less good ones since; -1: none yet */",
        f"    unsigned int back[{plan.n_in}]; /* 1: good in the last tick, but away before */",
        "    unsigned int fresh; /* 1 if all were good in the last tick, and are sure */",
    ]
    lines += [
        f"struct {n}_guard {{",
        f"    {n}_in last; /* inputs as the equations see them: the last good ones */",
        *ages * bool(plan.n_in),
        "    unsigned int refused; /* ticks refused in a row since the last good one or reset */",
        *["    unsigned int missed; /* ticks refused since the last good one */"]
        * bool(plan.counters),
        "    unsigned int mark; /* set by init, looked for by step */",
        "};",
        "",
    ]
    if lay.states:
        lines += _kept(plan)
    if plan.work_in_state:  # at file scope, as in C++ a struct within another is another
        made = plan.equations
        _, _, sz_iw, sz_w = made.work
        more = [f"{real} w[{w}];" for w in [sz_w - made.in_arrays] if w]
        more += [f"int iw[{sz_iw}];"] * bool(sz_iw)
        more += ["int failed; /* a solver did not come to its end */"] * plan.can_fail
        what = "Arrays of functions of step, where they would take too much of the stack."
        lines += [comment(what), *structs(made.arrays, f"{n}_work", real, more)]
    if lay.measured:
        told = "What the parts of a tick give: the outputs, and measurements beside them."
        lines += [comment(told), f"{lay.now} {{"]
        for m in lay.signals:
            kind = lay.kind(m, real)
            lines += [member_comment(m, kind=kind), f"    {m.declared(kind)}"]
        lines += ["};", ""]
    what = "State: set by init, changed by step; a copy of the struct saves an instance."
    lines += [comment(what), f"typedef struct {n}_state {{"]
    for s in state_members(plan):
        lines.append(f"    {s.kind} {s.name};{f' /* {s.told} */' * bool(s.told)}")
    return "\n".join([*lines, f"}} {n}_state;"])


class StateMember(NamedTuple):
    """A member of the state struct: its type in C, name, bytes, and what it is."""

    kind: str
    name: str
    bytes: int
    told: str


def state_members(plan: Plan) -> list[StateMember]:
    """Members of the state struct in order, where an int has four bytes."""
    n, lay, real, width = plan.name, plan.layout, plan.real, size(plan.real)
    sizes, (_, _, sz_iw, sz_w) = lay.words(real), plan.equations.work
    kept, held = lay.kept_offsets(real)[-1], width * max(sizes["n_out"], 1)
    counts = (2 * plan.n_in + 1) * bool(plan.n_in) + 2 + bool(plan.counters)
    measured = lay.offsets(real)[-1] if lay.measured else 0
    guards = width * max(plan.n_in, 1) + 4 * counts
    work = width * sz_w + 4 * (sz_iw + plan.can_fail)
    struct, tick = f"struct {n}", rates.TICK.format(n=n, real=real)
    rows = (
        (lay.states, f"{struct}_kept", "kept", kept, "of the last good tick"),
        (lay.derived, f"{struct}_derived", "derived", width * sizes["n_derived"], ""),
        (True, f"{n}_param", "in_force", width * max(sizes["n_param"], 1),
         "parameters that init or tune took last"),
        (True, f"{n}_out", "held", held, "outputs of the last good step"),
        (lay.measured, lay.now, "measured", measured, "of the last good step"),
        (True, f"{struct}_guard", "guard", guards, "what the guards keep"),
        (plan.next_in_state and lay.states, f"{struct}_kept", "next", kept, "scratch of step"),
        (plan.work_in_state, f"{struct}_work", "work", work, "scratch of step"),
        (plan.rates, tick, "tick", held + 2 * width,
         "a tick in hand, between the steps of its rates"),
        (plan.counter, tick_counter.COUNTER, "counter", 8, ""),
    )  # fmt: skip
    return [
        StateMember(kind, name, -(-many // width) * width, told)
        for there, kind, name, many, told in rows if there
    ]  # fmt: skip


def place_in_state(plan: Plan, name: str) -> int:
    """Bytes from the begin of the state to a member that it has."""
    names = [m.name for m in state_members(plan)]
    return sum(m.bytes for m in state_members(plan)[: names.index(name)])


def memory_bytes(plan: Plan) -> dict[str, int]:
    """Size of each struct of the module, by its short name."""
    words = plan.layout.words(plan.real)
    found = {k: size(plan.real) * max(words[f"n_{k}"], 1) for k in ("in", "param", "out")}
    return found | {"state": sum(m.bytes for m in state_members(plan))}


def _kept(plan: Plan) -> list[str]:
    """Structs of what a good tick keeps: one for each part, and the whole."""
    real, lines, whole = plan.real, list[str](), list[str]()
    for struct, own in plan.layout.kept:
        members = [
            line for m in own for name in [own_name(m) if struct else m.c]
            for kind in [plan.layout.kind(m, real)]
            for line in (member_comment(m, kind=kind),
                         f"    {m.declared(kind, name)}")
        ]  # fmt: skip
        if not struct:
            whole += members
            continue
        path = own[0].name.rpartition(".")[0]
        kind = f"struct {plan.name}_kept_{struct}"
        lines += [comment(f"What {path} keeps for the next tick."), f"{kind} {{", *members]
        lines += ["};", ""]
        whole.append(f"    {kind} {struct};")
    what = comment("What a good tick keeps for the next one.")
    return [*lines, what, f"struct {plan.name}_kept {{", *whole, "};", ""]


def prototypes(plan: Plan) -> dict[str, str]:
    """Declarations of the functions of the module, by their short names."""
    n = plan.name
    param, state = f"const {n}_param *param", f"{n}_state *state"
    arguments = {
        "default": ("void", f"{n}_param *param"),
        "init": ("int", param, state),
        "tune": ("int", param, state),
        "step": ("int", f"const {n}_in *in", param, state, f"{n}_out *out"),
    }
    if plan.block.composition.split:
        arguments["prepare"] = arguments["step"][:-1]
        arguments["feedback"] = arguments["step"]
    texts = {k: signature(a[0], f"{n}_{k}", a[1:]) for k, a in arguments.items()}
    texts |= rates.prototypes(plan) if plan.rates else {}
    return texts | ({"step_counted": tick_counter.prototype(plan)} if plan.counter else {})


def _prototypes(plan: Plan) -> str:
    big, texts = plan.layout.big, prototypes(plan)
    told = {
        "default": "Fill the parameters with their defaults; derived ones are not among them.",
        "init": (
            "Check the parameters, compute the derived ones, set the start state. Status 0 or"
            f" {big}_BAD_PARAM: then the defaults are in force, and the state starts as with them."
        ),
        "tune": (
            "Check the parameters, compute the derived ones and put them all in force at once; the"
            f" rest of the state stays. Status 0 or {big}_BAD_PARAM: then those before stay."
        ),
        "step": (
            "One tick, with the parameters in force, whatever param has become since. Status 0, or"
            f" bits that tell what was wrong. With {big}_REFUSED the state is"
            " untouched and the outputs are those of the last good step (before the first one:"
            " zero, or the end of their range nearest to it)"
            + (", or their safe value where one is stated." if plan.safe else ".")
            + " Else the step was made, with the last good value of an input that was bad."
        ),
    }
    if plan.block.composition.split:
        read = ", ".join(m.c for m in plan.early) or "nothing"
        told["prepare"] = (
            f"What can be done of the next tick before its inputs are there: of in it reads {read}."
            f" Status 0, or {big}_REFUSED with the reason: then nothing is prepared, and the next"
            " tick does it all. Parameters that tune takes after it count from the tick after next."
        )
        told["feedback"] = (
            "The rest of the tick, of all inputs; without prepare before it, the whole. Status and"
            " outputs are those of step, which does the same."
        )
    told |= rates.rate_docs(plan) if plan.rates else {}
    told |= {"step_counted": tick_counter.counter_doc(plan)} if plan.counter else {}
    return "\n\n".join(f"{comment(what)}\n{texts[k]};" for k, what in told.items())


def bit(name: str) -> int:
    """Value of a status."""
    return next(v for k, v, _ in STATUS if k == name)
