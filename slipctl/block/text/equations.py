"""Blocks written as text: equations, and what their names mean.

``mu = c*(exp(-a*v_s) - exp(-b*v_s)) where v_s [m/s], c = 1 in 0 .. 2, a = 0.54 s/m, b = 1.2 s/m``

``x' = ...`` makes a flow, ``x+ = ...`` a step, neither a law. Behind ``where`` a name with a unit
is an input (or the unit of a result), one with a value a parameter (or the start of a state).
``on wet: c = 0.3`` is a rail condition. All faults of a text are told at once.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, block_from
from slipctl.block.signals import Signal
from slipctl.block.text import expression, formula
from slipctl.block.text.expression import Expression, interpolated
from slipctl.block.text.meanings import EQUATION, MOST, Item, Meaning, Meanings, Table, bare
from slipctl.block.units import unit_walk
from slipctl.block.units.unit_algebra import checking_units, parse_quantity, si_text, unit
from slipctl.errors import BadInput, Faults, nearest

PLACES = 200
"""Parts of a text that are looked through one by one for where a unit goes wrong."""


def from_text(
    text: str,
    *,
    equations: Mapping[str, str] | None = None,
    name: str | None = None,
    inputs: Mapping[str, Item] | None = None,
    parameters: Mapping[str, Item] | None = None,
    states: Mapping[str, Item] | None = None,
    outputs: Mapping[str, Item] | None = None,
    tables: Mapping[str, Mapping[str, Any]] | None = None,
    conditions: Mapping[str, Mapping[str, Item]] | None = None,
    period: Item | None = None,
    doc: str = "",
    units: str = "checked",
    where: Callable[[tuple[str, ...]], str] | None = None,
) -> Block:
    """Make a block of equations written as text; nothing of it is run as Python.

    Args:
        text: ``"mu = c*(exp(-a*v_s) - exp(-b*v_s))"``, an equation a line (or with ``;``
            between), with or without ``where`` and what the names mean.
        equations: further ones by their results, ``{"z+": "z + e"}``.
        name: of the block; its kind (law, flow, step) by default.
        inputs: unit of each, ``{"v_s": "m/s"}``, with a range ``"m/s in 0 .. 50"``, or a table
            ``{"unit": "m/s", "range": [0, 50], "doc": ..., "positive": "braking"}``.
        parameters: ``{"a": "0.54 s/m in 0.1 .. 2"}``, or a table with ``value``.
        states: start of each, ``{"z": "0 N m"}``; it may be an expression in a table with ``unit``.
        outputs: units of results; with it what is not named is no output but an intermediate
            result. Without it all are outputs, in the units that the equations give.
        tables: functions by points, ``{"F": {"over": "m/s", "unit": "kN", "points": [[0, 10],
            [20, 8]]}}``, called as ``F(v)``: straight lines, the ends held.
        conditions: parameter sets by rail condition.
        period: of a step, ``"2 ms"``; the equations may then use ``tick``.
        doc: what it is.
        units: ``"printed"`` for a form that cannot be made consistent.
        where: gives what stands in front of a fault, from the keys that lead to it.

    Raises:
        Faults: all that is wrong, each with its place.
    """
    reader = _Reader(where)
    reader.sizes(text)
    head = reader.sentence(text)
    for kind, given in (("inputs", inputs), ("parameters", parameters), ("states", states),
                        ("outputs", outputs)):  # fmt: skip
        reader.declare(kind, given or {})
    for table, spec in (tables or {}).items():
        reader.table(table, spec)
    reader.equations(head)
    for result, formula_text in (equations or {}).items():
        reader.equations(f"{result} = {formula_text}", len(f"{result} = "))
    reader.known_names()
    given_conditions = {**reader.conditions, **(conditions or {})}
    return reader.block(name, bool(outputs), given_conditions, period, doc, units)


@dataclass(frozen=True)
class _Equation:
    """One equation: its result, ``'`` or ``+`` or nothing, its expression, where it stands."""

    name: str
    mark: str
    expression: Expression
    keys: tuple[str, ...]
    place: str
    offset: int


