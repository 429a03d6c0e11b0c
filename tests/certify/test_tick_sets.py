"""Loops that a user declares by their tick: verdicts against closed forms and plain runs."""

from __future__ import annotations

import copy
import math
from fractions import Fraction

import numpy as np
import pytest
from samples import line, relay

from slipctl.certify import proofs
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.smooth.sampled_loop import decimals
from slipctl.certify.systems import CERTIFIED, INPUT, REFUTED, TARGET, Number, System, report
from slipctl.certify.ticks.tick_sets import Loop, clip, if_else, root, sgn
from slipctl.certify.ticks.tick_source import _run_beside, code_of_tick
from slipctl.errors import BadInput

F = Fraction

NUMBERS = {
    "a": Number("1", "factor", low="any"),
    "T": Number("s", "period", 1.0),
    "g": Number("1/s", "gain", 0.0, "not negative"),
    "x0": Number("1", "largest |x| at the start", 0.0, "not negative"),
    "u0": Number("1", "largest |u| at the start", 0.0, "not negative"),
    "W": Number("1", "largest |w|", 0.0, "not negative", role=INPUT, says="every |w| <= {}"),
    "lag": Number("s", "lag", 0.0, "not negative", role=INPUT, says="a lag of {}"),
    "band": Number("1", "wanted |x|", optional=True, role=TARGET),
}


def declared(loop):
    return System("own", "somebody's loop", NUMBERS, {}, loop.targets(), loop.says_start(),
                  loop=loop)  # fmt: skip


LINE = declared(Loop(line, {"x": "x0"}, {"w": "W"}, {"x": "band"}))

RELAY = declared(Loop(relay, {"x": "x0", "u": "u0"}, {"w": "W"}, {"x": "band"}))


def largest(a, x0, W):
    """Largest |x| of x+ = a x + w: the start, or what the worst w builds up."""
    return max(x0, W / (1 - abs(a))) if abs(a) < 1 else np.inf if x0 or W else 0.0


@pytest.mark.long
def test_a_line_is_decided_but_for_the_width_of_a_cell():
    """No verdict against the closed form, and one for each band 5 % from it."""
    rng = np.random.default_rng(1)
    for _ in range(25):
        a, x0, W = rng.uniform(-1.2, 1.2), rng.uniform(0, 1), rng.uniform(0, 1)
        a, x0, W = (float(f"{v:.3f}") for v in (a, x0, W))
        most = largest(a, x0, W)
        for factor in (0.8, 0.95, 1.05, 1.3):
            band = (most if np.isfinite(most) else 5) * factor
            found = report(LINE, {"a": a, "x0": x0, "W": W, "band": band})
            far = abs(most / band - 1) > 0.04 and (abs(a) < 0.9 or abs(a) > 1.02)
            if most > band:
                assert found.verdict != CERTIFIED
                assert found.verdict == REFUTED or not far
            else:
                assert found.verdict != REFUTED
                assert found.verdict == CERTIFIED or not far


def test_a_relay_behind_its_lag_against_plain_runs():
    """Two states and a sign; runs of random pushes never pass a band that was certified."""
    numbers = {"a": 0.3, "T": 0.1, "g": 2, "x0": 0.2, "u0": 1, "W": 0.3}
    rng, worst = np.random.default_rng(2), 0.0
    for _ in range(300):
        x, u = rng.choice([-0.2, 0.2]), rng.choice([-1, 1])
        for w in 0.3 * rng.choice([-1, 1], 200):
            x, u = x + 0.1 * (-2 * x + u + w), 0.3 * u - 0.7 * np.sign(x)
            worst = max(worst, abs(x))
    verdicts = {}
    for band in (0.9 * worst, 1.5 * worst):
        payload = proofs.write(RELAY, {**numbers, "band": F(f"{band:.4f}")})
        verdicts[band] = payload["verdict"]
        assert payload["verdict"] in proofs.check(RELAY, payload)
    assert list(verdicts.values()) == [REFUTED, CERTIFIED]


