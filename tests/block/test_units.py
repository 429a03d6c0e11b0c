"""Units: reading them, quantities with units, and the algebra of equations."""

import math
import subprocess
import sys
from contextlib import suppress
from fractions import Fraction

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.block.text import formula
from slipctl.block.units.unit_algebra import (
    checking_units,
    dimension_equal,
    factor,
    one,
    parse_quantity,
    unit,
)
from slipctl.block.units.unit_names import PLAIN, PREFIXED, PREFIXES
from slipctl.block.units.unit_walk import check
from slipctl.errors import BadInput

# ---- reading units ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "same_as", "ratio"),
    [
        ("N m", "J", 1.0),
        ("kg m^2", "kg m2", 1.0),
        ("m/s^2", "m s^-2", 1.0),
        ("m/s/s", "m/s^2", 1.0),
        ("m²/s⁴", "m2/s4", 1.0),
        ("m^.5/s^1.5", "m^(1/2) s^-1.5", 1.0),
        ("m s⁻¹", "m/s", 1.0),
        ("1", "rad", 1.0),
        ("(rad/s) / s", "1/s^2", 1.0),
        ("N m s/rad", "N m s", 1.0),
        ("1/(s m)", "s^-1 m**-1", 1.0),
        ("km/h", "m/s", 1000 / 3600),
        ("t", "kg", 1000.0),
        ("T", "kg/(A s^2)", 1.0),  # tesla, not tonne
        ("h", "s", 3600.0),
        ("Nm", "N m", 1.0),  # pint: a unit of yarn
        ("kNm", "N m", 1000.0),
        ("N/kN", "1", 1e-3),
        ("%", "1", 1e-2),
        ("rpm", "rad/s", 2 * math.pi / 60),
        ("kPa", "N/m^2", 1000.0),
        ("kWh", "J", 3.6e6),
        ("ohm", "V/A", 1.0),
    ],
)
def test_units_read_as_written(text, same_as, ratio):
    assert dimension_equal(text, same_as)
    assert factor(text, same_as) == pytest.approx(ratio, rel=1e-15)
    assert unit(text).same(unit(same_as)) == (ratio == 1.0)


BASE = {"meter": "m", "kilogram": "kg", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
        "candela": "cd"}  # fmt: skip


@pytest.mark.second
def test_every_name_and_prefix_agrees_with_pint():
    pint = pytest.importorskip("pint", reason="pint, which the table is compared with, is missing")
    registry = pint.UnitRegistry()
    names = {n: n for n in (*PLAIN, *PREFIXED)} | {f"{n}s": n for n in PLAIN if len(n) > 3}
    names |= {p + n: p + n for p in PREFIXES for n in PREFIXED if p + n not in PLAIN}
    for name in names.keys() - {"°", "hbar", "Btu", "Btus"}:  # Planck's constant; a rounded Btu
        base = registry.Quantity(1.0, name).to_base_units()
        dims = {BASE[n]: Fraction(e) for n, e in base._units.items() if n in BASE}
        found = unit(name)
        assert dict(found.dims) == dims, name
        assert found.scale == pytest.approx(base.magnitude, rel=1e-15), name
    assert factor("Btu", "J") == pytest.approx(1055.05585262, rel=1e-15)  # International Table
    assert factor("hbar", "Pa") == 1e7


def test_of_a_name_that_two_units_have_none_is_taken():
    for name in ("kt", "ton"):  # knot or kilotonne; of 2000 or 2240 pounds
        with pytest.raises(BadInput, match="cannot be read"):
            unit(name)


