"""Pieces of what bounds a seeker with a dither: against plain sums and differences."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.smooth.sampled_loop import ends_of
from slipctl.models.cheng_2022.certificate import (
    dither,
    dither_flight,
    dither_push,
    dither_search,
    dithering_kind,
)
from slipctl.models.cheng_2022.certificate.dither import Loop
from slipctl.models.cheng_2022.certificate.dither_push import Push

F = Fraction

ORBIT = np.array([[0.3, 0.21, -0.14, 0.05, 0.08], [-0.2, 0.11, 0.17, -0.03, 0.06],
                  [0.1, -0.05, 0.02, 0.07, -0.01]])  # fmt: skip
"""x, z and e: a mean, and the cosines and sines or sines and cosines of two waves."""


def at(row: int, angle):
    return ORBIT[row] @ dither.basis_at(np.atleast_1d(angle), 2)


@pytest.mark.parametrize(("late", "lag"), [(0, 4.0), (3, 4.0), (2, 0.7)])
def test_what_is_heard_of_an_orbit_is_what_a_lag_makes_of_its_square(late, lag) -> None:
    """The mean of all that came before, each tick forgotten a little more."""
    loop, E = Loop(0.3, 0.5, 0.7, 0.2, 0.0, late, lag), math.exp(-1 / lag)
    for angle in (0.4, 2.9, 5.1):
        before = angle - loop.W * (late + np.arange(400))
        values = (at(0, before) + np.sin(before)) ** 2 / 2
        wanted = float(((1 - E) * E ** np.arange(400)) @ values)
        assert dither_push._heard(loop, ORBIT, angle) == pytest.approx(wanted, rel=1e-9)


def test_the_slope_of_a_sum_is_its_change() -> None:
    angles = np.linspace(0, 6, 9)
    for sums in ORBIT:
        found = dither_push._slope(sums) @ dither.basis_at(angles, 2)
        near = [sums @ dither.basis_at(angles + s * 1e-5, 2) for s in (1, -1)]
        assert found == pytest.approx((near[0] - near[1]) / 2e-5, abs=1e-8)


def test_what_a_noise_does_to_the_end_is_found_backwards() -> None:
    """c . J, tick by tick: J of differences of the seeker's own map on the orbit, over 70 ticks."""
    loop = Loop(0.3, 0.5, 0.7, 0.2, 0.0)
    q, l, h, W = loop[:4]

    def tick(state, angle):
        x, z, e = state
        s = math.sin(angle)
        H = x * s + s * s / 2 - e
        return np.array([x - W * q * z, z + W * l * (s * H - z),
                         e + W * (h * H + q * x * z - q * q * W * z * z / 2)])  # fmt: skip

    ends = np.array([0.3, 2.2, 4.0])
    found = list(dither_push._backwards(loop, ORBIT, dither.basis_at(ends, 2), 70))
    assert len(found) == 70
    for n, end in enumerate(ends):
        c = np.array([1.0, 0.0, 0.0])
        for k, (push, rows) in enumerate(found, 1):
            angle = end - k * W
            place = np.array([float(at(i, angle)[0]) for i in range(3)])
            assert push[n] == pytest.approx(c @ [0.0, l * math.sin(angle), h], abs=1e-9)
            J = np.array([(tick(place + d, angle) - tick(place - d, angle)) / 2e-4
                          for d in 1e-4 * np.eye(3)]).T  # fmt: skip
            c = c @ J
            assert rows[:, n] == pytest.approx(c, abs=1e-9)


def test_a_proof_that_need_not_fall_says_nothing_of_a_push() -> None:
    """Below zero: nothing is exceeded. Or no bound."""
    loop, push = Loop(0.3, 0.5, 0.7, 0.2, 0.01), Push(0.3, (True, False, True))
    proof = SimpleNamespace(orbit=ORBIT, mu=0.1)
    noisy = SimpleNamespace(mu=0.1, alpha=1.0, last=0.01, proof=proof, stiff=(1.0, 2.0, 0.5),
                            loud=0.3, spread=1.0)  # fmt: skip
    quiet = SimpleNamespace(last=1e-9)
    least = dither_push.at_least(loop, noisy, quiet, push)
    x, z, e = (float(at(i, 0.3)[0]) for i in range(3))
    for k, up in enumerate(push.signs):
        s = math.sin(0.3 + 0.2 * k)
        H = x * s + s * s / 2 - e + (0.01 if up else -0.01)
        x, z, e = (x - 0.06 * z, z + 0.1 * (s * H - z),
                   e + 0.2 * (0.7 * H + 0.3 * x * z - 0.018 * z * z / 2))  # fmt: skip
    assert 0 < least <= abs(x)
    assert least == pytest.approx(abs(x), abs=1e-6)
    noisy.mu = 0.02  # twice alpha times what is left: the function need not fall
    assert dither_push.at_least(loop, noisy, quiet, push) == -1.0
    noisy.mu = 0.1
    for wrong in (loop._replace(W=3.0), loop._replace(W=1e-20), loop._replace(h=1e30)):
        assert dither_push.at_least(wrong, noisy, quiet, push) == -1.0
    noisy.proof = SimpleNamespace(orbit=ORBIT * 1e30, mu=0.1)
    assert dither_push.at_least(loop, noisy, quiet, push) == -1.0