class _Reader(Meanings):
    """Collects what a text says, and all that is wrong with it."""

    def __init__(self, where: Callable[[tuple[str, ...]], str] | None) -> None:
        super().__init__(where)
        self.found: list[_Equation] = []

    # ---- equations ----------------------------------------------------------------------------

    def equations(self, text: str, before: int = 0) -> None:
        """Read ``name = expression``, one a line or with a semicolon between.

        Args:
            text: the equations.
            before: letters of the first line that a person did not write.
        """
        calls = frozenset(self.tables)
        lines = _lines(text)
        if len(lines) > MOST:
            raise Faults([f"there are {len(lines)} equations, at most {MOST} are read"])
        for number, start, piece in lines:
            match = EQUATION.match(piece)
            line = f"line {number}, " if number > 1 else ""
            if match is None:
                shown = piece.strip()[:40]
                self.wrong(("equations",), f"{line}column {start + 1}: {shown!a} is no equation;"
                           " write name = expression, x' = ... or x+ = ...")  # fmt: skip
                continue
            name, mark = match[1], match[2]
            offset = start + match.end() - (before if number == 1 else 0)
            keys = (f"{name}{mark}",)
            if not self.good_name(keys, name):
                continue
            try:
                found = expression.read(piece[match.end() :], calls)
            except Faults as error:
                for told in error.lines:
                    self.wrong(keys, line + _moved(told, offset))
                continue
            self.found.append(_Equation(name, mark, found, keys, line, offset))

    def known_names(self) -> None:
        """Tell results that come twice, names that nobody declared, and mixed kinds."""
        seen: set[str] = set()
        known = {*self.meanings, *(e.name for e in self.found)}
        functions = {*expression.FUNCTIONS, *expression.CONSTANTS, *self.tables, "tick"}
        for e in self.found:
            if e.name in seen:
                self.wrong(e.keys, f"{e.name} has two equations")
            seen.add(e.name)
            for node in ast.walk(e.expression.tree):
                if not isinstance(node, ast.Name) or node.id in known or node.id in functions:
                    continue
                close = nearest(node.id, known)
                hint = close if "did you mean" in close else f"; declare it, {node.id} [unit]"
                at = f"{e.place}column {node.col_offset + e.offset + 1}"
                self.wrong(e.keys, f"{at}: {node.id!r} is not declared{hint}")
        if not self.found and not self.faults:
            self.wrong((), "there is no equation; write mu = ...")
        if len({e.mark for e in self.found if e.mark}) > 1:
            self.wrong((), "x' is of continuous time, x+ of ticks; one block has one of them")

    # ---- the block ----------------------------------------------------------------------------

    def block(
        self, name: str | None, listed: bool, conditions: Mapping[str, Mapping[str, Item]],
        period: Item | None, doc: str, units: str,
    ) -> Block:  # fmt: skip
        """Make the block, or tell all that is wrong."""
        mark = next((e.mark for e in self.found if e.mark), "")
        kind = {"'": "flow", "+": "step", "": "law"}[mark]
        seconds = self.seconds(period, kind)
        used = {n for e in self.found for n in e.expression.names}
        if "tick" in used and "tick" not in self.meanings:
            if seconds is None:
                self.wrong((), "tick is the period of a step; say period = '2 ms', or declare tick")
            else:
                self.meanings["tick"] = Meaning("", ("tick",), "s", seconds, doc="period")
        signals = self.signals(listed, used)
        order = self.ordered()
        self.stop()
        equations = _Equations(tuple(order), dict(self.tables), tuple(
            s.name for s in signals if s.role == "output"))  # fmt: skip
        if units != "printed":
            signals = self.check_units(equations, signals, kind)
        if kind == "step":  # of a law, what searches and fits it wants numbers
            signals += self.points([s.name for s in signals])
            equations = replace(equations, settable=True)
        self.stop()
        values = self.condition_values(conditions, {s.name: s for s in signals})
        self.stop()
        try:
            made = block_from(
                name or kind, kind, equations.body, signals, period=seconds, doc=doc, units=units,
                conditions=values,
            )  # fmt: skip
            if all(s.value is not None for s in made.params.values()):
                made.param_values()
                made.start()
            return made
        except BadInput as error:
            self.wrong((), str(error))
            raise Faults(self.faults) from None

    def points(self, taken: Sequence[str]) -> list[Signal]:
        """Points of the tables as parameters."""
        found = [(table, p) for table, t in self.tables.items() for p in t.params(table)]
        for table, p in found:
            if p.name in taken:
                self.wrong(("tables", table), f"{p.name} is a parameter of the table {table} and a"
                           " name of its own; rename one")  # fmt: skip
        return [p for _, p in found]

    def stop(self) -> None:
        if self.faults:
            raise Faults(self.faults)

    def seconds(self, period: Item | None, kind: str) -> float | None:
        if period is None:
            return None
        try:
            found = parse_quantity(str(period), "s", "period")
            if not found > 0:
                raise BadInput(f"period {period!r:.30} must be positive")
            if kind != "step":
                raise BadInput("only a step, x+ = ..., has a period")
            return found
        except BadInput as error:
            self.wrong(("period",), str(error))
            return None

    def signals(self, listed: bool, used: set[str]) -> list[Signal]:
        """What each name is, by its equation and by what was said of it."""
        results = {e.name: e for e in self.found}
        found: list[Signal] = []
        unread = bool(self.faults)
        told = used | {
            n for m in self.meanings.values() if isinstance(m.value, str)
            for n in expression.read(m.value).names
        }  # fmt: skip
        for name, m in self.meanings.items():
            e = results.get(name)
            role = _role(m, e)
            if m.role and m.role != f"{role if role != 'param' else 'parameter'}s":
                is_a = "a state" if role == "state" else "a result"
                said = f"{name} has an equation, so it is {is_a} and not among the {m.role}"
                if e is None:
                    mark = "'" if m.role == "states" else ""
                    said = f"{name} has no equation; write {name}{mark} = ..."
                self.wrong(m.keys, said)
                continue
            if m.unit is None:
                if name not in self.lost:
                    self.wrong(m.keys, f"{name} needs a unit")
                continue
            if role == "param" and name not in told and not unread:
                close = nearest(name, used - set(self.meanings))
                hint = close if "did you mean" in close else "; leave it out"
                self.wrong(m.keys, f"the parameter {name} is used nowhere{hint}")
            if role == "output" and m.value is not None:
                self.wrong(m.keys, f"{name} has an equation and a value; leave one of them out")
            found.append(_signal(role, name, m))
        for name, e in results.items():
            if name in self.meanings:
                continue
            if e.mark:
                self.wrong(e.keys, f"the state {name} needs its unit and start, {name} [unit] = 0")
            elif not listed:
                found.append(Signal("output", "1", name=name))
        return found

    def ordered(self) -> list[_Equation]:
        """Equations so that each stands behind those that it uses."""
        plain = {e.name: e for e in self.found if not e.mark}
        done: dict[str, _Equation] = {}
        waiting = dict(plain)
        while waiting:
            ready = [
                n for n, e in waiting.items()
                if not any(k in waiting for k in e.expression.names)
            ]  # fmt: skip
            if not ready:
                names = ", ".join(list(waiting)[:5])
                self.wrong((), f"{names} need one another; a loop of equations needs a state")
                break
            done |= {n: waiting.pop(n) for n in ready}
        return [*done.values(), *(e for e in self.found if e.mark)]

    def check_units(
        self, equations: _Equations, signals: Sequence[Signal], kind: str
    ) -> list[Signal]:
        """Tell where units do not fit, and give results without one the unit that they have."""
        symbols = {s.name: ca.SX.sym(s.name) for s in signals if s.role != "output"}
        given = {s.name: s.unit for s in signals if s.role != "output"}
        rate = "({}) / s" if kind == "flow" else "{}"
        of_states = {s.name: rate.format(s.unit) for s in signals if s.role == "state"}
        parts: dict[_Equation, list[tuple[ast.expr, Any]]] = {}
        with checking_units():
            values = equations.values(symbols, parts)
        wanted = {
            e: of_states[e.name] if e.mark else self.meanings[e.name].unit
            for e in equations.order
            if e.mark or e.name in self.meanings
        }
        bad: set[str] = set()
        for e in equations.order:
            left = f"{e.name}{e.mark}"
            target = {left: str(wanted[e])} if e in wanted else {}
            if bad.intersection(e.expression.names):
                continue  # what follows from a wrong one is wrong too
            lines = unit_walk.check({left: values[e]}, given, target)
            if lines:
                bad.add(e.name)
                places = self.unit_places(parts[e], given)
                for column, line in places or [(e.expression.tree.col_offset, lines[0])]:
                    said = re.sub(r"^in .*?: (?=\S)", "", line, count=1)
                    said = said.replace("as a Param or by one('...')", "as a parameter")
                    said += self.si_hint(e)
                    self.wrong(e.keys, f"{e.place}column {column + e.offset + 1}: {said}")
        if self.faults:
            return list(signals)
        results = {e.name: values[e] for e in equations.order if not e.mark}
        units = unit_walk.infer(results, given) if results else {}
        return [self.with_unit(s, units) for s in signals]

    def si_hint(self, e: _Equation) -> str:
        """What to write where a result was told in a unit with a factor, kN say."""
        told = self.meanings[e.name].unit if e.name in self.meanings else None
        if told is None or si_text(told) == told:
            return ""
        return f"; numbers are kept in SI, say {e.name} [{si_text(told)}]"

    def with_unit(self, s: Signal, units: Mapping[str, str]) -> Signal:
        if s.role != "output" or s.name in self.meanings:
            return s
        found = units[s.name]
        try:
            unit(found)
        except BadInput:
            self.wrong((s.name,), f"its unit is [{found}]; say it in SI, {s.name} [unit]")
            return s
        return Signal("output", found, name=s.name)

    def unit_places(
        self, parts: Sequence[tuple[ast.expr, Any]], given: Mapping[str, str]
    ) -> list[tuple[int, str]]:
        """Columns of the innermost parts whose units do not fit, and what is wrong there."""
        wrong: set[int] = set()
        found = []
        for node, value in parts[:PLACES]:
            inside = any(id(child) in wrong for child in ast.iter_child_nodes(node))
            told = [] if inside or not isinstance(value, ca.SX) else unit_walk.check(
                {"part": value}, given, {})  # fmt: skip
            if inside or told:
                wrong.add(id(node))
            found += [(node.col_offset, told[0])] if told else []
        return found

    def condition_values(
        self, conditions: Mapping[str, Mapping[str, Item]], signals: Mapping[str, Signal]
    ) -> dict[str, dict[str, float]]:
        """Numbers of the rail conditions in the units of the parameters."""
        found: dict[str, dict[str, float]] = {}
        for condition, values in conditions.items():
            keys = ("conditions", str(condition))
            if not isinstance(values, Mapping):
                self.wrong(keys, "write { c = 0.3, a = '0.5 s/m' }")
                continue
            found[str(condition)] = {}
            for name, value in values.items():
                s = signals.get(str(name))
                settable = [n for n, s in signals.items() if s.role == "param"]
                if s is None or s.role != "param":
                    close = nearest(str(name), settable)
                    told = f"there is no parameter {name!r:.40}{close}"
                    self.wrong((*keys, str(name)), told)
                    continue
                try:
                    number = self.end(value, s.unit, s.unit)
                    s.check(f"on {condition}: {name}", number)
                    found[str(condition)][str(name)] = number
                except BadInput as error:
                    self.wrong((*keys, str(name)), bare(error))
        return found


