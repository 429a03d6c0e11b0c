"""What the proofs are made of, each against another way to compute it."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from slipctl.certify.smooth.sums_check import _positive
from slipctl.models.bounded_error.certificate import lagged_maps
from slipctl.models.bounded_error.certificate.lagged_maps import Lagged, lag_numbers
from slipctl.models.bounded_error.certificate.scalar_maps import AtanhPull, CubicPull, Interval
from slipctl.models.cheng_2022.certificate.dither_search import TIE, first_of_the_best
from slipctl.models.huang_2020.certificate import reaching_law_kind
from slipctl.models.huang_2020.certificate.relay_orbits import _period
from slipctl.models.huang_2020.certificate.relay_sets import Absorbing, Relay
from slipctl.models.super_twisting.certificate import quadratic
from slipctl.models.super_twisting.certificate.super_twisting import enclosure_of_log_ratio

NAMES = ("k1", "k2", "L")


def test_a_matrix_is_positive_as_its_eigenvalues_are() -> None:
    """Whole numbers, many of them 0; the nearly singular left out."""
    rng = np.random.default_rng(3)
    said = []
    for n in (1, 2, 3, 4):
        for _ in range(60):
            root = rng.integers(-3, 4, (n, n)) * rng.integers(0, 2, (n, n))
            M = root + root.T + np.diag(rng.integers(0, 9, n))
            least = np.linalg.eigvalsh(M)[0]
            rows = [[Fraction(int(x)) for x in row] for row in M]
            if abs(least) > 1e-6:
                assert _positive(rows) == (least > 0), M
                said.append(least > 0)
    assert 40 < sum(said) < len(said) - 40
    assert not _positive([[Fraction(2), Fraction(1)], [Fraction(0), Fraction(2)]])  # not symmetric


def test_the_inequalities_of_a_quadratic_function_hold_where_there_is_one() -> None:
    """In closed form or by the minors of the matrix found: the same answer for any gains."""
    rng = np.random.default_rng(4)
    said = []
    for _ in range(150):
        k1, k2, L = (Fraction(int(x), 8) for x in rng.integers(1, [60, 80, 60]))
        told = all(s.holds() for s in quadratic.quadratic_sides(k1, k2, L, NAMES))
        P = quadratic.matrix(k1, k2, L)
        assert told == (P is not None), (k1, k2, L)
        said.append((told, k1 * k1 >= 4 * k2))
        if P is not None:
            sides = quadratic.quadratic_sides(k1, k2, L, NAMES, tuple(P.values()))
            assert all(s.holds() for s in sides)
            a, b, c = (float(x) for x in P.values())
            assert np.linalg.eigvalsh([[a, b], [b, c]])[0] > 0
            A = np.array([[-float(k1) / 2, 0.5], [-float(k2), 0]])
            for w in (-float(L), float(L)):  # V falls at both ends of the disturbance
                moved = A + np.array([[0, 0], [w, 0]])
                M = np.array([[a, b], [b, c]]) @ moved
                assert np.linalg.eigvalsh(M + M.T)[-1] < 0
            a, b, c = P.values()
            wrong = quadratic.quadratic_sides(k1, k2, L, NAMES, (a, b, -c))
            assert not all(s.holds() for s in wrong)
    assert len(set(said)) == 4  # both answers, on both sides of k1^2 = 4 k2


def test_the_logarithm_of_a_swing_has_an_enclosure_of_either_sign() -> None:
    signs = set()
    for k1 in range(1, 7):
        for L in (1, 2, 4):
            gains = Fraction(k1), Fraction(5), Fraction(L)
            low, high = enclosure_of_log_ratio(*gains) or (0, 0)
            found = quadratic.sta.log_ratio(*map(float, gains))
            assert abs(float(low) - found) <= 1e-9 * (1 + abs(found))
            assert low <= high
            assert np.sign(float(low)) == np.sign(float(high)) == np.sign(found)
            signs.add(low > 0)
    assert len(signs) == 2


@pytest.mark.parametrize("period", [1, 2, 3, 7])
def test_a_run_that_repeats_has_its_period(period: int) -> None:
    s = np.resize(np.cos(np.arange(period)), 40)
    a = np.resize(np.sin(1.0 + np.arange(period)), 40)
    assert _period(s, a, 20) == period
    assert _period(s, a, period) in ((0,) if period > 1 else (0, 1))
    assert _period(s * 1.01 ** np.arange(40), a, 20) == 0
    assert _period(s, np.arange(40.0), 20) == 0


def test_a_set_that_absorbs_keeps_the_runs_that_begin_in_it() -> None:
    """Parallelograms |s + lag a| <= Z, |a| <= A: where one holds, no tick from it leaves it."""
    law = Relay(*(Fraction(x) for x in ("0.5", "3", "0.01", "0.05", "1")))
    rng = np.random.default_rng(5)
    s_row, a_row = ([float(x) for x in row] for row in law.rows(law.left[0]))
    said = []
    for wide in ("0.05", "0.1", "0.16", "0.2", "0.4", "1"):
        for high in ("1", "2.9", "3.1", "3.3", "6", "20"):
            Z, A, lag = Fraction(wide), Fraction(high), law.lag
            corners = tuple((z - lag * a, a) for z, a in ((Z, -A), (Z, A), (-Z, A), (-Z, -A)))
            z, a = rng.uniform(-1, 1, (2, 400)) * [[float(Z)], [float(A)]]
            z[:4], a[:4] = (
                [float(Z), float(Z), -float(Z), -float(Z)],
                float(A) * np.array([-1, 1] * 2),
            )
            s = z - float(lag) * a
            side, d = np.sign(s), rng.choice([-1.0, 1.0], 400)
            s, a = (m * s + n * a - b * side for m, n, b in (s_row, a_row))
            s += float(law.T * law.D) * d
            left = (abs(s + float(lag) * a) > float(Z)).any() or (abs(a) > float(A)).any()
            held = Absorbing(law, corners).holds()
            assert not (held and left), (wide, high)
            said.append((held, bool(left)))
    assert {(True, False), (False, True)} <= set(said)


@pytest.mark.parametrize("seed", range(5))
def test_the_corners_of_a_hull_are_those_of_scipy(seed: int) -> None:
    x = np.random.default_rng(seed).integers(-9, 10, (40, 2))
    points = {(Decimal(int(a)), Decimal(int(b))) for a, b in x}
    found = lagged_maps._outermost(points)
    hull = ConvexHull(x)
    assert sorted(found) == sorted((int(a) * 10**20, int(b) * 10**20) for a, b in x[hull.vertices])
    edges = np.diff(np.array([*found, found[0]], dtype=float), axis=0)
    after = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    assert (turns > 0).all()  # one after the other, counter-clockwise


def test_a_polygon_as_wide_as_the_funnel_is_never_kept() -> None:
    """What keeps with its own size is refused once it, or it and the noise, reach the width."""

    def law(number: type, noise: float = 0.0) -> Lagged:
        lag, T, push, heard, one = (number(str(x)) for x in (0.2, 0.05, 0.01, noise, 1.0))
        E, c1, c2, scale, left = lag_numbers(lag, T, 0)
        pull = CubicPull(T, one)
        return Lagged(pull, pull, push, heard, left, E, c1, c2, scale)

    found = lagged_maps.invariant_levels(law(float), Interval(-0.1, 0.1))
    assert found is not None
    levels = np.array(found[0], dtype=float)
    exact = lagged_maps.decimal_levels(levels)
    size = float(max(levels[0], levels[lagged_maps.SIDES // 2])) / 1e6

    assert lagged_maps.keeps(law(Decimal), exact, Decimal(0))
    assert not lagged_maps.keeps(law(Decimal, 1.0 - size / 2), exact, Decimal(0))
    assert not lagged_maps.keeps(
        law(Decimal), lagged_maps.decimal_levels(levels / size), Decimal(0))  # fmt: skip


def test_the_first_of_scores_that_differ_by_rounding_is_taken() -> None:
    for most in (0.0, 3.0, -3.0, 1e6, -1e6):
        near, far = (most - k * TIE * (1 + abs(most)) for k in (0.5, 2))
        assert first_of_the_best(np.array([far, near, most, near])) == 1
        assert first_of_the_best(np.array([-math.inf, far, most, near])) == 2


def test_without_a_gain_the_sampled_error_has_one_side() -> None:
    """M has the eigenvalue 1 then: det M < 1 says nothing of it."""
    n = {"g1": Fraction(0), "g2": Fraction(12), "T": Fraction(1, 1000), "lag": Fraction(42, 10**4)}
    texts = [[s.text for s in reaching_law_kind._sampled(n | {"g1": Fraction(g)})] for g in (0, 36)]
    assert texts == [["0 < 1 + trace M + det M"], ["det M < 1", "0 < 1 + trace M + det M"]]


@pytest.mark.parametrize("ends", [(-0.9, 0.8), (-0.9, -0.2), (-0.7, 0.1), (0.2, 0.9), (-0.1, 0.8)])
def test_bounds_of_a_pull_hold_it_between_its_ends_too(ends: tuple[float, float]) -> None:
    """It is largest inside, on either side: bounds by the ends alone would be too narrow."""
    law = SimpleNamespace(above=AtanhPull(Decimal("1.3")),
                          below=CubicPull(Decimal("2.7"), Decimal("1.1")))  # fmt: skip
    low, high = (Decimal(repr(x)) for x in ends)
    least, most = lagged_maps._pull_range(law, low, high)
    every = [low + (high - low) * k / 100 for k in range(101)]
    pulls = [law.above.at(y) if y >= 0 else -law.below.at(-y) for y in every]
    assert least <= min(pulls)
    assert max(pulls) <= most
    assert float(most - least) < 1.4 * float(max(pulls) - min(pulls))
