"""Steps of the optimum of a train, each against plain loops with curves written anew."""

from __future__ import annotations

from math import exp, sqrt

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.models.wheel_rail import train_optimum
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.sliding_train import SlidingTrain, stop
from slipctl.models.wheel_rail.train_optimum import LocalRule, Program, Rule, program
from tests.models.test_caution_of_trains import adhesion

LEAVES = falling_creep.with_params(mu_0=0.04, A=0.7, B=0.2)
G = 9.7


def train(behind=(0.0, 2.7, 8.1), **changes):
    usual = dict(load=5.8e4, tau=2.1e-4, slip=0.27, most=0.11, resistance=(0.013, 2.3e-5),
                 gravity=G, layers=1.2, gradient=0.004, t_gamma=1500.0)  # fmt: skip
    return SlidingTrain(LEAVES, falling_creep, behind, **usual | changes)


def both(e, v):
    return adhesion(e, v, 0.04, 0.7, 0.2), adhesion(e, v, 0.15, 0.5, 0.15)


def found_by(t, e, v, W, fouled=1.0):
    """Adhesion of an axle that finds an energy."""
    low, high = both(e, v)
    q = 1 - np.exp(-((t.tau * W) ** t.layers)) if fouled else 1.0
    return np.minimum((1 - q) * low + q * high, t.most)


def test_a_train_is_what_its_curves_and_numbers_say():
    t = train(stretches=((5.0, 9.0), (20.0, 21.5)))
    e = np.array([0.003, 0.02, 0.2])
    for got, wanted in zip(t.heights(e, 13.0), both(e, 13.0), strict=True):
        assert got == pytest.approx(wanted, rel=1e-10)
    assert t.recovered([0.0, 3e3, 9e3]) == pytest.approx(
        [1 - exp(-((2.1e-4 * W) ** 1.2)) for W in (0.0, 3e3, 9e3)])  # fmt: skip
    assert t.lost(20.0) == pytest.approx(0.013 + 2.3e-5 * 400 + G * 0.004)
    assert t.axles == 3
    assert t.cells_behind(0.5).tolist() == [0, 5, 16]
    places = np.array([4.9, 5.0, 8.9, 9.0, 20.0, 21.4, 21.5])
    assert t.fouled_at(places).tolist() == [False, True, True, False, True, True, False]
    assert train().fouled_at(places).all()
    for name in ("load", "most", "slip", "layers", "gravity"):
        for value in (0.0, -1.0):
            with pytest.raises(BadInput, match=name):
                train(**{name: value})
    for tau in (-1e-9, np.inf, np.nan):
        with pytest.raises(BadInput, match="no finite strength"):
            train(tau=tau)


def test_a_program_has_the_best_of_all_slips_in_each_of_its_rows():
    t, v = train(), 14.0
    found = program(t, v)
    e = np.concatenate([[1e-5], np.geomspace(1e-4, 0.27, 400)])
    top = max(k.max() for k in both(e, v))
    assert found.W[0] == 0
    assert found.W[-1] == pytest.approx(3 * t.load * min(0.11, top) * 0.27)
    assert found.W[1] == pytest.approx(1e-4 * found.W[-1])
    assert found.slip.shape == found.value.shape == (3, 401)
    for row in (0, 150, 300, 400):
        W = found.W[row]
        f = found_by(t, e, v, W)
        left = t.load * f * e
        behind = np.zeros(401)
        for m in range(3):
            total = np.where(left <= 1500.0, f + np.interp(W + left, found.W, behind), -np.inf)
            best = int(np.argmax(total))
            assert found.slip[m, row] == pytest.approx(e[best])
            assert found.value[m, row] == pytest.approx(total[best])
            behind = found.value[m]
    own = program(t, v, 1)
    assert own.slip.shape == (1, 401)
    assert own.slip[0, 0] == found.slip[0, 0]


def test_slips_of_a_program_lie_between_its_rows():
    W = np.array([0.0, 10.0, 30.0])
    table = Program(W, np.array([[0.1, 0.2, 0.6], [1.0, 3.0, 4.0]]), np.zeros((2, 3)))
    found = table.slips(np.array([1, 0, 1]), np.array([5.0, 20.0, 90.0]))
    assert found == pytest.approx([2.0, 0.4, 4.0])


@pytest.mark.parametrize("greedy", [False, True])
def test_a_rule_takes_the_program_of_the_nearest_speed(monkeypatch, greedy):
    """Two speeds by m/s; on clean rail each axle has the first slip of the largest adhesion."""
    asked = []

    def made(t, v, axles):
        asked.append((v, axles))
        many = axles or t.axles
        slip = 0.01 * v + np.arange(many)[:, None] / 10 + np.zeros(3)
        return Program(np.array([0.0, 1.0, 2.0]), slip, slip)

    monkeypatch.setattr(train_optimum, "program", made)
    t = train()
    rule = Rule(t, greedy, fastest=6.0)
    speeds = np.linspace(0.5, 6.0, 12)
    fouled = np.array([True, False, True])
    e = np.geomspace(1e-4, 0.27, 400)
    for v, nearest in ((0.0, 0.5), (2.76, 3.0), (2.74, 2.5), (40.0, 6.0)):
        near = speeds[np.abs(speeds - nearest).argmin()]
        clean = e[np.minimum(both(e, near)[1], t.most).argmax()]
        behind = np.zeros(3) if greedy else np.array([2, 1, 0])
        wanted = np.where(fouled, 0.01 * near + behind / 10, clean)
        assert rule(0.0, v, np.array([0.3, 0.0, 1.2]), fouled) == pytest.approx(wanted)
    assert [v for v, _ in asked] == pytest.approx(speeds)
    assert {axles for _, axles in asked} == {1 if greedy else None}


