"""Proofs by sums: against closed forms and plain runs of loops that were written for the test."""

from __future__ import annotations

import copy
from fractions import Fraction

import numpy as np
import pytest

from slipctl.certify import proofs
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import CERTIFIED, INPUT, REFUTED, TARGET, Number, System
from slipctl.certify.smooth.sums import Bounds, NoProof, check_cell, find_cell
from slipctl.certify.ticks.tick_sets import Loop
from slipctl.errors import BadInput

F = Fraction

NUMBERS = {
    "K": Number("1/s", "gain"), "Ki": Number("1/s^2", "integral gain", low="not negative"),
    "T": Number("s", "tick", role=INPUT, says="a tick of {}"),
    "bend": Number("1/m", "second slope of the curve", 0.0, "any"),
    "slope": Number("1/s", "slope of the curve at rest", 0.0, "any"),
    "lag": Number("s", "lag", 0.05, role=INPUT, says="a lag of {}"),
    "none": Number("1", "zero", 0.0, "not negative"),
    "e0": Number("m/s", "start", 0.0, "not negative"),
    "W": Number("m/s^2", "push", 0.0, "not negative", role=INPUT, says="every |w| <= {}"),
    "band": Number("m/s", "wanted |e|", optional=True, role=TARGET),
}  # fmt: skip


def pi(delay):
    """A PI behind a lag and so many ticks of dead time, on a curve with slope and bend."""
    states = ["e", "i", "a", *(f"q{k}" for k in range(delay))]

    def tick(n, x, d):
        e, n_T = x["e"], n["T"]
        wanted = -n["K"] * e - x["i"]
        last = x[f"q{delay - 1}"] if delay else wanted
        after = {
            "e": e + n_T * (x["a"] - n["slope"] * e - n["bend"] * e * e + d["w"]),
            "i": x["i"] + n_T * n["Ki"] * e,
            "a": x["a"] + n_T / n["lag"] * (last - x["a"]),
        }
        return after | {f"q{k}": x[f"q{k - 1}"] if k else wanted for k in range(delay)}

    start = {s: "e0" if s == "e" else "none" for s in states}
    loop = Loop(tick, start, {"w": "W"}, {"e": "band"})
    return System("own", "PI", NUMBERS, {}, loop.targets(), loop.says_start(), loop=loop)


def told(system, **numbers):
    given = {"K": 6, "Ki": 4, "T": F(1, 100), "W": F(1, 10), **numbers}
    return proofs.exact_numbers(system, {k: F(str(v)) for k, v in given.items()})


def bound(system, numbers):
    """Half-width of e that is proved, by check."""
    sampled, cell, bounds = system.loop.sampled(numbers)
    entry, _ = find_cell(sampled, cell, bounds)
    return float(check_cell(sampled, bounds, entry)[1][0])


def worst(numbers, delay, seed=0, runs=400, ticks=1500):
    """Largest |e| of plain runs: the signs of the impulse response, and random blocks."""
    n = {k: float(v) for k, v in numbers.items()}
    states = 3 + delay

    def after(x, w):
        e, i, a = x[0], x[1], x[2]
        wanted = -n["K"] * e - i
        last = x[-1] if delay else wanted
        rows = [e + n["T"] * (a - n["slope"] * e - n["bend"] * e * e + w),
                i + n["T"] * n["Ki"] * e, a + n["T"] / n["lag"] * (last - a)]  # fmt: skip
        return np.array([*rows, *([wanted, *x[3:-1]] if delay else [])])

    A = np.array([after(np.eye(states)[k] * 1e-6, 0) for k in range(states)]).T / 1e-6
    h, v = [], np.eye(states)[0] * n["T"]
    for _ in range(ticks):
        h.append(v[0])
        v = A @ v
    rng = np.random.default_rng(seed)
    pushes = [np.sign(h[::-1]), -np.sign(h[::-1])]
    for _ in range(6):
        pushes.append(np.repeat(rng.choice([-1, 1], ticks), rng.choice([1, 10, 60]))[:ticks])
    pushes += [None] * 5  # the signs of the gradient along the run before
    far, row = 0.0, None
    for start in (1, -1):
        gradient = pushes[0]
        for push in pushes:
            x, path = np.zeros(states), []
            x[0] = n["e0"] * start
            for w in gradient if push is None else push:
                path.append(x[0])
                x = after(x, w * n["W"])
            far = max(far, abs(x[0]), *map(abs, path))
            row, signs = np.eye(states)[0] * np.sign(x[0]), []
            for e in reversed(path):
                signs.append(np.sign(row[0]))
                along = A.copy()
                along[0, 0] -= 2 * n["T"] * n["bend"] * e
                row = row @ along
            gradient = np.array(signs[::-1]) if push is None or push is pushes[0] else gradient
    return far