def test_a_unit_that_is_near_none_has_no_list_of_all():
    """What is near is asked for; else the line ends, where a list would have hundreds."""
    for name, near in (("Newton", "newton"), ("qqqq", "")):
        with pytest.raises(BadInput) as told:
            unit(name)
        assert len(str(told.value)) < 90
        assert ("did you mean" in str(told.value)) == bool(near)
        assert near in str(told.value)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "a pure number has the unit '1'"),
        ("n", "is no known unit"),
        ("2 kg", "the number 2 has no place"),
        ("m^x", "an exponent must be a number"),
        ("m^1000", "beyond reason"),
        ("(m", "a bracket is not closed"),
        ("m)", "has no place"),
        ("m/", "a name is missing at its end"),
        ("m;", "has no place"),
        ("m + s", "has no place"),
        ("__import__('os')", "has no place"),
        ("m/s m", "the blank before 'm'"),
        ("degC", "offset"),
        ("c", "speed of light"),
        ("k", "Boltzmann"),
        ("tons", "write t"),
        ("m " * 300, "too long"),
    ],
)
def test_what_is_no_unit_is_refused_in_one_line(text, why):
    with pytest.raises(BadInput) as error:
        unit(text)
    assert why in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 160


@given(st.text(max_size=12))
def test_any_text_is_a_unit_or_bad_input(text):
    with suppress(BadInput):
        assert unit(text).scale > 0


NAMES = ("m", "kg", "s", "N", "kN", "km", "h", "rad", "K", "W", "t", "%")
EXPONENTS = (Fraction(1), Fraction(2), Fraction(-1), Fraction(-2), Fraction(1, 2), Fraction(-3, 2))
UNITS = st.lists(st.tuples(st.sampled_from(NAMES), st.sampled_from(EXPONENTS)), max_size=4)


def made(parts):
    text = " ".join(f"{n}^{float(e)}" for n, e in parts) or "1"
    return unit(text)


@given(UNITS, UNITS)
def test_units_are_a_group_and_print_as_what_reads_back(a, b):
    a, b = made(a), made(b)
    assert ((a * b) / b).same(a)
    assert (a / b).same((b / a) ** Fraction(-1))
    assert ((a * b) ** Fraction(1, 2)).same(a ** Fraction(1, 2) * b ** Fraction(1, 2))
    assert unit(str(a)).same(a)
    if math.isclose((a * b).scale, 1.0):
        assert unit(str(a * b)).same(a * b)


def test_a_wire_between_units_of_one_dimension_knows_the_ratio():
    assert factor("km/h", "m/s") == 1000 / 3600
    assert factor("N m", "kg m^2/s^2") == 1.0
    with pytest.raises(BadInput, match="rad/s cannot be turned into m/s"):
        factor("rad/s", "m/s")


@pytest.mark.parametrize(
    ("source", "target", "exact"),
    [("atm", "bar", "1.01325"), ("bar", "atm", "4000/4053"), ("m", "yd", "1250/1143"),
     ("km/h", "m/s", "5/18"), ("m/s", "km/h", "3.6")],
)  # fmt: skip
def test_a_number_is_turned_by_the_ratio_that_is_meant_and_rounded_once(source, target, exact):
    for k in range(1, 400):
        assert parse_quantity(f"{k} {source}", target) == float(k * Fraction(exact))


