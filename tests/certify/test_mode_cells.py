"""Cells with modes: against a relay whose swing is known, plain runs, and altered certificates."""

from __future__ import annotations

import copy
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl.certify import proofs
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.whole_boxes import ONE, WholeBoxes, exponential
from slipctl.certify.cells.mode_cells import (
    Cells,
    Grid,
    _counted,
    _cover,
    _totals,
    places_in_ranges,
)
from slipctl.certify.cells.mode_images import ModeTick
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import CERTIFIED, INPUT, REFUTED, TARGET, Number, System
from slipctl.certify.ticks.tick_sets import Loop, Stay, SwitchedLoop, exp, if_else
from slipctl.certify.ticks.tick_source import code_of_tick
from slipctl.errors import BadInput
from slipctl.models.vehicle.certificate.tick_coordinates import (
    chosen_coordinates,
    compared_sums,
    with_coordinates,
)

F = Fraction
ends = st.tuples(st.floats(-50, 50), st.floats(0, 3))


def made(kind, a):
    return kind.of_ends(np.array([a[0]]), np.array([a[0] + a[1]]))


def fractions(box):
    scale = F(1) if isinstance(box, Boxes) else F(1, ONE)
    return F(box.low[0]) * scale, F(box.high[0]) * scale


@given(ends, ends, st.sampled_from(["+", "-", "*", "/"]), st.floats(0, 1), st.floats(0, 1))
def test_boxes_hold_what_their_numbers_make(a, b, sign, p, q):
    """Both kinds, against rationals; and cells hold their boxes."""
    x, y = F(a[0]) + F(p) * F(a[1]), F(b[0]) + F(q) * F(b[1])
    x, y = min(x, F(a[0] + a[1])), min(y, F(b[0] + b[1]))
    if sign == "/" and b[0] <= 0.01 and b[0] + b[1] >= -0.01:
        return
    exact = {"+": x + y, "-": x - y, "*": x * y, "/": x / y if y else F(0)}[sign]
    for kind in (Boxes, WholeBoxes):
        one, two = made(kind, a), made(kind, b)
        found = {"+": lambda: one + two, "-": lambda: one - two, "*": lambda: one * two,  # noqa: B023
                 "/": lambda: one / two}[sign]()  # noqa: B023  # fmt: skip
        low, high = fractions(found)
        assert low <= exact <= high
        size = F(3, 64)
        first, last = found.cells(size)
        assert int(first[0]) * size <= low
        assert high <= (int(last[0]) + 1) * size


@given(st.floats(-60, 60))
def test_an_exponential_in_whole_numbers_is_that_of_decimals(x):
    low, high = exponential(int(F(x) * ONE))
    with localcontext() as context:
        context.prec = 60
        true = (Decimal(int(F(x) * ONE)) / Decimal(ONE)).exp() * ONE
    assert low <= true <= high
    assert high - low <= 3 + high * 2.0**-70


def test_what_holds_is_not_moved_by_rounding():
    """Sums that are exact stay, so that a pressure that is held stays in its cell."""
    box = Boxes.of_ends(np.array([0.375, 1.0]), np.array([0.5, 1.0]))
    held = box + Boxes.of_ends(np.zeros(2), np.zeros(2)) * 0.1
    assert (held.low == box.low).all()
    assert (held.high == box.high).all()


# ---- a relay -------------------------------------------------------------------------------------


def relay(late=0):
    """e moves by 1/32 a tick, up or down; it turns at +-1/2, so many ticks late."""

    def tick(n, x, d):
        m = if_else(x["e"] >= n["hi"], 1, if_else(x["e"] <= -n["hi"], 0, x["m"]))
        acts = x[f"q{late}"] if late else m
        rest = {f"q{i}": x[f"q{i - 1}"] if i > 1 else m for i in range(1, late + 1)}
        return {"e": x["e"] + if_else(acts == 1, -n["step"], n["step"]) + d["w"], "m": m, **rest}

    modes = {"m": 0, **{f"q{i}": 0 for i in range(1, late + 1)}}
    loop = SwitchedLoop(tick, {"e": "e0"}, {"w": "W"}, {"e": Stay("band", "the error")}, modes)
    numbers = {
        "hi": Number("1", "threshold"), "step": Number("1", "step"),
        "e0": Number("1", "start", 0.0, "not negative"),
        "W": Number("1", "push", 0.0, "not negative", role=INPUT, says="every |w| <= {}"),
        "band": Number("1", "wanted", optional=True, role=TARGET),
    }  # fmt: skip
    return System("own", "relay", numbers, {}, loop.targets(), loop.says_start(), loop=loop)


