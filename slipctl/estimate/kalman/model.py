"""What a filter estimates and measures: the equations of a flow, cut down to what they need."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs
from slipctl.block.signals import Signal
from slipctl.errors import BadInput, check_known, nearest, value_text

Numbers = float | Mapping[str, float]


_ANY: Any = {"value": None, "lo": -math.inf, "hi": math.inf}


@dataclass(frozen=True)
class Problem:
    """Unknowns and measurements of a flow.

    Attributes:
        who: the call, for messages: ``"ctukf(wheel)"``.
        block: the flow.
        unknown: estimated states, inputs and parameters.
        measured: measured states and outputs.
        known: signals that come from outside beside the measurements: inputs, and states that are
            neither estimated nor measured.
        params: parameters that matter.
        in_rates, in_outputs: names among the known and the measured that the equations of motion
            and the directly measured outputs need.
    """

    who: str
    block: Block
    unknown: tuple[Signal, ...]
    measured: tuple[Signal, ...]
    known: tuple[Signal, ...]
    params: tuple[Signal, ...]
    in_rates: frozenset[str]
    in_outputs: frozenset[str]

    @classmethod
    def of(
        cls, call: str, block: Block, measured: str | Sequence[str],
        estimate: str | Sequence[str], limited: Sequence[str] = (),
    ) -> Problem:  # fmt: skip
        """Check what the user asked for and find what the equations depend on.

        ``limited``: names of outputs that are kept within limits, so what they read is used too.
        """
        who = f"{call}({block.name})"
        if block.kind != "flow":
            raise BadInput(f"{who}: {block.name} is a {block.kind}; a filter is made from a flow")
        unknown = _unknowns(who, block, [estimate] if isinstance(estimate, str) else estimate)
        found = _measurements(who, block, [measured] if isinstance(measured, str) else measured)
        whole = cls(who, block, unknown, found, (), (), frozenset(), frozenset())
        rates, outputs = whole._needs()
        whole._refuse_unseen(rates, outputs)
        used = rates | outputs | whole._reads(limited)
        names = {s.name for s in (*unknown, *found)}
        states = [s for s in block.states.values() if s.name in used and s.name not in names]
        inputs = [s for s in block.inputs.values() if s.name in used and s.name not in names]
        given = (s.as_role("input", value=None) for s in states)  # from outside
        known = (*given, *(s for s in inputs if not s.noise))
        params = (s for s in block.params.values() if s.name in used and s.name not in names)
        here = {s.name for s in (*known, *whole.increments)}
        return cls(
            who, block, unknown, found, known, tuple(params),
            frozenset(rates & here), frozenset(outputs & here),
        )  # fmt: skip

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return len(self.unknown)

    @property
    def moving(self) -> bool:
        """Whether an unknown is a state, which moves by its equation."""
        return any(s.role == "state" for s in self.unknown)

    @property
    def direct(self) -> tuple[Signal, ...]:
        """Measured outputs, and measured states that are estimated: compared directly."""
        return tuple(s for s in self.measured if not self.by_increments(s))

    @property
    def increments(self) -> tuple[Signal, ...]:
        """Measured states that are not estimated: compared by their increments."""
        return tuple(s for s in self.measured if self.by_increments(s))

    def by_increments(self, s: Signal) -> bool:
        """Whether a measurement is compared by its increments."""
        return s.role == "state" and all(s.name != k.name for k in self.unknown)

    def equations(self, values: Mapping[str, Any]) -> tuple[Exprs, Exprs]:
        """(state derivatives, outputs) of the flow at values by name.

        What the values leave out has no influence and is set to its declared value.
        """
        p = {s.name: values.get(s.name) for s in self.block.params.values()}
        free = {
            n: self._idle(self.block.params[n]) if v is None else v
            for n, v in p.items()
            if not self.block.params[n].derived
        }
        x, u = (
            {n: values[n] if n in values else self._idle(s) for n, s in group.items()}
            for group in (self.block.states, self.block.inputs)
        )
        return self.block.expr(x, u, self.block.derive(free))

    def rates(self, values: Mapping[str, Any]) -> tuple[list[Any], list[Any]]:
        """Rates of the unknowns, zero for a random walk, and of the measured states."""
        n, _ = self.equations(values)
        moving = [n[s.name] if s.role == "state" else 0.0 for s in self.unknown]
        return moving, [n[s.name] for s in self.increments]

    def outputs(self, values: Mapping[str, Any]) -> list[Any]:
        """What is measured directly."""
        y = self.equations(values)[1] if any(s.role == "output" for s in self.direct) else {}
        return [y[s.name] if s.role == "output" else values[s.name] for s in self.direct]

    def samples(self) -> list[Signal]:
        """Inputs of what estimates: the measurements."""
        return [
            s.as_role("input", doc=f"measured {s.doc or s.name}", **_ANY) for s in self.measured
        ]

    def estimates(self) -> list[Signal]:
        """Outputs of what estimates: the unknowns."""
        return [
            s.as_role("output", doc=f"estimate: {s.doc or s.name}", **_ANY) for s in self.unknown
        ]

    def symbols(self) -> Exprs:
        """A symbol for each signal that is no output, and no derived parameter."""
        b = self.block
        symbols = b.symbols("state") | b.symbols("input") | b.symbols("param")
        return {k: v for k, v in symbols.items() if k not in b.params or not b.params[k].derived}

    def _idle(self, s: Signal) -> Any:
        value = start_value(self.block, s)
        make = ca.SX if self.block.sx else ca.MX
        shape = s.shape if len(s.shape) == 2 else (s.size, 1)
        return make(ca.DM(np.broadcast_to(value, s.shape).reshape(shape)))

    def _needs(self) -> tuple[set[str], set[str]]:
        """Names that the equations of motion, and the direct measurements, depend on."""
        values = self.symbols()
        moving, increments = self.rates(values)
        return _depends([*moving, *increments], values), _depends(self.outputs(values), values)

    def _reads(self, outputs: Sequence[str]) -> set[str]:
        """Names that some outputs of the flow depend on."""
        values = self.symbols()
        y = self.equations(values)[1]
        return _depends([y[n] for n in outputs], values)

    def _refuse_unseen(self, rates: set[str], outputs: set[str]) -> None:
        """Refuse an unknown on which no measurement depends, not even through other unknowns."""
        values = self.symbols()
        moving, increments = self.rates(values)
        of = {s.name: _depends([m], values) for s, m in zip(self.unknown, moving, strict=True)}
        seen = _depends(increments, values) | outputs
        for _ in self.unknown:
            seen |= {k for s in self.unknown if s.name in seen for k in of[s.name]}
        for s in self.unknown:
            if s.name not in seen:
                names = ", ".join(m.name for m in self.measured)
                raise BadInput(f"{self.who}: {names} does not depend on {s.name}; measure more")


def _unknowns(who: str, block: Block, names: Sequence[str]) -> tuple[Signal, ...]:
    if not names:
        raise BadInput(f"{who}: estimate names no state, input or parameter")
    found = []
    for name in names:
        if name in block.outputs and name not in block.states:
            raise BadInput(
                f"{who}: {name} is an output; estimate a state, an input or a parameter"
                f"{nearest('', [*block.states, *block.inputs])}"
            )
        full = block.find(name, "state", "input", "param")
        s = next(g[full] for g in (block.states, block.inputs, block.params) if full in g)
        if s.shape != ():
            raise BadInput(f"{who}: {full} has shape {s.shape}; only scalars can be estimated")
        if s.role == "param" and s.derived:
            raise BadInput(f"{who}: {full} is derived, {s.value}; estimate what it depends on")
        if s.noise:
            raise BadInput(f"{who}: {full} is noise and cannot be estimated")
        if s in found:
            raise BadInput(f"{who}: estimate names {full} twice")
        found.append(s)
    return tuple(found)


def _measurements(who: str, block: Block, names: Sequence[str]) -> tuple[Signal, ...]:
    if not names:
        raise BadInput(f"{who}: measured names no state or output")
    found = []
    for name in names:
        full = block.find(name, "state", "output")
        s = block.states[full] if full in block.states else block.outputs[full]
        if s.shape != ():
            raise BadInput(f"{who}: {full} has shape {s.shape}; measure scalars")
        if s in found:
            raise BadInput(f"{who}: measured names {full} twice")
        if s.role == "output" and full in {**block.inputs, **block.params}:
            raise BadInput(f"{who}: {full} is an input or parameter and an output of {block.name}")
        found.append(s)
    return tuple(found)


def _depends(expressions: Iterable[Any], values: Mapping[str, Any]) -> set[str]:
    whole = [e for e in expressions if hasattr(e, "is_constant") and not e.is_constant()]
    if not whole:
        return set()
    return {n for n, s in values.items() if ca.depends_on(ca.vertcat(*whole), s)}


def start_value(block: Block, s: Signal) -> np.ndarray:
    """Declared value of a signal, computed if it is an expression; else the one next to zero."""
    try:
        if s.role == "state":
            return block.start()[s.name]
        if s.role == "param" and s.value is not None:
            return block.param_values()[s.name]
    except BadInput:
        pass
    value = s.value if s.value is not None and not s.derived else 0.0
    return np.clip(np.broadcast_to(np.asarray(value, dtype=float), s.shape), s.lo, s.hi)


def unit_squared(unit: str) -> str:
    """Text of a unit squared."""
    return unit if unit == "1" else f"{_one_word(unit)}^2"


def product(a: str, b: str) -> str:
    """Text of a product of units."""
    return b if a == "1" else a if b == "1" else f"{_one_word(a)} * {_one_word(b)}"


def per_second(unit: str) -> str:
    """Text of a unit per second."""
    return f"{_one_word(unit)}/s"


def _one_word(unit: str) -> str:
    return unit if unit.isalpha() or unit == "1" else f"({unit})"


def by_name(
    who: str, what: str, given: Numbers, units: Mapping[str, str], allowed: str,
    partial: bool = False,
) -> dict[str, float]:  # fmt: skip
    """One number per name, from one number or a mapping.

    Args:
        who, what: for messages.
        given: the numbers.
        units: unit of each number by name.
        allowed: ``"positive"``, ``"not negative"`` or ``"finite"``.
        partial: names may be left out.

    Raises:
        BadInput: a missing or unknown name, or a number that is not allowed.
    """
    full: dict[str, Any] = {}
    if isinstance(given, Mapping):
        last = {n.rpartition(".")[2]: n for n in units}
        full = {k if k in units else last.get(k, k): v for k, v in given.items()}
        for k in full:
            check_known(f"{who}: {what} has", k, units)
        for n, unit in units.items():
            if n not in full and not partial:
                raise BadInput(f"{who}: {what} lacks {n!r} in {unit}")
    elif len(units) > 1 and given != 0:
        wanted = ", ".join(f"{n!r}: ..." for n in units)
        raise BadInput(f"{who}: {what} is {given!r}; give each its own, {{{wanted}}}")
    else:
        full = dict.fromkeys(units, given)
    for n, value in full.items():
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        low = {"positive": number > 0, "not negative": number >= 0, "finite": True}[allowed]
        if not (low and math.isfinite(number)):
            other = abs(number) if math.isfinite(number) and number else 1.0
            raise BadInput(
                f"{who}: {what} of {n} is {value_text(value)} {units[n]} and must be {allowed};"
                f" {other:g} would pass"
            )
        full[n] = number
    return full
