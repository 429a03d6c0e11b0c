"""What the head of a measured curve says: units to convert, quantities that the law has not."""

from __future__ import annotations

import ast
import keyword
import re
from collections.abc import Mapping
from typing import Any

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.block.units import unit_walk
from slipctl.block.units.unit_algebra import Unit, dimension_equal, unit
from slipctl.errors import BadInput

Units = Mapping[str, str]

WORDS = re.compile(rf"\b({'|'.join(keyword.kwlist)})\b")
"""Words that may head a column and are none of an expression, such as lambda."""


def python_name(text: str) -> str:
    """A name or an expression whose names may be written in one: lambda_ for lambda."""
    return WORDS.sub(r"\1_", text)


def read_heads(
    law: Block, source: str, signals: Mapping[str, Signal], heads: Units,
    columns: Mapping[str, str], known: Mapping[str, Any], si: bool,
) -> tuple[dict[str, str], list[str]]:  # fmt: skip
    """Expression of each signal that columns give, and a line for all that is not plain.

    A column that the law reads as a share of something (``creep * v``) and that is in the unit of
    the signal itself (``creep [m/s]``) is that signal.

    Args:
        law: the law.
        source: of the curve.
        signals: inputs and measured output of the law.
        heads: unit of each column, ``""`` where the head says none.
        columns: expressions that the person gave.
        known: what is told beside the columns.
        si: whether a head without a unit is one in SI, as of columns in Python.

    Raises:
        BadInput: a column measures another quantity than the law takes there.
    """
    found: dict[str, str] = {}
    notes: list[str] = []
    used = {n for n in heads if n in {**law.params, **law.law_data.beside}}
    bare: dict[str, str] = {}
    for n, s in signals.items():
        if n not in columns and n in heads:
            used.add(n)
            if not heads[n]:
                bare[n] = s.unit
            continue
        expression = columns.get(n) or ("" if n in known else law.law_data.readings.get(n, ""))
        mine = [c for c in names_in(expression) if c in heads] if expression else []
        used.update(mine)
        mine = [c for c in mine if n in columns or c not in {**law.inputs, **law.params}]
        if n in columns:
            bare.update({c: "1" for c in mine if not heads[c] and c not in signals})
            notes += _own_expression(law, source, s, expression, heads)
        elif len(mine) == 1:
            (c,) = mine
            wanted = _share(law, s, expression, c)
            if not heads[c]:
                bare[c] = wanted
            elif dimension_equal(heads[c], wanted):
                pass
            elif dimension_equal(heads[c], s.unit):
                expression = c
                notes.append(f"{source}: {c} is in {heads[c]}, so it is {n} itself, not read as"
                             f" {law.law_data.readings[n]}")  # fmt: skip
            else:
                raise BadInput(
                    f"{source}: the column {c} is in {heads[c]}, the law reads {n} as {expression}"
                    f" and wants it in {wanted}, or {n} itself in {s.unit}"
                )
        if expression:
            found[n] = expression
    if bare and not si:
        said = ", ".join(f"{c} in {u}" if u != "1" else f"{c} as a number" for c, u in bare.items())
        notes.insert(0, f"{source}: its head has no unit for {', '.join(bare)}; read {said}")
    turned = {c: u for c, u in heads.items() if c in used and u and unit(u).scale != 1.0}
    if turned:
        said = ", ".join(f"{c} from {u} to {_plain(law, u)}" for c, u in turned.items())
        notes.insert(0, f"{source}: converted {said}")
    if spare := [c for c in heads if c not in used]:
        notes.append(f"{source}: not used: {', '.join(spare)}")
    return found, notes


def _own_expression(law: Block, source: str, s: Signal, expression: str, heads: Units) -> list[str]:
    """Refuse an expression of a person that gives another quantity than the signal.

    Its numbers may carry units (``omega * 0.625 - v``); then a line tells that they have to.
    """
    given = {n: x.unit for n, x in {**law.inputs, **law.params, **law.law_data.beside}.items()}
    given |= {c: _plain(law, u) for c, u in heads.items() if u}
    names = names_in(expression)
    if any(n not in given for n in names):
        return []
    symbols = {n: ca.SX.sym(n) for n in names}
    value = ca.SX(evaluate(expression, symbols, f"{source}: {s.name}"))
    wrong = unit_walk.check({s.name: value}, {n: given[n] for n in names}, {s.name: s.unit})
    if not wrong:
        return []
    if any(isinstance(k, ast.Constant) for k in ast.walk(ast.parse(expression, mode="eval"))):
        units = ", ".join(f"{n} in {given[n]}" for n in names)
        return [f"{source}: {s.name} = {expression} is in {s.unit} only if its numbers have units;"
                f" {units}"]  # fmt: skip
    raise BadInput(f"{source}: {s.name} = {expression}: {wrong[0].partition(': ')[2]}")


def _share(law: Block, s: Signal, expression: str, column: str) -> str:
    """Unit that a column has to have for a product of the law's own to be in the signal's."""
    units: dict[str, Any] = {n: unit(x.unit) for n, x in {**law.inputs, **law.params}.items()}
    rest = evaluate(expression, units | {column: Unit(1.0, ())}, f"{law.name}: {s.name}")
    return _named(law, unit(s.unit) / rest)


def _plain(law: Block, text: str) -> str:
    """The same quantity without a factor: N for kN."""
    return _named(law, Unit(1.0, unit(text).dims))


def _named(law: Block, wanted: Unit) -> str:
    """A unit as the law writes it."""
    every = (x.unit for x in {**law.inputs, **law.params, **law.outputs}.values())
    return next((u for u in every if unit(u).same(wanted)), str(wanted))