@dataclass(frozen=True)
class _Equations:
    """Equations in order; ``body`` is that of the block."""

    order: tuple[_Equation, ...]
    tables: Mapping[str, Table]
    outputs: tuple[str, ...]
    settable: bool = False  # points of tables are parameters

    def body(self, x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        """Next states (or derivatives) and outputs."""
        found = self.values({**x, **u, **p})
        named = {e.name: v for e, v in found.items() if not e.mark}
        for name, _value in named.items():
            if name not in self.outputs:
                formula.tell(name, _value)
        states = {e.name: v for e, v in found.items() if e.mark}
        return states, {n: named[n] for n in self.outputs}

    def values(
        self,
        known: Mapping[str, Any],
        parts: dict[_Equation, list[tuple[ast.expr, Any]]] | None = None,
    ) -> dict[_Equation, Any]:
        """Value of each equation."""
        values, found = dict(known), {}
        symbols = next((type(v) for v in known.values() if isinstance(v, (ca.SX, ca.MX))), ca.SX)
        calls: dict[str, Callable[..., Any]] = dict(self.tables)
        if self.settable:
            calls = {
                t: partial(interpolated, xs=known[f"{t}_at"], ys=known[f"{t}_there"]) for t in calls
            }
        for e in self.order:
            seen = None
            if parts is not None:
                mine = parts.setdefault(e, [])
                seen = lambda node, value, mine=mine: mine.append((node, value))  # noqa: E731
            found[e] = symbols(e.expression.value(values, calls, seen))
            if not e.mark:
                values[e.name] = found[e]
        return found


def _role(m: Meaning, e: _Equation | None) -> str:
    if e is not None:
        return "state" if e.mark else "output"
    if m.role:
        return {"inputs": "input", "parameters": "param", "states": "-", "outputs": "-"}[m.role]
    return "input" if m.value is None else "param"


def _signal(role: str, name: str, m: Meaning) -> Signal:
    value = 0.0 if role == "state" and m.value is None else m.value
    lo = -math.inf if m.lo is None else m.lo
    hi = math.inf if m.hi is None else m.hi
    return Signal(
        role, m.unit or "1", value, m.doc, m.source, lo, hi, positive=m.positive, per=m.per,
        name=name,
    )  # fmt: skip


def _moved(told: str, offset: int) -> str:
    return re.sub(r"^column (\d+)", lambda m: f"column {int(m[1]) + offset}", told)


def _lines(text: str) -> list[tuple[int, int, str]]:
    """Equations with their line and the column before them; open brackets join lines."""
    found: list[tuple[int, int, str]] = []
    line, column, depth, comment = 1, 0, 0, False
    begun, piece = (1, 0), ""
    for c in text:
        comment = comment or c == "#"
        if c in "\n;" and (c == "\n" or not comment) and depth <= 0:
            found.append((*begun, piece))
            piece = ""
        else:
            depth += 0 if comment else (c in "([") - (c in ")]")
            piece += " " if comment or c in "\n\r\t" else c
        column += 1
        if c == "\n":
            line, column, comment = line + 1, 0, False
        if not piece:
            begun = (line, column)
    return [(k, at, p) for k, at, p in [*found, (*begun, piece)] if p.strip()]