def test_units_need_neither_casadi_nor_numpy():
    code = (
        "import sys, slipctl.block.units.unit_algebra as u\n"
        "u.unit('kg m^2'), u.parse_quantity('8.2t', 'kg'), u.parse_quantity('20 mph', 'm/s')\n"
        "assert not {'casadi', 'numpy'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# ---- quantities -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "wanted", "value"),
    [
        ("8.2t", "kg", 8200.0),
        ("1.005 t", "kg", 1005.0),  # 1.005 * 1000 in floats is 1004.9999999999999
        ("106.7kN", "N", 106700.0),
        ("20 kNm", "N m", 20000.0),
        ("20 km/h", "m/s", 50 / 9),
        ("36km/h", "m/s", 10.0),
        ("8200", "kg", 8200.0),
        ("1e-3", "s", 1e-3),
        ("1e-3 mm", "m", 1e-6),
        ("-.5", "1", -0.5),
        ("−2 m/s", "m/s", -2.0),
        ("50 %", "1", 0.5),
        ("300 rpm", "rad/s", 10 * math.pi),
        ("20 m^.5/s^1.5", "m^.5/s^1.5", 20.0),
        ("16 ms", "s", 0.016),
        ("3MWh", "J", 1.08e10),
        ("100 km/h", "km/h", 100.0),
    ],
)
def test_quantities(text, wanted, value):
    assert parse_quantity(text, wanted) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "wanted", "said"),
    [
        ("5 m", "kg", "car.m [kg] cannot be '5 m': [m] is another dimension"),
        ("8.2T", "kg", "kg/(A s^2)"),
        ("8,2t", "kg", "write a point for a comma"),
        ("heavy", "kg", "no number"),
        ("", "kg", "no number"),
        ("nan", "kg", "no number"),
        ("inf", "kg", "no number"),
        ("1e999", "kg", "too large"),
        ("1e5e5", "kg", "no number"),
        ("1 2", "kg", "no number"),
        ("--3", "kg", "no number"),
        ("8.2ton", "kg", "write t"),
        ("20 degC", "K", "offset"),
        ("3c", "m/s", "speed of light"),
        ("3 parsnips", "kg", "no known unit"),
        ("x" * 500, "kg", "no number"),
    ],
)
def test_bad_quantities_are_refused_in_one_line_that_names_parameter_and_unit(text, wanted, said):
    with pytest.raises(BadInput) as error:
        parse_quantity(text, wanted, "car.m")
    line = str(error.value)
    assert line.startswith(f"car.m [{wanted}]")
    assert said in line
    assert "\n" not in line
    assert len(line) < 160


SAME_KIND = [("kg", ("kg", "t", "g", "lb")), ("m/s", ("m/s", "km/h", "mph")), ("N", ("kN", "MN"))]


# subnormal numbers have fewer digits than the tolerance asks for
NUMBERS = st.floats(-1e12, 1e12).filter(lambda v: v == 0 or abs(v) > 1e-290)


@given(NUMBERS, st.sampled_from([(w, g) for w, gs in SAME_KIND for g in gs]))
def test_a_written_quantity_reads_back(value, pair):
    wanted, given_unit = pair
    read = parse_quantity(f"{value!r} {given_unit}", wanted)
    assert read == pytest.approx(value * factor(given_unit, wanted), rel=4e-16, abs=5e-324)
    assert parse_quantity(repr(read), wanted) == read


@given(st.text(max_size=12))
def test_any_text_is_a_quantity_or_bad_input(text):
    with suppress(BadInput):
        assert math.isfinite(parse_quantity(text, "kg"))


# ---- equations --------------------------------------------------------------------------------

LETTERS = {
    "v": "m/s", "omega": "rad/s", "T_b": "N m", "mu": "1", "m": "kg", "J": "kg m^2", "r": "m",
    "g": "m/s^2", "k1": "m^.5/s^1.5", "R": "m",
}  # fmt: skip


@pytest.fixture
def s():
    return {n: ca.SX.sym(n) for n in LETTERS}


def wheel(v, omega, T_b, mu, m, J, r, g, arm=1):
    F_a = mu * m * g
    v_s = v - r * omega
    torque = r * F_a if arm else r * mu
    return {"v'": -F_a / m, "omega'": (torque - T_b) / J, "v_s": v_s}


WANTED = {"v'": "(m/s) / s", "omega'": "(rad/s) / s", "v_s": "m/s"}


def traced(s, **options):
    def body():
        return wheel(**{k: v for k, v in s.items() if k not in ("k1", "R")}, **options)

    with formula.letters(body.__code__) as names:
        equations = body()
    return equations, names


def test_the_wheelset_passes(s):
    equations, names = traced(s)
    assert check(equations, LETTERS, WANTED, names) == []


