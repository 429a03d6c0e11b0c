"""README of a folder: how its module is built, tested and used, for who has nothing of slipctl."""

from __future__ import annotations

from slipctl.block.text.failures import FAILURE_HEAD, failures_of
from slipctl.ccode.compile.board import EMULATOR, TARGETS, TOOLS
from slipctl.ccode.compile.files import TOOLCHAIN
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.comments import first_sentence
from slipctl.ccode.module.header import CONTENT, memory, statuses
from slipctl.ccode.module.layout import Member, c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.rates import groups
from slipctl.ccode.ship.readable import table
from slipctl.ccode.tree.expressions import number


def readme(plan: Plan) -> str:
    """Text of the README."""
    from slipctl import __version__

    lay, words = plan.layout, plan.layout.words(plan.real)
    kinds = {"inputs": "in", "parameters": "param", "states": "state", "outputs": "out"}
    shared, idle = _shared(plan), ", ".join(f"`{c}`" for c in _idle(plan))
    parts = [(f"`{path}`", _cell(first_sentence(leaf.doc))) for path, leaf in plan.part_docs()]
    failures = failures_of(plan.block)
    return fill_template(
        "README.md", **words, what=first_sentence(plan.block.doc), version=__version__,
        content=CONTENT, toolchain=TOOLCHAIN, target=next(iter(TARGETS)), tools=TOOLS,
        emulator=EMULATOR, files=", ".join(f"`{f}`" for f in plan.files),
        counts=", ".join(f"{what} {words[f'n_{k}']}" for what, k in kinds.items()),
        parts=table(["part", "what it does"], parts) if parts else "",
        float=plan.real == "float", measured=bool(lay.measured), safe=_safe(plan),
        period=number(plan.period) if plan.period else "", pieces=_pieces(plan),
        bits="\n".join(f"| `{lay.big}_{k}` | {v} | {what} |" for k, v, what in statuses(plan)),
        memory=memory(plan), parameters=shared or idle, idle=idle,
        shared=table(["quantity", "default", "members of the struct"], map(_group, shared))
        if shared else "",
        failures=table(FAILURE_HEAD, failures) if failures else "",
    )  # fmt: skip


def _cell(text: str) -> str:
    """Text for a table, where a bar would end it."""
    return text.replace("|", r"\|")


def _group(members: list[Member]) -> tuple[str, str, str]:
    """Row of parameters that go together: what they are, default and members."""
    first = members[0]
    s = first.signal
    unit = "" if s.unit == "1" else f", in {s.unit}"
    value = number(float(s.value)) if first.scalar else "an array"
    return _cell(f"{s.doc or s.name}{unit}"), value, ", ".join(f"`{m.c}`" for m in members)


def _shared(plan: Plan) -> list[list[Member]]:
    """Parameters of different parts with one name, unit and default, other than the tick."""
    groups: dict[object, list[Member]] = {}
    for m in plan.layout.params:
        s, values = m.signal, c_elements(m, m.signal.value).tolist()
        if s.unit == "s" and values == [plan.period]:
            continue
        groups.setdefault((m.name.rpartition(".")[2], s.unit, s.shape, *values), []).append(m)
    return [g for g in groups.values() if len(g) > 1]


def _idle(plan: Plan) -> list[str]:
    """Parameters that no equation and no start value reads, as far as they can be seen."""
    lay, made = plan.layout, plan.equations
    nodes = [*made.lines, *made.results.values(), *made.functions.values()]
    nodes += plan.start_lines(lay.derived, 0, "now.")
    nodes += plan.start_lines(lay.states, len(lay.derived), "state->")
    members = (n for node in nodes for n in node.walk() if n.kind == "member")
    read = {n.head[2:] for n in members if n.parts[0].head == "param"}
    return [m.c for m in lay.params if m.c not in read]


def _pieces(plan: Plan) -> str:
    """What may be called in the place of the step, where there is a function for each rate."""
    if not plan.rates:
        return ""
    row = groups(plan)
    named = ", ".join(
        f"`{plan.name}_{g.name}`" + (f" (every {g.ticks}th tick)" if g.ticks > 1 else "")
        for g in row
    )
    return f"   or in its place, with the same arguments and in this order, {named},"


def _safe(plan: Plan) -> str:
    """Outputs that give something else while a step is refused, to go on a sentence."""
    units = {m.c: m.signal.unit for m in plan.layout.outputs}
    said = [f"`{c}` {number(v)} {units[c]}" for c, v in plan.safe.items()]
    return f", but {', '.join(said)}" if said else ""
