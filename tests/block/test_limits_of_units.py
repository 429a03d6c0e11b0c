"""Numbers of units: how forces are shown, what a rate counts, how large a unit may be."""

from __future__ import annotations

from fractions import Fraction

import pytest

from slipctl import BadInput, Input, Output, Param, State, connect, flow, gated, law, step
from slipctl.block.transforms.adaptors import ratio_to_speed, speed_to_ratio
from slipctl.block.transforms.distance import over_distance
from slipctl.block.units.unit_algebra import (
    Unit,
    display_scale,
    factor,
    says_what_counts,
    si_text,
    split_quantity,
    unit,
)


@pytest.mark.parametrize(
    ("text", "scale", "shown"),
    [("N", 1e-3, "kN"), ("N m", 1e-3, "kN m"), ("N m/s", 1e-3, "kN m/s"), ("N/s", 1e-3, "kN/s"),
     ("m/s", 1.0, "m/s"), ("N s", 1.0, "N s"), ("kN", 1.0, "kN")],
)  # fmt: skip
def test_forces_and_torques_are_shown_in_thousands(text, scale, shown):
    assert display_scale(text) == (scale, shown)


@pytest.mark.parametrize(
    ("text", "said", "so"),
    [
        ("1/min", "rpm", True), ("1/min", "rad/min", True), ("1/min", "rad/s", False),
        ("1/min", "turn/s", False), ("Hz", "turn/s", True), ("Hz", "rad/s", True),
        (" 1/min ", " U/min", True), ("1/min", "1/min", False), ("rpm", "rpm", False),
        ("rpm", "rad/s", False), ("1/min", "m/s", False), ("m/s", "rad/s", False),
        ("1/s", "deg/s", False),
    ],
)  # fmt: skip
def test_a_unit_may_say_what_a_rate_counts(text, said, so):
    assert says_what_counts(text, said) == so


@pytest.mark.parametrize(
    ("text", "si"),
    [("kN", "N"), ("km/h", "m/s"), ("N m", "N m"), ("t m^2", "kg m^2"), ("%", "1"), ("1", "1"),
     ("kN s/m", "N s/m"), ("mm/s^2", "m/s^2"), ("J", "J"), ("kW", "W"), ("kg", "kg"), ("g", "kg"),
     ("km^.5/ms^1.5", "m^0.5/s^1.5"), ("A/ms", "A/s")],
)  # fmt: skip
def test_a_unit_has_one_in_si(text, si):
    assert si_text(text) == si
    assert unit(si).scale == 1.0
    assert unit(si).dims == unit(text).dims


@pytest.mark.parametrize(
    ("text", "fine"),
    [("km^49", True), ("km^50/yd", False), ("km^50 yd", True), ("mm^50/yd", True),
     ("mm^50 yd", False), ("mm^49", True)],
)  # fmt: skip
def test_a_unit_is_not_beyond_what_a_number_holds_when_squared(text, fine):
    """Of 1e150 and more, or 1e-150 and less, there is none; a yard is 0.91 m."""
    if fine:
        assert unit(text).scale > 0
    else:
        with pytest.raises(BadInput, match="is beyond what a number can hold"):
            unit(text)


@pytest.mark.parametrize(
    ("text", "same"),
    [("tonnes", "t"), ("minutes", "min"), ("litres", "l"), ("inches", "in"), ("miles", "mi"),
     ("dam", "m"), ("hPa", "mbar"), ("µm", "um"), ("dl", "l"), ("Gs", "s"), ("nF", "F")],
)  # fmt: skip
def test_names_have_plurals_and_prefixes(text, same):
    scales = {"dam": 10, "dl": 0.1, "Gs": 1e9, "nF": 1e-9}
    assert unit(text).dims == unit(same).dims
    assert unit(text).scale == pytest.approx(scales.get(text, 1) * unit(same).scale, rel=1e-15)
    for wrong in ("ts", "mins", "kts", "tonness"):
        with pytest.raises(BadInput, match="no known unit"):
            unit(wrong)