def asked(system, **numbers):
    return proofs.write(system, {"hi": F(1, 2), "step": F(1, 32), **numbers})


@pytest.mark.parametrize("late", [0, 3])
def test_the_swing_of_a_relay_is_proved_to_a_cell(late):
    """It turns up to a tick and a push beyond the threshold, and goes on while it is late."""
    W = F(1, 128)
    swing = F(1, 2) + (1 + late) * (F(1, 32) + W)
    system = relay(late)
    for band, verdict in ((swing * F(98, 100) - F(1, 32), REFUTED), (swing + F(1, 100), CERTIFIED)):
        payload = asked(system, W=W, band=band)
        assert payload["verdict"] == verdict
        proofs.check(system, payload)


def test_without_a_bound_the_promise_names_what_is_proved():
    payload = asked(relay())
    assert payload["verdict"] == CERTIFIED
    proved = float(payload["promise"]["claims"]["e_bounded"].split()[-1])
    assert 0.5 <= proved <= 0.56
    proofs.check(relay(), payload)


@pytest.mark.long
def test_more_push_is_never_easier():
    certified = []
    for k in range(1, 9):
        payload = asked(relay(1), W=F(k, 256), band=F(5, 8))
        certified.append(payload["verdict"] == CERTIFIED)
    assert certified == sorted(certified, reverse=True)
    assert certified[0]
    assert not certified[-1]


def test_altered_certificates_fail():
    system = relay(1)
    good = asked(system, W=F(1, 128), band=F(3, 4))
    proofs.check(system, good)
    evidence = good["proofs"]["cells"]["evidence"]
    grid = evidence["grid"]
    for name, value in (
        ("cells", evidence["cells"][1:]), ("reach", {"e": "1/2"}),
        ("grid", {**grid, "size": [str(F(grid["size"][0]) * 2)]}),
        ("grid", {**grid, "origin": [grid["origin"][0] + 1]}),
        ("cells", [{**evidence["cells"][0], "cells": evidence["cells"][1]["cells"]},
                   *evidence["cells"][1:]]),
    ):  # fmt: skip
        bad = copy.deepcopy(good)
        bad["proofs"]["cells"]["evidence"][name] = value
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(system, bad)
    bad = copy.deepcopy(good)
    bad["asked"]["W"]["value"] = "1/32"
    with pytest.raises((DoesNotHold, BadInput)):
        proofs.check(system, bad)


# ---- images ------------------------------------------------------------------------------------


def protection(n, x, d):
    """Slip, pressure, filtered acceleration and valve of a slide protection, every 10 ms."""
    s, p, valve, T = x["s"], x["p"], x["valve"], F(1, 100)
    mu = d["c"] * (exp(-0.54 * abs(s)) - exp(-1.2 * abs(s)))
    fall = 159.2 * if_else(s < 0, -mu, mu)
    to = if_else(valve == 0, (12.3 - p) / 0.3, if_else(valve == 2, -p / 0.1, 0))
    rise = p - fall + d["w"] + T / 2 * to
    seen = s + d["n"]
    vent = if_else(seen > 1.5, 1, if_else(seen > 0.9, x["a"] > 3, 0))
    fill = if_else(seen < 0.9, x["a"] <= 0.5, 0)
    return {"s": s + T * rise, "p": p + T * to, "a": x["a"] + 0.25 * (rise - x["a"]),
            "valve": if_else(vent, 2, if_else(fill, 0, 1))}  # fmt: skip


def plain(x, c, w, n):
    """The same tick, written for floats."""
    s, p, a, valve = x
    mu = c * (np.exp(-0.54 * abs(s)) - np.exp(-1.2 * abs(s)))
    fall = 159.2 * (mu if s >= 0 else -mu)
    to = (12.3 - p) / 0.3 if valve == 0 else -p / 0.1 if valve == 2 else 0.0
    rise = p - fall + w + 0.005 * to
    filled = s + n < 0.9 and a <= 0.5
    new = 2 if s + n > 1.5 or (s + n > 0.9 and a > 3) else 0 if filled else 1
    return s + 0.01 * rise, p + 0.01 * to, a + 0.25 * (rise - a), new


