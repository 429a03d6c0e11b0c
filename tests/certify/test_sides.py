"""Inequalities of every criterion at drawn numbers, and what a system tells of numbers: a table.

``python tests/certify/test_sides.py`` writes it anew; what changed then belongs into CHANGELOG. The
examples of each system are drawn apart, number by number, so that each inequality is met on both
of its sides. That they are right the cases of the papers and the adversary hold.
"""

from __future__ import annotations

import json
import random
import sys
import zlib
from collections.abc import Iterator, Mapping
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1])]

import pytest
from recorded_calls import off, told

from slipctl import BadInput
from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.catalogue import SYSTEMS
from slipctl.certify.promise import Side, exact_numbers
from slipctl.certify.systems import _shown

TABLE = Path(__file__).parent / "sides.json"
DRAWS, NEAR = 16, 1e-9
"""Numbers that are drawn of each system; and how close sums of floats come with other versions."""


def drawn(name: str) -> Iterator[dict[str, Fraction]]:
    """Cases of ``recorded.json`` with each number a little off, far off, left out, or as it is."""
    system, rng = SYSTEMS[name], random.Random(zlib.crc32(name.encode()))
    recorded = Path(__file__).parent / "recorded.json"
    cases = json.loads(recorded.read_text(encoding="utf-8"))[name]["cases"]
    for k in range(DRAWS):
        start = rng.choice(cases)["of"]
        given = {}
        for n, v in start.items():
            factor = rng.choice((1, 1, Fraction(11, 10), Fraction(9, 10), 3, Fraction(1, 4)))
            if not (system.numbers[n].optional and rng.random() < 0.2):
                given[n] = Fraction(str(v)) * (factor if k else 1)
        for n, number in system.numbers.items():
            if number.optional and n not in start and rng.random() < 0.3:
                given[n] = Fraction(rng.choice((1, 2, 5)), rng.choice((1, 10, 100)))
        try:
            numbers = exact_numbers(system, given)
            system.guard(numbers)
        except BadInput:
            continue
        yield numbers


def text(value: Any) -> Any:
    """Sides, intervals and numbers as lists, words and floats."""
    if isinstance(value, Interval):
        return [float(end) for end in value.ends()]
    if isinstance(value, Side):
        return [value.text, text(value.left), text(value.right), str(value.holds())]
    if isinstance(value, Mapping):
        return {k: text(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set):
        return [text(v) for v in (sorted(value) if isinstance(value, set) else value)]
    return float(value) if isinstance(value, int | float | Fraction) else str(value)


def of(name: str, numbers: dict[str, Fraction]) -> list[Any]:
    """What the system tells of numbers."""
    system = SYSTEMS[name]
    sides = {}
    for k, c in system.asked(numbers).items():
        if c.sides is not None:
            found = (c.find(numbers) or {}) if c.multipliers else {}
            if set(c.multipliers) <= set(found):
                sides[k] = list(c.sides({**numbers, **found}))
    floats = {k: float(v) for k, v in numbers.items()}
    ends = {k: dict(system.ends(k, floats)) for k in system.asked(floats)} if system.ends else {}
    clauses = sorted(system.clauses(numbers))
    values = dict(_shown(lambda: system.values(floats), {}))
    return told(text([sides, values, ends, clauses, system.inputs(numbers), system.time(numbers)]))


@pytest.mark.table
@pytest.mark.parametrize("name", SYSTEMS)
def test_inequalities_are_those_of_the_table(name: str) -> None:
    wanted = json.loads(TABLE.read_text(encoding="utf-8"))[name]
    found = [of(name, numbers) for numbers in drawn(name)]
    assert len(found) == len(wanted) > 3
    for a, b in zip(found, wanted, strict=True):
        assert off(a, b) < NEAR


@pytest.mark.parametrize(
    ("left", "right", "wanted"),
    [((1, 2), (3, 4), True), ((3, 4), (1, 2), False), ((1, 3), (2, 4), None),
     ((1, 2), (2, 3), None), (1, (2, 3), True),
     ((1, 2), 0, False), ((1, 2), 2, None), (2, (1, 2), None)],
)  # fmt: skip
def test_enclosures_tell_where_they_lie_apart(left: Any, right: Any, wanted: bool | None) -> None:
    ends = [Interval(*map(Decimal, x), 20) if isinstance(x, tuple) else x for x in (left, right)]
    for words in ("a < b", "a <= b"):
        assert Side(words, *ends).holds() is wanted


def test_numbers_may_be_equal_where_the_words_say_so() -> None:
    for a, b, below, at_most in ((1, 2, True, True), (2, 2, False, True), (3, 2, False, False)):
        assert Side("a < b", a, b).holds() is below
        assert Side("a <= b", a, b).holds() is at_most


if __name__ == "__main__":
    found = {name: [of(name, numbers) for numbers in drawn(name)] for name in SYSTEMS}
    TABLE.write_text(json.dumps(found, indent=0) + "\n", encoding="utf-8")
