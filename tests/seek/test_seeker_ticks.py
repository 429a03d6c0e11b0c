"""One tick of each seeker in numbers, what its numbers are by default, and how far they may go."""

from __future__ import annotations

import math

import pytest

from slipctl import locking_seek, perturbation_seek, sliding_seek

T = 1 / 64
WIDE = {"k": 1e-12, "rho": 1e-12, "beta": 1e-12, "planes": 1, "gain": -1e12, "a_0": 0, "w": 1e-9,
        "w_h": 1e-9, "w_l": 1e-9, "r": 0, "q": 1e-9, "reach": 0, "tolerance": 0, "forget": 0,
        "wait": 0, "T": 1e-9}  # fmt: skip
LOCKING = {"k": 1.0, "rho": 0.1, "beta": 0.02, "planes": 3.0, "gain": 600.0, "a_0": 0.06,
           "w": 8 * math.pi, "w_h": 5.0, "w_l": 5.0, "r": 20.0, "q": 1.2, "reach": 0.1,
           "tolerance": 0.02, "forget": 1.0, "wait": 0.05}  # fmt: skip
DITHER = {"k": 20.0, "w": 4 * math.pi, "w_h": 0.9, "w_l": 0.7}
MADE = {
    "sliding": (sliding_seek, {}, {"k": 1.0, "rho": 0.1, "beta": 0.02}, {}),
    "fixed": (perturbation_seek, {}, DITHER | {"a": 0.1}, {"k": -1e12, "a": 1e-12}),
    "vanishing": (perturbation_seek, {"dither": "vanishing"}, DITHER | {"r": 20.0, "q": 0.25},
                  {"k": -1e12}),
    "locking": (locking_seek, {}, LOCKING, {}),
}  # fmt: skip


@pytest.mark.parametrize("what", [*MADE])
def test_numbers_of_a_seeker_are_those_it_declares(what):
    make, options, numbers, other = MADE[what]
    block = make(T, **options)
    assert {n: float(v) for n, v in block.param_values().items()} == numbers | {"T": T}
    least = WIDE | other
    assert {n: (s.lo, s.hi) for n, s in block.params.items()} == {
        n: (least[n], 1e12) for n in (*numbers, "T")}  # fmt: skip
    start = {n: float(v) for n, v in make(T, start=2.5, **options).start().items()}
    at = {"th": 2.5, "v": 2.5, "turn": 2.5, "a": 0.1 if what == "vanishing" else 0.0}
    assert start == {n: at.get(n, 0.0) for n in start}


def tick(block, y, **at):
    """States after a tick, and outputs, as numbers."""
    after, out = block(**at, y=y)
    return tuple({n: float(v) for n, v in d.items()} for d in (after, out))


@pytest.mark.parametrize(
    ("y", "g", "side"), [(0.5, 0.49, 1), (0.5, 0.47, -1), (0.5, 0.455, 1), (0.1, 0.115, -1)]
)
def test_a_sliding_tick_goes_by_the_half_cell_that_the_value_is_in(y, g, side):
    """Cells are 0.02 wide: up in even ones, down in odd ones; the target is kept below 0.04."""
    block = sliding_seek(T, k=3.0, rho=0.25)
    after, out = tick(block, y, v=7.0, g=g)
    delta = (y - g) % 0.04
    assert out == pytest.approx({"v": 7.0, "delta": delta})
    assert side == (1 if delta < 0.02 else -1)
    assert after == pytest.approx({"v": 7.0 + side * 3.0 * T, "g": g + 0.25 * T - 0.04})
    assert tick(block, y, v=7.0, g=0.03)[0]["g"] == pytest.approx(0.03 + 0.25 * T)


@pytest.mark.parametrize("dither", ["fixed", "vanishing"])
def test_a_dithered_tick_filters_demodulates_and_climbs(dither):
    numbers = {"k": 11.0, "a": 0.3, "w": 20.0, "w_h": 0.75, "w_l": 1.25, "r": 3.0, "q": 0.5}
    block = perturbation_seek(T, dither=dither, **numbers)
    at = {"th": 2.0, "xi": -0.4, "eta": 0.6, "phase": 1.2, "awake": 1.0}
    at |= {"a": 0.7} if dither == "vanishing" else {}
    a, wave = at.get("a", 0.3), math.sin(1.2)
    after, out = tick(block, 0.9, **at)
    assert out == pytest.approx(
        {"v": 2.0 + a * wave, "theta": 2.0, "slope": -0.4, "amplitude": a})  # fmt: skip
    wanted = {
        "th": 2.0 - T * 11.0 * 0.4, "xi": -0.4 + T * 1.25 * (0.3 * wave + 0.4),
        "eta": 0.6 + T * 0.75 * 0.3, "phase": 1.2 + 20 * T, "awake": 1.0,
    }  # fmt: skip
    wanted |= {"a": 0.7 + T * 0.5 * (3.0 * 0.4 - 0.7)} if dither == "vanishing" else {}
    assert after == pytest.approx(wanted)
    turned = tick(block, 0.9, **at | {"phase": 6.1})[0]
    assert turned["phase"] == pytest.approx(6.1 + 20 * T - 2 * math.pi)
    first = tick(block, 0.9, **at | {"awake": 0.0})[0]  # its mean begins at the value
    assert (first["eta"], first["xi"]) == pytest.approx((0.9, -0.4 + T * 1.25 * 0.4))


