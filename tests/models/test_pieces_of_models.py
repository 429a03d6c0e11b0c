"""Small functions of models and of their certificates, each against another way to compute it."""

from __future__ import annotations

import math
from collections import deque
from decimal import Decimal, Overflow
from fractions import Fraction
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, law
from slipctl.certify.cells import mode_runs
from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.ticks.tick_code import code_of_function
from slipctl.models.bounded_error.certificate import (
    bounded_error,
    interval_systems,
    lagged_maps,
)
from slipctl.models.bounded_error.certificate.scalar_maps import AtanhPull
from slipctl.models.cheng_2022 import freight_traction
from slipctl.models.cheng_2022.certificate import (
    dither_push,
    dithering_kind,
    seeking_kind,
    sliding_seeker,
)
from slipctl.models.cheng_2022.certificate.dither import Loop, basis_at
from slipctl.models.cheng_2022.certificate.sliding_seeker import Seeker
from slipctl.models.huang_2020 import subway_braking
from slipctl.models.sensors import speed_of_wheels
from slipctl.models.super_twisting.certificate import super_twisting_kind, twisting_sampled
from slipctl.models.vehicle import cars, control, of_study, trip
from slipctl.models.vehicle.air import valve_control
from slipctl.models.vehicle.certificate import gains, slide_tick
from slipctl.models.vehicle.parts import Pads, SlipRatio, SlipSpeed
from slipctl.models.vehicle.slip import train_reference
from slipctl.models.wang_2025.certificate import higher_order
from slipctl.models.zhang_2021.certificate import prescribed_performance

F = Fraction

# ---- curves --------------------------------------------------------------------------------------

SLIPS = np.linspace(0.0, 12.0, 240_001)


@pytest.mark.parametrize("rail", ["dry", "wet", "ice"])
@pytest.mark.parametrize(("a", "b"), [(0.54, 1.2), (0.36, 0.8), (0.9, 2.5)])
def test_a_curve_that_is_moved_keeps_the_height_of_its_rail(rail, a, b):
    """And has its peak where a and b say."""

    def curve(c, a, b):
        return c * (np.exp(-a * SLIPS) - np.exp(-b * SLIPS))

    first = subway_braking.TABLE_1[rail]
    moved = subway_braking._scaled(a, b, rail)
    assert (moved["a"], moved["b"]) == (a, b)
    before, after = curve(**first), curve(**moved)
    assert after.max() == pytest.approx(before.max(), rel=1e-8)
    peak = subway_braking.peak_slip(**moved)
    assert SLIPS[after.argmax()] == pytest.approx(float(peak), abs=1e-4)
    if (a, b) == (first["a"], first["b"]):
        assert moved["c"] == pytest.approx(first["c"], rel=1e-12)


@pytest.mark.parametrize("height", [0.1, 0.25])
def test_a_freight_rail_that_is_moved_has_the_height_it_is_given(height):
    moved = freight_traction._moved(0.36, 0.8, height)
    assert (moved["a"], moved["b"]) == (0.36, 0.8)
    curve = moved["c"] * (np.exp(-0.36 * SLIPS) - np.exp(-0.8 * SLIPS))
    assert curve.max() == pytest.approx(height, rel=1e-8)


@pytest.mark.parametrize(("a", "slip", "W"), [(1.5, 0.1, 0.2), (0.3, 0.02, 1.0)])
def test_what_a_law_leaves_out_is_the_motion_of_the_slip_ratio(a, slip, W):
    """d/dt of slip = 1 - v_w/v at a wheel speed that stands: (1 - slip) v'/v, more at less v."""
    v, dt = 12.0, 1e-6
    wheel = (1 - slip) * v
    rate = ((1 - wheel / v) - (1 - wheel / (v - a * dt))) / dt
    assert prescribed_performance.neglected_term(v, a, slip) == pytest.approx(rate, rel=1e-5)
    least = prescribed_performance.lowest_speed(a, slip, W)
    assert prescribed_performance.neglected_term(least, a, slip) == pytest.approx(W)
    assert prescribed_performance.neglected_term(2 * least, a, slip) == pytest.approx(W / 2)


def test_the_pull_of_a_funnel_has_its_slope_and_peak():
    pull = AtanhPull(1.7)
    for y in (-0.9, -0.3, 0.0, 0.2, 0.6479, 0.95):
        assert pull.at(y) == pytest.approx(1.7 * (1 - y * y) * math.atanh(y))
        slope = (pull.at(y + 1e-6) - pull.at(y - 1e-6)) / 2e-6
        assert pull.slope(y) == pytest.approx(slope, abs=1e-6)
    shares = np.linspace(0, 0.999, 100_000)
    values = [pull.at(float(y)) for y in shares[::100]]
    assert shares[::100][int(np.argmax(values))] == pytest.approx(pull.peak, abs=1e-3)
    assert pull.slope(pull.peak) == pytest.approx(0, abs=1e-9)


# ---- wheels and pads -----------------------------------------------------------------------------


@pytest.mark.parametrize("driven", [False, True])
def test_the_speed_of_wheels_is_that_of_the_one_that_slips_least(driven):
    """Within the largest rate; from the speed at the start, tick by tick."""
    block = speed_of_wheels(3, driven).with_params(a_max=2.0, r=0.4, T=0.1, v_start=10.0)
    rng = np.random.default_rng(1)
    x, v = ca.DM(block.pack("state", block.start())), 10.0
    limited = set()
    for _ in range(60):
        omega = rng.uniform(22, 28, 3)
        rims = 0.4 * omega
        x, y = block.f(x, block.pack("input", {"omega": omega}),
                       block.pack("param", block.param_values()))  # fmt: skip
        free = rims.min() if driven else rims.max()
        v = min(free, v + 0.2) if driven else max(free, v - 0.2)
        limited.add(v == free)
        assert float(block.unpack("output", y)["v_m"]) == pytest.approx(v, rel=1e-12)
    assert limited == {True, False}