WRITTEN = [
    ("N m/(s^2 K)", "N m/(K s^2)"), ("kg m^2", "kg m^2"), ("m^.5/s^1.5", "m^0.5/s^1.5"),
    ("1/s", "1/s"), ("m^(1/3)", "m^(1/3)"), ("m/m", "1"), ("s m", "m s"), ("m/s/s", "m/s^2"),
    ("kg/(m s)", "kg/(m s)"), ("m**2", "m^2"), ("(N s)/m", "N s/m"), ("kNm s", "kN m s"),
    ("m^-1", "1/m"), ("(m/s)^2", "m^2/s^2"), ("(m/s)^(-1/2)", "s^0.5/m^0.5"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), WRITTEN)
def test_a_unit_is_written_as_it_was_said(text, said):
    """Its names in the order of the alphabet."""
    assert str(unit(text)) == said
    assert unit(said).same(unit(text))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (unit("kg") * unit("m/s^2"), "N"), (unit("kN") * unit("m/s"), "kW"),
        (unit("N") * unit("s"), "N s"), (unit("km/h") * unit("s"), "0.277778 m"),
        (unit("N m") / unit("s"), "W"), (unit("m") / unit("km"), "0.001 1"),
        (unit("kg") / unit("A"), "kg/A"), (unit("m^2") * unit("kg"), "kg m^2"),
        (unit("s") * unit("K") / unit("A"), "K s/A"), (unit("m") ** Fraction(1, 2), "m^0.5"),
        (unit("km") / unit("s") / unit("s"), "1000 m/s^2"), (unit("h") / unit("m") * unit("m"),
         "h"), (unit("V") / unit("A"), "kg m^2/(A^2 s^3)"),
    ],
)  # fmt: skip
def test_a_unit_out_of_algebra_has_its_usual_name(made, said):
    assert str(made) == said


def test_units_are_one_by_scale_and_dimension():
    assert unit("N m").same(unit("J"))
    assert not unit("N m").same(unit("N"))
    assert not Unit(1.0 + 1e-8, ()).same(Unit(1.0, ()))
    assert Unit(1.0, ()).plain
    assert not Unit(1.0 + 1e-8, ()).plain
    assert not unit("m").plain
    assert split_quantity(" 8.2 t ") == ("8.2", "t")
    assert split_quantity("−3e2") == ("-3e2", None)
    with pytest.raises(BadInput, match="'t' is no number with a unit"):
        split_quantity("t")


@law(W=Output("J", "work"))
def lifts(E=Param("N m", 2.0, "energy"), u=Input("1")):
    return E * u


@law(W=Output("J", "work"))
def falls(E=Param("J", 2.0, "energy"), u=Input("1")):
    return E * u


def test_a_number_is_shared_by_two_units_that_are_one():
    """Not by N m and kN m."""
    pair = connect("pair", {}, a=lifts, b=falls, share={"E": ["a.E", "b.E"]})
    assert pair.with_params(E=3.0).param_values()["E"] == 3.0

    @law(W=Output("kN m", "work"))
    def heavy(E=Param("kN m", 2.0, "energy"), u=Input("1")):
        return E * u

    with pytest.raises(BadInput, match=r"b\.E is in kN m, a\.E in\s+N m; write both in one unit"):
        connect("pair", {}, a=lifts, b=heavy, share={"E": ["a.E", "b.E"]})
    assert factor("kN m", "N m") == 1000


@step(0.1, y=Output("1"))
def counts(u=Input("1")):
    return {}, {"y": 2 * u}


@pytest.mark.parametrize(("gate", "y"), [(0.48, 0.0), (0.52, 6.0), (1.0, 6.0), (0.0, 0.0)])
def test_a_gate_is_open_above_one_half(gate, y):
    assert float(gated(counts, "on")(u=3.0, on=gate)[1]["y"]) == y


@flow()
def car(v=State("m/s", 20.0, "speed"), x=State("m", 0.0, "way"), a=Input("m/s^2", "demand")):
    return dict(v=a, x=v), {}


def test_least_speeds_of_a_ratio_and_of_a_way():
    for block in (ratio_to_speed(), speed_to_ratio()):
        least = block.params["v_min"]
        assert (least.value, least.lo, least.hi) == (1.0, 1e-3, 1000)
    rates, _ = over_distance(car)(v=0.05, x=0.0, clock=0.0, a=2.0)
    assert float(rates["clock"]) == 10.0
    assert float(rates["v"]) == 20.0
