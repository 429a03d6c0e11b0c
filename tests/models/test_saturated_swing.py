"""Swings of a mass under a saturated command, against its equation solved by scipy."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slipctl.certify.entries import DoesNotHold
from slipctl.models.wang_2025.certificate import saturated_motion as swing
from slipctl.models.wang_2025.certificate import saturation_kind
from slipctl.models.wang_2025.certificate.saturated_motion import Saturated, half_turn, turn

LAW = Saturated(0.5, 0.3, (0.9, 0.35), (0.5, 0.7))
"""Cut at each limit of either way, from 4 on: strongly at first, weakly at the end."""


def rest(law: Saturated, s: float) -> tuple[float, float]:
    """Where a motion from rest at e1 = s comes to rest next, on the other side, and how fast it is.

    Under the worst need: e2' is -y, cut at the strong limit and the weak one.
    """
    strong, weak = law.left

    def rate(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -min(max(law.stiff * x[0] + law.damp * x[1], -weak), strong)]

    def stops(t: float, x: np.ndarray) -> float:
        return x[1] if t > 1e-3 else -1.0

    stops.terminal, stops.direction = True, 1  # type: ignore[attr-defined]
    found = solve_ivp(rate, (0, 99), [s, 0.0], events=stops, rtol=1e-9, atol=1e-11, max_step=0.05)
    return -float(found.y_events[0][0][0]), float(-found.y[1].min())


@pytest.mark.parametrize("law", [LAW, LAW.turned()])
def test_a_half_turn_lies_between_its_bounds_which_close_in_with_the_steps(law) -> None:
    far, fast = rest(law, 4.0)
    gaps = []
    for steps in (30, 120):
        high, low = (half_turn(law, 4.0, above, steps) for above in (True, False))
        assert high is not None
        assert low is not None
        assert low[0] - 1e-6 < far < high[0] + 1e-6
        assert low[1] - 1e-6 < fast < high[1] * 1.001
        gaps.append((high[0] - low[0], high[1] - low[1]))
        for found, above in ((high, True), (low, False)):
            exact = half_turn(
                Saturated(*(Decimal(str(v)) for v in (law.stiff, law.damp)),
                          tuple(Decimal(str(v)) for v in law.left),
                          tuple(Decimal(str(v)) for v in law.right)),
                Decimal(4), above, steps,
            )  # fmt: skip
            assert exact is not None
            assert [float(v) for v in exact] == pytest.approx(found, rel=1e-12)
    for many, few in zip(*gaps, strict=True):
        assert few < many / 3
    assert gaps[1][0] < 0.06 * far


def test_a_turn_is_a_half_turn_and_another_seen_from_the_other_side() -> None:
    one = half_turn(LAW, 4.0, True, 60)
    assert one is not None
    two = half_turn(LAW.turned(), one[0], True, 60)
    assert two is not None
    assert turn(LAW, 4.0, True, 60) == (two[0], max(one[1], two[1]), one[0])
    back = turn(LAW.turned(), 4.0, True, 60)
    assert back[1] == half_turn(LAW.turned(), 4.0, True, 60)[1]  # the first is the faster one
    slow = Saturated(0.5, 2.0, (0.9, 0.9), (0.9, 0.9))
    assert turn(slow, 1.0, False, 30) == half_turn(slow, 1.0, False, 30)  # no way beyond 0
    assert turn(slow, 1.0, False, 30)[0] <= 0 < turn(slow, 1.0, False, 30)[1]
    assert half_turn(Saturated(1.0, 0.0, (1.0, 1e-6), (1.0, 1.0)), 1.0, True, 30) is None


def test_the_error_dies_out_from_nearer_and_comes_back_from_further() -> None:
    """Where R R(s) is s itself, by bisection on what scipy finds."""
    law = Saturated(0.5, 0.3, (0.9, 0.3), (0.9, 0.3))

    def grows(s: float) -> bool:
        return rest(law, s)[0] > s

    low, high = 0.5, 30.0
    for _ in range(7):
        low, high = ((low, (low + high) / 2) if grows((low + high) / 2)
                     else ((low + high) / 2, high))  # fmt: skip
    assert swing.dies_out(law, 0.9 * low)
    assert not swing.comes_back(law, 0.9 * low)
    assert swing.comes_back(law, 1.1 * high)
    assert not swing.dies_out(law, 1.1 * high)
    assert not swing.dies_out(law, 0.9 * low, 2)  # with a step so long nothing is seen
    side = Saturated(0.5, 0.3, (0.9, 0.05), (0.9, 0.9))
    assert swing.dies_out(side, 1.0) == swing.dies_out(side.turned(), 1.0)


def test_numbers_of_the_motion_are_what_is_left_of_the_limits() -> None:
    made = swing.motion(2.0, 3.0, 10.0, -70.0, 90.0, -20.0, 40.0)
    assert (made.stiff, made.damp) == (6.0, 5.0)
    assert made.left == (11.0, 5.0)  # 40 is needed: 110 below it, 50 above
    assert made.right == (11.0, 5.0)
    other = swing.motion(2.0, 3.0, 10.0, -70.0, 90.0, -30.0, 40.0)
    assert (other.left, other.right) == ((11.0, 5.0), (12.0, 4.0))
    assert other.turned() == Saturated(6.0, 5.0, (12.0, 4.0), (11.0, 5.0))
    assert swing.exactly([Fraction(1, 3), Fraction(-5, 4)]) == [
        Decimal("0." + "3" * swing.DIGITS), Decimal("-1.25")]  # fmt: skip


# ---- as evidence ---------------------------------------------------------------------------------

NUMBERS: Any = {k: Fraction(v) for k, v in dict(
    k1="0.5", k3="0.2", M=500000, F_min=-100000, F_max=100000, F_low=-40000, F_high=50000, start=4,
).items()}  # fmt: skip


def test_steps_of_a_ladder_are_those_that_are_tried() -> None:
    for steps in swing.FINER:
        saturation_kind._check(NUMBERS, {"steps": steps})
    with pytest.raises(DoesNotHold, match="must be one of"):
        saturation_kind._check(NUMBERS, {"steps": 77})
    with pytest.raises(DoesNotHold, match="not shown to die out"):
        saturation_kind._check(NUMBERS | {"F_high": Fraction(100000)}, {"steps": 100})
    saturation_kind._check(NUMBERS | {"start": Fraction(0)}, {"steps": 30})


def test_the_first_number_of_steps_that_shows_it_exactly_is_taken(monkeypatch) -> None:
    """One that shows it in floats alone is passed over, and so is one that does not."""
    tried: list[int] = []

    def check(n: Any, given: Any) -> None:
        tried.append(given["steps"])
        if given["steps"] == 20:
            raise DoesNotHold("not exactly")

    monkeypatch.setattr(swing, "FINER", (10, 20, 40, 80))
    monkeypatch.setattr(swing, "dies_out", lambda law, start, steps: steps > 10)
    monkeypatch.setattr(saturation_kind, "_check", check)
    assert saturation_kind._find(NUMBERS) == {"steps": 40}
    assert tried == [20, 40]
    for nothing in ({"F_high": Fraction(100000)}, {"F_high": Fraction(-40000)}):
        assert saturation_kind._find(NUMBERS | nothing) is None
    monkeypatch.setattr(swing, "FINER", (10, 20))
    assert saturation_kind._find(NUMBERS) is None


FAR: Any = NUMBERS | {"F_high": Fraction(95000), "F_low": Fraction(-95000),
                      "start": Fraction(40), "k1": Fraction(2), "k3": Fraction(1)}  # fmt: skip


@pytest.mark.parametrize("side", [1, -1])
def test_a_run_that_comes_back_refutes_and_another_does_not(side) -> None:
    run = {"e1": str(side * 40), "need_while_e2_negative": "95000",
           "need_while_e2_positive": "-95000"}  # fmt: skip
    assert saturation_kind._worst(FAR) == run | {"e1": "40"}
    said = saturation_kind._replay(FAR, run)
    assert said.startswith(f"from rest at e1 = {side * 40} m it comes to rest as far out")
    for wrong in ({"e1": "41"}, {"need_while_e2_negative": "94000"},
                  {"need_while_e2_positive": "95000"}):  # fmt: skip
        with pytest.raises(DoesNotHold, match="a start or a need that is not allowed"):
            saturation_kind._replay(FAR, run | wrong)
    with pytest.raises(DoesNotHold, match="comes back nearer"):
        saturation_kind._replay(FAR | {"start": Fraction(1, 100)}, run | {"e1": f"{side}/100"})
    out = {"F_high": Fraction(100000)}
    with pytest.raises(DoesNotHold, match="out of reach"):
        saturation_kind._replay(FAR | out, run | {"need_while_e2_negative": "100000"})
    assert saturation_kind._worst(FAR | out) is None
    assert saturation_kind._worst({k: v for k, v in FAR.items() if k != "start"}) is None


def test_the_witness_is_the_mass_under_its_limits() -> None:
    """Step by step of 0.02 s, each thirtieth is shown; by another program of the same steps."""
    n = {k: float(v) for k, v in FAR.items()}
    shown = saturation_kind._witness(n)
    e, v, rows = 40.0, 0.0, []
    for k in range(3000):
        need = 95e3 if v < 0 or k == 0 else -95e3
        F = np.clip(need - 5e5 * (3 * v + 2 * e), -1e5, 1e5)
        e, v = e + 0.02 * v, v + 0.02 * (F - need) / 5e5
        rows.append((0.02 * (k + 1), e, v))
    t, e1, e2 = (shown.trajectory[name] for name in ("t", "e1", "e2"))
    assert [t[0], e1[0], e2[0]] == ["s", "m", "m/s"]
    np.testing.assert_allclose(np.column_stack([t[1], e1[1], e2[1]]), rows[::30], rtol=1e-9)
    assert shown.found["position_error_after_60_s"] == (pytest.approx(e), "m")
    assert shown.found["speed_error_after_60_s"] == (pytest.approx(v), "m/s")
    out = saturation_kind._witness(n | {"F_low": -2e5, "F_high": 5e4})
    assert out.found["speed_error_after_60_s"][0] == pytest.approx(60 * 1e5 / 5e5, rel=1e-9)
    high = saturation_kind._witness(n | {"F_low": -2e5, "F_high": 1.5e5})
    assert high.found["speed_error_after_60_s"][0] == pytest.approx(-60 * 5e4 / 5e5, rel=1e-9)