def test_pads_of_axles_have_their_own_numbers_each():
    one = Pads(material="cosid", blocks=4, nominal=0.2, radius=0.3, spread=1.1, heat_capacity=5e4,
               cooling=7.0, fade=0.001, fade_from=200.0)  # fmt: skip
    two = Pads(material="disc")
    vehicle = SimpleNamespace(each_pads=(one, None, two), radii=(0.42, 0.43, 0.44), axles=3)
    values = {
        n: np.ravel(v).tolist() for n, v in cars.pads_of_axles(vehicle).param_values().items()
    }
    wanted = {
        "r_w": [0.42, 0.43, 0.44], "r_f": [0.3, 0.43, 0.44], "blocks": [4, 1, 8],
        "mu_n": [one.friction, 1.0, two.friction], "spread": [1.1, 1.0, 1.0],
        "fade": [0.001, 0.0, 0.0], "theta_f": [200.0, 0.0, 250.0], "C": [5e4, 1e9, 1e9],
        "k": [7.0, 0.0, 0.0],
    }  # fmt: skip
    assert {n: values[n] for n in wanted} == wanted
    assert values["mu_0"][1] == 1.0
    for n in ("by_V", "by_N", "by_N2", "iron"):
        assert values[n][1] == 0.0
    for k, part in ((0, one), (2, two)):
        row = cars.MATERIALS[part.material]
        assert row
        for n, v in row.items():
            assert values[n][k] == v
        for n in {"mu_0", "by_V", "by_N", "by_N2", "iron"} - set(row):
            assert values[n][k] == 0.0
    assert cars.pads_of_axles(SimpleNamespace(each_pads=(None, None))) is None


@pytest.mark.parametrize("bits", [True, False])
@pytest.mark.parametrize("inputs", [(), ("a_w",), ("v_s",), ("omega",), ("v", "v_s", "a_w")])
def test_a_slide_protection_of_ones_own_has_the_parts_that_it_asks_for(monkeypatch, bits, inputs):
    """Gate and model stay; the rim's filter and the slip only where the block hears them."""
    parts = {n: n.upper() for n in ("machine", "rim", "slip", "refill", "gate", "model", "trust")}
    wires = {"machine.v": "trust.v", "machine.a_w": "rim.a_w", "rim.rim": "slip.rim",
             "slip.v": "trust.v", "slip.rim": "rim.in", "refill.state": "machine.state",
             "refill.T_b": "trust.T_b", "gate.x": "trust.y"}  # fmt: skip
    monkeypatch.setattr(valve_control, "slide_protection",
                        lambda trip, part, w: (dict(parts), dict(wires)))  # fmt: skip
    monkeypatch.setattr(valve_control, "contained_block", lambda block: ("CONTAINED", block))
    outputs = ("hold", "vent") if bits else ("state",)
    block = SimpleNamespace(inputs=dict.fromkeys((*inputs, "own")), outputs=dict.fromkeys(outputs))
    found, led = valve_control.own_slide_protection(None, block, None)
    wanted = {"law", "refill", "gate", "model", "trust"} | ({"states"} if not bits else set())
    wanted |= {"rim"} if "a_w" in inputs else set()
    wanted |= {"slip"} if {"v_s", "omega"} & set(inputs) else set()
    assert set(found) == wanted
    assert found["law"] == ("CONTAINED", block)
    assert found["refill"] == (valve_control.whole_bits if bits else "REFILL")
    if not bits:
        assert found["states"] is valve_control.whole_state
    lines = {f"law.{n}": valve_control.SEEN[n] for n in inputs} | {"gate.x": "trust.y"}
    if bits:
        lines |= {"refill.hold_by": "law.hold", "refill.vent_by": "law.vent"}
    else:
        lines |= {"states.state_by": "law.state", "refill.state": "states.state",
                  "refill.T_b": "trust.T_b"}  # fmt: skip
    if "a_w" in inputs:
        lines["rim.rim"] = "slip.rim"
    if {"v_s", "omega"} & set(inputs):
        lines |= {"slip.v": "trust.v", "slip.rim": "rim.in"}
    assert led == lines


def test_a_block_gives_bits_by_its_outputs():
    for outputs, bits in ((("hold", "vent"), True), (("state",), True), (("hold",), False),
                          (("T_wanted", "state"), False), (("T_wanted", "hold", "vent"), False),
                          ((), False)):  # fmt: skip
        assert valve_control.gives_bits(SimpleNamespace(outputs=dict.fromkeys(outputs))) == bits


# ---- a command that waits ------------------------------------------------------------------------


def waiting_loop():
    x = [ca.SX.sym(k) for k in ("s", "w", "late")]
    f = ca.Function("tick", [ca.vertcat(*x)], [ca.vertcat(x[0] / 2 + x[1], x[1] + x[2] / 8)])
    code = code_of_function(f, ["x_s", "d_w", "d_late"], ["s", "rate"])
    return ModeLoop(code, ("s",), (), ((F(0), F(0)),), (), {"w": (F(-1, 4), F(1, 2))}, ("s",), 3)


