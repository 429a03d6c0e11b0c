"""One number of several parts: every door, every depth, against loops without any share."""

import re

import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Scenario,
    State,
    c_module,
    connect,
    every,
    flow,
    gated,
    replicate,
    sampled,
    simulate,
    step,
)
from slipctl.block.shared_numbers import differences
from slipctl.block.transforms.discretisation import check_sample_times

H = 1e-3


@flow(v_s=Output("m/s", "slip speed"), a=Output("m/s^2", "deceleration"))
def wheel(
    v=State("m/s", 20.0, "speed", lo=0),
    omega=State("rad/s", "v / r", "wheel speed"),
    T=Input("N m", "torque"),
    m=Param("kg", 8000.0, "mass", "Table 3", lo=1000, hi=40000),
    J=Param("kg m^2", 240.0, "inertia", lo=1),
    r=Param("m", 0.5, "radius", lo=0.2, hi=1),
):
    """A wheel."""
    a = T / (r * m)
    return dict(v=-a, omega=(0.9 * r * m * a - T) / J), dict(v_s=v - r * omega, a=a)


@step(period=H, T=Output("N m", "torque"), v_m=Output("m/s", "filtered speed"))
def law(
    v_h=State("m/s", 3.0, "speed estimate"),
    seen=State("rad/s", "omega_start", "wheel speed of the last tick"),
    v_s=Input("m/s", "slip speed"),
    v=Input("m/s", "speed"),
    omega=Input("rad/s", "wheel speed"),
    m=Param("kg", 5000.0, "mass", lo=2000, hi=50000),
    J=Param("kg m^2", 100.0, "inertia"),
    T_f=Param("s", 0.01, "lag", lo=1e-4),
    gain=Param("1/s", "1 / T_f", "of the filter"),
    omega_start=Param("rad/s", 1.0, "wheel speed at the start"),
):
    """A law that holds copies of the wheel's numbers."""
    nxt = dict(v_h=v_h + 1e-3 * gain * (v - v_h), seen=omega)
    return nxt, dict(T=m * (1 - v_s) + J * (omega - seen) + 10 * v_h, v_m=v_h)


WIRES = {
    "ctl.v_s": "plant.wheel.v_s", "ctl.v": "plant.wheel.v", "ctl.omega": "plant.wheel.omega",
    "plant.wheel.T": "ctl.a.T",
}  # fmt: skip
INNER = {f"{b}.{n}": n for b in "ab" for n in ("v_s", "v", "omega")}
PLACES = {
    "m": ("plant.wheel.m", "ctl.a.m", "ctl.b.m"),
    "J": ("plant.wheel.J", "ctl.a.J", "ctl.b.J"),
    "v_start": ("plant.wheel.v", "ctl.a.v_h", "ctl.b.v_h"),
    "omega_start": ("plant.wheel.omega", "ctl.a.omega_start", "ctl.b.omega_start"),
}


def no_mass(
    v=State("m/s", 20.0), omega=State("rad/s", 40.0), T=Input("N m"), J=Param("kg m^2", 240.0),
    r=Param("m", 0.5),
):  # fmt: skip
    """A wheel that says no mass."""
    return dict(v=0 * v, omega=T / J), dict(v_s=v - r * omega, a=0 * v)


def shared(slow: int = 1):
    plant = sampled(connect("plant", {}, wheel=wheel), H)
    ctl = connect(
        "ctl", INNER, a=law, b=law,
        share={"m": "*.m", "v_start": ["a.v_h", "b.v_h"],
               "omega_start": ["a.omega_start", "b.omega_start"]},
    )  # fmt: skip
    return connect(
        "loop", WIRES, plant=plant, ctl=every(ctl, 1) if slow else ctl,
        share={
            "m": ["plant.wheel.m", "*.m"],
            "J": ["plant.wheel.J", "*.J"],
            "r": ["plant.wheel.r"],
            "v_start": ["plant.wheel.v", "ctl.v_start"],
            "omega_start": ["plant.wheel.omega", "ctl.omega_start"],
        },
    )  # fmt: skip


