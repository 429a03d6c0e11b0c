"""What a text of equations is told to have wrong: the whole line, cut where it is long."""

from __future__ import annotations

import pytest

from slipctl import from_text
from slipctl.block.text import expression
from slipctl.errors import Faults

SAID = [
    ("y = c where c = three", ["c: 'three' is no number with a unit; an expression needs a unit:"
                               " c [unit] = three"]),
    ("y = v*k where v [m/s], k = -q*2", ["k: '-q*2' is no number with a unit; an expression needs a"
                                         " unit: k [unit] = -q*2"]),
    ("y = v*k where v [m/s], k = (3)", ["k: '(3)' is no number with a unit, such as '8.2 kg'"]),
    ("y = v*k where v [m/s], k = .5 q", ["k: unit 'q' cannot be read: 'q' is no known unit"]),
    ("y = v*k where v [m/s], k [m] = q q",
     ["k: 'q q': column 3: write * for a product, at 'q'"]),
    ("y = v*k where v [m/s], k [m] = 3 apples",
     ["k: '3 apples': column 3: write * for a product, at 'apples'"]),
    ("y = v*t where v [km/h], t [s]", ["y: its unit is [0.277778 m]; say it in SI, y [unit]"]),
    ("y = 2; " + 50 * "b" + " + 3", [f"equations: column 7: '{40 * 'b'}' is no equation; write name"
                                     " = expression, x' = ... or x+ = ..."]),
    ("; ".join(f"a{k} = a{(k + 1) % 7}" for k in range(7)),
     ["a0, a1, a2, a3, a4 need one another; a loop of equations needs a state"]),
    ("z = a - b; w = 2; y = exp(v) where a [m], b [s], v [m]",
     ["z: column 5: 'b' [s] cannot be subtracted from 'a' [m]",
      "y: column 23: exp takes a pure number, 'v' [m]"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "lines"), SAID)
def test_a_fault_is_told_in_these_words(text, lines):
    with pytest.raises(Faults) as told:
        from_text(text)
    assert list(told.value.lines) == lines


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a + ) + bcdefghijklmnop", "column 5: unmatched ')', at ') + bcdefghi'"),
        ("  2 xyz + y", "column 5: write * for a product, at 'xyz + y'"),
        ("a (b + c) d", "column 11: write * for a product, at 'd'"),
        ("  ", "there is no expression"),
        ("3 +* b", "column 4: invalid syntax, at '* b'"),
        ("1e999", "column 1: it cannot be computed, it is no finite number"),
    ],
)  # fmt: skip
def test_an_expression_that_is_none_is_told_with_the_letters_there(text, said):
    with pytest.raises(Faults) as told:
        expression.read(text)
    assert list(told.value.lines) == [said]


def test_a_condition_behind_one_that_is_wrong_is_told_too():
    with pytest.raises(Faults) as told:
        from_text("y = c*d where c = 1, d = 2", conditions={
            "dry": {"q": 1.0, "c": "1 kg", "d": 3.0, "p": 2.0}, "wet": {"d": "2 m"}})  # fmt: skip
    places = [line.partition(": ")[0] for line in told.value.lines]
    assert places == ["conditions.dry.q", "conditions.dry.c", "conditions.dry.p",
                      "conditions.wet.d"]  # fmt: skip