@pytest.mark.parametrize("recovered", [None, 0.09])
def test_a_local_rule_seeks_the_best_of_its_own_law(recovered):
    t = train(t_gamma=600.0)
    rule = LocalRule(t, 0.7, recovered, fastest=2.0)
    e = np.geomspace(1e-4, 0.27, 300)
    speeds, shares, table = rule._tables
    assert speeds == pytest.approx([0.5, 1.0, 1.5, 2.0])
    assert shares == pytest.approx(np.arange(65) / 64)
    for i, j in ((0, 0), (1, 20), (3, 64)):
        low, high = both(e, speeds[i])
        top = high.max() if recovered is None else recovered
        k = 0.7 * 2.1e-4 * 5.8e4 * (top - low.max())
        f = np.minimum((1 - j / 64) * low + j / 64 * high, 0.11)
        for axle, behind in enumerate((2, 1, 0)):
            worth = np.log(f) + behind * k * np.maximum(1 - f / top, 0) * e
            worth = np.where(5.8e4 * f * e <= 600, worth, -np.inf)
            assert table[i, j, axle] == pytest.approx(e[worth.argmax()])
    W, fouled = np.array([500.0, 2500.0, 900.0]), np.array([True, True, False])
    q = np.where(fouled, 1 - np.exp(-((2.1e-4 * W) ** 1.2)), 1.0)
    wanted = [np.interp(q[k], shares, table[2, :, k]) for k in range(3)]
    assert rule(7.0, 1.4, W, fouled) == pytest.approx(wanted)


def test_a_stop_goes_cell_by_cell_by_the_midpoint_rule():
    """On rail that is fouled in part; each axle finds what those before it left in its cell."""
    t = train(stretches=((0.6, 3.9),), gradient=-0.002)
    seen = []

    def slips(x, v, W, fouled):
        seen.append((x, v, W.copy(), fouled.copy()))
        return np.array([0.02, 0.05, 0.11]) * (1 + 0.1 * x)

    cell = 0.5
    found = stop(t, slips, 3.3, cell)
    off, W, z, k, calls = (0, 5, 16), {}, 3.3**2 / 2, 0, 0

    def forces(x, z):
        nonlocal calls
        v = sqrt(2 * z)
        place = [k - o for o in off]
        dirty = [0.6 <= (p + 0.5) * cell < 3.9 for p in place]
        energy = [W.get(p, 0.0) for p in place]
        X, V, E, D = seen[calls]
        calls += 1
        assert (pytest.approx(x), pytest.approx(v)) == (X, V)
        assert pytest.approx(energy) == E
        assert D.tolist() == dirty
        e = np.array([0.02, 0.05, 0.11]) * (1 + 0.1 * x)
        f = np.array([found_by(t, e[i], v, energy[i], dirty[i]) for i in range(3)])
        return G * f.mean() + t.lost(v), f, e

    while True:
        x = (k + 0.5) * cell
        a, f, e = forces(x, z)
        middle = z - a * cell / 2
        if middle > 0:
            a, f, e = forces(x, middle)
        if z - a * cell <= 0:
            break
        assert found.x[k] == pytest.approx(x)
        assert found.v[k] == pytest.approx(sqrt(2 * middle))
        assert found.f[k] == pytest.approx(f)
        assert found.e[k] == pytest.approx(e)
        assert found.W[k] == pytest.approx([W.get(k - o, 0.0) for o in off])
        for i, o in enumerate(off):
            W[k - o] = W.get(k - o, 0.0) + t.load * f[i] * e[i]
        z -= a * cell
        k += 1
    assert k > 8
    assert len(found.x) == k
    assert calls == len(seen)
    assert found.distance == pytest.approx(k * cell + z / a)


def test_a_point_is_refined_within_what_a_contact_bears():
    """The axles leave what they may, where more would be better for those behind."""
    t, v = train(t_gamma=np.inf), 14.0
    slips, total = train_optimum.refined_point(t, v, np.array([0.1, 0.05, 0.02]))
    W = height = 0.0
    for e in slips:
        f = (1 - exp(-((t.tau * W) ** t.layers))) if W else 0.0
        low, high = both(e, v)
        f = (1 - f) * low + f * high
        height += f
        W += t.load * f * e
    assert total == pytest.approx(height, rel=1e-6)
    tight, less = train_optimum.refined_point(train(t_gamma=200.0), v, np.array([0.1, 0.05, 0.02]))
    assert less < total
    low, _ = both(tight[0], v)
    assert t.load * low * tight[0] <= 200 * (1 + 1e-6)
    assert tight.max() <= 0.27 + 1e-6
    assert tight.min() >= 1e-5 - 1e-8