def test_a_command_that_waits_is_off_by_what_it_changes_while_it_does(monkeypatch):
    """Three passes: what waits makes the rate larger, and that more wait for."""
    loop, seen, ticks, room = waiting_loop(), [], 2, slide_tick.ROOM

    def runs(now, many, kept):
        assert (many, kept) == (slide_tick.RUN, "rate")
        seen.append(now.push["late"])
        assert now.push["w"] == loop.push["w"]
        assert (now.code, now.start, now.stride, now.watched) == (
            loop.code, loop.start, 3, ("s",))  # fmt: skip
        (a, b), (c, d) = now.push["w"], now.push["late"]
        return SimpleNamespace(kept=(a + c / 8, b + d / 8))

    monkeypatch.setattr(slide_tick, "worst_runs", runs)
    found = slide_tick._with_delay(loop, ticks)
    low = high = F(0)
    for late in seen:
        assert late == (-ticks * high, -ticks * low)
        low, high = ((F(-1, 4) - ticks * high / 8) * room, (F(1, 2) - ticks * low / 8) * room)
    assert len(seen) == 3
    assert found.kept == {"rate": (low, high)}
    assert found.push == {"w": loop.push["w"], "late": (-ticks * high, -ticks * low)}
    assert (found.code, found.reals, found.modes) == (loop.code, loop.reals, loop.modes)
    assert (found.start, found.begins, found.watched, found.stride) == (
        loop.start, loop.begins, ("s",), 3)  # fmt: skip


def test_a_rate_that_fell_meanwhile_is_not_forgotten(monkeypatch):
    """The largest of all passes counts, and a command that only rises waits for 0 at least."""
    rates = iter([(F(1), F(4)), (F(2), F(3)), (F(0), F(1))])
    monkeypatch.setattr(slide_tick, "worst_runs",
                        lambda *a, **k: SimpleNamespace(kept=next(rates)))  # fmt: skip
    found = slide_tick._with_delay(waiting_loop(), 3)
    high = 4 * slide_tick.ROOM
    assert found.kept == {"rate": (F(0), high)}
    assert found.push["late"] == (-3 * high, F(0))


def test_runs_of_a_loop_show_how_fast_its_command_changes(monkeypatch):
    """By the loop itself: a push at its ends is among the runs."""
    monkeypatch.setattr(slide_tick, "RUN", 12)
    monkeypatch.setattr(mode_runs, "RUNS", 60)
    found = slide_tick._with_delay(waiting_loop(), 0)
    low, high = found.kept["rate"]
    assert float(low) == pytest.approx(-0.25, rel=1e-5)
    assert float(high) == pytest.approx(0.5, rel=1e-5)
    assert found.push["late"] == (0, 0)


# ---- seekers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0, 3])
@pytest.mark.parametrize("lag", [0.5, 4.0])
def test_what_a_lag_hears_of_an_orbit_is_the_sum_of_what_it_was(late, lag):
    """(x + sin)^2/2, each tick before weighed by the lag, and a dead time late."""
    rng = np.random.default_rng(2)
    orbit = rng.uniform(-0.4, 0.4, (3, 5))  # 1, cos, sin, cos 2, sin 2
    loop = Loop(0.1, 0.2, 0.3, 0.37, 0.0, late, lag)
    E = math.exp(-1 / lag)
    for angle in (0.0, 1.1, 4.0):
        places = angle - 0.37 * (late + np.arange(400))
        x = orbit[0] @ basis_at(places, 2)
        heard = (1 - E) * float((E ** np.arange(400)) @ ((x + np.sin(places)) ** 2 / 2))
        assert dither_push._heard(loop, orbit, angle) == pytest.approx(heard, rel=1e-9)


def test_values_of_a_sliding_seeker_are_its_closed_forms():
    """At a slope above rho/k it slides; the ripple of a cell of 5.5 ticks is that of six."""
    n = {"k": F(1), "rho": F(1, 10), "beta": F(55, 1000), "slope": F(1, 2), "T": F(1, 10)}
    found = seeking_kind._sliding_values(n)
    assert {k: (float(v), u) for k, (v, u) in found.items()} == {
        "sliding_somewhere": (1.0, "1"), "rate_at_that_slope": (pytest.approx(0.2), "m/s^2"),
        "ripple_at_the_peak": (pytest.approx(0.55), "m/s"),
        "ripple_at_the_peak_sampled": (pytest.approx(0.6), "m/s"),
    }  # fmt: skip
    flat = seeking_kind._sliding_values({**n, "slope": F(1, 20)})
    assert float(flat["sliding_somewhere"][0]) == 0
    assert float(flat["rate_at_that_slope"][0]) == pytest.approx(0.5)
    assert "ripple_bound" not in seeking_kind._sliding_values({**n, "curvature": F(0)})


def plain_turns(p, c, x, noises):
    """Turns of a seeker by its own ticks: when it hears another sign, and the place it hears then.

    It is at rest before, and hears a place a dead time late; one noise for each half cycle.
    """
    g = -abs(c) * x * x / 2 - p.beta / 2
    heard, side, tick, found = deque([x] * (p.late + 1)), 1, 0, []
    for noise in noises:
        while True:
            place = heard.popleft()
            told = -abs(c) * place * place / 2 - g + noise * p.noise
            now = 1 if math.floor(told / p.beta) % 2 == 0 else -1
            if now != side:
                found.append((tick + p.late, x, now))  # as it is heard then
            side = now
            x += side * p.k * p.T
            g += p.rho * p.T
            heard.append(x)
            tick += 1
            if found and found[-1][0] == tick - 1 + p.late:
                break
    return found


