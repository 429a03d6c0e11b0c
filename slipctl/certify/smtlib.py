"""Steps of proofs as SMT-LIB 2, so that a solver of another house can be asked.

What is written is the negation of a step: ``unsat`` means that nothing breaks it. Terms are texts
over reals; numbers are exact rationals.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify.promise import System


def number(x: Fraction | int) -> str:
    """Rational as a term."""
    x = Fraction(x)
    size = f"(/ {abs(x.numerator)}.0 {x.denominator}.0)"
    size = f"{abs(x.numerator)}.0" if x.denominator == 1 else size
    return f"(- {size})" if x < 0 else size


def term(operator: str, *parts: Any) -> str:
    """Operator of terms; rationals among them are written as numbers."""
    texts = [p if isinstance(p, str) else number(p) for p in parts]
    return f"({operator} {' '.join(texts)})"


def sum_term(*parts: Any) -> str:
    """Sum."""
    return term("+", *parts) if len(parts) > 1 else str(parts[0])


def times(*parts: Any) -> str:
    """Product."""
    return term("*", *parts)


def interval_terms(low: Fraction, x: str, high: Fraction) -> list[str]:
    """Both ends of an interval as terms."""
    return [term("<=", low, x), term("<=", x, high)]


def problem(
    variables: Iterable[str],
    facts: Sequence[str],
    negated: str | Sequence[str],
    logic: str = "QF_NRA",
) -> str:
    """Problem that is ``unsat`` where the facts imply what is negated.

    Args:
        variables: names of reals. facts: what holds. negated: the step that is claimed; of several
            each is asked by itself. logic: QF_LRA where all of it is linear.
    """
    rows = [f"(set-logic {logic})", *(f"(declare-const {v} Real)" for v in variables)]
    rows += [f"(assert {f})" for f in facts]
    asked = [f"(assert (not {claim}))\n(check-sat)"
             for claim in ([negated] if isinstance(negated, str) else negated)]  # fmt: skip
    if len(asked) > 1:
        asked = [f"(push)\n{text}\n(pop)" for text in asked]
    return "\n".join([*rows, *asked]) + "\n"


RAYS = "(or (= x 1.0) (and (= x 0.0) (= y 1.0)))"
"""One point of each line through the origin: enough for quadratic forms."""


def shrinks(
    A: Sequence[Sequence[Any]], P: Sequence[Any], sampled: bool, E: tuple[Fraction, Fraction] | None
) -> str:
    """Step of a linear proof: V = x'P x > 0, and x+ = A x or x' = A x makes it fall, on each ray.

    Args:
        A: rows of two terms or rationals. P: P11, P12, P22. sampled: whether it is x+.
        E: interval of the number E, where the terms of A have it.
    """
    x = ("x", "y")

    def row(coefficients: Sequence[Any], of: Sequence[Any]) -> str:
        return sum_term(*(times(c, v) for c, v in zip(coefficients, of, strict=True)))

    def form(one: Sequence[Any], two: Sequence[Any]) -> str:
        return sum_term(times(one[0], row(P[:2], two)), times(one[1], row(P[1:], two)))

    moved = [row(r, x) for r in A]
    fall = sum_term(form(moved, moved), times(-1, form(x, x))) if sampled else form(moved, x)
    facts = [RAYS]
    if E:
        facts += [term("<=", E[0], "E"), term("<=", "E", E[1])]
    claim = term("and", term(">", form(x, x), 0), term("<", fall, 0))
    return problem((*x, *(("E",) if E else ())), facts, claim)


def steps(system: System, payload: Mapping[str, Any]) -> dict[str, str]:
    """Problems of a certificate by the name of the criterion, of those that are polynomial.

    Where a step is made of several, each is one problem, numbered.
    """
    numbers = {k: Fraction(v["value"]) for k, v in payload["asked"].items()}
    found = {}
    for name, entry in payload.get("proofs", {}).items():
        step = system.criteria[name].step if name in system.criteria else None  # else: of a tick
        texts = step(numbers, entry) if step else None
        if isinstance(texts, str):
            found[name] = texts
        for number, text in enumerate([] if isinstance(texts, str) else texts or [], 1):
            found[f"{name} {number}"] = text
    return found


def script(problems: Mapping[str, str]) -> str:
    """One script of all problems, each from an empty state; every answer must be ``unsat``."""
    return "\n".join(
        f"; {name}: the negation of its step, to be answered unsat\n(reset)\n{text}"
        for name, text in problems.items()
    )
