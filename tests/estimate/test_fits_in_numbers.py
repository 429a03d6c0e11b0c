"""Probes tick by tick, bounds of a peak, linear fits that forget, and parts of a curve's fit."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, fit, law, linear_fit, peak_bound
from slipctl.estimate.curve import Curve, parameters_of_columns
from slipctl.estimate.curve_fit import _peaks, _Scale
from slipctl.estimate.misfit import rotation, solution
from slipctl.estimate.peak import _probe_numbers, _probing

# ---- probes --------------------------------------------------------------------------------------

NUMBERS = {"depth": 0.5, "lowest": 0.3, "highest": 6.0, "tolerance": 0.02, "longest": 0.3,
           "again": 1.0, "look": 0.08, "nudge": 0.25}  # fmt: skip


def told(exprs):
    return {n: float(v) for n, v in exprs.items()}


def tick(x, changed, deviation, best=2.0, limit=9.0, looks=True):
    u = {"changed": ca.DM(changed), "limit": ca.DM(limit)}
    p, x = ({n: ca.DM(v) for n, v in d.items()} for d in (NUMBERS, x))
    nxt, out = _probing(x, u, p, ca.DM(best), ca.DM(deviation), 0.1, looks)
    return told(nxt), told(out)


@pytest.mark.parametrize(
    ("probing", "elapsed", "waited", "changed", "deviation", "following", "reference"),
    [
        # elapsed, probing, waited after it
        (1, 0.1, 0.0, 0, 0.05, (0.2, 1, 0.0), 3.0), (1, 0.1, 0.0, 0, 0.02, (0.2, 0, 0.1), 2.0),
        (1, 0.3, 0.0, 0, 0.05, (0.3, 0, 0.1), 2.0), (1, 0.25, 0.0, 0, 0.05, (0.3, 1, 0.0), 3.0),
        (0, 0.2, 0.5, 0, 0.05, (0.3, 0, 0.6), 2.0), (0, 0.2, 0.5, 1, 0.05, (0.1, 1, 0.0), 3.0),
        (0, 0.2, 0.5, 1, 0.01, (0.1, 0, 0.6), 2.0), (0, 0.2, 1.0, 0, 0.05, (0.1, 1, 0.0), 3.0),
        (0, 0.2, 1.0, 0, 0.01, (0.3, 0, 0.0), 2.5), (0, 0.2, 0.97, 0, 0.01, (0.3, 0, 1.07), 2.0),
        (0, 0.2, 0.985, 0, 0.01, (0.3, 0, 0.0), 2.0), (1, 0.2, 1.0, 0, 0.05, (0.3, 1, 0.0), 3.0),
    ],
)  # fmt: skip
def test_a_probe_goes_past_the_peak_while_it_is_unsure(
    probing, elapsed, waited, changed, deviation, following, reference
):
    """At most 0.3 s; a second later it looks for 0.08 s, and probes where it is unsure again."""
    x = {"probing": probing, "elapsed": elapsed, "waited": waited}
    nxt, out = tick(x, changed, deviation)
    assert nxt == pytest.approx(dict(zip(("elapsed", "probing", "waited"), following, strict=True)))
    assert out == pytest.approx(
        {"reference": reference, "deviation": deviation, "probing": following[1]})  # fmt: skip
    for best, limit, cut in ((9.0, 99.0, 6.0), (2.0, 1.25, 1.25), (0.1, 9.0, 0.3), (2.0, 0.1, 0.3)):
        assert tick(x, changed, deviation, best, limit)[1]["reference"] == pytest.approx(cut)
    if waited < 1:
        nxt, out = tick(x, changed, deviation, looks=False)
        assert nxt == pytest.approx({"elapsed": following[0], "probing": following[1]})
        assert out["reference"] == pytest.approx(reference)


def test_numbers_of_a_probe():
    found = {s.name: (s.value, s.lo, s.hi) for s in _probe_numbers("m/s", 0.5, 3.0, True)}
    assert found == {
        "depth": (0.4, 0, 2), "lowest": (0.5, -1e12, 1e12), "highest": (3.0, -1e12, 1e12),
        "tolerance": (0.02, 1e-6, 1e12), "longest": (0.3, 0, 60), "again": (1.0, 0, 3600),
        "look": (0.08, 0, 60), "nudge": (0.15, 0, 2),
    }  # fmt: skip


@law(y=Output("N", "height"))
def hill(
    w=Input("1", "tilt"), v=Input("m/s", "place"), a=Param("N s/m", 2.0, "rise"),
    k=Param("N", 0.7, "known"), b=Param("N s^2/m^2", 0.8, "bend"), c=Param("N", 0.3, "height"),
):  # fmt: skip
    """A parabola over v that tilts with w."""
    return a * v - b * v**2 * (1 + w) + c * w + k


@pytest.mark.parametrize("spread", [None, {"b": 0.02, "c": 0.5}])
def test_a_bound_of_a_peak_of_two_inputs(spread):
    """Place a/(2 b (1 + w)) at the mean of w; what is known beforehand adds its information."""
    rng = np.random.default_rng(3)
    w, v = rng.uniform(0, 1, 7), rng.uniform(0.2, 2, 7)
    a, b, at_w = 2.2, 0.9, w.mean()
    at = a / (2 * b * (1 + at_w))
    found = peak_bound(hill, "v", at, {"v": v, "w": w}, 0.05, unknown=["a", "b", "c"],
                       spread=spread, a=a, b=b)  # fmt: skip
    H = np.column_stack([v, -(v**2) * (1 + w), w]) / 0.05
    before = np.diag([0.0, 1 / 0.02, 1 / 0.5] if spread else [0.0] * 3)
    inverse = np.linalg.inv(H.T @ H + before @ before)
    g = np.array([1 / (2 * b * (1 + at_w)), -a / (2 * b**2 * (1 + at_w)), 0.0])
    h = np.array([at, -(at**2) * (1 + at_w), at_w])
    assert found.location == pytest.approx(math.sqrt(g @ inverse @ g))
    assert found.height == pytest.approx(math.sqrt(h @ inverse @ h))


# ---- linear fits ---------------------------------------------------------------------------------


def test_a_linear_fit_forgets_and_goes_home():
    """Information lam I + (1 - lam) I_0 + h h'; what is left over falls with it."""
    lam, noise, about, home = 0.9, 0.2, np.array([0.5, 2.0, 1.5]), np.array([2.0, 0.8, 0.3])
    block = linear_fit(hill, unknown=["a", "b", "c"], spread=about, forgetting=lam, noise=noise)
    rng, state = np.random.default_rng(5), {}
    prior = np.diag(noise / about)
    rows, right = prior.copy(), prior @ home
    left, count = 0.0, 0.0
    for _ in range(8):
        w, v, y = rng.uniform(0, 1), rng.uniform(0.2, 2), rng.normal()
        before = np.linalg.lstsq(rows, right, rcond=None)[0]
        state, out = block(**state, w=w, v=v, y=y, k=0.6)
        h, m = np.array([v, -(v**2) * (1 + w), w]), y - 0.6
        assert out["residual"] == pytest.approx(m - h @ before, abs=1e-9)
        both = np.vstack([math.sqrt(lam) * rows, math.sqrt(1 - lam) * prior, h])
        told = np.r_[math.sqrt(lam) * right, math.sqrt(1 - lam) * prior @ home, m]
        R = np.linalg.qr(np.column_stack([both, told]), mode="r")
        rows, right = R[:3, :3], R[:3, 3]
        left = math.sqrt(lam * left**2 + R[3, 3] ** 2)
        count = lam * count + 1
        best = np.linalg.solve(rows, right)
        assert [out[n] for n in "abc"] == pytest.approx(best, abs=1e-9)
        assert out["q"] == pytest.approx(left, abs=1e-9)
        root = np.array([[out.get(f"R{i}{j}", 0.0) for j in (1, 2, 3)] for i in (1, 2, 3)])
        assert root.T @ root == pytest.approx(rows.T @ rows, abs=1e-9)
        assert float(state["count"]) == pytest.approx(count)


