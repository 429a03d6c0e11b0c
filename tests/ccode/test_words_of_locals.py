"""Names of locals say what they hold: words of an expression in an order that one would say."""

from __future__ import annotations

import pytest

from slipctl.ccode.passes.local_names import _said
from slipctl.ccode.tree.parser import expression


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a - b", "a_minus_b"), ("a + b", "a_plus_b"), ("2.0*a", "a_times_2"),
        ("a*2.0", "a_times_2"), ("ctl_a*b", "a_times_b"), ("a/3.0", "a_over_3"),
        ("a[2] - b", "a_2_minus_b"), ("a", ""), ("w12 + a", ""), ("1.23456*a", ""),
        ("a + b*c", "a_plus_b_times_c"), ("f(a, b)", ""), ("3.0 - a", ""),
    ],
)  # fmt: skip
def test_words_of_an_expression(text: str, said: str) -> None:
    assert _said(expression(text), "ctl", ()) == said


def test_what_is_derived_has_no_word() -> None:
    assert _said(expression("a + b"), "ctl", {"a"}) == ""


@pytest.mark.parametrize(
    ("text", "turned", "plain"),
    [("1.0 < a", "a_above_1", ""), ("2.0 <= ctl_b", "b_from_2", ""),
     ("a < 1.0", *["a_below_1"] * 2),
     ("a <= b", *["a_up_to_b"] * 2), ("2.0*a", *["a_times_2"] * 2), ("1.0 > a", "", "")],
)  # fmt: skip
def test_a_condition_is_said_by_what_is_no_number(text: str, turned: str, plain: str) -> None:
    assert _said(expression(text), "ctl", (), turned=True) == turned
    assert _said(expression(text), "ctl", ()) == plain
