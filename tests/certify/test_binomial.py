"""What draws prove of a share: the exact tail against floats, tables and brute force."""

from fractions import Fraction
from itertools import product
from math import comb

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from slipctl import BadInput
from slipctl.certify.arithmetic import binomial

MILLIONTH = Fraction(1, 10**6)


@pytest.mark.parametrize(
    ("share", "beta", "draws"),
    [(20, Fraction(1, 20), 59), (100, Fraction(1, 1000), 688), (100, MILLIONTH, 1375),
     (1000, MILLIONTH, 13809)],
)  # fmt: skip
def test_draws_that_a_share_needs(share: int, beta: Fraction, draws: int) -> None:
    """ln(1/beta)/-ln(1 - e), rounded up; one draw fewer does not do."""
    e = Fraction(1, share)
    assert binomial.draws_needed(e, beta) == draws
    assert binomial.holds(draws, 0, e, beta)
    assert not binomial.holds(draws - 1, 0, e, beta)


@given(st.integers(1, 300), st.data(), st.sampled_from([2, 20, 1000, 10**6]))
def test_the_bound_is_that_of_clopper_and_pearson(draws: int, data: st.DataObject, b: int) -> None:
    """Least share on the grid: that of the beta distribution, rounded up; the next below fails."""
    k, beta = data.draw(st.integers(0, draws)), Fraction(1, b)
    found = binomial.largest_share(draws, k, beta)
    if k == draws:
        assert found == 1
        return
    other = float(stats.beta.ppf(1 - 1 / b, k + 1, draws - k))
    assert other - 1e-9 <= float(found) <= other + 1 / binomial.GRAIN + 1e-9  # scipy: 1e-10 or so
    assert binomial.holds(draws, k, found, beta)
    assert not binomial.holds(draws, k, found - Fraction(1, binomial.GRAIN), beta)


@given(st.integers(1, 8), st.data(), st.fractions(0, 1, max_denominator=50))
def test_the_tail_by_counting(draws: int, data: st.DataObject, share: Fraction) -> None:
    """Sum over all outcomes of so few draws, each with its probability as a fraction."""
    k = data.draw(st.integers(0, draws))
    beta = data.draw(st.fractions(Fraction(1, 100), Fraction(99, 100)))
    tail = sum(
        (share ** sum(o) * (1 - share) ** (draws - sum(o))
         for o in product((0, 1), repeat=draws) if sum(o) <= k), Fraction(0),
    )  # fmt: skip
    assert binomial.holds(draws, k, share, beta) == (tail <= beta)
    assert comb(draws, 0) == 1


@pytest.mark.parametrize("case", [
    (0, 0, Fraction(1, 2), MILLIONTH), (5, 6, Fraction(1, 2), MILLIONTH),
    (5, -1, Fraction(1, 2), MILLIONTH), (10**6, 0, Fraction(1, 2), MILLIONTH),
    (5, 0, Fraction(3, 2), MILLIONTH), (5, 0, Fraction(1, 2), Fraction(0)),
])  # fmt: skip
def test_what_is_no_count(case: tuple[int, int, Fraction, Fraction]) -> None:
    with pytest.raises(BadInput):
        binomial.holds(*case)