# ---- the seeker that locks -----------------------------------------------------------------------

P = {"k": 3.0, "rho": 0.25, "beta": 0.04, "planes": 2, "gain": 50.0, "a": 0.08, "w": 20.0,
     "w_h": 1.5, "w_l": 2.5, "r": 7.0, "q": 1.25, "reach": 0.5, "tolerance": 0.1, "forget": 0.75,
     "wait": 0.06}  # fmt: skip
AT = {"age": 0.03, "v": 5.0, "g": 0.9, "side": 1.0, "turn": 4.8, "xi": 0.02, "eta": 0.85,
      "phase": 1.2, "a": 0.07, "kept": 1.0}  # fmt: skip
SEEKER = locking_seek(T, **P)


def test_waiting_it_stands_still_until_it_slides():
    """g ends half a cell below the value; after 0.06 s the mode is 1."""
    for age, mode in ((0.03, 0), (0.061, 1)):
        after, out = tick(SEEKER, 0.95, **AT | {"mode": 0, "age": age})
        assert out == pytest.approx(
            {"v": 5.0, "delta": 0.05, "mode": 0, "amplitude": 0, "kept": 1.0})  # fmt: skip
        assert after == pytest.approx(
            {"mode": mode, "age": age + T, "v": 5.0, "g": 0.93, "side": 0, "turn": 5.0, "xi": 0,
             "eta": 0.95, "phase": 0, "a": 0, "kept": 0.95})  # fmt: skip


@pytest.mark.parametrize(
    ("y", "side", "turn"), [(0.93, 1, 4.8), (0.95, -1, 5.0), (0.99, 1, 4.8), (0.87, -1, 5.0)]
)
def test_sliding_it_goes_on_or_turns(y, side, turn):
    """It was going up: where it goes down now, it turned here."""
    after, out = tick(SEEKER, y, **AT | {"mode": 1})
    assert out == pytest.approx(
        {"v": 5.0, "delta": y - 0.9, "mode": 1, "amplitude": 0, "kept": 1.0})  # fmt: skip
    assert after == pytest.approx(
        {"mode": 1, "age": 0, "v": 5.0 + side * 3.0 * T, "g": 0.9 + 0.25 * T, "side": side,
         "turn": turn, "xi": 0, "eta": y, "phase": 0, "a": 0.08, "kept": y})  # fmt: skip


def test_two_planes_below_it_locks_in_the_middle_of_its_last_travel():
    for y, mode in ((0.821, 1), (0.819, 2)):
        after, _ = tick(SEEKER, y, **AT | {"mode": 1})
        assert after["mode"] == mode
    assert (after["v"], after["turn"]) == pytest.approx((4.9, 4.9))


@pytest.mark.parametrize(
    ("y", "v", "mode"),
    [(1.09, 5.0, 2), (1.11, 5.0, 0), (0.91, 5.0, 2), (0.89, 5.0, 0), (1.0, 5.29, 2),
     (1.0, 5.31, 0), (1.0, 4.31, 2), (1.0, 4.29, 0)],
)  # fmt: skip
def test_locked_it_dithers_until_the_value_departs_or_it_climbs_too_far(y, v, mode):
    """A tenth off the locked value 1, or half a metre from the place of the lock, 4.8."""
    after, out = tick(SEEKER, y, **AT | {"mode": 2, "v": v})
    wave = math.sin(1.2)
    assert out == pytest.approx({"v": v + 0.07 * wave, "delta": y - 0.9, "mode": 2,
                                 "amplitude": 0.07, "kept": 1.0})  # fmt: skip
    assert after == pytest.approx({
        "mode": mode, "age": 0, "v": v + T * 50 * 0.02, "g": 0.9, "side": 0, "turn": 4.8,
        "xi": 0.02 + T * 2.5 * ((y - 0.85) * wave - 0.02), "eta": 0.85 + T * 1.5 * (y - 0.85),
        "phase": 1.2 + 20 * T, "a": 0.07 + T * 1.25 * (7 * 0.02 - 0.07),
        "kept": 1.0 + T * 0.75 * (y - 1.0),
    })  # fmt: skip
