"""A paper's own proof stays where the generic ones lose; the table is in docs/architecture.md."""

from __future__ import annotations

from fractions import Fraction

import generic
import pytest

LOST = (
    ("barrier_lyapunov", dict(k=5111, k_a=0.03946, k_s=0.02688, T=0.008237, W=0.07687, start=0.75,
                              noise=0.001)),
    ("prescribed_performance", dict(K1=69.58, T=0.004271, eta_inf=0.002449, delta_l=1.498,
                                    delta_u=1.266, start=0.328, W=0.04502, noise=2.847e-05,
                                    lag=0.0004621, eta_0=0.007384, k=3.745)),
)  # fmt: skip
HELD = (
    ("barrier_lyapunov", dict(k=37500, k_a=0.02, k_s=0.02, T=0.001, lag=0.01, W=0.01, start=0.5)),
    ("prescribed_performance", dict(K1=30, T=0.001, lag=0.01, eta_inf=0.01, delta_l=1, delta_u=1,
                                    W=0.01, start=0.5)),
)  # fmt: skip


def asked(name, numbers):
    """What sums and cells prove at 0.93 of the largest disturbance of the own proof."""
    row = generic.of_bounds(name, "", {k: Fraction(str(v)) for k, v in numbers.items()})
    assert row is not None
    return row["sums"] or row["cells"]


@pytest.mark.long
@pytest.mark.parametrize(("name", "numbers"), LOST)
def test_what_no_generic_proof_holds_keeps_its_own(name, numbers):
    assert not asked(name, numbers)  # else the system has to go


@pytest.mark.second
@pytest.mark.parametrize(("name", "numbers"), HELD)
@pytest.mark.others("long")
def test_cells_hold_an_error_behind_a_lag(name, numbers):
    assert asked(name, numbers)


def test_a_linear_loop_decays_by_a_matrix_too():
    row = generic.of_linear({"K": Fraction(20), "T": Fraction(1, 100), "lag": Fraction(1, 20)})
    assert row is not None
    assert row["sums"]