def test_an_input_that_the_tick_never_looks_at_is_not_withstood():
    numbers = {"a": 0.5, "W": 0.1, "band": 1}
    assert report(LINE, numbers).verdict == CERTIFIED
    assert report(LINE, {**numbers, "lag": 0.1}).verdict == "UNDECIDED"
    unsaid = report(LINE, numbers).decision.promise.not_promised
    assert (
        "that its tick is what runs: it is taken from the declaration, without rounding" in unsaid
    )


def test_altered_certificates_fail():
    numbers = {"a": F(1, 2), "W": F(1, 10), "band": F(1)}
    good = proofs.write(LINE, numbers)
    proofs.check(LINE, good)
    evidence = good["proofs"]["cells"]["evidence"]
    grid, (cells,) = evidence["grid"], evidence["cells"]
    wrong = (
        ("cells", []), ("cells", [{**cells, "cells": ""}]), ("cells", [{**cells, "modes": [1]}]),
        ("grid", {**grid, "origin": [grid["origin"][0] + 1]}), ("grid", {**grid, "size": ["0"]}),
        ("reach", {"x": "1/6"}), ("reach", {"x": "2"}),
    )  # fmt: skip
    for name, value in wrong:
        bad = copy.deepcopy(good)
        bad["proofs"]["cells"]["evidence"][name] = value
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(LINE, bad)
    refuted = proofs.write(LINE, {**numbers, "W": F(1)})
    proofs.check(LINE, refuted)
    runs = (([0], []), ([5], []), ([], []), ([0], [[1, 2]]), ([0], [[30_000, 1]]))
    for run in runs:
        bad = copy.deepcopy(refuted)
        bad["counterexample"]["run"] = dict(zip(("start", "pushes"), run, strict=True))
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(LINE, bad)


def asked(tick, **numbers):
    """Verdict on a tick of one state x and one push w."""
    loop = Loop(tick, {"x": "x0"}, {"w": "W"}, {"x": "band"})
    told = {"a": F(1, 2), "x0": F(1), "W": F(1, 10), "band": F(3, 2), **numbers}
    return report(declared(loop), told).verdict


def test_comparisons_and_literals_of_a_tick_are_what_python_does():
    """Each branch counts where its condition holds, and only there."""
    assert asked(lambda n, x, d: {"x": 0.5 * x["x"] + d["w"]}) == CERTIFIED
    assert asked(lambda n, x, d: {"x": (0 if x["x"] > 0 else x["x"] / 2) + d["w"]}) == CERTIFIED
    kicked = lambda n, x, d: {"x": x["x"] / 2 + (5 if x["x"] == 0 else 0)}  # noqa: E731
    assert asked(kicked, x0=F(0), W=F(0)) == REFUTED
    assert asked(kicked) != CERTIFIED
    assert asked(lambda n, x, d: {"x": x["x"] / 2 + (5 if x["x"] > 4 else 0)}, W=F(0)) == CERTIFIED
    assert asked(lambda n, x, d: {"x": max(min(x["x"], 0.3), -0.3) + d["w"]}) == CERTIFIED
    assert asked(lambda n, x, d: {"x": 2 * x["x"] if x["x"] else d["w"]}) == REFUTED
    assert (
        asked(lambda n, x, d: {"x": abs(x["x"]) ** 2 / 4 - (-1 < x["x"] < 1) / 10}, W=F(0))
        == CERTIFIED
    )


def test_a_value_that_is_the_same_over_all_cells_is_checked():
    """A limit far outside makes constants of intervals, and a comparison asks for rows of them."""

    def tick(n, x, d):
        capped = min(max(x["u"], -0.7), 1e-3)
        other = 1 if if_else(x["x"] > 0.25, x["x"], x["x"]) / 2 else clip(x["x"], -0.1, 0.3)
        return {"x": 0.9 * sorted((capped, other))[0] + d["w"], "u": 0.9 * x["u"]}

    loop = Loop(tick, {"x": "x0", "u": "u0"}, {"w": "W"}, {"x": "band"})
    told = {"a": F(1), "x0": F(0), "u0": F(0), "W": F(0), "band": F(3, 10)}
    payload = proofs.write(declared(loop), told)
    assert payload["verdict"] == CERTIFIED
    proofs.check(declared(loop), payload)


COUNT = [0]
GAIN = 0.5
HOLDER = {"gain": 0.5}


