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
from slipctl.certify.cells import mode_cells
from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.models.cheng_2022.certificate import dither, dither_push, dither_search, dithering_kind
from slipctl.models.vehicle.certificate import own_gains

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


@pytest.mark.parametrize("noise", ["0.0002355", "0.00004", "0.0000001"])
def test_a_run_under_the_worst_noise_lies_between_both_bounds(noise):
    """The seeker's own equations, without dimensions: from its orbit to the last push."""
    n = {"k": F("0.941"), "w": F("1.385"), "w_l": F("0.1262"), "w_h": F("0.148"),
         "a": F("0.2151"), "curvature": F("-0.6474"), "T": F("0.1815"), "noise": F(noise),
         "start": F("0.04556")}  # fmt: skip
    loop = dithering_kind._plain(n)
    found = dither_search.find(dithering_kind._loop(n), 0.05)
    quiet = dither.check_proof(dithering_kind._loop({**n, "noise": F(0)}), found.proof)
    push = dither_push.find(loop, found)
    least, most = dither_push.at_least(loop, found, quiet, push), dither_push.at_most(loop, found)
    x = z = e = 0.0
    far = []
    for k in range(4000 + len(push.signs)):
        i = k - 4000
        up = push.signs[i] if i >= 0 else k % 2 == 0
        strength = loop.noise if i >= 0 else 0.0
        s = math.sin(push.angle + i * loop.W)
        H = (x + s) ** 2 / 2 - x * x / 2 - e + (strength if up else -strength)
        x, z, e = (x - loop.W * loop.q * z, z + loop.W * loop.l * (s * H - z),
                   e + loop.W * (loop.h * H + loop.q * x * z
                                 - loop.q**2 * loop.W * z * z / 2))  # fmt: skip
        far.append(abs(x))
    assert least <= far[-1] * (1 + 1e-6)
    assert max(far[3000:]) <= most
    assert most < 2 * max(far[3000:])
    if noise == "0.0000001":  # hardly any: both are what the orbit itself swings by
        assert most < 1.5 * max(far[3000:4000])
    if least > 0:
        assert least > 0.8 * far[-1]


@given(st.lists(st.integers(-40, 40), min_size=1, max_size=30))
def test_distinct_numbers_are_in_order_and_each_finds_its_own(values):
    given_ = np.array(values)
    found, of = mode_cells._distinct(given_)
    assert list(found) == sorted(set(values))
    assert list(found[of]) == values


def test_what_a_law_is_told_moves_the_slip_as_it_is_told():
    """D and F say the same: the force slows the rim less and the vehicle by F/m."""
    numbers = {"J": 110.0, "r": 0.42, "m": 9000.0}
    for D, wrong in ((1.5, 0.0), (1.5, 0.25), (-2.0, 0.5)):
        told = {n: float(v) for n, v in own_gains.telling(D=D, wrong=wrong, **numbers).items()}
        assert told["D_told"] == D + wrong
        F = told["F_told"]
        assert F * numbers["r"] ** 2 / numbers["J"] + F / numbers["m"] == pytest.approx(D + wrong)
        still = (D + wrong) * numbers["J"] / numbers["r"]  # the torque that holds the slip
        rises = own_gains.rising(T=still, D=D + wrong, J=numbers["J"], r=numbers["r"])["rises"]
        assert float(rises) == pytest.approx(0, abs=1e-12)
        more = own_gains.rising(T=still + 100, D=D + wrong, J=numbers["J"], r=numbers["r"])
        assert float(more["rises"]) == pytest.approx(100 * numbers["r"] / numbers["J"])