def test_rotations_and_their_solution_are_numpys():
    rng = np.random.default_rng(6)
    R = np.triu(rng.normal(size=(3, 4)) + 3 * np.eye(3, 4))
    row, q = rng.normal(size=(1, 4)), 0.7
    found, left = (np.array(v) for v in rotation(3)(R, q, row))
    wanted = np.linalg.qr(np.vstack([R, row]), mode="r")
    assert np.abs(found) == pytest.approx(np.abs(wanted[:3]))
    assert found[:, :3].T @ found[:, 3] == pytest.approx(
        R[:, :3].T @ R[:, 3] + row[0, :3] * row[0, 3]
    )
    assert left.item() == pytest.approx(math.hypot(q, wanted[3, 3]))
    a, deviation = (np.array(v).ravel() for v in solution(3)(R, q, 11))
    inverse = np.linalg.inv(R[:, :3])
    assert a == pytest.approx(inverse @ R[:, 3])
    assert deviation == pytest.approx(q / math.sqrt(11 - 3) * np.linalg.norm(inverse, axis=1))
    still = np.zeros((3, 4))  # nothing yet, and a row of nothing
    assert not np.array(rotation(3)(still, 0.0, np.zeros((1, 4)))[0]).any()


# ---- curves --------------------------------------------------------------------------------------


