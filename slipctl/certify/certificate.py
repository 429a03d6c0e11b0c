"""Certificates: facts that a reader can check with rationals alone; here, of super-twisting.

A certificate holds the gains as exact rationals, and proofs. ``check`` repeats each proof from the
gains, without the search that found it: Sylvester's minors with ``fractions``, and the enclosure of
ln q with outward-rounded decimals. A number that was altered does not agree any more.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from slipctl.certify import outward, proofs
from slipctl.certify import super_twisting as sta
from slipctl.certify.systems import CONTINUOUS
from slipctl.certify.twisting_report import CERTIFIED, REFUTED, checked, exact_verdict
from slipctl.errors import BadInput, nearest

Matrix = tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]

RATIONAL = re.compile(r"-?\d{1,200}(/[1-9]\d{0,199})?")
DECIMAL = re.compile(r"-?\d{1,60}(\.\d{1,60})?(E[+-]?\d{1,4})?")
ENTRIES = ("format", "kind", "system", "gains", "verdict", "exact", "quadratic")
KIND = "certificate"


class DoesNotHold(ValueError):
    """A certificate whose numbers prove nothing, or not what it says."""


@dataclass(frozen=True)
class Certificate:
    """Gains of the super-twisting law with proofs of a verdict.

    Attributes:
        gains: k1, k2, L, delta as rationals.
        verdict: CERTIFIED or REFUTED, by the exact criterion.
        exact: ``{"because": ...}`` where an inequality of rationals decides, otherwise
            ``{"because": "ln q", "ln_q": [low, high]}``, an enclosure as decimal texts.
        quadratic: None, or ``{"P": [[..], [..]], "theta": .., "minors": [m1, m2, m3], "det_P"}``
            with V = zeta' P zeta at k1 - delta.
    """

    gains: dict[str, Fraction]
    verdict: str
    exact: dict[str, Any]
    quadratic: dict[str, Any] | None

    def payload(self) -> dict[str, Any]:
        """Entries of the file."""
        gains = {k: {"value": str(v), "unit": sta.UNITS[k]} for k, v in self.gains.items()}
        found: dict[str, Any] = {"kind": KIND, "system": "super_twisting", "gains": gains}
        found |= {"verdict": self.verdict, "exact": self.exact}
        return found | ({"quadratic": self.quadratic} if self.quadratic else {})


def certify_super_twisting(
    k1: float | Fraction, k2: float | Fraction, L: float | Fraction, delta: float | Fraction = 0
) -> Certificate:
    """Prove a verdict, and find a quadratic Lyapunov function where one exists.

    Args:
        k1, k2: gains. L: bound of the disturbance's slope. delta: bound of |r1| over |x1|^(1/2).
            Fractions are taken as they are, floats by their exact binary value.

    Raises:
        BadInput: numbers that mean nothing, or gains on the boundary of stability.
    """
    gains = checked(k1, k2, L, delta)
    verdict, exact = _exact_proof(gains)
    return Certificate(gains, verdict, exact, find_quadratic(gains))


def minors(gains: Mapping[str, Fraction], P: Matrix, theta: Fraction) -> tuple[Fraction, ...]:
    """Leading minors of -[[A'P + PA + theta L^2 C'C, P B], [B'P, -theta]], and det P.

    A = [[-k/2, 1/2], [-k2, 0]] with k = k1 - delta, B = (0, 1)', C = (1, 0). All positive: V falls.

    Proof note: |x1|^(1/2) V' = zeta' (A'P + PA) zeta + 2 zeta' P B w with w^2 <= L^2 zeta1^2 is
    below the quadratic form of that matrix in (zeta, w).
    """
    k, k2, L = gains["k1"] - gains["delta"], gains["k2"], gains["L"]
    (p, r), (_, s) = P
    a = k * p + 2 * k2 * r - theta * L**2
    b = -(p / 2 - k * r / 2 - k2 * s)
    c = -r
    second = a * c - b * b
    third = theta * second - (a * s * s - 2 * b * r * s + c * r * r)
    return a, second, third, p * s - r * r


def check(payload: Mapping[str, Any]) -> str:
    """Check a certificate; gives what it proves, in one line.

    Raises:
        DoesNotHold: a proof fails, or its numbers do not belong to the gains.
        BadInput: it is no certificate of a system that is known, or an entry is no number.
    """
    if payload.get("kind") != KIND:
        raise BadInput("it is no certificate; slipctl certify ... --out FILE writes one")
    if payload.get("system") != "super_twisting":
        from slipctl.certify.catalogue import SYSTEMS

        name = payload.get("system")
        if not isinstance(name, str) or name not in SYSTEMS:
            known = ", ".join(SYSTEMS)
            raise BadInput(f"no check for the system {str(name)[:40]!r}; it has {known}")
        return proofs.check(SYSTEMS[name], payload)
    only(payload, ENTRIES, "the certificate")
    gains = checked(**_gains(payload.get("gains")))
    verdict, proof = _exact_proof(gains)
    if payload.get("verdict") not in (CERTIFIED, REFUTED):
        raise BadInput(f"the verdict must be {CERTIFIED} or {REFUTED}")
    if payload["verdict"] != verdict:
        raise DoesNotHold(f"it says {payload['verdict']}, but the gains are {verdict}")
    given = payload.get("exact")
    if not isinstance(given, Mapping):
        raise BadInput("the entry 'exact' is missing; it says why the verdict holds")
    only(given, ("because", "ln_q"), "exact")
    for text in given.get("ln_q", []) if isinstance(given.get("ln_q", []), list) else ["?"]:
        if not (isinstance(text, str) and DECIMAL.fullmatch(text)):
            raise BadInput("exact.ln_q must be two decimal numbers as texts")
    if dict(given) != proof:
        raise DoesNotHold(f"exact: {dict(given)} does not belong to the gains, {proof} does")
    shown_proofs = ["exact"]
    if "quadratic" in payload:
        _check_quadratic(gains, payload["quadratic"])
        shown_proofs.append("quadratic")
    shown = ", ".join(f"{k}={v}" for k, v in gains.items())
    by = f"({' and '.join(shown_proofs)} proof checked)"
    return f"super_twisting {shown}: {verdict} {CONTINUOUS} {by}"


def _check_quadratic(gains: Mapping[str, Fraction], given: Any) -> None:
    if not isinstance(given, Mapping):
        raise BadInput("the entry 'quadratic' must hold P, theta, minors and det_P")
    only(given, ("P", "theta", "minors", "det_P"), "quadratic")
    rows, written = given.get("P"), given.get("minors")
    square = isinstance(rows, list) and len(rows) == 2
    square = square and all(isinstance(row, list) and len(row) == 2 for row in rows or ())
    if not square or not isinstance(written, list) or len(written) != 3:
        raise BadInput("quadratic.P must be [[p, r], [r, s]] and quadratic.minors three rationals")
    (p, r), (r2, s) = [[rational(x, "quadratic.P") for x in row] for row in rows or ()]
    theta = rational(given.get("theta"), "quadratic.theta")
    said = [rational(x, "quadratic.minors") for x in written]
    said.append(rational(given.get("det_P"), "quadratic.det_P"))
    found = minors(gains, ((p, r), (r, s)), theta)
    if r != r2:
        raise DoesNotHold(f"quadratic: P is not symmetric, {r} and {r2}")
    if min(*found, theta, p) <= 0:
        raise DoesNotHold("quadratic: a minor, theta or P11 is not positive, so V need not fall")
    if list(found) != said:
        raise DoesNotHold("quadratic: the minors are not those of P, theta and the gains")


def rational(text: Any, where: str) -> Fraction:
    """Read "p/q".

    Raises:
        BadInput: it is none, or has more than 200 digits.
    """
    if not isinstance(text, str) or not RATIONAL.fullmatch(text):
        shown = repr(text) if len(repr(text)) < 40 else repr(text)[:36] + "..."
        raise BadInput(f"{where}: {shown} must be a text such as '3/2', at most 200 digits")
    return Fraction(text)


def _gains(given: Any) -> dict[str, Fraction]:
    if not isinstance(given, Mapping):
        raise BadInput("the entry 'gains' is missing; it holds k1, k2, L, delta")
    only(given, tuple(sta.UNITS), "gains")
    out = {}
    for name, unit in sta.UNITS.items():
        entry = given.get(name)
        if not isinstance(entry, Mapping):
            raise BadInput(f"gains.{name} is missing; write {{'value': '3/2', 'unit': '{unit}'}}")
        if entry.get("unit") != unit:
            raise BadInput(f"gains.{name} has the unit {entry.get('unit')!r}, it must be {unit!r}")
        out[name] = rational(entry.get("value"), f"gains.{name}")
    return out


def only(given: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Refuse entries that are not known.

    Raises:
        BadInput: an unknown entry.
    """
    for name in given:
        if name not in known:
            raise BadInput(f"{where} has no entry {str(name)[:40]!r}{nearest(str(name), known)}")


def _exact_proof(gains: dict[str, Fraction]) -> tuple[str, dict[str, Any]]:
    """Verdict of the exact criterion and why."""
    k1, k2, L, delta = (gains[k] for k in ("k1", "k2", "L", "delta"))
    if k2 <= L:
        return REFUTED, {"because": "k2 <= L"}
    if k1 <= delta:
        return REFUTED, {"because": "k1 <= delta"}
    if (k1 - delta) ** 2 >= 8 * (k2 + L):
        return CERTIFIED, {"because": "(k1 - delta)^2 >= 8 (k2 + L)"}
    found = outward.enclosure(k1, k2, L, delta)
    if found is None:
        exact_verdict(gains)
        raise BadInput("the gains lie on the boundary of stability")
    verdict = CERTIFIED if found[1] < 0 else REFUTED
    return verdict, {"because": "ln q", "ln_q": [str(x) for x in found]}


def find_quadratic(gains: Mapping[str, Fraction]) -> dict[str, Any] | None:
    """Quadratic function in closed form, rounded to as few digits as still prove it.

    Args:
        gains: k1, k2, L and delta.

    Returns:
        P, theta, minors and det_P as texts, or None if the criterion does not hold.
    """
    k, k2, L = gains["k1"] - gains["delta"], gains["k2"], gains["L"]
    if k <= 0 or not sta.quadratic(k, k2, L):
        return None
    for digits in (4, 6, 9, 14, 20, 30, 45):
        root = _root_below(k2 * k2 - L * L, digits)
        if root is None:
            continue
        raw = [_short(x, digits) for x in sta.quadratic_matrix(k, k2, L, root)]
        P = ((raw[0], raw[1]), (raw[1], raw[2]))
        found = minors(gains, P, Fraction(1))
        if min(*found, raw[0]) > 0:
            return {
                "P": [[str(x) for x in row] for row in P],
                "theta": "1",
                "minors": [str(x) for x in found[:3]],
                "det_P": str(found[3]),
            }
    return None


def _root_below(x: Fraction, digits: int) -> Fraction | None:
    """Rational at most sqrt(x) with about this many digits."""
    scale = _scale(x, 2 * digits + 2)
    scale *= scale
    root = Fraction(math.isqrt(int(x * scale)), math.isqrt(scale))
    return root if root > 0 else None


def _scale(x: Fraction, digits: int) -> int:
    """Power of ten at which x has about this many digits."""
    size = len(str(x.numerator)) - len(str(x.denominator))
    return int(10 ** max(digits - size, 0))


def _short(x: Fraction, digits: int) -> Fraction:
    """Round to about this many significant digits."""
    scale = _scale(abs(x), digits)
    return Fraction(round(x * scale), scale)