def test_of_a_linear_loop_the_bound_is_the_sum_of_its_impulse_response():
    """Exact but for the room of the search, and never below."""
    for delay, numbers in ((0, {}), (5, {"K": 4, "slope": -1}), (12, {"K": 3, "Ki": 1})):
        n = told(pi(delay), **numbers)
        far = worst(n, delay)
        assert far <= bound(pi(delay), n) <= 1.01 * far


@pytest.mark.long
def test_random_loops_on_a_bent_curve_are_proved_closely_and_never_falsely():
    """Slopes of both signs at rest, dead times; a start off rest is added to what pushes."""
    rng, ratios = np.random.default_rng(4), []
    for case in range(6):
        delay = int(rng.integers(0, 12))
        n = told(pi(delay), K=round(rng.uniform(3, 8), 2), Ki=round(rng.uniform(0.5, 5), 2),
                 slope=round(rng.uniform(-1, 1.5), 2), bend=round(rng.uniform(-2.5, 2.5), 2),
                 W=round(rng.uniform(0.05, 0.3), 3),
                 e0=0.02 * (case == 5))  # fmt: skip
        try:
            proved = bound(pi(delay), n)
        except NoProof:
            continue
        far = worst(n, delay, seed=case)
        assert far <= proved
        ratios.append(proved / far)
    print(sorted(ratios))
    assert len(ratios) >= 5
    assert np.median(ratios) <= 1.12
    assert max(ratios) <= 1.6


@pytest.mark.long
def test_more_of_what_pushes_or_starts_is_never_easier():
    """No holes: on a grid there is a proof up to an end, and none beyond."""
    system = pi(6)
    for name, values in (("W", np.linspace(0.02, 0.6, 5)), ("e0", np.linspace(0, 0.12, 4))):
        certified = []
        for v in values:
            n = told(system, bend=2, band=0.08, **{name: round(v, 4)})
            certified.append(proofs.proof(system.loop.criteria(n)["sums"], n) is not None)
        assert certified == sorted(certified, reverse=True)
        assert certified[0]
        assert not certified[-1]


def test_a_band_that_a_run_leaves_is_refuted_by_it():
    system = pi(6)
    n = told(system)
    far = worst(n, 6)
    for band, verdict in ((0.97 * far, REFUTED), (1.02 * far, CERTIFIED)):
        payload = proofs.write(system, told(system, band=round(band, 6)))
        assert payload["verdict"] == verdict
        proofs.check(system, payload)


def test_altered_proofs_fail():
    system = pi(3)
    n = told(system, bend=2, band="0.1")
    good = proofs.write(system, n)
    proofs.check(system, good)
    evidence = good["proofs"]["sums"]["evidence"]
    smaller = [str(F(z) * F(9, 10)) for z in evidence["box"]]
    for name, value in (("box", smaller), ("decay", "1"), ("decay", "1/2"), ("ticks", 3),
                        ("A", evidence["A"][1:]), ("rest", ["1/10"] * 6),
                        ("P", [["1"] * (i + 1) for i in range(6)]), ("sizes", [0] * 6),
                        ("slow", [])):  # fmt: skip
        bad = copy.deepcopy(good)
        bad["proofs"]["sums"]["evidence"][name] = value
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(system, bad)


def test_why_there_is_no_proof_is_said():
    with pytest.raises(NoProof, match="unstable: its spectral radius is"):
        bound(pi(12), told(pi(12), K=30))
    loop = Loop(lambda n, x, d: {"e": x["e"] / 2 + (x["e"] > 0) * n["T"] + d["w"]}, {"e": "e0"},
                {"w": "W"}, {"e": "band"})  # fmt: skip
    sampled, cell, _ = loop.sampled({"T": F(1), "e0": F(1), "W": F(1), "band": F(9)})
    with pytest.raises(NoProof, match=r"condition \(0 < x_e\) is open"):
        find_cell(sampled, cell, Bounds((F(1),), (F(1),)))
