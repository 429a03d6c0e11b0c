"""Random PI loops of many states: sums, which hold for ever, and tubes, which hold for a time.

The loops are run here in floats, by matrices and pushes of this file: the signs of the impulse
response, random blocks, and the signs of the gradient along the worst run so far. No CERTIFIED band
may be left, and each counterexample has to leave it. A smaller push or start is asked too: what was
certified has to stay so.
"""

from __future__ import annotations

import random
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from adversary.common import Tally, trial_of_cases

TICK = 0.01


def after(n: dict[str, float], x: np.ndarray, w: float) -> np.ndarray:
    """Next states of error, integral, actuator and the registers of the dead time."""
    e, i, a = x[0], x[1], x[2]
    wanted = -n["K"] * e - i
    last = x[-1] if len(x) > 3 else wanted
    rows = [e + TICK * (a - n["slope"] * e - n["bend"] * e * e + w),
            i + TICK * n["Ki"] * e, a + TICK / n["lag"] * (last - a)]  # fmt: skip
    return np.array([*rows, *([wanted, *x[3:-1]] if len(x) > 3 else [])])


def farthest(n: dict[str, float], states: int, ticks: int, seed: int, rounds: int) -> float:
    """Largest |e| of runs."""
    rng = np.random.default_rng(seed)
    A = np.array([after({**n, "bend": 0}, row, 0.0) for row in np.eye(states)]).T
    h, v = [], np.eye(states)[0]
    for _ in range(ticks):
        h.append(v[0])
        v = A @ v
    pushes: list[Any] = [np.sign(h[::-1]), -np.sign(h[::-1])]
    for _ in range(rounds):
        stay = rng.choice([1, 8, 40])
        pushes.append(np.repeat(rng.choice([-1, 1], ticks), stay)[:ticks])
    far = 0.0
    for start in (1.0, -1.0):
        best, signs = -1.0, pushes[0]
        for push in [*pushes, None, None, None]:
            push = signs if push is None else push
            x, path = np.zeros(states), []
            x[0] = start * n["e0"]
            for w in push:
                path.append(x[0])
                x = after(n, x, w * n["W"])
            now = max(abs(x[0]), *map(abs, path))
            far = max(far, now)
            if now > best:  # the signs that would have driven this run farther
                best, row, turned = now, np.eye(states)[0] * np.sign(x[0] or 1), []
                for e in reversed(path):
                    turned.append(np.sign(row[0]))
                    along = A.copy()
                    along[0, 0] -= 2 * TICK * n["bend"] * e
                    row = row @ along
                signs = np.array(turned[::-1])
    return far


def one(seed: int, within: bool) -> tuple[str, str]:
    """Verdict on a random loop, and what is false of it; empty if nothing."""
    from slipctl.certify import proofs
    from slipctl.certify.cells.mode_proofs import WORK

    rng = random.Random(seed)
    delay = rng.choice((0, 0, 2, 5))
    plain = {"K": rng.uniform(1, 5), "Ki": rng.uniform(0.1, 4), "slope": rng.uniform(-1, 2),
             "bend": rng.choice((0.0, rng.uniform(-3, 3))), "lag": rng.uniform(0.03, 0.12),
             "W": rng.uniform(0, 0.3), "e0": rng.choice((0.0, rng.uniform(0, 0.05)))}  # fmt: skip
    plain = {k: round(v, 3) for k, v in plain.items()}
    ticks = rng.choice((5, 30, 100)) if within else 400
    states = 3 + delay
    far = farthest(plain, states, ticks, seed, 3)
    band = min(far, 1e3) * rng.choice((0.7, 0.97, 1.02, 1.2, 1.5)) or 0.1
    numbers = {k: Fraction(str(v)) for k, v in plain.items()} | {"band": Fraction(f"{band:.5g}")}
    numbers |= {"T": Fraction(1, 100), "none": Fraction(0)}
    # cells, which are tried where sums fail, have an adversary of their own: here one of ten times
    system = _system(delay, within, WORK if seed % 10 == 0 else 1)
    if within:
        numbers["ticks"] = Fraction(ticks)

    def verdict(given: dict[str, Fraction]) -> dict[str, Any]:
        told = proofs.exact_numbers(system, given)
        return proofs.certificate_entries(system, told, proofs.decide(system, told))

    payload = verdict(numbers)
    if payload["verdict"] != "REFUTED" or seed % 10 == 0:  # the others are replayed below
        proofs.check(system, payload)
    limit = float(numbers["band"])
    if payload["verdict"] == "CERTIFIED":
        worst = farthest(plain, states, ticks, seed + 1, 12)
        if worst > limit * (1 + 1e-9):
            return "CERTIFIED", f"seed {seed}: {worst:g} > {limit:g}, {plain}"
        for name in ("W", "e0"):
            less = verdict({**numbers, name: numbers[name] * Fraction(7, 10)})
            if less["verdict"] != "CERTIFIED":
                return "CERTIFIED", f"seed {seed}: not with less {name}, {plain}"
    if payload["verdict"] == "REFUTED":
        run = payload["counterexample"]["run"]
        x = np.zeros(states)
        x[0], most = run["start"][0] * plain["e0"], plain["e0"]
        for count, sign in run["pushes"]:
            for _ in range(count):
                x = after(plain, x, sign * plain["W"])
                most = max(most, abs(x[0]))
        if most < limit * (1 - 1e-6):
            return "REFUTED", f"seed {seed}: its run comes to {most:g} < {limit:g}"
    return payload["verdict"], ""


def _system(delay: int, within: bool, work: int) -> Any:
    """The loop as a person declares it; ``work`` is that of a search of cells."""
    from slipctl.certify.promise import INPUT, TARGET, Number, System
    from slipctl.certify.ticks.tick_sets import Loop

    def tick(n, x, d):
        e = x["e"]
        wanted = -n["K"] * e - x["i"]
        last = x[f"q{delay - 1}"] if delay else wanted
        nxt = {
            "e": e + n["T"] * (x["a"] - n["slope"] * e - n["bend"] * e * e + d["w"]),
            "i": x["i"] + n["T"] * n["Ki"] * e, "a": x["a"] + n["T"] / n["lag"] * (last - x["a"]),
        }  # fmt: skip
        return nxt | {f"q{k}": x[f"q{k - 1}"] if k else wanted for k in range(delay)}

    names = ["e", "i", "a", *(f"q{k}" for k in range(delay))]
    loop = Loop(tick, {s: "e0" if s == "e" else "none" for s in names}, {"w": "W"}, {"e": "band"},
                work=work)  # fmt: skip
    loop = replace(loop, within="ticks") if within else loop
    declared = {k: Number("1", k, low="any") for k in ("K", "Ki", "slope", "bend", "lag", "T")}
    declared |= {k: Number("1", k, 0.0, "not negative") for k in ("e0", "none")}
    declared["W"] = Number("1", "W", 0.0, "not negative", role=INPUT, says="every |w| <= {}")
    declared["band"] = Number("1", "wanted", optional=True, role=TARGET)
    declared["ticks"] = Number("1", "ticks", optional=True, role=INPUT, says="{} ticks")
    return System("own", "PI", declared, {}, loop.targets(), loop.says_start(), loop=loop)


def trial(n: int, seed: int) -> Tally:
    """What became of so many random loops, asked for ever."""
    return trial_of_cases(lambda at: one(at, within=False), n, seed)


def trial_of_tubes(n: int, seed: int) -> Tally:
    """The same for tubes."""
    return trial_of_cases(lambda at: one(at, within=True), n, seed)
