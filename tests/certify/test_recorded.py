"""Certificates, margins and witnesses change on purpose only: they are those of a table.

``python tests/certify/test_recorded.py`` writes the table anew; what changed then belongs into
CHANGELOG. It says that nothing changed, not that it is right: the adversary, closed forms and the
checker hold what is promised. Cases are drawn by the adversary near the edge of each promise.
"""

from __future__ import annotations

import json
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from adversary.common import adversaries, cases, singles

from slipctl import BadInput
from slipctl.certify import proofs, smtlib
from slipctl.certify.catalogue import SYSTEMS
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.systems import report

TABLE = Path(__file__).parent / "recorded.json"
ALIKE, DRAWN = 3, 40
"""So many cases of each kind of answer, out of so many that are drawn."""
SLOW = ("perturbation_seek", "barrier_lyapunov")
MOST = 40
"""Numbers of an answer that are kept one by one; the others are summed."""
NEAR = 1e-6
"""Searches of other versions of NumPy end this close, as a share."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?:/\d+)?")


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers and words of an answer, in its order; numbers within words are numbers."""
    if isinstance(value, Mapping):
        for k, v in value.items():
            if k == "seal":  # a hash of the last digits
                continue
            yield path, str(k)
            yield from leaves(v, f"{path}.{k}")
    elif isinstance(value, list | tuple):
        for i, v in enumerate(value):
            yield from leaves(v, f"{path}[{i}]")
    elif isinstance(value, str):
        yield path, NUMBER.sub("#", value)
        yield from ((path, number(found)) for found in NUMBER.findall(value))
    elif isinstance(value, bool) or value is None:
        yield path, str(value)
    else:
        yield path, float(value) if math.isfinite(value) else str(value)


def number(text: str) -> float:
    """Value of a decimal or of a ratio."""
    top, _, bottom = text.partition("/")
    if not bottom:
        return max(min(float(text), 1e300), -1e300)
    try:
        return int(top) / int(bottom)
    except (ArithmeticError, ValueError):
        return 0.0


def told(answer: Any) -> dict[str, Any]:
    """What is kept of an answer."""
    parts = list(leaves(answer))
    words: dict[str, str] = {}
    for path, v in parts:
        if isinstance(v, str):
            words[entry(path)] = words.get(entry(path), "") + v + "\n"
    numbers = [v for _, v in parts if isinstance(v, float)]
    rest = numbers[MOST:]
    sums = [sum(rest), sum((1 + i % 7) * v for i, v in enumerate(rest)), sum(map(abs, rest))]
    hashes = {k: zlib.crc32(v.encode()) for k, v in words.items()}
    return {"words": hashes, "numbers": [*numbers[:MOST], *sums], "count": len(numbers)}


def entry(path: str) -> str:
    """Where in an answer, two names deep: what is said of words that differ."""
    return ".".join(path.split("[")[0].split(".")[1:3])


def answer(name: str, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Report, certificate and steps for a solver of a system."""
    system = SYSTEMS[name]
    payload = proofs.write(system, {k: Fraction(str(v)) for k, v in numbers.items()})
    payload.pop("slipctl", None)
    return {"report": report(system, numbers).payload(), "certificate": payload,
            "steps": list(smtlib.steps(system, payload).values())}  # fmt: skip


def declared(name: str) -> list[Any]:
    """Numbers of a system as they are declared, and where its search for counterexamples starts."""
    system = SYSTEMS[name]
    return [
        {k: {f.name: getattr(n, f.name) for f in fields(n)} for k, n in system.numbers.items()},
        {k: [c.title, c.kind, c.margins, c.needs, c.multipliers, c.proves, c.covers, c.refutes,
             c.refuted_under] for k, c in system.criteria.items()},
        {k: [r.target, r.quick is None] for k, r in system.refuters.items()}, system.never,
        system.panel,
    ]  # fmt: skip


def drawn(name: str) -> Iterator[dict[str, float]]:
    """A few cases of each kind of answer, and the system's own examples."""
    yield from map(dict, SYSTEMS[name].panel)
    kinds: Counter[Any] = Counter()
    for numbers in singles(cases(adversaries()[name], DRAWN, 11)):
        found = report(SYSTEMS[name], numbers).decision
        kind = (found.verdict, *found.proofs, (found.counterexample or {}).get("by"))
        kinds[kind] += 1
        if kinds[kind] <= (1 if name in SLOW else ALIKE):
            yield numbers


@pytest.mark.table
@pytest.mark.parametrize("name", SYSTEMS)
def test_numbers_and_criteria_are_declared_as_in_the_table(name: str) -> None:
    assert told(declared(name)) == json.loads(TABLE.read_text(encoding="utf-8"))[name]["declared"]


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_proof_with_an_entry_more_or_less_is_refused(name: str) -> None:
    """What a file holds is what its check reads: nothing that is not looked at passes."""
    system = SYSTEMS[name]
    for case in json.loads(TABLE.read_text(encoding="utf-8"))[name]["cases"]:
        payload = proofs.write(system, {k: Fraction(str(v)) for k, v in case["of"].items()})
        for of, proof in payload.get("proofs", {}).items():
            if "evidence" not in proof:
                continue
            evidence = proof["evidence"]
            fewer = [{k: v for k, v in evidence.items() if k != n} for n in evidence]
            for other in (evidence | {"more": 1}, *fewer):
                wrong = {**payload["proofs"], of: {**proof, "evidence": other}}
                with pytest.raises((BadInput, DoesNotHold)):
                    proofs.check(system, payload | {"proofs": wrong})
            return


@pytest.mark.table
@pytest.mark.parametrize("name", SYSTEMS)
def test_answers_are_those_of_the_table(name: str) -> None:
    kept = json.loads(TABLE.read_text(encoding="utf-8"))[name]
    assert len(kept["cases"]) > 3
    for wanted in kept["cases"]:
        parts = answer(name, wanted["of"])
        found = told(parts)
        where = f"{name} at {wanted['of']}"
        paths = [p for p, v in leaves(parts) if isinstance(v, float)]
        for at in found["words"] | wanted["words"]:
            words = [v for p, v in leaves(parts) if isinstance(v, str) and entry(p) == at]
            same = found["words"].get(at) == wanted["words"].get(at)
            assert same, f"{where}: {at} has other words: {words}"
        assert found["count"] == wanted["count"], where
        size = max(map(abs, wanted["numbers"][-3:]))
        for i, (a, b) in enumerate(zip(found["numbers"], wanted["numbers"], strict=True)):
            path = paths[i] if i < MOST else "the rest"
            near = NEAR * (abs(b) if i < MOST else size) + 1e-12
            assert a == pytest.approx(b, abs=near, rel=0), f"{where}: {path}"


if __name__ == "__main__":
    table = {
        name: {
            "declared": told(declared(name)),
            "cases": [{"of": n, **told(answer(name, n))} for n in drawn(name)],
        }
        for name in SYSTEMS
    }
    TABLE.write_text(json.dumps(table, indent=0) + "\n", encoding="utf-8")
