"""Which places of the parts one shared number is bound to, and whether they can have one."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import lru_cache

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.shared_numbers import Share, differences, has_place, signal_at
from slipctl.block.signals import Signal, common_range
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.block.units import unit_algebra
from slipctl.errors import BadInput, nearest


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
            signals = [signal_at(blocks, p) for p in told]
            lifted = [
                _lifted(name, blocks, share, p, s, taken, left)
                for p, s in zip(told, signals, strict=True)
                if s.derived and share.expression is None and signals[0].derived
            ]
            _agree(name, share, told, signals, lifted)
            value = share.expression or (lifted[0] if lifted else None)
            made = _declared(blocks, share, told, signals, value)
            found[share.name] = replace(made, places=places)
    found = _shaped(blocks, found)
    for share in found.values():
        _check_unit(name, share, found)
    return found


def _shaped(blocks: Mapping[str, Block], shares: dict[str, Share]) -> dict[str, Share]:
    """Shares in which what is computed from vectors is a vector too, where all its places are."""
    for key in [k for k, s in shares.items() if s.expression and not s.begins]:
        share = shares[key]
        assert share.signal is not None
        assert share.expression is not None
        used = [shares[k].signal for k in names_in(share.expression) if k in shares]
        own = {signal_at(blocks, p).shape for p in share.places}
        if len(own) == 1 and any(s is not None and s.shape == next(iter(own)) for s in used):
            signal = replace(share.signal, shape=next(iter(own)))
            shares[key] = replace(share, signal=signal)
    return shares


def _places(
    name: str, blocks: Mapping[str, Block], share: Share, apart: Mapping[str, Mapping[str, str]]
) -> list[str]:
    """Places of a share, those set apart included; patterns meet parameters in order.

    ``apart`` has the places by part that left a share inside it; they do not come back.
    """
    found: dict[str, None] = {}
    for wanted in share.wanted:
        if "*" not in wanted:
            part, _, n = wanted.partition(".")
            if part in blocks and n in blocks[part].sharing.aliases:
                inner = blocks[part].sharing.name(n)
                raise BadInput(
                    f"{name}: share {share.name!r} names {wanted}, which {part} shares as {inner};"
                    f" write {part}.{inner}"
                )
            if not has_place(blocks, wanted):
                if part not in blocks:
                    why = f"there is no part {part!r}{nearest(part, blocks)}"
                else:
                    known = [*blocks[part].params, *blocks[part].states]
                    why = f"{part} has no {n!r}{nearest(n, known)}"
                raise BadInput(f"{name}: share {share.name!r} names {wanted}, but {why}")
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
    s = signal_at(blocks, place)
    needs = names_in(s.value) if s.derived and s.shape and n in blocks[b].params else ()
    return any(f"{b}.{blocks[b]._sibling(n, k)}" in left for k in needs)


def _agree(
    name: str, share: Share, places: Sequence[str], signals: Sequence[Signal],
    lifted: Sequence[str],
) -> None:  # fmt: skip
    """Refuse places that cannot have one number.

    Places that are derived alike have one: ``lifted`` are their expressions of shared numbers.
    """
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
    lo, hi = common_range(signals)
    if lo > hi:
        low = next(p for p, s in zip(places, signals, strict=True) if s.lo == lo)
        high = next(p for p, s in zip(places, signals, strict=True) if s.hi == hi)
        raise BadInput(
            f"{name}: share {share.name!r}: {low} is at least {lo:g} {first.unit}, {high} at most"
            f" {hi:g} {first.unit}; no number is in both ranges"
        )


def _check_unit(name: str, share: Share, shares: Mapping[str, Share]) -> None:
    """Refuse an expression of shared numbers that has another unit than its places.

    A number alone is in the unit of its places.
    """
    if share.expression is None or share.signal is None or not names_in(share.expression):
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
    from slipctl.block.units import unit_algebra, unit_walk

    with unit_algebra.checking_units():
        value = ca.SX(evaluate(expression, {k: ca.SX.sym(k) for k, _ in given}, expression))
        found = unit_walk.check({"share": value}, dict(given), {"share": unit}, {})
    return found[0].partition(": ")[2] if found else ""


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
    lo, hi = common_range(signals)
    signal = first.as_role(
        "param",
        name=share.name,
        deviation="",
        truth=(),
        value=first.value if value is None else value,
        shape=() if alone else first.shape,
        lo=lo,
        hi=hi,
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
