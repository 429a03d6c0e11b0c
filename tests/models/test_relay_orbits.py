"""Periodic runs of the reaching law behind a lag, against runs of the equations tick by tick."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from slipctl.certify.entries import DoesNotHold
from slipctl.models.huang_2020.certificate import relay_orbits, relay_proof, relay_sets
from slipctl.models.huang_2020.certificate.relay_orbits import HALF_PERIODS, prove_orbit
from slipctl.models.huang_2020.certificate.relay_sets import Relay

F = Fraction
SWINGING = Relay(F(36), F(12), F(1, 1000), F(42, 10000), F(5))
FREE = Relay(F(0), F(12), F(1, 1000), F(42, 10000), F(3))


def after(law: Relay, x: np.ndarray, push: float) -> np.ndarray:
    """State (s, a) a tick later: s' = a + d, lag a' = u - a with u held, solved by hand."""
    s, a = x
    u = -float(law.g1) * s - float(law.g2) * np.sign(s)
    T, lag = float(law.T), float(law.lag)
    left = np.exp(-T / lag)
    s += u * T + (a - u) * lag * (1 - left) + T * push * float(law.D)
    return np.array([s, u + (a - u) * left])


def settled(law: Relay, push: Any, ticks: int = 2500) -> tuple[list[np.ndarray], list[float]]:
    """States of the last period of a run, and what pushed it."""
    x, states, pushes = np.array([0.02, 0.5]), [], []
    for k in range(ticks):
        d = push(k, x)
        states.append(x)
        pushes.append(d)
        x = after(law, x, d)
    for n in range(1, 400):
        same = pushes[-n:] == pushes[-2 * n : -n]
        if same and np.abs(states[-n] - x).max() < 1e-11:
            return states[-n:], pushes[-n:]
    raise AssertionError("no period")


WAYS = {
    "nothing": lambda k, x: 0,
    "one side": lambda k, x: 1,
    "to and fro": lambda k, x: 1 if k // 13 % 2 else -1,
    "along": lambda k, x: int(np.sign(x[0])),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_period_is_that_of_the_run_itself(way: str) -> None:
    """Where it starts, and the largest |s| on it."""
    states, pushes = settled(SWINGING, WAYS[way])
    signs = tuple(int(np.sign(s)) for s, _ in states)
    assert 3 < len(signs) < 100
    largest, start = prove_orbit(SWINGING, signs, tuple(pushes))
    assert [float(v) for v in start] == pytest.approx(list(states[0]), abs=1e-9)
    assert float(largest) == pytest.approx(max(abs(s) for s, _ in states), rel=1e-8)
    for k in (0, len(signs) // 2, len(signs) - 1):  # another sign is another run
        for other in (-signs[k], 0):
            with pytest.raises(DoesNotHold, match="not have the sign"):
                prove_orbit(SWINGING, (*signs[:k], other, *signs[k + 1 :]), tuple(pushes))


def test_without_the_slope_a_period_starts_where_it_is_told_to() -> None:
    """A run whose ticks on both sides are as many, so that the signs sum up to nothing."""
    found, pushes = settled(FREE, WAYS["nothing"])
    signs = tuple(int(np.sign(v)) for v, _ in found)
    assert sum(signs) == 0
    near = Fraction(float(found[0][0]))
    largest, (s, a) = prove_orbit(FREE, signs, tuple(pushes), near)
    assert abs(s - near) < F(1, 10**30)
    assert float(a) == pytest.approx(found[0][1], abs=1e-9)
    x = np.array([float(s), float(a)])
    states = []
    for _ in signs:
        states.append(x)
        x = after(FREE, x, 0)
    assert x == pytest.approx(states[0], abs=1e-12)
    assert [int(np.sign(v)) for v, _ in states] == list(signs)
    assert float(largest) == pytest.approx(max(abs(v) for v, _ in states), rel=1e-10)


def test_a_period_that_does_not_come_back_is_refused() -> None:
    """Without the slope the ticks of both sides have to be as many, less what is pushed."""
    with pytest.raises(DoesNotHold, match="drifts"):
        prove_orbit(FREE, (1, 1, -1), (0, 0, 0), F(1, 100))
    with pytest.raises(DoesNotHold, match="drifts"):
        prove_orbit(FREE, (1, -1), (1, 0), F(1, 100))
    four = Relay(FREE.g1, FREE.g2, FREE.T, FREE.lag, F(4))
    with pytest.raises(DoesNotHold, match="not have the sign"):  # 12 - 12 + 12 is 3 times 4
        prove_orbit(four, (1, -1, 1), (1, 1, 1), F(-1, 10))
    for law in (SWINGING, FREE):
        with pytest.raises(DoesNotHold, match="no single start"):
            prove_orbit(law, (), ())


def test_a_run_is_replayed_from_its_start_and_beyond_its_band() -> None:
    states, pushes = settled(SWINGING, WAYS["to and fro"])
    signs = [int(np.sign(s)) for s, _ in states]
    largest, start = prove_orbit(SWINGING, tuple(signs), tuple(pushes))
    numbers = {"g1": F(36), "g2": F(12), "T": F(1, 1000), "lag": F(42, 10000), "D": F(5)}

    def replay(
        s: F = start[0], a: F = start[1], band: F = largest - F(1, 10**9), **more: Any
    ) -> str:
        entry = {"start": {"s": str(s), "a": str(a)}, "signs": signs,
                 "d": [str(5 * p) for p in pushes]}  # fmt: skip
        return relay_proof._replay(numbers | {"band": band}, entry | more)

    said = replay()
    assert f"period {len(signs)} ticks" in said
    near = max(largest, F(12, 1000)) / 10**6
    assert replay(s=start[0] + near * F(9, 10)) == replay(s=start[0] - near * F(9, 10)) == said
    far = near * (1 + 1 / F(42, 10000))  # a is s over the lag
    assert replay(a=start[1] + far * F(9, 10)) == replay(a=start[1] - far * F(9, 10)) == said
    for wrong in ({"s": start[0] + near * F(11, 10)}, {"a": start[1] - far * F(11, 10)}):
        with pytest.raises(DoesNotHold, match="does not start where"):
            replay(**wrong)
    with pytest.raises(DoesNotHold, match="inside the band"):
        replay(band=largest)
    with pytest.raises(DoesNotHold, match="is not -D, 0 or D"):
        replay(d=["5"] * (len(signs) - 1) + ["4"])
    with pytest.raises(DoesNotHold, match="a lag and a period"):
        replay(signs=[], d=[])


def test_ticks_that_take_too_long_are_refused(monkeypatch) -> None:
    """As many corners are moved as are told, and no more."""
    law = relay_proof.law(
        {"g1": F(36), "g2": F(12), "T": F(1, 1000), "lag": F(42, 10000), "D": F(5)}
    )
    start = relay_sets.find(law)
    assert start is not None
    numbers = {"g1": law.g1, "g2": law.g2, "T": law.T, "lag": law.lag, "D": law.D}
    entry = {"corners": [[str(s), str(a)] for s, a in start.corners], "ticks": 2, "bound": "1000"}
    ticker = relay_sets.Ticker(start)
    work = len(ticker.points) + 4
    ticker.tick()
    work += len(ticker.points) + 4
    monkeypatch.setattr(relay_proof, "MOST_WORK", F(work, 2))
    monkeypatch.setattr(relay_proof, "whole", lambda value, where, low, high: value)
    relay_proof._check(numbers, entry)
    monkeypatch.setattr(relay_proof, "MOST_WORK", F(work - 1, 2))
    with pytest.raises(DoesNotHold, match="too long"):
        relay_proof._check(numbers, entry)


@pytest.mark.parametrize("law", [SWINGING, FREE])
def test_the_runs_of_a_search_are_runs_of_the_equations(law: Relay) -> None:
    """Each of the ways to push it, from each start: the next tick, and the sign and push told."""
    S, A, sides, D = (v.reshape(60, -1, 24) for v in relay_orbits._runs(law, 0.02, 7, 60))
    assert S.shape == (60, 6 + len(HALF_PERIODS), 24)
    assert (sides == np.sign(S)).all()
    for way, start in ((0, 3), (1, 5), (2, 0), (3, 23), (4, 11), (5, 2), (6, 7), (19, 17)):
        for k in range(59):
            x = after(law, np.array([S[k, way, start], A[k, way, start]]), D[k, way, start])
            assert [S[k + 1, way, start], A[k + 1, way, start]] == pytest.approx(
                x, rel=1e-9, abs=1e-12
            )
    assert (D[:, 0] == 1).all()
    assert (D[:, 1] == np.sign(A[:, 1])).all()
    assert (D[:, 2] == sides[:, 2]).all()
    assert (D[:, 3] == -sides[:, 3]).all()
    assert (D[:, 4] == np.sign(A[:, 4] - float(law.g2) * sides[:, 4])).all()
    for j, half in enumerate(HALF_PERIODS):
        for k in range(60):
            assert (D[k, 6 + j] == (-1 if (k + 7) // half % 2 else 1)).all()
