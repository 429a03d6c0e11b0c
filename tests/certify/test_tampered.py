"""Certificates of which one entry was altered: refused in words, or what they say is proved anew.

``python tests/certify/test_tampered.py`` writes anew which alteration ends how. So a check begins
to refuse where it did. Cases are those of ``recorded.json``.
"""

from __future__ import annotations

import copy
import itertools
import json
from collections.abc import Iterator, Mapping
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

from slipctl import BadInput
from slipctl.certify import certificate, proofs
from slipctl.certify.catalogue import SYSTEMS
from slipctl.certify.checksum import with_checksum
from slipctl.certify.entries import RATIONAL, DoesNotHold

TABLE = Path(__file__).parent / "tampered.json"
CASES, LEAVES = 2, 4
"""Certificates of each kind of proof of a system, and entries of each list that are altered."""
MOST = 60
"""Alterations of a certificate."""
SHARES = (Fraction(1, 10**6), Fraction(1, 100), Fraction(1, 2))
NEVER: tuple[Any, ...] = (None, True, 0.5, "", "nan", "1e3", "x", [], {}, "1" * 201)
"""What no entry may hold; True, 0.5 and others stand for what Python would take for a number."""


def entries(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Entries that are no list and no mapping, with their places; a few of a long list."""
    if isinstance(value, Mapping):
        for k in value:
            yield from entries(value[k], (*path, k))
    elif isinstance(value, list):
        for i in sorted({round(k * (len(value) - 1) / (LEAVES - 1)) for k in range(LEAVES)}
                        if value else []):  # fmt: skip
            yield from entries(value[i], (*path, i))
    else:
        yield path, value


def others(value: Any) -> Iterator[Any]:
    """Numbers near to an entry and far from it, written as it is."""
    if isinstance(value, int):
        yield from (value + 1, value - 1, 2 * value + 3, -value - 1)
        return
    try:
        number = Fraction(value)
    except ValueError:
        yield from (value[:-1], value + value[:1], value[::-1] + "?")
        return
    decimal = not RATIONAL.fullmatch(value)
    for share in SHARES:
        for other in (number * (1 + share), number * (1 - share)):
            yield repr(float(other)) if decimal else str(other)
    yield repr(float(-number - 1)) if decimal else str(-number - 1)


def near(a: str, b: str) -> bool:
    """Whether two rationals differ in digits only that a promise does not show."""
    return abs(Fraction(a) - Fraction(b)) <= abs(Fraction(b)) / 10**4


def altered(payload: Mapping[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """The file with another entry at a place."""
    new = copy.deepcopy(dict(payload))
    at: Any = new
    for k in path[:-1]:
        at = at[k]
    at[path[-1]] = value
    return new


def resealed(payload: dict[str, Any]) -> dict[str, Any]:
    """The file with the seals that belong to its entries."""
    numbers = {k: Fraction(v["value"]) for k, v in payload["asked"].items()}
    held = [p["evidence"] for p in payload.get("proofs", {}).values() if "evidence" in p]
    held += [payload["counterexample"]["run"]] if "run" in payload.get("counterexample", {}) else []
    for entry in held:
        if entry.pop("seal", None):
            entry |= with_checksum(numbers, entry)
    return payload


def ends(payload: Mapping[str, Any]) -> str:
    """P where it is proved anew, D where it proves nothing, B where it is malformed."""
    try:
        certificate.check(payload)
    except DoesNotHold as refused:
        return "D" if str(refused) else "?"
    except BadInput as refused:
        return "B" if str(refused) else "?"
    return "P"


@lru_cache
def certificates(name: str) -> list[dict[str, Any]]:
    """A few certificates of each kind."""
    seen: dict[Any, int] = {}
    found = []
    recorded = Path(__file__).parent / "recorded.json"
    for case in json.loads(recorded.read_text(encoding="utf-8"))[name]["cases"]:
        payload = proofs.write(SYSTEMS[name], {k: Fraction(str(v)) for k, v in case["of"].items()})
        kind = (*payload.get("proofs", {}), payload.get("counterexample", {}).get("by"))
        seen[kind] = seen.get(kind, 0) + 1
        if kind != (None,) and seen[kind] <= CASES:
            found.append(payload)
    return found


def outcomes(name: str) -> list[str]:
    """How each alteration of what a proof brings ends, file by file."""
    found = []
    for payload in certificates(name):
        brought = [(path, v) for part in ("proofs", "counterexample")
                   for path, value in entries(payload.get(part, {}), (part,))
                   if path[-1] != "seal" for v in others(value)]  # fmt: skip
        brought = brought[:: 1 + len(brought) // MOST]
        found.append("".join(ends(resealed(altered(payload, *b))) for b in brought))
    return found


@pytest.mark.table
@pytest.mark.parametrize("name", SYSTEMS)
def test_what_an_alteration_does_is_what_it_did(name: str) -> None:
    assert outcomes(name) == json.loads(TABLE.read_text(encoding="utf-8"))[name]


@pytest.mark.second
@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.others("long")
def test_what_is_no_number_is_refused_in_words(name: str) -> None:
    """Anywhere in a file: refused by a line, never by an error from inside."""
    for payload in certificates(name)[:2]:
        assert ends(payload) == "P"
        for path, value in entries(payload):
            for wrong in NEVER:
                if wrong != value:
                    file = altered(payload, path, wrong)
                    file = file if path[0] == "asked" or path[-1] == "seal" else resealed(file)
                    assert ends(file) in "BD", (path, wrong)


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_was_asked_cannot_be_altered(name: str) -> None:
    """Its numbers, its promise, its verdict: the one does not belong to the other any more."""
    for payload in certificates(name)[:2]:
        for part in ("asked", "promise", "verdict", "time"):
            for path, value in entries(payload[part], (part,)):
                for v in others(value) if part != "asked" or path[-1] == "value" else ():
                    if v == value or (part == "asked" and near(v, value)):
                        continue  # a promise shows ten digits
                    assert ends(altered(payload, path, v)) in "BD", (path, v)


def told(payload: Mapping[str, Any]) -> dict[str, Fraction]:
    return {k: Fraction(v["value"]) for k, v in payload["asked"].items()}


def sealed(numbers: Mapping[str, Fraction], entry: Mapping[str, Any]) -> dict[str, Any]:
    """An entry with the seal of other numbers, where it has one."""
    left = {k: v for k, v in entry.items() if k != "seal"}
    return dict(with_checksum(numbers, left)) if "seal" in entry else left


def between(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[dict[str, Fraction]]:
    """Numbers of the one, of the other, and of each with one number of the other."""
    yield dict(a)
    if set(a) == set(b):
        yield dict(b)
    for k in a if set(a) == set(b) else ():
        if a[k] != b[k]:
            yield from (dict(a) | {k: b[k]}, dict(b) | {k: a[k]})


@pytest.mark.parametrize("name", SYSTEMS)
def test_nothing_is_both_proved_and_refuted(name: str) -> None:
    """Proofs of one file and runs of another, with numbers of both: never do both hold."""
    system = SYSTEMS[name]
    proved = [p for p in certificates(name) if "proofs" in p]
    refuted = [p for p in certificates(name) if "run" in p.get("counterexample", {})]
    for good, bad in itertools.product(proved, refuted):
        against = bad["counterexample"]
        assert holds(system, told(bad), "run", against)
        for numbers in between(told(good), told(bad)):
            try:
                criteria, inputs = system.asked(numbers), system.inputs(numbers)
            except (BadInput, ArithmeticError):
                continue
            for by, entry in good["proofs"].items():
                c = criteria.get(by)
                if c and against["clause"] in c.proves and inputs <= set(c.covers):
                    shown = holds(system, numbers, by, entry)
                    assert shown or numbers != told(good)
                    assert not (shown and holds(system, numbers, "run", against)), (by, numbers)


def holds(system: Any, numbers: Mapping[str, Fraction], by: str, entry: Mapping[str, Any]) -> bool:
    """Whether a proof holds, or a run refutes, with these numbers."""
    try:
        if by == "run":
            run = {**entry, "run": sealed(numbers, entry["run"])}
            return bool(proofs._check_counterexample(system, numbers, run))
        own = entry if "sides" in entry else {"evidence": sealed(numbers, entry["evidence"])}
        proofs._check_proof(by, system.asked(numbers)[by], numbers, own)
    except (BadInput, DoesNotHold, ArithmeticError):
        return False
    return True


if __name__ == "__main__":
    TABLE.write_text(json.dumps({n: outcomes(n) for n in SYSTEMS}, indent=1) + "\n", "utf-8")
