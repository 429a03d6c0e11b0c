"""Contact: Hertz, Kalker and Polach against published values, the law over all speeds."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from slipctl import BadInput, argmax, c_module
from slipctl.models.wheel_rail import contact, hertz
from slipctl.models.wheel_rail.contact import SURFACES, polach

SPEEDS = st.floats(0, 90)
NAMES = st.sampled_from(sorted(SURFACES))

# ---- Hertz ---------------------------------------------------------------------------------------


@given(st.floats(1e-9, 0.9999))
def test_elliptic_integrals(m):
    K, E, D = hertz.elliptic(m)
    assert pytest.approx(ellipk(m), rel=1e-14) == K
    assert pytest.approx(ellipe(m), rel=1e-14) == E
    # the difference below loses digits at small m; D does not
    assert pytest.approx((ellipk(m) - ellipe(m)) / m, rel=1e-14 + 1e-15 / m) == D


def test_two_spheres():
    # Johnson 1985, (4.22)-(4.24): a^3 = 3 Q R/(4 E*), p_0 = 3 Q/(2 pi a^2), approach a^2/R
    Q, R, E, nu = 1e4, 0.25, 2e11, 0.3
    modulus = E / (2 * (1 - nu**2))
    a = (3 * Q * R / (4 * modulus)) ** (1 / 3)
    found = hertz.ellipse(Q, 1 / (2 * R), 1 / (2 * R), E, nu)
    assert found == pytest.approx((a, a, 3 * Q / (2 * math.pi * a**2), a**2 / R), rel=1e-13)


HERTZ = {
    30: (2.731, 0.493), 35: (2.397, 0.530), 40: (2.136, 0.567), 45: (1.926, 0.604),
    50: (1.754, 0.641), 55: (1.611, 0.678), 60: (1.486, 0.717), 65: (1.378, 0.759),
    70: (1.284, 0.802), 75: (1.202, 0.846), 80: (1.128, 0.893), 85: (1.061, 0.944),
}  # fmt: skip
"""Hertz's own table, as in Timoshenko and Goodier, Theory of Elasticity: theta, m, n."""


@pytest.mark.parametrize("degrees", HERTZ)
def test_table_of_hertz(degrees):
    # cos theta = (B - A)/(A + B); a = m u, b = n u with u^3 = 3 Q/(4 E* (A + B)). Hertz's third
    # decimal errs by up to 2 (Cooper, J. Appl. Mech. 36 (1969) 296, lists errors of his tables)
    cosine = math.cos(math.radians(degrees))
    u = (3 * 1e4 / (4 * hertz.E_STEEL / (2 * (1 - hertz.NU_STEEL**2)))) ** (1 / 3)
    shape = hertz.ellipse(1e4, (1 - cosine) / 2, (1 + cosine) / 2)
    assert (shape.a / u, shape.b / u) == pytest.approx(HERTZ[degrees], abs=2.5e-3)


def test_reference_output_of_contact():
    # CONTACT, examples/tractcurv.ref_out (2023): A1 .8, B1 .2814 1/m, AA 6.304, BB 12.61 mm,
    # approach 7.651e-2 mm; PMAX 640.7 MPa is of its 48 x 44 elements, the ellipse has 0.05 % more
    Q, G, nu = 106.7e3, 82e9, 0.28
    by_ratio = hertz.ellipse_of_ratio(Q, 0.8, 0.5, 2 * G * (1 + nu), nu)
    assert by_ratio.a * 1e3 == pytest.approx(6.304, abs=5e-4)
    assert by_ratio.b * 1e3 == pytest.approx(12.61, abs=5e-3)
    assert by_ratio.approach == pytest.approx(7.651e-5, rel=2e-4)  # of its elements too
    assert by_ratio.p_0 == pytest.approx(640.7e6, rel=1e-3)
    by_curvature = hertz.ellipse(Q, 0.8, 0.2814, 2 * G * (1 + nu), nu)
    assert by_curvature[:2] == pytest.approx(by_ratio[:2], rel=2e-4)  # B1 has four digits
    # 247.0 N at a creep of 1e-5, of finite elements: Kalker's linear theory within 2 %
    linear = G * by_ratio.a * by_ratio.b * hertz.c11(0.5, nu) * 1e-5
    assert linear == pytest.approx(247.0, rel=0.02)