@settings(max_examples=10)
@given(st.integers(0, 10**6))
def test_images_hold_what_points_do(seed):
    """Random cells and points in them, after one to four ticks, in both arithmetics."""
    rng = np.random.default_rng(seed)
    code = code_of_tick(protection, ((), ("s", "p", "a", "valve"), ("c", "w", "n")),
                        ("s", "p", "a", "valve"))  # fmt: skip
    tick = ModeTick(code, ("s", "p", "a"), ("valve",))
    low = np.array([rng.uniform(0, 1.6, 8), rng.uniform(0, 12, 8), rng.uniform(-5, 5, 8)])
    low, wide = np.round(low * 64) / 64, np.array([1 / 16, 1 / 4, 1 / 4])
    modes = rng.integers(0, 3, (8, 1))
    push = {"c": (F(17, 100), F(19, 100)), "w": (F(-1, 5), F(1, 5)), "n": (F(0), F(1, 50))}
    ticks = int(rng.integers(1, 5))
    box = [(low[k], low[k] + wide[k]) for k in range(3)]
    for kind in (Boxes, WholeBoxes):
        found = tick.images(kind, box, modes, push, ticks)
        scale = 1.0 if kind is Boxes else 1 / ONE
        for cell in range(8):
            for _ in range(6):
                x = (*(low[:, cell] + wide * rng.choice([0, 1, rng.random()], 3)), modes[cell, 0])
                for _ in range(ticks):
                    c, w, n = (
                        rng.choice([0.17, 0.19]),
                        rng.choice([-0.2, 0.2]),
                        rng.choice([0, 0.02]),
                    )
                    x = plain(x, c, w, n)
                assert any(
                    int(found.modes[r, 0]) == x[3]
                    and all(float(b.low[r]) * scale - 1e-9 <= v <= float(b.high[r]) * scale + 1e-9
                            for b, v in zip(found.reals, x, strict=False))
                    for r in np.flatnonzero(found.cell == cell)
                )  # fmt: skip


def slide(**numbers):
    """Slide protection as a system."""
    loop = SwitchedLoop(
        protection, dict.fromkeys(("s", "p", "a"), "none"),
        {"c": ("least", "most"), "w": "W", "n": "noise"}, {"s": Stay("band", "the slip", "m/s")},
        {"valve": 0},
    )  # fmt: skip
    declared = {
        "none": Number("1", "zero", 0.0, "not negative"),
        "least": Number("1", "least adhesion", role=INPUT, says="adhesion of {}"),
        "most": Number("1", "largest adhesion", role=INPUT, says="to {}"),
        "W": Number("m/s^2", "push", 0.0, "not negative", role=INPUT, says="every |push| <= {}"),
        "noise": Number("m/s", "noise", 0.0, "not negative", role=INPUT, says="noise <= {}"),
        "band": Number("m/s", "wanted", optional=True, role=TARGET),
    }  # fmt: skip
    return System("wsp", "wsp", declared, {}, loop.targets(), loop.says_start(), loop=loop), {
        "least": F(17, 100), "most": F(19, 100), "W": F(1, 5), **numbers,
    }  # fmt: skip


@pytest.mark.long
def test_a_slide_protection_is_proved_near_to_its_worst_run_and_refuted_below():
    """Adhesion moves in any way within its range; ratio 1.45 at most."""
    system, numbers = slide(band=F(21, 10))
    payload = proofs.write(system, numbers)
    assert payload["verdict"] == CERTIFIED
    rng, worst = np.random.default_rng(1), 0.0
    for k in range(150):
        x, stay = (0.0, 0.0, 0.0, 0), int(rng.choice([1, 5, 20, 60]))
        c, w = 0.17, 0.2
        for i in range(400):
            if i % stay == 0:
                c, w = rng.choice([0.17, 0.19]), rng.choice([-0.2, 0.2])
            if k % 3 == 0:  # a low adhesion as soon as there is pressure
                c, w = (0.17, 0.2) if x[1] > 9 - k / 50 else (0.19, -0.2)
            x = plain(x, c, w, 0.0)
            worst = max(worst, x[0])
    assert 1.45 < worst < 2.1 < 1.45 * worst
    refuted = proofs.write(*slide(band=F("1.45")))
    assert refuted["verdict"] == REFUTED
    proofs.check(system, refuted)
    proofs.check(system, payload)


def test_coordinates_that_a_tick_compares_change_nothing():
    """A state that is replaced by a sum which is compared: the same run, exactly."""

    def tick(n, x, d):
        a = (x["s"] - x["f"]) / 4
        return {"s": x["s"] + if_else(a > 1, -1, 1) + d["w"], "f": x["f"] + a, "m": x["m"]}

    states = ("s", "f", "m")
    code = code_of_tick(tick, ((), states, ("w",)), states)
    sums = chosen_coordinates(code, ("s", "f"), "s")
    assert set(sums) == {"f"}
    new = with_coordinates(code, sums)
    one, two = code.compiled(), new.compiled()
    s, f = 3.0, 0.5
    y = float(sums["f"]["s"]) * s + float(sums["f"]["f"]) * f
    for k in range(40):
        s_next, f, _ = one(s, f, 0.0, 0.25 * (k % 3))
        t_next, y, _ = two(s, y, 0.0, 0.25 * (k % 3))
        assert t_next == pytest.approx(s_next)
        s = s_next
        assert y == pytest.approx(float(sums["f"]["s"]) * s + float(sums["f"]["f"]) * f)


