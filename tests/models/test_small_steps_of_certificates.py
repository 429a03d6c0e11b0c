"""Small steps on the way to a certificate of a vehicle, with numbers that all differ."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, law
from slipctl.certify.smooth.sums import NoProof
from slipctl.models.vehicle import study
from slipctl.models.vehicle.certificate import (
    air_tick,
    axle_kind,
    axle_loops,
    gains,
    own_gains,
    slide_tick,
)
from slipctl.models.vehicle.certificate.own_gains import Withstood
from slipctl.models.vehicle.parts import Air, Lag, SlideProtection, Slope
from slipctl.study.declaration import Certificates

F = Fraction

MET = Withstood(steady=0.3, wrong=0.05, slope=2.1, drift=0.7, tube=0.16, motion=1.3, tubes=())


def loop_of(period=0.01, **numbers):
    def values_by_place():
        return {n.replace("__", "."): v for n, v in numbers.items()}

    return SimpleNamespace(period=period, values_by_place=values_by_place)


def test_half_a_range_is_its_middle_half():
    assert gains._half((2.0, 10.0)) == (4.0, 8.0)
    over = gains.Ranges(0.3, 20.0, {"m": (2.0, 10.0), "J": (1.0, 5.0)},
                        {"c": (0.8, 1.2), "a": (0.6, 1.4), "b": (0.5, 0.9)}, True,
                        (("c", "a"), ("b",)))  # fmt: skip
    found = over.halved()
    assert list(found) == ["tube", "m", "J", "c and a", "b"]
    assert found["tube"].tube == 0.15
    assert found["m"].numbers == {"m": (4.0, 8.0), "J": (1.0, 5.0)}
    assert found["J"].numbers == {"m": (2.0, 10.0), "J": (2.0, 4.0)}
    halved = found["c and a"].scale
    assert {k: pytest.approx(v) for k, v in halved.items()} == {
        "c": (0.9, 1.1), "a": (0.8, 1.2), "b": (0.5, 0.9)
    }  # fmt: skip
    assert found["b"].scale == {"c": (0.8, 1.2), "a": (0.6, 1.4), "b": pytest.approx((0.6, 0.8))}
    for name, one in found.items():
        assert (one.speed, one.untold, one.together) == (20.0, True, over.together)
        assert (one.tube == over.tube) == (name != "tube")


def test_a_law_is_asked_with_its_gains_and_what_it_meets():
    """|s'| is 2 k1 sqrt(tube) at most of a super-twisting law, and so on by each law's own root."""
    names = dict(k1=3.0, k2=5.0, g1=7.0, g2=11.0, K=13.0, K1=17.0, eta_inf=0.02, delta_l=0.4,
                 delta_u=0.6, k_4=1.9, alpha=2.3, beta=2.9)  # fmt: skip
    loop = loop_of(**{f"ctl__law__law__{n}": np.array([v]) for n, v in names.items()})
    assert gains._twisting(loop, MET) == {
        "k1": 3.0, "k2": 5.0, "L": pytest.approx(2.1 * 2 * 3.0 * 0.4 + 0.7), "T": 0.01,
        "band": 0.16,
    }  # fmt: skip
    assert gains._reaching(loop, MET) == {"g1": 7.0, "g2": 11.0, "T": 0.01, "band": 0.16,
                                          "D": pytest.approx(0.35)}  # fmt: skip
    assert gains._linear(loop, MET) == {"K": 13.0, "T": 0.01}
    funnel = {"K1": 17.0, "eta_inf": 0.02, "delta_l": 0.4, "delta_u": 0.6, "T": 0.01,
              "W": pytest.approx(0.35 / 14)}  # fmt: skip
    assert gains._funnel(loop, MET, 14.0, False) == funnel
    assert gains._funnel(loop, MET, 14.0, True) == funnel | {"a": 1.3, "v": 14.0}
    assert gains._higher(loop, MET) == {
        "k4": 1.9, "alpha": 2.3, "beta": 2.9,
        "eta": pytest.approx(2.1 * 2 * 1.9 * (0.4 + 0.16) + 0.7),
    }  # fmt: skip


def test_a_controller_knows_its_wheel_within_a_hundredth():
    plant = {"plant__train__m": 38e3, "plant__train__J": [110.0, 90.0], "plant__train__r": 0.42,
             "plant__train__g": 9.8}  # fmt: skip
    wanted = {"m": 38e3, "J": 110.0, "r": 0.42, "g": 9.8}
    assert gains._wheel(loop_of(**plant)) == wanted
    assert gains._wheel(loop_of(**plant, ctl__law__J=110.9, ctl__fall__r=0.4241)) == wanted
    # what a fall is told goes before what a law is
    assert gains._wheel(loop_of(**plant, ctl__law__J=190.0, ctl__fall__J=109.0)) == wanted
    for wrong, said in (({"ctl__law__J": 111.3}, "J = 111"), ({"ctl__fall__r": 0.414}, "r = 0.414"),
                        ({"ctl__law__r": 0.4244}, "r = 0.424"),
                        ({"ctl__law__J": 110.0, "ctl__fall__J": 95.0}, "J = 95")):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            gains._wheel(loop_of(**plant, **wrong))


@pytest.mark.parametrize(("gradient", "steepest"), [
    (0.004, 0.004), (-0.007, 0.007), (None, 0.0),
    ((Slope(place=0.0, gradient=0.002), Slope(place=9.0, gradient=-0.011),
      Slope(place=20.0, gradient=0.005)), 0.011),
])  # fmt: skip
def test_resistance_and_gradient_disturb_by_their_size_and_change_with_the_speed(
    gradient, steepest
):
    asked = []
    part = SimpleNamespace(of=lambda m: asked.append(m) or (1200.0, 30.0, 4.0))
    vehicle = SimpleNamespace(resistance=part, total=41e3, gravity=9.7)
    trip = SimpleNamespace(vehicle=vehicle, rail=SimpleNamespace(gradient=gradient))
    steady, drift = gains._resistance(trip, 15.0, 36e3, 0.8)
    assert asked == [41e3]
    wanted = (1200 + 30 * 15 + 4 * 225) / 36e3 + 9.7 * steepest
    assert steady == pytest.approx(wanted)
    assert drift == pytest.approx((30 + 2 * 4 * 15) / 36e3 * (0.8 + wanted))


# ---- refusals ------------------------------------------------------------------------------------


def test_a_loop_behind_air_has_no_noise_and_a_filter_of_more_than_a_tick():
    axle = SimpleNamespace(T_f=0.04)
    with pytest.raises(NoProof, match="noise of a wheel"):
        air_tick.air_loop(None, axle, {"T": F(1, 100), "noise": F(1, 9)})
    for T in (F(4, 100), F(5, 100)):
        with pytest.raises(NoProof, match=r"filter of the rim, 0\.04 s"):
            air_tick.air_loop(None, axle, {"T": T, "noise": F(0)})


def test_evidence_of_a_loop_is_of_an_axle(monkeypatch):
    """It has a slip, one slow number and the three pushes, each by its name."""

    def read(states=("s", "T"), pushes=("w", "n", "f"), slow=("h",), inputs=None, outputs=None):
        names = [*(f"x_{k}" for k in states), *(f"d_{k}" for k in pushes),
                 *(f"p_{k}" for k in slow)]  # fmt: skip
        code = SimpleNamespace(inputs=names if inputs is None else inputs,
                               outputs=dict.fromkeys(outputs or states))  # fmt: skip
        monkeypatch.setattr(axle_kind, "read_code", lambda entry: code)
        entry = {"tick": 0, "states": list(states), "pushes": list(pushes), "slow": list(slow)}
        return axle_kind._read_loop(entry)

    found = read()
    assert (found.states, found.pushes, found.slow) == (("s", "T"), ("w", "n", "f"), ("h",))
    for wrong in (dict(states=("q", "T")), dict(slow=("h", "k")), dict(slow=()),
                  dict(pushes=("w", "n")), dict(pushes=("w", "n", "f", "g"))):  # fmt: skip
        with pytest.raises(BadInput, match="no loop of an axle"):
            read(**wrong)
    for wrong in (dict(inputs=["x_s", "x_T"]), dict(outputs=("s", "v"))):
        with pytest.raises(BadInput, match="other inputs or outputs"):
            read(**wrong)


def test_a_rail_that_a_law_does_not_know_refuses_its_certificate_where_it_is_drawn(monkeypatch):
    def unknown(trip):
        raise BadInput("c is out of range")

    monkeypatch.setattr(axle_loops, "rail_law", unknown)
    monkeypatch.setattr(axle_loops, "has_modes", lambda trip, part: False)
    drawn = SimpleNamespace(ensemble=SimpleNamespace())
    assert axle_loops._on_rails(drawn, SimpleNamespace()) == (
        [], "[ensemble] draws what the rail's law does not know: c is out of range"
    )  # fmt: skip
    with pytest.raises(BadInput, match=r"^c is out of range"):
        axle_loops._on_rails(SimpleNamespace(ensemble=None), SimpleNamespace())


def test_rails_on_which_slip_control_rules_are_asked(monkeypatch):
    rail = SimpleNamespace(conditions={"dry": {}, "wet": {}, "leaves": {}})
    monkeypatch.setattr(axle_loops, "rail_law", lambda trip: rail)
    monkeypatch.setattr(axle_loops, "has_modes", lambda trip, part: part == "modes")

    class Asked:
        def __init__(self, *given):
            self.given = given

        def rules(self):
            return self.given[2] != "dry"

    class Modes(Asked):
        pass

    monkeypatch.setattr(axle_loops, "_Asked", Asked)
    monkeypatch.setattr(axle_loops, "_AskedModes", Modes)
    for part, kind in (("linear", Asked), ("modes", Modes)):
        some, why = axle_loops._on_rails("trip", part)
        assert why == axle_loops.NO_RAIL
        assert [type(one) for one in some] == [kind, kind]
        assert [one.given for one in some] == [("trip", part, "wet", rail),
                                               ("trip", part, "leaves", rail)]  # fmt: skip


def test_heights_of_a_curve_are_by_mass_and_draws_and_one_where_there_is_none(monkeypatch):
    asked = object.__new__(axle_loops._Asked)
    asked.over = SimpleNamespace(numbers={"m": (30e3, 50e3)},
                                 scale={"c": (0.8, 1.3), "d": (0.9, 1.1)})  # fmt: skip
    asked.__dict__["_height_draws"] = [("c", "c2"), ("d",)]
    asked._at_goal = lambda m, J: m / 1e4 + J
    numbers = {"m": 40e3, "J": 2.0}  # 6; 5 and 7 at the ends
    assert asked._heights(numbers) == pytest.approx((5 / 6 * 0.72, 7 / 6 * 1.43))
    asked.over.numbers = {}
    assert asked._heights(numbers) == pytest.approx((0.72, 1.43))
    asked._at_goal = lambda m, J: 0.0
    assert asked._heights(numbers) == (1.0, 1.0)


def test_a_slope_that_nothing_bounds_is_refused():
    @law(rises=Output("m/s^2", "rate"))
    def root(v_s=Input("m/s", "slip"), wrong=Input("m/s^2", "push")):
        """A slope without end at zero."""
        return (v_s**2) ** 0.25 + wrong

    with pytest.raises(BadInput, match="nothing bounds the slope"):
        own_gains._slopes(root, {"v_s": (-1.0, 1.0), "wrong": (0.0, 0.5)}, {})

    @law(rises=Output("m/s^2", "rate"))
    def bent(v_s=Input("m/s", "slip"), wrong=Input("m/s^2", "push")):
        """Slope 3 v_s^2 + wrong - 2."""
        return v_s**3 + (wrong - 2) * v_s

    low, high = own_gains._slopes(bent, {"v_s": (0.5, 1.0), "wrong": (0.1, 0.4)}, {})
    assert low == pytest.approx(0.75 + 0.1 - 2, abs=0.02)
    assert low <= 0.75 + 0.1 - 2
    assert high == pytest.approx(3 + 0.4 - 2, abs=0.02)
    assert high >= 3 + 0.4 - 2


class SmallTick(slide_tick.SlideTick):
    """A tick of some states, in the place of that of a vehicle."""

    def _tick(self, v, demand, waits):
        import casadi as ca

        from slipctl.certify.ticks.tick_code import code_of_function

        names = ["s", *(f"a{k}" for k in range(self.more))]
        x = [ca.SX.sym(k) for k in names]
        push = [ca.SX.sym(k) for k in self.pushes]
        after = [x[0] / 2 + sum(push) + sum(x[1:]), *(k / 3 + x[0] for k in x[1:])]
        f = ca.Function("tick", [ca.vertcat(*x, *push)], [ca.vertcat(*after, x[0] / 8)])
        inputs = [*(f"x_{k}" for k in names), *(f"d_{k}" for k in self.pushes)]
        code = code_of_function(f, inputs, [*names, "rate"])
        return code, dict.fromkeys(names, F(1, 3))


@pytest.mark.parametrize(
    ("dead", "noise", "more", "inputs", "said"),
    [
        (F(2, 100), F(1, 9), 0, ["law.v_s"], "dead time"),
        (F(2, 100), F(0), 0, ["law.v_s", "law.F"], "hears F or D"),
        (F(2, 100), F(0), 0, ["D"], "hears F or D"),
        (F(2, 100), F(0), 9, ["v_s", "F.x"], "states that are real numbers"),
        (F(2, 100), F(0), 1, ["v_s", "F.x"], None),
        (F(0), F(1, 9), 0, ["D"], None),
        (F(0), F(0), 9, ["F"], None),
    ],
)
def test_a_dead_time_is_asked_without_noise_and_of_few_states(
    monkeypatch, dead, noise, more, inputs, said
):
    tick = object.__new__(SmallTick)
    tick.period, tick.more, tick.pushes = 0.01, more, (slide_tick.HEIGHT, slide_tick.PUSH)
    tick.law = SimpleNamespace(inputs=dict.fromkeys(inputs))
    late = []
    monkeypatch.setattr(slide_tick, "_with_delay", lambda loop, n: late.append(n) or loop)
    n = {"T": F(1, 100), "dead": dead, "noise": noise, "v": 9, "demand": 8, "W": F(1, 2),
         "least": F(1, 4), "most": F(3, 4), "lag": 0}  # fmt: skip
    if said:
        with pytest.raises(NoProof, match=said):
            tick.loop(n)
        assert not late
        return
    made = tick.loop(n)
    assert late == ([2] if dead else [])
    assert len(made.reals) == 1 + more
    assert made.stride == max(slide_tick.LEAST_TICKS, round(slide_tick.STEP / 0.01))


@pytest.mark.parametrize(("parts", "why", "valves"), [
    ({}, None, None), ({"track_brake": 1}, study.MAGNETS, ()),
    ({"dynamic_brake": 1}, study.MOTORS, ()),
    ({"contamination": 1}, study.NO_LAYER, (SlideProtection,)),
    ({"actuator": Air(torque=6e3)}, study.BITS, (SlideProtection,)),
    ({"actuator": Air(torque=6e3), "dynamic_brake": 1}, study.MOTORS, ()),
    ({"actuator": Air(torque=6e3), "contamination": 1}, study.NO_LAYER, (SlideProtection,)),
])  # fmt: skip
def test_why_a_trip_has_no_certificate_of_its_laws(monkeypatch, parts, why, valves):
    """The first reason is told; a slide protection is asked of valves and layers all the same."""
    given = {"track_brake": None, "dynamic_brake": None, "contamination": None,
             "actuator": Lag(torque=6e3)} | parts  # fmt: skip
    trip = SimpleNamespace(vehicle=SimpleNamespace(**given), rail=SimpleNamespace(**given),
                           actuator=given["actuator"], controllers={"a": 1, "b": 2})  # fmt: skip
    monkeypatch.setattr(gains, "certificates", lambda trip: "those of the gains")
    monkeypatch.setattr(axle_loops, "certificates", lambda *a: a)
    found = study.certificates_of_trip(trip)
    if why is None:
        assert found == (trip, "those of the gains")
        return
    first, none, kinds = found
    assert (first, kinds) == (trip, valves)
    assert none == Certificates((), {"a": why, "b": why})