@given(st.floats(0.05, 20), st.floats(0.05, 20), st.floats(1e3, 2e5))
def test_ellipse_solves_the_equations_of_hertz(A, B, Q):
    shape = hertz.ellipse(Q, A, B)
    c, d = max(shape.a, shape.b), min(shape.a, shape.b)
    m = 1 - (d / c) ** 2
    assert shape.p_0 * 2 * math.pi * c * d / 3 == pytest.approx(Q, rel=1e-12)
    ratio = max(A, B) / min(A, B)
    if m > 1e-3:
        there = ((c / d) ** 2 * ellipe(m) - ellipk(m)) / (ellipk(m) - ellipe(m))
        assert there == pytest.approx(ratio, rel=1e-9)
    else:
        assert ratio == pytest.approx(1 + 0.75 * m, abs=1e-5)  # to first order in m
    turned = hertz.ellipse(Q, B, A)
    assert (turned.b, turned.a) == pytest.approx((shape.a, shape.b), rel=1e-12)
    again = hertz.ellipse_of_ratio(Q, A, shape.a / shape.b)
    assert again == pytest.approx(shape, rel=1e-9)


# ---- Kalker --------------------------------------------------------------------------------------


def test_c11_is_the_table_at_its_nodes():
    for ratio, row in hertz.TABLE_E3.items():
        for nu, value in zip(hertz.NU_OF_TABLE, row, strict=True):
            assert hertz.c11(ratio, nu) == pytest.approx(value, rel=1e-13)


def test_c11_of_contact():
    # parabola in 1/c over nu: subroutine linrol of CONTACT, weights 8, -16, 8
    nu, row = 0.28, (2.88, 3.62, 4.83)
    inverse = (
        (nu - 0.25) * (nu - 0.5) * 8 / row[0]
        - (nu - 0.5) * nu * 16 / row[1]
        + nu * (nu - 0.25) * 8 / row[2]
    )
    assert hertz.c11(0.5, nu) == pytest.approx(1 / inverse, rel=1e-13)


def test_cubic_through_every_other_row_finds_the_rows_between(monkeypatch):
    full = dict(hertz.TABLE_E3)
    ratios = list(full)
    monkeypatch.setattr(hertz, "TABLE_E3", {r: full[r] for r in ratios[::2]})
    worst = max(
        abs(hertz.c11(r, nu) - value)
        for r in ratios[1::2]
        for nu, value in zip(hertz.NU_OF_TABLE, full[r], strict=True)
    )
    # the error of a cubic falls with the 4th power of the spacing: 1/16 of this at the table's own
    assert worst < 0.04
    assert worst / 16 < 0.005


@given(st.floats(0.1, 10), st.floats(0, 0.5))
def test_c11_rises_with_nu_and_stays_between_its_neighbours(ratio, nu):
    assert hertz.c11(ratio, 0) <= hertz.c11(ratio, nu) <= hertz.c11(ratio, 0.5)


# ---- numbers of this wheel -----------------------------------------------------------------------


def test_patch_of_the_wheel():
    p = contact.patch()
    shape = hertz.ellipse(p["Q"], 1 / 0.89, 1 / 0.6)
    assert (p["a"] * 1e3, p["b"] * 1e3) == pytest.approx((6.474, 4.978), abs=5e-4)
    assert shape.p_0 == pytest.approx(1134e6, abs=5e5)
    assert p["c11"] == pytest.approx(4.411, abs=5e-4)
    assert p["G"] == pytest.approx(82.03e9, abs=5e6)
    assert float(polach.param_values()["KEPS"]) == pytest.approx(119.62, abs=5e-3)
    # Table E.3 read at 0.28 in place of 0.25
    at_28 = contact.patch(nu_c11=0.28)["c11"]
    assert at_28 / p["c11"] == pytest.approx(1.024, abs=5e-4)


