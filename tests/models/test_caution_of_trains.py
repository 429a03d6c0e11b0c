"""How much of a strength a train counts on: its steps, each worked out with plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl.models.wheel_rail import train_caution
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.sliding_train import SlidingTrain

LEAVES = falling_creep.with_params(mu_0=0.04, A=0.7, B=0.2)
G = 9.7


def train(axles=3, **changes):
    usual = dict(load=5.8e4, tau=2.1e-4, slip=0.27, most=0.11, resistance=(0.013, 2.3e-5),
                 gravity=G, layers=1.2)  # fmt: skip
    return SlidingTrain(LEAVES, falling_creep, tuple(2.7 * k for k in range(axles)),
                        **usual | changes)  # fmt: skip


def adhesion(e, v, mu_0, A, B):
    """Of the law, written anew."""
    s = e * v
    mu = mu_0 * ((1 - A) * np.exp(-B * s) + A)
    eps = 300 * s / np.hypot(v, 0.1) / mu
    return 2 * mu / np.pi * (0.3 * eps / (1 + (0.3 * eps) ** 2) + np.arctan(0.1 * eps))


RATIOS = np.geomspace(1e-3, 0.27, 150)


def curves(v):
    return adhesion(RATIOS, v, 0.04, 0.7, 0.2), adhesion(RATIOS, v, 0.15, 0.5, 0.15)


def values_behind(axles, rate, low, high, most):
    """What 0, 1, ... axles transmit over the nodes, of one share of the strength."""
    nodes, found = np.linspace(0, 1, 17), [np.zeros(17)]
    for _ in range(axles - 1):
        new = []
        for q in nodes:
            f = np.minimum((1 - q) * low + q * high, most)
            left = 1 - (1 - q) * np.exp(-rate * f * RATIOS)
            new.append((f + np.interp(left, nodes, found[-1])).max())
        found.append(np.array(new))
    return found


def force(t, v, share, factor, plan):
    """Adhesions of all axles over a rail point, with a share of the strength, and a true one."""
    low, high = curves(v)
    rate = share * t.tau * t.load
    k = rate * (high.max() - low.max())
    values = values_behind(t.axles, rate, low, high, t.most)
    W = total = 0.0
    for behind in range(t.axles - 1, -1, -1):
        q = 1 - np.exp(-((t.tau * factor * W) ** t.layers))
        f = np.minimum((1 - q) * low + q * high, t.most)
        left = 1 - (1 - q) * np.exp(-rate * f * RATIOS)
        by_plan = f + np.interp(left, np.linspace(0, 1, 17), values[behind])
        by_law = np.log(f) + behind * k * np.maximum(1 - f / high.max(), 0) * RATIOS
        at = np.argmax(by_plan if plan else by_law)
        total += f[at]
        W += t.load * f[at] * RATIOS[at]
    return total


@pytest.mark.parametrize("plan", [False, True])
def test_adhesions_over_a_rail_point_are_those_of_axle_after_axle(plan):
    t, factors = train(), np.geomspace(0.4, 2.5, 7)
    found = train_caution._forces(t, 17.0, factors, plan)
    assert found.shape == (51, 7)
    for share, factor in ((0, 0), (7, 6), (25, 3), (50, 1), (50, 6)):
        wanted = force(t, 17.0, share / 50, factors[factor], plan)
        assert found[share, factor] == pytest.approx(wanted, rel=1e-9)


def test_values_of_a_plan_are_those_of_axle_after_axle():
    t = train(4)
    low, high = curves(17.0)
    rate = train_caution.SHARES[:, None, None] * t.tau * t.load
    found = train_caution._values(t, RATIOS, (low, high), rate)
    assert len(found) == 4
    for share in (0, 20, 50):
        wanted = values_behind(4, share / 50 * t.tau * t.load, low, high, t.most)
        for rows, row in zip(found, wanted, strict=True):
            assert rows[share] == pytest.approx(row, rel=1e-9)


def test_a_longer_way_is_the_sum_over_the_speeds(monkeypatch):
    """dx = v dv/a by trapezoids, up from .15 of the speed; a by adhesions and what else brakes."""
    t, seen = train(), []

    def forces(one, v, factors, plan):
        seen.append((v, factors, plan))
        return np.array([[0.1], [0.1 * (1 - v / 100)], [0.12]]) * factors

    monkeypatch.setattr(train_caution, "_forces", forces)
    found = train_caution._later(t, 40.0, 2.0, True)
    assert found.shape == (24, 3, 7)
    speeds, factors = np.linspace(6.0, 40.0, 25), np.geomspace(0.5, 2, 7)
    assert [v for v, *_ in seen] == pytest.approx(speeds)
    assert all(plan is True and given == pytest.approx(factors) for _, given, plan in seen)

    def way(share, factor, upto):
        def slow(v):
            height = (0.1, 0.1 * (1 - v / 100), 0.12)[share] * factors[factor]
            return v / (G * height / 3 + 0.013 + 2.3e-5 * v**2)

        rows = np.array([slow(v) for v in speeds[: upto + 2]])
        return np.sum(rows[1:] + rows[:-1])

    for k, share, factor in ((0, 1, 0), (11, 2, 6), (23, 1, 3), (23, 0, 2)):
        wanted = way(share, factor, k) / way(0, factor, k) - 1
        assert found[k, share, factor] == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize(("lost", "gained", "learn", "share"), [
    ({}, (-0.01, -0.02), False, 1.0),  # nothing is lost
    ({30: 0.0191}, (-0.01, -0.02), False, 0.58),  # the last share before more than 1.9 % is
    ({30: 0.0189}, (-0.01, -0.02), False, 1.0),
    ({}, (-0.0049, -0.02), False, 0.0),  # less than half a percent is gained as believed
    ({}, (-0.0049, -0.02), True, 1.0),  # but much if it is stronger, and that is learnt
    ({}, (-0.0051, 0.0), False, 1.0),
    ({3: 0.02}, (-0.01, -0.02), False, 0.0),  # what is gained begins at a share of .1
])  # fmt: skip
def test_a_share_is_the_largest_that_loses_little_where_something_is_gained(
    monkeypatch, lost, gained, learn, share
):
    later = np.zeros((4, 51, 7))
    later[-1, 5:, 3], later[-1, 5:, -1] = gained
    for k, value in lost.items():
        later[1, k, 2] = value
    asked = []
    monkeypatch.setattr(train_caution, "_later", lambda *a: asked.append(a) or later)
    t = train()
    found = train_caution.cautious_share(t, 33.0, 2.5, plan=True, learn=learn)
    assert found == pytest.approx(share)
    assert asked == [(t, 33.0, 2.5, True)]
    assert train_caution.cautious_share(train(2), 33.0) == 0.0
    assert len(asked) == 1
