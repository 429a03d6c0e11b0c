"""Other numbers for a loop that is built: where a number stands in it, so that nothing is remade.

``with_params`` makes a loop again from its parts. Where only numbers differ, the loop made again
differs from the first in the values of some signals alone. A template says which: it is taken from
a loop that ``with_params`` made, and compared with the loop before. Whatever it cannot explain is
left to ``with_params``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.shared_numbers import number_at, targets
from slipctl.block.signals import Signal
from slipctl.block.transforms.replication import with_derived
from slipctl.errors import BadInput
from slipctl.run.rail import Scenario
from slipctl.run.scenario_inputs import complete_params, given_by, loop_at_start

NUDGE = 1e-9
"""Share by which a number is moved that is the same before and after, to see what it changes."""


@dataclass(frozen=True)
class Template:
    """A loop with certain names set, in whose place others of the same names can be put.

    Attributes:
        loop: what ``with_params`` made, begun in its scenario.
        declared: what each name was checked against.
        places: name of the signal by each given name that reaches the run.
        guarded: parts that refuse some numbers, each with the name in the loop of its numbers.
        values: of all parameters of the loop.
        follow: parameters that follow from what is set.
    """

    loop: Block
    declared: Mapping[str, tuple[Signal, ...]]
    places: Mapping[str, tuple[str, ...]]
    guarded: tuple[tuple[Block, Mapping[str, str]], ...]
    values: Mapping[str, np.ndarray]
    follow: tuple[str, ...]

    def with_numbers(
        self, numbers: Mapping[str, Any]
    ) -> tuple[Block, Mapping[str, np.ndarray]] | None:
        """Loop with these numbers, and the values of its parameters.

        Its signals are right, its parts are not made again.

        Returns:
            None where ``with_params`` has to say what it is, a refusal most likely.
        """
        if any(isinstance(v, str) for v in numbers.values()):
            return None
        try:
            new: dict[str, Any] = {}
            for name, value in numbers.items():
                for signal in self.declared[name]:
                    signal.check(name, value)
                new |= dict.fromkeys(self.places[name], value)
            block = self.loop._numbered(new)
            own = {n: block.params[n].check(n, v) for n, v in new.items() if n in block.params}
            values = complete_params(block, {**self.values, **own}, self.follow)
            for part, names in self.guarded:
                known = {**values, **block.start()}
                own = {n: known[full] for n, full in names.items() if full in known}
                assert part.composition.guard is not None
                part.composition.guard(own)
        except BadInput:
            return None
        return block, values


def template(
    loop: Block, before: Block, scenario: Scenario, numbers: Mapping[str, Any]
) -> Template | None:
    """Say where numbers of these names stand in a loop, by a comparison of it with and without.

    Args:
        loop: as it is.
        before: the loop begun in the scenario.
        scenario: the scenario.
        numbers: what is set.

    Returns:
        The template; None where more than values of signals differs.

    Raises:
        BadInput: numbers that are refused.
    """
    if any(isinstance(v, str) for v in numbers.values()):
        return None
    meant = {k: [number_at(loop, n) for n in targets(loop, k) or [k]] for k in numbers}
    declared = {k: tuple(loop.declared(n) for n in full) for k, full in meant.items()}
    tried = {k: _other(declared[k], v) for k, v in numbers.items()}
    changed = loop.with_params(**tried)
    after = loop_at_start(changed, scenario)
    ruled = {number_at(changed, n) for n in given_by(changed, scenario)}
    slots = {n: k for k, full in meant.items() for n in full if n not in ruled}
    if after._made is not loop._made or len(slots) < sum(
        n not in ruled for full in meant.values() for n in full
    ):
        return None
    old, new = ({s.name: s for s in (*b.params.values(), *b.states.values())}
                for b in (before, after))  # fmt: skip
    for n, s in new.items():
        if n in slots:
            explained = not s.derived and _same(s, tried[slots[n]])
        elif n not in old or s.derived != old[n].derived:
            explained = False
        else:
            explained = s.value == old[n].value if s.derived else _same(s, old[n].value)
        if not explained:
            return None
    if not set(slots) <= set(new):
        return None
    guarded: list[tuple[Block, Mapping[str, str]]] = []
    for part, path, names in _guarded(after, "", {n: n for n in new}):
        if _at(loop, path) is part:
            continue
        if names is None:
            return None
        guarded.append((part, names))
    places = {k: tuple(n for n in full if n in slots) for k, full in meant.items()}
    own = [n for n in slots if n in after.params]
    follow = tuple(n for n in with_derived(after, own) if after.params[n].derived)
    return Template(after, declared, places, tuple(guarded), after.param_values(), follow)


def _other(signals: Sequence[Signal], value: Any) -> Any:
    """A number in range that is none of those from before, so that what it changes is seen."""
    told = np.asarray(value, dtype=float)
    for s in signals:
        if s.value is None or s.derived or not np.any(s.shaped("", s.value) == told):
            continue
        told = told + NUDGE * np.maximum(np.abs(told), 1.0) * np.where(told < s.hi, 1, -1)
    return told if told.shape else float(told)


def _same(s: Signal, value: Any) -> bool:
    """Whether a signal has this number."""
    if s.value is None or value is None:
        return s.value is value
    return np.array_equal(s.shaped("", s.value), s.shaped("", value))


def _at(block: Block, path: str) -> Block | None:
    """Part at a path of keys of ``parts``."""
    for key in path.split("/")[1:]:
        if key not in block.parts:
            return None
        block = block.parts[key]
    return block


def check_guards(loop: Block) -> None:
    """Refuse numbers that a part refuses, on each rail condition that the loop knows.

    Asked where a loop is made ready to roll or to be written, and not where it is made: numbers
    that belong together may be set one by one.

    Raises:
        BadInput: in the words of the part, with its path.
    """
    parts = [(part, path) for part, path, _ in _guarded(loop, "", None) if not part.transparent]
    if not parts:  # a sampled part asked when it was made
        return
    known = loop.values_by_place()
    for part, path in parts:
        where = ".".join(path.split("/")[1:])
        for values in {str(v): v for v in loop.conditions.values()}.values() or [{}]:
            at = known | values
            own = {n: at[f"{where}.{n}" if where else n] for n in part.params
                   if (f"{where}.{n}" if where else n) in at}  # fmt: skip
            try:
                part.composition.guard(own)  # type: ignore[misc]
            except BadInput as error:
                raise BadInput(f"{where or part.name}: {error}") from None


def _guarded(
    block: Block, path: str, names: Mapping[str, str] | None
) -> Iterator[tuple[Block, str, Mapping[str, str] | None]]:
    """Blocks inside that have a guard, their path, and the loop's names of their numbers.

    The names are None where they are not told: below a block that gives a number to one of several
    parts.
    """
    if block.composition.guard is not None:
        yield block, path, names
    for head, part in block.parts.items():
        inner: dict[str, str] | None = None
        if names is not None and (block.prefixed or len(block.parts) == 1):
            inner = {}
            for s in (*part.params.values(), *part.states.values()):
                full = block.sharing.name(f"{head}.{s.name}") if block.prefixed else s.name
                if full in names and full not in block.composition.own:
                    inner[s.name] = names[full]
        yield from _guarded(part, f"{path}/{head}", inner)