PEAKS_AT_40 = {
    "dry": (0.588, 0.3266, 500), "damp": (0.668, 0.2528, 387), "wet": (0.847, 0.1027, 157),
    "oily": (1.229, 0.1003, 154), "ice": (1.031, 0.0574, 87.9),
}  # fmt: skip
"""Creep in m/s, adhesion, and force in kN of ten axles, of an independent computation."""


@pytest.mark.parametrize("surface", PEAKS_AT_40)
def test_peaks_at_40(surface):
    creep, adhesion, force = PEAKS_AT_40[surface]
    found = contact.peak(40.0, surface)
    assert found.location == pytest.approx(creep, abs=5e-4 + 1e-9)
    assert found.value == pytest.approx(adhesion, abs=5e-5)
    tolerance = 0.05 if force < 100 else 0.5
    assert 20 * contact.WHEEL_LOAD * found.value / 1e3 == pytest.approx(force, abs=tolerance)


def test_stiffness_moves_the_peak_of_ice():
    for factor, creep, adhesion in ((0.5, 1.45, 0.0526), (2.0, 0.73, 0.0614)):
        law = contact.creep_law().with_params(c11=factor * contact.patch()["c11"])
        found = contact.peak(40.0, "ice", law)
        assert found.location == pytest.approx(creep, abs=5e-3)
        assert found.value == pytest.approx(adhesion, abs=5e-5)


def test_adhesion_of_a_spinning_wheel():
    wanted = {"dry": 0.169, "damp": 0.135, "oily": 0.052, "wet": 0.051, "ice": 0.0255}
    for name, value in wanted.items():
        found = polach(v_s=50.0, v=40.0, **SURFACES[name])["mu"]
        assert found == pytest.approx(value, abs=5e-5 if name == "ice" else 5e-4)


def test_wet_and_oily_swap_their_order():
    def ahead(v: float) -> float:
        return contact.peak(v, "wet").value - contact.peak(v, "oily").value

    assert ahead(4.9) < 0 < ahead(5.1)  # in m/s
    at_5 = [contact.peak(5.0, name).value for name in ("wet", "oily")]
    assert at_5 == pytest.approx([0.1179, 0.1179], abs=5e-5)
    for v in (1.0, 5.0, 20.0, 40.0, 90.0):  # the others keep it
        best = [contact.peak(v, name).value for name in ("dry", "damp", "wet", "ice")]
        assert best == sorted(best, reverse=True)
        assert best[1] > contact.peak(v, "oily").value > best[3]


def test_slopes():
    wanted = {"dry": 110, "damp": 49, "wet": 32, "oily": 27, "ice": 24}
    for name, value in wanted.items():
        assert contact.slope(name) == pytest.approx(value, abs=0.5)
        slope = polach.jacobian("mu", "v_s")(u_v_s=0.0, u_v=20.0, **_params(name))["J"]
        assert 20 * float(slope) == pytest.approx(contact.slope(name), rel=1e-12)


def _params(name: str) -> dict[str, float]:
    return {f"p_{k}": float(v) for k, v in polach.param_values(**SURFACES[name]).items()}


# ---- the law -------------------------------------------------------------------------------------


@given(st.floats(-100, 100), SPEEDS, NAMES)
def test_odd_and_bounded(v_s, v, name):
    mu = polach(v_s=v_s, v=v, **SURFACES[name])["mu"]
    assert mu == -polach(v_s=-v_s, v=v, **SURFACES[name])["mu"]
    assert mu * v_s >= 0
    # F <= 1/2 + pi/2, and the friction is at most mu_0
    assert abs(mu) <= SURFACES[name]["mu_0"] * (1 / math.pi + 1)


@given(st.floats(-3, 3), st.floats(0, 90), NAMES)
def test_exact_derivative(v_s, v, name):
    p = _params(name)
    slope = float(polach.jacobian("mu", "v_s")(u_v_s=v_s, u_v=v, **p)["J"])
    h = 1e-5
    at = {"v": v, **SURFACES[name]}
    numeric = (polach(v_s=v_s + h, **at)["mu"] - polach(v_s=v_s - h, **at)["mu"]) / (2 * h)
    # the friction has a corner at 0, where the difference is off by its share of the step
    assert slope == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_standstill_is_regular():
    at_rest = [polach(v_s=0.05, v=v)["mu"] for v in (0.0, 1e-300, 0.5, 1.0)]
    assert len(set(at_rest)) == 1
    assert polach(v_s=0.0, v=0.0)["mu"] == 0.0
    assert np.isfinite(np.array(polach.jacobian("mu", ["v_s", "v"])(
        u_v_s=0.0, u_v=0.0, **_params("dry"))["J"])).all()  # fmt: skip