def test_sums_are_those_that_a_tick_compares_whatever_else_it_compares():
    """Once up to a factor; products and single states are none."""

    def tick(n, x, d):
        k = if_else(x["s"] * x["f"] > 1, 1, 0) + if_else(x["g"] > 2, 1, 0)
        k = k + if_else(x["s"] + 2 * x["f"] > 1, 1, 0) + if_else(-3 * x["s"] <= 6 * x["f"], 1, 0)
        return {"s": x["s"] + k, "f": x["f"] + if_else(x["g"] - x["f"] < 5, 1, 0), "g": x["g"]}

    states = ("s", "f", "g")
    code = code_of_tick(tick, ((), states, ()), states)
    sums = compared_sums(code, states)
    assert [{k: abs(v) for k, v in s.items()} for s in sums] == [
        {"s": F(1, 2), "f": F(1)}, {"g": F(1), "f": F(1)},
    ]  # fmt: skip
    assert sums[0]["s"] * sums[0]["f"] > 0 > sums[1]["g"] * sums[1]["f"]
    assert compared_sums(code, ("s", "g")) == []


# ---- cells of ranges ---------------------------------------------------------------------------


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_cells_of_ranges_are_those_that_plain_loops_mark(data):
    """Few ranges are listed, many are summed up from their corners; counts are those of a grid."""
    count = tuple(data.draw(st.lists(st.integers(1, 6), min_size=1, max_size=3)))
    many = data.draw(st.integers(1, 5))
    ends = [[sorted(data.draw(st.integers(0, c - 1)) for _ in range(2)) for c in count]
            for _ in range(many)]  # fmt: skip
    low, high = np.moveaxis(np.array(ends), 2, 0)
    grid = np.zeros(count, int)
    for row in ends:
        grid[tuple(slice(a, b + 1) for a, b in row)] += 1
    marked = np.flatnonzero(grid)
    assert np.array_equal(np.unique(places_in_ranges(low, high, count)), marked)
    assert np.array_equal(_cover(low, high, count), grid.reshape(-1))
    held = grid.reshape(-1) > 1
    wanted = [held.reshape(count)[tuple(slice(a, b + 1) for a, b in row)].sum() for row in ends]
    assert np.array_equal(_counted(_totals(held, count), low, high), wanted)


def test_cells_end_at_what_is_asked():
    """A start that fills its bound, and a tick that moves nothing: no cell beyond has to stay."""

    def still(n, x, d):
        return {"e": x["e"]}

    numbers = {"e0": Number("1", "start"), "band": Number("1", "wanted", role=TARGET)}
    loop = Loop(still, {"e": "e0"}, {}, {"e": "band"})
    system = System("own", "it stays", numbers, {}, loop.targets(), loop.says_start(), loop=loop)
    told = proofs.exact_numbers(system, {"e0": F(1, 3), "band": F(1, 3)})
    found = loop.question().find(told)
    assert found is None  # a third is no float: it is rounded outwards
    for far in (F(3, 4), F(3, 10)):  # decimals are exact in whole numbers
        told = proofs.exact_numbers(system, {"e0": far, "band": far})
        found = loop.question().find(told)
        assert found is not None
        loop.question().check(told, found)
        with pytest.raises(DoesNotHold):
            loop.question().check({**told, "band": far - F(1, 10**9)}, found)


def test_products_by_powers_of_two_are_exact():
    box = Boxes(np.array([0.1, -0.3, 5e-324]), np.array([0.1, 0.7, 1.0]))
    for by in (0.5, -4.0, 0.0):
        low = np.minimum(box.low * by, box.high * by)[:2]
        factor = Boxes.around(F(by), F(by))
        for found in (box * factor, factor * box):
            assert np.array_equal(found.low[:2], low)
    assert (box * Boxes.around(F(1, 2), F(1, 2))).low[2] < 0  # where floats end it is rounded
    assert np.array_equal((box / Boxes.around(F(2), F(2))).low[:2], [0.05, -0.15])


def test_cells_are_counted_once_each_over_all_modes():
    cells = Cells(Grid((0,), (F(1),), (8,)))
    for modes, places, new in [
        ((0,), [3, 1, 3], [1, 3]), ((1,), [1], [1]), ((0,), [1, 2], [2]), ((0,), [2], []),
    ]:  # fmt: skip
        assert list(cells.add(cells.number(modes), np.array(places))) == new
    assert cells.many == sum(int(held.sum()) for held in cells.held) == 4