def test_a_metre_that_meets_a_newton_is_told_in_the_letters_of_the_paper(s):
    equations, names = traced(s, arm=0)
    assert check(equations, LETTERS, WANTED, names) == [
        "in omega' = (torque - T_b)/J: 'T_b' [N m] cannot be subtracted from 'torque' [m]"
    ]
    assert check(equations, LETTERS, WANTED) == [
        "in omega' = (r*mu - T_b)/J: 'T_b' [N m] cannot be subtracted from 'r*mu' [m]"
    ]


def test_a_rate_wants_the_unit_per_second(s):
    found = check({"v'": s["v"]}, LETTERS, {"v'": "(m/s) / s"})
    assert found == ["in v' = v: this is [m/s], not [m/s^2]"]
    assert check({"v+": s["v"]}, LETTERS, {"v+": "(m/s)"}) == []


def test_an_error_in_an_intermediate_result_is_told_once_where_it_is_written(s):
    def body():
        F = s["m"] * s["g"] + s["v"]
        return {"a": F / s["m"], "b": s["r"] * F}

    with formula.letters(body.__code__) as names:
        equations = body()
    assert check(equations, LETTERS, {"a": "m/s^2", "b": "N m"}, names) == [
        "in F = m*g + v: 'm*g' [N] cannot be added to 'v' [m/s]"
    ]


@pytest.mark.parametrize(
    ("make", "passes"),
    [
        (lambda s: ca.fmin(s["v"], ca.inf), True),
        (lambda s: ca.fmax(s["v"], 0), True),
        (lambda s: ca.fmax(s["v"], 3), False),
        (lambda s: ca.fmin(s["v"], s["r"] * s["omega"]), True),
        (lambda s: ca.fmin(s["v"], s["omega"]), False),
        (lambda s: s["v"] + 0, True),
        (lambda s: s["v"] + 1, False),
        (lambda s: ca.exp(s["mu"]), True),
        (lambda s: ca.exp(s["v"]), False),
        (lambda s: ca.log(s["v"] / one("m/s")), True),
        (lambda s: ca.sin(s["omega"] * one("s")), True),
        (lambda s: ca.sin(s["omega"]), False),
        (lambda s: ca.sign(s["v"]) * s["mu"], True),
        (lambda s: ca.floor(s["r"]), False),
        (lambda s: ca.floor(s["r"] / s["R"]) * s["R"], True),
        (lambda s: ca.fmod(s["r"], s["R"]), True),
        (lambda s: ca.fmod(s["r"], 2 * math.pi), False),
        (lambda s: ca.copysign(s["v"], s["T_b"]), True),
        (lambda s: ca.if_else(s["v"] > 0, s["mu"], 0.3), True),
        (lambda s: ca.if_else(s["v"] > 1, s["mu"], 0.3), False),
        (lambda s: ca.if_else(s["v"] > s["r"] * s["omega"], s["v"], 0), True),
        (lambda s: ca.if_else(s["mu"] > 0, s["v"], s["omega"]), False),
        (lambda s: ca.if_else(s["mu"] > 0, s["v"], ca.if_else(s["mu"] > 1, 0, s["r"])), False),
        (lambda s: s["mu"] ** s["mu"], True),
        (lambda s: s["v"] ** s["mu"], False),
        (lambda s: s["mu"] ** s["v"], False),
        (lambda s: s["v"] ** 0.3 * s["v"] ** 0.7 + s["v"], True),
        (lambda s: s["v"] ** (1 / 3) + s["v"], False),
        (lambda s: ca.hypot(s["v"], s["r"] * s["omega"]) + s["v"], True),
        (lambda s: ca.atan2(s["v"], s["r"] * s["omega"]) + 1, True),
        (lambda s: ca.atan2(s["v"], s["omega"]), False),
        (lambda s: ca.logic_and(s["v"] > 0, s["r"] <= s["R"]) + 1, True),
        (lambda s: 3.6 * s["v"] * one("km/h/(m/s)") + one("km/h"), True),
        (lambda s: 3.6 * s["v"] + one("km/h"), False),  # of one dimension, but not of one unit
        (lambda s: s["k1"] * ca.sqrt(ca.fabs(s["v"])) * ca.sign(s["v"]) + s["g"], True),
        (lambda s: ca.sqrt(ca.fabs(s["v"])) + s["v"], False),
        (lambda s: ca.sqrt(ca.fabs(s["v"])) + s["v"] * one("s^.5/m^.5"), True),
        (lambda s: ca.norm_2(ca.vertcat(s["v"], s["r"] * s["omega"])), True),
        (lambda s: ca.sum1(ca.vertcat(s["v"], s["r"])), False),
    ],
)
def test_operations(s, make, passes):
    with checking_units():
        found = check({"y": make(s)}, LETTERS, {})
    assert (found == []) is passes, found
    assert all(f.startswith("in y = ") for f in found)


