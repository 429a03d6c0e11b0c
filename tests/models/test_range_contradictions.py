"""Ranges of parts that feed each other: what one may give, the next one does not refuse."""

from __future__ import annotations

import random
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from bench.healthy_vehicles import KINDS, drawn_vehicle, refused_ticks, trip_of
from slipctl.block.block import Block
from slipctl.certify.arithmetic.enclosure import enclose
from slipctl.models.ranges import of_those
from slipctl.models.vehicle.control import vehicle_control

FAR = 1e9


def inner_of(part: Block) -> Block:
    """What a part is of one axle, in its own time."""
    while part.transparent:
        part = next(iter(part.parts.values()))
    return part


def contradictions(control: Block) -> dict[str, str]:
    """Outputs of laws that may leave their ranges while all inputs are in those of their sources.

    By interval arithmetic of one box, over all numbers that the sources may give. Of a law that
    iterates, as a search does, it has no end, and nothing is said. Nor is it of the slip law, which
    is contained: one that leaves its ranges begins anew, and what it wants is limited behind it.
    """
    found = {}
    known = {**control.inputs, **control.states, **control.outputs}
    now = control.values_by_place()
    for name, part in control.parts.items():
        one = inner_of(part)
        if one.states or not one.sx or "contained" in part.choices:
            continue
        sources = [known[control.wires.get(f"{name}.{n}", f"{name}.{n}")] for n in one.inputs]
        given = {n: ca.SX.sym(n) for n in one.inputs}
        numbers = {n: float(np.ravel(now[f"{name}.{n}"])[0])
                   for n, s in one.params.items() if not s.derived}  # fmt: skip
        values = {n: ca.SX(ca.DM(v)) for n, v in one.param_values(**numbers).items()}
        _, y = one.expr({}, given, values)
        f = ca.Function("f", [ca.vertcat(*given.values())], [ca.vertcat(*y.values())])
        ends = [np.array([[max(s.lo, -FAR)] for s in sources]),
                np.array([[min(s.hi, FAR)] for s in sources])]  # fmt: skip
        for n, least, most in zip(y, *enclose(f, *ends), strict=True):
            own, small, large = control.outputs[f"{name}.{n}"], float(least[0]), float(most[0])
            room = 1e-9 * max(1.0, abs(small), abs(large))
            told = np.isfinite([small, large]).all()
            if told and (small < own.lo - room or large > own.hi + room):
                found[f"{name}.{n}"] = f"{small:g} to {large:g}, declared {own.lo:g} to {own.hi:g}"
    return found


def control_of(seed: int, kind: str) -> Block:
    """Control of a drawn vehicle, within its own period."""
    trip = trip_of(drawn_vehicle(random.Random(seed), kind))
    return inner_of(vehicle_control(trip, trip.controllers["one"]))


@pytest.mark.parametrize("seed", range(3))
def test_no_law_of_a_drawn_vehicle_contradicts_what_feeds_it(seed):
    assert contradictions(control_of(seed, "pid")) == {}


@pytest.mark.second
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.others("long")
def test_no_law_of_any_controller_contradicts_what_feeds_it(kind):
    assert contradictions(control_of(len(kind), kind)) == {}


def test_an_estimate_at_its_farthest_refuses_no_sample():
    """Half a metre per second below zero the law of the metro car comes to 3.5e6 there: the guards
    of the C take every state of the fit in hand, and of the one that holds."""
    control = control_of(0, "pid")
    one = inner_of(control.parts["estimator"])
    values = {n: ca.DM(v) for n, v in one.param_values().items()}
    start = one.start()
    far = np.asarray(one.states["theta"].value) + float(values["farthest"]) * np.array([1, 1, 1])
    inputs = {n: ca.DM(0.0) for n in one.inputs} | {"v_s": ca.DM(-0.5), "mu": ca.DM(-2.0)}
    x = one.pack("state", start | {"theta": far})
    x, _ = one.f(x, one.pack("input", inputs), one.pack("param", values))
    after = one.unpack("state", x)
    assert abs(float(after["predicted_then"])) > 1e6
    for n in one.states:
        declared = control.states[f"estimator.{n}"]
        assert declared.lo <= float(ca.mmin(after[n])), n
        assert float(ca.mmax(after[n])) <= declared.hi, n


def test_a_range_that_is_too_narrow_is_found():
    """The curve may be five, and a range of two refused healthy samples."""
    control = control_of(0, "pid")
    assert contradictions(of_those(control, {"curve.mu": (-2, 2, "steel on steel")})) == {
        "curve.mu": "-5 to 5, declared -2 to 2"
    }


def test_the_search_takes_every_height_of_the_curve_that_an_estimate_may_have():
    """Its value is the curve at its place, so the ends of that are ends of it."""
    control = control_of(0, "pid")
    search, curve = control.outputs["search.value"], control.outputs["curve.mu"]
    assert search.hi == pytest.approx(curve.hi)
    places = np.linspace(0.01, 10.0, 40)
    ends = [(s.lo, s.hi) for s in (control.outputs[f"estimator.{n}"] for n in "cab")]
    law = inner_of(control.parts["curve"])
    heights = [
        float(law(v_s=s, c=c, a=a, b=b)["mu"])
        for s in places for c in ends[0] for a in ends[1] for b in ends[2]
    ]  # fmt: skip
    assert search.lo <= min(heights)
    assert max(heights) <= search.hi
    assert max(heights) > 2


@pytest.mark.long
@pytest.mark.parametrize("number", range(10))
def test_right_sensors_are_never_refused(number):
    """5 to 160 km/h, radii within 3 %; ``python -m bench.healthy_vehicles`` draws a hundred."""
    trip = trip_of(drawn_vehicle(random.Random(f"7 {number}"), KINDS[number % len(KINDS)]))
    assert refused_ticks(replace(trip, duration=3.0)) == {}
