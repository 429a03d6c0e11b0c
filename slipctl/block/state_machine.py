"""State machines: one state of a few, and conditions that lead from one to another."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, block_from
from slipctl.block.signals import Output, Signal, State
from slipctl.block.text import expression
from slipctl.errors import BadInput, Faults, check_known, nearest

Transition = tuple[str, str, str]
"""From, to, and the condition, ``("apply", "hold", "v_s > v_hi")``."""


def state_machine(
    name: str,
    values: Sequence[str],
    transitions: Iterable[Transition],
    *,
    start: str | None = None,
    doc: str = "",
    period: float | None = None,
    **signals: Any,
) -> Block:
    """Make a block that is in one state of a few.

    In each tick the first transition from the present state whose condition holds is taken, by the
    order in which they are given; at most one a tick. The output ``state`` is where it is then, the
    number of the name: 0, 1, 2 in the order of ``values``. ``show`` draws its diagram.

    Args:
        name: name of the block.
        values: names of the states, ``("apply", "hold", "release")``.
        transitions: from, to and condition, a comparison of signals such as ``"v_s > v_hi"``, with
            ``and``, ``or`` and ``not``; from ``"*"`` leads from every other state.
        start: first state, by default the first of ``values``.
        doc: meaning of the block.
        period: sample period in s if it insists on one.
        **signals: inputs and parameters by name, ``v_s=Input("m/s")``.

    Raises:
        BadInput: a state that is none of ``values`` or that nothing leads to; a condition that is
            no comparison, or of unknown signals; a signal of another role.
    """
    for n, s in signals.items():
        if not isinstance(s, Signal) or s.role not in ("input", "param"):
            raise BadInput(f'{name}: {n} is no signal; write {n}=Input("m/s") or Param("m/s", 1)')
        if n in ("state", "at"):
            raise BadInput(f"{name}: {n} is its own; give the signal another name")
    kept = State("enum", start or next(iter(values), ""), "present state", values=tuple(values))
    found = [_transition(name, kept.values, signals, t) for t in transitions]
    led = {kept.values[int(kept.value)], *(to for _, to, _, _ in found)}
    lost = [v for v in kept.values if v not in led]
    if lost:
        raise BadInput(f"{name}: no transition leads to {lost[0]!r}; add one, or leave it out")

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        now = x["at"]
        then = now
        for here, to, _, condition in reversed(found):
            taken = condition.value({**u, **p})
            if here != "*":
                taken = ca.logic_and(now == kept.code(name, here), taken)
            then = ca.if_else(taken, kept.code(name, to), then)
        return {"at": then}, {"state": then}

    given = [s.named(n) for n, s in signals.items()]
    told = Output("enum", "state it is in", values=kept.values).named("state")
    return block_from(
        name, "step", body, [kept.named("at"), *given, told],
        doc=doc or f"One of {', '.join(kept.values)}.", period=period,
        choices={"transitions": tuple(t[:3] for t in found)},
    )  # fmt: skip


def _transition(
    name: str, values: Sequence[str], signals: Mapping[str, Any], given: Transition
) -> tuple[str, str, str, expression.Expression]:
    """A transition with its condition read."""
    try:
        here, to, text = given
    except (TypeError, ValueError):
        raise BadInput(f"{name}: {given!r} is no transition; write (from, to, condition)") from None
    where = f"{name}: {here} -> {to}"
    for state, allowed in ((here, [*values, "*"]), (to, list(values))):
        check_known(f"{where}:", state, allowed, " is no state")
    if here == to:
        raise BadInput(f"{where}: the transition leads back to its own state; leave it out")
    try:
        found = expression.read(text)
    except Faults as error:
        raise BadInput(f"{where}: {text!r}, {error.lines[0]}") from None
    except (TypeError, AttributeError):
        raise BadInput(f"{where}: {text!r} is no text; write a condition, 'v_s > 1'") from None
    tree = found.tree
    negated = isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.Not)
    if not (isinstance(tree, ast.Compare | ast.BoolOp) or negated):
        raise BadInput(f"{where}: {text!r} is no condition; write a comparison, such as x > 0")
    unknown = [n for n in found.names if n not in signals]
    if unknown:
        raise BadInput(f"{where}: {unknown[0]!r} is unknown{nearest(unknown[0], signals)}")
    return here, to, text, found
