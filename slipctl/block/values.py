"""Numbers of a block: parameters, derived ones too, start values of states, ranges."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.fields import Fields
from slipctl.block.signals import Signal
from slipctl.block.text.named_expressions import evaluate, names_in, solve_order
from slipctl.errors import BadInput, check_known, nearest


class Values(Fields):
    """Numbers of a block."""

    def _solved(
        self,
        expressions: Mapping[str, str],
        known: Mapping[str, Any],
        start: bool = False,
        check: Callable[[str, Any], Any] = lambda _, v: v,
    ) -> dict[str, Any]:
        """Values of the block's own expressions beside the known ones, each as ``check`` has it."""

        def needs(n: str, e: str) -> list[str]:
            return [self._sibling(n, k) for k in names_in(e)]

        def value(n: str, e: str, values: Mapping[str, Any]) -> Any:
            local = {k: values[self._sibling(n, k)] for k in names_in(e)}
            return check(n, evaluate(e, local, f"{self.name}.{n}"))

        def stuck(n: str, e: str, _: Mapping[str, Any]) -> BadInput:
            if start:
                return BadInput(f"{self.name}.{n}: start value {e!r} cannot be computed")
            for k in names_in(e):
                if self._sibling(n, k) not in self.params:
                    return BadInput(f"{self.name}.{n} = {e!r} uses {k!r}{nearest(k, self.params)}")
            return BadInput(f"{self.name}.{n} = {e!r} depends on itself")

        return solve_order(expressions, known, needs, value, stuck)

    def derive(self, free: Mapping[str, Any]) -> dict[str, Any]:
        """Complete the parameters: derived ones that are not given, from the free ones."""
        values = {k: v for k, v in free.items() if k in self.params}
        waiting = {n: s.value for n, s in self.params.items() if s.derived and n not in values}
        values = self._solved(waiting, values)
        return {n: values[n] for n in self.params if n in values}

    def _sibling(self, name: str, other: str) -> str:
        """Full name of ``other`` beside ``name``: expressions speak of their own block."""
        return self.sharing.name(name.rpartition(".")[0] + "." + other if "." in name else other)

    def ends(self, signal: Signal, values: Mapping[str, Any]) -> tuple[list[Any], ...]:
        """Lower ends, upper ends, largest changes and noises of a signal, with these parameters.

        Of each the tightest holds, of noises the largest; what is infinite or no noise is left out.
        So is what names another input, unless its value is given.

        Args:
            signal: of this block.
            values: of all parameters by name, numbers or symbols; of inputs too, if it shall count.

        Raises:
            BadInput: an expression that uses what is no parameter.
        """
        found: dict[str, list[Any]] = {"lo": [], "hi": [], "change": [], "noise": []}
        for what, number in (("lo", signal.lo), ("hi", signal.hi), ("change", signal.change)):
            found[what] += [number] if math.isfinite(number) else []
        found["noise"] += [signal.jitter] if signal.jitter else []
        for b in signal.bounds:
            where = f"{self.name}.{signal.name}: {b.what}"
            home = b.home or signal.name
            local = {k: values.get(self._sibling(home, k)) for k in names_in(b.expression)}
            if signal.role == "input" and self._others(home, local, inside=bool(b.home)):
                continue
            known = {k: v for k, v in local.items() if v is not None}
            found[b.what].append(evaluate(b.expression, known, where))
        return found["lo"], found["hi"], found["change"], found["noise"]

    def _others(self, home: str, local: Mapping[str, Any], inside: bool) -> bool:
        """Whether what an end lacks are inputs; those of a part are not seen from outside it."""
        lacks = [self._sibling(home, k) for k, v in local.items() if v is None]
        return bool(lacks) and (inside or all(n in self.inputs for n in lacks))

    def without_range(self) -> list[str]:
        """Signals of which an end of the range is open, ``"input v"``, in their order.

        An input that the block judges itself needs none.
        """
        found = []
        for s in self.signals:
            if s.judged:
                continue
            follows = {b.what for b in s.bounds}
            closed = math.isfinite(s.lo) or "lo" in follows, math.isfinite(s.hi) or "hi" in follows
            if not all(closed):
                found.append(f"{s.role} {s.name}")
        return found

    def param_values(self, **override: Any) -> dict[str, np.ndarray]:
        """Values of all parameters, checked against their ranges, derived ones computed.

        Raises:
            BadInput: a parameter without value, off range, unknown, or derived and overridden.
        """
        if not override:
            if self._checked is None:
                self._checked = self._values_with({})
            return {n: v.copy() for n, v in self._checked.items()}
        for n in override:
            self._settable(n)
        return self._values_with(override)

    def _values_with(self, override: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Values of all parameters, checked, with some that are set."""
        free: dict[str, Any] = {}
        for n, s in self.params.items():
            if s.derived:
                continue
            value = override.get(n, s.value)
            if value is None:
                raise BadInput(f"{self.name}.{n} has no value; set it, in {s.unit}")
            free[n] = s.check(f"{self.name}.{n}", value)
        return self.completed(free)

    def completed(self, free: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Values of all parameters from those that are not derived, which are checked already.

        Raises:
            BadInput: a derived parameter off range.
        """
        return {
            n: v if n in free else self.params[n].check(f"{self.name}.{n}", v)
            for n, v in self.derive(free).items()
        }

    def values_by_place(self) -> dict[str, np.ndarray]:
        """Values of all parameters, those of shared numbers by the name of each place too."""
        values = self.param_values()
        shared = self.sharing.aliases.items()
        return values | {place: values[name] for place, name in shared if name in values}

    def orders(self) -> list[tuple[str, str]]:
        """Pairs (larger, smaller) of parameters that the law expects in this order.

        Raises:
            BadInput: an expectation of another form, or of an unknown parameter.
        """
        found = []
        for text in self.law_data.expects:
            larger, _, smaller = (part.strip() for part in text.partition(">="))
            for n in (larger, smaller):
                if n not in self.params:
                    raise BadInput(
                        f"{self.name} expects {text!r}; write 'p >= q' of two parameters"
                    )
            found.append((larger, smaller))
        return found

    def _start(self, given: Mapping[str, Any], params: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Start values beside the given ones, which may lie off range."""
        values: dict[str, Any] = {}
        waiting: dict[str, str] = {}
        for n, s in self.states.items():
            value = given.get(n, s.value)
            if isinstance(value, str) and s.values:
                value = float(s.code(f"{self.name}.{n}", value))
            if isinstance(value, str):
                waiting[n] = value
            else:
                values[n] = value if n in given else s.check(f"{self.name}.{n}", value)

        def check(n: str, value: Any) -> Any:
            return self.states[n].check(f"{self.name}.{n}", value)

        found = self._solved(waiting, {**values, **params}, start=True, check=check)
        return {n: found[n] if n in waiting else values[n] for n in self.states}

    def symbolic_start(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Start values of the states as expressions of the parameters."""
        waiting = {n: s.value for n, s in self.states.items() if isinstance(s.value, str)}
        values = {
            n: ca.DM(s.check(f"{self.name}.{n}", s.value))
            for n, s in self.states.items()
            if n not in waiting
        }
        found = self._solved(waiting, {**values, **params}, start=True)

        def column(v: Any, s: Signal) -> Any:
            if v.numel() == s.size:
                return ca.vec(v)
            if len(s.shape) == 2 and v.numel() == s.shape[1]:  # a number for each copy
                return ca.vec(ca.repmat(ca.vec(v).T, s.shape[0], 1))
            return ca.repmat(v, s.size, 1)

        return {
            n: column(found[n] if n in waiting else values[n], s) for n, s in self.states.items()
        }

    def _settable(self, name: str) -> Signal:
        if name in self.sharing.aliases and name not in self.params:
            shared = self.sharing.name(name)
            raise BadInput(
                f"{self.name}.{name} is shared as {shared}; write {shared}, or give it a number of"
                f" its own first, with_params(**{{{name!r}: ...}})"
            )
        check_known(f"{self.name} has no parameter", name, self.params)
        signal = self.params[name]
        if signal.derived and name not in self.sharing.begun:
            raise BadInput(
                f"{self.name}.{name} is derived, {signal.value}; set "
                + " or ".join(names_in(signal.value))
            )
        return signal

    def find(self, name: str, *roles: str) -> str:
        """Full name of a signal given by its full name or its unique last part.

        Raises:
            BadInput: unknown, or the last part of several names.
        """
        known = list(dict.fromkeys(n for role in roles for n in self._signals[role]))
        if "param" in roles and name not in known and name in self.sharing.aliases:
            self._settable(name)
        hits = [name] if name in known else [n for n in known if n.endswith("." + name)]
        if len(hits) == 1:
            return hits[0]
        if hits:
            raise BadInput(f"{self.name}: {name!r} could be {' or '.join(hits)}; write which")
        raise BadInput(f"{self.name} has no {' or '.join(roles)} {name!r}{nearest(name, known)}")