@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize(("noise", "left", "right"), [(F(0), 2, 1), (F(1, 500), 1, 1)])
def test_half_cycles_are_those_of_the_ticks(late, noise, left, right):
    """Rationals: each turn comes at the first tick whose sign is the other one.

    A noise that drives to one side makes the half cycles to that side longer.
    """
    p = Seeker(F(1), F(1, 10), F(5, 100), F(1, 50), noise, late)
    found = list(sliding_seeker.turns(p, F(-1, 10), F(1, 20), left, right))
    assert len(found) >= 4
    noises, side = [], 1
    for k in range(len(found)):
        wanted = 1 if k % (left + right) >= left else -1
        noises.append(1 if wanted == side else -1)
        side = -side
    wanted = plain_turns(p, F(-1, 10), F(1, 20), noises)
    assert [(t.tick, t.x) for t in found] == [(tick, x) for tick, x, _ in wanted]
    assert [t.side for t in found] in ([s for *_, s in wanted], [-s for *_, s in wanted])


def test_without_room_the_ripple_is_the_whole_zone():
    """A dead time whose way is a cell: nothing holds the seeker about its peak."""
    p = Seeker(F(1), F(1, 10), F(1, 100), F(1, 10), F(0), 3)
    assert sliding_seeker.ripple(p, F(-1, 10)) == 2 * sliding_seeker.zone(p, F(-1, 10))
    p = Seeker(F(1), F(1, 10), F(5, 100), F(1, 100))
    width = sliding_seeker.ripple(p, F(-1, 10))
    assert 0 < width < 2 * sliding_seeker.zone(p, F(-1, 10))
    assert (width / F(1, 100)).denominator == 1  # whole ways of a tick


# ---- runs of errors inside bounds ----------------------------------------------------------------


class Tick:
    """Push and noise of a tick."""

    def __init__(self, k):
        self.push, self.noise = Decimal(k + 1), Decimal(k + 1) / 10


@pytest.fixture
def replayed(monkeypatch):
    """Runs that are taken, and after how many ticks each is said to leave."""
    taken, after = [], [3]
    monkeypatch.setattr(interval_systems.scalar_runs, "leaves",
                        lambda law, run: taken.append((law, run)) or after[0])  # fmt: skip
    starts = {"start": SimpleNamespace(low=Decimal(-4), high=Decimal(2)),
              "middle": SimpleNamespace(low=Decimal(0), high=Decimal(0))}  # fmt: skip

    def of(step=Decimal(5), **entry):
        given = {"from": "start", "at": "1/2", "ticks": [[2, "1", "-1/2", "0"]], **entry}
        return interval_systems.replay(given, {"start": Tick, "middle": Tick}, starts, step)

    return SimpleNamespace(of=of, taken=taken, after=after)


def test_a_run_of_shares_is_what_the_bounds_are(replayed):
    """Push, noise and step of each tick, by their bounds then; a start below 0 by the lower end."""
    rows = [[2, "1", "-1/2", "0"], [1, "-1", "0", "1/2"], [1, "1/4", "1", "0"]]
    assert replayed.of(**{"from": "middle"}, ticks=rows, at="0") == 3
    (law_, run) = replayed.taken[0]
    assert law_ is Tick
    assert run.start == 0
    assert [(m.push, m.noise, m.step) for m in run.moves] == [
        (Decimal(1), Decimal("-0.05"), 0), (Decimal(2), Decimal("-0.1"), 0),
        (Decimal(-3), 0, Decimal("2.5")), (Decimal(1), Decimal("0.4"), 0),
    ]  # fmt: skip
    for at, begin in (("1/2", 1), ("-1/2", -2), ("1", 2), ("-1", -4), ("0", 0)):
        replayed.of(at=at)
        assert replayed.taken[-1][1].start == begin


@pytest.mark.parametrize(
    "wrong",
    [
        {"from": "end"}, {"from": 1}, {"at": "101/100"}, {"at": "-101/100"}, {"at": 1},
        {"ticks": [[1, "101/100", "0", "0"]]}, {"ticks": [[1, "0", "-101/100", "0"]]},
        {"ticks": [[1, "0", "0", "1/2"]]}, {"from": "middle", "ticks": [[1, "0", "0", "2"]]},
        {"from": "middle", "ticks": [[2, "0", "0", "1/2"]]}, {"ticks": [[0, "0", "0", "0"]]},
        {"from": "middle", "ticks": [[1, "0", "0", "1/2"], [1, "0", "0", "1/2"]]},
        {"ticks": [[1, "0", "0"]]}, {"ticks": "x"}, {"ticks": [[10**7, "0", "0", "0"]]},
    ],
)  # fmt: skip
def test_a_run_of_shares_that_asks_for_more_is_refused(replayed, wrong):
    with pytest.raises((DoesNotHold, BadInput)):
        replayed.of(**wrong)
    assert replayed.taken == []


def test_a_run_that_does_not_leave_refutes_nothing(replayed, monkeypatch):
    replayed.after[0] = None
    with pytest.raises(DoesNotHold):
        replayed.of()
    monkeypatch.setattr(interval_systems.scalar_runs, "MOST", 4)
    replayed.after[0] = 4
    assert replayed.of(ticks=[[4, "0", "0", "0"]]) == 4
    with pytest.raises((DoesNotHold, BadInput)):
        replayed.of(ticks=[[2, "0", "0", "0"], [3, "0", "0", "0"]])


@pytest.fixture
def path_of(monkeypatch):
    taken, leaves = [], [True]
    monkeypatch.setattr(interval_systems.lagged_runs, "leaves",
                        lambda law, path: taken.append((law, path)) or leaves[0])  # fmt: skip
    starts = {"start": SimpleNamespace(low=Decimal(-1), high=Decimal(1)),
              "middle": SimpleNamespace(low=Decimal(0), high=Decimal(0))}  # fmt: skip

    def of(**entry):
        given = {"from": "start", "errors": ["1/2", "3/4"], "noise": [1, -1], "stepped": -1,
                 "forward": 1, **entry}  # fmt: skip
        return interval_systems.replay_path(given, {"start": "LAW", "middle": "MIDDLE"}, starts,
                                            Decimal(3))  # fmt: skip

    return SimpleNamespace(of=of, taken=taken, leaves=leaves)


