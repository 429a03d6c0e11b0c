"""One number of several parts: declared once, and what each spelling of its name means."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.order import solve_order
from slipctl.block.signals import Signal, evaluate, names_in
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


def bind(name: str, blocks: Mapping[str, Block], shares: Mapping[str, Share]) -> dict[str, Share]:
    """Find the places of each share among the parts.

    A share all of whose places are patterns, and which no part has, is left out.

    Raises:
        BadInput: a place that no part has, of another unit or shape, ranges without a common
            number, a place that two shares want. A derived place, an expression of what is not
            shared.
    """
    found: dict[str, Share] = {}
    taken: dict[str, str] = {}
    apart = {b: differences(block) for b, block in blocks.items()} if shares else {}
    met = {share.name: _places(name, blocks, share, apart) for share in shares.values()}
    for share in shares.values():
        for place in met[share.name]:
            if place in taken:
                raise BadInput(
                    f"{name}: {place} is shared as {taken[place]} and as {share.name}; write one"
                )
            taken[place] = share.name
    left = {place for share in shares.values() for place in share.apart}
    left |= {f"{b}.{place}" for b, places in apart.items() for place in places}
    for share in shares.values():
        every = met[share.name]
        places = tuple(
            p for p in every if p not in share.apart and not _follows(blocks, p, left)
        )  # fmt: skip
        if places or (every and share.expression):  # what is computed stands without a place too
            told = places or tuple(every)
            signals = [_signal(blocks, p) for p in told]
            lifted = [
                _lifted(name, blocks, share, p, s, taken, left)
                for p, s in zip(told, signals, strict=True)
                if s.derived and share.expression is None and signals[0].derived
            ]
            _agree(name, share, told, signals, lifted)
            value = share.expression or (lifted[0] if lifted else None)
            made = _declared(blocks, share, told, signals, value)
            found[share.name] = replace(made, places=places)
    for share in found.values():
        _check_unit(name, share, found)
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
            s = _signal(blocks, place)
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
        found |= {place: share.name for place in sorted(share.apart) if _has(block.parts, place)}
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
    roles = tuple(roles)
    known = dict.fromkeys(n for role in roles for n in block._signals[role])
    if "param" in roles:
        known |= dict.fromkeys(block.sharing.aliases)
    if name in known:
        return [name]
    pattern = name if "*" in name else f"*.{name}"
    hits = [n for n in known if fnmatchcase(n, pattern)]
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
        if missed and not any(h in block.sharing.owners for h in hits if _same(block, h, shared)):
            raise BadInput(
                f"{name} meets {len(places) - len(missed)} of the {len(places)} places of"
                f" {shared}; write {shared}= for all of them, or {hit}= for that one alone"
            )
        if hit not in left:
            found[shared] = None
    if len(found) > 1 and "*" not in name:
        raise BadInput(
            f"{name!r} could be {' or '.join(found)}; write which, or '*.{name}' for all"
        )
    return list(found)


def _same(block: Block, place: str, shared: str) -> bool:
    return block.sharing.aliases.get(place) == shared


def _places(
    name: str, blocks: Mapping[str, Block], share: Share, apart: Mapping[str, Mapping[str, str]]
) -> list[str]:
    """Places of a share, those set apart included; patterns meet parameters in order.

    ``apart`` has the places by part that left a share inside it; they do not come back.
    """
    found: dict[str, None] = {}
    for wanted in share.wanted:
        if "*" not in wanted:
            if not _has(blocks, wanted):
                part, _, n = wanted.partition(".")
                if part not in blocks:
                    why = f"there is no part {part!r}{nearest(part, blocks)}"
                else:
                    known = [*blocks[part].params, *blocks[part].states]
                    why = f"{part} has no {n!r}{nearest(n, known)}"
                raise BadInput(f"{name}: share {share.name!r} names {wanted}, but {why}")
            part, _, n = wanted.partition(".")
            if n in blocks[part].sharing.aliases:
                inner = blocks[part].sharing.name(n)
                raise BadInput(
                    f"{name}: share {share.name!r} names {wanted}, which {part} shares as {inner};"
                    f" write {part}.{inner}"
                )
            found[wanted] = None
        else:
            for b, block in blocks.items():
                met = (n for n in block.params if fnmatchcase(f"{b}.{n}", wanted))
                found |= dict.fromkeys(
                    f"{b}.{n}" for n in met if n not in apart[b] and not block.params[n].derived
                )
    return list(found)


def _follows(blocks: Mapping[str, Block], place: str, left: Set[str]) -> bool:
    """Whether a vector is derived of what was set apart, so that it is apart too."""
    b, _, n = place.partition(".")
    s = _signal(blocks, place)
    needs = names_in(s.value) if s.derived and s.shape and n in blocks[b].params else ()
    return any(f"{b}.{blocks[b]._sibling(n, k)}" in left for k in needs)


def _has(blocks: Mapping[str, Block], place: str) -> bool:
    b, _, n = place.partition(".")
    return b in blocks and (n in blocks[b].params or n in blocks[b].states)


def _signal(blocks: Mapping[str, Block], place: str) -> Signal:
    b, _, n = place.partition(".")
    block = blocks[b]
    return block.params.get(n) or block.states[n]


def _agree(
    name: str, share: Share, places: Sequence[str], signals: Sequence[Signal],
    lifted: Sequence[str],
) -> None:  # fmt: skip
    """Refuse places that cannot have one number.

    Places that are derived alike have one: ``lifted`` are their expressions of shared numbers.
    """
    from slipctl.block.units import unit_algebra

    first = next((s for s in signals if len(s.shape) == 0), signals[0])
    for place, s in zip(places[1:], signals[1:], strict=True):
        same = s.unit == first.unit or (
            unit_algebra.dimension_equal(s.unit, first.unit)
            and unit_algebra.factor(s.unit, first.unit) == 1.0
        )
        if not same:
            raise BadInput(
                f"{name}: share {share.name!r}: {place} is in {s.unit}, {places[0]} in"
                f" {first.unit}; write both in one unit"
            )
        scalar = first.shape == () or share.expression or signals[0].derived
        if s.shape not in ((), first.shape) and not scalar:
            raise BadInput(
                f"{name}: share {share.name!r}: {place} has shape {s.shape}, {places[0]}"
                f" {first.shape}"
            )
        if s.derived and not (lifted and set(lifted) == {lifted[0]}):
            raise BadInput(
                f"{name}: share {share.name!r}: {place} is derived, {s.value}; share what it"
                " depends on"
            )
    lo, hi = max(s.lo for s in signals), min(s.hi for s in signals)
    if lo > hi:
        low = next(p for p, s in zip(places, signals, strict=True) if s.lo == lo)
        high = next(p for p, s in zip(places, signals, strict=True) if s.hi == hi)
        raise BadInput(
            f"{name}: share {share.name!r}: {low} is at least {lo:g} {first.unit}, {high} at most"
            f" {hi:g} {first.unit}; no number is in both ranges"
        )


def _check_unit(name: str, share: Share, shares: Mapping[str, Share]) -> None:
    """Refuse an expression of shared numbers that has another unit than its places."""
    if share.expression is None or share.signal is None:
        return
    given = []
    for k in names_in(share.expression):
        other = shares[k].signal if k in shares else None
        if other is None:
            return  # an unknown name is refused with those that there are
        given.append((k, other.unit))
    wrong = _unit_error(share.expression, share.signal.unit, tuple(given))
    if wrong:
        raise BadInput(
            f"{name}: share {share.name!r} = {share.expression!r} is no {share.signal.unit}, the"
            f" unit of {(share.places or share.wanted)[0]}: {wrong}"
        )


@lru_cache(maxsize=4096)
def _unit_error(expression: str, unit: str, given: tuple[tuple[str, str], ...]) -> str:
    """What is wrong with the unit of an expression, empty if nothing is."""
    import casadi as ca

    from slipctl.block.units import unit_algebra, unit_walk

    with unit_algebra.checking_units():
        value = ca.SX(evaluate(expression, {k: ca.SX.sym(k) for k, _ in given}, expression))
        found = unit_walk.check({"share": value}, dict(given), {"share": unit}, {})
    return found[0].partition(": ")[2] or found[0] if found else ""


def _declared(
    blocks: Mapping[str, Block],
    share: Share,
    places: tuple[str, ...],
    signals: Sequence[Signal],
    value: str | None,
) -> Share:
    """Share with its places and its signal, which the first place declares.

    ``value`` is an expression of other shared numbers, where it is computed from them.

    Where some places are one number and others have one for each copy, the share is one number.
    """
    b, _, n = places[0].partition(".")
    begins = n in blocks[b].states or n in blocks[b].sharing.begun
    first = next((s for s in signals if s.shape == ()), signals[0])
    # copies that begin alike begin with one number
    alone = begins and np.ndim(first.value) == 0
    alone |= value is not None and (begins or share.expression is not None)
    signal = first.as_role(
        "param",
        name=share.name,
        deviation="",
        truth=(),
        value=first.value if value is None else value,
        shape=() if alone else first.shape,
        lo=max(s.lo for s in signals),
        hi=min(s.hi for s in signals),
        source=first.source or next((s.source for s in signals if s.source), ""),
    )
    return replace(share, places=places, begins=begins, signal=signal)


def _lifted(
    name: str,
    blocks: Mapping[str, Block],
    share: Share,
    place: str,
    signal: Signal,
    taken: Mapping[str, str],
    left: Set[str],
) -> str:
    """Expression of a place, ``"v / r"`` beside a wheel, in the names of the shares."""
    b, _, n = place.partition(".")
    part = blocks[b]
    names: dict[str, str] = {}
    own: dict[str, float] = {}  # of places that were set apart
    for k in names_in(signal.value):
        full = f"{b}.{part._sibling(n, k)}"
        if full in left:
            own[k] = float(np.ravel(part.param_values()[part._sibling(n, k)])[0])
            continue
        if full not in taken:
            raise BadInput(
                f"{name}: share {share.name!r}: {place} = {signal.value!r} uses {full}, which is"
                " not shared; share it too"
            )
        names[k] = taken[full]

    class Rename(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> ast.expr:
            if node.id in own:
                return ast.Constant(own[node.id])
            return ast.Name(names.get(node.id, node.id), node.ctx)

    tree = Rename().visit(ast.parse(signal.value, mode="eval"))
    return ast.unparse(tree)


def _in_order(name: str, shares: Mapping[str, Share]) -> list[str]:
    """Names of the shares, each after those that it is computed from."""

    def needs(_: str, share: Share) -> list[str]:
        assert share.signal is not None
        return names_in(share.signal.value) if share.signal.derived else []

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