@law(y=Output("1", "height"))
def free(
    v=Input("1", "place"), w=Input("1", "further", value=0.5),
    p=Param("1", 3.0, "positive", lo=0.5, hi=8),
    q=Param("1", -4.0, "of a range", lo=-5, hi=1), r=Param("1", 7.0, "of none"),
    s=Param("1", 0.2, "small, of none"),
):  # fmt: skip
    """A parabola."""
    return p - (v - q * w) ** 2 + 0 * r * s


def test_coordinates_of_a_fit_are_logarithms_of_what_is_positive():
    scale = _Scale.of(free, ["p", "q", "r", "s"])
    assert scale.log.tolist() == [True, False, False, False]
    assert scale.lo == pytest.approx([math.log(0.5), -5, -np.inf, -np.inf])
    assert scale.hi == pytest.approx([math.log(8), 1, np.inf, np.inf])
    assert scale.size.tolist() == [1, 6, 7, 1]
    values = np.array([2.0, -3, 5, 0.4])
    assert scale.to(values) == pytest.approx([math.log(2), -3, 5, 0.4])
    assert scale.back(scale.to(values)) == pytest.approx(values)
    assert scale.slopes(values).tolist() == [2, 1, 1, 1]


def test_peaks_of_a_fit_are_those_of_its_parabolas():
    """At q w for each w that was measured: -4 w, within 0 and below; others have no peak."""
    v, w = np.array([-3.0, -2, -1, -2, -1, 1]), np.array([0.5, 0.5, 0.25, 0.25, 2.0, 2.0])
    found = _peaks(free, Curve("data", {"v": v, "w": w}, np.zeros(6), "y"))
    assert [p[0] for p in found] == [{"w": 0.25}, {"w": 0.5}]
    assert [p[1] for p in found] == pytest.approx([-1.0, -2.0], abs=1e-9)
    assert [p[2] for p in found] == pytest.approx([3.0, 3.0], abs=1e-9)
    w = np.array([0.3107, 0.3107])  # beside the points of the grid
    (found,) = _peaks(free, Curve("data", {"v": np.array([-2.0, 0.5]), "w": w}, np.zeros(2), "y"))
    assert found[1:] == pytest.approx((-4 * 0.3107, 3.0), abs=1e-9)


def test_a_column_of_one_number_is_a_parameter():
    """To a billionth of the first one, which is what is taken."""
    data = {"v": [1.0, 2, 3], "r": [2.0, 2 + 1.9e-9, 2.0], "s": [0.3, 0.3, 0.3], "z": [1.0, 2, 3]}
    found = parameters_of_columns(free, "data", data, {"s": 0.3})
    assert found == {"r": 2.0}
    assert parameters_of_columns(free, "data", {"r": [2.0 + 1e-9, 2.0]}, {}) == {"r": 2.0 + 1e-9}
    with pytest.raises(BadInput, match="the column r goes from 2 to 2 1, but free has one r"):
        parameters_of_columns(free, "data", {"r": [2.0, 2 + 2.1e-9]}, {})
    with pytest.raises(BadInput, match=r"has a column s, and s = 0.4 1 is given"):
        parameters_of_columns(free, "data", data, {"s": 0.4})


def test_a_fit_of_two_inputs_tells_deviations_and_correlations():
    """Linear in all three: those of linear regression, with Student's factor of 4 degrees."""
    rng = np.random.default_rng(8)
    v, w = np.sort(rng.uniform(0.2, 2, 7)), np.full(7, 0.0)
    w[1::2] = 0.5
    y = 2.1 * v - 0.7 * v**2 * (1 + w) + 0.4 * w + 0.7 + 0.02 * rng.normal(size=7)
    found = fit(hill, {"v": v, "w": w, "y": y}, ["a", "b", "c"], at={"k": 0.7})
    H = np.column_stack([v, -(v**2) * (1 + w), w])
    best, squares = np.linalg.lstsq(H, y - 0.7, rcond=None)[:2]
    C = squares[0] / 4 * np.linalg.inv(H.T @ H)
    deviation = np.sqrt(np.diag(C))
    assert [found.values[n] for n in "abc"] == pytest.approx(best, rel=1e-6)
    assert [found.std[n] for n in "abc"] == pytest.approx(deviation, rel=1e-6)
    for k, n in enumerate("abc"):
        far = 2.7764451 * deviation[k]
        assert found.interval[n] == pytest.approx((best[k] - far, best[k] + far), rel=1e-6)
    R = C / np.outer(deviation, deviation)
    assert found.correlation == pytest.approx(
        {("b", "a"): R[1, 0], ("c", "a"): R[2, 0], ("c", "b"): R[2, 1]}, rel=1e-6)  # fmt: skip
    assert found.residuals == pytest.approx(y - 0.7 - H @ best, abs=1e-8)
    assert found.rms == pytest.approx(math.sqrt(squares[0] / 7), rel=1e-6)