def test_a_path_behind_an_actuator_is_what_the_file_says(path_of):
    assert path_of.of() == 1
    law_, path = path_of.taken[0]
    assert law_ == "LAW"
    assert [float(e) for e in path.errors] == [0.5, 0.75]
    assert (list(path.noise), path.stepped, path.step) == ([1, -1], -1, 3)
    assert path_of.of(**{"from": "middle"}, errors=["0"], noise=[0, 1, -1], stepped=2,
                      forward=-1) == 2  # fmt: skip
    law_, path = path_of.taken[1]
    assert law_ == "MIDDLE"
    assert (path.stepped, path.step) == (2, -3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"errors": ["11/10", "0"]}, {"errors": ["-11/10", "0"]}, {"errors": []},
        {"errors": ["0", "0", "0"]}, {"noise": [2, 0]}, {"noise": [1]}, {"stepped": 0},
        {"stepped": -2}, {"forward": 2}, {"from": "end"}, {"from": ["start"]}, {"errors": [1, 2]},
    ],
)  # fmt: skip
def test_a_path_with_one_entry_altered_is_refused(path_of, wrong):
    with pytest.raises((DoesNotHold, BadInput)):
        path_of.of(**wrong)
    path_of.leaves[0] = False
    with pytest.raises(DoesNotHold):
        path_of.of()


def test_a_counterexample_is_shown_with_its_time():
    """Of rows of ticks only when it leaves; of errors each, or every so many of a long one."""
    seen = interval_systems.witness({"from": "start", "ticks": [[2, "0"], [3, "1"]]}, 0.5, 0.25,
                                    "1/s", "error")  # fmt: skip
    assert seen.found == {"leaves_the_error_after": (2.0, "s")}
    assert seen.trajectory == {}
    assert "0.25 1/s" in seen.law
    assert "the start set" in seen.law
    errors = [f"{k}/1000" for k in range(900)]
    seen = interval_systems.witness({"from": "middle", "errors": errors, "noise": [1] * 900}, 0.5,
                                    1.0, "1/s", "band")  # fmt: skip
    assert seen.found == {"leaves_the_band_after": (899 * 0.5, "s")}
    assert seen.trajectory["t"] == ("s", [0.5 * k for k in range(0, 900, 4)])
    assert seen.trajectory["z"] == ("1", [k / 1000 for k in range(0, 900, 4)])
    assert "the middle" in seen.law


@law(y=Output("1", "twice"))
def twice(x=Input("1", "once")):
    """Twice."""
    return 2 * x


def test_what_gives_no_bits_or_asks_for_more_does_not_fit():
    trip = SimpleNamespace(actuator=None)
    with pytest.raises(BadInput):
        valve_control.refuse_misfits(trip, twice)


def test_the_ripple_of_a_seeker_is_its_closed_form():
    """Noise, dead time and lag; in whole ways of a tick."""
    p = Seeker(F(1), F(1, 10), F(1, 10), F(1, 100), F(1, 200), 2, F(1, 50))
    c = F(-1, 10)
    m = 3 * F(1, 10) * F(1, 100)
    r = F(1, 10) / (1 * F(1, 10))
    share = 1 - (2 * F(1, 10) * F(1, 50) + m) / F(1, 10)
    X = (F(1, 10) / (2 * F(1, 10)) + r * (2 * F(1, 200) + m) / F(1, 10)) / share
    width = sliding_seeker.ripple(p, c)
    assert width == math.floor(2 * X / F(1, 100)) * F(1, 100)


@pytest.mark.parametrize(("k1", "k2"), [(4.0, 3.0), (1.0, 3.0), (2.0, 2.0), (0.3, 5.0)])
def test_a_quadratic_proof_takes_what_the_peak_of_a_gain_leaves(k1, k2):
    """2 eta times the largest |1/(s^2 + k1 s + k2)| is 1."""
    w = np.linspace(0, 4 * math.sqrt(k2), 400_001)
    peak = np.abs(1 / (k2 - w**2 + 1j * k1 * w)).max()
    assert 2 * higher_order.quadratic_eta(k1, k2) * peak == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize(("k1", "k2"), [(4.0, 3.0), (0.5, 6.0), (1.2, 2.0)])
def test_any_proof_takes_no_more_than_half_k2_and_no_less_than_a_quadratic_one(k1, k2):
    eta = higher_order.exact_eta(k1, k2)
    assert higher_order.quadratic_eta(k1, k2) <= eta * (1 + 1e-9)
    assert eta <= k2 / 2
    assert higher_order.sta.exact(k1, k2 / 2, eta * (1 - 1e-6))
    if eta < k2 / 2:
        assert not higher_order.sta.exact(k1, k2 / 2, eta * (1 + 1e-6))


@pytest.mark.parametrize("lag", [0.0, 0.004, 0.05])
@pytest.mark.parametrize("dead", [0, 1, 3])
def test_a_command_behind_a_lag_is_the_mean_of_the_tick(lag, dead):
    """alpha+ = E alpha + (1 - E) U, and the error feels c1 alpha + c2 U of a tick."""
    T = 0.01
    E, c1, c2, scale, left = lagged_maps.lag_numbers(lag, T, dead)
    assert c1 + c2 == pytest.approx(1)
    if not lag:  # a tick of dead time is kept in alpha
        assert (E, c1, c2) == ((0, 1, 0) if dead else (0, 0, 1))
        assert (scale, left) == (1, max(dead - 1, 0))
        return
    steps = 20_000
    alpha, felt = 1.0, 0.0
    for _ in range(steps):
        felt += alpha / steps
        alpha += T / steps / lag * (0 - alpha)
    assert pytest.approx(alpha, rel=1e-3) == E
    assert c1 == pytest.approx(felt, rel=1e-3)
    assert (scale, left) == (pytest.approx(T / max(lag, T)), dead)
    exact = lagged_maps.lag_numbers(Decimal(str(lag)), Decimal(str(T)), dead)
    assert float(exact[0]) == pytest.approx(E, rel=1e-14)
    assert exact[4] == dead


