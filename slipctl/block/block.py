"""The Block: one page of equations that is called, differentiated, simulated and generated as C.

A block is written as a Python function whose default arguments declare its signals and whose body
is the paper's formulas. ``@law`` is algebra, ``@flow`` gives x' = f, ``@step`` gives x+ = f.
What it holds stands in ``fields``, its numbers in ``values``, its CasADi Functions in
``functions``; here it is called, and made again of other numbers and parts.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from slipctl import registry
from slipctl.block import portable, shared_numbers
from slipctl.block.fields import ROLES, Body, Composition, LawData, Rebuild
from slipctl.block.functions import Exprs, Functions
from slipctl.block.signals import Signal
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.errors import BadInput, check_all_known, check_known, list_of_kind, nearest, value_text


class Block(Functions):
    """Equations with declared signals; see the module text for how to write one.

    Its attributes are those of :class:`slipctl.block.fields.Fields`.
    """

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(self._signals[r])} {r}s" for r in ROLES if self._signals[r])
        return f"<{self.kind} {self.name}: {counts}>"

    def _repr_html_(self) -> str:
        return registry.view(self, "html")

    __reduce__ = portable.reduce_block

    def _repr_latex_(self) -> str:
        return registry.view(self, "latex")

    def __getitem__(self, path: str) -> Block:
        """Return a part by its path, ``loop["plant.adh"]``."""
        if not isinstance(path, str):
            raise BadInput(f"{self.name} has parts by name, none by {value_text(path)}")
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

    def start(self, **override: Any) -> dict[str, np.ndarray]:
        """Start values of the states; expressions such as ``"v / r"`` are computed.

        Raises:
            BadInput: unknown state, value off range, or an expression that cannot be computed.
        """
        check_all_known(f"{self.name} has no state", override, self.states)
        shared = {n: v for n, v in override.items() if n in self.sharing.aliases}
        if shared:  # what follows them does so
            rest = {n: v for n, v in override.items() if n not in shared}
            return self.with_params(**shared).start(**rest)
        given: dict[str, Any] = {n: v for n, v in override.items() if isinstance(v, str)}
        for n, s in self.states.items():
            if n in override and n not in given:
                given[n] = s.check(f"{self.name}.{n}", override[n])
        return self._start(given, self.param_values())

    def point(self, **numbers: Any) -> tuple[Exprs, Exprs, Exprs]:
        """Numbers of all states, inputs and parameters; what is not given has its declared value.

        Raises:
            BadInput: unknown name, an input without value, a parameter off range.
        """
        known = {**self.states, **self.inputs, **self.params}
        check_all_known(f"{self.name} has no signal", numbers, known)
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
        owner = self._owner(name)
        assert owner is not None  # a place lies in a part
        return self.parts[owner[0]].declared(owner[1])

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
            assert self.composition.rebuild is not None
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
        assert self.composition.rebuild is not None
        new = self.composition.rebuild(parts, shares) if shares else self.composition.rebuild(parts)
        if self._has_equations_of(new):
            new._made = self._made
        return new

    def _has_equations_of(self, new: Block) -> bool:
        """Whether the block made again has the same equations: only numbers changed."""

        def layout(block: Block) -> Any:
            return [(s.role, s.name, s.shape) for s in block.signals]

        return (
            self.composition.by_structure
            and new.composition.by_structure
            and list(new.parts) == list(self.parts)
            and all(part._made is self.parts[k]._made for k, part in new.parts.items())
            and (new.name, new.kind, new.period, new.sx, new.composition.own, new.wires)
            == (self.name, self.kind, self.period, self.sx, self.composition.own, self.wires)
            and new.choices == self.choices
            and new.sharing.aliases == self.sharing.aliases
            and layout(new) == layout(self)
        )

    def _keep_values(self, before: Block, new: Mapping[str, Any]) -> Block:
        """Take over, from the block as it was, the values that belong to no part."""
        changed = []
        for s in self.signals:
            old = before._signals[s.role].get(s.name)
            of_part = s.name in self.sharing.shares or self._owner(s.name) is not None
            if s.role not in ("param", "state") or of_part:
                changed.append(s)
            elif s.name in new:
                changed.append(s.valued(new[s.name]))
            else:
                old = s if old is None else old
                changed.append(s if old.value is s.value else s.valued(old.value))
        block = self._copy(changed)
        return block if block.name == before.name else block.renamed(before.name)

    def _numbered(self, values: Mapping[str, Any]) -> Block:
        """Block whose signals alone have other numbers, already checked; its parts are as before.

        It has the Function, start and parameters with these numbers, and is no block to go on from.
        """
        block = object.__new__(Block)  # made once and looked through; only numbers differ
        block.__dict__ |= self.__dict__
        signals = dict(self._signals)
        for role in ("param", "state"):
            own = {n: s.valued(values[n]) for n, s in self._signals[role].items()
                   if n in values and not s.derived}  # fmt: skip
            signals[role] = self._signals[role] | own
        block._hold(signals)
        return block

    def _owner(self, name: str) -> tuple[str, str] | None:
        """Part that owns state or parameter ``name``, and its name there."""
        if name in self.composition.own:
            return None
        if self.prefixed:
            head, _, rest = name.partition(".")
            return (head, rest) if head in self.parts and self.parts[head]._has(rest) else None
        if self.composition.rebuild is not None:
            for head, part in self.parts.items():
                if part._has(name):
                    return head, name
        return None

    def _has(self, name: str) -> bool:
        """Whether ``name`` is a state, a parameter, or a place of a shared number."""
        return name in self.states or name in self.params or name in self.sharing.aliases

    def _copy(self, signals: Iterable[Signal], **changes: Any) -> Block:
        """The same block with these signals, and with other fields by name."""
        block = object.__new__(Block)
        block.__dict__ |= self.__dict__ | changes
        block._declare(signals)
        return block

    def with_conditions(self, **conditions: Mapping[str, float]) -> Block:
        """Return the law with other rail conditions, ``dry={"c": 1.0}, wet={"c": 0.3}``.

        Raises:
            BadInput: an unknown or derived parameter, a value off range.
        """
        for name, values in conditions.items():
            for n, value in values.items():
                self._settable(n).check(f"{self.name}, condition {name!r}: {n}", value)
        return self._copy(self.signals, conditions={k: dict(v) for k, v in conditions.items()})

    def with_source(self, source: str, *names: str) -> Block:
        """Return the block with another source of these parameters: where their numbers are from.

        Raises:
            BadInput: unknown parameter.
        """
        return self.with_sources(dict.fromkeys(names, source))

    def with_sources(self, sources: Mapping[str, str]) -> Block:
        """Return the block with other sources of parameters, by their names.

        Raises:
            BadInput: unknown parameter.
        """
        wanted = {self._settable(n).name: source for n, source in sources.items()}
        return self._copy([
            replace(s, source=wanted[s.name]) if s.role == "param" and s.name in wanted else s
            for s in self.signals
        ])  # fmt: skip

    def with_rebuild(self, rebuild: Rebuild) -> Block:
        """Return the block with another way to make it again of other parts."""
        return self._copy(self.signals, composition=replace(self.composition, rebuild=rebuild))

    def renamed(self, name: str) -> Block:
        """Return the same block under another name."""
        return self._copy(self.signals, name=name, _made={})  # Functions carry the name

    def swap(self, name: str, block: Block) -> Block:
        """Return the block with part ``name`` (a path, ``"plant.adh"``) replaced.

        The new part takes the shared numbers of the block where it has their places; what it
        shares with nobody, it brings along.

        Raises:
            BadInput: no such part, or the new block does not fit the wires or the shares.
        """
        as_block(f"{self.name}.swap: the new {name}", block)
        parts = dict(self.parts)
        if self.composition.rebuild is None:
            head = name.partition(".")[0]
            check_known(f"{self.name} has no part", head, parts)
            raise BadInput(f"{self.name} cannot be rebuilt with another {head!r}")
        if self.transparent:
            ((head, part),) = parts.items()
            return self.composition.rebuild({head: part.swap(name, block)})._keep_values(self, {})
        head, _, rest = name.partition(".")
        check_known(f"{self.name} has no part", head, parts)
        parts[head] = parts[head].swap(rest, block) if rest else block
        new = self._rebuilt(parts, {k: s.given for k, s in self.sharing.shares.items()})
        return shared_numbers.with_shares_of(self, new)._keep_values(self, {})

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
        **options: as of :class:`Block` (``period``, ``sx``, ...), and the fields of its
            :class:`LawData` and :class:`Composition` (``parts``, ``rebuild``, ...).
    """
    roles = {"state": states, "input": inputs, "param": params, "output": outputs}
    signals = {
        role: list_of_kind(f"{name}: its {role}s", given, Signal) for role, given in roles.items()
    }
    for role, given in signals.items():
        if odd := [s for s in given if s.role != role]:
            raise BadInput(f"{name}: {odd[0].name!r} is an {odd[0].role}, given among the {role}s")
    return block_from(name, kind, body, [s for given in signals.values() for s in given], **options)


def block_from(
    name: str, kind: str, body: Body, signals: Iterable[Signal], **options: Any
) -> Block:
    """Make a block; what belongs to its law data or composition is put there by its name."""
    groups: dict[str, Any] = {}
    for group, made in (("law_data", LawData), ("composition", Composition)):
        own = {f.name: options.pop(f.name) for f in fields(made) if f.name in options}
        if own:
            groups[group] = made(**own)
    return Block(name, kind, body, signals, **groups, **options)