@pytest.mark.parametrize(
    ("v", "name"), [(0.0, "damp"), (5.0, "oily"), (40.0, "ice"), (69.0, "wet")]
)
def test_one_peak_is_proven(v, name):
    proven, found = contact.peak(v, name, proven=True), contact.peak(v, name)
    assert proven.method == "proven"
    assert proven.bracket[0] < found.location < proven.bracket[1]
    assert proven.location == pytest.approx(found.location, rel=1e-9)


def test_table_of_peaks():
    table = contact.peak_table()
    assert table.choices["conditions"] == ", ".join(SURFACES)
    assert table.check_units() == []
    for v in (0.0, 0.7, 3.3, 27.1, 64.9, 90.0):
        got = table(v=v)
        for k, name in enumerate(SURFACES):
            true = contact.peak(v, name)
            assert got["best"][k] == pytest.approx(true.location, rel=1e-3)
            assert got["value"][k] == pytest.approx(true.value, rel=1e-3)
    assert (table(v=200.0)["value"] == table(v=90.0)["value"]).all()


@pytest.mark.parametrize(("real", "error"), [("double", 0.0), ("float", 1e-6)])
def test_table_of_peaks_in_c(real, error, needs_compiler, tmp_path):
    # float: a sum of some 30 ramps, each rounded to 2^-24
    table = contact.peak_table(error=0.01)
    module = c_module(table, tmp_path, real=real).compile().load()
    for v in np.linspace(-5.0, 120.0, 101):
        ours, there = table(v=float(v)), module.step(v=float(v))
        for name in ours:
            assert there[name] == pytest.approx(ours[name], rel=error, abs=0)


def test_printed_forms():
    at = {"v": 40.0, **SURFACES["ice"]}
    ours = polach(v_s=0.8, **at)["mu"]
    assert contact.creep_law("printed-8")(v_s=0.8, **at)["mu"] == -ours
    assert contact.creep_law("printed-7")(v_s=0.8, **at)["mu"] == ours
    assert contact.creep_law("printed-6")(v_s=0.8, **at)["mu"] < ours
    dry = {"v": 40.0, **SURFACES["dry"]}  # k_A = 1: the bracket makes no difference
    assert contact.creep_law("printed-6")(v_s=0.8, **dry)["mu"] == polach(v_s=0.8, **dry)["mu"]
    for form in contact.FORMS:
        assert contact.creep_law(form).check_units() == []


def test_curtius_kniffler():
    assert contact.curtius_kniffler(0.0) == pytest.approx(7.5 / 44 + 0.161)
    assert contact.curtius_kniffler(100 / 3.6) == pytest.approx(0.2131, abs=5e-5)


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: hertz.c11(12.0, 0.25), "axis ratio a/b = 12 is outside Kalker's table"),
        (lambda: contact.patch(R_rail=20e-3 / 3), "is outside Kalker's table"),
        (lambda: hertz.c11(1.0, 0.6), "nu = 0.6 is outside"),
        (lambda: hertz.ellipse(-1, 1, 1), "Q = -1 N must be positive"),
        (lambda: hertz.ellipse_of_ratio(1e4, 1, 0), "ratio = 0 1 must be positive"),
        (lambda: hertz.ellipse(1e4, 1, 1, nu=0.7), "nu = 0.7 must lie in [0, 0.5]"),
        (lambda: hertz.ellipse(1e4, 1, 1, E=0), "E = 0 Pa must be positive"),
        (lambda: contact.patch(R_wheel=0), "R_wheel = 0 m must be positive"),
        (lambda: contact.creep_law("printed-5"), "creep_law has no form 'printed-5'"),
        (lambda: contact.peak(10.0, "snow"), "polach has no surface 'snow'"),
        (lambda: polach.with_params(k_A=0.0), "polach.k_A = 0 is out of range"),
        (lambda: polach.with_params(k_S=-1.0), "polach.k_S = -1 is out of range"),
        (lambda: polach.with_params(mu_0=1.2), "polach.mu_0 = 1.2 is out of range"),
    ],
)
def test_refusals(call, words):
    with pytest.raises(BadInput) as told:
        call()
    assert words in str(told.value)
    assert "\n" not in str(told.value)