# ---- numbers and parts of vehicles ---------------------------------------------------------------


@pytest.mark.parametrize("rail", ["dry", "wet", "ice"])
def test_the_best_slip_of_a_rail_is_where_its_curve_is_highest(rail):
    curve = subway_braking.double_exponential
    slip, mu = trip.best(curve, rail)
    p = subway_braking.TABLE_1[rail]
    values = p["c"] * (np.exp(-p["a"] * SLIPS) - np.exp(-p["b"] * SLIPS))
    assert slip == pytest.approx(SLIPS[values.argmax()], abs=1e-3)
    assert mu == pytest.approx(values.max(), rel=1e-6)


def test_the_best_slip_of_a_ratio_is_below_one_and_of_a_speed_at_ten():
    @law(mu=Output("1", "adhesion", positive="braking"), conditions={"one": {"c": 0.25}})
    def by_ratio(lam=Input("1", "slip ratio", positive="braking"),
                 v=Input("m/s", "speed"), c=Param("1", 0.5, "place")):  # fmt: skip
        """A parabola whose place goes with the speed."""
        return 0.3 - (lam - c * v / 10) ** 2

    assert trip.best(by_ratio, "one") == (pytest.approx(0.25, abs=1e-6), pytest.approx(0.3))


def test_what_an_axle_gets_that_cannot_be_relied_on(monkeypatch):
    def of(safe, mode):
        return control.safe_output(SimpleNamespace(control=SimpleNamespace(safe=safe),
                                                   vehicle=SimpleNamespace(mode=mode)))  # fmt: skip

    assert of("", "brake") == "demand"
    assert of("", "drive") == 0.0
    for safe in ("demand", "hold"):
        assert of(safe, "brake") == of(safe, "drive") == safe
    found = of("2 kN m", "brake")
    assert found == 2000.0
    assert isinstance(found, float)


def test_a_law_that_is_searched_goes_from_a_braking_slip_alone():
    part = SimpleNamespace(law="subway_braking.double_exponential", start={})
    curve, begin = control.law_and_guess(part)
    assert curve is not None
    assert set(begin) == {"c", "a", "b"}
    part.start = {"a": 0.7}
    _, changed = control.law_and_guess(part)
    assert changed == {"c": float(curve.params["c"].value), "a": 0.7,
                       "b": float(curve.params["b"].value)}  # fmt: skip
    for name in ("falling_creep", "never"):
        part.law = name
        with pytest.raises(BadInput):
            control.law_and_guess(part)


@pytest.mark.parametrize(("plan", "ahead"), [(p, a) for p in (False, True) for a in (False, True)])
def test_an_axle_of_a_train_has_the_parts_of_its_reference(monkeypatch, plan, ahead):
    monkeypatch.setattr(train_reference, "train_reference", lambda trip, part: "REFERENCE")
    monkeypatch.setattr(train_reference, "filling_rate", lambda trip: 5e3)
    part = SimpleNamespace(plan=plan, ahead=ahead, slip=0.15)
    parts, wires, where = train_reference.parts_of_train_slip(
        SimpleNamespace(actuator=SimpleNamespace(dead_time=0.06)), part
    )
    wanted = {"reference.v": "trust.v", "reference.mu": "sample.mu", "reference.v_s": "sample.v_s"}
    if plan:
        wanted |= {"reference.value": "plan.value", "reference.rate": "plan.rate"}
    assert parts["reference"] == "REFERENCE"
    if not ahead:
        assert (list(parts), wires, where) == (["reference"], wanted, "reference.v_best")
        return
    assert (list(parts), where) == (["reference", "fill"], "fill.v_best")
    wanted |= {"fill.v": "trust.v", "fill.v_s": "sample.v_s", "fill.own": "reference.v_best",
               "fill.ahead": "rail.ahead"}  # fmt: skip
    assert wires == wanted
    values = {n: float(v) for n, v in parts["fill"].param_values().items()}
    assert (values["slip"], values["rate"], values["dead"]) == (0.15, 5e3, 0.06)


def test_numbers_of_a_file_are_in_the_unit_of_their_signal():
    speed, share = Param("m/s", 1.0, "speed").named("v"), Param("1", 1.0, "share").named("k")
    assert of_study.in_unit("36 km/h", speed) == pytest.approx(10.0)
    assert of_study.in_unit(3, share) == 3.0
    assert isinstance(of_study.in_unit(3, share), float)
    for wrong, signal in ((3, speed), (True, share), (None, share), ("3 s", speed), ({}, share)):
        with pytest.raises(BadInput):
            of_study.in_unit(wrong, signal)


# ---- super-twisting and seekers ------------------------------------------------------------------


def test_gains_that_a_double_cannot_tell_apart_are_refused():
    good = {"k1": F(2), "k2": F(3), "L": F(1), "delta": F(0)}
    kind = super_twisting_kind
    kind._guard(good)
    kind._guard({**good, "k2": F(1)})  # the same is told
    kind._guard({**good, "k1": F(10**30), "L": F(1, 10**30)})
    for name in good:
        for far in (F(10**30) + 1, F(1, 10**30) / 2, F(-1)):
            with pytest.raises(BadInput, match=name):
                kind._guard({**good, name: far})
    for one, two in (("k2", "L"), ("k1", "delta")):
        with pytest.raises(BadInput, match=f"{one} and {two}"):
            kind._guard({**good, one: F(2), two: F(2) + F(1, 10**30)})


