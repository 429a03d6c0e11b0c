"""What a block holds: name, kind, body and signals, what a law says of itself, its parts."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.shared_numbers import ALONE, Sharing
from slipctl.block.signals import Signal, Split
from slipctl.block.units.unit_algebra import read_unit
from slipctl.errors import BadInput, check_positive, list_of_kind, refuse_unknown_choice, value_text

if TYPE_CHECKING:
    from slipctl.block.block import Block

Body = Any
"""Function of dictionaries (x, u, p) of expressions, giving (x' or x+, outputs)."""
Rebuild = Callable[..., "Block"]

VectorNames = Mapping[str, Mapping[str, tuple[str, Mapping[int, str]]]]
"""By Function and argument or result: what its vector is, and names of numbers in it."""

ROLES = ("state", "input", "param", "output")


@dataclass(frozen=True)
class LawData:
    """What a law says of itself beside its equations.

    Attributes:
        closed_form: function of its parameters giving the argument of its peak.
        coordinates: expressions of its parameters that an estimator works in.
        readings: its signals as expressions of what a measured curve has in place of them,
            ``{"v_s": "creep * v"}``.
        expects: orders that its parameters usually keep, ``("k_A >= k_S",)``.
        follows: gives parameters that follow from others when it is fitted.
        beside: signals that stand beside it for a fit, and not in its equations.
        leaves_out: what it leaves out, in words.
        measured_to: largest slip at which it was measured, 0 where never; None where not told.
        meant_to: largest slip at which it is meant to hold, infinity for a locked wheel.
        failures: what may fail around it and what it does then, see ``block/text/failures.py``.
    """

    closed_form: Callable[..., Any] | None = None
    coordinates: tuple[str, ...] = ()
    readings: Mapping[str, str] = field(default_factory=dict)
    expects: tuple[str, ...] = ()
    follows: Callable[..., Mapping[str, float]] | None = None
    beside: Mapping[str, Signal] = field(default_factory=dict)
    leaves_out: str = ""
    measured_to: float | None = None
    meant_to: float | None = None
    failures: Sequence[tuple[str, ...]] = ()


@dataclass(frozen=True)
class Composition:
    """What a block was made of, and how it is made again.

    Attributes:
        parts: the blocks this one was made of, by name.
        rebuild: makes it again of other parts; without it no part can be replaced.
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
        dependence: for a connection, which elements of its inputs each element of its outputs
            depends on, of its parts alone.
        vector_names: what the numbers are in vectors of the Functions inside it.
    """

    parts: dict[str, Block] = field(default_factory=dict)
    rebuild: Rebuild | None = None
    wires: dict[str, str] = field(default_factory=dict)
    prefixed: bool = False
    transparent: bool = False
    own: frozenset[str] = frozenset()
    sharing: Sharing = ALONE
    by_structure: bool = False
    guard: Callable[[Mapping[str, Any]], None] | None = None
    solves: tuple[Sequence[tuple[str, str]], Mapping[str, Block]] | None = None
    split: Split | None = None
    dependence: Callable[[], np.ndarray] | None = None
    vector_names: VectorNames = field(default_factory=dict)

    @classmethod
    def around(cls, block: Block, rebuild: Rebuild | None, **more: Any) -> Composition:
        """Composition of a block that is ``block`` in another time, or several of it."""
        through = block.sharing.through()
        shown: dict[str, Any] = {"transparent": True, "by_structure": True, "sharing": through}
        return cls(parts={block.name: block}, rebuild=rebuild, **shown | more)


def of_composition(name: str, doc: str) -> Any:
    """Property of a block that its composition has; read by C, as it is asked for everywhere."""
    return property(attrgetter(f"composition.{name}"), doc=doc)


class Fields:
    """What a :class:`Block` holds.

    Attributes:
        name: name of the block.
        kind: ``"law"``, ``"flow"`` or ``"step"``.
        period: sample period in s of a step that insists on one, otherwise None.
        doc: what the block is, with its source.
        sx: whether the body works on CasADi SX (scalar expressions) or on MX.
        units: ``"checked"``, or ``"printed"`` for a printed form that cannot be made consistent.
        choices: structural choices by keyword, for name, report and C header.
        conditions: parameter sets by the name of a rail condition, ``{"dry": {"c": 1.0}}``.
        law_data: what a law says of itself beside its equations.
        composition: what the block was made of, and how it is made again.
        states, inputs, params, outputs: signals by name, in order; derived parameters included.
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
        units: str = "checked",
        choices: Mapping[str, Any] | None = None,
        conditions: Mapping[str, Mapping[str, float]] | None = None,
        law_data: LawData | None = None,
        composition: Composition | None = None,
    ) -> None:
        if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
            raise BadInput(
                f"a block's name must be a letter, then letters, digits, _; not {value_text(name)}"
            )
        if name.lower() in ("null", "jac", "hess"):
            raise BadInput(f"a block cannot be named {name!r}, CasADi keeps that name for itself")
        kind = kind if isinstance(kind, str) else value_text(kind)
        refuse_unknown_choice(name, "kind", kind, ("law", "flow", "step"))
        signals = list_of_kind(f"{name}: its signals", signals, Signal)
        if not callable(body):
            raise BadInput(
                f"{name}: its body is {value_text(body)}; give a function (x, u, p) -> (n, y)"
            )
        if period is not None:
            check_positive(f"{name}: period", period, "s")
        self.name, self.kind, self.period, self.doc = name, kind, period, doc
        self.sx, self.units, self._body = sx, units, body
        self.choices: dict[str, Any] = dict(choices or {})
        self.conditions = {k: dict(v) for k, v in (conditions or {}).items()}
        self.law_data = law_data or LawData()
        self.composition = composition or Composition()
        self._made: dict[Any, Any] = {}
        self._declare(signals)

    def _declare(self, signals: Iterable[Signal]) -> None:
        """Take over the signals, checked against each other and their own ranges."""
        name = self.name
        self._hold({role: {} for role in ROLES})
        seen: set[str] = set()
        for s in signals:
            if s.name in seen and s.role != "output":
                raise BadInput(f"{name} declares {s.name!r} twice")
            seen.add(s.name)
            if not (self.parts or s.declared):
                if not isinstance(s.name, str) or not re.fullmatch(r"[\w.]+", s.name):
                    raise BadInput(
                        f"{name}: {value_text(s.name)} is no name of a signal; write letters,"
                        " digits, _, as in Input('m/s').named('v')"
                    )
                read_unit(f"{name}.{s.name}", s.unit)
            if s.role == "output" and s.name in self._signals["output"]:
                raise BadInput(f"{name} declares the output {s.name!r} twice")
            self._signals[s.role][s.name] = s
        if self.kind == "law" and self.states:
            raise BadInput(f"{name} is a law and cannot have states; make it a flow or a step")
        for p in self.params.values():
            if not (p.derived or p.declared) and p.value is not None:
                p.check(f"{name}.{p.name}", p.value)
        for y in self.outputs.values():
            if not y.declared and y.safe is not None:
                replace(y, shape=()).check(f"safe value of {name}.{y.name}", y.safe)
        if not self.parts:
            for s in self.signals:
                s.__dict__["declared"] = True

    parts: dict[str, Block] = of_composition("parts", "The blocks this one was made of, by name.")
    wires: dict[str, str] = of_composition("wires", "Source by destination, of a connected block.")
    sharing: Sharing = of_composition("sharing", "Which places of the parts have one number.")
    prefixed: bool = of_composition("prefixed", "Whether signals carry their part's name in front.")
    transparent: bool = of_composition("transparent", "Whether it is its part in another time.")

    def _hold(self, signals: dict[str, dict[str, Signal]]) -> None:
        """Hold signals by role and name."""
        self._signals = signals
        self._checked: dict[str, np.ndarray] | None = None
        self.states, self.inputs = signals["state"], signals["input"]
        self.params, self.outputs = signals["param"], signals["output"]

    @property
    def signals(self) -> list[Signal]:
        """All signals: states, inputs, parameters, outputs."""
        return [s for role in ROLES for s in self._signals[role].values()]

    def of_equations(self, key: Any, make: Callable[[], Any]) -> Any:
        """What follows from the equations alone, made once for all blocks that differ in numbers.

        Args:
            key: what it is.
            make: makes it, without a look at values, conditions or ranges.
        """
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]
