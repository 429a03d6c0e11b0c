"""What a law under the wheels is told to do that no rail does: how much of it, and where."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from slipctl import Input, Output, State, connect, from_text, step
from slipctl.block.reach import with_reach
from slipctl.models.wheel_rail.exponential_tail import exponential_tail
from slipctl.run.warnings import wheels

TIME = 0.5 * np.arange(4)


@step(period=0.5, v_s=Output("m/s", "slip", positive="braking", per="speed"))
def axle(n=State("1", 0.0), mu=Input("1", "adhesion", positive="braking")):
    """Something that slips."""
    return dict(n=n), dict(v_s=n + 0 * mu)


def loop_of(*names, law=exponential_tail):
    parts = {n: connect("part", {"adh.v_s": "axle.v_s", "axle.mu": "adh.mu"}, axle=axle, adh=law)
             for n in names}  # fmt: skip
    return connect("loop", {}, **parts)


def told(slip, mu, law=exponential_tail):
    log = {"time": TIME, "a.axle.v_s": np.array(slip, float), "a.adh.mu": np.array(mu, float)}
    return list(wheels._no_adhesion(loop_of("a", law=law), log))


FINE = [0.1, 0.2, 0.3, 0.2]


@pytest.mark.parametrize(
    ("slip", "mu", "said"),
    [
        ([1, 2, 3, 2], FINE, ""),
        ([1, 2, 3, 2], [0.1, 0.2, -0.0105, 0.1], "of -0.0105 at a slip of 3 m/s, at 1 s: it push"),
        ([1, 2, 3, 2], [0.1, 0.2, -0.0095, 0.1], ""),
        ([-1, 2, 3, 2], [0.0105, 0.2, 0.1, 0.1], "of 0.0105 at a slip of -1 m/s, at 0 s: it push"),
        ([1, 1.05e-3, 3, 2], [0.1, -0.2, 0.1, 0.1], "of -0.2 at a slip of 0.00105 m/s, at 0.5 s"),
        ([1, 0.95e-3, 3, 2], [0.1, -0.2, 0.1, 0.1], ""),
        ([1, 2, 3, 2], [0.1, 1.05, 0.3, 1.2], "of 1.05 at a slip of 2 m/s, at 0.5 s: it is more"),
        ([1, 0, 3, 2], [0.1, 0.0105, 0.3, 0.1], "of 0.0105 at a slip of 0 m/s, at 0.5 s: a wheel"),
        ([1, 0, 3, 2], [0.1, 0.0095, 0.3, 0.1], ""),
        ([1, 2, 3, 2], [0.95e-9, 0, 0, 0], "of 0 at a slip of 3 m/s, at 1 s: there is none at any"),
        ([1, 2, 3, 2], [1.05e-9, 0, 0, 0], ""),
        ([0, 0, 0.95e-3, 0], [0, 0, 0, 0], ""),
        ([1, 2, 3, 2], [0.1, -2.0, 3.0, 0.1], "of -2 at a slip of 2 m/s, at 0.5 s: it pushes"),
    ],
)  # fmt: skip
def test_what_no_rail_does_is_told_once_where_it_begins(slip, mu, said):
    lines = told(slip, mu)
    assert len(lines) == bool(said)
    assert all(f"exponential_tail gives an adhesion {said}" in line for line in lines)


def test_a_law_behind_what_is_not_logged_or_of_another_shape_is_told():
    for order in permutations(["unseen", "shaped", "odd", "fine"]):
        log = {"time": TIME}
        for n in ("shaped", "odd", "fine"):
            log[f"{n}.axle.v_s"] = np.array([1.0, 2.0, 3.0, 2.0])
            log[f"{n}.adh.mu"] = np.array(FINE)
        log["shaped.adh.mu"] = np.full((4, 2), 5.0)
        log["odd.adh.mu"] = np.array([0.1, 5.0, 0.2, 0.1])
        (line,) = wheels._no_adhesion(loop_of(*order), log)
        assert "of 5 at a slip of 2 m/s, at 0.5 s" in line


@pytest.mark.parametrize(("unit", "farthest"), [("1", 1.0), ("m/s", 10.0)])
def test_a_peak_is_looked_for_up_to_a_locked_wheel(unit, farthest):
    """k s exp(-s/q) is highest at q, with k q/e; one that rises on to the end has no peak."""
    name = {"1": "lam", "m/s": "v_s"}[unit]
    used = {"k": "0.5" if unit == "1" else "0.5 s/m", "q": f"1 {unit}" if unit != "1" else "1"}
    law = from_text(f"mu = k*{name}*exp(-{name}/q)", inputs={name: unit}, parameters=used)
    rails = {"low": 0.4, "high": 0.95, "beyond": 1.05}
    law = law.with_conditions(**{n: {"q": share * farthest} for n, share in rails.items()})
    condition, at, height = wheels._highest_peak(law)
    assert condition == "high"
    assert at == pytest.approx(0.95 * farthest, rel=0.05)
    assert height == pytest.approx(0.5 * 0.95 * farthest / np.e, rel=2e-3)


@step(period=0.5, a_s=Output("m/s", "another slip", positive="braking", per="speed"),
      v_s=Output("m/s", "slip", positive="braking", per="speed"), v=Output("m/s", "speed"),
      ratio=Output("1", "ratio", positive="braking", per="ratio"))  # fmt: skip
def train(n=State("1", 0.0), mu=Input("1", "adhesion", positive="braking")):
    """Has two slips and a speed."""
    return dict(n=n), dict(a_s=n, v_s=n + 0 * mu, v=n, ratio=n)


def test_the_slip_of_a_law_is_the_one_of_its_name():
    """Whatever else slips beside it; what is watched is the slip, the adhesion and the speed."""
    wires = {"adh.v_s": "w.v_s", "w.mu": "adh.mu"}
    part = connect("part", wires, w=train, adh=exponential_tail)
    loop = connect("loop", {}, front=part, plain=train)
    ((path, law, name),) = wheels.rail_laws(loop)
    assert (path, law.name, name) == ("front.adh", "exponential_tail", "front.w.v_s")
    assert wheels.watched_wheels(loop) == {"front.w.v_s", "front.adh.mu", "front.w.v"}
    bare = from_text("mu = 0.1*lam", inputs={"lam": "1"})
    assert list(wheels.rail_laws(connect("loop", {}, w=train, adh=bare))) == []  # on no rail
    ratio = bare.with_conditions(dry={})
    assert [n for *_, n in wheels.rail_laws(connect("loop", {}, w=train, adh=ratio))] == []
    inner = connect("inner", {}, w=train, adh=ratio)
    found = list(wheels.rail_laws(connect("loop", {}, a=inner)))
    assert [(p, n) for p, _, n in found] == [("a.adh", "a.w.ratio")]


@pytest.mark.parametrize(
    ("speed", "slip", "lines"),
    [(0.5, 0.69, 0), (0.5, 0.71, 1), (1.05, 0.73, 0), (1.05, 0.74, 1), (20.0, 13.9, 0),
     (20.0, 14.1, 1)],
)  # fmt: skip
def test_a_law_of_the_ratio_is_judged_by_the_slip_in_the_speed(speed, slip, lines):
    """It is meant up to 0.7 of the speed; below 1 m/s of that speed."""

    @step(period=0.5, v_s=Output("m/s", "slip", positive="braking", per="speed"),
          v=Output("m/s", "speed"))  # fmt: skip
    def wheel(n=State("1", 0.0), mu=Input("1", "adhesion", positive="braking")):
        """Slips."""
        return dict(n=n), dict(v_s=n + 0 * mu, v=n)

    made = from_text("mu = k*v_s/v_least", inputs={"v_s": "m/s"},
                     parameters={"k": "0.1", "v_least": "1 m/s"})  # fmt: skip
    adh = with_reach(made.with_conditions(dry={}), {"meant_to": "0.7 m/s"})
    part = connect("part", {"adh.v_s": "axle.v_s", "axle.mu": "adh.mu"}, axle=wheel, adh=adh)
    log = {"time": TIME, "a.axle.v_s": np.full(4, slip), "a.v": np.full(4, speed)}
    found = list(wheels._slides(connect("loop", {}, a=part), log))
    assert len(found) == lines
    assert all("slides at" in line and "meant up to 0.7" in line for line in found)