def test_a_found_function_is_written_with_its_largest_mean_as_one() -> None:
    loop = Loop(0.0295, 0.0557, 0.0716, 0.012566, 0.0)
    found = dither_search.find(loop, 1.0)
    assert found is not None
    assert max(row[0] for row in found.proof.P) == pytest.approx(1, abs=1e-6)
    assert found.at_least(loop, 1e9, 5) == -1.0  # from so far it need not come back
    assert 0.99 * found.swing < dither_search.swing(loop) <= found.swing


@pytest.mark.parametrize("k", [20, -20])
def test_the_run_that_is_shown_is_that_of_the_seeker_from_its_start(k) -> None:
    """Tick by tick until it is a thousand times as far, and no further; else for all ticks."""
    n = {"k": F(k), "w": F(40), "w_l": F(30), "w_h": F(25), "a": F(1, 2), "curvature": F(3),
         "T": F(1, 100), "start": F(1, 3), "dead_time": F(2, 100)}  # fmt: skip
    th, xi, eta, heard, path = 1 / 3, 0.0, 1.5 / 9, [], [1 / 3]
    for i in range(-2, 4000):
        s = math.sin(0.4 * i)
        heard.append((th + s / 2) ** 2)
        if i < 0:
            continue
        y = 1.5 * heard[i] - eta
        s = math.sin(0.4 * i)
        th, xi, eta = th + 0.01 * k * xi, xi + 0.3 * (y * s - xi), eta + 0.25 * y
        path.append(th)
        if not abs(th) <= 500:
            break
    shown = dithering_kind._perturbation_witness(n)
    t, own = shown.trajectory["t"][1], shown.trajectory["th"][1]
    if abs(path[-1]) > 500:
        assert shown.found["run"][0] == pytest.approx(0.01 * (len(path) - 1))
        assert shown.found["distance_over_the_start"][0] == pytest.approx(
            abs(path[-1]) * 3, rel=1e-6)  # fmt: skip
    else:
        assert shown.found["run"][0] > 39
    places = [round(x / 0.01) for x in t]
    assert places[:3] == [0, places[1], 2 * places[1]]
    early = [p for p in places if p < min(300, len(path))]
    assert own[: len(early)] == pytest.approx([path[p] for p in early], rel=1e-6)


def test_ticks_of_a_flight_are_told_where_they_are_beyond() -> None:
    n = {"k": 20, "w": 40, "w_l": 30, "w_h": 25, "a": 0.5, "curvature": 3, "T": 0.01, "noise": 0.02}
    every = list(dither_flight.ticks(n, 0.3, 0, True, 60))
    assert [i for i, _ in every] == list(range(1, 61))
    quiet = list(dither_flight.ticks(n, 0.3, 0, False, 60))
    assert every != quiet
    mirrored = list(dither_flight.ticks(n, -0.3, 0, True, 60))
    assert mirrored[-1][1] != pytest.approx(-every[-1][1])  # the dither begins upwards
    far = sorted(abs(x) for _, x in every)[40]
    beyond = list(dither_flight.ticks(n, 0.3, 0, True, 60, far))
    assert beyond == [(i, x) for i, x in every if abs(x) > far]
    assert len(beyond) == 19


def test_ends_that_nothing_bounds_are_none() -> None:
    found = ends_of(Boxes(np.array([1.0, -3.0, 0.5]), np.array([2.0, 0.25, 7.0])))
    assert found == (F(-3), F(7))
    for low, high in ((-np.inf, 1.0), (0.0, np.inf), (-np.inf, np.inf)):
        with pytest.raises(ArithmeticError, match="nothing bounds it"):
            ends_of(Boxes(np.array([0.0, low, 0.5]), np.array([2.0, high, 7.0])))