@pytest.mark.parametrize("name", list(super_twisting_kind.SIDES))
def test_a_gain_below_what_is_left_of_it_has_one_inequality(name):
    """Else those of the criterion, of k1 less delta."""
    criterion = super_twisting_kind._named(name)
    n = {"k1": F(5), "k2": F(3), "L": F(1), "delta": F(1)}
    sides = criterion.sides(n)
    assert sides[0].holds()
    own = super_twisting_kind.SIDES[name](F(4), F(3), F(1))
    assert [s.holds() for s in sides[1:]] == [s.holds() for s in own]
    assert len(sides) > 1
    for delta in (F(5), F(6)):
        (side,) = criterion.sides({**n, "delta": delta})
        assert not side.holds()
    assert criterion.proves == ("settles",)


def test_numbers_of_a_proof_are_written_shortest():
    for text in ("0.1", "-2.5", "1e-09", "0.0", "1000000.0", "-1000000.0"):
        assert dithering_kind._decimal(text, "P") == float(text)
    for wrong in ("0.10", "1", "1e6", "1000000.1", "nan", "inf", "x", "", 0.1, None,
                  "0." + "1" * 40):  # fmt: skip
        with pytest.raises(BadInput, match="P"):
            dithering_kind._decimal(wrong, "P")


# ---- errors inside bounds ------------------------------------------------------------------------


@pytest.fixture
def bounded(monkeypatch):
    """Errors of a law whose pieces are words, and what was asked of the replays."""
    asked = []
    for name in ("find_drift", "replay_drift", "replay", "replay_path", "check_polygons",
                 "find_polygons", "witness"):  # fmt: skip
        monkeypatch.setattr(
            bounded_error.interval_systems, name,
            lambda *a, name=name: asked.append((name, a)) or {"find_drift": None, "replay": 4,
                                                             "replay_path": 6}.get(name, name),
        )  # fmt: skip
    number = lambda value: lambda n, as_: value  # noqa: E731
    made = bounded_error.BoundedError(
        leaves="it leaves", bounds="band", unit="1/s", outward=" outwards", push=lambda n: 0.5,
        ticks=lambda n, as_: {"start": lambda k: ("tick", k), "middle": lambda k: ("last", k)},
        lagged=lambda n, as_: {"start": "LAGGED"},
        polygon_laws=lambda n, as_: (SimpleNamespace(r=n.get("r", 1), dead=n.get("left", 0)), "S"),
        start=number("START"), step=number("STEP"),
    )  # fmt: skip
    monkeypatch.setattr(bounded_error, "Interval", lambda a, b: ("interval", a, b))
    return SimpleNamespace(made=made, asked=asked)


N = {"T": F(1, 2), "lag": F(0), "dead": F(0)}
LATE = {**N, "lag": F(1)}


def test_errors_without_a_lag_are_replayed_by_their_ticks(bounded):
    made, asked = bounded.made, bounded.asked
    refuters = made.refuters()
    assert list(refuters) == ["drift", "run", "run_behind_the_actuator"]
    assert [(r.target, r.find, r.replay) for r in refuters.values()] == [
        ("stays", made._drift, made._replay_drift), ("stays", made._run, made._replay),
        ("stays", made._run_behind, made._replay_behind),
    ]  # fmt: skip
    assert made._replay(N, "RUN") == "it leaves after 2 s"
    ((name, (entry, laws, starts, step)),) = asked
    assert (name, entry, step) == ("replay", "RUN", "STEP")
    assert list(laws) == list(starts) == ["start", "middle"]
    assert starts["start"] == "START"
    assert "it leaves" in made._replay_drift(N, "DRIFT")
    assert asked[1] == ("replay_drift", ("DRIFT", ("last", 0)))
    for n, replay in ((LATE, made._replay), (N, made._replay_behind), (N, made._check_polygon)):
        with pytest.raises(DoesNotHold):
            replay(n, "RUN")
    assert made._run(LATE) is None
    assert made._run_behind(N) is None
    assert made._find_polygon(N) is None


def test_errors_behind_an_actuator_are_replayed_by_their_path(bounded):
    made, asked = bounded.made, bounded.asked
    assert made._replay_behind(LATE, "RUN") == "it leaves after 3 s"
    ((name, (entry, laws, _, step)),) = asked
    assert (name, entry, laws, step) == ("replay_path", "RUN", {"start": "LAGGED"}, "STEP")
    made._check_polygon(LATE, "GIVEN")
    name, (own, standing, start, step, given) = asked[-1]
    assert (name, standing, start, step, given) == ("check_polygons", "S", "START", "STEP", "GIVEN")
    assert own.r == 1
    made._check_polygon({**LATE, "r": 2}, "GIVEN")
    with pytest.raises(DoesNotHold):
        made._check_polygon({**LATE, "r": 2, "left": 1}, "GIVEN")
    assert made._find_polygon({**LATE, "r": 2, "left": 1}) is None
    assert made._find_polygon(LATE) == "find_polygons"
    evidence = made.polygon()
    assert (evidence.find, evidence.check) == (made._find_polygon, made._check_polygon)


