"""Pieces of proofs whose fault would be unsound: what leaves a range, and a function that falls."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.certify import smtlib
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.whole_boxes import WholeBoxes
from slipctl.certify.bounds import linear_kind
from slipctl.certify.cells.mode_cells import ModeLoop

F = Fraction


@pytest.mark.parametrize("kind", [Boxes, WholeBoxes])
@pytest.mark.parametrize("order", [("any", "b", "c"), ("c", "any", "b"), ("b", "c", "any")])
def test_a_further_output_that_leaves_its_range_is_found_whatever_stands_before(kind, order):
    """One without a range never does; ends belong to the range."""
    ranges = {"any": None, "b": (F(0), F(1)), "c": (F(-2), F(2))}
    loop = SimpleNamespace(kept={n: ranges[n] for n in order})

    def left(**ends):
        boxes = {n: (-9.0, 9.0) if n == "any" else ends.get(n, (0.0, 1.0)) for n in order}
        kept = {n: [kind.of_ends(np.array([0.5, a]), np.array([0.5, b]))]
                for n, (a, b) in boxes.items()}  # fmt: skip
        return ModeLoop.left(loop, SimpleNamespace(kept=kept))

    assert left() == ""
    assert left(c=(-2.0, 2.0)) == ""
    assert left(b=(0.0, 1.25)) == "b"
    assert left(b=(-0.25, 1.0)) == "b"
    assert left(c=(-2.0, 2.5)) == "c"
    assert left(c=(-3.0, 3.0)) == "c"


@given(st.floats(0.05, 0.9), st.floats(0.2, 4))
def test_the_quadratic_function_behind_a_lag_falls(share, lags):
    """At both ends of what exp(-T/lag) may be: A'PA - P is negative, with P as it is written."""
    T, lag = F("0.01"), F(f"{0.01 * lags:.4f}")
    K = F(f"{share * 2 / (0.01 + 2 * float(lag)):.3f}")
    told = []

    def noted(A, P, strict, ends):
        told.append((A, P, ends))
        return ""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smtlib, "shrinks", noted)
        patch.setattr(smtlib, "times", lambda a, b: (b if isinstance(b, tuple) else ("E",), a))
        patch.setattr(smtlib, "sum_term", lambda a, b: ("sum", a, b))
        linear_kind._lag_step({"K": K, "T": T, "lag": lag}, {})
    (_, P, (low, high)) = told[0]
    assert low <= F(math.exp(-T / lag)) <= high
    assert 0 < high - low < F(1, 10**14)
    P = np.array([[P[0], P[1]], [P[1], P[2]]], float)
    E = math.exp(-T / lag)
    k, t, g = float(K), float(T), float(lag)
    A = np.array([[1 - k * (t - g * (1 - E)), g / t * (1 - E)], [-k * t * (1 - E), E]])
    assert (np.linalg.eigvalsh(P) > 0).all()
    assert (np.linalg.eigvalsh(A.T @ P @ A - P) < 0).all()
    assert (np.linalg.eigvalsh(A.T @ P @ A - P) < -0.99).all()  # minus one by construction
