"""What fresh draws prove of tuned gains: kept in at least a share of all draws, with confidence.

The draws of a statement are used for it alone. One that falls short may be followed by another, on
draws of its own; the file counts them. The j-th has the j-th part of the allowed chance of an
error, and the confidence that is told allows for all of them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.arithmetic import binomial
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.design.gain_search import FIRST_PROOF, Search
from slipctl.design.goals import Limit, single
from slipctl.errors import BadInput
from slipctl.run.sweep.ensemble import read_ensemble

SHARE = Fraction(99, 100)
"""Share of all draws in which a claim shall hold."""

BETA = Fraction(1, 10**6)
"""Allowed chance that a statement is wrong."""

ENTRIES = ("ensemble", "hash", "scenario", "seed", "attempt", "draws", "set", "swapped",
           "objective", "unit", "values", "claims")  # fmt: skip
CLAIM = ("text", "metric", "upper", "limit", "unit", "wanted", "violations", "share", "values")


@dataclass(frozen=True)
class Claim:
    """A claim of a statement.

    Attributes:
        text: what holds. draws, violations: what was seen. share: of all draws in which it holds
            at least. wanted: that shall be reached.
    """

    text: str
    draws: int
    violations: int
    share: Fraction
    wanted: Fraction

    @property
    def reached(self) -> bool:
        """Whether the share that was wanted is proved."""
        return self.share >= self.wanted

    def line(self, missing: Fraction) -> str:
        """The claim in words."""
        seen = f"{self.violations} of {self.draws} fresh draws are beyond"
        lost = "" if self.reached else f"; {100 * float(self.wanted):g} % were wanted"
        return (
            f"{self.text} in at least {_rounded(100 * self.share, ROUND_FLOOR)} % of draws,"
            f" confidence 1 - {_rounded(missing, ROUND_CEILING)}: {seen}{lost}"
        )


DIGITS = 6
"""Of the numbers in a statement; they are rounded to the side on which it is true."""


def _rounded(value: Fraction, side: str) -> str:
    context = Context(prec=DIGITS, rounding=side)
    told = context.divide(Decimal(value.numerator), Decimal(value.denominator))
    return f"{told:g}" if -4 <= told.adjusted() < DIGITS else f"{told:e}"


def level(attempt: int) -> Fraction:
    """Chance of an error that an attempt may have."""
    return BETA / attempt


def error_chance(attempt: int) -> Fraction:
    """Chance that this attempt or one before it is wrong, at most."""
    return sum((level(j) for j in range(1, attempt + 1)), Fraction(0))


def prove(search: Search) -> dict[str, Any]:
    """Entries of the statement of the best numbers of a search.

    What was stated in the same folder is taken again if it reached what was wanted; else fresh
    draws are run.
    """
    attempt = 1
    while True:
        kept = search.rolls.count(FIRST_PROOF + attempt - 1)
        fresh = kept < binomial.draws_needed(1 - SHARE, level(attempt))
        entries = _attempt(search, attempt)
        if fresh or all(c.reached for c in check(entries)):
            return entries
        attempt += 1


def _attempt(search: Search, attempt: int) -> dict[str, Any]:
    world, goal = search.rolls.world, search.objective
    draws = binomial.draws_needed(1 - SHARE, level(attempt))
    asked = [(search.best.number, search.best.numbers, k) for k in range(draws)]
    search.rolls.begin(f"statement on {draws} fresh draws", draws)
    metrics = search.rolls.all(FIRST_PROOF + attempt - 1, asked)
    values = [math.inf if m is None else goal.value(m) for m in metrics]
    unit = next((goal.unit(m) for m in metrics if m), "1")
    claims = []
    for limit in search.limits:
        worst = math.inf if limit.upper else -math.inf
        seen = [worst if m is None else single(m[limit.metric], limit.upper) for m in metrics]
        claims.append(_claim(limit, seen, level(attempt)))
    return {
        "ensemble": world.ensemble.told(), "hash": world.ensemble.hash,
        "scenario": world.scenario.name, "seed": world.seed, "attempt": attempt, "draws": draws,
        "objective": goal.text, "unit": unit, "values": [v.hex() for v in values],
        "claims": claims,
    }  # fmt: skip


def _claim(limit: Limit, seen: Sequence[float], beta: Fraction) -> dict[str, Any]:
    beyond = _beyond(seen, limit.upper, limit.value)
    wanted = SHARE if limit.share == 1 else Fraction(str(limit.share))
    return {
        "text": limit.text, "metric": limit.metric, "upper": limit.upper,
        "limit": limit.value.hex(), "unit": limit.unit, "wanted": str(wanted),
        "violations": beyond, "share": str(1 - binomial.largest_share(len(seen), beyond, beta)),
        "values": [float(v).hex() for v in seen],
    }  # fmt: skip


def _beyond(seen: Sequence[float], upper: bool, limit: float) -> int:
    return sum(not (v <= limit if upper else v >= limit) for v in seen)


# ---- checking it ---------------------------------------------------------------------------------


def check(given: Mapping[str, Any]) -> list[Claim]:
    """Recompute the claims of a statement from its draws, in integers.

    Raises:
        DoesNotHold: a count, a share or the hash is not what its draws give.
        BadInput: it is malformed.
    """
    found = read_mapping(given, ENTRIES, "statistical")
    attempt = whole(found.get("attempt"), "statistical.attempt", 1, 1000)
    draws = whole(found.get("draws"), "statistical.draws", 1, binomial.MOST)
    whole(found.get("seed"), "statistical.seed", 0, 2**62)
    if read_ensemble("statistical.ensemble", found.get("ensemble")).hash != found.get("hash"):
        raise DoesNotHold("statistical: the hash is not that of the ensemble in it")
    beta = level(attempt)
    values = _numbers(found.get("values"), "statistical.values", draws)
    ended = [v for v in values if math.isfinite(v)]
    lost = draws - len(ended)
    said = str(found.get("objective"))[:200]
    said += " has a value" if lost else f" <= {_bound(max(ended), found.get('unit'))}"
    claims = [Claim(said, draws, lost, 1 - binomial.largest_share(draws, lost, beta), SHARE)]
    for k, row in enumerate(rows(found.get("claims", []), "statistical.claims", 100)):
        where = f"statistical.claims[{k}]"
        entry = read_mapping(row, CLAIM, where, True)
        seen = _numbers(entry["values"], f"{where}.values", draws)
        limit = _numbers([entry["limit"]], f"{where}.limit", 1)[0]
        beyond = whole(entry["violations"], f"{where}.violations", 0, draws)
        share = rational(entry["share"], f"{where}.share")
        if _beyond(seen, entry["upper"] is True, limit) != beyond:
            raise DoesNotHold(f"{where}: {beyond} violations are not what its draws show")
        if not (0 <= share <= 1 and (share == 0 or binomial.holds(draws, beyond, 1 - share, beta))):
            raise DoesNotHold(f"{where}: its draws do not prove the share {share}")
        sign = "<=" if entry["upper"] is True else ">="
        said = f"{str(entry['metric'])[:80]} {sign} {limit:.17g} {str(entry['unit'])[:40]}"
        wanted = rational(entry["wanted"], f"{where}.wanted")
        claims.append(Claim(said, draws, beyond, share, wanted))
    return claims


def lines(given: Mapping[str, Any]) -> list[str]:
    """The statement in words, a line for each claim."""
    claims = check(given)
    attempt = int(given["attempt"])
    head = f"ensemble {str(given['hash'])[:16]}, seed {given['seed']}, attempt {attempt}"
    return [f"{c.line(error_chance(attempt))} ({head})" for c in claims]


def _bound(value: float, unit: Any) -> str:
    """Upper bound with its unit, rounded up."""
    told = _rounded(Fraction(value), ROUND_CEILING)
    return told if unit == "1" else f"{told} {str(unit)[:40]}"


def _numbers(given: Any, where: str, many: int) -> list[float]:
    """Numbers of texts as ``float.hex`` writes them."""
    found = []
    for text in rows(given, where, many, many):
        if not isinstance(text, str) or len(text) > 40:
            raise BadInput(f"{where}: {str(text)[:40]!r} is no number as a hexadecimal text")
        try:
            found.append(float.fromhex(text))
        except (ValueError, OverflowError):
            raise BadInput(f"{where}: {text!r} is no number as a hexadecimal text") from None
    if any(math.isnan(v) for v in found):
        raise BadInput(f"{where}: a number in it is nan")
    return found


def repeated_draws(payload: Mapping[str, Any], many: int, draws: int) -> list[int]:
    """Draws that are repeated: by the content of the file, so that nobody knows them before."""
    import hashlib

    digest = hashlib.sha256(json.dumps(payload, sort_keys=True).encode()).digest()
    words = [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 32, 4)]
    random = np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))
    return sorted(int(k) for k in random.choice(draws, min(many, draws), replace=False))
