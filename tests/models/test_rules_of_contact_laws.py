"""Adhesion laws of wheel on rail at drawn points: each number of each, and the patch of a wheel."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl import BadInput
from slipctl.models.wheel_rail import contact
from slipctl.models.wheel_rail.contact_reference import carter, fastsim
from slipctl.models.wheel_rail.exponential_tail import exponential_tail, peak_slip
from slipctl.models.wheel_rail.falling_creep import falling_creep

MANY = 400


def falling(s, v_s):
    return s["mu_0"] * (s["A"] + (1 - s["A"]) * np.exp(-s["B"] * np.abs(v_s)))


def points(d, **more):
    v = d.one_of(d.even(-40, 40), d.even(-2, 2))
    return {"v": v, "v_s": d.one_of(d.even(-3, 3), d.even(-0.1, 0.1)), "A": d.even(0.2, 0.6),
            "B": d.even(0.1, 0.9), "mu_0": d.even(0.1, 0.5)} | more  # fmt: skip


def grip(k_A, k_S, eps):
    return 2 / np.pi * (k_A * eps / (1 + (k_A * eps) ** 2) + np.arctan(k_S * eps))


def test_polach_is_its_formula():
    d = Draw(MANY, 1)
    s = points(d, k_A=d.even(0.3, 1), k_S=d.even(0.1, 0.5), KEPS=d.even(50, 900),
               v_min=d.even(0.5, 2))  # fmt: skip
    _, _, told = values(contact.polach, s, MANY)
    mu = falling(s, s["v_s"])
    eps = s["KEPS"] * s["v_s"] / np.maximum(np.abs(s["v"]), s["v_min"]) / mu
    assert_same(told, {"mu": mu * grip(s["k_A"], s["k_S"], eps)})


@pytest.mark.parametrize("form", ["printed-6", "printed-7", "printed-8"])
def test_printed_forms_of_polach(form):
    d = Draw(MANY, 2)
    s = points(d, k_A=d.even(0.3, 1), k_S=d.even(0.1, 0.5), KEPS=d.even(50, 900),
               v_min=d.even(0.5, 2))  # fmt: skip
    _, _, told = values(contact.creep_law(form), s, MANY)
    v_s = -s["v_s"] if form == "printed-8" else s["v_s"]
    mu = falling(s, v_s)
    if form == "printed-7":
        mu = s["mu_0"] * (s["A"] + (1 - s["A"]) * np.exp(-s["B"] * v_s))
    eps = s["KEPS"] * v_s / np.maximum(np.abs(s["v"]), s["v_min"]) / mu
    found = mu * grip(s["k_A"], s["k_S"], eps)
    if form == "printed-6":
        share = s["k_A"] * eps / (1 + s["k_A"] * eps**2) + np.arctan(s["k_S"] * eps)
        found = mu * 2 / np.pi * share
    assert_same(told, {"mu": found})


def test_a_falling_creep_law_is_its_formula():
    d = Draw(MANY, 3)
    s = points(d, k_A=d.even(0.2, 0.6), k_S=d.even(0.05, 0.3), c=d.even(100, 900),
               k_v=d.even(0, 0.05), v_0=d.even(0.05, 1))  # fmt: skip
    _, _, told = values(falling_creep, s, MANY)
    mu = falling(s, s["v_s"]) / (1 + s["k_v"] * np.abs(s["v"]))
    eps = s["c"] * s["v_s"] / np.hypot(s["v"], s["v_0"]) / mu
    assert_same(told, {"mu": mu * grip(s["k_A"], s["k_S"], eps)})


def test_two_exponentials_and_a_tail():
    d = Draw(MANY, 4)
    s = {"v_s": d.even(0, 8), "c": d.even(0.1, 0.9), "a": d.even(0.2, 0.6), "b": d.even(0.9, 2),
         "s": d.even(0.01, 0.1)}  # fmt: skip
    _, _, told = values(exponential_tail, s, MANY)
    fast = np.exp(-s["b"] * s["v_s"])
    mu = s["c"] * (np.exp(-s["a"] * s["v_s"]) - fast) + s["s"] * (1 - fast)
    assert_same(told, {"mu": mu})
    for k in range(3):
        c, a, b, tail = (float(s[n][k, 0]) for n in "cabs")
        top = float(peak_slip(c, a, b, tail))
        slope = -a * c * np.exp(-a * top) + b * (c + tail) * np.exp(-b * top)
        assert slope == pytest.approx(0, abs=1e-9)


def test_fastsim_is_the_sum_over_its_strips():
    """Along a strip traction grows with the way until it meets the parabolic bound, and stays."""
    d, many = Draw(40, 5), 40
    s = points(d, k=d.even(0.5, 1.5), KEPS=d.even(50, 900), v_min=d.even(0.5, 2))
    s["v_s"] = d.one_of(d.even(-0.4, 0.4), d.even(-0.03, 0.03), d.even(-3e-3, 3e-3))
    _, _, told = values(fastsim, s, many)
    mu = falling(s, s["v_s"])[:, 0]
    e = (s["v_s"] / np.maximum(np.abs(s["v"]), s["v_min"]))[:, 0]
    # without slip the force is that of Kalker, G a b c11 e; over the load it is 4/pi k KEPS e
    rate = 3 / 2 * s["k"][:, 0] * s["KEPS"][:, 0] * np.abs(e)
    y, weight = np.polynomial.legendre.leggauss(50)
    force = np.zeros(many)
    for at, w in zip(y, weight, strict=True):
        half = np.sqrt(1 - at**2)
        x = half * (1 - (np.arange(2000) + 0.5) / 1000)  # from the leading edge on
        bound = 2 / np.pi * mu[:, None] * (half**2 - x**2)
        grows = rate[:, None] / np.pi * (half - x)
        force += w * np.minimum(grows, bound).sum(axis=1) * half / 1000
    assert np.abs(told["mu"][:, 0]) == pytest.approx(force, rel=3e-3)
    assert (np.sign(told["mu"][:, 0]) == np.sign(s["v_s"][:, 0])).all()
    assert 0.2 < (np.abs(told["mu"][:, 0]) < 0.98 * mu).mean() < 0.95


def test_carter_is_a_parabola_up_to_full_slip():
    d = Draw(MANY, 6)
    s = points(d, k=d.even(0.5, 1.5), Q=d.even(4e4, 9e4), G=d.even(7e10, 9e10),
               nu=d.even(0.2, 0.3), R=d.even(0.4, 0.6), b=d.even(3e-3, 9e-3),
               a=d.even(4e-3, 8e-3), v_min=d.even(0.5, 2))  # fmt: skip
    s["v_s"] = d.even(-0.4, 0.4)
    _, _, told = values(carter, s, MANY)
    mu = falling(s, s["v_s"])
    slope = np.pi * s["G"] * s["a"] * s["b"] * s["k"] / (1 - s["nu"]) / s["Q"]
    e = np.abs(s["v_s"]) / np.maximum(np.abs(s["v"]), s["v_min"])
    part = np.minimum(slope * e / mu / 2, 1)
    assert_same(told, {"mu": np.sign(s["v_s"]) * mu * (2 * part - part**2)})
    half = carter.with_params(Q=6e4, R=0.5, nu=0.25, b=5e-3, G=8e10).param_values()["a"]
    assert float(half) == pytest.approx(np.sqrt(2 * 6e4 * 0.5 * 0.75 / (np.pi * 5e-3 * 8e10)))


def test_slopes_peaks_and_what_a_locomotive_may_count_on():
    law = contact.polach
    p = {n: float(v) for n, v in law.param_values().items()}
    wanted = 2 / np.pi * (0.28 + 0.14) * p["KEPS"]
    assert contact.slope("wet") == pytest.approx(wanted)
    own = {"k_A": 0.5, "k_S": 0.2}
    assert contact.slope(own) == pytest.approx(2 / np.pi * 0.7 * p["KEPS"])
    for v in (0.0, 20.0, -20.0):
        found = 7.5 / (3.6 * abs(v) + 44) + 0.161
        assert contact.curtius_kniffler(v) == pytest.approx(found)
    slips = np.linspace(1e-3, 3, 20001)
    s = {n: np.full((1, 1), p[n]) for n in ("k_A", "k_S", "A", "B", "mu_0")}
    wet = s | {n: np.full((1, 1), v) for n, v in contact.SURFACES["wet"].items()}
    mu = falling(wet, slips)[0]
    curve = mu * grip(wet["k_A"], wet["k_S"], p["KEPS"] * slips / 12.0 / mu)[0]
    found = contact.peak(12.0, "wet")
    assert found.location == pytest.approx(slips[curve.argmax()], abs=3e-4)
    assert found.value == pytest.approx(curve.max(), rel=1e-6)


def test_a_law_with_a_patch_follows_the_wheel_of_a_vehicle():
    made = contact.law_of_wheel(contact.polach, 6e4, 0.5, 8)
    fits = contact.patch(6e4, 0.5)
    found = {n: float(v) for n, v in made.param_values().items()}
    assert {n: found[n] for n in ("Q", "a", "b", "c11")} == pytest.approx(
        {n: fits[n] for n in ("Q", "a", "b", "c11")})  # fmt: skip
    assert found["m"] == pytest.approx(6e4 * 8 / 9.81)
    heavy = made.with_params(m=found["m"] * 8, g=9.81).param_values()
    assert float(heavy["Q"]) == pytest.approx(4.8e5)
    assert float(heavy["a"]) == pytest.approx(2 * fits["a"])
    assert float(heavy["b"]) == pytest.approx(2 * fits["b"])
    own = contact.polach.with_params(b=4e-3)
    assert contact.law_of_wheel(own, 6e4, 0.5, 8) is own
    assert contact.law_of_wheel(falling_creep, 6e4, 0.5, 8) is falling_creep


def test_a_patch_of_another_wheel_is_refused():
    usual = {n: float(v) for n, v in contact.polach.param_values().items()}
    load = usual["Q"]
    contact.check_patch(usual, [load, load * 1.009], 0.445)
    contact.check_patch({"Q": 1.0}, load, 0.445)  # no patch is not judged
    with pytest.raises(BadInput, match="the load of another wheel"):
        contact.check_patch(usual, [load, load * 1.02], 0.445)
    other = usual | {"Q": 2 * load}
    with pytest.raises(BadInput, match="a, b and c11 are of a wheel"):
        contact.check_patch(other, 2 * load, 0.445)
    contact.check_patch(other | {"a": 9e-3}, 2 * load, 0.445)  # one of its own is taken
    with pytest.raises(BadInput, match="a, b and c11 are of a wheel"):
        contact.check_patch(usual, load, [0.445, 0.6])
    for name in ("R_wheel", "R_rail"):
        with pytest.raises(BadInput, match=name):
            contact.patch(**{name: 0.0})


def test_what_is_no_surface_is_refused():
    dry = dict(contact.SURFACES["dry"])
    for wrong, said in (
        ({k: v for k, v in dry.items() if k != "B"}, "lacks B"),
        (dry | {"k_B": 1.0}, "no parameter 'k_B'"),
        (dry | {"A": 2.0}, "out of range"),
    ):
        with pytest.raises(BadInput, match=said):
            contact.creep_law(surfaces={"mine": wrong})
    with pytest.raises(BadInput, match="no form"):
        contact.creep_law("printed-9")
    with pytest.raises(BadInput, match="no surface 'wett'"):
        contact.peak(10.0, "wett")