def counts(n, x, d):
    """A tick that another tick hears of."""
    COUNT[0] += 1
    return {"x": x["x"] / 2 + (5 if COUNT[0] > 3000 else 0)}


def counting():
    """A tick that keeps its own count."""
    seen = 0

    def tick(n, x, d):
        nonlocal seen
        seen += 1
        return {"x": x["x"] / 2 + (5 if seen > 3000 else 0)}

    return tick


def caught(n, x, d):
    """A tick that swallows what it is refused."""
    try:
        return {"x": x["x"] // 1 * 9}
    except TypeError:
        return {"x": 0 * x["x"]}


def keeps(n, x, d, memory=[]):  # noqa: B006
    """A tick with a default that keeps what is put into it."""
    memory.append(1)
    return {"x": x["x"] / 2 + len(memory)}


def looks_again(n, x, d):
    """A tick with a name that an inner function reads, before one that cannot be read."""
    own = x["x"]
    return {"x": own * 0 + sum(own for _ in (1,)) + hash(own)}


@pytest.mark.parametrize(
    ("tick", "says"),
    [
        (looks_again, "hash"),
        (lambda n, x, d: {"x": int(x["x"])}, "int"),
        (lambda n, x, d: {"x": round(x["x"], 1)}, "round"),
        (lambda n, x, d: {"x": 2 * x["x"] // 1}, "a cast, a rounding"),
        (lambda n, x, d: {"x": np.sign(x["x"])}, "np.sign"),
        (lambda n, x, d: {"x": 2 if isinstance(x["x"], float) else 0}, "isinstance"),
        (lambda n, x, d: {"x": 2 if x["x"] is n["a"] else 0}, "same object"),
        (lambda n, x, d: {"x": 2 if x["x"] is not None else 0}, "same object"),
        (lambda n, x, d: {"x": len(f"{x['x']}")}, "a text of a number"),
        (lambda n, x, d: {"x": x["x"].real}, "attribute real"),
        (lambda n, x, d: {"x": {0: 5}.get(x["x"], 0)}, "a cast"),
        (lambda n, x, d: {"x": HOLDER["gain"] * x["x"]}, "HOLDER"),
        (lambda n, x, d: {"x": np.random.default_rng() * x["x"]}, "np.random"),
        (lambda n, x, d: {"y": x["x"]}, "gives no 'x'"),
        (lambda n, x, d: {"x": x["x"] * float("inf")}, "float"),
        (counts, "COUNT"),
        (counting(), "seen"),
        (caught, "catches an error"),
        (keeps, "in a default"),
        (COUNT.append, "builtin"),
        (lambda n, x, d: {"x": x["x"] % 1}, "a cast, a rounding"),
        (lambda n, x, d: {"x": (0, 5)[x["x"] > 3]}, "a cast, a rounding"),
        (lambda n, x, d: {"x": 5 * ((x["x"] > 1) ^ (x["x"] > 2))}, "a cast, a rounding"),
        (lambda n, x, d: {"x": 2 ** x["x"]}, "a cast, a rounding"),
        (lambda n, x, d: {"x": divmod(x["x"], 1)[0]}, "divmod"),
        (lambda n, x, d: {"x": math.fsum([x["x"], 3])}, "math.fsum"),
        (lambda n, x, d: {"x": math.copysign(3, x["x"])}, "math.copysign"),
        (lambda n, x, d: {"x": np.where(x["x"] > 0, 5, 0)}, "np.where"),
        (lambda n, x, d: {"x": np.float32(0.1) * x["x"]}, "np.float32"),
        (lambda n, x, d: {"x": hash(x["x"]) % 2}, "hash"),
        (lambda n, x, d: {"x": min(float("nan"), x["x"])}, "float"),
        (lambda n, x, d: {"x": x["x"] * 1e308 * 10 / (1e308 * 10)}, "no finite number"),
        (lambda n, x, d: {"x": next(iter(x.values()))}, "next"),
        (lambda n, x, d: {"x": (x["x"] + 1j).real}, "attribute real"),
    ],
)  # fmt: skip
def test_a_tick_that_cannot_be_read_is_refused_in_words(tick, says):
    with pytest.raises(BadInput, match=says) as told:
        asked(tick)
    assert "\n" not in str(told.value)


def test_a_tick_that_is_run_gives_what_was_read_of_it():
    """Where it gives nothing, as for a zero, it is asked at other numbers."""
    groups = ((), ("x",), ("w",))
    code = code_of_tick(lambda n, x, d: {"x": 1 / x["x"] + d["w"]}, groups, ("x",))
    _run_beside(lambda n, x, d: {"x": d["w"] + 1 / x["x"]}, code, groups)
    with pytest.raises(BadInput, match="when it is run"):
        _run_beside(lambda n, x, d: {"x": 2 / x["x"] + d["w"]}, code, groups)


def test_a_tick_may_use_numbers_of_its_file_and_functions_of_its_own():
    def own(value, gain=0.25):
        return gain * value

    assert asked(lambda n, x, d: {"x": GAIN * x["x"] + own(d["w"])}) == CERTIFIED
    assert asked(lambda n, x, d: {"x": sum(own(v) for v in (x["x"], d["w"]))}) == CERTIFIED


@pytest.mark.parametrize("tick", [
    lambda n, x, d: {"x": 5 if 0.1 < x["x"] < 0.2 else x["x"] / 2},
    lambda n, x, d: {"x": x["x"] / 2 if not (0 < x["x"] <= 0.005 < n["a"]) else 7},
    lambda n, x, d: {"x": (y := x["x"] / 2) + (3 if (y := 2 * y) > 0.9 else 0)},
    lambda n, x, d: {"x": 5 if any(x["x"] > k for k in (0.3, 0.4)) else x["x"] / 2},
    lambda n, x, d: {"x": 3 * (x["x"] > 0.2) - (x["x"] > 0.4) * True},
    lambda n, x, d: {"x": 5 if x["x"] in (0, 1) else x["x"] / 2},
    lambda n, x, d: {"x": (x["x"] or 5) / 2},
    lambda n, x, d: {"x": (x["x"] > 0.3 and 5) or x["x"] / 2},
    lambda n, x, d: {"x": sorted([x["x"] / 2, 30 * x["x"], -1 * x["x"]])[-1]},
    lambda n, x, d: {"x": min([30 * x["x"], x["x"] / 2], key=lambda z: -z)},
    lambda n, x, d: {"x": max((v for v in [30 * x["x"]] if x["x"] > 0.3), default=x["x"] / 2)},
    lambda n, x, d: {"x": 0 * x["x"] + (x["x"] / x["x"] if x["x"] != 0 else 3)},
    lambda n, x, d: {"x": sum([x["x"] > 0.1, x["x"] > 0.2, x["x"] > 0.3])},
    lambda n, x, d: {"x": x.get("x", 0) / 2 + (3 if "y" not in x else 0)},
    lambda n, x, d: {"x": x["x"] / 2 + x["x"] * 10**400 / 10**399},
])  # fmt: skip
def test_what_python_makes_of_a_tick_is_never_certified_if_a_run_leaves(tick):
    """Chains, assignments inside, truth of a number, generators, keys, defaults, large integers."""
    assert asked(tick, W=F(0), band=F(11, 10)) != CERTIFIED


def test_an_interval_is_no_number():
    """A comparison, a truth or a cast of an interval is an error, never an answer."""
    one = decimals(F(0), F(1))
    for wrong in (lambda: one == 0, lambda: bool(one), lambda: one > 0, lambda: hash(one),
                  lambda: float(one), lambda: int(one), lambda: one // 1, lambda: round(one),
                  lambda: one != one, lambda: one in (0, 1)):  # fmt: skip
        with pytest.raises(TypeError):
            wrong()


@pytest.mark.long
def test_functions_enclose_what_they_do_to_numbers():
    rng = np.random.default_rng(3)
    for _ in range(200):
        low, high = np.sort(rng.uniform(-2, 2, 2)).tolist()
        for of in (sgn, root, lambda x: clip(x, -1, F(1, 2))):
            a, b = of(decimals(F(low), F(high))).ends()
            for x in np.linspace(low, high, 7).tolist():
                assert float(a) - 1e-12 <= of(x) <= float(b) + 1e-12  # floats round
