"""Swarms and evolution against the same search in plain Python; boxes and folds in numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_seek import by_hand, search

from slipctl import Input, Output, Param, law, particle_swarm
from slipctl.seek import population, random
from slipctl.seek.evolution import _memory, _numbers
from slipctl.seek.population import Box, first, reflect_at_faces, trial
from slipctl.seek.random import FACTORS, MODULI


@pytest.mark.parametrize(
    ("n", "crossover", "generations", "seed"),
    [(13, 0.6, 5, 11), (4, 1.0, 3, 7), (11, 0.3, 2, 2), (5, 0.6, 2, 2604)],
)
def test_evolution_is_the_algorithm_bit_for_bit(n, crossover, generations, seed):
    """Of a block and a rest, less than one, one and a single member; a draw at the very share."""
    block = search(population=n, crossover=crossover, generations=generations, seed=seed)
    state, y = block(c=0.7, a=0.4, b=1.3)
    rng, best, value = by_hand(n, crossover, generations, seed, 0.7, 0.4, 1.3)
    assert state["rng"].tolist() == rng
    assert y == {"best": best, "value": value}


def test_numbers_and_memory_of_a_search():
    numbers = _numbers("m", -2.0, 7.0, 0.35)
    assert [(s.name, s.unit, s.value, s.lo, s.hi) for s in numbers] == [
        ("lo", "m", -2.0, -1e12, 1e12), ("hi", "m", 7.0, -1e12, 1e12),
        ("crossover", "1", 0.35, 0, 1), ("F0", "1", 0.5, 0.01, 2),
    ]  # fmt: skip
    memory = _memory("m", "N", 6, 3)
    assert [(s.name, s.unit, s.shape) for s in memory] == [
        ("pop", "m", (6,)), ("val", "N", (6,)), ("at", "1", (3,)), ("G", "1", ()),
        ("place", "m", ()), ("height", "N", ()), ("searches", "1", ()),
    ]  # fmt: skip
    assert [float(np.ravel(s.value)[0]) for s in memory] == [0, 0, 0, 1, 0, 0, 0]


# ---- swarms --------------------------------------------------------------------------------------


@law(f=Output("1", "height"))
def bowl(
    x=Input("m", "one"), tilt=Input("1", "further input"), y=Input("s", "other"),
    deep=Param("1", 2.0, "factor"),
):  # fmt: skip
    """An oval bowl."""
    return deep * (x - 0.3) ** 2 + (y + 1.2) ** 2 + tilt * x * y


BOX = {"x": (-1.0, 3.0), "y": (-2.0, 0.5)}


def swarm_by_hand(n, iterations, seed, weight, c1, c2, clamp, tilt, deep):
    """The search as its documentation tells it; (rng, place, value)."""
    rng = [int(v) for v in random.state_from_seed(seed)]
    lo, hi = np.array([*BOX.values()]).T

    def draw():
        rng[:] = [f * v % m for f, v, m in zip(FACTORS, rng, MODULI, strict=True)]
        return [v / m for v, m in zip(rng, MODULI, strict=True)]

    def value(z):
        return deep * (z[0] - 0.3) ** 2 + (z[1] + 1.2) ** 2 + tilt * z[0] * z[1]

    x = np.array([[sum(draw()) % 1 for _ in range(2)] for _ in range(n)]) * (hi - lo) + lo
    v, own = np.zeros_like(x), x.copy()
    least = np.array([value(z) for z in x])
    for k in range(1, iterations + 1):
        best, w = own[least.argmin()].copy(), weight(k / iterations)
        for j in range(n):
            r = [*draw(), draw()[0]]  # r1 and r2 of x, then of y
            pull = np.array([[c1 * r[0], c2 * r[1]], [c1 * r[2], c2 * r[3]]])
            step = w * v[j] + pull[:, 0] * (own[j] - x[j]) + pull[:, 1] * (best - x[j])
            v[j] = np.clip(step, -clamp * (hi - lo), clamp * (hi - lo))
            x[j] = np.clip(x[j] + v[j], lo, hi)
            if value(x[j]) < least[j]:
                own[j], least[j] = x[j], value(x[j])
    return rng, own[least.argmin()], least.min()


@pytest.mark.parametrize(
    ("n", "iterations", "seed", "clamp", "falls"),
    [(5, 4, 3, 0.5, False), (12, 3, 8, (0.2, 0.07), False), (7, 5, 5, 0.3, True)],
)
def test_a_swarm_is_the_algorithm(n, iterations, seed, clamp, falls):
    """One step after the other, all seeing the best of the iteration before."""
    weight = (lambda s: 0.9 - 0.5 * s) if falls else (lambda s: 0.6)
    block = particle_swarm(
        bowl, BOX, particles=n, iterations=iterations, seed=seed, c1=1.25, c2=1.75,
        inertia=weight if falls else 0.6, clamp=clamp,
    )  # fmt: skip
    assert list(block.inputs) == ["tilt", "deep"]
    state, found = block(tilt=0.4, deep=1.5)
    rng, place, value = swarm_by_hand(
        n, iterations, seed, weight, 1.25, 1.75, np.array(clamp), 0.4, 1.5)  # fmt: skip
    assert state["rng"].tolist() == rng
    assert [found["x"], found["y"]] == pytest.approx(place, rel=1e-12)
    assert found["value"] == pytest.approx(value, rel=1e-12)


def test_settings_of_a_swarm():
    block = particle_swarm(bowl, BOX)
    told = {n: (s.value, s.lo, s.hi) for n, s in block.params.items() if n != "deep"}
    assert told == {"inertia": (0.73, 0, 2), "c1": (1.5, 0, 4), "c2": (1.5, 0, 4),
                    "clamp": (0.5, 1e-9, 1)}  # fmt: skip
    assert "inertia" not in particle_swarm(bowl, BOX, inertia=lambda s: s).params
    assert [s.unit for s in block.outputs.values()] == ["m", "s", "1"]


# ---- populations ---------------------------------------------------------------------------------


def test_a_box_is_linear_or_logarithmic_by_each_range():
    """1..10 is logarithmic, its ends ten apart, 1..9.9 and -1..100 are not."""
    box = Box([1.0, 1.0, -1.0, 0.01], [10.0, 9.9, 100.0, 1.0])
    assert box.logarithmic.tolist() == [True, False, False, True]
    share = np.array([0.25, 0.5, 0.75, 0.5])
    point = np.array([10**0.25, 1 + 8.9 / 2, -1 + 101 * 0.75, 0.1])
    assert box.point(share) == pytest.approx(point, rel=1e-14)
    assert box.share(point) == pytest.approx(share, rel=1e-13)
    slopes = [point[0] * math.log(10), 8.9, 101.0, point[3] * math.log(100)]
    assert box.by_share(share) == pytest.approx(slopes, rel=1e-13)
    assert box.point(np.full(4, 1.25)).tolist() == [10, 9.9, 100, 1]
    assert box.point(np.full(4, -0.25)).tolist() == [1, 1, -1, 0.01]


def test_points_are_folded_back_at_the_faces():
    x = np.array([-0.25, 0.0, 0.4, 1.0, 1.25, 1.9, 2.25, -1.1, 3.3])
    folded = [0.25, 0.0, 0.4, 1.0, 0.75, 0.1, 0.25, 0.9, 0.7]
    assert reflect_at_faces(x) == pytest.approx(folded)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_first_points_are_one_in_each_stratum(seed):
    points = first(7, 3, seed)
    assert points.shape == (7, 3)
    assert np.sort(np.floor(7 * points), axis=0).tolist() == [[k] * 3 for k in range(7)]
    assert len({tuple(r) for r in np.floor(7 * points.T).tolist()}) == 3
    assert (points == first(7, 3, seed)).all()
    assert (points != first(7, 3, seed + 1)).any()


@pytest.mark.parametrize("i", [0, 2, 4])
def test_a_trial_goes_towards_the_best_by_a_difference_of_two_others(i, monkeypatch):
    """Each of its numbers is new, by one factor in 0.4..0.9, or that of its member."""
    monkeypatch.setattr(population, "reflect_at_faces", lambda x: x)
    rng = np.random.default_rng(3)
    members, best = rng.random((6, 4)), 2
    kept, factors = 0, []
    for key in range(40):
        made = trial(members, best, i, [key, 5])
        x = members[i]
        new = made != x
        assert new.any()
        kept += (~new).sum()
        fits = []
        for a in range(6):
            for b in range(6):
                if len({a, b, i, best}) == 4 - (i == best):
                    way = members[best] - x + members[a] - members[b]
                    F = (made - x)[new] / way[new]
                    fits += [F[0]] if np.ptp(F) < 1e-12 and 0.4 <= F[0] <= 0.9 else []
        assert fits
        factors += fits[:1] if len(fits) == 1 else []
        assert (trial(members, best, i, [key, 5]) == made).all()
    assert 3 <= kept <= 40  # a tenth of 160, less those that have to be new
    assert min(factors) < 0.45
    assert max(factors) > 0.85
    assert (trial(members, best, i, [1, 5], crossover=0.0) != members[i]).sum() == 1
    assert (trial(members, best, i, [1, 5], crossover=1.0) != members[i]).all()