HEAD = "surface,k_A,k_S,A,B,mu_0\n"


def test_surface_table(tmp_path, caplog):
    file = tmp_path / "mine.csv"
    file.write_text(
        f"# measured in spring\n{HEAD}leaves,0.2,0.05,0.4,0.1,0.06\nsand,1,.5,.4,.5,.5\n"
    )
    surfaces = contact.read_surfaces(file)
    assert surfaces["leaves"] == {"k_A": 0.2, "k_S": 0.05, "A": 0.4, "B": 0.1, "mu_0": 0.06}
    law = contact.creep_law(surfaces=surfaces)
    assert list(law.conditions) == ["leaves", "sand"]
    assert 0.03 < contact.peak(20.0, "leaves", law).value < 0.06
    assert not caplog.records
    contact.creep_law(surfaces={"odd": SURFACES["dry"] | {"k_S": 1.5}})
    assert "k_A = 1 < k_S = 1.5" in caplog.text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "surface,k_A,k_S,A,B\nx,1,.5,.4,.5\n",
            "has the columns surface, k_A, k_S, A, B; a surface",
        ),
        (HEAD + "x,1,.5,.4,.5\n", "line 2 has 5 cells, its head 6"),
        (HEAD + "x,1,.5,.4,.5,.5\ny,0,.5,.4,.5,.5\n", "line 3: k_A = 0 is out of range"),
        (HEAD + "x,1,.5,.4,.5,1.5\n", "line 2: mu_0 = 1.5 is out of range"),
        (HEAD + "x,1,.5,.4,.5,much\n", "'much' in line 2 is no number"),
        (HEAD + "x,1,.5,.4,.5,nan\n", "line 2: mu_0 is NaN"),
        (HEAD + "x,1,.5,.4,.5,.3\nx,1,.5,.4,.5,.3\n", "line 3: 'x' is no name, or the second"),
        (HEAD, "no row of numbers below it"),
    ],
)
def test_bad_surface_table(tmp_path, text, words):
    file = tmp_path / "mine.csv"
    file.write_text(text)
    with pytest.raises(BadInput) as told:
        contact.read_surfaces(file)
    assert words in str(told.value)


def test_a_surface_must_be_whole():
    with pytest.raises(BadInput, match="surface x lacks mu_0"):
        contact.creep_law(surfaces={"x": {"k_A": 1, "k_S": 0.5, "A": 0.4, "B": 0.5}})
    with pytest.raises(BadInput, match="there is no parameter 'k_Q'"):
        contact.creep_law(surfaces={"x": SURFACES["dry"] | {"k_Q": 1.0}})


def test_the_grid_finds_what_is_proven_over_the_whole_range():
    # the reference for any law: the bracket is wider, the place is the same
    at = {"v": 30.0, **SURFACES["damp"]}
    proven = argmax(polach, "v_s", lo=0, hi=100, at=at, proven=True)
    assert proven.location == pytest.approx(contact.peak(30.0, "damp").location, rel=1e-9)
    f = polach.jacobian("mu", "v_s")
    signs = [
        float(ca.sign(f(u_v_s=x, u_v=30.0, **_params("damp"))["J"]))
        for x in np.geomspace(1e-4, 100)
    ]
    falls = [k for k in range(1, len(signs)) if signs[k - 1] > 0 > signs[k]]
    assert len(falls) == 1
    # far out the friction falls no more, and the arctangent still rises
    assert signs[-1] > 0
    assert polach(v_s=100.0, v=30.0, **SURFACES["damp"])["mu"] < 0.6 * proven.value
