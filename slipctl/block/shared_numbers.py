"""One number of several parts: declared once, and what each spelling of its name means."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import translate
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.signals import Signal
from slipctl.block.text.named_expressions import evaluate, names_in, solve_order
from slipctl.errors import BadInput, nearest

if TYPE_CHECKING:
    from slipctl.block.block import Block


@dataclass(frozen=True)
class Share:
    """A number that parts of a connection have in common.

    Attributes:
        name: its name in the connection.
        wanted: places as written, ``"plant.m"``, or ``"*.m"`` for every part that has it.
        expression: of other shared numbers, where it is computed from them.
        apart: places that were set to a number of their own.
        places: places that are bound to it; the first declares it.
        begins: whether it is the start value of a state, which the other places follow.
        signal: what it is, with its number.
    """

    name: str
    wanted: tuple[str, ...]
    expression: str | None = None
    apart: frozenset[str] = frozenset()
    places: tuple[str, ...] = ()
    begins: bool = False
    signal: Signal | None = None

    @property
    def given(self) -> Share:
        """The same as it was written, without what the parts made of it."""
        return replace(self, places=(), begins=False, signal=None)


@dataclass(frozen=True)
class Sharing:
    """What a block knows of the numbers that its parts share.

    Attributes:
        shares: the block's own, by name.
        aliases: name of the number by each place, at every depth.
        between: places that are shared numbers of a part themselves.
        owners: states that begin with a shared number, which follows them.
        begun: shared numbers with which a state begins.
    """

    shares: Mapping[str, Share] = field(default_factory=dict)
    aliases: Mapping[str, str] = field(default_factory=dict)
    between: frozenset[str] = frozenset()
    owners: frozenset[str] = frozenset()
    begun: frozenset[str] = frozenset()

    @classmethod
    def of(cls, blocks: Mapping[str, Block], shares: Mapping[str, Share]) -> Sharing:
        """Sharing of a connection, from its own shares and those of its parts."""
        bound = {place: s.name for s in shares.values() for place in s.places}
        aliases = dict(bound)
        between: set[str] = set()
        owners = {s.places[0] for s in shares.values() if s.begins}
        begun = {s.name for s in shares.values() if s.begins}
        for b, block in blocks.items():
            inner = block.sharing
            for place, key in inner.aliases.items():
                aliases[f"{b}.{place}"] = bound.get(f"{b}.{key}", f"{b}.{key}")
                between |= {f"{b}.{key}"} & set(bound)
            between |= {f"{b}.{place}" for place in inner.between}
            for key in inner.begun:
                full = f"{b}.{key}"
                if full not in bound:
                    begun.add(full)
                if full not in bound or full in owners:
                    owners |= {
                        f"{b}.{place}" for place in inner.owners if inner.aliases.get(place) == key
                    }
        return cls(shares, aliases, frozenset(between), frozenset(owners), frozenset(begun))

    def through(self) -> Sharing:
        """Sharing of a block in another time, whose only part has the same names."""
        return replace(self, shares={})

    def name(self, full: str) -> str:
        """Name of the number that stands at a place; of any other signal its own."""
        return self.aliases.get(full, full)


ALONE = Sharing()
"""Sharing of a block that shares nothing."""


def read_shares(name: str, share: Mapping[str, Any] | None) -> dict[str, Share]:
    """Shares as ``connect`` takes them, ``{"m": [...], "J_w = J * R_g**2": [...]}``.

    Raises:
        BadInput: what is none.
    """
    found: dict[str, Share] = {}
    if not isinstance(share, Mapping | None):
        raise BadInput(
            f"{name}: share names the places of each number, {{'m': ['car.m', 'ctl.m']}}; a part"
            " cannot be named share"
        )
    for key, places in (share or {}).items():
        if isinstance(places, Share):
            found[key] = places
            continue
        short, _, expression = (text.strip() for text in key.partition("="))
        places = [places] if isinstance(places, str) else places
        texts = isinstance(places, Sequence) and all(isinstance(p, str) for p in places)
        if not short.isidentifier() or not texts or short in found:
            raise BadInput(f"{name}: share {key!r}: {places!r}; write 'm': ['car.m', 'ctl.m']")
        found[short] = Share(short, tuple(places), expression or None)
    return found


def numbers_of(name: str, shares: Mapping[str, Share]) -> dict[str, Any]:
    """Number of each share that has one, expressions computed."""
    numbers: dict[str, Any] = {}
    for key in _in_order(name, shares):
        s = shares[key].signal
        assert s is not None
        if not s.derived:
            listed = isinstance(s.value, list | tuple)
            numbers[key] = s.shaped(key, s.value) if listed else s.value
        elif all(numbers[k] is not None for k in names_in(s.value)):
            numbers[key] = evaluate(s.value, numbers, f"{name}.{key}")
        else:
            numbers[key] = None
    return numbers


def parts_with_shares(
    blocks: Mapping[str, Block], shares: Mapping[str, Share], numbers: Mapping[str, Any]
) -> dict[str, Block]:
    """Parts in which every place has the number of its share."""
    new: dict[str, dict[str, Any]] = {}
    for share in shares.values():
        value = numbers[share.name]
        for place in share.places if value is not None else ():
            b, _, n = place.partition(".")
            s = signal_at(blocks, place)
            if not s.derived and not _equal(s.value, value):
                new.setdefault(b, {})[n] = value
    return {b: part._with_values(new[b]) if b in new else part for b, part in blocks.items()}


def shares_after_setting(
    block: Block, values: Mapping[str, Any]
) -> tuple[dict[str, Share], dict[str, Any]]:
    """Shares after values are set, and the values of the places that they reach.

    A shared number reaches all its places; a place that is set by itself leaves its share.
    """
    shares = {k: s.given for k, s in block.sharing.shares.items()}
    at = {place: s for s in block.sharing.shares.values() for place in s.places}
    numbers: dict[str, Any] = {}
    single: dict[str, Any] = {}
    for name, value in values.items():
        if name in shares:
            shares[name] = replace(shares[name], expression=None)
            numbers |= dict.fromkeys(block.sharing.shares[name].places, value)
            continue
        single[name] = value
        if name in at:
            given = shares[at[name].name]
            shares[given.name] = replace(given, apart=given.apart | {name})
    return shares, numbers | single


def number_at(block: Block, name: str) -> str:
    """What is set by a full name: the shared number where it begins or stands nowhere else.

    Any other name means itself: a place of a shared number is set apart from the others.
    """
    return block.sharing.name(name) if name in block.sharing.owners else _outermost(block, name)


def _outermost(block: Block, name: str) -> str:
    """Name of the outermost share that has this place alone, or the place itself."""
    owner = block._owner(name) if name not in block.sharing.shares else None
    if owner is not None:
        head, rest = owner
        inner = _outermost(block.parts[head], rest)
        name = f"{head}.{inner}" if block.prefixed else inner
    for share in block.sharing.shares.values():
        settable = share.begins or not share.expression
        if share.places == (name,) and not share.apart and settable:
            return share.name
    return name


def with_shares_of(before: Block, after: Block) -> Block:
    """Block with another part, in which the shared numbers are those from before."""
    old = numbers_of(before.name, before.sharing.shares)
    new = numbers_of(after.name, after.sharing.shares)
    values = {}
    for key, number in new.items():
        share = after.sharing.shares[key]
        assert share.signal is not None
        if not share.signal.derived and old.get(key) is not None and not _equal(number, old[key]):
            values[key] = old[key]
    return after._with_values(values) if values else after


def differences(block: Block) -> dict[str, str]:
    """Places that were set apart, and the shared number that each of them left."""
    found: dict[str, str] = {}
    for share in block.sharing.shares.values():
        apart = [place for place in sorted(share.apart) if has_place(block.parts, place)]
        found |= dict.fromkeys(apart, share.name)
    for b, part in block.parts.items():
        for place, key in differences(part).items():
            if block.prefixed:
                found[f"{b}.{place}"] = block.sharing.name(f"{b}.{key}")
            else:
                found[place] = key
    return {place: key for place, key in found.items() if key in block.params}


def warnings_of_places(block: Block) -> list[str]:
    """What was set apart to another number, one line each."""
    values, start = block.param_values(), block.start()
    known = {**values, **start}
    lines = []
    for place, name in differences(block).items():
        one, other = known[place], values[name]
        if np.array_equal(one, np.broadcast_to(other, np.shape(one))):
            continue
        signal = block.params.get(place) or block.states[place]
        unit = "" if signal.unit == "1" else f" {signal.unit}"
        line = f"{place} differs from {name}"
        if np.ndim(one) == np.ndim(other) == 0:
            line += f": {float(one):.6g}{unit}, not {float(other):.6g}{unit}"
        lines.append(line)
    return lines


def places_of(block: Block, name: str) -> list[str]:
    """Innermost places of a shared number, by their full names."""
    bound = [p for p, key in block.sharing.aliases.items() if key == name]
    return [p for p in bound if p not in block.sharing.between]


def targets(block: Block, name: str, roles: Iterable[str] = ("param", "state")) -> list[str]:
    """Full names that ``name`` means, the same at every door.

    A full name means itself: a shared number, or one place of it. An ending that one signal has,
    and a wildcard, mean what they meet; all places of a shared number are that number.

    Raises:
        BadInput: the ending of several, or what meets only some places of a shared number.
    """
    roles, known = tuple(roles), dict[str, None]()
    for role in roles:
        known |= dict.fromkeys(block._signals[role])
    if "param" in roles:
        known |= dict.fromkeys(block.sharing.aliases)
    if name in known:
        return [name]
    pattern = re.compile(translate(name if "*" in name else f"*.{name}"))
    hits = list(filter(pattern.match, known))
    if not hits:
        return []
    left = differences(block)
    found: dict[str, None] = {}
    for hit in hits:
        shared = block.sharing.aliases.get(hit) or left.get(hit)
        if shared is None or hit in left:
            found[hit] = None
        if shared is None:
            continue
        places = [*places_of(block, shared), *(p for p, key in left.items() if key == shared)]
        missed = [p for p in places if p not in hits]
        own = [h for h in hits if block.sharing.aliases.get(h) == shared]
        if missed and not any(h in block.sharing.owners for h in own):
            raise BadInput(
                f"{name} matches {len(places) - len(missed)} of the {len(places)} places of"
                f" {shared}; write {shared}= for all of them, or {hit}= for that one alone"
            )
        if hit not in left:
            found[shared] = None
    if len(found) > 1 and "*" not in name:
        raise BadInput(
            f"{name!r} could be {' or '.join(found)}; write which, or '*.{name}' for all"
        )
    return list(found)


def has_place(blocks: Mapping[str, Block], place: str) -> bool:
    """Whether one of the blocks has a parameter or state at a place, ``"car.m"``."""
    b, _, n = place.partition(".")
    return b in blocks and (n in blocks[b].params or n in blocks[b].states)


def signal_at(blocks: Mapping[str, Block], place: str) -> Signal:
    """Parameter or state of one of the blocks that is there at a place, ``"car.m"``."""
    b, _, n = place.partition(".")
    block = blocks[b]
    return block.params.get(n) or block.states[n]


def _in_order(name: str, shares: Mapping[str, Share]) -> list[str]:
    """Names of the shares, each after those that it is computed from."""

    def needs(_: str, share: Share) -> tuple[str, ...]:
        assert share.signal is not None
        return names_in(share.signal.value) if share.signal.derived else ()

    def stuck(key: str, share: Share, done: Mapping[str, Any]) -> BadInput:
        assert share.signal is not None
        missing = next(n for n in names_in(share.signal.value) if n not in done)
        return BadInput(
            f"{name}: share {key!r} = {share.signal.value!r} uses {missing!r}"
            f"{nearest(missing, [k for k in shares if k != key])}"
        )

    return list(solve_order(shares, {}, needs, lambda *_: None, stuck))


def _equal(a: Any, b: Any) -> bool:
    if a is None or isinstance(a, str):
        return False
    return bool(np.array_equal(np.asarray(a, dtype=float), np.asarray(b, dtype=float)))