def test_a_literal_is_told_how_to_get_a_unit(s):
    (line,) = check({"y": s["v"] + 1.5}, LETTERS, {"y": "m/s"})
    assert line == (
        "in y = v + 1.5: 'v' [m/s] cannot be added to '1.5' [1];"
        " give the number its unit, as a Param or by one('...')"
    )


def test_curve_resistance_hides_newton_per_kilonewton():
    R, m, g = (ca.SX.sym(n) for n in ("R", "m", "g"))
    with checking_units() as hidden:
        right = 600 * one("m N/kN", "curve resistance 600/R") / R * m * g / 1000 / one("N/kN")
        wrong = 600 / R * m * g / 1000
        equations = {"right": right, "wrong": wrong}
        found = check(equations, {"R": "m", "m": "kg", "g": "m/s^2"}, {"right": "N", "wrong": "N"})
    assert [line.split(" = ")[0] for line in found] == ["in wrong"]
    assert {k: doc for k, (_, doc) in hidden.items()} == {
        "m N/kN": "curve resistance 600/R",
        "N/kN": "",
    }


def test_one_is_the_number_one_outside_the_check():
    assert one("m^.5/s^.5") == 1.0
    with checking_units():
        assert one("m/s").name() == "one[m/s]"
        assert one("m/s") is one("m/s")
        with pytest.raises(BadInput, match="no known unit"):
            one("furlongsss")
    assert one("m/s") == 1.0


def test_vectors_are_checked_element_by_element_and_told_once(s):
    theta = ca.SX.sym("theta", 3)
    known = LETTERS | {"theta": "m/s"}
    good = ca.vertcat(s["v"], theta[1], 0)
    bad = ca.vertcat(s["v"], s["r"], s["m"] + theta[2], s["g"])
    assert check({"y": good}, known, {"y": "m/s"}) == []
    assert check({"y": bad}, known, {"y": "m/s"}) == ["in y = r: this is [m], not [m/s]"]
    assert check({"P": theta @ theta.T}, known, {"P": "m^2/s^2"}) == []


def test_an_error_in_an_output_that_other_equations_use_is_told_there(s):
    def body():
        v_s = s["v"] - s["omega"]
        return {"x'": s["r"] * v_s, "v_s": v_s}

    with formula.letters(body.__code__) as names:
        equations = body()
    assert check(equations, LETTERS, {"v_s": "m/s"}, names) == [
        "in v_s = v - omega: 'omega' [rad/s] cannot be subtracted from 'v' [m/s]"
    ]


def test_a_derived_parameter_may_share_its_name_with_an_output(s):
    equations = {"q": s["v"] + s["r"], "q =": s["v"] * s["m"]}
    assert check(equations, LETTERS, {"q": "m/s", "q =": "kg"}) == [
        "in q = v + r: 'v' [m/s] cannot be added to 'r' [m]",
        "in q = v*m: this is [N s], not [kg]",
    ]


def test_a_symbol_without_a_unit_is_bad_input(s):
    with pytest.raises(BadInput, match="'v' of an equation has no unit"):
        check({"y": s["v"]}, {}, {})