def test_numbers_that_are_too_large_prove_nothing(bounded, monkeypatch):
    def overflows(*_):
        raise Overflow

    made = bounded.made
    for name in ("replay", "replay_path", "replay_drift", "check_polygons"):
        monkeypatch.setattr(bounded_error.interval_systems, name, overflows)
    for n, replay in ((N, made._replay), (N, made._replay_drift), (LATE, made._replay_behind),
                      (LATE, made._check_polygon)):  # fmt: skip
        with pytest.raises(DoesNotHold):
            replay(n, "RUN")


# ---- half turns and ticks of a plan --------------------------------------------------------------


@pytest.fixture
def planned(monkeypatch):
    """Half turns and rows that are words; their grids have so many parts."""
    asked = []
    falls = [True]

    class Rows:
        """Rows after so many ticks."""

        def __init__(self, grid, ticks=0, of="levels"):
            self.grid, self.ticks, self.of = grid, ticks, of

        def tick(self):
            return Rows(self.grid, self.ticks + 1, self.of)

        def finer(self, factor):
            asked.append(("finer", factor))
            grid = SimpleNamespace(parts=self.grid.parts * factor, height=None)
            return Rows(grid, self.ticks, self.of)

        def largest(self):
            return ("largest", self.grid.parts, self.ticks, self.of)

        def widest(self):
            return ("widest", self.grid.parts, self.ticks, self.of)

    class Sweep:
        def __init__(self, grid, most):
            self.grid, self.most = grid, list(most)
            asked.append(("sweep", grid.parts, list(most)))

        def falls(self):
            return falls[0]

        def bounds(self):
            return ("bounds", self.grid.parts, self.most)

        def rows(self):
            return Rows(self.grid, 0, f"crossing {self.most}")

    sampled = twisting_sampled
    monkeypatch.setattr(sampled, "Grid", lambda law, parts, bits: SimpleNamespace(
        parts=parts, height=F(1, parts), law=law, bits=bits))  # fmt: skip
    monkeypatch.setattr(sampled, "sweep", Sweep)
    monkeypatch.setattr(sampled, "cost", lambda grid, most: len(most))
    monkeypatch.setattr(sampled, "_work", lambda rows: 1.0)
    monkeypatch.setattr(sampled, "MOST_WORK", 10)
    levels = SimpleNamespace(law="LAW", kept=F(4), rows=Rows)
    return SimpleNamespace(asked=asked, falls=falls, levels=levels, Rows=Rows)


def test_half_turns_follow_each_other_from_the_polygon_on(planned):
    """Each begins with what the one before leads to; rows begin at the last crossing."""
    replay, levels = twisting_sampled.replay, planned.levels
    assert replay(levels, ((2, 8, 5),), ()) == ("bounds", 2, [8, 5])
    assert replay(levels, ((2, 8, 5), (4, 10, 7)), ()) == ("bounds", 4, [10, 7])
    assert replay(levels, ((2, 7, 5),), ()) is None  # 7/2 is less than 4
    assert replay(levels, ((2, 8, 5), (4, 9, 7)), ()) is None  # 9/4 is less than 5/2
    planned.falls[0] = False
    assert replay(levels, ((2, 8, 5),), ()) is None
    planned.falls[0] = True
    assert replay(levels, ((2, 8, 5),), ((4, 3),)) == (
        ("largest", 4, 3, "crossing [10]"), ("widest", 4, 3, "crossing [10]"))  # fmt: skip
    assert replay(levels, (), ()) is None


def test_ticks_of_a_plan_are_made_in_finer_and_finer_rows(planned):
    replay, levels = twisting_sampled.replay, planned.levels
    assert replay(levels, (), ((2, 3),)) == (
        ("largest", 2, 3, "levels"), ("widest", 2, 3, "levels"))  # fmt: skip
    assert replay(levels, (), ((2, 3), (6, 4)))[0] == ("largest", 6, 7, "levels")
    assert planned.asked == [("finer", 3)]
    assert replay(levels, (), ((2, 3), (5, 1))) is None
    assert replay(levels, (), ((2, 20),)) is not None
    assert replay(levels, (), ((2, 21),)) is None  # it takes too much
    assert replay(levels, ((2, 8, 5),), ((2, 19),)) is None
    assert replay(levels, ((2, 8, 5),), ((2, 18),)) is not None
    assert replay(levels, ((1, *range(25, 4, -1)),), ()) is None


def test_rows_that_overflow_prove_nothing(planned):
    class Over:
        def __init__(self, grid):
            raise OverflowError

    planned.levels.rows = Over
    assert twisting_sampled.replay(planned.levels, (), ((2, 3),)) is None


def test_a_certificate_goes_to_the_slip_that_its_reference_says():
    at = {"c": 1.0, "a": 0.54, "b": 1.2}
    rail = subway_braking.double_exponential
    goal = gains._goal(rail, "dry", at, 20.0, SlipSpeed(slip=0.8))
    assert goal == 0.8
    assert gains._goal(rail, "dry", at, 20.0, SlipRatio(slip=0.05)) == pytest.approx(1.0)
    with pytest.raises(BadInput):
        gains._goal(rail, "dry", at, 20.0, SlipRatio(slip=(0.05, 0.06)))
    searched = gains._goal(rail, "dry", at, 20.0, SimpleNamespace())
    assert searched == pytest.approx(math.log(1.2 / 0.54) / (1.2 - 0.54), abs=1e-3)

    @law(mu=Output("1", "adhesion", positive="braking"), conditions={"one": {"c": 0.25}})
    def by_ratio(lam=Input("1", "slip ratio", positive="braking"),
                 c=Param("1", 0.5, "place")):  # fmt: skip
        """A parabola of the ratio."""
        return 0.3 - (lam - c) ** 2

    found = gains._goal(by_ratio, "one", {"c": 0.25}, 20.0, SimpleNamespace())
    assert found == pytest.approx(5.0, abs=1e-4)
