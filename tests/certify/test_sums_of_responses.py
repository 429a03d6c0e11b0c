"""What a vector that enters once does to a linear loop over all ticks: against matrix powers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from slipctl.certify.entries import DoesNotHold
from slipctl.certify.smooth.sums_check import (
    GRID,
    Decay,
    Response,
    check_decay,
    peaks,
    response,
    root_above,
    whole_entries,
)

F = Fraction

LOOPS = {
    "a line of copies": [[0.5, 0.25, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [-0.5, 0, 0, 0]],
    "copies of others": [[0, 0, 0, 1], [1, 0, 0, 0], [0.25, 0.5, -0.5, 0], [0, 0, 0.75, 0]],
    "all of all": [[0.5, -0.25, 0.125, 0.25], [0.25, 0.5, 0, -0.5], [0, 0.25, -0.5, 0.125],
                   [0.125, 0, 0.25, 0.25]],
}  # fmt: skip


def whole(A) -> dict[tuple[int, int], int]:
    return {(i, j): int(F(a) * 2**GRID) for i, row in enumerate(A) for j, a in enumerate(row) if a}


def lyapunov(A, share: float) -> Decay:
    """P of the sum of all powers, with a share of room."""
    A = np.array(A)
    rho = max(abs(np.linalg.eigvals(A))) ** 2
    rho = rho + share * (1 - rho)
    P, power = np.eye(len(A)), A / np.sqrt(rho)
    for _ in range(60):
        P, power = P + power.T @ P @ power, power @ power
    P = (P + P.T) / 2 * 1.001
    return Decay([[round(x * 2**20) for x in row] for row in P.tolist()], F(float(rho)))


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("ticks", [7, 60])
def test_a_response_is_that_of_powers_and_what_is_left_is_bounded(name, ticks) -> None:
    """Sums and largest values of |A^t b|, and of the sums of A^t b; never less than over all."""
    A, b = np.array(LOOPS[name], float), np.array([0.25, -0.5, 0.0, 1.0])
    decay = lyapunov(A, 0.5)
    check_decay(whole(A), decay)
    found = response(whole(A), {i: int(F(x) * 2**GRID) for i, x in enumerate(b) if x}, ticks, decay)
    path = np.array([np.linalg.matrix_power(A, t) @ b for t in range(400)])
    near, all_of = path[:ticks], path
    rest = np.linalg.matrix_power(A, ticks) @ b
    P = np.array([[float(x) for x in row] for row in decay.P]) / 2**20
    later = float(np.sqrt(rest @ P @ rest)) / (1 - float(np.sqrt(float(decay.decay))))
    for own, sums in ((found.sums, lambda p: abs(p).sum(axis=0)),
                      (found.most, lambda p: abs(p).max(axis=0)),
                      (found.steps, lambda p: abs(p.cumsum(axis=0)).max(axis=0))):  # fmt: skip
        values = np.array([float(x) for x in own])
        assert (values >= sums(all_of) - 1e-12).all()
        assert values == pytest.approx(sums(near) + later, rel=1e-9, abs=1e-12)


def test_a_function_that_does_not_decay_or_is_too_small_is_refused() -> None:
    A = LOOPS["all of all"]
    decay = lyapunov(A, 0.5)
    check_decay(whole(A), decay)
    half = Decay([[x // 3 for x in row] for row in decay.P], decay.decay)
    with pytest.raises(DoesNotHold, match="P is not above 1"):
        check_decay(whole(A), half)
    with pytest.raises(DoesNotHold, match="P does not decay"):
        check_decay(whole(A), Decay(decay.P, decay.decay / 3))
    with pytest.raises(DoesNotHold, match="P does not decay"):
        check_decay(whole(2 * np.array(A)), decay)
    turned = [list(row) for row in decay.P]
    turned[1][2] += 1  # not symmetric
    with pytest.raises(DoesNotHold, match="P is not above 1"):
        check_decay(whole(A), Decay(turned, decay.decay))


def test_sizes_are_never_too_small() -> None:
    """Of P = [[2, 1], [1, 3]]: x' P x and its unit vectors; a geometric sum."""
    decay = Decay([[2 * 2**20, 2**20], [2**20, 3 * 2**20]], F(1, 4))
    for value, exact in ((decay.size([F(1), F(2)]) ** 2, 18), (decay.one(0) ** 2, 2),
                         (decay.one(1) ** 2, 3), (root_above(F(9, 4)), F(3, 2)),
                         (decay.sum, 2)):  # fmt: skip
        assert exact <= value < exact + F(1, 10**15)
    for share in (F(1), F(5, 4)):
        with pytest.raises(DoesNotHold, match="it is not below 1"):
            _ = Decay(decay.P, share).sum


def test_peaks_add_up_what_each_source_brings() -> None:
    """2 states: pushes by their sums, middles by their steps, starts by their largest value."""
    P = [[4 * 2**20, 0], [0, 9 * 2**20]]
    one = Response([F(1), F(2)], [F(3), F(4)], [F(5), F(6)])
    two = Response([F(7), F(8)], [F(9), F(10)], [F(11), F(12)])
    decay = Decay(P, F(1, 4))
    found = peaks([(one, F(1, 2)), (two, F(3))], one, [(two, F(1, 4))], [F(0), F(0)], decay)
    assert found == [F(1, 2) + 21 + 5 + F(9, 4), 1 + 24 + 6 + F(10, 4)]
    assert peaks([(one, F(1))], None, [], [F(0), F(0)], decay) == [1, 2]
    small = peaks([], None, [], [F(1), F(1, 3)], decay)
    assert small[0] == small[1] == pytest.approx(2 * (2 + 1))


def test_entries_of_a_matrix_are_whole_numbers_in_their_places() -> None:
    given = [[0, 2, "5"], [1, 0, "-7"]]
    assert whole_entries(given, 2, 3) == {(0, 2): 5, (1, 0): -7}
    for wrong, said in (
        ([[0, 3, "5"]], "out of place"), ([[2, 0, "5"]], "out of place"),
        ([[-1, 0, "5"]], "out of place"), ([[0, -1, "5"]], "out of place"),
        ([[0, 0, 5]], "out of place"), ([[0, 0.0, "5"]], "out of place"),
        ([[0, 0, "1" * 60]], "out of place"), ([*given, [1, 0, "2"]], "out of place"),
        ([[0, 0, "x"]], "is no whole number"), ([[0, 0]], "has entries"), ("x", "has entries"),
        ([given[0], "x"], "has entries"),
    ):  # fmt: skip
        with pytest.raises(DoesNotHold, match=said):
            whole_entries(wrong, 2, 3)