def test_long_equations_are_cut_and_deep_ones_do_not_explode(s):
    z = s["v"]
    for _ in range(200):
        z = z + ca.fmin(z, s["v"]) * s["mu"]
    found = check({"y": z + s["r"]}, LETTERS, {"y": "m/s"})
    assert len(found) == 1
    assert "'r' [m]" in found[0]
    assert len(found[0]) < 250


def test_messages_do_not_change_from_run_to_run(s):
    equations = {"a": s["v"] + s["r"], "b": s["v"] * s["r"] + s["g"], "c": ca.exp(s["v"])}
    assert check(equations, LETTERS, {}) == check(equations, LETTERS, {})


class Builder:
    """Grows expressions whose units fit, over symbols that it declares as it goes."""

    def __init__(self, choose):
        self.choose = choose
        self.given = {}
        self.pool = [self.symbol(u) for u in ("m/s", "km/h", "N m", "kg", "rad/s", "%")]

    def symbol(self, text):
        name = f"q{len(self.given)}"
        self.given[name] = str(unit(text))
        return ca.SX.sym(name), self.given[name]

    def grow(self, spoil=""):
        (a, u), (b, w) = self.choose(self.pool), self.choose(self.pool)
        other = b * self.symbol(f"({u})/({w})")[0]
        if spoil:
            other = other * self.symbol(spoil)[0]
        both = {
            "add": lambda: (a + other, u),
            "sub": lambda: (a - other, u),
            "fmin": lambda: (ca.fmin(a, other), u),
            "if": lambda: (ca.if_else(a > 0, a, other), u),
            "less": lambda: ((a < other) * b, w),
            "exp": lambda: (ca.exp(-other / a), "1"),
        }
        single = {
            "mul": lambda: (a * b, f"({u})*({w})"),
            "div": lambda: (a / (b * self.symbol("1")[0]), f"({u})/({w})"),  # a/a would be 1
            "sqrt": lambda: (ca.sqrt(ca.fabs(a)), f"({u})^.5"),
            "inv": lambda: (1 / a, f"1/({u})"),
            "twice": lambda: (2 * a, u),
        }
        made, text = self.choose(list((both if spoil else both | single).values()))()
        self.pool.append((made, str(unit(text))))
        return made


@given(st.data())
def test_random_equations_that_fit_pass_and_one_misfit_is_found(data):
    def choose(items):
        return items[data.draw(st.integers(0, len(items) - 1))]

    build = Builder(choose)
    for _ in range(data.draw(st.integers(1, 8))):
        build.grow()
    y, wanted = build.pool[-1]
    assert check({"y": y}, build.given, {"y": wanted}) == []
    spoiled = build.grow(choose(["m^.5", "km", "s", "N", "%"]))
    build.pool.pop()
    build.grow()
    found = check({"y": spoiled * build.pool[-1][0]}, build.given, {})
    assert len(found) == 1


@pytest.mark.parametrize("text", ["1/min", "min^-1", "Hz", "kHz", "1/h"])
def test_a_count_is_no_angular_speed(text: str) -> None:
    """A wheel speed in 1/min is one of revolutions, or of radians: off by 2 pi if it is guessed."""
    with pytest.raises(BadInput, match="may count revolutions or radians"):
        factor(text, "rad/s")
    with pytest.raises(BadInput, match="may count revolutions or radians"):
        parse_quantity(f"2 {text}", "rad/s")
    assert factor("rpm", "rad/s") == pytest.approx(2 * math.pi / 60, rel=1e-15)
    assert factor("1/s", "rad/s") == 1.0
    assert factor(text, "1/s") > 0


@pytest.mark.parametrize(("text", "wanted"), [("Ns/m", "N s"), ("kNs", "kN s")])
def test_two_units_without_a_blank_are_told_as_two(text: str, wanted: str) -> None:
    name = wanted.replace(" ", "")
    with pytest.raises(BadInput, match=f"'{name}' is no known unit; write '{wanted}'"):
        unit(text)
