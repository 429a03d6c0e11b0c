"""Certificates of every system: both sides of each inequality as exact rationals or enclosures.

``write`` decides each criterion with rationals and keeps the two sides. ``check`` computes the
sides again from the numbers in the file, and from the multipliers that it brings, and compares
them: it needs no search and no solver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify.outward import Interval
from slipctl.certify.systems import (
    CERTIFIED,
    EXACT,
    NECESSARY,
    REFUTED,
    SUFFICIENT,
    Criterion,
    Side,
    System,
    checked,
    verdict_of,
)
from slipctl.errors import BadInput

KIND = "certificate"


class Asked(dict[str, Fraction]):
    """Numbers that remember which of them were used; a certificate holds no others."""

    def __init__(self, numbers: Mapping[str, Fraction]) -> None:
        super().__init__(numbers)
        self.used: set[str] = set()

    def __getitem__(self, name: str) -> Fraction:
        if name not in self:
            raise BadInput(f"gains.{name} is missing")
        self.used.add(name)
        return super().__getitem__(name)

    def beside(self, found: Mapping[str, Fraction]) -> Asked:
        """Give the same numbers and further ones, with a memory of their own."""
        return Asked({**self, **found})


def write(system: System, given: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of a certificate.

    Raises:
        BadInput: numbers that mean nothing, or a verdict that needs more than rationals.
    """
    numbers = Asked(checked(system, given))
    proofs, held = {}, {}
    for name, c in system.asked(numbers).items():
        found = c.find(dict(numbers)) or {}
        own = numbers.beside(found)
        sides = c.sides(own)
        hard = c.kind in (EXACT, NECESSARY)
        if not _finite(sides):
            if hard:
                raise BadInput(
                    f"{system.name}: '{name}' has no finite exact check at these numbers"
                    f" ({sides[-1].text}); leave out --out"
                )
            continue
        holds = _decided(sides)
        if hard or (holds and c.kind == SUFFICIENT):
            held[name] = holds
            numbers.used |= own.used
            proofs[name] = _written(holds, found, sides)
    system.time(numbers)  # so that the certificate names what tells the time
    gains = {
        k: {"value": str(v), "unit": system.numbers[k].unit}
        for k, v in numbers.items()
        if k in numbers.used
    }  # fmt: skip
    verdict = verdict_of(system, held)
    return {
        "kind": KIND, "system": system.name, "gains": gains, "verdict": verdict, "proofs": proofs
    }  # fmt: skip


def check(system: System, payload: Mapping[str, Any]) -> str:
    """Check a certificate of a system; gives what it proves, in one line.

    Raises:
        DoesNotHold: a proof fails, or its numbers do not belong to the gains.
        BadInput: it is malformed.
    """
    from slipctl.certify.certificate import DoesNotHold, only

    only(payload, ("format", "kind", "system", "gains", "verdict", "proofs"), "the certificate")
    numbers = Asked(_numbers(system, payload.get("gains")))
    proofs, asked = payload.get("proofs"), system.asked(numbers)
    if not isinstance(proofs, Mapping):
        raise BadInput("the entry 'proofs' is missing; it says why the verdict holds")
    held = {}
    numbers.used.clear()
    for name, given in proofs.items():
        if name not in asked:
            raise BadInput(f"proofs: {system.name} has no criterion {str(name)[:40]!r} here")
        held[name] = _check_proof(name, asked[name], numbers, given)
    missing = [k for k, c in asked.items() if c.kind in (EXACT, NECESSARY) and k not in held]
    if missing:
        raise BadInput(f"proofs: no proof of {', '.join(missing)}")
    time = system.time(numbers)
    for name in numbers:
        if name not in numbers.used:
            raise BadInput(f"gains.{name} plays no role in the proofs; leave it out")
    verdict = verdict_of(system, held)
    if payload.get("verdict") != verdict:
        said = str(payload.get("verdict"))[:40]
        raise DoesNotHold(f"it says {said!r}, but its proofs say {verdict}")
    shown = ", ".join(f"{k}={v}" for k, v in numbers.items())
    return f"{system.name} {shown}: {verdict} {time} ({', '.join(held)} checked)"


def _check_proof(name: str, criterion: Criterion, numbers: Asked, given: Any) -> bool:
    from slipctl.certify.certificate import DoesNotHold, only, rational

    where = f"proofs.{name}"
    if not isinstance(given, Mapping):
        raise BadInput(f"{where} must hold verdict and sides")
    only(given, ("verdict", "multipliers", "sides"), where)
    brought = given.get("multipliers", {})
    if not isinstance(brought, Mapping) or (brought and set(brought) != set(criterion.multipliers)):
        wanted = ", ".join(criterion.multipliers) or "nothing"
        raise BadInput(f"{where}.multipliers must hold {wanted}")
    found = {k: rational(v, f"{where}.multipliers.{k}") for k, v in brought.items()}
    own = numbers.beside(found)
    try:
        sides = criterion.sides(own)
    except ZeroDivisionError:
        raise DoesNotHold(f"{where}: a multiplier is zero") from None
    numbers.used |= own.used
    if not _finite(sides):
        raise BadInput(f"{where} has no finite exact check at these numbers")
    holds = _decided(sides)
    if criterion.kind == SUFFICIENT and not holds:
        raise DoesNotHold(f"{where}: {_failing(sides).text} is false")
    if dict(given) != _written(holds, found, sides):
        raise DoesNotHold(f"{where}: its sides or its verdict do not belong to the gains")
    return holds


def _numbers(system: System, given: Any) -> dict[str, Fraction]:
    from slipctl.certify.certificate import only, rational

    if not isinstance(given, Mapping):
        raise BadInput(f"the entry 'gains' is missing; it holds {', '.join(system.numbers)}")
    only(given, tuple(system.numbers), "gains")
    out = {}
    for name, number in system.numbers.items():
        entry = given.get(name)
        if name not in given:
            continue  # a proof that uses it says so
        if not isinstance(entry, Mapping):
            raise BadInput(f"gains.{name} must be {{'value': '3/2', 'unit': '{number.unit}'}}")
        if entry.get("unit") != number.unit:
            raise BadInput(
                f"gains.{name} has the unit {entry.get('unit')!r}, it must be {number.unit!r}"
            )
        out[name] = rational(entry.get("value"), f"gains.{name}")
    return {k: v for k, v in checked(system, out, whole=False).items() if k in out}


def _finite(sides: Sequence[Side]) -> bool:
    return not any(isinstance(x, float) for s in sides for x in (s.left, s.right))


def _decided(sides: Sequence[Side]) -> bool:
    found = [s.holds() for s in sides]
    if False in found:
        return False
    if None in found:
        text = sides[found.index(None)].text
        raise BadInput(f"on the boundary of '{text}'; change a number in its last digit")
    return True


def _failing(sides: Sequence[Side]) -> Side:
    return next(s for s in sides if s.holds() is False)


def _written(holds: bool, found: Mapping[str, Fraction], sides: Sequence[Side]) -> dict[str, Any]:
    shown = [{"text": s.text, "left": _text(s.left), "right": _text(s.right)} for s in sides]
    entry: dict[str, Any] = {"verdict": CERTIFIED if holds else REFUTED, "sides": shown}
    return entry | ({"multipliers": {k: str(v) for k, v in found.items()}} if found else {})


def _text(x: Any) -> Any:
    return x.texts() if isinstance(x, Interval) else str(Fraction(x))
