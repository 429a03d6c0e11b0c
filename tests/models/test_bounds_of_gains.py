"""Bounds that a certificate of a slip law takes: the steps around interval arithmetic, by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace as Of

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl import BadInput, Input, Output, Param, law
from slipctl.models.vehicle import Lag, SlipLaw, SlipRatio, SlipSpeed, Valve
from slipctl.models.vehicle.certificate import gains, own_gains
from slipctl.models.vehicle.certificate.own_gains import Tube, Withstood
from slipctl.models.vehicle.parts import Searched

WHEEL = {"m": 41e3, "J": 120.0, "r": 0.43, "g": 9.7}


@law(mu=Output("1", "adhesion", positive="braking"))
def curve(
    v_s=Input("m/s", "slip", positive="braking", per="speed"),
    c=Param("1", 0.3, "height", "test"),
    b=Param("m/s", 0.8, "bend", "test"),
):
    """Rises and falls."""
    return 2 * c * b * v_s / (b**2 + v_s**2)


RAIL = curve.with_conditions(dry={"c": 0.3}, wet={"c": 0.1, "b": 0.6})
CERTIFY = Of(tube=0.2, error=0.12)


def trip_of(worked=(0, 2, 3), axles=4, conditions=None, **more):
    vehicle = Of(axles=axles, worked=worked, total=41e3, gravity=9.7, mode="brake",
                 resistance=Of(of=lambda m: (1200.0, 30.0, 4.0)))  # fmt: skip
    return Of(vehicle=vehicle, rail=Of(gradient=0.003), certify=CERTIFY, **more)


@pytest.fixture
def asked(monkeypatch):
    """What is asked of interval arithmetic; each answer is another."""
    found = []
    boxes = {"dry": (3.0, 5.0, 0.7), "wet": (1.0, 2.0, 1.1)}

    def enclosure(block, output, box, coarse, **given):
        name = "dry" if given.get("adh.b", 0.8) == 0.8 else "wet"
        found.append((name, output, box, coarse, given))
        return boxes[name][:2]

    def slope(block, output, by, box, coarse, **given):
        name, *rest = found[-1]
        assert (output, by, box, coarse, given) == ("D", "v_s", rest[1], rest[2], rest[3])
        return Of(value=boxes[name][2])

    monkeypatch.setattr(gains, "enclosure", enclosure)
    monkeypatch.setattr(gains, "largest_slope", slope)
    monkeypatch.setattr(gains, "_wheel", lambda loop: dict(WHEEL))
    monkeypatch.setattr(gains, "rail_law", lambda trip: RAIL)
    return found


OVER = gains.Ranges(0.2, 15.0, {"m": (34e3, 46e3), "J": (110.0, 130.0)}, {"c": (0.8, 1.3)}, True,
                    (("c",),))  # fmt: skip


@pytest.mark.parametrize("untold", [False, True])
@pytest.mark.parametrize("fitted", [False, True])
def test_bounds_are_those_of_every_condition_and_the_other_axles(
    asked, monkeypatch, fitted, untold
):
    reference = Searched() if fitted else SlipSpeed(slip=1.1)
    goals = {"dry": (0.9, 1.0), "wet": (0.5, 0.7)}
    calls = []

    def goal(rail, condition, at, v, given):
        calls.append((condition, at["c"], v, given))
        low, high = goals[condition]
        return low if at["c"] < 0.3 * (1 if condition == "dry" else 1 / 3) else high

    monkeypatch.setattr(gains, "_goal", goal)
    over = replace(OVER, untold=untold)
    met = gains.slip_law_bounds(trip_of(), "loop", over, reference)
    assert [(n, pytest.approx(c), v, r) for n, c, v, r in calls] == [
        ("dry", 0.24, 15.0, reference), ("dry", 0.39, 15.0, reference),
        ("wet", 0.08, 15.0, reference), ("wet", 0.13, 15.0, reference)]  # fmt: skip
    (_, output, dry, coarse, given), (_, _, wet, _, of_wet) = asked
    assert (output, coarse) == ("D", 0.01)
    assert dry == {
        "v_s": (pytest.approx(0.72), pytest.approx(1.2)),
        "fall.m": (34e3, 46e3),
        "fall.J": (110.0, 130.0),
        "adh.c": (pytest.approx(0.24), pytest.approx(0.39)),
    }
    assert wet["v_s"] == (pytest.approx(0.4), pytest.approx(0.84))
    assert given == {"adh.b": 0.8, "fall.r": 0.43, "fall.g": 9.7, "v": 15.0}
    assert of_wet["adh.b"] == 0.6
    # the lightest vehicle is moved most by its other axles
    share = 3 / 34e3
    other = share / (0.43**2 / 120 + share)
    spans = (0.7 * 0.48, 1.1 * 0.44)
    grade = (1200 + 30 * 15 + 4 * 225) / 34e3 + 9.7 * 0.003
    steady = grade + other * (5 - 1)
    steady += other * 5 * (7 / 41) * untold
    assert met.steady == pytest.approx(steady)
    assert met.wrong == pytest.approx(0.12 * 5 if fitted else max(spans))
    assert met.slope == pytest.approx(1.1 * (0.12 + 2 * other if fitted else 2))
    assert met.tube == pytest.approx(0.24)
    assert met.motion == pytest.approx(other * 5)
    assert met.drift == pytest.approx((30 + 8 * 15) / 34e3 * (other * 5 + grade))
    assert met.largest == pytest.approx(met.steady + met.wrong)
    assert [(t.goal, t.falls) for t in met.tubes] == [((0.9, 1.0), (3.0, 5.0)),
                                                      ((0.5, 0.7), (1.0, 2.0))]  # fmt: skip
    assert met.tubes[1].slips == wet["v_s"]


def test_on_one_rail_the_other_axles_differ_by_the_tube(asked, monkeypatch):
    monkeypatch.setattr(gains, "rail_law", lambda trip: curve.with_conditions(dry={"c": 0.3}))
    monkeypatch.setattr(gains, "_goal", lambda *a: 1.0)
    over = replace(OVER, numbers={}, scale={}, untold=False)
    met = gains.slip_law_bounds(trip_of(), "loop", over, SlipSpeed(slip=1.0))
    other = (3 / 41e3) / (0.43**2 / 120 + 3 / 41e3)
    grade = (1200 + 30 * 15 + 4 * 225) / 41e3 + 9.7 * 0.003
    assert met.steady == pytest.approx(grade + other * 0.7 * 0.4)
    assert asked[0][4] == {"adh.c": 0.3, "adh.b": 0.8, "fall.m": 41e3, "fall.J": 120.0,
                           "fall.r": 0.43, "fall.g": 9.7, "v": 15.0}  # fmt: skip


def test_a_law_goes_to_its_reference_or_to_the_best_of_its_rail(monkeypatch):
    rail = Of(with_conditions=lambda **k: ("rail", k), inputs={"v_s": 1})
    assert gains._goal(rail, "dry", {}, 12.0, SlipSpeed(slip=0.7)) == 0.7
    assert gains._goal(rail, "dry", {}, 12.0, SlipRatio(slip=0.1, least=0.3)) == pytest.approx(1.2)
    with pytest.raises(BadInput, match="one slip for all axles"):
        gains._goal(rail, "dry", {}, 12.0, SlipRatio(slip=(0.1, 0.2)))
    asked = []
    monkeypatch.setattr(gains, "best", lambda *a: asked.append(a) or (0.15, 0.3))
    assert gains._goal(rail, "wet", {"c": 0.2}, 12.0, Searched()) == 0.15
    assert asked == [(("rail", {"wet": {"c": 0.2}}), "wet")]
    rail.inputs = {"lam": 1}
    assert gains._goal(rail, "wet", {}, 12.0, Searched()) == pytest.approx(1.8)


MET = Withstood(0.3, 0.05, 2.1, 0.7, 0.16, 1.3, ())


def asked_of(monkeypatch, kind, actuator, over=OVER):
    trip = Of(actuator=actuator, reference=SlipSpeed(slip=1.0), title="a trip", certify=CERTIFY,
              vehicle=Of(mode="brake"))  # fmt: skip
    monkeypatch.setattr(gains, "ranges", lambda trip: (over, ("lag",)))
    monkeypatch.setattr(gains, "_wheel", lambda loop: dict(WHEEL))
    monkeypatch.setattr(gains, "sample_time", lambda trip, part: 0.004)
    met = []

    def bounds(trip, loop, over, reference):
        met.append(over)
        return replace(MET, steady=over.tube + sum(map(sum, over.numbers.values())) / 1e6)

    monkeypatch.setattr(gains, "slip_law_bounds", bounds)
    part = SlipLaw(kind=kind, lead=1.5)
    return {g.name: g for g in gains._of(trip, "mine", part, {})}, met


def loop_of(**numbers):
    given = {"tau": np.array([0.06, 0.09])} | {f"ctl.law.law.{n}": v for n, v in numbers.items()}
    return Of(period=1e-3, values_by_place=lambda: given)


def test_a_late_actuator_is_asked_with_its_lag_and_its_dead_time(monkeypatch):
    found, met = asked_of(monkeypatch, "sta", Lag(torque=8e3, lag=0.06, dead_time=0.024))
    assert list(found) == ["mine", "mine_prompt"]
    assert {g.system for g in found.values()} == {"super_twisting"}
    loop = loop_of(k1=3.0, k2=5.0)
    late = found["mine"].numbers(loop)
    assert late["T"] == 0.004
    assert (late["lag"], late["dead"]) == (pytest.approx(0.06), 0.024)
    prompt = found["mine_prompt"].numbers(loop)
    assert {"lag", "dead"} & set(prompt) == set()
    assert len(met) == 1  # of the same ranges once
    assert "lag and dead time of the actuator" in found["mine"].bounds
    assert "not over its lag" in found["mine"].bounds
    valve = Valve(torque=6e3, fill=0.2, vent=0.1, dead_time=0.02)
    found, _ = asked_of(monkeypatch, "smc", valve)
    assert "its dead time left out, a valve taken as the slower" in found["mine"].bounds
    own = found["mine"].numbers(loop_of(g1=3.0, g2=5.0))
    assert own["lag"] == pytest.approx(valve.longest_lag / 1.5)
    assert "dead" not in own


def test_what_half_a_range_costs_is_a_share_of_the_bound(monkeypatch):
    found, _ = asked_of(monkeypatch, "smc", Lag(torque=8e3, lag=0.06))
    shares = found["mine"].costs(loop_of(g1=3.0, g2=5.0))
    whole = 0.2 + (80e3 + 240) / 1e6 + 0.05
    assert shares == {"tube": pytest.approx((whole - 0.1) / whole), "m": pytest.approx(1.0),
                      "J": pytest.approx(1.0), "c": pytest.approx(1.0)}  # fmt: skip
    funnel, met = asked_of(monkeypatch, "eppfc", Lag(torque=8e3, lag=0.06))
    loop = loop_of(K1=9.0, eta_inf=0.02, delta_l=0.4, delta_u=0.6)
    numbers = funnel["mine"].numbers(loop)
    # its tube is its funnel: 0.6 times 0.02 of the speed, for the tube of .16 m/s
    assert met[-1].tube == pytest.approx(0.2 * 0.6 * 0.02 * 15 / 0.16)
    assert numbers["W"] == pytest.approx((met[-1].tube + 80240 / 1e6 + 0.05) / 15)
    assert "tube" not in funnel["mine"].costs(loop)


# ---- a law of one's own --------------------------------------------------------------------------


def test_a_law_of_one_s_own_is_a_reaching_law_with_the_mean_of_its_slopes(monkeypatch):
    """T = (J/r) (D - 3 e + .5 e^2): slopes from -3.3 to -2.5 in the tubes, no rest beside."""

    @law(T_wanted=Output("N m", "torque", positive="braking"))
    def bent(
        v_s=Input("m/s", "slip", positive="braking", per="speed"),
        v_best=Input("m/s", "goal", positive="braking", per="speed"),
        D=Input("m/s^2", "fall", positive="braking"),
        k=Param("1/s", 1.0, "gain", "test"),
    ):
        e = v_s - v_best
        return 110.0 / 0.42 * (D - k * e + 0.5 * e**2)

    monkeypatch.setattr(own_gains, "slip_law", lambda trip, part, w: (bent, False))
    monkeypatch.setattr(own_gains, "wheel", lambda *a: None)
    loop = Of(period=2e-3, values_by_place=lambda: {
        "ctl.law.k": np.array([3.0]), "ctl.fall.J": 110.0, "ctl.fall.r": 0.42,
        "ctl.fall.m": 9e3})  # fmt: skip
    tubes = (Tube((1.0, 1.0), (0.7, 1.3), (2.0, 4.0)), Tube((0.5, 0.5), (0.4, 0.6), (1.0, 2.0)))
    met = Withstood(0.3, 0.05, 2.1, 0.7, 0.3, 1.3, tubes)
    found = own_gains.as_reaching(None, Of(reference=None), loop, met, 15.0)
    # slopes of s' by v_s are -3 + e, over e from -.3 to .3; wrong moves D by .05
    assert found["g1"] == pytest.approx(3.0, rel=0.02)
    d = 0.3 + 0.05 + 0.3 * 0.3
    assert found["D"] == pytest.approx(d, rel=0.04)
    assert found["g2"] == pytest.approx(1e-6 * d, rel=0.04)
    assert (found["T"], found["band"]) == (2e-3, 0.3)


def test_what_a_law_is_told_and_how_its_slip_rises():
    d = Draw(100, 1)
    s = {"D": d.even(0, 9), "wrong": d.even(-1, 1), "J": d.even(60, 160), "r": d.even(0.3, 0.6),
         "m": d.even(5e3, 9e3)}  # fmt: skip
    told = s["D"] + s["wrong"]
    force = told / (s["r"] ** 2 / s["J"] + 1 / s["m"])
    assert_same(values(own_gains.telling, s, 100)[2], {"D_told": told, "F_told": force})
    t = {"T": d.even(0, 9e3), "D": s["D"], "J": s["J"], "r": s["r"]}
    rises = s["r"] / s["J"] * t["T"] - s["D"]
    assert_same(values(own_gains.rising, t, 100)[2], {"rises": rises})
    f = {"mu": d.even(0, 0.3), "m": d.even(3e4, 6e4), "J": s["J"], "r": s["r"],
         "g": d.even(9, 10.5), "n": d.even(2, 8), "n_w": d.even(1, 4)}  # fmt: skip
    D = (s["r"] ** 2 / s["J"] + f["n_w"] / f["m"]) * f["mu"] * f["m"] * f["g"] / f["n"]
    assert_same(values(gains.falling, f, 100)[2], {"D": D})


def test_why_a_law_of_one_s_own_has_no_certificate(monkeypatch):
    def block(states=(), inputs=("v_s", "v_best")):
        return Of(states=dict.fromkeys(states), inputs=dict.fromkeys(inputs))

    for made, said in ((block(("a", "b")), "it keeps a, b"), (block((), ("v_s", "T_top", "T")),
                       "it hears T and T_top"), (block((), ("v_s", "T_top")), "hears T_top,"),
                       (block((), ("v",)), "does not hear v_s"), (block(), "")):  # fmt: skip
        monkeypatch.setattr(own_gains, "slip_law", lambda *a, made=made: (made, False))
        monkeypatch.setattr(own_gains, "wheel", lambda *a: None)
        found = own_gains.why_not(None, Of(reference=None))
        assert said in found if said else found == ""
