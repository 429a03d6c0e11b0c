"""The Block: one page of equations that is called, differentiated, simulated and generated as C.

A block is written as a Python function whose default arguments declare its signals and whose body
is the paper's formulas. ``@law`` is algebra, ``@flow`` gives x' = f, ``@step`` gives x+ = f.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block import portable, shared_numbers
from slipctl.block.shared_numbers import ALONE, Sharing
from slipctl.block.signals import Signal, Split, evaluate, names_in, packed_numbers, total_size
from slipctl.block.text.intermediates import collect_locals, with_checked_locals
from slipctl.block.units.unit_algebra import read_unit
from slipctl.errors import BadInput, check_positive, nearest, refuse_unknown_choice

Exprs = dict[str, Any]
Body = Any
"""Function of dictionaries (x, u, p) of expressions, giving (x' or x+, outputs)."""
Rebuild = Callable[..., "Block"]

ROLES = ("state", "input", "param", "output")
_PREFIX = {"state": "x", "input": "u", "param": "p", "output": "y"}


def symbol_maker(sx: bool) -> Callable[..., Any]:
    """``SX.sym`` or ``MX.sym``."""
    return ca.SX.sym if sx else ca.MX.sym


class Block:
    """Equations with declared signals; see the module text for how to write one.

    Attributes:
        name: name of the block.
        kind: ``"law"``, ``"flow"`` or ``"step"``.
        period: sample period in s of a step that insists on one, otherwise None.
        doc: what the block is, with its source.
        choices: structural choices by keyword, for name, report and C header.
        conditions: parameter sets by the name of a rail condition, ``{"dry": {"c": 1.0}}``.
        closed_form: for a law, function of its parameters giving the argument of its peak.
        coordinates: for a law, the expressions of its parameters that an estimator works in.
        readings: for a law, its signals as expressions of what a measured curve has in place of
            them, ``{"v_s": "creep * v"}``.
        expects: orders that a law's parameters usually keep, ``("k_A >= k_S",)``.
        measured_to, meant_to: slips up to which a law was measured and is meant, or None.
        units: ``"checked"``, or ``"printed"`` for a printed form that cannot be made consistent.
        sx: whether the body works on CasADi SX (scalar expressions) or on MX.
        parts: the blocks this one was made of, by name.
        wires: for a connected block, source by destination.
        prefixed: whether signals carry their part's name in front (made by ``connect``).
        transparent: whether it is its only part in another time (``sampled``, ``every``), so that
            paths and swaps look through it.
        own: names of states and parameters whose values this block keeps for itself, although a
            part has the name too (``replicate``: one value per copy).
        sharing: which places among the parts have one number, and its name.
        by_structure: whether, made again of parts with the same equations, it has the same
            equations too, whatever the numbers of the parts are.
        guard: refuses numbers, by name, for which the block may not be made: a step that is too
            long for them, say. What else its making refuses is no matter of numbers.
        solves: lines of the problem that it solves, and the blocks that these speak of.
        split: for a step whose tick may be made in two, how.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        body: Body,
        signals: Iterable[Signal],
        *,
        period: float | None = None,
        doc: str = "",
        sx: bool = True,
        choices: Mapping[str, Any] | None = None,
        parts: Mapping[str, Block] | None = None,
        rebuild: Rebuild | None = None,
        wires: Mapping[str, str] | None = None,
        units: str = "checked",
        conditions: Mapping[str, Mapping[str, float]] | None = None,
        closed_form: Callable[..., Any] | None = None,
        coordinates: Iterable[str] = (),
        readings: Mapping[str, str] | None = None,
        expects: Iterable[str] = (),
        follows: Callable[..., Mapping[str, float]] | None = None,
        beside: Mapping[str, Signal] | None = None,
        leaves_out: str = "",
        measured_to: float | None = None,
        meant_to: float | None = None,
        prefixed: bool = False,
        transparent: bool = False,
        own: Iterable[str] = (),
        sharing: Sharing = ALONE,
        by_structure: bool = False,
        guard: Callable[[Mapping[str, Any]], None] | None = None,
        solves: tuple[Sequence[tuple[str, str]], Mapping[str, Block]] | None = None,
        split: Split | None = None,
    ) -> None:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
            raise BadInput(
                f"a block's name must be a letter, then letters, digits, _; not {name!r}"
            )
        if name.lower() in ("null", "jac", "hess"):
            raise BadInput(f"a block cannot be named {name!r}, CasADi keeps that name for itself")
        refuse_unknown_choice(name, "kind", kind, ("law", "flow", "step"))
        if not callable(body):
            raise BadInput(f"{name}: its body is {body!r}; give a function (x, u, p) -> (n, y)")
        if period is not None:
            check_positive(f"{name}: period", period, "s")
        self.name, self.kind, self.period, self.doc, self.sx = name, kind, period, doc, sx
        self.choices: dict[str, Any] = dict(choices or {})
        self.parts: dict[str, Block] = dict(parts or {})
        self.wires: dict[str, str] = dict(wires or {})
        self.units = units
        self.conditions = {k: dict(v) for k, v in (conditions or {}).items()}
        self.closed_form, self.coordinates = closed_form, tuple(coordinates)
        self.readings = dict(readings or {})
        self.expects = tuple(expects)
        self.follows, self.leaves_out = follows, leaves_out
        self.measured_to, self.meant_to = measured_to, meant_to
        self.beside = {n: s.named(n) for n, s in (beside or {}).items()}
        self.prefixed, self.transparent = prefixed, transparent
        self.own = frozenset(own)
        self.sharing = sharing
        self.by_structure = by_structure
        self.guard, self.solves, self.split = guard, solves, split
        self._body, self._rebuild = body, rebuild
        self._made: dict[Any, Any] = {}
        self._signals: dict[str, dict[str, Signal]] = {role: {} for role in ROLES}
        seen: set[str] = set()
        for s in signals:
            if s.name in seen and s.role != "output":
                raise BadInput(f"{name} declares {s.name!r} twice")
            seen.add(s.name)
            if not parts:
                read_unit(f"{name}.{s.name}", s.unit)
            if s.role == "output" and s.name in self._signals["output"]:
                raise BadInput(f"{name} declares the output {s.name!r} twice")
            self._signals[s.role][s.name] = s
        if kind == "law" and self.states:
            raise BadInput(f"{name} is a law and cannot have states; make it a flow or a step")
        for p in self.params.values():
            if not p.derived and p.value is not None:
                p.check(f"{name}.{p.name}", p.value)
        for y in self.outputs.values():
            if y.safe is not None:
                replace(y, shape=()).check(f"safe value of {name}.{y.name}", y.safe)

    # ---- signals ------------------------------------------------------------------------------

    @property
    def states(self) -> dict[str, Signal]:
        """States in order."""
        return self._signals["state"]

    @property
    def inputs(self) -> dict[str, Signal]:
        """Inputs in order."""
        return self._signals["input"]

    @property
    def params(self) -> dict[str, Signal]:
        """Parameters in order, derived ones included."""
        return self._signals["param"]

    @property
    def outputs(self) -> dict[str, Signal]:
        """Outputs in order."""
        return self._signals["output"]

    @property
    def signals(self) -> list[Signal]:
        """All signals: states, inputs, parameters, outputs."""
        return [s for role in ROLES for s in self._signals[role].values()]

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(self._signals[r])} {r}s" for r in ROLES if self._signals[r])
        return f"<{self.kind} {self.name}: {counts}>"

    def _repr_html_(self) -> str:
        return str(import_module("slipctl.study.notebook").html(self))

    __reduce__ = portable.reduce_block

    def _repr_latex_(self) -> str:
        from slipctl.draw import show

        return show.latex(self)

    def __getitem__(self, path: str) -> Block:
        """Return a part by its path, ``loop["plant.adh"]``."""
        if self.transparent:
            return next(iter(self.parts.values()))[path]
        head, _, rest = path.partition(".")
        if head not in self.parts:
            inside = [p for n, part in self.parts.items() for p in part._paths(n)]
            inside = [p for p in inside if p.endswith(f".{path}")]
            where = f"; did you mean {inside[0]!r}?" if inside else nearest(head, self.parts)
            raise BadInput(f"{self.name} has no part {head!r}{where}")
        return self.parts[head][rest] if rest else self.parts[head]

    def _paths(self, prefix: str) -> list[str]:
        """Paths of all parts inside, and its own."""
        if self.transparent:
            return next(iter(self.parts.values()))._paths(prefix)
        inside = [p for n, part in self.parts.items() for p in part._paths(f"{prefix}.{n}")]
        return [prefix, *inside]

    def leaves(self, prefix: str = "") -> Iterable[tuple[str, Block]]:
        """Yield path and block of every block without parts, depth first."""
        if not self.parts:
            yield prefix, self
        for name, part in self.parts.items():
            path = prefix if self.transparent else f"{prefix}.{name}" if prefix else name
            yield from part.leaves(path)

    # ---- values -------------------------------------------------------------------------------

    def derive(self, free: Mapping[str, Any]) -> dict[str, Any]:
        """Complete the parameters: derived ones that are not given, from the free ones."""
        values = {k: v for k, v in free.items() if k in self.params}
        waiting = {n: s.value for n, s in self.params.items() if s.derived and n not in values}
        while waiting:
            ready = [
                n
                for n, e in waiting.items()
                if all(self._sibling(n, k) in values for k in names_in(e))
            ]
            if not ready:
                name, expression = next(iter(waiting.items()))
                for k in names_in(expression):
                    if self._sibling(name, k) not in self.params:
                        raise BadInput(
                            f"{self.name}.{name} = {expression!r} uses {k!r}"
                            f"{nearest(k, self.params)}"
                        )
                raise BadInput(f"{self.name}.{name} = {expression!r} depends on itself")
            for n in ready:
                e = waiting.pop(n)
                local = {k: values[self._sibling(n, k)] for k in names_in(e)}
                values[n] = evaluate(e, local, f"{self.name}.{n}")
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
        """Signals of which an end of the range is open, ``"input v"``, in their order."""
        found = []
        for s in self.signals:
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
        free: dict[str, Any] = {}
        for n in override:
            self._settable(n)
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
        for text in self.expects:
            larger, _, smaller = (part.strip() for part in text.partition(">="))
            for n in (larger, smaller):
                if n not in self.params:
                    raise BadInput(
                        f"{self.name} expects {text!r}; write 'p >= q' of two parameters"
                    )
            found.append((larger, smaller))
        return found

    def start(self, **override: Any) -> dict[str, np.ndarray]:
        """Start values of the states; expressions such as ``"v / r"`` are computed.

        Raises:
            BadInput: unknown state, value off range, or an expression that cannot be computed.
        """
        for n in override:
            if n not in self.states:
                raise BadInput(f"{self.name} has no state {n!r}{nearest(n, self.states)}")
        shared = {n: v for n, v in override.items() if n in self.sharing.aliases}
        if shared:  # what follows them does so
            rest = {n: v for n, v in override.items() if n not in shared}
            return self.with_params(**shared).start(**rest)
        given: dict[str, Any] = {n: v for n, v in override.items() if isinstance(v, str)}
        for n, s in self.states.items():
            if n in override and n not in given:
                given[n] = s.check(f"{self.name}.{n}", override[n])
        return self._start(given, self.param_values())

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
        while waiting:
            progress = False
            for n, e in list(waiting.items()):
                needed = {k: self._sibling(n, k) for k in names_in(e)}
                known = {**values, **params}
                if all(full in known for full in needed.values()):
                    local = {k: known[full] for k, full in needed.items()}
                    number = evaluate(e, local, f"{self.name}.{n}")
                    values[n] = self.states[n].check(f"{self.name}.{n}", number)
                    del waiting[n]
                    progress = True
            if not progress:
                n, e = next(iter(waiting.items()))
                raise BadInput(f"{self.name}.{n}: start value {e!r} cannot be computed")
        return {n: values[n] for n in self.states}

    def symbolic_start(self, params: Mapping[str, Any]) -> Exprs:
        """Start values of the states as expressions of the parameters."""
        values: dict[str, Any] = {}
        waiting: dict[str, str] = {}
        for n, s in self.states.items():
            if isinstance(s.value, str):
                waiting[n] = s.value
            else:
                values[n] = ca.DM(s.check(f"{self.name}.{n}", s.value))
        while waiting:
            for n, e in list(waiting.items()):
                needed = {k: self._sibling(n, k) for k in names_in(e)}
                known = {**values, **params}
                if all(full in known for full in needed.values()):
                    local = {k: known[full] for k, full in needed.items()}
                    values[n] = evaluate(e, local, f"{self.name}.{n}")
                    del waiting[n]
                    break
            else:
                n, e = next(iter(waiting.items()))
                raise BadInput(f"{self.name}.{n}: start value {e!r} cannot be computed")
        sizes = {n: s.size for n, s in self.states.items()}
        return {
            n: ca.repmat(v, sizes[n], 1) if v.numel() != sizes[n] else ca.vec(v)
            for n, v in ((n, values[n]) for n in self.states)
        }

    def _settable(self, name: str) -> Signal:
        if name in self.sharing.aliases and name not in self.params:
            shared = self.sharing.name(name)
            raise BadInput(
                f"{self.name}.{name} is shared as {shared}; write {shared}, or give it a number of"
                f" its own first, with_params(**{{{name!r}: ...}})"
            )
        if name not in self.params:
            raise BadInput(f"{self.name} has no parameter {name!r}{nearest(name, self.params)}")
        signal = self.params[name]
        if signal.derived and name not in self.sharing.begun:
            raise BadInput(
                f"{self.name}.{name} is derived, {signal.value}; set "
                + " or ".join(names_in(signal.value))
            )
        return signal

    def with_params(self, **values: Any) -> Block:
        """Return the block with other parameter values (or start values of its states).

        Names may carry dots when passed as ``**{"car.m": 9000}``. A shared number is set at all its
        places; the full path of one place gives that place a number of its own. An ending that
        only one signal has, and a wildcard (``"*.m"``), mean what they meet. An expression of the
        block's own signals is a value too. A law whose rail conditions set the parameter loses
        them, for they are those of the law as it was: name them anew, :meth:`with_conditions`.

        Raises:
            BadInput: unknown or derived parameter, value off range or NaN, an expression of names
                that the block has not, a name that meets only some places of a shared number.
        """
        meant: dict[str, Any] = {}
        for given, value in values.items():
            for name in shared_numbers.targets(self, given) or [given]:
                meant[shared_numbers.number_at(self, name)] = value
        for name, value in meant.items():
            signal = self.declared(name)
            if isinstance(value, str) and signal.values:
                value = meant[name] = float(signal.code(f"{self.name}.{name}", value))
            if not isinstance(value, str):
                signal.check(f"{self.name}.{name}", value)
                continue
            known = self.signals if name in self.states else self.params.values()
            beside = [
                k
                for k in dict.fromkeys(s.name.rpartition(".")[2] for s in known)
                if self._sibling(name, k) in self.params or self._sibling(name, k) in self.states
            ]
            for k in names_in(value):
                if k not in beside or name in self.sharing.aliases or name in self.sharing.shares:
                    raise BadInput(
                        f"{self.name}.{name} takes a number in {signal.unit} or an expression;"
                        f" {value!r} uses {k!r}{nearest(k, beside)}"
                    )
        return self._with_values(meant)

    def declared(self, name: str) -> Signal:
        """State, parameter, or place of a shared number, as it was declared."""
        if name in self.states:
            return self.states[name]
        if name in self.params or name not in self.sharing.aliases:
            return self._settable(name)
        return self._part_of(name)[0].declared(self._part_of(name)[1])

    def _part_of(self, name: str) -> tuple[Block, str]:
        """Part that a place lies in, and the place's name there."""
        if self.prefixed:
            head, _, rest = name.partition(".")
            return self.parts[head], rest
        return next(iter(self.parts.values())), name

    def _with_values(self, values: Mapping[str, Any]) -> Block:
        """Give each value to the part that owns it; what no part owns stays with this block."""
        handed: dict[str, dict[str, Any]] = {}
        own: dict[str, Any] = {}
        shares, inner = shared_numbers.shares_after_setting(self, values)
        for name, value in inner.items():
            owner = self._owner(name)
            if owner is None:
                own[name] = value
            else:
                handed.setdefault(owner[0], {})[owner[1]] = value
        if handed:
            assert self._rebuild is not None
            parts = {
                k: part._with_values(handed[k]) if k in handed else part
                for k, part in self.parts.items()
            }
            block = self._rebuilt(parts, shares)._keep_values(self, own)
        else:
            block = self._keep_values(self, own)
        if any(n in values for n in own for values in self.conditions.values()):
            block.conditions = {}  # they hold the numbers from before
        return block

    def _rebuilt(
        self, parts: dict[str, Block], shares: Mapping[str, shared_numbers.Share]
    ) -> Block:
        """The block made again of other parts, with the same shares or changed ones."""
        assert self._rebuild is not None
        new = self._rebuild(parts, shares) if shares else self._rebuild(parts)
        if self._has_equations_of(new):
            new._made = self._made
        return new

    def _has_equations_of(self, new: Block) -> bool:
        """Whether the block made again has the same equations: only numbers changed."""

        def layout(block: Block) -> Any:
            return [(s.role, s.name, s.shape) for s in block.signals]

        return (
            self.by_structure
            and new.by_structure
            and list(new.parts) == list(self.parts)
            and all(part._made is self.parts[k]._made for k, part in new.parts.items())
            and (new.name, new.kind, new.period, new.sx, new.own, new.wires)
            == (self.name, self.kind, self.period, self.sx, self.own, self.wires)
            and new.choices == self.choices
            and new.sharing.aliases == self.sharing.aliases
            and layout(new) == layout(self)
        )

    def of_equations(self, key: Any, make: Callable[[], Any]) -> Any:
        """What follows from the equations alone, made once for all blocks that differ in numbers.

        Args:
            key: what it is.
            make: makes it, without a look at values, conditions or ranges.
        """
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def _keep_values(self, before: Block, new: Mapping[str, Any]) -> Block:
        """Take over, from the block as it was, the values that belong to no part."""
        changed = []
        for s in self.signals:
            old = before._signals[s.role].get(s.name)
            parts_have_it = s.name in self.sharing.shares or self._owner(s.name) is not None
            if s.role not in ("param", "state") or parts_have_it:
                changed.append(s)
            elif s.name in new:
                changed.append(s.valued(new[s.name]))
            else:
                changed.append(s if old is None else s.valued(old.value))
        block = self._copy(changed)
        return block if block.name == before.name else block.renamed(before.name)

    def _numbered(self, values: Mapping[str, Any]) -> Block:
        """Block whose signals alone have other numbers, already checked; its parts are as before.

        It has the Function, start and parameters with these numbers, and is no block to go on from.
        """
        block = object.__new__(Block)  # made once and looked through; only numbers differ
        block.__dict__ |= self.__dict__ | {"_signals": dict(self._signals)}
        for role in ("param", "state"):
            own = {n: s.valued(values[n]) for n, s in self._signals[role].items()
                   if n in values and not s.derived}  # fmt: skip
            block._signals[role] = self._signals[role] | own
        return block

    def _owner(self, name: str) -> tuple[str, str] | None:
        """Part that owns state or parameter ``name``, and its name there."""
        if name in self.own:
            return None
        if self.prefixed:
            head, _, rest = name.partition(".")
            return (head, rest) if head in self.parts and self.parts[head]._has(rest) else None
        if self._rebuild is not None:
            for head, part in self.parts.items():
                if part._has(name):
                    return head, name
        return None

    def _has(self, name: str) -> bool:
        """Whether ``name`` is a state, a parameter, or a place of a shared number."""
        return name in self.states or name in self.params or name in self.sharing.aliases

    def _copy(self, signals: Iterable[Signal]) -> Block:
        block = Block(
            self.name, self.kind, self._body, signals,
            period=self.period, doc=self.doc, sx=self.sx, choices=self.choices, parts=self.parts,
            rebuild=self._rebuild, wires=self.wires, units=self.units, conditions=self.conditions,
            closed_form=self.closed_form, coordinates=self.coordinates, readings=self.readings,
            expects=self.expects, follows=self.follows, beside=self.beside,
            leaves_out=self.leaves_out, measured_to=self.measured_to, meant_to=self.meant_to,
            prefixed=self.prefixed, transparent=self.transparent, own=self.own,
            sharing=self.sharing, by_structure=self.by_structure, guard=self.guard,
            solves=self.solves, split=self.split,
        )  # fmt: skip
        block._made = self._made
        return block

    def with_conditions(self, **conditions: Mapping[str, float]) -> Block:
        """Return the law with other rail conditions, ``dry={"c": 1.0}, wet={"c": 0.3}``.

        Raises:
            BadInput: an unknown or derived parameter, a value off range.
        """
        for name, values in conditions.items():
            for n, value in values.items():
                self._settable(n).check(f"{self.name}, condition {name!r}: {n}", value)
        block = self._copy(self.signals)
        block.conditions = {k: dict(v) for k, v in conditions.items()}
        return block

    def with_source(self, source: str, *names: str) -> Block:
        """Return the block with another source of these parameters: where their numbers are from.

        Raises:
            BadInput: unknown parameter.
        """
        wanted = {self._settable(n).name for n in names}
        return self._copy(
            replace(s, source=source) if s.role == "param" and s.name in wanted else s
            for s in self.signals
        )

    def renamed(self, name: str) -> Block:
        """Return the same block under another name."""
        block = self._copy(self.signals)
        block.name, block._made = name, {}  # Functions carry the name
        return block

    def swap(self, name: str, block: Block) -> Block:
        """Return the block with part ``name`` (a path, ``"plant.adh"``) replaced.

        The new part takes the shared numbers of the block where it has their places; what it
        shares with nobody, it brings along.

        Raises:
            BadInput: no such part, or the new block does not fit the wires or the shares.
        """
        as_block(f"{self.name}.swap: the new {name}", block)
        parts = dict(self.parts)
        if self._rebuild is None:
            head = name.partition(".")[0]
            if head not in parts:
                raise BadInput(f"{self.name} has no part {head!r}{nearest(head, parts)}")
            raise BadInput(f"{self.name} cannot be rebuilt with another {head!r}")
        if self.transparent:
            ((head, part),) = parts.items()
            return self._rebuild({head: part.swap(name, block)})._keep_values(self, {})
        head, _, rest = name.partition(".")
        if head not in parts:
            raise BadInput(f"{self.name} has no part {head!r}{nearest(head, parts)}")
        parts[head] = parts[head].swap(rest, block) if rest else block
        new = self._rebuilt(parts, {k: s.given for k, s in self.sharing.shares.items()})
        return shared_numbers.with_shares_of(self, new)._keep_values(self, {})

    # ---- functions ----------------------------------------------------------------------------

    def expr(self, x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        """Evaluate the body on CasADi expressions by name; returns (x' or x+, outputs)."""
        n, y = self._body(x, u, p)
        self._complete("state", n, "derivative" if self.kind == "flow" else "next state")
        self._complete("output", y, "output")
        return _columns(n), _columns(y)

    def _complete(self, role: str, given: Mapping[str, Any], what: str) -> None:
        wanted = self._signals[role]
        for name in wanted:
            if name not in given:
                raise BadInput(f"{self.name} does not return its {what} {name!r}")
        for name, value in given.items():
            if name not in wanted:
                raise BadInput(
                    f"{self.name} returns an undeclared {what} {name!r}{nearest(name, wanted)}"
                )
            if value is None or isinstance(value, (str, Mapping)):
                raise BadInput(
                    f"{self.name} returns {value!r} as {what} {name!r}; return an expression"
                )

    def symbols(self, role: str) -> Exprs:
        """CasADi symbols of one role by name, named as in the equations."""
        sym = symbol_maker(self.sx)
        return {
            n: sym(n, *(s.shape if len(s.shape) == 2 else (s.size, 1)))
            for n, s in self._signals[role].items()
        }

    def pack(self, role: str, values: Mapping[str, Any]) -> Any:
        """Stack values (numbers or expressions) of one role to one column vector."""
        numbers = packed_numbers(self._signals[role], values)
        if numbers is not None:
            return ca.DM(numbers)
        columns = []
        for n, s in self._signals[role].items():
            v = values[n]
            shape = s.shape if len(s.shape) == 2 else (s.size, 1)
            if isinstance(v, (list, tuple)):
                v = ca.vertcat(*v)
            if isinstance(v, np.ndarray) and v.size == s.size:
                v = ca.DM(np.asarray(v, dtype=float).reshape(shape))
            elif isinstance(v, (np.generic, np.ndarray)) or not hasattr(v, "shape"):
                v = ca.DM(float(v)) if np.size(v) == 1 else ca.DM(v)
            if tuple(v.shape) != tuple(shape):
                if v.shape == (1, 1):
                    v = ca.repmat(v, *shape)
                elif v.numel() == s.size and 1 in v.shape:
                    v = ca.reshape(v, *shape)
                else:
                    raise BadInput(
                        f"{self.name}.{n} has shape {tuple(v.shape)}, declared {tuple(shape)}"
                    )
            if not v.is_dense():
                v = ca.densify(v)
            columns.append(ca.reshape(v, s.size, 1) if len(s.shape) == 2 else v)
        return ca.vertcat(*columns) if columns else ca.DM(0, 1)

    def unpack(self, role: str, vector: Any) -> Exprs:
        """Split a column vector into values of one role by name, in their shapes."""
        out: Exprs = {}
        at = 0
        for n, s in self._signals[role].items():
            piece = vector[at : at + s.size]
            out[n] = ca.reshape(piece, *s.shape) if len(s.shape) == 2 else piece
            at += s.size
        return out

    @property
    def f(self) -> ca.Function:
        """Packed function ``(x, u, p) -> (n, y)``; n is x' of a flow and x+ of a step."""
        return self.of_equations("f", self._packed)

    def _packed(self) -> ca.Function:
        sym = symbol_maker(self.sx)
        x, u, p = (
            sym(letter, total_size(self._signals[role].values()))
            for letter, role in (("x", "state"), ("u", "input"), ("p", "param"))
        )
        groups = self.unpack("state", x), self.unpack("input", u), self.unpack("param", p)
        with collect_locals() as found:
            n, y = self.expr(*groups)
        out = [self.pack("state", n), self.pack("output", y)]
        f = ca.Function(self._c_name(), [x, u, p], out, ["x", "u", "p"], ["n", "y"], {"cse": True})
        return with_checked_locals(f, self.name, found) if self.sx and not self.parts else f

    def _c_name(self) -> str:
        return re.sub(r"_+", "_", self.name).strip("_")

    def _io_names(self, role: str, letter: str) -> list[str]:
        names: list[str] = []
        for n in self._signals[role]:
            base = re.sub(r"_+", "_", f"{letter}_{n.replace('.', '_')}").rstrip("_")
            while base in names:
                base += "a"
            names.append(base)
        return names

    def _named_symbols(self) -> tuple[list[Any], list[str], tuple[Exprs, Exprs, Exprs]]:
        args: list[Any] = []
        names: list[str] = []
        groups = []
        for role in ("state", "input", "param"):
            symbols = self.symbols(role)
            groups.append(symbols)
            args += list(symbols.values())
            names += self._io_names(role, _PREFIX[role])
        return args, names, (groups[0], groups[1], groups[2])

    def function(self) -> ca.Function:
        """CasADi Function with one named argument per signal.

        Inputs are ``x_<state>, u_<input>, p_<param>``, outputs ``d_<state>`` (flow) or
        ``n_<state>`` (step) and ``y_<output>``; dots of composite names become underscores.
        """
        args, names, groups = self._named_symbols()
        with collect_locals() as found:
            n, y = self.expr(*groups)
        letter = "d" if self.kind == "flow" else "n"
        results = [*(n[k] for k in self.states), *(y[k] for k in self.outputs)]
        out = self._io_names("state", letter) + self._io_names("output", "y")
        f = ca.Function(self._c_name(), args, results, names, out)
        return with_checked_locals(f, self.name, found) if self.sx and not self.parts else f

    def jacobian(self, of: str, wrt: str | Iterable[str]) -> ca.Function:
        """Exact Jacobian of an output or of a state's equation, as a named Function.

        Args:
            of: name of an output, or of a state (its derivative or next value).
            wrt: one or more names of states, inputs or parameters; columns in this order.

        Returns:
            Function with the arguments of ``function()`` and one result ``J``.

        Raises:
            BadInput: unknown name.
        """
        wanted = [wrt] if isinstance(wrt, str) else list(wrt)
        args, names, groups = self._named_symbols()
        n, y = self.expr(*groups)
        results = {**n, **y}
        if of not in results:
            raise BadInput(f"{self.name} has no output or state {of!r}{nearest(of, results)}")
        known = {**groups[0], **groups[1], **groups[2]}
        for w in wanted:
            if w not in known:
                raise BadInput(f"{self.name} has no signal {w!r}{nearest(w, known)}")
        J = ca.horzcat(*[ca.jacobian(results[of], known[w]) for w in wanted])
        return ca.Function(f"jac_{self._c_name()}", args, [J], names, ["J"])

    def feedthrough(self) -> dict[str, list[str]]:
        """Inputs that each output depends on directly, by structure."""
        return self.of_equations("feedthrough", self._direct)

    def _direct(self) -> dict[str, list[str]]:
        if not self.outputs:
            return {}
        if not self.inputs:
            return {name: [] for name in self.outputs}
        pattern: Any = np.array(ca.DM(self.f.jac_sparsity(1, 1), 1).full(), dtype=bool)
        out: dict[str, list[str]] = {}
        row = 0
        for name, s in self.outputs.items():
            hit = pattern[row : row + s.size].any(axis=0)
            row += s.size
            used, column = [], 0
            for u, su in self.inputs.items():
                if hit[column : column + su.size].any():
                    used.append(u)
                column += su.size
            out[name] = used
        return out

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

    def point(self, **numbers: Any) -> tuple[Exprs, Exprs, Exprs]:
        """Numbers of all states, inputs and parameters; what is not given has its declared value.

        Raises:
            BadInput: unknown name, an input without value, a parameter off range.
        """
        known = {**self.states, **self.inputs, **self.params}
        for n in numbers:
            if n not in known:
                raise BadInput(f"{self.name} has no signal {n!r}{nearest(n, known)}")
        shared = {n: v for n, v in numbers.items() if n in self.sharing.aliases}
        if shared and not set(self.states) <= set(numbers):  # what follows them does so
            rest = {n: v for n, v in numbers.items() if n not in shared}
            meant = {shared_numbers.number_at(self, n): v for n, v in shared.items()}
            return self._with_values(meant).point(**rest)
        p = self.param_values(**{k: v for k, v in numbers.items() if k in self.params})
        given_x = {
            k: s.shaped(f"{self.name}.{k}", numbers[k])
            for k, s in self.states.items()
            if k in numbers
        }
        x = given_x if len(given_x) == len(self.states) else self._start(given_x, p)
        u: Exprs = {}
        for n, s in self.inputs.items():
            value = numbers.get(n, s.value)
            if value is None:
                raise BadInput(f"{self.name} needs the input {n} [{s.unit}]")
            u[n] = s.shaped(f"{self.name}.{n}", value)
        return x, u, p

    def __call__(self, **numbers: Any) -> Any:
        """Evaluate with numbers; what is not given has its declared value.

        Returns:
            What the body returns: outputs of a law; (derivatives or next states, outputs)
            otherwise. Scalars are floats, the rest arrays.

        Raises:
            BadInput: unknown name, an input without value, a parameter off range.
        """
        x, u, p = self.point(**numbers)
        nx, y = self.f(self.pack("state", x), self.pack("input", u), self.pack("param", p))
        outputs = self._numbers("output", y)
        if self.kind == "law":
            return outputs
        return self._numbers("state", nx), outputs

    def _numbers(self, role: str, vector: Any) -> dict[str, Any]:
        out = {}
        for n, v in self.unpack(role, vector).items():
            shape = self._signals[role][n].shape
            out[n] = float(v) if shape == () else np.array(v.full()).reshape(shape)
        return out

    # ---- units --------------------------------------------------------------------------------

    def check_units(self) -> list[str]:
        """Unit errors of every equation, in the paper's letters; an empty list is a pass."""
        if self.parts:
            found = []
            for part in self.parts.values():
                found += part.check_units()
            return found
        if self.units == "printed" or not self.sx:
            return []
        derived = tuple((s.name, s.value) for s in self.signals if s.derived)
        return list(self.of_equations(("units", derived), self._wrong_units))

    def _wrong_units(self) -> list[str]:
        from slipctl.block.text import formula
        from slipctl.block.units import unit_algebra, unit_walk

        with unit_algebra.checking_units(), formula.letters(self._body.__code__) as names:
            x, u, p = (self.symbols(r) for r in ("state", "input", "param"))
            n, y = self.expr(x, u, p)
            flow = self.kind == "flow"
            equations = {k + ("'" if flow else "+"): n[k] for k in self.states} | y
            wanted = {k + ("'" if flow else "+"): s.unit for k, s in self.states.items()}
            if flow:
                wanted = {k: f"({unit}) / s" for k, unit in wanted.items()}
            wanted |= {k: s.unit for k, s in self.outputs.items()}
            given = {s.name: s.unit for s in self.signals if s.role != "output"}
            for s in (*self.params.values(), *self.states.values()):
                if s.derived:
                    local = {k: v for k, v in (x | p).items() if k in names_in(s.value)}
                    equations[f"{s.name} ="] = evaluate(s.value, local, s.name)
                    wanted[f"{s.name} ="] = s.unit
            try:
                found = unit_walk.check(equations, given, wanted, names)
            except BadInput as error:
                raise BadInput(f"{self.name}: {error}") from None
        return [f"{self.name}: {e}" for e in found]


def as_block(where: str, thing: Any) -> Block:
    """Return ``thing``, refused where it is no block.

    Raises:
        BadInput: says what it is, and how a block is made.
    """
    if isinstance(thing, Block):
        return thing
    how = "call it, if it makes one" if callable(thing) else "@law, @flow and @step make one"
    raise BadInput(f"{where} is no block but of type {type(thing).__name__}; {how}")


def doc_of_maker(maker: Callable[..., Block]) -> str:
    """What a block says of itself: the docstring of what makes it, without Args and the like."""
    return re.split(r"\n\n(?:Args|Returns|Raises):", inspect.getdoc(maker) or "")[0]


def make_block(
    name: str,
    kind: str,
    body: Body,
    *,
    states: Iterable[Signal] = (),
    inputs: Iterable[Signal] = (),
    params: Iterable[Signal] = (),
    outputs: Iterable[Signal] = (),
    **options: Any,
) -> Block:
    """Make a block from named signals and a body on dictionaries; for transforms of blocks.

    Args:
        name: name of the block.
        kind: ``"law"``, ``"flow"`` or ``"step"``.
        body: ``body(x, u, p) -> (n, y)`` on dictionaries of CasADi expressions.
        states, inputs, params, outputs: signals that carry their names.
        **options: as of :class:`Block` (``period``, ``sx``, ``parts``, ``rebuild``, ...).
    """
    return Block(name, kind, body, [*states, *inputs, *params, *outputs], **options)


def _columns(values: Exprs) -> Exprs:
    """Values by name, with a list of elements as a column."""
    return {k: ca.vertcat(*v) if isinstance(v, (list, tuple)) else v for k, v in values.items()}