def by_hand(slow: int = 1, **numbers: float):
    """The same loop without a share, every place set; nothing here knows of sharing."""
    full = {"m": 8000.0, "J": 240.0, "v_start": 20.0} | numbers
    full.setdefault("omega_start", full["v_start"] / full.get("r", 0.5))
    plant = sampled(connect("plant", {}, wheel=wheel), H)
    ctl = connect("ctl", INNER, a=law, b=law)
    loop = connect("loop", WIRES, plant=plant, ctl=every(ctl, 1) if slow else ctl)
    values = {place: full[k] for k, places in PLACES.items() for place in places}
    return loop.with_params(**values, **({"plant.wheel.r": full["r"]} if "r" in full else {}))


def same(a, b, scenario: Scenario | None = None) -> None:
    scenario = scenario or Scenario("s", 0.05)
    one, two = (simulate(x, scenario, compile=False) for x in (a, b))
    assert set(one.data_vars) == set(two.data_vars)
    for n in one.data_vars:
        # a few roundings: equal numbers meet in one expression instead of two
        np.testing.assert_allclose(one[n].values, two[n].values, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("slow", [0, 1])
@pytest.mark.parametrize(
    "numbers",
    [{}, {"m": 9000.0}, {"J": 200.0, "r": 0.4}, {"v_start": 26.0}, {"omega_start": 35.0},
     {"v_start": 14.0, "m": 6000.0, "omega_start": 20.0}],
)  # fmt: skip
def test_one_setting_reaches_every_place(numbers, slow):
    same(shared(slow).with_params(**numbers), by_hand(slow, **numbers))


def test_the_rule_is_the_same_at_every_door():
    told = by_hand(m=9000.0, v_start=25.0)
    doors = [
        shared().with_params(m=9000.0, **{"wheel.v": 25.0}),
        shared().with_params(**{"*.m": 9000.0, "plant.wheel.v": 25.0}),
        shared().with_params(v_start=25.0).with_params(m=9000.0),
    ]
    for loop in doors:
        same(loop, told)
    runs = [
        Scenario("s", 0.05, params={"m": 9000.0}, start={"plant.wheel.v": 25.0}),
        Scenario("s", 0.05, params={"*.m": 9000.0, "v_start": 25.0}),
        Scenario("s", 0.05, params={"m": 9000.0}, start={"wheel.v": 25.0}),
    ]
    for scenario in runs:
        log = simulate(shared(), scenario, compile=False)
        wanted = simulate(told, Scenario("s", 0.05), compile=False)
        assert log["ctl.a.T"].values == pytest.approx(wanted["ctl.a.T"].values, rel=1e-11)


def test_a_full_path_is_a_deliberate_difference():
    loop = shared().with_params(**{"plant.wheel.m": 8800.0})
    assert differences(loop) == {"plant.wheel.m": "m"}
    values = by_hand().with_params(**{"plant.wheel.m": 8800.0})
    same(loop, values)
    # the order does not matter, and what is left of the share still moves together
    for other in (
        loop.with_params(m=9000.0),
        shared().with_params(m=9000.0).with_params(**{"plant.wheel.m": 8800.0}),
        shared().with_params(**{"plant.wheel.m": 8800.0, "m": 9000.0}),
    ):
        same(other, by_hand(m=9000.0).with_params(**{"plant.wheel.m": 8800.0}))
    deep = shared().with_params(**{"ctl.b.m": 7000.0})
    assert differences(deep) == {"ctl.b.m": "m"}
    same(deep, by_hand().with_params(**{"ctl.b.m": 7000.0}))
    whole = shared().with_params(**{"ctl.m": 7000.0})
    same(whole, by_hand().with_params(**{"ctl.a.m": 7000.0, "ctl.b.m": 7000.0}))


def test_an_estimator_may_begin_elsewhere_and_the_plant_may_not_leave_it_behind():
    loop = shared().with_params(**{"ctl.a.v_h": 19.0})
    assert differences(loop) == {"ctl.a.v_h": "v_start"}
    same(loop, by_hand().with_params(**{"ctl.a.v_h": 19.0}))
    moved = loop.with_params(**{"plant.wheel.v": 30.0})
    start = {k: float(v) for k, v in moved.start().items()}
    assert (start["plant.wheel.v"], start["ctl.a.v_h"], start["ctl.b.v_h"]) == (30.0, 19.0, 30.0)
    assert start["plant.wheel.omega"] == start["ctl.b.seen"] == 60.0
    asked = {k: float(v) for k, v in shared().start(**{"plant.wheel.v": 30.0}).items()}
    assert asked["ctl.a.v_h"] == 30.0
    assert asked["ctl.a.seen"] == 60.0
    x, _, _ = shared().point(**{"plant.wheel.v": 30.0})
    assert float(x["ctl.b.v_h"]) == 30.0
    assert float(x["plant.wheel.omega"]) == 60.0


@pytest.mark.parametrize("name", ["wheel.m", "plant.*.m", "ctl.*.m", "a.v_h", "b.omega_start"])
def test_what_meets_only_some_places_is_refused_with_both_spellings(name):
    with pytest.raises(BadInput, match=r"matches \d of the 3 places of \w+; write \w+= .* or \S+="):
        shared().with_params(**{name: 3000.0})
    with pytest.raises(BadInput, match=r"matches \d of the 3 places"):
        simulate(shared(), Scenario("s", 0.05, params={name: 3000.0}), compile=False)


def test_a_rail_does_not_set_one_place_alone():
    from slipctl import Rail, Section

    rail = Rail([Section(0, values={"plant.wheel.m": 9000.0})])
    with pytest.raises(BadInput, match=r"plant.wheel.m.*shared as m"):
        simulate(shared(), Scenario("s", 0.05, rail), compile=False)


def test_a_part_that_is_swapped_in_joins():
    heavy = law.with_params(m=3000.0, T_f=0.02)
    loop = shared().with_params(m=9000.0).swap("ctl.a", heavy)
    assert loop.param_values()["m"] == 9000.0
    assert loop["ctl.a"].param_values()["m"] == 9000.0
    assert loop.param_values()["ctl.a.T_f"] == 0.02  # what it shares with nobody is its own
    first = shared().with_params(m=9000.0).swap("plant.wheel", wheel.with_params(m=2000.0))
    assert first.param_values()["m"] == 9000.0
    kept = shared().with_params(**{"ctl.b.m": 7000.0}).swap("ctl.a", heavy)
    assert differences(kept) == {"ctl.b.m": "m"}
    with pytest.raises(BadInput, match=r"names plant.wheel.m, but plant has no 'wheel.m'"):
        shared().swap("plant.wheel", flow(v_s=Output("m/s"), a=Output("m/s^2"))(no_mass))


def test_parts_know_their_number():
    loop = shared().with_params(m=9000.0, **{"wheel.v": 30.0})
    assert loop["ctl"].param_values()["m"] == 9000.0
    assert float(loop["ctl"].start()["b.v_h"]) == 30.0
    assert float(loop["plant"].start()["wheel.omega"]) == 60.0


def test_a_number_computed_from_shared_ones():
    @step(period=H, T=Output("N m", "torque"))
    def motor_law(
        e=Input("m/s", "error"),
        J_w=Param("kg m^2", 1.0, "inertia at the wheel"),
        T_half=Param("N m", 2.0, "half the torque"),
    ):
        """A law in numbers of the wheel."""
        return dict(), dict(T=J_w * e + T_half)

    @step(period=H, e=Output("m/s", "error"))
    def motor(
        J=Param("kg m^2", 40.0, "inertia"), R_g=Param("1", 6.0, "gear"), T_max=Param("N m", 12e3),
    ):  # fmt: skip
        """A motor."""
        return dict(), dict(e=0.1 * J / 40 + R_g + T_max)

    loop = connect(
        "loop", {"law.e": "motor.e"}, motor=motor, law=motor_law,
        share={"J": "motor.J", "R_g": "motor.R_g", "J_w = J * R_g**2": "law.J_w",
               "T_half = T_max / 2": "law.T_half", "T_max": "motor.T_max"},
    ).with_params(J=50.0)  # fmt: skip
    assert loop.param_values()["J_w"] == 1800.0
    assert loop.param_values()["T_half"] == 6000.0
    assert loop["law"].param_values()["J_w"] == 1800.0
    with pytest.raises(BadInput, match=r"J_w is derived, J . R_g..2; set J or R_g"):
        loop.with_params(J_w=3.0)
    apart = loop.with_params(**{"law.J_w": 3.0})
    assert differences(apart) == {"law.J_w": "J_w"}
    assert float(apart.param_values()["law.J_w"]) == 3.0


def test_copies_share_one_number():
    many = replicate(connect("axle", {}, w=wheel), 3, distinct=["w.J"])
    loop = connect(
        "l", {}, axle=sampled(many, H), b=law,
        share={"J": ["b.J", "axle.w.J"], "m": ["axle.w.m", "b.m"]},
    ).with_params(J=200.0)  # fmt: skip
    assert loop.param_values()["J"].shape == ()
    assert list(loop["axle"].param_values()["w.J"]) == [200.0] * 3
    uneven = loop.with_params(**{"axle.w.J": [1.0, 2.0, 3.0]})
    assert list(uneven.param_values()["axle.w.J"]) == [1.0, 2.0, 3.0]
    assert uneven.param_values()["b.J"] if "b.J" in uneven.params else True


@pytest.mark.parametrize(
    ("share", "words"),
    [
        ({"m": ["plant.wheel.m", "ctl.x"]}, "share 'm' names ctl.x, but ctl has no 'x'"),
        ({"m": ["plant.wheel.m", "ctr.m"]}, "there is no part 'ctr'; did you mean 'ctl'"),
        ({"m": ["plant.wheel.m", "ctl.J"]}, r"ctl.J is in kg m\^2, plant.wheel.m in kg; write"),
        ({"m": ["plant.wheel.J", "ctl.gain"]}, "ctl.gain is in 1/s"),
        ({"t": ["ctl.gain", "ctl.T_f"]}, "ctl.T_f, which is not shared|ctl.T_f is in s"),
        ({"m": ["plant.wheel.m", "ctl.m"], "n": "ctl.m"}, "ctl.m is shared as m and as n"),
        ({"q = 2 * k": ["ctl.m"]}, "share 'q' = '2 . k' uses 'k'"),
        ({"ctl": ["ctl.m"]}, "'ctl' is a part and a shared number; rename one"),
        ({"m": 3}, "write 'm': .'car.m', 'ctl.m'."),
        ({"omega": ["plant.wheel.omega", "ctl.omega_start"]}, "uses plant.wheel.r, which is not"),
        (law, "a part cannot be named share"),
    ],
)
def test_shares_that_cannot_be_are_refused_in_one_line(share, words):
    with pytest.raises(BadInput, match=words) as told:
        connect("loop", {}, share=share, plant=sampled(connect("p", {}, wheel=wheel), H), ctl=law)
    assert "\n" not in str(told.value)


def test_ranges_without_a_common_number_are_refused():
    @step(period=H)
    def other(m=Param("kg", 60e3, lo=50e3)):
        """Too heavy."""
        return dict(), dict()

    with pytest.raises(BadInput, match="no number is in both ranges"):
        connect("l", {}, share={"m": "*.m"}, a=sampled(wheel, H), b=other)
    loop = shared()
    assert (loop.params["m"].lo, loop.params["m"].hi) == (2000, 40000)
    with pytest.raises(BadInput, match="out of range"):
        loop.with_params(m=45e3)
    assert loop.params["m"].source == "Table 3"


def test_c_has_one_member_and_computes_the_start_of_all(tmp_path, needs_compiler):
    ctl = connect(
        "ctl", INNER, a=law, b=law,
        share={"m": "*.m", "v_start": ["a.v_h", "b.v_h"],
               "omega_start": ["a.omega_start", "b.omega_start"]},
    )  # fmt: skip
    c = c_module(ctl, tmp_path).compile().load()
    header = (tmp_path / "ctl.h").read_text()
    assert len(re.findall(r"\bm;", header)) == 1
    assert "a_m" not in header
    changed = {"m": 9000.0, "v_start": 30.0, "omega_start": 55.0}
    c.reset(**changed)
    python = ctl.with_params(**changed)
    inputs = {"v_s": 0.1, "v": 29.0, "omega": 54.0}
    _, y = python(**inputs)
    assert c.step(**inputs) == pytest.approx(y, rel=1e-15)


def test_a_start_follows_its_own_radius_where_that_was_set_apart():
    """The wheel rolls at the start, v/r with the radius that it has; v still moves it."""
    loop = shared().with_params(**{"plant.wheel.r": 0.4})
    assert float(loop.start()["plant.wheel.omega"]) == 20.0 / 0.4
    both = connect(
        "l", {}, wheel=sampled(wheel, H), b=law,
        share={"r": ["wheel.r"], "v_start": "wheel.v",
               "omega_start": ["wheel.omega", "b.omega_start"], "J": "*.J"},
    )  # fmt: skip
    outer = connect(
        "o", {}, l=both, c=law,
        share={"r": "l.r", "J": "*.J", "v_start": "l.v_start",
               "omega_start": ["l.omega_start", "c.omega_start"]},
    ).with_params(**{"l.wheel.r": 0.25})  # fmt: skip
    for v in (20.0, 30.0):
        start = outer.with_params(**{"wheel.v": v}).start()
        assert [float(start[n]) for n in ("l.wheel.omega", "l.b.seen", "c.seen")] == [v / 0.25] * 3


def test_a_start_follows_its_own_radius_and_a_speed_that_has_another_name_outside():
    places = {"r": ["one.r", "two.r"], "speed": "one.v", "rate": "one.omega"}
    both = connect("l", {}, one=sampled(wheel, H), two=sampled(wheel, H), share=places)
    start = both.with_params(**{"one.r": 0.25, "speed": 30.0}).start()
    assert float(start["one.omega"]) == 30.0 / 0.25
    assert float(start["two.omega"]) == 20.0 / 0.5


def test_a_sample_time_that_the_loop_does_not_have_is_refused():
    def adding(x=State("m", 0.0), v=Input("m/s", value=1.0), T=Param("s", H, "sample time")):
        """Sum."""
        return dict(x=x + T * v), dict(y=x)

    sums = step(period=H, y=Output("m", "way"))(adding)
    slow = every(step(period=5 * H, y=Output("m", "way"))(adding).with_params(T=5 * H), 5)
    loop = connect("l", {}, a=sums, b=slow, c=replicate(sums, 2), d=replicate(slow, 2),
                   e=gated(slow))  # fmt: skip
    check_sample_times(loop)
    for n, told in (("a", "0.001"), ("b", "0.005"), ("c", "0.001"), ("d", "0.005"), ("e", "0.005")):
        with pytest.raises(BadInput, match=rf"{n}.T = 0.002 s, but it runs every {told} s"):
            check_sample_times(loop.with_params(**{f"{n}.T": 2e-3}))


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("Q = m * r", r"this is \[kg m\], not \[N\]"),
        ("Q = m + g", r"'m' \[kg\] cannot be added to 'g' \[m/s\^2\]"),
        ("Q = m / 2", r"this is \[kg\], not \[N\]"),
    ],
)
def test_a_number_computed_from_shared_ones_has_the_unit_of_its_places(expression, said):
    @step(period=H, y=Output("1"))
    def one(m=Param("kg", 8.0), g=Param("m/s^2", 9.81), r=Param("m", 0.5)):
        """Numbers."""
        return dict(), dict(y=0 * (m + g + r))

    @step(period=H, y=Output("1"))
    def load(Q=Param("N", 1.0)):
        """A load."""
        return dict(), dict(y=0 * Q)

    share = {"m": "a.m", "g": "a.g", "r": "a.r"}
    fits = connect("l", {}, a=one, b=load, share=share | {"Q = m * g / 2": "b.Q"})
    assert float(fits.param_values()["Q"]) == 8.0 * 9.81 / 2
    with pytest.raises(BadInput, match=f"is no N, the unit of b.Q: .*{said}"):
        connect("l", {}, a=one, b=load, share=share | {expression: "b.Q"})


def test_a_pattern_finds_shared_and_own_numbers_alike():
    """In any order of the parts: one that is shared does not hide those behind it."""
    from slipctl import Output, Param, connect, law
    from slipctl.block.shared_numbers import targets

    def part(name):
        @law(y=Output("1"), name=name)
        def one_number(m=Param("1", 2.0), k=Param("1", 1.0)):
            return m * k

        return one_number

    for share in (["a.m", "b.m"], ["b.m", "c.m"], ["a.m", "c.m"]):
        parts = {n: part(n) for n in "abc"}
        block = connect("whole", {}, share={"m": share}, **parts)
        own = ({"a.m", "b.m", "c.m"} - set(share)).pop()
        assert set(targets(block, "*.m")) == {own, "m"}
        assert set(targets(block, "*.k")) == {"a.k", "b.k", "c.k"}
        assert targets(block, "*.q") == []
